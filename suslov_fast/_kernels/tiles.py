"""Output of rows of states, with non-temporal stores if they do not fit in the caches.

A result (rows, B, D) is written as a flat array. A block of trajectories computes its part of a row
in a tile, which stays in the L1 cache.
"""

from .._jit import LINE, expect_store, formula, put, stream_line

# Results of at least this many numbers are written with non-temporal stores.
_LARGE = 2**21


@formula
def lead_of(out):
    """Return the number of elements of `out` before its first cache line, -1 if it is small."""
    return -(out.ctypes.data // 8) % LINE if out.size >= _LARGE else -1


@formula
def write_row(tile, skip, flat, start, size, stride, lead):
    """Copy `size` numbers of a tile, from tile[skip] on, to flat[start:].

    The next row begins `stride` numbers later; `lead` is that of `lead_of`.
    """
    if lead >= 0:
        expect_store(flat, min(start + stride, flat.size - 1))
        expect_store(flat, min(start + stride + size, flat.size) - 1)
    head = min((lead - start) % LINE, size) if lead >= 0 else size
    for i in range(head):
        put(flat, start + i, tile[skip + i])
    lines = (size - head) // LINE
    for line in range(lines):
        at = head + LINE * line
        stream_line(flat, start + at, tile, skip + at)
    for i in range(head + LINE * lines, size):
        put(flat, start + i, tile[skip + i])


@formula
def shortening_of_first_block(lead, batch, D):
    """Return by how many lanes the first block is shorter: others start on cache lines."""
    fits = (lead >= 0) & (batch * D % LINE == 0) & (lead % D == 0) & (LINE % D == 0)
    return -(lead // D) % (LINE // D) if fits else 0
