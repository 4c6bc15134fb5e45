"""Steps that cross a surface twice, which the values at both ends of the step do not show.

s_0 ... s_4 are the values of the function s of a surface at the beginning of a step and at POINTS
of the step, times the sign of s_4. If s_0 > 0, the step crosses the surface twice or not at all.
The cubic through the other four points has an error at the middle point; e is 16 times this error.
m is the least of s_1, s_2, s_3 and of the quartic through all five points.

- m < -e: the surface is crossed twice.
- |m| <= e: undecided; the step must be shorter, by the fourth root of e / |m|.
- m > e: the surface is not crossed.

States have errors of about rtol, so s has an error d of rtol times the sizes of its terms. If |m| <
d, a shorter step would not tell more: then e / d replaces e / |m|. At kinks, where f itself is
continuous, d has rtol**(3/4) in place of rtol: a motion that is beyond the kink by less than d is
there for a time of about d**(1/2), in which f is wrong by about d, and d**(3/2) is below rtol.
Values of s within ROUNDING_BETWEEN_POINTS of its terms are no crossings: a temperature that relaxes
to that of a room does not cross it.

The five values do not show a narrow hump of s between two points, as of a bell curve; polynomials
have no such humps. At a hump the rate ds/dt changes its sign between two points. If the straight
line through the rates at these points is far from the rate at a neighbour, the step is too long.

For waves, functions of sin, cos and tan, the phase must change by less than a quarter of a turn
from point to point. The phase of a product is the sum of the phases of its factors. The phase of a
wave inside another function counts twice, as in exp(sin(t)) or sin(cos(t)).
"""

import functools
from itertools import pairwise
from math import inf, pi, prod
from operator import add
from typing import NamedTuple

from ..expressions.dense_product import ENTRY, is_matrix
from ..expressions.derivative import gradients_along
from ..expressions.programs import (
    Expressions,
    Program,
    Values,
    depending,
    emitted,
    needed_for,
    program_of,
)
from ..expressions.rounding import sizes_of
from ..expressions.tables import LARGEST
from ..expressions.tolerances import TINY
from ..expressions.values import larger, operand_of, smaller
from .tolerances import (
    ERROR_OF_POINTS,
    LEAST_OF_THIRD,
    MOST_HIDDEN,
    ROUNDING_BETWEEN_POINTS,
    ROUNDING_OF_STEPS,
    STRAIGHT,
    ZERO_RATE_OF_TERMS,
)

# Fractions of a step. Their distances differ, because a wave may vanish at equally spaced points.
POINTS = 0.23, 0.49, 0.76, 1.0
_FRACTIONS, MIDDLE = (0.0, *POINTS), 2
# The error e of s (above) is OF_FOURTH times the fourth divided difference of s, and at least
# LEAST_OF_THIRD times the third, because the fourth may be 0 by chance.
OF_FOURTH = 16.0 * prod(abs(POINTS[1] - u) for u in _FRACTIONS if u != POINTS[1])
WAVES, QUARTER = ("sin", "cos", "tan"), 0.5 * pi
_OF_POLYNOMIALS = "fadd", "fsub", "fmul", "fabs", "max", "min", "select", ENTRY, *WAVES


class DoubleCrossings(NamedTuple):
    """Programs that find out if a step crosses a surface twice; None for needless programs.

    decision     reads the surfaces, `phases` and `rates`, each at five points of a step; the state
                 at the middle point; rtol; and the table of f
    phases       reads the state and the table; its results are the arguments of sin, cos and tan
    rates        its results are rates of surfaces that may have humps, see `_rates_of`
    of_clocks    True if there are surfaces that depend on clocks alone
    of_states    True if there are surfaces that depend on other components
    inside       the numbers of results of `phases` and of `rates`

    The results of `decision` are maxima over all surfaces, with e and m of the head of this file:

    1. e / |m|; from 1 on the step must be shorter. It is MOST_HIDDEN if interpolation or the rates
       show two crossings that the values at the points do not show.
    2. 1 if the values at the points show two crossings, else 0.
    3. The change of a phase from point to point, in quarters of a turn.
    """

    decision: Program | None = None
    phases: Program | None = None
    rates: Program | None = None
    of_clocks: bool = False
    of_states: bool = False

    inside = property(lambda self: [len(of.results) if of else 0 for of in self[1:3]])


