"""Newton's method for periodic orbits: arcs that must join (multiple shooting).

M arcs of equal duration T / M start at nodes x_k. The unknowns are the nodes and log T, the
equations

Phi(x_k) - x_k+1 = 0,    where x_M = x_0,

for all components except those of constant rates. There are fewer equations than unknowns, and
families of solutions if the system has integrals. A step is the shortest one that solves the linear
equations.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.expressions.event_formulas import EventAction
from ..core.expressions.numpy_evaluation import evaluate
from ..core.flow.batch_solver import Settings, SolverRequest
from ..core.flow.single_steps import attempts
from ..fields.right_hand_sides import with_events
from .event import Event
from .events import actions_of, event_times_of
from .flow import to_tolerance
from .integration import SolverResult
from .sensitivities import Columns, WithColumns

_ROUNDS, _HALVINGS = 60, 10
# Singular values below this part of the largest one, or below the residual, are directions along a
# family of orbits, of which a system with an integral has one for each of its values.
_LEAST = 1e-8
_LONGEST = 0.3  # step of log T
_CORRECTIONS, _LEAST_CHANGE = 5, 1e-6  # of T before Newton's steps, relative to it
_ARCS = 1, 4, 16  # that are tried
# Of derivatives: above which an orbit is found again with more arcs, and that along one of these.
_GROWTH, _GROWTH_OF_ARC = 1e3, 30.0
# The residual that is a solution, in units of rtol and of how much derivatives grow.
_NOISE, _MOST_RESIDUAL = 10.0, 1e-9
_LEAST_SIZE = 2.0**-20  # of the largest size, in which residuals are measured
_ROUNDING = 2.0**-49  # of T, which shows where states event fast
_STRONG = 1e3  # weight of the equation that keeps the phase
# States at which a motion with events is looked at, and how often that time is doubled.
_LOOKS, _DOUBLINGS = 512, 12
_FAST = 10.0  # how much faster a start is than the state at which a search begins instead
_AROUND = 1 / 16  # of the period before and after a state, in which it is the slowest


@dataclass
class Arcs:
    """The ends of arcs from nodes (M, D)."""

    nodes: FloatArray
    T: float
    ends: FloatArray  # (M, D), NaN where an arc has none
    slopes: FloatArray  # (M, D, D), derivatives of the ends by the nodes
    rates: FloatArray  # (M, D), derivatives of the ends by log T


class OfMotion:
    """Arcs of the motion of a field, to a tolerance, with events on surfaces.

    drifts       components of constant rates
    is_forced    True if T is fixed, because other components depend on one of `drifts`
    keeps_phase  True if steps keep the fastest component of the first node, as with events
    """

    def __init__(
        self, field: Any, start: FloatArray, rtol: float, events: tuple[Event, ...] = ()
    ) -> None:
        self.field, self.settings = field, Settings(rtol)
        self.keeps_phase = bool(events)
        self._event_times = self._moving = self._listed = None
        actions: tuple[EventAction, ...] = ()
        if events:
            actions, self._event_times = actions_of(field, events), event_times_of(events, 1, ())
            self._moving = WithColumns(field.shape, with_events(field, actions))
            self._listed = with_events(field, actions, (), True)
        (_, f, table), *_ = self._listed or field._listed_right_hand_sides
        self.rate = field(start)
        parts = f.events.components if f.events else ()
        changed = {i for own in parts for i in own}  # which do not only drift
        self.drifts = np.isin(np.arange(f.D), [i for i in f.steady if i not in changed])
        read = {*f.clocks}.union(*(action.read() for action in actions))
        self.clocks = [i for i in np.flatnonzero(self.drifts & (self.rate != 0.0)) if i in read]
        self.is_forced = bool(self.clocks)
        self._actions, self._parameters = actions, table[0, : f.events.P] if f.events else ()

    def _solved(
        self, field: Any, x: FloatArray, times: FloatArray, settings: Settings
    ) -> SolverResult:
        return to_tolerance(
            field, x, (len(x),), SolverRequest(times, 1, settings, event_times=self._event_times)
        )

    def arcs(self, nodes: FloatArray, T: float) -> Arcs:
        M = len(nodes)
        columns = Columns(self.field, nodes, (M,), True, (), self.settings, self._listed)
        times = np.array([T / M])
        found = self._solved(columns.field, columns.starts, times, columns.settings)
        (ends,), (slopes,) = columns.parted(found.states)
        rates: FloatArray = self.field(ends) * (T / M)
        return Arcs(nodes, T, ends, slopes, rates)

    def states(self, x: FloatArray, times: Any) -> FloatArray:
        """Return the states (n, D) at times, all 0 or later."""
        moving = self._moving or self.field
        return self._solved(moving, x[np.newaxis], times, self.settings).states[:, 0]

    def of_changes(self, states: FloatArray) -> FloatArray:
        """Return values of surfaces, and new values of components that do not drift, (-, n)."""
        found = [np.empty((0, len(states)))]
        for action in self._actions:
            for list_ in filter(None, (action.surface, action.to)):
                values = dict(enumerate([*states.T, *self._parameters]))
                evaluate(list_.operations, values)
                results = [a if isinstance(a, float) else values[a] for a in list_.results]
                own = ~self.drifts if list_ is action.to else [True]
                parts = [a for a, is_own in zip(results, own, strict=True) if is_own]
                found.append(np.array(np.broadcast_arrays(*parts, states[:, 0]))[:-1])
        return np.concatenate(found)

    def between_changes(self, x: FloatArray, T: float) -> FloatArray:
        """Return the state in the middle of the longest time without an event, in two periods.

        An orbit from a state on a surface would end before the event or after it.
        """
        if self._moving is None:
            return x
        found = self._solved(self._moving, x[np.newaxis], np.array([2.0 * T]), self.settings)
        assert found.records is not None
        times = np.unique(found.records.time)
        if not len(times):
            return x
        following = np.append(times[1:], times[-1] + T)
        k = int((np.minimum(following, times + T) - times).argmax())
        end = min(following[k], times[k] + T)
        middle: FloatArray = self.states(x, np.array([0.5 * (times[k] + end)]))[0]
        return middle if np.isfinite(middle).all() else x

    def steps(self, x: FloatArray, last: float) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Yield times and states (n, D) at the ends of steps; each begins with the last one before.

        If there are events, the times are equally spaced instead, in parts that double in length.
        """
        if self._moving is not None:
            ends = [0.0, *(last * 2.0 ** np.arange(-_DOUBLINGS, 1.0))]
            for begin, end in itertools.pairwise(ends):
                times = np.linspace(begin, end, _LOOKS)
                yield times, self.states(x, times)
            return
        (_, f, table), *_ = self.field._right_hand_sides
        tried = attempts(f, table[0], x, last, self.settings)
        found, tries = [next(tried)], 0
        while tries < _MOST and (some := [*itertools.islice(tried, max(_STEPS, tries))]):
            found, tries = [found[-1], *some], tries + len(some)
            t, steps, states = map(np.array, zip(*found, strict=True))
            is_taken = np.diff(steps, prepend=-1.0) > 0.0
            yield t[is_taken], states[is_taken]


