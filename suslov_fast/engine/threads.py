"""Calls of kernels, on one thread or on several."""

import threading
from collections.abc import Callable
from typing import Any

import numba

Kernel = Callable[..., object]  # see `core.numba`

# Lane-steps below which one thread does all: starting others takes some 0.1 ms.
CROSSOVER = 1_000_000


def call_kernel(kernel: Kernel, work: int, threads: int | None, *arguments: Any) -> None:
    """Call a kernel; `work` lane-steps decide whether other threads are started.

    They end with the call, so that neither forks nor other threads disturb them. An executor's lock
    would stop a handler of signals that interrupts a call, and makes one.
    """
    parts = 1 if work < CROSSOVER else threads or numba.get_num_threads()
    if parts == 1:
        kernel(0, 1, *arguments)
        return
    done = []

    def take(part: int) -> None:
        kernel(part, parts, *arguments)
        done.append(part)

    others = [threading.Thread(target=take, args=(k,), daemon=True) for k in range(1, parts)]
    for each in others:
        each.start()
    try:
        take(0)
    finally:
        for each in others:
            each.join()
    if len(done) < parts:
        raise RuntimeError("a thread failed")
