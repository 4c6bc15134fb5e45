"""Periodic orbits of motions, with their Floquet multipliers: `periodic_orbit`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies.systems import System
from ..checks import FloatArray, StatesLike, short, warn, wrong
from ..core.expressions.linear_terms import coefficients
from ..errors import NoConvergence
from ..fields.field import Field, system_of
from ..fields.html import html_table
from ..fields.map import Map
from ..keywords import lacking, public
from . import shooting
from .event import Event
from .events import checked_events
from .motion_arguments import checked_settings
from .shooting import OfMotion, Shooting

_AT_REST = 1e-6  # part of its size that a state at rest moves in a period
_NEUTRAL = 1e-6  # from 1, within which a modulus of a multiplier decides nothing
_TURNS, _AGAIN = 12, 1e-6  # of an orbit in a period, at most; how near they are, in its ranges
_FAR = 0.5  # distance from x0, in ranges of the orbit, above which it is told
_ROUGH = 1e-8  # tolerance of the search for a near return
_LOOKS = np.arange(1, 512) / 512  # parts of the period, at which it is looked at
_NEARER = "an x0 nearer to it, as flow(system, x0, time={T}).final is if the orbit attracts"


class PeriodicOrbit(NamedTuple):
    """A periodic orbit: the result of :func:`periodic_orbit`.

    Examples
    --------
    >>> from suslov_fast import Field, flow, periodic_orbit
    >>> field = Field.from_hamiltonian(lambda x: (x[0]**2 + x[1]**2) / 2 + x[0]**3, "q p")
    >>> orbit = periodic_orbit(field, [0.1, 0.0], period=6.3)
    >>> motion = flow(field, orbit.state, time=orbit.period, rtol=1e-12)
    >>> bool(abs(motion.states[-1] - orbit.state).max() < 1e-11)
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
    """Distance from the end of the orbit, or of one of its arcs, to the start of the next arc.

    The largest modulus of a component, divided by the largest one of the states."""
    stable: bool
    """True if the orbit attracts: moduli of nontrivial multipliers are below 1 - 1e-6.

    Trivial is one multiplier 1 of the flow, unless the equations depend on time, and one for each
    known integral; none is known with events that change states."""

    def __getattr__(self, name: str) -> NoReturn:
        times = "np.linspace(0, orbit.period, 200)"
        here = f"flow(system, orbit.state, time={times}).states" if name == "states" else ""
        raise lacking(self, name, here)

    def _repr_html_(self) -> str:
        return html_table("PeriodicOrbit", ["", "value"], self._asdict().items())


