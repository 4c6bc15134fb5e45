"""Darboux polynomials, P(Phi(x)) = C(x) P(x), of a cofactor C, and cofactors that have such P.

P solves linear equations at random points modulo a prime. Cofactors are products of powers of the
factors of det DPhi and of the denominator (Celledoni and others, arXiv:1902.04715).
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import flint

from ..checks import integer, wrong
from ..fields.base import Body
from ..keywords import public
from . import arithmetic
from .arithmetic import EPS, EXTRA, Residues, Values
from .birational_maps import TERMS, RationalMap
from .interpolation import over_rationals
from .letters import checked_map
from .polynomials import (
    Polynomials,
    degree_of,
    exponents_up_to,
    letters_of,
    modulo,
    monomial_values,
    on_line,
    polynomials_with,
    random_line,
)
from .rational_functions import RationalFunction, factored, product_of, rational_roots


def space_of(map: RationalMap, degree: int, cofactor: Any, sign: int = 1) -> Polynomials:
    """Return a basis of P to a degree: P(Phi) = sign * cofactor * P. Cofactor None: det DPhi."""

    def search(p: int, eps: Values) -> Residues:
        space = arithmetic.null_space(_equations(map, degree, cofactor, sign, p, eps))
        if map.is_symbolic and space:  # formulas without LLL: pivots are monomials of low degree
            return arithmetic.row_space(space, p)
        return space

    rows = over_rationals(map.generator(), search, len(map.letters))
    if rows is None:
        raise ArithmeticError("the polynomials have too many terms, or too long coefficients")
    exponents = exponents_up_to(degree, map.dimension)
    return polynomials_with(rows, exponents, letters_of(map.ring))


def nullity(map: RationalMap, degree: int, cofactor: Any, sign: int = 1) -> int:
    """Return the number of independent P with P(Phi) = sign * cofactor * P, modulo one prime."""
    matrix = _equations(map, degree, cofactor, sign, map.prime, EPS)
    return int(matrix.ncols() - matrix.rank())


@public
def cofactors(
    map: RationalMap | Body, degree: int, *, letters: Any = None
) -> tuple[RationalFunction, ...]:
    """Find the cofactors that polynomials up to a degree can have (arXiv:1902.04715).

    They are products of a constant and powers of the factors of det DPhi and of the map's
    denominator. The result has all with a Darboux polynomial up to the degree, and 1 and det DPhi.

    Parameters
    ----------
    map, degree, letters
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
    >>> from suslov_fast import Field
    >>> from suslov_fast.integrability import cofactors, darboux_polynomials, kahan
    >>> prey = Field(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
    >>> map = kahan(prey, eps=1)
    >>> for C in cofactors(map, 1):
    ...     print(C, darboux_polynomials(map, 1, C))
    1 (1,)
    -(3*x1 + x2 + 1)*(3*x1 + x2 - 9)/(x1 - 3*x2 - 3)^2 ()
    (3*x1 + x2 - 9)/(x1 - 3*x2 - 3) (x1,)
    -(3*x1 + x2 + 1)/(x1 - 3*x2 - 3) (x2,)
    """
    map = checked_map(map, letters)
    degree = integer("degree", degree, 0)
    check_unknowns("degree", degree, map.dimension)
    one = RationalFunction(())
    known = [(0, one)]
    for k in range(1, degree + 1):
        known += [(k, C) for C in cofactors_of_degree(map, k)]
    poles = [(k, C) for k in range(1, degree + 1) for C in _of_poles(map, k)]
    for k, C in poles:
        more = known
        while more := [(j + k, C * other) for j, other in more if j + k <= degree]:
            known = [*known, *more]
    different = dict.fromkeys([one, map.jacobian_cofactor or one, *(C for _, C in known)])
    return tuple(C.renamed(map.names, map.letter) for C in different)


def check_unknowns(name: str, degree: int, n: int, most: int = 300) -> None:
    """Raise an error on `name` if polynomials of `degree` in n variables have over `most` terms."""
    if (unknowns := math.comb(n + degree, n)) > most:
        largest = next(d for d in range(degree) if math.comb(n + d + 1, n) > most)
        expected = f"at most {largest} for {n} variables ({math.comb(n + largest, n)} coefficients)"
        raise wrong(name, expected, f"{degree} ({unknowns} coefficients)")


def cofactors_of_degree(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield cofactors C of Darboux polynomials P up to a degree, P(Phi) = C P.

    Other such cofactors are products of these and of cofactors of lower degrees.
    """
    for candidate in candidate_cofactors(map, degree):
        yield from with_constants(map, degree, candidate)
    yield from _of_poles(map, degree)


def _of_poles(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield the cofactors of F_0 and of the map's factors, if they have cofactors and this degree.

    A factor of F_0 need not divide its pullback, so `candidate_cofactors` may not find its C.
    """
    for P in (*(map.factors or ()), map.forms[-1]):
        if degree_of(P) == degree and (C := map.cofactor(P)) is not None:
            yield C


def _equations(map: RationalMap, degree: int, cofactor: Any, sign: int, p: int, eps: Values) -> Any:
    """Return the matrix modulo p of the linear equations P(Phi) = sign * cofactor * P.

    It has a row for each random point, and a column for each monomial up to a degree.
    """
    points = _random_points(map, degree, p, eps)
    at_points = flint.nmod_mat(points.times(cofactor, sign), p)
    return at_points - flint.nmod_mat(points.of_images, p)


class _Points(NamedTuple):
    """Random points `x` modulo p, and values of monomials at x and, as `of_images`, at Phi(x)."""

    map: RationalMap  # at eps
    eps: Values
    x: list[list[Any]]
    monomials: list[list[Any]]
    of_images: list[list[Any]]

    def times(self, cofactor: Any, sign: int = 1) -> list[list[Any]]:
        """Return the rows of `monomials`, each times `sign` and the cofactor at its point."""
        try:
            values = self._values_of(cofactor)
        except ZeroDivisionError:
            raise ArithmeticError("the cofactor is undefined at random points") from None
        pairs = zip(values, self.monomials, strict=True)
        return [[sign * c * a for a in row] for c, row in pairs]

    def _values_of(self, cofactor: Any) -> list[Any]:
        """Return the values of a cofactor at the points; None stands for det DPhi."""
        if cofactor is None:
            return [self.map.derivative(x).det() for x in self.x]
        p = int(self.x[0][0].modulus())
        return cofactor.values_modulo(p, self.eps, self.x)


@lru_cache(maxsize=32)
def _random_points(map: RationalMap, degree: int, p: int, eps: Values) -> _Points:
    """Return random points modulo p, more than monomials to a degree; equal for all cofactors."""
    n, rng, at_eps = map.dimension, random.Random(p), map.at_eps(eps)
    exponents = exponents_up_to(degree, n)
    x = [arithmetic.random_point(n, p, rng) for _ in range(len(exponents) + EXTRA)]
    pairs = ([monomial_values(exponents, y) for y in (a, at_eps.image(a))] for a in x)
    monomials, of_images = zip(*pairs, strict=True)
    return _Points(at_eps, eps, x, [*monomials], [*of_images])


def candidate_cofactors(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield products C of powers of the map's factors; c C may be a cofactor for a constant c.

    P(Phi) = c C P may have a solution P of this degree; then `with_constants` finds c.
    """
    if (determinant := map.jacobian_cofactor) is None:
        needed = f"a map with an inverse, and factors of at most {TERMS} terms"
        raise ArithmeticError(f"the factors of det DPhi are not known: they need {needed}")
    # The Jacobian determinant of F: its zeros have images of lower dimension. Those of any other
    # factor of a pullback are mapped to a hypersurface, and it has a cofactor itself.
    jacobian = factored(map.forms[-1]) ** (map.dimension + 1) * determinant
    factors = [f for f, _ in jacobian.factors if degree_of(f)]
    at_infinity = (map.dimension + 1) * (map.degree - 1) > jacobian.degree
    poles = factored(map.forms[-1]) ** -degree
    for powers in _divisors(map, degree, factors, at_infinity):
        yield product_of(zip(factors, powers, strict=True), Fraction(1)) * poles


def with_constants(
    map: RationalMap, degree: int, candidate: RationalFunction
) -> Iterator[RationalFunction]:
    """Yield c * candidate for all constants c that make it a cofactor of polynomials to a degree.

    The constants are eigenvalues of the pullback divided by the candidate.
    """

    def search(p: int, eps: Values) -> Residues:
        points = _random_points(map, degree, p, eps)
        at_points, at_images = points.times(candidate), points.of_images
        n = len(at_points[0])

        def minimal_polynomial(start: int) -> Any:
            """Return the minimal polynomial of P -> P(Phi) / candidate, at points[start:]."""
            here, there = (flint.nmod_mat(rows[start:][:n], p) for rows in (at_points, at_images))
            return here.solve(there).minpoly()

        # The eigenvalues of polynomials do not depend on the points.
        common = minimal_polynomial(0).gcd(minimal_polynomial(EXTRA))
        return [[int(c) for c in common.coeffs()]] if common.degree() else []

    rows = over_rationals(map.generator(degree), search, len(map.letters))
    for c in rational_roots(rows[0], map.ring) if rows else ():
        yield c * candidate


def _divisors(
    map: RationalMap, degree: int, factors: list[Any], at_infinity: bool
) -> Iterator[tuple[int, ...]]:
    """Yield tuples e: the product of `factors`**e divides P(F) for some polynomial P of `degree`.

    F are the homogeneous forms of the map. The quotient must have the degree of P, too. If
    `at_infinity`, the product may have powers of the last coordinate as well, which are not in e.
    The test is modulo a prime, on random lines.
    """
    rng = map.generator(degree)
    p = arithmetic.random_prime(rng)
    eps = arithmetic.random_values(rng, p)
    monomials = [(*e, degree - sum(e)) for e in exponents_up_to(degree, map.dimension)]
    count, most = len(monomials), degree * (map.degree - 1)
    divisors = [modulo(f, p, eps) for f in factors]
    sizes = [degree_of(f) for f in factors]
    if at_infinity:
        divisors, sizes = [modulo(map.ring.constant(1), p, eps), *divisors], [1, *sizes]
    enough = 1 + 2 * count // min(sizes, default=1)
    lines = [random_line(map.dimension, p, rng) for _ in range(enough)]
    at_number = map.at_eps(eps)
    pullbacks = [monomial_values(monomials, at_number.coprime_image(line)) for line in lines]

    def equations(f: Any, size: int, power: int) -> Residues:
        """Return linear equations for P: f**power divides its pullback; f has the degree `size`."""
        divisor_degree = size * power
        rows: Residues = []
        enough = 1 + 2 * count // divisor_degree
        for line, of_monomials in zip(lines[:enough], pullbacks, strict=False):
            divisor = on_line(f, line, size) ** power
            remainders = [pullback % divisor for pullback in of_monomials]
            rows += [[remainder[j] for remainder in remainders] for j in range(divisor_degree)]
        return arithmetic.row_space(rows, p)

    # The equations by factor and power, up to the highest power that divides some pullback.
    systems: list[list[Residues]] = []
    for f, size in zip(divisors, sizes, strict=True):
        systems.append([[]])
        for power in range(1, most // size + 1):
            if len(rows := equations(f, size, power)) == count:
                break
            systems[-1].append(rows)
    largest = [size * (len(system) - 1) for size, system in zip(sizes, systems, strict=True)]

    def extended(powers: tuple[int, ...], system: Residues, left: int) -> Iterator[tuple[int, ...]]:
        """Yield exponents that begin with `powers`; the remaining factors have the degree `left`.

        `system` has the linear equations for P that `powers` imply.
        """
        k = len(powers)
        if k == len(divisors):
            yield powers[at_infinity:]
            return
        for power, rows in enumerate(systems[k]):
            rest = left - power * sizes[k]
            if rest < 0:
                return
            if rest > sum(largest[k + 1 :]):  # too much for the factors that follow
                continue
            joint = system
            if rows:
                joint = arithmetic.row_space(system + rows, p)
                if len(joint) == count:  # higher powers divide no pullback either
                    return
            yield from extended((*powers, power), joint, rest)

    yield from extended((), [], most)
