"""The limits of the machine, as benchmarks beside those that they limit."""

import native
import numpy as np
from cases import Case, Work
from problem import aligned

LARGE = 2**25  # doubles: 256 MiB, far beyond the caches
MACHINE = "the machine"


def divisions(size, threads):
    """Independent divisions."""
    blocks, rounds = size(1024, 8), size(1000, 10)
    to = np.empty(blocks)
    call = lambda: native.call("limits.c", "divide", to, blocks, rounds, threads)  # noqa: E731
    call()
    return Work(call, 64 * blocks * rounds)


def stores(kind, threads, size=LARGE):
    """A call that fills memory, and its bytes."""
    to = aligned((size,))
    call = lambda: native.call("limits.c", kind, to, size, threads)  # noqa: E731
    call()
    return call, to.nbytes


def states_stored(kind):
    """Stores, in states of 16 bytes."""

    def make(size, threads):
        call, nbytes = stores(kind, threads, size(LARGE, 2**10))
        return Work(call, nbytes // 16)

    return make


def new_memory(size, threads):
    count = size(LARGE, 2**10)
    return Work(lambda: np.ones(count), count // 2)


def copy(size, threads):
    """Bytes read and written, in pieces of 24, into memory that is used again."""
    source, to = (aligned((size(LARGE // 2, 2**10),)) for _ in range(2))
    call = lambda: native.call("limits.c", "copy", source, to, to.size, threads)  # noqa: E731
    call()
    return Work(call, 2 * to.nbytes // 24)


def new_copy(size, threads):
    source = np.ones(size(LARGE // 2, 2**10))
    return Work(source.copy, 2 * source.nbytes // 24)


LAST, SAVED, COPIED = ("last states", "steps"), ("saved states", "states"), ("quantities", "states")
DIVISIONS, STREAMING, COPY = ("divisions", 1), ("streaming", 16), ("copy", 24)
streaming_stores, plain_stores = states_stored("streaming"), states_stored("plain")
CASES = [
    Case(table[0], key, f"*limit: {label}*", table[1], make, None, limit, MACHINE, threads=threads)
    for table, key, label, limit, threads, make in (
        (LAST, "divisions", "one division per step", DIVISIONS, "all", divisions),
        (SAVED, "streaming", "streaming stores", STREAMING, "all", streaming_stores),
        (SAVED, "plain", "plain stores", STREAMING, "all", plain_stores),
        (SAVED, "new", "`np.ones`, new memory", None, "one", new_memory),
        (COPIED, "copy", "a copy of 24 bytes in C", COPY, "both", copy),
        (COPIED, "new-copy", "`ndarray.copy` of 24 bytes", COPY, "one", new_copy),
    )
]
