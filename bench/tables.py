"""Results as tables in Markdown: one for the README, all of them for a file of their own."""

from results import Limit, Table, Whose

HEADLINE = ("auto", "canonical", "c-printed", "numpy")
BEGIN, END = "<!-- begin of the tables -->", "<!-- end of the tables -->"


def figure(value, digits=3):
    """A number in so many digits, without exponent."""
    return "" if value is None else f"{float(f'{value:.{digits}g}'):,.10g}"


def percent(value):
    """A share in percent."""
    return "" if value is None else f"{100 * value:.0f} %"


def error(value):
    """An error, in one digit."""
    return "" if value is None else f"{value:.0e}"


def ratio(value, base):
    """How many times a base, in two digits; empty without one."""
    return figure(value / base, 2) if value and base else ""


def per_unit(row, scale):
    """Time per unit of work, in seconds over `scale`."""
    return figure(scale / row.rate) if row else ""


def spelled(threads):
    """So many threads."""
    return f"{threads} thread" + "s" * (threads > 1)


def named(row, threads):
    """What a row is called: ours in bold, with its threads where others have more."""
    label = f"**suslov_fast**, {row.label}" if row.whose is Whose.OURS else row.label
    return label + (", one thread" if row.threads < threads else "")


def markdown(header, lines):
    """A table whose columns but the first are numbers."""
    head = ["| " + " | ".join(header) + " |", "|---|" + "---:|" * (len(header) - 1)]
    return "\n".join(head + ["| " + " | ".join(line) + " |" for line in lines])


def ordered(lines):
    """Lines without the rates in front of them, by which they are sorted, fastest first."""
    return [line for _, line in sorted(lines, key=lambda each: -each[0])]


def last_states(results):
    """Steps per second, and what share of the divider they need."""
    base = results.one(Table.LAST, "c-printed")
    base = base and base.rate
    lines = []
    for row in results.best(Table.LAST):
        divisions = row.limit[1] if row.limit else None
        cells = [figure(row.rate / 1e9), ratio(row.rate, base), figure(divisions)]
        cells += [percent(results.share(row)), error(row.error)]
        lines.append((row.rate, [named(row, results.threads), *cells]))
    limit = results.limit(Limit.DIVISIONS, results.threads)
    if limit:
        cells = [figure(limit / 1e9), ratio(limit, base), "1", "100 %", ""]
        lines.append((limit, ["*limit: one division per step*", *cells]))
    header = ["", "1e9 steps/s", "of C as printed", "divisions per step", "of the divider", "error"]
    return markdown(header, ordered(lines))


def headline(results):
    """The rows that say most: ours, the fastest in C, what the paper prints in C and in NumPy."""
    fastest = next(iter(results.best(Table.LAST, whose=Whose.C)), None)
    of_keys = [row for row in results.best(Table.LAST) if row.key in HEADLINE]
    base = results.one(Table.LAST, "c-printed")
    lines = []
    for row in of_keys if fastest is None or fastest in of_keys else [fastest, *of_keys]:
        cells = [figure(row.rate / 1e9), ratio(row.rate, base and base.rate), error(row.error)]
        lines.append((row.rate, [named(row, results.threads), *cells]))
    return markdown(["", "1e9 steps/s", "of C as printed", "error"], ordered(lines))


def saved_states(results):
    """States per second, and what share of streaming stores they reach."""
    lines = []
    for row in results.best(Table.SAVED):
        cells = [figure(row.rate / 1e9), figure(16 * row.rate / 1e9)]
        cells += [percent(results.share(row)), error(row.error)]
        lines.append((row.rate, [named(row, results.threads), *cells]))
    for what, threads in (
        (Limit.STREAMING, results.threads),
        (Limit.PLAIN, results.threads),
        (Limit.NEW, 1),
    ):
        row = results.one(Table.LIMITS, what, threads=threads)
        if row:
            rate = results.limit(what, threads)
            share = "100 %" if what is Limit.STREAMING else percent(results.share(row))
            cells = [figure(rate / 16e9), figure(rate / 1e9), share, ""]
            label = f"*limit: {row.label}{', one thread' * (what is Limit.NEW)}*"
            lines.append((rate / 16, [label, *cells]))
    return markdown(["", "1e9 states/s", "GB/s", "of streaming stores", "error"], ordered(lines))


