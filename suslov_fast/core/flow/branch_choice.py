"""The branches of a right-hand side with conditions: fixed along a step, chosen after it.

A step ends just beyond a surface on which a condition changes (`event_location`). There new
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

from ..expressions.tables import Table, is_table
from ..expressions.values import larger, smaller
from ..llvm.text import Carried, Intervals
from . import dense_output
from .codegen import StepCode
from .memory import LaneState
from .scalar_kernels import AT_ONCE, scalar_kernel

_BEFORE = 2  # number of results of `branches` that precede the branches

BACK_AND_FORTH = 12.0  # so many changes of branches in a row at one instant count as sliding
EARLY = 2.0**-12  # part of the last time: earlier changes of branches count as changes then
# Parts of the time. If a solution ends just before a surface, the surface is sought within NEAREST,
# then up to AHEAD. A second such end within AGAIN counts as a change of branches at once.
NEAREST, AHEAD, AGAIN = 2.0**-44, 2.0**-38, 2.0**-28


@scalar_kernel
def CHOSEN(t, wanted, chosen_at, chosen_often, acted, state, mode, last):
    """Return `chosen_at`, `chosen_often` and `state` of a lane, after a change of branches at t.

    `chosen_at` is the time of the last change at which no event `acted` (0). `chosen_often` counts
    consecutive changes. Each is within AT_ONCE * max(t, `wanted`, EARLY * `last`) of the change
    before, where `wanted` is the requested time and `last` the last one. An event sets it to 0.
    When it reaches BACK_AND_FORTH, a lane that is in the state `mode` becomes SLIDING.
    """
    now = larger(larger(t, wanted), EARLY * last)
    is_at_once = (t - chosen_at <= AT_ONCE * now) & acted.equals(0.0)
    often = is_at_once.select(chosen_often + 1.0, 0.0)
    runs = state.equals(mode) | state.equals(float(LaneState.TOO_MANY))
    slides = (often >= BACK_AND_FORTH) & runs
    return {
        "chosen_at": (acted > 0.0).select(chosen_at, t),
        "chosen_often": often,
        "state": slides.select(float(LaneState.SLIDING), state),
    }


@scalar_kernel
def LOOK_AHEAD(t, last, part, sign):
    """Return a time `ahead` = part * t, or part * last at t = 0; and `signed` = sign * ahead."""
    ahead = part * (t > 0.0).select(t, last)
    return {"ahead": ahead, "signed": sign * ahead}


@scalar_kernel
def GOES_ON(t, ahead, chosen_at, chosen_often, first_state, last, stop, sign):
    """Return the rows of a trajectory that continues at the time t + ahead, beyond a surface.

    The new time does not pass `stop`, the next given time of an event. `signed` is the difference
    to t, with `sign`. `state` is SLIDING after BACK_AND_FORTH consecutive changes, each within
    AGAIN * t of the change before. At the time `last` it is DONE, and otherwise `first_state`.
    """
    often = (t - chosen_at <= AGAIN * t).select(chosen_often + 1.0, 0.0)
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
    """Return `change`, the jump of the integral of u trace f' where f `jumps` at a surface s = 0.

    It is u log|after / before|, with grad s . f on both sides of the surface; 0 if `jumps` is 0.
    """
    of_jump = u * (abs(after / before)).then("log")
    return {"change": (jumps > 0.0).select(of_jump, 0.0)}


def add_branches(text, integrator, name, for_each):
    """Add the function void choose(arguments), which chooses branches at the state `new`.

    Only lanes where the row `chooses` is 1 get new branches. See `StepCode` for the arguments.
    """
    with text.function(f"{name}_choose", ("arguments",)):
        code = StepCode(text, integrator, name, for_each)
        work, branches, f = code.work, integrator.f.branches, integrator.f.of
        _look(code, work.new)
        truth = work.chooses[0] > 0.0
        _put_choices(code, truth, branches.kinds, work.chosen.after(_BEFORE), branches.P)
        derived = f.derived.results  # numbers of the table that depend on branches
        if derived:
            code.call("derived", code.table, code.table, work.derived)
            places, table = text.constants([f.places[a] for a in derived]), text.array(code.table)
            for k in text.each(len(derived)):
                table.choose(truth, places[k], work.derived[k])


def update_branches(code, truth, by_motion=False):
    """Choose all branches of f at the new state, in lanes where `truth` is true.

    A solution exactly on a surface counts as beyond it only if a step led there (`by_motion`).
    """
    branches = code.f.branches
    if branches.joins and not by_motion:
        for k in code.text.each(branches.jumps):
            code.text.array(code.table, branches.P).choose(truth, k, nan)
    code.work.chooses[0] = truth.select(1.0, 0.0)
    code.text.invoke(f"{code.name}_choose", code.arguments)


def choose(code):
    """Choose branches at kinks, where f bends, after a step to a surface; evaluate f with them."""
    work, branches = code.work, code.f.branches
    ends = (work.accepted[0] > 0.0) & (work.at_surface[0] > 0.0)
    with code.text.when(ends.any(), likely=False):
        place = branches.P + branches.jumps
        _put_choices(code, ends, code.integrator.kinks, work.crossings.after(3), place)
        # f may change much even if it is continuous, as along a steep line of a table.
        code.call("f", work.new, code.table, work.f_new)


def renew(code):
    """Choose new branches where f has jumped, and where solutions have ended just before a surface.

    Beyond such a surface f has a value only with the new branches, and solutions continue.
    """
    text, line, work = code.text, code.line, code.work
    if code.f.branches.jumps:
        jumped = (work.accepted[0] > 0.0) & (work.jumped[0] > 0.0)
        with text.when(jumped.any(), likely=False):
            _jump(code, jumped)
    t = line.t[0]
    ended = line.state[0].equals(float(LaneState.ENDED)) & (work.taken[0] > 0.0)
    ended = ended & ((t > line.chosen_at[0]) | t.equals(0.0))
    with text.when(ended.any(), likely=False):
        _go_on(code, ended)


def _look(code, x):
    """Write to the rows `chosen` whether branches change at the state x, and the branches there."""
    code.call("branches", x, code.table, code.work.chosen)


def _jump(code, jumped):
    """Choose branches in lanes where f has `jumped`; seek a surface that is just ahead."""
    line, work = code.line, code.work
    acted = code.text.value(0.0)
    if code.integrator.events:
        acted = line.t[0].equals(line.at[0]).select(1.0, 0.0)
    _choose(code, jumped, acted)
    code.keep(line, code.apply(CHOSEN, mode=code.mode, acted=acted), jumped)
    ahead = code.apply(LOOK_AHEAD, part=AHEAD)
    _put_ahead(code, work.new, work.f_new, ahead["signed"])
    _look(code, work.start)
    back = jumped & (work.chosen[0] >= 0.0)
    with code.text.when(back.any(), likely=False):
        for i in code.text.each(code.integrator.watched):
            line.beyond.choose(back, i, work.start[i])
        # This starts a search for a surface within the time `ahead`, see `event_location`.
        search = {"whole": line.wanted[0], "wanted": ahead["ahead"], "outer": ahead["ahead"]}
        code.keep(line, search | {"inner": 0.0, "weight": 0.0, "rounds": 0.0}, back)


def _put_ahead(code, x, f, signed):
    """Write x + signed f, about the state a time `signed` later, to the row `start`; f is f(x)."""
    for i in code.text.each(code.D):
        code.work.start[i] = x[i] + signed * f[i]


def _choose(code, truth, acted):
    """Choose branches in lanes `truth`; update f, and columns unless an event `acted`."""
    text, work, f = code.text, code.work, code.f
    has_columns = f.columns and f.branches.jumps > 0
    text.copy(work.f_new, work.f_old, code.f.of.D)
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
    text, work, f, block = code.text, code.work, code.f, code.f.of
    D, gradient = block.D, work.gradient
    for j in text.each(D + f.q):
        gradient[j] = 0.0
    surfaces = text.constants([float(k) for k, _ in block.slope_places])
    places = text.constants([j for _, j in block.slope_places])
    for n in text.each(len(block.slope_places)):
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
    scales = text.array(code.table, len(block.table))
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
    accepted, none = work.accepted[0] > 0.0, text.value(0.0)
    for i in text.each(code.D):
        work.new.choose(ended, i, accepted.select(work.new[i], line.x[i]))
    for i in text.each(code.extended):
        work.f_new.choose(ended, i, accepted.select(work.f_new[i], line.f[i]))
    found = {"ahead": none, "signed": none}
    for part in (NEAREST, 8.0 * NEAREST, AHEAD):
        own = code.apply(LOOK_AHEAD, part=part)
        _put_ahead(code, work.new, work.f_new, own["signed"])
        _look(code, work.start)
        is_first = found["ahead"].equals(0.0) & (work.chosen[1] > 0.0)
        found = {name: is_first.select(own[name], a) for name, a in found.items()}
    goes_on = ended & (found["ahead"] > 0.0)
    t, stop = line.t[0], line.stop[0] if code.integrator.events else text.value(inf)
    after = code.apply(GOES_ON, ahead=found["ahead"], stop=stop)
    is_saved, signed_after = goes_on & (after.pop("slides") < 1.0), after.pop("signed")

    def passed():
        return is_saved & (line.next[0] <= t + found["ahead"]) & (line.next[0] < stop)

    with text.when(passed().any(), likely=False):
        for now in text.rounds(Carried()):
            signed = code.number("sign") * (line.next[0] - t)
            _put_ahead(code, work.new, work.f_new, signed)
            dense_output.save(code, passed().bits(), work.start)
            now.goes_on = passed().any()
    code.keep(line, after, goes_on)
    _put_ahead(code, work.new, work.f_new, signed_after)
    for i in text.each(code.D):
        work.new.choose(goes_on, i, work.start[i])
    work.accepted.choose(goes_on, 0, 1.0)
    _choose(code, goes_on, none)


def _put_choices(code, truth, kinds, rows, place):
    """Write branches of surfaces to f's table from `place` on, in lanes where `truth` is true.

    `kinds` are comparisons, "floor" and `Table`s, and `rows` are their branches. A row of a `Table`
    is an argument of it; the interval that contains the argument goes to f's table.
    """
    text, f, branches = code.text, code.f.of, code.f.of.branches
    first = len(branches.kinds) - len(kinds)
    shifts = f.surfaces.results[len(branches.kinds) + code.integrator.event_surfaces :]
    places = {k: f.places[q] for k, q in zip(branches.shifts, shifts, strict=False)}
    for are_tables, group in itertools.groupby(enumerate(kinds), lambda each: is_table(each[1])):
        group = [*group]
        if not are_tables:
            numbers, chosen = rows.after(group[0][0]), text.array(code.table, place)
            for n in text.each(len(group)):
                chosen.choose(truth, n, numbers[n])
            place += len(group)
            continue
        for k, kind in group:  # the argument is p + q with the shift q
            _put_interval(code, kind, truth.bits(), rows.after(k), place, places.get(first + k))
            place += Table.ROWS


def _put_interval(code, table, bits, argument, place, shift):
    """Write to f's table the interval of a `Table` that holds argument + shift, minus the shift.

    `argument` is a row, and `shift` the place of the shift in f's table, or None. The interval goes
    to `place` and the three places after it, in lanes with bit 1 in `bits`.
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