def double_crossings_of(f, watched, surfaces):
    """Return the `DoubleCrossings` of f, for its `surfaces` and the surfaces of events."""
    degrees = _degrees(f, watched)
    by_states = depending(watched.operations, {*range(f.D)}.difference(f.steady))
    tested = [
        (k, a, surface)
        for k, (a, surface) in enumerate(zip(watched.results, surfaces, strict=True))
        # A step crosses surfaces linear in clocks once at most. Equalities (oeq) are true on their
        # surfaces alone, so that crossings do not change them.
        if not (isinstance(a, float) or a in degrees or surface.kind == "oeq")
    ]
    if not tested:
        return DoubleCrossings()
    operations = needed_for(watched.operations, [a for _, a, _ in tested])
    arguments = [operands[0] for name, _, operands in operations if name in WAVES]
    phases = program_of(operations, arguments) if arguments else None
    humps = _humps(f, operations)
    humps = [*dict.fromkeys(a for _, a, _ in tested if a in humps)]
    is_of_states = [a in by_states for _, a, _ in tested]
    rates = _rates_of(f, watched, humps)
    found = DoubleCrossings(None, phases, rates, not all(is_of_states), any(is_of_states))
    decision = _decision_of(f, watched, tested, by_states, humps, found.inside)
    return found._replace(decision=decision)


def _humps(f, operations):
    """Return values that may have narrow humps; piecewise polynomials and waves have none."""
    humps, varying = set(), depending(operations, range(f.D))
    for name, number, operands in operations:
        of = [a for a in operands if not isinstance(a, float)]
        is_quotient = name == "fdiv" and (of[-1] is not operands[1] or of[-1] not in varying)
        is_polynomial = name in _OF_POLYNOMIALS or is_quotient or is_matrix(name)
        if number in varying and (not is_polynomial or not humps.isdisjoint(of)):
            humps.add(number)
    return humps


def _rates_of(f, watched, humps):
    """Return the `Program` of the rates of surfaces with `humps`, or None if there are none.

    `humps` are the values s that may have a hump (head of this file). For each the program gives
    ds/du, with the fraction u of a step, and a bound below which ds/du counts as 0. It reads the
    state x, dx/du, the largest |x| so far, rtol, and the table of f.
    """
    if not humps:
        return None
    D = f.D
    first = 3 * D + 1
    values = Expressions(first + len(f.table), range(D, first + len(f.table)))
    new = {i: i for i in range(D)} | {a: first + k for a, k in f.places.items()}
    surfaces = emitted(values, program_of(watched.operations, humps), new)
    results, of_states = [], values.number(3 * D) + ERROR_OF_POINTS
    rows, v = gradients_along(values, surfaces, D, {j: D + j for j in range(D)})
    for row in rows:
        rate = zero = 0.0
        for j, slope in row.items():
            term = values.number(slope) * values.number(v.get(j, 0.0))
            rate, zero = rate + term, zero + abs(term) * ZERO_RATE_OF_TERMS
            rounding = values.number(2 * D + j) * ROUNDING_OF_STEPS
            zero = zero + abs(values.number(slope)) * (abs(values.number(j)) * of_states + rounding)
        results += [operand_of(rate), operand_of(zero)]
    return program_of(values.operations, results)


