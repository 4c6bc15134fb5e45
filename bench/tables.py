"""Results as Markdown: the pages of the folder `pages`, with a table in the place of each comment.

A comment has the name of a table and the headers of its columns; the first header is optional. The
comment "floors" becomes a table of the ratios of `floors.ROWS`.
"""

import re

import floors
from results import BENCH

TABLE = re.compile(r"^<!-- ([\w ]+?)(?: by (.*?))?: (.*) -->$", re.M)
# README has these rows of some tables.
SHORT = " in short"
HEADLINES = "iterate", "flow", "order8", "c", "dop853", "heyoka", "numpy", "scipy"
BEGIN, END = "<!-- begin of the tables -->", "<!-- end of the tables -->"


def figure(value, digits=3):
    """Format a number with some significant digits, without exponent."""
    return f"{float(f'{value:.{digits}g}'):,.10g}"


def rate(scale):
    """Units per second, divided by a scale."""
    return lambda results, row: figure(row.rate / scale)


def time(scale, digits=3):
    """Seconds per unit of work, times a scale."""
    return lambda results, row: figure(scale / row.rate, digits)


def beside(name, times=False):
    """Rate, or time, relative to that of another row."""

    def column(results, row):
        base = results.rows.get(name, row)
        ratio = base.rate / row.rate if times else row.rate / base.rate
        return "" if base is row else figure(ratio, 2)

    return column


def share(results, row):
    value = results.share(row)
    return "" if value is None else f"{100 * value:.0f} %"


COLUMNS = {
    "GB/s": rate(1e9 / 16),
    "ns": time(1e9),
    "µs": time(1e6),
    "seconds": lambda results, row: figure(row.seconds, 2),
    "error": lambda results, row: "" if row.error is None else f"{row.error:.0e}",
    "of the divider": share,
    "of the fastest stores": share,
    "relative to C": beside("last_states-c-printed"),
    "of `numpy.linalg.solve`": beside("calls-solve", times=True),
    "of `import numba`": beside("processes-import-numba", times=True),
}


def table(results, name, across, columns):
    """A table; with `across`, it has a line for each key and a column for each x.

    "orders in short and inside" has the columns of both tables, and the lines of the first.
    """
    rows = [row for each in name.split(" and ") for row in rows_of(results, each)]
    if not rows:
        return "Not measured yet."
    headers, counts = columns.split(" | "), {row.threads for row in rows}
    cells = [COLUMNS.get(header) or rate(float(header.split()[0])) for header in headers]
    lines = [[named(row, counts), *(cell(results, row) for cell in cells)] for row in rows]
    if across:
        found, labels = {}, {}
        for row, (label, cell) in zip(rows, lines, strict=True):
            labels.setdefault(row.key, label)
            found.setdefault(row.key, {})[row.x] = cell
        places, headers = places_of(rows)
        lines = [[labels[key], *(line.get(x, "") for x in places)] for key, line in found.items()]
    lines = [[across or "", *headers], ["---"] + ["---:"] * len(headers), *lines]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def rows_of(results, name):
    rows = results.of(name.removesuffix(SHORT))
    return [row for row in rows if not name.endswith(SHORT) or row.key in HEADLINES]


def places_of(rows):
    """All x of some rows, numbers first and errors from the largest one, and their headers."""
    numbers = sorted({row.x for row in rows if not isinstance(row.x, str)})
    texts = sorted({row.x for row in rows if isinstance(row.x, str)})
    headers = [f"{x:,}" for x in numbers]
    if numbers and 0 < numbers[-1] < 0.01:
        numbers.reverse()
        headers = [f"{x:.0e}".replace("e-0", "e-") for x in numbers]
    return numbers + texts, headers + texts


def named(row, counts):
    """Name of a row: ours in bold, with the number of threads if others have more."""
    ours = "**suslov_fast**, " if row.whose == "this package" else ""
    return ours + row.label + ", one thread" * (row.threads == 1 and counts != {1})


def floor(results, row, other, sign, bound):
    """Cells of a line: the ratio of two rows, its bound, and whether that is reached."""
    pair = [results.rows.get(name) for name in ((row, other) if sign == "≥" else (other, row))]
    if None in pair:
        return ["", f"{sign} {bound}", ""]
    ratio = pair[0].rate / pair[1].rate
    reached = ratio >= bound if sign == "≥" else ratio <= bound
    return [figure(ratio), f"{sign} {bound}", "yes" if reached else "**no**"]


def floors_of(results):
    """The table of all floors."""
    lines = [["", "measured", "wanted", "reached"], ["---", "---:", "---:", "---:"]]
    lines += [[label, *floor(results, *rest)] for label, *rest in floors.ROWS]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def caption(results):
    """Machine, threads, date and versions, in one line."""
    versions = ", ".join(f"{name} {value}" for name, value in results.machine["versions"].items())
    processor, threads = results.machine["processor"], results.machine["threads"]
    return f"{processor}, {threads} thread{'s' * (threads > 1)}, {results.date}; {versions}"


def page(results, name):
    """A page with all its tables."""
    text = (BENCH / "pages" / name).read_text(encoding="utf-8")
    text = text.replace("{the caption}", caption(results))
    text = text.replace("{the caption of motions}", caption(results.motions))
    text = TABLE.sub(lambda found: table(results, *found.groups()), text)
    return text.replace("<!-- floors -->", floors_of(results))


def replace(text, new):
    """Replace the tables between the markers of a text."""
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        raise ValueError(f"expected one {BEGIN!r} and one {END!r}")
    return text.split(BEGIN)[0] + new.strip() + text.split(END)[1]
