"""The closed form over a batch and many times, in parts between which Python looks for Ctrl-C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._kernels import closed_form as kernels
from . import threads as _threads
from .layout import flat_vectors
from .problem import alike
from .units import for_loops

# States of one call of a kernel: some 10 ms. A quarter of them lost a twentieth to threads that
# wait.
SLICE = 2**24
# Fewer times than these are not worth a run of equal steps.
SHORTEST = 32
# Rows of one call, if there are as many: to enter a trajectory costs some 100 states.
_WORTH_ENTERING = 2**12
# What it costs to enter an orbit, and a state of it at any time, in steps of the map.
_ENTERING, _EVALUATING = 64, 8

Range = tuple[int, int]
# Statuses, the numbers of the first missing states, and the last step.
Ends = tuple[NDArray[np.int8], NDArray[np.int64], float]
NO_ENDS: Ends = np.empty(0, np.int8), np.empty(0, np.int64), math.inf


def slices(batch: int, rows: int) -> Sequence[tuple[Range, Range]]:
    """Return the trajectories and rows of each of the calls that a long one is cut into.

    Both begin at multiples of what kernels take together, LANES trajectories and GROUP rows. The
    batch is cut first, as long as rows are worth that trajectories are entered.
    """
    if 0 < batch * rows <= SLICE:
        return (((0, batch), (0, rows)),)
    abreast = max(SLICE // max(min(rows, _WORTH_ENTERING), 1), 1)
    width = alike(batch, abreast, kernels.LANES) if batch else 1
    height = (SLICE // max(min(width, batch), 1) // kernels.GROUP + 1) * kernels.GROUP
    return [
        ((lane, min(lane + width, batch)), (row, min(row + height, rows)))
        for lane in range(0, batch, width)
        for row in range(0, rows, height)
    ]


def _new(shape: tuple[int, ...]) -> FloatArray:
    """Return an array, or raise an error that says what does not fit."""
    try:
        if math.prod(shape) > 2**60:  # more than NumPy could even ask for
            raise MemoryError
        return np.empty(shape)
    except MemoryError as error:
        raise MemoryError(f"expected states that fit in memory, got shape {shape}") from error


class Run(NamedTuple):
    """States at equal steps: sign (first + every i) for begin <= i < end, first and every >= 0.

    Row i of them goes to row origin + direction i of the result.
    """

    sign: float
    first: float
    every: float
    begin: int
    end: int
    origin: int
    direction: int


def states_at(
    body: Suslov3D,
    state: FloatArray,
    eps: float | FloatArray,
    batch: tuple[int, ...],
    times: FloatArray,
    flow: bool,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Return states at times () or (N,), and how many are missing: at steps of the map, between
    two, and out of the range of float64.
    """
    parameters, states = for_loops(body, eps, batch), flat_vectors(state, batch)
    moments, missing = times.reshape(-1), np.zeros(3)
    flat = _new((moments.size, len(states), 2))
    if runs := runs_of(moments, flow):
        for run in runs:
            fill_rows(run, flow, parameters, states, flat, NO_ENDS, missing, threads)
    else:
        for sign, places in _by_sign(moments):
            some = abs(moments[places])
            fill_states(
                sign, some, places, flow, parameters, states, flat, NO_ENDS, missing, threads
            )
    return flat.reshape((*times.shape, *batch, 2)), missing


def _by_sign(moments: FloatArray) -> Sequence[tuple[float, NDArray[np.intp]]]:
    """Return the places of times that are not negative, and of those that are."""
    if moments.size == 1:  # faster by the time of a call of the kernel
        return ((-1.0 if moments.item() < 0.0 else 1.0, np.zeros(1, np.intp)),)
    negative = moments < 0.0
    places = ((1.0, np.flatnonzero(~negative)), (-1.0, np.flatnonzero(negative)))
    return [each for each in places if each[1].size]


def fill_states(
    sign: float,
    times: FloatArray,
    to: NDArray[np.intp],
    flow: bool,
    parameters: list[FloatArray],
    states: FloatArray,
    out: FloatArray,
    ends: Ends,
    missing: FloatArray,
    threads: int | None,
) -> None:
    """Fill row to[j] of `out`, (N, B, 2), with the states at sign * times[j]."""
    for lanes, (begin, end) in slices(len(states), times.size):
        count = np.zeros(3)
        _threads.run(
            kernels.states_of_flow if flow else kernels.states_of_map,
            (lanes[1] - lanes[0]) * (_ENTERING + (end - begin) * _EVALUATING),
            threads,
            sign,
            tuple(parameters),
            states,
            times[begin:end],
            to[begin:end],
            lanes,
            out,
            ends,
            count,
        )
        missing += count


def fill_rows(
    run: Run,
    flow: bool,
    parameters: list[FloatArray],
    states: FloatArray,
    out: FloatArray,
    ends: Ends,
    missing: FloatArray,
    threads: int | None,
) -> None:
    """Fill the rows of `out`, (N, B, 2), that belong to a run."""
    low = run.begin // kernels.GROUP * kernels.GROUP
    for lanes, (upper, lower) in slices(len(states), run.end - low):
        top, bottom, count = max(low + upper, run.begin), low + lower, np.zeros(3)
        _threads.run(
            kernels.rows_of_flow if flow else kernels.rows_of_map,
            (lanes[1] - lanes[0]) * (_ENTERING + bottom - top),
            threads,
            run.sign,
            tuple(parameters),
            states,
            (run.first, run.every),
            (top, bottom, run.origin, run.direction),
            lanes,
            out,
            ends,
            count,
        )
        missing += count


def runs_of(times: FloatArray, flow: bool) -> list[Run]:
    """Return the runs of equal steps that times make up, one for each sign; none if they do not.

    Runs of steps of the map begin where n is smaller than the step, so that a state does not depend
    on which others are asked for.
    """
    size = times.size
    if size < SHORTEST:
        return []
    every = (float(times[-1]) - float(times[0])) / (size - 1)
    if every == 0.0 or not math.isfinite(every):
        return []
    if every < 0.0:
        return [
            run._replace(origin=size - 1 - run.origin, direction=-run.direction)
            for run in runs_of(times[::-1], flow)
        ]
    if not abs(float(times[1]) - float(times[0]) - every) <= abs(every) * 1e-6:
        return []
    negative = int(np.searchsorted(times, 0.0))
    runs = []
    for sign, outward, origin in (
        (-1, -times[:negative][::-1], negative - 1),
        (1, times[negative:], negative),
    ):
        if outward.size:
            expected = outward[0] + every * np.arange(outward.size)
            if (abs(outward - expected) > outward * 2.0**-52).any():
                return []
            nearest = float(outward[0])
            whole = not flow and nearest == math.floor(nearest)
            skipped = int(nearest // every) if whole else 0
            first, end = nearest - skipped * every, skipped + outward.size
            runs.append(Run(sign, first, every, skipped, end, origin - sign * skipped, sign))
    return runs