def _decision_of(f, watched, tested, by_states, humps, inside):
    """Return the `Program` `decision` of `DoubleCrossings`.

    `tested` has the place of each surface among the results of `watched`, its operand, and the
    `Surface`. `by_states` are the operands that depend on other components than clocks, `humps` as
    in `_rates_of`, `inside` as in `DoubleCrossings`.
    """
    count, of_phases, of_rates = len(watched.results), *inside
    first_phase = len(_FRACTIONS) * count
    first_rate = first_phase + len(_FRACTIONS) * of_phases
    middle = first_rate + len(_FRACTIONS) * of_rates
    rtol = middle + f.D
    of_table = {number: rtol + 1 + place for number, place in f.places.items()}
    values = Values(rtol + 1 + len(f.table), ())
    state = {i: middle + i for i in range(f.D)} | of_table

    def at_points(first, count, k):
        return [values.number(first + n * count + k) for n in range(len(_FRACTIONS))]

    operations = needed_for(watched.operations, [a for _, a, _ in tested])
    turns = [at_points(first_phase, of_phases, k) for k in range(of_phases)]
    turns = _turns(operations, turns)
    waves = [each for _, a, _ in tested for each in turns.get(a, ())]
    waves = functools.reduce(larger, waves) * (1.0 / QUARTER) if waves else 0.0
    emitted(values, watched, state)
    sizes = sizes_of(values, watched.operations, state, with_branches=False)
    ratio = twice = 0.0
    for k, a, surface in tested:
        points, rates = at_points(0, count, k), None
        if a in humps:
            rates = [at_points(first_rate, of_rates, 2 * humps.index(a) + n) for n in (0, 1)]
        both = [(points, rates)]
        if interval := surface.interval(values.number, of_table):
            low, high = interval
            opposite = rates and [[-r for r in rates[0]], rates[1]]
            both = ([s - low for s in points], rates), ([high - s for s in points], opposite)
        rounding = error = ROUNDING_BETWEEN_POINTS * sizes[a]
        if a in by_states:
            root = values.number(rtol).sqrt()
            bends = surface.kind != "event" and not surface.jumps
            error = (root * root.sqrt() if bends else root * root) * sizes[a]
        for each in both:
            own_ratio, own_twice = _decided(*each, rounding, error)
            ratio, twice = larger(own_ratio, ratio), larger(own_twice, twice)
    return program_of(values.operations, [*map(operand_of, (ratio, twice, waves))])


def _turns(operations, arguments):
    """Return {number of a value: changes of its phase between neighbouring points of a step}.

    `arguments` has the phase a at five points for each sin(a), cos(a) or tan(a) in `operations`.
    """
    turns, arguments = {}, iter(arguments)
    for name, number, operands in operations:
        of = [turns[a] for a in operands if not isinstance(a, float) and a in turns]
        if name in WAVES:
            turn = [abs(b - a) for a, b in pairwise(next(arguments))]
            both = zip(*of, turn, strict=True)
            turns[number] = [2.0 * (a + b) for a, b in both] if of else turn
        elif of:
            how = add if name in ("fmul", "fdiv") else larger
            turn = [functools.reduce(how, each) for each in zip(*of, strict=True)]
            is_plain = name in _OF_POLYNOMIALS or (name == "fdiv" and len(of) == 1)
            turns[number] = turn if is_plain else [2.0 * each for each in turn]
    return turns


