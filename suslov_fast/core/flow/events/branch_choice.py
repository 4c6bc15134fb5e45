"""The branches of a right-hand side with conditions: fixed along a step, chosen after it.

A step ends just beyond a surface on which a condition changes (`location`). There new
branches are chosen, and f is evaluated with them. Columns v of derivatives become

v + (f_after - f_before) (grad s . v + ds/dp) / (grad s . f_before),

because a solution displaced by dx reaches the surface s = 0 earlier, and continues with f_after.
(p is the parameter of the column.) This matrix has the determinant (grad s . f_after) /
(grad s . f_before); its logarithm is a part of Lyapunov exponents.

A solution that comes back to surfaces at once, again and again, slides along them, and ends. If f
with the old branches has no value beyond a surface, a solution may end just before the surface.
Then it continues with the other branches.
"""

import itertools
from math import inf, nan

from ...expressions.tables import Table, is_table
from ...expressions.values import larger, smaller
from ...llvm.text import Carried, Intervals
from .. import dense_output
from ..memory import LaneState
from ..scalar_kernels import scalar_kernel
from ..tolerances import (
    AT_ONCE,
    BACK_AND_FORTH,
    CHANGED_AGAIN,
    EARLY,
    FARTHEST_AHEAD,
    NEAREST_AHEAD,
)

_BEFORE = 2  # number of results of `branches` that precede the branches


@scalar_kernel
def CHOSEN(t, wanted, chosen_at, chosen_often, acted, state, mode, last):
    """Return `chosen_at`, `chosen_often` and `state` of a lane after a change of branches at t.

    `chosen_often` counts changes that follow the last change at once: the time between them is
    rounding of t, or of the next length. At BACK_AND_FORTH of them the lane becomes SLIDING. An
    event that `acted` sets the count to 0.
    """
    now = larger(larger(t, wanted), EARLY * last)
    is_at_once = (t - chosen_at <= AT_ONCE * now) & acted.equals(0.0)
    often = is_at_once.select(chosen_often + 1.0, 0.0)
    slides = (often >= BACK_AND_FORTH) & state.equals(mode)
    return {
        "chosen_at": (acted > 0.0).select(chosen_at, t),
        "chosen_often": often,
        "state": slides.select(float(LaneState.SLIDING), state),
    }


@scalar_kernel
def GOES_ON(t, ahead, chosen_at, chosen_often, first_state, last, stop, sign):
    """Return rows of a trajectory that goes on at t + `ahead`, or at `stop` if that is sooner.

    If a trajectory goes on in this way too often in a row, it is SLIDING, as in `CHOSEN`.
    """
    often = (t - chosen_at <= CHANGED_AGAIN * t).select(chosen_often + 1.0, 0.0)
    slides, after = often >= BACK_AND_FORTH, smaller(t + ahead, stop)
    state = slides.select(float(LaneState.SLIDING), first_state)
    is_done = (after >= last) & (after < stop) & (state < LaneState.DONE)
    return {
        "chosen_at": t,
        "chosen_often": often,
        "slides": slides.select(1.0, 0.0),
        "signed": sign * (after - t),
        "wanted": 16.0 * ahead,
        "outer": inf,
        "t": is_done.select(last, after),
        "state": is_done.select(float(LaneState.DONE), state),
    }


@scalar_kernel
def TRACE(before, after, jumps, u):
    """Return the jump u log|after / before| of the integral of u trace f' where f jumps, else 0."""
    of_jump = u * (abs(after / before)).then("log")
    return {"change": (jumps > 0.0).select(of_jump, 0.0)}


def choose_branches(code):
    """Choose the branches of f at the state `new`, in lanes where the row `chooses` is 1."""
    text, work, branches, f = code.text, code.work, code.f.hybrid.branches, code.f.of_x
    code.call("branches", work.new, code.table, work.chosen)
    truth = work.chooses[0] > 0.0
    _put_choices(code, truth, branches.kinds, work.chosen.after(_BEFORE), branches.P)
    derived = f.hybrid.derived.results  # numbers of the table that depend on branches
    if derived:
        code.call("derived", code.table, code.table, work.derived)
        places, table = text.constants([f.places[a] for a in derived]), text.array(code.table)
        for k in text.each(len(derived)):
            table.choose(truth, places[k], work.derived[k])


def update_branches(code, truth, by_motion=False):
    """Choose all branches of f at the new state, in lanes where `truth` is true.

    A solution exactly on a surface is beyond the surface only if a step led there (`by_motion`).
    """
    branches = code.f.hybrid.branches
    if branches.joins and not by_motion:
        for k in code.text.each(branches.jumps):
            code.text.array(code.table, branches.P).choose(truth, k, nan)
    code.work.chooses[0] = truth.select(1.0, 0.0)
    code.text.invoke(f"{code.name}_choose", code.arguments)


