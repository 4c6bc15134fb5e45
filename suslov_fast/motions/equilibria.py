"""Equilibria of fields near given states, and fixed points of maps, by Newton's method.

Linear integrals c . x of f keep their values: the equation of each integral replaces an equation of
f that follows from the others. A Newton step is the solution of least norm of the linear equations.
Rows of their matrix are scaled to 1, so that units of rates do not matter. Unknowns are in units of
the given states, unless the matrix is singular in these units. Newton's method goes on while each
step is much shorter than the step before, as near a regular equilibrium; at a multiple root each
step is half as long, and near a family of equilibria it may be. Members of a family near the start
are found by other steps (`_Equations.in_family`).

Equations f = 0 of mechanics with constraints have solutions off the constraints, which mean
nothing. So the equations are those of residuals of constraints, and of f in the tangent space T at
the present state: T^T f = 0. A Newton step neglects that T changes, by parts that are 0 at
equilibria. Eigenvalues are those of f' in the tangent space.
"""

from __future__ import annotations

from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..bodies.systems import System
from ..checks import FloatArray, StatesLike, common_shape, first_index, short, spell, warn
from ..core.cached import cached_property
from ..core.expressions.linear_terms import coefficients
from ..fields.constraints import constraints_of
from ..fields.html import html_table
from ..fields.map import Map
from ..fields.mechanics import near_constraints
from ..fields.names import labels
from ..keywords import lacking, public
from ..maps.formulas import eigenvalues_in_order
from ..results.result import place_in
from ..status import Status
from .motion_arguments import system_of
from .tangent_spaces import tangent_basis, within
from .tolerances import (
    DISPLACEMENT_FROM_FAMILY,
    DISPLACEMENT_OF_PROBE,
    LAST_NEWTON_STEP,
    LEAST_SIZE_OF_COMPONENT,
    LONGEST_NEWTON_STEP,
    MOST_DAMPED_STEPS,
    MOST_NEWTON_STEPS,
    MOST_STARTS_COUNTED,
    MOST_STEPS_TO_FAMILY,
    NEUTRAL_RATE,
    NEUTRAL_RATE_IF_SINGULAR,
    RESIDUAL_ON_FAMILY,
    SHORT_NEWTON_STEP,
    SHRINKING_OF_STEPS,
    SINGULAR_SLOPES,
    ZERO_AT_MULTIPLE_ROOT,
    ZERO_OF_PROJECTION,
    ZERO_OF_RANK,
)


