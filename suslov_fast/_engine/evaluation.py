"""Evaluation of quantities of checked states by kernels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numpy as np

from .._checks import LARGE_ARRAY, FloatArray, real_array, spell, warn
from .._jit import Kernel
from .._kernels import quantities_3d as kernels
from .._kernels.lanes import LANES
from .._kernels.quantities_nd import ROWS
from . import threads as _threads
from .arguments import States
from .closed_form_runs import with_rotor
from .layout import flat_body, flat_parameter, for_kernel
from .status import SingularStepWarning

# At least the number of threads.
TASKS = max(64, numba.config.NUMBA_NUM_THREADS)
# Cost of a state, or of a component in n dimensions, in steps of the map.
WORK = 4
# Least number of states of a task in n dimensions.
_LEAST = 64
# Numbers of states that NumPy processes at a time, and of components that a kernel does: memory
# of copies for these is used again.
SLAB, NUMBERS = 2**15, 2**19
# Bodies are repeated, as at the times of a run, up to this number: whole blocks.
REPEATED = 8 * LANES

Index = tuple[Any, ...]
# Arguments of a call of a kernel: the index of the first state; parameters, the last of them eps;
# states (count, D); and the period of the bodies. A parameter is (1, ...) or (period, ...).
_Part = tuple[int, tuple[FloatArray, ...], FloatArray, int]


def of_state(kernel: Kernel, shape: tuple[int, ...], states: States) -> FloatArray:
    """Return a quantity (..., *shape) in three dimensions; one warning counts what is missing."""
    out = np.empty((*states.batch, *shape))
    results = out.reshape(-1, math.prod(shape))
    missing: list[tuple[int, int]] = []
    work = WORK * len(results)
    for begin, parameters, omega, period in _parts(states):
        count = len(omega)
        tasks = min(-(-period // LANES) * -(-count // period), TASKS)
        counts = np.zeros((tasks, 3), np.int64)
        arguments = with_rotor(parameters), omega, results[begin : begin + count], period, counts
        _threads.call_kernel(kernel, work, states.threads, *arguments)
        if states.omega.size > LARGE_ARRAY and counts[:, kernels.INFINITE].any():
            real_array(states.name, states.omega, allow_nan=True)
        missing += [(begin + first, n) for n, first, _ in counts.tolist() if n]
    if missing:
        warn_of_missing(sum(n for _, n in missing), min(missing)[0], states.batch)
    return out[()]


def of_state_nd(
    kernel: Kernel, axes: int, states: States, following: FloatArray | None = None
) -> FloatArray:
    """Return a quantity with `axes` axes in n dimensions; `following` are the next states, flat."""
    m = states.body.dimension
    out = np.empty((*states.batch, *(m,) * axes))
    results = out.reshape(-1, m**axes)
    work = WORK * len(results) * max(m, results.shape[1])
    for begin, parameters, omega, _ in _parts(states):
        end = begin + len(omega)
        after = omega if following is None else following.reshape(-1, m)[begin:end]
        tasks = min(-(-len(omega) // _LEAST), TASKS)
        scratch, infinite = np.empty((tasks, ROWS, m)), np.zeros(tasks, np.int8)
        arguments = parameters, omega, after, results[begin:end], scratch, infinite
        _threads.call_kernel(kernel, work, states.threads, *arguments)
        if states.omega.size > LARGE_ARRAY and infinite.any():
            real_array("omega", states.omega, allow_nan=True)
    return out[()]


def by_slabs(
    function: Callable[..., FloatArray],
    axes: int,
    states: States,
    warn: bool = False,
    most: int = SLAB,
) -> FloatArray:
    """Return a quantity with `axes` axes, `function(body, omega, eps)` by NumPy, in small parts."""
    body, omega, eps, batch, *_ = states
    real_array("omega", omega, allow_nan=True)
    result = (body.dimension,) * axes
    out, lost = np.empty((*batch, *result)), np.zeros(batch, bool)
    omega, eps = _over(batch, omega, 1), _over(batch, np.asarray(eps))
    arrays = body._arrays if body.shape else {}
    arrays = {name: _over(batch, array, body._axes(name)) for name, array in arrays.items()}
    for part in _portions(batch, most):
        bodies = body._of({name: array[part] for name, array in arrays.items()}) if arrays else body
        out[part] = values = function(bodies, omega[part], eps[part])
        if warn:
            absent = np.isnan(values.reshape((*omega[part].shape[:-1], math.prod(result)))[..., 0])
            lost[part] = absent & ~np.isnan(omega[part]).any(axis=-1)
    if lost.any():
        warn_of_missing(int(lost.sum()), int(np.argmax(lost)), batch)
    return out[()]


def warn_of_missing(
    count: int,
    first: int,
    batch: tuple[int, ...],
    what: str = "states: singular step or out of range",
) -> None:
    """Warn of states without a next state; `first` counts states in C order."""
    index = spell(tuple(map(int, np.unravel_index(first, batch))))
    warn(f"{count} of {math.prod(batch)} {what}, first: {index}", SingularStepWarning)


def _over(batch: tuple[int, ...], array: FloatArray, axes: int = 0) -> FloatArray:
    """Return an array, of which `axes` axes are not those of the batch, broadcast to the batch."""
    shape = (*batch, *array.shape[array.ndim - axes :])
    # `broadcast_to` returns a read-only array, which would be copied for the kernel.
    return array if array.shape == shape else np.broadcast_to(array, shape)


def _parts(states: States) -> Iterator[_Part]:
    """Yield the parts of a batch, whose size limits the memory of copies for the kernel."""
    body, omega, eps, batch, *_ = states
    if not batch:  # one state: the code below would take most of the time of a call
        parameters = *flat_body(body, ()), flat_parameter(eps, ())
        yield 0, parameters, for_kernel(omega).reshape(1, -1), 1
        return
    D, omega = omega.shape[-1], _over(batch, omega, 1)
    values = [_over(batch, np.asarray(value), body._vector_axes) for value in body.parameters]
    values.append(_over(batch, np.asarray(eps)))
    begin = 0
    for part in _portions(batch, max(NUMBERS // D, 1)):
        flat = for_kernel(omega[part]).reshape(-1, D)
        parameters, count = (
            _flat([value[part] for value in values], omega[part].ndim - 1),
            len(flat),
        )
        period = max(map(len, parameters))
        if period == 1:  # one body
            period = count
        elif body._vector_axes == 0 and period < min(REPEATED, count):
            times = min(REPEATED, count) // period + 1
            parameters = tuple(np.tile(p, times) if p.size > 1 else p for p in parameters)
            period *= times
        yield begin, parameters, flat, period
        begin += count


def _flat(values: list[FloatArray], ndim: int) -> tuple[FloatArray, ...]:
    """Return parameters as (1, ...), or (period, ...) from the first axis along which they vary."""

    def varies(array: FloatArray, k: int) -> bool:
        return array.shape[k] > 1 and array.strides[k] != 0

    def rows(array: FloatArray) -> FloatArray:
        skipped = first if any(varies(array, k) for k in range(ndim)) else ndim
        return for_kernel(array[(0,) * skipped]).reshape((-1, *array.shape[ndim:]))

    first = next((k for k in range(ndim) if any(varies(a, k) for a in values)), ndim)
    return tuple(map(rows, values))


def _portions(batch: tuple[int, ...], most: int) -> Iterator[Index]:
    """Yield parts of a batch, in C order, of at most `most` elements."""
    if not batch:
        yield ()
    if not batch or 0 in batch:
        return
    # Parts are divided along the first axis whose elements are small enough.
    sizes = [math.prod(batch[k + 1 :]) for k in range(len(batch))]
    axis = next(k for k, size in enumerate(sizes) if size <= most)
    rows = most // sizes[axis]
    for index in np.ndindex(batch[:axis]):
        for first in range(0, batch[axis], rows):
            yield (*index, slice(first, first + rows))
