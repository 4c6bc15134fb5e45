"""The charts, from results."""

import matplotlib
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from results import Limit, Table, Whose
from tables import caption, error

COLOURS = {
    Whose.OURS: "#c8442b",
    Whose.C: "#35507a",
    Whose.NUMPY: "#6f8f6a",
    Whose.OTHER: "#9aa7b8",
    Whose.MACHINE: "#2c2c2c",
}
NAMES = {
    Whose.OURS: "suslov_fast",
    Whose.C: "C by gcc",
    Whose.NUMPY: "NumPy",
    Whose.OTHER: "others",
}
OURS, C, NUMPY, OTHER, LIMIT = COLOURS.values()
SECOND = "#e0a03a"  # another line of this package
NOTE = "#555555"
LEGEND = {"frameon": False, "fontsize": 8.5}
STYLE = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
}


def plain(label):
    """A label without Markdown."""
    return label.replace("`", "")


def speed(results, path):
    """Last states and saved states, ours and peers, beside the limits.

    Saved states as shares of a limit: memory may have been faster for one row than for another.
    """
    threads = results.threads
    last, saved = results.best(Table.LAST), results.best(Table.SAVED)
    shares = {row.name: 100 * (results.share(row) or 0) for row in saved}
    stores = results.one(Table.LIMITS, Limit.PLAIN, threads=threads)
    panels = [
        (
            "Last states only: steps per second",
            [(row, row.rate) for row in last],
            {"one division per step": results.limit(Limit.DIVISIONS, threads)},
            ("per second", scientific),
        ),
        (
            "Saved states: % of streaming stores",
            sorted(((row, shares[row.name]) for row in saved), key=lambda pair: -pair[1]),
            {
                "streaming stores": 100.0,
                "plain stores": stores and 100 * (results.share(stores) or 0),
            },
            ("%", lambda share: f"{share:.0f}"),
        ),
    ]
    panels = [panel for panel in panels if panel[1]]
    if not panels:
        return
    heights = [len(rows) for _, rows, _, _ in panels]
    figure = Figure(figsize=(11, 2.6 + 0.31 * sum(heights)), layout="constrained")
    axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)
    for axis, (title, rows, limits, column) in zip(axes[:, 0], panels, strict=True):
        bars(axis, rows, {name: value for name, value in limits.items() if value}, column)
        axis.set_title(title)
        if column[1] is scientific:
            axis.set_xscale("log")
            axis.set_xlim(min(value for _, value in rows) / 2, 1.3 * axis.get_xlim()[1])
    save(figure, results, path)


def bars(axis, rows, limits, column):
    """Horizontal bars of rows and their values, with limits as lines.

    column   The header of the values, and how they are written.
    """
    places, values = range(len(rows)), [value for _, value in rows]
    rows = [row for row, _ in rows]
    axis.barh(places, values, color=[COLOURS[row.whose] for row in rows], height=0.72)
    axis.set_yticks(places, [plain(row.label) for row in rows])
    # Figures stand beside the axes, where no line crosses them.
    columns = [
        (1.10, column[0], [column[1](value) for value in values]),
        (1.20, "error", [error(row.error) for row in rows]),
    ]
    for x, header, texts in columns:
        place = {"transform": axis.get_yaxis_transform(), "ha": "right", "va": "center"}
        axis.text(x, -0.9, header, color=NOTE, fontsize=8.5, **place)
        for y, text in enumerate(texts):
            axis.text(x, y, text, fontsize=9, **place)
    axis.invert_yaxis()
    axis.margins(y=0.02)
    axis.set_xlim(0, max([*values, *limits.values()]) * 1.03)
    shown = [whose for whose in NAMES if any(row.whose is whose for row in rows)]
    handles = [Patch(color=COLOURS[whose], label=NAMES[whose]) for whose in shown]
    for style, (name, value) in zip(("--", ":"), limits.items(), strict=False):
        line = axis.axvline(
            value, color=LIMIT, linestyle=style, linewidth=1.2, label=f"limit: {name}"
        )
        handles.append(line)
    below = {"loc": "upper center", "bbox_to_anchor": (0.4, -0.09), "ncols": 6}
    axis.legend(handles=handles, **LEGEND, **below)
    axis.tick_params(axis="y", length=0)