class Equilibria(NamedTuple):
    """Equilibria near given states: the result of :func:`equilibria`.

    Attributes
    ----------
    states : ndarray(float, shape=(..., D))
        The equilibria; NaN where none is found.
    eigenvalues : ndarray(complex, shape=(..., k))
        Eigenvalues of f', by decreasing real part; k is D without the variables that have a
        constant rate. With constraints they are those of motions that satisfy them, and k is the
        dimension of their manifold. For a `Map` they are its multipliers, by decreasing modulus. In
        conjugate pairs Im > 0 comes first.
    status : ndarray(int, shape=(...))
        The :class:`Status`: `OK`, `DEGENERATE`, `NOT_FOUND` or `NONFINITE`. It is `DEGENERATE`
        where f' is singular up to rounding: at a multiple root, where states have 7 digits, and on
        a family of equilibria, of which the result is a member near the given state.
    stable : ndarray(bool, shape=(...))
        True where the equilibrium attracts, or a family of equilibria near it: all eigenvalues have
        negative real parts, except the zeros that belong to linear integrals, and those along a
        family, one for each of its dimensions. For a `Map` all multipliers have moduli below 1.
    kind : ndarray(str, shape=(...))
        "attracting", "repelling" or "saddle"; "neutral" if the eigenvalues decide nothing; "" where
        no equilibrium is found. With two eigenvalues it is "attracting node", "attracting focus",
        "repelling node", "repelling focus", "saddle" or "centre". On a family, such as the line of
        equilibria of a body, eigenvalues 0 along the family do not count.
    """

    states: FloatArray
    eigenvalues: NDArray[np.complex128]
    status: NDArray[np.int8]
    stable: NDArray[np.bool_]
    kind: NDArray[np.str_]

    def __getattr__(self, name: str) -> NoReturn:
        raise lacking(self, name, "field.jacobian(found.states)" if name == "jacobian" else "")

    def distinct(self, rtol: float = 1e-6) -> tuple[Equilibria, NDArray[np.int64]]:
        """Return each equilibrium once, and how many starts led to it.

        Two states count as one if each component differs by at most `rtol` times its largest
        modulus, or by at most 1e-14 times the largest modulus of all components.

        Examples
        --------
        >>> from suslov_fast import Field, equilibria
        >>> well = Field(lambda x: (x[1], x[0] - x[0] ** 3 - 0.2 * x[1]), "q p")
        >>> starts = [[-2, 0], [-0.9, 0], [0.1, 0], [1.2, 0]]
        >>> found, count = equilibria(well, near=starts).distinct()
        >>> found.states[:, 0].round(9) + 0.0, count, found.kind[:2].tolist()
        (array([-1.,  0.,  1.]), array([2, 1, 1]), ['attracting focus', 'saddle'])
        """
        x = self.states.reshape(-1, self.states.shape[-1])
        left = np.flatnonzero(self.status.ravel() >= 0)
        largest = abs(x[left]).max(axis=0, initial=0.0)
        first, count = [], []
        near = np.maximum(rtol * largest, 1e-14 * largest.max())
        while left.size:
            is_same = (abs(x[left] - x[left[0]]) <= near).all(axis=1)
            first.append(left[0])
            count.append(np.count_nonzero(is_same))
            left = left[~is_same]
        one = np.newaxis if not self.status.ndim else ...
        places = np.unravel_index(np.array(first, int), self.status[one].shape)
        parts: Any = (np.asarray(each)[one][places] for each in self)
        return Equilibria(*parts), np.array(count, np.int64)

    def __repr__(self) -> str:
        if not self.status.ndim:
            status = Status(int(self.status)).name
            return f"Equilibria({short(self.states.tolist())}, {status}, {self.kind or 'none'})"
        found = f"{np.count_nonzero(self.status >= 0)} OK"
        if self.status.size <= MOST_STARTS_COUNTED:
            found += f", {len(self.distinct()[1])} different states"
        return f"Equilibria({self.status.size} starts: {found})"

    def _repr_html_(self) -> str:
        found, count = self.distinct()
        rows = np.c_[count.astype(object), found.kind.astype(object), found.states]
        return html_table(self, ["starts", "kind", *labels(self.states.shape[-1])], rows)


