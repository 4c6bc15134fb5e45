"""Surfaces on which conditions of f change: steps end just beyond them.

A step looks for surfaces at POINTS of its length, where the state is (`rules.POINT`)

x + u d + u (u - 1) ((1 - 2 u) d + (u - 1) h f(x) + u h f(x_next)),     d = x_next - x,

and `watch` of the half compares both ends of each part. A step that crosses a surface is taken
again, shorter, until it ends just beyond (`rules.CUT`); and so is one that may hide two crossings
between points, see `lists.hidden`. Then states there are better known, by f at one of them. In an
implicit step they lie on the polynomial of degree 4 through the states at its quarters.
"""

import itertools

import numpy as np

from ..code.text import Carried
from ..lists.hidden import MIDDLE, POINTS
from . import rules


def cut(lines, before, total):
    """Take a step again that crosses a surface, or is on the way to one, with a better length."""
    text, line, work, watched = lines.text, lines.line, lines.work, lines.half.watched
    taken = work.taken[0]
    count, pair, point, points = lines.half.surfaces, work.between, work.point, work.points
    x, far, new, seen = line.x, line.far, work.new, work.seen

    def value(state, to):
        lines.call("surfaces", state, lines.table, to)

    def look(*names):
        lines.call("watch", pair, lines.table, seen)
        return {name: seen[k] for k, name in enumerate(names)}

    def keep_far(truth, state):
        for i in _read(lines):
            far.put_chosen(i, truth.select(state[i], far[i]))

    value(x, points)
    if lines.half.changes and lines.half.changes.surfaces:
        text.copy(line.side, work.sides, 2 * lines.half.changes.surfaces)
    parts = dict.fromkeys(("crossed", "place", "end"), text.value(0.0))
    outer = line.outer[0]
    is_far = ~(outer < np.inf)
    hidden, quartic = lines.half.hidden is not None, None
    middle = points.after((1 + len(POINTS)) * count)
    if lines.half.reads_states and not lines.half.is_implicit:
        quartic = work.quartic
        find_quartic(lines)
    for k, (begin, end) in enumerate(itertools.pairwise((0.0, *POINTS)), 1):
        state = point if end < 1.0 else new
        if end < 1.0:
            put_point(lines, text.value(end), point, quartic=quartic)
        value(state, points.after(k * count))
        if hidden and k == MIDDLE:
            text.copy(point, middle, watched)
        text.copy(points.after((k - 1) * count), pair, 2 * count)
        inputs = look("part", "crosses") | parts | {"u": end, "width": end - begin}
        parts = lines.apply(rules.LOOK, taken=taken, **inputs)
        keep_far((parts.pop("is_first") > 0.0) & is_far, state)
    inputs = {"total": total, "before": before, "taken": taken}
    inputs |= parts | {"mode": lines.mode, "goal": lines.goal().get("last", lines.number("last"))}
    of_new = points.after(len(POINTS) * count)
    text.copy(of_new, pair, count)
    value(far, pair.after(count))
    inputs |= look("part")
    text.copy(points, pair, count)
    text.copy(of_new, pair.after(count), count)
    inputs |= look("whole_part", "crosses", "jumps")
    inputs |= {"starts": inputs["crossed"], "hidden": 0.0, "twice": 0.0, "known": np.inf}
    if hidden:
        middle[watched] = lines.number("rtol")
        lines.call("hidden", points, lines.table, work.told)
        inputs |= {"hidden": work.told[0], "twice": work.told[1]}
        if lines.half.has_waves:  # a longer step may fit the periods of a clock
            inputs["known"] = taken
        if lines.half.reads_states:  # points that differ by their errors are not crossings
            inputs["starts"] = (work.told[1] > 0.0).select(1.0, inputs["crosses"])
    found = lines.apply(rules.CUT, **inputs | _aim(lines, inputs, is_far))
    keep_far(found.pop("beyond") > 0.0, new)
    own = "at_surface", "jumped", "accepted", "served"
    lines.keep(work, {name: found.pop(name) for name in own})
    lines.keep(line, found)


