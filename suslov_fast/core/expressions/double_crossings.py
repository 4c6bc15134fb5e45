"""Surfaces that a step may cross twice: tests by values of the surface at points of the step.

s_0 ... s_4 are the values of a surface at the beginning of a step and at POINTS of it, with the
sign of s_4. If s_0 has this sign, too, the surface is crossed twice or not at all. A cubic through
the four other points has an error at the middle point; e is 16 times this error. m is the least of
the three values inside and of the quartic through all five points.

- m < -e: the surface is crossed twice.
- |m| <= e: undecided; the step must be shorter, by the fourth root of e / |m|.
- m > e: the surface is not crossed.

A state is known within its tolerance, so that a distance below rtol times the numbers that are
compared is undecided, too: no step becomes shorter for less. At a kink, where f bends, the factor
is d = rtol**(3/4): a motion is beyond it for a time of the order of d**(1/2), and its error is less
than rtol. Within ROUNDING of the numbers nothing is crossed, as when a temperature relaxes to the
temperature of a room.

Values do not show a hump between points of a function that is no polynomial, such as a bell. Rates
do: ds/dt changes its sign in the part with the top. If a straight line through the rates at both
ends of that part does not predict the next rate, the step must be shorter.

Waves, functions of sin, cos and tan, need points close to each other: between two of them the phase
of an argument changes by less than a quarter of a turn. Phases of factors add up. Phases in a
function that is no polynomial of waves count twice, as in exp(sin(t)), and in a wave of a wave.
"""

import functools
from itertools import pairwise, zip_longest
from math import inf, pi, prod
from operator import add
from typing import NamedTuple

from .dense_product import ENTRY, DenseMatrix, is_matrix
from .derivative import gradients_along
from .programs import Expressions, Program, Values, depending, emitted, needed_for
from .tables import LARGEST, interval, is_table
from .values import larger, operand_of, smaller

POINTS = 0.23, 0.49, 0.76, 1.0  # not even: waves whose period is a part of a step would hide
ROUNDING, TINY, MOST = 2.0**-40, 2.0**-1000, 1e4
_ENDS = 0.0, *POINTS
MIDDLE = 2
# Factors of divided differences. The fourth may vanish by chance; then the third decides.
OF_FOURTH = 16.0 * prod(abs(_ENDS[MIDDLE] - u) for u in _ENDS if u != _ENDS[MIDDLE])
OF_THIRD = 2.0**-7
WAVES, QUARTER = ("sin", "cos", "tan"), 0.5 * pi
# For rates: how far the rates beside a hump may be from a straight line, relative to their change
# in its part; and what counts as 0, relative to the sum of their terms, and to states besides rtol.
STRAIGHT, OF_TERMS, OF_STATES = 0.25, 2.0**-10, 2.0**-38
_OF_POLYNOMIALS = "fadd", "fsub", "fmul", "fabs", "max", "min", "select", ENTRY, *WAVES


class DoubleCrossings(NamedTuple):
    """Programs that find surfaces which a step crosses twice: its end alone does not show them.

    told         the `Program` that decides, see below; None if no surface may be crossed twice
    phases       the `Program` of the arguments of sin, cos and tan at a state, or None
    rates        the `Program` of rates of surfaces that may have humps, or None, see `_rates_of`
    of_clocks, of_states   True if some surfaces depend on clocks alone, or on other components

    `told` reads values of the surfaces at five points of a step, phases and rates there, the state
    at the middle point, rtol, and the table of f. Each result is the largest of all surfaces:
    1. e / |m|, undecided from 1 on: e is the error of interpolation between points, and m the least
       value of the surface. It is MOST if interpolation or rates alone show two crossings.
    2. 1 if values at points show two crossings, else 0.
    3. The change of a phase, an argument of sin, cos or tan, between two points, over pi / 2.
    """

    told: Program | None = None
    phases: Program | None = None
    rates: Program | None = None
    of_clocks: bool = False
    of_states: bool = False

    @property
    def inside(self):
        """[m, n]: at points of a step `phases` computes m angles, `rates` n numbers; 0 for None."""
        return [len(each.results) if each else 0 for each in (self.phases, self.rates)]


