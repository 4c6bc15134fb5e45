"""Linear equations of numbers and symbols: elimination, and Cramer's rule.

The pivots are chosen once, for all states. Numbers are chosen before formulas, and pivots of a
symmetric matrix from its diagonal. A formula that is 0 at all states is no pivot, because its
rounding errors are not 0. A formula that changes its sign is 0 at some states, at which the matrix
may have an inverse: where only such pivots are left, Cramer's rule solves the last equations. It
divides only by their determinant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from ..checks import wrong
from .samples import Samples
from .symbols import Symbol
from .tolerances import MOST_EQUATIONS_OF_CRAMER


def singular() -> Any:
    """Return the error that a matrix has no inverse."""
    how = "write an equation without a derivative into the others, as a formula"
    return wrong("mass", "a matrix that has an inverse", f"a singular one: {how}")


def is_zero(a: Any) -> bool:
    return isinstance(a, float) and a == 0.0


def product_of(a: Any, b: Any) -> Any:
    """Return a b, without an operation if a is 0 or 1, or b is 0."""
    if is_zero(a) or is_zero(b):
        return 0.0
    return b if _same(a, 1.0) else a * b


def sum_of(products: Iterable[tuple[Any, Any]]) -> Any:
    """Return the sum of the products of pairs."""
    total: Any = 0.0
    for product in (product_of(a, b) for a, b in products):
        if not is_zero(product):
            total = product if is_zero(total) else total + product
    return total


def solved(
    a: list[list[Any]],
    b: list[Any],
    samples: Samples,
    first: int = 0,
    is_definite: bool = False,
) -> list[Any]:
    """Return the solution x of a x = b, for numbers and symbols; a and b are overwritten.

    Pivots are chosen in the first rows and columns while these have some. `is_definite` tells that
    this block is positive definite, and a symmetric: then no pivot on the diagonal is 0.
    """
    D = len(b)
    is_symmetric = all(_same(a[i][j], a[j][i]) for i in range(D) for j in range(i))
    rows, columns = [*range(D)], [*range(D)]
    steps, x = [], [0.0] * D
    while rows:
        i, j = _pivot(a, rows, columns, is_symmetric, samples.looks_zero, first)
        is_safe = is_definite and is_symmetric and i == j
        if len(rows) <= MOST_EQUATIONS_OF_CRAMER and not is_safe and samples.changes_sign(a[i][j]):
            for j, value in zip(columns, _by_cramer(a, b, rows, columns, samples), strict=True):
                x[j] = value
            break
        is_symmetric &= i == j
        rows.remove(i)
        columns.remove(j)
        after = [c for c in columns if not is_zero(a[i][c])]
        below = [r for r in rows if not is_zero(a[r][j])]
        inverse = 1.0 / a[i][j] if below and not _same(a[i][j], 1.0) else 1.0
        for r in below:
            factor = product_of(inverse, a[r][j])
            for c in after:
                a[r][c] = less(a[r][c], factor, a[i][c])
            b[r] = less(b[r], factor, b[i])
        steps.append((i, j, inverse if below else None, after))
    for i, j, inverse, after in reversed(steps):
        rest = b[i]
        for c in after:
            rest = less(rest, a[i][c], x[c])
        x[j] = rest / a[i][j] if inverse is None else product_of(inverse, rest)
    return x


def _by_cramer(
    a: list[list[Any]], b: list[Any], rows: list[int], columns: list[int], samples: Samples
) -> list[Any]:
    """Return the solution of the equations in these rows and columns, by Cramer's rule."""
    whole = [[*row, value] for row, value in zip(a, b, strict=True)]  # b is the last column

    @cache
    def minor(rows: tuple[int, ...], columns: tuple[int, ...]) -> Any:
        """Return a determinant, expanded along its first column."""
        if not columns:
            return 1.0
        j, *others = columns
        cofactors = [minor((*rows[:k], *rows[k + 1 :]), (*others,)) for k in range(len(rows))]
        parts = (product_of(whole[i][j], c) for i, c in zip(rows, cofactors, strict=True))
        total = sum_of(((-1.0) ** k, part) for k, part in enumerate(parts))
        return 0.0 if samples.is_zero(total) else total

    determinant = minor((*rows,), (*columns,))
    if samples.looks_zero(determinant):
        raise singular()
    places = [(len(b), *columns[:k], *columns[k + 1 :]) for k in range(len(columns))]
    signed = ((-1.0) ** k * minor((*rows,), place) for k, place in enumerate(places))
    return [each if _same(determinant, 1.0) else each / determinant for each in signed]


def less(a: Any, factor: Any, b: Any) -> Any:
    """Return a - factor b."""
    product = product_of(factor, b)
    if is_zero(product):
        return a
    return -product if is_zero(a) else a - product


def _same(a: Any, b: Any) -> bool:
    """Return True for equal numbers, and for one symbol twice."""
    if isinstance(a, Symbol) and isinstance(b, Symbol):
        return bool(a.operand == b.operand)
    return isinstance(a, float) and isinstance(b, float) and a == b


def _pivot(
    a: Any,
    rows: list[int],
    columns: list[int],
    is_symmetric: bool,
    is_zero: Callable[[Any], bool],
    first: int = 0,
) -> tuple[int, int]:
    """Return the place of the next pivot: of a number, else where few entries fill in."""
    places = [(i, j) for i in rows for j in columns if not is_zero(a[i][j])]
    if not places:
        raise singular()
    places = [(i, j) for i, j in places if max(i, j) < first] or places
    diagonal = [(i, j) for i, j in places if i == j]
    in_row = {i: sum(place[0] == i for place in places) for i in rows}
    in_column = {j: sum(place[1] == j for place in places) for j in columns}

    def order(place: tuple[int, int]) -> Any:
        i, j = place
        size = abs(a[i][j]) if isinstance(a[i][j], float) else 0.0
        return not size, (in_row[i] - 1) * (in_column[j] - 1), -size, i != j, place

    return min(diagonal if is_symmetric and diagonal else places, key=order)
