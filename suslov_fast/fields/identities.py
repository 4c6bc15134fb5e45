"""Exact identities: formulas as quotients of polynomials with rational coefficients.

The letters of polynomials are variables, parameters, and the values of other functions, such as
sin(x), of which only this is used: equal formulas have equal values. So what is proved here holds
for all values; what is not proved may hold all the same.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import Any

from ..core.expressions.programs import depending, needed_for
from .polynomial_dicts import Polynomial, constant, difference, product, total
from .tolerances import LARGEST_POWER, MOST_PRODUCTS_OF_TERMS

_FIRST_ROOT = 2**40  # the first letter for a square root
_ONE: Polynomial = {(): Fraction(1)}


class _TooLong(Exception):
    """The polynomials have too many terms."""


class _Quotients:
    """Formulas as quotients (N, D) of polynomials, in a limited time."""

    def __init__(self, operations: Sequence[Any], ratios: Mapping[float, Fraction]) -> None:
        self.operations, self.ratios, self.left = operations, ratios, MOST_PRODUCTS_OF_TERMS
        self.roots: dict[int, Polynomial] = {}  # {letter: its square}
        self.rules: dict[str, Any] = {
            "fadd": self._sum, "fsub": self._difference, "fmul": self._product,
            "fdiv": self._quotient, "pow": self._power, "sqrt": self._root,
        }  # fmt: skip

    def product(self, a: Polynomial, b: Polynomial) -> Polynomial:
        self.left -= len(a) * len(b)
        if self.left < 0:
            raise _TooLong
        return self._reduced(product(a, b))

    def _reduced(self, a: Polynomial) -> Polynomial:
        """Return a polynomial with the squares of roots in place of products of equal roots."""
        for root, square in self.roots.items():
            while twice := [m for m in a if m.count(root) > 1]:
                rest = {m: c for m, c in a.items() if m not in {*twice}}
                for m in twice:
                    k = m.index(root)
                    rest = total(rest, self.product({(*m[:k], *m[k + 2 :]): a[m]}, square))
                a = rest
        return a

    def of(self, operand: Any) -> tuple[Polynomial, Polynomial]:
        """Return the quotient of an operand; `_TooLong` if it takes too long."""
        known: dict[Any, Any] = {}

        def at(a: Any) -> Any:
            if isinstance(a, float):
                return constant(self.ratios.get(a) or Fraction(repr(a))), _ONE
            return known.get(a) or ({(a,): Fraction(1)}, _ONE)

        for name, number, of in needed_for(self.operations, [operand]):
            if name in self.rules and (found := self.rules[name](*map(at, of))):
                known[number] = found
        return at(operand)

    def _sum(self, a: Any, b: Any) -> Any:
        if a[1] == b[1]:
            return total(a[0], b[0]), a[1]
        return total(self.product(a[0], b[1]), self.product(b[0], a[1])), self.product(a[1], b[1])

    def _difference(self, a: Any, b: Any) -> Any:
        return self._sum(a, ({m: -c for m, c in b[0].items()}, b[1]))

    def _product(self, a: Any, b: Any) -> Any:
        return self.product(a[0], b[0]), self.product(a[1], b[1])

    def _quotient(self, a: Any, b: Any) -> Any:
        if b[0].keys() == {()} and b[1] == _ONE:
            return {m: c / b[0][()] for m, c in a[0].items()}, a[1]
        return (self.product(a[0], b[1]), self.product(a[1], b[0])) if b[0] else None

    def _power(self, a: Any, exponent: Any) -> Any:
        n = exponent[0].get((), Fraction(0)) if exponent[0].keys() <= {()} else Fraction(1, 2)
        if exponent[1] != _ONE or n.denominator > 2 or not 0 < abs(n) <= LARGEST_POWER:
            return None
        if n.denominator == 2 and (a := self._root(a)) is None:
            return None
        found = a
        for _ in range(abs(n.numerator) - 1):
            found = self._product(found, a)
        return found if n > 0 else self._quotient((_ONE, _ONE), found)

    def _root(self, a: Any) -> Any:
        if a[1] != _ONE or a[0].keys() <= {()}:
            return None
        known = (root for root, square in self.roots.items() if square == a[0])
        root = next(known, _FIRST_ROOT + len(self.roots))
        self.roots[root] = a[0]
        return {(root,): Fraction(1)}, _ONE


def is_zero(operations: Sequence[Any], operand: Any, ratios: Mapping[float, Fraction]) -> bool:
    """Return True if an operand is proved to be 0, whatever the inputs of the operations are."""
    try:
        return not _Quotients(operations, ratios).of(operand)[0]
    except (_TooLong, ValueError):  # ValueError: a constant is infinite
        return False


def is_independent(
    operations: Sequence[Any],
    operand: Any,
    ratios: Mapping[float, Fraction],
    inputs: Collection[int],
) -> bool:
    """Return True if an operand is proved not to depend on these inputs of the operations."""
    moving = depending(operations, inputs)
    if isinstance(operand, float) or operand not in moving:
        return True

    quotients = _Quotients(operations, ratios)

    def other(a: Polynomial) -> Polynomial:  # at other values of the inputs, and of all roots
        changed = moving | {*quotients.roots}
        return {tuple(sorted(-k - 1 if k in changed else k for k in m)): c for m, c in a.items()}

    try:
        N, D = quotients.of(operand)
        return not difference(quotients.product(N, other(D)), quotients.product(other(N), D))
    except (_TooLong, ValueError):
        return False
