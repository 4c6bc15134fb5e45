"""Coefficients of a field, from calls of the user's function f with polynomials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ...checks import OTHERS, within
from .calls import alone, called, check_same, components
from .polynomials import NoPolynomial, Number, Polynomial
from .symbolic import Symbol, Symbols, Untraceable
from .terms import Terms, collected

# The exact terms of a Hamiltonian, or of the components of a field, by their three indices.
_Places = dict[tuple[int, ...], Number]


class Exact:
    """The polynomials of a function that is called with symbolic numbers.

    `count` is that of operations of symbols.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self.names, self.count = names, 0
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
        self.count += 1
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


def terms_of_function(
    argument: str, f: Any, names: Sequence[str], parameters: Mapping[str, Any], degree: int
) -> tuple[Terms, int]:
    """Return the exact terms of a field f (degree 2) or of a Hamiltonian (degree 3), and `count`.

    For a family f is called for each member. `argument` is the public argument that holds f.
    """
    shape = np.broadcast_shapes(*map(np.shape, parameters.values()))
    tracer, rows, count = Exact(names), [], 0
    columns = [np.broadcast_to(np.asarray(a).astype(object), shape) for a in parameters.values()]
    for values in zip(*(column.ravel() for column in columns), strict=True) if columns else [()]:
        of_member = dict(zip(parameters, values, strict=True))
        rows.append(_member(argument, f, tracer, of_member, degree))
        if len(rows) == 1:
            count = tracer.count
            check_same(argument, _member(argument, f, tracer, of_member, degree), rows[0])
    places = [*dict.fromkeys(place for terms in rows for place in terms)]
    found: Any = np.empty((len(rows), len(places)), object)
    for row, terms in zip(found, rows, strict=True):
        row[:] = [Fraction(terms.get(place, 0)) for place in places]
    try:
        within("coefficients", found, OTHERS)
    except ValueError as error:
        raise ValueError(f"{argument}: {error}") from None
    indices = np.array(places, np.int64).reshape(-1, 3).T
    return collected(indices, found.reshape(*shape, len(places)), len(names), degree), count


def _member(
    argument: str, f: Any, tracer: Exact, parameters: Mapping[str, Any], degree: int
) -> _Places:
    """Return the exact terms of one member of a family, or of a single field or Hamiltonian."""
    result, D = called(argument, f, tracer.state, parameters), len(tracer.names)
    try:
        if degree == 3:
            return _terms_of(result, D, degree)
        rows = (_terms_of(part, D, degree, i) for i, part in enumerate(components(result, D)))
        return {place: c for row in rows for place, c in row.items()}
    except (TypeError, ValueError) as error:
        raise type(error)(f"{argument}: {error}") from None


def _terms_of(value: Any, D: int, most: int, *row: int) -> _Places:
    """Return the terms of a polynomial by their three indices: `row`, and those of factors."""
    value = alone(value)
    terms = Polynomial.of(value.operand if isinstance(value, Symbol) else value).terms
    if (degree := max(map(len, terms), default=0)) > most:
        raise ValueError(f"a formula has degree {degree}, above {most}: use Field, and flow")
    one = (D,) * most
    return {(*row, *indices, *one[len(indices) :]): c for indices, c in terms.items()}
