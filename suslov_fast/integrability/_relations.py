"""Hirota-Kimura bases and Darboux polynomials."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import combinations_with_replacement
from typing import Any

import flint
import numpy as np

from .._bodies.algebra import exact_array
from .._checks import instance, integer, wrong
from .._docs import filled
from . import _exact
from ._exact import Exponents, Matrix, Point, Polynomials, Residues, confirmed
from ._maps import Arithmetic, KahanMap

_MORE = 10  # equations more than unknowns


@dataclass(frozen=True)
class HKBasis:
    """Linear relations between `monomials` along orbits, as `hk_bases` returns them.

    The rows of `basis`, `dimension` of them, are coefficients of relations along the orbit of
    `point`: the last nonzero entry of a row is 1, and 0 in the others. They are None if they are
    too long to reconstruct. On random orbits, `independent` of the coefficients are independent
    first integrals. The quotients of the polynomials `integrals` are first integrals too. There are
    such polynomials only for the smallest set of monomials that has relations: with more monomials
    the multiples of a relation are relations of the same orbit.
    """

    monomials: Exponents = field(repr=False)
    dimension: int
    independent: int
    integrals: Polynomials
    point: Point = field(repr=False)
    basis: Matrix | None = field(repr=False)

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        return _exact.polynomials_with(self.basis, self.monomials)


@filled
def hk_bases(
    map: KahanMap, monomials: int | Sequence[Sequence[int]], *, point: Any = None, seed: int = 0
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits (arXiv:1008.1040).

    An orbit has 10 points more than there are monomials, and is extended until the number of
    relations remains constant. The coefficients of a relation in the form of `HKBasis.basis` are
    first integrals; the rank of their derivatives is the number of independent ones. If the
    relations of all orbits together span one dimension more than those of one orbit, then quotients
    of these polynomials are first integrals, too.

    Parameters
    ----------
    %(map)s
    monomials : int or sequence of exponents
        All monomials up to a degree, 1 included, or the exponents (e1, ..., eD) of each.
    point : sequence of D rational numbers, optional
        Point whose orbit `basis` and `dimension` belong to; by default one of random integers below
        100.
    %(seed)s

    Returns
    -------
    HKBasis
        If its `dimension` is 0, no quotient of two linear combinations of the monomials is a first
        integral.

    Raises
    ------
    %(invalid)s
    ArithmeticError
        If the orbit of `point`, or of most points, ends at a pole.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Suslov3D
    >>> from suslov_fast.integrability import hk_bases, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> hk_bases(map, 1).dimension, hk_bases(map, 2).dimension
    (0, 1)
    >>> hk_bases(map, 2).integrals
    (4*x1^2 + x2^2, x1*x2 + 1024)
    """
    instance("map", map, KahanMap)
    exponents, rng = _exponents("monomials", monomials, map.dimension), random.Random(seed)

    def relations(p: int, point: Any = None) -> Residues:
        modular = Arithmetic(map, p)
        x = modular.random_point(rng) if point is None else [modular.number(a) for a in point]
        return _relations(modular, exponents, x)

    def span(p: int) -> Residues:
        rows = [row for _ in range(3) for row in relations(p)]
        reduced, rank = flint.nmod_mat(rows, p).rref()
        return _exact.integer_rows(reduced)[:rank] if rank == dimension + 1 else []

    small = rng.sample(range(2, 100), map.dimension)
    start = exact_array("point", small if point is None else point, (map.dimension,))
    dimension = of_point = confirmed(rng, lambda p: len(relations(p)))
    basis: Matrix | None = ()
    if dimension > 0 or point is not None:
        basis = _exact.over_rationals(rng, lambda p: relations(p, start))
        of_point = dimension if basis is None else len(basis)
    independent, integrals = 0, ()
    if dimension > 0:
        independent = confirmed(rng, lambda p: _independent(Arithmetic(map, p), exponents, rng))
        integrals = _exact.polynomials_with(_exact.over_rationals(rng, span), exponents)
    return HKBasis(exponents, of_point, independent, integrals, tuple(start), basis)


