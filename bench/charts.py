"""The two charts, from the rows of a report."""

import matplotlib
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from report import DIVIDER, caption, error, rate

OURS, C, OTHER, LIMIT = "#c8442b", "#35507a", "#9aa7b8", "#2c2c2c"
NOTE = "#555555"
KINDS = {"suslov_fast": "suslov_fast", "C,": "C by gcc", "": "others"}
LEGEND = {"frameon": False, "fontsize": 8.5, "ncols": 2}
BELOW = LEGEND | {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16)}
STYLE = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
}


def plain(name):
    """A name without Markdown."""
    return name.replace("**", "").replace("`", "")


def colour(name):
    """One for this package, one for C, one for all others."""
    if "suslov_fast" in name:
        return OURS
    return C if name.startswith("C,") else OTHER


def bars(axis, found, limits, title, unit):
    """Horizontal bars, the fastest on top, with limits as lines."""
    names = [plain(row["row"]) for row in found]
    values = [rate(row) for row in found]
    axis.barh(names, values, color=[colour(row["row"]) for row in found], height=0.72)
    # Figures stand beside the axes, where no line crosses them.
    columns = [(1.12, f"1e9 {unit}/s", [f"{value / 1e9:.3g}" for value in values])]
    columns.append((1.22, "error", [error(row) for row in found]))
    for x, header, texts in columns:
        place = {"transform": axis.get_yaxis_transform(), "ha": "right", "va": "center"}
        axis.text(x, -0.9, header, color=NOTE, fontsize=8.5, **place)
        for y, text in enumerate(texts):
            axis.text(x, y, text, fontsize=9, **place)
    axis.invert_yaxis()
    axis.margins(y=0.02)
    axis.set_xscale("log")
    axis.set_xlim(min(values) / 2, max([*values, *limits.values()]) * 1.3)
    handles = [Patch(color=colour(name), label=text) for name, text in KINDS.items()]
    for style, (name, value) in zip(("--", ":"), limits.items(), strict=False):
        line = axis.axvline(value, color=LIMIT, linestyle=style, linewidth=1.2, label=name)
        handles.append(line)
    axis.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.4, -0.11), **LEGEND | {"ncols": 5}
    )
    axis.set_title(title)
    axis.set_xlabel(f"1e9 {unit} per second", labelpad=2)
    axis.xaxis.set_major_formatter(lambda value, _: f"{value / 1e9:g}")
    axis.tick_params(axis="y", length=0)


def speed(rows, path):
    """Last states and all states, ours and peers, beside the limits."""
    threads = rows.machine["threads"]
    last, stored = rows.of("last states"), rows.of("all states")
    panels = [
        (
            last,
            {"limit: one division per step": rows.limit(DIVIDER, threads)},
            "Last states only",
            "steps",
        ),
        (
            stored,
            {
                f"limit: {kind} stores": rows.limit(f"bytes, {kind} stores", threads)
                for kind in ("streaming", "plain")
            },
            "All states stored",
            "states",
        ),
    ]
    panels = [panel for panel in panels if panel[0]]
    if not panels:
        return
    figure = Figure(figsize=(11, 2.6 + 0.31 * (len(last) + len(stored))), layout="constrained")
    heights = [len(panel[0]) for panel in panels]
    axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)
    for axis, (found, limits, title, unit) in zip(axes[:, 0], panels, strict=True):
        limits = {
            name: value / (16 if "stores" in name else 1) for name, value in limits.items() if value
        }
        bars(axis, found, limits, title, unit)
    footer(figure, rows)
    figure.savefig(path, dpi=130, bbox_inches="tight", pad_inches=0.15)


def lines(axis, found, value, styles):
    """A line for each row, over its x."""
    names = dict.fromkeys(row["row"] for row in found)
    for name in names:
        points = sorted((row["x"], value(row)) for row in found if row["row"] == name)
        axis.plot(*zip(*points, strict=True), label=plain(name), **styles.get(name, {}))


def scaling(rows, path):
    """Against the size of the batch, the states saved, n, and the threads."""
    threads = rows.machine["threads"]
    figure = Figure(figsize=(11, 9.6), layout="constrained")
    axes = figure.subplots(2, 2)
    batch(axes[0, 0], rows, threads)
    saved(axes[0, 1], rows)
    dimension(axes[1, 0], rows)
    by_threads(axes[1, 1], rows)
    for axis in axes.flat:
        axis.grid(alpha=0.25, which="major")
    footer(figure, rows)
    figure.savefig(path, dpi=130, bbox_inches="tight", pad_inches=0.15)


