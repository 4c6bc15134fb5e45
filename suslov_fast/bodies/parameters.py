"""Parameters of a family of lifted fields: columns that know their text, and functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from .columns import Column, Refused, alone
from .definitions import Definitions, in_brackets
from .expressions import RULES, Expression
from .texts import COMPARISONS


class Parameter(NDArrayOperatorsMixin, Column):
    """A column of a family of lifted fields, which knows its text, and functions of columns."""

    def __init__(self, values: Any, definitions: Definitions, text: str) -> None:
        super().__init__(values, definitions.symbols)
        self._definitions, self._text = definitions, text

    def symbol(self, *, is_inverse: bool = False) -> int:
        if is_inverse not in self._indices:
            if is_inverse and not np.all(self.values):
                raise ZeroDivisionError(f"division by {self._text}, which is 0 for a member")
            definitions = self._definitions
            i = definitions.symbol(self.values, self._text, is_inverse)
            if (not is_inverse) in self._indices:
                definitions.pair(i, self._indices[not is_inverse])
            self._indices[is_inverse] = i
        return self._indices[is_inverse]

    def __array_ufunc__(self, operation: Any, method: str, *operands: Any, **options: Any) -> Any:
        if any(isinstance(a, np.ndarray) for a in operands):
            return operation(*(np.asarray(a, object) for a in operands))
        name = operation.__name__
        if any(isinstance(a, Expression) for a in operands):
            return NotImplemented
        if name not in RULES or method != "__call__":
            does = "compares" if name in COMPARISONS else f"calls {name} of"
            raise Refused(f"{does} the parameter {self._text}, which has an array of values")
        values: list[Any] = []
        texts = []
        for a in operands:
            if isinstance(a, Parameter):
                values.append(a.values)
                texts.append(in_brackets(a._text))
            else:
                values.append(float(a))
                texts.append(_text_of_number(a))
        return Parameter(_by_member(name, operation, values), self._definitions, _text(name, texts))

    def __array__(self, *_: Any, **__: Any) -> Any:
        return alone(self)  # so that arrays can hold it, such as a matrix of parameters

    def __bool__(self) -> bool:
        raise Refused(f"asks whether {self._text} is true, which has an array of values")


def _text_of_number(a: Any) -> str:
    """Return a number, or a fraction, as text that is an operand."""
    text = repr(float(a)) if isinstance(a, float) else str(a)
    return text if text.replace(".", "").isdigit() else f"({text})"


_SIGNS = {
    "add": " + ", "subtract": " - ", "multiply": "*", "divide": "/", "true_divide": "/",
    "power": "**", "float_power": "**",
}  # fmt: skip


def _text(name: str, texts: Sequence[str]) -> str:
    if name in _SIGNS:
        return _SIGNS[name].join(texts)
    if name in ("positive", "negative"):
        return ("-" if name == "negative" else "") + texts[0]
    return f"{name}({', '.join(texts)})"


def _by_member(name: str, operation: Any, values: Sequence[Any]) -> Any:
    """Return the values of an operation; powers and functions one by one, as for one member."""
    with np.errstate(all="ignore"):
        if name in ("add", "subtract", "multiply", "negative", "positive"):
            return operation(*values)
        if name in ("divide", "true_divide"):
            if not np.all(values[1]):
                raise ZeroDivisionError("division by zero")
            return operation(*values)
        columns = np.broadcast_arrays(*values)
        results = [
            float(operation(*row)) for row in zip(*(c.ravel() for c in columns), strict=True)
        ]
        return np.array(results, np.float64).reshape(columns[0].shape)
