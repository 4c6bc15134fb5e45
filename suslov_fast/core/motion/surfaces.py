"""Surfaces on which conditions of f change: steps end just beyond them.

A step looks for surfaces at the ends of PARTS of its length, where the state is (`rules.POINT`)

x + u d + u (u - 1) ((1 - 2 u) d + (u - 1) h f(x) + u h f(x_next)),     d = x_next - x,

and `watch` of the half compares both ends of each part. A step that crosses a surface is taken
again, shorter, until it ends just beyond (`rules.CUT`).
"""

import numpy as np

from . import rules


def cut(lines, before, total):
    """Take a step again that crosses a surface, or is on the way to one, with a better length."""
    text, line, work, watched = lines.text, lines.line, lines.work, lines.half.watched
    taken = work.taken[0]
    pair, point, seen = work.between, work.between.after(watched), work.seen
    x, far, new = line.x, line.far, work.new

    def look(*names):
        lines.call("watch", pair, lines.table, seen)
        return {name: seen[k] for k, name in enumerate(names)}

    def keep_far(truth):
        for i in text.each(watched):
            far.put_chosen(i, truth.select(point[i], far[i]))

    text.copy(x, pair, watched)
    if lines.half.changes and lines.half.changes.surfaces:
        text.copy(line.side, work.sides, 2 * lines.half.changes.surfaces)
    parts = dict.fromkeys(("crossed", "place", "end"), text.value(0.0))
    outer = line.outer[0]
    is_far = ~(outer < np.inf)
    for k in range(1, rules.PARTS + 1):
        u = text.value(k / rules.PARTS)
        if k < rules.PARTS:
            put_point(lines, u, point)
        else:
            text.copy(new, point, watched)
        inputs = look("part", "crosses") | parts | {"u": u, "taken": taken}
        parts = lines.apply(rules.LOOK, **inputs)
        keep_far((parts.pop("is_first") > 0.0) & is_far)
        text.copy(point, pair, watched)
    inputs = {"total": total, "before": before, "taken": taken}
    inputs |= parts | {"mode": lines.mode}
    text.copy(far, point, watched)
    inputs |= look("part")
    text.copy(x, pair, watched)
    text.copy(new, point, watched)
    inputs |= look("whole_part", "crosses", "jumps")
    found = lines.apply(rules.CUT, **inputs)
    keep_far(found.pop("beyond") > 0.0)
    own = "at_surface", "jumped", "accepted", "served"
    lines.keep(work, {name: found.pop(name) for name in own})
    lines.keep(line, found)


def put_point(lines, u, to):
    """Write the state at a part u of the step."""
    text, work = lines.text, lines.work
    rule = rules.POINT_IMPLICIT if lines.half.is_implicit else rules.POINT
    signed = work.signed[0]
    for i in text.each(lines.half.block.D):
        to[i] = lines.apply(rule, i, signed=signed, u=u)["point"]
