"""The closed form over a batch and many times, in parts between which Python looks for Ctrl-C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._core.cpu import closed_form as loops
from .._core.cpu import equal_steps
from .._core.cpu.blocks import TASKS
from .._core.cpu.orbits import WIDTH
from .._core.cpu.seeds import GROUP
from . import threads as _threads
from .layout import flat_vectors, for_kernel
from .problem import alike
from .units import for_loops

# States of one call of a loop: some 10 ms. A quarter of them lost a twentieth to threads that wait.
SLICE = 2**24
# Fewer times than these are not worth a run: it has tables.
SHORTEST = 32
# Rows of one call, if there are as many: to enter a trajectory costs some 100 states.
_WORTH_ENTERING = 2**12
# Numbers that are compared at a time.
_IN_CACHE = 2**15
# Integers up to this are exact as floats.
_EXACT = 2**53
# Most given states have the number 0.
NO_START = np.zeros(1)
# So many states are no work that tasks could share.
_ONE_TASK = 2**12
# What one task counts missing states in: a copy takes half the time of a new array.
_NONE_MISSING = np.zeros((1, 2), np.int64)
# Where statuses are not wanted.
NO_STATUS = np.empty(0, np.int8)


Range = tuple[int, int]


def slices(batch: int, rows: int) -> Sequence[tuple[Range, Range]]:
    """Trajectories and rows of each of the calls that a long one is cut into.

    Both begin at multiples of what loops take together, WIDTH trajectories and GROUP rows. The
    batch is cut first, as long as rows are worth that trajectories are entered.
    """
    if 0 < batch * rows <= SLICE:
        return (((0, batch), (0, rows)),)
    abreast = max(SLICE // max(min(rows, _WORTH_ENTERING), 1), 1)
    width = alike(batch, abreast, WIDTH) if batch else 1
    height = (SLICE // max(min(width, batch), 1) // GROUP + 1) * GROUP
    return [
        ((lane, min(lane + width, batch)), (row, min(row + height, rows)))
        for lane in range(0, batch, width)
        for row in range(0, rows, height)
    ]


def none_missing(states: int = SLICE) -> NDArray[np.int64]:
    """What the tasks of a loop count missing states in; few states are one task."""
    return np.zeros((TASKS, 2), np.int64) if states > _ONE_TASK else _NONE_MISSING.copy()


def _new(shape: tuple[int, ...]) -> FloatArray:
    """An array, or an error that says what was asked for."""
    try:
        if math.prod(shape) > 2**60:  # more than NumPy could even ask for
            raise MemoryError
        return np.empty(shape)
    except MemoryError as error:
        raise MemoryError(f"expected states that fit in memory, got shape {shape}") from error


class Run(NamedTuple):
    """States at equal steps: n = sign (first + every i) for begin <= i < end, first and every >= 0.

    Row i of them goes to row origin + direction i of the result.

    steps   first, every.
    rows    begin, end, origin, direction.
    """

    sign: float
    steps: tuple[float, float]
    rows: tuple[int, int, int, int]


# Numbers of states, or times, () or (N,): floats, or integers that make up runs; and those runs.
Times = tuple[NDArray[Any], list[Run]]


def states_at(
    body: Suslov3D,
    state: FloatArray,
    eps: float | FloatArray,
    batch: tuple[int, ...],
    times: Times,
    flow: bool,
    threads: int | None,
) -> tuple[FloatArray, NDArray[np.int64]]:
    """States at times () or (N,), and how many are missing: (tasks, 2), at steps and between."""
    values, runs = times
    out = _new((*values.shape, *batch, 2))
    states, moments = flat_vectors(state, batch), values.reshape(-1)
    parameters = for_loops(body, eps, batch)
    size, rows = len(states), moments.size
    flat, missing = out.reshape((rows, size, 2)), none_missing(rows * size)
    for run in runs:
        fill_run(*run, flow, parameters, states, NO_START, flat, NO_STATUS, missing, threads)
    for lanes, (begin, end) in slices(size, rows) if not runs else ():
        _threads.run(
            loops.fill,
            (lanes[1] - lanes[0]) * (loops.ENTERING + (end - begin) * loops.EVALUATING),
            threads,
            flow,
            *parameters,
            states,
            for_kernel(moments[begin:end]),
            lanes,
            flat[begin:end],
            missing,
        )
    return out, missing


def fill_run(
    sign: float,
    steps: tuple[float, float],
    rows: tuple[int, int, int, int],
    flow: bool,
    parameters: list[FloatArray],
    states: FloatArray,
    start: FloatArray,
    out: FloatArray,
    status: NDArray[np.int8],
    missing: NDArray[np.int64],
    threads: int | None,
) -> None:
    """Fill the rows of `out`, (N, B, 2), that belong to a `Run`.

    start    (1,) or (B,): the number n of each of the given states; rows of smaller n stay.
    status   (B,), receives how trajectories end, or (0,); negative where the closed form may not be
             used.
    """
    begin, end, origin, direction = rows
    low = begin // GROUP * GROUP
    for lanes, (upper, lower) in slices(len(states), end - low):
        top, bottom = max(low + upper, begin), low + lower
        _threads.run(
            equal_steps.fill_run,
            (lanes[1] - lanes[0]) * (loops.ENTERING + bottom - top),
            threads,
            flow,
            sign,
            *parameters,
            states,
            start,
            steps,
            lanes,
            (top, bottom, origin, direction),
            out,
            status,
            missing,
        )


def runs_of(times: NDArray[Any], flow: bool) -> list[Run]:
    """The runs of equal steps that the times make up, one for each sign; none if they do not.

    Runs of steps of the map begin where n is smaller than the step, so that a state does not depend
    on which others are asked for.
    """
    if times.size < SHORTEST:
        return []
    low, high = times[0].item(), times[-1].item()
    if isinstance(low, int) and max(abs(low), abs(high)) > _EXACT:
        return runs_of(times.astype(np.float64), flow)
    every = (high - low) / (times.size - 1)
    if every == 0.0 or not math.isfinite(every):
        return []
    if every < 0.0:
        return [_turned(run, times.size) for run in runs_of(times[::-1], flow)]
    negative = int(np.searchsorted(times, 0))
    runs = []
    for sign, outward, origin in (
        (-1, times[:negative][::-1], negative - 1),
        (1, times[negative:], negative),
    ):
        if outward.size and not _equal_steps(outward, sign * every):
            return []
        if outward.size:
            nearest = abs(float(outward[0]))
            skipped = 0 if flow or nearest != math.floor(nearest) else int(nearest // every)
            begin, end = skipped, skipped + outward.size
            first = nearest - skipped * every
            origin -= sign * skipped
            runs.append(Run(float(sign), (first, every), (begin, end, origin, sign)))
    return runs


def _turned(run: Run, size: int) -> Run:
    begin, end, origin, direction = run.rows
    return run._replace(rows=(begin, end, size - 1 - origin, -direction))


def _equal_steps(times: NDArray[Any], every: float) -> bool:
    """Whether each time is the first and so many steps, to one unit of its own last place.

    Part after part, so that what is made on the way stays in the caches.
    """
    first, numbers = float(times[0]), np.arange(float(min(times.size, _IN_CACHE)))
    room = np.empty_like(numbers)
    for begin in range(0, times.size, _IN_CACHE):
        some = times[begin : begin + _IN_CACHE]
        expected = np.add(numbers[: some.size], begin, out=room[: some.size])
        expected *= every
        expected += first
        if (some == expected).all():
            continue
        if not np.isfinite(some).all() or (abs(some - expected) > abs(some) * 2.0**-52).any():
            return False
    return True
