"""Complex symbolic numbers, and functions of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .complex_rules import RULES, TO_REAL
from .symbols import NotReal, Symbol, Untraceable, applied, is_complex


class Complex(Symbol):
    """A complex symbolic number: its parts are real symbols, or a symbol and a number."""

    __slots__ = ("imag", "real")
    is_complex = True

    def __init__(self, tracer: Any, real: Any, imag: Any) -> None:
        self.tracer, self.real, self.imag = tracer, _number(real), _number(imag)

    @classmethod
    def of(cls, real: Symbol, imag: Symbol) -> Complex:
        return cls(real.tracer, real, imag)

    @property
    def operand(self) -> Any:
        how = "take z.real, z.imag or abs(z), or name the variable: Field(f, names, complex=...)"
        parameters, layout = self.tracer.parameters, self.tracer.layout
        if not layout.has_pairs and (own := [a for a in parameters if is_complex(parameters[a])]):
            how = f"the parameter {own[0]} is complex, so name the variables that are, too: "
            how += "Field(f, names, complex=...)"
        raise NotReal(f"{self} is complex, where a real number is wanted: {how}")

    def conjugate(self) -> Any:
        return applied("conjugate", self)

    conj = conjugate

    def __repr__(self) -> str:
        return f"({self.real} + i*({self.imag}))"


def _number(a: Any) -> Any:
    """Return the number if a symbol is a constant."""
    return a.operand if isinstance(a, Symbol) and isinstance(a.operand, float) else a


def parts_of_number(value: Any) -> tuple[Any, Any]:
    """Return the real and the imaginary part of a number or symbol."""
    if is_complex(value):
        return value.real, value.imag
    return value, 0.0


def of_complex(tracer: Any, name: str, values: Sequence[Any]) -> Any:
    """Return the value of a function of numbers, of which some are complex and some symbolic."""
    if name == "where":
        condition, *rest = values
        parts = zip(*map(parts_of_number, rest), strict=True)
        return Complex(tracer, *(applied(name, condition, *each) for each in parts))
    given = [part for value in values for part in map(_number, parts_of_number(value))]
    if name in TO_REAL:
        found = TO_REAL[name](*given)
        if name == "absolute" and isinstance(found, Symbol):
            tracer.squares[found.operand] = TO_REAL["square of absolute"](*given).operand
        return found
    if name not in RULES:
        how = f"take z.real, z.imag or abs(z), or write {', '.join(RULES)}"
        raise Untraceable(f"{name} of a complex number: {how}")
    return Complex(tracer, *RULES[name](*given))
