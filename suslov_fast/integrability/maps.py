"""Birational maps, exact, x_i~ = F_i(x) / F_0(x): what Kahan maps and other maps have in common.

Images, derivatives and orbits of points of any kind of numbers, the pullback F_0**d P(F / F_0) of a
polynomial, det DPhi in factors, and the cofactors that are products of these factors.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import flint
import numpy as np

from . import arithmetic
from .arithmetic import Point, degree_of, value_at
from .functions import RationalFunction, factored
from .reconstruction import polynomials_with

TERMS = 300_000  # of the largest polynomial that is factored
LONGEST = 6.0  # seconds that a pullback may take, as estimated
_SHAPES = {0: "a point", 1: "a curve", 2: "a surface"}  # by dimension


class RationalMap:
    """A birational map, exact, with components F_i / F_0; made by `rational_map`.

    Called with a point, D rational numbers, it returns the next one, a tuple of fractions. At a
    pole, a point without an image, its methods raise `ZeroDivisionError`. `inverse` is None if it
    was not given.
    """

    has_letter = False  # whether eps is symbolic
    names: tuple[str, ...] | None = None  # of the variables, if they are not x1, ..., xD
    inverse: Any
    forms: Any  # polynomials F_1, ..., F_D, F_0 without a common factor

    def __init__(self, forms: Sequence[Any], inverse: RationalMap | None = None) -> None:
        self.dimension, self.forms, self.inverse = len(forms) - 1, list(forms), inverse

    def __repr__(self) -> str:
        *above, below = map(factored, self.forms)
        return f"rational_map({', '.join(str(F / below) for F in above)})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RationalMap) and self.__reduce__() == other.__reduce__()

    def __hash__(self) -> int:
        return hash(self.dimension)  # cheap: points are cached by map

    def __reduce__(self) -> Any:
        return RationalMap, (self.forms, self.inverse)

    def at(self, eps: int) -> RationalMap:
        """Return the map for a number eps if it is symbolic, else the map itself."""
        return self

    # Points are (x1, ..., xD, 1), of numbers of any kind.

    def homogeneous(self, x: Sequence[Any]) -> list[Any]:
        """Return F, up to a common factor, at homogeneous coordinates: numbers or polynomials."""
        return [value_at(F, x, self.degree) for F in self.forms]

    def reduced(self, x: Sequence[Any]) -> list[Any]:
        """Return F at polynomials, without a common factor."""
        return coprime(self.homogeneous(x))

    def image(self, x: Sequence[Any]) -> list[Any]:
        try:
            *above, below = self.homogeneous(x)
            return [*(a / below for a in above), x[-1] ** 0]
        except ZeroDivisionError:
            where = ", ".join(map(str, x[:-1]))
            raise ZeroDivisionError(f"({where}) has no image: it is a pole of the map") from None

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for k in range(length):
            if k:
                x = self.image(x)
            yield x

    def variations(self, x: Sequence[Any], length: int) -> Iterator[tuple[Sequence[Any], Any]]:
        """Yield the points of an orbit modulo a prime, and their derivatives by the first one."""
        p, units = int(x[0].modulus()), np.eye(self.dimension, dtype=int)
        derivative = flint.nmod_mat(units.tolist(), p)
        for y in self.orbit(x, length):
            yield y, derivative
            derivative = self.derivative(y) * derivative

    def derivative(self, x: Sequence[Any]) -> Any:
        y, columns = self.image(x), range(self.dimension)
        *above, below = ([value_at(F.derivative(i), x) for i in columns] for F in self.forms)
        rows = [[row[i] - a * below[i] for i in columns] for a, row in zip(y, above, strict=False)]
        return arithmetic.matrix(rows) * (1 / value_at(self.forms[-1], x))

    @property
    def denominator(self) -> Any:
        """The polynomial F_0, or a multiple whose factors a cofactor may have too."""
        return self.forms[-1]

    def _determinant(self) -> RationalFunction | None:
        """Return det DPhi in factors; None if they are too long."""
        # F_0^(D + 1) det DPhi is the determinant of the matrix of derivatives of F and F itself.
        n = self.dimension
        rows = [[*(F.derivative(i) for i in range(n)), F, 0] for F in self.forms]
        return factored(cramer(rows)[-1]) / factored(self.forms[-1]) ** (n + 1)

    def __call__(self, point: Any) -> tuple[Any, ...]:
        """Return the image of a point, exactly; functions of eps if it is symbolic."""
        if not self.has_letter:
            return tuple(map(arithmetic.fraction, self.image(self._numbers(point))[:-1]))
        x = arithmetic.rationals("point", point, self.dimension)
        scale = math.lcm(*(a.denominator for a in x))
        constants = [self.ring.constant(int(a * scale)) for a in (*x, Fraction(1))]
        *above, below = map(factored, self.homogeneous(constants))
        return tuple(a / below for a in above)

    def jacobian(self, point: Any) -> tuple[Point, ...]:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        rows = self.derivative(self._numbers(point)).tolist()
        return tuple(tuple(map(arithmetic.fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        return arithmetic.fraction(self.derivative(self._numbers(point)).det())

    def _numbers(self, point: Any) -> list[Any]:
        if self.has_letter:
            raise TypeError("eps is symbolic here: set it by map.subs(eps=Fraction(1, 3))")
        return [
            arithmetic.fmpq(a) for a in (*arithmetic.rationals("point", point, self.dimension), 1)
        ]

    @cached_property
    def ring(self) -> Any:
        """The ring of polynomials in x, and eps if it is symbolic."""
        return arithmetic.ring(self.dimension, self.has_letter)

    @property
    def variables(self) -> list[Any]:
        """The variables x1, ..., xD and 1."""
        return [*self.ring.gens()[self.has_letter :], self.ring.constant(1)]

    @cached_property
    def degree(self) -> int:
        """The degree of the map of projective space."""
        return max(map(degree_of, self.forms))

    def terms_of_degree(self, degree: int) -> int:
        """Return the number of terms of a polynomial of a degree in x, and in eps."""
        eps = 1 + max(int(F.degrees()[0]) for F in self.forms) if self.has_letter else 1
        return math.comb(self.dimension + degree, self.dimension) * eps

    @cached_property
    def _density(self) -> float:
        """The part of all monomials of its degree that the map has."""
        k = int(self.has_letter)
        found = {e[k:] for F in self.forms for e in F.monoms()}
        return len(found) / math.comb(self.dimension + self.degree, self.dimension)

    def cost_of_pullback(self, P: Any, degree: int) -> float:
        """Return an estimate of the seconds that the pullback of P and its factors take.

        Each term of P adds the product of a power and a form, sums of as many terms as there are
        monomials of their degree, if the map had all of its own degree, or less if it is sparse.
        """
        k, most = int(self.has_letter), self.terms_of_degree(degree * self.degree) * self._density
        exponents = ((*e[k:], degree - sum(e[k:])) for e in P.monoms())
        lengths = [len(F) for F in self.forms]
        powers = (zip(lengths, e, strict=True) for e in exponents)
        # The power t^n of t terms has as many as there are monomials of degree n in t variables.
        terms = sum(
            min(most, math.prod(math.comb(t + n - 1, n) for t, n in each)) for each in powers
        )
        return 1e-9 * terms * max(lengths)

    def pullback(self, P: Any, degree: int, at: Sequence[Any] | None = None) -> Any:
        """Return F_0^degree P(F / F_0), with F or with other polynomials `at`."""
        k = int(self.has_letter)
        whole = arithmetic.ring(self.dimension + 1, self.has_letter)
        terms = {(*e, degree - sum(e[k:])): c for e, c in P.to_dict().items()}
        return whole.from_dict(terms).compose(
            *self.ring.gens()[:k], *(at or self.forms), ctx=self.ring
        )

    @cached_property
    def is_invertible(self) -> bool:
        """True if det DPhi is not 0 at a random point modulo a prime."""
        return bool(
            self.at(arithmetic.EPS).derivative(arithmetic.random_point(self.dimension)).det() != 0
        )

    @cached_property
    def is_planar(self) -> bool:
        """True for a birational map of the plane: a map without inverse is not known to be one."""
        return self.dimension == 2 and self.is_invertible and self._has_inverse

    @property
    def _has_inverse(self) -> bool:
        return self.inverse is not None

    @property
    def shape_of_image(self) -> str:
        """The kind of the image, by its dimension: the rank of DPhi at a random point."""
        derivative = self.at(arithmetic.EPS).derivative(arithmetic.random_point(self.dimension))
        rank = int(derivative.rank())
        return _SHAPES.get(rank, f"of dimension {rank}")

    @cached_property
    def jacobian_cofactor(self) -> RationalFunction | None:
        """The determinant of the derivative, in factors; None if they are too long."""
        return self._determinant() if self.is_invertible else None

    @property
    def cost_of_factors(self) -> float:
        """An estimate of the seconds that `factors` takes."""
        return 2e-6 * self.terms_of_degree((self.dimension + 1) * (self.degree - 1))

    @cached_property
    def factors(self) -> list[Any] | None:
        """The irreducible factors of F_0 and of det DPhi; None if they are too long."""
        if self.jacobian_cofactor is None:
            return None
        powers = (*self.jacobian_cofactor.factors, *arithmetic.factors(self.denominator))
        return sorted({str(f): f for f, _ in powers if degree_of(f)}.values(), key=arithmetic.size)

    @cached_property
    def _line(self) -> tuple[Any, ...]:
        """A random line with the parameter x1, and F and the factors on this line."""
        (t, *_, one), rng = self.variables, random.Random(0)
        ends = (rng.sample(range(10**6), 2) for _ in range(self.dimension))
        line = [*(a * t + b for a, b in ends), one]
        factors = [self.pullback(f, degree_of(f), line) for f in self.factors or ()]
        return line, self.homogeneous(line), factors

    def cofactor(self, P: Any) -> RationalFunction | None:
        """Return C with P(Phi) = C P, a product of powers of factors; None if there is none."""
        degree, (line, F, factors) = degree_of(P), self._line
        above, below = self.pullback(P, degree, F), self.pullback(P, degree, line) * F[-1] ** degree
        C = RationalFunction(())
        for f, on_line in zip(self.factors or (), factors, strict=True):
            content, divisor = on_line.primitive()
            above, more = _divided(above, divisor)
            below, less = _divided(below, divisor)
            C *= RationalFunction(((f, 1),), Fraction(1, int(content))) ** (more - less)
        above, below = coprime([above, below])
        if degree_of(above) or degree_of(below):
            return None
        return C * factored(above) / factored(below)


def _divided(P: Any, divisor: Any) -> tuple[Any, int]:
    """Divide a polynomial by a divisor as often as possible; return the quotient and the power."""
    power = 0
    while degree_of(divisor) and P % divisor == 0:
        P, power = P // divisor, power + 1
    return P, power


def rational_roots(row: Any, of: Any) -> list[RationalFunction]:
    """Return the rational roots of a polynomial, numbers or functions of eps in this ring."""
    letter = arithmetic.has_letter(of.gens()[0])
    (f,) = polynomials_with([row], tuple((k,) for k in range(len(row))), letter)
    *_, t = f.context().gens()
    roots = []
    for g in (g for g, _ in arithmetic.factors(f) if degree_of(g) == 1):
        slope = g.derivative(int(letter))
        above, below = (factored(P.project_to_context(of)) for P in (slope * t - g, slope))
        roots.append(above / below)
    return roots


def random_line(dimension: int, p: int, rng: random.Random) -> list[Any]:
    """Return a line modulo a prime; its parameter t is the last coordinate, 0 at infinity."""
    ends = ([rng.randrange(p), rng.randrange(p)] for _ in range(dimension))
    return [flint.nmod_poly(each, p) for each in (*ends, [0, 1])]


def on_line(P: Any, line: Sequence[Any], degree: int) -> Any:
    """Return a polynomial modulo a prime, homogeneous of a degree, on a line; t is the last."""
    p = int(line[-1].modulus())
    of = arithmetic.ring(1, False, flint.nmod_mpoly_ctx, p)
    by_inverse = [of.from_dict({(0,): int(x[1]), (1,): int(x[0])}) for x in line[:-1]]  # of x / t
    terms = P.compose(*by_inverse, ctx=of).to_dict()
    return flint.nmod_poly([int(terms.get((degree - k,), 0)) for k in range(degree + 1)], p)


def coprime(polynomials: Sequence[Any]) -> list[Any]:
    common = reduce(lambda a, b: a.gcd(b), polynomials)
    return [each // common for each in polynomials]


def cramer(system: list[list[Any]]) -> list[Any]:
    """Return the numerators of the solution of a linear system (A | b), and det A.

    Elimination of polynomials with exact divisions (Bareiss).
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
        how = "pass kahan(field, eps) or rational_map(f, dimension)"
        raise TypeError(f"map is a {type(map).__name__}: {how}")
    now = map.at(arithmetic.EPS)
    try:
        image = now.image(arithmetic.random_point(map.dimension))
    except ZeroDivisionError:
        raise ArithmeticError(f"{map} is no map, because its equations have no solution") from None
    try:
        now.image(image)
    except ZeroDivisionError:
        shape = map.shape_of_image
        raise ArithmeticError(f"{map}: the image is {shape}, and it consists of poles") from None
