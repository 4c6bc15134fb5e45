"""Proofs of what becomes of a contracted curve: its singularity is confined, or never is.

`contracted` computes the orders of a passage modulo primes, at random points of the curve. Here
they are computed at its general point, with a parameter s: of a line, of one of several conjugate
lines, or of a conic. The coordinates of the germ are polynomials in s, in eps if it is symbolic,
and in r, an algebraic number: that of one of the lines, or of a point of the conic. Orders of a
curve that is no line are exact, too, if the forms have them as multiplicities at the points of the
orbit of one point. An orbit never comes to another point without an image if it is periodic modulo
a small prime, and all of its points there have images.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from typing import Any

import flint

from .contracted import Passage, Plane, PlaneModulo
from .polynomials import coefficients_in, irreducible_factors, value_at

_TERMS = 4, 8, 16, 32  # of power series in t, until they suffice
_BITS = 20_000  # of coordinates, at most
_MONOMIALS = 2_000  # of coordinates, at most
_NUMBERS = range(1, 9)  # in place of s
_SMALL_PRIMES = (5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79)
_TRIES = 3  # points and numbers in place of eps for each of these
_STEPS = 12  # of an orbit over the rationals


def is_proved(plane: Plane, number: int, passage: Passage) -> bool:
    """Return True if the orders of a passage are exact, up to its last point without an image.

    The orders modulo a prime are at least the true ones, so those that are 0 are exact.
    """
    if passage.endless:
        return False
    if not passage.common_orders:
        return passage.steps is None
    germs = _Germs(plane, number)
    if plane.degrees[number] > 1 and germs.have_multiplicities(passage):
        return True
    expected = [*zip(passage.common_orders, passage.curve_orders, strict=True)]
    for terms in _TERMS if germs.first else ():
        followed = germs.orders(terms, len(expected))
        if followed is None:
            return False
        orders, last = followed
        if orders == expected:
            return germs.begin_at_point(last) == (passage.steps is None)
    return False


class _Germs:
    """Germs across a curve, at its general point: polynomials in eps, r, s, and t as the last."""

    def __init__(self, plane: Plane, number: int) -> None:
        self._plane, self._curve = plane, plane.curves[number]
        names = ["eps"] * plane.symbolic + ["r", "s", "t"]
        self._ring = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
        *self._eps, self._r, self._s, self._t = self._ring.gens()
        self._modulus = self._r  # a polynomial with the root r and the leading coefficient 1
        degree, count = plane.degrees[number], 1
        self._point = [self._ring.constant(1)] * 3
        if degree > 1:
            self._point, count = self._point_of_curve(), plane.count(number)
        gradient = self._values(self._slopes(self._curve), self._point)
        self.first: list[Any] = []  # none for curves of higher degree
        if degree == count:
            self.first = self._across_line(gradient)
        elif degree == 2:
            self.first = self._across_conic(gradient)
        if self.first and _order(self._values([self._curve], self.first, 2)[0], 2) != 1:
            self.first = []

    def _point_of_curve(self) -> list[Any]:
        """Return a point of the curve on a line; conjugate ones behave alike."""

        def on_line(unit: Any) -> list[Any]:
            return [a * unit + b * self._r for a, b in ((2, 3), (5, 7), (11, -4))]

        P = self._curve.compose(*self._eps, *on_line(self._ring.constant(1)), ctx=self._ring)
        every = (coefficients_in(f, -3) for f, _ in irreducible_factors(P))
        *lower, leading = next(coefficients for coefficients in every if len(coefficients) > 1)
        n = len(lower)
        terms = (c * leading ** (n - 1 - k) * self._r**k for k, c in enumerate(lower))
        self._modulus = sum(terms, self._r**n)  # of r times the leading coefficient
        return on_line(leading)

    def _across_line(self, line: list[Any]) -> list[Any]:
        # Two coordinates depend on s alone; the third makes line . germ a multiple of t.
        pivot = next(j for j in range(3) if line[j] != 0)
        i, j = (k for k in range(3) if k != pivot)
        u, v = 2 + 3 * self._s, 5 + 7 * self._s
        germ = [0 * self._s] * 3
        germ[i], germ[j] = line[pivot] * u, line[pivot] * v
        germ[pivot] = self._t - line[i] * u - line[j] * v
        return germ

    def _across_conic(self, gradient: list[Any]) -> list[Any]:
        # The other point of the conic on the line through a point with a direction d.
        d = [2 + 3 * self._s, 5 - self._s, 1 + 7 * self._s]
        (square,) = self._values([self._curve], d)
        slope = sum(a * b for a, b in zip(gradient, d, strict=True))
        across = (self._t, -2 * self._t, 5 * self._t)
        parts = zip(self._point, d, across, strict=True)
        return [square * a - slope * b + c for a, b, c in parts]

    def _slopes(self, P: Any) -> list[Any]:
        return [P.derivative(self._plane.symbolic + j) for j in range(3)]

    def _values(self, forms: Sequence[Any], x: Sequence[Any], terms: int = 1) -> list[Any]:
        """Return the values of forms, without powers of t from a number of terms on."""
        values = (F.compose(*self._eps, *x, ctx=self._ring) for F in forms)
        return [self._reduced(_cut(P, terms)) for P in values]

    def _reduced(self, P: Any) -> Any:
        """Return a polynomial modulo that of r."""
        n = len(coefficients_in(self._modulus, -3)) - 1
        while len(coefficients := coefficients_in(P, -3)) > n:
            P -= coefficients[-1] * self._r ** (len(coefficients) - 1 - n) * self._modulus
        return P

    def orders(
        self, terms: int, steps: int
    ) -> tuple[list[tuple[int, tuple[int, ...]]], list[Any]] | None:
        """Return the orders after each step, as in a `Passage`, and the last germ.

        There are fewer steps if there are too few terms; None if coordinates become too large.
        """
        germ, orders = self.first, []
        for k in range(steps + 1):
            image = self._values(self._plane.forms, germ, terms)
            order = min(_order(P, terms) for P in image)
            if order == terms:
                break
            if k:
                curves = self._values(self._plane.curves, germ, terms)
                orders.append((order, tuple(_order(P, terms) for P in curves)))
            germ, terms = without_common_factor([_divided(P, order) for P in image]), terms - order
            if _is_large(germ):
                return None
        return orders, germ

    def have_multiplicities(self, passage: Passage) -> bool:
        """Return True if forms have the orders of a passage with one base point as multiplicities.

        That is, if all of their derivatives below this order vanish at the points of the orbit.
        """
        x, steps = self._point, len(passage.common_orders)
        if any(passage.common_orders[:-1]) or passage.steps is None:
            return False
        for k in range(steps + 1):
            if k:
                orders = [*zip(self._plane.curves, passage.curve_orders[k - 1], strict=True)]
                orders += [(F, passage.common_orders[k - 1]) for F in self._plane.forms]
                for P, order in orders:
                    derivatives = [P] if order else []
                    for _ in range(order - 1):
                        derivatives = [slope for D in derivatives for slope in self._slopes(D)]
                    if any(self._values(derivatives, x)):
                        return False
            image = self._values(self._plane.forms, x)
            if not any(image) or k == steps:
                return not any(image) and k == steps
            x = without_common_factor(image)
            if _is_large(x):
                return False
        return False

    def begin_at_point(self, germ: Sequence[Any]) -> bool:
        """Return True if a germ begins at a point that does not depend on s."""
        x = [_cut(P, 1) for P in germ]
        for number in _NUMBERS:
            y = [P.compose(*self._eps, self._r, number + 0 * self._s, self._t) for P in x]
            if any(y):
                pairs = ((0, 1), (0, 2), (1, 2))
                return all(self._reduced(x[i] * y[j] - x[j] * y[i]) == 0 for i, j in pairs)
        return False


def _cut(P: Any, terms: int) -> Any:
    """Return a polynomial without powers of t from a number of terms on."""
    return P.context().from_dict({e: c for e, c in P.to_dict().items() if e[-1] < terms})


def _order(P: Any, terms: int) -> int:
    """Return the order in t, or the number of terms if all are 0."""
    return min((int(e[-1]) for e in P.monoms()), default=terms)


def _divided(P: Any, order: int) -> Any:
    """Return a polynomial divided by a power of t."""
    terms = P.to_dict().items()
    return P.context().from_dict({(*e[:-1], e[-1] - order): c for e, c in terms})


def without_common_factor(x: Sequence[Any]) -> list[Any]:
    """Divide polynomials by their common factor that does not depend on the last variable."""
    ring = x[0].context()
    common = ring.constant(0)
    for P in x:
        by_power: dict[int, dict[Any, Any]] = {}
        for e, c in P.to_dict().items():
            by_power.setdefault(int(e[-1]), {})[(*e[:-1], 0)] = c
        for terms in by_power.values():
            common = common.gcd(ring.from_dict(terms))
    return [P // common for P in x]


def _is_large(x: Sequence[Any]) -> bool:
    """Return True if coordinates have too many terms, or too long ones, to go on."""
    bits = max((int(abs(c)).bit_length() for P in x for c in P.coeffs()), default=0)
    return bits > _BITS or sum(map(len, x)) > _MONOMIALS


# Orbits that never end.


def why_never(plane: Plane, number: int, passage: Passage) -> str:
    """Return why an orbit never ends after its last point without an image; "" if unknown."""
    for p in _SMALL_PRIMES:
        rng = random.Random(p)
        for _ in range(_TRIES):
            eps = rng.randrange(1, p)
            residues = PlaneModulo(plane, p, eps, rng.randrange(99))
            if _is_periodic_modulo(residues, number, passage):
                at = f" and eps = {eps}" if plane.symbolic else ""
                return f"never, since modulo {p}{at} the orbit is periodic"
    points = [] if passage.common_orders else [*_points_of_line(plane, number, 1 + _STEPS)]
    if len({*points}) == len(points):
        return ""
    return "never, since the orbit is periodic"


def _is_periodic_modulo(residues: PlaneModulo, number: int, passage: Passage) -> bool:
    """Return True if the orbit modulo a prime is periodic, and all its points have images.

    A point of the curve modulo p at which the curve is smooth is that of one over p-adic numbers;
    if images do not vanish modulo p, they are those of the true orbit.
    """
    if any(P == 0 for P in (*residues.forms, residues.curves[number])):
        return False
    germ, terms = residues.germ(residues.curves[number]), 1 + sum(passage.common_orders)
    for expected in (0, *passage.common_orders):
        if germ is None or (step := residues.step(germ, terms)) is None:
            return False
        germ, order, _ = step
        terms -= order
        if order != expected:
            return False
    x = [P[0] for P in germ or ()]
    visited = set()
    while any(x):
        pivot = next(a for a in x if a)
        point = tuple(int(a / pivot) for a in x)
        if point in visited:
            return True
        visited.add(point)
        x = [F(*point) for F in residues.forms]
    return False


def orbit_of_line(plane: Plane, number: int, length: int | None) -> tuple[tuple[int, ...], ...]:
    """Return the first points to which a line with rational coefficients goes, without repetition.

    At most `length` points, or some. Other curves, and a symbolic eps, have none.
    """
    return tuple(dict.fromkeys(_points_of_line(plane, number, length or 1 + _STEPS)))


def _points_of_line(plane: Plane, number: int, most: int) -> Iterator[tuple[int, ...]]:
    """Yield the points to which a line goes, up to one without an image."""
    if plane.symbolic or plane.degrees[number] != 1:
        return
    line = [int(plane.curves[number].derivative(j).leading_coefficient() or 0) for j in range(3)]
    rng, x = random.Random(0), None
    while x is None:
        on_line = _cross(line, [rng.randrange(-50, 50) for _ in range(3)])
        x = _image(plane, on_line) if any(on_line) else None
    for _ in range(most):
        if x is None or max(map(abs, x)).bit_length() > _BITS:
            return
        yield x
        x = _image(plane, x)


def _image(plane: Plane, x: Sequence[int]) -> tuple[int, ...] | None:
    """Return the image of a point with integer coordinates; None if it has none."""
    y = [int(value_at(F, x)) for F in plane.forms]
    if not (common := math.gcd(*y)):
        return None
    sign = 1 if next(a for a in y if a) > 0 else -1
    return tuple(sign * a // common for a in y)


def _cross(a: Sequence[int], b: Sequence[int]) -> list[int]:
    """Return the line through two points, or the point on two lines."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
