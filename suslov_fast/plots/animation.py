"""The animation of the body in space, `animate_body`, and the ellipsoid of inertia."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from ..bodies.classes import BodyIn3D
from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, integer, kind_of, positive, wrong
from ..keywords import public
from ..runs.trajectories import Trajectories
from ..space import attitude

_BODY_AXES = (("black", "$e_1$"), ("black", "$e_2$"), ("crimson", "$a$"))
# Distances from the centre: the largest semi-axis, the tips of the axes, and their names.
_RADIUS, _TIP, _NAME = 0.85, 1.15, 1.28
# Angle between the surface and its poles, because a patch with two equal corners has no normal.
_POLE = 1e-3


@public
def animate_body(run: Trajectories, /, *, every: int = 2, fps: int = 25) -> Any:
    """Return an animation of the body in space: ellipsoid of inertia, and path of the axis a.

    The constrained axis a is the one about which rotation is forbidden.

    Parameters
    ----------
    run : Trajectories
        The run of one orbit of a `Suslov3D` or a `SuslovGyrostat`, with `attitude` or with every
        state saved. If I3 of the body is not set, the middle of the interval ``admissible_I3()`` is
        drawn; if that is empty, another I3 whose inertia tensor is positive definite.
    every, fps : int
        Saved states from one frame to the next, and frames per second.

    Returns
    -------
    matplotlib.animation.FuncAnimation
        Keep it in a variable while it plays, or call its `save`.

    Raises
    ------
    TypeError, ValueError
        If the inertia tensor is not positive definite, or this is not the run of one orbit that has
        not failed.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, animate_body, iterate
    >>> run = iterate(Suslov3D(4, 2, -0.5, -0.3, 3), [-1.3, 1.6], 0.05, 440, attitude=True)
    >>> animation = animate_body(run)  # doctest: +SKIP
    >>> animation.save("body.gif", writer="pillow")  # doctest: +SKIP
    """
    every, interval = integer("every", every, 1), 1000.0 / positive("fps", fps)
    if not isinstance(run, Trajectories):
        raise wrong("run", "iterate(body, omega0, eps, steps)", kind_of(run), TypeError)
    run.map.require("animate_body", run.body)
    if run.status.ndim:
        raise wrong("run", "that of one orbit", f"a batch {run.status.shape}")
    if not run.ok:
        raise ValueError(f"this orbit has no state at step {int(run.failed_at)}: draw fewer steps")
    body, orientations = cast(BodyIn3D, run.body), run.attitude
    if orientations is None:
        orientations = attitude(body, run.states, run.eps)
    figure, draw = _rotating_body(body, orientations, run.time)

    from matplotlib.animation import FuncAnimation

    return FuncAnimation(figure, draw, frames=range(0, len(orientations), every), interval=interval)


def _rotating_body(body: BodyIn3D, orientations: FloatArray, times: FloatArray) -> tuple[Any, Any]:
    """Return a figure, and a function that draws the body at a saved state."""
    from ..runs.plot import plt

    shape = ellipsoid(body)
    if shape is None:
        how = "no body has it: choose one in body.admissible_I3()"
        raise ValueError(f"I3 = {body.I3}: {how}")
    radii, principal = _RADIUS * shape["radii"], shape["axes"]
    polar = np.linspace(np.pi - _POLE, _POLE, 33)  # descending, so that normals point outwards
    azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 65), polar)
    x, y, z = np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)
    surface = np.einsum("ij,j,jkl->ikl", principal, radii, np.stack([x, y, z]))
    style = {"color": "#8fbce6", "linewidth": 0, "antialiased": False, "rcount": 65, "ccount": 65}
    axes = plt.Figure(figsize=(4.8, 4.8), layout="constrained").add_subplot(projection="3d")
    axes.computed_zorder = False
    axes.set_proj_type("ortho")
    axes.view_init(elev=30, azim=-60)
    eye = np.array([np.sqrt(3), -3, 2]) / 4
    path = _TIP * orientations[:, :, 2]
    in_front = np.where(path @ eye >= 0, path.T, np.nan).T
    head = f"ellipsoid of inertia, $I_3$ = {shape['I3']:.3g}; path of axis $a$"

    def draw(number: int) -> None:
        axes.clear()
        R = orientations[number]
        axes.plot_surface(*np.einsum("ij,jkl->ikl", R, surface), zorder=2, **style)
        for k, (colour, name) in enumerate(_BODY_AXES):
            # The body hides an axis if the surface faces away where the axis leaves it.
            normal = principal / radii**2 @ (principal.T[:, k])
            order = 3 if R @ normal @ eye > 0 else 1
            ends = np.outer([1.0 / np.sqrt(normal[k]), _TIP], R[:, k])
            axes.plot(*ends.T, color=colour, linewidth=2.2, zorder=order)
            alignment = {"ha": "center", "va": "center", "zorder": order}
            axes.text(*(_NAME * R[:, k]), name, color=colour, **alignment)
        # The whole path is drawn lightly behind the body, then its front part over the body.
        for order, points, alpha in ((1, path, 0.45), (3, in_front, 1.0)):
            line = {"color": "crimson", "linewidth": 1.2, "alpha": alpha, "zorder": order}
            axes.plot(*points[: number + 1].T, **line)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.set_axis_off()
        axes.set_title(f"time {times[number]:.2f}: {head}", y=0.0, fontsize="small")

    return axes.figure, draw


def ellipsoid(body: BodyIn3D) -> dict[str, Any] | None:
    """Return the ellipsoid of inertia; None if the inertia tensor is not positive definite.

    `radii` are the semi-axes, the largest is 1; columns of `axes` are their directions; `matter` is
    whether a rigid body can have this I3. If `body.I3` is not set, `I3` is the middle of the
    admissible interval; if that is empty, one of a positive definite tensor.
    """
    I1, I2, I13, I23, _ = body.constants
    low, high = Suslov3D(I1, I2, I13, I23).admissible_I3()
    definite = max(I1, I2, 2.0 * (I13**2 / I1 + I23**2 / I2))
    middle = float(np.nan_to_num(0.5 * (low + high), nan=definite))
    I3 = middle if body.I3 is None else body.I3
    moments, axes = np.linalg.eigh(body._inertia(I3))
    if not moments[0] > 0:
        return None
    radii, is_realizable = np.sqrt(moments[0] / moments), bool(low < I3 < high)
    return {"radii": radii, "axes": axes, "I3": I3, "matter": is_realizable}