def scientific(value):
    """Three digits and an exponent."""
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def observables(results, path):
    """Nanoseconds per state: on all threads, on one, by NumPy, and what copies take."""
    ours = results.best(Table.OBSERVABLES, whose=Whose.OURS)
    if not ours:
        return
    figure = Figure(figsize=(9, 1.8 + 0.36 * len(ours)), layout="constrained")
    axis = figure.subplots()
    copy = results.limit(Limit.COPY, results.threads)
    new = results.limit(Limit.NEW_COPY, 1)
    kinds = {
        f"suslov_fast, {results.threads} threads": ({"color": OURS}, "o"),
        "suslov_fast, one thread": ({"markeredgecolor": OURS, "color": "white"}, "o"),
        "NumPy's formula, one thread": ({"color": NUMPY}, "s"),
        "a copy of as many bytes in C, reused memory": ({"color": LIMIT, "markersize": 13}, "|"),
        "the same by ndarray.copy, new memory": ({"color": SECOND, "markersize": 13}, "|"),
    }
    for y, row in enumerate(ours):
        one = results.one(Table.OBSERVABLES, row.key, whose=Whose.OURS, threads=1)
        numpy = results.one(Table.OBSERVABLES, row.key, whose=Whose.NUMPY)
        count = row.limit[1]
        rates = [row.rate, one and one.rate, numpy and numpy.rate]
        rates += [copy and copy / count, new and new / count]
        times = [1e9 / rate if rate else None for rate in rates]
        found = [time for time in times if time]
        axis.plot([min(found), max(found)], [y, y], color="#dddddd", linewidth=1, zorder=0)
        for time, (style, marker) in zip(times, kinds.values(), strict=True):
            if time:
                axis.plot(time, y, marker, **{"markersize": 6.5} | style)
    axis.set_yticks(range(len(ours)), [plain(row.label) for row in ours])
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_xlabel("ns per state")
    axis.set_title("Quantities of 10,000,000 states")
    axis.grid(alpha=0.25, axis="x")
    handles = [
        Line2D([], [], linestyle="", marker=marker, label=name, **{"markersize": 6.5} | style)
        for name, (style, marker) in kinds.items()
    ]
    below = {"loc": "upper center", "bbox_to_anchor": (0.4, -0.11), "ncols": 2}
    axis.legend(handles=handles, **LEGEND, **below)
    save(figure, results, path)


def scaling(results, path):
    """Against everything that may grow."""
    figure = Figure(figsize=(15, 9.6), layout="constrained")
    panels = (batch, few, save_every, steps, dimension, by_threads)
    for axis, panel in zip(figure.subplots(2, 3).flat, panels, strict=True):
        panel(axis, results)
        axis.grid(alpha=0.25, which="major")
    save(figure, results, path)


METHODS = {
    "auto": {"color": OURS, "marker": "o", "markersize": 4},
    "canonical": {"color": SECOND, "marker": "s", "markersize": 4},
    "exact": {"color": C, "marker": "^", "markersize": 4, "linestyle": "--"},
}
NAMED = {
    "auto": 'iterate, method="auto"',
    "canonical": 'iterate, method="canonical"',
    "exact": "exact",
}


def lines(axis, rows, value, styles, names=None):
    """A line for each key, over x."""
    for key in styles:
        points = sorted((row.x, value(row)) for row in rows if row.key == key)
        if points:
            label = names and names.get(key)
            label = label or next(plain(row.label) for row in rows if row.key == key)
            axis.plot(*zip(*points, strict=True), label=label, **styles[key])


def dress(axis, title, x, y, logarithmic=True):
    """Titles, scales and the legend."""
    axis.set_title(title)
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    if logarithmic:
        axis.set_xscale("log")
        axis.set_yscale("log")
    if axis.get_legend_handles_labels()[0]:
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, **LEGEND)


