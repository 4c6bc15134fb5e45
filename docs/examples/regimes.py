"""Three regimes.

The criticality t (criticality) determines the regime of an orbit. For t < 1 it
follows the continuous motion along an ellipse. At t = 1 it reaches a steady state in one or two
steps. For t > 1 it jumps from one side of the line of steady states to the other, on a hyperbola.
In X = eps x / (2 sqrt(I1 I2)) and Y = eps y / (2 I1 I2) the figure is the same for every body and
step size. Numbers count steps.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, iterate

body, eps = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), 1.0
a = body.I1 * body.I2
units = np.array([2 * np.sqrt(a), 2 * a]) / eps  # of x and y

# Initial (X, Y), steps, the largest X and Y shown, and the last step with a number.
panels = [
    ([(0.04, 0.4), (-0.04, 0.4)], 9, (0.6, 0.6), 5),
    ([(0.55, 1.0), (-1.1, 1.0), (-1.7, -1.0)], 2, (2.2, 2.2), 1),
    ([(0.23, 1.53)], 5, (2.3, 3.6), 4),
]
figure, axes = plt.subplots(1, 3, figsize=(7.2, 3.6), layout="constrained")
for panel, letter, (starts, steps, (width, height), last) in zip(axes, "abc", panels, strict=True):
    omega0 = starts * units @ np.linalg.inv(body.to_xy(np.eye(2)))
    iterated = body.to_xy(iterate(body, omega0, eps, steps).states) / units
    closed = body.to_xy(body.exact(omega0, eps, np.arange(steps + 1))) / units
    t = body.criticality(omega0[0], eps)

    # The level of the first integral, X**2 (1 - t**2) + Y**2 = t**2, as a contour.
    X, Y = np.meshgrid(np.linspace(-width, width, 201), np.linspace(-height, height, 201))
    level = X**2 * (1 - t**2) + Y**2 - t**2
    panel.contour(X, Y, level, levels=[0], colors="steelblue", linewidths=1)
    for k in range(len(starts)):
        panel.plot(*iterated[:, k].T, ":", color="grey", linewidth=0.8)
        panel.plot(*iterated[:, k].T, "k.", markersize=5)
        panel.plot(*closed[:, k].T, "o", color="steelblue", fillstyle="none", markersize=8)
        for n, point in enumerate(iterated[: last + 1, k]):
            side = np.sign(point.round(9))  # 0, not the sign of a rounding error
            place = {"xytext": 9 * side, "textcoords": "offset points", "fontsize": 8}
            panel.annotate(f"{n}", point, ha="center", va="center", **place)
    panel.axvline(0, color="crimson", linewidth=2, zorder=0)
    panel.set(xlim=(-width, width), ylim=(-height, height), xlabel="$X$", title=f"$t = {t:.3g}$")
    panel.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
axes[0].set_ylabel("$Y$")

entries = {
    "states, iterated": {"marker": ".", "color": "black", "linestyle": "none"},
    "states, closed form": {
        "marker": "o",
        "color": "steelblue",
        "fillstyle": "none",
        "linestyle": "none",
    },
    "from state to state": {"color": "grey", "linestyle": ":"},
    "level of $F$": {"color": "steelblue"},
    "steady states": {"color": "crimson"},
}
handles = [plt.Line2D([], [], label=label, **look) for label, look in entries.items()]
figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize="small")
