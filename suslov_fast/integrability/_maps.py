"""Kahan maps of quadratic fields, exact."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import flint
import numpy as np

from .._bodies.algebra import exact_array
from .._bodies.field import QuadraticField
from .._checks import instance, wrong
from .._docs import filled
from ._exact import Matrix, Point, fmpq, fraction

LinearForm = list[tuple[int, int]]  # places and coefficients that are not 0


@dataclass(frozen=True, repr=False)
class KahanMap:
    """The Kahan map of a quadratic field, exact; made by `kahan`.

    Called with a point, D rational numbers, it returns the next one, a tuple of fractions. At a
    pole, a point without an image, its methods raise `ZeroDivisionError`.
    """

    field: QuadraticField
    eps: Fraction

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return self.field.dimension

    @cached_property
    def inverse(self) -> KahanMap:
        """The inverse map, which is the Kahan map of the same field with -eps."""
        return KahanMap(self.field, -self.eps)

    def __call__(self, point: Any) -> Point:
        """Return the image of a point, exactly."""
        return tuple(map(fraction, self._at(point, Arithmetic.image)[:-1]))

    def jacobian(self, point: Any) -> Matrix:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        rows = self._at(point, Arithmetic.derivative).tolist()
        return tuple(tuple(map(fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        return fraction(self._at(point, Arithmetic.derivative).det())

    def __repr__(self) -> str:
        return f"kahan({self.field}, eps={self.eps})"

    def _at(self, point: Any, method: Callable[[Arithmetic, list[Any]], Any]) -> Any:
        x, rational = exact_array("point", point, (self.dimension,)), Arithmetic(self)
        try:
            return method(rational, rational.point(x))
        except ZeroDivisionError:
            where = ", ".join(map(str, x))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None

    @cached_property
    def equations(self) -> list[list[LinearForm]]:
        """Rows of (A | b), linear forms in x1, ..., xD, 1, of the equations A(x) x~ = b(x).

        Each row is multiplied by a common denominator.
        """
        field, eps, unit = self.field, self.eps, np.eye(self.dimension, dtype=int)
        half = eps / 2 * np.array(field.linear)
        A = np.dstack([-eps * np.array(field.quadratic), unit - half])
        b = np.column_stack([unit + half, eps * np.array(field.constant)])
        rows = []
        for row in np.hstack([A, b[:, np.newaxis]]):
            factor = math.lcm(*(a.denominator for a in row.flat))
            rows.append([[(k, int(a * factor)) for k, a in enumerate(f) if a] for f in row])
        return rows


class Arithmetic:
    """Steps of a map over the rationals, or modulo a prime p. Points are (x1, ..., xD, 1)."""

    def __init__(self, map: KahanMap, p: int | None = None) -> None:
        self.map, self.p = map, p

    def point(self, x: Iterable[Any]) -> list[Any]:
        numbers = map(fmpq, (*x, 1))
        return [*numbers] if self.p is None else [flint.nmod(a, self.p) for a in numbers]

    def matrix(self, rows: Any) -> Any:
        return flint.fmpq_mat(rows) if self.p is None else flint.nmod_mat(rows, self.p)

    def _equations(self, map: KahanMap, x: Sequence[Any]) -> tuple[Any, Any]:
        rows = linear_values(map.equations, x)
        return self.matrix([row[:-1] for row in rows]), self.matrix([row[-1:] for row in rows])

    def image(self, x: Sequence[Any]) -> list[Any]:
        A, b = self._equations(self.map, x)
        return [*A.solve(b).entries(), x[-1] ** 0]

    def derivative(self, x: Sequence[Any]) -> Any:
        backward, _ = self._equations(self.map.inverse, self.image(x))
        return self._equations(self.map, x)[0].solve(backward)

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for _ in range(length):
            yield x
            x = self.image(x)


def linear_values(equations: list[list[LinearForm]], x: Sequence[Any]) -> list[list[Any]]:
    zero = 0 * x[-1]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in equations]


def image_by_minors(map: KahanMap, x: Sequence[Any]) -> list[Any]:
    """Return the numerators of the image of a point of polynomials, and their denominator det A.

    Elimination without fractions (Bareiss).
    """
    system = linear_values(map.equations, x)
    n, previous = len(system), 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        if pivot != k:  # the determinant keeps its sign
            system[k], system[pivot] = system[pivot], [-a for a in system[k]]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [*(row[n] for row in system), previous]


def random_line(map: KahanMap, p: int, rng: random.Random) -> list[Any]:
    """Return a line modulo a prime; its parameter t is the last coordinate, 0 at infinity."""
    ends = ([rng.randrange(p), rng.randrange(p)] for _ in range(map.dimension))
    return [flint.nmod_poly(each, p) for each in (*ends, [0, 1])]


@filled
def kahan(field: QuadraticField, eps: Any) -> KahanMap:
    """Return the Kahan map of a field, ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c``.

    Parameters
    ----------
    field : QuadraticField
        The field to discretize.
    eps : int, Fraction, float or str
        Step size, of any sign. A float is taken exactly; a string may be "1/3" or "0.1".

    Returns
    -------
    KahanMap
        It is callable, and has `inverse`, `jacobian`, `determinant`, `dimension`, `field`, `eps`.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> from suslov_fast.integrability import kahan
    >>> map = kahan(QuadraticField([[[1]]]), eps=1)  # x' = x**2
    >>> [str(x) for x in map([2])], [str(x) for x in map.inverse([-2])]
    (['-2'], ['2'])
    """
    instance("field", field, QuadraticField)
    if field.shape:
        raise wrong("field", "a single field", f"a batch of shape {field.shape}")
    if isinstance(eps, str):
        try:
            eps = Fraction(eps)
        except (ValueError, ZeroDivisionError):
            raise wrong("eps", "a number such as 1/3 or 0.1", repr(eps)) from None
    return KahanMap(field, exact_array("eps", eps, ()).item())


def check_map(map: Any) -> None:
    if not isinstance(map, KahanMap):
        expected = "a KahanMap, as kahan(field, eps) returns it"
        raise wrong("map", expected, type(map).__name__, TypeError)
