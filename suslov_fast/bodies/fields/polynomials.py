"""Exact numbers, named parameters, and the polynomials with which functions of users are called."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from functools import partial
from itertools import product
from numbers import Rational
from typing import Any

import numpy as np

from ...checks import (
    OF_SYMBOLS,
    OTHERS,
    common_shape,
    kind_of,
    real_array,
    refuse,
    short,
    spelled,
    within,
    wrong,
)
from .names import check_parameter, labels
from .symbolic import Untraceable

# Of a text "p/q" in a file, in characters; and of the exponent of 10 in a decimal.
_LONGEST_NUMBER, _LARGEST_EXPONENT = 10_000, 400


def exact(name: str, value: Any) -> Fraction:
    """Return a number of Python, NumPy or SymPy as a fraction; a float is exact as it is."""
    is_ratio = isinstance(value, Rational)
    if isinstance(value, complex):
        how = "split complex variables into real and imaginary parts"
        raise wrong(name, "real numbers", f"{value}: {how}", TypeError)
    if getattr(value, "is_number", False) and not is_ratio:  # of SymPy, as sqrt(2)
        with suppress(TypeError):  # of a complex one
            value = float(value)
    if isinstance(value, bool) or not (is_ratio or hasattr(value, "as_integer_ratio")):
        received = "None" if value is None else f"the {kind_of(value)} {short(value)}"
        if isinstance(value, str) and re.fullmatch(r"-?\d+(/\d+)?", value):
            received += f": pass fractions.Fraction({value!r})"
        if callable(value):
            received += ": what changes in time is a formula in f, with a variable t of the rate 1"
        if hasattr(value, "_mpf_"):
            received += ": pass fractions.Fraction(str(value))"
        if isinstance(value, dict):
            how = f"**{name}, and let f take {', '.join(map(str, value))}"
            received += f": pass {f'{name}={value[name]}' if name in value else how}"
        received += f": {OF_SYMBOLS}" * hasattr(value, "free_symbols")
        raise wrong(name, "integers, fractions or floats", received, TypeError)
    try:
        if not is_ratio and value and float(value) in (0.0, math.inf, -math.inf):
            raise OverflowError  # a decimal such as 1e99999999, whose ratio would take minutes
        ratio = (value.numerator, value.denominator) if is_ratio else value.as_integer_ratio()
        return Fraction(*map(int, ratio))
    except (OverflowError, ValueError):
        raise wrong(name, "finite, and in the range of float64", short(value)) from None


def as_given(name: str, value: Any) -> Any:
    """Return an array that keeps every number as it is; lists become arrays of objects."""
    refuse(name, value)
    return value if isinstance(value, np.ndarray) else np.array(value, dtype=object)


def numbers(name: str, value: Any, is_batch: bool) -> Any:
    """Return an array of floats for a batch, of fractions for a single field."""
    if is_batch:
        return real_array(name, value)
    return np.vectorize(partial(exact, name), "O")(as_given(name, value))


def coefficients(name: str, value: Any, is_batch: bool) -> Any:
    """Return `numbers` that are in the range of coefficients."""
    return within(name, numbers(name, value, is_batch), OTHERS)


def named_parameters(
    parameters: Mapping[str, Any], variables: Sequence[str], *, has_map: bool = True
) -> dict[str, Any]:
    """Return checked parameters by name: numbers as they are, arrays as floats.

    `has_map` is as in `names.variables`.
    """
    checked: dict[str, Any] = {}
    for name, value in parameters.items():
        check_parameter(name, variables, has_map=has_map)
        array = as_given(name, value)
        checked[name] = real_array(name, value) if array.ndim else array.item()
        if not array.ndim:
            exact(name, checked[name])
    common_shape({name: np.shape(value) for name, value in checked.items()})
    return checked


def plain(value: Any) -> float | str:
    """Return a number as a float if one equals it, else as the string "p/q"."""
    number = exact("value", value) if value else 0  # most entries of tensors are 0
    return float(number) if float(number) == number else str(number)


def to_lists(value: Any) -> Any:
    """Return an array, or a dictionary of arrays, as lists of floats and strings "p/q"."""
    if isinstance(value, dict):
        return {name: to_lists(each) for name, each in value.items()}
    array = np.asarray(value)
    return array.tolist() if array.dtype.kind in "fi" else np.vectorize(plain, "O")(array).tolist()


def from_lists(name: str, value: Any) -> Any:
    """Return lists from `to_lists` with fractions in place of their strings "p/q"."""
    if isinstance(value, dict):
        return {name: from_lists(name, each) for name, each in value.items()}
    if isinstance(value, list):
        return [from_lists(name, each) for each in value]
    try:
        return from_text(value) if isinstance(value, str) else value
    except ValueError:
        raise wrong(name, 'numbers or strings "p/q"', short(value)) from None


def from_text(text: str) -> Fraction:
    """Return the number in a text, such as 1/3, 0.1 or 1e6; ValueError if there is none.

    Exponents above 400 are refused, because the fraction of 1e99999999 would take minutes.
    """
    if len(text) > _LONGEST_NUMBER:
        raise ValueError(text)
    exponent = re.search(r"e([-+]?[\d_]+)", text, re.IGNORECASE)
    if exponent and abs(int(exponent[1])) > _LARGEST_EXPONENT:
        raise ValueError(text)
    try:
        return Fraction(text)
    except ZeroDivisionError as error:
        raise ValueError(text) from error


class NoPolynomial(Untraceable):
    """An operation on a polynomial whose result is not a polynomial."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what}: QuadraticField takes polynomials; use Field, and flow")


