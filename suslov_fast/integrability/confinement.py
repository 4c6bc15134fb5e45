"""Proofs that the orders of a passage across a contracted curve are exact.

`contracted` computes them modulo primes, at random points of the curve. Here they are computed at
its general point, with a parameter s: of a line, of one of several conjugate lines, or of a conic.
The coordinates of the germ are polynomials in s, in eps if it is symbolic, and in r, an algebraic
number: that of one of the lines, or of a point of the conic. Orders of a curve that is no line are
exact, too, if the forms have them as multiplicities at the points of the orbit of one point.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import flint

from .contracted import Passage, Plane
from .polynomials import irreducible_factors

_TERMS = 4, 8, 16, 32  # of power series in t, until they suffice
_BITS = 20_000  # of the coefficients of coordinates, at most
_MONOMIALS = 2_000  # of coordinates, at most
_NUMBERS = range(1, 9)  # in place of s


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
        factor = next(f for f, _ in irreducible_factors(P) if _degree(f, -3) > 0)
        n = _degree(factor, -3)
        leading = _coefficient(factor, -3, n)
        lower = (
            _coefficient(factor, -3, k) * leading ** (n - 1 - k) * self._r**k for k in range(n)
        )
        self._modulus = sum(lower, self._r**n)  # of r times the leading coefficient
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
        n = _degree(self._modulus, -3)
        for k in range(_degree(P, -3), n - 1, -1):
            P -= _coefficient(P, -3, k) * self._r ** (k - n) * self._modulus
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


def _degree(P: Any, variable: int) -> int:
    return max((int(e[variable]) for e in P.monoms()), default=-1)


def _coefficient(P: Any, variable: int, k: int) -> Any:
    """Return the coefficient of a power of a variable, given by its place from the end."""
    terms = {}
    for e, c in P.to_dict().items():
        if e[variable] == k:
            others = [*e]
            others[variable] = 0
            terms[*others] = c
    return P.context().from_dict(terms)


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
