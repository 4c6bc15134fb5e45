"""The chart of the results."""

import matplotlib
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from tables import caption

# Colour and marker of each kind of row.
KINDS = {
    "this package": ("#c8442b", "o"),
    "C": ("#35507a", "s"),
    "NumPy": ("#6f8f6a", "^"),
    "others": ("#9aa7b8", "D"),
    "the machine": ("#2c2c2c", "|"),
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
        ("Saved states: % of the fastest stores", saved, "{:.0f}", "linear"),
    ]
    heights = [1 + len(rows) for _, rows, _, _ in panels]
    figure = Figure(figsize=(11, 1.4 + 0.31 * sum(heights)), layout="constrained")
    axes = figure.subplots(len(panels), height_ratios=heights)
    for axis, (title, rows, written, scale) in zip(axes, panels, strict=True):
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
                axis.axvline(value, color=colour, linestyle="--", linewidth=1)
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


def draw(results, folder):
    """Save the chart, with the machine and the versions below."""
    with matplotlib.rc_context(STYLE):
        figure = speed(results)
        figure.supxlabel(caption(results).replace("; ", "\n"), fontsize=8, color="#555555")
        figure.savefig(folder / "speed.png", dpi=130, bbox_inches="tight", pad_inches=0.15)
