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
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.expressions.event_formulas import EventAction
from ..core.flow.batch_solver import Settings, SolverRequest
from ..fields.right_hand_sides import with_events
from .event import Event
from .events import actions_of, event_times_of
from .integration import SolverResult, to_tolerance
from .sensitivities import Columns, WithColumns

_ROUNDS, _HALVINGS = 60, 10
# Singular values below this part of the largest one, or below the residual, are directions along a
# family of orbits, of which a system with an integral has one for each of its values.
_LEAST = 1e-8
_LONGEST = 0.3  # step of log T
_CORRECTIONS, _LEAST_CHANGE = 5, 1e-6  # of T before Newton's steps, relative to it
_ARCS = 1, 4, 16  # that are tried
_GROWTH = 1e3  # of derivatives along an arc, above which an orbit is found again with more arcs
# The residual that is a solution, in units of rtol and of how much derivatives grow.
_NOISE, _MOST_RESIDUAL = 10.0, 1e-9
_LEAST_SIZE = 2.0**-20  # of the largest size, in which residuals are measured
_ROUNDING = 2.0**-49  # of T, which shows where states event fast
_STRONG = 1e3  # weight of the equation that keeps the phase
_LOOKS = 512  # states of a motion that are looked at
_OF_FORCE = 1e-6  # part of changes of states by which those a period later may differ
_FRACTIONS = np.arange(1, 32) / 32  # of the period, at which forces are compared
# The longest time until a near return, in units of |x / f(x)|, and how often it is halved for the
# first look.
_LAST, _DOUBLINGS = 2.0**16, 28
_INSIDE = np.arange(33) / 32  # parts of the time from look to look, where a return is looked for
# Of the extent of an orbit: what is not looked at, what is near, and what is far from the start.
_FAR, _NEAR, _AWAY = 1.0, 0.1, 0.5
_LATEST = 4.0  # times of the first near return until which the nearest one is looked for


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
        self._event_times = self._listed = None
        self._moving = field
        actions: tuple[EventAction, ...] = ()
        if events:
            actions, self._event_times = actions_of(field, events), event_times_of(events, 1, ())
            self._moving = WithColumns(field.shape, with_events(field, actions))
            self._listed = with_events(field, actions, (), True)
        (_, f, _), *_ = self._listed or field._listed_right_hand_sides
        self.rate = field(start)
        parts = f.events.components if f.events else ()
        changed = {i for own in parts for i in own}  # which do not only drift
        self.drifts = np.isin(np.arange(f.D), [i for i in f.steady if i not in changed])
        read = {*f.clocks}.union(*(action.read() for action in actions))
        self.clocks = [i for i in np.flatnonzero(self.drifts & (self.rate != 0.0)) if i in read]
        self.is_forced = bool(self.clocks)

    def _solved(
        self, field: Any, x: FloatArray, times: Any, settings: Settings | None = None
    ) -> SolverResult:
        settings = settings or self.settings
        request = SolverRequest(np.asarray(times), 1, settings, event_times=self._event_times)
        return to_tolerance(field, x, (len(x),), request)

    def arcs(self, nodes: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
        """Return the ends (M, D) of arcs from nodes, and their derivatives (M, D, D) by these."""
        own = nodes, (len(nodes),), True, (), self.settings, self._listed
        columns = Columns(self.field, *own)
        found = self._solved(columns.field, columns.starts, [duration], columns.settings)
        (ends,), (slopes,) = columns.parted(found.states)
        return ends, slopes

    def states(self, x: FloatArray, times: Any) -> FloatArray:
        """Return the states (n, D) of the motion from x at times, all 0 or later."""
        return self._solved(self._moving, x[np.newaxis], times).states[:, 0]

    def has_force_of(self, x: FloatArray, period: float) -> bool:
        """Return True if `period` is a period of the force: motions a period later are the same."""
        own = ~self.drifts
        states = self.states(x, period * _FRACTIONS)
        later = states + np.where(self.drifts, period * self.rate, 0.0)
        now, then = (
            self._solved(self._moving, each, [period / 32]).states[0, :, own]
            for each in (states, later)
        )
        change = abs(now - states[:, own].T).max(axis=1, keepdims=True)
        return not (abs(then - now) > _OF_FORCE * change).any()  # where there is a number

    def between_changes(self, x: FloatArray, T: float) -> FloatArray:
        """Return the state in the middle of the longest time without events, from x to time 2 T.

        An orbit from a state on a surface would end before the event or after it.
        """
        if not self.keeps_phase:
            return x
        found = self._solved(self._moving, x[np.newaxis], [2.0 * T])
        assert found.records is not None
        times = np.concatenate([[0.0], np.unique(found.records.in_order().time), [2.0 * T]])
        k = int(np.diff(times).argmax())
        middle: FloatArray = self.states(x, [0.5 * (times[k] + times[k + 1])])[0]
        return middle if np.isfinite(middle).all() else x


class Shooting:
    """Arcs from nodes (M, D), of the duration T together.

    ends    (M, D), NaN where an arc has none; the gaps are `ends` less the next nodes
    slopes  (M, D, D), derivatives of the ends by the nodes
    rates   (M, D), derivatives of the ends by log T
    sizes   (D,), ranges of components, in which lengths of steps are measured
    """

    def __init__(self, flow: OfMotion, nodes: FloatArray, T: float, sizes: FloatArray) -> None:
        self.flow, self.nodes, self.T, self.sizes = flow, nodes, T, sizes
        self.drifts = flow.drifts
        self.ends, self.slopes = flow.arcs(nodes, T / len(nodes))
        self.rates = flow.field(self.ends) * (T / len(nodes))
        self.gaps = self.ends - np.roll(nodes, -1, axis=0)
        self.gaps[:, self.drifts] = 0.0
        largest = float(abs(nodes[:, ~self.drifts]).max(initial=0.0))
        # At rest in 0, as parametric forces allow, only the sizes say what is small.
        self.largest = max(largest, _LEAST_SIZE * float(sizes[~self.drifts].max(initial=0.0)))
        residual = abs(self.gaps).max() / self.largest
        self.residual = float(residual) if np.isfinite(residual) else np.inf
        distance = np.linalg.norm(self.gaps / sizes)  # what a short enough step reduces
        self.distance = float(distance) if np.isfinite(distance) else np.inf

    @property
    def growth(self) -> float:
        """The factor by which differences of states, in units of their sizes, grow along an arc."""
        scaled = self.slopes * self.sizes / self.sizes[:, np.newaxis]
        scaled = scaled[:, ~self.drifts][:, :, ~self.drifts]
        norm = np.sqrt((scaled**2).sum(axis=(1, 2))).max()
        return float(max(norm, 1.0)) if np.isfinite(norm) else np.inf

    @property
    def allowed(self) -> float:
        """The largest residual with which arcs count as an orbit."""
        rtol = self.flow.settings.rtol
        most = max(_MOST_RESIDUAL, _NOISE * rtol)
        rates = self.rates[:, ~self.drifts] * len(self.nodes)
        of_T = float(abs(rates).max() / self.largest)
        return max(min(_NOISE * rtol * self.growth, most), _ROUNDING * of_T)

    @property
    def is_found(self) -> bool:
        return self.residual <= self.allowed

    def _matrix(self) -> FloatArray:
        """Return the derivative of the gaps by the nodes and log T, all in units of the sizes."""
        M = len(self.nodes)
        own = np.flatnonzero(~self.drifts)
        n, sizes = len(own), self.sizes[own]
        matrix = np.zeros((M, n, M * n + 1))
        for k in range(M):
            slopes = self.slopes[k][np.ix_(own, own)]
            matrix[k, :, k * n : (k + 1) * n] += slopes * sizes
            following = (k + 1) % M * n
            matrix[k, :, following : following + n] -= np.diag(sizes)
            if not self.flow.is_forced:
                matrix[k, :, -1] = self.rates[k, own]
        return (matrix / sizes[:, np.newaxis]).reshape(M * n, -1)

    @property
    def freedom(self) -> int:
        """The number of independent changes of nodes, and of a free T, that keep gaps closed."""
        matrix = self._matrix()[:, : -1 if self.flow.is_forced else None]
        values = np.linalg.svd(matrix, compute_uv=False)
        rank = int((values > _LEAST * values[0]).sum())
        return matrix.shape[1] - rank

    def _step(self) -> tuple[FloatArray, float]:
        """Return changes of nodes and log T by a damped Newton step; NaN without derivatives."""
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
        change = np.zeros((M, D))
        change[:, own] = step[:-1].reshape(M, n) * sizes
        return change, float(np.clip(step[-1], -_LONGEST, _LONGEST))

    def _improved(self) -> Shooting:
        """Return arcs after a step, or a fraction of it, with smaller gaps; else these arcs."""
        change, of_T = self._step()
        for k in range(_HALVINGS):
            nodes, T = self.nodes + change / 2**k, self.T * float(np.exp(of_T / 2**k))
            if np.isfinite(nodes).all() and np.isfinite(T):
                other = Shooting(self.flow, nodes, T, self.sizes)
                if other.distance < self.distance:
                    return other
        return self

    def with_period(self) -> Shooting:
        """Return an arc of the time T at which the orbit of the start passes nearest to the start.

        A system with several integrals has nearby orbits of all periods, turned against each other.
        Newton's steps would rather turn a Kepler ellipse than correct a period.
        """
        best = self
        for _ in range(0 if self.flow.is_forced or self.flow.keeps_phase else _CORRECTIONS):
            rate, gap = (a[0, ~self.drifts] for a in (best.rates, best.gaps))
            change = -(rate @ gap) / (rate @ rate)
            if not _LEAST_CHANGE < abs(change) < 0.5:  # false for NaN
                break
            other = Shooting(self.flow, self.nodes, best.T * float(1.0 + change), self.sizes)
            if not other.distance < best.distance:
                break
            best = other
        return best

    def solved(self) -> Shooting:
        """Return arcs after steps that make the gaps smaller."""
        best = self
        for _ in range(_ROUNDS):
            before, best = best, best._improved()
            is_slow = before.is_found and best.distance > before.distance / 2
            if best is before or is_slow:
                break
        return best


def found(flow: OfMotion, x: FloatArray, T: float) -> Shooting:
    """Return arcs that form an orbit near x with a period near T, or came nearest to one.

    More arcs are tried if one arc finds no orbit, or derivatives grow much along it.
    """
    sizes, best = _sizes(flow, x, T), None
    for M in _ARCS:
        nodes = flow.states(x, np.arange(M) * (T / M)) if M > 1 else x[np.newaxis]
        if not np.isfinite(nodes).all():
            break
        search = Shooting(flow, nodes, T, sizes)
        if M == 1:
            search = search.with_period()
            T = search.T
        search = search.solved()
        if best is None or search.is_found or search.residual < best.residual:
            best = search
        if search.is_found:
            x, T = search.nodes[0], search.T
            if search.growth <= _GROWTH:
                break
    assert best is not None
    return best


def _sizes(flow: OfMotion, start: FloatArray, T: float) -> FloatArray:
    """Return the range of each component during T; lengths of steps are measured in ranges."""
    states = flow.states(start, T * np.arange(1, _LOOKS + 1) / _LOOKS)
    own = ~flow.drifts
    sizes = np.ptp(np.vstack([start, states[np.isfinite(states).all(axis=1)]]), axis=0)
    if not sizes[own].any():
        sizes = abs(start)
    largest = sizes[own].max(initial=0.0) or 1.0
    return np.maximum(np.where(own, sizes, 0.0), _LEAST_SIZE * largest)


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
    longest = _LAST * float(size or 1.0) / fastest
    extent, until = np.zeros(own.sum()), np.inf
    best: tuple[float, float | None] = _NEAR, None
    for begin, end in itertools.pairwise([0.0, *(longest * 2.0 ** np.arange(-_DOUBLINGS, 1.0))]):
        times = np.linspace(begin, end, _LOOKS)
        states = flow.states(start, times)
        ways = states[:, own] - start[own]
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
                return best[1], end
            if distances[nearest] < (0.7 if best[1] else 1.0) * best[0]:
                best, until = (float(distances[nearest]), t), min(until, _LATEST * t)
            if best[0] < _NEAR / 10:
                return best[1], end
        if end > until:
            break
    return best[1], end
