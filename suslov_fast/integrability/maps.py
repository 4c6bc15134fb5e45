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


class RationalMap:
    """A birational map, exact, with components F_i / F_0; made by `rational_map`.

    Called with a point, D rational numbers, it returns the next one, a tuple of fractions. At a
    pole, a point without an image, its methods raise `ZeroDivisionError`. `inverse` is None if it
    was not given.
    """

    has_letter = False  # whether eps is a letter
    inverse: Any
    forms: Any  # polynomials F_1, ..., F_D, F_0 without a common factor

    def __init__(self, forms: Sequence[Any], inverse: RationalMap | None = None) -> None:
        self.dimension, self.forms, self.inverse = len(forms) - 1, list(forms), inverse

    @property
    def components(self) -> tuple[str, ...]:
        """The components as text."""
        *above, below = self.forms
        return tuple(str(exact_quotient(F, below)) for F in above)

    def __repr__(self) -> str:
        return f"rational_map({', '.join(self.components)})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RationalMap) and self.__reduce__() == other.__reduce__()

    def __hash__(self) -> int:
        return hash(repr(self))

    def __reduce__(self) -> Any:
        return RationalMap, (self.forms, self.inverse)

    def steps(self, p: int | None, eps: int = 0) -> Steps:
        """Return the steps modulo a prime, with a number for eps if it is a letter.

        For None, they are those over the rationals, or polynomials.
        """
        return Steps(p, self.forms)

    @property
    def denominator(self) -> Any:
        """The polynomial F_0, or a multiple whose factors a cofactor may have too."""
        return self.forms[-1]

    def _determinant(self) -> RationalFunction | None:
        """Return det DPhi in factors; None if they are too long."""
        *above, below = self.forms
        n = self.dimension
        rows = [
            [*(F.derivative(j) * below - F * below.derivative(j) for j in range(n)), below]
            for F in above
        ]
        whole = cramer(rows)[-1] // below ** (n - 1)
        return exact_quotient(whole) * exact_quotient(below) ** (-n - 1)

    def __call__(self, point: Any) -> tuple[Any, ...]:
        """Return the image of a point, exactly; functions of eps if it is a letter."""
        if not self.has_letter:
            return tuple(map(fraction, self._at(point, "image")[:-1]))
        x = rationals("point", point, self.dimension)
        scale = math.lcm(*(a.denominator for a in x))
        constants = [self.ring.constant(int(a * scale)) for a in (*x, Fraction(1))]
        *above, below = self.steps(None).forms(constants)
        return tuple(exact_quotient(a, below) for a in above)

    def jacobian(self, point: Any) -> tuple[Point, ...]:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        rows = self._at(point, "derivative").tolist()
        return tuple(tuple(map(fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        return fraction(self._at(point, "derivative").det())

    def _at(self, point: Any, method: str) -> Any:
        x = rationals("point", point, self.dimension)
        if self.has_letter:
            raise TypeError("eps: expected a number here, as in map.subs(eps=Fraction(1, 3))")
        try:
            return getattr(self.steps(None), method)([fmpq(a) for a in (*x, 1)])
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
    def jacobian_cofactor(self) -> RationalFunction | None:
        """The determinant of the derivative, in factors; None if they are too long."""
        return self._determinant() if self.is_invertible else None

    @cached_property
    def factors(self) -> list[Any] | None:
        """The irreducible factors of F_0 and of det DPhi; None if they are too long."""
        if self.jacobian_cofactor is None:
            return None
        powers = (*self.jacobian_cofactor.factors, *factors(self.denominator))
        return sorted({str(f): f for f, _ in powers if degree_of(f)}.values(), key=size)

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

    def __init__(self, p: int | None, polynomials: Sequence[Any]) -> None:
        self.p, n = p, len(polynomials) - 1
        self.polynomials = [F if p is None else modulo(F, p, 0) for F in polynomials]
        self.gradients = [[F.derivative(i) for i in range(n)] for F in self.polynomials]
        self.degree = max(degree_of(F) for F in polynomials)

    def image(self, x: Sequence[Any]) -> list[Any]:
        *above, below = self.forms(x)
        return [*(a / below for a in above), x[-1] ** 0]

    def derivative(self, x: Sequence[Any]) -> Any:
        """Return the matrix of derivatives at a point."""
        *above, below = self.forms(x)
        *rows, last = ([value_at(f, x) for f in row] for row in self.gradients)
        return self.matrix(
            [
                [(f * below - a * g) / below**2 for f, g in zip(row, last, strict=True)]
                for row, a in zip(rows, above, strict=True)
            ]
        )

    def forms(self, x: Sequence[Any]) -> list[Any]:
        """Return F, up to a common factor, at homogeneous coordinates of any type."""
        return [value_at(F, x, self.degree) for F in self.polynomials]

    def reduced(self, x: Sequence[Any]) -> list[Any]:
        """Return F at polynomials, without a common factor."""
        return coprime(self.forms(x))

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


def coprime(polynomials: Sequence[Any]) -> list[Any]:
    """Return polynomials without their common factor."""
    common = reduce(lambda a, b: a.gcd(b), polynomials)
    return [each // common for each in polynomials]


def cramer(system: list[list[Any]]) -> list[Any]:
    """Return the numerators of the solution of a linear system (A | b), and det A.

    Elimination without fractions (Bareiss).
    """
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


def check_map(map: Any) -> None:
    """Raise an error for anything but a map, and for equations that define none."""
    if not isinstance(map, RationalMap):
        expected = "a map, as kahan(field, eps) or rational_map(f, dimension) returns it"
        raise wrong("map", expected, type(map).__name__, TypeError)
    steps, rng = map.steps(2**61 - 1, 2**40 + 7), random.Random(0)
    try:
        steps.image(steps.point([rng.randrange(2**60) for _ in range(map.dimension)]))
    except ZeroDivisionError:
        raise ArithmeticError(f"{map} is no map: its equations have no solution") from None
