"""What `suslov-fast pictures` draws."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from .._attitude import attitude
from .._bodies.nd import SuslovND
from .._bodies.paper import PICTURES, Picture
from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._conserved import criticality, energy, modified_energy
from .._coordinates import from_xy, to_xy
from .._map import iterate
from .._solution import exact, flow

_LINE = "crimson"
_LEVELS = 9
# Orbits start and end at this angle from the line, seen where levels of the energy are circles.
_NEAR = 0.03


def _orbits(picture: Picture) -> list[FloatArray]:
    """Orbits from one end of the line to the other on either side of it, innermost first."""
    body, eps, extent = picture.body, picture.eps, picture.extent
    # Energies from the middle to the corners, as lengths along the line.
    farthest = np.sqrt(energy(body, [extent, extent]) / energy(body, _line(body)))
    orbits: list[FloatArray] = []
    for level in farthest * np.arange(1, _LEVELS + 1) / (_LEVELS + 1):
        _, y_end = to_xy(body, level * _line(body))
        y = y_end * np.cos(_NEAR)
        x = y_end * np.sin(_NEAR) / np.sqrt(body.I1 * body.I2) * np.array([-1.0, 1.0])
        starts = from_xy(body, np.stack([x, [y, y]], axis=-1))
        t = criticality(body, starts[0], eps)
        steps = int(np.ceil(np.arctanh(np.cos(_NEAR)) / np.arctanh(t)))
        orbits.extend(iterate(body, starts, eps, steps).omega)
    return orbits


def _line(body: Suslov3D) -> FloatArray:
    """The direction of the repelling half of the line of steady states."""
    direction: FloatArray = np.array([body.I23, -body.I13]) / np.hypot(body.I13, body.I23)
    return direction


def _steps_shown(orbit: FloatArray, extent: float) -> FloatArray:
    """The steps (from, to) that lie within the picture, those in the middle of the orbit first."""
    inside = np.asarray((abs(orbit) < 0.97 * extent).all(axis=-1))
    steps = np.flatnonzero(inside[:-1] & inside[1:])
    steps = steps[np.argsort(abs(steps - len(orbit) // 2))]
    return np.stack([orbit[steps], orbit[steps + 1]], axis=1)


def picture_of_the_paper(number: int) -> Figure:
    """Orbits through the whole picture, and the line that they leave and reach."""
    picture = PICTURES[number]
    body, eps, extent = picture.body, picture.eps, picture.extent
    figure = Figure(figsize=(6.4, 6.8), layout="constrained")
    axes: Any = figure.add_subplot()
    colours = colormaps["viridis"](np.linspace(0.15, 0.85, _LEVELS))
    for k, orbit in enumerate(_orbits(picture)):
        colour = colours[k // 2]
        axes.plot(*orbit.T, "-", color=colour, linewidth=0.7, alpha=0.6)
        axes.plot(*orbit.T, ".", color=colour, markersize=4.5, markeredgewidth=0)
        for tail, head in _steps_shown(orbit, extent)[:1]:
            arrow = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 13}
            axes.annotate("", xy=head, xytext=tail, arrowprops=arrow)
    repelling, attracting = (np.outer([0, s * extent], _line(body)) for s in (2.0, -2.0))
    line = r"$I_{13}\,\Omega_1 + I_{23}\,\Omega_2 = 0$"
    style = {"color": "crimson", "linewidth": 2.6}
    axes.plot(*attracting.T, label=f"{line}, attracting", **style)
    axes.plot(*repelling.T, label=f"{line}, repelling", linestyle=(0, (4, 2)), **style)
    axes.set(
        xlim=(-extent, extent),
        ylim=(-extent, extent),
        aspect="equal",
        xlabel=r"$\Omega_1$",
        ylabel=r"$\Omega_2$",
    )
    axes.set_title(
        f"Picture {number}\n"
        rf"$\epsilon = {eps:g},\ I_1 = {body.I1:g},\ I_2 = {body.I2:g},\ "
        rf"I_{{13}} = {body.I13:g},\ I_{{23}} = {body.I23:g}$"
    )
    figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return figure


def regimes() -> Figure:
    """An orbit below, at and beyond t = 1, on the conic that its closed form runs through."""
    body, eps, _ = PICTURES[4]
    a = body.I1 * body.I2
    # States 0 in units of sqrt(2a)/eps and 2a/eps, and the conic x**2 (1 - t**2)/2 + y**2 = t**2.
    starts = {"t < 1": (0.06, 0.4), "t = 1": (0.75, 1.0), "t > 1": (0.33, 1.53)}
    units = np.array([np.sqrt(2.0 * a), 2.0 * a]) / eps
    figure = Figure(figsize=(12.0, 4.9), layout="constrained")
    for axes, (name, start) in zip(figure.subplots(1, 3), starts.items(), strict=True):
        omega0 = from_xy(body, start * units)
        t = float(criticality(body, omega0, eps))
        steps = 2 if t == 1.0 else 5 if t > 1.0 else 9
        for branch in _conic(t):
            axes.plot(*branch, color="steelblue", linewidth=1.2)
        iterated = to_xy(body, iterate(body, omega0, eps, steps).omega) / units
        closed = to_xy(body, exact(body, omega0, eps, np.arange(steps + 1))) / units
        axes.plot(*iterated.T, ":", color="grey", linewidth=0.8)
        axes.plot(*closed.T, "o", color="steelblue", fillstyle="none", markersize=9)
        axes.plot(*iterated.T, "o", color="black", markersize=3.5)
        if t < 1.0:
            between = exact(body, omega0, eps, np.linspace(0, steps, 400))
            axes.plot(*(to_xy(body, between) / units).T, color="steelblue", linewidth=2.6)
        size = 0.75 if t < 1.0 else 3.1
        for n, point in enumerate(iterated):
            if n == 0 or abs(point[0]) > 0.04 * size:
                axes.annotate(f"{n}", point, xytext=(7, 5), textcoords="offset points", fontsize=9)
        axes.axvline(0.0, color=_LINE, linewidth=2.0)
        axes.set(
            xlim=(-size, size),
            ylim=(-size, size),
            xlabel=r"$\epsilon x / \sqrt{2 I_1 I_2}$",
            ylabel=r"$\epsilon y / 2 I_1 I_2$",
            title=f"{name}" if t == 1.0 else f"{name}: t = {t:.2f}",
        )
    axes.plot([], [], "o", color="black", markersize=3.5, label="iterated")
    axes.plot([], [], "o", color="steelblue", fillstyle="none", markersize=9, label="closed form")
    axes.plot([], [], color="steelblue", label="level of the first integral")
    axes.plot([], [], color=_LINE, label=r"$I_{13}\,\Omega_1 + I_{23}\,\Omega_2 = 0$")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _conic(t: float) -> list[tuple[FloatArray, FloatArray]]:
    """The branches of the level on which an orbit lies."""
    if t == 1.0:
        x = np.array([-4.0, 4.0])
        return [(x, np.full(2, y)) for y in (-1.0, 1.0)]
    width = t * np.sqrt(2.0 / abs(1.0 - t * t))
    if t < 1.0:
        angle = np.linspace(0.0, 2.0 * np.pi, 300)
        return [(width * np.cos(angle), t * np.sin(angle))]
    s = np.linspace(-3.0, 3.0, 300)
    return [(width * np.sinh(s), sign * t * np.cosh(s)) for sign in (-1.0, 1.0)]


def convergence() -> Figure:
    """The errors of the map and of the attitude at a fixed time, as eps goes to 0."""
    body, omega0, time = PICTURES[1].body, [1.0, 0.5], 4.0
    steps = [2**k for k in range(3, 13)]
    eps = time / np.array(steps)
    of_map, of_attitude = [], []
    finest = _orientation(body, omega0, time, 2**15)
    for n in steps:
        error = exact(body, omega0, time / n, n) - flow(body, omega0, time)
        of_map.append(np.hypot(*error))
        of_attitude.append(np.linalg.norm(_orientation(body, omega0, time, n) - finest))
    figure = Figure(figsize=(6.4, 4.8), layout="constrained")
    axes: Any = figure.add_subplot()
    axes.loglog(eps, of_map, "o-", color="black", label=r"$\Omega$: the map against the exact flow")
    axes.loglog(eps, of_attitude, "s-", color="steelblue", label=r"$R$: the attitude")
    axes.loglog(
        eps, 0.3 * of_map[0] * (eps / eps[0]) ** 2, "--", color=_LINE, label=r"$\epsilon^2$"
    )
    axes.set(
        xlabel=r"$\epsilon$",
        ylabel=f"error at time {time:g}",
        title="Order 2: halve the step, quarter the error",
    )
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


def _orientation(body: Suslov3D, omega0: list[float], time: float, steps: int) -> FloatArray:
    states = iterate(body, omega0, time / steps, steps).omega
    final: FloatArray = attitude(body, states, time / steps)[-1]
    return final


def four_dimensions() -> Figure:
    """Motion for n = 4, and how well the map keeps the energy and the modified energy."""
    body = SuslovND(J=[1.0, 1.6, 2.2], I=[0.5, -0.3, 0.4])
    figure = Figure(figsize=(11.5, 5.2), layout="constrained")
    space: Any = figure.add_subplot(1, 2, 1, projection="3d")
    E = 1.0
    pole = body.I * np.sqrt(E / energy(body, body.I))
    u, v = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 49), np.linspace(0.0, np.pi, 25))
    sphere = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
    radii = np.sqrt(2.0 * E / body.J)
    space.plot_wireframe(*(radii[:, None, None] * sphere), color="grey", linewidth=0.3, alpha=0.5)
    around = np.linalg.svd((body.J * pole)[None])[2][1:]  # tangent to the ellipsoid at the pole
    turns = np.linspace(0.0, 2.0 * np.pi, 10)[:-1, None]
    starts = pole + 0.05 * (np.cos(turns) * around[0] + np.sin(turns) * around[1])
    starts = starts * np.sqrt(E / energy(body, starts))[:, None]
    colours = colormaps["viridis"](np.linspace(0.15, 0.85, len(starts)))
    for colour, orbit in zip(colours, iterate(body, starts, 0.2, 150).omega, strict=True):
        space.plot(*orbit.T, ".-", color=colour, markersize=3.5, linewidth=0.6)
    space.plot(*np.outer([-1.3, 1.3], pole).T, color=_LINE, linewidth=2.2)
    for sign, text in ((1.38, "$+cI$"), (-1.38, "$-cI$")):
        space.text(*(sign * pole), text, color=_LINE, fontsize=12)
    space.set(xlabel=r"$\Omega_{14}$", ylabel=r"$\Omega_{24}$", zlabel=r"$\Omega_{34}$")
    space.set_title("n = 4: from $+cI$ to $-cI$ on the energy ellipsoid")
    space.set_box_aspect(radii)
    space.view_init(elev=18, azim=40)

    axes: Any = figure.add_subplot(1, 2, 2)
    time, eps = 25.6, 0.8 / 2.0 ** np.arange(8)
    drifts: dict[str, list[float]] = {"energy": [], "modified energy": []}
    for step_size in eps:
        states = iterate(body, starts[0], step_size, round(time / step_size)).omega
        drifts["energy"].append(np.ptp(energy(body, states)) / E)
        drifts["modified energy"].append(np.ptp(modified_energy(body, states, step_size)) / E)
    for (name, drift), order, style in zip(drifts.items(), (2, 4), ("ko-", "s-"), strict=True):
        axes.loglog(eps, drift, style, label=name)
        guide = 0.4 * drift[2] * (eps / eps[2]) ** order
        axes.loglog(eps, guide, "--", color=_LINE, linewidth=1.0)
        axes.annotate(rf"$\epsilon^{order}$", (eps[4], 0.4 * guide[4]), color=_LINE, fontsize=12)
    axes.set(xlabel=r"$\epsilon$", ylabel="largest relative drift", title="What the map keeps")
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


DRAWINGS: dict[str, Callable[[], Figure]] = {
    **{f"picture{number}": partial(picture_of_the_paper, number) for number in PICTURES},
    "regimes": regimes,
    "convergence": convergence,
    "four_dimensions": four_dimensions,
}
