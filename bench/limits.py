"""Benchmarks of the limits of the machine."""

import native
import numpy as np
from problem import aligned
from work import Case, Work

LARGE = 2**25  # doubles: 256 MiB, far beyond the caches
SMALL = 2**10


def divisions(size, threads):
    """Independent divisions."""
    blocks, rounds = size(1024, 8), size(1000, 10)
    to = np.empty(blocks)
    call = lambda: native.call("limits.c", "divide", to, blocks, rounds, threads)  # noqa: E731
    return Work(call, 64 * blocks * rounds)


def stores(kind):
    """Stores, in units of 16 bytes (one state)."""

    def make(size, threads):
        to = aligned((size(LARGE, SMALL),))
        return Work(lambda: native.call("limits.c", kind, to, to.size, threads), to.nbytes // 16)

    return make


def new_memory(size, threads):
    count = size(LARGE, SMALL)
    return Work(lambda: np.ones(count), count // 2)


def copy(size, threads):
    """Copy in units of 24 bytes, read or written, into reused memory."""
    source, to = (aligned((size(LARGE // 2, SMALL),)) for _ in range(2))
    call = lambda: native.call("limits.c", "copy", source, to, to.size, threads)  # noqa: E731
    return Work(call, 2 * to.nbytes // 24)


def new_copy(size, threads):
    source = np.ones(size(LARGE // 2, SMALL))
    return Work(source.copy, 2 * source.nbytes // 24)


DIVISIONS, STREAMING, COPY = ("divisions", 1), ("streaming", 16), ("copy", 24)
CASES = [
    Case(table, key, f"*limit: {label}*", make, None, limit, "the machine", threads=threads)
    for table, key, label, limit, threads, make in (
        ("last states", "divisions", "one division per step", DIVISIONS, "all", divisions),
        ("saved states", "streaming", "streaming stores", STREAMING, "all", stores("streaming")),
        ("saved states", "plain", "plain stores", STREAMING, "all", stores("plain")),
        ("saved states", "new", "`np.ones`, new memory", None, "one", new_memory),
        ("quantities", "copy", "a copy of 24 bytes in C", COPY, "both", copy),
        ("quantities", "new-copy", "`ndarray.copy` of 24 bytes", COPY, "one", new_copy),
    )
]
