"""Periodic orbits of motions and of maps, with their Floquet multipliers: `periodic_orbit`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import checks
from ..bodies.base import Body
from ..bodies.classes import BodyOrField
from ..bodies.fields.field_of_terms import FieldOfFunction
from ..checks import FloatArray, integer, short, warn, wrong
from ..engine.starts import checked_settings
from ..keywords import public, with_answers
from ..maps import Method, map_of
from ..quantities.derivatives import vector_field
from . import shooting
from .change import Change
from .changes import checked_changes
from .shooting import OfMap, OfMotion, Shooting

_AT_REST = 1e-6  # part of its size that a state at rest moves in a period
_DIVISORS = 2, 3, 5, 7, 11, 13
_SMALL = 1e-4  # a residual that a larger tolerance may make one of a solution
_NOISES = 30.0  # the residual, at most, that errors of steps explain, in units of such an error
_MOST_ARCS = 32
_ROUGH = 1e-8  # tolerance of the search for a near return
_OF_FORCE = 1e-6  # part of the rates by which those a period later may differ
_NEARER = "a start nearer to it, as flow(system, start, time={T}).x[-1] is if the orbit attracts"
_FAR = 0.1  # of log T, beyond which an orbit away from the start is not the one asked for
_MOST_STEPS, _TRIED = 64, 3  # of a map, after which a start may return, and nearest returns
_SAME = 0.01  # part of a period that is given, by which that of a near return may differ
_FRACTIONS = np.arange(1, 32) / 32  # of the period, at which states are looked at


@with_answers
class PeriodicOrbit(NamedTuple):
    """A periodic orbit: the result of :func:`periodic_orbit`.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, flow, periodic_orbit
    >>> field = QuadraticField.from_function(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> orbit = periodic_orbit(field, [1.0, 2.0], period=6.6)
    >>> motion = flow(field, orbit.state, time=orbit.period, rtol=1e-12)
    >>> bool(abs(motion.x[-1] - orbit.state).max() < 1e-11)
    True
    """

    state: FloatArray
    """A state of the orbit, shape (D,)."""
    period: float
    """The period."""
    multipliers: NDArray[np.complex128]
    """Floquet multipliers, eigenvalues of the derivative of the motion over a period, by modulus.

    Shape (D,), less those of variables of constant rates, such as time, as for
    :func:`lyapunov_exponents`."""
    residual: float
    """How far the end of the orbit, or of one of its arcs, is from the start of the next.

    The largest modulus of a component over that of the states."""


@public
def periodic_orbit(
    system: BodyOrField,
    start: ArrayLike,
    /,
    period: float | None = None,
    *,
    rtol: float = 1e-12,
    changes: Change | Sequence[Change] = (),
    eps: float | None = None,
    steps: int | None = None,
    method: Method | None = None,
) -> PeriodicOrbit:
    """Find a periodic orbit near a state, with its period and (Floquet) multipliers.

    Of the motion, of a map for a step size, by `eps` and `steps`, or of a map for some step size
    near ``period / steps``.

    A system with an integral, such as an energy, has families of periodic orbits, of which it finds
    a member near `start`, not that of its energy: the farther `period` is off, the farther away.

    Newton's method solves for the state and the period together, along the motion as :func:`flow`
    computes it, with its derivatives, by steps of least norm. If derivatives grow much within a
    period, the orbit is divided into arcs that are solved for together (multiple shooting). The
    state that is returned is where the motion is slow if it is much faster at `start`, as on the
    jump of a relaxation cycle. A rest state of a forced system is found, too: its multipliers say
    whether it is stable.

    Parameters
    ----------
    system : QuadraticField, Field, Suslov3D, SuslovGyrostat or SuslovND
        A single field or body.
    start : array_like(float, shape=(D,))
        A state near the orbit.
    period : float, optional
        The approximate period; by default the time after which the motion from `start` returns to
        it nearly. If the equations depend on time, a variable with a constant rate, the period is
        that of the force, which has to be given, and is kept.
    rtol : float
        The tolerance of :func:`flow`. With `steps` the largest residual.
    changes : Change or sequence of Change
        Changes of the state at surfaces, see :class:`Change`: bouncing, walking, spiking cycles.
        The state that is returned lies between two of them.
    eps : float, optional
        With `steps`, and without `period`: the step size of a map, which is kept.
    steps : int, optional
        Find an orbit of a map instead, which so many steps close: of the size `eps`, or with
        `period` of the size ``orbit.period / steps``, which is solved for.
    method : str, optional
        With `steps`, the steps, as in :func:`iterate`; by default "auto" with `eps`, "order8" with
        `period`.

    Returns
    -------
    PeriodicOrbit
        A named tuple of `state` (D,), `period`, `multipliers` and `residual`. The multipliers are
        complex and sorted by decreasing modulus; in conjugate pairs Im > 0 comes first. Unless the
        equations depend on time, one of them is 1 up to the error of the method.

    Raises
    ------
    RuntimeError
        If there is no periodic orbit near `start` and `period`; the message says what was found
        instead: an equilibrium, a motion that ends, or for which `rtol` or `period` there is one.
    TypeError, ValueError
        If an argument is out of range, the system has no steps, or the equations depend on time and
        `period` is left out, or is none of the force.

    Warns
    -----
    UserWarning
        If the period is a multiple of a shorter one, or period and orbit are far from the given
        ones.

    Examples
    --------
    The shortest periodic orbit of Roessler's system, whose period is 5.8810884555:

    >>> from suslov_fast import QuadraticField, iterate, periodic_orbit
    >>> roessler = QuadraticField.from_function(
    ...     lambda x: (-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - 5.7)), 3
    ... )
    >>> orbit = periodic_orbit(roessler, [0.0, -8.4, 0.03])
    >>> round(orbit.period, 9), round(float(orbit.multipliers[0].real), 6)
    (5.881088456, -2.403954)

    A state that 7 steps of Kahan's map of the step size 1 bring back to itself:

    >>> well = QuadraticField.from_hamiltonian(lambda x: (x @ x) / 2 + x[0] ** 3 / 3, "q p")
    >>> orbit = periodic_orbit(well, [0.3, 0.0], eps=1.0, steps=7)
    >>> bool(abs(iterate(well, orbit.state, 1.0, 7).final - orbit.state).max() < 1e-12)
    True
    """
    checks.instance("system", system, Body)
    acting = checked_changes(changes)
    if acting and steps is not None:
        raise wrong("changes", "left out with steps", short(changes), TypeError)
    if any(change.times is not None for change in acting):
        how = "a clock that it resets, Change(lambda s: s[-1] - 24, to=...), makes it periodic"
        raise wrong("changes", "changes at surfaces", f"times: {how}")
    if eps is not None and (steps is None or period is not None):
        raise wrong("eps", "given with steps, and without period", short(eps), TypeError)
    if steps is not None:
        return _result(_of_map(system, start, period, rtol, eps, steps, method))
    if method is not None:
        raise wrong("method", "left out without steps", short(method), TypeError)
    x = _checked_start(system, start)
    checked_settings(system, rtol)
    field = system if isinstance(system, FieldOfFunction) else system.field()
    motion = OfMotion(field, x, rtol, acting)
    T = _checked_period(field, motion, x, period, acting)
    with np.errstate(all="ignore"):
        x = motion.between_changes(x, T)
        search = shooting.found(motion, x, T, rtol, _MOST_ARCS)
        if found := _not_an_orbit(search, T):
            is_alone = period is None or motion.is_forced or acting
            other = None if is_alone else _by_return(field, x, rtol)
            if other is None or abs(other.T / T - 1.0) > _SAME:
                advice = _advice(field, x, period, T, search, other, acting)
                raise RuntimeError(f"periodic_orbit found {found}{advice}")
            search = other
    if abs(np.log(search.T / T)) > _FAR and not shooting.passes(search, x):
        found = f"{search.T:g}, far from {T:g}, and is far from the start"
        warn(f"periodic_orbit: the orbit that was found has the period {found}: pass nearer ones")
    return _result(search)


def _checked_start(system: Any, start: Any) -> FloatArray:
    x = checks.states("start", start, system.labels)
    if system.shape or x.ndim > 1:
        expected = f"called with a single {type(system).__name__} and state"
        received = f"a batch {system.shape or x.shape[:-1]}: call it for system[k], in a loop"
        raise wrong("periodic_orbit", expected, received)
    if not np.isfinite(x).all():
        raise wrong("start", "finite", short(start))
    return np.array(x)


def _checked_period(
    field: Any, motion: OfMotion, x: FloatArray, period: Any, changes: tuple[Change, ...]
) -> float:
    """Return the period that is given, or the time of a near return."""
    if period is not None:
        T = checks.positive("period", period)
        if motion.is_forced and not _is_of_force(field, motion, x, T):
            expected = "a time after which the force is the same, to six digits or more"
            raise wrong("period", expected, period)
        return T
    if motion.is_forced:
        name = field.names[motion.clocks[0]]
        expected = f"given, because the equations depend on {name}, which has a constant rate"
        raise wrong("period", expected, None)
    with np.errstate(all="ignore"):
        near, last = _near_return(field, x, motion.settings.rtol, changes)
    if near is not None:
        return near
    start = short(x.tolist())
    if not motion.rate[~motion.drifts].any():
        raise RuntimeError(f"periodic_orbit: start is the equilibrium {start}")
    found = f"the motion from start = {start} does not return near it until t = {last:g}"
    raise RuntimeError(f"periodic_orbit: {found}: pass period=, or {_NEARER.format(T='T')}")


def _near_return(
    field: Any, x: FloatArray, rtol: float, changes: tuple[Change, ...] = ()
) -> tuple[float | None, float]:
    return shooting.near_return(OfMotion(field, x, max(rtol, _ROUGH), changes), x)


def _is_of_force(field: Any, motion: OfMotion, x: FloatArray, period: float) -> bool:
    """Return whether f and changes are the same a period later, at states of the motion."""
    with np.errstate(all="ignore"):
        states = motion.states(x, period * _FRACTIONS)
    later = states + np.where(motion.drifts, period * motion.rate, 0.0)
    pairs = [tuple(vector_field(field, each).T for each in (states, later))]
    pairs.append(tuple(motion.of_changes(each) for each in (states, later)))
    now, then = (np.concatenate(each) for each in zip(*pairs, strict=True))
    differ = abs(then - now).max(axis=1)
    return not (differ > _OF_FORCE * abs(now).max(axis=1)).any()  # where there is a number


def _of_map(
    system: Any, start: Any, period: Any, rtol: Any, eps: Any, steps: Any, method: Method | None
) -> Shooting:
    """Return the search for an orbit of a map."""
    steps = integer("steps", steps, 1)
    if period is None and eps is None:
        raise wrong("eps", "given with steps, or a period", None)
    name, size = ("period", period) if eps is None else ("eps", eps)
    size = checks.positive(name, size)
    method = method or ("order8" if eps is None else "auto")
    map_of(system, method).require("jacobian", system)
    x, T = _checked_start(system, start), size if eps is None else size * steps
    checked_settings(system, rtol)
    _check_return(system)
    of_map = OfMap(system, vector_field(system, x), steps, method, eps is not None)
    with np.errstate(all="ignore"):
        search = shooting.found(of_map, x, T, rtol, 1)
    if found := _not_an_orbit(search, T):
        far = f"start, {name} = {size:g} or steps = {steps} is too far from an orbit"
        others = _other_steps(of_map, x, size, rtol) if eps is not None else None
        far += f": pass steps={others}" if others else ""
        raise RuntimeError(f"periodic_orbit found {found}: {far}")
    if eps is not None:
        _warn_of_fewer_steps(search, steps)
    return search


def _other_steps(of_map: OfMap, x: FloatArray, eps: float, rtol: float) -> int | None:
    """Return a number of steps that close an orbit near the start, because it was found."""

    def of(steps: int) -> OfMap:
        return OfMap(of_map.field, of_map.rate, steps, of_map.method, True)

    with np.errstate(all="ignore"):
        ((_, states),) = of(_MOST_STEPS).steps(x, _MOST_STEPS * eps)
        nearest = np.argsort(abs(states - x).max(axis=1))  # the first is the start
        for k in [k for k in nearest.tolist() if k > 1][:_TRIED]:
            search = shooting.found(of(k), x, k * eps, rtol, 1)
            if not _not_an_orbit(search, k * eps) and shooting.passes(search, x):
                return int(k)
    return None


def _warn_of_fewer_steps(search: Shooting, steps: int) -> None:
    """Warn if fewer steps of the same size close the orbit."""
    ((_, states),) = search.flow.steps(search.nodes[0], search.T)
    distances = abs(states - states[0]).max(axis=1)
    closed = np.flatnonzero(distances[1:-1] < 1e-6 * distances.max()) + 1
    if len(closed):
        text = f"steps: {steps} close the orbit {steps // closed[0]} times"
        warn(f"{text}; pass steps={closed[0]} for one turn")


def _check_return(field: Any) -> None:
    """Raise an error if a variable has a constant rate, as time has: no orbit of a map returns."""
    if not hasattr(field, "terms"):  # a body
        return
    i, j, k = field.terms[0]
    is_constant = (j == field.dimension) & (k == field.dimension)
    growing = sorted({*i[is_constant].tolist()} - {*i[~is_constant].tolist()})
    if growing:
        name = field.names[growing[0]]
        received = f"one in which {name} grows at a constant rate: leave steps out, for the motion"
        raise wrong("system", "a field whose orbits can return", received)


def _at_rest(search: Shooting, given: float) -> str | None:
    """Return what was found, if it does not move."""
    x, own = search.nodes[0], ~search.drifts
    size, T, state = search.largest, search.T, short(x.tolist())
    rate = abs(search.arcs.rates[:, own]).max(initial=0.0) * len(search.nodes)  # in a period
    is_forced = search.flow.is_forced and search.drifts.any()  # of a map, eps may be kept
    if is_forced or not rate <= _AT_REST * size:
        return None
    if rate * max(given / T, 1.0) <= _AT_REST * size:
        return f"the equilibrium {state}"
    return f"periods that tend to 0 at the state {state}"


def _not_an_orbit(search: Shooting, given: float) -> str | None:
    """Return what was found, if that is no periodic orbit."""
    if (found := _at_rest(search, given)) or search.is_found:
        return found
    if not np.isfinite(search.residual):
        return "no orbit, because the motion from start ends within the period"
    return f"no orbit: the residual is {search.residual:.1e}, not {search.allowed:.1e}"


def _by_return(field: Any, x: FloatArray, rtol: float) -> Shooting | None:
    """Return the search that finds an orbit whose period is the time of a near return."""
    T = _near_return(field, x, rtol)[0]
    if T is None:
        return None
    search = shooting.found(OfMotion(field, x, rtol), x, T, rtol, _MOST_ARCS)
    return None if _not_an_orbit(search, T) else search


def _advice(
    field: Any,
    x: FloatArray,
    period: Any,
    T: float,
    search: Shooting,
    other: Shooting | None,
    changes: tuple[Change, ...],
) -> str:
    """Return why there is no orbit, and arguments with which there is one, because it was found."""
    rtol = search.rtol
    is_near = search.residual < _SMALL and not _at_rest(search, T)
    is_noise = is_near and search.residual <= _NOISES * _noise(field, search, changes)
    if is_noise and (enough := _larger(field, x, T, rtol, changes)) is not None:
        return f", because rtol = {rtol:g} is too tight for this orbit: pass rtol={enough:g}"
    if period is None:
        return ": start is too far from an orbit"
    far = f": start or period = {T:g} is too far from an orbit"
    if search.flow.is_forced and not changes:
        return f"{far}: pass {_NEARER.format(T=f'{100 * T:.10g}')}"
    return f"{far}, or there is none" if other is None else f"{far}: pass period={other.T:.10g}"


def _noise(field: Any, search: Shooting, changes: tuple[Change, ...]) -> float:
    """Return by how much the ends of arcs differ with the steps of another tolerance."""
    other = OfMotion(field, search.nodes[0], 2.0 * search.rtol, changes)
    return search.differs_from(other.arcs(search.nodes, search.T))


def _larger(
    field: Any, x: FloatArray, T: float, rtol: float, changes: tuple[Change, ...] = ()
) -> float | None:
    """Return a larger tolerance with which there is an orbit."""
    while (rtol := float(f"{10 * rtol:.0e}")) < _SMALL:
        motion = OfMotion(field, x, rtol, changes)
        if not _not_an_orbit(shooting.found(motion, x, T, rtol, _MOST_ARCS), T):
            return rtol
    return None


def _result(search: Shooting) -> PeriodicOrbit:
    x, T, own = search.nodes[0], search.T, ~search.drifts
    product = np.eye(int(own.sum()))
    with np.errstate(all="ignore"):
        for slopes in search.arcs.slopes:
            product = slopes[np.ix_(own, own)] @ product
    if not np.isfinite(product).all():
        found = f"an orbit of period {T:g} whose multipliers exceed the range of float64"
        raise RuntimeError(f"periodic_orbit found {found}: call flow for its states")
    if not search.flow.is_forced:
        _warn_of_divisors(search)
    values = np.linalg.eigvals(product).astype(complex)
    order = np.lexsort((-values.imag, -abs(values)))
    return PeriodicOrbit(x, float(T), values[order], search.residual)


def _warn_of_divisors(search: Shooting) -> None:
    """Warn if the orbit returns after a fraction of the period."""
    x, T, own = search.nodes[0], search.T, ~search.drifts
    around = search.arcs.ends if len(search.nodes) > 1 else search.flow.states(x, T * _FRACTIONS)
    extent, turns, found = abs(around - x)[:, own].max(), 1, [1]
    while found:
        turns *= found[-1]
        ends = search.flow.states(x, T / (turns * np.array(_DIVISORS)))
        returns = abs(ends - x)[:, own].max(axis=1) < 1e-6 * extent
        found = [k for k, is_back in zip(_DIVISORS, returns, strict=True) if is_back]
    if turns > 1:
        text = f"period: {T:g} is {turns} times the shorter period {T / turns:g}"
        warn(f"{text}; pass period={T / turns:g} for one turn")
