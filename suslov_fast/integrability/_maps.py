"""Quadratic fields and their Kahan maps."""

from __future__ import annotations

import random
import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import flint
import numpy as np

from .._bodies.gyrostat import SuslovGyrostat
from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import instance, integer, wrong
from ._exact import Matrix, Point, Polynomials, exact_array, fmpq, fraction, polynomial_ring


@dataclass(frozen=True, init=False, repr=False)
class QuadraticField:
    """A quadratic vector field, ``dx_i/dt = sum_jk q_ijk x_j x_k + sum_j l_ij x_j + c_i``.

    Parameters
    ----------
    quadratic : array_like(shape=(D, D, D))
        q: integers, fractions, or floats, which are taken exactly (0.1 is not 1/10: use
        ``Fraction(1, 10)``). It is made symmetric in j and k, which does not change the field.
    linear : array_like(shape=(D, D)), optional
        l, by default 0.
    constant : array_like(shape=(D,)), optional
        c, by default 0.

    Raises
    ------
    TypeError, ValueError
        If a coefficient is not a finite rational number, or a shape is not as above.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField
    >>> QuadraticField([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]], constant=[0, 0.5])
    QuadraticField(x1' = x1*x2, x2' = -x1^2 + 1/2)
    >>> QuadraticField.of(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25))
    QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)
    >>> QuadraticField.from_function(lambda x: (x[1] * x[2], x[2] * x[0], x[0] * x[1]), 3)
    QuadraticField(x1' = x2*x3, x2' = x1*x3, x3' = x1*x2)
    """

    quadratic: tuple[Matrix, ...]
    linear: Matrix
    constant: Point

    def __init__(self, quadratic: Any, linear: Any = None, constant: Any = None) -> None:
        q = exact_array("quadratic", quadratic)
        n = len(q) if q.ndim else 0
        if n == 0 or q.shape != (n, n, n):
            raise wrong("quadratic", "the shape (D, D, D)", q.shape)
        q = (q + q.transpose(0, 2, 1)) / 2
        l = exact_array("linear", np.zeros((n, n), int) if linear is None else linear, (n, n))
        c = exact_array("constant", np.zeros(n, int) if constant is None else constant, (n,))
        object.__setattr__(self, "quadratic", tuple(tuple(map(tuple, each)) for each in q))
        object.__setattr__(self, "linear", tuple(map(tuple, l)))
        object.__setattr__(self, "constant", tuple(c))

    @classmethod
    def from_function(cls, f: Callable[[Point], Any], dimension: int) -> QuadraticField:
        """Return the field with components ``f(x)``, computed exactly for a tuple x of fractions.

        Raises TypeError or ValueError if they are not polynomials of degree 2 or less.
        """
        n = integer("dimension", dimension, 1)
        unit = exact_array("unit", np.eye(n, dtype=int))

        def at(x: Any) -> Any:
            return exact_array("the value of f", f(tuple(x)), (n,), exact=True)

        c = at(0 * unit[0])
        l = np.stack([at(a) - at(-a) for a in unit], axis=-1) / 2
        q = np.array([[at(a + b) - at(a) - at(b) + c for b in unit] for a in unit]) / 2
        field = cls(np.moveaxis(q, -1, 0), l, c)
        x = [Fraction(k, 7) for k in random.Random(0).sample(range(100, 10_000), n)]
        if tuple(at(x)) != field(x):
            raise ValueError("f: expected polynomials of degree at most 2, evaluated exactly")
        return field

    @classmethod
    def of(cls, body: Suslov3D | SuslovND | SuslovGyrostat) -> QuadraticField:
        """Return the equations of motion of a single body, its parameters taken exactly.

        The variables are Omega_1 and Omega_2, or Omega_1n, ..., Omega_(n-1)n. Raises TypeError or
        ValueError for anything else, or a batch of bodies.
        """
        instance("body", body, (Suslov3D, SuslovND, SuslovGyrostat))
        if body.shape != ():
            raise wrong("body", "a single body", f"a batch of shape {body.shape}")
        if isinstance(body, SuslovND):
            J, I = exact_array("J", body.J), exact_array("I", body.I)
        else:
            J, I = exact_array("J", (body.I1, body.I2)), exact_array("I", (body.I23, -body.I13))
        unit = np.eye(len(J), dtype=int)
        # J_i x_i' = sum_j I_j x_j x_i - I_i sum_j x_j x_j
        q = (np.multiply.outer(unit, I) - np.multiply.outer(I, unit)) / J[:, None, None]
        if not isinstance(body, SuslovGyrostat):
            return cls(q)
        k = Fraction(float(body.k))
        return cls(q, [[0, -k / J[0]], [k / J[1], 0]])

    @property
    def dimension(self) -> int:
        """The number of variables."""
        return len(self.constant)

    @property
    def components(self) -> Polynomials:
        """The components as polynomials, ``flint.fmpq_mpoly`` in x1, ..., xD."""
        x = polynomial_ring(self.dimension, flint.fmpq_mpoly_ctx).gens()
        return self._at(np.fromiter(x, object), np.frompyfunc(fmpq, 1, 1))

    def __call__(self, point: Any) -> Point:
        """Return the field at a point, exactly."""
        return self._at(exact_array("point", point, (self.dimension,)), np.asarray)

    def _at(self, x: Any, numbers: Callable[[Any], Any]) -> tuple[Any, ...]:
        coefficients = (self.quadratic, self.linear, self.constant)
        q, l, c = (numbers(np.array(each, object)) for each in coefficients)
        return tuple(q @ x @ x + l @ x + c)

    def __repr__(self) -> str:
        equations = (f"x{i}' = {each}" for i, each in enumerate(self.components, start=1))
        return f"QuadraticField({textwrap.shorten(', '.join(equations), 300, placeholder=' ...')})"


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
    """A map over the rationals, or modulo a prime p; divisions by 0 raise `ZeroDivisionError`.

    A step solves the linear equations A(x) x~ = b(x).
    """

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

    Raises
    ------
    TypeError, ValueError
        If `field` or `eps` is not as above.

    Examples
    --------
    >>> from suslov_fast.integrability import QuadraticField, kahan
    >>> map = kahan(QuadraticField([[[1]]]), eps=1)  # x' = x**2
    >>> [str(x) for x in map([2])], [str(x) for x in map.inverse([-2])]
    (['-2'], ['2'])
    """
    instance("field", field, QuadraticField)
    return KahanMap(field, exact_array("eps", eps, ()).item())
