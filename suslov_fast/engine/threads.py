"""Calls of kernels, on one thread or on several."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numba

Kernel = Callable[..., object]  # see `core.numba`

# Lane-steps below which one thread does all: starting others takes some 0.1 ms.
CROSSOVER = 1_000_000


def call_kernel(kernel: Kernel, work: int, threads: int | None, *arguments: Any) -> None:
    """Call a kernel; `work` lane-steps decide whether other threads are started."""
    parts = 1 if work < CROSSOVER else threads or numba.get_num_threads()
    if parts == 1:
        kernel(0, 1, *arguments)
        return
    # Threads that end with the call are no trouble to forks, to signals and to other threads.
    with ThreadPoolExecutor(parts - 1) as pool:
        others = [pool.submit(kernel, part, parts, *arguments) for part in range(1, parts)]
        kernel(0, parts, *arguments)
    for each in others:
        each.result()
