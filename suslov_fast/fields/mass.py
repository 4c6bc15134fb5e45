"""Mass matrices: x' of the equations M(x) x' = f(x) as formulas, by elimination in symbols."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import real_array, short, wrong
from .complex_symbols import parts_of_number
from .linear_equations import singular, solved, sum_of
from .samples import Samples
from .symbols import Symbol
from .tolerances import LEAST_CONDITION

if TYPE_CHECKING:
    from .tracer import Tracer
    from .user_function import UserFunction


def check_both(f: UserFunction, mass: Any, names: Any, parameters: Mapping[str, Any]) -> None:
    """Raise TypeError unless f takes the parameters, or those that a function M does not take."""
    of_mass = [] if mass is None else mass.takes
    of_f = [name for name in parameters if name in f.takes or name not in of_mass]
    f.check(names, {name: parameters[name] for name in of_f})
    if mass is not None:
        mass.check(names, {name: parameters[name] for name in of_mass})


def rates(tracer: Tracer, mass: Any, right: Sequence[Any]) -> list[Any]:
    """Return the operands of M^-1 f, for the operands `right` of f."""
    D, layout = len(right), tracer.layout
    if hasattr(mass, "formulas"):
        entries = mass.formulas(tracer)
    else:
        matrix = np.asarray(mass) if layout.has_pairs else real_array("mass", mass)
        if matrix.shape != (layout.n, layout.n) or matrix.dtype.kind not in "iufc":
            raise wrong("mass", f"have the shape ({layout.n}, {layout.n})", short(mass))
        entries = layout.blocks(matrix.ravel().tolist(), parts_of_number)
    rows = [entries[k : k + D] for k in range(0, D * D, D)]
    b = [_as_symbol(tracer, a) for a in right]
    if all(isinstance(a, float) for row in rows for a in row):
        x = [sum_of(zip(row, b, strict=True)) for row in _inverse(np.array(rows))]
    else:
        samples = Samples(tracer)
        x = solved([[_as_symbol(tracer, a) for a in row] for row in rows], b, samples)
    return [*map(tracer.result, x)]


def _as_symbol(tracer: Tracer, operand: Any) -> Any:
    return operand if isinstance(operand, float) else Symbol(tracer, operand)


def _inverse(matrix: Any) -> list[list[float]]:
    """Return the inverse of a matrix of numbers; raise an error if it is singular.

    The method is Gauss and Jordan's, row by row: last digits of LAPACK depend on the processor, and
    these numbers are part of f.
    """
    rows = abs(matrix).max(axis=1, keepdims=True)
    scaled = matrix / np.where(rows > 0, rows, 1.0)
    if np.linalg.cond(scaled) * LEAST_CONDITION > 1:
        raise singular()
    D = len(matrix)
    both = np.hstack([matrix, np.eye(D)])
    for k in range(D):
        pivot = k + int(abs(both[k:, k]).argmax())
        both[[k, pivot]] = both[[pivot, k]]
        both[k] /= both[k, k]
        others = np.arange(D) != k
        both[others] -= both[others, k, None] * both[k]
    return both[:, D:].tolist()
