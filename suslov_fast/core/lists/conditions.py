"""Right-hand sides that choose: the same ones with choices that are fixed along a step.

A comparison of numbers, at which f may jump, becomes the comparison of a parameter with 1/2, and
`floor` becomes a parameter. So f is smooth within a step, even beyond the surface on which a choice
changes: the difference of the numbers that are compared, or the argument of `floor`.
"""

import numpy as np

from .records import same
from .right_hand_side import Expressions, List, RightHandSide, needed_for
from .step import evaluate

_COMPARISONS = "olt", "ogt", "oge", "oeq"


class Conditions:
    """What the choices of a right-hand side are made of.

    count      how many there are
    is_floor   (count,), whether a choice is an integer rather than a truth value
    is_closed  (count,), whether a truth value is true where the surface is 0
    is_equal   (count,), whether it is true there alone
    """

    def __init__(self, truths, kinds, D, P):
        self._truths, self._D, self.P, self.count = truths, D, P, len(kinds)
        self.is_floor = np.array([kind == "floor" for kind in kinds])
        self.is_closed = np.array([kind == "oge" for kind in kinds])
        self.is_equal = np.array([kind == "oeq" for kind in kinds])

    def choices_at(self, x, parameters):
        """Return the choices (count, ...) of f at states (D, ...), for parameters (P, ...)."""
        values = dict(enumerate([*x, *parameters]))
        with np.errstate(all="ignore"):
            evaluate(self._truths.operations, values)
        return np.array(
            [np.broadcast_to(values[a], x.shape[1:]) for a in self._truths.results], float
        )

    def choices_of(self, surfaces):
        """Return the choices that values (count, ...) of the surfaces stand for."""
        choices = (surfaces > 0.0).astype(float)
        for kind in ("is_closed", "is_equal", "is_floor"):
            (k,) = np.nonzero(getattr(self, kind))
            if k.size:
                own = surfaces[k]
                choices[k] = {
                    "is_closed": own >= 0.0, "is_equal": own == 0.0, "is_floor": np.floor(own),
                }[kind]  # fmt: skip
        return choices


def with_fixed_choices(values, results, P):
    """Return the `RightHandSide` whose choices are its last parameters; None if there are none.

    It has the surfaces as `surfaces`, and the attribute `conditions`.
    """
    D = len(results)
    operations = needed_for(values.operations, results)
    chosen = {
        number: name
        for name, number, operands in operations
        if name in (*_COMPARISONS, "floor")
        and any(_varies(values, a) for a in operands)
        and (name == "floor" or not same(*operands))  # not the test whether a number is NaN
    }
    if not chosen:
        return None
    first = D + P
    given = first + len(chosen)
    fixed = Expressions(given, range(D, given))
    new, surfaces = {a: a for a in range(first)}, []
    for name, number, operands in operations:
        of = [a if isinstance(a, float) else new[a] for a in operands]
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
    given = range(D, given)
    f = RightHandSide(fixed, own, len(given), surfaces=surfaces, kept=given)
    f.clocks = sorted({*f.clocks, *RightHandSide(values, results, P).clocks})
    truths = List(needed_for(operations, [*chosen]), [*chosen])
    f.conditions = Conditions(truths, [*chosen.values()], D, P)
    return f


def _varies(values, operand):
    return not isinstance(operand, float) and operand not in values.fixed
