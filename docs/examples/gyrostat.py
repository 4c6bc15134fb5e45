"""The gyrostat.

A rotor along the constrained axis moves the line of steady states off the origin. Orbits whose
ellipse of energy meets the line go from its repelling (dashed) to its attracting (solid) half, on
both sides of it; orbits on smaller ellipses are periodic. The step size is 0.4. Symbols are states
of the map, thin lines the levels of its first integral.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, iterate

body, eps = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3, k=0.4), 0.4
starts = np.concatenate([np.linspace(-2.2, -0.2, 7), [1.4, 1.8, 2.2]])[:, None] * [0.3, 0.8]
runs = [iterate(body, starts, sign * eps, steps=150) for sign in (1, -1)]

# The ellipse of energy E meets the line where k**2 <= A**2.
A2 = 2 * runs[0].energy()[0] * (body.I13**2 / body.I1 + body.I23**2 / body.I2)
periodic = body.k**2 > A2

figure, axes = plt.subplots(figsize=(6, 5.6), layout="constrained")
grid = np.linspace(-2.6, 2.6, 300)
F = body.first_integral(np.stack(np.meshgrid(grid, grid), axis=-1), eps)
levels = np.unique(body.first_integral(starts, eps))
axes.contour(grid, grid, F, levels=levels, colors="gray", linewidths=0.5)
axes.plot([], [], color="gray", linewidth=0.5, label="levels of $F$")
for chosen, marker, color, label in (
    (~periodic, "o", "black", "from one steady state to another"),
    (periodic, "s", "darkorange", "periodic"),
):
    states = np.concatenate([run.states[:, chosen] for run in runs]).reshape(-1, 2)
    axes.plot(*states.T, marker, color=color, markersize=2.5, label=label)
# l = 0; the halves meet where the line touches an ellipse.
normal = np.array([body.I13, body.I23])
middle = -body.k * normal / [body.I1, body.I2] / (normal**2 / [body.I1, body.I2]).sum()
for sign, style, name in ((9, "--", "repelling"), (-9, "-", "attracting")):
    end = middle + sign * np.array([body.I23, -body.I13])
    axes.plot(*np.stack([middle, end]).T, style, color="crimson", label=f"{name} steady states")
axes.set(xlim=(-2.6, 2.6), ylim=(-2.6, 2.6), aspect="equal")
axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$")
figure.suptitle(r"gyrostat, $k = 0.4$, $\epsilon = 0.4$")
axes.legend(frameon=False, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
