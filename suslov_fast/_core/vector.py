"""Vectors of lanes: arrays that hold whole ones, and arithmetic where none would be formed."""

import numpy as np

from .jit import part

# Doubles in the widest registers; the compiler splits them where registers are narrower.
VECTOR = 8


@part
def aligned(size):
    """An array of doubles on a cache line: a vector across two lines costs a quarter and more."""
    buffer = np.empty(size + VECTOR)
    offset = -(buffer.ctypes.data // buffer.itemsize) % VECTOR
    return buffer[offset : offset + size]


def subtract_product(array, target, first, second):
    """array[target] -= array[first] * array[second], each VECTOR numbers from an index on.

    Compiled, it is what `intrinsics` says.
    """
    array[target : target + VECTOR] -= (
        array[first : first + VECTOR] * array[second : second + VECTOR]
    )
