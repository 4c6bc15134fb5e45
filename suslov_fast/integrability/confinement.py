"""Proofs that the orders of a passage across a contracted curve are exact.

`contracted` computes them modulo primes, at random points of the curve. For a line with rational
coefficients they are computed again at its general point a + s b: the coordinates of the germ are
polynomials in s, and in eps if it is symbolic. For conjugate lines they are exact if the forms have
them as multiplicities at the points of the orbit, in the number field of a point of the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import flint

from .contracted import Passage, Plane
from .polynomials import coprime, irreducible_factors

_TERMS = 4, 8, 16  # of power series in t, until they suffice
_BITS = 20_000  # of the coefficients of coordinates, at most
_MONOMIALS = 2_000  # of coordinates, at most


def is_proved(plane: Plane, number: int, passage: Passage) -> bool:
    """Return True if the orders of a passage are exact, up to its last point without an image.

    The orders modulo a prime are at least the true ones, so those that are 0 are exact.
    """
    if passage.endless:
        return False
    if not passage.common_orders:
        return passage.steps is None
    if plane.degrees[number] == 1:
        return _is_exact_on_a_line(plane, number, passage)
    if any(passage.common_orders[:-1]) or passage.steps is None:
        return False
    return _is_exact_in_a_field(plane, number, passage)


# Lines: germs with polynomials in eps, s and t as coordinates.


def _is_exact_on_a_line(plane: Plane, number: int, passage: Passage) -> bool:
    germ = _germ_across_line(plane, number)
    expected = [*zip(passage.common_orders, passage.curve_orders, strict=True)]
    for terms in _TERMS:
        followed = _orders_of_line(plane, germ, terms, len(expected))
        if followed is None:
            return False
        orders, last = followed
        if orders == expected:
            return _begins_at_point(last) == (passage.steps is None)
    return False


def _germ_across_line(plane: Plane, number: int) -> list[Any]:
    """Return the germ across a line at its general point, with the parameter s."""
    names = ["eps"] * plane.symbolic + ["s", "t"]
    ring = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
    *_, s, t = ring.gens()
    line = [_coefficient_of_line(plane, number, j, ring) for j in range(3)]
    # Two coordinates depend on s alone; the third makes the product line . germ a multiple of t.
    pivot = next(j for j in range(3) if line[j] != 0)
    i, j = (k for k in range(3) if k != pivot)
    u, v = 2 + 3 * s, 5 + 7 * s
    germ = [ring.constant(0)] * 3
    germ[i], germ[j] = line[pivot] * u, line[pivot] * v
    germ[pivot] = t - line[i] * u - line[j] * v
    return germ


def _coefficient_of_line(plane: Plane, number: int, j: int, ring: Any) -> Any:
    """Return the coefficient of a coordinate in the equation of a line."""
    k = plane.symbolic
    terms = {(*e[:k], 0, 0): c for e, c in plane.curves[number].to_dict().items() if e[k + j]}
    return ring.from_dict(terms)


def _orders_of_line(
    plane: Plane, germ: list[Any], terms: int, steps: int
) -> tuple[list[tuple[int, tuple[int, ...]]], list[Any]] | None:
    """Return the orders after each step, as in a `Passage`, and the last germ.

    There are fewer steps if there are too few terms; None if coordinates become too large.
    """
    ring = germ[0].context()
    eps = ring.gens()[: plane.symbolic]
    orders = []
    for k in range(steps + 1):
        image = [_cut(F.compose(*eps, *germ, ctx=ring), terms) for F in plane.forms]
        curves = [_cut(C.compose(*eps, *germ, ctx=ring), terms) for C in plane.curves]
        order = min(_order(P, terms) for P in image)
        if order == terms:
            break
        if k:
            orders.append((order, tuple(_order(P, terms) for P in curves)))
        germ, terms = without_common_factor([_divided(P, order) for P in image]), terms - order
        if _is_large(germ):
            return None
    return orders, germ


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


def _begins_at_point(germ: Sequence[Any]) -> bool:
    """Return True if a germ begins at a point that does not depend on s."""
    first = coprime([_cut(P, 1) for P in germ])
    return all(e[-2] == 0 for P in first for e in P.monoms())


# Conjugate lines and other curves: the orbit of one point, with coordinates in its field.


def _is_exact_in_a_field(plane: Plane, number: int, passage: Passage) -> bool:
    field = _Field(plane, number)
    if field.modulus is None:
        return False
    x, steps = field.start, len(passage.common_orders)
    for k in range(steps + 1):
        if k:
            orders = [*zip(plane.curves, passage.curve_orders[k - 1], strict=True)]
            orders += [(F, passage.common_orders[k - 1]) for F in plane.forms]
            if not all(_has_multiplicity(P, order, x, field) for P, order in orders):
                return False
        image = field.values(plane.forms, x)
        is_base_point = all(a == 0 for a in image)
        if is_base_point or k == steps:
            return is_base_point and k == steps
        x = without_common_factor(image)
        if _is_large(x):
            return False
    return False


def _has_multiplicity(P: Any, order: int, x: Sequence[Any], field: _Field) -> bool:
    """Return True if all derivatives of a form below this order vanish at a point."""
    derivatives, first = [P] if order else [], P.context().nvars() - 3
    for _ in range(order - 1):
        derivatives = [D.derivative(first + j) for D in derivatives for j in range(3)]
    return all(a == 0 for a in field.values(derivatives, x))


class _Field:
    """The field of the coordinates of a point of a curve: polynomials in s modulo another one.

    Their coefficients are integers, or polynomials in eps; homogeneous coordinates need no others.
    """

    def __init__(self, plane: Plane, number: int) -> None:
        names = ["eps"] * plane.symbolic + ["s"]
        self._ring = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
        *self._eps, self._s = self._ring.gens()
        s = self._s
        self.start = [2 + 3 * s, 5 + 7 * s, 11 - 4 * s]
        self.modulus: Any = None  # of a point of one component; conjugate ones behave alike
        on_line = plane.curves[number].compose(*self._eps, *self.start, ctx=self._ring)
        for factor, _ in irreducible_factors(on_line):
            if _degree_in_s(factor) > 0:
                self.modulus = factor

    def values(self, forms: Sequence[Any], x: Sequence[Any]) -> list[Any]:
        """Return the values of forms at a point, times a common factor."""
        values = [F.compose(*self._eps, *x, ctx=self._ring) for F in forms]
        n = _degree_in_s(self.modulus)
        leading = self._coefficient(self.modulus, n)
        # Pseudo-remainders: the modulus removes the highest power of s, one after the other.
        for k in range(max(map(_degree_in_s, values), default=0), n - 1, -1):
            multiple = self._s ** (k - n) * self.modulus
            values = [leading * P - self._coefficient(P, k) * multiple for P in values]
        return values

    def _coefficient(self, P: Any, k: int) -> Any:
        """Return the coefficient of a power of s."""
        terms = {(*e[:-1], 0): c for e, c in P.to_dict().items() if e[-1] == k}
        return self._ring.from_dict(terms)


def _degree_in_s(P: Any) -> int:
    return max((int(e[-1]) for e in P.monoms()), default=-1)
