"""The equations of equilibria of a field, and Newton's method for them.

Linear integrals c . x of f keep their values: the equation of each integral replaces an equation of
f that follows from the others. A Newton step is the solution of least norm of the linear equations.
Rows of their matrix are scaled to 1, so that units of rates do not matter. Unknowns are in units of
the given states, unless the matrix is singular in these units. Newton's method goes on while each
step is much shorter than the step before, as near a regular equilibrium; at a multiple root each
step is half as long, and near a family of equilibria it may be. Members of a family near the start
are found by other steps (`EquationsAtRest.in_family`).

Equations f = 0 of mechanics with constraints have solutions off the constraints, which mean
nothing. So the equations are those of residuals of constraints, and of f in the tangent space T at
the present state: T^T f = 0. A Newton step neglects that T changes, by parts that are 0 at
equilibria. Eigenvalues are those of f' in the tangent space.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.cached import cached_property
from ..core.expressions.linear_terms import coefficients
from ..fields.constraints import constraints_of
from ..results.result import place_in
from .tangent_spaces import tangent_basis, within
from .tolerances import (
    DISPLACEMENT_FROM_FAMILY,
    DISPLACEMENT_OF_PROBE,
    LAST_NEWTON_STEP,
    LEAST_SIZE_OF_COMPONENT,
    LONGEST_NEWTON_STEP,
    MOST_DAMPED_STEPS,
    MOST_NEWTON_STEPS,
    MOST_STEPS_TO_FAMILY,
    RESIDUAL_ON_FAMILY,
    SHORT_NEWTON_STEP,
    SHRINKING_OF_STEPS,
    SINGULAR_SLOPES,
    ZERO_AT_MULTIPLE_ROOT,
    ZERO_OF_PROJECTION,
    ZERO_OF_RANK,
)


class EquationsAtRest:
    """The equations of a field for its k variables without a constant rate.

    moving    True for these variables (D,)
    start     their given values (..., k)
    totals    matrices (..., k, k): if a linear integral c . x of f replaces the equation of a
              variable, its row is c, else 0
    is_total  True for rows with an integral (..., k)
    sizes     sizes of components (..., k), at least LEAST_SIZE_OF_COMPONENT times the largest one
    units     sizes of components (..., k), however small they are

    With r constraints there are k - r rows of f in their tangent space, then r rows of constraints,
    which `is_total` marks; linear integrals are not known then.
    """

    def __init__(self, field: Any, x: FloatArray, totals: Any = None, moving: Any = None) -> None:
        self.field, self.x = field, x
        self.constraints: Any = constraints_of(field)
        steady = [{*f.steady} for _, f, _ in field._listed_right_hand_sides]
        left_out = [*set.intersection(*steady)] if steady else []
        if self.constraints:  # a velocity of constant rate is no clock: then nothing is at rest
            left_out = [i for i in left_out if i >= self.constraints.parts[1].stop]
        self.moving = ~np.isin(np.arange(field._layout.D), left_out) if moving is None else moving
        self.start = x[..., self.moving]
        self.totals = self._all_totals() if totals is None else totals
        self.is_total: Any = self.totals.any(axis=-1)
        if self.constraints:
            k = int(self.moving.sum())
            r = len(self.constraints.rows(np.flatnonzero(self.moving).tolist()))
            self.is_total = np.arange(k) >= k - r
        moduli = abs(self.start)
        largest = moduli.max(axis=-1, keepdims=True, initial=0.0)
        self.sizes = np.maximum(
            moduli, np.where(largest > 0, LEAST_SIZE_OF_COMPONENT * largest, 1.0)
        )
        self.units = np.where(moduli == 0.0, self.sizes, moduli)

    def _all_totals(self) -> FloatArray:
        """Return matrices (..., k, k) with integrals as rows; a single one if members share it."""
        k, shape = int(self.moving.sum()), self.field.shape
        if self.constraints:
            return np.zeros((k, k))
        found, known = np.zeros((int(np.prod(shape)), k, k)), {}
        for members, f, table in self.field._listed_right_hand_sides:
            for member, C in zip(members, coefficients(f, table)[:, self.moving], strict=True):
                key = C.round(12).tobytes()
                if key not in known:
                    known[key] = _totals(C)
                found[member] = known[key]
        return found[0] if len(known) == 1 else found.reshape(*shape, k, k)

    def member(self, index: tuple[int, ...]) -> EquationsAtRest:
        """Return the equations of one state, by its index in the batch."""
        field, totals = self.field, self.totals
        if field.shape:
            place = place_in(field.shape, index)
            field, totals = field[place], totals[place] if totals.ndim > 2 else totals
        return EquationsAtRest(field, self.x[index], totals, self.moving)

    def whole(self, y: FloatArray) -> FloatArray:
        """Return states (..., D) with variables y; other components keep their given values."""
        x = self.x.copy()
        x[..., self.moving] = y
        return x

    def value(self, y: FloatArray) -> FloatArray:
        """Return the residual (..., k) of the variables y (..., k), which is 0 at equilibria."""
        if self.constraints:
            residuals, _, basis = self._of_constraints(self.whole(y))
            rates = self.field._value(self.whole(y))[..., self.moving, np.newaxis]
            along = (np.swapaxes(basis, -2, -1) @ rates)[..., 0]
            return np.concatenate([along, residuals], axis=-1)
        away = (self.totals @ (y - self.start)[..., np.newaxis])[..., 0]
        return np.where(self.is_total, away, self.field._value(self.whole(y))[..., self.moving])

    def slopes(self, y: FloatArray) -> FloatArray:
        """Return the derivative (..., k, k) of the residual with respect to the variables y."""
        slopes = self.field._slopes(self.whole(y))[..., self.moving, :][..., self.moving]
        if self.constraints:
            _, rows, basis = self._of_constraints(self.whole(y))
            return np.concatenate([np.swapaxes(basis, -2, -1) @ slopes, rows], axis=-2)
        return np.where(self.is_total[..., np.newaxis], self.totals, slopes)

    def _of_constraints(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return residuals (..., r), their derivatives (..., r, k), and a basis (..., k, k - r)."""
        moving = np.flatnonzero(self.moving).tolist()
        residuals, rows = self.constraints.of(x, self.field._inputs, moving)
        lengths = np.linalg.norm(rows, axis=-1)
        lengths = np.where(lengths > 0.0, lengths, 1.0)  # residuals become distances
        return residuals / lengths, rows / lengths[..., np.newaxis], tangent_basis(rows)

    def on_constraints(self, x: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return f', `slopes`, at states x, in the tangent space of constraints if f has some."""
        return within(self._of_constraints(x)[2], slopes) if self.constraints else slopes

    def without_totals(self, slopes: FloatArray, is_map: bool) -> FloatArray:
        """Return f', `slopes`, with negative numbers for eigenvalues 0 that integrals cause."""
        if self.constraints:
            return slopes
        one = np.eye(slopes.shape[-1])
        along = one - np.linalg.pinv(self.totals) @ self.totals
        size = abs(slopes).max(axis=(-2, -1), keepdims=True, initial=0.0) + 1e-300
        # For a map `slopes` is f' - 1, in which -1 makes the multiplier of an integral 0.
        size = 1.0 if is_map else size
        return along @ slopes @ along - size * (one - along)

    @cached_property
    def terms(self) -> FloatArray:
        """Sizes of the terms of f (..., k): |f'| u at the given states, with u = `units`."""
        units = self.units[..., np.newaxis]
        terms: FloatArray = (abs(self.slopes(self.start)) @ units)[..., 0]
        return np.where(np.isfinite(terms), terms, 0.0)  # at infinite f' only f = 0 counts as zero

    def is_zero(self, y: FloatArray) -> Any:
        """Return True where f is 0 up to rounding errors, which is so near multiple roots."""
        return (abs(self.value(y)) <= ZERO_AT_MULTIPLE_ROOT * self.terms).all(axis=-1)

    def step(self, y: FloatArray) -> tuple[Any, Any, Any, Any]:
        """Return Newton's step (..., k), the scaled residual, the matrix of the step, and a ratio.

        The step is the matrix (..., k, k) times the residual. The ratio is the smallest singular
        value of f', in units of the components, divided by the largest one; it is 0 if f' is
        singular.
        """
        f, slopes = self.value(y), self.slopes(y)
        sizes = abs(slopes).max(axis=-1, initial=0.0)
        sizes = np.where(sizes > 0, sizes, 1.0)
        known: Any = np.isfinite(f).all(axis=-1) & np.isfinite(slopes).all(axis=(-2, -1))
        scaled = np.where(known[..., np.newaxis, np.newaxis], slopes / sizes[..., np.newaxis], 0.0)
        units = self.units[..., np.newaxis, :]
        inner = scaled * units
        inner = np.where(np.isfinite(inner), inner, 0.0)
        rows = abs(inner).max(axis=-1, keepdims=True, initial=0.0)
        values = np.linalg.svd(inner / np.where(rows > 0, rows, 1.0), compute_uv=False)
        largest = values.max(axis=-1, initial=0.0)
        least = values.min(axis=-1, initial=np.inf) / np.where(largest > 0.0, largest, 1.0)
        least = np.where((rows > 0).all(axis=(-2, -1)), least, 0.0)
        kept = (least > SINGULAR_SLOPES)[..., np.newaxis, np.newaxis]
        units, rows = np.where(kept, units, 1.0), np.where(kept, rows, 1.0)
        inverse: Any = -np.linalg.pinv(scaled * units / rows, rcond=ZERO_OF_RANK)
        inverse *= np.swapaxes(units, -2, -1) / np.swapaxes(rows * sizes[..., np.newaxis], -2, -1)
        step = (inverse @ np.where(known[..., np.newaxis], f, np.nan)[..., np.newaxis])[..., 0]
        return step, f / sizes, inverse, least

    def newton(self, y: FloatArray, sizes: FloatArray | None = None) -> tuple[Any, Any]:
        """Return the states to which Newton's method leads from y, and True where it converges.

        Steps are measured in units of `sizes` (..., k), the sizes of the components.
        """
        sizes = self.sizes if sizes is None else sizes
        y, before = y.copy(), np.full(y.shape[:-1], np.inf)
        going = np.isfinite(y).all(axis=-1)
        is_found = np.zeros(y.shape[:-1], bool)
        for _ in range(MOST_NEWTON_STEPS):
            step, f, *_ = self.step(y)
            scale = np.maximum(sizes, abs(y))
            length = _length(step, scale)
            size = scale.max(axis=-1, keepdims=True, initial=0.0)
            solved = (abs(f) <= SHORT_NEWTON_STEP * size).all(axis=-1)
            going &= length <= LONGEST_NEWTON_STEP
            is_last = (length <= LAST_NEWTON_STEP) | (
                (before <= SHORT_NEWTON_STEP) & (length > SHRINKING_OF_STEPS * before)
            )
            is_found |= going & is_last & solved
            going &= ~is_last & (length <= SHRINKING_OF_STEPS * before)
            moves = going | (is_found & (length <= before))
            y = np.where(moves[..., np.newaxis], y + step, y)
            before = length
            if not going.any():
                break
        return y, is_found

    def damped(self, y: FloatArray) -> FloatArray:
        """Return y after fractions of Newton steps; each one makes the next Newton step shorter."""
        part = np.ones(y.shape[:-1])
        for _ in range(MOST_DAMPED_STEPS):
            step, _, inverse, _ = self.step(y)
            scale = np.maximum(self.sizes, abs(y))
            length = _length(step, scale)
            part = np.minimum(part, LONGEST_NEWTON_STEP / length)
            moved = y + part[..., np.newaxis] * step
            after = _length((inverse @ self.value(moved)[..., np.newaxis])[..., 0], scale)
            is_shorter = after <= (1.0 - part / 4) * length
            is_shorter &= ~self.is_zero(y)
            y = np.where(is_shorter[..., np.newaxis], moved, y)
            part = np.where(is_shorter, np.minimum(1.0, 2.0 * part), part / 4)
        return y

    def in_family(self, y: FloatArray) -> tuple[Any, Any]:
        """Return states near y, and True where f is 0, f' singular, and steps become short fast.

        They are the nearest in units of the largest component, or else of each component.
        """
        own = np.maximum(self.sizes, abs(y))
        members, are_members = self._in_family(y, own.max(axis=-1, keepdims=True) + 0.0 * own)
        if not are_members.all():
            others, too = self._in_family(y, own)
            members = np.where(are_members[..., np.newaxis], members, others)
            are_members = are_members | too
        return members, are_members

    def _in_family(self, y: FloatArray, scale: FloatArray) -> tuple[Any, Any]:
        """Take steps of Levenberg and Marquardt, in units of `scale`.

        They tend to a near member of a family as fast as Newton's method does to a regular
        equilibrium, while Newton's steps may go along the family. At a multiple root each step is
        about 3/5 of the step before. Rates are in units of the states and of the largest rate: an
        equation that vanishes along the family is not scaled up.
        """
        known: Any = np.isfinite(y).all(axis=-1, keepdims=True)
        for _ in range(MOST_STEPS_TO_FAMILY):
            f, A = self.value(y), self.slopes(y) * scale[..., np.newaxis, :]
            known = known & np.isfinite(f).all(axis=-1, keepdims=True)
            known = known & np.expand_dims(np.isfinite(A).all(axis=(-2, -1)), -1)
            f, A = np.where(known, f, 0.0), np.where(np.expand_dims(known, -1), A, 0.0)
            rows = abs(A).max(axis=-1, initial=0.0)
            rate = (rows / scale).max(axis=-1, keepdims=True, where=~self.is_total, initial=1e-300)
            rows = np.where(self.is_total, rows, scale * rate)
            left, values, right = np.linalg.svd(A / rows[..., np.newaxis])
            f = f / rows
            size = np.sqrt((f * f).sum(axis=-1, keepdims=True))
            along = (np.swapaxes(left, -2, -1) @ f[..., np.newaxis])[..., 0]
            along *= values / np.where(size > 0.0, values**2 + size, np.inf)
            y = y - scale * (np.swapaxes(right, -2, -1) @ along[..., np.newaxis])[..., 0]
        is_zero = (known & (size <= RESIDUAL_ON_FAMILY))[..., 0]
        return y, is_zero & (self.step(y)[3] <= SINGULAR_SLOPES)

    def size_of_family(self, y: FloatArray) -> int:
        """Return the dimension of the family of equilibria near its member y (k,); at least 1.

        Members near displaced states are projections of the displacements onto the family.
        """
        scale = np.maximum(self.sizes, abs(y))
        moved = [self.in_family(y + DISPLACEMENT_FROM_FAMILY * away) for away in np.diag(scale)]
        along = np.array([(member - y) / scale * is_member for member, is_member in moved])
        return max(
            int(
                (
                    np.linalg.svd(along / DISPLACEMENT_FROM_FAMILY, compute_uv=False)
                    > ZERO_OF_PROJECTION
                ).sum()
            ),
            1,
        )

    def by_scipy(self) -> tuple[FloatArray, bool]:
        """Return the state that SciPy finds for a single field; True if it is an equilibrium."""
        from scipy.optimize import root  # inside, because the import takes time

        for method in ("hybr", "lm"):
            options = {"factor": 1}  # the first step is no longer than the state
            last = root(self.value, self.start, jac=self.slopes, method=method, options=options).x
            y, is_found = self.newton(last)
            if is_found:
                return y, True
        return last, bool(self.is_zero(last))

    def near(self, y: FloatArray) -> tuple[Any, Any]:
        """Return two masks: Newton's method converges from a state near y; y is in a family.

        First each component is displaced in proportion to its entry in `sizes`, or to its modulus
        if that is larger. For a component far below the others this displacement may be too large.
        If Newton's method then fails, it starts again from displacements in proportion to the
        components.
        """
        scale = np.maximum(self.sizes, abs(y))
        away = DISPLACEMENT_OF_PROBE * np.cos(np.arange(y.shape[-1]))
        back, leads = self.newton(y + scale * away)
        is_family = leads & (_length(back - y, scale) > SHORT_NEWTON_STEP)
        if not leads.all():
            small = np.where(y == 0.0, self.sizes, abs(y))
            leads = leads | self.newton(y + small * away, small)[1]
        return leads, is_family & (self.step(y)[3] <= SINGULAR_SLOPES)


def found_from(equations: EquationsAtRest, f_is_finite: Any) -> tuple[Any, Any, Any, Any]:
    """Return variables y (..., k) and masks: y is an equilibrium, is degenerate, is in a family."""
    y, is_found = equations.newton(equations.start)
    if not is_found.all():
        start = np.where(is_found[..., np.newaxis], np.nan, equations.start)
        closer = equations.damped(start)
        others, too = equations.newton(closer)
        is_zero = ~too & ~is_found & equations.is_zero(closer)
        y = np.where(too[..., np.newaxis], others, y)
        y = np.where(is_zero[..., np.newaxis], closer, y)
        is_found = np.array(is_found | too | is_zero)
    for index in map(tuple, np.argwhere(f_is_finite & ~is_found)):
        y[index], is_found[index] = equations.member(index).by_scipy()
    leads, is_family = equations.near(y)
    if not (leads | ~is_found).all():
        others, too = equations.in_family(equations.start)
        y = np.where((too & is_found & ~leads)[..., np.newaxis], others, y)
        scale = np.maximum(equations.sizes, abs(y))
        others, too = equations.in_family(
            y + DISPLACEMENT_FROM_FAMILY * scale * np.cos(np.arange(y.shape[-1]))
        )
        too &= is_found & ~leads & (_length(others - y, scale) > DISPLACEMENT_OF_PROBE)
        leads, is_family = leads | too, is_family | too
    if (is_multiple := is_found & ~leads).any():  # `damped` corrects small components of y
        closer = equations.damped(np.where(is_multiple[..., np.newaxis], y, np.nan))
        y = np.where(is_multiple[..., np.newaxis], closer, y)
        is_found = is_found & (leads | equations.is_zero(y))
    return y, is_found, is_found & (~leads | is_family), is_found & is_family


def _totals(C: FloatArray) -> FloatArray:
    """Return the matrix `totals` (k, k) from coefficients C (k, terms) of f's terms."""
    k = len(C)
    totals = np.zeros((k, k))
    if not C.any():
        return np.eye(k)
    if not np.isfinite(C).all():  # a coefficient has no value, as 1/a - 1/a for a parameter a = 0
        return totals
    _, values, rows = np.linalg.svd(np.linalg.qr(C.T, mode="r"))
    free = rows[int((values > ZERO_OF_RANK * values[0]).sum()) :]
    pivots = []
    for i in range(len(free)):  # in echelon form, so that integrals of different sizes do not mix
        pivots.append(int(abs(free[i]).argmax()))
        free[i] /= free[i, pivots[i]]
        others = np.arange(len(free)) != i
        free[others] -= free[others, pivots[i], np.newaxis] * free[i]
    totals[pivots] = np.where(abs(free) < ZERO_OF_RANK, 0.0, free)
    return totals


def _length(step: FloatArray, scale: FloatArray) -> Any:
    return abs(step / scale).max(axis=-1, initial=0.0)
