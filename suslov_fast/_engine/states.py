"""From checked states to the kernels that find a quantity of each, and back."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .._checks import LARGE, FloatArray, real_array
from .._jit import Kernel
from .._kernels.states import INFINITE, LANES
from . import threads as _threads
from .layout import flat_parameter, for_kernel, spell
from .status import SingularStepWarning

# More than the threads of any machine that this is likely to meet.
TASKS = 64
# The cost of a state, in steps of the map.
WORK = 4
# States that NumPy works on at a time, and numbers that are copied at a time for a kernel.
SLAB, COPIES = 2**15, 2**20
# Bodies that repeat at each time of a run are repeated until they are so many: whole blocks.
REPEATED = 8 * LANES

Index = tuple[Any, ...]
_Part = tuple[int, tuple[FloatArray, ...], FloatArray, int]


def of_state(
    kernel: Kernel,
    shape: tuple[int, ...],
    body: Any,
    omega: FloatArray,
    eps: float | FloatArray | None,
    batch: tuple[int, ...],
    threads: int | None,
    name: str = "omega",
    warn: bool = False,
) -> FloatArray:
    """Return a quantity (..., *shape) of states whose body has parameters of one number each.

    One warning counts the states that have no result, with `warn`; `name` is that of the argument
    that holds the states.
    """
    out = np.empty((*batch, *shape))
    results = out.reshape(-1, math.prod(shape))
    missing: list[tuple[int, int]] = []
    for begin, parameters, states, period in _parts(body, eps, omega, batch):
        count = len(states)
        blocks = -(-period // LANES) * -(-count // period)
        report = np.zeros((min(blocks, TASKS), 3), np.int64)
        out_part = results[begin : begin + count]
        _threads.run(kernel, WORK * count, threads, parameters, states, out_part, period, report)
        if omega.size > LARGE and report[:, INFINITE].any():
            real_array(name, omega, allow_nan=True)
        if warn:
            missing += [(begin + first, n) for n, first, _ in report.tolist() if n]
    if missing:
        warn_of_missing(sum(n for _, n in missing), min(missing)[0], batch, stacklevel=5)
    return out[()]


def by_slabs(
    function: Callable[..., FloatArray],
    body: Any,
    omega: FloatArray,
    eps: float | FloatArray,
    batch: tuple[int, ...],
    result: tuple[int, ...] = (),
    warn: bool = False,
) -> FloatArray:
    """Return a quantity that NumPy finds: `function(body, omega, eps)`, of SLAB states at a time.

    Temporary arrays never have the size of all states.
    """
    real_array("omega", omega, allow_nan=True)
    out = np.empty((*batch, *result))
    full, steps = np.broadcast_to(omega, (*batch, omega.shape[-1])), np.broadcast_to(eps, batch)
    lost = np.zeros(batch, bool)
    for part in _slabs(batch, SLAB):
        some = full[part]
        out[part] = values = function(_part_of_body(body, batch, part), some, steps[part])
        if warn:
            absent = np.isnan(values.reshape((*some.shape[:-1], -1))[..., 0])
            lost[part] = absent & ~np.isnan(some).any(axis=-1)
    if lost.any():
        warn_of_missing(int(np.count_nonzero(lost)), int(np.argmax(lost)), batch, stacklevel=6)
    return out[()]


def warn_of_missing(count: int, first: int, batch: tuple[int, ...], stacklevel: int) -> None:
    """Warn of states that have no next one; `first` counts them in C order."""
    index = tuple(int(i) for i in np.unravel_index(first, batch))
    warnings.warn(
        f"{count} of {math.prod(batch)} states: singular or non-finite step, first: {spell(index)}",
        SingularStepWarning,
        stacklevel=stacklevel,
    )


def _parts(
    body: Any, eps: float | FloatArray | None, omega: FloatArray, batch: tuple[int, ...]
) -> Iterator[_Part]:
    """Yield the first state, parameters, states (count, 2) and the period of each kernel call.

    The last parameter is eps, or 1 where none is needed. One call takes all states if few numbers
    must be copied for it, else slab after slab.
    """
    eps = 1.0 if eps is None else eps
    if not batch:  # one state: most of the time of a call would go into what follows
        yield 0, (*_one(body), flat_parameter(eps, ())), for_kernel(omega).reshape(1, -1), 1
        return
    size = math.prod(batch)
    if not size:
        return
    given = [np.asarray(each) for each in (*body.parameters, eps)]
    varying = [each for each in given if each.size > 1]
    # Behind these axes of the batch the bodies repeat.
    depth = max((_depth(each.shape) for each in varying), default=len(batch))
    axes = batch[len(batch) - depth :]
    period = math.prod(axes)
    copies = sum(period for each in varying if each.shape != axes or not each.flags.carray)
    if omega.shape[:-1] != batch:
        omega = np.broadcast_to(omega, (*batch, omega.shape[-1]))
    if not omega.flags.carray:
        copies += 2 * size
    if copies <= max(COPIES, size // 4):
        parameters = _flat(given, axes, ...)
        if varying and period < min(REPEATED, size):
            times = min(REPEATED, size) // period + 1
            parameters = tuple(np.tile(p, times) if p.size > 1 else p for p in parameters)
            period *= times
        yield 0, parameters, for_kernel(omega).reshape(size, -1), period
        return
    begin = 0
    for part in _slabs(batch, COPIES // 4):
        states = for_kernel(omega[part]).reshape(-1, omega.shape[-1])
        yield begin, _flat(given, batch, part), states, len(states)
        begin += len(states)


def _one(body: Any) -> tuple[FloatArray, ...]:
    """Return the parameters of a single body as kernels take them."""
    parameters: tuple[FloatArray, ...] | None = vars(body).get("_one")
    if parameters is None:
        parameters = tuple(flat_parameter(each, ()) for each in body.parameters)
        vars(body)["_one"] = parameters
    return parameters


def _depth(shape: tuple[int, ...]) -> int:
    """Return the number of axes from the first that varies on."""
    return next(len(shape) - k for k, length in enumerate(shape) if length != 1)


def _flat(given: list[FloatArray], batch: tuple[int, ...], part: Any) -> tuple[FloatArray, ...]:
    """Return one number of each parameter that does not vary, and those of a part of the others."""
    flat = []
    for each in given:
        if each.size > 1:
            shape = each.shape[max(each.ndim - len(batch), 0) :]
            each = each.reshape(shape)
            each = each[part] if shape == batch else np.broadcast_to(each, batch)[part]
        flat.append(for_kernel(each).reshape(-1))
    return tuple(flat)


def _slabs(batch: tuple[int, ...], most: int) -> Iterator[Index]:
    """Yield parts of a batch, in C order, of at most so many elements."""
    inner = math.prod(batch[1:])
    if not batch:
        yield ()
    elif inner <= most:
        rows = most // max(inner, 1)
        for first in range(0, batch[0], rows):
            yield (slice(first, first + rows),)
    else:
        for i in range(batch[0]):
            for part in _slabs(batch[1:], most):
                yield (i, *part)


def _part_of_body(body: Any, batch: tuple[int, ...], part: Index) -> Any:
    """Return the bodies of a part of a batch; their parameters are vectors."""
    if not body.shape:
        return body
    vectors = (np.broadcast_to(each, (*batch, each.shape[-1])) for each in body.parameters)
    return type(body)(*(each[part] for each in vectors))