def _exponents(name: str, monomials: Any, n: int) -> Exponents:
    """Return the exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        return tuple(
            tuple(chosen.count(i) for i in range(n))
            for degree in range(integer(name, monomials, 0) + 1)
            for chosen in combinations_with_replacement(range(n), degree)
        )
    try:
        exponents = tuple(tuple(integer(name, e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong(name, "a degree or a list of exponents", monomials, TypeError) from None
    for each in exponents:
        if len(each) != n:
            raise wrong(name, f"{n} exponents for each monomial", each)
    if not exponents or len({*exponents}) < len(exponents):
        raise wrong(name, "at least one monomial, and none twice", monomials)
    return exponents


def _relations(modular: Arithmetic, exponents: Exponents, x: Sequence[Any]) -> Residues:
    """Return the relations along the orbit of a point, in the form of `HKBasis.basis`."""
    steps, before = len(exponents) + _MORE, None
    while True:
        rows = [list(_exact.monomial_values(exponents, y)) for y in modular.orbit(x, steps)]
        relations = _exact.null_space(modular.matrix(rows))
        if len(relations) in (0, before):
            return relations
        before, steps = len(relations), 2 * steps


def _independent(modular: Arithmetic, exponents: Exponents, rng: random.Random) -> int:
    """Return the rank of the derivatives of the coefficients of relations by the orbit's start.

    For each k, ``sum_i c_i m_i(x_k) = 0`` is differentiated with respect to x_0.
    """
    n, x = modular.dimension, modular.random_point(rng)
    relations = _relations(modular, exponents, x)
    ring = _exact.polynomial_ring(n, flint.nmod_mpoly_ctx, modulus=modular.p)
    polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
    gradients = [[each.derivative(i) for i in range(n)] for each in polynomials]
    derivative = modular.matrix(np.eye(n, dtype=int).tolist())  # of x_k
    rows = []
    for y in modular.orbit(x, len(exponents) + _MORE):
        changes = modular.matrix([[each(*y) for each in row] for row in gradients]) * derivative
        rows.append([*_exact.monomial_values(exponents, y), *changes.entries()])
        derivative = modular.derivative(y) * derivative
    reduced = modular.matrix(rows).rref()[0].tolist()[: len(exponents) - len(relations)]
    starts = range(len(exponents), len(rows[0]), n)
    return int(modular.matrix([row[k : k + n] for row in reduced for k in starts]).rank())


@filled
def darboux_polynomials(
    map: KahanMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) (arXiv:1902.04715).

    For the default cofactor 1 / P is the density of an invariant measure. For any cofactor the
    quotients of two such polynomials are first integrals. The equations for the coefficients are
    those of random integer points, 10 more than there are monomials, solved exactly.

    Parameters
    ----------
    %(map)s
    degree : int
        Largest degree of P.
    cofactor : number or callable, optional
        C: a rational number, or a function that takes a point, a tuple of fractions, and returns
        a rational number, exactly. By default it is ``map.determinant``.
    %(seed)s

    Returns
    -------
    tuple of flint.fmpz_mpoly
        A basis of these polynomials in x1, ..., xD, whose coefficients have no common factor.
        ``sympy.sympify(str(P))`` converts one of them to SymPy.

    Raises
    ------
    %(invalid)s
    ArithmeticError
        If the map or the cofactor is undefined at most points.

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
    instance("map", map, KahanMap)
    degree = integer("degree", degree, 0)
    exponents = _exponents("degree", degree, map.dimension)
    homogeneous = tuple((degree - sum(e), *e) for e in exponents)
    C = map.determinant if cofactor is None else cofactor
    if not callable(C):
        constant = exact_array("cofactor", cofactor, ()).item()
        C = lambda x: constant  # noqa: E731
    rng = random.Random(seed)

    equations: list[list[int]] = []
    for _ in range(2 * (len(exponents) + _MORE)):
        x = tuple(Fraction(rng.randrange(-(2**12), 2**12)) for _ in range(map.dimension))
        with contextlib.suppress(ZeroDivisionError):  # at poles
            image, c = map(x), exact_array("cofactor", C(x), (), exact=True).item()
            # With image = numerators / d, the equations times d**degree have integer coefficients.
            d = math.lcm(*(a.denominator for a in image))
            before = d**degree * _exact.monomial_values(exponents, [int(a) for a in x])
            after = _exact.monomial_values(homogeneous, [d, *(int(a * d) for a in image)])
            equations.append(list(c.denominator * after - c.numerator * before))
        if len(equations) == len(exponents) + _MORE:
            return _exact.polynomials_with(_exact.null_space(flint.fmpz_mat(equations)), exponents)
    raise ArithmeticError("the map or the cofactor is undefined at most points")
