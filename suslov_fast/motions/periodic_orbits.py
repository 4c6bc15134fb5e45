"""Periodic orbits of motions, with their Floquet multipliers: `periodic_orbit`."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from .. import checks
from ..bodies.systems import System
from ..checks import FloatArray, Reals, StatesLike, short, warn, wrong
from ..core.expressions.linear_terms import coefficients
from ..core.flow.batch_solver import Settings
from ..errors import NoConvergence
from ..fields.constraints import check_constraints, constraints_of
from ..fields.field import Field
from ..fields.map import Map
from ..keywords import public
from ..maps.formulas import eigenvalues_in_order
from ..results.result import place_in
from .event import Event, EventLike
from .events import Derivatives, checked_events, clocked
from .kept_integrals import warn_of_unkept
from .motion_arguments import checked_derivatives, checked_settings, system_of
from .periodic_orbit_results import OrbitDerivatives, PeriodicOrbit, each_of, joined
from .shooting import FieldFlow, Shooting, near_return, nearest_orbit
from .tolerances import (
    CHANGE_OF_STATE_AT_REST,
    DISTANCE_FROM_X0,
    DISTANCE_OF_EQUAL_TURNS,
    FARTHEST_RETURN,
    LEAST_RTOL_OF_SEARCH,
    MOST_TURNS,
    NEUTRAL_MULTIPLIER,
)

_LOOKS = np.arange(1, 512) / 512  # parts of the period, at which the orbit is compared with x0


@public
def periodic_orbit(
    system: System,
    x0: StatesLike,
    /,
    period: Reals | None = None,
    *,
    rtol: float = 1e-12,
    t0: Reals | None = None,
    events: EventLike | Sequence[EventLike] | None = (),
    derivatives: str | Sequence[str] = (),
) -> PeriodicOrbit:
    """Find a periodic orbit near a state, with its period and its Floquet multipliers.

    Newton's method solves for the state and the period together, with the derivatives of the motion
    that :func:`flow` computes. Its steps have the least norm. If derivatives grow much within a
    period, the orbit is divided into arcs that are solved for together (multiple shooting).

    A system with an integral, such as an energy, has families of periodic orbits. Then the result
    is a member of the family near `x0`, usually with another energy; a better `period` leads to a
    nearer member. For a relaxation cycle pass an `x0` where the motion is slow. If a forced system
    has a state of rest, it is a result, too: its multipliers show whether it is stable.

    Parameters
    ----------
    system : Field, Suslov3D, SuslovND or callable
        A field or body, or a function as in :func:`flow`. For a family, or several `x0`, the orbits
        are found one after the other.
    x0 : array_like(float, shape=(..., D))
        A state near the orbit.
    period : array_like(float, shape=(...)), optional
        The approximate period; by default the time after which the motion from `x0` nearly returns
        to it, or, if an orbit attracts it, to a late state. If the equations depend on time, a
        variable with a constant rate, pass the period of the force; it stays fixed.
    rtol : float
        The relative tolerance of :func:`flow`.
    t0 : array_like(float, shape=(...)), optional
        If f takes the time, as f(t, y): the time t at the state, by default 0.
    events : Event, callable or str, or a sequence of these
        Events on surfaces, see :class:`Event`, for cycles that bounce, walk or spike. The returned
        state lies between two events.
    derivatives : str or sequence of str
        Parameters of the field. ``orbit.derivatives["a"].period`` is the derivative of the period
        with respect to a, and ``.state`` of the state; NaN for a member of a family of orbits,
        which parameters do not determine.

    Returns
    -------
    PeriodicOrbit
        A named tuple. Unless the equations depend on time, one multiplier is 1 up to the error of
        the method.

    Raises
    ------
    NoConvergence
        If there is no periodic orbit near `x0` and `period`. The message says what was found
        instead: an equilibrium, or a motion that ends. For a batch it is a warning, and the result
        has NaN there.
    ValueError
        If the equations depend on time and `period` is left out, or is not a period of the force.

    Warns
    -----
    UserWarning
        If `period` is a multiple of the period of the orbit: the result is the orbit for one turn.
        If the orbit neither attracts nor passes near x0: the warning has its period and distance.
        If the orbit belongs to a family: more multipliers are 1 than the flow and the known
        integrals explain. Known integrals are linear ones, and energies of
        `Field.from_hamiltonian` and `Field.from_lagrangian`.

    See Also
    --------
    equilibria : States at rest, and periodic orbits of maps.

    Examples
    --------
    The shortest periodic orbit of Roessler's system has the period 5.8810884555:

    >>> from suslov_fast import Field, periodic_orbit
    >>> roessler = Field(
    ...     lambda x: (-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)), 3
    ... )
    >>> orbit = periodic_orbit(roessler, [0.0, -8.4, 0.03])
    >>> round(orbit.period, 9), round(float(orbit.multipliers[0].real), 6)
    (5.881088456, -2.403954)

    The cycles of a family, and by how much the period changes with the parameter:

    >>> van_der_pol = Field(
    ...     lambda x, mu: (x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]), "x v", mu=[0.5, 1.0]
    ... )
    >>> cycles = periodic_orbit(van_der_pol, [2.0, 0.0], derivatives="mu")
    >>> cycles.period.round(6), cycles.derivatives["mu"].period.round(6)
    (array([6.380676, 6.663287]), array([0.387055, 0.731597]))
    """
    body: Any = system_of(system, x0)
    if isinstance(body, Map):
        how = "equilibria(Map(lambda x: f(f(x)), names), near=x0) finds those of period 2"
        raise TypeError(f"system: a Map has no flow: its periodic orbits are fixed points, {how}")
    acting = checked_events(events)
    if any(event.times is not None for event in acting):
        how = "a clock that it resets, Event(lambda s: s[-1] - 24, to=...), makes it periodic"
        raise wrong("events", "events at surfaces", f"times: {how}")
    names = _checked_names(body, derivatives)
    body = clocked(body, acting)
    x = body._layout.enter("x0", x0, t0)
    T: Any = None if period is None else checks.real_number("period", period)
    shapes = {"system": body.shape, "x0": x.shape[:-1], "period": np.shape(T)}
    batch = checks.common_shape(shapes)
    if not batch:
        return _orbit(body, x, T, rtol, acting, names)

    def member(index: tuple[int, ...]) -> PeriodicOrbit | None:
        one = body[place_in(body.shape, index)] if body.shape else body
        start = np.broadcast_to(x, (*batch, x.shape[-1]))[index]
        if np.isnan(start).any():
            return None
        time = None if T is None else float(np.broadcast_to(T, batch)[index])
        return _orbit(one, start, time, rtol, acting, names)

    return joined(batch, [*each_of(batch, member)], body._layout, names)


def _orbit(
    body: Any,
    x: FloatArray,
    period: float | None,
    rtol: float,
    acting: tuple[Event, ...],
    names: tuple[str, ...],
) -> PeriodicOrbit:
    """Return the orbit of a single system near the state x of the engine; or raise an error."""
    if not np.isfinite(x).all():
        raise wrong("x0", "finite", short(body._layout.leave(x).tolist()))
    check_constraints(body, x)
    x = np.array(x)
    settings = checked_settings(body, rtol)
    field = body._field
    motion = FieldFlow(field, x, settings, acting)
    with np.errstate(all="ignore"):
        T, near = _checked_period(field, motion, x, period, acting)
        if near is not x:
            motion = FieldFlow(field, near, settings, acting)
        start = motion.between_events(near, T)
        search = _nearer_turn(nearest_orbit(motion, start, T), start, T)
        if near is not x:
            search = _doubled(search, start, T)
        if found := _not_an_orbit(search, T):
            how = "an x0 nearer to the orbit, a nearer period, or a larger rtol"
            raise NoConvergence(f"periodic_orbit found {found}: pass {how}")
        search = _one_turn(search)
        acts = any(event.to is not None for event in acting)  # events may change integrals of f
        orbit = _result(search, 0 if acts else _integrals(body))
        # Integrals may change near x0 alone, if the result is at rest.
        ends = motion.ends(np.stack([x, orbit.state]), search.T)
        warn_of_unkept(ends, (2,), since=body._layout.times(x))
        orbit = orbit._replace(
            state=body._layout.leave(orbit.state), derivatives=_derivatives(search, names)
        )
        if not (orbit.stable or motion.is_forced):  # attractors, forced orbits may be far from x0
            _warn_of_distance(search, x)
    return orbit


def _checked_names(system: Any, derivatives: Any) -> tuple[str, ...]:
    names = checked_derivatives(system, derivatives)
    if "x0" in names:
        raise wrong("derivatives", "parameters: an orbit does not depend on x0", "'x0'")
    if names and constraints_of(system._field):
        raise wrong("derivatives", "left out for a field with constraints", short(names))
    return names


def _derivatives(search: Shooting, names: tuple[str, ...]) -> dict[str, OrbitDerivatives]:
    """Return derivatives of an orbit by name; NaN and a warning if it is a member of a family."""
    if not names:
        return Derivatives()
    of_state, of_T = search.by_parameters(names)
    if search.freedom > (not search.flow.is_forced):
        warn(
            "periodic_orbit: no derivatives, because parameters do not determine a member of a "
            "family; an event or a damping that selects one does"
        )
        of_state, of_T = of_state + np.nan, of_T + np.nan
    columns = search.flow.field._layout.leave(of_state.T)
    return Derivatives(
        (name, OrbitDerivatives(float(of_T[k]), columns[k])) for k, name in enumerate(names)
    )


def _checked_period(
    field: Any, motion: FieldFlow, x: FloatArray, period: Any, events: tuple[Event, ...]
) -> tuple[float, FloatArray]:
    """Return the period and a start near the orbit: the given ones, or from the motion.

    Without a period it is the time after which the motion from x nearly returns; or, if it does not
    return to x but to a later state, as it tends to an orbit, the time for this state.
    """
    if period is not None:
        T = checks.positive("period", period)
        if motion.is_forced and not motion.has_force_of(x, T):
            expected = "a time after which the force is the same, to six digits or more"
            raise wrong("period", expected, period)
        return T, x
    if motion.is_forced:
        name = field._layout.components[motion.clocks[0]]
        expected = f"given, because the equations depend on {name}, which has a constant rate"
        raise wrong("period", expected, None)
    rough = FieldFlow(field, x, Settings(max(motion.settings.rtol, LEAST_RTOL_OF_SEARCH)), events)
    near, last = near_return(rough, x)
    if near is not None:
        return near, x
    start = f"x0 = {_text(field, x)}"
    if not motion.rate[~motion.drifts].any():
        raise NoConvergence(f"periodic_orbit: {start} is an equilibrium")
    if (rest := _rest(field, motion, x, last)) is not None:
        found = f"the motion from {start} falls to the equilibrium {_text(field, rest)}"
        raise NoConvergence(f"periodic_orbit: {found}: pass an x0 nearer to an orbit")
    late = rough.states(x, [last])[0]
    if np.isfinite(late).all():
        rough = FieldFlow(field, late, rough.settings, events)
        near, _ = near_return(rough, late)
        if near is not None:
            return near, late
    found = f"the motion from {start} does not return near it until t = {last:g}"
    raise NoConvergence(f"periodic_orbit: {found}: pass period=, or an x0 nearer to an orbit")


def _doubled(search: Shooting, start: FloatArray, T: float) -> Shooting:
    """Return arcs of an orbit that attracts, of the period T, 2 T or 4 T; else the given arcs.

    If an orbit attracts the motion to `start`, an orbit that repels lies beside one of twice the
    period.
    """
    for m in (1, 2, 4):
        each = search if m == 1 else nearest_orbit(search.flow, start, m * T)
        product = functools.reduce(lambda first, then: then @ first, each.slopes)
        exists = each.closes and np.isfinite(product).all()
        if exists and abs(np.linalg.eigvals(product)).max() < 1.0 + NEUTRAL_MULTIPLIER:
            return each
    return search


def _text(field: Any, x: FloatArray) -> str:
    return short(field._layout.leave(x).tolist())


def _rest(field: Any, motion: FieldFlow, x: FloatArray, last: float) -> FloatArray | None:
    """Return the state if the motion from x is at rest at the time `last`, else None."""
    moving = ~motion.drifts
    end = motion.states(x, [last])[0]
    rate = abs(field._value(end))[moving].max()
    # At this rate `end` would move, until the time 2 `last`, by a small part of its way from x.
    is_at_rest = rate * last <= CHANGE_OF_STATE_AT_REST * abs(end - x)[moving].max()
    return (
        np.where(abs(end) <= CHANGE_OF_STATE_AT_REST * abs(x).max(), 0.0, end)
        if is_at_rest
        else None
    )


def _not_an_orbit(search: Shooting, given: float) -> str | None:
    """Return what a search from the period `given` found in place of an orbit, or None."""
    state, least = search.nodes[0], CHANGE_OF_STATE_AT_REST * search.largest
    state = _text(
        search.flow.field,
        np.where(abs(state) <= CHANGE_OF_STATE_AT_REST * search.sizes, 0.0, state),
    )
    rate = abs(search.rates).max(initial=0.0) * len(search.nodes)  # per period
    if rate <= least and not search.flow.is_forced:  # the orbit does not move
        if rate * max(given / search.T, 1.0) <= least:
            return f"the equilibrium {state}"
        return f"periods that tend to 0 at the state {state}"
    if search.closes:
        return None
    if not np.isfinite(search.residual):
        return "no orbit, because the motion from x0 ends within the period"
    return f"no orbit: the residual is {search.residual:.1e}, not {search.allowed:.1e}"


def _nearer_turn(search: Shooting, start: FloatArray, T: float) -> Shooting:
    """Return arcs of one turn if T is several turns of an orbit that passes nearer to the start.

    Errors of T and of the start grow over several turns of an unstable orbit, so that Newton's
    method may lead to another orbit.
    """
    flow = search.flow
    if flow.is_forced:
        return search
    turns = np.arange(MOST_TURNS, 1, -1)
    ways = abs(flow.states(start, T / turns) - start)[:, search.moving] / search.units
    for m in turns[(ways < FARTHEST_RETURN).all(axis=1)]:
        one = nearest_orbit(flow, start, T / m)
        if not _not_an_orbit(one, one.T) and 2 * _away(one, start) < _away(search, start):
            _warn_of_turns(one, int(m))
            return one
    return search


def _away(search: Shooting, start: FloatArray) -> float:
    """Return the distance of the first node from a state, or infinity if there is no orbit."""
    if not search.closes:
        return np.inf
    return float((abs(search.nodes[0] - start)[search.moving] / search.units).max())


def _warn_of_turns(one: Shooting, m: int) -> None:
    which = f"an orbit {m} times around: one turn, of period {one.T:.9g}, is returned"
    warn(f"periodic_orbit found {which}")


def _one_turn(search: Shooting) -> Shooting:
    """Return the arcs, or if they are several turns of an orbit, arcs of one turn and a warning."""
    flow, x = search.flow, search.nodes[0]
    if flow.is_forced:
        return search
    turns = np.arange(MOST_TURNS, 1, -1)
    ways = abs(flow.states(x, search.T / turns) - x)[:, search.moving] / search.units
    for m in turns[(ways < DISTANCE_OF_EQUAL_TURNS).all(axis=1)]:
        one = nearest_orbit(flow, x, search.T / m)
        if not _not_an_orbit(one, one.T):
            _warn_of_turns(one, int(m))
            return one
    return search


def _warn_of_distance(search: Shooting, x0: FloatArray) -> None:
    """Warn if the orbit does not pass near x0."""
    moving, x = search.moving, search.nodes[0]
    states = np.vstack([x, search.flow.states(x, search.T * _LOOKS)])[:, moving]
    ranges = np.ptp(states, axis=0)
    ways = abs(states - x0[moving]) / np.maximum(ranges, 1e-3 * ranges.max())
    nearest = ways.max(axis=1).argmin()
    if ways[nearest].max() > DISTANCE_FROM_X0:
        far = np.linalg.norm(states[nearest] - x0[moving])
        passes = f"an orbit of period {search.T:.4g} that passes x0 at a distance of {far:.2g}"
        warn(f"periodic_orbit found {passes}: pass an x0 or a period nearer to those that you want")


def _result(search: Shooting, known: int | None) -> PeriodicOrbit:
    """Return the orbit; warn if it is in a larger family than the `known` integrals explain."""
    product = np.eye(len(search.moving))
    for slopes in search.slopes:
        product = slopes @ product
    if not np.isfinite(product).all():
        found = f"an orbit of period {search.T:g} whose multipliers exceed the range of float64"
        raise NoConvergence(f"periodic_orbit found {found}: call flow for its states")
    product = search.within_constraints(product)
    trivial = (known or 0) + (not search.flow.is_forced)
    if known is not None and search.freedom > trivial:
        why = "the equations conserve something, so near orbits are periodic, too"
        how = "if states are a force, write it as a function of the time, in f(t, x)"
        warn(f"periodic_orbit found a member of a family, which x0 and period choose: {why}; {how}")
    values = np.linalg.eigvals(product).astype(complex)
    others = values[np.argsort(abs(values - 1.0))][trivial:]
    is_stable = bool((abs(others) < 1.0 - NEUTRAL_MULTIPLIER).all())
    return PeriodicOrbit(
        search.nodes[0],
        float(search.T),
        eigenvalues_in_order(values, abs(values)),
        search.residual,
        is_stable,
    )


def _integrals(system: Any) -> int | None:
    """Return the number of known integrals of a field; None for a body, which has further ones."""
    if not isinstance(system, Field):
        return None
    energy = system._is_hamiltonian or _keeps_energy(system)
    if constraints_of(system):
        return int(energy)
    [(_, f, table)] = system._listed_right_hand_sides
    moving = [i for i in range(f.D) if i not in f.steady]
    [C] = coefficients(f, table)[:, moving]
    linear = len(moving) - int(np.linalg.matrix_rank(C, tol=1e-12)) if C.size else len(moving)
    return linear + energy


def _keeps_energy(field: Field) -> bool:
    """Return True if the equations conserve the energy of a mechanical system."""
    if "energy" not in field._quantities:
        return False
    try:
        field.conserving()
    except ValueError:  # the energy changes, by a force or a constraint that moves
        return False
    return True
