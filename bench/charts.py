"""The chart of the results: last states and saved states, a dot per row, beside the limits."""

import textwrap

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
CALLS = (
    "iterate(body, omega0, eps, steps), the default call, saves every state into new memory.\n"
    "out=out is used again; it begins at a multiple of 64 bytes, unaligned: 16 bytes behind one."
)


def plain(row):
    """Label of a row without Markdown, in short lines."""
    return textwrap.fill(row.label.replace("`", "").strip("*").removeprefix("limit: "), 34)


def panel(axis, pairs, written):
    """Draw pairs (row, value): a dot with its value and error, or a line for a limit."""
    dots = [pair for pair in pairs if pair[0].whose in KINDS]
    beside = {"transform": axis.get_yaxis_transform(), "va": "center", "fontsize": 9}
    for y, (row, value) in enumerate(dots):
        colour, marker = KINDS[row.whose]
        label = row.whose if row.whose not in axis.get_legend_handles_labels()[1] else None
        axis.plot(value, y, marker, color=colour, markersize=9, label=label)
        axis.text(1.02, y, written.format(value), **beside)
        axis.text(1.12, y, "" if row.error is None else f"{row.error:.0e}", **beside)
    axis.text(1.12, -0.9, "error", **beside)
    for row, value in pairs:
        if row.whose not in KINDS:
            axis.axvline(value, color="#2c2c2c", linestyle="--", linewidth=1)
            place = {"rotation": 90, "ha": "right", "va": "bottom", "fontsize": 8.5}
            axis.text(value, len(dots) - 0.5, plain(row) + " ", **place)
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_yticks(range(len(dots)), [plain(row) for row, _ in dots], fontsize=8.5)
    axis.set_ylim(len(dots) - 0.4, -0.6)
    axis.grid(alpha=0.25)


def draw(results, path):
    """Save the chart, with the machine and the versions below.

    Saved states are shares of a limit, since the speed of memory may vary between rows.
    """
    last = [(row, row.rate) for row in results.of("last states")]
    shares = [(row, results.share(row)) for row in results.of("saved states")]
    saved = [(row, 100 * share) for row, share in shares if share]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10, 2.4 + 0.38 * (len(last) + len(saved))), layout="constrained")
        above, below = figure.subplots(2, height_ratios=[1 + len(last), 1 + len(saved)])
        panel(above, last, "{:.1e}")
        panel(below, saved, "{:.0f} %")
        above.set(title="Last states", xlabel="steps per second", xscale="log")
        below.set(title="Saved states", xlabel="% of the rate of streaming stores", xlim=(0, None))
        figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=4)
        under = f"{CALLS}\n{caption(results).replace('; ', chr(10))}"
        figure.supxlabel(under, fontsize=8, color="#555555")
        figure.savefig(path, dpi=130, bbox_inches="tight", pad_inches=0.15)
