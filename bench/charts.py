"""The chart of the results: last states and saved states, a dot per row, beside the limits."""

import matplotlib
from matplotlib.figure import Figure
from tables import caption

# Colour and marker of each kind of row.
KINDS = {
    "this package": ("#c8442b", "o"),
    "C": ("#35507a", "s"),
    "NumPy": ("#6f8f6a", "^"),
    "others": ("#9aa7b8", "D"),
}
STYLE = {"font.size": 10, "axes.titlelocation": "left", "axes.titleweight": "bold"}
BEHIND = {"facecolor": "white", "edgecolor": "none", "pad": 1}


def plain(row):
    """Label of a row without Markdown."""
    return row.label.replace("`", "").strip("*").removeprefix("limit: ")


def panel(axis, pairs, written):
    """Draw pairs (row, value): a dot with its name and value, or a line for a limit.

    Names stand above the dots, because names beside them would be too small to read on a phone.
    """
    dots = [pair for pair in pairs if pair[0].whose in KINDS]
    beside = {"transform": axis.get_yaxis_transform(), "va": "center"}
    for y, (row, value) in enumerate(dots):
        colour, marker = KINDS[row.whose]
        label = row.whose if row.whose not in axis.get_legend_handles_labels()[1] else None
        axis.plot(value, y, marker, color=colour, markersize=9, label=label)
        axis.text(1.02, y, written.format(value), **beside)
        axis.text(0.01, y - 0.42, plain(row), **beside, bbox=BEHIND)
    limits = [pair for pair in pairs if pair[0].whose not in KINDS]
    for k, (row, value) in enumerate(limits):
        axis.axvline(value, color="#2c2c2c", linestyle="--", linewidth=1)
        place = {"ha": "right", "va": "center", "fontsize": 8, "bbox": BEHIND}
        axis.text(value, len(dots) - 0.6 + 0.36 * k, plain(row) + " ", **place)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_yticks(range(len(dots)), [""] * len(dots))
    axis.set_ylim(len(dots), -0.7)
    axis.grid(alpha=0.25)


def draw(results, path):
    """Save the chart, with the name of the machine below.

    Rates of saved states are shares of a limit, since the speed of memory varies over time.
    """
    last = [(row, row.rate) for row in results.of("last states")]
    shares = [(row, results.share(row)) for row in results.of("saved states")]
    saved = [(row, 100 * share) for row, share in shares if share]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6, 2 + 0.45 * (len(last) + len(saved))), layout="constrained")
        above, below = figure.subplots(2, height_ratios=[1 + len(last), 1 + len(saved)])
        panel(above, last, "{:.1e}")
        panel(below, saved, "{:.0f} %")
        above.set(title="Last states", xlabel="steps per second", xscale="log")
        below.set(title="Saved states", xlabel="% of the rate of streaming stores", xlim=(0, None))
        figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=4)
        figure.supxlabel(caption(results).split(";")[0], fontsize=9, color="#555555")
        figure.savefig(path, dpi=200, bbox_inches="tight", pad_inches=0.1)
