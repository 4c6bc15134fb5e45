"""Polynomials of functions of the user, traced with exact coefficients, and their text."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from itertools import permutations
from typing import Any

import numpy as np

from ..checks import OTHERS, short, within, wrong
from .numbers import exact, is_number, plain

# The indices of the variables of a monomial, ascending, and its coefficient.
Terms = Mapping[tuple[int, ...], Fraction]
# Kinds of parameters that stand for any number of arguments.
_WHATEVER = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
_LIFT = (
    ": make it quadratic by a variable for a product, as y for x**2 with y' = 2 x x'; away from "
    "y = x**2 errors may grow, so watch abs(y - x**2), and reset y after each step where it grows"
)


class Polynomial:
    """A polynomial with exact coefficients, with which functions of the user calculate."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, terms: Terms) -> None:
        self.terms = {powers: c for powers, c in terms.items() if c}

    @classmethod
    def of(cls, value: Any) -> Polynomial | None:
        """Return a polynomial, or a number as a polynomial; None for anything else."""
        if isinstance(value, cls):
            return value
        return cls({(): exact("f", value)}) if is_number(value) else None

    def __add__(self, other: Any) -> Any:
        if (right := self.of(other)) is None:
            return NotImplemented
        terms = dict(self.terms)
        for powers, c in right.terms.items():
            terms[powers] = terms.get(powers, 0) + c
        return Polynomial(terms)

    def __mul__(self, other: Any) -> Any:
        if (right := self.of(other)) is None:
            return NotImplemented
        terms: dict[tuple[int, ...], Fraction] = {}
        for first, a in self.terms.items():
            for second, b in right.terms.items():
                powers = tuple(sorted(first + second))
                terms[powers] = terms.get(powers, Fraction(0)) + a * b
        return Polynomial(terms)

    __radd__, __rmul__ = __add__, __mul__

    def __pos__(self) -> Polynomial:
        return self

    def __neg__(self) -> Any:
        return self * -1

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __truediv__(self, number: Any) -> Any:
        return self * (1 / exact("divisor", number)) if is_number(number) else NotImplemented

    def __pow__(self, power: Any) -> Polynomial:
        if power not in range(100):
            raise wrong("power", "a small integer", power)
        return math.prod([self] * int(power), start=Polynomial({(): Fraction(1)}))

    def __eq__(self, other: object) -> bool:
        raise TypeError("polynomials in x cannot be compared")

    def __bool__(self) -> bool:
        raise TypeError("polynomials in x are neither true nor false")

    def __repr__(self) -> str:
        return text_of(self.terms)


def check_call(name: str, f: Any, parameters: Mapping[str, Any]) -> None:
    """Raise an error that names the first parameter that f(x, **parameters) lacks, or has not."""
    if not callable(f):
        expected = "a function of x, the tuple of variables"
        raise wrong(name, expected, type(f).__name__, TypeError)
    try:
        known = [*inspect.signature(f).parameters.values()][1:]
    except (TypeError, ValueError):  # functions of other languages may have no signature
        return
    by_name = {each.name: each.default for each in known if each.kind not in _WHATEVER}
    for each, default in by_name.items():
        if default is inspect.Parameter.empty and each not in parameters:
            how = f"none for {each}: {name} needs {each}: pass {each}=28, say"
            raise wrong(name, "values for all its parameters", how, TypeError)
    others = [each for each in parameters if each not in by_name]
    if others and all(each.kind is not each.VAR_KEYWORD for each in known):
        has = f"parameters that it has ({', '.join(by_name) or 'none but x'})"
        raise wrong(name, has, ", ".join(others), TypeError)


def traced(
    name: str, f: Callable[..., Any], D: int, degree: int, parameters: Mapping[str, Any]
) -> Any:
    """Return f(x, **parameters) for polynomials x, with errors that say what f may do."""
    what = f"polynomials of degree at most {degree} in x[0] to x[{D - 1}]"
    expected = f"{what}, by +, -, * and divisions by numbers"
    try:
        return f(tuple(Polynomial({(i,): Fraction(1)}) for i in range(D)), **parameters)
    except (TypeError, AttributeError) as error:
        of_numpy = re.search(r"callable (\w+) method", str(error))
        which = f"{of_numpy[1]} of x" if of_numpy else error
        raise wrong(name, expected, f"another operation: {which}", TypeError) from error
    except (ValueError, IndexError, ArithmeticError) as error:
        raise wrong(name, expected, f"an error: {error}") from error


def tensor(name: str, value: Any, D: int, degree: int) -> Any:
    """Return a polynomial as a symmetric tensor of fractions in homogeneous coordinates."""
    polynomial = Polynomial.of(value)
    if polynomial is None:
        received = f"{short(value)} of type {type(value).__name__}"
        raise wrong(name, "polynomials in x, or numbers", received, TypeError)
    within(name, np.array([*polynomial.terms.values(), 0], dtype=object), OTHERS)
    table = np.full((D + 1,) * degree, Fraction(0))
    for powers, c in polynomial.terms.items():
        if len(powers) > degree:
            lift = _LIFT if degree == 2 else ""
            received = f"degree {len(powers)}{lift}"
            raise wrong(name, f"polynomials of degree at most {degree}", received)
        places = {*permutations((*powers, *[D] * (degree - len(powers))))}
        for each in places:
            table[each] = c / len(places)
    return table


def terms_of(table: Any) -> Terms:
    """Return the terms of a symmetric tensor in homogeneous coordinates."""
    D, terms = len(table) - 1, dict[tuple[int, ...], Any]()
    for place in zip(*(each.tolist() for each in np.nonzero(table)), strict=True):
        powers = tuple(sorted(i for i in place if i < D))
        terms[powers] = terms.get(powers, 0) + table[place]
    return terms


def text_of(terms: Terms) -> str:
    """Return a polynomial as text, the terms of highest degree first."""
    text = ""
    for powers, c in sorted(terms.items(), key=lambda term: (-len(term[0]), term[0])):
        size = abs(c)
        factors = [str(plain(size) if size.denominator > 2**20 else size)]
        if powers and size == 1:
            factors = []
        for i in dict.fromkeys(powers):
            power = powers.count(i)
            factors.append(f"x{i + 1}^{power}" if power > 1 else f"x{i + 1}")
        text += (" - " if c < 0 else " + ") + "*".join(factors)
    if not text:
        return "0"
    return text[3:] if text.startswith(" +") else f"-{text[3:]}"