def look_at_changes(lines, x, f, to):
    """Find the values of surfaces of changes at a state, and their rates."""
    pair, D = lines.work.pair, lines.half.block.D
    lines.text.copy(x, pair, D)
    lines.text.copy(f, pair.after(D), D)
    lines.call("toward", pair, lines.table, to)


def _aim(lines, inputs, is_far):
    """Return `aim` and `since` of `rules.CUT`, and where `rules.START` finds a surface.

    `is_far` is true in lanes that were not looking for a surface before this step.
    """
    text, line, work, D = lines.text, lines.line, lines.work, lines.half.block.D
    changes, found = lines.half.changes, work.aim.after(3)
    for k, value in enumerate((np.inf, 0.0, inputs["place"])):
        work.aim.put_chosen(k, value)
    with text.when((~is_far).any(), likely=False):
        sign = lines.number("sign")
        text.copy(work.new, work.end, D)
        for i in text.each(D):
            work.end.after(D)[i] = sign * work.f_new[i]
        if changes and changes.surfaces:
            text.copy(line.side, work.end.after(2 * D), 2 * changes.surfaces)
        lines.call("aim", work.end, lines.table, found)
        work.aim.choose(~is_far, 0, inputs["taken"] + found[0])
        work.aim.choose(~is_far, 1, found[1])
    if changes and changes.surfaces:
        is_first = is_far & (inputs["crossed"] > 0.0)
        with text.when(is_first.any(), likely=False):
            _start(lines, is_first, inputs)
    return dict(zip(("aim", "since", "place"), (work.aim[k] for k in range(3)), strict=True))


def _start(lines, is_first, inputs):
    """Find where motions that start on a surface of a change come back to it."""
    line, work = lines.line, lines.work
    look_at_changes(lines, line.x, line.f, work.toward)
    look_at_changes(lines, line.far, line.f, work.ahead)
    sums = Carried(first=np.inf)
    for k in lines.text.each(lines.half.changes.surfaces, sums):
        own = {"value": work.toward[2 * k], "rate": work.toward.after(1)[2 * k]}
        own |= {"side": line.side[2 * k], "level": line.side.after(1)[2 * k]}
        own |= {"ahead": work.ahead[2 * k], "end": inputs["end"], "taken": inputs["taken"]}
        sums.update(lines.apply(rules.START, **own, **vars(sums)))
    work.aim.choose(is_first & (sums.first < np.inf), 2, sums.first)


def put_point(lines, u, to, of="surfaces", quartic=None):
    """Write the components that surfaces read at a part u of the step to a state.

    `quartic` of them may be known.
    """
    rule = rules.POINT if quartic is None else rules.POINT_WITH_QUARTIC
    signed, is_implicit, inputs = lines.work.signed[0], lines.half.is_implicit, {}
    if is_implicit:
        rule = rules.POINT_IMPLICIT
    quarters = [lines.work.nodes.after(k * lines.D) for k in range(3)]
    for i in _read(lines, of):
        if is_implicit:
            inputs = {f"quarter{k}": own[i] for k, own in enumerate(quarters, 1)}
        to[i] = lines.apply(rule, i, signed=signed, u=u, **inputs)["point"]


def _read(lines, of="surfaces"):
    """Add a loop over the components that surfaces read, see `Half.read`."""
    return lines.text.listed(lines.half.read[of])()


def find_quartic(lines, of="surfaces"):
    """Find what polynomials of degree 4 have in an explicit step beside cubics."""
    text, work = lines.text, lines.work
    signed, u = work.signed[0], text.value(POINTS[0])
    for i in text.each(lines.D):
        work.start[i] = lines.apply(rules.POINT, i, signed=signed, u=u)["point"]
    lines.call("f", work.start, lines.table, work.f)
    for i in _read(lines, of):
        of_point = {"f_point": work.f[i], "signed": signed}
        work.quartic[i] = lines.apply(rules.QUARTIC, i, **of_point)["quartic"]