def batch(axis, results):
    """Steps per second for one orbit and for a hundred million."""
    rows = results.best(Table.BATCH)
    lines(axis, rows, lambda row: row.rate / 1e9, METHODS, NAMED)
    dress(axis, "Batch (last states, 50 steps)", "orbits", "1e9 steps per second")


def few(axis, results):
    """Shares of streaming stores for few orbits."""
    rows = [row for row in results.best(Table.FEW) if row.key in ("auto", "canonical")]
    share = {row.name: results.share(row) for row in rows}
    rows = [row for row in rows if share[row.name]]
    lines(axis, rows, lambda row: 100 * share[row.name], METHODS, NAMED)
    if rows:
        axis.axhline(100, color=LIMIT, linestyle="--", linewidth=1.2, label="streaming stores")
    dress(axis, "All states of few orbits, 5e6 in all", "orbits", "% of streaming stores", False)
    axis.set_xscale("log")
    axis.set_ylim(bottom=0)


def save_every(axis, results):
    """Time per saved state, by what lies between."""
    rows = results.best(Table.EVERY)
    lines(axis, rows, lambda row: 1e9 / row.rate, METHODS, NAMED)
    dress(axis, "Saved states that lie apart", "save_every", "ns per saved state")


def steps(axis, results):
    """Time for the last state of a batch, by its number."""
    rows = results.best(Table.STEPS)
    lines(axis, rows, lambda row: 1e6 * row.seconds, METHODS, NAMED)
    dress(axis, "Number of steps (last states of 4096 orbits)", "n", "µs")


def dimension(axis, results):
    """One step in n dimensions, this package and others, on one thread."""
    rows = results.of(Table.ND, threads=1)
    styles = {
        "rank2": {"color": OURS, "marker": "o"},
        "c-rank2": {"color": C, "marker": "s"},
        "numpy-rank2": {"color": NUMPY, "marker": "^"},
        "gauss": {"color": OURS, "marker": "o", "linestyle": ":"},
        "c-elimination": {"color": C, "marker": "s", "linestyle": ":"},
        "numpy-solve": {"color": NUMPY, "marker": "^", "linestyle": ":"},
    }
    styles = {key: {"markersize": 4} | style for key, style in styles.items()}
    lines(axis, rows, lambda row: 1e9 / row.rate, styles)
    dress(axis, "Dimension (one thread)", "n - 1", "ns per step of one orbit")
    axis.set_xticks(sorted({row.x for row in rows}), minor=False)
    axis.set_xticks([], minor=True)
    axis.xaxis.set_major_formatter(lambda n, _: f"{n:g}")


def by_threads(axis, results):
    """From one thread to all."""
    rows = results.of(Table.THREADS)
    one = {row.key: row.rate for row in rows if row.threads == 1}
    styles = {
        key: {"color": colour, "marker": marker, "markersize": 5}
        for key, colour, marker in (("last", OURS, "o"), ("saved", SECOND, "s"), ("nd", C, "^"))
    }
    lines(
        axis, [row for row in rows if row.key in one], lambda row: row.rate / one[row.key], styles
    )
    most = max((row.threads for row in rows), default=1)
    axis.plot([1, most], [1, most], color=LIMIT, linestyle="--", linewidth=1, label="ideal")
    dress(axis, "Threads", "threads", "times as fast as on one", False)
    axis.set_xticks(sorted({row.threads for row in rows}))
    axis.set_ylim(bottom=0)


def save(figure, results, path):
    """Say where the figures come from, and write the file."""
    figure.supxlabel(caption(results).replace("; ", "\n"), fontsize=8, color=NOTE)
    figure.savefig(path, dpi=130, bbox_inches="tight", pad_inches=0.15)


def draw(results, folder):
    """All charts."""
    with matplotlib.rc_context(STYLE):
        speed(results, folder / "speed.png")
        observables(results, folder / "observables.png")
        scaling(results, folder / "scaling.png")
