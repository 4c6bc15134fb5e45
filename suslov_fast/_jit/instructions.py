"""Instructions that Numba lacks, and what they are in Python, for interpreted runs.

The reasons, measured on AVX2 with the closed form (entering an orbit takes 26 ns):

select        not an instruction: both values are computed, so that LLVM can choose without a
              branch, as SIMD needs; a ternary of expressions is a branch: 110 ns
two_product   the error of a product takes one FMA, or 16 other operations
stack         LLVM knows that rows on the stack do not overlap; other arrays it compares in pairs
              at run time, and does not vectorize with eight: 110 ns
rows_of, lane, put
              lanes by name, without a line of code for each name
stream_line   non-temporal stores: 15 GB/s instead of 9 if every state is saved
borrowed      counting the references to the arrays of a step takes five times as long as the step
expect_store  a store to a line that is not in the caches delays those after it
subtract_product
              elimination of 64 equations in half the time: a loop that LLVM makes for a few
              numbers spends half its time on the first and last iterations
"""

import numpy as np
from numba import config

from . import llvm
from .llvm import LINE
from .options import formula

if config.DISABLE_JIT:

    def select(condition, first, second):
        """Return `first` where the condition holds, else `second`; both are computed."""
        chosen = first if condition else second
        # Dividing by 0, a float of Python raises, and one of NumPy does not.
        return np.float64(chosen) if isinstance(chosen, float) else chosen

    def two_product(v, w):
        """Return v*w, rounded, and its rounding error (Dekker)."""
        product = v * w
        v1, v2 = _split(v)
        w1, w2 = _split(w)
        return product, v2 * w2 - (((product - v1 * w1) - v2 * w1) - v1 * w2)

    def _split(v):
        c = 134217729.0 * v
        high = c - (c - v)
        return high, v - high

    def stack(*shape):
        """Return an array of uninitialised floats on the stack, of constant size."""
        return np.empty(shape)

    def rows_of(kind, lanes):
        """Return a NamedTuple of rows on the stack: arrays with a number for each lane."""
        return kind(*(np.empty(lanes) for _ in kind._fields))

    def lane(rows, l):
        """Return the numbers of lane l of rows in a NamedTuple, which may be nested, as a tuple."""
        return type(rows)(*(lane(e, l) if isinstance(e, tuple) else e[l] for e in rows))

    def put(rows, l, numbers):
        """Store a tuple of numbers, or one: in lane l of rows, or from rows[l] on in an array."""
        for k, number in enumerate(numbers if isinstance(numbers, tuple) else (numbers,)):
            row, place = (rows, l + k) if isinstance(rows, np.ndarray) else (rows[k], l)
            row[place] = number

    def stream_line(target, i, source, j):
        """Copy source[j:j+8] to the cache line target[i:i+8] with non-temporal stores."""
        target[i : i + LINE] = source[j : j + LINE]

    def subtract_product(target, i, factor, j, source, k):
        """Subtract from eight numbers, from target[i] on, the products of eight pairs of others."""
        target[_slice(i)] -= factor[_slice(j)] * source[_slice(k)]

    def _slice(index):
        return (*index[:-1], slice(index[-1], index[-1] + LINE))

    def borrowed(array):
        """Return an array whose references are not counted, for use while another holds it."""
        return array

    def expect_store(target, i):
        """Prefetch the cache line of target[i] for writing, on AMD's processors."""

else:
    stack, rows_of, lane, put = llvm.stack, llvm.rows_of, llvm.lane, llvm.put
    stream_line, subtract_product = llvm.stream_line, llvm.subtract_product
    expect_store, borrowed = llvm.expect_store, llvm.borrowed

    @formula
    def select(condition, first, second):
        """Return `first` where the condition holds, else `second`; both are computed."""
        return first if condition else second

    @formula
    def two_product(v, w):
        """Return v*w, rounded, and its rounding error."""
        product = v * w
        return product, llvm.fma(v, w, -product)
