"""Dense output: states inside a step, at the requested times.

If a step would pass one requested time, another step ends there (`step_length.LENGTH`). If an
explicit step of order 2 n + 2 has passed several requested times, all but the last of its n parts
are computed again, with few columns. They end at x_1, x_2, ...; x_n is the next state. With v = n
(t - t_0) / h, states inside are the polynomial p of degree 2 n + 1 with p(j) = x_j and p'(j) = h /
n f(x_j), j = 0 ... n,

p(v) = sum_j L_j(v)**2 ((1 - 2 L_j'(j) (v - j)) x_j + (v - j) h / n f(x_j)),

with Lagrange polynomials L_j. Its error is C prod_j (v - j)**2 at first order. The defect p' -
h / n f(p) shows C and the errors of x_j. If it is large, a new step ends at the requested time.
"""

from math import inf, prod

import numpy as np

from ..llvm.text import Carried, Integers, Shared, Value
from .codegen import larger_of, weighted
from .memory import LaneState
from .projected_states import project
from .scalar_kernels import scalar_kernel
from .tolerances import (
    ERROR_OF_DEFECT,
    ERROR_OF_NODES,
    EXACT_END,
    FACTOR_AFTER_REFUSED,
    NEARLY,
    TEST_OF_POLYNOMIAL,
)
from .weights import weights


def few_of(columns):
    """Return how many of the columns give nodes; one column more is used if errors are large."""
    return len(columns) // 2 + 1


def weights_at(v, n):
    """Return the weights in p(v) - x: of x_j - x, j = 1 ... n, and of h / n f(x_j), j = 0 ... n.

    p interpolates the states x_j and rates f(x_j) after j parts of a step from x, where v = j.
    """
    of_states, of_rates, nodes = [], [], range(n + 1)
    for j in nodes:
        others = [k for k in nodes if k != j]
        slope, scale = 2.0 * sum(1.0 / (j - k) for k in others), prod(j - k for k in others)
        product = prod((v - float(k) for k in others), start=1.0 / scale)
        square, own = product * product, v - float(j)
        of_rates.append(own * square)
        if j:
            of_states.append((1.0 - slope * own) * square)
    return of_states, of_rates


@scalar_kernel
def WITH_SIGN(value, x, keeps):
    """Return `value`, a component inside a step, with the sign of x, its start, if `keeps` is 1."""
    signed = x.equals(0.0).select(0.0, abs(value).then("copysign", x))
    return {"value": (keeps > 0.0).select(signed, value)}


def save_between(code):
    """Save states at times within a step, by interpolation."""
    _find_nodes(code)
    _test(code)
    for now in code.text.rounds(Carried()):
        n = code.integrator.rule.nodes
        v = float(n) * ((code.line.next[0] - code.work.began[0]) / code.work.taken[0])
        _put_between(code, weights_at(v, n))
        project(code, code.work.start)
        save(code, _passed(code, Value.__gt__).bits(), code.work.start)
        now.goes_on = _passed(code, Value.__gt__).any()


def save_states(code):
    """Add code that saves states at requested times that a step passed, or a step aside reached."""
    text, work = code.text, code.work
    served = work.served[0] > 0.0
    with text.when((served | _passed(code, Value.__ge__)).any(), likely=False):
        save(code, served.bits(), work.new)
        if code.integrator.rule.interpolates:
            with text.when(_passed(code, Value.__gt__).any()):
                text.invoke(f"{code.name}_between", code.arguments)
        if not code.f.hybrid.acts:
            save(code, _passed(code, Value.equals).bits(), work.new)


def save_at_end(code):
    """Save states at requested times at (or NEARLY at) the end of a step, after actions there."""
    text = code.text
    with text.when(_reached(code).any(), likely=False):
        for now in text.rounds(Carried()):
            save(code, _reached(code).bits(), code.work.new)
            now.goes_on = _reached(code).any()


def _passed(code, how):
    """Return which accepted steps end past the next requested time; `how` compares: >, >= or =.

    If a step ends on a surface, a requested time NEARLY at its end is not passed, because actions
    of events come before the state at this time.
    """
    end = code.line.t[0]
    if code.f.hybrid.acts:
        end = (code.work.at_surface[0] > 0.0).select(end - NEARLY * end, end)
    return (code.work.accepted[0] > 0.0) & how(end, code.line.next[0])


def _reached(code):
    """Return which lanes have accepted a step that reaches their next requested time."""
    return (code.work.accepted[0] > 0.0) & (code.line.t[0] >= code.line.next[0])


