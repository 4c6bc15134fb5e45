"""Which build of a loop runs, and on how many threads."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numba

from .._checks import integer
from .._core.jit import Loop

# Lane-steps below which a call is serial. Measured on two cores: threads that are awake gain from
# some 10,000 on, but less than 0.1 ms up to here, and one that sleeps may take 8 ms to wake.
CROSSOVER = 1_000_000

# One parallel call at a time: Numba's `workqueue` threads abort under two. Whoever comes second
# takes the serial build, whose results are the same bit for bit.
_one_at_a_time = threading.Lock()
_may_use_threads = True


def thread_count(threads: int | None) -> int | None:
    """Check the `threads` argument of a public function."""
    if threads is None:
        return None
    limit = int(numba.config.NUMBA_NUM_THREADS)
    expected = f"None or an integer from 1 to {limit} (NUMBA_NUM_THREADS)"
    count = integer("threads", threads, 1, expected)
    if count > limit:
        raise ValueError(f"threads: expected {expected}, got {count}")
    return count


def run(loop: Loop, work: int, threads: int | None, *arguments: Any) -> None:
    """Call a loop; `work` lane-steps decide between its two builds."""
    if (
        work < CROSSOVER
        or (threads or numba.config.NUMBA_NUM_THREADS) == 1
        or not _may_use_threads
        or not _one_at_a_time.acquire(blocking=False)
    ):
        loop.serial(*arguments)
        return
    try:
        with _numba_threads(threads):
            loop.parallel(*arguments)
    finally:
        _one_at_a_time.release()


@contextmanager
def _numba_threads(threads: int | None) -> Iterator[None]:
    if threads is None:
        yield
        return
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _after_fork() -> None:
    """Stay serial in a child of a process whose OpenMP threads ran: they would abort it."""
    global _may_use_threads, _one_at_a_time
    _one_at_a_time = threading.Lock()
    with suppress(ValueError):  # no thread was ever started
        _may_use_threads = numba.threading_layer() != "omp"


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
