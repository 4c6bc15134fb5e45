"""The motion of a lifted field at given times, to a tolerance, by whole extrapolated steps.

The length of each step follows from the estimated error as in `core.tolerance`. A step is refused,
too, if det(1 - (eps / 4) f') of the given equations was negative, or a component changed a sign
that the motion keeps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..bodies.lift import values_of
from ..checks import FloatArray
from ..core.tolerance import LONGER, OF_ROUNDING, REFUSED, SAFETY, SHORTER, SHORTEST, SMALLEST
from ..engine.problem import Problem
from ..engine.stretches import Report
from ..engine.threads import call_kernel
from ..maps import map_of


def in_direction(
    problem: Problem,
    x0: FloatArray,
    times: FloatArray,
    direction: int,
    rtol: float,
    counts: Sequence[int],
    told: Report,
) -> tuple[FloatArray, Any, FloatArray]:
    """Return what `motion.in_direction` does, with the same arguments, for a lifted field."""
    body, B = problem.body, len(x0)
    [steps] = map_of(body, "extrapolated").methods.values()
    arguments = steps.arguments(body, 1.0, problem.batch)
    assert steps.divide is not None
    rates = problem.map.formulas["vector_field"].compute(problem).reshape(x0.shape)
    groups = []
    for where, (scheme, values, _) in steps.divide(x0.shape[1], arguments):
        own = direction, rtol, times[-1], problem.threads
        group = _Group(steps, scheme, values, x0[where], rates[where], *own)
        groups.append((where, group))
    out = np.full((len(times), *x0.shape), np.nan)
    for k, end in enumerate(times):
        for where, group in groups:
            group.go_to(end)
            out[k, where] = group.x
        if counts and not told(counts[k]):
            break
    ended, ends = np.zeros(B, bool), np.zeros(B)
    for where, group in groups:
        ended[where], ends[where] = group.length == 0.0, group.time
    return out, ended, ends


class _Group:
    """Trajectories with one list of operations.

    Arguments are the steps of the method, a scheme and the values of the terms as kernels take
    them, states and their rates f(x0), the direction of time, the tolerance, the modulus of the
    last time, and threads.
    """

    def __init__(
        self,
        steps: Any,
        scheme: Any,
        values: FloatArray,
        x0: FloatArray,
        rates: FloatArray,
        direction: int,
        rtol: float,
        last: float,
        threads: int | None,
    ) -> None:
        self.steps, self.scheme, self.values = steps, scheme, values
        self.direction, self.rtol, self.threads = direction, rtol, threads
        self.x, self.time, self.largest = x0.copy(), np.zeros(len(x0)), abs(x0)
        with np.errstate(all="ignore"):
            f, size = abs(rates).max(axis=1), self.largest.max(axis=1)
            length = np.where((f > 0.0) & (size > 0.0), 0.125 * size / f, last)
            length = np.where(np.isfinite(f + size), np.minimum(length, last), 0.0)
        self.length = self.first = length
        self.x[length == 0.0] = np.nan

    def go_to(self, end: float) -> None:
        """Take steps until all trajectories have reached a time or ended."""
        while True:
            active = np.flatnonzero((self.time < end) & (self.length > 0.0))
            if not active.size:
                return
            with np.errstate(all="ignore"):
                self._step(active, end)

    def _step(self, i: Any, end: float) -> None:
        """Take a step of the trajectories i, at most to a time."""
        wanted, rest = self.length[i], end - self.time[i]
        taken = np.minimum(wanted, rest)
        after, errors, passed = self._after(i, taken)
        sizes = np.maximum(abs(after), self.largest[i])
        scale = np.maximum(sizes, SMALLEST * sizes.max(axis=1, keepdims=True))
        rounding = OF_ROUNDING * taken[:, np.newaxis] * self._sizes_of_terms(i)
        allowed = np.maximum(self.rtol * scale, rounding)
        ratios = np.where(errors == 0.0, 0.0, errors / allowed)
        rho = ratios.max(axis=1)
        finite = np.isfinite(after).all(axis=1) & np.isfinite(errors).all(axis=1)
        good = finite & (rho <= 1.0) & ~passed
        root = np.where(finite, rho, 1e30)
        for _ in range(3):
            root = np.sqrt(root)
        factor = np.minimum(np.maximum(SAFETY / root, SHORTER), LONGER)
        factor = np.where(good, factor, np.minimum(factor, REFUSED))
        # A step that was cut at the end of time says nothing against the length wanted.
        length = np.where(good & (taken < wanted), wanted, taken * factor)
        time = np.where(taken == rest, end, self.time[i] + taken)
        self.time[i] = np.where(good, time, self.time[i])
        ended = length < SHORTEST * np.maximum(self.time[i], self.first[i])
        kept = good[:, np.newaxis]
        self.largest[i] = np.where(kept, scale, self.largest[i])
        x = np.where(kept, after, self.x[i])
        self.x[i] = np.where(ended[:, np.newaxis], np.nan, x)
        self.length[i] = np.where(ended, 0.0, length)

    def _sizes_of_terms(self, i: Any) -> FloatArray:
        """Return the sums of the moduli of the terms of f."""
        step, x = self.scheme.step, self.x[i]
        values = self.values[i] if len(self.values) > 1 else self.values
        columns = [*x.T]
        if hasattr(step, "lift"):
            variables = values_of(step.lift[0], values[:, step.T :], x)
            columns += [math.prod(variables[k] for k in w) for w in step.lift[0].words]
        columns.append(np.ones(len(x)))
        sums: FloatArray = np.zeros_like(x)
        for t, (row, j, k) in enumerate(step.indices.T.tolist()):
            if row < x.shape[1]:
                sums[:, row] += abs(values[:, t] * columns[j] * columns[k])
        return sums

    def _after(self, i: Any, taken: FloatArray) -> tuple[FloatArray, FloatArray, Any]:
        """Return the states after a step, its estimated errors, and whether it passed a pole."""
        x, (B, D) = self.x[i], (len(i), self.x.shape[1])
        values = self.values[i] if len(self.values) > 1 else self.values
        arguments = self.scheme, np.ascontiguousarray(values), self.direction * taken
        carry, final = np.empty((self.steps.rows_carried(D), B)), np.empty((B, D))
        status, failed_at = np.zeros(B, np.int8), np.full(B, -1)
        arrays = np.ascontiguousarray(x), carry, (0, B, 0, 1, 0, 0), np.empty((0, B, D)), final
        work = int(B * self.steps.cost(D, arguments)) if self.steps.lanes < B else 0
        call_kernel(self.steps.kernel, work, self.threads, arguments, *arrays, status, failed_at)
        return final, carry[1:].T, status > 0
