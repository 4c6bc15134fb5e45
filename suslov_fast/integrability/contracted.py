"""Curves that a birational map of the plane contracts, and the orbits of their images.

A contracted curve C goes to a point q, and on to points f(q), f(f(q)), ... If one of them has no
image, the singularity may be confined: a neighbourhood of C then goes to one of another curve. The
degrees of iterates follow from orders in t along a germ c + t v, with a generic point c of C: of
the common factor of the coordinates of its image, and of each contracted curve. They are computed
modulo a prime, for two germs.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any, NamedTuple

import flint

from . import arithmetic
from .growth import common_series, rational_series
from .maps import RationalMap
from .polynomials import (
    decoded,
    degree_of,
    determinant,
    homogenized,
    irreducible_factors,
    modulo,
    monomial_values,
    polynomial_ring,
    primitive,
    renamed,
    value_at,
)
from .reducible import count_factors

_TERMS = 8, 32, 128, 512, 2048, 8192, 32768  # of power series in t, until they suffice
_ENOUGH = 128  # for endless passages whose orders show a rule
_RULE = 20  # steps that show a rule, if there is one
_LINES = 20  # on which a point of a curve is sought
_PRIMES = 80
_BITS = 31  # of a prime: python-flint 0.9 cannot sort factors with larger coefficients


class Passage(NamedTuple):
    """The orders of a germ across a contracted curve, step by step.

    After k steps the germ is at a point if k < `steps`; then it crosses a curve again, or `steps`
    is None if it does not within the steps that were computed. `common_orders[k - 1]` is the order
    of the common factor of the next image, `curve_orders[k - 1]` those of the contracted curves, up
    to the last point without an image. If such points come again and again, the passage is
    `endless`, and has the orders of all steps that were computed.
    """

    common_orders: tuple[int, ...]
    curve_orders: tuple[tuple[int, ...], ...]
    steps: int | None
    endless: bool = False

    @property
    def series(self) -> list[tuple[Sequence[int], Sequence[int]]] | None:
        """Polynomials P, Q with P / Q = sum of orders z^k: of `common_orders`, and of each curve.

        None if the passage is endless and its orders show no such quotient.
        """
        if not self.endless:
            return [(orders, (1,)) for orders in self._sequences]
        # Orders that grow fast are known for a few steps only, which suffice for all together.
        return self.own_series or common_series(self._sequences)  # type: ignore[return-value]

    @property
    def own_series(self) -> list[tuple[Sequence[int], Sequence[int]]] | None:
        """P and Q of an endless passage if the orders show them, each sequence by itself."""
        quotients = [rational_series(orders) for orders in self._sequences]
        return None if None in quotients else quotients  # type: ignore[return-value]

    @property
    def _sequences(self) -> list[tuple[int, ...]]:
        of_curves = zip(*self.curve_orders, strict=True)
        return [(0, *orders) for orders in (self.common_orders, *of_curves)]


class Plane:
    """A birational map of the plane in homogeneous coordinates, and the curves it contracts."""

    def __init__(self, map: RationalMap) -> None:
        self.map, self.symbolic, self.degree = map, map.is_symbolic, map.degree
        self.ring = polynomial_ring(3, self.symbolic)
        x = self.ring.gens()[self.symbolic :]
        self.forms = [homogenized(F, self.degree, x, self.ring) for F in map.forms]
        derivatives = [[F.derivative(self.symbolic + j) for j in range(3)] for F in self.forms]
        powers = irreducible_factors(determinant(derivatives)) if self.degree > 1 else []
        self.curves = [P for P, _ in powers if degree_of(P)]
        self.degrees = [degree_of(P) for P in self.curves]

    def text(self, number: int) -> str:
        """Return the equation of a curve."""
        P = renamed(self._affine(number), self.map.names, self.map.letter)
        return "the line at infinity" if P == 1 else decoded(f"{P} = 0")

    def count(self, number: int) -> int:
        """Return the number of conjugate curves."""
        return max(1, count_factors(self._affine(number)))

    def _affine(self, number: int) -> Any:
        ring = self.map.ring
        return primitive(self.curves[number].compose(*ring.gens(), ring.constant(1), ctx=ring))


class PlaneModulo:
    """The forms and curves of a `Plane` modulo a prime, and at a number in place of eps."""

    def __init__(self, plane: Plane, p: int, eps: int, seed: int) -> None:
        self.p, self.rng = p, random.Random(seed)
        self.forms = [modulo(F, p, eps) for F in plane.forms]
        self.curves = [modulo(C, p, eps) for C in plane.curves]
        # The monomials that forms and curves have in common are evaluated once.
        terms = [P.to_dict() for P in (*self.forms, *self.curves)]
        self._monomials = tuple({e: None for of_one in terms for e in of_one})
        self._terms = [[(e, int(c)) for e, c in of_one.items()] for of_one in terms]

    def component(self, number: int) -> Any:
        """Return a factor of a curve on which there are points with coordinates modulo p, if any.

        Conjugate lines are one curve over the rationals; their points go to different points.
        """
        P = self.curves[number]
        if P == 0:
            return None
        for factor, _ in sorted(P.factor()[1], key=lambda f: int(f[0].total_degree())):
            if factor.total_degree() > 0 and self.germ(factor) is not None:
                return factor
        return None

    def germ(self, component: Any) -> list[Any] | None:
        """Return a germ across a component at a random point: three polynomials in t.

        The point is where a random line meets the component.
        """
        p = self.p
        for _ in range(_LINES):
            ends = [(self.rng.randrange(p), self.rng.randrange(p)) for _ in range(3)]
            on_line = value_at(component, [flint.nmod_poly([*end], p) for end in ends])
            if on_line.degree() < 1:
                continue
            for factor, power in on_line.factor()[1]:
                if factor.degree() == 1 and power == 1:
                    root = int(-factor[0] / factor[1])
                    point = [a + b * root for a, b in ends]
                    return [flint.nmod_poly([c, self.rng.randrange(p)], p) for c in point]
        return None

    def step(
        self, germ: Sequence[Any], terms: int
    ) -> tuple[list[Any], int, tuple[int, ...]] | None:
        """Return the next germ, the order of its common factor, and those of contracted curves.

        None if all terms of the next germ are 0. Orders of curves are at most the number of terms.
        """
        values = monomial_values(self._monomials, germ)
        by_monomial = dict(zip(self._monomials, values, strict=True))
        series = [
            sum((c * by_monomial[e] for e, c in of_one), 0 * germ[0]) for of_one in self._terms
        ]
        image, curve_orders = series[:3], tuple(_order(P, terms) for P in series[3:])
        common_order = min(_order(P, terms) for P in image)
        if common_order == terms:
            return None
        divided = [flint.nmod_poly(P.coeffs()[common_order:terms], self.p) for P in image]
        return divided, common_order, curve_orders

    def passage(self, component: Any, most: int) -> Passage | None:
        """Return the passage of a germ across a curve; None if two germs disagree."""
        for terms in _TERMS:
            germs = [self.germ(component) for _ in range(2)]
            if None in germs:
                return None
            passage = self._follow(germs, terms, most)
            if passage is None or not passage.endless:
                return passage
            shows_all = len(passage.common_orders) >= _RULE or passage.own_series is not None
            if terms >= _ENOUGH and shows_all:
                return passage
        return passage

    def _follow(self, germs: Any, terms: int, most: int) -> Passage | None:
        """Return the passage of two germs, endless if there are too few terms."""
        common_orders: list[int] = []
        curve_orders: list[tuple[int, ...]] = []
        exact = 0  # steps whose orders of curves are less than the number of terms
        steps: int | None = None
        has_terms = True
        for k in range(most + 1):
            if k and not self._at_one_point(*germs):
                steps = k
                break
            first, second = (self.step(germ, terms) for germ in germs)
            if first is None or second is None:
                has_terms = False
                break
            if first[1:] != second[1:]:
                return None
            germs, order, orders = (first[0], second[0]), first[1], first[2]
            if k:
                if exact == k - 1 and max(orders) < terms:
                    exact = k
                common_orders.append(order)
                curve_orders.append(orders)
            terms -= order
        # After k = last steps the germ is at the last point without an image.
        last = max((k for k, order in enumerate(common_orders, start=1) if order), default=0)
        never_stops = steps is None and last > len(common_orders) // 2
        if not has_terms or last > exact or never_stops:
            orders_known = tuple(common_orders[:exact]), tuple(curve_orders[:exact])
            return Passage(*orders_known, None, endless=True)
        return Passage(tuple(common_orders[:last]), tuple(curve_orders[:last]), steps)

    def _at_one_point(self, first: Sequence[Any], second: Sequence[Any]) -> bool:
        """Return True if two germs begin at the same point."""
        a, b = ([int(P[0]) for P in germ] for germ in (first, second))
        return all((a[i] * b[j] - a[j] * b[i]) % self.p == 0 for i, j in ((0, 1), (0, 2), (1, 2)))


def _order(P: Any, terms: int) -> int:
    """Return the order of a power series, or the number of terms if they are all 0."""
    return next((k for k, c in enumerate(P.coeffs()[:terms]) if c), terms)


def passages_across(plane: Plane, most: int, seed: int) -> list[Passage] | None:
    """Return the passages across all contracted curves, of which two primes have the same.

    None if no primes show them.
    """
    rng, numbers = plane.map.generator(seed), range(len(plane.curves))
    by_prime: list[list[Passage]] = [[] for _ in numbers]
    for _ in range(_PRIMES):
        p = arithmetic.random_prime(rng, _BITS)
        residues = PlaneModulo(plane, p, rng.randrange(2, p), rng.getrandbits(30))
        for number in numbers:
            if _agree(by_prime[number]) or (component := residues.component(number)) is None:
                continue
            if (passage := residues.passage(component, most)) is not None:
                by_prime[number].append(passage)
        if all(map(_agree, by_prime)):
            return [passages[-1] for passages in by_prime]
    return None


def _agree(passages: list[Passage]) -> bool:
    """Return True if the last passage is one that another prime has shown."""
    return bool(passages) and passages[-1] in passages[:-1]
