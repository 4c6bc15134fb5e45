"""The charts, from results."""

import matplotlib
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from tables import caption

COLOURS = {
    "this package": "#c8442b",
    "C": "#35507a",
    "NumPy": "#6f8f6a",
    "others": "#9aa7b8",
    "the machine": "#2c2c2c",
}
OURS, C, NUMPY, _, LIMIT = COLOURS.values()
SECOND = "#e0a03a"  # another line of this package
STYLE = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.markersize": 4,
}


def plain(label):
    """A label without Markdown."""
    return label.replace("`", "").replace("*", "")


def speed(results):
    """Last states and saved states, ours and peers, beside the limits.

    Saved states as shares of a limit: memory may have been faster for one row than for another.
    """
    last = [(row, row.rate) for row in results.best("last states")]
    saved = [(row, 100 * (results.share(row) or 0)) for row in results.best("saved states")]
    saved = sorted((pair for pair in saved if pair[1]), key=lambda pair: -pair[1])
    panels = [
        ("Last states only: steps per second", last, "{:.2e}"),
        ("Saved states: % of streaming stores", saved, "{:.0f}"),
    ]
    panels = [panel for panel in panels if panel[1]]
    heights = [len(rows) for _, rows, _ in panels]
    figure = Figure(figsize=(11, 2 + 0.31 * sum(heights)), layout="constrained")
    axes = figure.subplots(max(len(panels), 1), squeeze=False, height_ratios=heights or None)
    for axis, (title, rows, written) in zip(axes[:, 0], panels, strict=False):
        values = [value for _, value in rows]
        colours = [COLOURS[row.whose] for row, _ in rows]
        axis.barh(range(len(rows)), values, color=colours, height=0.72)
        axis.set_yticks(range(len(rows)), [plain(row.label) for row, _ in rows])
        for y, (row, value) in enumerate(rows):
            # Figures stand beside the axes, where no line crosses them.
            error = f"error {row.error:.0e}" if row.error is not None else ""
            for x, text in ((1.09, written.format(value)), (1.23, error)):
                place = {"transform": axis.get_yaxis_transform(), "ha": "right", "va": "center"}
                axis.text(x, y, text, fontsize=9, **place)
            if row.whose == "the machine":
                axis.axvline(value, color=LIMIT, linestyle="--", linewidth=1)
        axis.invert_yaxis()
        axis.margins(y=0.02)
        axis.tick_params(axis="y", length=0)
        axis.set_title(title)
    if last:
        axes[0, 0].set_xscale("log")
    handles = [Patch(color=colour, label=name) for name, colour in COLOURS.items()]
    axes[-1, 0].legend(handles=handles, loc="upper center", bbox_to_anchor=(0.4, -0.08), ncols=6)
    return figure


AUTO = {"color": OURS, "marker": "o", "label": 'iterate, method="auto"'}
CANONICAL = {"color": SECOND, "marker": "s", "label": 'iterate, method="canonical"'}
EXACT = {"color": C, "marker": "^", "linestyle": "--", "label": "exact"}
METHODS = {"auto": AUTO, "canonical": CANONICAL, "exact": EXACT}
DIMENSIONS = {
    "rank2": {"color": OURS, "marker": "o", "label": 'method="rank2"'},
    "c-rank2": {"color": C, "marker": "s", "label": "C, rank two"},
    "numpy-rank2": {"color": NUMPY, "marker": "^", "label": "NumPy, rank two"},
    "gauss": {"color": OURS, "marker": "o", "linestyle": ":", "label": 'method="gauss"'},
    "c-elimination": {"color": C, "marker": "s", "linestyle": ":", "label": "C, elimination"},
    "numpy-solve": {
        "color": NUMPY,
        "marker": "^",
        "linestyle": ":",
        "label": "NumPy, linalg.solve",
    },
}
# Table, title, labels of the axes, styles of the keys.
PANELS = (
    ("batch", "Batch (last states, 50 steps)", "orbits", "1e9 steps per second", METHODS),
    ("few orbits", "All states, 5e6 in all", "orbits", "% of streaming stores", METHODS),
    ("save_every", "Saved states that lie apart", "save_every", "ns per saved state", METHODS),
    ("n dimensions", "Dimension (one thread)", "n - 1", "ns per step of one orbit", DIMENSIONS),
)


def height(results, row, unit):
    """The value of a row in the unit of its panel."""
    if unit.startswith("%"):
        return 100 * (results.share(row) or 0)
    return 1e9 / row.rate if unit.startswith("ns") else row.rate / 1e9


def scaling(results):
    """Against everything that may grow."""
    figure = Figure(figsize=(11, 9), layout="constrained")
    for axis, panel in zip(figure.subplots(2, 2).flat, PANELS, strict=True):
        table, title, x, y, styles = panel
        for key, style in styles.items():
            points = sorted((row.x, height(results, row, y)) for row in results.of(table, key=key))
            if points:
                axis.plot(*zip(*points, strict=True), **style)
        if y.startswith("%"):
            axis.axhline(100, color=LIMIT, linestyle="--", linewidth=1.2, label="streaming stores")
            axis.set_ylim(bottom=0)
        else:
            axis.set_yscale("log")
        axis.set(title=title, xlabel=x, ylabel=y, xscale="log")
        axis.grid(alpha=0.25, which="major")
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
    return figure


def draw(results, folder):
    """All charts, each with the machine and the versions below."""
    with matplotlib.rc_context(STYLE):
        for name, chart in (("speed", speed), ("scaling", scaling)):
            figure = chart(results)
            figure.supxlabel(caption(results).replace("; ", "\n"), fontsize=8, color="#555555")
            figure.savefig(folder / f"{name}.png", dpi=130, bbox_inches="tight", pad_inches=0.15)
