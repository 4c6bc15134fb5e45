"""Birational maps from functions of the user."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from ..bodies.polynomials import exact
from ..checks import integer, wrong
from .exact import ring
from .maps import RationalMap

_ARITHMETIC: dict[Any, Callable[..., tuple[Any, Any]]] = {  # of a / b and c / d
    np.add: lambda a, b, c, d: (a * d + c * b, b * d),
    np.subtract: lambda a, b, c, d: (a * d - c * b, b * d),
    np.multiply: lambda a, b, c, d: (a * c, b * d),
    np.true_divide: lambda a, b, c, d: (a * d, b * c),
    np.negative: lambda a, b: (-a, b),
    np.positive: lambda a, b: (a, b),
}


class Quotient(NDArrayOperatorsMixin):
    """A quotient of polynomials in x, with which functions of the user calculate."""

    def __init__(self, above: Any, below: Any) -> None:
        if below == 0:
            raise ZeroDivisionError("a denominator is 0")
        common = above.gcd(below)
        self.above, self.below = above // common, below // common

    def of(self, value: Any) -> Quotient:
        """Return a number as a quotient in the same variables, and a quotient as it is."""
        if isinstance(value, Quotient):
            return value
        number, constant = exact("number", value), self.above.context().constant
        return Quotient(constant(number.numerator), constant(number.denominator))

    def __array_ufunc__(self, operation: Any, method: str, *operands: Any, **options: Any) -> Any:
        if operation not in _ARITHMETIC:
            raise TypeError(operation.__name__)
        parts = [part for q in map(self.of, operands) for part in (q.above, q.below)]
        return Quotient(*_ARITHMETIC[operation](*parts))

    def __pow__(self, power: Any) -> Quotient:
        if power not in range(-99, 100):
            raise wrong("power", "a small integer", power)
        above, below = (self.above, self.below) if power >= 0 else (self.below, self.above)
        return Quotient(above ** abs(int(power)), below ** abs(int(power)))


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
        The inverse map, given in the same way; it is checked. Without it, it is not checked that
        the map is birational, and `RationalMap.inverse` is None.

    Returns
    -------
    RationalMap
        It is callable, and has `inverse`, `jacobian`, `determinant` and `dimension`.

    Raises
    ------
    TypeError, ValueError
        If f is no such function, or `inverse` is not its inverse.

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
    map = RationalMap(forms, RationalMap(back, RationalMap(forms)))
    # The inverse takes images back, as an identity.
    *above, below = map.inverse.homogeneous(forms)
    if below == 0 or above != [x * below for x in map.variables[:-1]]:
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
        components = [Quotient(one, one).of(each) for each in found]
    except (TypeError, AttributeError) as error:
        raise wrong(name, expected, f"another operation: {error}", TypeError) from error
    except (ValueError, IndexError, ArithmeticError) as error:
        raise wrong(name, expected, f"an error: {error}") from error
    if len(components) != n:
        raise wrong(name, expected, f"{len(components)} components: {found!r:.60}")
    common = reduce(lambda a, b: a * b // a.gcd(b), (q.below for q in components))
    return [*(q.above * (common // q.below) for q in components), common]
