"""Base points of a pencil of plane curves P = h Q, and the genus of its general member.

After a random change of coordinates the resultant of P and Q is a polynomial in one coordinate u,
and each of its roots belongs to one base point: an irreducible factor to conjugate points, with
coordinates in the number field Q[u] / factor. The general member has no singular points but base
points (Bertini). A point of multiplicity m lowers the genus by m (m - 1) / 2, and so do points that
lie infinitely near, which blowing up shows where the members have a common double tangent.
"""

import random
from collections.abc import Iterator, Sequence
from itertools import count
from math import comb
from typing import Any, NamedTuple

import flint

from . import polynomials
from .polynomials import coefficients_in, coprime, degree_of, irreducible_factors, letters_of
from .rational_functions import RationalFunction, factored
from .tolerances import MEMBERS_COMPARED, MOST_CHANGES_OF_COORDINATES, MOST_POINTS_NEAR_A_POINT


class Points(NamedTuple):
    """Conjugate base points, with homogeneous coordinates in Q[r] / `root` or in letters."""

    coordinates: list[Any] | None  # polynomials in r, or in letters if `root` is None
    root: Any  # the polynomial with the roots r; None for a rational point
    number: int  # of conjugate points
    intersection: int  # of two members at each point
    loss: int | None  # by which each point lowers the genus; None if unknown
    multiplicity: int | None  # of the general member at each point


def points_of(P: Any, Q: Any) -> list[Points]:
    """Return the base points of P = h Q, for polynomials without a common factor."""
    degree, names = max(map(degree_of, (P, Q))), letters_of(P.context())
    rng = random.Random(0)
    ring = P.context()
    u, v = ring.gens()[-2:]
    for _ in range(MOST_CHANGES_OF_COORDINATES):
        rows = [[rng.randrange(-9, 10) for _ in range(3)] for _ in range(3)]
        if flint.fmpz_mat(rows).det() == 0:
            continue
        forms = [a * u + b * v + c for a, b, c in rows]
        f, g = (polynomials.homogenized(F, degree, forms, ring) for F in (P, Q))
        eliminated = f.resultant(g, ring.names()[-1])
        if degree_of(eliminated) < degree**2:  # a point is at infinity in these coordinates
            continue
        factors = [(a, m) for a, m in irreducible_factors(eliminated) if degree_of(a)]
        found = [_points(f, g, rows, factor, m, bool(names)) for factor, m in factors]
        if None not in found:
            return found  # type: ignore[return-value]
    raise ArithmeticError("base points were not found")


def _points(f: Any, g: Any, rows: Any, factor: Any, m: int, has_letters: bool) -> Points | None:
    """Return the points with the coordinate u a root of `factor`; None if one u has several."""
    number = degree_of(factor)
    if not has_letters:
        return NumberField(_in_u(factor)).points(f, g, rows, m)
    # If both curves had a double point, their intersection number would be at least 4.
    if number > 1:
        return Points(None, factor, number, m, *((0, 1) if m < 4 else (None, None)))
    minus, slope = coefficients_in(factor, -2)
    common = _substituted(f, -minus, slope).gcd(_substituted(g, -minus, slope))
    roots = [each for each, _ in irreducible_factors(common) if degree_of(each)]
    if len(roots) != 1 or degree_of(roots[0]) != 1:
        return None
    minus_v, slope_v = coefficients_in(roots[0], -1)
    at = [-minus * slope_v, -minus_v * slope, slope * slope_v]
    coordinates = coprime([sum(a * x for a, x in zip(row, at, strict=True)) for row in rows])
    order = (
        1 if m < 4 else min(_multiplicity(F, [minus, slope], [minus_v, slope_v]) for F in (f, g))
    )
    # If m = order^2, the curves have no common tangent there, and different tangents.
    loss = order * (order - 1) // 2 if order == 1 or m == order**2 else None
    return Points(coordinates, None, 1, m, loss, order)


def _multiplicity(f: Any, of_u: Any, of_v: Any) -> int:
    """Return the multiplicity of f = 0 at a point with c + d u = 0 for (c, d) = `of_u`, and v."""
    derivatives, place = [f], len(letters_of(f.context()))
    for order in count():
        values = (_substituted(D, -of_u[0], of_u[1]) for D in derivatives)
        if any(_substituted(P, -of_v[0], of_v[1], -1) != 0 for P in values):
            return order
        derivatives = [D.derivative(place + i) for D in derivatives for i in range(2)]
    raise AssertionError


