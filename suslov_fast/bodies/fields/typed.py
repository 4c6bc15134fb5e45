"""f of a quadratic field as it was typed: the list of its motions where that is the shorter one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...checks import FloatArray
from ...core.lists.right_hand_side import needed_for
from ...core.lists.step import evaluate
from .calls import operands_of_call
from .field_of_terms import NAMES
from .general import EQUATIONS, Equations, Field, of_hamiltonian
from .symbolic import Tracer
from .terms import sums_at

# The time of operations; an f of others, and of choices, is taken by its terms.
_TIMES = {"fadd": 1.0, "fsub": 1.0, "fmul": 1.0, "fdiv": 16.0}
_ROUNDING = 2.0**-40  # of f at a state where nothing cancels, beside the moduli of its terms


class Typed:
    """f as it was typed, of a field, its members and copies; traced when a motion asks for it.

    `count` is that of its operations with repetitions, which says when to trace f. `trace` returns
    the `Equations`. There are none if f is no list, because it counts by a parameter, for example.
    """

    def __init__(self, count: int, trace: Callable[[], Any]) -> None:
        self.count, self._trace = count, trace

    @classmethod
    def read(cls, typed: Any, names: Sequence[str], parameters: Any) -> Typed:
        """Return what `QuadraticField.to_dict` has written."""
        checks.instance("typed", typed, Mapping)
        count = checks.integer("operations", typed.get("operations"), 0)
        texts = typed.get("equations"), typed.get("definitions")
        field = Field.read(names, *texts, parameters=parameters)
        return cls(count, lambda: field._equations)

    @cached_property
    def equations(self) -> Any:
        try:
            return self._trace()
        except Exception:  # whatever the user's function raises that took polynomials
            return None

    def __reduce__(self) -> Any:
        return _of_equations, (self.count, self.equations)

    def field(self, parameters: Mapping[str, Any]) -> Field:
        """Return the field with these equations, and checked values of all parameters."""
        return Field._of({**parameters, NAMES: self.equations.names, EQUATIONS: self.equations})

    def is_shorter(
        self,
        indices: NDArray[np.int64],
        values: FloatArray,
        parameters: Sequence[FloatArray],
        D: int,
    ) -> NDArray[np.bool_]:
        """Return for which members (K,) f has fewer operations as typed than by its terms.

        `values` (K, T) are those of terms, and `parameters` (K,) those of the function. Nothing but
        the member decides, so it has the same bits in every family.
        """
        operations = _operations(indices, values, D)
        found: NDArray[np.bool_] = self.count <= operations
        if not found.any() or (equations := self.equations) is None:
            return found & False
        list_, results = equations.values, equations.results
        used = [a for a in needed_for(list_.operations, results) if a[1] not in list_.fixed]
        found &= sum(_TIMES.get(a[0], np.inf) for a in used) < operations
        x = 1.0 + 0.6180339887498949 * np.arange(1, D + 2) % 1.0
        x[D] = 1.0
        known = dict(enumerate([*x[:D], *parameters]))
        with np.errstate(all="ignore"):
            evaluate(list_.operations, known)
        f = np.zeros((D, len(values)))
        for i, a in enumerate(results):
            f[i] = a if isinstance(a, float) else known[a]
        terms = values * x[indices[1]] * x[indices[2]]
        error, size = f.T - sums_at(indices[0], terms, D), sums_at(indices[0], abs(terms), D)
        # A constant rate is a clock, which other steps are taken for.
        moves = sums_at(indices[0], (values != 0.0) * (indices[1] < D), D) > 0.0
        varies = np.array([not isinstance(a, float) and a not in list_.fixed for a in results])
        # Another f than at first, such as one of a variable that the user has changed since.
        is_same = (abs(error) <= _ROUNDING * size) & (moves | ~varies)
        found &= is_same.all(axis=1)
        return found


def equations_of(
    argument: str, f: Any, names: Sequence[str], parameters: Sequence[str], K: Any = None
) -> Equations:
    """Return the equations of a function f, or of K grad H, as it was typed."""
    tracer = Tracer(names, parameters)
    results = operands_of_call(argument, f, tracer)
    if argument == "f":
        return Equations(names, parameters, tracer.values, results)
    found = of_hamiltonian(tracer, names, parameters, results[0], K)
    return Equations(names, parameters, found.values, found.results)


def _of_equations(count: int, equations: Any) -> Typed:
    return Typed(count, lambda: equations)


def _operations(indices: NDArray[np.int64], values: FloatArray, D: int) -> NDArray[np.int64]:
    """Return how many operations (K,) the lists of terms (3, T) with values (K, T) have."""
    i, j, k = indices
    exists, is_product = values != 0.0, k < D
    scaled = exists & (abs(values) != 1.0) & (j < D)
    products = _different((j * D + k)[is_product], exists[:, is_product])
    sums = exists.sum(axis=1) - _different(i, exists)
    return sums + scaled.sum(axis=1) + products


def _different(keys: NDArray[np.int64], exists: NDArray[np.bool_]) -> Any:
    """Return how many keys (T,) are those of values (K, T) that exist."""
    order = np.argsort(keys, kind="stable")
    first = np.flatnonzero(np.diff(keys[order], prepend=-1))
    return np.logical_or.reduceat(exists[:, order], first, axis=1).sum(axis=1) if len(first) else 0
