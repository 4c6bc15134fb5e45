"""Records of the actions of events, in a buffer that Python copies into arrays."""

from ...llvm.text import Integers, Shared
from ..code_arguments import SLOT


def size_of(f):
    """Return how many numbers `record` writes for f: 3, two states, and more if f has columns."""
    of_columns = f.columns and f.columns + 2 * f.of_x.D
    return 3 + 2 * f.D + of_columns


def record(code, truth, k, before, f_before):
    """Write records of event k in lanes `truth`: its trajectory, k, time, and both states.

    The states are `before`, D rows, and the row `new`. If f has columns of derivatives, `tau` (how
    much earlier displaced solutions reach the event) and f before and after the event follow.
    """
    text, loaded, work, D = code.text, code.loaded, code.work, code.D
    one = text.lanes(1)
    parts = [(before, D), (work.new, D)]
    if code.f.columns:
        of_x = code.f.of_x.D
        parts += [(work.tau, code.f.columns), (f_before, of_x), (work.f_new, of_x)]
    for offset in code.lanes_with(truth.bits()):
        base = work.line.at() + offset
        number = code.arguments[SLOT.recorded]
        to = loaded.records + number * (8 * size_of(code.f))
        integers, numbers = Integers(text, to), Shared(one, to)
        integers[0] = Integers(text, code.line.trajectory.at() + offset)[0]
        integers[1] = k
        numbers[2] = one.array(code.line.t.at() + offset)[0]
        place = 3
        for rows, count in parts:
            source, target = one.array(base, rows.first), numbers.after(place)
            for i in text.each(count):
                target[i] = source[i]
            place += count
        for first in (3, 3 + D):
            code.put_clocks(one, offset, numbers[2], numbers.after(first))
        code.arguments[SLOT.recorded] = number + 1