def _decided(points, rates, rounding, tolerance):
    """Return e / |m| of a surface s, and 1 if its values show two crossings in a step, else 0.

    m is the least value of s inside the step, e its error, as in the head of this file. `points`
    are s at five points of the step. `rates` is None, or has ds/du and the bounds of `_rates_of` at
    these points. Values within `rounding` of 0 are no crossings, and an |m| below `tolerance`
    counts as `tolerance`.
    """
    agree = ((points[-1] >= 0.0).select(1.0, -1.0) * points[0]) >= -rounding
    sign = (agree.select(points[-1], points[MIDDLE]) >= 0.0).select(1.0, -1.0)
    points = [sign * s for s in points]
    sides = smaller(points[1], points[3])
    inside = smaller(points[2], sides)
    place = (points[1] < points[3]).select(_FRACTIONS[1], _FRACTIONS[3])
    place = (points[2] < sides).select(_FRACTIONS[2], place)
    end = (points[0] < points[4]).select(0.0, 1.0)
    coefficients = _divided(points)
    least = smaller(_least_near(coefficients, place), inside)
    least = smaller(_least_near(coefficients, end), least)
    error = larger(OF_FOURTH * abs(coefficients[4]), LEAST_OF_THIRD * abs(coefficients[3]))
    error = (error < inf).select(error, 0.0)
    below = -(error + rounding)
    ratio = smaller(error / larger(larger(abs(least), tolerance), TINY), MOST_HIDDEN)
    ratio = (inside < below).select(0.0, (least < below).select(MOST_HIDDEN, ratio))
    twice = (inside < below).select(1.0, 0.0)
    if rates:
        ratio = _is_steep([sign * rate for rate in rates[0]], rates[1]).select(MOST_HIDDEN, ratio)
    return (agree | (inside >= 0.0)).select(ratio, 0.0), agree.select(twice, 0.0)


def _divided(points):
    """Return the coefficients of Newton's polynomial through `points`, values at 0 and POINTS."""
    coefficients = []
    while points:
        coefficients.append(points[0])
        n, pairs = len(coefficients), enumerate(pairwise(points))
        points = [(b - a) * (1.0 / (_FRACTIONS[k + n] - _FRACTIONS[k])) for k, (a, b) in pairs]
    return coefficients


def _least_near(coefficients, place):
    """Return the minimum near `place` of the quartic with Newton's `coefficients`, or infinity."""
    _, slope, bend = _of_quartic(coefficients, place)
    least = place - (slope / (bend + bend)).within(-0.25, 0.25)
    is_inside = (bend > 0.0) & (least > 0.0) & (least < 1.0)
    return is_inside.select(_of_quartic(coefficients, least)[0], inf)


def _of_quartic(coefficients, u):
    """Return P, P' and P'' / 2 at u, where P is the quartic with Newton's `coefficients`."""
    value, slope, bend = coefficients[-1], 0.0, 0.0
    for end, c in zip(reversed(_FRACTIONS[:-1]), reversed(coefficients[:-1]), strict=True):
        x = u - end
        value, slope, bend = value * x + c, slope * x + value, bend * x + slope
    return value, slope, bend


def _is_steep(rates, zeros):
    """Return the truth value that the rates of a surface s show a sharp minimum of s in a step.

    A minimum lies between a negative and a positive rate; `rates` up to `zeros` count as 0. It is
    sharp if the line through both rates misses the rate beside them.
    """
    is_steep = None
    for k, (u, v) in enumerate(pairwise(_FRACTIONS)):
        change = rates[k + 1] - rates[k]
        apart = 0.0
        for j in (k - 1, k + 2):
            if 0 <= j < len(_FRACTIONS):
                line = rates[k] + change * ((_FRACTIONS[j] - u) / (v - u))
                apart = larger(abs(line - rates[j]), apart)
        is_minimum = (rates[k] < -zeros[k]) & (rates[k + 1] > zeros[k + 1])
        is_sharp = is_minimum & (apart > STRAIGHT * change)
        is_steep = is_sharp if is_steep is None else is_steep | is_sharp
    return is_steep


def _degrees(f, watched):
    """Return {number of a value: degree 0 or 1} of the values of f that are linear in clocks."""
    degrees = dict.fromkeys(f.table, 0) | dict.fromkeys(f.steady, 1)
    for name, number, operands in watched.operations:
        of = [0 if isinstance(a, float) else degrees.get(a, 2) for a in operands]
        if name == "fmul":
            degree = sum(of)
        elif name in ("max", "min") and operands[0] in (-LARGEST, LARGEST):
            degree = of[1]  # the argument of a table, clipped by `branches._finite`
        elif name in ("fadd", "fsub") or (name == "fdiv" and not of[1]):
            degree = max(of)
        else:
            degree = 2 * max(of)
        if degree < 2:
            degrees[number] = degree
    return degrees
