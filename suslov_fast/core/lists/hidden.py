"""Surfaces that a step may cross twice: what values at its points tell of them.

s_0 ... s_4 are the values of a surface at the beginning of a step and at POINTS of it, with the
sign of the last one. Where the first has this sign, too, the surface is crossed twice or not at
all. With e, OF_ERROR times the error at the middle point of the cubic through the others, and m,
the least of the three values inside and of the parabolas through three neighbours,

- m < -e tells that it is crossed twice;
- |m| <= e tells nothing, and the step must be shorter, by the fourth root of e / |m|;
- m > e tells that it is not crossed.

A state is known within its tolerance, so that a distance of a part rtol of the numbers that are
compared tells nothing, either: no step becomes shorter for less. Beyond a kink, where f bends, it
is rtol**(3/4): there a motion is for a part that is the root of it, and misses less than rtol.
Within ROUNDING of the numbers nothing is crossed, as where a temperature comes to that of a room.
"""

from itertools import zip_longest
from math import inf, prod

from .numbers import larger, smaller
from .right_hand_side import List, depending, emitted, needed_for
from .step import Values
from .tables import LARGEST, interval, is_table

POINTS = 0.23, 0.49, 0.76, 1.0  # not even: waves whose period is a part of a step would hide
OF_ERROR, ROUNDING, TINY, MOST = 16.0, 2.0**-40, 2.0**-1000, 1e4
_ENDS = 0.0, *POINTS
MIDDLE = 2


def hidden_of(f, kinds, jumps, choices):
    """Return what values of surfaces tell, see `_list_of`, and whether some depend on clocks alone.

    Whether some depend on states follows. `choices` are the numbers of the choices of `kinds`, of
    which the first `jumps` are those of surfaces where f jumps; the surfaces of changes follow.
    Left out are surfaces that are linear in clocks.
    """
    results, degrees = f.watched.results, _degrees(f)
    by_states = depending(f.watched.operations, {*range(f.D)}.difference(f.steady))
    kinks = {*results[jumps : len(kinds)]} & by_states
    own = [*enumerate(zip_longest(results, kinds, choices))]
    own = [(k, *of) for k, of in own if not (isinstance(of[0], float) or of[0] in degrees)]
    own = [each for each in own if each[2] != "oeq"]  # which holds at the surface alone
    of_clocks = [each for each in own if each[1] not in by_states]
    return _list_of(f, own, by_states, kinks), bool(of_clocks), len(of_clocks) < len(own)


def _list_of(f, own, by_states, kinks):
    """Return the `List` of what values of surfaces tell, None if there are none.

    Results are the largest e / |m|, at most MOST, which it is where the parabolas alone tell of two
    crossings, and 1 where the points do, else 0. Values are those of the surfaces at five points,
    the state at the middle one, rtol, and those of the table.
    """
    if not own:
        return None
    count = len(f.watched.results)
    middle, rtol = len(_ENDS) * count, len(_ENDS) * count + f.D
    of_table = {number: rtol + 1 + place for number, place in f.places.items()}
    values = Values(rtol + 1 + len(f.table), ())
    state = {i: middle + i for i in range(f.D)} | of_table
    emitted(values, f.watched, state)
    sizes, largest, some = sizes_of(values, f.watched.operations, state), 0.0, 0.0
    for k, a, kind, choice in own:
        points = [values.number(n * count + k) for n in range(len(_ENDS))]
        surfaces = [points]
        if kind == "floor" or is_table(kind):
            low, high = interval(kind, values.number, choice, of_table)
            surfaces = [[s - low for s in points], [high - s for s in points]]
        rounding = ROUNDING * sizes[a]
        tells_nothing = rounding
        if a in by_states:
            root = values.number(rtol).sqrt()
            tells_nothing = (root * root.sqrt() if a in kinks else root * root) * sizes[a]
        for each in surfaces:
            ratio, twice = _told(each, rounding, tells_nothing)
            largest, some = larger(ratio, largest), larger(twice, some)
    results = [largest.number, some.number]
    return List(needed_for(values.operations, results), results)


def _told(points, rounding, tells_nothing):
    """Return e / |m| of one surface, and 1 where the points tell that it is crossed twice."""
    agree = ((points[-1] >= 0.0).select(1.0, -1.0) * points[0]) >= -rounding
    sign = (agree.select(points[-1], points[MIDDLE]) >= 0.0).select(1.0, -1.0)
    points = [sign * s for s in points]
    inside = least = smaller(smaller(points[1], points[2]), points[3])
    for k in range(3):
        (a, s, b), (u, v, w) = points[k : k + 3], _ENDS[k : k + 3]
        before, after = (s - a) * (1.0 / (v - u)), (b - s) * (1.0 / (w - v))
        bend = (after - before) * (1.0 / (w - u))
        slope = before * ((w - v) / (w - u)) + after * ((v - u) / (w - u))
        place = slope / (bend * -2.0)
        is_inside = (bend > 0.0) & (place > u - v) & (place < w - v)
        least = is_inside.select(smaller(s + 0.5 * (slope * place), least), least)
    others = [k for k in range(len(_ENDS)) if k != MIDDLE]
    guess = 0.0
    for k in others:
        weight = prod((_ENDS[MIDDLE] - _ENDS[j]) / (_ENDS[k] - _ENDS[j]) for j in others if j != k)
        guess = guess + weight * points[k]
    error = OF_ERROR * abs(points[MIDDLE] - guess)
    error = (error < inf).select(error, 0.0)
    below = -(error + rounding)
    ratio = smaller(error / larger(larger(abs(least), tells_nothing), TINY), MOST)
    ratio = (inside < below).select(0.0, (least < below).select(MOST, ratio))
    twice = (inside < below).select(1.0, 0.0)
    return (agree | (inside >= 0.0)).select(ratio, 0.0), agree.select(twice, 0.0)


def sizes_of(values, operations, state):
    """Return what values are the sums of, by modulus, at a state; of others their moduli."""
    sizes = {a: abs(values.number(number)) for a, number in state.items()}
    for name, number, operands in operations:
        a, b = (abs(a) if isinstance(a, float) else sizes[a] for a in (*operands, 0.0)[:2])
        if name in ("fadd", "fsub"):
            sizes[number] = a + b
        elif name == "fmul":
            sizes[number] = a * b
        elif name == "fdiv" and not isinstance(operands[1], float):
            sizes[number] = a / abs(values.number(state[operands[1]]))
        elif name == "fdiv":
            sizes[number] = a / b
        elif name == "fabs":
            sizes[number] = a
    return sizes


def _degrees(f):
    """Return the degrees, 0 or 1, of values that are linear in clocks."""
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
