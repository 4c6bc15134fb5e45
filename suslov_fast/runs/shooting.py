"""Newton's method for periodic orbits: arcs that must join, of a motion or of a map.

M arcs of equal duration T / M start at nodes x_k. The unknowns are the nodes and log T, the
equations

Phi(x_k) - x_k+1 = 0,    where x_M = x_0,

for all components but those of constant rates. They are fewer than the unknowns, and have families
of solutions where the system has integrals; a step is the shortest one that solves the linear
equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core.motion.engine import Settings
from ..engine.sensitivity import Columns
from ..quantities.derivatives import jacobian
from .flow import _to_tolerance
from .iterate import iterate

_ROUNDS, _HALVINGS = 60, 10
# Singular values below this part of the largest one, or below the residual, are directions along a
# family of orbits, of which a system with an integral has one for each of its values.
_LEAST = 1e-8
_LONGEST = 0.3  # step of log T
_CORRECTIONS, _LEAST_CHANGE = 5, 1e-6  # of T before Newton's steps, relative to it
_ARCS = 1, 4, 16  # that are tried
_GROWTH = 1e3  # of derivatives, above which an orbit is found again with more arcs
# The residual that is a solution, in units of rtol and of how much derivatives grow.
_NOISE = 10.0
_STEP = 1e-6  # of log T, for the difference quotient of a map


@dataclass
class Arcs:
    """The ends of arcs from nodes (M, D)."""

    nodes: FloatArray
    T: float
    ends: FloatArray  # (M, D), NaN where an arc has none
    slopes: FloatArray  # (M, D, D), derivatives of the ends by the nodes
    rates: FloatArray  # (M, D), derivatives of the ends by log T


class Flow(Protocol):
    """What has arcs: a motion, or a map."""

    drifts: NDArray[np.bool_]  # (D,) components of constant rates
    is_forced: bool  # whether others depend on one of them, and T is fixed
    rate: FloatArray  # (D,) f at the start

    def arcs(self, nodes: FloatArray, T: float) -> Arcs: ...

    def states(self, x: FloatArray, times: FloatArray) -> FloatArray: ...


class OfMotion:
    """Arcs of the motion of a field, to a tolerance."""

    def __init__(self, field: Any, start: FloatArray, rtol: float) -> None:
        self.field, self.settings = field, Settings(rtol, None, np.inf, None)
        (_, f, table), *_ = field.listed_right_hand_sides
        self.rate: FloatArray = f.value(start, table[0])
        depends = {i for i, _ in f.pattern}
        has_rate = [i not in depends and self.rate[i] != 0.0 for i in range(f.D)]
        self.drifts, self.is_forced = np.array(has_rate), bool(f.clocks)
        self._value: Any = lambda x: f.value(x.T, table[0][:, np.newaxis]).T

    def _solved(self, field: Any, x: FloatArray, times: FloatArray, settings: Settings) -> Any:
        return _to_tolerance(field, x, (len(x),), times, 1, settings, None, None).states

    def arcs(self, nodes: FloatArray, T: float) -> Arcs:
        M = len(nodes)
        columns = Columns(self.field, nodes, (M,), True, (), self.settings)
        times = np.array([T / M])
        found = self._solved(columns.field, columns.starts, times, columns.settings)
        (ends,), (slopes,) = columns.parted(found)
        return Arcs(nodes, T, ends, slopes, self._value(ends) * (T / M))

    def states(self, x: FloatArray, times: FloatArray) -> FloatArray:
        """Return the states (n, D) at times, all 0 or later."""
        found: FloatArray = self._solved(self.field, x[np.newaxis], times, self.settings)[:, 0]
        return found


class OfMap:
    """One arc, of N steps of a map."""

    is_forced = False

    def __init__(self, field: Any, rate: FloatArray, steps: int, method: str) -> None:
        self.field, self.steps, self.method, self.rate = field, steps, method, rate
        self.drifts = np.zeros(len(rate), bool)

    def _run(self, x: FloatArray, eps: Any, **options: Any) -> Any:
        options |= {"method": self.method, "on_singular": "ignore"}
        return iterate(self.field, x, eps, self.steps, **options)

    def arcs(self, nodes: FloatArray, T: float) -> Arcs:
        eps, (x,) = T / self.steps, nodes
        states = self._run(x, eps).states
        near = self._run(x, eps * np.array([1 + _STEP, 1 - _STEP]), save_every=None).final
        factors = jacobian(self.field, states[:-1], eps, method=self.method)
        while len(factors) > 1:  # the later one of two is the left one
            last = factors[len(factors) // 2 * 2 :]
            factors = np.concatenate([factors[1::2] @ factors[: len(factors) - 1 : 2], last])
        rates = (near[:1] - near[1:]) / (2 * _STEP)
        return Arcs(nodes, T, states[-1:], factors, rates)

    def states(self, x: FloatArray, times: FloatArray) -> FloatArray:
        """Return the states (n, D) after N steps each."""
        found: FloatArray = self._run(x, times / self.steps, save_every=None).final
        return found


class Shooting:
    """A search that begins with arcs from nodes (M, D)."""

    def __init__(self, flow: Flow, nodes: FloatArray, T: float, rtol: float) -> None:
        self.flow, self.rtol, self.drifts = flow, rtol, flow.drifts
        self.clocks = nodes[:, self.drifts]
        self.rounds = 0
        self._go_to(nodes, T)

    def _go_to(self, nodes: FloatArray, T: float) -> None:
        self._take(self.flow.arcs(nodes, T))

    def _take(self, arcs: Arcs) -> None:
        self.arcs, self.T, self.nodes = arcs, arcs.T, arcs.nodes
        gaps = arcs.ends - np.roll(arcs.nodes, -1, axis=0)
        gaps[:, self.drifts] = 0.0
        self.gaps = gaps
        sizes = abs(arcs.nodes[:, ~self.drifts]).max(initial=0.0)
        residual = abs(gaps).max() / sizes if sizes else np.inf
        self.residual = float(residual) if np.isfinite(residual) else np.inf

    @property
    def growth(self) -> float:
        """By how much differences of states, in units of their sizes, grow along an arc."""
        sizes = self._sizes
        scaled = self.arcs.slopes * sizes / sizes[:, np.newaxis]
        scaled = scaled[:, ~self.drifts][:, :, ~self.drifts]
        with np.errstate(all="ignore"):
            norm = np.sqrt((scaled**2).sum(axis=(1, 2))).max()
        return float(max(norm, 1.0)) if np.isfinite(norm) else np.inf

    @property
    def allowed(self) -> float:
        """The residual that a solution has."""
        return _NOISE * self.rtol * self.growth

    @property
    def is_found(self) -> bool:
        return self.residual <= self.allowed

    @property
    def _sizes(self) -> FloatArray:
        sizes = np.maximum(abs(self.nodes), abs(self.arcs.ends)).max(axis=0)
        sizes = np.where(self.drifts, 0.0, sizes)
        of_nodes: FloatArray = np.maximum(sizes, 2.0**-20 * sizes.max())
        return of_nodes

    def _step(self) -> tuple[FloatArray, float]:
        """Return the step of the nodes and of log T."""
        M, D = self.nodes.shape
        own = np.flatnonzero(~self.drifts)
        n, sizes = len(own), self._sizes[~self.drifts]
        matrix = np.zeros((M, n, M * n + 1))
        for k in range(M):
            slopes = self.arcs.slopes[k][np.ix_(own, own)]
            matrix[k, :, k * n : (k + 1) * n] += slopes * sizes
            following = (k + 1) % M * n
            matrix[k, :, following : following + n] -= np.diag(sizes)
            if not self.flow.is_forced:
                matrix[k, :, -1] = self.arcs.rates[k, own]
        matrix = (matrix / sizes[:, np.newaxis]).reshape(M * n, -1)
        right = (-self.gaps[:, own] / sizes).ravel()
        if not np.isfinite(matrix).all():
            return np.full((M, D), np.nan), np.nan
        left, values, rows = np.linalg.svd(matrix, full_matrices=False)
        # Levenberg and Marquardt's step, which is Newton's but for small singular values.
        damping = (_LEAST * values[0]) ** 2 + right @ right
        step = (values / (values**2 + damping) * (right @ left)) @ rows
        change = np.zeros((M, D))
        change[:, own] = step[:-1].reshape(M, n) * sizes
        return change, float(np.clip(step[-1], -_LONGEST, _LONGEST))

    def _improve(self) -> bool:
        """Take a step, or a part of it; return whether the residual fell."""
        before, residual = self.arcs, self.residual
        with np.errstate(all="ignore"):
            change, of_T = self._step()
            if not (np.isfinite(change).all() and np.isfinite(of_T)):
                return False
            for k in range(_HALVINGS):
                nodes = before.nodes + change / 2**k
                self._go_to(nodes, before.T * float(np.exp(of_T / 2**k)))
                if self.residual < residual:
                    return True
        self._take(before)
        return False

    def correct_period(self) -> None:
        """Go to the T at which the orbit of the start passes nearest to it.

        A system with several integrals has orbits of all periods near by, turned against each
        other, and Newton's steps would rather turn a Kepler ellipse than correct a period.
        """
        for _ in range(0 if self.flow.is_forced else _CORRECTIONS):
            before, residual = self.arcs, self.residual
            rate, gap = (a[0, ~self.drifts] for a in (before.rates, self.gaps))
            with np.errstate(all="ignore"):
                change = -(rate @ gap) / (rate @ rate)
            if not _LEAST_CHANGE < abs(change) < 0.5:  # false for NaN
                break
            self._go_to(before.nodes, before.T * float(1.0 + change))
            if not self.residual < residual:
                self._take(before)
                break

    def search(self) -> bool:
        """Take steps as long as the residual falls; return whether it is that of a solution."""
        for self.rounds in range(1, _ROUNDS + 1):
            was_found, last = self.is_found, self.residual
            if not self._improve() or (was_found and self.residual > last / 2):
                break
        return self.is_found


def found(flow: Flow, start: FloatArray, T: float, rtol: float, most: int) -> Shooting:
    """Return the search that found an orbit, or the one that came nearest."""
    best = None
    for M in _ARCS:
        if most < M:
            break
        nodes = start[np.newaxis]
        if M > 1:
            nodes = flow.states(start, np.linspace(0.0, T, M, endpoint=False))
            if not np.isfinite(nodes).all():
                break
        search = Shooting(flow, nodes, T, rtol)
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
        arcs = best.arcs
        M = int(min(np.ceil(len(arcs.nodes) * np.log(best.growth) / np.log(30.0)), most))
        again = flow.states(arcs.nodes[0], np.linspace(0.0, arcs.T, M, endpoint=False))
        if np.isfinite(again).all():
            search = Shooting(flow, again, arcs.T, rtol)
            if search.search():
                return search
    return best


# ------------------------------------------------------------------------------------ near returns
_POINTS, _DOUBLINGS = 512, 14  # times in each stretch, and stretches, each as long as all before
_NEAR = 0.1  # of the extent of an orbit: how near a return is
_NEAREST = 4  # returns after the first near one, of which the nearest is taken


def near_return(flow: Flow, start: FloatArray) -> tuple[float, float]:
    """Return the time after which the motion of the start returns, and how near, by its extent.

    A return passes the plane through the start that is normal to f, in the direction of f. Both
    are infinite if there is none.
    """
    own = ~flow.drifts
    rate, size = flow.rate[own], abs(start[own]).max()
    unit = (size or 1.0) / (abs(rate).max() or np.inf)
    if unit == 0.0:
        return np.inf, np.inf
    before, low, best = start[np.newaxis, own], 0.0, (np.inf, np.inf)
    high, extent, left = 4.0 * unit, np.zeros(own.sum()), _NEAREST
    for _ in range(_DOUBLINGS):
        times = np.linspace(low, high, _POINTS + 1)
        states = flow.states(start, times[1:])[:, own]
        states = np.concatenate([before, states])
        states = states[np.isfinite(states).all(axis=1)]
        extent = np.maximum(extent, abs(states - start[own]).max(axis=0, initial=0.0))
        scale = np.where(extent > 0.0, extent, 1.0)
        normal = rate / scale**2
        heights = (states - start[own]) @ normal
        rises = np.flatnonzero((heights[:-1] < 0.0) & (heights[1:] >= 0.0))
        for k in rises:
            part = heights[k] / (heights[k] - heights[k + 1])
            state = states[k] + part * (states[k + 1] - states[k])
            distance = float(np.sqrt((((state - start[own]) / scale) ** 2).mean()))
            if distance < 0.7 * best[1]:
                best = float(times[k] + part * (times[k + 1] - times[k])), distance
            left -= best[1] < _NEAR
            if left == 0 or best[1] < _NEAR / 10:
                return best
        if len(states) <= _POINTS:
            break
        before, low, high = states[-1:], high, 2.0 * high
    return best
