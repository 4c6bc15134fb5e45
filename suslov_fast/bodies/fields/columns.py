"""Columns: a parameter of a family as one object, so that one call of f gives all members.

Arithmetic among columns is that of floats, for all members at once. Where a column meets the state
it becomes a symbol: a variable with a negative index in a polynomial with exact coefficients.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from fractions import Fraction
from functools import reduce
from typing import Any, NamedTuple

import numpy as np

from ...checks import OTHERS, FloatArray, within

_ARITHMETIC = {"positive", "negative", "add", "subtract", "multiply", "divide"}
# A sum of products: each coefficient with the sorted indices of its symbols.
Products = Sequence[tuple[Fraction, Sequence[int]]]


class Refused(Exception):
    """A column cannot do what f asks of it: f is called for each member instead."""


class ColumnSymbol(NamedTuple):
    """A symbol in a polynomial: it stands for the values of a column, or for their inverses."""

    values: Any
    is_inverse: bool


class Column:
    """The values of a parameter, or of an expression of parameters, for all members of a family."""

    def __init__(self, values: FloatArray, symbols: list[ColumnSymbol]) -> None:
        self.values = values
        self._symbols = symbols  # shared by all columns of the family
        self._indices: dict[bool, int] = {}  # where its symbols are, by is_inverse

    def symbol(self, *, is_inverse: bool = False) -> int:
        """Return the index of the symbol that stands for the values, or for their inverses.

        Values outside 1e-100 to 1e100 are refused: products of two could leave the range of floats.
        """
        size = abs(self.values[self.values != 0])
        if not ((size > 1e-100) & (size < 1e100)).all() or (is_inverse and not self.values.all()):
            raise Refused
        if is_inverse not in self._indices:
            self._symbols.append(ColumnSymbol(self.values, is_inverse))
            self._indices[is_inverse] = -len(self._symbols)
        return self._indices[is_inverse]

    @staticmethod
    def applied(name: str, operands: Sequence[Any]) -> Column:
        """Return the value of a function of columns and numbers, by arithmetic of floats."""
        columns = [a for a in operands if isinstance(a, Column)]
        if name == "power":
            return columns[0]._power(*operands)
        if name not in _ARITHMETIC:
            raise Refused
        # As Python does for a number and a float.
        numbers = [a.values if isinstance(a, Column) else float(a) for a in operands]
        if name == "divide" and not np.all(numbers[1]):
            raise Refused  # a float would raise ZeroDivisionError
        with np.errstate(all="ignore"):
            return Column(getattr(np, name)(*numbers), columns[0]._symbols)

    def _power(self, base: Any, power: Any) -> Column:
        if base is not self or type(power) is not int or power not in range(100):
            raise Refused
        # Powers by Python, because those by NumPy may differ in the last bit.
        values = [value**power for value in base.values.ravel().tolist()]
        return Column(np.array(values, np.float64).reshape(base.values.shape), self._symbols)

    def __bool__(self) -> bool:
        raise Refused

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise Refused


def alone(value: Any) -> Any:
    """Return an array without axes that holds one object."""
    array = np.empty((), object)
    array[()] = value
    return array


def rounded(terms: Products, symbols: Sequence[ColumnSymbol]) -> Any:
    """Return a sum of products of symbols for all members, rounded once."""
    ((c, indices), *others) = terms
    single = symbols[-1 - indices[0]] if len(indices) == 1 and not others else None
    if single is not None and not single.is_inverse and _is_power(c):
        values = float(c) * single.values  # exact, and the case of most coefficients
    else:
        values = np.asarray(exact_values(terms, symbols)).astype(np.float64)
    return _checked(values) + 0.0  # no -0.0


def exact_values(terms: Products, symbols: Sequence[ColumnSymbol]) -> Any:
    """Return a sum of products of symbols for all members, as fractions."""
    products = (_product(c, [symbols[-1 - i] for i in indices]) for c, indices in terms)
    return reduce(operator.add, products)


def _product(c: Fraction, factors: Sequence[ColumnSymbol]) -> Any:
    """Return c times the values of symbols for all members, as fractions."""
    product = alone(c)
    for values, is_inverse in factors:
        p, q = (1, 1) if product.ndim else c.as_integer_ratio()
        ratios = (a.as_integer_ratio() for a in values.ravel().tolist())
        array: Any = np.empty(values.shape, object)
        array.flat = [
            Fraction(p * d, q * n) if is_inverse else Fraction(p * n, q * d) for n, d in ratios
        ]
        product = product * array if product.ndim else array
    return product


def _checked(values: Any) -> Any:
    """Return coefficients that are in their range, or refuse them."""
    try:
        return within("coefficients", values, OTHERS)
    except ValueError:
        raise Refused from None


def _is_power(c: Fraction) -> bool:
    """Return whether c or -c is a power of 2, from 2**-99 to 2**99."""
    return all(n.bit_count() == 1 and n <= 2**99 for n in (abs(c.numerator), c.denominator))
