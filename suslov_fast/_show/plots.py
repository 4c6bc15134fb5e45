"""Pictures: functions that draw on Matplotlib axes and return them (extra `plots`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray, instance, integer, real_array, vectors, wrong
from .._runs.iterate import iterate
from .._runs.solution import exact, flow
from .._space.attitude import attitude
from .._space.scattering import scattering_angle
from .._states.conserved import criticality, energy, modified_energy
from .._states.continuous import vector_field
from .._states.coordinates import from_xy, to_xy
from .ellipsoid import sphere
from .figures import axes_for, legend_below, plot_around, positive, towards_eye
from .plane import conic, level_curves, repelling_direction
from .style import styled
from .turning import turning_body

# Lines differ in style as well as in colour.
_LINE, _ACCENT = "crimson", "steelblue"
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
    [axes] = axes_for(ax, (5.2, 5.6), letters=letter)
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
def plot_regimes(
    body: Suslov3D | None = None,
    eps: float = 1.0,
    *,
    letters: Sequence[str] | None = None,
    ax: Sequence[Any] | None = None,
) -> list[Any]:
    """Draw orbits below, at and above t = 1, iterated and by the closed form.

    Parameters
    ----------
    body : Suslov3D, optional
        A single body. In these coordinates orbits do not depend on it.
    eps : float
        Positive step size, on which they do not depend either.
    %(panels)s

    Raises
    ------
    TypeError, ValueError
        If `body` is no single Suslov3D, `eps` not positive, or `ax` are not three axes.

    Examples
    --------
    >>> from suslov_fast import plot_regimes
    >>> len(plot_regimes(letters="abc"))
    3
    """
    body, eps = _single(body), positive("eps", eps)
    panels = axes_for(ax, (11.0, 4.6), (None,) * 3, letters)
    _draw_regime(panels[0], body, eps, [(0.06, 0.4), (-0.06, 0.4)], 9, (0.8, 0.6))
    _draw_regime(panels[1], body, eps, [(0.75, 1.0), (-1.6, 1.0), (-2.4, -1.0)], 2, (3.2, 2.2))
    _draw_regime(panels[2], body, eps, [(0.33, 1.53)], 5, (3.2, 3.6))
    panels[0].set_ylabel(r"$Y = \epsilon y / (2 I_1 I_2)$")
    legend_below(panels[1], 2)
    return panels


@styled
def plot_convergence(
    body: Suslov3D | None = None,
    omega0: ArrayLike = (1.0, 0.5),
    time: float = 4.0,
    *,
    letter: str | None = None,
    ax: Any = None,
) -> Any:
    """Plot the errors of the map and of the orientation at a fixed time against the step size.

    Parameters
    ----------
    body : Suslov3D, optional
        A single body; by default one with I1 = 4, I2 = 2, I13 = -0.5 and I23 = -0.3.
    omega0 : array_like(float, shape=(2,))
        Initial angular velocity.
    time : float
        Positive time at which the errors are taken, in the inverse unit of omega0.
    %(panel)s

    Raises
    ------
    TypeError, ValueError
        If `body` is no single Suslov3D, `omega0` no single state, `time` not positive, or `ax` no
        axes.

    Examples
    --------
    >>> from suslov_fast import plot_convergence
    >>> plot_convergence().get_xscale()
    'log'
    """
    body, omega0, time = _single(body), _state(omega0), positive("time", time)
    [axes] = axes_for(ax, (5.2, 3.9), letters=letter)
    steps = 2 ** np.arange(3, 13)
    eps = time / steps
    finest = _orientation(body, omega0, time, 2**15)
    end = flow(body, omega0, time)
    of_map = [np.hypot(*(exact(body, omega0, time / n, int(n)) - end)) for n in steps]
    of_attitude = [np.linalg.norm(_orientation(body, omega0, time, int(n)) - finest) for n in steps]
    axes.loglog(eps, of_attitude, "s-", color=_ACCENT, label=r"orientation $R$")
    axes.loglog(eps, of_map, "o-", color="black", label=r"angular velocity $\Omega$")
    guide = 0.3 * of_map[0] * (eps / eps[0]) ** 2
    axes.loglog(eps, guide, "--", color=_LINE, label=r"$\propto \epsilon^2$")
    axes.set(xlabel=r"step size $\epsilon$", ylabel=f"error at time {time:g}")
    axes.legend(frameon=False, loc="upper left")
    axes.grid(alpha=0.3)
    return axes


@styled
def plot_four_dimensions(
    body: SuslovND | None = None,
    *,
    letters: Sequence[str] | None = None,
    ax: Sequence[Any] | None = None,
) -> list[Any]:
    """Draw a motion for n = 4 on the energy ellipsoid, and the drift of two energies.

    The first of the two panels has ``projection="3d"``.

    Parameters
    ----------
    body : SuslovND, optional
        A single body with n = 4.
    %(panels)s

    Raises
    ------
    ValueError
        If the body is a batch, or n is not 4.

    Examples
    --------
    >>> from suslov_fast import plot_four_dimensions
    >>> len(plot_four_dimensions())
    2
    """
    body = SuslovND(np.array([1.0, 1.6, 2.2]), np.array([0.5, -0.3, 0.4])) if body is None else body
    instance("body", body, SuslovND)
    if body.dimension != 3 or body.shape:
        raise wrong("body", "a single one with n = 4", body)
    panels = axes_for(ax, (10.4, 4.6), ("3d", None), letters)
    pole, starts = _around_repelling_state(body)
    _draw_ellipsoid(panels[0], body, pole, starts)
    _draw_drift(panels[1], body, starts[0])
    return panels


@styled
def plot_scattering(
    ratios: Sequence[float] = (1.0, 4.0),
    *,
    extent: float | None = None,
    letters: Sequence[str] | None = None,
    ax: Sequence[Any] | None = None,
) -> list[Any]:
    """Draw the scattering angle of all bodies with given ratios of I1 and I2.

    Parameters
    ----------
    ratios : sequence of float
        I1 / I2, one for each panel.
    extent : float, optional
        Distance from 0 that the products of inertia reach, in units of sqrt(I1 I2); by default as
        far as those of bodies do.
    %(panels)s

    Raises
    ------
    TypeError, ValueError
        If `ratios` is empty or not positive, or the number of `ax` is not that of `ratios`.

    Notes
    -----
    Where :meth:`Suslov3D.admissible_I3` is NaN no body has these parameters, and none is drawn.

    Examples
    --------
    >>> from suslov_fast import plot_scattering
    >>> len(plot_scattering((1.0, 2.0, 4.0)))
    3
    """
    from matplotlib.colors import BoundaryNorm

    shape = np.shape(real_array("ratios", ratios))
    if len(shape) != 1 or not shape[0]:
        raise wrong("ratios", "at least one number, in a sequence", ratios)
    ratios = [positive("ratios", each) for each in ratios]
    extent = None if extent is None else positive("extent", extent)
    panels = axes_for(ax, (1.2 + 3.6 * len(ratios), 4.2), (None,) * len(ratios), letters)
    angles = [_angles(ratio, extent) for ratio in ratios]
    bounds = np.array([0.01, 0.03, 0.1, 0.3, 1, 3, 10, 20, 30, 45, 60, 90, 120, 150, 180])
    largest = max(float(np.nanmax(degrees)) for _, _, degrees in angles)
    bounds = bounds[: np.searchsorted(bounds, largest) + 1]
    style = {"cmap": "viridis", "norm": BoundaryNorm(bounds, 256, extend="min"), "extend": "min"}
    for panel, ratio, (I13, I23, degrees) in zip(panels, ratios, angles, strict=True):
        shades = panel.contourf(I13, I23, degrees, bounds, **style)
        shades.set_edgecolor("face")  # avoids seams between shades in vector formats
        levels = (10, 30, 90) if np.nanmax(degrees) > 10 else (1, 3)
        lines = panel.contour(I13, I23, degrees, levels, colors="white", linewidths=0.7)
        panel.clabel(lines, fmt="%g°", fontsize=8)
        panel.set_facecolor("0.9")
        panel.text(0.03, 0.03, "no body", color="0.35", transform=panel.transAxes)
        panel.set_title(rf"$I_1 / I_2 = {ratio:g}$", fontsize="medium")
        panel.set_xlabel(r"$I_{13} / \sqrt{I_1 I_2}$")
    panels[0].set_ylabel(r"$I_{23} / \sqrt{I_1 I_2}$")
    bar = panels[0].figure.colorbar(shades, ax=panels, ticks=bounds, format="%g")
    bar.set_label("scattering angle (degrees)")
    return panels


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


def _single(body: Suslov3D | None) -> Suslov3D:
    """Return a single body, by default a realizable one."""
    body = _BODY if body is None else body
    instance("body", body, Suslov3D)
    if body.shape:
        raise wrong("body", "a single one", body)
    return body


def _state(omega0: ArrayLike) -> FloatArray:
    """Return a single state."""
    state = vectors("omega0", omega0, 2)
    if state.ndim != 1:
        raise wrong("omega0", "shape (2,)", state.shape)
    return state


def _colours(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.1, 0.8, count))


def _angles(ratio: float, extent: float | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """I13, I23 and the scattering angle in degrees, for I1 I2 = 1; NaN where no body exists."""
    I1, I2, half = np.sqrt(ratio), 1.0 / np.sqrt(ratio), np.linspace(0.0, 1.0, 151)
    if extent is not None:
        reach = [extent, extent]
    else:
        coarse = half[::3]
        exists = np.isfinite(Suslov3D(I1, I2, coarse, coarse[:, np.newaxis]).admissible_I3()[0])
        reach = [1.1 * coarse[exists.any(axis=k)].max() for k in (0, 1)]
    body = Suslov3D(I1, I2, reach[0] * half, reach[1] * half[:, np.newaxis])
    degrees = np.rad2deg(scattering_angle(body))
    degrees[np.isnan(body.admissible_I3()[0])] = np.nan
    # Mirror images have the same angle.
    both = np.concatenate([-half[:0:-1], half])
    return reach[0] * both, reach[1] * both, np.pad(degrees, ((150, 0), (150, 0)), "reflect")


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


def _draw_regime(
    axes: Any,
    body: Suslov3D,
    eps: float,
    starts: list[tuple[float, float]],
    steps: int,
    size: tuple[float, float],
) -> None:
    """Orbits on one level; starts and axes are in units of sqrt(2a)/eps and 2a/eps."""
    units = np.array([np.sqrt(2.0 * body.I1 * body.I2), 2.0 * body.I1 * body.I2]) / eps
    omega0 = from_xy(body, starts * units)
    t = float(criticality(body, omega0[0], eps))
    for k, branch in enumerate(conic(t)):
        label = None if k else "level of the first integral"
        axes.plot(*branch, color=_ACCENT, linewidth=1.2, label=label)
    iterated = to_xy(body, iterate(body, omega0, eps, steps).omega) / units
    closed = to_xy(body, exact(body, omega0, eps, np.arange(steps + 1))) / units
    hollow = {"color": _ACCENT, "fillstyle": "none", "markersize": 9}
    for k in range(len(starts)):
        labels = (None, None) if k else ("iterated", "closed form")
        axes.plot(*iterated[:, k].T, ":", color="grey", linewidth=0.8)
        axes.plot(*iterated[:, k].T, "o", color="black", markersize=3.5, label=labels[0])
        axes.plot(*closed[:, k].T, "o", label=labels[1], **hollow)
        for n, point in enumerate(iterated[:, k]):
            if n == 0 or abs(point[0]) > 0.06 * size[0]:
                side, up = np.sign(point) * (9, 7)
                place = {"xytext": (side, up), "textcoords": "offset points", "fontsize": 9}
                axes.annotate(f"{n}", point, ha="center", va="center", **place)
    axes.axvline(0.0, color=_LINE, linewidth=2.0, label=_STEADY, zorder=0)
    axes.set(xlim=(-size[0], size[0]), ylim=(-size[1], size[1]))
    axes.set_xlabel(r"$X = \epsilon x / \sqrt{2 I_1 I_2}$")
    axes.set_title(f"$t = {t:.3g}$", fontsize="medium")


def _orientation(body: Suslov3D, omega0: ArrayLike, time: float, steps: int) -> FloatArray:
    states = iterate(body, omega0, time / steps, steps).omega
    final: FloatArray = attitude(body, states, time / steps)[-1]
    return final


def _around_repelling_state(body: SuslovND) -> tuple[FloatArray, FloatArray]:
    """The repelling steady state of energy 1, and states of energy 1 in a circle around it."""
    pole = body.I * np.sqrt(1.0 / energy(body, body.I))
    tangent = np.linalg.svd((body.J * pole)[None])[2][1:]
    turns = np.linspace(0.0, 2.0 * np.pi, 10)[:-1, None]
    starts = pole + 0.05 * (np.cos(turns) * tangent[0] + np.sin(turns) * tangent[1])
    return pole, starts * np.sqrt(1.0 / energy(body, starts))[:, None]


def _draw_ellipsoid(axes: Any, body: SuslovND, pole: FloatArray, starts: FloatArray) -> None:
    radii = np.sqrt(2.0 / body.J)
    surface = 0.99 * radii[:, None, None] * sphere()
    axes.computed_zorder = False
    axes.set_proj_type("ortho")
    axes.view_init(elev=18, azim=40)
    eye = towards_eye(axes)
    look = {"color": "0.95", "edgecolor": "0.8", "linewidth": 0.3, "alpha": 0.5, "shade": False}
    axes.plot_surface(*surface, rcount=17, ccount=33, zorder=2, **look)
    orbits = iterate(body, starts, 0.2, 150).omega
    in_front = orbits * body.J @ eye >= 0
    for k, colour in enumerate(_colours(len(starts))):
        look = {"marker": ".", "color": colour, "markersize": 3.5, "linewidth": 0.6}
        plot_around(axes, orbits[:, k], in_front[:, k], 1.0, **look)
    for sign, text in ((1, "$+cI$"), (-1, "$-cI$")):
        order = 3 if sign * (body.J * pole) @ eye > 0 else 1
        axes.plot(*np.outer([sign, 1.3 * sign], pole).T, color=_LINE, linewidth=2.2, zorder=order)
        axes.text(*(1.45 * sign * pole), text, color=_LINE, fontsize=12, zorder=4)
    axes.set(xlabel=r"$\Omega_{14}$", ylabel=r"$\Omega_{24}$", zlabel=r"$\Omega_{34}$")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.get_major_locator().set_params(nbins=4)
        axis.labelpad = 2.0
        axis.set_tick_params(pad=0.0, labelsize=8)
    axes.zaxis.set_rotate_label(False)
    axes.set_box_aspect(radii, zoom=0.95)


def _draw_drift(axes: Any, body: SuslovND, start: FloatArray) -> None:
    time, eps, E = 25.6, 0.8 / 2.0 ** np.arange(8), energy(body, start)
    runs = [iterate(body, start, each, round(time / each)).omega for each in eps]
    energies = [energy(body, run) for run in runs]
    modified = [modified_energy(body, *run) for run in zip(runs, eps, strict=True)]
    lines = (
        ("energy", energies, "black", "o-", 2),
        ("modified energy", modified, _ACCENT, "s-", 4),
    )
    for name, values, colour, style, order in lines:
        drift = [np.ptp(each) / E for each in values]
        axes.loglog(eps, drift, style, color=colour, label=name)
        guide = 0.4 * drift[2] * (eps / eps[2]) ** order
        axes.loglog(eps, guide, "--", color=_LINE, linewidth=1.0)
        axes.annotate(rf"$\epsilon^{order}$", (eps[4], 0.3 * guide[4]), color=_LINE, fontsize=12)
    axes.set(xlabel=r"step size $\epsilon$", ylabel="largest relative drift")
    axes.legend(frameon=False, loc="lower right")
    axes.grid(alpha=0.3)
