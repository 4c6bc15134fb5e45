"""Birational maps, exact: what Kahan maps and other maps have in common."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import flint

from ..checks import wrong
from .exact import (
    Point,
    Residues,
    degree_of,
    factors,
    fmpq,
    fraction,
    modulo,
    random_prime,
    rationals,
    ring,
    size,
    value_at,
)
from .functions import RationalFunction, exact_quotient, product_of
from .reconstruction import over_rationals, polynomials_with

TERMS = 100_000  # of the largest polynomial that is written out
_SPARSE = 100  # terms of a component; of sparse maps all polynomials are


class BirationalMap:
    """A map whose components are F_i / F_0, with polynomials F in x without a common factor."""

    dimension: int
    has_letter = False  # whether eps is a letter
    inverse: BirationalMap | None = None

    def steps(self, p: int | None, eps: int = 0) -> Any:
        """Return the `Steps` modulo a prime, with a number for eps if it is a letter.

        For None, they are those over the rationals, or polynomials.
        """
        raise NotImplementedError

    def _parts_of_determinant(self) -> Iterator[tuple[Any, int]]:
        """Yield polynomials, None for one that is too long, and powers: F_0, and of det DPhi."""
        raise NotImplementedError

    @property
    def why_none(self) -> str:
        """Say why there is no map, if there is none."""
        return ""

    def __call__(self, point: Any) -> tuple[Any, ...]:
        """Return the image of a point, exactly; functions of eps if it is a letter."""
        x = rationals("point", point, self.dimension)
        if not self.has_letter:
            return tuple(map(fraction, self._at(x, self.steps(None).image)[:-1]))
        scale = math.lcm(*(a.denominator for a in x))
        constants = [self.ring.constant(int(a * scale)) for a in (*x, Fraction(1))]
        *above, below = self.steps(None).forms(constants)
        return tuple(exact_quotient(a, below) for a in above)

    def jacobian(self, point: Any) -> tuple[Point, ...]:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        x = rationals("point", point, self.dimension)
        rows = self._at(x, self.steps(None).derivative).tolist()
        return tuple(tuple(map(fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        x = rationals("point", point, self.dimension)
        return fraction(self._at(x, self.steps(None).derivative).det())

    def _at(self, x: Point, method: Any) -> Any:
        if self.has_letter:
            raise TypeError("eps: expected a number here, as in map.subs(eps=Fraction(1, 3))")
        try:
            return method([fmpq(a) for a in (*x, 1)])
        except ZeroDivisionError:
            where = ", ".join(map(str, x))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None

    @cached_property
    def ring(self) -> Any:
        """The ring of polynomials in x, and eps if it is a letter."""
        return ring(self.dimension, self.has_letter)

    @property
    def variables(self) -> list[Any]:
        """The variables x1, ..., xD and 1."""
        return [*self.ring.gens()[self.has_letter :], self.ring.constant(1)]

    @cached_property
    def forms(self) -> list[Any]:
        """The polynomials F_1, ..., F_D, F_0."""
        return list(self.steps(None).reduced(self.variables))

    @cached_property
    def degree(self) -> int:
        """The degree of the map of projective space."""
        return max(map(degree_of, self.forms))

    def writes_out(self, degree: int) -> bool:
        """Return True if the pullback of a polynomial is not too long to be written out."""
        terms = math.comb(self.dimension + degree * self.degree, self.dimension)
        eps = 1 + max(int(F.degrees()[0]) for F in self.forms) if self.has_letter else 1
        return terms * eps <= TERMS or max(map(len, self.forms)) <= _SPARSE

    def pullback(self, P: Any, degree: int) -> Any:
        """Return F_0^degree P(F / F_0)."""
        k = int(self.has_letter)
        whole = ring(self.dimension + 1, self.has_letter)
        terms = {(*e, degree - sum(e[k:])): c for e, c in P.to_dict().items()}
        return whole.from_dict(terms).compose(*self.ring.gens()[:k], *self.forms, ctx=self.ring)

    @cached_property
    def is_invertible(self) -> bool:
        """True if det DPhi is not 0 at a random point modulo a prime."""
        rng = random.Random(0)
        steps = self.steps(random_prime(rng), rng.getrandbits(60))
        x = steps.point([rng.getrandbits(60) for _ in range(self.dimension)])
        return bool(steps.derivative(x).det() != 0)

    @cached_property
    def _determinant(self) -> list[tuple[RationalFunction, int]] | None:
        """Polynomials in factors, and powers, whose product is det DPhi; None if too long."""
        parts = [*self._parts_of_determinant()] if self.is_invertible else [(None, 0)]
        if any(P is None for P, _ in parts):
            return None
        one = self.ring.constant(1)
        return [(exact_quotient(P, one), e) for P, e in parts]

    @cached_property
    def factors(self) -> list[Any] | None:
        """The irreducible factors of F_0 and of det DPhi; None if they are too long."""
        if self._determinant is None:
            return None
        found = {str(f): f for P, _ in self._determinant for f, _ in P.factors if degree_of(f)}
        return sorted(found.values(), key=size)

    @cached_property
    def jacobian_cofactor(self) -> RationalFunction | None:
        """The determinant of the derivative, in factors; None if they are too long."""
        if self._determinant is None:
            return None
        return math.prod((P**e for P, e in self._determinant), start=RationalFunction(()))

    def cofactor(self, P: Any) -> RationalFunction | None:
        """Return C with P(Phi) = C P, a product of powers of factors; None if there is none."""
        degree, known = degree_of(P), self.factors or ()
        powers: list[int] = []

        def constant(p: int, eps: int) -> Residues:
            steps, line = self.steps(p, eps), random_line(self.dimension, p, random.Random(p))
            F, Q = steps.reduced(line), modulo(P, p, eps)
            above = value_at(Q, F, degree)
            below = value_at(Q, line, degree) * F[-1] ** degree
            powers.clear()
            for f in known:
                divisor = on_line(modulo(f, p, eps), line, degree_of(f))
                above, more = _divided(above, divisor)
                below, less = _divided(below, divisor)
                powers.append(more - less)
            above, below = (part // above.gcd(below) for part in (above, below))
            # What is left may be a power of the hyperplane at infinity, t = 0.
            left = [c for part in (above, below) for c in part.coeffs() if c]
            return [[-int(left[0] / left[1]), 1]] if len(left) == 2 else []

        rows = over_rationals(random.Random(0), constant, self.has_letter)
        if not rows:
            return None
        (c,) = rational_roots(rows[0], self.has_letter)
        own = tuple((P.project_to_context(self.ring), e) for P, e in c.factors)
        return product_of(zip(known, powers, strict=True), "") * replace(c, factors=own)


def _divided(P: Any, divisor: Any) -> tuple[Any, int]:
    """Return what is left of a polynomial in t without a divisor, and the divisor's power."""
    power = 0
    while P.degree() > 0 and P % divisor == 0:
        P, power = P // divisor, power + 1
    return P, power


