"""Proofs that functions are first integrals of equations, and tests of those without a proof.

A function I is a first integral if dI/dt = I' f is 0. Where I and f are quotients of polynomials in
variables, parameters and values of other functions, this may be proved; then it holds for all
values of parameters.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from ..checks import FloatArray
from ..core.expressions.derivative import gradients
from ..core.expressions.numpy_evaluation import results_at
from ..core.expressions.programs import Program, dot, in_order, program_of
from ..core.expressions.projection import change_along
from ..core.expressions.rounding import sizes_in
from ..core.expressions.tolerances import CHANGE_OF_INTEGRALS, ROUNDING_OF_CHANGES
from .equations import Equations
from .identities import is_zero


class Changes:
    """The changes dI/dt of those integrals of equations that are not proved to be constant.

    The energy of a system with constraints changes by the power of reactions, lambda . phi, which
    is 0 on the constraints.

    which   the numbers of these integrals
    """

    def __init__(self, equations: Equations) -> None:
        D, quantities = len(equations.names), equations.quantities
        multipliers = quantities.get("multipliers", [])
        phi = quantities.get("residuals", [])[: len(multipliers)]
        H = [equations.H] if equations.H is not None else []
        integrals, energy = (quantities.get(name, []) for name in ("conserved", "energy"))
        parts = [equations.results, integrals, H, energy, multipliers, phi]
        values, operands = in_order(equations.values, [a for part in parts for a in part])
        rest = iter(operands)
        rates, integrals, H, energy, multipliers, phi = ([next(rest) for _ in of] for of in parts)
        emit, self.which = values.emit, []
        power = dot(emit, zip(multipliers, phi, strict=True), 0.0)
        changes, terms = [], []
        for k, row in enumerate(gradients(values, [*values.operations], integrals, D)):
            change, moduli = change_along(emit, row, rates)
            is_energy = integrals[k] in H  # K is antisymmetric
            other = emit("fsub", change, power) if integrals[k] in energy else change
            if is_energy or is_zero(values.operations, other, equations.ratios):
                continue
            self.which.append(k)
            changes.append(change)
            terms.append(moduli)
        self._changes = program_of(values.operations, [*changes, *terms])
        size = sizes_in(values)
        self._sizes: Program = program_of(values.operations, [size(a).number for a in changes])

    def are_wrong(self, x: FloatArray, parameters: FloatArray) -> Any:
        """Return where integrals change, beyond rounding, (k, ...) at states x (D, ...)."""
        shape = np.broadcast_shapes(x.shape[1:], parameters.shape[1:])
        given = dict(enumerate([*x, *parameters]))
        found = abs(results_at(self._changes, given, shape))
        changes, terms = found[: len(self.which)], found[len(self.which) :]
        is_wrong = changes > CHANGE_OF_INTEGRALS * terms
        if is_wrong.any():
            is_wrong &= changes > ROUNDING_OF_CHANGES * results_at(self._sizes, given, shape)
        return is_wrong


_changes_of = lru_cache(64)(Changes)


def unproved(equations: Equations) -> tuple[int, ...]:
    """Return the numbers of those integrals that equations keep without a proof."""
    return (*_changes_of(equations).which,) if "conserved" in equations.sizes else ()


def changes_of(field: Any) -> Changes | None:
    """Return the `Changes` of integrals that a field keeps without a proof; None if it has none."""
    if "conserved" not in field._quantities:
        return None
    changes = _changes_of(field._equations)
    return changes if changes.which else None
