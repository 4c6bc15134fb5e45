"""The body in space: its ellipsoid of inertia, and the path of the constrained axis."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import BodyIn3D
from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, integer, positive, short, wrong
from ..maps import map_of
from ..runs.iterate import iterate
from ..runs.trajectories import Trajectories
from ..space import attitude
from .phase import Plane

# A realizable body: admissible_I3() contains 2.28 to 5.68.
_EXAMPLE = Suslov3D(4, 2, -0.5, -0.3, 3)
_BODY_AXES = (("black", "$e_1$"), ("black", "$e_2$"), ("crimson", "$a$"))
# Lengths: the largest semi-axis, the axes (the path of the tip of a is drawn) and their names.
_RADIUS, _TIP, _NAME = 0.85, 1.15, 1.28
# Angle of the surface from its poles: patches with two equal corners have no normal for shading.
_POLE = 1e-3


def animate_body(
    body: BodyIn3D | Trajectories = _EXAMPLE,
    omega0: ArrayLike | None = None,
    /,
    eps: float = 0.05,
    steps: int = 440,
    *,
    R0: ArrayLike | None = None,
    every: int = 2,
    fps: int = 25,
) -> Any:
    """Animate the body in space: its ellipsoid of inertia, and the path of the constrained axis.

    Parameters
    ----------
    body : Suslov3D, SuslovGyrostat or Trajectories, optional
        A single body, by default Suslov3D(4, 2, -0.5, -0.3, I3=3). Without I3 the middle of the
        interval ``admissible_I3()`` is drawn or, if no rigid body has these parameters, another.
        Or the run of one orbit, with the orientations that it holds; without them every state must
        be saved.
    omega0 : array_like(float, shape=(2,)), optional
        Initial angular velocity; by default one near the repelling steady rotation.
    eps, steps : float, int
        As in :func:`iterate`; a run has its own.
    R0 : array_like(float, shape=(3, 3)), optional
        The orientation at the start; by default the identity.
    every, fps : int
        Saved states from one frame to the next, and frames per second.

    Returns
    -------
    matplotlib.animation.FuncAnimation

    Raises
    ------
    ValueError
        If the inertia tensor is not positive definite, or a run has failed.
    SingularStepError
        If the orbit meets a pole of the map.

    Examples
    --------
    >>> from suslov_fast import animate_body
    >>> animation = animate_body()  # doctest: +SKIP
    >>> animation.save("body.gif", writer="pillow")  # doctest: +SKIP
    """
    every, interval = integer("every", every, 1), 1000.0 / positive("fps", fps)
    is_run = isinstance(body, Trajectories)
    if isinstance(body, Trajectories):
        run = body
        run.map.require("animate_body", run.body)
        if omega0 is not None:
            raise wrong("omega0", "left out, because the run has states", short(omega0))
        if R0 is not None and run.attitude is not None:
            raise wrong("R0", "left out, because the run has orientations", short(R0))
    else:
        run = _new_run(body, omega0, eps, steps, True if R0 is None else R0)
    if run.status.ndim:
        what = "run" if is_run else "omega0, R0"
        raise wrong(what, "a single state and orientation", f"a batch {run.status.shape}")
    if not run.ok:
        raise ValueError(f"this orbit has no state at step {int(run.failed_at)}: draw fewer steps")
    whole, rotations = cast(BodyIn3D, run.body), run.attitude
    if rotations is None:
        rotations = attitude(whole, run.states, run.eps, R0)
    figure, draw = _turning_body(whole, rotations, run.time)

    from matplotlib.animation import FuncAnimation

    return FuncAnimation(figure, draw, frames=range(0, len(rotations), every), interval=interval)


def _new_run(body: BodyIn3D, omega0: Any, eps: float, steps: int, attitude: Any) -> Trajectories:
    """Return the run of one orbit, by default from a state near the repelling steady rotation."""
    map_of(body).require("animate_body", body)
    if body.shape or np.ndim(eps):
        shapes = f"the shapes {body.shape} and {np.shape(eps)}: for a run call animate_body(run)"
        raise wrong("body, eps", "a single body and a single step size", shapes)
    if omega0 is None:
        middle, (x, y) = Plane(body, eps).steady_line() or (0.0, (1.0, 0.0))
        omega0 = middle + 2.0 * np.array([x, y]) + 0.3 * np.array([-y, x])
    return iterate(body, omega0, eps, steps, attitude=attitude, on_singular="raise")


def _turning_body(body: BodyIn3D, rotations: FloatArray, times: FloatArray) -> tuple[Any, Any]:
    """Return a figure, and a function that draws the body in a given state."""
    from ..runs.plot import plt

    drawn = ellipsoid(body)
    if drawn is None:
        how = "no body has it: choose one in body.admissible_I3()"
        raise ValueError(f"I3 = {body.I3}: {how}")
    radii, principal = _RADIUS * drawn["radii"], drawn["axes"]
    v = np.linspace(np.pi - _POLE, _POLE, 33)  # normals point outwards
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 65), v)
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    surface = np.einsum("ij,j,jkl->ikl", principal, radii, sphere)
    look = {"color": "#8fbce6", "linewidth": 0, "antialiased": False, "rcount": 65, "ccount": 65}
    axes = plt.Figure(figsize=(4.8, 4.8), layout="constrained").add_subplot(projection="3d")
    axes.computed_zorder = False
    axes.set_proj_type("ortho")
    axes.view_init(elev=30, azim=-60)
    eye = np.array([np.sqrt(3), -3, 2]) / 4
    path = _TIP * rotations[:, :, 2]
    in_front = np.where(path @ eye >= 0, path.T, np.nan).T
    head = f"ellipsoid of inertia, $I_3$ = {drawn['I3']:.3g}; path of axis $a$"

    def draw(number: int) -> None:
        axes.clear()
        R = rotations[number]
        axes.plot_surface(*np.einsum("ij,jkl->ikl", R, surface), zorder=2, **look)
        for k, (colour, name) in enumerate(_BODY_AXES):
            # A convex body hides an axis that leaves it through the side turned away.
            normal = principal / radii**2 @ (principal.T[:, k])
            order = 3 if R @ normal @ eye > 0 else 1
            ends = np.outer([1.0 / np.sqrt(normal[k]), _TIP], R[:, k])
            axes.plot(*ends.T, color=colour, linewidth=2.2, zorder=order)
            place = {"ha": "center", "va": "center", "zorder": order}
            axes.text(*(_NAME * R[:, k]), name, color=colour, **place)
        # The path lies outside the body, which hides what is behind: that part is lighter.
        for order, points, alpha in ((1, path, 0.45), (3, in_front, 1.0)):
            line = {"color": "crimson", "linewidth": 1.2, "alpha": alpha, "zorder": order}
            axes.plot(*points[: number + 1].T, **line)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.25)
        axes.set_axis_off()
        axes.set_title(f"time {times[number]:.2f}: {head}", y=0.0, fontsize="small")

    return axes.figure, draw


def ellipsoid(body: BodyIn3D) -> dict[str, Any] | None:
    """The ellipsoid of inertia, if there is one, and whether a rigid body has this I3 (`matter`).

    The largest semi-axis is 1; directions are columns. Without I3 the middle of the interval or,
    if that is empty, a number of an ellipsoid is taken.
    """
    I1, I2, I13, I23, _ = body.constants
    low, high = Suslov3D(I1, I2, I13, I23).admissible_I3()
    large = max(I1, I2, 2.0 * (I13**2 / I1 + I23**2 / I2))
    middle = float(np.nan_to_num(0.5 * (low + high), nan=large))
    I3 = middle if body.I3 is None else body.I3
    moments, axes = np.linalg.eigh(body._inertia(I3))
    if not moments[0] > 0:
        return None
    radii, matter = np.sqrt(moments[0] / moments), bool(low < I3 < high)
    return {"radii": radii, "axes": axes, "I3": I3, "matter": matter}
