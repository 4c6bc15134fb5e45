"""A turning body in three dimensions, its hidden parts behind it."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .ellipsoid import ellipsoid, sphere
from .figures import new_figure, styled

_AXES = (("black", "$e_1$"), ("black", "$e_2$"), ("crimson", "$a$"))
# Lengths, where the ellipsoid fits into a sphere of radius 0.85.
_BODY, _TIP, _NAME, _PATH = 0.85, 1.15, 1.28, 1.15


def towards_eye(axes: Any) -> FloatArray:
    """Return the unit vector from axes in three dimensions to the eye."""
    elevation, azimuth = np.deg2rad([axes.elev, axes.azim])
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


class TurningBody:
    """A figure that shows the body at one state; `draw` draws another one."""

    def __init__(self, body: Suslov3D, rotations: FloatArray) -> None:
        radii, axes, I3, _ = ellipsoid(body)
        self.rotations = rotations
        self.radii = _BODY * radii
        self.principal = axes
        self.surface = np.einsum("ij,j,jkl->ikl", axes, self.radii, sphere())
        self.path = _PATH * rotations[:, :, 2]
        self.figure = new_figure((4.8, 4.8))
        self.axes = self.figure.add_subplot(projection="3d", computed_zorder=False)
        self.axes.set_proj_type("ortho")
        self.title = f"ellipsoid of inertia with $I_3$ = {I3:.3g}, path of the axis $a$"

    @styled
    def draw(self, number: int) -> list[Any]:
        """Draw the body at a state."""
        from matplotlib.colors import LightSource

        axes, R = self.axes, self.rotations[number]
        axes.clear()
        eye, light = towards_eye(axes), LightSource(azdeg=150.0, altdeg=55.0)
        # A convex body hides what leaves it where its surface is turned away, and, of what lies
        # outside the sphere around it, what is farther away than its centre.
        surface = np.einsum("ij,jkl->ikl", R, self.surface)
        look = {"color": "#8fbce6", "linewidth": 0, "antialiased": False, "lightsource": light}
        axes.plot_surface(*surface, rcount=65, ccount=65, zorder=2, **look)
        for k, (shade, name) in enumerate(_AXES):
            along = R[:, k]
            normal = self.principal / self.radii**2 @ (self.principal.T[:, k])
            reach = 1.0 / np.sqrt(normal[k])
            order = 3 if R @ normal @ eye > 0 else 1
            axes.plot(*np.outer([reach, _TIP], along).T, color=shade, linewidth=2.2, zorder=order)
            axes.text(*(_NAME * along), name, color=shade, ha="center", va="center", zorder=order)
        path = self.path[: number + 1]
        hidden = path @ eye < 0
        for order, part in ((1, ~hidden), (3, hidden)):
            visible = np.where(part[:, np.newaxis], np.nan, path)
            style = {"linewidth": 1.2, "alpha": 0.45 if order == 1 else 1.0}
            axes.plot(*visible.T, color="crimson", zorder=order, **style)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.set_axis_off()
        axes.set_title(self.title, y=0.0, fontsize="small")
        return []
