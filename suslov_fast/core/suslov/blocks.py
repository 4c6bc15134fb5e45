"""Blocks b[row, lane] of 128 trajectories: their parameters, and copies of states to arrays.

States of large arrays are written by whole cache lines, if possible.
"""

import numpy as np
from numba import config

from ..numba.decorators import ZERO, formula, function, inlined, lesser
from ..numba.intrinsics import LINE, stream_pairs

# Outputs of this many numbers or more are written past the caches, 2.1 times as fast. Smaller
# outputs stay in the caches, where they are read again.
STREAM_FROM = np.inf if config.DISABLE_JIT else 2**20


@formula
def are_common(parameters):
    """Return True if all `parameters` are arrays of one number: one body and step size for all."""
    I1, I2, I13, I23, k, eps = parameters
    return I1.size * I2.size * I13.size * I23.size * k.size * eps.size == 1


@formula
def fill_parameters(b, l, row, parameters, i):
    """Write I1, I2, I13, I23, k and eps of trajectory i to lane l, in six rows from `row` on."""
    I1, I2, I13, I23, k, eps = parameters
    b[row, l] = pick(I1, i)
    b[row + 1, l] = pick(I2, i)
    b[row + 2, l] = pick(I13, i)
    b[row + 3, l] = pick(I23, i)
    b[row + 4, l] = pick(k, i)
    b[row + 5, l] = pick(eps, i)


@formula
def pick(parameter, i):
    """Return the parameter of trajectory i, from an array (B,) or (1,)."""
    return parameter[i if i < parameter.size else 0]


@formula
def alignment(out, begin, batch, lanes):
    """Return `lead`, `shift` and `shared`, which align blocks that write to `out` with cache lines.

    A row of `out` has two numbers for each of `batch` trajectories. A block writes the numbers of
    `lanes` trajectories, the first block from trajectory `begin` on. If two blocks write parts of
    one line, the processor reads it first, which doubles the time.

    lead     the numbers of `out` before its first line, -1 if `out` is small
    shift    the trajectories that the first block lacks, so that later blocks start at a line
    shared   the trajectories that a block and the next one both compute, so that one of them writes
             each line whole: LINE if rows start at different places within lines, else 0
    """
    lead = -(out.ctypes.data // 8) % LINE if out.size >= STREAM_FROM else -1
    in_lines = lead >= 0 and lead % 2 == 0 and batch > lanes > 1
    shift = (begin - lead // 2) % 4 if in_lines and batch % 4 == 0 else 0
    return lead, shift, LINE if in_lines and batch % 4 > 0 else 0


@formula
def store_rows(b, row, flat, place, count):
    """Interleave b[row, :count] and b[row + 1, :count] into flat[place : place + 2 * count]."""
    for l in range(count):  # SIMD, because both numbers are read before one is written
        flat[place + 2 * l], flat[place + 2 * l + 1] = b[row, l], b[row + 1, l]


@formula
def write_pairs(b, row, flat, place, count, lead, after, before):
    """Interleave b[row, :count] and b[row + 1, :count] into flat[place : place + 2 * count].

    Whole cache lines are written past the caches, unless `lead` is -1 (see `alignment`). If `after`
    is True, the block before this one writes the pairs ahead of the first line. If `before` is
    True, the next block writes the pairs after the last line.
    """
    ahead = (lead - place) % LINE
    if lead < 0 or ahead % 2 == 1:
        store_rows(b, row, flat, place, count)
        return
    head = lesser(ahead // 2, count)  # pairs ahead of the first cache line
    store_rows(b, row, flat, place, ZERO if after else head)
    lines = (count - head) // LINE
    most = b.shape[1] // LINE - 1
    written = 0
    if lines >= most:  # a loop of constant length takes three quarters of the time
        for j in range(most):
            l = head + LINE * j
            stream_pairs(flat, place + 2 * l, b, row, l)
        if before:
            return
        written = most
    for j in range(written, lines):
        l = head + LINE * j
        stream_pairs(flat, place + 2 * l, b, row, l)
    for l in range(head + LINE * lines, count):
        flat[place + 2 * l], flat[place + 2 * l + 1] = b[row, l], b[row + 1, l]


@inlined
def empty_at_line(shape):
    """Return an array of three axes that begins at a cache line.

    Vectors in arrays of `np.empty` may straddle two lines, which takes up to 1.6 times as long.
    """
    count = shape[0] * shape[1] * shape[2]
    memory = np.empty(count + LINE - 1)
    first = -(memory.ctypes.data // 8) % LINE
    return memory[first : first + count].reshape(shape)


@function
def write_states(x, begin, end, target):
    """Write states of the first lanes, x[:D, lane], to target[begin:end], of an array (B, D)."""
    for l in range(end - begin):
        for i in range(target.shape[1]):
            target[begin + l, i] = x[i, l]
