"""The limits of the machine: divisions and stores in C."""

from functools import partial

import numpy as np
from native import call
from numba import get_num_threads
from problem import aligned
from work import Work

LARGE, SMALL = 2**25, 2**10  # doubles: 256 MiB, far beyond the caches


def divisions(size):
    blocks, rounds = size(1024, 8), size(1000, 10)
    divide = partial(call, "limits.c", "divide", np.empty(blocks), blocks, rounds)
    return Work(lambda: divide(get_num_threads()), 64 * blocks * rounds, "division")


def stores(kind, size):
    """Stores of states, 16 bytes each."""
    to = aligned((size(LARGE, SMALL),))
    store = partial(call, "limits.c", kind, to, to.size)
    return Work(lambda: store(get_num_threads()), to.size // 2, "state")


def new_memory(size):
    return Work(lambda: np.ones(size(LARGE, SMALL)), size(LARGE, SMALL) // 2, "state")
