"""Newton's method for periodic orbits: arcs that must join (multiple shooting).

M arcs of equal duration T / M start at nodes x_k, and Phi maps a node to the end of its arc. The
unknowns are the nodes and log T. The equations are

Phi(x_k) - x_k+1 = 0,    where x_M = x_0,

for all components without a constant rate. They are fewer than the unknowns; if the system has
integrals, solutions form families. Of all steps that solve the linear equations, Newton's method
takes the shortest. Nodes stay on constraints of mechanics: steps are tangent, then nodes are
projected.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.flow.batch_solver import Settings, SolverRequest
from ..core.hybrid.event_formulas import components_of
from ..fields.constraints import constraints_of
from ..fields.mechanics import near_constraints
from ..fields.right_hand_sides import with_events
from .event import Event
from .events import actions_of, event_times_of
from .integration import Ends, SolverResult, to_tolerance
from .sensitivities import with_derivatives
from .tangent_spaces import block_diagonal, tangent_basis, within
from .tolerances import (
    CHANGE_OF_PERIODIC_FORCE,
    DOUBLINGS_OF_SEARCH,
    FARTHEST_FROM_CLOSED_ARCS,
    FARTHEST_REFINED_RETURN,
    GROWTH_OF_ARC,
    LARGEST_RESIDUAL,
    LATEST_NEARER_RETURN,
    LEAST_CORRECTION_OF_PERIOD,
    LEAST_UNIT,
    LEFT_START,
    LONGEST_SEARCH,
    LONGEST_STEP_OF_PERIOD,
    MOST_CORRECTIONS_OF_PERIOD,
    MOST_HALVINGS,
    MOST_ROUNDS_OF_NEWTON,
    NEAR_RETURN,
    NOISE_OF_RESIDUAL,
    ROUNDING_OF_PERIOD,
    STATES_OF_ORBIT,
    WEIGHT_OF_PHASE,
    ZERO_OF_NEWTON,
)

_ARCS = 1, 4, 16  # numbers of arcs that are tried in this order
_FRACTIONS = np.arange(1, 32) / 32  # parts of the period at which forces are compared
_INSIDE = np.arange(33) / 32  # fractions of an interval at which a search for a return is refined


class FieldFlow:
    """The motion of a field, to a tolerance, with events on surfaces.

    drifts       True for components with a constant rate (D,)
    is_forced    True if T is fixed, because other components depend on one that drifts
    keeps_phase  True with events: unless T is fixed, Newton's method keeps the fastest component of
                 the first node, so that the node stays between the same events
    """

    def __init__(
        self, field: Any, start: FloatArray, settings: Settings, events: tuple[Event, ...]
    ) -> None:
        self.field, self.settings = field, settings
        self.keeps_phase = bool(events)
        self._actions = actions_of(field, events)
        self._event_times = event_times_of(events, 1, ()) if events else None
        [(_, f, _)] = self._groups = with_events(field, self._actions)
        self.rate = field._value(start)
        changed = {i for action in self._actions for i in components_of(action)}
        self.drifts = np.isin(np.arange(f.D), [i for i in f.steady if i not in changed])
        read = {*f.clocks}.union(*(action.read() for action in self._actions))
        self.clocks = [i for i in np.flatnonzero(self.drifts & (self.rate != 0.0)) if i in read]
        self.is_forced = bool(self.clocks)

    def _request(self, times: Any) -> SolverRequest:
        return SolverRequest(np.asarray(times), 1, self.settings, event_times=self._event_times)

    def _solved(self, x: FloatArray, times: Any) -> SolverResult:
        """Return the motions from x (B, D) at times, all 0 or later."""
        return to_tolerance(self._groups, self.field.shape, x, (len(x),), self._request(times))

    def arcs(self, nodes: FloatArray, duration: float) -> tuple[FloatArray, FloatArray]:
        """Return the ends (M, D) of arcs from nodes, and the derivatives (M, D, D) of the ends."""
        request, batch = self._request([duration]), (len(nodes),)
        result = with_derivatives(self.field, nodes, batch, ("x0",), request, self._actions)
        return result.states[0], result.derivatives[0]

    def arcs_by(
        self, nodes: FloatArray, duration: float, parameters: tuple[str, ...]
    ) -> FloatArray:
        """Return the derivatives (M, D, P) of the ends of arcs with respect to parameters."""
        request, batch = self._request([duration]), (len(nodes),)
        result = with_derivatives(self.field, nodes, batch, parameters, request, self._actions)
        return np.asarray(result.derivatives[0])

    def states(self, x: FloatArray, times: Any) -> FloatArray:
        """Return the states (n, D) of the motion from x at times, all 0 or later."""
        return self._solved(x[np.newaxis], times).states[:, 0]

    def ends(self, x: FloatArray, time: float) -> Ends:
        """Return the `Ends` of the motions from x (B, D) over a time."""
        return self._solved(x, [time]).all_ends

    def has_force_of(self, x: FloatArray, period: float) -> bool:
        """Return True if `period` is a period of the force: a motion a period later is the same."""
        moving = ~self.drifts
        states = self.states(x, period * _FRACTIONS)
        later = states + np.where(self.drifts, period * self.rate, 0.0)
        now, then = (
            self._solved(each, [period / 32]).states[0, :, moving] for each in (states, later)
        )
        change = abs(now - states[:, moving].T).max(axis=1, keepdims=True)
        return not (
            abs(then - now) > CHANGE_OF_PERIODIC_FORCE * change
        ).any()  # NaN is no difference

    def between_events(self, x: FloatArray, T: float) -> FloatArray:
        """Return the state in the middle of the longest time without events, from x to time 2 T.

        An orbit that started on a surface could end before or after the event there.
        """
        if not self.keeps_phase:
            return x
        result = self._solved(x[np.newaxis], [2.0 * T])
        assert result.records is not None
        times = np.concatenate([[0.0], np.unique(result.records.in_order().time), [2.0 * T]])
        k = int(np.diff(times).argmax())
        middle: FloatArray = self.states(x, [0.5 * (times[k] + times[k + 1])])[0]
        return middle if np.isfinite(middle).all() else x


class Shooting:
    """Arcs from nodes (M, D), which take the time T together.

    sizes   ranges (D,) of components along the orbit, which are the units of steps

    Of the n components that do not drift:
    gaps    ends of arcs minus the next nodes (M, n), NaN where an arc has no end
    slopes  derivatives (M, n, n) of the ends with respect to the nodes
    rates   derivatives (M, n) of the ends with respect to log T
    units   their `sizes` (n,)
    """

    def __init__(self, flow: FieldFlow, nodes: FloatArray, T: float, sizes: FloatArray) -> None:
        self.flow, self.nodes, self.T, self.sizes = flow, nodes, T, sizes
        self.moving = np.flatnonzero(~flow.drifts)
        ends, slopes = flow.arcs(nodes, T / len(nodes))
        self.slopes = slopes[:, self.moving][:, :, self.moving]
        self.rates = flow.field._value(ends)[:, self.moving] * (T / len(nodes))
        self.gaps = (ends - np.roll(nodes, -1, axis=0))[:, self.moving]
        self.units = sizes[self.moving]
        largest = float(abs(nodes[:, self.moving]).max(initial=0.0))
        # If the orbit rests in 0, as with parametric forces, only the sizes say what is small.
        self.largest = max(largest, LEAST_UNIT * float(self.units.max(initial=0.0)))
        gaps = np.where(np.isnan(self.gaps), np.inf, abs(self.gaps))
        self.residual = float(gaps.max(initial=0.0) / self.largest)
        # A short enough Newton step reduces this norm, but not always the largest gap.
        self.distance = float(np.linalg.norm(gaps / self.units))

    @property
    def growth(self) -> float:
        """The factor by which differences of states, in units of their sizes, grow along an arc."""
        scaled = self.slopes * self.units / self.units[:, np.newaxis]
        norm = np.sqrt((scaled**2).sum(axis=(1, 2))).max()
        return float(max(norm, 1.0)) if np.isfinite(norm) else np.inf

    @property
    def allowed(self) -> float:
        """The largest residual of arcs that count as an orbit."""
        rtol = self.flow.settings.rtol
        most = max(LARGEST_RESIDUAL, NOISE_OF_RESIDUAL * rtol)
        of_T = float(abs(self.rates * len(self.nodes)).max() / self.largest)
        return max(min(NOISE_OF_RESIDUAL * rtol * self.growth, most), ROUNDING_OF_PERIOD * of_T)

    @property
    def closes(self) -> bool:
        """True if the arcs form an orbit."""
        return self.residual <= self.allowed

    def _matrix(self) -> FloatArray:
        """Return the derivatives of the gaps with respect to nodes and log T, in units of sizes."""
        M, n = self.gaps.shape
        matrix = np.zeros((M, n, M * n + 1))
        for k in range(M):
            matrix[k, :, k * n : (k + 1) * n] += self.slopes[k] * self.units
            following = (k + 1) % M * n
            matrix[k, :, following : following + n] -= np.diag(self.units)
            if not self.flow.is_forced:
                matrix[k, :, -1] = self.rates[k]
        matrix = (matrix / self.units[:, np.newaxis]).reshape(M * n, -1)
        if (bases := self._bases()) is None:
            return matrix
        of_ends, of_nodes = block_diagonal(np.roll(bases, -1, axis=0)), block_diagonal(bases)
        matrix = of_ends.T @ matrix
        return np.concatenate([matrix[:, :-1] @ of_nodes, matrix[:, -1:]], axis=1)

    def _slopes_of_constraints(self) -> Any:
        """Return derivatives (M, r, n) of residuals of constraints at nodes; None without any."""
        if not (constraints := constraints_of(self.flow.field)):
            return None
        return constraints.of(self.nodes, self.flow.field._inputs, self.moving.tolist())[1]

    def _bases(self) -> Any:
        """Return bases (M, n, d) of changes of nodes, in units, that keep constraints, or None."""
        slopes = self._slopes_of_constraints()
        return None if slopes is None else tangent_basis(slopes * self.units)

    def within_constraints(self, slopes: FloatArray) -> FloatArray:
        """Return a derivative (n, n) of the motion at the first node, in its tangent space."""
        rows = self._slopes_of_constraints()
        return slopes if rows is None else within(tangent_basis(rows[0]), slopes)

    @property
    def freedom(self) -> int:
        """The number of independent changes of nodes, and of a free T, that keep gaps closed.

        As the matrix is a difference of matrices of size 1, its entries below ZERO_OF_NEWTON are
        rounding.
        """
        matrix = self._matrix()[:, : -1 if self.flow.is_forced else None]
        values = np.linalg.svd(matrix, compute_uv=False)
        rank = int((values > ZERO_OF_NEWTON * max(values[0], 1.0)).sum())
        return matrix.shape[1] - rank

    def by_parameters(self, parameters: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        """Return derivatives of the first node (D, P) and of T (P,) with respect to parameters.

        They solve the equations of Newton's steps, with the derivatives of the ends on the right.
        The change of the node is perpendicular to f, since it may move along the orbit.
        """
        flow, (M, n), P = self.flow, self.gaps.shape, len(parameters)
        ends = flow.arcs_by(self.nodes, self.T / M, parameters)[:, self.moving]
        matrix, right = self._matrix(), -ends / self.units[:, np.newaxis]
        right = right.reshape(M * n, P)
        if flow.is_forced:
            matrix = matrix[:, :-1]
        else:
            row = np.zeros(matrix.shape[1])
            row[:n] = flow.field._value(self.nodes[0])[self.moving] * self.units
            matrix = np.vstack([matrix, row / np.linalg.norm(row)])
            right = np.vstack([right, np.zeros(P)])
        solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
        of_node = np.zeros((len(flow.drifts), P))
        of_node[self.moving] = solution[:n] * self.units[:, np.newaxis]
        return of_node, np.zeros(P) if flow.is_forced else self.T * solution[-1]

    def _step(self) -> tuple[FloatArray, float]:
        """Return a damped Newton step: changes of nodes and of log T; NaN without derivatives."""
        matrix, right = self._matrix(), -self.gaps / self.units
        bases, count = self._bases(), self.gaps.shape[1]
        if bases is not None:
            ends, count = np.roll(bases, -1, axis=0), bases.shape[2]
            right = (np.swapaxes(ends, 1, 2) @ right[..., np.newaxis])[..., 0]
        right = right.ravel()
        if self.flow.keeps_phase and not self.flow.is_forced:
            row = np.zeros((1, matrix.shape[1]))
            rate = self.flow.field._value(self.nodes[0])[self.moving] / self.units
            fastest = abs(rate).argmax()
            kept = np.eye(len(rate))[fastest] if bases is None else bases[0, fastest]
            row[0, :count] = WEIGHT_OF_PHASE * kept
            matrix, right = np.concatenate([matrix, row]), np.append(right, 0.0)
        change = np.full(self.nodes.shape, np.nan)
        if not np.isfinite(matrix).all():
            return change, np.nan
        left, values, rows = np.linalg.svd(matrix, full_matrices=False)
        # The step of Levenberg and Marquardt: Newton's step, with small singular values damped.
        damping = (ZERO_OF_NEWTON * values[0]) ** 2 + right @ right
        step = (values / (values**2 + damping) * (right @ left)) @ rows
        change[:] = 0.0
        of_nodes = step[:-1].reshape(len(self.nodes), count)
        if bases is not None:
            of_nodes = (bases @ of_nodes[..., np.newaxis])[..., 0]
        change[:, self.moving] = of_nodes * self.units
        return change, float(np.clip(step[-1], -LONGEST_STEP_OF_PERIOD, LONGEST_STEP_OF_PERIOD))

    def _improved(self) -> Shooting:
        """Return arcs with smaller gaps, after a step or a fraction of a step; else these arcs."""
        change, of_T = self._step()
        for k in range(MOST_HALVINGS):
            nodes, T = self.nodes + change / 2**k, self.T * float(np.exp(of_T / 2**k))
            nodes = near_constraints(self.flow.field, nodes)
            if np.isfinite(nodes).all() and np.isfinite(T):
                other = Shooting(self.flow, nodes, T, self.sizes)
                if other.distance < self.distance:
                    return other
        return self

    def with_period(self) -> Shooting:
        """Return the arc with the T near the given one at which its end is nearest to its start.

        With several integrals there are orbits of all periods near the start. So Newton's steps for
        all unknowns would close a Kepler ellipse by changes of the state, and keep a wrong T.
        """
        best = self
        for _ in range(
            0 if self.flow.is_forced or self.flow.keeps_phase else MOST_CORRECTIONS_OF_PERIOD
        ):
            (rate,), (gap,) = best.rates, best.gaps
            change = -(rate @ gap) / (rate @ rate)
            if not LEAST_CORRECTION_OF_PERIOD < abs(change) < 0.5:  # NaN leaves the loop, too
                break
            other = Shooting(self.flow, self.nodes, best.T * float(1.0 + change), self.sizes)
            if not other.distance < best.distance:
                break
            best = other
        return best

    def solved(self) -> Shooting:
        """Return arcs after Newton's steps, as long as they make the gaps smaller.

        If all motions near an orbit are periodic, the equations of steps are rounding: then steps
        that lead far away from arcs that close are none.
        """
        best = self
        for _ in range(MOST_ROUNDS_OF_NEWTON):
            before, best = best, best._improved()
            is_slow = before.closes and best.distance > before.distance / 2
            if best is before or is_slow:
                break
        return self if self.closes and best._is_far_from(self) else best

    def _is_far_from(self, other: Shooting) -> bool:
        """Return True if nodes or T differ from other arcs by over FARTHEST_FROM_CLOSED_ARCS."""
        ways = abs(self.nodes - other.nodes)[:, self.moving] / self.units
        return bool(
            max(ways.max(initial=0.0), abs(np.log(self.T / other.T))) > FARTHEST_FROM_CLOSED_ARCS
        )


def nearest_orbit(flow: FieldFlow, x: FloatArray, T: float) -> Shooting:
    """Return arcs of an orbit near x with a period near T; if none is found, the best arcs.

    More arcs are tried if one arc leads to no orbit, or if derivatives grow much along it.
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
        if best is None or search.closes or search.residual < best.residual:
            best = search
        if search.closes:
            x, T = search.nodes[0], search.T
            if search.growth <= GROWTH_OF_ARC:
                break
    assert best is not None
    return best


