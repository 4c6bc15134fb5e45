"""The closed form over a batch and many times, in parts between which Python handles Ctrl-C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._jit import Kernel
from .._kernels import closed_form_rows as kernels
from .._kernels.lanes import LANES
from . import threads as _threads
from .arguments import States
from .layout import alike, flat_arrays, for_loops
from .memory import require

# States of one call of a kernel: some 10 ms. With a quarter of this, idle threads cost 5 %.
SLICE = 2**24
# Least number of times for which rows of equal steps are faster.
SHORTEST = 32
# Least number of rows of a call: entering a trajectory costs some 100 states.
_WORTH_ENTERING = 2**12
# Number of trajectories that are tried first, and the part of them above which most are left.
_PROBE, _MOST = 2**8, 0.75
# Costs of entering an orbit, of a state in equal steps, and of a state at an arbitrary time, in
# steps of the map.
_ENTERING, _ROW, _ANY = 64, 1, 8

Range = tuple[int, int]
# Statuses, the indices of the first missing states, and the last step.
Ends = tuple[NDArray[np.int8], NDArray[np.int64], float]
# The parameter k of a body without a rotor.
NO_ROTOR = np.zeros(1)
_NO_ENDS: Ends = np.empty(0, np.int8), np.empty(0, np.int64), math.inf


class Orbits(NamedTuple):
    """Orbits of the map or the flow, in the form for kernels; with `ends` they end at poles."""

    parameters: tuple[FloatArray, ...]
    omega: FloatArray
    flow: bool
    ends: Ends
    # 1 for trajectories of the blocks that the first call of a kernel leaves.
    left: NDArray[np.int8]
    # Numbers of missing states so far, a row for each thread: at a step, between, and out of range.
    missing: FloatArray
    threads: int | None

    def call(
        self,
        kernel: Kernel,
        sign: float,
        which: tuple[Any, Any],
        lanes: Range,
        work: int,
        out: FloatArray,
    ) -> None:
        """Call a kernel for some trajectories, and again for those that it leaves.

        If it leaves most of the first _PROBE, all others are left, too: the second call computes
        the same bits. `work` is that of a trajectory after it is entered.
        """
        parameters, omega, flow, ends, left, missing, threads = self
        batch, (begin, stop) = ((sign, flow), parameters, omega, ends, left), lanes
        end, most_left = begin + _PROBE if stop - begin > 4 * _PROBE else stop, False
        while begin < stop:
            call = batch, (begin, end), *which, out, missing
            total = (end - begin) * (_ENTERING + work)
            if most_left:
                left[begin:end] = 1
            else:
                _threads.call_kernel(kernel, total, threads, *call, None)
            if 1 in left[begin:end].tobytes():  # faster than `any` for one trajectory
                _threads.call_kernel(kernel, total, threads, *call, True)
                most_left = end < stop and left[begin:end].mean() > _MOST
            begin, end = end, stop


def orbits_of(
    parameters: tuple[FloatArray, ...],
    omega: FloatArray,
    flow: bool,
    threads: int | None,
    ends: Ends = _NO_ENDS,
) -> Orbits:
    missing, left = np.zeros((numba.config.NUMBA_NUM_THREADS, 3)), np.zeros(len(omega), np.int8)
    return Orbits(with_rotor(parameters), omega, flow, ends, left, missing, threads)


class Rows(NamedTuple):
    """States at equal steps: sign (first + every i) for begin <= i < end, first and every >= 0."""

    every: float
    begin: int
    end: int
    origin: int  # row i is written to row origin + direction i of the result
    direction: int = 1
    first: float = 0.0
    sign: float = 1.0


def slices(batch: int, rows: int) -> Sequence[tuple[Range, Range]]:
    """Return the trajectories and rows of each call of a kernel.

    Trajectories begin at multiples of LANES, rows at multiples of GROUP. The batch is divided
    first, as long as the rows of a call outweigh the cost of entering trajectories.
    """
    if batch * rows <= SLICE:
        return (((0, batch), (0, rows)),)
    abreast = max(SLICE // min(rows, _WORTH_ENTERING), 1)
    width = alike(batch, abreast, LANES)
    height = (SLICE // min(width, batch) // kernels.GROUP + 1) * kernels.GROUP
    return [
        ((lane, min(lane + width, batch)), (row, min(row + height, rows)))
        for lane in range(0, batch, width)
        for row in range(0, rows, height)
    ]


def states_at(states: States, times: FloatArray, flow: bool) -> tuple[FloatArray, FloatArray]:
    """Return states at times () or (N,), and `Orbits.missing`."""
    body, omega, eps, batch, threads, *_ = states
    omega = flat_arrays(omega, batch)
    orbits = orbits_of(for_loops(body, eps, batch), omega, flow, threads)
    moments, shape = times.reshape(-1), (*times.shape, *batch, 2)
    require(16 * moments.size * len(omega), "the states are {}: compute fewer at a time", shape)
    out = np.empty((moments.size, len(omega), 2))
    if moments.size == 1:  # the code below would take a third of a call
        sign = -1.0 if moments.item() < 0.0 else 1.0
        at_times(orbits, sign, abs(moments), np.zeros(1, np.intp), out)
        return out.reshape(shape), orbits.missing
    negative = moments < 0.0
    for sign, to in ((1.0, np.flatnonzero(~negative)), (-1.0, np.flatnonzero(negative))):
        if to.size:
            outward = abs(moments[to])
            if rows := equal_steps(outward, to, sign, flow):
                at_equal_steps(orbits, rows, out)
            else:
                at_times(orbits, sign, outward, to, out)
    return out.reshape(shape), orbits.missing


def with_rotor(parameters: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """Return parameters with k, 0 for a body without a rotor."""
    return parameters if len(parameters) > 5 else (*parameters[:4], NO_ROTOR, parameters[4])


def at_times(
    orbits: Orbits, sign: float, times: FloatArray, to: NDArray[np.intp], out: FloatArray
) -> None:
    """Fill row to[j] of `out`, (N, B, 2), with the states at sign * times[j]."""
    for lanes, (begin, end) in slices(len(orbits.omega), times.size):
        which, work = (times[begin:end], to[begin:end]), (end - begin) * _ANY
        orbits.call(kernels.states, sign, which, lanes, work, out)


def at_equal_steps(orbits: Orbits, rows: Rows, out: FloatArray) -> None:
    low = rows.begin // kernels.GROUP * kernels.GROUP
    for lanes, (begin, end) in slices(len(orbits.omega), rows.end - low):
        numbers = max(low + begin, rows.begin), low + end, rows.origin, rows.direction
        which, work = ((rows.first, rows.every), numbers), (end - begin) * _ROW
        orbits.call(kernels.rows, rows.sign, which, lanes, work, out)


def equal_steps(times: FloatArray, to: NDArray[np.intp], sign: float, flow: bool) -> Rows | None:
    """Return times >= 0, which belong to rows `to`, as rows of equal steps; None if they are not.

    A state of the map does not depend on the other times: beyond t = 1 the next float after a whole
    number of steps has no state. So steps are equal without rounding, and begin below every.
    """
    size, direction = times.size, 1
    if size < SHORTEST or to[-1] - to[0] != size - 1:
        return None
    if times[-1] < times[0]:
        times, to, direction = times[::-1], to[::-1], -1
    first, every = float(times[0]), float(times[-1] - times[0]) / (size - 1)
    if not (0.0 < every < math.inf and abs(times[1] - first - every) <= every * 1e-6):
        return None
    expected = first + every * np.arange(size)
    if (abs(times - expected) > times * (2.0**-52 if flow else 0.0)).any():
        return None
    skipped = 0 if flow or not every.is_integer() else int(first // every)
    origin, first = int(to[0]) - direction * skipped, first - skipped * every
    return Rows(every, skipped, skipped + size, origin, direction, first, sign)
