"""Path of the constrained axis.

The axis about which the body cannot turn, seen from space, while the body passes from one steady
rotation to the other. At both ends the axis moves along a great circle, orthogonal to the axis of
that rotation. The sphere has radius 1, and the hidden half of the path is faint.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Suslov3D, iterate

body = Suslov3D(I1=4, I2=1, I13=-0.3, I23=-1, I3=3.7)
run = iterate(body, [-1.0, 0.32], eps=0.02, steps=900, attitude=True)
axis = run.attitude[..., 2]
rotation = (run.attitude[..., :2] @ run.states[..., np.newaxis])[[0, -1], :, 0]
rotation /= np.linalg.norm(rotation, axis=-1, keepdims=True)

figure = plt.figure(figsize=(6, 5), layout="constrained")
axes = figure.add_subplot(projection="3d", computed_zorder=False)
axes.set_proj_type("ortho")
azimuth, elevation = np.deg2rad([axes.azim, axes.elev])
eye = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]

u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 25), np.linspace(0, np.pi, 13))
sphere = np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)
look = {"color": "0.97", "edgecolor": "0.9", "linewidth": 0.4, "alpha": 0.4, "shade": False}
axes.plot_surface(*sphere, zorder=1, **look)
for end, style, name in zip(rotation, ("--", "-"), ("first", "last"), strict=True):
    for sign in (1, -1):
        order = 3 if sign * end @ eye > 0 else 0
        label = f"axis of the {name} rotation" if sign == 1 else None
        line = np.outer([sign, 1.3 * sign], end)
        axes.plot(*line.T, style, color="crimson", linewidth=2, zorder=order, label=label)
front = axis @ eye > 0
axes.scatter(*axis[~front].T, c=run.time[~front], s=3, alpha=0.6, zorder=0, vmin=0, vmax=18)
path = axes.scatter(*axis[front].T, c=run.time[front], s=3, zorder=2, vmin=0, vmax=18)
axes.set(xlabel="$x$", ylabel="$y$", zlabel="$z$")
axes.grid(False)
for each in (axes.xaxis, axes.yaxis, axes.zaxis):
    each.pane.set_visible(False)  # the hidden half of an axis would be behind it
figure.suptitle("path of the constrained axis in space, $I_3 = 3.7$")
axes.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1], zticks=[-1, 0, 1])
axes.set_aspect("equal")  # after all artists, whose extent it uses
axes.legend(
    loc="upper center", bbox_to_anchor=(0.5, 1.05), ncols=2, frameon=False, fontsize="small"
)
figure.colorbar(path, label=r"time ($\epsilon = 0.02$)", shrink=0.7, pad=0.1)
