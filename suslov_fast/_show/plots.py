"""Pictures: functions that draw on Matplotlib axes and return them (extra `plots`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.body_3d import Suslov3D
from .._checks import FloatArray, integer, positive, wrong
from .._engine.arguments import BodyIn3D
from .._runs.iterate import iterate
from .._space.attitude import attitude
from .._states.conserved import energy
from .._states.derivatives import vector_field
from .geometry import check_moving, half_angle, level, meeting_phase, on_level, steady_line
from .style import styled

# Lines differ in style as well as in colour.
_LINE_COLOUR = "crimson"
_STEADY = r"$I_{13}\,\Omega_1 + I_{23}\,\Omega_2"
# Phase between the ends of orbits and the line, where the arc is a half turn; longest orbits.
_FROM_LINE, _LONGEST_TURN = 0.03, 1000
# A realizable body: admissible_I3() contains 2.28 to 5.68.
_EXAMPLE = Suslov3D(4, 2, -0.5, -0.3, 3)


@styled
def plot_phase(
    body: BodyIn3D,
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
    body : Suslov3D or SuslovGyrostat
        A single body, of which not all states are steady.
    eps : float
        Positive step size; the criticality must be below 1 in the whole picture.
    extent : float
        Distance from 0 that the axes reach, in the unit of omega.
    levels : int
        Number of level curves, at least 1.
    %(letter)s
    legend : bool
        Draw a legend below the axes.
    %(ax)s

    Returns
    -------
    matplotlib.axes.Axes

    %(Raises: invalid)s

    Notes
    -----
    Each level has a colour: a thin line, and states of the map as dots. An orbit is drawn from near
    a repelling to near an attracting steady state, on both sides of the line; a periodic one for
    one turn.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, plot_phase
    >>> ax = plot_phase(Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), eps=0.2, extent=4.0)
    >>> [float(end) for end in ax.get_xlim()]
    [-4.0, 4.0]
    """
    from matplotlib import colormaps

    from .figures import axes_for

    check_moving(body)
    g, k = half_angle(body)
    eps, extent = positive("eps", eps), positive("extent", extent)
    levels = integer("levels", levels, 1)
    e = 0.5 * eps / float(np.sqrt(body.I1 * body.I2))
    largest = float(np.sqrt(2.0 * energy(body, [extent, extent])))
    if not e * largest * abs(g) < 1:
        expected = "a criticality below 1 in the corners of the picture"
        raise wrong("extent", expected, f"{e * largest * abs(g):.3g}")
    axes = axes_for(ax, (5.2, 5.6), letter)
    colours = colormaps["viridis"](np.linspace(0.1, 0.8, levels))
    for R, colour in zip(largest * np.arange(1, levels + 1) / (levels + 1), colours, strict=True):
        (curve,) = level(body, eps, R)
        axes.plot(*curve.T, "-", color=colour, linewidth=0.8, alpha=0.7)
        for psi, steps in _orbits(e, R * abs(g), k):
            orbit = iterate(body, on_level(body, eps, R, np.array(psi)), eps, steps).omega
            axes.plot(*orbit.T, ".", color=colour, markersize=4.5, markeredgewidth=0)
            _arrow(axes, body, orbit, extent, colour)
    if g:
        _steady_states(axes, body, 4.0 * extent)
    colour, name = colours[levels // 2], "levels of $F$, one colour each"
    axes.plot([], [], "-", color=colour, linewidth=0.8, label=name)
    axes.plot([], [], ".", color=colour, markersize=6, label="states of the map")
    axes.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal")
    axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$")
    axes.locator_params(nbins=8, steps=[1, 2, 5, 10])
    if legend:  # below the label of the axis, in units of the font size
        place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.2}
        axes.legend(**place, ncols=2, frameon=False, fontsize="small")
    return axes