def double_crossings_of(f, kinds, jumps, choices):
    """Return the `DoubleCrossings` of a right-hand side f and of its events.

    `kinds` are the conditions of the surfaces of f (`Branches.kinds`); f jumps at the first `jumps`
    of them. `choices` are the numbers of the parameters that hold their branches. Surfaces linear
    in clocks are left out, because a step crosses them once at most.
    """
    results, degrees = f.watched.results, _degrees(f)
    by_states = depending(f.watched.operations, {*range(f.D)}.difference(f.steady))
    kinks = {*results[jumps : len(kinds)]} & by_states
    own = [*enumerate(zip_longest(results, kinds, choices))]
    own = [(k, *of) for k, of in own if not (isinstance(of[0], float) or of[0] in degrees)]
    own = [each for each in own if each[2] != "oeq"]  # which is true on the surface alone
    if not own:
        return DoubleCrossings()
    operations = needed_for(f.watched.operations, [a for _, a, *_ in own])
    arguments = [operands[0] for name, _, operands in operations if name in WAVES]
    phases = Program(needed_for(operations, arguments), arguments) if arguments else None
    humps = _humps(f, operations)
    humps = [*dict.fromkeys(a for _, a, *_ in own if a in humps)]
    of_clocks = [each for each in own if each[1] not in by_states]
    found = DoubleCrossings(
        None, phases, _rates_of(f, humps), bool(of_clocks), len(of_clocks) < len(own)
    )
    return found._replace(told=_list_of(f, own, by_states, kinks, humps, found.inside))


def _humps(f, operations):
    """Return the set of numbers of values that may have humps: extrema between points of a step.

    `operations` compute the values. Piecewise polynomials in states, sin, cos and tan have none.
    """
    found, varying = set(), depending(operations, range(f.D))
    for name, number, operands in operations:
        of = [a for a in operands if not isinstance(a, float)]
        is_quotient = name == "fdiv" and (of[-1] is not operands[1] or of[-1] not in varying)
        is_polynomial = name in _OF_POLYNOMIALS or is_quotient or is_matrix(name)
        if number in varying and (not is_polynomial or not found.isdisjoint(of)):
            found.add(number)
    return found


def _rates_of(f, humps):
    """Return the `Program` of the rates of surfaces s that may have humps, or None without them.

    `humps` are numbers of the values s. For each it gives ds/du, where u is the fraction of a step,
    and a size: smaller rates count as 0. It reads the state x, dx/du, rtol, and the table of f.
    """
    if not humps:
        return None
    D = f.D
    values = Expressions(2 * D + 1 + len(f.table), range(D, 2 * D + 1 + len(f.table)))
    new = {i: i for i in range(D)} | {a: 2 * D + 1 + k for a, k in f.places.items()}
    own = emitted(values, Program(needed_for(f.watched.operations, humps), humps), new)
    results, of_states = [], values.number(2 * D) + OF_STATES
    rows, v = gradients_along(values, own, D, {j: D + j for j in range(D)})
    for row in rows:
        rate = zero = 0.0
        for j, slope in row.items():
            term = values.number(slope) * values.number(v.get(j, 0.0))
            rate, zero = rate + term, zero + abs(term) * OF_TERMS
            zero = zero + abs(values.number(slope) * values.number(j)) * of_states
        results += [operand_of(rate), operand_of(zero)]
    return Program(needed_for(values.operations, results), results)


