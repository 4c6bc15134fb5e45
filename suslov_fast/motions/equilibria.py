"""Equilibria of fields near given states, and fixed points of maps: their states and kinds."""

from __future__ import annotations

from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from ..bodies.systems import System
from ..checks import FloatArray, StatesLike, common_shape, first_index, short, spell, warn
from ..fields.html import html_table
from ..fields.map import Map
from ..fields.mechanics import near_constraints
from ..fields.names import labels
from ..keywords import lacking, public
from ..maps.formulas import eigenvalues_in_order
from ..results.result import place_in
from ..status import Status
from .equations_at_rest import EquationsAtRest, found_from
from .motion_arguments import system_of
from .tolerances import (
    MOST_STARTS_COUNTED,
    NEUTRAL_RATE,
    NEUTRAL_RATE_IF_SINGULAR,
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
        equations = EquationsAtRest(field, x)
        has_value = np.isfinite(field._value(x)).all(axis=-1) & np.isfinite(x).all(axis=-1)
        y, is_found, is_degenerate, is_family = found_from(equations, has_value & ~has_line)
        y = np.where(has_line[..., np.newaxis], equations.start, y)
        is_found = np.where(has_line, has_value, is_found)
        is_degenerate, is_family = is_degenerate & ~has_line, is_family & ~has_line
        x = np.where(is_found[..., np.newaxis], equations.whole(y), np.nan)
        doubts = is_degenerate, is_family, has_line
        values, kind, attracts = _stability(field, x, y, equations, doubts, is_map)
    status = np.select(
        [is_found & ~is_degenerate, is_found, ~has_value],
        [Status.OK, Status.DEGENERATE, Status.NONFINITE],
        Status.NOT_FOUND,
    ).astype(np.int8)
    failed = (status < 0) & ~np.isnan(given).any(axis=-1)
    _warn(field, batch, failed, is_family, is_degenerate)
    _warn_of_clocks(field, equations)
    kind = np.where(is_found, kind, "")
    return Equilibria(body._layout.leave(x), values, status, attracts & is_found, kind)


def _stability(
    field: Any, x: FloatArray, y: FloatArray, equations: Any, doubts: Any, is_map: bool
) -> tuple[Any, Any, Any]:
    """Return eigenvalues, kinds and where equilibria attract, at states x with variables y.

    `doubts` tell where y is degenerate, where it is in a family, and where on a line of these.
    """
    is_degenerate, is_family, has_line = doubts
    slopes = field._slopes(x)[..., equations.moving, :][..., equations.moving]
    slopes = equations.on_constraints(x, slopes)
    values = _eigenvalues(slopes, is_map)
    others = _eigenvalues(equations.without_totals(slopes, is_map), is_map)
    size = abs(slopes).max(axis=(-2, -1), initial=0.0) + is_map
    at_start = abs(equations.slopes(equations.start)).max(axis=(-2, -1), initial=0.0) + is_map
    is_member = is_family | (has_line & (size > 0.0))
    double = NEUTRAL_RATE_IF_SINGULAR * np.fmax(size, at_start)
    rounding = np.where(is_degenerate | is_member, double, NEUTRAL_RATE * size)[..., np.newaxis]
    kind, attracts = _kinds(others, rounding, is_map)
    order, zeros = abs(others - is_map).argsort(axis=-1), abs(others - is_map)
    zeros = (zeros <= rounding).sum(axis=-1)
    size_of_family = np.array(is_member, int)
    for index in map(tuple, np.argwhere(is_family & (zeros > 1))):
        size_of_family[index] = equations.member(index).size_of_family(y[index])
    for n in range(1, size_of_family.max(initial=0) + 1):  # all but the n nearest to 0
        across: Any = np.take_along_axis(others, order[..., n:], -1)
        across = _kinds(across, rounding, is_map)
        kind, attracts = (
            np.where(size_of_family == n, *each)
            for each in zip(across, (kind, attracts), strict=True)
        )
    return values, kind, attracts


def _warn(
    field: Any, batch: tuple[int, ...], failed: Any, is_family: Any, is_degenerate: Any
) -> None:
    """Warn of starts without a result, in families of equilibria, and at multiple roots."""
    for which, what in (
        (failed, "have no result: f has no value there, or a nearer start is needed"),
        (is_family, "lead to a family of equilibria, of which a near one is returned"),
        (is_degenerate & ~is_family, "lead to a multiple root, as at a fold, with 7 digits"),
    ):
        if which.any():
            index = first_index(which)
            place = place_in(field.shape, index)
            member = field._of_member(place[0] if len(place) == 1 else place)
            where = f" (first: {spell(index)}{member})" if batch else ""
            warn(f"equilibria: {which.sum()} of {which.size} starts {what}{where}")


def _warn_of_clocks(field: Any, equations: EquationsAtRest) -> None:
    """Warn if the equations depend on a variable of constant rate."""
    clocks = {clock for _, f, _ in field._listed_right_hand_sides for clock in f.clocks}
    if clocks := {i for i in clocks if not equations.moving[i]}:
        name = field._layout.components[min(clocks)]
        how = f"which has a constant rate: {name} was held at its start"
        warn(f"equilibria: the equations depend on {name}, {how}; periodic_orbit follows a force")


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


def _eigenvalues(slopes: FloatArray, of_map: bool) -> Any:
    """Return eigenvalues of f', `slopes`; or with f' - 1 of a map the multipliers of the map."""
    known = np.asarray(np.isfinite(slopes).all(axis=(-2, -1)))[..., np.newaxis]
    values = np.linalg.eigvals(np.where(known[..., np.newaxis], slopes, 0.0)).astype(complex)
    values = np.where(known, values + of_map, complex(np.nan, np.nan))
    return eigenvalues_in_order(values, abs(values) if of_map else values.real)
