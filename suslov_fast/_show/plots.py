"""Pictures: functions that draw on Matplotlib axes and return them (extra `plots`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.matter import ellipsoid_of_inertia
from .._bodies.nd import SuslovND
from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._checks import FloatArray, instance
from .._runs.iterate import iterate
from .._runs.solution import exact, flow
from .._space.attitude import attitude
from .._space.scattering import scattering_angle
from .._states.conserved import criticality, energy, modified_energy
from .._states.continuous import vector_field
from .._states.coordinates import from_xy, to_xy
from .figures import axes_or_new, new_figure
from .plane import conic, level_curves, repelling_direction

# Legible without colour too: lines differ in style, not in colour alone.
_LINE, _ACCENT = "crimson", "steelblue"
_STEADY = r"$I_{13}\,\Omega_1 + I_{23}\,\Omega_2 = 0$"
# Orbits start and end at this angle from the line, seen where levels of the energy are circles.
_NEAR = 0.03


def plot_phase(
    body: Suslov3D,
    eps: float,
    extent: float,
    *,
    levels: int = 9,
    letter: str | None = None,
    legend: bool = True,
    axes: Any = None,
) -> Any:
    """Orbits of the map in the plane (Omega1, Omega2), on the curves on which F is constant.

    Parameters
    ----------
    body : Suslov3D
        A single body, whose products of inertia are not both 0.
    eps : float
        Step size; t < 1 must hold in the whole picture.
    extent : float
        How far from 0 the axes reach, in the unit of omega.
    levels : int
        The number of curves.
    letter : str, optional
        The letter of a panel, written into its corner.
    legend : bool
        Whether to draw the legend, below the axes.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    ImportError
        If Matplotlib is not installed: ``pip install 'suslov_fast[plots]'``.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, plot_phase
    >>> axes = plot_phase(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), eps=0.2, extent=4.0)
    >>> [float(end) for end in axes.get_xlim()]
    [-4.0, 4.0]
    """
    direction = repelling_direction(body)
    farthest = np.sqrt(energy(body, [extent, extent]) / energy(body, direction))
    if not criticality(body, farthest * direction, eps) < 1:
        raise ValueError(
            "extent: expected one in which orbits follow the continuous motion, got t = "
            f"{float(criticality(body, farthest * direction, eps)):.3g} in the corners"
        )
    axes = axes_or_new(axes, (5.2, 5.6))
    colours = _colours(levels)
    for level, colour in zip(np.arange(1, levels + 1) / (levels + 1), colours, strict=True):
        starts, t, steps = _orbit_through(body, eps, level * farthest * direction)
        orbits = iterate(body, starts, eps, steps).omega
        axes.plot(*level_curves(body, eps, t)[0].T, "-", color=colour, linewidth=0.8, alpha=0.7)
        for k in range(2):
            orbit = orbits[:, k]
            axes.plot(*orbit.T, ".", color=colour, markersize=4.5, markeredgewidth=0)
            _arrow(axes, body, orbit, extent, colour)
    for sign, style, what in ((-1, "-", "attracting"), (1, (0, (4, 2)), "repelling")):
        ends = np.outer([0, sign * 2.0 * extent], direction)
        label = f"{_STEADY}, {what}"
        axes.plot(*ends.T, color=_LINE, linewidth=2.4, linestyle=style, label=label)
    axes.plot([], [], "-", color=colours[levels // 2], linewidth=0.8, label="$F$ constant")
    axes.plot([], [], ".", color=colours[levels // 2], markersize=6, label="states of the map")
    axes.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal")
    axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$")
    axes.locator_params(nbins=8, steps=[1, 2, 5, 10])
    _finish(axes, letter)
    if legend:
        _legend_below(axes, 2)
    return axes


def plot_regimes(
    body: Suslov3D | None = None,
    eps: float = 1.0,
    *,
    letters: Sequence[str] | None = None,
    axes: Sequence[Any] | None = None,
) -> Any:
    """An orbit below, at and beyond t = 1, iterated and by the closed form.

    Parameters
    ----------
    body : Suslov3D, optional
        A single body; by default that of the paper's fourth picture.
    eps : float
        Step size.
    letters : sequence of str, optional
        The letters of the three panels.
    axes : sequence of matplotlib.axes.Axes, optional
        Three of them; by default those of a new figure.

    Returns
    -------
    sequence of matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    ImportError
        If Matplotlib is not installed: ``pip install 'suslov_fast[plots]'``.

    Examples
    --------
    >>> from suslov_fast import plot_regimes
    >>> len(plot_regimes(letters="abc"))
    3
    """
    body = PICTURES[4].body if body is None else body
    instance("body", body, Suslov3D)
    axes = new_figure((11.0, 4.4)).subplots(1, 3) if axes is None else axes
    # States 0 in units of sqrt(2a)/eps and 2a/eps.
    starts = {"$t < 1$": (0.06, 0.4), "$t = 1$": (0.75, 1.0), "$t > 1$": (0.33, 1.53)}
    units = np.array([np.sqrt(2.0 * body.I1 * body.I2), 2.0 * body.I1 * body.I2]) / eps
    for k, (panel, (name, start)) in enumerate(zip(axes, starts.items(), strict=True)):
        _draw_regime(panel, body, eps, np.multiply(start, units), units, name)
        _finish(panel, None if letters is None else letters[k])
    _legend_below(axes[1], 4)
    return axes


def plot_convergence(
    body: Suslov3D | None = None,
    omega0: ArrayLike = (1.0, 0.5),
    time: float = 4.0,
    *,
    letter: str | None = None,
    axes: Any = None,
) -> Any:
    """The errors of the map and of the orientation at a fixed time, as eps goes to 0.

    Parameters
    ----------
    body : Suslov3D, optional
        A single body; by default that of the paper's first picture.
    omega0 : array_like(float, shape=(2,))
        Initial angular velocity.
    time : float
        The time at which they are taken, in the inverse unit of omega0.
    letter : str, optional
        The letter of a panel, written into its corner.
    axes : matplotlib.axes.Axes, optional
        Where to draw; by default axes of a new figure.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    ImportError
        If Matplotlib is not installed: ``pip install 'suslov_fast[plots]'``.

    Examples
    --------
    >>> from suslov_fast import plot_convergence
    >>> plot_convergence().get_xscale()
    'log'
    """
    body = PICTURES[1].body if body is None else body
    instance("body", body, Suslov3D)
    axes = axes_or_new(axes, (5.2, 3.9))
    steps = [2**k for k in range(3, 13)]
    eps = time / np.array(steps)
    finest = _orientation(body, omega0, time, 2**15)
    of_map, of_attitude = [], []
    for n in steps:
        error = exact(body, omega0, time / n, n) - flow(body, omega0, time)
        of_map.append(np.hypot(*error))
        of_attitude.append(np.linalg.norm(_orientation(body, omega0, time, n) - finest))
    axes.loglog(eps, of_map, "o-", color="black", label=r"$\Omega$, against the exact flow")
    axes.loglog(
        eps, of_attitude, "s-", color=_ACCENT, label=r"$R$, against $\epsilon = 2^{-15}\,t$"
    )
    guide = 0.3 * of_map[0] * (eps / eps[0]) ** 2
    axes.loglog(eps, guide, "--", color=_LINE, label=r"$\propto \epsilon^2$")
    axes.set(xlabel=r"step size $\epsilon$", ylabel=f"error at time $t = {time:g}$")
    axes.legend(frameon=False)
    _finish(axes, letter, grid=True)
    return axes


def plot_four_dimensions(
    body: SuslovND | None = None,
    *,
    letters: Sequence[str] | None = None,
    axes: Sequence[Any] | None = None,
) -> Any:
    """Motion for n = 4 on the ellipsoid of energy, and how well the map keeps two energies.

    Parameters
    ----------
    body : SuslovND, optional
        A single body with n = 4.
    letters : sequence of str, optional
        The letters of the two panels.
    axes : sequence of matplotlib.axes.Axes, optional
        Two of them, the first one in three dimensions; by default those of a new figure.

    Returns
    -------
    sequence of matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    ImportError
        If Matplotlib is not installed: ``pip install 'suslov_fast[plots]'``.

    Examples
    --------
    >>> from suslov_fast import plot_four_dimensions
    >>> len(plot_four_dimensions())
    2
    """
    body = SuslovND(np.array([1.0, 1.6, 2.2]), np.array([0.5, -0.3, 0.4])) if body is None else body
    instance("body", body, SuslovND)
    if body.dimension != 3 or body.shape:
        raise ValueError(f"body: expected a single one with n = 4, got {body}")
    if axes is None:
        figure = new_figure((10.4, 4.6))
        axes = [figure.add_subplot(1, 2, 1, projection="3d"), figure.add_subplot(1, 2, 2)]
    space, drift = axes
    starts = _around_the_pole(body)
    _draw_ellipsoid(space, body, starts)
    _draw_drift(drift, body, starts[0])
    for k, panel in enumerate(axes):
        _finish(panel, None if letters is None else letters[k], grid=k == 1)
    return axes


def plot_scattering(
    ratios: Sequence[float] = (1.0, 4.0),
    *,
    extent: float = 3.0,
    letters: Sequence[str] | None = None,
    axes: Sequence[Any] | None = None,
) -> Any:
    """The scattering angle over the products of inertia, for some ratios of I1 and I2.

    Parameters
    ----------
    ratios : sequence of float
        Of I1 and I2, one for each panel.
    extent : float
        How far the products reach, in units of sqrt(I1 I2).
    letters : sequence of str, optional
        The letters of the panels.
    axes : sequence of matplotlib.axes.Axes, optional
        One for each ratio; by default those of a new figure.

    Returns
    -------
    sequence of matplotlib.axes.Axes

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    ImportError
        If Matplotlib is not installed: ``pip install 'suslov_fast[plots]'``.

    Examples
    --------
    >>> from suslov_fast import plot_scattering
    >>> len(plot_scattering((1.0, 2.0, 4.0)))
    3
    """
    if axes is None:
        width = 0.9 + 3.7 * len(ratios)
        axes = new_figure((width, 4.0)).subplots(1, len(ratios), squeeze=False, sharey=True)[0]
    products = np.linspace(-extent, extent, 401)
    for k, (panel, ratio) in enumerate(zip(axes, ratios, strict=True)):
        body = Suslov3D(np.sqrt(ratio), 1 / np.sqrt(ratio), products, products[:, np.newaxis])
        degrees = np.rad2deg(scattering_angle(body))
        shades = panel.contourf(products, products, degrees, np.arange(0, 181, 10), cmap="viridis")
        for collection in np.atleast_1d(np.asarray(shades, dtype=object)):
            collection.set_edgecolor("face")  # no seams between shades in vector formats
        lines = panel.contour(
            products, products, degrees, (30, 60, 90, 120), colors="white", linewidths=0.7
        )
        panel.clabel(lines, fmt=r"%d°", fontsize=8)
        panel.set(aspect="equal", xlabel=r"$I_{13} / \sqrt{I_1 I_2}$")
        panel.text(
            0.97,
            0.03,
            rf"$I_1 / I_2 = {ratio:g}$",
            transform=panel.transAxes,
            ha="right",
            va="bottom",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.5},
        )
        _finish(panel, None if letters is None else letters[k])
    axes[0].set_ylabel(r"$I_{23} / \sqrt{I_1 I_2}$")
    bar = axes[0].figure.colorbar(shades, ax=list(axes), shrink=0.85, ticks=range(0, 181, 30))
    bar.set_label("scattering angle (degrees)")
    return axes


def animate_body(
    body: Suslov3D | None = None,
    omega0: ArrayLike | None = None,
    eps: float = 0.05,
    steps: int = 440,
    *,
    I3: float | None = None,
    every: int = 2,
    fps: int = 25,
) -> Any:
    """The body in space: its ellipsoid of inertia, its axes, the path of the forbidden axis.

    Parameters
    ----------
    body : Suslov3D, optional
        A single body; by default that of the paper's second picture.
    omega0 : array_like(float, shape=(2,)), optional
        Initial angular velocity; by default one that passes from one steady rotation to the other.
    eps : float
        Step size.
    steps : int
        Number of steps.
    I3 : float, optional
        The third moment of inertia, which decides the shape alone; by default the larger one of I1
        and I2.
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
        If an argument is not what is said above; in particular if with this I3 the inertia tensor
        is not positive definite.
    ImportError
        If Matplotlib is not installed: ``pip install 'suslov_fast[plots]'``.

    Examples
    --------
    >>> from suslov_fast import animate_body
    >>> animation = animate_body()  # doctest: +SKIP
    >>> animation.save("body.gif", writer="pillow")  # doctest: +SKIP
    """
    from matplotlib.animation import FuncAnimation

    body = PICTURES[2].body if body is None else body
    direction = repelling_direction(body)
    if omega0 is None:
        _, y = to_xy(body, 2.0 * direction)
        omega0 = from_xy(body, [0.15 * y / np.sqrt(body.I1 * body.I2), y])
    omega = iterate(body, omega0, eps, steps).omega
    third = float(max(body.I1, body.I2)) if I3 is None else I3
    scene = _Scene(body, third, attitude(body, omega, eps))
    return FuncAnimation(
        scene.figure, scene.draw, frames=range(0, steps + 1, every), interval=1000.0 / fps
    )


class _Scene:
    """The figure of an animation, drawn anew for each frame."""

    def __init__(self, body: Suslov3D, I3: float, turns: FloatArray) -> None:
        radii, principal = ellipsoid_of_inertia(body.parameters, I3)
        self.turns = turns
        self.path = 1.15 * turns[:, :, 2]
        u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 41), np.linspace(0, np.pi, 21))
        sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
        self.surface = np.einsum("ij,j,jkl->ikl", principal, 0.9 * radii, sphere)
        self.figure = new_figure((4.8, 4.8))
        self.axes = self.figure.add_subplot(projection="3d")

    def draw(self, number: int) -> list[Any]:
        """Draw the body at a state."""
        axes, R = self.axes, self.turns[number]
        axes.clear()
        axes.plot_surface(
            *np.einsum("ij,jkl->ikl", R, self.surface),
            color=_ACCENT,
            alpha=0.45,
            linewidth=0,
            rstride=1,
            cstride=1,
        )
        for k, (colour, name) in enumerate(
            (("dimgrey", "$e_1$"), ("dimgrey", "$e_2$"), (_LINE, "$a$"))
        ):
            tip = 1.15 * R[:, k]
            axes.plot(*np.outer([0, 1], tip).T, color=colour, linewidth=2.0)
            axes.text(*(1.1 * tip), name, color=colour, ha="center", va="center")
        axes.plot(*self.path[: number + 1].T, color=_LINE, linewidth=1.0)
        axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1))
        axes.set_box_aspect((1, 1, 1), zoom=1.2)
        axes.set_axis_off()
        return []


def _colours(count: int) -> Any:
    from matplotlib import colormaps

    return colormaps["viridis"](np.linspace(0.1, 0.8, count))


def _finish(axes: Any, letter: str | None, grid: bool = False) -> None:
    """The letter of a panel, and a grid where numbers are to be read off."""
    if grid:
        axes.grid(alpha=0.3)
    if letter is not None:
        write = axes.text2D if hasattr(axes, "text2D") else axes.text
        write(
            0.02,
            0.98,
            f"({letter})",
            transform=axes.transAxes,
            ha="left",
            va="top",
            weight="bold",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.0},
        )


def _legend_below(axes: Any, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    axes.figure.legend(
        handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )


def _orbit_through(body: Suslov3D, eps: float, end: FloatArray) -> tuple[FloatArray, float, int]:
    """Two states next to a repelling one, their t, and the steps to the attracting one."""
    _, y_end = to_xy(body, end)
    y = y_end * np.cos(_NEAR)
    x = y_end * np.sin(_NEAR) / np.sqrt(body.I1 * body.I2) * np.array([-1.0, 1.0])
    starts = from_xy(body, np.stack([x, [y, y]], axis=-1))
    t = float(criticality(body, starts[0], eps))
    return starts, t, int(np.ceil(np.arctanh(np.cos(_NEAR)) / np.arctanh(t)))


def _arrow(axes: Any, body: Suslov3D, orbit: FloatArray, extent: float, colour: Any) -> None:
    """The direction of motion at the state in the middle of the orbit, or next to it in view."""
    inside = np.flatnonzero((abs(orbit) < 0.95 * extent).all(axis=-1))
    if inside.size:
        state = orbit[inside[np.argmin(abs(inside - len(orbit) // 2))]]
        along = vector_field(body, state)
        along = 0.01 * extent * along / np.hypot(*along)
        style = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 12, "linewidth": 0.8}
        axes.annotate("", xy=state + along, xytext=state - along, arrowprops=style)


def _draw_regime(
    axes: Any, body: Suslov3D, eps: float, start: FloatArray, units: FloatArray, name: str
) -> None:
    omega0 = from_xy(body, start)
    t = float(criticality(body, omega0, eps))
    steps = 2 if t == 1.0 else 5 if t > 1.0 else 9
    size = 0.75 if t < 1.0 else 3.1
    for k, branch in enumerate(conic(t)):
        label = None if k else "level of the first integral"
        axes.plot(*branch, color=_ACCENT, linewidth=1.2, label=label)
    iterated = to_xy(body, iterate(body, omega0, eps, steps).omega) / units
    closed = to_xy(body, exact(body, omega0, eps, np.arange(steps + 1))) / units
    axes.plot(*iterated.T, ":", color="grey", linewidth=0.8)
    style = {"color": _ACCENT, "fillstyle": "none", "markersize": 9}
    axes.plot(*iterated.T, "o", color="black", markersize=3.5, label="iterated")
    axes.plot(*closed.T, "o", label="closed form", **style)
    axes.axvline(0.0, color=_LINE, linewidth=2.0, label=_STEADY, zorder=0)
    for n, point in enumerate(iterated):
        if n == 0 or abs(point[0]) > 0.06 * size:
            shift = (7, 5) if point[1] > 0 else (7, -12)
            axes.annotate(f"{n}", point, xytext=shift, textcoords="offset points", fontsize=9)
    axes.text(
        0.97,
        0.97,
        name if t == 1.0 else rf"{name[:-1]},\ t = {t:.2f}$",
        transform=axes.transAxes,
        ha="right",
        va="top",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.0},
    )
    # Room for the letter and the name above the curves.
    axes.set(xlim=(-size, size), ylim=(-1.25 * size, 1.25 * size))
    axes.set(xlabel=r"$X = \epsilon x / \sqrt{2 I_1 I_2}$", ylabel=r"$Y = \epsilon y / 2 I_1 I_2$")


def _orientation(body: Suslov3D, omega0: ArrayLike, time: float, steps: int) -> FloatArray:
    states = iterate(body, omega0, time / steps, steps).omega
    final: FloatArray = attitude(body, states, time / steps)[-1]
    return final


def _around_the_pole(body: SuslovND, count: int = 9, E: float = 1.0) -> FloatArray:
    """States of energy E next to the repelling one, all around it."""
    pole = body.I * np.sqrt(E / energy(body, body.I))
    tangent = np.linalg.svd((body.J * pole)[None])[2][1:]
    turns = np.linspace(0.0, 2.0 * np.pi, count + 1)[:-1, None]
    starts = pole + 0.05 * (np.cos(turns) * tangent[0] + np.sin(turns) * tangent[1])
    scaled: FloatArray = starts * np.sqrt(E / energy(body, starts))[:, None]
    return scaled


def _draw_ellipsoid(axes: Any, body: SuslovND, starts: FloatArray) -> None:
    E = float(energy(body, starts[0]))
    radii = np.sqrt(2.0 * E / body.J)
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 49), np.linspace(0.0, np.pi, 25))
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    axes.plot_wireframe(*(radii[:, None, None] * sphere), color="grey", linewidth=0.3, alpha=0.5)
    orbits = iterate(body, starts, 0.2, 150).omega
    for k, colour in enumerate(_colours(len(starts))):
        axes.plot(*orbits[:, k].T, ".-", color=colour, markersize=3.5, linewidth=0.6)
    pole = body.I * np.sqrt(E / energy(body, body.I))
    axes.plot(*np.outer([-1.3, 1.3], pole).T, color=_LINE, linewidth=2.2)
    for sign, text in ((1.45, "$+cI$"), (-1.45, "$-cI$")):
        axes.text(*(sign * pole), text, color=_LINE, fontsize=12)
    axes.set(xlabel=r"$\Omega_{14}$", ylabel=r"$\Omega_{24}$", zlabel=r"$\Omega_{34}$")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.get_major_locator().set_params(nbins=4)
        axis.labelpad = 2.0
        axis.set_tick_params(pad=0.0, labelsize=8)
    axes.zaxis.set_rotate_label(False)
    axes.set_box_aspect(radii, zoom=0.95)
    axes.view_init(elev=18, azim=40)


def _draw_drift(axes: Any, body: SuslovND, start: FloatArray) -> None:
    time, eps = 25.6, 0.8 / 2.0 ** np.arange(8)
    E = float(energy(body, start))
    drifts: dict[str, list[float]] = {"energy": [], "modified energy": []}
    for step_size in eps:
        states = iterate(body, start, step_size, round(time / step_size)).omega
        drifts["energy"].append(np.ptp(energy(body, states)) / E)
        drifts["modified energy"].append(np.ptp(modified_energy(body, states, step_size)) / E)
    marks = (("black", "o-", 2), (_ACCENT, "s-", 4))
    for (name, drift), (colour, style, order) in zip(drifts.items(), marks, strict=True):
        axes.loglog(eps, drift, style, color=colour, label=name)
        guide = 0.4 * drift[2] * (eps / eps[2]) ** order
        axes.loglog(eps, guide, "--", color=_LINE, linewidth=1.0)
        axes.annotate(rf"$\epsilon^{order}$", (eps[4], 0.3 * guide[4]), color=_LINE, fontsize=12)
    axes.set(xlabel=r"step size $\epsilon$", ylabel="largest relative drift")
    axes.legend(frameon=False)