def _list_of(f, tested, by_states, kinks, humps, inside):
    """Return the program `told` of `DoubleCrossings`: it decides if a step crosses surfaces twice.

    `tested` has for each surface its place in the results of `f.watched`, its operand, the kind of
    its condition, and the number of the parameter of its branch (None for events). The next three
    are numbers of values: `by_states` depend on more than clocks, at `kinks` f bends, and `humps`
    may have extrema between points. `inside` is how many results `phases` and `rates` have.
    """
    count, of_phases, of_rates = len(f.watched.results), *inside
    first_phase = len(_ENDS) * count
    first_rate = first_phase + len(_ENDS) * of_phases
    middle = first_rate + len(_ENDS) * of_rates
    rtol = middle + f.D
    of_table = {number: rtol + 1 + place for number, place in f.places.items()}
    values = Values(rtol + 1 + len(f.table), ())
    state = {i: middle + i for i in range(f.D)} | of_table

    def at_points(first, count, k):
        return [values.number(first + n * count + k) for n in range(len(_ENDS))]

    operations = needed_for(f.watched.operations, [a for _, a, *_ in tested])
    turns = [at_points(first_phase, of_phases, k) for k in range(of_phases)]
    turns = _turns(operations, turns)
    waves = [each for _, a, *_ in tested for each in turns.get(a, ())]
    waves = functools.reduce(larger, waves) * (1.0 / QUARTER) if waves else 0.0
    emitted(values, f.watched, state)
    sizes = sizes_of(values, f.watched.operations, state, with_branches=False)
    largest, some = 0.0, 0.0
    for k, a, kind, choice in tested:
        points, rates = at_points(0, count, k), None
        if a in humps:
            rates = [at_points(first_rate, of_rates, 2 * humps.index(a) + n) for n in (0, 1)]
        surfaces = [(points, rates)]
        if kind == "floor" or is_table(kind):
            low, high = interval(kind, values.number, choice, of_table)
            surfaces = [([s - low for s in points], rates)]
            rates = rates and [[-r for r in rates[0]], rates[1]]
            surfaces.append(([high - s for s in points], rates))
        rounding = ROUNDING * sizes[a]
        tells_nothing = rounding
        if a in by_states:
            root = values.number(rtol).sqrt()
            tells_nothing = (root * root.sqrt() if a in kinks else root * root) * sizes[a]
        for each in surfaces:
            ratio, twice = _told(*each, rounding, tells_nothing)
            largest, some = larger(ratio, largest), larger(twice, some)
    results = [*map(operand_of, (largest, some, waves))]
    return Program(needed_for(values.operations, results), results)


def _turns(operations, arguments):
    """Return {number of a value: changes of its phase between neighbouring points of a step}.

    `arguments` has the phase a at five points for each sin(a), cos(a) or tan(a) in `operations`.
    """
    found, arguments = {}, iter(arguments)
    for name, number, operands in operations:
        of = [found[a] for a in operands if not isinstance(a, float) and a in found]
        if name in WAVES:
            own = [abs(b - a) for a, b in pairwise(next(arguments))]
            found[number] = [2.0 * (a + b) for a, b in zip(*of, own, strict=True)] if of else own
        elif of:
            how = add if name in ("fmul", "fdiv") else larger
            own = [functools.reduce(how, each) for each in zip(*of, strict=True)]
            is_plain = name in _OF_POLYNOMIALS or (name == "fdiv" and len(of) == 1)
            found[number] = own if is_plain else [2.0 * each for each in own]
    return found


def _told(points, rates, rounding, tolerance):
    """Return e / |m| of a surface s, and 1 if its values show two crossings in a step, else 0.

    `points` are the values of s at five points of the step. e is an error of interpolation between
    them, and m the least value, negative beyond the surface. e / |m| is MOST if interpolation or
    rates alone show two crossings. `rates` is None, or has two lists for the points: ds/du with the
    fraction u of the step, and sizes within which it counts as 0. Distances from s = 0 below
    `rounding` are no crossings. An |m| below `tolerance` counts as `tolerance`.
    """
    agree = ((points[-1] >= 0.0).select(1.0, -1.0) * points[0]) >= -rounding
    sign = (agree.select(points[-1], points[MIDDLE]) >= 0.0).select(1.0, -1.0)
    points = [sign * s for s in points]
    sides = smaller(points[1], points[3])
    inside = smaller(points[2], sides)
    place = (points[1] < points[3]).select(_ENDS[1], _ENDS[3])
    place = (points[2] < sides).select(_ENDS[2], place)
    end = (points[0] < points[4]).select(_ENDS[0], _ENDS[4])
    coefficients = _divided(points)
    least = smaller(_least_near(coefficients, place), inside)
    least = smaller(_least_near(coefficients, end), least)
    error = larger(OF_FOURTH * abs(coefficients[4]), OF_THIRD * abs(coefficients[3]))
    error = (error < inf).select(error, 0.0)
    below = -(error + rounding)
    ratio = smaller(error / larger(larger(abs(least), tolerance), TINY), MOST)
    ratio = (inside < below).select(0.0, (least < below).select(MOST, ratio))
    twice = (inside < below).select(1.0, 0.0)
    if rates:
        ratio = _is_steep([sign * rate for rate in rates[0]], rates[1]).select(MOST, ratio)
    return (agree | (inside >= 0.0)).select(ratio, 0.0), agree.select(twice, 0.0)


