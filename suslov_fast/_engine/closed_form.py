"""The closed form over a batch and many times, in parts between which Python looks for Ctrl-C."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._core.cpu import closed_form as loops
from .._core.cpu.blocks import TASKS
from .._core.cpu.vector import VECTOR
from . import threads as _threads
from .layout import flat_parameter, flat_vectors, for_kernel

# States of one call of a loop: some 10 ms.
SLICE = 2**22


def scratch() -> FloatArray:
    """Room for the tasks of a loop, on a cache line."""
    size = TASKS * loops.SCRATCH
    buffer = np.empty(size + VECTOR)
    offset = -(buffer.ctypes.data // buffer.itemsize) % VECTOR
    return buffer[offset : offset + size].reshape(TASKS, loops.SCRATCH)


Range = tuple[int, int]


def slices(batch: int, rows: int) -> Iterator[tuple[Range, Range]]:
    """Trajectories and rows of each of the calls that a long one is cut into.

    Both begin at multiples of what loops take together, WIDTH trajectories and GROUP rows.
    """
    width = max(SLICE // max(min(rows, loops.GROUP), 1) // loops.WIDTH * loops.WIDTH, loops.WIDTH)
    width = min(batch, width)
    height = max(SLICE // max(width, 1) // loops.GROUP * loops.GROUP, loops.GROUP)
    for lane in range(0, batch, max(width, 1)):
        for row in range(0, rows, height):
            yield (lane, min(lane + width, batch)), (row, min(row + height, rows))


def states_at(
    body: Suslov3D,
    state: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    times: FloatArray,
    flow: bool,
    threads: int | None,
) -> tuple[FloatArray, NDArray[np.int64]]:
    """States (N, ..., 2) at times (N,), and how many are missing at steps and between them."""
    out = _new((times.size, *batch, 2))
    return out, _fill(body, state, eps, batch, times, flow, threads, out)


def _new(shape: tuple[int, ...]) -> FloatArray:
    """An array, or an error that says what was asked for."""
    try:
        if math.prod(shape) > 2**60:  # more than NumPy could even ask for
            raise MemoryError
        return np.empty(shape)
    except MemoryError as error:
        raise MemoryError(f"expected states that fit in memory, got shape {shape}") from error


def _fill(
    body: Suslov3D,
    state: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    times: FloatArray,
    flow: bool,
    threads: int | None,
    out: FloatArray,
) -> NDArray[np.int64]:
    states = flat_vectors(state, batch)
    step_size = flat_parameter(body.normalised_eps(eps), batch)
    parameters = [*body.flat_normalised(batch), step_size]
    flat = out.reshape(times.size, len(states), 2)
    room = scratch()
    missing = np.zeros((len(room), 2), np.int64)
    for lanes, rows in slices(len(states), times.size):
        _threads.run(
            loops.fill,
            (lanes[1] - lanes[0]) * (rows[1] - rows[0]) * loops.WORK,
            threads,
            flow,
            *parameters,
            states,
            for_kernel(times[slice(*rows)]),
            lanes,
            flat[slice(*rows)],
            missing,
            room,
        )
    return missing.sum(axis=0)
