"""Floats of a body, a field or a step size as the decimals that were written: 0.1 as 1/10."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.field import QuadraticField
from ..bodies.field_of_terms import H_VALUES, MATRIX, VALUES
from .arithmetic import rational

_LONG = 2**20  # denominators of floats such as 0.1
_ODD = 1000  # factors of denominators of fractions of floats
_DIGITS = 12  # of decimals that sums and products of floats can be


def as_decimal(a: Any) -> Fraction:
    """Return the decimal of at most 15 digits that a float was written as, or its binary value.

    So 0.1 is 1/10, and 1/3 remains the binary number. A coefficient of a Hamiltonian may be a third
    of a float, for example: then the float is replaced.
    """
    binary = Fraction(a)
    q = binary.denominator
    odd = q // (q & -q)  # without its power of two: 1 for a float
    if odd > 1:
        return as_decimal(binary * odd) / odd if odd < _ODD else binary
    if q < _LONG:
        return binary
    text = f"{float(binary):.14e}"
    decimal = Fraction(text)
    digits = len(text.partition("e")[0].replace(".", "").lstrip("-").rstrip("0"))
    is_near = digits <= _DIGITS and abs(decimal - binary) <= abs(binary) / 2**50
    return decimal if is_near or float(decimal) == binary else binary


def in_decimals(body: Any) -> QuadraticField:
    """Return the field of a single body or field with its floats as decimals."""
    decimals = np.vectorize(as_decimal, "O")
    if not isinstance(body, QuadraticField):
        parts = {name: decimals(part) for name, part in body._parts.items()}
        return QuadraticField.of(body._of(parts))
    parts = dict(body._parts)
    for name in {H_VALUES, VALUES, *body.parameters} & {*parts}:
        parts[name] = decimals(parts[name])[()]
    if H_VALUES in parts:
        parts[MATRIX] = np.vstack([parts[MATRIX][:2], decimals(parts[MATRIX][2])])
    field: QuadraticField = body._with(parts)
    return field


def note_on_floats(body: Any, eps: Any) -> list[str]:
    """Return a note on the first number that looks like a decimal rounded to a float."""
    numbers = [rational("field", number) for number in [*_numbers_in(body), eps or 0]]
    # Positive ones first, because 0.1 * x * (1 - y) has the coefficient -0.1, which nobody wrote.
    for a in sorted(numbers, key=lambda number: number < 0):
        simple, q = a.limit_denominator(10**6), a.denominator
        is_binary = q & (q - 1) == 0  # a power of two
        if q > _LONG and is_binary and float(simple) == a:
            return [
                f"The float {float(a)!r} is taken exactly, as {a}: if {simple} is meant, write "
                f"Fraction({simple.numerator}, {simple.denominator}), or decimals=True for all."
            ]
    return []


def _numbers_in(body: Any) -> list[Any]:
    """Return the numbers of a body or field as they are written: parameters, then coefficients."""
    if not isinstance(body, QuadraticField):
        return [a for part in body._parts.values() for a in np.ravel(part)]
    if body.H is None:
        return [*body.parameters.values(), *body._exact.values]
    return [*body.parameters.values(), *body.H.exact.values, *body._parts[MATRIX][2]]