class Shooting:
    """A search that begins with arcs from nodes (M, D)."""

    def __init__(
        self, flow: OfMotion, nodes: FloatArray, T: float, rtol: float, sizes: FloatArray
    ) -> None:
        self.flow, self.rtol, self.drifts, self.sizes = flow, rtol, flow.drifts, sizes
        self._go_to(nodes, T)

    def _go_to(self, nodes: FloatArray, T: float) -> None:
        self._take(self.flow.arcs(nodes, T))

    def _take(self, arcs: Arcs) -> None:
        self.arcs, self.T, self.nodes = arcs, arcs.T, arcs.nodes
        gaps = arcs.ends - np.roll(arcs.nodes, -1, axis=0)
        gaps[:, self.drifts] = 0.0
        self.gaps = gaps
        largest = float(abs(arcs.nodes[:, ~self.drifts]).max(initial=0.0))
        # At rest in 0, as parametric forces allow, only the sizes say what is small.
        self.largest = max(largest, _LEAST_SIZE * float(self.sizes[~self.drifts].max(initial=0.0)))
        residual = abs(gaps).max() / self.largest
        self.residual = float(residual) if np.isfinite(residual) else np.inf
        distance = np.linalg.norm(gaps / self.sizes)  # what a short enough step reduces
        self.distance = float(distance) if np.isfinite(distance) else np.inf

    @property
    def growth(self) -> float:
        """The factor by which differences of states, in units of their sizes, grow along an arc."""
        scaled = self.arcs.slopes * self.sizes / self.sizes[:, np.newaxis]
        scaled = scaled[:, ~self.drifts][:, :, ~self.drifts]
        norm = np.sqrt((scaled**2).sum(axis=(1, 2))).max()
        return float(max(norm, 1.0)) if np.isfinite(norm) else np.inf

    @property
    def allowed(self) -> float:
        """The largest residual of a solution."""
        most = max(_MOST_RESIDUAL, _NOISE * self.rtol)
        rates = self.arcs.rates[:, ~self.drifts] * len(self.nodes)
        of_T = float(abs(rates).max() / self.largest)
        return max(min(_NOISE * self.rtol * self.growth, most), _ROUNDING * of_T)

    @property
    def is_found(self) -> bool:
        return self.residual <= self.allowed

    def _matrix(self) -> FloatArray:
        """Return the derivative of the gaps by the nodes and log T, in units of the sizes."""
        M = len(self.nodes)
        own = np.flatnonzero(~self.drifts)
        n, sizes = len(own), self.sizes[own]
        matrix = np.zeros((M, n, M * n + 1))
        for k in range(M):
            slopes = self.arcs.slopes[k][np.ix_(own, own)]
            matrix[k, :, k * n : (k + 1) * n] += slopes * sizes
            following = (k + 1) % M * n
            matrix[k, :, following : following + n] -= np.diag(sizes)
            if not self.flow.is_forced:
                matrix[k, :, -1] = self.arcs.rates[k, own]
        return (matrix / sizes[:, np.newaxis]).reshape(M * n, -1)

    @property
    def freedom(self) -> int:
        """The number of directions of nodes and T that keep gaps closed, including the phase.

        If T is given, it is no direction.
        """
        matrix = self._matrix()[:, : -1 if self.flow.is_forced else None]
        values = np.linalg.svd(matrix, compute_uv=False)
        rank = int((values > _LEAST * values[0]).sum())
        return matrix.shape[1] - rank

    def _step(self) -> tuple[FloatArray, float]:
        """Return the step of the nodes and of log T."""
        M, D = self.nodes.shape
        own = np.flatnonzero(~self.drifts)
        n, sizes = len(own), self.sizes[own]
        matrix = self._matrix()
        right = (-self.gaps[:, own] / sizes).ravel()
        if self.flow.keeps_phase and not self.flow.is_forced:
            row = np.zeros((1, matrix.shape[1]))
            rate = self.flow.field(self.nodes[0])[own] / sizes
            row[0, abs(rate).argmax()] = _STRONG
            matrix, right = np.concatenate([matrix, row]), np.append(right, 0.0)
        if not np.isfinite(matrix).all():
            return np.full((M, D), np.nan), np.nan
        left, values, rows = np.linalg.svd(matrix, full_matrices=False)
        # Levenberg and Marquardt's step, which is Newton's but for small singular values.
        damping = (_LEAST * values[0]) ** 2 + right @ right
        step = (values / (values**2 + damping) * (right @ left)) @ rows
        event = np.zeros((M, D))
        event[:, own] = step[:-1].reshape(M, n) * sizes
        return event, float(np.clip(step[-1], -_LONGEST, _LONGEST))

    def _improve(self) -> bool:
        """Take a step, or a fraction of it; return True if the gaps became smaller."""
        before, distance = self.arcs, self.distance
        event, of_T = self._step()
        for k in range(_HALVINGS):
            nodes, T = before.nodes + event / 2**k, before.T * float(np.exp(of_T / 2**k))
            if np.isfinite(nodes).all() and np.isfinite(T):
                self._go_to(nodes, T)
                if self.distance < distance:
                    return True
        self._take(before)
        return False

    def correct_period(self) -> None:
        """Change T to the time at which the orbit of the start passes nearest to the start.

        A system with several integrals has nearby orbits of all periods, turned against each other.
        Newton's steps would rather turn a Kepler ellipse than correct a period.
        """
        for _ in range(0 if self.flow.is_forced or self.flow.keeps_phase else _CORRECTIONS):
            before, distance = self.arcs, self.distance
            rate, gap = (a[0, ~self.drifts] for a in (before.rates, self.gaps))
            event = -(rate @ gap) / (rate @ rate)
            if not _LEAST_CHANGE < abs(event) < 0.5:  # false for NaN
                break
            self._go_to(before.nodes, before.T * float(1.0 + event))
            if not self.distance < distance:
                self._take(before)
                break

    def search(self) -> bool:
        """Take steps while the gaps become smaller; return True if they are those of a solution."""
        for _ in range(_ROUNDS):
            was_found, last = self.is_found, self.distance
            if not self._improve() or (was_found and self.distance > last / 2):
                break
        return self.is_found