@public
def periodic_orbit(
    system: System,
    x0: StatesLike,
    /,
    period: float | None = None,
    *,
    rtol: float = 1e-12,
    events: Event | Sequence[Event] | None = (),
) -> PeriodicOrbit:
    """Find a periodic orbit near a state, with its period and (Floquet) multipliers.

    A system with an integral, such as an energy, has families of periodic orbits. The result is a
    member near `x0`, usually with another energy. The nearer `period`, the nearer the member.

    Newton's method solves for the state and the period together, along the motion as :func:`flow`
    computes it, with its derivatives, by steps of least norm. If derivatives grow much within a
    period, the orbit is divided into arcs that are solved for together (multiple shooting). On a
    relaxation cycle `x0` should lie where the motion is slow. A rest state of a forced system is
    found, too: its multipliers say whether it is stable.

    Parameters
    ----------
    system : Field, Suslov3D, SuslovND or callable
        A single field or body, or a function as in :func:`flow`.
    x0 : array_like(float, shape=(D,))
        A state near the orbit.
    period : float, optional
        The approximate period; by default the time after which the motion from `x0` returns to
        it nearly. If the equations depend on time, a variable with a constant rate, pass the
        period of the force, which is kept.
    rtol : float
        The tolerance of :func:`flow`.
    events : Event or sequence of Event
        Events at surfaces, see :class:`Event`: bouncing, walking, spiking cycles.
        The state that is returned lies between two of them.

    Returns
    -------
    PeriodicOrbit
        A named tuple of `state` (D,), `period`, `multipliers`, `residual` and `stable`. They are
        complex and sorted by decreasing modulus; in conjugate pairs Im > 0 comes first. Unless the
        equations depend on time, one of them is 1 up to the error of the method.

    Raises
    ------
    NoConvergence
        If there is no periodic orbit near `x0` and `period`; the message says what was found
        instead: an equilibrium, or a motion that ends.
    TypeError, ValueError
        If an argument is out of range, the system has no steps, or the equations depend on time and
        `period` is left out, or is no period of the force.

    Warns
    -----
    UserWarning
        If `period` is a multiple of the period of the orbit, which is returned. If the orbit
        neither attracts nor passes near x0: with its period and its distance. If the orbit is a
        member of a family: more multipliers are 1 than the flow and known integrals explain: the
        Hamiltonian of `Field.from_hamiltonian`, and linear integrals.

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
    """
    body: Any = system_of(system, x0)
    if isinstance(body, Map):
        how = "equilibria(Map(lambda x: f(f(x)), names), near=x0) finds those of period 2"
        raise TypeError(f"system: a Map has no flow: its periodic orbits are fixed points, {how}")
    acting = checked_events(events)
    if any(event.times is not None for event in acting):
        how = "a clock that it resets, Event(lambda s: s[-1] - 24, to=...), makes it periodic"
        raise wrong("events", "events at surfaces", f"times: {how}")
    x = _checked_start(body, x0)
    checked_settings(body, rtol)
    field = body._field
    motion = OfMotion(field, x, rtol, acting)
    T = _checked_period(field, motion, x, period, acting)
    with np.errstate(all="ignore"):
        search = shooting.found(motion, motion.between_changes(x, T), T)
        if found := _not_an_orbit(search, T):
            how = "an x0 nearer to the orbit, a nearer period, or a larger rtol"
            raise NoConvergence(f"periodic_orbit found {found}: pass {how}")
    search = _one_turn(search)
    acts = any(event.to is not None for event in acting)  # they may change what f keeps
    orbit = _result(search, 0 if acts else _integrals(body))
    if not (orbit.stable or search.flow.is_forced):  # where x0, or the force, may lead to it
        _warn_of_distance(search, x)
    return orbit


def _checked_start(system: Any, x0: Any) -> FloatArray:
    x = checks.states("x0", x0, system._labels)
    if system.shape or x.ndim > 1:
        expected = f"called with a single {type(system).__name__} and state"
        received = f"a batch {system.shape or x.shape[:-1]}: call it for system[k], in a loop"
        raise wrong("periodic_orbit", expected, received)
    if not np.isfinite(x).all():
        raise wrong("x0", "finite", short(x0))
    return np.array(x)


def _checked_period(
    field: Any, motion: OfMotion, x: FloatArray, period: Any, events: tuple[Event, ...]
) -> float:
    """Return the given period, or the time after which the motion from x nearly returns."""
    if period is not None:
        T = checks.positive("period", period)
        with np.errstate(all="ignore"):
            if motion.is_forced and not motion.has_force_of(x, T):
                expected = "a time after which the force is the same, to six digits or more"
                raise wrong("period", expected, period)
        return T
    if motion.is_forced:
        name = field.names[motion.clocks[0]]
        expected = f"given, because the equations depend on {name}, which has a constant rate"
        raise wrong("period", expected, None)
    with np.errstate(all="ignore"):
        rough = OfMotion(field, x, max(motion.settings.rtol, _ROUGH), events)
        near, last = shooting.near_return(rough, x)
    if near is not None:
        return near
    start = f"x0 = {short(x.tolist())}"
    if not motion.rate[~motion.drifts].any():
        raise NoConvergence(f"periodic_orbit: {start} is an equilibrium")
    if (rest := _rest(field, motion, x, last)) is not None:
        found = f"the motion from {start} falls to the equilibrium {short(rest.tolist())}"
        raise NoConvergence(f"periodic_orbit: {found}: pass an x0 nearer to an orbit")
    found = f"the motion from {start} does not return near it until t = {last:g}"
    raise NoConvergence(f"periodic_orbit: {found}: pass period=, or {_NEARER.format(T='T')}")


def _rest(field: Any, motion: OfMotion, x: FloatArray, last: float) -> FloatArray | None:
    """Return the state at which the motion from x rests at the time `last`, or None."""
    own = ~motion.drifts
    with np.errstate(all="ignore"):
        end = motion.states(x, np.array([last]))[0]
        rate = abs(field(end))[own].max()
    # In the time until then, such a rate moves it by less than a part of its way.
    is_at_rest = rate * last <= _AT_REST * abs(end - x)[own].max()
    return np.where(abs(end) <= _AT_REST * abs(x).max(), 0.0, end) if is_at_rest else None