def _divided(points):
    """Return the coefficients of Newton's polynomial through `points`, values at 0 and POINTS."""
    found = []
    while points:
        found.append(points[0])
        n, pairs = len(found), enumerate(pairwise(points))
        points = [(b - a) * (1.0 / (_ENDS[k + n] - _ENDS[k])) for k, (a, b) in pairs]
    return found


def _least_near(coefficients, place):
    """Return the minimum near `place` of the quartic with Newton's `coefficients`, or infinity."""
    _, slope, bend = _of_quartic(coefficients, place)
    least = place - (slope / (bend + bend)).within(-0.25, 0.25)
    is_inside = (bend > 0.0) & (least > 0.0) & (least < 1.0)
    return is_inside.select(_of_quartic(coefficients, least)[0], inf)


def _of_quartic(coefficients, u):
    """Return P, P' and P'' / 2 at u, where P is the quartic with Newton's `coefficients`."""
    value, slope, bend = coefficients[-1], 0.0, 0.0
    for end, c in zip(reversed(_ENDS[:-1]), reversed(coefficients[:-1]), strict=True):
        x = u - end
        value, slope, bend = value * x + c, slope * x + value, bend * x + slope
    return value, slope, bend


def _is_steep(rates, zeros):
    """Return the truth value that the rates of a surface s show a sharp minimum of s in a step.

    `rates` are ds/du at five points; within the sizes `zeros` they count as 0. A minimum is between
    a negative and a positive rate. It is sharp if the line through both misses a neighbouring rate.
    """
    found = None
    for k, (u, v) in enumerate(pairwise(_ENDS)):
        change = rates[k + 1] - rates[k]
        apart = 0.0
        for j in (k - 1, k + 2):
            if 0 <= j < len(_ENDS):
                line = rates[k] + change * ((_ENDS[j] - u) / (v - u))
                apart = larger(abs(line - rates[j]), apart)
        own = (rates[k] < -zeros[k]) & (rates[k + 1] > zeros[k + 1]) & (apart > STRAIGHT * change)
        found = own if found is None else found | own
    return found


def sizes_of(values, operations, state, with_branches=True):
    """Return {number of a value: size}, where the size is the scale of its rounding error.

    The program `values` contains a copy of `operations`: `state` is {number of an input or value:
    its operand in the copy}. Sizes are `Number`s, added to `values`. The size of a sum or
    difference is the sum of the sizes of both operands; other sizes are about the modulus, also
    those of branches, unless `with_branches`.
    """
    sizes = {a: abs(values.number(number)) for a, number in state.items()}
    for name, number, operands in operations:
        a, b, *_ = of = [abs(a) if isinstance(a, float) else sizes[a] for a in (*operands, 0.0)]
        if is_matrix(name):
            moduli = DenseMatrix(abs(name.matrix))
            sizes[number] = values.number(values.emit(moduli, *map(operand_of, of[:-1])))
        elif name == ENTRY:
            sizes[number] = values.number(values.emit(ENTRY, a.number, b))
        elif name in ("fadd", "fsub"):
            sizes[number] = a + b
        elif name == "fmul":
            sizes[number] = a * b
        elif name == "fdiv" and not isinstance(operands[1], float):
            sizes[number] = a / abs(values.number(state[operands[1]]))
        elif name == "fdiv":
            sizes[number] = a / b
        elif name == "fabs":
            sizes[number] = a
        elif with_branches and name in ("max", "min"):
            sizes[number] = larger(a, b)
        elif with_branches and name == "select":
            a, b = (
                abs(values.number(a)) if isinstance(a, float) else sizes[a] for a in operands[1:]
            )
            sizes[number] = values.number(state[operands[0]]).select(a, b)
    return sizes


def _degrees(f):
    """Return {number of a value: 0 or 1}, its degree in clocks; other values of f are left out."""
    degrees = dict.fromkeys(f.table, 0) | dict.fromkeys(f.steady, 1)
    for name, number, operands in f.watched.operations:
        of = [0 if isinstance(a, float) else degrees.get(a, 2) for a in operands]
        if name == "fmul":
            degree = sum(of)
        elif name in ("max", "min") and operands[0] in (-LARGEST, LARGEST):
            degree = of[1]  # the argument of a table
        elif name in ("fadd", "fsub") or (name == "fdiv" and not of[1]):
            degree = max(of)
        else:
            degree = 2 * max(of)
        if degree < 2:
            degrees[number] = degree
    return degrees
