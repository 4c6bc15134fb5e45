"""Newton's method with many digits, for equilibria at which f' is singular in doubles.

It tells weak links of a network, beside which other terms cancel, from a curve of equilibria.
"""

from __future__ import annotations

import math
from decimal import Decimal, DecimalException, localcontext
from typing import Any

import numpy as np

from ..bodies.fields.general import Field
from ..checks import FloatArray
from ..core.lists.step import OF_NUMBERS, OF_TRUTH_VALUES

_DIGITS, _STEP = 150, Decimal("1e-50")  # of decimals, and of differences beside x
_PIVOT = Decimal("1e-40")  # pivots for which f' is singular
_MOST, _LAST = 30, 1e-28  # steps of Newton's method, and the last one beside x
_CHANGED = 1e-6  # what other last digits of the numbers of f may change
_NOTHING = 1e-30  # beside units: components that are 0
_NAMES = "fadd fsub fmul fdiv sum fabs sqrt".split()
_OPERATIONS = OF_TRUTH_VALUES | {name: OF_NUMBERS[name] for name in _NAMES}
_OPERATIONS |= {"exp": Decimal.exp, "log": Decimal.ln, "pow": pow, "max": max, "min": min}
_OPERATIONS["select"] = lambda truth, a, b: a if truth else b


def by_decimals(field: Any, x: FloatArray, own: Any, units: FloatArray) -> Any:
    """Return the equilibrium of a single field to which Newton's method leads from a state.

    None where f' is singular, or not if the numbers of f are rounded otherwise, and where f has
    functions that decimals have not. `own` are the components that move, `units` their sizes.
    """
    if not isinstance(field, Field):
        field = Field.from_function(field, field.dimension)
    try:
        with localcontext(prec=_DIGITS):
            found, other = (_equilibrium(field, x, own, units, k) for k in (0, 1))
    except (DecimalException, KeyError):
        return None
    least = np.append(_NOTHING * units, 0.0)
    return found[:-1] if np.allclose(found, other, _CHANGED, least) else None


def _equilibrium(field: Field, x: Any, own: Any, units: FloatArray, other: int) -> FloatArray:
    """Return the equilibrium, and log det f' there, in its units.

    `other` is 1 for other last digits of the numbers of f, and other steps of differences.
    """
    f = field._equations.right_hand_side

    def given(a: Any) -> Any:
        exact = Decimal(float(a))
        if not other or a == float(np.float32(a)):  # as short numbers of stoichiometry are
            return exact
        return exact * (1 + Decimal(2**-52 * math.frexp(a)[0]))

    def results(operations: Any, numbers: Any, known: dict[int, Any]) -> Any:
        for name, number, operands in operations:
            of = (given(a) if isinstance(a, float) else known[a] for a in operands)
            known[number] = _OPERATIONS[name](*of)
        return np.array([given(a) if isinstance(a, float) else known[a] for a in numbers])

    parameters = dict(enumerate(map(given, field.parameters.values()), f.D))
    table = dict(zip(f.table, results(f.fixed, f.table, parameters), strict=True))
    x, least = (np.array([*map(Decimal, a.tolist())]) for a in (x, _NOTHING * units))
    places, h = np.flatnonzero(own), _STEP * (1 + other)
    for _ in range(_MOST):
        scale = abs(x) + least
        sides = [x, *(x + h * scale * (np.arange(f.D) == j) for j in places)]
        value, *beside = (
            results(f.f.operations, f.f.results, dict(enumerate(y)) | table)[own] for y in sides
        )
        slopes = np.array([(side - value) / h for side in beside]).T
        part, det = _solved(slopes, value)
        x[own] -= part * scale[own]
        if abs(part).max() < _LAST:
            return np.array([*x, det.ln()], float)
    raise DecimalException


def _solved(matrix: Any, right: Any) -> tuple[Any, Decimal]:
    """Return the solution of linear equations in decimals, and the size of the determinant."""
    sizes = abs(matrix).max(axis=1, keepdims=True)
    rows, det = np.column_stack([matrix, right]) / sizes, sizes.prod()
    for i in range(len(rows)):
        best = i + abs(rows[i:, i]).argmax()
        rows[[i, best]] = rows[[best, i]]
        det *= abs(rows[i, i])
        if abs(rows[i, i]) < _PIVOT:
            raise DecimalException
        rows[i, i:] /= rows[i, i]
        below = i + 1 + np.flatnonzero(rows[i + 1 :, i])
        rows[below, i:] -= rows[below, i, np.newaxis] * rows[i, i:]
    for i in reversed(range(len(rows))):
        rows[:i, -1] -= rows[:i, i] * rows[i, -1]
    return rows[:, -1], det
