"""Darboux polynomials of one cofactor: a linear problem at random points."""

from __future__ import annotations

import random
from fractions import Fraction
from typing import Any

import flint

from ..checks import integer, wrong
from . import exact
from .exact import MORE, Polynomials, Residues, monomial_values, rational, value_at
from .functions import RationalFunction
from .maps import BirationalMap, check_map
from .reconstruction import over_rationals, polynomials_with


def darboux_polynomials(
    map: BirationalMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) (arXiv:1902.04715).

    For the default cofactor 1 / P is the density of an invariant measure. For any cofactor the
    quotients of two such polynomials are first integrals. The equations for the coefficients are
    those of random points modulo a prime, 10 more than there are monomials; the solution is
    reconstructed over the rationals, or rational functions of eps if it is a letter, and confirmed
    modulo another prime.

    Parameters
    ----------
    map : KahanMap or RationalMap
        Made by `kahan` or `rational_map`.
    degree : int
        Largest degree of P.
    cofactor : number, RationalFunction or callable, optional
        C: a rational number, a function that `cofactors` found, or one that takes a point, a tuple
        of fractions, and returns a rational number, exactly (not if eps is a letter). By default it
        is ``map.determinant``.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    tuple of flint.fmpz_mpoly
        A basis of these polynomials in x1, ..., xD, whose coefficients have no common factor.
        ``sympy.sympify(str(P))`` converts one of them to SymPy.

    Raises
    ------
    ArithmeticError
        If there is no map, or the map or the cofactor is undefined at most points.

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
        cofactor = RationalFunction((), rational("cofactor", cofactor))
    if map.has_letter and not isinstance(cofactor, RationalFunction | None):
        raise wrong("cofactor", "a number or RationalFunction", "another function", TypeError)
    return with_cofactor(map, degree, cofactor, rng)


def with_cofactor(
    map: BirationalMap, degree: int, cofactor: Any, rng: random.Random
) -> Polynomials:
    """Return a basis of the polynomials up to a degree that have a cofactor, None for det DPhi."""
    exponents = exact.exponents_up_to(degree, map.dimension)

    def search(p: int, eps: int) -> Residues:
        steps, rows = map.steps(p, eps), []
        for _ in range(2 * (len(exponents) + MORE)):
            x = steps.point([rng.randrange(-(2**12), 2**12) for _ in range(map.dimension)])
            try:
                image, c = steps.image(x), value_of(cofactor, steps, eps, x)
            except ZeroDivisionError:  # at a pole
                continue
            before, after = (monomial_values(exponents, y) for y in (x, image))
            rows.append([b - c * a for a, b in zip(before, after, strict=True)])
            if len(rows) == len(exponents) + MORE:
                return exact.null_space(steps.matrix(rows))
        raise ArithmeticError("the map or the cofactor is undefined at most points")

    rows = over_rationals(rng, search, map.has_letter)
    if rows is None:
        raise ArithmeticError("the coefficients are too long")
    return polynomials_with(rows, exponents, map.has_letter)


def value_of(cofactor: Any, steps: Any, eps: int, x: list[Any]) -> Any:
    """Return the value of a cofactor at a point modulo a prime."""
    if cofactor is None:
        return steps.derivative(x).det()
    if isinstance(cofactor, RationalFunction):
        value = flint.nmod(exact.fmpq(cofactor.constant), steps.p)
        for P, e in cofactor.factors:
            letter = [flint.nmod(eps, steps.p)] if exact.has_letter(P) else []
            value *= value_at(P, [*letter, *x]) ** e
        return value
    half = steps.p // 2
    found = cofactor(tuple(Fraction((int(a) + half) % steps.p - half) for a in x[:-1]))
    if isinstance(found, float):
        raise wrong("cofactor", "exact numbers", "float", TypeError)
    return flint.nmod(exact.fmpq(rational("cofactor", found)), steps.p)