def _find_nodes(code):
    """Write states and f after parts of a step to `nodes`."""
    text, line, work, D = code.text, code.line, code.work, code.D
    columns, n = code.integrator.rule.columns, code.integrator.rule.nodes
    part = (1.0 / n) * (code.number("sign") * work.taken[0])
    work.signed[0] = _passed(code, Value.__gt__).select(part, 0.0)
    FEW = few_of(columns)
    # Two sets of weights: for FEW columns, and for FEW + 1; all other columns have weight 0.
    pads = [(k, (0, len(columns) - k)) for k in (FEW, FEW + 1)]
    few, more = (np.pad(weights(columns[:k], 2), pad) for k, pad in pads)
    of_few = few - weights(columns, 2)
    largest = Carried(ratio=0.0)
    for i in text.each(D, largest):
        error = weighted(of_few, code.of_columns(work.ends, i))
        largest.ratio = larger_of(abs(error) * work.inverse[i], largest.ratio)
    needs = largest.ratio > ERROR_OF_NODES * float(n) ** (2 * FEW + 1)
    count = needs.any().bits() + FEW
    factors = [needs.select(text.value(b), a) for a, b in zip(few, more, strict=True)]
    factors = factors[: FEW + 1]

    x, f = line.x, line.f_x
    for k in range(n - 1):
        code.columns(x, f, count)
        node = work.nodes.after(2 * k * D)
        for i in text.each(D):
            ends = code.of_columns(work.ends, i)[: FEW + 1]
            ends[FEW] = needs.select(ends[FEW], 0.0)  # not computed if no lane needs this column
            node[i] = x[i] + weighted(factors, ends)
        code.call("f", node, code.table, work.f_start)
        x, f = node, node.after(D)
        text.copy(work.f_start, f, D)


def _test(code):
    """Reject the step if interpolation fails: the polynomial is not finite, or not accurate."""
    text, line, work, D = code.text, code.line, code.work, code.D
    sums = Carried(ratio=0.0, total=0.0)
    n = code.integrator.rule.nodes
    for v in (TEST_OF_POLYNOMIAL, n - TEST_OF_POLYNOMIAL):
        both = weights_at(complex(v, 2.0**-60), n)  # p(v + i d) = p(v) + i d p'(v) + O(d**2)
        _put_between(code, [[weight.real for weight in each] for each in both])
        of_slope = [[weight.imag * 2.0**60 for weight in each] for each in both]
        code.call("f", work.start, code.table, work.f_start)
        for i in text.each(D, sums):
            defect = abs(_between(code, of_slope, i) - work.signed[0] * work.f_start[i])
            sums.ratio = larger_of(ERROR_OF_DEFECT * defect * work.inverse[i], sums.ratio)
            sums.total = sums.total + (abs(work.f_start[i]) + defect)
    taken, length = work.taken[0], line.next[0] - work.began[0]
    is_right = (sums.ratio <= 1.0) | (taken - length <= EXACT_END * taken)
    fails = _passed(code, Value.__gt__) & ~(is_right & (sums.total < inf))
    with text.when(fails.any(), likely=False):
        # A very short step would be followed by others that are too short. So it is a step aside.
        is_short = length <= larger_of(EXACT_END * taken, NEARLY * work.began[0])
        again = {"wanted": is_short.select(taken, length), "second": inf}
        again |= {"t": work.began[0], "steps": line.steps[0] - 1.0}
        again |= {"state": float(LaneState.EXPLICIT), "longer": FACTOR_AFTER_REFUSED}
        code.keep(line, again, fails)
        work.accepted.choose(fails, 0, 0.0)


def _between(code, weights, i):
    """Return component i of p(v) - x, or of p'(v), by its weights, see `weights_at`."""
    line, work, D = code.line, code.work, code.D
    nodes = [work.nodes.after(2 * k * D) for k in range(code.integrator.rule.nodes - 1)]
    x, (of_states, of_rates) = line.x[i], weights
    states = [state[i] - x for state in (*nodes, work.new)]
    rates = [rate[i] for rate in (line.f_x, *(node.after(D) for node in nodes), work.f_new)]
    return weighted(of_states, states) + work.signed[0] * weighted(of_rates, rates)


def _put_between(code, weights):
    """Write the state inside a step that has these `weights` (`weights_at`) to the row `start`."""
    for i in code.text.each(code.D):
        x = code.line.x[i]
        value = x + _between(code, weights, i)
        if code.f.of_one_sign:
            value = code.apply(WITH_SIGN, i, value=value, x=x)["value"]
        code.work.start.put_chosen(i, value)


def save(code, bits, states):
    """Save rows `states` at the next time, in lanes with bit 1 in `bits`; set their next times."""
    text, loaded, rows = code.text, code.loaded, code.integrator.rows
    one = text.lanes(1)
    for offset in code.lanes_with(bits):
        line = one.arrays(code.line.x.at() + offset, rows)
        of_work = code.work.line.at() + offset
        place_at = Integers(text, line.place.at())
        place = place_at[0]
        trajectory = Integers(text, line.trajectory.at())[0]
        to = loaded.states + place * loaded.state_bytes
        to = to + trajectory * (8 * code.D)
        for i in text.each(code.D):
            Shared(one, to)[i] = one.array(of_work, states.first)[i]
        code.put_clocks(one, offset, line.next[0], Shared(one, to))
        following = place + 1
        place_at[0] = following
        times = Shared(one, loaded.times)
        line.next[0], line.second[0] = times[following], times[following + 1]
        line.tries[0] = 0.0
