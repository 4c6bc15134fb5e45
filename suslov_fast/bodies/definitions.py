"""Definitions of added variables, u = g(p), and of the symbols of parameters.

The variables have the indices 0, 1, ..., those of the state first; parameters of a family are
symbols with negative indices, as in `columns`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from ..checks import spelled
from .columns import Symbol
from .polynomials import Polynomial, plain

Key = tuple[str, frozenset[Any], frozenset[Any]]
NOTHING = Polynomial([])
ONE = Polynomial([((), Fraction(1))])
HALF = Fraction(1, 2)
# g(-p) = -g(p) or g(p), without rounding; sin(b - a) needs no variable beside sin(a - b).
_ODD, _EVEN = {"sin", "tan", "sinh", "tanh", "arctan", "cbrt"}, {"cos", "cosh"}


def brief(expression: str) -> str:
    """Return an expression for readers, whose numbers are those of `spelled`."""

    def shown(found: re.Match[str]) -> str:
        text = found[0]
        return spelled(Fraction(text if "/" in text else float(text)))

    return re.sub(r"(?<![\w.])\d+(/\d+|(\.\d+)?(e[-+]?\d+)?)", shown, expression)


def variable(i: int) -> Polynomial:
    """Return the variable, or the symbol, with an index."""
    return Polynomial([((i,), Fraction(1))])


def number(value: Any) -> Polynomial:
    """Return a constant."""
    return Polynomial([((), Fraction(value))])


def product(factors: Iterable[Polynomial], start: Polynomial = ONE) -> Polynomial:
    """Return a product of polynomials."""
    result: Polynomial = math.prod(factors, start=start)
    return result


def _key(polynomial: Polynomial) -> frozenset[Any]:
    return frozenset(polynomial.terms.items())


class Definition(NamedTuple):
    """An added variable u = g(p), or u = p**exponent.

    `function` is the name of g in NumPy, "inverse" for 1/p, "root" for p**(-1/2), or "power".
    """

    function: str
    argument: Polynomial
    exponent: Polynomial  # of "power", a number or a symbol; else 0

    @property
    def key(self) -> Key:
        return self.function, _key(self.argument), _key(self.exponent)


class Definitions:
    """The added variables of a right-hand side, and the symbols of its parameters."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names, self.D = tuple(names), len(names)
        self.list: list[Definition] = []
        self._places: dict[Key, int] = {}
        self.symbols: list[Symbol] = []
        self.texts: list[str] = []  # of the symbols
        self.inverse_of: dict[int, int] = {}  # symbols by those that stand for their inverses

    def added(
        self, function: str, argument: Polynomial, exponent: Polynomial = NOTHING
    ) -> Polynomial:
        """Return the variable with this definition, which is added if there is none.

        If there is the variable of the negative argument, return this variable or its negative.
        """
        definition = Definition(function, argument, exponent)
        if definition.key not in self._places:
            if function in _ODD | _EVEN:
                place = self._places.get(Definition(function, -argument, exponent).key)
                if place is not None:
                    return variable(place) if function in _EVEN else -variable(place)
            self._places[definition.key] = self.D + len(self.list)
            self.list.append(definition)
        return variable(self._places[definition.key])

    def definition(self, i: int) -> Definition | None:
        """Return the definition of variable i; None for a variable of the state or a symbol."""
        return self.list[i - self.D] if i >= self.D else None

    # ----------------------------------------------------------------------- quotients and powers
    def inverse(self, p: Polynomial) -> Polynomial:
        """Return 1 / p: inverses of its factors if it is a monomial, else an added variable."""
        if not p.terms:
            raise ZeroDivisionError("division by zero")
        if len(p.terms) == 1:
            ((indices, c),) = p.terms.items()
            return product((self._inverse_of(i) for i in indices), number(1 / c))
        for k, (function, argument, _) in enumerate(self.list):
            if function == "inverse" and argument.terms.keys() == p.terms.keys():
                first = next(iter(p.terms))
                ratio = argument.terms[first] / p.terms[first]
                if all(argument.terms[m] == ratio * c for m, c in p.terms.items()):
                    return product([number(ratio)], variable(self.D + k))
        return self.added("inverse", p)

    def _inverse_of(self, i: int) -> Polynomial:
        """Return the inverse of the variable or symbol i."""
        if i < 0:
            return variable(self._inverse_symbol(i))
        definition = self.definition(i)
        if definition is None:
            return self.added("inverse", variable(i))
        function, p, exponent = definition
        if function == "inverse":
            return p
        if function == "root":
            return product([p], variable(i))
        if function == "power":
            return self.power(p, -exponent)
        if function == "exp":
            return self.added("exp", -p)
        return self.added("inverse", variable(i))

    def _inverse_symbol(self, i: int) -> int:
        """Return the symbol that stands for the inverses of the values of symbol i."""
        if i not in self.inverse_of:
            values, is_inverse = self.symbols[-1 - i]
            if not np.all(values):
                raise ZeroDivisionError(f"division by {self.texts[-1 - i]}, which is 0")
            text = self.texts[-1 - i]
            self.pair(i, self.symbol(values, text, not is_inverse))
        return self.inverse_of[i]

    def symbol(self, values: Any, text: str, is_inverse: bool = False) -> int:
        """Return the index of the symbol for the values of parameters, or their inverses."""
        for k, each in enumerate(self.symbols):  # as often as f computes them
            if self.texts[k] == text and each.is_inverse == is_inverse:
                return -1 - k
        self.symbols.append(Symbol(values, is_inverse))
        self.texts.append(text)
        return -len(self.symbols)

    def pair(self, i: int, j: int) -> None:
        """Note that the symbols i and j are inverses of each other."""
        self.inverse_of[i], self.inverse_of[j] = j, i

    def power(self, p: Polynomial, exponent: Polynomial) -> Polynomial:
        """Return p**exponent, for a number or a symbol."""
        if exponent.terms.keys() <= {()}:
            r = exponent.terms.get((), Fraction(0))
            if r.denominator == 1 and abs(r) < 100:
                return product([p if r > 0 else self.inverse(p)] * abs(int(r)))
            if r.denominator == 2 and abs(r) < 100:
                root, n = self.added("root", p), int(r + HALF)
                factor, n = (p, n) if n > 0 else (root, int(-2 * r) - 1)
                return product([factor] * n, root)
        for k, (function, argument, other) in enumerate(self.list):
            # x**2.3 and x**1.3 need one variable.
            difference = exponent - other
            if function == "power" and argument.terms == p.terms and difference.terms:
                n = difference.terms.get((), Fraction(0))
                if difference.terms.keys() == {()} and n.denominator == 1 and abs(n) < 100:
                    return product([self.power(p, difference)], variable(self.D + k))
        return self.added("power", p, exponent)

    # -------------------------------------------------------------------------------------- texts
    def text(
        self, polynomial: Polynomial, named: Sequence[str] = (), *, exact: bool = False
    ) -> str:
        """Return a polynomial in the syntax of Python.

        Added variables have their names in `named`, the others their definitions. With `exact` the
        text, evaluated from left to right, is this polynomial: products and sums of symbols begin
        with a variable, because symbols alone are columns of floats, whose arithmetic rounds.
        """
        text, terms = "", sorted(polynomial.terms.items(), key=lambda t: (-len(t[0]), t[0]))
        if exact:
            terms.sort(key=lambda t: (max(t[0], default=-1) < 0, -len(t[0]), self._ranks(t[0])))
        for indices, c in terms:
            size = abs(c)
            value = str(plain(size) if size.denominator > 2**20 else size)
            factors, below = [] if indices and size == 1 else [value], ""
            if exact and indices and max(indices) < 0:
                is_one = len(indices) == size == 1 and not self.symbols[-1 - indices[0]].is_inverse
                if not (is_one and (text or (c > 0 and len(terms) == 1))):
                    factors.append(f"{self.names[0]}**0")
            distinct = [*dict.fromkeys(indices)]
            if exact:
                distinct.sort(key=lambda i: self._ranks([i]))
            for i in distinct:
                power, name = indices.count(i), self._name(i, named, exact)
                if i < 0 and self.symbols[-1 - i].is_inverse:
                    below += f"/{name}" * power
                elif i < 0 and exact:
                    factors += [name] * power
                else:
                    factors.append(f"{name}**{power}" if power > 1 else name)
            text += (" - " if c < 0 else " + ") + ("*".join(factors) or "1") + below
        return ("" if text.startswith(" +") else "-") + text[3:] if text else "0"

    def _ranks(self, indices: Sequence[int]) -> list[tuple[bool, int, str]]:
        """Return a key that depends on texts of symbols, not on the order in which f uses them."""
        return sorted((i < 0, max(i, 0), self.texts[-1 - i] if i < 0 else "") for i in indices)

    def _name(self, i: int, named: Sequence[str], exact: bool) -> str:
        if i < 0:
            return in_brackets(self.texts[-1 - i])
        if i < self.D:
            return self.names[i]
        if i - self.D < len(named) and named[i - self.D]:
            return named[i - self.D]
        text = self.text_of_definition(i, named, exact=exact)
        return text if _is_call(text) else f"({text})"

    def text_of_definition(self, i: int, named: Sequence[str] = (), *, exact: bool = False) -> str:
        """Return the definition of the added variable i as text."""
        function, p, exponent = self.list[i - self.D]
        argument = self.text(p, named, exact=exact)
        if function == "inverse":
            return f"1/{in_brackets(argument)}"
        if function == "root":
            return f"{in_brackets(argument)}**(-1/2)"
        if function == "power":
            power = self.text(exponent, exact=exact)
            power = power if power.isidentifier() else f"({power})"
            return f"{in_brackets(argument)}**{power}"
        return f"{function}({argument})"


def in_brackets(text: str) -> str:
    return text if text.isidentifier() or _is_call(text) else f"({text})"


def _is_call(text: str) -> bool:
    """Return whether a text is one call, such as exp(x + 1)."""
    name, bracket, rest = text.partition("(")
    if not (bracket and name.isidentifier() and rest.endswith(")")):
        return False
    depth = 1
    for k, letter in enumerate(rest):
        depth += (letter == "(") - (letter == ")")
        if depth == 0:
            return k == len(rest) - 1
    return False
