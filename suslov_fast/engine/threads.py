"""Calls of kernels, serial or parallel."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from typing import Any

import numba

from ..core.numba import Kernel

# Lane-steps below which a call is serial. Measured on two cores: active threads gain from some
# 10,000 on, but less than 0.1 ms up to here, and a sleeping thread may take 8 ms to wake.
CROSSOVER = 1_000_000

# One parallel call at a time: Numba's `workqueue` layer aborts under two. A second thread
# makes a serial call, whose results are bit-identical. The lock stores its owner, so it can be
# released without knowing whether it was acquired.
_one_at_a_time = threading.RLock()
_may_use_threads = True
_idle_at_fork = True


def call_kernel(kernel: Kernel, work: int, threads: int | None, *arguments: Any) -> None:
    """Call a kernel; `work` lane-steps decide between a serial and a parallel call."""
    if (
        work < CROSSOVER
        or (threads or numba.config.NUMBA_NUM_THREADS) == 1
        or not _may_use_threads
        or _owned()  # by a call interrupted by a signal, whose handler makes this call
        or not _parallel(kernel, threads, arguments)
    ):
        kernel.serial(*arguments)


# A signal handler may raise between any two lines here, but not before the first call of a
# `finally`, which is one to C.


def _parallel(kernel: Kernel, threads: int | None, arguments: tuple[Any, ...]) -> bool:
    """Call a kernel in parallel and return True, or return False if another thread is doing so."""
    try:
        if not _one_at_a_time.acquire(blocking=False):
            return False
        kernel.parallel(threads or numba.get_num_threads(), *arguments)
        return True
    finally:
        try:  # noqa: SIM105  (`suppress` would be the first call)
            _one_at_a_time.release()
        except RuntimeError:  # another thread's
            pass


def _owned() -> bool:
    """Return True in a thread that is in a parallel call."""
    owned: bool = _one_at_a_time._is_owned()  # type: ignore[attr-defined]
    return owned


def _before_fork() -> None:
    """Prevent parallel calls during a fork; record if one was running before it."""
    global _idle_at_fork
    _idle_at_fork = _one_at_a_time.acquire(blocking=False)


def _after_fork_in_parent() -> None:
    with suppress(RuntimeError):  # another thread's
        _one_at_a_time.release()


def _after_fork_in_child() -> None:
    """Make serial calls in a forked child that cannot use the threads of its parent.

    OpenMP aborts the child, TBB may hang, and `workqueue` starts new threads unless it was running.
    """
    global _may_use_threads, _one_at_a_time
    _one_at_a_time = threading.RLock()
    with suppress(ValueError):  # no thread was ever started
        _may_use_threads &= numba.threading_layer() == "workqueue" and _idle_at_fork


if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=_before_fork,
        after_in_parent=_after_fork_in_parent,
        after_in_child=_after_fork_in_child,
    )
