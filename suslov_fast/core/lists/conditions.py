"""Right-hand sides that choose: the same ones with choices that are fixed along a step.

A comparison of numbers, at which f may jump, becomes the comparison of a parameter with 1/2, and
`floor` becomes a parameter. So f is smooth within a step, even beyond the surface on which a choice
changes: the difference of the numbers that are compared, or the argument of `floor`. The kinks of
`abs`, `minimum` and `maximum` are such choices, too; because f does not jump there, steps make them
anew by themselves.
"""

import functools

import numpy as np

from .grouped import Groups
from .numbers import Number, larger, smaller
from .records import same
from .right_hand_side import Expressions, List, RightHandSide, needed_for
from .step import Values

_COMPARISONS = "olt", "ogt", "oge", "oeq"
_EXTREMES = {"max": "ogt", "min": "olt"}


class Conditions:
    """The choices of a right-hand side: those of jumps, and then those of kinks.

    jumps, kinks   their numbers
    P              number of parameters before them
    """

    def __init__(self, truths, jumps, D, P):
        self.D, self.P, self.jumps, self.kinks = D, P, jumps, len(truths.results) - jumps
        self._all = Groups(truths, range(D + P))
        of_kinks = truths.results[jumps:]
        self._of_kinks = Groups(
            List(needed_for(truths.operations, of_kinks), of_kinks), range(D + P)
        )

    def choices_at(self, x, parameters):
        """Return the choices (jumps + kinks, ...) at states (D, ...), for parameters (P, ...)."""
        with np.errstate(all="ignore"):
            return self._all.carried_out([*x, *parameters], x.shape[1:])

    def kinks_at(self, x, parameters):
        """Return the choices (kinks, ...) at states (D, ...), for parameters (P, ...)."""
        with np.errstate(all="ignore"):
            return self._of_kinks.carried_out([*x, *parameters], x.shape[1:])


def watch_of(f, kinds, jumps):
    """Return the `List` that finds where a straight line from x to y crosses surfaces of f first.

    Values 0 to D - 1 are x, the next D are y, and those of the table follow, where the choices
    stand after the parameters. Results are the part of the line before a surface, which is 1 where
    none is crossed; 1 where one is crossed, else 0; 1 where f jumps there; and the choices of kinks
    at y. `kinds` are comparisons and "floor", those of `jumps` first.
    """
    D, first = f.D, f.D + f.P - len(kinds)
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
    changes, now, part = [], [], 1.0
    for k, (kind, a, b) in enumerate(zip(kinds, *ends, strict=True)):
        choice = Number(values.emit, of_table[first + k])
        if kind == "floor":
            change = b.then("floor").equals(choice).select(0.0, 1.0) > 0.0
            level = choice + (b >= choice + 1.0).select(1.0, 0.0)
            a, b = a - level, b - level
        else:
            truth = b >= 0.0 if kind == "oge" else b.equals(0.0) if kind == "oeq" else b > 0.0
            change = truth ^ (choice > 0.5)
            now.append(truth.select(1.0, 0.0).number)
        own = larger(smaller(a / (a - b), 1.0), 0.0)
        part = smaller(change.select(own, 1.0), part)
        changes.append(change)

    def some(truths):
        if not truths:
            return 0.0
        return functools.reduce(lambda a, b: a | b, truths).select(1.0, 0.0).number

    of_kinks = now[len(now) - (len(kinds) - jumps) :]
    return List(values.operations, [part.number, some(changes), some(changes[:jumps]), *of_kinks])


def with_fixed_choices(values, results, P, by=(), twice=False):
    """Return the `RightHandSide` whose choices are its last parameters, after the P others.

    Where f chooses it has `surfaces`, `watch` and `conditions`. `by` are numbers of parameters to
    differentiate by, `twice` asks for the second derivative.
    """
    D = len(results)
    operations = needed_for(values.operations, results)
    varying = [each for each in operations if any(_varies(values, a) for a in each[2])]
    jumps = {
        number: name
        for name, number, operands in varying
        if name == "floor" or (name in _COMPARISONS and not same(*operands))  # whether it is NaN
    }
    kinks = {
        number: _EXTREMES.get(name, "ogt")
        for name, number, operands in varying
        if name in _EXTREMES or (name == "fabs" and not _is_0_times(values, *operands))
    }
    kinds = jumps | kinks
    if not kinds:
        return RightHandSide(values, results, P, by, twice=twice)
    first = D + P
    given = first + len(kinds)
    choices = {number: first + k for k, number in enumerate(kinds)}
    fixed = Expressions(given, range(D, first + len(jumps)))
    new, surfaces, truths = {a: a for a in range(first)}, {}, {}
    tests = Expressions(first, values.fixed)  # the choices themselves
    old = {a: a for a in range(first)}
    for name, number, operands in operations:
        of = [a if isinstance(a, float) else new[a] for a in operands]
        others = [a if isinstance(a, float) else old[a] for a in operands]
        old[number] = tests.emit(name, *others)
        if number not in kinds:
            new[number] = fixed.emit(name, *of)
            continue
        kind, choice = kinds[number], choices[number]
        a, b = of if len(of) > 1 else (of[0], 0.0)
        surfaces[number] = fixed.emit("fsub", *((b, a) if kind == "olt" else (a, b)))
        truths[number] = old[number]
        if number in kinks:
            truths[number] = tests.emit(kind, *(others if len(of) > 1 else (others[0], 0.0)))
        if kind == "floor":
            surfaces[number], new[number] = a, choice
            continue
        truth = fixed.emit("ogt", choice, 0.5)
        new[number] = truth
        if number in kinks:
            b = fixed.emit("fmul", -1.0, a) if name == "fabs" else b
            new[number] = fixed.emit("select", truth, a, b)
    fixed.take_written(values, new)
    own = [a if isinstance(a, float) else new[a] for a in results]
    f = RightHandSide(
        fixed,
        own,
        given - D,
        by,
        surfaces=[surfaces[number] for number in kinds],
        jumps=len(jumps),
        kept=range(D, given),
        twice=twice,
    )
    plain = RightHandSide(values, results, P)  # a rate that is constant along a step may change
    f.steady, f.clocks = plain.steady, plain.clocks
    f.watch = watch_of(f, [*kinds.values()], len(jumps))
    tested = [truths[number] for number in kinds]
    f.conditions = Conditions(List(needed_for(tests.operations, tested), tested), len(jumps), D, P)
    return f


def _varies(values, operand):
    return not isinstance(operand, float) and operand not in values.fixed


def _is_0_times(values, operand):
    """Return whether a value is a product with 0, which tells of NaN alone."""
    name, of = values.of.get(operand, ("", ()))
    return name == "fmul" and isinstance(of[0], float) and of[0] == 0.0
