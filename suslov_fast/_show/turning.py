"""A rotating body in three dimensions, with hidden lines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._bodies.body_3d import Suslov3D
from .._bodies.body_gyrostat import SuslovGyrostat
from .._checks import FloatArray
from .ellipsoid import ellipsoid, sphere
from .style import styled

_AXES = (("black", "$e_1$"), ("black", "$e_2$"), ("crimson", "$a$"))
# Lengths, relative to an ellipsoid in a sphere of radius 0.85.
_BODY, _TIP, _NAME, _PATH = 0.85, 1.15, 1.28, 1.15


def turning_body(
    body: Suslov3D | SuslovGyrostat, rotations: FloatArray, eps: float
) -> tuple[Any, Callable[[int], list[Any]]]:
    """Return a figure, and a function that draws the body in a given state."""
    from .styled_figure import StyledFigure

    radii, principal, I3, _ = ellipsoid(body)
    radii = _BODY * radii
    surface = np.einsum("ij,j,jkl->ikl", principal, radii, sphere())
    path = _PATH * rotations[:, :, 2]
    axes = StyledFigure(figsize=(4.8, 4.8), layout="constrained").add_subplot(projection="3d")
    axes.computed_zorder = False
    axes.set_proj_type("ortho")

    @styled
    def draw(number: int) -> list[Any]:
        from matplotlib.colors import LightSource
        from matplotlib.patheffects import withStroke

        axes.clear()
        R, eye, light = rotations[number], _towards_eye(axes), LightSource(azdeg=150.0, altdeg=55.0)
        # A convex body hides an axis that leaves it through the side turned away, and, of a curve
        # outside its sphere, the part behind its centre.
        look = {"color": "#8fbce6", "linewidth": 0, "antialiased": False, "lightsource": light}
        turned = np.einsum("ij,jkl->ikl", R, surface)
        axes.plot_surface(*turned, rcount=65, ccount=65, zorder=2, **look)
        for k, (colour, name) in enumerate(_AXES):
            normal = principal / radii**2 @ (principal.T[:, k])
            reach = 1.0 / np.sqrt(normal[k])
            order = 3 if R @ normal @ eye > 0 else 1
            ends = np.outer([reach, _TIP], R[:, k]).T
            axes.plot(*ends, color=colour, linewidth=2.2, zorder=order)
            look = {"color": colour, "ha": "center", "va": "center", "zorder": order}
            outline = [withStroke(linewidth=3.0, foreground="white")]
            axes.text(*(_NAME * R[:, k]), name, path_effects=outline, **look)
        past = path[: number + 1]
        _plot_around(axes, past, past @ eye >= 0, 0.45, color="crimson", linewidth=1.2)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.set_axis_off()
        title = f"time {number * eps:.2f}: ellipsoid of inertia, $I_3$ = {I3:.3g}; path of axis $a$"
        axes.set_title(title, y=0.0, fontsize="small")
        return []

    return axes.figure, draw


def _towards_eye(axes: Any) -> FloatArray:
    """Return the unit vector from axes in three dimensions to the eye."""
    elevation, azimuth = np.deg2rad([axes.elev, axes.azim])
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _plot_around(axes: Any, points: FloatArray, in_front: Any, alpha: float, **look: Any) -> None:
    """Draw a curve (N, 3) around a body at `zorder` 2, the part behind it with `alpha`.

    The part behind ends at the first point of the part in front, so that there is no gap.
    """
    behind = ~in_front
    behind[1:] |= ~in_front[:-1]
    behind[:-1] |= ~in_front[1:]
    for order, shown, opacity in ((1, behind, alpha), (3, in_front, 1.0)):
        part = np.where(shown[:, np.newaxis], points, np.nan)
        axes.plot(*part.T, zorder=order, alpha=opacity, **look)
