"""Sums of many comparisons of one number with constants, as tables: pulses, schedules, stairs.

What is made of comparisons u >= c, constants and operations on these alone is constant between the
thresholds c. As a `Table` it has two surfaces at a time, where each comparison would have one, so
that a change costs what one costs. Not where another choice reads the value: it would be made by
a sum of which clocks have more digits, see `elapsed`.
"""

import numpy as np

from .right_hand_side import Expressions, needed_for, renamed
from .step import OF_TRUTH_VALUES, evaluate
from .tables import Table, is_table

MANY = 8  # thresholds from which on a table is made
_COMPARISONS = "olt", "ogt", "oge"


def with_stairs(values, results):
    """Return `Expressions` and results where values of many thresholds are tables."""
    operations = needed_for(values.operations, results)
    of = {}  # the numbers u and the thresholds of values that are constant between these
    for name, number, operands in operations:
        others = [a for a in operands if not isinstance(a, float)]
        if name in _COMPARISONS and len(others) == 1 and others[0] not in of:
            if others[0] not in values.fixed:
                of[number] = others[0], frozenset([_threshold(name, operands)])
        elif others and all(a in of for a in others) and len({of[a][0] for a in others}) == 1:
            thresholds = frozenset().union(*(of[a][1] for a in others))
            of[number] = of[others[0]][0], thresholds
    if not any(len(thresholds) >= MANY for _, thresholds in of.values()):
        return values, results
    is_truth = {number for name, number, _ in operations if name in OF_TRUTH_VALUES}
    read = [a for _, number, operands in operations if number not in of for a in operands]
    roots = {a for a in [*read, *results] if a in of and a not in is_truth}
    choices = [each for each in operations if each[1] not in of and _chooses(each[0])]
    others = needed_for(operations, [a for *_, operands in choices for a in operands])
    roots = {a for a in roots if len(of[a][1]) >= MANY} - {number for _, number, _ in others}
    given = values.count - len(values.operations)
    new, known = Expressions(given, [a for a in values.fixed if a < given]), {}
    known |= {a: a for a in range(given)}
    stairs = [each for each in operations if each[1] in of]
    for name, number, operands in operations:
        table = _table_of(stairs, number, *of[number]) if number in roots else None
        if table is not None:
            known[number] = new.emit(table, known[of[number][0]])
        else:
            known[number] = new.emit(name, *renamed(operands, known))
    new.take_written(values, known)
    return new, renamed(results, known)


def _chooses(name):
    return name in (*_COMPARISONS, "oeq", "max", "min", "fabs", "floor") or is_table(name)


def _threshold(name, operands):
    """Return the least number at which a comparison is not what it is for smaller ones."""
    is_first = isinstance(operands[0], float)
    constant = operands[0] if is_first else operands[1]
    changes_after = name in ("oge", "olt") if is_first else name == "ogt"
    return float(np.nextafter(constant, np.inf)) if changes_after else constant


def _table_of(operations, number, u, thresholds):
    """Return the table of a value that these operations compute, None if it is not finite."""
    knots = np.array(sorted(thresholds))
    values = {u: np.append(np.nextafter(knots[0], -np.inf), knots)}
    with np.errstate(all="ignore"):
        evaluate(needed_for(operations, [number]), values)
    heights = np.broadcast_to(values[number], len(knots) + 1).astype(float)
    if not (np.isfinite(heights).all() and np.isfinite(knots).all()):
        return None
    changes = heights[1:] != heights[:-1]
    kept = np.append(True, changes)
    return Table(knots[changes], heights[kept], np.zeros(kept.sum()), False)