def found(flow: OfMotion, start: FloatArray, T: float, rtol: float, most: int) -> Shooting:
    """Return a search with at most `most` arcs that found an orbit, or came nearest.

    If states change fast, the rounding of T alone is a residual, and Newton's steps change the
    phase. So a search begins at the slowest state of the motion, if that is far slower. If it finds
    nothing, or an orbit elsewhere, a search begins at the start itself.
    """
    sizes, slowest = _sizes_and_slowest(flow, start, T)
    if slowest is None:
        return _found(flow, start, T, rtol, most, sizes)
    first = _found(flow, slowest, T, rtol, most, sizes)
    if first.is_found and passes(first, start):
        return first
    second = _found(flow, start, T, rtol, most, sizes)
    return second if second.is_found or second.residual < first.residual else first


def _found(
    flow: OfMotion, start: FloatArray, T: float, rtol: float, most: int, sizes: FloatArray
) -> Shooting:
    best = None
    for M in _ARCS:
        if most < M:
            break
        nodes = flow.states(start, np.arange(M) * (T / M)) if M > 1 else start[np.newaxis]
        if not np.isfinite(nodes).all():
            break
        search = Shooting(flow, nodes, T, rtol, sizes)
        if M == 1:
            search.correct_period()
            T = search.T
        search.search()
        if best is None or search.is_found or search.residual < best.residual:
            best = search
        if search.is_found:
            break
    assert best is not None
    if best.is_found and best.growth > _GROWTH and len(best.nodes) < most:
        x, T = best.nodes[0], best.T
        M = int(min(np.ceil(len(best.nodes) * np.log(best.growth) / np.log(_GROWTH_OF_ARC)), most))
        nodes = flow.states(x, np.arange(M) * (T / M))
        if np.isfinite(nodes).all():
            search = Shooting(flow, nodes, T, rtol, sizes)
            best = search if search.search() else best
    return best