def batch(axis, rows, threads):
    """One line serial, one parallel, and where they cross."""
    found = rows.every("batch")
    if not found:
        return
    styles = {
        "iterate": {"color": OURS, "linewidth": 5, "alpha": 0.35},
        "serial": {"color": C, "marker": "o", "markersize": 4},
        "parallel": {"color": OURS, "marker": "s", "markersize": 4},
    }
    texts = {
        "serial": "on one thread",
        "parallel": f"on {threads}, whatever the size",
        "iterate": "as iterate decides",
    }
    found.sort(key=lambda row: list(texts).index(row["row"]))
    lines(axis, found, lambda row: rate(row) / 1e9, styles)
    for handle in axis.get_legend_handles_labels()[0]:
        handle.set_label(texts[handle.get_label()])
    chosen = next((row["crossover"] for row in found if row.get("crossover")), None)
    if chosen:
        axis.axvline(
            chosen, color=LIMIT, linestyle="--", linewidth=1, label="from here iterate is parallel"
        )
    measured = crossing(found)
    if measured:
        axis.axvline(
            measured,
            color=LIMIT,
            linestyle=":",
            linewidth=1.3,
            label="from here parallel gains",
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_title("Size of the batch (3D, last states)")
    axis.set_xlabel("trajectories, of 1000 steps each")
    axis.set_ylabel("1e9 steps per second")
    axis.legend(**BELOW)


def crossing(found):
    """The smallest batch from which on the parallel build is faster, up to where it gains most."""
    serial, parallel = (
        {row["x"]: rate(row) for row in found if row["row"] == name}
        for name in ("serial", "parallel")
    )
    gain = {x: parallel[x] / serial[x] for x in sorted(serial.keys() & parallel.keys())}
    faster = None
    for x in reversed(gain):
        if x <= max(gain, key=gain.get):
            if gain[x] < 1.05:
                break
            faster = x
    return faster


def saved(axis, rows):
    """All states saved, or few, or only the last."""
    found = rows.every("saved")
    if not found:
        return
    styles = {
        'order "C"': {"color": C, "marker": "o", "markersize": 4},
        'order "F"': {"color": OURS, "marker": "s", "markersize": 4},
    }
    lines(axis, found, lambda row: rate(row) / 1e9, styles)
    axis.set_xscale("log")
    axis.set_ylim(bottom=0)
    axis.set_title("Saved states (3D, 16,384 trajectories, 1000 steps)")
    axis.set_xlabel("saved states of each trajectory")
    axis.set_ylabel("1e9 steps per second")
    axis.legend(**BELOW)


def dimension(axis, rows):
    """One step in n dimensions, this package and others."""
    found = [row | {"x": row["components"] + 1} for row in rows.of("nd", 1)]
    if not found:
        return
    markers = iter("os^vDPX")
    names = sorted({row["row"] for row in found}, key=lambda name: ("suslov" not in name, name))
    styles = {}
    for name in names:
        cubic = "gauss" in name or "elimination" in name or "solve" in name
        styles[name] = {"color": colour(name), "linestyle": ":" if cubic else "-"}
        styles[name] |= {"marker": next(markers), "markersize": 4}
    found.sort(key=lambda row: names.index(row["row"]))
    lines(axis, found, lambda row: 1e9 / rate(row), styles)
    axis.set_xscale("log")
    axis.set_xticks(sorted({row["x"] for row in found}), minor=False)
    axis.set_xticks([], minor=True)
    axis.xaxis.set_major_formatter(lambda n, _: f"{n:g}")
    axis.set_yscale("log")
    axis.set_title("Dimension n (last states, one thread)")
    axis.set_xlabel("n")
    axis.set_ylabel("ns per step of one trajectory")
    axis.legend(**BELOW)


def by_threads(axis, rows):
    """From one thread to all."""
    found = rows.every("threads")
    if not found:
        return
    one = {row["row"]: rate(row) for row in found if row["threads"] == 1}
    markers = dict(zip(one, "os^", strict=False))
    styles = {name: {"marker": marker, "markersize": 5} for name, marker in markers.items()}
    for name, tint in zip(one, (OURS, C, OTHER), strict=False):
        styles[name]["color"] = tint
    lines(axis, found, lambda row: rate(row) / one[row["row"]], styles)
    most = max(row["threads"] for row in found)
    axis.plot([1, most], [1, most], color=LIMIT, linestyle="--", linewidth=1, label="ideal")
    axis.set_xticks(sorted({row["threads"] for row in found}))
    axis.set_ylim(bottom=0)
    axis.set_title("Threads")
    axis.set_xlabel("threads")
    axis.set_ylabel("times as fast as on one")
    axis.legend(**BELOW)


def footer(figure, rows):
    """Where the figures come from."""
    figure.supxlabel(caption(rows).replace("; ", "\n"), fontsize=8, color=NOTE)


def draw(rows, folder):
    """Both charts."""
    with matplotlib.rc_context(STYLE):
        speed(rows, folder / "speed.png")
        scaling(rows, folder / "scaling.png")
