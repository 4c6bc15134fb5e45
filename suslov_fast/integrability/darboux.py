"""Darboux polynomials of a cofactor, and the cofactors that have some."""

import math
import random
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, lru_cache, partial
from itertools import product, takewhile
from typing import Any

import flint

from ..checks import integer, wrong
from . import arithmetic
from .arithmetic import MORE, Polynomials, Residues, degree_of, modulo, monomial_values
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
    arithmetic.check_unknowns("degree", degree, map.dimension)
    rng = random.Random(integer("seed", seed, 0))
    if cofactor is not None and not callable(cofactor):
        cofactor = RationalFunction((), arithmetic.rational("cofactor", cofactor))
    if map.has_letter and not isinstance(cofactor, RationalFunction | None):
        raise wrong("cofactor", "a number or RationalFunction", "another function", TypeError)

    def search(p: int, eps: int) -> Residues:
        here, images = (flint.nmod_mat(rows, p) for rows in at_points(p, eps))
        space = arithmetic.null_space(images - here)
        if map.has_letter and space:  # formulas without LLL: pivots are monomials of low degree
            return arithmetic.integer_rows(flint.nmod_mat(space, p).rref()[0])
        return space

    at_points = partial(_at_points, map, degree, cofactor)
    rows = over_rationals(rng, search, map.has_letter)
    if rows is None:
        raise ArithmeticError("the coefficients are too long")
    return polynomials_with(rows, arithmetic.exponents_up_to(degree, map.dimension), map.has_letter)


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
    arithmetic.check_unknowns("degree", degree, map.dimension)
    one = RationalFunction(())
    found = [C for k in range(1, degree + 1) for C in cofactors_of(map, k)]
    return tuple(dict.fromkeys([one, map.jacobian_cofactor or one, *found]))


def _at_points(map: RationalMap, degree: int, cofactor: Any, p: int, eps: int) -> tuple[Any, Any]:
    """Return monomials at random points, times the cofactor, and at their images, in rows."""
    points, monomials, images = _random_points(map, degree, p, eps)
    powers = [(modulo(P, p, eps), e) for P, e in getattr(cofactor, "factors", ())]

    def value(x: list[Any]) -> Any:
        if cofactor is None:
            return map.at(eps).derivative(x).det()
        if isinstance(cofactor, RationalFunction):
            constant = flint.nmod(arithmetic.fmpq(cofactor.constant), p)
            return math.prod((flint.nmod(P(*x[:-1]), p) ** e for P, e in powers), start=constant)
        found = cofactor(tuple(Fraction(int(a)) for a in x[:-1]))
        if isinstance(found, float):
            raise wrong("cofactor", "exact numbers", "float", TypeError)
        return flint.nmod(arithmetic.fmpq(arithmetic.rational("cofactor", found)), p)

    try:
        values = [value(x) for x in points]
    except ZeroDivisionError:
        raise ArithmeticError("the cofactor is undefined at random points") from None
    return [[c * a for a in row] for c, row in zip(values, monomials, strict=True)], images


@lru_cache(maxsize=32)
def _random_points(map: RationalMap, degree: int, p: int, eps: int) -> tuple[Any, Any, Any]:
    """Return random points, and the monomials at them and at their images, for all cofactors."""
    n, rng, now = map.dimension, random.Random(p), map.at(eps)
    exponents = arithmetic.exponents_up_to(degree, n)
    points = [arithmetic.random_point(n, p, rng) for _ in range(len(exponents) + MORE)]
    monomials = [monomial_values(exponents, x).tolist() for x in points]
    images = [monomial_values(exponents, now.image(x)).tolist() for x in points]
    return points, monomials, images


