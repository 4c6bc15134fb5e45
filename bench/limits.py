"""The limits of the machine, measured: divisions, and bytes stored, per second."""

import ctypes

import numpy as np
from gcc import library, pointer


def aligned(shape):
    """A C-contiguous array of doubles at a multiple of 64 bytes, as streaming stores need."""
    size = int(np.prod(shape))
    room = np.zeros(size + 8)  # large ones are on huge pages, where the system has them
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
