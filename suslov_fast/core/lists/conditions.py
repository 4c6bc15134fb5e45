"""Right-hand sides that choose: the same ones with choices that are fixed along a step.

A comparison of numbers, at which f may jump, becomes the comparison of a parameter with 1/2, and
`floor` becomes a parameter. So f is smooth within a step, even beyond the surface on which a choice
changes: the difference of the numbers that are compared, or the argument of `floor`. The kinks of
`abs`, `minimum` and `maximum` are surfaces, too; there f stays as it is, because it does not jump.
Steps end on surfaces of both kinds.
"""

import functools
import operator

import numpy as np

from .grouped import Groups
from .numbers import Number, larger, smaller
from .records import same
from .right_hand_side import Expressions, List, RightHandSide, needed_for
from .step import Values

_COMPARISONS = "olt", "ogt", "oge", "oeq"
_EXTREMES = "max", "min"


class Conditions:
    """What the choices of a right-hand side are made of.

    count      how many there are
    is_floor   (count,), whether a choice is an integer rather than a truth value
    """

    def __init__(self, truths, kinds, D, P):
        self.D, self.P, self.count = D, P, len(kinds)
        self.is_floor = np.array([kind == "floor" for kind in kinds])
        self._truths = Groups(truths, range(D + P))

    def choices_at(self, x, parameters):
        """Return the choices (count, ...) of f at states (D, ...), for parameters (P, ...)."""
        with np.errstate(all="ignore"):
            return self._truths.carried_out([*x, *parameters], x.shape[1:])


def watch_of(f, kinds):
    """Return the `List` that finds where a straight line from x to y crosses surfaces of f first.

    Values 0 to D - 1 are x, the next D are y, and those of the table follow. Results are the part
    of the line before a surface, which is 1 where none is crossed; 1 where one is crossed, else 0;
    and 1 where f jumps there. `kinds` are comparisons and "floor", whose choices begin the table
    after the parameters, and "kink".
    """
    D, first = f.D, f.P - sum(kind != "kink" for kind in kinds)
    of_table = {number: 2 * D + place for number, place in f.places.items()}
    values = Values(2 * D + len(f.table), ())
    ends = []
    for begin in (0, D):
        new = {i: begin + i for i in range(D)} | of_table
        for name, number, operands in f.surfaces.operations:
            of = (a if isinstance(a, float) else new[a] for a in operands)
            new[number] = values.emit(name, *of)
        results = (a if isinstance(a, float) else new[a] for a in f.surfaces.results)
        ends.append([Number(values.emit, a) for a in results])
    changes, jumps, part = [], [], 1.0
    for k, (kind, a, b) in enumerate(zip(kinds, *ends, strict=True)):
        if kind == "kink":
            change = (a >= 0.0) ^ (b >= 0.0)
        else:
            choice = Number(values.emit, of_table[D + first + k])
            if kind == "floor":
                change = b.then("floor").equals(choice) ^ Number(values.emit, 0.0).equals(0.0)
                level = choice + (b >= choice + 1.0).select(1.0, 0.0)
                a, b = a - level, b - level
            else:
                now = {"oge": lambda b=b: b >= 0.0, "oeq": lambda b=b: b.equals(0.0)}
                change = now.get(kind, lambda b=b: b > 0.0)() ^ (choice > 0.5)
            jumps.append(change)
        own = larger(smaller(a / (a - b), 1.0), 0.0)
        part = smaller(change.select(own, 1.0), part)
        changes.append(change)

    def some(truths):
        return functools.reduce(operator.or_, truths).select(1.0, 0.0).number if truths else 0.0

    return List(values.operations, [part.number, some(changes), some(jumps)])


def with_fixed_choices(values, results, P, by=()):
    """Return the `RightHandSide` whose choices are its last parameters, after the P others.

    Where f chooses or has kinks it has `surfaces`, and `watch`; where f chooses, `conditions`.
    `by` are numbers of parameters to differentiate by.
    """
    D = len(results)
    operations = needed_for(values.operations, results)
    varying = [each for each in operations if any(_varies(values, a) for a in each[2])]
    chosen = {
        number: name
        for name, number, operands in varying
        if name == "floor" or (name in _COMPARISONS and not same(*operands))  # whether it is NaN
    }
    bent = {
        number
        for name, number, operands in varying
        if name in _EXTREMES or (name == "fabs" and not _is_0_times(values, *operands))
    }
    if not (chosen or bent):
        return RightHandSide(values, results, P, by)
    first = D + P
    given = first + len(chosen)
    fixed = Expressions(given, range(D, given))
    new, surfaces, kinks = {a: a for a in range(first)}, [], []
    for name, number, operands in operations:
        of = [a if isinstance(a, float) else new[a] for a in operands]
        if number in bent:
            kinks.append(of[0] if name == "fabs" else fixed.emit("fsub", *of))
        if number not in chosen:
            new[number] = fixed.emit(name, *of)
            continue
        choice = first + len(surfaces)
        if name == "floor":
            new[number], surface = choice, of[0]
        else:
            new[number] = fixed.emit("ogt", choice, 0.5)
            surface = fixed.emit("fsub", *(of[::-1] if name == "olt" else of))
        surfaces.append(surface)
    for number, (name, operands, *tables) in values.written.items():
        others = [a if isinstance(a, float) else new.get(a) for a in operands]
        place = new.get(number)
        if isinstance(place, int) and None not in others:
            fixed.written.setdefault(place, (name, (*others,), *tables))
    own = [a if isinstance(a, float) else new[a] for a in results]
    kinks = [a for a in dict.fromkeys(kinks) if _varies(fixed, a)]
    f = RightHandSide(
        fixed,
        own,
        given - D,
        by,
        surfaces=[*surfaces, *kinks],
        jumps=len(surfaces),
        kept=range(D, given) if chosen else (),
    )
    kinds = [*chosen.values()]
    f.clocks = sorted({*f.clocks, *RightHandSide(values, results, P).clocks})
    f.watch = watch_of(f, [*kinds, *["kink"] * len(kinks)])
    if chosen:
        truths = List(needed_for(operations, [*chosen]), [*chosen])
        f.conditions = Conditions(truths, kinds, D, P)
    return f


def _varies(values, operand):
    return not isinstance(operand, float) and operand not in values.fixed


def _is_0_times(values, operand):
    """Return whether a value is a product with 0, which tells of NaN alone."""
    name, of = values.of.get(operand, ("", ()))
    return name == "fmul" and isinstance(of[0], float) and of[0] == 0.0
