"""A turning body.

The ellipsoid of inertia in space, and the path of the axis a about which the body cannot turn; its
hidden half is faint. The motion begins close to one steady rotation and ends close to the other. In
a notebook the picture moves.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation

from suslov_fast import Suslov3D, iterate

body = Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3, I3=3)
x, y = np.array([-0.3, 0.5]) / np.hypot(0.3, 0.5)  # a repelling steady rotation
run = iterate(body, [2 * x - 0.3 * y, 2 * y + 0.3 * x], eps=0.05, steps=440, attitude=True)

inertia = [[body.I1, 0, body.I13], [0, body.I2, body.I23], [body.I13, body.I23, body.I3]]
moments, principal = np.linalg.eigh(inertia)
radii = 0.85 * np.sqrt(moments[0] / moments)
# From pole to pole, downwards, so that normals point outwards; a patch at a pole has no normal.
azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 65), np.linspace(np.pi - 1e-3, 1e-3, 33))
ball = np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)
surface = np.einsum("ij,j,jkl->ikl", principal, radii, ball)

figure = plt.Figure(figsize=(4.8, 4.8), layout="constrained")
axes = figure.add_subplot(projection="3d", computed_zorder=False, proj_type="ortho")
axes.view_init(elev=30, azim=-60)
eye = np.array([np.sqrt(3), -3, 2]) / 4
path = 1.15 * run.attitude[:, :, 2]
in_front = np.where((path @ eye >= 0)[:, None], path, np.nan)


def draw(n):
    """Draw the body at state n."""
    axes.clear()
    R = run.attitude[n]
    style = {"color": "#8fbce6", "linewidth": 0, "antialiased": False, "rcount": 65, "ccount": 65}
    axes.plot_surface(*np.einsum("ij,jkl->ikl", R, surface), zorder=2, **style)
    for k, (colour, name) in enumerate((("k", "$e_1$"), ("k", "$e_2$"), ("crimson", "$a$"))):
        normal = principal / radii**2 @ principal.T[:, k]  # where the axis leaves the surface
        zorder = 3 if R @ normal @ eye > 0 else 1
        ends = np.outer([normal[k] ** -0.5, 1.15], R[:, k])
        axes.plot(*ends.T, color=colour, linewidth=2.2, zorder=zorder)
        axes.text(*(1.28 * R[:, k]), name, color=colour, ha="center", va="center", zorder=zorder)
    # The whole path is drawn lightly behind the body, then its front part over the body.
    for zorder, points, alpha in ((1, path, 0.45), (3, in_front, 1.0)):
        axes.plot(*points[: n + 1].T, "crimson", linewidth=1.2, alpha=alpha, zorder=zorder)
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()
    title = f"time {run.time[n]:.2f}: ellipsoid of inertia, $I_3$ = {body.I3:g}; path of axis $a$"
    axes.set_title(title, y=0.0, fontsize="small")


plt.rcParams["animation.html"] = "jshtml"
animation = FuncAnimation(figure, draw, frames=range(0, 441, 8), interval=40)
animation
