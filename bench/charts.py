"""The two charts, from the rows of a report."""

import matplotlib
from matplotlib.figure import Figure
from report import DIVIDER, caption, rate

OURS, C, OTHER, LIMIT = "#c8442b", "#35507a", "#9aa7b8", "#2c2c2c"
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
    for y, value in enumerate(values):
        axis.text(value * 1.12, y, f"{value / 1e9:.3g}", va="center", fontsize=9)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.set_xlim(min(values) / 2, max([*values, *limits.values()]) * 4)
    for style, (name, value) in zip(("--", ":"), limits.items(), strict=False):
        axis.axvline(value, color=LIMIT, linestyle=style, linewidth=1.1, zorder=0, label=name)
    if limits:
        axis.legend(loc="upper left", bbox_to_anchor=(0, -0.13), frameon=False, fontsize=9, ncols=2)
    axis.set_title(title)
    axis.set_xlabel(f"{unit} per second; beside the bars: in 1e9 per second")
    axis.tick_params(axis="y", length=0)


def speed(rows, path):
    """Last states and all states, ours and peers, beside the limits."""
    threads = rows.machine["threads"]
    last, stored = rows.of("last states"), rows.of("all states")
    panels = [
        (
            last,
            {"one division per step": rows.limit(DIVIDER, threads)},
            "Last states only",
            "steps",
        ),
        (
            stored,
            {
                f"{kind} stores of 16 bytes": rows.limit(f"bytes, {kind} stores", threads)
                for kind in ("streaming", "plain")
            },
            "All states stored",
            "states",
        ),
    ]
    panels = [panel for panel in panels if panel[0]]
    if not panels:
        return
    figure = Figure(figsize=(11, 2.8 + 0.33 * (len(last) + len(stored))), layout="constrained")
    heights = [len(panel[0]) for panel in panels]
    axes = figure.subplots(len(panels), 1, squeeze=False, height_ratios=heights)
    for axis, (found, limits, title, unit) in zip(axes[:, 0], panels, strict=True):
        limits = {
            name: value / (16 if "bytes" in name else 1) for name, value in limits.items() if value
        }
        bars(axis, found, limits, title, unit)
    footer(figure, rows)
    figure.savefig(path, dpi=130)


def lines(axis, found, value, styles):
    """A line for each row, over its x."""
    names = dict.fromkeys(row["row"] for row in found)
    for name in names:
        points = sorted((row["x"], value(row)) for row in found if row["row"] == name)
        axis.plot(*zip(*points, strict=True), label=plain(name), **styles.get(name, {}))


def scaling(rows, path):
    """Against the size of the batch, the states saved, n, and the threads."""
    threads = rows.machine["threads"]
    figure = Figure(figsize=(11, 8.6), layout="constrained")
    axes = figure.subplots(2, 2)
    batch(axes[0, 0], rows, threads)
    saved(axes[0, 1], rows)
    dimension(axes[1, 0], rows)
    by_threads(axes[1, 1], rows)
    for axis in axes.flat:
        axis.grid(alpha=0.25, which="major")
    footer(figure, rows)
    figure.savefig(path, dpi=130)


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
    lines(axis, found, lambda row: rate(row) / 1e9, styles)
    handles, _ = axis.get_legend_handles_labels()
    texts = {
        "serial": "on one thread",
        "parallel": f"on {threads}, whatever the size",
        "iterate": "as iterate decides",
    }
    for handle in handles:
        handle.set_label(texts[handle.get_label()])
    chosen = next((row["crossover"] for row in found if row.get("crossover")), None)
    if chosen:
        axis.axvline(
            chosen, color=LIMIT, linestyle="--", linewidth=1, label="iterate goes parallel"
        )
    measured = crossing(found)
    if measured:
        axis.axvline(
            measured,
            color=LIMIT,
            linestyle=":",
            linewidth=1.3,
            label="parallel is faster, measured",
        )
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.set_title("Against the size of the batch: 3D, 1000 steps, last states")
    axis.set_xlabel("trajectories")
    axis.set_ylabel("1e9 steps per second")
    axis.legend(loc="lower right", frameon=False, fontsize=8.5)


def crossing(found):
    """The smallest batch from which on the parallel build is the faster one."""
    by_name = {name: {row["x"]: rate(row) for row in found if row["row"] == name}
               for name in ("serial", "parallel")}  # fmt: skip
    faster = None
    for x in sorted(by_name["serial"].keys() & by_name["parallel"].keys(), reverse=True):
        if by_name["parallel"][x] < 1.05 * by_name["serial"][x]:
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
    axis.set_title("Against the number of saved states: 3D, 1000 steps")
    axis.set_xlabel("saved states of each trajectory, of 1001")
    axis.set_ylabel("1e9 steps per second")
    axis.legend(loc="lower left", frameon=False, fontsize=8.5)


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
    axis.set_xscale("log", base=2)
    axis.set_yscale("log")
    axis.set_title("Against n: nanoseconds per step, one thread")
    axis.set_xlabel("n")
    axis.set_ylabel("ns per step of one trajectory")
    axis.legend(loc="upper left", frameon=False, fontsize=8.5)


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
    axis.set_title("Against the threads")
    axis.set_xlabel("threads")
    axis.set_ylabel("times as fast as on one")
    axis.legend(loc="lower right", frameon=False, fontsize=8.5)


def footer(figure, rows):
    """Where the figures come from."""
    figure.supxlabel(caption(rows), fontsize=7.5, color="#555555")


def draw(rows, folder):
    """Both charts."""
    with matplotlib.rc_context(STYLE):
        speed(rows, folder / "speed.png")
        scaling(rows, folder / "scaling.png")
