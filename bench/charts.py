"""The chart of the results."""

import textwrap

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
}
LABEL = 32  # letters of a line
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
        ("Last states", "steps per second", last, "{:.1e}", "log"),
        ("Saved states", "% of the rate of streaming stores", saved, "{:.0f} %", "linear"),
    ]
    heights = [1 + len(rows) for _, _, rows, _, _ in panels]
    figure = Figure(figsize=(10, 1.8 + 0.36 * sum(heights)), layout="constrained")
    axes = figure.subplots(len(panels), height_ratios=heights)
    for axis, (title, unit, rows, written, scale) in zip(axes, panels, strict=True):
        limits = [pair for pair in rows if pair[0].whose == "the machine"]
        dots = [pair for pair in rows if pair[0].whose != "the machine"]
        labels = [textwrap.fill(plain(row), LABEL) for row, _ in dots]
        axis.set_yticks(range(len(dots)), labels, fontsize=8.5, linespacing=0.9)
        # Numbers beside the axes, where no line crosses them.
        place = {"transform": axis.get_yaxis_transform(), "va": "center", "fontsize": 9}
        for y, (row, value) in enumerate(dots):
            colour, marker = KINDS[row.whose]
            axis.plot(value, y, marker, color=colour, markersize=9)
            axis.text(1.02, y, written.format(value), **place)
            axis.text(1.12, y, f"{row.error:.0e}" if row.error is not None else "", **place)
        axis.text(1.12, -0.9, "error", **place)
        for row, value in limits:
            axis.axvline(value, color="#2c2c2c", linestyle="--", linewidth=1)
            name = {"rotation": 90, "ha": "right", "va": "bottom", "fontsize": 8.5}
            axis.text(value, len(dots) - 0.5, plain(row).removeprefix("limit: ") + " ", **name)
        axis.set(title=title, xlabel=unit, xscale=scale, ylim=(len(dots) - 0.4, -0.6))
        axis.set_xlim(left=0 if scale == "linear" else None)
        axis.grid(alpha=0.25, which="major")
        axis.tick_params(axis="y", length=0)
    style = {"linestyle": "", "markersize": 8}
    handles = [
        Line2D([], [], color=colour, marker=marker, label=name, **style)
        for name, (colour, marker) in KINDS.items()
    ]
    handles.append(Line2D([], [], color="#2c2c2c", linestyle="--", label="limits of the machine"))
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def plain(row):
    """Label of a row without Markdown."""
    return row.label.replace("`", "").strip("*")


def draw(results, folder):
    """Save the chart, with the machine and the versions below."""
    with matplotlib.rc_context(STYLE):
        figure = speed(results)
        figure.supxlabel(caption(results).replace("; ", "\n"), fontsize=8, color="#555555")
        figure.savefig(folder / "speed.png", dpi=130, bbox_inches="tight", pad_inches=0.15)
