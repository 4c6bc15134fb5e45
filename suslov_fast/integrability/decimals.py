"""Floats taken as the decimals that are written, 0.1 as 1/10."""

from __future__ import annotations

import math
from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.field import QuadraticField
from ..bodies.polynomials import terms_of

_LONG = 2**20  # denominators of floats such as 0.1
_ODD = 1000  # factors of denominators of fractions of floats
_DIGITS = 12  # of decimals that sums and products of floats can be


def decimal(a: Any) -> Fraction:
    """Return the decimal of at most 15 digits that a float was written as, or its binary value.

    So 0.1 is 1/10, and 1/3 remains the binary number. Of the thirds of floats, say, that
    coefficients of a Hamiltonian are, the float is replaced.
    """
    binary = Fraction(a)
    odd = binary.denominator // (binary.denominator & -binary.denominator)
    if odd > 1:
        return decimal(binary * odd) / odd if odd < _ODD else binary
    if binary.denominator < _LONG:
        return binary
    text = f"{float(binary):.14e}"
    simple = Fraction(text)
    digits = len(text.partition("e")[0].replace(".", "").lstrip("-").rstrip("0"))
    near = digits <= _DIGITS and abs(simple - binary) <= abs(binary) / 2**50
    return simple if near or float(simple) == binary else binary


def field_of(body: Any, decimals: bool) -> QuadraticField:
    """Return the field of a body or field, its floats as decimals if told so."""
    if not decimals:
        return QuadraticField.of(body)
    if not isinstance(body, QuadraticField):
        QuadraticField.of(body)  # checks the type
        field: QuadraticField = body.field() if body.shape else body._field_of(decimal)
        return field
    if body.shape:
        return body
    if body.H is None:
        arrays = (body.quadratic, body.linear, body.constant)
        return QuadraticField(*(np.vectorize(decimal, "O")(a) for a in arrays))
    terms = {powers: decimal(c) for powers, c in terms_of(body.H.tensor).items()}

    def H(x: Any) -> Any:
        return sum(math.prod((x[i] for i in powers), start=c) for powers, c in terms.items())

    return QuadraticField.from_hamiltonian(H, body.dimension, np.vectorize(decimal, "O")(body.K))


def note_on_floats(values: Iterable[Any]) -> list[str]:
    """Return a note if numbers in nested lists look like decimals that are taken as floats."""
    for c in values:
        if isinstance(c, list):
            if note := note_on_floats(c):
                return note
        elif isinstance(c, float | Fraction):
            simple, q = Fraction(c).limit_denominator(10**6), Fraction(c).denominator
            if q > _LONG and q & (q - 1) == 0 and float(simple) == c:
                return [
                    f"The float {float(c)!r} is taken exactly, as {Fraction(c)}: if {simple} is "
                    f"meant, write Fraction({simple.numerator}, {simple.denominator}), or "
                    "decimals=True for all."
                ]
    return []
