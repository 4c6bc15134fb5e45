"""Exact numbers and named parameters from users, and polynomials from their functions."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import product
from numbers import Rational
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from ..checks import OTHERS, common_shape, real_array, refuse, short, within, wrong
from .columns import Column
from .names import check_parameter, labels

_LARGEST_EXPONENT = 400  # of a decimal


def exact(name: str, value: Any) -> Fraction:
    """Return a number, of NumPy or SymPy too, as a fraction: a float as its binary value."""
    is_ratio = isinstance(value, Rational)
    if isinstance(value, bool) or not (is_ratio or hasattr(value, "as_integer_ratio")):
        received = f"{short(value)} of type {type(value).__name__}"
        raise wrong(name, "integers, fractions or floats", received, TypeError)
    try:
        if not is_ratio and value and float(value) in (0.0, math.inf, -math.inf):
            raise OverflowError  # a decimal such as 1e99999999, whose ratio would take minutes
        ratio = (value.numerator, value.denominator) if is_ratio else value.as_integer_ratio()
        return Fraction(*map(int, ratio))
    except (OverflowError, ValueError):
        raise wrong(name, "finite numbers", value) from None


def as_given(name: str, value: Any) -> Any:
    """Return an array of the numbers as they are: one of integers and floats is one of objects."""
    refuse(name, value)
    return value if isinstance(value, np.ndarray) else np.array(value, dtype=object)


def numbers(name: str, value: Any, is_batch: bool) -> Any:
    """Return floats of a batch, or fractions of a single field."""
    if is_batch:
        return real_array(name, value)
    return np.vectorize(partial(exact, name), "O")(as_given(name, value))


def coefficients(name: str, value: Any, is_batch: bool) -> Any:
    return within(name, numbers(name, value, is_batch), OTHERS)


def named(parameters: Mapping[str, Any], variables: Sequence[str]) -> dict[str, Any]:
    """Return parameters by name: numbers as they are, and arrays of floats."""
    found: dict[str, Any] = {}
    for name, value in parameters.items():
        check_parameter(name, variables)
        array = as_given(name, value)
        found[name] = real_array(name, value) if array.ndim else array.item()
        if not array.ndim:
            exact(name, found[name])
    common_shape({name: np.shape(value) for name, value in found.items()})
    return found


def plain(value: Any) -> float | str:
    """Return a number as a float if it is one, else as the string "p/q"."""
    number = exact("value", value) if value else 0  # most entries of tensors are 0
    return float(number) if float(number) == number else str(number)


def to_lists(value: Any) -> Any:
    """Return an array, or a dictionary of arrays, as lists of floats and strings "p/q"."""
    if isinstance(value, dict):
        return {name: to_lists(each) for name, each in value.items()}
    array = np.asarray(value)
    return array.tolist() if array.dtype.kind == "f" else np.vectorize(plain, "O")(array).tolist()


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
    """Return the number that a text is, as 1/3, 0.1 or 1e6; ValueError if it is none.

    Nor is one that no float comes near: the fraction of 1e99999999 would take minutes and memory.
    """
    exponent = re.search(r"e([-+]?[\d_]+)", text, re.IGNORECASE)
    if exponent and abs(int(exponent[1])) > _LARGEST_EXPONENT:
        raise ValueError(text)
    try:
        return Fraction(text)
    except ZeroDivisionError as error:
        raise ValueError(text) from error


class Polynomial(NDArrayOperatorsMixin):
    """A sum of terms with exact coefficients: the argument of functions of the user."""

    def __init__(self, terms: Iterable[tuple[Sequence[int], Fraction]]) -> None:
        found = defaultdict[tuple[int, ...], Fraction](Fraction)
        for indices, c in terms:  # indices of the variables of a monomial
            found[tuple(sorted(indices))] += c
        self.terms = {indices: c for indices, c in found.items() if c}

    @classmethod
    def of(cls, value: Any) -> Polynomial:
        """Return a polynomial unchanged; a number is a constant, a column a variable."""
        if isinstance(value, Column):
            return cls([((value.letter(),), Fraction(1))])
        return value if isinstance(value, cls) else cls([((), exact("coefficient", value))])

    def __array_ufunc__(self, operation: Any, method: str, *operands: Any, **options: Any) -> Any:
        has_array = any(isinstance(each, np.ndarray) for each in operands)
        if has_array or operation in (np.power, np.square):  # entry by entry
            return operation(*(np.array(each, object) for each in operands))
        if operation not in _ARITHMETIC:
            raise TypeError(f"the operation {operation.__name__}")
        return Polynomial(_ARITHMETIC[operation](*(self.of(each).terms for each in operands)))

    def __truediv__(self, number: Any) -> Any:
        if isinstance(number, Column):
            return self * Polynomial([((number.letter(is_inverse=True),), Fraction(1))])
        return self * (1 / exact("divisor", number))

    def __pow__(self, power: Any) -> Any:
        if power not in range(100):
            raise wrong("power", "a small integer", power)
        return math.prod([self] * int(power))

    def derivative(self, i: int) -> Polynomial:
        """Return the derivative with respect to the variable i."""
        return Polynomial(
            ((*m[:k], *m[k + 1 :]), c)
            for m, c in self.terms.items()
            for k, each in enumerate(m)
            if each == i
        )

    def __bool__(self) -> bool:
        raise TypeError("polynomials in x are neither true nor false")

    def __repr__(self) -> str:
        return self.text(labels(max((i for m in self.terms for i in m), default=0) + 1))

    def text(self, names: Sequence[str]) -> str:
        """Return the polynomial in variables with these names."""
        text = ""
        for indices, c in sorted(self.terms.items(), key=lambda term: (-len(term[0]), term[0])):
            size = abs(c)
            number = str(plain(size) if size.denominator > 2**20 else size)
            factors = [] if indices and size == 1 else [number]
            for i in dict.fromkeys(indices):
                power = indices.count(i)
                factors.append(f"{names[i]}^{power}" if power > 1 else names[i])
            text += (" - " if c < 0 else " + ") + "*".join(factors)
        return ("" if text.startswith(" +") else "-") + text[3:] if text else "0"


_ARITHMETIC: dict[Any, Callable[..., Iterable[Any]]] = {  # on terms {indices: coefficient}
    np.positive: dict.items,
    np.negative: lambda a: ((indices, -c) for indices, c in a.items()),
    np.add: lambda a, b: [*a.items(), *b.items()],
    np.subtract: lambda a, b: [*a.items(), *((j, -d) for j, d in b.items())],
    np.multiply: lambda a, b: ((i + j, a[i] * b[j]) for i, j in product(a, b)),
}


def polynomial_of(tensor: Any) -> Polynomial:
    """Return the polynomial of a symmetric tensor in homogeneous coordinates."""
    D, places = len(tensor) - 1, np.argwhere(tensor != 0).tolist()
    return Polynomial(([i for i in place if i < D], tensor[tuple(place)]) for place in places)