def _not_an_orbit(search: Shooting, given: float) -> str | None:
    """Return what was found, as text, or None for a periodic orbit; `given` is the T asked for."""
    x, own, T = search.nodes[0], ~search.drifts, search.T
    state, least = short(x.tolist()), _AT_REST * search.largest
    rate = abs(search.rates[:, own]).max(initial=0.0) * len(search.nodes)  # in a period
    if rate <= least and not search.flow.is_forced:  # it does not move
        if rate * max(given / T, 1.0) <= least:
            return f"the equilibrium {state}"
        return f"periods that tend to 0 at the state {state}"
    if search.is_found:
        return None
    if not np.isfinite(search.residual):
        return "no orbit, because the motion from x0 ends within the period"
    return f"no orbit: the residual is {search.residual:.1e}, not {search.allowed:.1e}"


def _one_turn(search: Shooting) -> Shooting:
    """Return arcs of one turn of an orbit that is found several times around, with a warning."""
    flow, x, own = search.flow, search.nodes[0], ~search.drifts
    turns = np.arange(_TURNS, 1 if not flow.is_forced else _TURNS, -1)
    with np.errstate(all="ignore"):
        ways = abs(flow.states(x, search.T / turns) - x) / search.sizes
        for m in turns[(ways[:, own] < _AGAIN).all(axis=1)]:
            one = shooting.found(flow, x, search.T / m)
            if one.is_found and not _not_an_orbit(one, one.T):
                which = f"an orbit {m} times around: one turn, of period {one.T:.9g}, is returned"
                warn(f"periodic_orbit found {which}")
                return one
    return search


def _warn_of_distance(search: Shooting, x0: FloatArray) -> None:
    """Warn if an orbit passes x0 far away."""
    own, x = ~search.drifts, search.nodes[0]
    with np.errstate(all="ignore"):
        states = np.vstack([x, search.flow.states(x, search.T * _LOOKS)])[:, own]
    ranges = np.ptp(states, axis=0)
    ways = abs(states - x0[own]) / np.maximum(ranges, 1e-3 * ranges.max())
    nearest = ways.max(axis=1).argmin()
    if ways[nearest].max() > _FAR:
        far = np.linalg.norm(states[nearest] - x0[own])
        passes = f"an orbit of period {search.T:.4g} that passes x0 at a distance of {far:.2g}"
        warn(f"periodic_orbit found {passes}: pass an x0 or a period nearer to those that you want")


def _result(search: Shooting, known: int | None) -> PeriodicOrbit:
    x, T, own = search.nodes[0], search.T, ~search.drifts
    product = np.eye(int(own.sum()))
    with np.errstate(all="ignore"):
        for slopes in search.slopes:
            product = slopes[np.ix_(own, own)] @ product
    if not np.isfinite(product).all():
        found = f"an orbit of period {T:g} whose multipliers exceed the range of float64"
        raise NoConvergence(f"periodic_orbit found {found}: call flow for its states")
    _warn_of_families(search, known)
    values = np.linalg.eigvals(product).astype(complex)
    order = np.lexsort((-values.imag, -abs(values)))
    of_flow = 0 if search.flow.is_forced else 1
    others = values[np.argsort(abs(values - 1.0))][of_flow + (known or 0) :]
    is_stable = bool((abs(others) < 1.0 - _NEUTRAL).all())
    return PeriodicOrbit(x, float(T), values[order], search.residual, is_stable)


def _integrals(system: Any) -> int | None:
    """Return the number of known integrals of a field; None for a body, which has others."""
    if not isinstance(system, Field):
        return None
    [(_, f, table)] = system._listed_right_hand_sides
    own = [i for i in range(f.D) if i not in f.steady]
    [C] = coefficients(f, table)[:, own]
    linear = len(own) - int(np.linalg.matrix_rank(C, tol=1e-12)) if C.size else len(own)
    return linear + system._is_hamiltonian


def _warn_of_families(search: Shooting, known: int | None) -> None:
    """Warn if the orbit has a family that the integrals, `known` in number, do not explain."""
    phase = 0 if search.flow.is_forced else 1
    if known is None or search.freedom <= phase + known:
        return
    why = "the equations conserve something, so near orbits are periodic, too"
    how = "if states are a force, write it as a function of a time t with t' = 1"
    warn(f"periodic_orbit found a member of a family, which x0 and period choose: {why}; {how}")