def cofactors_of(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield the cofactors of polynomials up to a degree; the factors of the map must be known.

    Such a polynomial is an eigenvector of the pullback, divided by powers of the factors.
    """
    if (determinant := map.jacobian_cofactor) is None:
        expected = f"a map with an inverse and factors of det DPhi of at most {TERMS} terms"
        raise ArithmeticError(f"expected {expected}")
    # The Jacobian determinant of F: its zeros have images of lower dimension. Those of any other
    # factor of a pullback are mapped to a hypersurface, and it has a cofactor itself.
    jacobian = factored(map.forms[-1]) ** (map.dimension + 1) * determinant
    factors = [f for f, _ in jacobian.factors if degree_of(f)]
    at_infinity = (map.dimension + 1) * (map.degree - 1) > jacobian.degree
    below = factored(map.forms[-1]) ** -degree
    for powers in _divisors(map, degree, factors, at_infinity):
        cofactor = product_of(zip(factors, powers, strict=True), Fraction(1)) * below

        def search(p: int, eps: int, cofactor: Any = cofactor) -> Residues:
            here, images = _at_points(map, degree, cofactor, p, eps)
            n = len(here[0])
            # As many points as unknowns: eigenvalues of true solutions do not depend on them.
            first, second = (
                flint.nmod_mat(here[k:][:n], p).solve(flint.nmod_mat(images[k:][:n], p)).minpoly()
                for k in (0, MORE)
            )
            common = first.gcd(second)
            return [[int(c) for c in common.coeffs()]] if common.degree() else []

        rows = over_rationals(random.Random(degree), search, map.has_letter)
        for c in rational_roots(rows[0], map.ring) if rows else ():
            yield c * cofactor


def _divisors(
    map: RationalMap, degree: int, factors: list[Any], at_infinity: bool
) -> Iterator[tuple[int, ...]]:
    """Yield the exponents of products of factors that divide the pullback of some polynomial.

    The test is modulo a prime, on random lines. A product has the degree `degree` (map.degree - 1),
    so that the quotient has `degree`; one of its factors may be the hyperplane at infinity.
    """
    rng = random.Random(degree)
    p = arithmetic.random_prime(rng)
    eps = rng.randrange(2, p)
    monomials = [(*e, degree - sum(e)) for e in arithmetic.exponents_up_to(degree, map.dimension)]
    count, most = len(monomials), degree * (map.degree - 1)
    divisors = [(modulo(f, p, eps), degree_of(f)) for f in factors]
    if at_infinity:
        divisors.insert(0, (modulo(map.ring.constant(1), p, eps), 1))
    enough = 1 + 2 * count // min((k for _, k in divisors), default=1)
    lines = [random_line(map.dimension, p, rng) for _ in range(enough)]
    images = [list(monomial_values(monomials, map.at(eps).reduced(line))) for line in lines]

    def equations(f: Any, k: int, power: int) -> Residues:
        """Return equations for the polynomials whose pullback is divisible by f**power."""
        rows: Residues = []
        for line, values in zip(lines[: 1 + 2 * count // (k * power)], images, strict=False):
            divisor = on_line(f, line, k) ** power
            remainders = [each % divisor for each in values]
            rows += [[each[j] for each in remainders] for j in range(k * power)]
        reduced, rank = flint.nmod_mat(rows, p).rref()
        return arithmetic.integer_rows(reduced)[:rank]

    systems = []
    for f, k in divisors:
        each = (equations(f, k, power) for power in range(1, most // k + 1))
        systems.append([[], *takewhile(lambda rows: len(rows) < count, each)])

    @cache
    def fit(*powers: int) -> bool:
        """Return True if the first factors to these powers all divide some pullback."""
        rows = [row for each, e in zip(systems, powers, strict=False) for row in each[e]]
        return not rows or (fit(*powers[:-1]) and flint.nmod_mat(rows, p).rank() < count)

    for powers in product(*(range(len(each)) for each in systems)):
        total = sum(e * k for e, (_, k) in zip(powers, divisors, strict=True))
        if total == most and fit(*powers):
            yield powers[at_infinity:]
