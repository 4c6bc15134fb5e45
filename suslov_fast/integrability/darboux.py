"""Darboux polynomials, P(Phi(x)) = C(x) P(x), and their cofactors C.

P solves linear equations at random points modulo a prime. C is a product of powers of the factors
of det DPhi and of the denominator (Celledoni and others, arXiv:1902.04715).
"""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import flint

from ..checks import integer, kind_of, wrong
from ..fields.base import Body
from ..keywords import public
from . import arithmetic, polynomials
from .arithmetic import EPS, Residues, Values
from .birational_maps import RationalMap
from .exact_maps import checked_map
from .integrals_of_polynomials import DarbouxInvariants
from .interpolation import over_rationals
from .polynomials import Polynomials, degree_of, exponents_up_to, modulo, monomial_values
from .rational_functions import RationalFunction, factored, product_of, rational_roots
from .tolerances import EXTRA_EQUATIONS, MOST_TERMS_FACTORED


class Determinant(NamedTuple):
    """The cofactor det DPhi of a map, or -det DPhi, without factors, which may not be known."""

    map: RationalMap
    sign: int = 1

    def values_modulo(self, p: int, eps: Values, points: Sequence[Any]) -> list[Any]:
        """Return the values modulo p at points, with numbers `eps` for letters."""
        at_eps = self.map.at_eps(eps)
        return [self.sign * at_eps.derivative(x).det() for x in points]


def space_of(map: RationalMap, degree: int, cofactor: Any) -> Polynomials:
    """Return a basis of the polynomials P up to a degree with P(Phi) = cofactor * P."""

    def search(p: int, eps: Values) -> Residues:
        space = arithmetic.null_space(_equations(map, degree, cofactor, p, eps))
        if map.is_symbolic and space:  # with letters LLL does not apply: take pivots of low degree
            return arithmetic.row_space(space, p)
        return space

    rows = over_rationals(map.generator(), search, len(map.letters))
    if rows is None:
        raise ArithmeticError("the polynomials have too many terms, or too long coefficients")
    exponents = exponents_up_to(degree, map.dimension)
    return polynomials.polynomials_with(rows, exponents, polynomials.letters_of(map.ring))


def nullity(map: RationalMap, degree: int, cofactor: Any) -> int:
    """Return the dimension of the space that `space_of` returns, computed modulo one prime."""
    matrix = _equations(map, degree, cofactor, map.prime, EPS)
    return int(matrix.ncols() - matrix.rank())


@public
def darboux_polynomials(
    map: RationalMap | Body, degree: int, cofactor: Any = None, *, letters: Any = None
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) of any cofactor C, or of a given one.

    Quotients of two such polynomials with one C are first integrals; 1 / P with C = det DPhi is the
    density of an invariant measure (arXiv:1902.04715). The equations hold at random points modulo a
    prime, 10 more points than unknowns. Another prime confirms the solution.

    Parameters
    ----------
    map : KahanMap or RationalMap
        Made by `kahan` or `rational_map`; a field or a body is its Kahan map with a symbolic eps.
    degree : int
        Largest degree of P.
    cofactor : number or RationalFunction, optional
        C: ``map.determinant`` for det DPhi, a rational number, or a function that
        :func:`cofactors` found. By default all that `cofactors` finds.
    letters : str or sequence of str, optional
        Names of parameters of a field or a body that stay symbols, in addition to eps: ``"a b"``.
        The polynomials have them as variables before x1, ..., xD.

    Returns
    -------
    tuple of flint.fmpz_mpoly
        For a given cofactor, a basis of its polynomials in x1, ..., xD, with coprime integers as
        coefficients. By default, the polynomials of all cofactors, without constants and
        combinations of products of others.

    Raises
    ------
    ArithmeticError
        If there is no map, or the cofactor is undefined at random points; without a cofactor also
        if there is no inverse, or the factors of det DPhi are too long to write out.

    Examples
    --------
    >>> from suslov_fast import Field, Suslov3D
    >>> from suslov_fast.integrability import darboux_polynomials, kahan
    >>> top = Field(lambda x: (x[1]*x[2], -2*x[0]*x[2], x[0]*x[1]), 3)
    >>> darboux_polynomials(kahan(top, eps=1), 2)
    (x1 + x3, x1 - x3, 2*x1^2 + x2^2, x3^2 + 2)

    The densities of invariant measures of the body of the paper:

    >>> map = kahan(Suslov3D(4, 1, -0.5, -0.25).field(), eps=0.25)
    >>> for P in darboux_polynomials(map, 3, map.determinant):
    ...     print(P.factor())
    (1, [(2*Omega1 + Omega2, 1), (4*Omega1^2 + Omega2^2, 1)])
    (1, [(2*Omega1 + Omega2, 1), (Omega1*Omega2 + 1024, 1)])
    """
    map = checked_map(map, letters)
    degree = checked_degree("degree", degree, map.dimension)
    if cofactor is None:
        space = _of_all_cofactors(map, degree)
    elif cofactor == map.determinant:
        space = space_of(map, degree, Determinant(map))
    else:
        if callable(cofactor) and not isinstance(cofactor, RationalFunction):
            expected = "map.determinant, a number or a result of cofactors(map, degree)"
            raise wrong("cofactor", expected, kind_of(cofactor), TypeError)
        if not callable(cofactor):
            cofactor = RationalFunction((), arithmetic.rational("cofactor", cofactor))
        space = space_of(map, degree, cofactor)
    space = tuple(polynomials.renamed(P, map.names, map.letter) for P in space)
    return tuple(polynomials.with_plain_letters(P) for P in space)


def _of_all_cofactors(map: RationalMap, degree: int) -> Polynomials:
    """Return Darboux polynomials of all cofactors, without combinations of products of others."""
    known = DarbouxInvariants(map, degree)
    usual = [RationalFunction(()), map.jacobian_cofactor]
    for k in range(1, degree + 1):
        for cofactor in dict.fromkeys([*cofactors_of_degree(map, k), *usual]):
            for P in sorted(space_of(map, k, cofactor), key=polynomials.sort_key):
                if not known.is_known(P, cofactor):
                    known.add(replace(factored(P), cofactor=cofactor))
            known.normalize(known.value(cofactor))
    return tuple(known.polynomial(g) for g in known.polynomials)


@public
def cofactors(
    map: RationalMap | Body, degree: int, *, letters: Any = None
) -> tuple[RationalFunction, ...]:
    """Find the cofactors that polynomials up to a degree can have (arXiv:1902.04715).

    They are products of a constant and powers of the factors of det DPhi and of the map's
    denominator. The result contains 1, det DPhi and each such product with a polynomial up to the
    degree. Other cofactors, of polynomials that are 0 where the map contracts, are not sought.

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
    degree = checked_degree("degree", degree, map.dimension)
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


