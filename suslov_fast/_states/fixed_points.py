"""Fixed points of fields, by elimination over the rationals."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np

from .._bodies.algebra import Polynomial
from .._bodies.base import Body
from .._bodies.field import QuadraticField
from .._checks import FloatArray, wrong
from .._docs import filled

_BEYOND = "scipy.optimize.root(lambda x: vector_field(field, x), x0) finds one near x0"
# Bits of a square root before it is rounded.
_BITS = 192


@filled
def fixed_points(field: Body) -> FloatArray:
    """All real fixed points of a field, which are those of its Kahan map for every step size.

    Parameters
    ----------
    field : QuadraticField or a body
        A single one, with at most 3 variables.

    Returns
    -------
    ndarray(float, shape=(k, D))
        Each point once, rounded once, in ascending order of the components.

    Raises
    ------
    TypeError, ValueError
        If the argument has a wrong type, is a batch, or has more than 3 variables; and if there are
        infinitely many fixed points, as those of all bodies.
    ImportError
        For D = 2 and 3, if python-flint is not installed (extra `algebra`).

    Notes
    -----
    Groebner bases reduce the equations to irreducible ones in one variable, and the points are
    polynomials in their roots. For D = 3, fields whose complex fixed points form an irreducible
    curve, such as that of two ellipsoids, count as having infinitely many, even if no real point or
    a single one lies on it. For more variables ``scipy.optimize.root`` finds single points.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, fixed_points
    >>> field = QuadraticField.from_function(
    ...     lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 3 * x[2]), 3
    ... )
    >>> fixed_points(field)
    array([[-9., -9., 27.],
           [ 0.,  0.,  0.],
           [ 9.,  9., 27.]])
    """
    whole = QuadraticField.of(field)
    D = whole.dimension
    if whole.shape:
        raise wrong("field", "a single one", f"a batch of shape {whole.shape}")
    if D > 3:
        raise wrong("field", "at most 3 variables", f"{D}: {_BEYOND}")
    try:
        points = _roots(whole.polynomials[0]) if D == 1 else _eliminated(whole)
    except OverflowError:
        raise wrong("field", "fixed points in the range of float64", "others") from None
    if points is None:
        raise wrong("field", "finitely many fixed points", f"infinitely many: {_BEYOND}")
    return np.array(sorted(points), np.float64).reshape(-1, D)


def _eliminated(field: QuadraticField) -> set[tuple[float, ...]] | None:
    try:
        from .real_zeros import real_zeros
    except ImportError as error:
        install = "pip install '.[algebra]' in a copy of the repository"
        raise ImportError(f"expected python-flint, got none: {install}") from error
    return real_zeros(field.components)


def _roots(equation: Polynomial) -> set[tuple[float, ...]] | None:
    """Return the roots of an equation in one variable; None if it is 0."""
    c, b, a = (equation.terms.get((0,) * k, Fraction(0)) for k in range(3))
    if not (a or b or c):
        return None
    if not a:
        return {(float(-c / b),)} if b else set()
    middle, square = -b / (2 * a), (b * b - 4 * a * c) / (4 * a * a)
    if square <= 0:
        return {(float(middle),)} if square == 0 else set()
    scale = 1 << (_BITS + square.denominator.bit_length())
    root = Fraction(math.isqrt(square.numerator * scale * scale // square.denominator), scale)
    larger = middle + root if middle >= 0 else middle - root  # where nothing cancels
    return {(float(larger),), (float(c / a / larger),)}
