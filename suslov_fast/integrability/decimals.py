"""Floats of a body, a field or a step size as the decimals that were written: 0.1 as 1/10."""

from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.fields.field import QuadraticField
from ..bodies.fields.field_of_terms import H_VALUES, MATRIX, VALUES

_LONG = 2**20  # denominators of floats such as 0.1
_ODD = 1000  # factors of denominators of fractions of floats


def as_decimal(a: Any) -> Fraction:
    """Return the decimal as which a float was written, or its binary value, as that of 1/3.

    It has 15 digits at most, or 12 if the float is only near to it, as a sum or product of floats.
    """
    binary = Fraction(a)
    q = binary.denominator
    odd = q // (q & -q)  # without its power of two: 1 for a float
    if 1 < odd < _ODD:  # a third of a float, for example, as in a Hamiltonian
        return as_decimal(binary * odd) / odd
    if odd > 1 or q < _LONG:
        return binary
    near, exact = (Fraction(f"{float(binary):.{digits}g}") for digits in (12, 15))
    if abs(near - binary) <= abs(binary) / 2**50:
        return near
    return exact if float(exact) == binary else binary


def in_decimals(body: Any) -> QuadraticField:
    """Return the field of a single body or field with its floats as decimals."""
    decimals, parts = np.vectorize(as_decimal, "O"), dict(body._parts)
    is_field = isinstance(body, QuadraticField)
    for name in {H_VALUES, VALUES, *body.parameters} & {*parts} if is_field else parts:
        parts[name] = decimals(parts[name])[()]
    if is_field and H_VALUES in parts:
        parts[MATRIX] = np.vstack([parts[MATRIX][:2], decimals(parts[MATRIX][2])])
    return body._with(parts) if is_field else QuadraticField.of(body._of(parts))
