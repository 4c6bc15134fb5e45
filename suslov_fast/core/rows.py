"""Rows of lanes leave a block: pairs of numbers, whole cache lines at a time."""

from .numba import LINE, STREAM_FROM, formula, lesser, stream_pairs


@formula
def alignment(out, begin, batch, lanes):
    """Return how many numbers of `out` lie before its first cache line, -1 if it is small; and by
    how many trajectories, of two numbers each, the block of lanes from trajectory `begin` on is
    shorter, so that all others begin at a line. (Large arrays begin 16 bytes after one.)
    """
    lead = -(out.ctypes.data // 8) % LINE if out.size >= STREAM_FROM else -1
    aligned = lead >= 0 and batch % 4 == 0 and batch > lanes > 1
    return lead, (begin - lead // 2) % 4 if aligned else 0


@formula
def write_pairs(source, first, second, flat, place, count, lead):
    """Copy source[first : first + count] and source[second : second + count], in turns, to flat
    from `place` on.
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
