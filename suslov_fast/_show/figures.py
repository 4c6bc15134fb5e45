"""Figures in the style of all pictures: orbits in a plane, and a rotating body with hidden lines.

Importing this module imports Matplotlib.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LightSource, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from .._checks import FloatArray
from .._engine.arguments import BodyIn3D
from .geometry import ellipsoid
from .style import style, styled

# Without the lightest colours, which are faint on white.
_COLOURS = ListedColormap(colormaps["viridis"](np.linspace(0.05, 0.9, 256)))
_BODY_AXES = (("black", "$e_1$"), ("black", "$e_2$"), ("crimson", "$a$"))
# Lengths, relative to an ellipsoid in a sphere of radius 0.85.
_RADIUS, _TIP, _NAME, _PATH = 0.85, 1.15, 1.28, 1.15


class StyledFigure(Figure):
    """A figure that is saved in the style it was drawn in."""

    def savefig(self, *arguments: Any, **keywords: Any) -> None:
        """Save the figure, as `matplotlib.figure.Figure.savefig` does."""
        with style():
            super().savefig(*arguments, **keywords)


def axes_for(ax: Any, size: tuple[float, float], letter: str | None = None) -> Any:
    """Return the plane axes passed, checked, or those of a new figure of a size in inches."""
    if ax is None:
        ax = StyledFigure(figsize=size, layout="constrained").add_subplot()
    elif not isinstance(ax, Axes) or ax.name == "3d":
        raise TypeError(f"ax: expected plane axes of Matplotlib, got {ax!r}")
    if letter:
        ax.set_title(f"({letter})", loc="left", weight="bold", fontsize="medium")
    return ax


def plot_orbits(
    axes: Any, states: FloatArray, components: tuple[int, int], lines: bool | None
) -> None:
    """Draw orbits, states (N, batch, D), in a plane, coloured by the size of the first state."""
    plane, size = states[..., components], np.linalg.norm(states[0], axis=-1)
    lines = _are_near(plane) if lines is None else lines
    known = size[np.isfinite(size)]
    if known.size and known.min() < known.max():
        colours = ScalarMappable(Normalize(known.min(), known.max()), _COLOURS)
        axes.set_prop_cycle(color=colours.to_rgba(size))
        axes.figure.colorbar(colours, ax=axes, label="size of the first state", shrink=0.8)
    look = {"linestyle": "-", "markersize": 3.0} if lines else {"linestyle": "none"}
    look = {"marker": ".", "markersize": 5.0, "markeredgewidth": 0.0, "linewidth": 0.6} | look
    axes.plot(plane[..., 0], plane[..., 1], **look)
    if states.shape[-1] > 2:
        shown = " and ".join(str(k + 1) for k in components)
        axes.set_title(f"components {shown} of {states.shape[-1]}", fontsize="small")


def _are_near(plane: FloatArray) -> bool:
    """True if the median of steps is below 1/20 of the extent of all states (N, batch, 2)."""
    lengths = np.hypot(*np.diff(plane, axis=0).T)
    lengths = lengths[~np.isnan(lengths)]
    known = plane[~np.isnan(plane).any(axis=-1)]
    return bool(lengths.size and 20.0 * np.median(lengths) < np.ptp(known, axis=0).max())


def turning_body(
    body: BodyIn3D, rotations: FloatArray, eps: float
) -> tuple[Any, Callable[[int], list[Any]]]:
    """Return a figure, and a function that draws the body in a given state."""
    radii, principal, I3, _ = ellipsoid(body)
    radii = _RADIUS * radii
    surface = np.einsum("ij,j,jkl->ikl", principal, radii, _sphere())
    path = _PATH * rotations[:, :, 2]
    axes = StyledFigure(figsize=(4.8, 4.8), layout="constrained").add_subplot(projection="3d")
    axes.computed_zorder = False
    axes.set_proj_type("ortho")

    @styled
    def draw(number: int) -> list[Any]:
        axes.clear()
        R, eye, light = rotations[number], _towards_eye(axes), LightSource(azdeg=150.0, altdeg=55.0)
        # A convex body hides an axis that leaves it through the side turned away, and, of a curve
        # outside its sphere, the part behind its centre.
        look = {"color": "#8fbce6", "linewidth": 0, "antialiased": False, "lightsource": light}
        turned = np.einsum("ij,jkl->ikl", R, surface)
        axes.plot_surface(*turned, rcount=65, ccount=65, zorder=2, **look)
        for k, (colour, name) in enumerate(_BODY_AXES):
            normal = principal / radii**2 @ (principal.T[:, k])
            reach = 1.0 / np.sqrt(normal[k])
            order = 3 if R @ normal @ eye > 0 else 1
            ends = np.outer([reach, _TIP], R[:, k]).T
            axes.plot(*ends, color=colour, linewidth=2.2, zorder=order)
            look = {"color": colour, "ha": "center", "va": "center", "zorder": order}
            outline = [withStroke(linewidth=3.0, foreground="white")]
            axes.text(*(_NAME * R[:, k]), name, path_effects=outline, **look)
        past = path[: number + 1]
        _plot_around(axes, past, past @ eye >= 0)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.set_axis_off()
        title = f"time {number * eps:.2f}: ellipsoid of inertia, $I_3$ = {I3:.3g}; path of axis $a$"
        axes.set_title(title, y=0.0, fontsize="small")
        return []

    return axes.figure, draw


def _sphere() -> FloatArray:
    """Return the points (3, 33, 65) of a grid on the unit sphere."""
    pole = 1e-3  # patches with two equal corners have no normal for shading
    v = np.linspace(np.pi - pole, pole, 33)  # normals point outwards
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 65), v)
    return np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])


def _towards_eye(axes: Any) -> FloatArray:
    """Return the unit vector from axes in three dimensions to the eye."""
    elevation, azimuth = np.deg2rad([axes.elev, axes.azim])
    flat = np.cos(elevation)
    return np.array([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


def _plot_around(axes: Any, points: FloatArray, in_front: NDArray[np.bool_]) -> None:
    """Draw a curve (N, 3) around a body at `zorder` 2, the part behind it in a lighter colour."""
    behind = ~in_front  # and the points beside it, so that there is no gap
    behind[1:] |= ~in_front[:-1]
    behind[:-1] |= ~in_front[1:]
    for order, shown, alpha in ((1, behind, 0.45), (3, in_front, 1.0)):
        part = np.where(shown[:, np.newaxis], points, np.nan)
        axes.plot(*part.T, zorder=order, alpha=alpha, color="crimson", linewidth=1.2)
