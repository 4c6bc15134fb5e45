"""Kahan maps of quadratic fields, exact."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
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

    @property
    def inverse(self) -> KahanMap:
        """The inverse map, which is the Kahan map of the same field with -eps."""
        return KahanMap(self.field, -self.eps)

    def __call__(self, point: Any) -> Point:
        """Return the image of a point, exactly."""
        return tuple(map(fraction, self._at(point, self._rational.image)))

    def jacobian(self, point: Any) -> Matrix:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        rows = self._at(point, self._rational.derivative).tolist()
        return tuple(tuple(map(fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        return fraction(self._at(point, self._rational.derivative).det())

    def __repr__(self) -> str:
        return f"kahan({self.field}, eps={self.eps})"

    @cached_property
    def _rational(self) -> Arithmetic:
        return Arithmetic(self)

    def _at(self, point: Any, compute: Callable[[list[Any]], Any]) -> Any:
        x = exact_array("point", point, (self.dimension,))
        try:
            return compute([fmpq(a) for a in x])
        except ZeroDivisionError:
            where = ", ".join(map(str, x))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None


class Arithmetic:
    """A map over the rationals, or modulo a prime p: a step solves A(x) x~ = b(x)."""

    def __init__(self, map: KahanMap, p: int | None = None) -> None:
        self.dimension, self.p = map.dimension, p
        self.forward = self._forms(map.field, map.eps)
        self.backward = self._forms(map.field, -map.eps)

    def number(self, a: Any) -> Any:
        return fmpq(a) if self.p is None else flint.nmod(fmpq(a), self.p)

    def matrix(self, rows: Any) -> Any:
        return flint.fmpq_mat(rows) if self.p is None else flint.nmod_mat(rows, self.p)

    def _forms(self, field: QuadraticField, eps: Fraction) -> list[Any]:
        """Rows of (A | b): the nonzero coefficients of linear forms in x0 = 1, x1, ..., xD."""
        unit, half = np.eye(self.dimension, dtype=int), eps / 2 * np.array(field.linear)
        A = np.dstack([unit - half, -eps * np.array(field.quadratic)])
        b = np.column_stack([eps * np.array(field.constant), unit + half])
        rows = np.hstack([A, b[:, np.newaxis]])

        def sparse(form: Any) -> list[Any]:
            return [(k, self.number(a)) for k, a in enumerate(form) if a]

        return [[sparse(form) for form in row] for row in rows]

    def _equations(self, forms: list[Any], x: Sequence[Any]) -> tuple[Any, Any]:
        rows = evaluate(forms, [self.number(1), *x])
        return self.matrix([row[:-1] for row in rows]), self.matrix([row[-1:] for row in rows])

    def image(self, x: Sequence[Any]) -> list[Any]:
        A, b = self._equations(self.forward, x)
        return list(A.solve(b).entries())

    def derivative(self, x: Sequence[Any]) -> Any:
        backward, _ = self._equations(self.backward, self.image(x))
        return self._equations(self.forward, x)[0].solve(backward)

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for _ in range(length):
            yield x
            x = self.image(x)

    def random_point(self, rng: random.Random) -> list[Any]:
        return [self.number(rng.randrange(self.p or 2**62)) for _ in range(self.dimension)]


def evaluate(forms: Any, x: Sequence[Any]) -> list[list[Any]]:
    zero = x[0] - x[0]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in forms]


def cramer(system: list[list[Any]]) -> list[Any]:
    """Return det A and the numerators of the solution of (A | b), without fractions (Bareiss)."""
    n, previous = len(system), 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        system[k], system[pivot] = system[pivot], system[k]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [previous, *(row[n] for row in system)]


@filled
def kahan(field: QuadraticField, eps: Any) -> KahanMap:
    """Return the Kahan map of a field, ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c``.

    Parameters
    ----------
    field : QuadraticField
        The field to discretize.
    eps : int, Fraction or float
        Step size, of any sign; a float is taken exactly.

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
    return KahanMap(field, exact_array("eps", eps, ()).item())
