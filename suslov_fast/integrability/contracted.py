"""Curves that a birational map of the plane contracts, and what becomes of them.

A contracted curve C goes to a point q, and on to points f(q), f(f(q)), ... If one of them has no
image, the singularity may be confined: a neighbourhood of C then goes to one of another curve. What
counts are orders in t along a germ c + t v, with a generic point c of C: of the common factor of
the coordinates of its image, and of each contracted curve. They are computed modulo a prime, for
two germs.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any, NamedTuple

import flint

from . import arithmetic
from .arithmetic import modulo, monomial_values, value_at
from .maps import RationalMap
from .normal_form import count_factors

_TERMS = 8, 32, 128  # of power series in t, until they suffice
_LINES = 20  # on which a point of a curve is sought
_PRIMES = 80
_BITS = 31  # of a prime: python-flint 0.9 cannot sort factors with larger coefficients


class Passage(NamedTuple):
    """The steps of a germ across a contracted curve, one after the other.

    After k steps the germ is at a point if k < `steps`; then it crosses a curve again, or `steps`
    is None if it does not within the steps that were looked at. `common[k - 1]` is the order of the
    common factor of the next image, `met[k - 1]` the orders of the contracted curves, up to the
    last point without an image. If there is no end of such points, the passage is `endless`, and
    they are those of all steps that were looked at.
    """

    common: tuple[int, ...]
    met: tuple[tuple[int, ...], ...]
    steps: int | None
    endless: bool = False


class Plane:
    """A birational map of the plane in homogeneous coordinates, and the curves it contracts."""

    def __init__(self, map: RationalMap) -> None:
        self.map, self.letter, self.degree = map, int(map.has_letter), map.degree
        k, self.ring = self.letter, arithmetic.ring(3, map.has_letter)
        self.forms = [
            self.ring.from_dict(
                {(*e, self.degree - int(sum(e[k:]))): c for e, c in F.to_dict().items()}
            )
            for F in map.forms
        ]
        slopes = [[F.derivative(k + j) for j in range(3)] for F in self.forms]
        (a, b, c), (d, e, f), (g, h, i) = slopes
        jacobian = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
        found = [P for P, _ in arithmetic.factors(jacobian)] if self.degree > 1 else []
        self.curves = [P for P in found if arithmetic.degree_of(P)]
        self.degrees = [arithmetic.degree_of(P) for P in self.curves]

    def text(self, number: int) -> str:
        """Return the equation of a curve."""
        P = arithmetic.renamed(self._affine(number), self.map.names)
        return "the line at infinity" if P == 1 else arithmetic.decoded(f"{P} = 0")

    def count(self, number: int) -> int:
        """Return the number of conjugate curves."""
        return max(1, count_factors(self._affine(number)))

    def _affine(self, number: int) -> Any:
        terms = self.curves[number].to_dict().items()
        return arithmetic.primitive(
            self.map.ring.from_dict({e[: self.letter + 2]: c for e, c in terms})
        )


class Residues:
    """The forms and curves of a plane modulo a prime, and at a number in place of eps."""

    def __init__(self, plane: Plane, p: int, eps: int, seed: int = 0) -> None:
        self.p, self.rng = p, random.Random(seed)
        self.forms = [modulo(F, p, eps) for F in plane.forms]
        self.curves = [modulo(C, p, eps) for C in plane.curves]
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
        """Return a germ across a component at a random point: three polynomials in t."""
        p = self.p
        for _ in range(_LINES):
            ends = [(self.rng.randrange(p), self.rng.randrange(p)) for _ in range(3)]
            line = [flint.nmod_poly([*end], p) for end in ends]
            on_line = value_at(component, line)
            if on_line.degree() < 1:
                continue
            for factor, power in on_line.factor()[1]:
                if factor.degree() == 1 and power == 1:
                    t = -factor[0] / factor[1]
                    return [flint.nmod_poly([a + b * int(t), self.rng.randrange(p)], p)
                            for a, b in ends]  # fmt: skip
        return None

    def step(self, x: Sequence[Any], terms: int) -> tuple[list[Any], int, tuple[int, ...]] | None:
        """Return the next germ, the order that is left out, and those of the contracted curves.

        None if there are too few terms. Orders of curves are at most their number.
        """
        # All forms and curves have these monomials in common.
        at = dict(zip(self._monomials, monomial_values(self._monomials, x), strict=True))
        values = [sum((c * at[e] for e, c in of_one), 0 * x[0]) for of_one in self._terms]
        y, met = values[:3], tuple(_order(P, terms) for P in values[3:])
        order = min(_order(P, terms) for P in y)
        if order == terms:
            return None
        return [flint.nmod_poly(P.coeffs()[order:terms], self.p) for P in y], order, met

    def passage(self, number: int, component: Any, most: int) -> Passage | None:
        """Return the passage of a germ across a curve; None if two germs disagree."""
        for terms in _TERMS:
            germs = [self.germ(component) for _ in range(2)]
            if None in germs:
                return None
            passage = self._follow(germs, terms, most)
            if passage is None or not passage.endless:
                return passage
        return passage

    def _follow(self, germs: Any, terms: int, most: int) -> Passage | None:
        """Return the passage of two germs, endless if there are too few terms."""
        common: list[int] = []
        met: list[tuple[int, ...]] = []
        steps: int | None = None
        is_short = False
        is_exact: list[bool] = []
        for k in range(most + 1):
            if k and not _same([[int(P[0]) for P in x] for x in germs], self.p):
                steps = k
                break
            both: Any = [self.step(x, terms) for x in germs]
            if None in both:
                is_short = True
                break
            (first, order, orders), (second, *other_orders) = both
            if [order, orders] != other_orders:
                return None
            if k:
                common.append(order)
                met.append(orders)
                is_exact.append(max(orders) < terms)
            germs, terms = [first, second], terms - order
        last = max((k for k, order in enumerate(common, start=1) if order), default=0)
        count = next((k for k, exact in enumerate(is_exact) if not exact), len(common))
        if is_short or last > count or (steps is None and last > len(common) // 2):
            return Passage(tuple(common[:count]), tuple(met[:count]), None, endless=True)
        return Passage(tuple(common[:last]), tuple(met[:last]), steps)


def _order(P: Any, terms: int) -> int:
    """Return the order of a power series, or the number of terms if they are all 0."""
    return next((k for k, c in enumerate(P.coeffs()[:terms]) if c), terms)


def _same(points: Sequence[Sequence[int]], p: int) -> bool:
    a, b = points
    return all((a[i] * b[j] - a[j] * b[i]) % p == 0 for i, j in ((0, 1), (0, 2), (1, 2)))


def passages_across(plane: Plane, most: int, seed: int) -> list[Passage] | None:
    """Return the passages across all contracted curves, of which two primes have the same.

    None if no primes show them.
    """
    rng, numbers = random.Random(seed), range(len(plane.curves))
    by_prime: list[list[Passage]] = [[] for _ in numbers]
    for _ in range(_PRIMES):
        p = arithmetic.random_prime(rng, _BITS)
        residues = Residues(plane, p, rng.randrange(2, p), rng.getrandbits(30))
        for number in numbers:
            if _agree(by_prime[number]) or (component := residues.component(number)) is None:
                continue
            if (passage := residues.passage(number, component, most)) is not None:
                by_prime[number].append(passage)
        if all(map(_agree, by_prime)):
            return [passages[-1] for passages in by_prime]
    return None


def _agree(passages: list[Passage]) -> bool:
    """Return True if the last passage is one that another prime has shown."""
    return bool(passages) and passages[-1] in passages[:-1]