@public
def equilibria(system: System, /, near: StatesLike) -> Equilibria:
    """Find equilibria near given states, or fixed points f(x) = x of a :class:`Map`.

    Newton's method solves f(x) = 0 from all states at once, with the exact f'. If it does not
    converge at once, it continues with shorter steps, and then ``scipy.optimize.root`` with its
    methods "hybr" and "lm" tries; these equilibria may be far from `near`. Linear integrals of f,
    such as the totals that a reaction conserves, keep the values that they have in `near`.
    Equilibria satisfy the constraints of the equations; `near` need not.

    Members of a family may lead to different equilibria. To follow one equilibrium, pass the last
    result as `near` of the next call. A body without a rotor has a line of equilibria; the result
    is the nearest one. Kahan's map has the same fixed points for every step size, because
    (1 - (eps / 2) f'(x)) (x_next - x) = eps f(x). Orbits of period 2 of a map are fixed points of
    ``Map(lambda x: f(f(x)), names)``.

    Parameters
    ----------
    system : Field, Map, body or callable
        A single one, or a batch, or a function of the state as in :func:`flow`.
    near : array_like(float, shape=(..., D))
        States near equilibria, which broadcast with the batch. NaN gives NaN.

    Returns
    -------
    Equilibria
        A named tuple; its method ``distinct`` lists each state once. If a variable has a constant
        rate in all members, such as time, it keeps the value that it has in `near`, and has neither
        an equation nor an eigenvalue.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or shape, or is infinite; or if f(t, x) reads the time:
        :func:`periodic_orbit` follows a force.

    Warns
    -----
    UserWarning
        Once for all states without an equilibrium, once for all multiple roots, once for all states
        on families, and once if the equations depend on a variable with a constant rate.

    See Also
    --------
    kahan.multipliers : Multipliers of Kahan's map at an equilibrium.

    Examples
    --------
    A pendulum with friction and a torque, for three torques:

    >>> import numpy as np
    >>> from suslov_fast import Field, Map, equilibria
    >>> pendulum = Field(
    ...     lambda x, m: (x[1], m - np.sin(x[0]) - 0.1 * x[1]), "q p", m=[0.0, 0.3, 0.6]
    ... )
    >>> found = equilibria(pendulum, near=[0.1, 0.0])
    >>> found.states[:, 0].round(6) + 0.0, found.stable
    (array([0.      , 0.304693, 0.643501]), array([ True,  True,  True]))

    A substrate S that an enzyme E turns into P: the total amounts are kept.

    >>> enzyme = Field(
    ...     lambda x: (x[2] - x[0] * x[1], 2 * x[2] - x[0] * x[1], x[0] * x[1] - 2 * x[2], x[2]),
    ...     "S E SE P",
    ... )
    >>> equilibria(enzyme, near=[10, 1, 0, 0]).states.round(9) + 0.0
    array([ 0.,  1.,  0., 10.])

    The saddle in the attractor of Hénon's map:

    >>> henon = Map(lambda x: (1 - 1.4 * x[0] ** 2 + x[1], 0.3 * x[0]), "x y")
    >>> saddle = equilibria(henon, near=[0.6, 0.2])
    >>> saddle.states.round(6), saddle.eigenvalues.real.round(6)
    (array([0.631354, 0.189406]), array([-1.923739,  0.155946]))
    """
    body: Any = system_of(system, near)
    is_map = isinstance(body, Map)
    field = body._displacement if is_map else body._field._autonomous
    given = field._layout.enter("near", near)
    batch = common_shape({"system": field.shape, "near": given.shape[:-1]})
    x = np.array(np.broadcast_to(given, (*batch, field._layout.D)))
    with np.errstate(all="ignore"):
        x = near_constraints(field, x)
        has_line = np.zeros(batch, bool)
        if (line := body._steady_line) is not None:
            has_line = np.broadcast_to(~np.isnan(line).any(axis=-1), batch)
            x = np.where(has_line[..., np.newaxis], _on_line(line, x), x)
        equations = _Equations(field, x)
        has_value = np.isfinite(field._value(x)).all(axis=-1) & np.isfinite(x).all(axis=-1)
        y, is_found, is_degenerate, is_family = _found(equations, has_value & ~has_line)
        y = np.where(has_line[..., np.newaxis], equations.start, y)
        is_found = np.where(has_line, has_value, is_found)
        is_degenerate, is_family = is_degenerate & ~has_line, is_family & ~has_line
        x = np.where(is_found[..., np.newaxis], equations.whole(y), np.nan)
        slopes = field._slopes(x)[..., equations.moving, :][..., equations.moving]
        slopes = equations.on_constraints(x, slopes)
        values = _eigenvalues(slopes, is_map)
        others = _eigenvalues(equations.without_totals(slopes, is_map), is_map)
        size = abs(slopes).max(axis=(-2, -1), initial=0.0) + is_map
        at_start = abs(equations.slopes(equations.start)).max(axis=(-2, -1), initial=0.0) + is_map
        is_member = is_family | (has_line & (size > 0.0))
        double = NEUTRAL_RATE_IF_SINGULAR * np.fmax(size, at_start)
        rounding = np.where(is_degenerate | is_member, double, NEUTRAL_RATE * size)
        kind, attracts = _kinds(others, rounding[..., np.newaxis], is_map)
        order, zeros = abs(others - is_map).argsort(axis=-1), abs(others - is_map)
        zeros = (zeros <= rounding[..., np.newaxis]).sum(axis=-1)
        size_of_family = np.array(is_member, int)
        for index in map(tuple, np.argwhere(is_family & (zeros > 1))):
            size_of_family[index] = equations.member(index).size_of_family(y[index])
        for n in range(1, size_of_family.max(initial=0) + 1):  # all but the n nearest to 0
            across: Any = np.take_along_axis(others, order[..., n:], -1)
            across = _kinds(across, rounding[..., np.newaxis], is_map)
            kind, attracts = (
                np.where(size_of_family == n, *each)
                for each in zip(across, (kind, attracts), strict=True)
            )
    status = np.select(
        [is_found & ~is_degenerate, is_found, ~has_value],
        [Status.OK, Status.DEGENERATE, Status.NONFINITE],
        Status.NOT_FOUND,
    ).astype(np.int8)

    def tell(which: Any, what: str) -> None:
        if which.any():
            index = first_index(which)
            place = place_in(field.shape, index)
            member = field._of_member(place[0] if len(place) == 1 else place)
            where = f" (first: {spell(index)}{member})" if batch else ""
            warn(f"equilibria: {which.sum()} of {which.size} starts {what}{where}")

    failed = (status < 0) & ~np.isnan(given).any(axis=-1)
    tell(failed, "have no result: f has no value there, or a nearer start is needed")
    tell(is_family, "lead to a family of equilibria, of which a near one is returned")
    tell(is_degenerate & ~is_family, "lead to a multiple root, as at a fold, with 7 digits")
    clocks = {clock for _, f, _ in field._listed_right_hand_sides for clock in f.clocks}
    if clocks := {i for i in clocks if not equations.moving[i]}:
        name = field._layout.components[min(clocks)]
        how = f"which has a constant rate: {name} was held at its start"
        warn(f"equilibria: the equations depend on {name}, {how}; periodic_orbit follows a force")
    kind = np.where(is_found, kind, "")
    return Equilibria(body._layout.leave(x), values, status, attracts & is_found, kind)