def choose(code):
    """Choose branches at kinks, where f bends, after a step to a surface; evaluate f with them."""
    work, branches = code.work, code.f.hybrid.branches
    ends = (work.accepted[0] > 0.0) & (work.at_surface[0] > 0.0)
    with code.text.when(ends.any(), likely=False):
        place = branches.P + branches.jumps
        _put_choices(code, ends, code.integrator.kinks, work.crossings.after(3), place)
        # f may change much even if it is continuous, as along a steep line of a table.
        code.call("f", work.new, code.table, work.f_new)


def renew(code):
    """Choose new branches where f has jumped, and where solutions end just before a surface."""
    text, line, work = code.text, code.line, code.work
    if code.f.hybrid.jumps:
        jumped = (work.accepted[0] > 0.0) & (work.jumped[0] > 0.0)
        with text.when(jumped.any(), likely=False):
            _jump(code, jumped)
    t = line.t[0]
    ended = line.state[0].equals(float(LaneState.ENDED)) & (work.taken[0] > 0.0)
    ended = ended & ((t > line.chosen_at[0]) | t.equals(0.0))
    with text.when(ended.any(), likely=False):
        _go_on(code, ended)


def _jump(code, jumped):
    """Choose branches in lanes where f has `jumped`; seek a surface that is just ahead."""
    line, acted = code.line, code.text.value(0.0)
    if code.f.hybrid.acts:
        acted = line.t[0].equals(line.at[0]).select(1.0, 0.0)
    _choose(code, jumped, acted)
    code.keep(line, code.apply(CHOSEN, mode=code.mode, acted=acted), jumped)
    ahead = _look_ahead(code, FARTHEST_AHEAD)
    back = jumped & (code.work.chosen[0] >= 0.0)
    with code.text.when(back.any(), likely=False):
        for i in code.text.each(code.integrator.D_of_surfaces):
            line.beyond.choose(back, i, code.work.start[i])
        # This starts a search for a surface within the time `ahead`, see `location`.
        search = {"unlimited": line.wanted[0], "wanted": ahead, "outer": ahead}
        code.keep(line, search | {"inner": 0.0, "weight": 0.0, "rounds": 0.0}, back)


def _put_ahead(code, signed):
    """Write x + signed f(x), about the state a time `signed` after the step, to the row `start`."""
    for i in code.text.each(code.D):
        code.work.start[i] = code.work.new[i] + signed * code.work.f_new[i]


def _look_ahead(code, part):
    """Find the branches (`chosen`) a time `part` * t after the step; return this time."""
    t = code.line.t[0]
    ahead = part * (t > 0.0).select(t, code.number("last"))
    _put_ahead(code, code.number("sign") * ahead)
    code.call("branches", code.work.start, code.table, code.work.chosen)
    return ahead


def _choose(code, truth, acted):
    """Choose branches in lanes `truth`; update f, and columns unless an event `acted`."""
    text, work, f = code.text, code.work, code.f
    has_columns = f.columns and f.hybrid.jumps
    text.copy(work.f_new, work.f_old, code.f.of_x.D)
    if has_columns:
        code.call("slopes", work.new, code.table, work.slopes)
    update_branches(code, truth, by_motion=True)
    code.call("f", work.new, code.table, work.f_new)
    if has_columns:
        own = truth & acted.equals(0.0) & (work.chosen[0] >= 0.0)  # an event updates columns itself
        with text.when(own.any()):
            for i in text.each(f.D):
                code.keep_largest(own, i, work.new[i])
            _change_columns(code, own)
            code.call("f", work.new, code.table, work.f_new)


def _change_columns(code, truth):
    """Add (f_new - f_old) tau to columns in lanes `truth`: displaced solutions jump tau earlier."""
    text, work, f, of_x = code.text, code.work, code.f, code.f.of_x
    D, gradient = of_x.D, work.gradient
    for j in text.each(D + f.q):
        gradient[j] = 0.0
    surfaces = text.constants([float(k) for k, _ in of_x.slope_places])
    places = text.constants([j for _, j in of_x.slope_places])
    for n in text.each(len(of_x.slope_places)):
        gradient.choose(work.chosen[0].equals(surfaces[n]), places[n], work.slopes[n])
    ends = Carried(before=0.0, after=0.0, jumps=0.0)
    for i in text.each(D, ends):
        ends.before = ends.before + gradient[i] * work.f_old[i]
        ends.after = ends.after + gradient[i] * work.f_new[i]
        ends.jumps = (work.f_new[i] - work.f_old[i]).equals(0.0).select(ends.jumps, 1.0)

    def move(column, ds):
        for i in text.each(D, ds):
            ds.sum = ds.sum + gradient[i] * column[i]
        time = ds.sum / ends.before
        for i in text.each(D):
            jump = work.f_new[i] - work.f_old[i]
            moved = column[i] + jump.equals(0.0).select(0.0, jump * time)
            column.choose(truth, i, moved)

    others = f.columns - f.q
    for c in text.each(others):
        move(work.new.from_here(D + c * D), Carried(sum=0.0))
    scales = text.array(code.table, len(of_x.table))
    for q in text.each(f.q):
        ds = gradient.after(D)[q] * scales[q]
        move(work.new.from_here(D * (1 + others) + q * D), Carried(sum=ds))
    if f.has_trace:
        of_trace = {"before": ends.before, "after": ends.after, "jumps": ends.jumps}
        found = code.apply(TRACE, u=work.new[code.D - 2], **of_trace)["change"]
        work.new.choose(truth, code.D - 1, work.new[code.D - 1] + found)


