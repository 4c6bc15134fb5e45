"""Pictures: functions that draw on Matplotlib axes and return them (extra `plots`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.three import Suslov3D
from .._checks import FloatArray, integer, vectors, wrong
from .._runs.iterate import iterate
from .._space.attitude import attitude
from .._states.conserved import criticality, energy
from .._states.continuous import vector_field
from .._states.coordinates import from_xy, to_xy
from .figures import axes_for, legend_below, positive
from .plane import level_curves, repelling_direction
from .style import styled
from .turning import turning_body

# Lines differ in style as well as in colour.
_LINE = "crimson"
_STEADY = r"$I_{13}\,\Omega_1 + I_{23}\,\Omega_2 = 0$"
# Angle of the ends of orbits from the line, in coordinates in which energy levels are circles.
_NEAR = 0.03
# A realizable body: admissible_I3() is (2.27, 5.68).
_BODY = Suslov3D(4, 2, -0.5, -0.3, 3)


@styled
def plot_phase(
    body: Suslov3D,
    eps: float,
    extent: float,
    *,
    levels: int = 9,
    letter: str | None = None,
    legend: bool = True,
    ax: Any = None,
) -> Any:
    """Draw orbits of the map and the level curves of F in the plane (Omega1, Omega2).

    Parameters
    ----------
    body : Suslov3D
        A single body, whose products of inertia are not both 0.
    eps : float
        Positive step size; t < 1 must hold in the whole picture.
    extent : float
        Distance from 0 that the axes reach, in the unit of omega.
    levels : int
        Number of level curves, at least 1.
    legend : bool
        Draw a legend below the axes.
    %(panel)s

    Raises
    ------
    TypeError, ValueError
        If t >= 1 in the corners of the picture, all states are steady, or an argument is not of the
        kind above.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, plot_phase
    >>> ax = plot_phase(Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), eps=0.2, extent=4.0)
    >>> [float(end) for end in ax.get_xlim()]
    [-4.0, 4.0]
    """
    direction = repelling_direction(body)
    eps, extent = positive("eps", eps), positive("extent", extent)
    levels = integer("levels", levels, 1)
    farthest = np.sqrt(energy(body, [extent, extent]) / energy(body, direction))
    in_corners = float(criticality(body, farthest * direction, eps))
    if not in_corners < 1:
        expected = "a criticality t < 1 in the corners of the picture"
        raise wrong("extent", expected, f"t = {in_corners:.3g}")
    axes = axes_for(ax, (5.2, 5.6), letter)
    colours = _colours(levels)
    for level, colour in zip(np.arange(1, levels + 1) / (levels + 1), colours, strict=True):
        starts, t, steps = _orbit_through(body, eps, level * farthest * direction)
        orbits = iterate(body, starts, eps, steps).omega
        axes.plot(*level_curves(body, eps, t)[0].T, "-", color=colour, linewidth=0.8, alpha=0.7)
        for k in range(2):
            axes.plot(*orbits[:, k].T, ".", color=colour, markersize=4.5, markeredgewidth=0)
            _arrow(axes, body, orbits[:, k], extent, colour)
    for sign, style, name in ((-1, "-", "attracting"), (1, (0, (4, 2)), "repelling")):
        ends = np.outer([0, sign * 2.0 * extent], direction)
        label = f"{_STEADY}, {name}"
        axes.plot(*ends.T, color=_LINE, linewidth=2.4, linestyle=style, label=label)
    axes.plot([], [], "-", color=colours[levels // 2], linewidth=0.8, label="$F$ constant")
    axes.plot([], [], ".", color=colours[levels // 2], markersize=6, label="states of the map")
    axes.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal")
    axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$")
    axes.locator_params(nbins=8, steps=[1, 2, 5, 10])
    if legend:
        legend_below(axes, 2)
    return axes


@styled
def animate_body(
    body: Suslov3D | None = None,
    omega0: ArrayLike | None = None,
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
    body : Suslov3D, optional
        A single body, drawn with its I3; by default one with I1 = 4, I2 = 2, I13 = -0.5,
        I23 = -0.3 and I3 = 3. Where a body has no I3, the middle of ``body.admissible_I3()`` is
        drawn or, where no rigid body has these parameters, an I3 with a positive definite
        inertia tensor.
    omega0 : array_like(float, shape=(2,)), optional
        Initial angular velocity; by default one that passes from one steady rotation to the other.
    eps : float
        Step size.
    steps : int
        Number of steps.
    R0 : array_like(float, shape=(3, 3)), optional
        The orientation at the start; by default the identity.
    every : int
        Steps from one frame to the next.
    fps : int
        Frames per second.

    Returns
    -------
    matplotlib.animation.FuncAnimation

    Raises
    ------
    TypeError, ValueError
        If with the I3 of the body the inertia tensor is not positive definite, or an argument is
        not of the kind above.
    SingularStepError
        If the orbit meets a pole of the map.

    Examples
    --------
    >>> from suslov_fast import animate_body
    >>> animation = animate_body()  # doctest: +SKIP
    >>> animation.save("body.gif", writer="pillow")  # doctest: +SKIP
    """
    from matplotlib.animation import FuncAnimation

    if np.ndim(eps):
        raise wrong("eps", "a single number", eps)
    every, interval = integer("every", every, 1), 1000.0 / positive("fps", fps)
    body = _BODY if body is None else body
    direction = repelling_direction(body)
    if omega0 is None:
        _, y = to_xy(body, 2.0 * direction)
        omega0 = from_xy(body, [0.15 * y / np.sqrt(body.I1 * body.I2), y])
    omega = iterate(body, _state(omega0), eps, steps, on_singular="raise").omega
    rotations = attitude(body, omega, eps, R0)
    if rotations.ndim != 3:
        raise wrong("R0", "shape (3, 3)", rotations.shape[1:])
    figure, draw = turning_body(body, rotations)
    return FuncAnimation(figure, draw, frames=range(0, steps + 1, every), interval=interval)


def _state(omega0: ArrayLike) -> FloatArray:
    """Return a single state."""
    state = vectors("omega0", omega0, 2)
    if state.ndim != 1:
        raise wrong("omega0", "shape (2,)", state.shape)
    return state


def _colours(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.1, 0.8, count))


def _orbit_through(body: Suslov3D, eps: float, end: FloatArray) -> tuple[FloatArray, float, int]:
    """Two states near a repelling steady state, their t, and the steps to the attracting one."""
    _, y_end = to_xy(body, end)
    y = y_end * np.cos(_NEAR)
    x = y_end * np.sin(_NEAR) / np.sqrt(body.I1 * body.I2) * np.array([-1.0, 1.0])
    starts = from_xy(body, np.stack([x, [y, y]], axis=-1))
    t = float(criticality(body, starts[0], eps))
    return starts, t, int(np.ceil(np.arctanh(np.cos(_NEAR)) / np.arctanh(t)))


def _arrow(axes: Any, body: Suslov3D, orbit: FloatArray, extent: float, colour: Any) -> None:
    """Direction of motion at the middle state of the orbit, or the nearest one in view."""
    inside = np.flatnonzero((abs(orbit) < 0.95 * extent).all(axis=-1))
    if inside.size:
        state = orbit[inside[np.argmin(abs(inside - len(orbit) // 2))]]
        along = vector_field(body, state)
        along = 0.01 * extent * along / np.hypot(*along)
        style = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 12, "linewidth": 0.8}
        axes.annotate("", xy=state + along, xytext=state - along, arrowprops=style)
