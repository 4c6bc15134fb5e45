"""Symbolic numbers with exact coefficients: what a function of a `QuadraticField` is called with.

The value of a symbolic number is a polynomial, or a column: the values of a parameter for all
members of a family.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from .columns import Column, ColumnSymbol
from .polynomials import NoPolynomial, Polynomial, exact
from .symbolic import Symbol, Symbols, Untraceable


class Exact:
    """The polynomials of a function that is called with symbolic numbers."""

    def __init__(self, names: Sequence[str], parameters: Mapping[str, Any]) -> None:
        self.names = names
        self.columns: list[ColumnSymbol] = []  # that stand in polynomials
        variables = (Polynomial([((i,), Fraction(1))]) for i in range(len(names)))
        self.state = Symbols.of([Symbol(self, variable) for variable in variables])
        self.parameters = {
            name: Symbol(self, Column(a, self.columns)) if getattr(a, "ndim", 0) else a
            for name, a in parameters.items()
        }

    def is_truth(self, operand: Any) -> bool:
        return False

    def operand(self, value: Any) -> Any:
        """Return the polynomial or column of a symbolic number, or a number as it is."""
        if isinstance(value, Symbol):
            if value.tracer is not self:
                raise Untraceable("f keeps symbols of an earlier call: compute all from x")
            return value.operand
        exact("coefficients", value)  # raises unless it is a real number
        return value

    number = operand

    def truth(self, value: Any) -> Any:
        raise self.asked(self.operand(value))

    def asked(self, operand: Any) -> Exception:
        """Return the error of a question whether a value is true."""
        return NoPolynomial(f"asks whether {self.text(operand)} is true")

    def applied(self, name: str, operands: Sequence[Any], *_: Any) -> Any:
        """Return the value of a function of operands."""
        if not any(isinstance(a, Polynomial) for a in operands):
            return Symbol(self, Column.applied(name, operands))
        if name == "power":
            base, power = operands
            if isinstance(power, (Polynomial, Column)):
                raise NoPolynomial("has an expression of x in an exponent")
            return Symbol(self, self.polynomial(base) ** power)
        if name == "divide" and isinstance(operands[1], Column):
            inverse = operands[1].symbol(is_inverse=True)
            operands, name = (operands[0], Polynomial([((inverse,), Fraction(1))])), "multiply"
        polynomials = [*map(self.polynomial, operands)]
        rule = _RULES.get(name)
        if rule is None:
            raise NoPolynomial(f"calls {name} of an expression of x")
        return Symbol(self, rule(*polynomials))

    def polynomial(self, operand: Any) -> Polynomial:
        return Polynomial.of(operand)

    def text(self, operand: Any) -> str:
        return operand.text(self.names) if isinstance(operand, Polynomial) else "a parameter"


_RULES: dict[str, Any] = {
    "positive": lambda a: a,
    "negative": lambda a: -a,
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a * b.inverse(),
}
