"""Exact numbers, named parameters, and texts of polynomials."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from numbers import Rational
from typing import Any

import numpy as np

from ..checks import OF_SYMBOLS, common_shape, kind_of, real_array, refuse, short, spelled, wrong
from .names import check_parameter
from .tolerances import LARGEST_DECIMAL_EXPONENT, LONGEST_NUMBER


def exact(name: str, value: Any) -> Fraction:
    """Return a number of Python, NumPy or SymPy as a fraction, a float as its exact value."""
    is_ratio = isinstance(value, Rational)
    if isinstance(value, complex):
        how = "Field(f, names, c=1j) and Map have complex parameters, from their first values on; "
        how += "elsewhere pass real and imaginary parts"
        raise wrong(name, "real numbers", f"{value}: {how}", TypeError)
    if getattr(value, "is_number", False) and not is_ratio:  # a number of SymPy, such as sqrt(2)
        with suppress(TypeError):  # complex numbers raise it
            value = float(value)
    if isinstance(value, bool) or not (is_ratio or hasattr(value, "as_integer_ratio")):
        received = "None" if value is None else f"the {kind_of(value)} {short(value)}"
        received += f": {OF_SYMBOLS}" * hasattr(value, "free_symbols")
        raise wrong(name, "integers, fractions or floats", received, TypeError)
    try:
        if not is_ratio and value and float(value) in (0.0, math.inf, -math.inf):
            raise OverflowError  # a decimal such as 1e99999999
        ratio = (value.numerator, value.denominator) if is_ratio else value.as_integer_ratio()
        return Fraction(*map(int, ratio))
    except (OverflowError, ValueError):
        raise wrong(name, "finite, and in the range of float64", short(value)) from None


def as_given(name: str, value: Any) -> Any:
    """Return an array of numbers as they were given; lists become arrays of objects."""
    refuse(name, value)
    return value if isinstance(value, np.ndarray) else np.array(value, dtype=object)


def named_parameters(parameters: Mapping[str, Any], variables: Sequence[str]) -> dict[str, Any]:
    """Return parameters with checked names and values, as `numbers_by_name` does."""
    for name in parameters:
        check_parameter(name, variables)
    if isinstance(parameters.get("complex"), (bool, str)):
        how = "here write equations of real and imaginary parts"
        raise TypeError(f"complex: only Field(f, names, complex=...) and Map have it: {how}")
    return numbers_by_name(parameters)


def numbers_by_name(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return checked values by name: numbers as they were given, arrays as floats."""
    checked: dict[str, Any] = {}
    shapes = {}
    for name, value in parameters.items():
        if type(value) in (float, np.float64) and math.isfinite(value):  # for speed in small calls
            checked[name] = float(value)
            continue
        array = as_given(name, value)
        checked[name] = real_array(name, value) if array.ndim else array.item()
        if not array.ndim:
            exact(name, checked[name])
        shapes[name] = array.shape
    if shapes:
        common_shape(shapes)
    return checked


def plain(value: Any) -> float | str:
    """Return a number as an equal float, or as a string "p/q" if there is no such float."""
    number = exact("value", value) if value else 0  # for speed: most entries of tensors are 0
    return float(number) if float(number) == number else str(number)


def to_lists(value: Any) -> Any:
    """Return an array, or a dictionary of arrays, as lists of floats and strings "p/q"."""
    if isinstance(value, dict):
        return {name: to_lists(each) for name, each in value.items()}
    array = np.asarray(value)
    return array.tolist() if array.dtype.kind in "fi" else np.vectorize(plain, "O")(array).tolist()


def from_lists(name: str, value: Any) -> Any:
    """Return lists with fractions in place of the strings "p/q" that `to_lists` wrote."""
    if isinstance(value, dict):
        return {name: from_lists(name, each) for name, each in value.items()}
    if isinstance(value, list):
        return [from_lists(name, each) for each in value]
    try:
        return from_text(value) if isinstance(value, str) else value
    except ValueError:
        raise wrong(name, 'numbers or strings "p/q"', short(value)) from None


def from_text(text: str) -> Fraction:
    """Return the number in a text, such as 1/3, 0.1 or 1e6; raise ValueError if there is none."""
    if len(text) > LONGEST_NUMBER:
        raise ValueError(text)
    exponent = re.search(r"e([-+]?[\d_]+)", text, re.IGNORECASE)
    if exponent and abs(int(exponent[1])) > LARGEST_DECIMAL_EXPONENT:
        raise ValueError(text)
    try:
        return Fraction(text)
    except ZeroDivisionError as error:
        raise ValueError(text) from error


def text_of(terms: Mapping[tuple[int, ...], Any], names: Sequence[str]) -> str:
    """Return the text of a polynomial: {(0, 0, 1): 2} is "2*x1^2*x2" with the names x1 and x2."""
    text = ""
    for indices, c in sorted(terms.items(), key=lambda term: (-len(term[0]), term[0])):
        size = -c if c < 0 else c
        factors = [] if indices and size == 1 else [spelled(size)]
        for i in dict.fromkeys(indices):
            power = indices.count(i)
            factors.append(f"{names[i]}^{power}" if power > 1 else names[i])
        text += (" - " if c < 0 else " + ") + "*".join(factors)
    return ("" if text.startswith(" +") else "-") + text[3:] if text else "0"
