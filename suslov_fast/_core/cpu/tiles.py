"""Rows of states, made in a tile and written to the result together.

tile   flat: rows of pairs of numbers.
flat   the result (N, B, 2), flat.
line   how many numbers lie before its first cache line.
"""

import numpy as np

from ..staged import staged
from .orbits import CODE, WIDTH
from .vector import VECTOR, expect_store, store_at, store_pairs, stream, vector_at

# Numbers of a tile: it stays in the first cache with all that is made of a block.
TILE = 1024
# Results of so many numbers are written past the caches.
BEYOND_CACHES = 2**21


@staged
def write_numbers(source, begin, flat, target, size, line, past_caches):
    """Write numbers of a tile from `begin` on to `target`, whole lines past the caches if asked."""
    head = min((line - target) % VECTOR, size) if past_caches else 0
    stop = head + (size - head) // VECTOR * VECTOR
    for k in range(head):
        flat[target + k] = source[begin + k]
    if past_caches:
        for k in range(head, stop, VECTOR):
            stream(flat, target + k, vector_at(source, begin + k))
    else:
        for k in range(head, stop, VECTOR):
            store_at(flat, target + k, vector_at(source, begin + k))
    for k in range(stop, size):
        flat[target + k] = source[begin + k]


@staged
def write_rows(tile, row, rows, width, flat, place, batch, first, line):
    """Write rows of a tile from `row` on to the rows of the result from `place` on."""
    past_caches = flat.size >= BEYOND_CACHES
    if width == batch:
        write_numbers(
            tile, 2 * row * width, flat, 2 * place * batch, 2 * rows * width, line, past_caches
        )
    else:
        for k in range(rows):
            begin, target = 2 * (row + k) * width, 2 * ((place + k) * batch + first)
            write_numbers(tile, begin, flat, target, 2 * width, line, past_caches)


@staged
def expect_rows(flat, place, direction, rows, batch, first, width):
    """Fetch the lines at the ends of rows: a store to part of a line waits for it."""
    for k in range(rows):
        begin = 2 * ((place + direction * k) * batch + first)
        expect_store(flat, begin)
        expect_store(flat, begin + 2 * width - 1)


@staged
def put_pairs(rows, row, tile, place, width):
    """Write VECTOR or more lanes of two rows, one after the other, to a tile as pairs."""
    for k in range(0, width, VECTOR):
        l = min(k, width - VECTOR)  # the last vector of a row stays within it
        pair = vector_at(rows, row + l), vector_at(rows, row + WIDTH + l)
        store_pairs(tile, place + 2 * l, *pair)


@staged
def shift_of_blocks(line):
    """Trajectories that the first block lacks, for the others to begin where cache lines do."""
    return -(line // 2) % (VECTOR // 2)


@staged
def blocks_of(lanes, shift, batch):
    """The blocks of some lanes, which begin at a multiple of WIDTH."""
    begin, end = lanes
    return begin // WIDTH, end // WIDTH if end < batch else (batch + shift + WIDTH - 1) // WIDTH


@staged
def first_and_width(block, lanes, shift, end):
    """Where a block begins, and how many trajectories it has: `lanes`, but for the ends.

    shift   what the first block lacks.
    end     after the last trajectory.
    """
    first = max(block * lanes - shift, 0)
    return first, min((block + 1) * lanes - shift, end) - first


@staged
def write_codes(orbit, first, width, status):
    """Statuses of the trajectories of a block."""
    some, codes = status[first : first + width], orbit[CODE : CODE + WIDTH]
    for l in range(width):
        some[l] = np.int8(codes[l])