def _go_on(code, ended):
    """Continue solutions that end just before a surface, in lanes `ended`, at states beyond it."""
    text, line, work = code.text, code.line, code.work
    accepted = work.accepted[0] > 0.0
    for i in text.each(code.D):
        work.new.choose(ended, i, accepted.select(work.new[i], line.x[i]))
    for i in text.each(code.extended):
        work.f_new.choose(ended, i, accepted.select(work.f_new[i], line.f_x[i]))
    none = ahead = text.value(0.0)
    for part in (NEAREST_AHEAD, 8.0 * NEAREST_AHEAD, FARTHEST_AHEAD):
        own = _look_ahead(code, part)
        ahead = (ahead.equals(0.0) & (work.chosen[1] > 0.0)).select(own, ahead)
    goes_on = ended & (ahead > 0.0)
    t, stop = line.t[0], line.stop[0] if code.f.hybrid.acts else text.value(inf)
    after = code.apply(GOES_ON, ahead=ahead, stop=stop)
    is_saved, signed_after = goes_on & (after.pop("slides") < 1.0), after.pop("signed")

    def passed():
        return is_saved & (line.next[0] <= t + ahead) & (line.next[0] < stop)

    with text.when(passed().any(), likely=False):
        for now in text.rounds(Carried()):
            _put_ahead(code, code.number("sign") * (line.next[0] - t))
            dense_output.save(code, passed().bits(), work.start)
            now.goes_on = passed().any()
    code.keep(line, after, goes_on)
    _put_ahead(code, signed_after)
    for i in text.each(code.D):
        work.new.choose(goes_on, i, work.start[i])
    work.accepted.choose(goes_on, 0, 1.0)
    _choose(code, goes_on, none)


def _put_choices(code, truth, kinds, rows, place):
    """Write to f's table, from `place` on, the branches of surfaces of these `kinds`.

    `rows` has the branch of a comparison or "floor". Of a `Table` it has the argument, and f's
    table gets the interval that contains the argument.
    """
    text, f, branches = code.text, code.f.of_x, code.f.hybrid.branches
    first = len(branches.kinds) - len(kinds)
    shifts = f.surface_values.results[len(branches.kinds) + code.integrator.event_surface_count :]
    places = {k: f.places[q] for k, q in zip(branches.shifts, shifts, strict=False)}
    for are_tables, group in itertools.groupby(enumerate(kinds), lambda each: is_table(each[1])):
        group = [*group]
        if not are_tables:
            numbers, chosen = rows.after(group[0][0]), text.array(code.table, place)
            for n in text.each(len(group)):
                chosen.choose(truth, n, numbers[n])
            place += len(group)
            continue
        for k, kind in group:  # the row lacks q if it shifts the knots (`Branches.shifts`)
            _put_interval(code, kind, truth.bits(), rows.after(k), place, places.get(first + k))
            place += Table.ROWS


def _put_interval(code, table, bits, argument, place, shift):
    """Write to f's table, from `place` on, the interval of a `Table` that holds a lane's argument.

    The argument is the row `argument`, plus the number of f's table at the place `shift` if that is
    not None. This number is subtracted from both ends of the interval. `bits` marks the lanes.
    """
    text, one = code.text, code.text.lanes(1)
    intervals = Intervals(text, table)
    for offset in code.lanes_with(bits):
        x = one.array(code.work.line.at() + offset, argument.first)[0]
        of_lane = one.array(code.table + offset)
        less = one.value(0.0) if shift is None else of_lane[shift]
        to = text.place(code.table + offset, place)
        at = intervals.holding(x, less)
        text.copy_numbers(at, intervals.bytes, to, text.size, Table.ROWS)
        if shift is not None:
            for k in range(2):  # low and high
                of_lane[place + k] = of_lane[place + k] - less
