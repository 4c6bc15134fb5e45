"""Polynomials as symbolic numbers: what a function of a `QuadraticField` is called with."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .polynomials import NoPolynomial, Polynomial
from .symbolic import Symbol, Symbols, Untraceable


class Exact:
    """The polynomials of a function that is called with symbolic numbers."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = names
        variables = (Polynomial({(i,): 1}) for i in range(len(names)))
        self.state = Symbols.of([Symbol(self, variable) for variable in variables])

    def is_truth(self, operand: Any) -> bool:
        return False

    def operand(self, value: Any) -> Any:
        """Return the polynomial of a symbolic number, or a number as it is."""
        if isinstance(value, Symbol):
            if value.tracer is not self:
                raise Untraceable("f keeps symbols of an earlier call: compute all from x")
            return value.operand
        return value

    number = operand

    def truth(self, value: Any) -> Any:
        raise self.asked(self.operand(value))

    def asked(self, operand: Any) -> Exception:
        """Return the error of a question whether a value is true."""
        return NoPolynomial(f"asks whether {self.text(operand)} is true")

    def applied(self, name: str, operands: Sequence[Any], *_: Any) -> Any:
        """Return the value of a function of operands."""
        if name == "power":
            base, power = operands
            if isinstance(power, Polynomial):
                raise NoPolynomial("has an expression of x in an exponent")
            return Symbol(self, Polynomial.of(base) ** power)
        rule = _RULES.get(name)
        if rule is None:
            raise NoPolynomial(f"calls {name} of an expression of x")
        return Symbol(self, rule(*map(Polynomial.of, operands)))

    def text(self, operand: Any) -> str:
        return str(operand.text(self.names))


_RULES: dict[str, Any] = {
    "positive": lambda a: a,
    "negative": lambda a: -a,
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a * b.inverse(),
}
