"""Periodic orbits by Newton's method on the map of a whole period.

N steps of the length eps = period / N take x to Phi^N(x). The unknowns are x and eps, the equations

Phi^N(x) - x = 0,   f(start) . (x - start) = 0,

of which the second one fixes a point of the orbit. The derivative with respect to x is the product
of the Jacobians of the steps; its eigenvalues at the solution are the multipliers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.fields.field import QuadraticField
from ..checks import FloatArray, integer, real_number, short, warn, wrong
from ..keywords import public
from ..maps import Method, map_of, problem
from ..quantities.derivatives import jacobian, vector_field
from .iterate import iterate

_ROUNDS, _HALVINGS = 50, 8
_PART = 1e-6  # of eps, for the difference quotient with respect to it
# Singular values below this part of the largest one, or below the residual, are directions along a
# family of orbits, of which a system with an integral has one for each of its values.
_LEAST = 1e-8
_CORRECTIONS, _LEAST_CHANGE = 5, 1e-6  # of the period before Newton's steps, relative to it
_AT_REST = 1e-6  # part of its size that a state at rest moves in a period
_DIVISORS = 2, 3, 5, 7, 11, 13
_NEAR = 1e-4  # below this residual, errors are looked for if it does not fall further


class PeriodicOrbit(NamedTuple):
    """A periodic orbit: the result of :func:`periodic_orbit`.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, iterate, periodic_orbit
    >>> field = QuadraticField.from_function(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> orbit = periodic_orbit(field, [1.0, 2.0], period=6.6, steps=120)
    >>> run = iterate(field, orbit.state, orbit.period / 120, 120, method="order8")
    >>> bool(abs(run.final - orbit.state).max() < 1e-11)
    True
    """

    state: FloatArray
    """A state of the orbit, shape (D,)."""
    period: float
    """The period."""
    multipliers: NDArray[np.complex128]
    """Eigenvalues of the derivative of the map of a period, shape (D,), sorted by modulus."""
    residual: float
    """The largest modulus of a component of Phi^N(x) - x over that of x."""


@public
def periodic_orbit(
    field: QuadraticField,
    /,
    start: ArrayLike,
    period: float,
    steps: int,
    *,
    method: Method = "order8",
    tol: float = 1e-12,
) -> PeriodicOrbit:
    """Find a periodic orbit near a state and a period, with its (Floquet) multipliers.

    Newton's method solves Phi^N(x) = x for the state and the step size together, on the plane
    through `start` that is normal to f(start). A system with an integral has families of periodic
    orbits, of which it finds a member near `start`.

    Parameters
    ----------
    field : QuadraticField
        A single field.
    start : array_like(float, shape=(D,))
        A state near the orbit, such as a near return of :func:`crossings`.
    period : float
        The approximate period.
    steps : int
        The number N of steps in a period. The orbit has the error of :func:`iterate` with
        eps = period / N.
    method : str
        As in :func:`iterate`.
    tol : float
        The largest residual, dimensionless, from 1e-14 to 1e-2.

    Returns
    -------
    PeriodicOrbit
        A named tuple of `state` (D,), `period`, `multipliers` (D,) and `residual`. The multipliers
        are complex and sorted by decreasing modulus; in conjugate pairs Im > 0 comes first. One of
        them is 1 up to the error of the method.

    Raises
    ------
    RuntimeError
        If Newton's method does not converge, or converges to an equilibrium: `start` or `period` is
        too far from an orbit. Also if the multipliers exceed the range of float64.
    TypeError, ValueError
        If an argument is out of range, the method has no Jacobian, or a variable, such as time, has
        a constant rate.

    Warns
    -----
    UserWarning
        If the period is a multiple of a shorter one.

    Examples
    --------
    The shortest periodic orbit of Roessler's system, whose period is 5.8810884555:

    >>> from suslov_fast import QuadraticField, periodic_orbit
    >>> roessler = QuadraticField.from_function(
    ...     lambda x: (-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)), 3
    ... )
    >>> orbit = periodic_orbit(roessler, [0.0, -8.4, 0.03], period=5.9, steps=600)
    >>> round(orbit.period, 9), round(float(orbit.multipliers[0].real), 6)
    (5.881088456, -2.403954)
    """
    times = real_number("period", period)
    if not np.all(np.greater(times, 0.0)):
        raise wrong("period", "positive", period)
    checked = problem("jacobian", field, start, times, method=method, name="start")
    if checked.batch:
        expected = f"a single {type(field).__name__}, state and period"
        raise wrong("periodic_orbit", f"called with {expected}", f"a batch {checked.batch}")
    x, period = checked.omega, float(times)
    if not np.isfinite(x).all():
        raise wrong("start", "finite", short(start))
    steps, tol = integer("steps", steps, 1), float(real_number("tol", tol))
    if not 1e-14 <= tol <= 1e-2:
        raise wrong("tol", "from 1e-14 to 1e-2", tol)
    _check_return(field)
    return _Shooting(field, x, period, steps, method).solve(tol)


def _check_return(field: Any) -> None:
    """Raise an error if a variable has a constant rate, as time has: no orbit returns then."""
    if not hasattr(field, "terms"):  # a body
        return
    i, j, k = field.terms[0]
    is_constant = (j == field.dimension) & (k == field.dimension)
    growing = sorted({*i[is_constant].tolist()} - {*i[~is_constant].tolist()})
    if growing:
        name = field.names[growing[0]]
        received = f"one in which {name} grows at a constant rate"
        how = "write a force cos(w t) by two variables, c' = -w s and s' = w c, from (1, 0)"
        raise wrong("field", "a field whose orbits can return", f"{received}: {how}")


class _Shooting:
    """Newton's method for the state and the step size of a periodic orbit."""

    def __init__(
        self, field: Any, start: FloatArray, period: float, steps: int, method: str
    ) -> None:
        self.field, self.start, self.steps, self.method = field, start, steps, method
        self.given, self.slope = period, vector_field(field, start)
        self._go_to(start, period / steps)

    def _runs(self, x: FloatArray, eps: Any, **options: Any) -> Any:
        return iterate(
            self.field, x, eps, self.steps, method=self.method, on_singular="ignore", **options
        )

    def _go_to(self, x: FloatArray, eps: float) -> None:
        """Compute the orbit of a state, and how far from it the orbit ends."""
        self.x, self.eps = x, eps
        self.states = self._runs(x, eps).states
        self.gap = self.states[-1] - x
        residual = abs(self.gap).max() / abs(x).max() if x.any() else np.inf
        self.residual = float(residual) if np.isfinite(residual) else np.inf

    def _derivative(self) -> FloatArray:
        """Return the derivative of the map of a period with respect to the state."""
        factors = jacobian(self.field, self.states[:-1], self.eps, method=self.method)
        while len(factors) > 1:  # the later one of two is the left one
            last = factors[len(factors) // 2 * 2 :]
            factors = np.concatenate([factors[1::2] @ factors[: len(factors) - 1 : 2], last])
        product: FloatArray = factors[0]
        return product

    def _step(self) -> FloatArray:
        """Return the step of the state and of log(eps)."""
        D = len(self.x)
        ends = self._runs(
            self.x, self.eps * np.array([1 + _PART, 1 - _PART]), save_every=None
        ).final
        sizes = abs(self.states).max(axis=0)
        sizes = np.maximum(sizes, 2.0**-20 * sizes.max())
        matrix, right = np.zeros((D + 1, D + 1)), np.zeros(D + 1)
        matrix[:D, :D] = self._derivative() - np.eye(D)
        matrix[:D, D] = (ends[0] - ends[1]) / (2 * _PART)  # with respect to log(eps)
        matrix[D, :D], right[D] = self.slope, -self.slope @ (self.x - self.start)
        right[:D] = -self.gap
        # Components in units of their size, the plane's equation of the size of the others.
        matrix[:, :D] *= sizes
        matrix[:D], right[:D] = matrix[:D] / sizes[:, np.newaxis], right[:D] / sizes
        length = np.linalg.norm(matrix[D]) or 1.0
        matrix[D], right[D] = matrix[D] / length, right[D] / length
        # Levenberg and Marquardt's step, which is Newton's but for small singular values.
        if not np.isfinite(matrix).all():
            return np.full(D + 1, np.nan)
        left, values, rows = np.linalg.svd(matrix)
        damping = (_LEAST * values[0]) ** 2 + right @ right
        step: FloatArray = (values / (values**2 + damping) * (right @ left)) @ rows
        step[:D] *= sizes
        return step

    def _improve(self) -> bool:
        """Take a step, or a part of it; return whether the residual fell."""
        x, eps, residual = self.x, self.eps, self.residual
        with np.errstate(all="ignore"):
            step = self._step()
        if not np.isfinite(step).all():
            return False
        for k in range(_HALVINGS):
            part = step / 2**k
            self._go_to(x + part[:-1], eps * np.exp(np.clip(part[-1], -0.5, 0.5)))
            if self.residual < residual:
                return True
        self._go_to(x, eps)
        return False

    def _correct_period(self) -> None:
        """Go to the time at which the orbit of the start passes nearest to it.

        A system with several integrals has orbits of all periods near by, turned against each
        other, and Newton's steps would rather turn a Kepler ellipse than correct a period.
        """
        for _ in range(_CORRECTIONS):
            eps, residual = self.eps, self.residual
            rate = vector_field(self.field, self.states[-1])
            change = -(rate @ self.gap) / (rate @ rate * self.steps * eps)
            if not _LEAST_CHANGE < abs(change) < 0.5:  # false for NaN
                break
            self._go_to(self.x, eps * (1.0 + change))
            if not self.residual < residual:
                self._go_to(self.x, eps)
                break

    def solve(self, tol: float) -> PeriodicOrbit:
        with np.errstate(all="ignore"):
            self._correct_period()
        for _ in range(_ROUNDS):
            is_found, last = self.residual <= tol, self.residual
            if not self._improve() or (is_found and self.residual > last / 2):
                break
        period = self.eps * self.steps
        size, rate = abs(self.x).max(), abs(vector_field(self.field, self.x)).max()
        if rate * max(period, self.given) <= _AT_REST * size:
            found = f"the equilibrium {short(self.x.tolist())}"
        elif rate * period <= _AT_REST * size:
            found = f"no orbit: the period tended to 0 at the state {short(self.x.tolist())}"
        elif not self.residual <= tol:
            found = f"no orbit: the residual {self.residual:.1e} exceeds tol = {tol:g}"
            if how := self._how_to_return(tol):
                raise RuntimeError(f"periodic_orbit found {found}{how}")
        else:
            with np.errstate(all="ignore"):
                derivative = self._derivative()
            if not np.isfinite(derivative).all():
                found = (
                    f"an orbit of period {period:g} whose multipliers exceed the range of float64"
                )
                raise RuntimeError(f"periodic_orbit found {found}: call iterate for its states")
            self._warn_of_divisors(period)
            values = np.linalg.eigvals(derivative).astype(complex)
            order = np.lexsort((-values.imag, -abs(values)))
            return PeriodicOrbit(self.x, float(period), values[order], self.residual)
        given = f"start or period = {self.given:g} is too far from a periodic orbit"
        raise RuntimeError(f"periodic_orbit found {found}; {given}, or steps is too small")

    def _how_to_return(self, tol: float) -> str:
        """Return what limits a small residual, and what to pass; nothing for a large one.

        It is the error of the method, which half of the step size shows, or rounding errors times
        the norm of the derivative.
        """
        if not self.residual < _NEAR:
            return ""
        with np.errstate(all="ignore"):
            fine = iterate(
                self.field, self.x, self.eps / 2, 2 * self.steps, save_every=None,
                method=self.method, on_singular="ignore",
            ).final  # fmt: skip
            error = abs(fine - self.states[-1]).max() / abs(self.x).max()
            amplified = np.linalg.norm(self._derivative(), 2) * 2.0**-52 * self.steps
        enough = f"tol={2 * self.residual:.0e}"
        if error > self.residual / 16:
            order = map_of(self.field, self.method).order
            steps = self.steps * max((self.residual / tol) ** (1 / order), 1.0) * 1.25
            steps = int(float(f"{steps:.2g}"))
            cause = f", because {self.steps} steps have about this error"
            return f"{cause}: pass steps={steps}, or {enough} if this is enough"
        if self.residual < 4 * amplified:
            return f", because rounding errors grow along the orbit: pass {enough}"
        return ""

    def _warn_of_divisors(self, period: float) -> None:
        """Warn if the orbit returns after a fraction of the period."""
        turns, found, extent = 1, [1], abs(self.states - self.x).max()
        while found:
            turns *= found[-1]
            divisors = turns * np.array(_DIVISORS)
            ends = self._runs(self.x, self.eps / divisors, save_every=None).final
            returns = abs(ends - self.x).max(axis=1) < 1e-6 * extent
            found = [k for k, is_back in zip(_DIVISORS, returns, strict=True) if is_back]
        if turns > 1:
            text = f"period: {period:g} is {turns} times the shorter period {period / turns:g}"
            warn(f"{text}; pass period={period / turns:g} for one turn")