def checked_degree(name: str, degree: Any, n: int, least: int = 0, most: int = 300) -> int:
    """Return `degree` as an integer; polynomials in n variables have at most `most` terms."""
    degree = integer(name, degree, least)
    if (unknowns := math.comb(n + degree, n)) > most:
        largest = next(d for d in range(degree) if math.comb(n + d + 1, n) > most)
        expected = f"at most {largest} for {n} variables ({math.comb(n + largest, n)} coefficients)"
        raise wrong(name, expected, f"{degree} ({unknowns} coefficients)")
    return degree


def cofactors_of_degree(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield cofactors of Darboux polynomials of a degree; others are products of lower ones."""
    for candidate in candidate_cofactors(map, degree):
        yield from with_constants(map, degree, candidate)
    yield from _of_poles(map, degree)


def _of_poles(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield cofactors of the denominator F_0, 0 at poles, and of `map.factors`, of this degree.

    F_0 and its factors need not divide their pullbacks, so `candidate_cofactors` may lack their
    cofactors.
    """
    for P in (*(map.factors or ()), map.forms[-1]):
        if degree_of(P) == degree and (C := map.cofactor(P)) is not None:
            yield C


def _equations(map: RationalMap, degree: int, cofactor: Any, p: int, eps: Values) -> Any:
    """Return the matrix modulo p of the equations P(Phi) = cofactor * P for coefficients of P."""
    points = _random_points(map, degree, p, eps)
    at_points = flint.nmod_mat(points.times(cofactor, p, eps), p)
    return at_points - flint.nmod_mat(points.of_images, p)


class _Points(NamedTuple):
    """Random points `x` modulo p, and the values of monomials there and at the images Phi(x)."""

    x: list[list[Any]]
    monomials: list[list[Any]]
    of_images: list[list[Any]]

    def times(self, cofactor: Any, p: int, eps: Values) -> list[list[Any]]:
        """Return the rows of `monomials`, each times the value of a cofactor at its point."""
        try:
            values = cofactor.values_modulo(p, eps, self.x)
        except ZeroDivisionError:
            raise ArithmeticError("the cofactor is undefined at random points") from None
        return [[c * a for a in row] for c, row in zip(values, self.monomials, strict=True)]


@lru_cache(maxsize=32)
def _random_points(map: RationalMap, degree: int, p: int, eps: Values) -> _Points:
    """Return random points modulo p, more than there are monomials up to a degree."""
    n, rng, at_eps = map.dimension, random.Random(p), map.at_eps(eps)
    exponents = exponents_up_to(degree, n)
    x = [arithmetic.random_point(n, p, rng) for _ in range(len(exponents) + EXTRA_EQUATIONS)]
    monomials = [monomial_values(exponents, a) for a in x]
    return _Points(x, monomials, [monomial_values(exponents, at_eps.image(a)) for a in x])


def candidate_cofactors(map: RationalMap, degree: int) -> Iterator[RationalFunction]:
    """Yield products of powers of the map's factors that may be cofactors, up to a constant."""
    if (determinant := map.jacobian_cofactor) is None:
        needed = f"a map with an inverse, and factors of at most {MOST_TERMS_FACTORED} terms"
        raise ArithmeticError(f"the factors of det DPhi are not known: they need {needed}")
    # Factors of C are sought among those of the Jacobian determinant of F, whose zeros have images
    # of lower dimension. Zeros of other factors of a pullback P(F) are mapped to a hypersurface
    # P = 0: mostly these factors belong to P, not to C.
    jacobian = factored(map.forms[-1]) ** (map.dimension + 1) * determinant
    factors = [f for f, _ in jacobian.factors if degree_of(f)]
    at_infinity = (map.dimension + 1) * (map.degree - 1) > jacobian.degree
    poles = factored(map.forms[-1]) ** -degree
    for powers in _divisors(map, degree, factors, at_infinity):
        yield product_of(zip(factors, powers, strict=True), Fraction(1)) * poles


def with_constants(
    map: RationalMap, degree: int, candidate: RationalFunction
) -> Iterator[RationalFunction]:
    """Yield c * candidate for each constant c that makes it the cofactor of a polynomial.

    The constants are the eigenvalues of the linear operator P -> P(Phi) / candidate.
    """

    def search(p: int, eps: Values) -> list[Any]:
        points = _random_points(map, degree, p, eps)
        at_points, at_images = points.times(candidate, p, eps), points.of_images
        n = len(at_points[0])

        def minimal_polynomial(start: int) -> Any:
            """Return the minimal polynomial of P -> P(Phi) / candidate, at points[start:]."""
            here, there = (flint.nmod_mat(rows[start:][:n], p) for rows in (at_points, at_images))
            return here.solve(there).minpoly()

        # Eigenvalues of Darboux polynomials are the same at all sets of points, others are not.
        common = minimal_polynomial(0).gcd(minimal_polynomial(EXTRA_EQUATIONS))
        return common.coeffs() if common.degree() else []

    yield from (c * candidate for c in rational_roots(map.generator(degree), search, map.ring))


def _divisors(
    map: RationalMap, degree: int, factors: list[Any], at_infinity: bool
) -> Iterator[tuple[int, ...]]:
    """Yield exponents of `factors` for which the product of powers divides some P(F_1, ..., F_0).

    P and the quotient are homogeneous of this degree, and F_i are the forms of the map. If
    `at_infinity`, the product may also contain a power of the last coordinate. The exponent of
    this power is left out of the result.
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
    lines = [polynomials.random_line(map.dimension, p, rng) for _ in range(enough)]
    at_number = map.at_eps(eps)
    pullbacks = [monomial_values(monomials, at_number.coprime_image(line)) for line in lines]

    def equations(f: Any, size: int, power: int) -> Residues:
        """Return linear equations for P: f**power divides P(F), where f has the degree `size`."""
        divisor_degree = size * power
        rows: Residues = []
        enough = 1 + 2 * count // divisor_degree
        for line, of_monomials in zip(lines[:enough], pullbacks, strict=False):
            divisor = polynomials.value_at(f, line, size) ** power
            remainders = [pullback % divisor for pullback in of_monomials]
            rows += [[remainder[j] for remainder in remainders] for j in range(divisor_degree)]
        return arithmetic.row_space(rows, p)

    # Equations by factor and power, up to the highest power that divides some P(F).
    systems: list[list[Residues]] = []
    for f, size in zip(divisors, sizes, strict=True):
        systems.append([[]])
        for power in range(1, most // size + 1):
            if len(rows := equations(f, size, power)) == count:
                break
            systems[-1].append(rows)
    for powers in _joint_powers(systems, sizes, count, p, most):
        yield powers[at_infinity:]


def _joint_powers(
    systems: list[list[Residues]], sizes: list[int], count: int, p: int, most: int
) -> Iterator[tuple[int, ...]]:
    """Yield a power of each factor, whose equations for `count` unknowns have a common solution.

    `systems` has the equations modulo p by factor and power, `sizes` the degrees of the factors.
    The product of all powers has the degree `most`.
    """
    largest = [size * (len(system) - 1) for size, system in zip(sizes, systems, strict=True)]

    def extended(powers: tuple[int, ...], system: Residues, free: int) -> Iterator[tuple[int, ...]]:
        """Yield the tuples of exponents that begin with `powers`.

        The powers of the remaining factors must have a product of degree `free`. `system` contains
        the linear equations for P that `powers` imply.
        """
        k = len(powers)
        if k == len(systems):
            yield powers
            return
        for power, rows in enumerate(systems[k]):
            rest = free - power * sizes[k]
            if rest < 0:
                return
            if rest > sum(largest[k + 1 :]):  # the later factors cannot make up this degree
                continue
            joint = system
            if rows:
                joint = arithmetic.row_space(system + rows, p)
                if len(joint) == count:  # no P for this power, and none for higher powers
                    return
            yield from extended((*powers, power), joint, rest)

    yield from extended((), [], most)
