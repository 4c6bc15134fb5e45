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
    for begin, parameters, some, period in _parts(states):
        count = len(some)
        parameters = with_rotor(parameters)
        tasks = min(-(-period // LANES) * -(-count // period), TASKS)
        counts = np.zeros((tasks, 3), np.int64)
        out_part = results[begin : begin + count]
        _threads.run(kernel, work, states.threads, parameters, some, out_part, period, counts)
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
    for begin, parameters, some, _ in _parts(states):
        end = begin + len(some)
        after = some if following is None else following.reshape(-1, m)[begin:end]
        tasks = min(-(-len(some) // _LEAST), TASKS)
        scratch, infinite = np.empty((tasks, ROWS, m)), np.zeros(tasks, np.int8)
        arguments = parameters, some, after, results[begin:end], scratch, infinite
        _threads.run(kernel, work, states.threads, *arguments)
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
    out = np.empty((*batch, *result))
    whole = (*batch, omega.shape[-1])
    full = omega if omega.shape == whole else np.broadcast_to(omega, whole)
    steps = np.broadcast_to(eps, batch)
    parameters = {
        name: np.broadcast_to(each, (*batch, *each.shape[each.ndim - body._axes(name) :]))
        for name, each in (body._arrays if body.shape else {}).items()
    }
    lost = np.zeros(batch, bool)
    for part in _portions(batch, most):
        some = full[part]
        bodies = body
        if body.shape:
            bodies = body._of({name: each[part] for name, each in parameters.items()})
        out[part] = values = function(bodies, some, steps[part])
        if warn:
            absent = np.isnan(values.reshape((*some.shape[:-1], math.prod(result)))[..., 0])
            lost[part] = absent & ~np.isnan(some).any(axis=-1)
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


def _parts(states: States) -> Iterator[_Part]:
    """Yield the parts of a batch, whose size limits the memory of copies for the kernel."""
    body, omega, eps, batch, *_ = states
    if not batch:  # one state: the code below would take most of the time of a call
        parameters = *flat_body(body, ()), flat_parameter(eps, ())
        yield 0, parameters, for_kernel(omega).reshape(1, -1), 1
        return
    own, D = body._vector_axes, omega.shape[-1]
    # `broadcast_to` returns a read-only array, which would be copied for the kernel.
    whole = omega if omega.shape == (*batch, D) else np.broadcast_to(omega, (*batch, D))
    values = [
        np.broadcast_to(each, (*batch, *np.shape(each)[np.ndim(each) - own :]))
        for each in body.parameters
    ]
    values.append(np.broadcast_to(eps, batch))
    begin = 0
    for part in _portions(batch, max(NUMBERS // D, 1)):
        some = for_kernel(whole[part]).reshape(-1, D)
        parameters = _flat([each[part] for each in values], whole[part].ndim - 1)
        period = max(map(len, parameters))
        if period == 1:  # one body
            period = len(some)
        elif own == 0 and period < min(REPEATED, len(some)):
            times = min(REPEATED, len(some)) // period + 1
            parameters = tuple(np.tile(p, times) if p.size > 1 else p for p in parameters)
            period *= times
        yield begin, parameters, some, period
        begin += len(some)


def _flat(values: list[FloatArray], ndim: int) -> tuple[FloatArray, ...]:
    """Return parameters as (1, ...), or (period, ...) from the first axis along which they vary."""
    varies = [[each.shape[k] > 1 and each.strides[k] != 0 for k in range(ndim)] for each in values]
    first = min((axes.index(True) for axes in varies if any(axes)), default=ndim)
    return tuple(
        for_kernel(each[(0,) * (first if any(axes) else ndim)]).reshape((-1, *each.shape[ndim:]))
        for each, axes in zip(values, varies, strict=True)
    )


def _portions(batch: tuple[int, ...], most: int) -> Iterator[Index]:
    """Yield parts of a batch, in C order, of at most `most` elements."""
    inner = math.prod(batch[1:])
    if not batch:
        yield ()
    elif 0 in batch:
        return
    elif inner <= most:
        rows = most // inner
        for first in range(0, batch[0], rows):
            yield (slice(first, first + rows),)
    else:
        for i in range(batch[0]):
            for part in _portions(batch[1:], most):
                yield (i, *part)