def columns(results, rows, cell, header, more=None):
    """A table with a line for each key and number of threads, and a column for each x.

    `cell` makes text of a row; `more` is a last column, (header, text of all rows of the line).
    """
    places = sorted({row.x for row in rows})
    lines = {}
    for row in rows:
        lines.setdefault((row.key, row.whose, row.threads), {})[row.x] = row
    texts = []
    for cells in sorted(lines.values(), key=lambda cells: -cells[max(cells)].rate):
        line = [named(next(iter(cells.values())), results.threads)]
        line += [cell(cells[x]) if x in cells else "" for x in places]
        texts.append(line + ([more[1](list(cells.values()))] if more else []))
    head = [header, *(f"{x:,}" for x in places), *([more[0]] if more else [])]
    return markdown(head, texts)


def largest_error(rows):
    """The largest error of some rows."""
    return error(max((row.error for row in rows if row.error is not None), default=None))


def few_orbits(results):
    """Shares of streaming stores against the number of orbits."""
    rows = results.best(Table.FEW)
    return columns(results, rows, lambda row: percent(results.share(row)), "orbits")


def simple(results, table):
    """Millions per second, and errors."""
    lines = [
        [named(row, results.threads), figure(row.rate / 1e6), error(row.error)]
        for row in results.best(table)
    ]
    unit = next((row.unit for row in results.of(table)), "units")
    return markdown(["", f"1e6 {unit}/s", "error"], lines)


def observables(results):
    """Each quantity beside NumPy's formula, a copy of as many bytes, and itself on one thread."""
    new = results.limit(Limit.NEW_COPY, 1)
    lines = []
    for row in results.best(Table.OBSERVABLES, whose=Whose.OURS):
        one = results.one(Table.OBSERVABLES, row.key, whose=Whose.OURS, threads=1)
        numpy = results.one(Table.OBSERVABLES, row.key, whose=Whose.NUMPY)
        numpys = numpy and numpy.rate
        cells = [per_unit(row, 1e9), per_unit(one, 1e9), per_unit(numpy, 1e9)]
        cells += [ratio(row.rate, numpys), ratio(one and one.rate, numpys)]
        cells += [percent(results.share(row)), ratio(row.rate * row.limit[1], new)]
        lines.append((row.rate, [row.label, *cells, error(row.error)]))
    header = [
        "ns per state",
        spelled(results.threads),
        "one thread",
        "NumPy",
        "times NumPy",
        "one thread, times NumPy",
        "of a copy in C",
        "times `ndarray.copy`",
        "error",
    ]
    return markdown(header, ordered(lines))


def dimensions(results):
    """Nanoseconds per step, by components."""
    rows = results.of(Table.ND)
    more = ("largest error", largest_error)
    return columns(results, rows, lambda row: per_unit(row, 1e9), "n - 1 =", more)


def dimensions_saved(results):
    """Shares of streaming stores, by components."""
    rows = results.best(Table.ND_SAVED)
    return columns(results, rows, lambda row: percent(results.share(row)), "n - 1 =")


def save_every(results):
    """Nanoseconds per saved state, by what lies between."""
    return columns(
        results, results.best(Table.EVERY), lambda row: per_unit(row, 1e9), "`save_every` ="
    )


def batches(results):
    """Steps per second, by the size of the batch."""
    return columns(results, results.best(Table.BATCH), lambda row: figure(row.rate / 1e9), "orbits")


def attitude(results):
    """Nanoseconds per step."""
    return columns(results, results.best(Table.ATTITUDE), lambda row: per_unit(row, 1e9), "n =")


def calls(results):
    """Microseconds per call."""
    lines = [[row.label, per_unit(row, 1e6)] for row in results.of(Table.CALLS)]
    return markdown(["a call", "µs"], lines)


def starts(results):
    """Seconds per process, and as a multiple of `import numba`."""
    base = results.one(Table.STARTS, "import-numba")
    lines = [
        [row.label, figure(row.seconds, 2), ratio(row.seconds, base and base.seconds)]
        for row in results.of(Table.STARTS)
    ]
    return markdown(["a process", "seconds", "of `import numba`"], lines)


def caption(results):
    """Machine, threads, date and versions, in one line."""
    versions = ", ".join(f"{name} {value}" for name, value in results.machine["versions"].items())
    threads = spelled(results.threads)
    return f"{results.machine['processor']}, {threads}, {results.date}; {versions}"


