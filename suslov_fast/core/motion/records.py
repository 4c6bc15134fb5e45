"""Records of what changes of the state did, in a buffer of which Python makes arrays."""

from ..code.text import Integers, Shared
from .arguments import SLOT


def record(lines, truth, k, time, before, after):
    """Write a record in these lanes: trajectory, number of the change, time, and both states.

    `time`, `before` and `after` are rows.
    """
    text, of, work, D = lines.text, lines.of, lines.work, lines.D
    one = text.lanes(1)
    for offset in lines.lanes_with(truth.bits()):
        base = work.line.at() + offset
        number = lines.arguments[SLOT.recorded]
        to = of.records + number * (8 * (3 + 2 * D))
        integers, numbers = Integers(text, to), Shared(one, to)
        integers[0] = Integers(text, lines.line.trajectory.at() + offset)[0]
        integers[1] = k
        numbers[2] = one.array(time.at() + offset)[0]
        for n, rows in enumerate((before, after)):
            source, target = one.array(base, rows.first), numbers.after(3 + n * D)
            for i in text.each(D):
                target[i] = source[i]
        lines.arguments[SLOT.recorded] = number + 1
