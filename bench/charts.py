"""Charts of the results."""

import matplotlib
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from tables import caption

OURS, C, NUMPY, LIMIT = "#c8442b", "#35507a", "#6f8f6a", "#2c2c2c"
SECOND = "#e0a03a"  # second line of this package
# Colour and marker of each kind of row.
KINDS = {
    "this package": (OURS, "o"),
    "C": (C, "s"),
    "NumPy": (NUMPY, "^"),
    "others": ("#9aa7b8", "D"),
    "the machine": (LIMIT, "|"),
}
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


def speed(results):
    """Draw last states and saved states, one dot per row, beside the limits of the machine.

    Saved states are shares of a limit, since the speed of memory may vary between rows.
    """
    last = [(row, row.rate) for row in results.best("last states")]
    shares = [(row, 100 * (results.share(row) or 0)) for row in results.best("saved states")]
    saved = sorted((pair for pair in shares if pair[1]), key=lambda pair: -pair[1])
    panels = [
        ("Last states only: steps per second", last, "{:.2e}", "log"),
        ("Saved states: % of streaming stores", saved, "{:.0f}", "linear"),
    ]
    panels = [panel for panel in panels if panel[1]]
    heights = [len(rows) for _, rows, _, _ in panels]
    figure = Figure(figsize=(11, 2 + 0.31 * sum(heights)), layout="constrained")
    axes = figure.subplots(max(len(panels), 1), squeeze=False, height_ratios=heights or None)[:, 0]
    for axis, (title, rows, written, scale) in zip(axes, panels, strict=False):
        labels = [row.label.replace("`", "").strip("*") for row, _ in rows]
        axis.set_yticks(range(len(rows)), labels)
        for y, (row, value) in enumerate(rows):
            colour, marker = KINDS[row.whose]
            axis.plot(value, y, marker, color=colour, markersize=9, markeredgewidth=2)
            # Numbers beside the axes, where no line crosses them.
            error = f"error {row.error:.0e}" if row.error is not None else ""
            for x, text in ((1.1, written.format(value)), (1.24, error)):
                place = {"transform": axis.get_yaxis_transform(), "ha": "right", "va": "center"}
                axis.text(x, y, text, fontsize=9, **place)
            if row.whose == "the machine":
                axis.axvline(value, color=LIMIT, linestyle="--", linewidth=1)
        axis.set(title=title, xscale=scale, ylim=(len(rows) - 0.4, -0.6))
        axis.set_xlim(left=0 if scale == "linear" else None)
        axis.grid(alpha=0.25, which="major")
        axis.tick_params(axis="y", length=0)
    style = {"linestyle": "", "markersize": 8, "markeredgewidth": 2}
    handles = [
        Line2D([], [], color=colour, marker=marker, label=name, **style)
        for name, (colour, marker) in KINDS.items()
    ]
    axes[-1].legend(handles=handles, loc="upper center", bbox_to_anchor=(0.4, -0.08), ncols=5)
    return figure


# Colour, marker, style and name of each line.
METHODS = {
    "auto": (OURS, "o", "-", 'iterate, method="auto"'),
    "canonical": (SECOND, "s", "-", 'iterate, method="canonical"'),
}
DIMENSIONS = {
    "rank2": (OURS, "o", "-", 'method="rank2"'),
    "c-rank2": (C, "s", "-", "C, rank two"),
    "gauss": (OURS, "o", ":", 'method="gauss"'),
    "c-elimination": (C, "s", ":", "C, elimination"),
    "numpy-solve": (NUMPY, "^", ":", "NumPy, linalg.solve"),
}
# Table, title, labels of the axes, styles of the keys.
PANELS = (
    ("batch", "Batch (last states, 50 steps)", "orbits", "1e9 steps per second", METHODS),
    ("few orbits", "All states, 5e6 in all", "orbits", "% of streaming stores", METHODS),
    ("save_every", "Saved states that lie apart", "save_every", "ns per saved state", METHODS),
    ("n dimensions", "Dimension (one thread)", "n - 1", "ns per step of one orbit", DIMENSIONS),
)


def height(results, row, unit):
    """Value of a row in the unit of its panel."""
    if unit.startswith("%"):
        return 100 * (results.share(row) or 0)
    return 1e9 / row.rate if unit.startswith("ns") else row.rate / 1e9


def scaling(results):
    """Draw rates against the batch size, `save_every` and n."""
    figure = Figure(figsize=(11, 9), layout="constrained")
    for axis, panel in zip(figure.subplots(2, 2).flat, PANELS, strict=True):
        table, title, x, y, styles = panel
        for key, (colour, marker, line, label) in styles.items():
            points = sorted((row.x, height(results, row, y)) for row in results.of(table, key=key))
            if points:
                look = {"color": colour, "marker": marker, "linestyle": line, "label": label}
                axis.plot(*zip(*points, strict=True), **look)
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
    """Save all charts, with the machine and the versions below."""
    with matplotlib.rc_context(STYLE):
        for name, chart in (("speed", speed), ("scaling", scaling)):
            figure = chart(results)
            figure.supxlabel(caption(results).replace("; ", "\n"), fontsize=8, color="#555555")
            figure.savefig(folder / f"{name}.png", dpi=130, bbox_inches="tight", pad_inches=0.15)
