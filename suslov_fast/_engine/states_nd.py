"""Quantities of states in n dimensions: from checked states to the kernel, and back."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._checks import LARGE, FloatArray, real_array
from .._kernels import states_nd
from . import threads as _threads
from .layout import flat_parameter, flat_rows, for_kernel

# States that one task takes at least, and tasks: more than the threads of most machines.
_TOGETHER, _TASKS = 64, 64
# The cost of a component of a state, in steps of the map.
_WORK = 4
# Numbers of states that are copied at a time.
_COPIES = 2**20


def of_state_nd(
    quantity: int,
    body: Any,
    omega: FloatArray,
    eps: float | FloatArray | None,
    batch: tuple[int, ...],
    threads: int | None,
    result: tuple[int, ...] = (),
    following: FloatArray | None = None,
) -> FloatArray:
    """Return a quantity (..., *result) of states; `following` are the next ones where needed."""
    out = np.empty((*batch, *result))
    count, m = math.prod(batch), body.dimension
    if not count:
        return out
    eps = 1.0 if eps is None else eps
    parameters = [np.asarray(each) for each in (*body.parameters, eps)]
    own = [each.shape[:-1] for each in parameters[:2]] + [parameters[2].shape]
    # Behind these axes of the batch the bodies repeat.
    axes = batch[len(batch) - max(map(_depth, own)) :]
    flat = tuple(
        (flat_rows if k < 2 else flat_parameter)(_spread(each, own[k], axes), axes)
        for k, each in enumerate(parameters)
    )
    states = np.broadcast_to(omega, (*batch, m))
    after = states if following is None else np.broadcast_to(following, (*batch, m))
    results, size = out.reshape(count, -1), math.prod(result)
    step = count
    if not states.flags.carray or not after.flags.carray:
        period = math.prod(axes)
        step = max(_COPIES // (m * period), 1) * period  # whole periods
    for begin in range(0, count, step):
        end = min(begin + step, count)
        some = _rows(states, begin, end)
        tasks = min(-(-(end - begin) // _TOGETHER), _TASKS)
        infinite = np.zeros(tasks, np.int8)
        _threads.run(
            states_nd.evaluate,
            _WORK * (end - begin) * max(m, size),
            threads,
            quantity,
            flat,
            some,
            some if following is None else _rows(after, begin, end),
            results[begin:end],
            np.empty((tasks, states_nd.ROWS, m)),
            infinite,
        )
        if omega.size > LARGE and infinite.any():
            real_array("omega", omega, allow_nan=True)
    return out[()]


def _depth(shape: tuple[int, ...]) -> int:
    """Return how many of the last axes vary."""
    return next((len(shape) - k for k, length in enumerate(shape) if length != 1), 0)


def _spread(array: FloatArray, shape: tuple[int, ...], axes: tuple[int, ...]) -> FloatArray:
    """Drop the leading axes of length 1 that do not belong to `axes`."""
    extra = max(len(shape) - len(axes), 0)
    return array.reshape(array.shape[extra:])


def _rows(states: FloatArray, begin: int, end: int) -> FloatArray:
    """Return some states (count, m) in C order."""
    if states.flags.carray or (begin == 0 and end == math.prod(states.shape[:-1])):
        return for_kernel(states).reshape(-1, states.shape[-1])[begin:end]
    index = np.unravel_index(np.arange(begin, end), states.shape[:-1])
    return for_kernel(states[index])
