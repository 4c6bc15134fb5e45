"""Darboux polynomials of a cofactor, and the cofactors that have some."""

import math
import random
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import lru_cache
from typing import Any

import flint
import numpy as np

from ..checks import integer, wrong
from . import exact
from .exact import MORE, Polynomials, Residues, degree_of, modulo, monomial_values
from .functions import RationalFunction, factored, product_of
from .maps import TERMS, RationalMap, check_map, on_line, random_line, rational_roots
from .reconstruction import over_rationals, polynomials_with


def darboux_polynomials(
    map: RationalMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) (arXiv:1902.04715).

    For the default cofactor, 1 / P is the density of an invariant measure. For any cofactor,
    quotients of two such polynomials are first integrals. The equations are those of random points
    modulo a prime, 10 more than unknowns; the solution is confirmed modulo another prime.

    Parameters
    ----------
    map : KahanMap or RationalMap
        Made by `kahan` or `rational_map`.
    degree : int
        Largest degree of P.
    cofactor : number, RationalFunction or callable, optional
        C: a rational number, a function that `cofactors` found, or, unless eps is a letter, one of
        a tuple of fractions that returns a rational number. By default ``map.determinant``.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    tuple of flint.fmpz_mpoly
        A basis of these polynomials in x1, ..., xD, whose coefficients have no common factor.

    Raises
    ------
    ArithmeticError
        If there is no map, or the cofactor is undefined at random points.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Suslov3D
    >>> from suslov_fast.integrability import darboux_polynomials, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> for P in darboux_polynomials(map, 3):
    ...     print(P.factor())
    (1, [(2*x1 + x2, 1), (4*x1^2 + x2^2, 1)])
    (1, [(2*x1 + x2, 1), (x1*x2 + 1024, 1)])
    """
    check_map(map)
    degree = integer("degree", degree, 0)
    exact.check_unknowns("degree", degree, map.dimension)
    rng = random.Random(integer("seed", seed, 0))
    if cofactor is not None and not callable(cofactor):
        cofactor = RationalFunction((), exact.rational("cofactor", cofactor))
    if map.has_letter and not isinstance(cofactor, RationalFunction | None):
        raise wrong("cofactor", "a number or RationalFunction", "another function", TypeError)
    return with_cofactor(map, degree, cofactor, rng)


def cofactors(map: RationalMap, degree: int) -> tuple[RationalFunction, ...]:
    """Find the cofactors that polynomials up to a degree can have (arXiv:1902.04715).

    They are constants times products of powers of the factors of det DPhi and of the map's
    denominator: those that have a polynomial, and 1 and det DPhi.

    Parameters
    ----------
    map, degree
        As in :func:`darboux_polynomials`.

    Returns
    -------
    tuple of RationalFunction
        They can be called with a point, and are arguments of `darboux_polynomials`.

    Raises
    ------
    ArithmeticError
        If there is no map or inverse, or the factors are too long to write out.

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> from suslov_fast.integrability import cofactors, darboux_polynomials, kahan
    >>> prey = QuadraticField.from_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
    >>> map = kahan(prey, eps=1)
    >>> for C in cofactors(map, 1):
    ...     print(C, darboux_polynomials(map, 1, C))
    1 (1,)
    -(3*x1 + x2 + 1)*(3*x1 + x2 - 9)/(x1 - 3*x2 - 3)^2 ()
    (3*x1 + x2 - 9)/(x1 - 3*x2 - 3) (x1,)
    -(3*x1 + x2 + 1)/(x1 - 3*x2 - 3) (x2,)
    """
    check_map(map)
    degree = integer("degree", degree, 0)
    exact.check_unknowns("degree", degree, map.dimension)
    one = RationalFunction(())
    found = [C for k in range(1, degree + 1) for C in cofactors_of(map, k)]
    return tuple(dict.fromkeys([one, map.jacobian_cofactor or one, *found]))


def with_cofactor(map: RationalMap, degree: int, cofactor: Any, rng: random.Random) -> Polynomials:
    """Return a basis of the polynomials up to a degree that have a cofactor, None for det DPhi."""

    def search(p: int, eps: int) -> Residues:
        here, images = _at_points(map, degree, cofactor, p, eps)
        space = exact.null_space(images - here)
        if map.has_letter and space:  # formulas without LLL: pivots are monomials of low degree
            return exact.integer_rows(flint.nmod_mat(space, p).rref()[0])
        return space

    rows = over_rationals(rng, search, map.has_letter)
    if rows is None:
        raise ArithmeticError("the coefficients are too long")
    return polynomials_with(rows, exact.exponents_up_to(degree, map.dimension), map.has_letter)


def _at_points(map: RationalMap, degree: int, cofactor: Any, p: int, eps: int) -> tuple[Any, Any]:
    """Return monomials at random points, times the cofactor, and at their images, in rows."""
    points, monomials, images = _random_points(map, degree, p, eps)
    value = _modulo(cofactor, map.at(eps), p, eps)
    try:
        values = [value(x) for x in points]
    except ZeroDivisionError:
        raise ArithmeticError("the cofactor is undefined at random points") from None
    here = [[c * a for a in row] for c, row in zip(values, monomials, strict=True)]
    return flint.nmod_mat(here, p), flint.nmod_mat(images, p)


@lru_cache(maxsize=32)
def _random_points(map: RationalMap, degree: int, p: int, eps: int) -> tuple[Any, Any, Any]:
    """Return random points, and the monomials at them and at their images, for all cofactors."""
    n, rng, now = map.dimension, random.Random(p), map.at(eps)
    exponents = exact.exponents_up_to(degree, n)
    points = [exact.random_point(n, p, rng) for _ in range(len(exponents) + MORE)]
    monomials = [monomial_values(exponents, x).tolist() for x in points]
    images = [monomial_values(exponents, now.image(x)).tolist() for x in points]
    return points, monomials, images


def _modulo(cofactor: Any, map: RationalMap, p: int, eps: int) -> Callable[[list[Any]], Any]:
    """Return a cofactor, None for det DPhi, as a function of points modulo a prime."""
    if cofactor is None:
        return lambda x: map.derivative(x).det()
    if isinstance(cofactor, RationalFunction):
        powers = [(modulo(P, p, eps), e) for P, e in cofactor.factors]
        constant = flint.nmod(exact.fmpq(cofactor.constant), p)
        return lambda x: math.prod(
            (flint.nmod(P(*x[:-1]), p) ** e for P, e in powers), start=constant
        )

    def value(x: list[Any]) -> Any:
        found = cofactor(tuple(Fraction(int(a)) for a in x[:-1]))
        if isinstance(found, float):
            raise wrong("cofactor", "exact numbers", "float", TypeError)
        return flint.nmod(exact.fmpq(exact.rational("cofactor", found)), p)

    return value


def cofactors_of(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield the cofactors of polynomials up to a degree; the factors of the map must be known.

    Such a polynomial is an eigenvector of its pullback divided by powers of the factors.
    """
    if map.factors is None:
        expected = f"a map with an inverse and factors of det DPhi of at most {TERMS} terms"
        raise ArithmeticError(f"expected {expected}")
    below = factored(map.forms[-1]) ** -degree
    divisors = _Divisors(map, degree, random.Random(degree))
    everything = flint.nmod_mat(np.eye(len(divisors.monomials), dtype=int).tolist(), divisors.p)
    for powers in divisors.powers(everything, degree * (map.degree - 1)):
        cofactor = product_of(zip(map.factors, powers, strict=True), Fraction(1)) * below

        def search(p: int, eps: int, cofactor: Any = cofactor) -> Residues:
            pullback = _pullback(*_at_points(map, degree, cofactor, p, eps))
            return [[int(c) for c in pullback.minpoly().coeffs()]] if pullback else []

        rows = over_rationals(random.Random(degree), search, map.has_letter)
        for c in rational_roots(rows[0], map.ring) if rows else ():
            yield c * cofactor


