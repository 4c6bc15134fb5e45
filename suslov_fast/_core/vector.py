"""Vectors of lanes: VECTOR numbers that are worked on at once.

Compiled, they are values in registers, as `intrinsics` says; interpreted, NumPy arrays. Either way
+, -, *, /, abs, < and > work on each lane, so that a formula serves numbers and vectors.
"""

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


def load(array, *index):
    """The vector at an index of a C-contiguous array (..., VECTOR)."""
    return array[index].copy()


def store(array, *index_and_vector):
    *index, vector = index_and_vector
    array[tuple(index)] = vector


def same(number):
    """A vector of one number."""
    return np.full(VECTOR, float(number))


def choose(condition, first, second):
    """The first where a condition holds, else the second."""
    return np.where(condition, first, second)


def in_all(condition):
    """Whether a condition holds in all lanes."""
    return bool(condition.all())
