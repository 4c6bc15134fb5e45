"""Vectors of lanes: VECTOR numbers that are worked on at once.

Compiled, they are values in registers, as `intrinsics` says; interpreted, NumPy arrays. Either way
+, -, *, /, abs and comparisons work lane by lane, so that a formula of numbers serves vectors too.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ..lanewise import VECTOR as VECTOR
from ..lanewise import larger as larger
from ..lanewise import select as select
from ..lanewise import shuffled as shuffled
from ..lanewise import smaller as smaller
from ..staged import staged


def aligned(size: int) -> NDArray[np.float64]:
    """An array of doubles on a cache line: a vector across two lines costs a quarter and more."""
    buffer = np.empty(size + VECTOR)
    offset = -(buffer.ctypes.data // buffer.itemsize) % VECTOR
    return buffer[offset : offset + size]


def on_stack(*shape):
    """An array of doubles on a cache line, for as long as the loop runs that a staged part is of.

    Its lengths are constants.
    """
    return aligned(math.prod(shape)).reshape(shape)


@staged
def to_cache_line(array, index):
    """How many elements lie between array[index] and the next start of a cache line."""
    return -(array.ctypes.data // array.itemsize + index) % VECTOR


def load(array, *indices):
    """The vector at some indices of a C-contiguous array (..., VECTOR)."""
    return array[indices].copy()


def store(array, *indices_and_vector):
    *indices, vector = indices_and_vector
    array[tuple(indices)] = vector


def splat(number):
    """A vector of one number."""
    return np.full(VECTOR, number)


def all_lanes(conditions):
    """Whether the conditions of all lanes hold."""
    return bool(conditions.all())


# Ways to read and write memory; arrays are flat, indices those of elements.


def vector_at(array, index):
    """The vector that starts at an element."""
    return array[index:][:VECTOR].copy()


def store_at(array, index, vector):
    """The reverse of `vector_at`."""
    array[index:][:VECTOR] = vector


def store_rows(array, index, vectors):
    """Write vectors lane by lane side by side, a row of numbers for each lane."""
    size = len(vectors)
    for k in range(size):
        numbers = [divmod(k * VECTOR + j, size) for j in range(VECTOR)]
        # The numbers of one vector after the other take their places.
        line = shuffled(vectors[0], vectors[0], [lane for lane, _ in numbers])
        for i in range(1, size):
            places = [VECTOR + l if which == i else j for j, (l, which) in enumerate(numbers)]
            line = shuffled(line, vectors[i], places)
        store_at(array, index + k * VECTOR, line)


def pairs_at(array, index):
    """The firsts and the seconds of VECTOR pairs of numbers that start at an element."""
    pairs = array[index:][: 2 * VECTOR].copy()
    return pairs[0::2], pairs[1::2]


def stream(array, index, vector):
    """Write a vector where a cache line starts.

    The caches need not read the line first, nor lose others to it.
    """
    array[index : index + VECTOR] = vector


def store_pairs(array, index, first, second):
    """Write two vectors lane by lane side by side, as pairs of numbers."""
    array[index : index + 2 * VECTOR] = np.column_stack((first, second)).reshape(2 * VECTOR)


def store_pairs_apart(array, index, stride, first, second):
    """Write two vectors as pairs, at index, index + stride, ..."""
    for k in range(VECTOR):
        array[index + stride * k], array[index + stride * k + 1] = first[k], second[k]


def stream_pairs(array, index, first, second):
    """The same past the caches, from where a cache line starts."""
    array[index : index + 2 * VECTOR] = np.column_stack((first, second)).reshape(2 * VECTOR)


def copy_transposed(array, index, stride, source, first, distance, factors):
    """A square of VECTOR**2 numbers, whose rows start at first, first + distance, ... in `source`.

    Its columns, each times a factor, are written at index, index + stride, ... one after the other.
    """
    rows = [factors * vector_at(source, first + distance * i) for i in range(VECTOR)]
    for k in range(VECTOR):
        store_at(array, index + stride * k, np.array([row[k] for row in rows]))


def expect_store(array, index):
    """Fetch the cache line of an element that will soon be written: a store waits for it."""


def fence():
    """Let other threads see what was stored past the caches."""