def _sizes_and_slowest(
    flow: OfMotion, start: FloatArray, T: float
) -> tuple[FloatArray, FloatArray | None]:
    """Return the ranges of components, as units of the lengths of steps, and the slowest state.

    The slowest state is None if the start is nearly as slow, or the phase is given.
    """
    parts = [*flow.steps(start, T)]
    times = np.concatenate([each for each, _ in parts])
    states = np.concatenate([each for _, each in parts])
    finite = np.isfinite(states).all(axis=1)
    own = ~flow.drifts
    sizes = np.ptp(np.vstack([start, states[finite]]), axis=0)
    if not sizes[own].any():
        sizes = abs(start)
    largest = sizes[own].max(initial=0.0) or 1.0
    sizes = np.maximum(np.where(own, sizes, 0.0), _LEAST_SIZE * largest)
    if flow.is_forced or flow.keeps_phase or not finite.all():
        return sizes, None
    speeds = (abs(flow.field(states)) / sizes)[:, own].max(axis=1)
    # As if the motion were periodic, the largest speed within a part of the period.
    around = np.concatenate([speeds, speeds, speeds])
    places = np.concatenate([times - T, times, times + T])
    first = np.searchsorted(places, times - _AROUND * T)
    last = np.searchsorted(places, times + _AROUND * T, "right")
    fastest = np.array([around[i:j].max() for i, j in zip(first, last, strict=True)])
    k = int(fastest.argmin())
    return sizes, states[k] if fastest[k] < fastest[0] / _FAST else None