def _kinds(values: Any, rounding: Any, is_map: bool) -> tuple[NDArray[np.str_], Any]:
    """Return the kinds of equilibria, and True where they attract, from eigenvalues (..., k).

    Rates of growth up to `rounding` count as 0.
    """
    growth, turns = abs(values) - 1.0 if is_map else values.real, (values.imag != 0).any(axis=-1)
    grows, falls = (growth > rounding).any(axis=-1), (growth < -rounding).any(axis=-1)
    attracts = falls & (growth < -rounding).all(axis=-1)
    one_way, others = np.where(grows, "repelling", "attracting"), np.array("neutral")
    if growth.shape[-1] == 2:
        one_way = np.char.add(one_way, np.where(turns, " focus", " node"))
        others = np.where(turns, "centre", "neutral")
    return np.select([grows & falls, grows | attracts], ["saddle", one_way], others), attracts


def _on_line(direction: FloatArray, x: FloatArray) -> FloatArray:
    """Return the states nearest to x on the line of steady states through 0 along `direction`.

    Newton's method converges slowly to this line, because f is homogeneous: each step halves x.
    """
    square = (direction**2).sum(axis=-1, keepdims=True)
    along = (x * direction).sum(axis=-1, keepdims=True) / square
    return np.where(square > 0, along * direction, x)  # if `square` is 0, all states are steady


class _Equations:
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

    def member(self, index: tuple[int, ...]) -> _Equations:
        """Return the equations of one state, by its index in the batch."""
        field, totals = self.field, self.totals
        if field.shape:
            place = place_in(field.shape, index)
            field, totals = field[place], totals[place] if totals.ndim > 2 else totals
        return _Equations(field, self.x[index], totals, self.moving)

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


def _found(equations: _Equations, f_is_finite: Any) -> tuple[Any, Any, Any, Any]:
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
    """Return the matrix `totals` of `_Equations` from coefficients C (k, terms) of f's terms."""
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


def _eigenvalues(slopes: FloatArray, of_map: bool) -> Any:
    """Return eigenvalues of f', `slopes`; or with f' - 1 of a map the multipliers of the map."""
    known = np.asarray(np.isfinite(slopes).all(axis=(-2, -1)))[..., np.newaxis]
    values = np.linalg.eigvals(np.where(known[..., np.newaxis], slopes, 0.0)).astype(complex)
    values = np.where(known, values + of_map, complex(np.nan, np.nan))
    return eigenvalues_in_order(values, abs(values) if of_map else values.real)
