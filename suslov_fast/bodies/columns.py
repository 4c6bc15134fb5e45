"""A parameter of a family as one number, with which a function of the user computes.

Arithmetic among columns is that of floats, for all members at once. Where a column meets the state
it becomes a letter: a variable with a negative index in polynomials whose coefficients are exact.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from fractions import Fraction
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from ..checks import OTHERS, FloatArray, within

_NUMBERS = (float, int, np.float64)
_ARITHMETIC = {np.positive, np.negative, np.add, np.subtract, np.multiply, np.true_divide}
# Coefficients with their letters, which are the sorted indices of the letters.
Terms = Sequence[tuple[Fraction, Sequence[int]]]


class Refused(Exception):
    """A column cannot do what is asked of it: f is called for each member instead."""


class Letter(NamedTuple):
    """A symbol of a column: it stands for the values of the column, or for their inverses."""

    values: Any
    is_inverse: bool


class Column(NDArrayOperatorsMixin):
    """The values that a parameter, or an expression of parameters, has for all members."""

    def __init__(self, values: FloatArray, letters: list[Letter]) -> None:
        self.values = values
        self._letters = letters  # of all columns of the family
        self._own: dict[bool, int] = {}

    def letter(self, *, is_inverse: bool = False) -> int:
        """Return the index of the letter that stands for the values, or for their inverses.

        They are in a range where products of two neither overflow nor lose digits at its lower end.
        """
        size = abs(self.values[self.values != 0])
        if not ((size > 1e-100) & (size < 1e100)).all() or (is_inverse and not self.values.all()):
            raise Refused
        if is_inverse not in self._own:
            self._letters.append(Letter(self.values, is_inverse))
            self._own[is_inverse] = -len(self._letters)
        return self._own[is_inverse]

    def __array_ufunc__(self, operation: Any, method: str, *operands: Any, **options: Any) -> Any:
        arrays = [each for each in operands if isinstance(each, np.ndarray)]
        if arrays:  # of variables, entry by entry; arrays of floats may add in another order
            if any(each.dtype != object for each in arrays):
                raise Refused
            return operation(
                *(each if isinstance(each, np.ndarray) else _alone(each) for each in operands)
            )
        if operation is np.power:
            return self._power(*operands)
        if operation not in _ARITHMETIC:
            raise Refused
        numbers: list[Any] = []
        for each in operands:
            if isinstance(each, Column):
                numbers.append(each.values)
            elif type(each) in _NUMBERS or isinstance(each, Fraction):
                numbers.append(float(each))  # as Python does where a number meets a float
            else:
                return NotImplemented
        if operation is np.true_divide and not np.all(numbers[1]):
            raise Refused  # a float would raise ZeroDivisionError
        with np.errstate(all="ignore"):
            return Column(operation(*numbers), self._letters)

    def _power(self, base: Any, power: Any) -> Column:
        if not isinstance(base, Column) or type(power) is not int or power not in range(100):
            raise Refused
        values = [value**power for value in base.values.ravel().tolist()]  # as of one member
        return Column(np.array(values, np.float64).reshape(base.values.shape), self._letters)

    def __bool__(self) -> bool:
        raise Refused

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise Refused


def _alone(value: Any) -> Any:
    """Return an array without axes, of one object."""
    array = np.empty((), object)
    array[()] = value
    return array


def rounded(terms: Terms, letters: Sequence[Letter]) -> Any:
    """Return a sum of products of letters for all members, rounded once."""
    ((c, own), *others) = terms
    alone = letters[-1 - own[0]] if len(own) == 1 and not others else None
    if alone is not None and not alone.is_inverse and _is_power(c):
        values = float(c) * alone.values  # as most coefficients are, without rounding
    else:
        values = exact_values(terms, letters).astype(np.float64)
    return _checked(values) + 0.0  # no -0.0


def exact_values(terms: Terms, letters: Sequence[Letter]) -> Any:
    """Return a sum of products of letters for all members, as fractions."""
    return reduce(operator.add, (_product(c, [letters[-1 - i] for i in own]) for c, own in terms))


def _product(c: Fraction, factors: Sequence[Letter]) -> Any:
    found = _alone(c)
    for values, is_inverse in factors:
        p, q = (1, 1) if found.ndim else c.as_integer_ratio()
        ratios = (a.as_integer_ratio() for a in values.ravel().tolist())
        array: Any = np.empty(values.shape, object)
        array.flat = [
            Fraction(p * d, q * n) if is_inverse else Fraction(p * n, q * d) for n, d in ratios
        ]
        found = found * array if found.ndim else array
    return found


def _checked(values: Any) -> Any:
    try:
        return within("coefficients", values, OTHERS)
    except ValueError:
        raise Refused from None


def _is_power(c: Fraction) -> bool:
    """Return whether c or -c is a power of 2, from 2**-99 to 2**99."""
    return all(n.bit_count() == 1 and n <= 2**99 for n in (abs(c.numerator), c.denominator))