def _sizes(flow: FieldFlow, start: FloatArray, T: float) -> FloatArray:
    """Return the range (D,) of each component during T, the unit of steps."""
    states = flow.states(start, T * np.arange(1, STATES_OF_ORBIT + 1) / STATES_OF_ORBIT)
    moving = ~flow.drifts
    sizes = np.ptp(np.vstack([start, states[np.isfinite(states).all(axis=1)]]), axis=0)
    if not sizes[moving].any():
        sizes = abs(start)
    # In units that differ from coordinate to coordinate the manifold of constraints would be bent.
    if constraints := constraints_of(flow.field):
        for part in constraints.parts:
            sizes[part] = sizes[part].max(initial=0.0)
    largest = sizes[moving].max(initial=0.0) or 1.0
    return np.maximum(np.where(moving, sizes, 0.0), LEAST_UNIT * largest)


def near_return(flow: FieldFlow, start: FloatArray) -> tuple[float | None, float]:
    """Return the time at which the motion returns near its start, or None, and a second time.

    The search for a return ended at the second time. At a return the motion is nearer to the start
    than before and after, and it has been far away. It need not cross the plane through the start
    normal to f, because the start may be off the orbit.
    """
    moving = ~flow.drifts
    fastest, size = float(abs(flow.rate[moving]).max()), abs(start[moving]).max()
    if fastest == 0.0:
        return None, 0.0
    longest = LONGEST_SEARCH * float(size or 1.0) / fastest
    extent, until = np.zeros(moving.sum()), np.inf
    best: tuple[float, float | None] = NEAR_RETURN, None
    for begin, end in itertools.pairwise(
        [0.0, *(longest * 2.0 ** np.arange(-DOUBLINGS_OF_SEARCH, 1.0))]
    ):
        times = np.linspace(begin, end, STATES_OF_ORBIT)
        states = flow.states(start, times)
        ways = states[:, moving] - start[moving]
        before = np.maximum(extent, np.maximum.accumulate(abs(ways)))
        extent = before[-1]
        scale = np.where(extent > 0.0, extent, 1.0)
        was_away = (before / scale).max(axis=1) > LEFT_START
        distance = np.sqrt(((ways / scale) ** 2).mean(axis=1))
        near = distance < FARTHEST_REFINED_RETURN
        recedes = np.append(np.diff(distance) >= 0.0, True)
        returns = ~recedes[:-1] & recedes[1:] & (near[:-1] | near[1:]) & was_away[:-1]
        for k in np.flatnonzero(returns).tolist():
            first, length = 0.0, times[min(k + 2, len(times) - 1)] - times[k]
            for _ in range(2):  # each round searches closer around the nearest point
                inside = first + length * _INSIDE
                ways = (flow.states(states[k], inside)[:, moving] - start[moving]) / scale
                distances = np.sqrt((ways**2).mean(axis=1))
                nearest = int(distances.argmin())
                first, length = inside[max(nearest - 1, 0)], length / 16
            t = float(times[k] + inside[nearest])
            if t > until:
                return best[1], end
            if distances[nearest] < (0.7 if best[1] else 1.0) * best[0]:
                best, until = (float(distances[nearest]), t), min(until, LATEST_NEARER_RETURN * t)
            if best[0] < NEAR_RETURN / 10:
                return best[1], end
        if end > until:
            break
    return best[1], end
