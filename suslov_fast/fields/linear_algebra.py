"""`np.linalg.solve`, `inv` and `det` of matrices of symbols, and Fourier transforms of vectors."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from .linear_equations import product_of, solved, sum_of
from .samples import Samples
from .symbols import Symbol, Symbols, Untraceable, is_complex
from .tolerances import MOST_ROWS


def _entries(name: str, a: Any, most: int = MOST_ROWS) -> list[list[Any]]:
    """Return the rows of a square matrix of real symbols and numbers."""
    a = np.asarray(a, object)
    if a.ndim != 2 or len(a) != a.shape[1] or len(a) > most:
        raise Untraceable(f"np.linalg.{name} of symbols takes one matrix of up to {most} rows")
    if any(map(is_complex, a.ravel())):
        raise Untraceable(f"np.linalg.{name} of symbols takes real matrices")
    return [[each if isinstance(each, Symbol) else float(each) for each in row] for row in a]


def solve(a: Any, b: Any) -> Any:
    """Return the solution of a x = b by elimination as formulas, see `mass`."""
    rows, right = _entries("solve", a), np.asarray(b, object)
    if right.ndim not in (1, 2) or len(right) != len(rows):
        raise Untraceable("np.linalg.solve(a, b) of symbols takes b with as many rows as a")
    every = [*np.ravel(np.array(rows, object)), *right.ravel()]
    samples = Samples(next(each for each in every if isinstance(each, Symbol)).tracer)
    columns = right.reshape(len(rows), -1).T.tolist()
    try:
        found = [solved([[*row] for row in rows], column, samples) for column in columns]
    except ValueError:
        raise Untraceable("np.linalg.solve of a singular matrix") from None
    return np.array(found, object).T.reshape(right.shape).view(Symbols)


def inv(a: Any) -> Any:
    """Return the inverse of a matrix as formulas."""
    return solve(a, np.eye(len(a)))


def det(a: Any) -> Any:
    """Return the determinant of a matrix as a formula, expanded along its columns."""
    rows = _entries("det", a, 6)

    @cache
    def minor(places: tuple[int, ...]) -> Any:
        j = len(rows) - len(places)
        if not places:
            return 1.0
        others = [minor((*places[:k], *places[k + 1 :])) for k in range(len(places))]
        parts = (product_of(rows[i][j], c) for i, c in zip(places, others, strict=True))
        return sum_of(((-1.0) ** k, part) for k, part in enumerate(parts))

    return minor((*range(len(rows)),))


def linear(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a linear function of a vector, such as `np.fft.fft`, as a product with a matrix."""

    def of_symbols(a: Any, *given: Any, **options: Any) -> Any:
        a = np.asarray(a).view(Symbols)
        if a.ndim != 1:
            raise Untraceable(f"{function.__name__} of symbols takes a vector")
        unit = np.eye(len(a))
        columns = np.stack([function(row, *given, **options) for row in unit], 1) @ a.real
        if not any(map(is_complex, a)):
            return columns
        return (
            columns + np.stack([function(1j * row, *given, **options) for row in unit], 1) @ a.imag
        )

    return of_symbols
