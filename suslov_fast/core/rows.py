"""Copy rows of lanes from a block to saved states: pairs of numbers, by whole cache lines."""

from .numba import LINE, STREAM_FROM, formula, lesser, stream_pairs


@formula
def alignment(out, begin, batch, lanes):
    """Return two numbers that align the writing of `out` with cache lines.

    The first is how many numbers of `out` lie before its first cache line, -1 if `out` is small.
    The second is by how many trajectories, of two numbers each, the block of lanes from trajectory
    `begin` on must be shorter for later blocks to begin at a line. (Large arrays of NumPy begin 16
    bytes after one.)
    """
    lead = -(out.ctypes.data // 8) % LINE if out.size >= STREAM_FROM else -1
    aligned = lead >= 0 and batch % 4 == 0 and batch > lanes > 1
    return lead, (begin - lead // 2) % 4 if aligned else 0


@formula
def write_pairs(source, first, second, flat, place, count, lead):
    """Interleave two rows into flat[place : place + 2 * count], by whole cache lines if possible.

    They are source[first : first + count] and source[second : second + count].
    """
    ahead = (lead - place) % LINE if lead >= 0 else 1
    head = count if ahead % 2 == 1 else lesser(ahead // 2, count)  # pairs before a cache line
    lines = (count - head) // LINE
    for l in range(head):
        flat[place + 2 * l], flat[place + 2 * l + 1] = source[first + l], source[second + l]
    for j in range(lines):
        l = head + LINE * j
        stream_pairs(flat, place + 2 * l, source, first + l, second + l)
    for l in range(head + LINE * lines, count):
        flat[place + 2 * l], flat[place + 2 * l + 1] = source[first + l], source[second + l]