def rational_roots(row: Any, letter: bool) -> list[RationalFunction]:
    """Return the rational roots of a polynomial, numbers or functions of eps."""
    (f,) = polynomials_with([row], tuple((k,) for k in range(len(row))), letter)
    *_, t = f.context().gens()
    pairs = ((g, g.derivative(int(letter))) for g, _ in factors(f) if degree_of(g) == 1)
    return [exact_quotient(slope * t - g, slope) for g, slope in pairs]


class Steps:
    """Steps of a map over the rationals, or modulo a prime p. Points are (x1, ..., xD, 1)."""

    def __init__(self, p: int | None) -> None:
        self.p = p

    def image(self, x: Sequence[Any]) -> list[Any]:
        raise NotImplementedError

    def derivative(self, x: Sequence[Any]) -> Any:
        """Return the matrix of derivatives at a point."""
        raise NotImplementedError

    def forms(self, x: Sequence[Any]) -> list[Any]:
        """Return F, up to a common factor, at homogeneous coordinates of any type."""
        raise NotImplementedError

    def reduced(self, x: Sequence[Any]) -> list[Any]:
        """Return F at polynomials, without a common factor."""
        F = self.forms(x)
        common = reduce(lambda a, b: a.gcd(b), F)
        return [each // common for each in F]

    def point(self, x: Sequence[Any]) -> list[Any]:
        return [flint.nmod(fmpq(a), self.p) for a in (*x, 1)]

    def matrix(self, rows: Any) -> Any:
        return flint.fmpq_mat(rows) if self.p is None else flint.nmod_mat(rows, self.p)

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for _ in range(length):
            yield x
            x = self.image(x)


def random_line(dimension: int, p: int, rng: random.Random) -> list[Any]:
    """Return a line modulo a prime; its parameter t is the last coordinate, 0 at infinity."""
    ends = ([rng.randrange(p), rng.randrange(p)] for _ in range(dimension))
    return [flint.nmod_poly(each, p) for each in (*ends, [0, 1])]


def on_line(P: Any, line: Sequence[Any], degree: int) -> Any:
    """Return a polynomial modulo a prime, homogeneous of a degree, on a line; t is the last."""
    p = int(line[-1].modulus())
    of = ring(1, False, flint.nmod_mpoly_ctx, modulus=p)
    by_inverse = [of.from_dict({(0,): int(x[1]), (1,): int(x[0])}) for x in line[:-1]]  # of x / t
    terms = P.compose(*by_inverse, ctx=of).to_dict()
    return flint.nmod_poly([int(terms.get((degree - k,), 0)) for k in range(degree + 1)], p)


def check_map(map: Any) -> None:
    """Raise an error for anything but a map, and for equations that define none."""
    if not isinstance(map, BirationalMap):
        expected = "a map, as kahan(field, eps) or rational_map(f, dimension) returns it"
        raise wrong("map", expected, type(map).__name__, TypeError)
    if map.why_none:
        raise ArithmeticError(f"{map} is no map: {map.why_none}")
