"""Random states, for choices among formulas, and for tests that refuse functions.

Values at states prove nothing; whether a formula is 0 is proved by `identities`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import FloatArray
from ..core.expressions.numpy_evaluation import evaluate
from .identities import is_zero
from .symbols import Symbol
from .tolerances import PART_OF_CANCELLED_SAMPLES, ROUNDING_OF_DIFFERENCE, SAMPLES_OF_DIFFERENCE

if TYPE_CHECKING:
    from .tracer import Tracer


def random_states(D: int, count: int, largest: float = 1.0) -> FloatArray:
    """Return random states (D, count) with sizes from 0.1 to about 10**largest."""
    states = np.random.default_rng(0).normal(size=(D, count))
    return states * 10.0 ** np.linspace(-1.0, largest, count)


class Samples:
    """The values of formulas at random states, with values of `parameters` or random ones."""

    def __init__(self, tracer: Tracer, parameters: Mapping[str, Any] | None = None) -> None:
        self._tracer, self._expressions, self._done = tracer, tracer.values, 0
        numbers = [*random_states(len(tracer.names), SAMPLES_OF_DIFFERENCE)]
        for k, value in enumerate((parameters or {}).values(), tracer.D):
            numbers[k] = numbers[k] * 0.0 + np.ravel(np.asarray(value, float))[0]
        self._values = dict(enumerate(numbers))

    def looks_zero(self, a: Any) -> bool:
        """Return True if a formula is 0, or a difference of equal terms at nearly all states."""
        if not isinstance(a, Symbol):
            return isinstance(a, float) and a == 0.0
        instruction, operands = self._expressions.of.get(a.operand, ("", ()))
        if instruction not in ("fadd", "fsub"):
            return False
        difference = abs(self.at(a.operand))
        with np.errstate(all="ignore"):
            terms = sum(abs(self.at(each)) for each in operands)
            is_small = (difference <= ROUNDING_OF_DIFFERENCE * terms)[np.isfinite(difference)]
        return bool(len(is_small) and is_small.mean() >= PART_OF_CANCELLED_SAMPLES)

    def is_zero(self, a: Any) -> bool:
        """Return True if a formula that `looks_zero` is proved to be 0."""
        if not isinstance(a, Symbol) or not self.looks_zero(a):
            return self.looks_zero(a)
        return is_zero(self._expressions.operations, a.operand, self._tracer.ratios)

    def changes_sign(self, a: Any) -> bool:
        """Return True if a formula is above 0 at some states, and below 0 at others."""
        values = self.at(a.operand if isinstance(a, Symbol) else a)
        return bool((values > 0.0).any() and (values < 0.0).any())

    def at(self, operand: Any) -> Any:
        """Return the values of an operand at all states; one value for a number."""
        if isinstance(operand, float):
            return np.array(operand)
        operations = self._expressions.operations
        with np.errstate(all="ignore"):
            evaluate(operations[self._done :], self._values)
        self._done = len(operations)
        return np.asarray(self._values[operand])

    def matrices(self, matrix: Any) -> FloatArray:
        """Return the values (n, ...) of an array of formulas at n states."""
        values = [self.at(self._tracer.number(a)) for a in matrix.ravel()]
        rows = [np.broadcast_to(a, SAMPLES_OF_DIFFERENCE) for a in values]
        shape = *matrix.shape, SAMPLES_OF_DIFFERENCE
        return np.moveaxis(np.reshape(rows, shape).astype(float), -1, 0)