def _substituted(f: Any, numerator: Any, denominator: Any, place: int = -2) -> Any:
    """Return f for u (or v) = numerator / denominator, times a power of the denominator."""
    coefficients = coefficients_in(f, place)
    n = len(coefficients) - 1
    terms = (c * numerator**k * denominator ** (n - k) for k, c in enumerate(coefficients))
    return sum(terms, 0 * f)


def _in_u(P: Any) -> Any:
    """Return a polynomial in u alone."""
    return flint.fmpq_poly([int(c.coeffs()[0]) if c != 0 else 0 for c in coefficients_in(P, 0)])


def function_of_root(a: Any, name: str) -> RationalFunction:
    """Return a polynomial in a root r, with rational coefficients, as a function of `name`."""
    ring = polynomials.polynomial_ring(0, (name,))
    terms = {(k,): int((c * a.denom()).p) for k, c in enumerate(a.coeffs()) if c}
    return (factored(ring.from_dict(terms)) / int(a.denom())).renamed(None, name)


Local = dict[tuple[int, int], Any]  # a polynomial at a point: {(i, j): coefficient of u^i v^j}


class NumberField:
    """The number field Q[r] / `root`; its elements are polynomials in r."""

    def __init__(self, root: Any) -> None:
        self.root, self.degree = root, root.degree()
        self.r = flint.fmpq_poly([0, 1]) % root

    def inverse(self, a: Any) -> Any:
        return a.xgcd(self.root)[1] % self.root

    def value(self, coefficients: Sequence[Any], x: Any) -> Any:
        """Return the value at x of a polynomial with these coefficients, lowest first."""
        total = flint.fmpq_poly([0])
        for c in reversed(coefficients):
            total = (total * x + c) % self.root
        return total

    def gcd(self, a: list[Any], b: list[Any]) -> list[Any]:
        """Return the monic greatest common divisor of two polynomials over the field."""
        a, b = _trimmed(a), _trimmed(b)
        while b:
            scale, a = self.inverse(b[-1]), [*a]
            while len(a) >= len(b):
                factor, shift = a[-1] * scale % self.root, len(a) - len(b)
                for k, c in enumerate(b):
                    a[k + shift] = (a[k + shift] - factor * c) % self.root
                a = _trimmed(a[:-1])
            a, b = b, a
        scale = self.inverse(a[-1]) if a else 0
        return [c * scale % self.root for c in a]

    def points(self, f: Any, g: Any, rows: Any, m: int) -> Points | None:
        """Return the conjugate points with u = r; None if one u has several points."""
        columns = [[self.value(_rational(c), self.r) for c in _by_v(F)] for F in (f, g)]
        common = self.gcd(*columns)
        k = len(common) - 1
        v = common[-2] * flint.fmpq(-1, k)
        power = [comb(k, j) * (-v) ** (k - j) % self.root for j in range(k + 1)]
        if power != common:
            return None
        at = [self.r, v, flint.fmpq_poly([1])]
        coordinates = [
            sum((a * x for a, x in zip(row, at, strict=True)), flint.fmpq_poly([0])) for row in rows
        ]
        pair = self._local(f, v), self._local(g, v)
        order = min(map(_order, pair))
        (new,), root = self.simplest([coordinates])
        return Points(new, root, self.degree, m, self.loss(*pair), order)

    def simplest(self, points: list[list[Any]]) -> tuple[list[list[Any]], Any]:
        """Return points in affine coordinates, with one of these as the root r if that is possible.

        The polynomial of r is None if all coordinates are rational.
        """
        n, affine = self.degree, []
        for x in points:
            scale = self.inverse(next(a for a in reversed(x) if a != 0))
            affine.append([a * scale % self.root for a in x])
        every = [a for x in affine for a in x]
        if all(a.degree() < 1 for a in every):
            return affine, None
        for x in every:
            powers = [flint.fmpq_poly([1])]
            for _ in range(n):
                powers.append(powers[-1] * x % self.root)
            matrix = flint.fmpq_mat([[P[k] for P in powers[:n]] for k in range(n)])
            if matrix.det() != 0:

                def in_powers(a: Any, matrix: Any = matrix) -> Any:
                    column = flint.fmpq_mat([[a[k]] for k in range(n)])
                    return flint.fmpq_poly(matrix.solve(column).entries())

                new = [[in_powers(a) for a in each] for each in affine]
                return new, flint.fmpq_poly([*([0] * n), 1]) - in_powers(powers[n])
        return affine, self.root

    def _local(self, F: Any, v: Any) -> Local:
        """Return F in coordinates at the point (r, v)."""
        terms: Local = {}
        for (i, j), c in F.to_dict().items():
            for a in range(int(i) + 1):
                for b in range(int(j) + 1):
                    value = int(c) * comb(i, a) * comb(j, b) * self.r ** (i - a) * v ** (j - b)
                    terms[a, b] = (terms.get((a, b), 0) + value) % self.root
        return {e: c for e, c in terms.items() if c != 0}

    def loss(self, F: Local, G: Local, depth: int = 0) -> int | None:
        """Return by how much the general member F - h G loses genus at the point 0; or None."""
        m = min(map(_order, (F, G)))
        if m < 2:
            return 0
        if depth == MOST_POINTS_NEAR_A_POINT:
            return None
        for shear in range(m + 1):  # then no common tangent is vertical
            if shear:
                F, G = (self._sheared(P) for P in (F, G))
            parts = [
                [P.get((m - j, j), flint.fmpq_poly([0])) for j in range(m + 1)] for P in (F, G)
            ]
            if parts[0][m] != 0 or parts[1][m] != 0:
                break
        double = min((self._double(parts, h) for h in range(1, MEMBERS_COMPARED)), key=len)
        total: int | None = m * (m - 1) // 2
        for slope in self._roots(double):
            if slope is None or any(not self._is_double(part, slope) for part in parts):
                return None
            F_near, G_near = (self._blown_up(P, m, slope) for P in (F, G))
            near = self.loss(F_near, G_near, depth + 1)
            total = None if near is None or total is None else total + near
        return total

    def _double(self, parts: Any, h: int) -> list[Any]:
        """Return the common divisor of the tangents of F - h G and its derivative."""
        tangents = [(a - h * b) % self.root for a, b in zip(*parts, strict=True)]
        return self.gcd(tangents, [k * c for k, c in enumerate(tangents)][1:])

    def _roots(self, P: list[Any]) -> Iterator[Any]:
        """Yield the different roots of P in the field; None if there are others."""
        if len(P) < 2:
            return
        if self.degree == 1:
            rational = flint.fmpq_poly([c[0] for c in P])
            for factor, _ in rational.factor()[1]:
                if factor.degree() > 1:
                    yield None
                else:
                    yield flint.fmpq_poly([-factor[0] / factor[1]])
            return
        k = len(P) - 1
        x = P[-2] * flint.fmpq(-1, k)
        power = [comb(k, j) * (-x) ** (k - j) % self.root for j in range(k + 1)]
        yield x if power == P else None

    def _is_double(self, part: list[Any], x: Any) -> bool:
        slopes = [k * c for k, c in enumerate(part)][1:]
        return bool(self.value(part, x) == 0 and self.value(slopes, x) == 0)

    def _sheared(self, P: Local) -> Local:
        """Return P for u + v in place of u."""
        terms: Local = {}
        for (i, j), c in P.items():
            for a in range(i + 1):
                e = a, i - a + j
                terms[e] = terms.get(e, 0) + comb(i, a) * c
        return {e: c for e, c in terms.items() if c != 0}

    def _blown_up(self, P: Local, m: int, slope: Any) -> Local:
        """Return P(u, u (v + slope)) / u^m."""
        terms: Local = {}
        for (i, j), c in P.items():
            for b in range(j + 1):
                e = i + j - m, b
                value = comb(j, b) * c * slope ** (j - b)
                terms[e] = (terms.get(e, 0) + value) % self.root
        return {e: c for e, c in terms.items() if c != 0}


def _trimmed(P: list[Any]) -> list[Any]:
    n = next((k for k in count(len(P) - 1, -1) if k < 0 or P[k] != 0), -1)
    return P[: n + 1]


def _order(P: Local) -> int:
    return min((i + j for i, j in P), default=99)


def _by_v(F: Any) -> list[Any]:
    """Return the coefficients of powers of v, polynomials in u."""
    return coefficients_in(F, -1)


def _rational(P: Any) -> list[Any]:
    """Return the coefficients of a polynomial in u as rational constants of a field."""
    return [flint.fmpq_poly([int(c.coeffs()[0]) if c != 0 else 0]) for c in coefficients_in(P, -2)]
