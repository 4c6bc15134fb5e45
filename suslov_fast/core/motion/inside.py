"""States inside a step, at times that were asked for.

The times that a step has passed are reached by shorter steps. In the explicit half these start at
the nearer end of the step, with the first k columns, whose error is that of k columns over the
whole step times u**(2 k + 1), where u is the part of its length (`rules.FEW`). In the implicit half
they are whole steps from the state before, with errors of their own, because a fast mode may decay
within the step.
"""

from ..code.text import Carried, Integers, Shared, Value, bits_of
from . import rules
from .columns import EXPLICIT, IMPLICIT, weights, weights_of_errors, weights_of_few
from .rows import State


def save_states(lines):
    """Save the states at times that the step has passed."""
    text, line, work = lines.text, lines.line, lines.work

    def passed(how):
        next_, after = line.next[0], line.t[0]
        accepted = work.accepted[0] > 0.0
        return accepted & how(after, next_)

    with text.when(passed(Value.__ge__).any(), likely=False):
        with text.when(passed(Value.__gt__).any()):
            few = None if lines.half.is_implicit else _ratios_of_few(lines)
            for now in text.rounds(Carried()):
                if lines.half.is_implicit:
                    _shorter_implicit_step(lines)
                else:
                    _shorter_step(lines, few)
                _save(lines, passed(Value.__gt__).bits(), work.start)
                now.goes_on = passed(Value.__gt__).any()
        _save(lines, passed(Value.equals).bits(), work.new)


def _ratios_of_few(lines):
    """Return the errors of the first 1, 2 and 3 columns by what is allowed."""
    table, own = weights_of_few(EXPLICIT, 2), weights(EXPLICIT, 2)
    factors = [[few - w for few, w in zip(table[k], own, strict=True)] for k in range(3)]
    ratios = Carried(ratio1=0.0, ratio2=0.0, ratio3=0.0)
    for i in lines.text.each(lines.D, ratios):
        inverse = lines.work.error[i]
        for (name, ratio), of_few in zip(vars(ratios).items(), factors, strict=True):
            error = lines.sum_of_ends(of_few, i)
            found = lines.apply(rules.LARGER_RATIO, error=error, inverse=inverse, ratio=ratio)
            setattr(ratios, name, found["ratio"])
    return vars(ratios)


def _shorter_step(lines, ratios):
    """Compute the states at the next times, in `start`, by steps from the nearer end."""
    text, line, work, D = lines.text, lines.line, lines.work, lines.D
    found = lines.apply(rules.INSIDE, **_ends_of_step(lines))
    lines.keep(work, {"signed": found["signed"]})
    forward = found["forward"] > 0.0
    few = lines.apply(rules.FEW, part=found["part"], **ratios)["few"]
    for i in text.each(D):
        for to, before, after in ((work.start, line.x, work.new), (work.f, line.f, work.f_new)):
            to.put_chosen(i, forward.select(before[i], after[i]))
    count, needs = text.value(1), [few > float(k) for k in (1, 2, 3)]
    for need in needs:
        count = count + need.any().bits()
    lines.columns(work.start, work.f, count)
    table, factors = weights_of_few(EXPLICIT, 2), []
    for c in range(4):
        factor = text.value(table[3, c])
        for k in (2, 1, 0):
            factor = needs[k].select(factor, table[k, c])
        factors.append(factor)
    for i in text.each(D):
        total = factors[0] * work.ends[i]
        for c in (1, 2, 3):  # columns that a lane does not need may not be there
            end = work.ends.after(c * D)[i]
            end = needs[c - 1].select(end, 0.0)
            total = total + factors[c] * end
        value = work.start[i] + total
        work.start.put_chosen(i, _with_sign(lines, value, i))


def _ends_of_step(lines):
    """Return the inputs of rules for shorter steps."""
    line, work = lines.line, lines.work
    ends = {"t": work.t[0], "after": line.t[0]}
    return ends | {"taken": work.taken[0], "accepted": work.accepted[0]}


def _with_sign(lines, value, i):
    """Return a component inside a step, with its sign if the motion keeps it."""
    if not lines.f.of_one_sign:
        return value
    return lines.apply(rules.WITH_SIGN, i, value=value)["value"]


def _shorter_implicit_step(lines):
    """Compute the states at the next times by shorter steps; refuse the step if they fail.

    Then it is taken again, to that time.
    """
    text, line, work = lines.text, lines.line, lines.work
    found = lines.apply(rules.INSIDE_IMPLICIT, **_ends_of_step(lines))
    lines.keep(work, {"signed": found["signed"]})
    lines.columns(line.x, line.f, len(IMPLICIT))
    own, of_error = weights(IMPLICIT, 1), weights_of_errors(IMPLICIT, 1)
    is_inside = found["length"] > 0.0
    sums = Carried(total=0.0, ratio=0.0)
    for i in text.each(lines.D, sums):
        value = line.x[i] + lines.sum_of_ends(own, i)
        work.start.put_chosen(i, _with_sign(lines, value, i))
        ratio = abs(lines.sum_of_ends(of_error, i)) * work.error[i]
        larger = lines.apply(rules.LARGER_RATIO, error=ratio, inverse=1.0, ratio=sums.ratio)
        sums.total, sums.ratio = sums.total + ratio, larger["ratio"]
    is_right = text.value(1.0) >= sums.ratio
    is_right = is_right & (sums.total < float("inf"))
    fails = ~is_right & is_inside
    with text.when(fails.any()):
        for rows, value in (
            (line.wanted, found["length"]), (line.t, work.t[0]),
            (line.state, float(State.IMPLICIT)), (line.longer, 1.0),
        ):  # fmt: skip
            rows.choose(fails, 0, value)
        work.accepted.choose(fails, 0, 0.0)


def _save(lines, bits, states):
    """Save the states in rows of `Work` of the lanes with these bits; go to their next time."""
    text, of, rows = lines.text, lines.of, lines.half.rows
    one = text.lanes(1)
    for offset in lines.lanes_with(bits):
        line = one.arrays(lines.line.x.at() + offset, rows)
        of_work = lines.work.line.at() + offset
        place_at = Integers(text, line.place.at())
        place = place_at[0]
        trajectory = Integers(text, line.trajectory.at())[0]
        to = of.states + place * of.state_bytes
        to = to + trajectory * (8 * lines.D)
        for i in text.each(lines.D):
            Shared(one, to)[i] = one.array(of_work, states.first)[i]
        text.prefetch(to + of.state_bytes * 2)
        following = place + 1
        place_at[0] = following
        next_at = line.next.at()
        text.store("double", bits_of(float("inf")), next_at)
        with text.when(following < of.times_count):
            one.array(next_at)[0] = Shared(one, of.times)[following]
        line.tries[0] = 0.0
