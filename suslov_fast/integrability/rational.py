"""Birational maps from functions of the user, called with symbols; an inverse is checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..bodies.advice import check_arguments
from ..bodies.names import labels
from ..checks import integer, wrong
from .arithmetic import ring
from .functions import as_function, factored, over_common_denominator
from .maps import RationalMap


def rational_map(
    f: Callable[[Any], Any], dimension: int, inverse: Callable[[Any], Any] | None = None
) -> RationalMap:
    """Return the birational map of a function, for the same searches as Kahan maps.

    Parameters
    ----------
    f : callable
        It maps a tuple x of D numbers to D quotients of polynomials, by ``+``, ``-``, ``*``, ``/``
        and integer powers. It is called with symbols; its integers and fractions remain exact, and
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
    ((x1 + 1)*(x2 + 1)*(x1 + x2 + 3)/(x1*x2),)
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
        raise ValueError("inverse is not the inverse of f: inverse(f(x)) differs from x")
    return map


def _traced(name: str, f: Any, n: int) -> list[Any]:
    """Return the polynomials F_1, ..., F_D, F_0 of a function."""
    if not callable(f):
        expected = "a function of x, the tuple of variables"
        raise wrong(name, expected, type(f).__name__, TypeError)
    check_arguments(name, f, labels(n), {}, "rational_map" if name == "f" else "")
    of = ring(n, False)
    must = f"must return {n} quotients of polynomials in x[0] to x[{n - 1}], by +, -, *, /, **"
    try:
        found = f(tuple(map(factored, of.gens())))
        components = [*map(as_function, found)]
    except (TypeError, AttributeError) as error:
        raise TypeError(f"{name} {must}: {error}") from error
    except (ValueError, IndexError, ArithmeticError) as error:
        raise ValueError(f"{name} {must}: {error}") from error
    if len(components) != n:
        raise ValueError(f"{name} {must}, not {len(components)} of them: {found!r:.60}")
    return over_common_denominator(components, of)
