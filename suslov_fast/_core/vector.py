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


@part
def to_cache_line(array, index):
    """How many elements lie between array[index] and the next start of a cache line."""
    return -(array.ctypes.data // array.itemsize + index) % VECTOR


def store_past_caches(array, target, source, first):
    """array[target] = source[first], VECTOR numbers from an index on, where a cache line starts.

    What is written only, and more than caches hold, need not be read before. Compiled, it is what
    `intrinsics` says; so are the functions below.
    """
    array.reshape(-1)[target : target + VECTOR] = source.reshape(-1)[first : first + VECTOR]


def expect_store(array, target):
    """Fetch a cache line that will soon be written: stores wait for what they write to."""


def store_transposed(array, target, stride, source, first, distance):
    """A square of VECTOR x VECTOR numbers, whose rows become columns.

    Rows of the source start at first, first + distance, ..., those of the array at target,
    target + stride, ...
    """
    rows, columns = np.arange(VECTOR)[:, np.newaxis], np.arange(VECTOR)
    square = source.reshape(-1)[first + distance * rows + columns]
    array.reshape(-1)[target + stride * rows + columns] = square.T


def subtract_product(array, target, first, second):
    """array[target] -= array[first] * array[second], each VECTOR numbers from an index on."""
    array[target : target + VECTOR] -= (
        array[first : first + VECTOR] * array[second : second + VECTOR]
    )
