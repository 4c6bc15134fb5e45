"""What all calls for batches share: flat arrays of a batch, threads, and progress."""

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

import numba
import numpy as np

import suslov_fast

from .checks import FloatArray, extra, integer, is_false, short, wrong


def flat_arrays(array: FloatArray, batch: tuple[int, ...], axes: int = 1) -> FloatArray:
    """Return an array, broadcast to the batch, as (B, ...): it keeps its last `axes` axes."""
    split = array.ndim - axes
    inner = array.shape[split:]
    if array.shape[:split] != batch:
        array = np.broadcast_to(array, (*batch, *inner))
    elif array.flags.carray:  # kernels are compiled for this memory layout alone
        return array.reshape((math.prod(batch), *inner))
    flat = array.reshape(math.prod(batch), *inner)
    return flat if flat.flags.carray else np.require(flat, np.float64, ["C", "A", "W"])


def flat_parameter(value: float | FloatArray, batch: tuple[int, ...], axes: int = 0) -> FloatArray:
    """Return a parameter as (1, ...) if the batch shares it, else as (B, ...), with `axes` axes."""
    if type(value) is float:
        return np.array([value])
    array = np.asarray(value)
    inner = array.shape[array.ndim - axes :]
    if array.size == math.prod(inner):
        array, batch = array.reshape((1, *inner)), (1,)
    return flat_arrays(array, batch, axes)


ALL = slice(None)  # the indices of a group of all trajectories


def thread_count(threads: int | None) -> int | None:
    """Return the checked number of threads of a call; None means all threads of Numba."""
    if threads is None:
        return None
    limit = int(numba.config.NUMBA_NUM_THREADS)
    expected = f"None or an integer from 1 to {limit} (NUMBA_NUM_THREADS)"
    return integer("threads", threads, 1, expected, limit)


def available() -> int:
    """Return the number of threads that Numba uses now; asking starts them."""
    return 1 if suslov_fast._threads_are_gone else int(numba.get_num_threads())


Progress = bool | None | Callable[[int, int], object]  # the argument `progress` of long calls


Report = Callable[[int], bool]  # takes the number of steps done so far; False ends the run


_SILENT = nullcontext()  # the context without `progress`, made once for speed in small calls


def reporter(progress: Progress, total: int) -> AbstractContextManager[Report | None]:
    """Check `progress`; return a context manager that gives the `Report` of a run, or None."""
    if progress is None or progress is False:
        return _SILENT
    if progress is True:
        return _bar(extra("tqdm.auto", "progress").tqdm, total)  # a notebook bar in a notebook
    if not callable(progress):
        expected = "True, for a bar, or a function that is called as progress(done, total)"
        raise wrong("progress", expected, short(progress), TypeError)
    return nullcontext(lambda done: not is_false(progress(done, total)))


@contextmanager
def _bar(tqdm: Any, total: int) -> Iterator[Report]:
    with tqdm(total=total, unit="", unit_scale=True) as bar:  # counts steps, states or trajectories
        yield lambda done: bar.update(done - bar.n) is not False
