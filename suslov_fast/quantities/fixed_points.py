"""Fixed points of fields, by elimination over the rationals."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from ..bodies.base import Body
from ..bodies.field import QuadraticField
from ..checks import FloatArray, wrong

_BEYOND = "scipy.optimize.root(lambda x: vector_field(field, x), x0) finds one near x0"
# Bits of a square root before it is rounded.
_BITS = 192


def fixed_points(field: Body) -> FloatArray | list[FloatArray]:
    """All real fixed points of a field, which are those of its Kahan map for every step size.

    Parameters
    ----------
    field : QuadraticField or a body
        With at most 3 variables: a single one, or a batch with one axis.

    Returns
    -------
    ndarray(float, shape=(k, D)), or a list of them
        Each point once, rounded once, in ascending order of the components. Of a batch a list, an
        array for each member, whose points are in the order of those of the member before that
        they continue, with the least sum of distances, and new ones last.

    Raises
    ------
    ValueError
        If there are more than 3 variables, or infinitely many fixed points, as of all Suslov
        bodies, or if a batch has several axes.
    ImportError
        For D > 1 without python-flint (extra `algebra`).

    Notes
    -----
    Groebner bases reduce the equations to irreducible ones in one variable, and the points are
    polynomials in their roots. For D = 3, complex fixed points that form an irreducible curve, such
    as that of two ellipsoids, count as infinitely many, even if none or one of them is real.

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
    >>> family = QuadraticField.from_function(lambda x, a: (a - x[0] ** 2,), 1, a=[-1.0, 1.0, 4.0])
    >>> fixed_points(family)
    [array([], shape=(0, 1), dtype=float64), array([[-1.],
           [ 1.]]), array([[-2.],
           [ 2.]])]
    """
    whole = QuadraticField.of(field)
    if whole.dimension > 3:
        raise wrong("field", "at most 3 variables", f"{whole.dimension}: {_BEYOND}")
    if len(whole.shape) > 1:
        raise wrong("field", "a single one, or a batch with one axis", f"the shape {whole.shape}")
    if not whole.shape:
        return _points_of(whole)
    found: list[FloatArray] = []
    for member in whole:
        points = _points_of(member)
        found.append(_continuing(found[-1], points) if found else points)
    return found


def _points_of(field: Any) -> FloatArray:
    """Return the fixed points of a single field in ascending order."""
    try:
        points = _roots(field) if field.dimension == 1 else _eliminated(field)
    except OverflowError:
        raise wrong("field", "fixed points in the range of float64", "others") from None
    if points is None:
        raise wrong("field", "finitely many fixed points", f"infinitely many: {_BEYOND}")
    return np.array(sorted(points), np.float64).reshape(-1, field.dimension)


def _continuing(before: FloatArray, points: FloatArray) -> FloatArray:
    """Return points in the order of those before that they continue, and then the others."""
    from scipy.optimize import linear_sum_assignment  # imported here, since importing takes time

    scale = max(abs(before).max(initial=0.0), abs(points).max(initial=0.0)) or 1.0
    distances = np.linalg.norm((before[:, np.newaxis] - points) / scale, axis=-1)
    _, continued = linear_sum_assignment(distances)
    new = np.setdiff1d(np.arange(len(points)), continued)
    order = np.concatenate([continued, new]).astype(np.intp)
    return np.asarray(points[order])


def _eliminated(field: Any) -> set[tuple[float, ...]] | None:
    try:
        from .real_zeros import real_zeros
    except ImportError as error:
        install = "pip install '.[algebra]' in a copy of the repository"
        raise ImportError(f"expected python-flint, got none: {install}") from error
    return real_zeros(field.components)


def _roots(field: Any) -> set[tuple[float, ...]] | None:
    """Return the roots of the equation in one variable; None if it is 0."""
    a, half_b, c = (Fraction(field.table[(0, *place)]) for place in ((0, 0), (0, 1), (1, 1)))
    if not a:
        return ({(float(-c / (2 * half_b)),)} if half_b else set()) if half_b or c else None
    middle, square = -half_b / a, (half_b * half_b - a * c) / (a * a)
    if square <= 0:
        return {(float(middle),)} if square == 0 else set()
    scale = 1 << (_BITS + square.denominator.bit_length())
    root = Fraction(math.isqrt(square.numerator * scale * scale // square.denominator), scale)
    larger = middle + root if middle >= 0 else middle - root  # where nothing cancels
    return {(float(larger),), (float(c / a / larger),)}
