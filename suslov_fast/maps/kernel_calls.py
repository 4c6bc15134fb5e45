"""Calls of kernels, on one thread or in parallel."""

import threading
from typing import Any

import numba

import suslov_fast

from ..calls import available
from ..core.numba.decorators import Kernel
from .tolerances import STEPS_OF_SERIAL_CALL

# One parallel call at a time, because Numba's `workqueue` layer aborts under two. Meanwhile other
# threads of Python make serial calls, whose results are bit-identical; so does a child that was
# forked during the call, in which nobody gives the lock back.
_one_at_a_time = threading.RLock()


def call_kernel(
    kernel: Kernel, work: int, threads: int | None, *arguments: Any, seconds: float
) -> None:
    """Call a kernel; in parallel if `work`, a number of steps of trajectories, is large enough.

    `seconds` is about how long the call would take in Python, before the kernel is compiled.
    """
    if kernel.by_numpy(*arguments):
        return
    if work < STEPS_OF_SERIAL_CALL or (threads or numba.config.NUMBA_NUM_THREADS) == 1:
        kernel.interpreted_or_serial(seconds, *arguments)
    elif not _parallel(kernel, threads, arguments):
        kernel.serial(*arguments)


def _parallel(kernel: Kernel, threads: int | None, arguments: tuple[Any, ...]) -> bool:
    """Call a kernel in parallel and return True; return False if a parallel call is not possible.

    A signal handler may raise between any two lines, except before the first call in `finally`.
    Calls made by a handler are serial, because it may have interrupted a parallel call.
    """
    if suslov_fast._threads_are_gone or _one_at_a_time._is_owned():  # type: ignore[attr-defined]
        return False
    try:
        if not _one_at_a_time.acquire(blocking=False):
            return False
        kernel.parallel(threads or available(), *arguments)
        return True
    finally:
        try:  # noqa: SIM105  (`suppress` would be the first call)
            _one_at_a_time.release()
        except RuntimeError:  # this call did not get the lock
            pass
