"""`plot_phase`, and the phase plane of a body in three dimensions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, integer, kind_of, left_out, positive, wrong
from ..fields.field import Field
from ..keywords import public
from ..orbits.iterate import iterate
from .portrait import draw_portrait

# Orbits are drawn where abs(l), see `Plane`, exceeds this part of its value in the middle of the
# orbit, because l is 0 at steady states.
_AT_THE_LINE = 0.07
_MOST = 500  # the most steps before and after the middle of an orbit


class Plane:
    """The phase plane of a single body for a positive step size, in a complex coordinate z.

    Let z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, g = I13 / sqrt(I1) + i I23 / sqrt(I2), l = k +
    Re(conj(g) z) with the momentum k of the rotor, and e = eps / (2 sqrt(I1 I2)). The levels of the
    first integral F are the curves abs(z) / sqrt(1 + e**2 l**2) = R. The phase of a state on its
    level is psi = arg(z / (1 - i e l)) - arg(g).
    """

    def __init__(self, body: Suslov3D, eps: float) -> None:
        self.body, self.eps = body, eps
        I1, I2, I13, I23, self.k = body._constants
        self.roots, self.products = np.sqrt([I1, I2]), np.array([I13, I23])
        self.g = complex(*self.products / self.roots)
        self.e = 0.5 * eps / float(self.roots.prod())

    def radius(self, omega: Any) -> float:
        """Return the modulus of z."""
        return float(np.hypot(*self.roots * omega))

    def on_level(self, R: float, psi: float | FloatArray) -> FloatArray:
        """Return the states (..., 2) on the level R at phases psi (...)."""
        g, e, A = self.g, self.e, R * abs(self.g)
        turned = (1 - 1j * e * self.k) * np.exp(1j * psi) - 1j * e * A
        z = R * (g / abs(g) if g else 1.0) * turned / (1 - e * A * np.sin(psi))
        return np.stack([z.real, z.imag], axis=-1) / self.roots

    def level(self, R: float) -> FloatArray:
        """Return 300 states (300, 2) on the level R, an ellipse."""
        t = abs(self.e * R * self.g)
        half = np.arctan(
            np.sqrt((1.0 - t) / (1.0 + t)) * np.tan(np.pi * np.linspace(-0.5, 0.5, 300))
        )
        return self.on_level(R, 0.5 * np.pi + 2.0 * half)

    def orbits(self, R: float) -> list[FloatArray]:
        """Return orbits, arrays of states (N, 2), on the level R.

        If no state of the level is steady, return one orbit that turns once. Otherwise return two
        orbits, on both sides of the line of steady states, which begin and end near this line.
        """
        body, eps, k, A = self.body, self.eps, self.k, R * abs(self.g)
        middle = self.on_level(R, np.array([0.0, np.pi]))
        if abs(k) > A:
            steps = np.pi / np.arctan(self.e * np.sqrt(k * k - A * A))
            return [iterate(body, middle[0], eps, int(min(steps + 1.0, 2 * _MOST))).states]
        before, after = (
            iterate(body, middle, step, _MOST, on_singular="ignore").states for step in (-eps, eps)
        )
        orbits = np.moveaxis(np.concatenate([before[:0:-1], after]), 1, 0)
        l = abs(orbits @ self.products + k)
        shown = l > _AT_THE_LINE * l[:, _MOST, np.newaxis]
        return [orbit[where] for orbit, where in zip(orbits, shown, strict=True)]

    def steady_line(self) -> tuple[FloatArray, FloatArray]:
        """Return the steady state of least energy, and the direction of the repelling half-line."""
        least = -self.k / abs(self.g) ** 2 * self.products / self.roots**2
        direction = self.products[::-1] * [1.0, -1.0]
        return least + 0.0, direction / np.hypot(*direction)


@public
def plot_phase(
    system: Suslov3D | Field,
    /,
    eps: float | None = None,
    extent: ArrayLike = 2.0,
    *,
    levels: int | None = None,
    nullclines: bool | None = None,
    ax: Any = None,
) -> Any:
    """Draw the phase plane of a body, or of any field of two variables.

    For a body: orbits of the map, and levels of its first integral F. Section 4 of Dragovic and
    Gajic, arXiv:0807.2966, has four such figures. For a field: arrows of the vector field, the
    nullclines, where one component of f is 0, and the equilibria.

    Parameters
    ----------
    system : Suslov3D or Field
        A single body, with I13 or I23 other than 0, or a rotor; or a single field with two
        components.
    eps : float, optional
        Of a body: positive step size for which :meth:`Suslov3D.criticality` is below 1 in the whole
        figure. By default the criticality is about 0.2 in the corners.
    extent : float or array_like(float, shape=(4,))
        The figure shows both variables from -extent to extent. For a field also (left, right, low,
        high), the least and the largest value of each variable.
    levels : int
        Of a body: number of levels, at least 1, by default 9.
    nullclines : bool
        Of a field: False leaves out the nullclines.
    ax : matplotlib.axes.Axes, optional
        Axes to draw on; by default axes of a new figure, with a legend below them. For panels of a
        figure, ``figure.legend(*ax.get_legend_handles_labels())`` is one legend for all.

    Returns
    -------
    matplotlib.axes.Axes
        Of a body, each level of F has a colour: a thin curve is the level, dots are orbits of the
        map, and an arrow shows the direction of motion. Attracting steady states are a solid line,
        and repelling steady states a dashed line. Of a field, filled dots are stable equilibria,
        and open dots are others. ``flow(field, x0, time=t).plot(ax=axes)`` adds orbits.

    Raises
    ------
    ValueError
        If every state of a body is steady, or the criticality is 1 or more at a state in the
        figure. If a field has not two components, or reads the time.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, plot_phase
    >>> ax = plot_phase(Suslov3D(I1=4, I2=2, I13=-0.5, I23=-0.3), eps=0.2, extent=4.0)
    >>> ax.figure.savefig("phase.png")  # doctest: +SKIP
    >>> from suslov_fast import Field
    >>> neuron = Field(
    ...     lambda x, I: (x[0] - x[0] ** 3 / 3 - x[1] + I, 0.08 * (x[0] + 0.7 - 0.8 * x[1])),
    ...     "v w", I=0.5,
    ... )
    >>> ax = plot_phase(neuron, extent=(-2.5, 2.5, -1, 2))
    """
    if isinstance(system, Field):
        left_out("a field", eps=eps is not None, levels=levels is not None)
        return draw_portrait(system, extent, nullclines is not False, ax)
    if not isinstance(system, Suslov3D):
        how = "iterate(...).plot() or flow(...).plot() draws orbits"
        raise wrong("system", "a Suslov3D or a Field", f"{kind_of(system)}: {how}", TypeError)
    left_out("a body", nullclines=nullclines is not None)
    return _draw_body(system, eps, positive("extent", extent), 9 if levels is None else levels, ax)


def _draw_body(body: Suslov3D, eps: float | None, extent: float, levels: int, ax: Any) -> Any:
    """Draw the phase plane of a body, and return the axes."""
    from ..results.figures import COLOURS, axes_for

    I1, I2, I13, I23, k = body._constants
    if body.shape or not (I13 or I23 or k):
        raise wrong("system", "a single one, with I13 or I23 other than 0", body)
    if eps is None:
        unit = Plane(body, 1.0)
        eps = float(f"{0.2 / (unit.e * unit.radius([extent, extent]) * abs(unit.g)):.0e}")
    eps = positive("eps", eps)
    plane, levels = Plane(body, eps), integer("levels", levels, 1)
    largest = plane.radius([extent, extent])
    t = plane.e * largest * abs(plane.g)
    if not t < 1:
        text = f"the criticality is {t:.3g} in the corners of the figure, and must be below 1"
        raise ValueError(f"extent: {text}: use a smaller extent or eps")
    axes = axes_for(ax, (5.2, 5.8))
    colours = COLOURS(np.linspace(0.05, 0.9, levels))
    for R, colour in zip(largest * np.arange(1, levels + 1) / (levels + 1), colours, strict=True):
        axes.plot(*plane.level(R).T, "-", color=colour, linewidth=0.8, alpha=0.7)
        for orbit in plane.orbits(R):
            axes.plot(*orbit.T, ".", color=colour, markersize=4.5, markeredgewidth=0)
            _arrow(axes, body, orbit, extent, colour)
    if plane.g:
        _steady_states(axes, k, *plane.steady_line(), 4.0 * extent)
    style = {"color": colours[levels // 2], "linewidth": 0.8}
    axes.plot([], [], "-", label="levels of $F$, one colour each", **style)
    axes.plot([], [], ".", label="states of the map", **style)
    axes.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal")
    axes.set(xlabel=r"$\Omega_1$", ylabel=r"$\Omega_2$")
    axes.locator_params(nbins=8, steps=[1, 2, 5, 10])
    moments = rf"$I_1={I1:g}$, $I_2={I2:g}$, $\epsilon={eps:g}$"
    products = rf"$I_{{13}}={I13:g}$, $I_{{23}}={I23:g}$" + (f", $k={k:g}$" if k else "")
    axes.set_title(moments + (", " if ax is None else "\n") + products, fontsize="small")
    if ax is None:
        # 4.2 font sizes below the axes, and so below the label of the axis.
        place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.2}
        axes.legend(**place, ncols=2, frameon=False, fontsize="small")
    return axes


def _steady_states(axes: Any, k: float, least: Any, direction: Any, reach: float) -> None:
    """Draw the attracting and the repelling half of the line l = 0, which meet at `least`."""
    line = rf"$I_{{13}}\,\Omega_1 + I_{{23}}\,\Omega_2{' + k' if k else ''} = 0$"
    for sign, style, name in ((-1, "-", "attracting"), (1, (0, (4, 2)), "repelling")):
        ends = least + np.outer([0.0, sign * (reach + np.hypot(*least))], direction)
        pen = {"color": "crimson", "linewidth": 2.4, "linestyle": style}
        axes.plot(*ends.T, label=f"{line}, {name}", **pen)


def _arrow(axes: Any, body: Any, orbit: FloatArray, extent: float, colour: Any) -> None:
    """Draw the direction of motion at the middle of the orbit, or at the nearest state in view."""
    inside = np.flatnonzero((abs(orbit) < 0.95 * extent).all(axis=-1))
    if inside.size:
        state = orbit[inside[np.argmin(abs(inside - len(orbit) // 2))]]
        velocity = body(state)
        half = 0.01 * extent * velocity / np.hypot(*velocity)
        style = {"arrowstyle": "-|>", "color": colour, "mutation_scale": 12, "linewidth": 0.8}
        axes.annotate("", xy=state + half, xytext=state - half, arrowprops=style)