Number = int | Fraction  # integers stay such, because fractions take ten times as long


def number(value: Any) -> Number:
    """Return a coefficient that an expression contains; raise unless it is a real number."""
    if type(value) is int or type(value) is Fraction:
        return value
    if type(value) is float and math.isfinite(value):
        return int(value) if value.is_integer() else Fraction(value)
    return exact("coefficients", value)


class Polynomial:
    """A polynomial with exact coefficients, none of which is 0."""

    __slots__ = ("terms",)

    def __init__(self, terms: dict[tuple[int, ...], Number]) -> None:
        self.terms = terms  # by sorted indices: (0, 0, 1) stands for x1 x1 x2

    @classmethod
    def of(cls, value: Any) -> Polynomial:
        """Return a polynomial unchanged; a number is a constant."""
        if type(value) is cls:
            return value
        constant = number(value)
        return cls({(): constant} if constant else {})

    def __add__(self, other: Any) -> Polynomial:
        """Return the sum; adding few terms to many takes hardly longer than a copy."""
        few, sums = self.terms, Polynomial.of(other).terms
        if len(few) > len(sums):
            few, sums = sums, few
        sums = sums.copy()
        for indices, c in few.items():
            total = sums.get(indices, 0) + c
            if total:
                sums[indices] = total
            else:
                del sums[indices]
        return Polynomial(sums)

    def __sub__(self, other: Any) -> Polynomial:
        return self + -Polynomial.of(other)

    def __neg__(self) -> Polynomial:
        return Polynomial({indices: -c for indices, c in self.terms.items()})

    def __mul__(self, other: Any) -> Polynomial:
        few, many = self.terms, Polynomial.of(other).terms
        if len(few) > len(many):
            few, many = many, few
        if len(few) == 1:  # for speed: no two products are alike
            ((i, c),) = few.items()
            if not i:
                return Polynomial({j: c * d for j, d in many.items()})
            return Polynomial({tuple(sorted(i + j)): c * d for j, d in many.items()})
        sums = defaultdict[tuple[int, ...], Number](int)
        for (i, c), (j, d) in product(few.items(), many.items()):
            sums[tuple(sorted(i + j))] += c * d
        return Polynomial({indices: c for indices, c in sums.items() if c})

    __radd__, __rmul__ = __add__, __mul__

    def inverse(self) -> Polynomial:
        """Return the inverse of a constant; raise if it is 0, or if this is not a constant."""
        if not self.terms:
            raise ZeroDivisionError("division by zero")
        if self.terms.keys() == {()}:
            return Polynomial({(): 1 / Fraction(self.terms[()])})
        raise NoPolynomial("divides by an expression of x")

    def __pow__(self, power: Any) -> Polynomial:
        if isinstance(power, int) and power < 0:
            return self.inverse() ** -power
        if power not in range(100):
            raise ValueError(f"raises an expression of x to the power {short(power)}")
        return math.prod([self] * int(power), start=Polynomial({(): 1}))

    def __repr__(self) -> str:
        return self.text(labels(max((i for m in self.terms for i in m), default=0) + 1))

    def text(self, names: Sequence[str]) -> str:
        """Return the polynomial as text in variables with these names."""
        text = ""
        for indices, c in sorted(self.terms.items(), key=lambda term: (-len(term[0]), term[0])):
            size = -c if c < 0 else c
            factors = [] if indices and size == 1 else [spelled(size)]
            for i in dict.fromkeys(indices):
                power = indices.count(i)
                factors.append(f"{names[i]}^{power}" if power > 1 else names[i])
            text += (" - " if c < 0 else " + ") + "*".join(factors)
        return ("" if text.startswith(" +") else "-") + text[3:] if text else "0"
