"""Results as Markdown tables: one for the README, all of them for a separate page."""

import re
from typing import NamedTuple

BEGIN, END = "<!-- begin of the tables -->", "<!-- end of the tables -->"
RATE = re.compile("(?<=<!-- rate -->).*?(?=<!-- end of the rate -->)")
HEADLINE = ("auto", "canonical", "numba-blocks", "c-free", "c-printed", "numba", "numpy")


def figure(value, digits=3):
    """Format a number with some significant digits, without exponent."""
    return "" if value is None else f"{float(f'{value:.{digits}g}'):,.10g}"


def error_of(results, row):
    return "" if row.error is None else f"{row.error:.0e}"


def share(results, row):
    """Share of the limit of the machine, in percent."""
    value = results.share(row)
    return "" if value is None else f"{100 * value:.0f} %"


def rate(scale):
    """Column of units per second, divided by a scale."""
    return lambda results, row: figure(row.rate / scale)


def seconds_per_unit(scale):
    """Column of seconds per unit of work, times a scale."""
    return lambda results, row: figure(scale / row.rate)


def of_printed(results, row):
    """Rate relative to the printed map in C."""
    base = results.one("last states", "c-printed")
    return figure(row.rate / base.rate, 2) if base else ""


def times_numpy(results, row):
    """Our rate on one thread relative to NumPy's."""
    one = results.one(row.table, row.key, whose="this package", threads=1)
    numpy = results.one(row.table, row.key, whose="NumPy")
    return figure(one.rate / numpy.rate, 2) if one and numpy and row.whose != "NumPy" else ""


def of_import_numba(results, row):
    base = results.one("processes", "import-numba")
    return figure(row.seconds / base.seconds, 2) if base else ""


class Table(NamedTuple):
    """A table of results: the text above it, and columns (header, function of results and row).

    With `across`, a table has a line for each key and a column for each x; `across` is the header
    of the first column, and the single column is the function that fills the cells.
    """

    name: str
    text: str
    columns: tuple
    across: str | None = None

    def lines(self, results, keys=None):
        rows = [row for row in results.best(self.name) if keys is None or row.key in keys]
        if not rows:
            return ""
        if self.across:
            places, lines = sorted({row.x for row in rows}), {}
            for row in sorted(rows, key=lambda row: -row.x):  # the fastest at the largest x first
                lines.setdefault((row.key, row.whose), {})[row.x] = row
            header = [self.across, *(f"{x:,}" for x in places)]
            cells = [
                [self.columns[0](results, line[x]) if x in line else "" for x in places]
                for line in lines.values()
            ]
            rows = [next(iter(line.values())) for line in lines.values()]
        else:
            header = ["", *(name for name, _ in self.columns)]
            cells = [[cell(results, row) for _, cell in self.columns] for row in rows]
        named_cells = [[named(results, row), *some] for row, some in zip(rows, cells, strict=True)]
        table = [header, ["---"] + ["---:"] * (len(header) - 1), *named_cells]
        return "\n".join("| " + " | ".join(line) + " |" for line in table)


def named(results, row):
    """Name of a row: ours in bold, with the number of threads if others have more."""
    ours = "**suslov_fast**, " if row.whose == "this package" else ""
    counts = {each.threads for each in results.best(row.table)}
    few = row.threads == 1 and counts != {1} and row.table not in ("calls", "processes")
    return ours + row.label + ", one thread" * few


