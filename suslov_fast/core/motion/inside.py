"""States inside a step, at times that were asked for.

A step aside has reached its time: its end is the state (`rules.LENGTH`). An explicit step that has
passed several times is taken once more as three quarters with few columns, which end at x_1, x_2,
x_3, and x_4 is the next state. With v = 4 (t - t_0) / h, the states inside are the polynomial p of
degree 9 with p(j) = x_j and p'(j) = h / 4 f(x_j), j = 0 ... 4,

p(v) = sum_j L_j(v)**2 ((1 - 2 L_j'(j) (v - j)) x_j + (v - j) h / 4 f(x_j)),

where L_j are Lagrange's polynomials. Its error is C prod_j (v - j)**2 at first order, and the
defect p' - h / 4 f(p) shows C and the errors of the nodes. If it is too large the step is taken
again, to the next time.
"""

from ..code.text import Carried, Integers, Shared, Value
from . import rules
from .columns import EXPLICIT, weights, weights_of_few
from .scope import weighted


def save_states(lines):
    """Save the states at times that the step has passed, or reached aside."""
    text, work = lines.text, lines.work
    served = work.served[0] > 0.0

    def passed(how):
        return _passed(lines, how)

    with text.when((served | passed(Value.__ge__)).any(), likely=False):
        save(lines, served.bits(), work.new)
        if not lines.half.is_implicit:
            with text.when(passed(Value.__gt__).any()):
                _find_nodes(lines)
                for now in text.rounds(Carried()):
                    _put_between(lines, lines.apply(rules.BETWEEN, **_of_step(lines)))
                    save(lines, passed(Value.__gt__).bits(), work.start)
                    now.goes_on = passed(Value.__gt__).any()
        if not lines.half.changes:
            save(lines, passed(Value.equals).bits(), work.new)


def save_at_end(lines):
    """Save the states at times at which the step ends, after changes there."""
    ends = _passed(lines, Value.equals)
    with lines.text.when(ends.any(), likely=False):
        save(lines, ends.bits(), lines.work.new)


def _passed(lines, how):
    """Return which lanes have passed their next time."""
    next_, after = lines.line.next[0], lines.line.t[0]
    accepted = lines.work.accepted[0] > 0.0
    return accepted & how(after, next_)


def _of_step(lines):
    """Return the inputs of rules for the time before a step, and its length."""
    return {"t": lines.work.t[0], "taken": lines.work.taken[0]}


def _find_nodes(lines):
    """Find states and rates at the ends of quarters; refuse steps whose inside is not known."""
    text, line, work, D = lines.text, lines.line, lines.work, lines.D
    lines.keep(work, lines.apply(rules.QUARTER, after=line.t[0], **_of_step(lines)))
    few, more = weights_of_few(EXPLICIT, 2)[rules.FEW - 1 : rules.FEW + 1]
    of_few, largest = few - weights(EXPLICIT, 2), Carried(ratio=0.0)
    for i in text.each(D, largest):
        inputs = {"error": weighted(of_few, lines.of_columns(work.ends, i))}
        inputs |= {"inverse": work.error[i], "ratio": largest.ratio}
        largest.update(lines.apply(rules.LARGER_RATIO, **inputs))
    needs = largest.ratio > rules.OF_FEW
    count = needs.any().bits() + rules.FEW
    factors = [needs.select(text.value(b), a) for a, b in zip(few, more, strict=True)]
    factors = factors[: rules.FEW + 1]

    def end(i):
        ends = lines.of_columns(work.ends, i)[: rules.FEW + 1]
        ends[rules.FEW] = needs.select(ends[rules.FEW], 0.0)  # it may not be there
        return weighted(factors, ends)

    _take_quarters(lines, count, end)
    sums = Carried(ratio=0.0, total=0.0)
    for v in rules.TESTS:
        of_value, of_slope = rules.weights_of_test(v)
        _put_between(lines, of_value)
        lines.call("f", work.start, lines.table, work.f)
        for i in text.each(D, sums):
            inputs = {"slope": _between(lines, of_slope, i), "f": work.f[i]}
            inputs |= {"signed": work.signed[0], "inverse": work.error[i]}
            sums.update(lines.apply(rules.DEFECT, **inputs, **vars(sums)))
    found = lines.apply(rules.FAILS, signed=work.signed[0], **_of_step(lines), **vars(sums))
    fails = found.pop("fails") > 0.0
    with text.when(fails.any(), likely=False):
        lines.keep(line, found, fails)
        work.accepted.choose(fails, 0, 0.0)


def put_points(lines):
    """Yield v quarters of a step whose state is in `start` then, at the ends of its eighths.

    `signed` is the length of a quarter.
    """
    own = weights(EXPLICIT, 2)
    _take_quarters(
        lines, len(EXPLICIT), lambda i: weighted(own, lines.of_columns(lines.work.ends, i))
    )
    for part in range(1, 8):
        _put_between(lines, rules.weights_at(0.5 * part))
        yield part


def _take_quarters(lines, count, end):
    """Find the nodes by so many columns; `end(i)` is that of component i of a quarter, less x."""
    text, work, D = lines.text, lines.work, lines.D
    x, f = lines.line.x, lines.line.f
    for k in range(3):
        lines.columns(x, f, count)
        node = work.nodes.after(2 * k * D)
        for i in text.each(D):
            node[i] = x[i] + end(i)
        lines.call("f", node, lines.table, work.f)
        x, f = node, node.after(D)
        text.copy(work.f, f, D)


def _between(lines, weights, i):
    """Return a component of the polynomial with these weights, less x."""
    work, inputs = lines.work, {}
    for k in range(3):
        node = work.nodes.after(2 * k * lines.D)
        inputs |= {f"x{k + 1}": node[i], f"f{k + 1}": node.after(lines.D)[i]}
    inputs |= {"x4": work.new[i], "f4": work.f_new[i], "signed": work.signed[0]}
    return lines.apply(rules.INTERPOLATED, i, **inputs, **weights)["value"]


def _put_between(lines, weights):
    """Write the state inside the step with these weights to `start`."""
    for i in lines.text.each(lines.D):
        x = lines.line.x[i]
        value = x + _between(lines, weights, i)
        if lines.f.of_one_sign:
            value = lines.apply(rules.WITH_SIGN, i, value=value, x=x)["value"]
        lines.work.start.put_chosen(i, value)


def save(lines, bits, states):
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
        times = Shared(one, of.times)
        line.next[0], line.second[0] = times[following], times[following + 1]
        line.tries[0] = 0.0
