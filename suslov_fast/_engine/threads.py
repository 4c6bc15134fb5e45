"""Calls of kernels, on one thread or several.

Kernels release the GIL, so the threads are those of Python: they are as safe in signal handlers, in
forked children and in concurrent calls as Python itself.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import cache
from queue import SimpleQueue
from typing import Any, TypeAlias

import numba

from .._checks import integer
from .._jit import Kernel

# Lane-steps below which a call takes one thread. Measured on two cores: active threads gain from
# some 10,000 on, but less than 0.1 ms up to here, and a sleeping thread may take 8 ms to wake.
CROSSOVER = 1_000_000

Task: TypeAlias = "tuple[Future[None], Callable[[], None]]"


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


def available() -> int:
    """Return the number of threads of a call: that of `numba.set_num_threads`, if it was used.

    Numba would start threads of its own if it was asked before.
    """
    try:
        numba.threading_layer()
    except ValueError:
        return int(numba.config.NUMBA_NUM_THREADS)
    return int(numba.get_num_threads())


def run(kernel: Kernel, work: int, threads: int | None, *arguments: Any) -> None:
    """Call a kernel; `work` lane-steps decide between one thread and several."""
    count = 1 if work < CROSSOVER else threads or available()
    tasks = _tasks_of_helpers() if count > 1 else None
    if tasks is None:
        kernel.compiled(0, 1, *arguments)
    else:
        _in_parts(kernel, count, arguments, tasks)


def _in_parts(
    kernel: Kernel, count: int, arguments: tuple[Any, ...], tasks: SimpleQueue[Task]
) -> None:
    """Call a kernel for each part; this thread computes what no helper has begun."""
    parts = iter(range(count))

    def compute() -> None:
        for part in parts:
            kernel.compiled(part, count, *arguments)

    helped: list[Future[None]] = [Future() for _ in range(count - 1)]
    try:
        for each in helped:
            tasks.put((each, compute))
        compute()
    finally:
        errors = [each.exception() for each in helped if not each.cancel()]
    for error in filter(None, errors):
        raise error


def _help(tasks: SimpleQueue[Task]) -> None:
    """Do tasks as long as the process runs."""
    while True:
        future, compute = tasks.get()
        if future.set_running_or_notify_cancel():
            try:
                future.set_result(compute())
            except BaseException as error:
                future.set_exception(error)
        del future, compute  # and the arrays


@cache
def _tasks_of_helpers() -> SimpleQueue[Task] | None:
    """Return the queue of started threads, or None if the system has no room for them."""
    # A queue that the handler of a signal may use during a call, unlike ThreadPoolExecutor.
    tasks: SimpleQueue[Task] = SimpleQueue()
    try:
        for _ in range(numba.config.NUMBA_NUM_THREADS - 1):
            threading.Thread(target=_help, args=(tasks,), daemon=True).start()
    except (RuntimeError, MemoryError):
        return None
    return tasks


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_tasks_of_helpers.cache_clear)