NS = seconds_per_unit(1e9)
OF_PRINTED, ERROR = ("of C as printed", of_printed), ("error", error_of)
README = Table("last states", "", (("1e9 steps/s", rate(1e9)), OF_PRINTED, ERROR))
SAVED = (("1e9 states/s", rate(1e9)), ("GB/s", rate(1e9 / 16)))
QUANTITIES = (("ns per state", NS), ("one thread, times NumPy", times_numpy))
SECONDS = ("seconds", lambda results, row: figure(row.seconds, 2))
TABLES = (
    Table(
        "last states",
        "**Last states** of 65,536 trajectories after 1000 steps; slower peers take a part of the "
        "trajectories. The closed form takes no steps: its row counts those that it replaces. A "
        "form with fewer than one division per step can pass the limit of one per step.",
        (("1e9 steps/s", rate(1e9)), OF_PRINTED, ("of the divider", share), ERROR),
    ),
    Table(
        "saved states",
        "**Saved states**: 257 of each of 65,536 trajectories, 16 bytes each:",
        (*SAVED, ("of the fastest stores", share), ERROR),
    ),
    Table(
        "few orbits",
        "**Few orbits**, 5,000,000 states in all, as shares of the fastest stores:",
        (share,),
        "orbits",
    ),
    Table(
        "save_every",
        "**Saved states that lie apart**: 50 of each of 4096 orbits, nanoseconds per saved state:",
        (NS,),
        "`save_every` =",
    ),
    Table(
        "batch",
        "**Batches of any size**, last states after 50 steps, 1e9 steps per second:",
        (rate(1e9),),
        "orbits",
    ),
    Table(
        "jumps",
        "**Any state by the closed form**, into new memory: n = 1,000,000 for 65,536 orbits, 256 n "
        "for 16,384 orbits, 1,000,000 scattered n in all. The error is that for n = 1000:",
        (("1e6 states/s", rate(1e6)), ERROR),
    ),
    Table(
        "motion",
        "**The continuous motion** to time 200, the time of 1000 steps: `flow` beside Suslov's "
        "solution in NumPy, which has no poles and no steps, and beside integrators. Errors are "
        "against the motion:",
        (("1e6 trajectories/s", rate(1e6)), ERROR),
    ),
    Table(
        "quantities",
        "**Quantities** of 10,000,000 states, into new memory. Shares are those of a copy in C of "
        "as many bytes, into memory that is used again:",
        (*QUANTITIES, ("of a copy in C", share), ERROR),
    ),
    Table(
        "n dimensions",
        "**In n dimensions**, nanoseconds per step of one of 512 trajectories, on one thread. All "
        "eliminations choose pivots:",
        (NS,),
        "n - 1 =",
    ),
    Table(
        "n dimensions, saved states",
        "**In n dimensions, all states** of 4096 orbits, as shares of the fastest stores:",
        (share,),
        "n - 1 =",
    ),
    Table(
        "fields",
        "**Quadratic fields**: the Lorenz system (D = 3, 16,384 trajectories) and a Volterra chain "
        "of 12 (4096), nanoseconds per step:",
        (NS,),
        "D =",
    ),
    Table(
        "space",
        "**Orientations and exponents** of 4096 bodies, 100 steps, nanoseconds per step:",
        (NS,),
        "n =",
    ),
    Table("calls", "**Small calls**:", (("µs", seconds_per_unit(1e6)),)),
    Table(
        "processes",
        "**Processes** from start to end:",
        (SECONDS, ("of `import numba`", of_import_numba)),
    ),
)
PICTURE = (
    "![Steps per second of this package and of others, beside limits of the machine](speed.png)"
)


def threads(results):
    count = results.machine["threads"]
    return f"{count} thread" + "s" * (count > 1)


def caption(results):
    """Machine, threads, date and versions, in one line."""
    versions = ", ".join(f"{name} {value}" for name, value in results.machine["versions"].items())
    return f"{results.machine['processor']}, {threads(results)}, {results.date}; {versions}"


def everything(results):
    """Page with all tables and the chart."""
    conditions = (
        f"Measured on {caption(results)}. The best of each in {results.passes} passes. Errors are "
        "the largest relative ones of 64 trajectories (8 in n dimensions) against long doubles. "
        "Limits are the highest rates of divisions, stores and copies seen in any row. All rows "
        f"are measured on {threads(results)} unless they say otherwise."
    )
    parts = ["# Benchmarks", PICTURE, conditions]
    for table in TABLES:
        lines = table.lines(results)
        parts += [table.text, lines] if lines else []
    return "\n\n".join(parts) + "\n"


def summary(results):
    """Table of the README, with the markers around it."""
    text = (
        "Steps per second for the last states of 65,536 trajectories after 1000 steps (fewer for "
        "naive loops), with the largest relative error of 64 of them. The closed form takes no "
        "steps: its row counts those that it replaces, as the command does. "
        f"Measured on {caption(results)}."
    )
    in_C = [row for row in results.best("last states") if row.whose == "C"]
    fastest = {max(in_C, key=lambda row: row.rate).key} if in_C else set()
    rest = (
        "[All tables](bench/results/tables.md), with the limits of the machine and where this "
        "package loses: saved states, few orbits, quantities, n dimensions, fields, orientations, "
        "small calls, processes."
    )
    return "\n\n".join([BEGIN, text, README.lines(results, fastest.union(HEADLINE)), rest, END])


def replace(text, new):
    """Replace the tables between the markers of a text."""
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"expected one {BEGIN!r} and one {END!r}")
    head, rest = text.split(BEGIN)
    if found := re.search(r'`method="canonical"`[^|]*\| ([\d.]+)', new):  # also in a sentence
        head = RATE.sub(found[1], head)
    return head + new + rest.split(END)[1]