def passes(search: Shooting, start: FloatArray) -> bool:
    """Return True if the orbit of a search passes near a state."""
    own = ~search.drifts
    states = np.vstack([each for _, each in search.flow.steps(search.nodes[0], search.T)])
    way = ((states - start) / search.sizes)[:, own]
    chord = np.diff(way, axis=0)
    length = (chord**2).sum(axis=1)
    with np.errstate(all="ignore"):
        part = np.clip(-(way[:-1] * chord).sum(axis=1) / length, 0.0, 1.0)
    nearest = way[:-1] + np.where(length > 0.0, part, 0.0)[:, np.newaxis] * chord
    return bool(np.sqrt((nearest**2).mean(axis=1)).min() < _NEAR)


# ------------------------------------------------------------------------------------ near returns
# Steps of the first look, and those of all looks; the longest time, in units of |x / f(x)|, and
# that with events.
_STEPS, _MOST, _LAST, _LAST_WITH_OF_EVENTS = 64, 2**14, 2.0**30, 2.0**11
_PARTS = 4  # of a step, at whose ends distances are compared
_INSIDE = np.arange(33) / 32  # parts of two of these, where a return is looked for
# Of the extent of an orbit: what is not looked at, what is near, and what is far from the start.
_FAR, _NEAR, _AWAY = 1.0, 0.1, 0.5
_LATEST = 4.0  # times of the first near return until which the nearest one is looked for


def near_return(flow: OfMotion, start: FloatArray) -> tuple[float | None, float]:
    """Return the time after which the motion of the start returns near it, or None.

    The other result is the time up to which it was sought. A return is a state that is nearer to
    the start than the states before and after it, once the motion was far away. (The plane through
    the start that is normal to f need not be crossed: a start may lie beyond the orbit.)
    """
    own = ~flow.drifts
    fastest, size = float(abs(flow.rate[own]).max()), abs(start[own]).max()
    if fastest == 0.0:
        return None, 0.0
    longest = _LAST_WITH_OF_EVENTS if flow.keeps_phase else _LAST
    longest *= float(size or 1.0) / fastest
    extent, last, until = np.zeros(own.sum()), 0.0, np.inf
    best: tuple[float, float | None] = _NEAR, None
    for times, states in flow.steps(start, longest):
        if not flow.keeps_phase:  # steps may be long, and f may jump at their ends
            parts = np.arange(len(times) * _PARTS - _PARTS + 1) / _PARTS
            times = np.interp(parts, np.arange(len(times)), times)
            states = flow.states(states[0], times - times[0])
        ways, last = states[:, own] - start[own], float(times[-1])
        before = np.maximum(extent, np.maximum.accumulate(abs(ways)))
        extent = before[-1]
        scale = np.where(extent > 0.0, extent, 1.0)
        was_away = (before / scale).max(axis=1) > _AWAY
        distance = np.sqrt(((ways / scale) ** 2).mean(axis=1))
        near = distance < _FAR
        recedes = np.append(np.diff(distance) >= 0.0, True)
        returns = ~recedes[:-1] & recedes[1:] & (near[:-1] | near[1:]) & was_away[:-1]
        for k in np.flatnonzero(returns).tolist():
            first, length = 0.0, times[min(k + 2, len(times) - 1)] - times[k]
            for _ in range(2):  # closer around the nearest point
                inside = first + length * _INSIDE
                found = (flow.states(states[k], inside)[:, own] - start[own]) / scale
                distances = np.sqrt((found**2).mean(axis=1))
                nearest = int(distances.argmin())
                first, length = inside[max(nearest - 1, 0)], length / 16
            t = float(times[k] + inside[nearest])
            if t > until:
                return best[1], last
            if distances[nearest] < (0.7 if best[1] else 1.0) * best[0]:
                best, until = (float(distances[nearest]), t), min(until, _LATEST * t)
            if best[0] < _NEAR / 10:
                return best[1], last
        if last > until:
            break
    return best[1], last
