"""Birational maps from functions of the user."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import reduce
from numbers import Rational
from typing import Any

import numpy as np

from ..checks import integer, wrong
from .exact import ring, value_at
from .maps import RationalMap

_NUMBERS: Any = Rational | float | np.integer | np.floating


def _binary(combine: Callable[..., tuple[Any, Any]]) -> Any:
    """Return the method for an operation on a / b and c / d."""

    def method(self: Quotient, other: Any) -> Any:
        if (right := self.of(other)) is None:
            return NotImplemented
        return Quotient(*combine(self.above, self.below, right.above, right.below))

    return method


class Quotient:
    """A quotient of polynomials in x, with which functions of the user calculate."""

    __array_ufunc__ = None  # NumPy numbers leave arithmetic to this class
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, above: Any, below: Any) -> None:
        if below == 0:
            raise ZeroDivisionError("a denominator is 0")
        common = above.gcd(below)
        self.above, self.below = above // common, below // common

    def of(self, other: Any) -> Quotient | None:
        """Return a number as a quotient; None for anything else."""
        if isinstance(other, Quotient):
            return other
        if isinstance(other, bool) or not isinstance(other, _NUMBERS):
            return None
        number, constant = Fraction(other), self.above.context().constant
        return Quotient(constant(number.numerator), constant(number.denominator))

    __add__ = __radd__ = _binary(lambda a, b, c, d: (a * d + c * b, b * d))
    __sub__ = _binary(lambda a, b, c, d: (a * d - c * b, b * d))
    __rsub__ = _binary(lambda a, b, c, d: (c * b - a * d, b * d))
    __mul__ = __rmul__ = _binary(lambda a, b, c, d: (a * c, b * d))
    __truediv__ = _binary(lambda a, b, c, d: (a * d, b * c))
    __rtruediv__ = _binary(lambda a, b, c, d: (c * b, d * a))

    def __neg__(self) -> Quotient:
        return Quotient(-self.above, self.below)

    def __pos__(self) -> Quotient:
        return self

    def __pow__(self, power: Any) -> Quotient:
        if power not in range(-99, 100):
            raise wrong("power", "a small integer", power)
        above, below = (self.above, self.below) if power >= 0 else (self.below, self.above)
        return Quotient(above ** abs(int(power)), below ** abs(int(power)))

    def __eq__(self, other: object) -> bool:
        raise TypeError("functions of x cannot be compared")


def rational_map(
    f: Callable[[Any], Any], dimension: int, inverse: Callable[[Any], Any] | None = None
) -> RationalMap:
    """Return the birational map of a function, for all that is found for Kahan maps.

    Parameters
    ----------
    f : callable
        It maps a tuple x of D numbers to D quotients of polynomials, by ``+``, ``-``, ``*``, ``/``
        and integer powers. It is called with letters; its integers and fractions remain exact, and
        floats are binary numbers.
    dimension : int
        The number D of variables.
    inverse : callable, optional
        The inverse map, given in the same way; it is checked. Degrees, integrals, measures and
        Darboux polynomials do not need it. Without it, it is not checked that the map is
        birational, and `RationalMap.inverse` is None.

    Returns
    -------
    RationalMap
        An argument of `degrees`, `hk_bases`, `cofactors`, `darboux_polynomials` and `report`. It is
        callable, and has `inverse`, `jacobian`, `determinant` and `dimension`.

    Raises
    ------
    TypeError, ValueError
        If an argument has a wrong type or value, f is no such function, or `inverse` is not its
        inverse.

    Examples
    --------
    The map of Lyness:

    >>> from suslov_fast.integrability import degrees, rational_map, report
    >>> map = rational_map(lambda x: (x[1], (x[1] + 3) / x[0]), 2)
    >>> degrees(map, 10)
    [2, 2, 3, 4, 5, 7, 9, 11, 14, 16]
    >>> report(map).integrals
    ((x1^2*x2 + x1*x2^2 + x1^2 + x2^2 + 4*x1 + 4*x2 + 3)/(x1*x2),)
    """
    n = integer("dimension", dimension, 1)
    forms = _traced("f", f, n)
    if inverse is None:
        return RationalMap(forms)
    back = _traced("inverse", inverse, n)
    map, opposite = RationalMap(forms), RationalMap(back, RationalMap(forms))
    map.inverse = opposite
    # The inverse takes images back, as an identity.
    *above, below = (value_at(F, forms, opposite.degree) for F in back)
    if below == 0 or [*above] != [x * below for x in map.variables[:-1]]:
        raise wrong("inverse", "the inverse of f", "another map")
    return map


def _traced(name: str, f: Any, n: int) -> list[Any]:
    """Return the polynomials F_1, ..., F_D, F_0 of a function."""
    if not callable(f):
        expected = "a function of x, the tuple of variables"
        raise wrong(name, expected, type(f).__name__, TypeError)
    of = ring(n, False)
    one = of.constant(1)
    expected = f"{n} quotients of polynomials in x[0] to x[{n - 1}], by +, -, *, / and powers"
    try:
        found = f(tuple(Quotient(x, one) for x in of.gens()))
        components: list[Any] = [Quotient(one, one).of(each) for each in found]
    except (TypeError, AttributeError) as error:
        raise wrong(name, expected, f"another operation: {error}", TypeError) from error
    except (ValueError, IndexError, ArithmeticError) as error:
        raise wrong(name, expected, f"an error: {error}") from error
    if len(components) != n or any(each is None for each in components):
        raise wrong(name, expected, f"{len(components)} components: {found!r:.60}")
    common = reduce(lambda a, b: a * b // a.gcd(b), (q.below for q in components))
    return [*(q.above * (common // q.below) for q in components), common]
