"""Singularity confinement.

A planar Kahan map contracts three lines, each to a point. Markers of the colour of a line are the
orbit of this point. It is confined if it ends at a point without an image (black square): then
degrees of iterates are lower. Left all three orbits end, and the entropy is 0. Right two do not:
they converge to the origin along invariant lines.
"""

from fractions import Fraction

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field
from suslov_fast.integrability import kahan, planar_entropy, zoo

STEPS = 12


def orbit(map, x):
    """Return the orbit of a point, and whether its last point has no image."""
    points = [x]
    try:
        for _ in range(STEPS):
            points.append(map(points[-1]))
    except ZeroDivisionError:
        return points, True
    return points, False


# The maps, and two points on each contracted line.

MAPS = {
    "Nahm, octahedral": kahan(*zoo()["Nahm, octahedral"]),
    "$x_1^2 + 3x_1x_2$, $2x_1x_2 - x_2^2$": kahan(
        Field(lambda x: (x[0] ** 2 + 3 * x[0] * x[1], 2 * x[0] * x[1] - x[1] ** 2), 2),
        Fraction(1, 3),
    ),
}
LINES = {
    "Nahm, octahedral": [
        ((4, 2), (-4, -1)),
        ((4, Fraction(-4, 3)), (-4, Fraction(2, 3))),
        ((Fraction(4, 5), 2), (Fraction(4, 5), 1)),
    ],
    "$x_1^2 + 3x_1x_2$, $2x_1x_2 - x_2^2$": [
        ((-4, 2), (3, 2)),
        ((-2, -2), (-7, -4)),
        ((-3, 4), (6, -2)),
    ],
}

STYLES = ("C0", "C1", "C2"), ("-", "--", "-."), ("o", "^", "D")

figure, panels = plt.subplots(1, 2, figsize=(8.4, 5), layout="constrained")
for ax, (name, map) in zip(panels, MAPS.items(), strict=True):
    key = []
    for (first, second), colour, dash, dot in zip(LINES[name], *STYLES, strict=True):
        points, ends = orbit(map, map(first))
        assert points[0] == map(second)  # the line is contracted
        ends_of_line = [tuple(float(a) for a in x) for x in (first, second)]
        line = ax.axline(*ends_of_line, color=colour, ls=dash, lw=1.2)
        x, y = np.array(points, float).T
        ax.plot(x, y, ":", color=colour, lw=0.8)
        (dots,) = ax.plot(x, y, dot, color=colour, ms=5)
        key += [line, dots]
        for k in range(len(points) if ends else 2):
            ax.annotate(str(k + 1), (x[k], y[k]), (4, 4), textcoords="offset points", fontsize=7)
        if ends:
            (end,) = ax.plot(x[-1], y[-1], "s", color="black", ms=9, mfc="none")
    found = planar_entropy(map)
    lengths = ", ".join("not confined" if n is None else str(n) for n in found.lengths)
    ax.set_title(f"{name}\nlengths {lengths}; entropy {found.entropy:.6g}", fontsize=9)
    ax.set(xlabel="$x_1$", ylabel="$x_2$")
names = [name for k in (1, 2, 3) for name in (f"contracted line {k}", "orbit of its point")]
figure.legend(
    [*key, end],
    [*names, "no image: confined"],
    loc="outside lower center",
    ncols=4,
    frameon=False,
    fontsize=8,
)
panels[0].set(xlim=(-5, 5), ylim=(-2.6, 2.6))
panels[1].set(xlim=(-9, 7), ylim=(-7, 7))