@styled
def animate_body(
    body: BodyIn3D | None = None,
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
    body : Suslov3D or SuslovGyrostat, optional
        A single body with a positive definite inertia tensor, by default
        Suslov3D(4, 2, -0.5, -0.3, I3=3). Without I3 the middle of the interval ``admissible_I3()``
        is drawn or, if no rigid body has these parameters, another one.
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
    %(invalid)s
    SingularStepError
        If the orbit meets a pole of the map.

    Examples
    --------
    >>> from suslov_fast import animate_body
    >>> animation = animate_body()  # doctest: +SKIP
    >>> animation.save("body.gif", writer="pillow")  # doctest: +SKIP
    """
    from matplotlib.animation import FuncAnimation

    from .figures import turning_body

    if np.ndim(eps):
        raise wrong("eps", "a single number", eps)
    every, interval = integer("every", every, 1), 1000.0 / positive("fps", fps)
    body = _EXAMPLE if body is None else body
    check_moving(body)
    g, k = half_angle(body)
    if omega0 is None:  # near the repelling steady rotation, where there is one
        R = 2.0 * float(np.sqrt(2.0 * energy(body, steady_line(body)[1] if g else [1.0, 0.0])))
        omega0 = on_level(body, eps, R, np.array(0.15 - meeting_phase(R * abs(g), k)))
    omega = iterate(body, omega0, eps, steps, on_singular="raise").omega
    rotations = attitude(body, omega, eps, R0)
    if rotations.ndim != 3:
        received = f"a batch of shape {rotations.shape[1:-2]}"
        raise wrong("omega0, R0", "a single state and orientation", received)
    figure, draw = turning_body(body, rotations, eps)
    return FuncAnimation(figure, draw, frames=range(0, steps + 1, every), interval=interval)


def _orbits(e: float, A: float, k: float) -> list[tuple[float, int]]:
    """Phase of the initial state, and steps, of the orbits on a level; theory: the gyrostat."""
    if abs(k) > A:  # one turn
        steps = np.pi / np.arctan(e * np.sqrt(k * k - A * A))
        return [(0.0, int(min(np.ceil(steps), _LONGEST_TURN)))]
    # From the steady state at -end to that at end, on either side.
    end, rate = meeting_phase(A, k), e * np.sqrt(A * A - k * k)
    orbits = []
    for side, half in ((1.0, end), (-1.0, np.pi - end)):
        psi = -end + side * 2.0 / np.pi * half * _FROM_LINE
        p, q = np.sin(0.5 * psi) / np.sqrt(A + k), np.cos(0.5 * psi) / np.sqrt(A - k)
        steps = np.log(abs((p - q) / (p + q))) / np.arctanh(rate)
        orbits.append((psi, int(min(np.ceil(steps), _LONGEST_TURN))))
    return orbits


def _steady_states(axes: Any, body: Any, reach: float) -> None:
    """The attracting and the repelling half of the line l = 0, which meet where F is least."""
    middle, direction = steady_line(body)
    k = half_angle(body)[1]
    line = _STEADY + (r" + k = 0$" if k else " = 0$")
    for sign, style, name in ((-1, "-", "attracting"), (1, (0, (4, 2)), "repelling")):
        ends = middle + np.outer([0.0, sign * (reach + np.hypot(*middle))], direction)
        label = f"{line}, {name}"
        axes.plot(*ends.T, color=_LINE_COLOUR, linewidth=2.4, linestyle=style, label=label)


def _arrow(axes: Any, body: Any, orbit: FloatArray, extent: float, colour: Any) -> None:
    """Direction of motion at the middle state of the orbit, or the nearest one in view."""
    inside = np.flatnonzero((abs(orbit) < 0.95 * extent).all(axis=-1))
    if inside.size:
        state = orbit[inside[np.argmin(abs(inside - len(orbit) // 2))]]
        along = vector_field(body, state)
        along = 0.01 * extent * along / np.hypot(*along)
        style = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 12, "linewidth": 0.8}
        axes.annotate("", xy=state + along, xytext=state - along, arrowprops=style)
