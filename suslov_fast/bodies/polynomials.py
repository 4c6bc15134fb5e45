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
from .numbers import check_parameters, exact, is_number, plain

# The indices of the variables of a monomial, ascending, and its coefficient.
Terms = Mapping[tuple[int, ...], Fraction]
_LIFT = (
    ": make it quadratic by a variable for a product, as y for x**2 with y' = 2 x x'; away from "
    "y = x**2 errors may grow, so watch abs(y - x**2), and reset y after each step where it grows"
)


class Polynomial:
    """A polynomial with exact coefficients, with which functions of the user calculate."""

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


def _check_call(name: str, f: Any, parameters: Mapping[str, Any]) -> None:
    """Raise TypeError unless f can be called as f(x, **parameters)."""
    try:
        known = inspect.signature(f).parameters
    except (TypeError, ValueError):  # no function, or one of another language
        return
    own = {each: known[each] for each in [*known][1:]}
    takes_any = any(each.kind is each.VAR_KEYWORD for each in own.values())
    for each, about in own.items():
        if about.default is about.empty and each not in parameters and "VAR" not in about.kind.name:
            received = f"none for {each}: {name} needs {each}: pass {each}=28, say"
            raise wrong(name, "values for all its parameters", received, TypeError)
    for each in parameters:
        if each not in own and not takes_any:
            expected = f"parameters that it has ({', '.join(own) or 'none but x'})"
            raise wrong(name, expected, each, TypeError)


def traced(
    name: str, f: Callable[..., Any], D: int, degree: int, parameters: Mapping[str, Any]
) -> Any:
    """Return the tensors of the D polynomials f(x, **parameters), or of the one of degree 3."""
    _check_call(name, f, parameters)
    count = f"{D} polynomials" if degree == 2 else "a polynomial"
    expected = f"a function that returns {count} of degree at most {degree} in x[0] to x[{D - 1}]"
    try:
        found = f(tuple(Polynomial({(i,): Fraction(1)}) for i in range(D)), **parameters)
        if degree == 3:
            return _tensor(found, D, degree)
        if not isinstance(found, (tuple, list, np.ndarray)) or len(found) != D:
            raise ValueError(short(found))
        return np.stack([_tensor(each, D, degree) for each in found])
    except (TypeError, AttributeError, ValueError, IndexError, ArithmeticError) as error:
        kind = TypeError if isinstance(error, (TypeError, AttributeError)) else ValueError
        of_numpy = re.search(r"callable (\w+) method", str(error))
        received = f"{of_numpy[1]} of x" if of_numpy else error
        raise wrong(
            name, f"{expected}, by +, -, * and divisions by numbers", received, kind
        ) from error


def _tensor(value: Any, D: int, degree: int) -> Any:
    """Return a polynomial as a symmetric tensor of fractions in homogeneous coordinates."""
    polynomial = Polynomial.of(value)
    if polynomial is None:
        raise TypeError(f"{short(value)} of type {type(value).__name__}")
    within("coefficients", np.array([*polynomial.terms.values()], dtype=object), OTHERS)
    table = np.full((D + 1,) * degree, Fraction(0))
    for powers, c in polynomial.terms.items():
        if len(powers) > degree:
            raise ValueError(f"degree {len(powers)}" + _LIFT * (degree == 2))
        places = {*permutations((*powers, *[D] * (degree - len(powers))))}
        for each in places:
            table[each] = c / len(places)
    return table


def family(
    parameters: Mapping[str, Any], tables: Callable[[Any], tuple[Any, ...]]
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """Return what `tables` makes of parameters, of floats if these are arrays, and them checked."""
    values = check_parameters(parameters)
    if not any(map(np.ndim, values.values())):
        return tables(values), values
    arrays = np.broadcast_arrays(*(np.asarray(each, np.float64) for each in values.values()))
    rows = zip(*(array.ravel().tolist() for array in arrays), strict=True)
    members = [tables(dict(zip(values, row, strict=True))) for row in rows]
    one = members or [tables(dict.fromkeys(values, 1.0))]  # shapes of an empty batch
    columns = (np.array(each, np.float64)[: len(members)] for each in zip(*one, strict=True))
    return tuple(each.reshape(*arrays[0].shape, *each.shape[1:]) for each in columns), values


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
        number = str(plain(size) if size.denominator > 2**20 else size)
        factors = [] if powers and size == 1 else [number]
        for i in dict.fromkeys(powers):
            power = powers.count(i)
            factors.append(f"x{i + 1}^{power}" if power > 1 else f"x{i + 1}")
        text += (" - " if c < 0 else " + ") + "*".join(factors)
    return ("" if text.startswith(" +") else "-") + text[3:] if text else "0"
