"""Portraits of two quadratic fields.

On the left a run of the Lorenz system with eps = 1/64, drawn by the run itself. On the right the
system of Henon and Heiles at the energy 1/8, with eps = 1/16: the points where chords of 17 orbits
of the map cross the plane q1 = 0 upwards. Most of them lie on curves; orbits whose largest Lyapunov
exponent exceeds 0.01 per unit of time are red crosses.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, iterate, lyapunov_exponents

lorenz = Field(
    lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]), "x y z"
)
henon_heiles = Field.from_hamiltonian(
    lambda x: (
        (x[2] ** 2 + x[3] ** 2 + x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3
    ),
    "q1 q2 p1 p2",
)


def at_energy(H, q2, p2):
    """States with q1 = 0 and p1 > 0."""
    q2, p2 = np.broadcast_arrays(q2, p2)
    p1 = np.sqrt(2 * H - q2**2 - p2**2 + 2 * q2**3 / 3)
    return np.stack([0 * q2, q2, p1, p2], axis=-1)


def section_of_map(system, x, eps, steps, chunk=1000):
    """Points where chords of orbits cross the plane q1 = 0 upwards, and their orbits."""
    points, orbits = [], []
    for begin in range(0, steps, chunk):
        run = iterate(system, x, eps, min(chunk, steps - begin))
        x, s = run.final, run.states[..., 0]
        n, orbit = np.nonzero((s[:-1] < 0) & (s[1:] >= 0))
        a, b = s[n, orbit, np.newaxis], s[n + 1, orbit, np.newaxis]
        points.append((b * run.states[n, orbit] - a * run.states[n + 1, orbit]) / (b - a))
        orbits.append(orbit)
    return np.concatenate(points), np.concatenate(orbits)


figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.7), layout="constrained")
iterate(lorenz, [1, 1, 20], eps=1 / 64, steps=3000).plot("x", "z", ax=axes[0])
axes[0].set_title(r"Lorenz system, $\epsilon = 1/64$", fontsize="small")

eps = 1 / 16
starts = at_energy(1 / 8, np.linspace(-0.36, 0.6, 17), 0.0)
points, orbits = section_of_map(henon_heiles, starts, eps, 40_000)
chaotic = lyapunov_exponents(henon_heiles, starts, eps, 200_000)[:, 0] > 0.01
regular, chaos = [], []
for k in range(len(starts)):
    own = points[orbits == k]
    colour = "crimson" if chaotic[k] else plt.colormaps["viridis"](k / len(starts))
    mark, size = ("x", 2.5) if chaotic[k] else (".", 1.2)
    style = {"color": colour, "markersize": size, "markeredgewidth": 0.5}
    (chaos if chaotic[k] else regular)[:] = axes[1].plot(own[:, 1], own[:, 3], mark, **style)
axes[1].set(xlabel="$q_2$", ylabel="$p_2$")
names = "regular orbits", "chaotic orbits"
axes[1].legend([*regular, *chaos], names, loc="lower right", markerscale=3, fontsize="x-small")
axes[1].set_title("Hénon\N{EN DASH}Heiles system, section at $q_1 = 0$", fontsize="small")
