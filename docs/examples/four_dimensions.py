"""Four dimensions.

For n = 4 a state has three components. The steady states are the multiples c I of the vector I of
couplings. On the ellipsoid of constant energy, orbits leave the one with c > 0 and end close to the
opposite one; those on the far side are faint. For this body no first integral of the map is known:
the modified energy drifts too, but its drift is of order 4 in eps instead of 2.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import SuslovND, iterate

body = SuslovND(J=[1.0, 1.6, 2.2], I=[0.5, -0.3, 0.4])

# Nine states of energy 1 around the repelling steady state of energy 1.
pole = body.I / np.sqrt(body.energy(body.I))
tangent = np.linalg.svd((body.J * pole)[None])[2][1:]
turn = np.linspace(0, 2 * np.pi, 10)[:-1, None]
starts = pole + 0.05 * (np.cos(turn) * tangent[0] + np.sin(turn) * tangent[1])
starts /= np.sqrt(body.energy(starts))[:, None]
orbits = iterate(body, starts, eps=0.2, steps=150).states

figure = plt.figure(figsize=(7.2, 3.6))
space = figure.add_axes((0.09, 0.05, 0.4, 0.9), projection="3d")
space.computed_zorder = False
space.set_proj_type("ortho")
space.view_init(elev=18, azim=40)
up, around = np.deg2rad([space.elev, space.azim])
eye = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])

# The ellipsoid, slightly smaller, and the orbits in front of it and behind it.
u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, np.pi, 17))
radii = np.sqrt(2 / body.J)
surface = np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
look = {"color": "0.95", "edgecolor": "0.8", "linewidth": 0.3, "alpha": 0.6, "shade": False}
space.plot_surface(*(0.99 * radii[:, None, None] * surface), zorder=2, **look)
front = (orbits * body.J @ eye >= 0)[..., None]
colours = plt.colormaps["viridis"](np.linspace(0.1, 0.8, len(starts)))
for order, seen, alpha in ((1, ~front, 0.4), (3, front, 1.0)):
    visible = np.where(seen, orbits, np.nan)
    for k, colour in enumerate(colours):
        states = visible[:, k].T
        space.plot(*states, ".-", color=colour, alpha=alpha, zorder=order, ms=3, lw=0.6)
for sign, name in ((1, "repelling"), (-1, "attracting")):
    order = 3 if sign * (body.J * pole) @ eye > 0 else 1
    tip = np.outer([sign, 1.25 * sign], pole)
    space.plot(*tip.T, color="crimson", linewidth=2, zorder=order)
    space.text(*(1.55 * sign * pole), name, color="crimson", ha="center", zorder=4)
names = {f"{name}label": rf"$\Omega_{{{k}4}}$" for k, name in enumerate("xyz", start=1)}
space.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1], zticks=[-1, 0, 1], **names)
space.zaxis.set_rotate_label(False)
space.set_box_aspect(radii, zoom=0.7)
space.set_aspect("equal")
space.set_title("orbits of energy 1", fontsize="medium", y=0.93)

# The drift of the energy and of the modified energy.
drift = figure.add_axes((0.62, 0.15, 0.36, 0.75))
time, eps = 25.6, 0.8 / 2.0 ** np.arange(8)
runs = [iterate(body, starts[0], each, round(time / each)) for each in eps]
for name, values, colour, look, order in (
    ("energy", [run.energy() for run in runs], "black", "o-", 2),
    ("modified energy", [run.modified_energy() for run in runs], "steelblue", "s-", 4),
):
    change = np.array([np.ptp(each) for each in values])  # relative: the energy is 1
    drift.loglog(eps, change, look, color=colour, markersize=4, label=name)
    guide = 0.4 * change[2] * (eps / eps[2]) ** order
    drift.loglog(eps, guide, "--", color=colour, linewidth=1, label=rf"$\propto \epsilon^{order}$")
drift.set(xlabel=r"step size $\epsilon$", ylabel="largest relative drift")
drift.legend(frameon=False, loc="lower right", fontsize="small")
drift.grid(alpha=0.3)
drift.set_title("until time 25.6", fontsize="medium")
