"""Calls of kernels, serial or by several threads of Python: kernels release the GIL."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

import numba

from .._jit import Kernel

# Lane-steps below which a call is serial. Measured on two cores: threads gain from some 100,000 on,
# but less than 0.2 ms up to here.
CROSSOVER = 1_000_000

# Threads that wait for tasks; a forked child has none of them, and starts its own.
_helpers: list[threading.Thread] = []
_tasks: SimpleQueue[Any] = SimpleQueue()


def run(kernel: Kernel, work: int, threads: int | None, *arguments: Any) -> None:
    """Call a kernel; `work` lane-steps decide between a serial and a parallel call."""
    count = 1 if work < CROSSOVER else threads or numba.get_num_threads()
    if count == 1:
        kernel.serial(*arguments)
    else:
        _parallel(kernel, count, arguments)


def _parallel(kernel: Kernel, count: int, arguments: tuple[Any, ...]) -> None:
    """Call a kernel for `count` parts: this thread takes those that no helper has taken."""
    compiled, parts = kernel.compiled, iter(range(count))
    errors: list[BaseException | None] = [None] * count
    running = [threading.Lock() for _ in range(count)]  # without memory, too, one can be released
    for lock in running:
        lock.acquire()

    def take_parts() -> None:
        for part in parts:
            try:
                compiled(part, count, *arguments)
            except BaseException as error:
                errors[part] = error
            finally:
                running[part].release()

    with suppress(RuntimeError, MemoryError):  # no more threads can be started
        while len(_helpers) < count - 1:
            helper = threading.Thread(target=_help, daemon=True)
            helper.start()
            _helpers.append(helper)
    for _ in range(min(count - 1, len(_helpers))):
        _tasks.put(take_parts)
    take_parts()
    for lock in running:
        lock.acquire()
    for error in filter(None, errors):
        raise error


def _help() -> None:
    while True:
        _tasks.get()()


def _after_fork_in_child() -> None:
    global _tasks
    _helpers.clear()
    _tasks = SimpleQueue()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork_in_child)
