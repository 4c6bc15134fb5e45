"""The limits of the machine, measured: divisions, bytes stored and bytes copied, per second."""

import ctypes

import numpy as np
from gcc import library, pointer

# Doubles of what is stored to: 256 MiB, far beyond the caches.
LARGE = 2**25


def aligned(shape):
    """A C-contiguous array of zeros, touched, at a multiple of 64 bytes for streaming stores."""
    size = int(np.prod(shape))
    room = np.empty(size + 8)  # large ones are on huge pages, where the system has them
    room.fill(0.0)
    start = -room.ctypes.data % 64 // 8
    return room[start : start + size].reshape(shape)


def divide(blocks, rounds, threads):
    """64 * blocks * rounds independent divisions of doubles."""
    function = library("limits.c").divide
    function.restype = ctypes.c_double
    function(ctypes.c_long(blocks), ctypes.c_long(rounds), ctypes.c_int(threads))


def store(to, threads, streaming=False):
    """Fill memory with plain stores, or with streaming (non-temporal) ones."""
    name = "store_streaming" if streaming else "store"
    function = getattr(library("limits.c"), name, None)
    if function is None:
        raise ImportError("no streaming stores for this processor")
    function(pointer(to), ctypes.c_long(to.size), ctypes.c_double(1.0), ctypes.c_int(threads))


def copy(source, to, threads):
    """Copy memory, a part on each thread."""
    size, count = ctypes.c_long(to.size), ctypes.c_int(threads)
    library("limits.c").copy(pointer(source), pointer(to), size, count)
