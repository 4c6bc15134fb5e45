"""A zoo of Kahan maps.

Orbits of the maps of 24 quadratic fields, in the plane of two components. The first fifteen maps
are integrable. Orbits whose largest Lyapunov exponent exceeds 0.02 per unit of time are red
crosses. The page "A zoo of Kahan maps" has the equations, their sources and the table.
"""

import warnings
from functools import cache

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import to_rgba

from suslov_fast import IntegrationWarning, iterate, lyapunov_exponents
from suslov_fast.integrability import zoo


def random(dimension, size, count=8):
    return np.random.default_rng(0).uniform(-size, size, (count, dimension)).tolist()


# Here the maps count, also where their orbits pass through infinity.
warnings.simplefilter("ignore", IntegrationWarning)

ZOO = {name: (field, eps) for name, (field, eps) in zoo().items() if eps is not None}
TOP = [[0.3, 0.2, each, 0.1, 0.4, 0.8] for each in (0.5, 1)]
POTENTIAL = [[0.4, each, 0.6, 0, 0.8] for each in (-0.5, 0.1, 0.7, 1.2)]
CHAIN = (0.2, 0.5, 0.8, 1.5, 2)
# Initial states, and the components that the figure shows, by default the first two.
STARTS = {
    "Suslov body": random(2, 2, 24),
    "Suslov gyrostat": random(2, 2, 24),
    "cubic Hamiltonian": [[each, 0] for each in (1.1, 1.2, 1.3, 1.4, 1.48)],
    "Nahm, octahedral": [[each, 0.5] for each in (0.2, 0.5, 0.75, 1.1)],
    "Euler top": random(3, 1, 10),
    "Zhukovsky-Volterra, one beta": random(3, 1, 10),
    "Nambu": random(3, 1, 6),
    "Volterra chain, N = 3": [[1, 1, each] for each in CHAIN],
    "Volterra chain, N = 4": [[1, 0.5, each, 1] for each in CHAIN],
    "Lagrange top": TOP,
    "Kirchhoff": TOP,
    "Clebsch": TOP,
    "Klebsch-Tisserand": POTENTIAL,
    "Suslov, Lagrange axis": POTENTIAL,
    "Suslov on so(4)": [[0.5, 0.3, each, 0.4, -0.2] for each in (-0.6, -0.1, 0.4, 0.9)],
    "Lotka-Volterra": [[1, each] for each in (1.3, 1.8, 2.4, 3, 3.5)],
    "Zhukovsky-Volterra, two betas": [[each, 0.3, 0.4] for each in (-0.9, -0.5, -0.1, 0.3, 0.7)],
    "Zhukovsky-Volterra, three betas": random(3, 2, 10),
    "Volterra chain, N = 5": [[1, 0.5, each, 1, 0.5] for each in (*CHAIN[:-1], 1.9)],
    "body in a fluid": TOP,
    "Henon-Heiles": [
        [0, each, (0.32 - each**2 + 2 * each**3 / 3) ** 0.5, 0] for each in (-0.2, 0, 0.2, 0.4)
    ],
    "Kharlamova": POTENTIAL,
    "Lorenz": [[1, 1, 20]],
    "generic planar field": random(2, 0.5, 4),
}
PLANES = {"Kharlamova": (2, 4), "Euler top": (0, 2), "Henon-Heiles": (1, 3), "Lorenz": (0, 2)}
PLANES |= dict.fromkeys(("Lagrange top", "Kirchhoff", "Clebsch", "body in a fluid"), (3, 4))
REACH = dict.fromkeys(("Suslov body", "Suslov gyrostat"), 2.6)  # else that of most states
CHAOTIC = 0.02  # exponent above which an orbit is red
INTEGRABLE = 15


@cache
def exponents(name, steps=50_000):
    """Largest Lyapunov exponent of each orbit of the figure, per unit of time."""
    field, eps = ZOO[name]
    return lyapunov_exponents(field, STARTS[name], float(eps), steps)[:, 0]


# The figure. Axes show the middle of the orbits; some of them come close to poles.

figure = plt.figure(figsize=(11, 13), layout="constrained")
kinds = (
    ("integrable", list(ZOO)[:INTEGRABLE], 3),
    ("exponential growth of degrees", list(ZOO)[INTEGRABLE:], 2),
)
parts = figure.subfigures(2, 1, height_ratios=[3, 2], hspace=0.03)
for part, (kind, names, rows) in zip(parts, kinds, strict=True):
    part.suptitle(kind, fontsize=13, weight="bold")
    axes = [*part.subplots(rows, 5).flat]
    for ax in axes[len(names) :]:
        ax.set_axis_off()
        for mark, colour, label in ((".", "steelblue", "regular"), ("x", "crimson", "chaotic")):
            ax.plot([], [], mark, color=colour, label=f"{label} orbit")
        ax.legend(loc="center", fontsize=12, frameon=False)
    for ax, name in zip(axes, names, strict=False):
        field, eps = ZOO[name]
        plane = PLANES.get(name, (0, 1))
        states = iterate(field, STARTS[name], float(eps), 1500).states[..., plane]
        chaotic = exponents(name) > CHAOTIC
        colours = plt.colormaps["viridis"](np.linspace(0, 0.85, len(chaotic)))
        colours[chaotic] = to_rgba("crimson")
        for k, orbit in enumerate(np.moveaxis(states, 1, 0)):
            mark, size = ("x", 1.8) if chaotic[k] else (".", 0.8)
            ax.plot(*orbit.T, mark, color=colours[k], markersize=size, markeredgewidth=0.3)
        low, high = np.percentile(states, [2, 98], axis=(0, 1))
        (left, bottom), (right, top) = low - 0.25 * (high - low), high + 0.25 * (high - low)
        if reach := REACH.get(name):
            left, bottom, right, top = -reach, -reach, reach, reach
        ax.set(xlim=(left, right), ylim=(bottom, top))
        ax.tick_params(labelsize=8, length=2, pad=1)
        ax.locator_params(nbins=3)
        ax.set_xlabel(f"$x_{plane[0] + 1}$", fontsize=10, labelpad=0)
        ax.set_ylabel(f"$x_{plane[1] + 1}$", fontsize=10, labelpad=0)
        ax.set_title(f"{name}\nε = {eps}".replace("Zhukovsky", "Zh."), fontsize=9)
