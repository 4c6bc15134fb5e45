"""Maps of one's own, `Map`, as functions of exact numbers: their lists of operations."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

from ..checks import wrong
from ..fields.map import Map
from .arithmetic import as_written, constant
from .rational_functions import as_function

_RULES = {
    "fadd": operator.add, "fsub": operator.sub, "fmul": operator.mul, "fdiv": operator.truediv
}  # fmt: skip


def function_of(map: Map, decimals: bool) -> Callable[..., list[Any]]:
    """Return f of a single map for `traced`, with parameters that are letters by name.

    Floats are what was written, or with `decimals` False binary numbers.
    """
    if map.shape:
        raise wrong("map", "a single one", f"a family of shape {map.shape}: pass map[i]")
    equations, exactly = map._equations, as_written if decimals else Fraction

    def f(x: Sequence[Any], **letters: Any) -> list[Any]:
        values = dict(enumerate(x))
        for k, (name, a) in enumerate(map.parameters.items(), map.dimension):
            known = letters.get(name)
            values[k] = as_function(constant(name, a, decimals)) if known is None else known

        def value(a: Any) -> Any:
            if type(a) is not float:
                return values[a]
            return as_function(equations.ratios.get(a) or exactly(a))

        for name, place, operands in equations.values.operations:
            if name not in _RULES:
                raise TypeError(f"{equations.shown(place)} is no quotient of polynomials")
            values[place] = _RULES[name](*(value(a) for a in operands))
        return [value(a) for a in equations.results]

    return f
