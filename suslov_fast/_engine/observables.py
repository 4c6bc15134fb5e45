"""From checked states to the loops that find a quantity of each, and back."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import LARGE, FloatArray, real_array
from .._core.cpu import observables, observables_nd
from .._core.cpu.blocks import LANES, TASKS
from .._core.jit import Loop
from . import threads as _threads
from .arguments import Body
from .layout import flat_parameter, for_kernel, spell
from .status import SingularStepWarning
from .units import flat_of_one

# What a state costs, in steps of the map.
WORK = 4
# States that NumPy works on at a time, and those of which copies are made for a loop.
SLAB, LARGE_SLAB = 2**15, 2**18
# Bodies that repeat at each time of a run are repeated until they are so many: whole blocks.
REPEATED = 8 * LANES

# How many axes of components the parameters have.
_SCALARS, _VECTORS = (0, 0, 0, 0, 0), (1, 1, 0)

Quantity = Callable[..., FloatArray]


def of_state(
    loop: Loop,
    body: Suslov3D,
    omega: FloatArray,
    eps: float | FloatArray | None,
    batch: tuple[int, ...],
    threads: int | None,
    size: int = 0,
    name: str = "omega",
) -> FloatArray:
    """A quantity of states of a 3D body: (...), or (..., size) if it has several numbers.

    States without a result, where the loop counts them, are told in one warning; `name` is that of
    the argument that holds the states.
    """
    out = np.empty((*batch, size) if size else batch)
    flat, size = out.reshape(-1), size or 1
    missing: list[Any] = []
    for begin, arrays, states, period in _parts(body, eps, _SCALARS, (omega,), batch):
        count = states[0].size // 2
        tasks = _tasks(count, period, LANES, TASKS)
        report = np.zeros((tasks, 3), np.int64)
        _threads.run(
            loop,
            WORK * count,
            threads,
            *arrays,
            *states,
            flat[begin * size : (begin + count) * size],
            period,
            report,
        )
        if omega.size > LARGE and report[:, observables.INFINITE].any():
            real_array(name, omega, allow_nan=True)
        missing += [(begin + first, n) for n, first, _ in report.tolist() if n]
    if missing:
        _warn_of_missing(sum(n for _, n in missing), min(missing)[0], batch)
    return out[()]


def of_state_nd(
    loop: Loop,
    body: SuslovND,
    omega: FloatArray,
    eps: float | FloatArray | None,
    batch: tuple[int, ...],
    threads: int | None,
    result: tuple[int, ...] = (),
    following: FloatArray | None = None,
) -> FloatArray:
    """A quantity of states of an n-dimensional body, of shape (..., *result)."""
    out = np.empty((*batch, *result))
    flat, size, m = out.reshape(-1), math.prod(result), body.dimension
    vectors = (omega,) if following is None else (omega, following)
    for begin, arrays, states, period in _parts(body, eps, _VECTORS, vectors, batch):
        count = states[0].size // m
        tasks = _tasks(count, period, observables_nd.LANES, TASKS)
        infinite = np.empty(tasks, np.int8)
        _threads.run(
            loop,
            WORK * count * max(m, size),
            threads,
            *arrays,
            states[0],
            states[-1],
            flat[begin * size : (begin + count) * size],
            m,
            period,
            infinite,
            np.empty((tasks, observables_nd.scratch_size(m))),
            np.empty((tasks, observables_nd.LOGARITHMS, observables_nd.LANES), np.int64),
        )
        if omega.size > LARGE and infinite.any():
            real_array("omega", omega, allow_nan=True)
    return out[()]


def by_slabs(
    function: Quantity,
    body: Body,
    omega: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    result: tuple[int, ...] = (),
    warn: bool = False,
) -> FloatArray:
    """A quantity that NumPy finds: `function(body, omega, eps)` of some states after others.

    What NumPy needs on its way never has the size of all states.
    """
    real_array("omega", omega, allow_nan=True)
    out = np.empty((*batch, *result))
    full, steps = np.broadcast_to(omega, (*batch, omega.shape[-1])), np.broadcast_to(eps, batch)
    count, first, begin = 0, 0, 0
    for part in _slabs(batch, SLAB):
        some = full[part]
        values = function(_part_of_body(body, batch, part), some, steps[part])
        out[part] = values
        if warn:
            lost = np.isnan(values.reshape((*some.shape[:-1], -1))[..., 0])
            lost = (lost & ~np.isnan(some).any(axis=-1)).reshape(-1)
            first = first if count or not lost.any() else begin + int(np.argmax(lost))
            count += int(np.count_nonzero(lost))
            begin += lost.size
    if count:
        _warn_of_missing(count, first, batch)
    return out[()]


def _warn_of_missing(count: int, first: int, batch: tuple[int, ...]) -> None:
    """Say once how many states have no next one; `first` counts them in C order."""
    index = tuple(int(i) for i in np.unravel_index(first, batch))
    message = (
        f"{count} of {math.prod(batch)} states: singular or non-finite step, first: {spell(index)}"
    )
    warnings.warn(message, SingularStepWarning, stacklevel=4)


def _tasks(count: int, period: int, lanes: int, most: int) -> int:
    """The tasks that share so many states, which repeat some bodies."""
    blocks = -(-period // lanes) * -(-count // max(period, 1))
    return min(blocks, most)


_Part = tuple[int, Sequence[FloatArray], Sequence[FloatArray], int]


def _parts(
    body: Body,
    eps: float | FloatArray | None,
    trailing: Sequence[int],
    vectors: Sequence[FloatArray],
    batch: tuple[int, ...],
) -> Iterator[_Part]:
    """Flat arrays as loops take them: the first state, parameters, states, and the period.

    The last parameter is eps, or 1 where none is needed. All at once where the arrays serve as they
    are or copies are small; else slab after slab.
    """
    if eps is None:
        eps = 1.0
    if not batch:  # one state: most of the time of a call would go into what follows
        one = [*flat_of_one(body), flat_parameter(eps, ())]
        yield 0, one, [for_kernel(v).reshape(-1) for v in vectors], 1
        return
    size = math.prod(batch)
    if not size:
        return
    given = [np.asarray(each) for each in (*body.parameters, eps)]
    own = [each.shape[each.ndim - k :] for each, k in zip(given, trailing, strict=True)]
    varying = [
        _without_leading_ones(each.shape[: each.ndim - k])
        for each, k in zip(given, trailing, strict=True)
    ]
    axes = batch[len(batch) - max(map(len, varying)) :]
    period = math.prod(axes) if any(varying) else size
    small = size <= LARGE_SLAB
    states_serve = small or all(v.shape[:-1] == batch and _is_plain(v) for v in vectors)
    parameters_serve = (
        small
        or 4 * period <= size
        or all(_is_plain(e) and v in ((), axes) for e, v in zip(given, varying, strict=True))
    )
    whole = states_serve and parameters_serve
    over = axes if whole else batch
    spread = [
        np.broadcast_to(each.reshape(shape + components), over + components) if shape else each
        for each, shape, components in zip(given, varying, own, strict=True)
    ]
    states = [
        np.broadcast_to(v, (*batch, v.shape[-1])) if v.shape[:-1] != batch else v for v in vectors
    ]
    if whole:
        flat = [for_kernel(each).reshape(-1) for each in spread]
        if any(varying) and period < min(REPEATED, size):
            times = min(REPEATED, size) // period + 1
            flat = [np.tile(e, times) if v else e for e, v in zip(flat, varying, strict=True)]
            period *= times
        yield 0, flat, [for_kernel(v).reshape(-1) for v in states], period
        return
    begin = 0
    for part in _slabs(batch, LARGE_SLAB):
        some = [for_kernel(v[part]).reshape(-1) for v in states]
        count = len(some[0]) // states[0].shape[-1]
        flat = [
            for_kernel(each[part] if shape else each).reshape(-1)
            for each, shape in zip(spread, varying, strict=True)
        ]
        yield begin, flat, some, count
        begin += count


def _without_leading_ones(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The axes of a shape that vary, with those of length 1 between them."""
    for k, length in enumerate(shape):
        if length != 1:
            return shape[k:]
    return ()


def _is_plain(array: FloatArray) -> bool:
    return bool(array.flags.carray)


def _slabs(batch: tuple[int, ...], most: int) -> Iterator[tuple[Any, ...]]:
    """Parts of a batch, in C order, of at most so many elements."""
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


def _part_of_body(body: Body, batch: tuple[int, ...], part: tuple[Any, ...]) -> Body:
    """The bodies of a part of a batch."""
    if not body.shape:
        return body
    k = 1 if isinstance(body, SuslovND) else 0
    some = []
    for each in map(np.asarray, body.parameters):
        own = each.shape[each.ndim - k :] if k else ()
        some.append(np.broadcast_to(each, (*batch, *own))[part])
    return type(body)(*some)