def _pullback(here: Any, images: Any) -> Any:
    """Return the matrix of the pullback on the largest space it takes to itself; None for 0.

    Rows are points, columns are polynomials, at the points and at their images.
    """
    while True:
        n, p, both = here.ncols(), here.modulus(), zip(here.tolist(), images.tolist(), strict=True)
        reduced, rank = flint.nmod_mat([a + b for a, b in both], p).rref()
        pulled = [row[n:] for row in reduced.tolist()[:rank]]
        if rank == n:
            return flint.nmod_mat(pulled, p)
        if not (columns := exact.null_space(flint.nmod_mat(pulled[n:], p))):
            return None
        chosen = flint.nmod_mat(columns, p).transpose()
        here, images = here * chosen, images * chosen


class _Divisors:
    """Products of factors that divide pullbacks of polynomials of a degree, modulo a prime.

    Columns are monomials. The equations are those of polynomials in the parameter t of random
    lines, whose points at infinity have t = 0.
    """

    def __init__(self, map: RationalMap, degree: int, rng: random.Random) -> None:
        self.map, self.p, self.rng = map, exact.random_prime(rng), rng
        eps = rng.randrange(2, self.p)
        self.now = map.at(eps)
        exponents = exact.exponents_up_to(degree, map.dimension)
        self.monomials = [(*e, degree - sum(e)) for e in exponents]
        infinity = map.ring.constant(1)  # its value on a line is t
        factors = [infinity, *(map.factors or ())]
        self.degrees = [1, *(degree_of(f) for f in factors[1:])]
        self.factors = [modulo(P, self.p, eps) for P in factors]
        self.exceptional = exceptional_factors(map)
        self.lines: list[tuple[list[Any], list[Any]]] = []
        self.equations: dict[tuple[int, int], Any] = {}

    def _add_line(self) -> None:
        """Add the monomials at the image of a random line, and the factors on it."""
        line = random_line(self.map.dimension, self.p, self.rng)
        factors = [on_line(P, line, k) for P, k in zip(self.factors, self.degrees, strict=True)]
        images = monomial_values(self.monomials, self.now.reduced(line))
        self.lines.append((list(images), factors))

    def _equations(self, i: int, power: int) -> Any:
        """Return equations for the polynomials whose pullback has factor i to this power."""
        rows: Residues = []
        k = 0
        while len(rows) <= 2 * len(self.monomials):
            if k == len(self.lines):
                self._add_line()
            images, factors = self.lines[k]
            divisor = factors[i] ** power
            remainders = [f % divisor for f in images]
            rows += [[f[j] for f in remainders] for j in range(divisor.degree())]
            k += 1
        return flint.nmod_mat(rows, self.p)

    def _divisible(self, basis: Any, i: int, power: int) -> Any:
        """Return the combinations of columns that have factor i to this power; None if only 0."""
        if (i, power) not in self.equations:
            self.equations[i, power] = self._equations(i, power)
        columns = exact.null_space(self.equations[i, power] * basis)
        return basis * flint.nmod_mat(columns, self.p).transpose() if columns else None

    def powers(
        self, basis: Any, left: int, known: tuple[int, ...] = ()
    ) -> Iterator[tuple[int, ...]]:
        """Yield the powers of factors, after those known, in products whose degrees add up."""
        if (i := len(known)) == len(self.degrees):
            if left == 0:
                yield known[1:]
            return
        # If others were allowed, any of them that goes to another one would have a cofactor.
        most = left // self.degrees[i] if self.exceptional[i] else 0
        for power in range(most + 1):
            reduced = self._divisible(basis, i, power) if power else basis
            if reduced is None:
                break
            yield from self.powers(reduced, left - power * self.degrees[i], (*known, power))


def exceptional_factors(map: RationalMap) -> list[bool]:
    """Return which of the hyperplane at infinity and the factors have a lower-dimensional image.

    They divide the Jacobian determinant of F in homogeneous coordinates, F_0^(D + 1) det DPhi.
    """
    below: Any = factored(map.forms[-1])
    found = (below ** (map.dimension + 1) * map.jacobian_cofactor).factors
    left = (map.dimension + 1) * (map.degree - 1) - sum(e * degree_of(f) for f, e in found)
    return [left > 0, *(f in [g for g, _ in found] for f in map.factors or ())]