def conditions(results):
    """What all tables have in common."""
    return (
        f"Measured on {caption(results)}. The best of each in {results.passes} "
        f"interleaved pass{'es' * (results.passes > 1)}. Errors are "
        "the largest relative ones of 64 trajectories (8 in n dimensions) against long doubles. A "
        "limit is the most that its own benchmark, or any other, got of it; but a share of "
        "streaming stores is the median of those of calls and stores that take turns, for the "
        "memory of a shared machine is fast and slow for seconds at a time. "
        f"All rows on {spelled(results.threads)} unless they say otherwise."
    )


LAST = (
    "**Last states** of 65,536 trajectories after 1000 steps; slower peers do a part of it. A "
    "share of the divider is that of the divisions which the form needs; what needs fewer than "
    "one per step can pass the limit of one per step.",
    last_states,
)
SAVED = (
    "**Saved states**: 257 of each of 65,536 trajectories, 16 bytes each:",
    saved_states,
)
JUMPS = (
    "**Any state by the closed form**: n = 1,000,000 for 65,536 orbits where nothing else is said; "
    "the error is that for n = 1000:",
    lambda results: simple(results, Table.JUMPS),
)
MOTION = (
    "**The continuous motion** to t = 200, the time of those 1000 steps: what one would do "
    "without the map. Errors are against the motion, not the map:",
    lambda results: simple(results, Table.MOTION),
)
DIMENSIONS = (
    "**In n dimensions**, nanoseconds per step of one trajectory, 512 trajectories:",
    dimensions,
)
OBSERVABLES = (
    "**Quantities** of 10,000,000 states, into new memory. NumPy's formula has one thread. The "
    "copies read and write as many bytes in all, in C into memory that is used again and with "
    "all threads, by `ndarray.copy` into new memory with one; shares are of their speed:",
    observables,
)
FEW = (
    "**Few orbits**, 5,000,000 states in all, as shares of streaming stores:",
    few_orbits,
)
EVERY = (
    "**Saved states that lie apart**: 50 of each of 4096 orbits, nanoseconds per saved state:",
    save_every,
)
BATCHES = ("**Batches of any size**, last states after 50 steps, 1e9 steps per second:", batches)
DIMENSIONS_SAVED = (
    "**In n dimensions, all states** of 4096 orbits, as shares of streaming stores:",
    dimensions_saved,
)
ATTITUDE = (
    "**Orientations** of 4096 bodies, 100 steps, into new memory, nanoseconds per step:",
    attitude,
)
CALLS = ("**Small calls**:", calls)
STARTS = ("**Processes** from start to end:", starts)

PAGE = "bench/results/tables.md"
PICTURES = (
    "![Steps per second of this package and of others, beside limits of the machine](speed.png)",
    "![Time per state of each quantity, beside NumPy and copies](observables.png)",
    "![Against the batch, what lies between saved states, steps, n and threads](scaling.png)",
)
ALL = (
    *(LAST, SAVED, FEW, EVERY, BATCHES, JUMPS, MOTION, OBSERVABLES),
    *(DIMENSIONS, DIMENSIONS_SAVED, ATTITUDE, CALLS, STARTS),
)


def sections(results, chosen):
    """Texts and tables, of what was measured."""
    texts = [conditions(results)]
    for text, table in chosen:
        made = table(results)
        if made.count("\n") > 1:
            texts += [text, made]
    return "\n\n".join(texts)


def summary(results):
    """The table of the README, with the markers around it."""
    text = (
        "Steps per second for the last states of 65,536 trajectories after 1000 steps, with the "
        f"largest relative error of 64 of them. Measured on {caption(results)}."
    )
    rest = (
        f"[All tables]({PAGE}), with the limits of the machine and where this package loses: saved "
        "states, few orbits, quantities, n dimensions, orientations, small calls, processes."
    )
    return "\n\n".join([BEGIN, text, headline(results), rest, END])


def everything(results):
    """A page with all tables, beside the charts."""
    return "\n\n".join(["# Benchmarks", *PICTURES, sections(results, ALL)]) + "\n"


def replace(text, new):
    """The text with new tables between its markers."""
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"expected one {BEGIN!r} and one {END!r}")
    head, rest = text.split(BEGIN)
    return head + new + rest.split(END)[1]
