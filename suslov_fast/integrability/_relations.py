"""Hirota-Kimura bases and Darboux polynomials."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import Any

import flint
import numpy as np

from .._bodies.algebra import exact_array, rational
from .._checks import integer, wrong
from .._docs import filled
from . import _exact
from ._exact import MORE, Exponents, Matrix, Point, Polynomials, Residues, monomial_values
from ._functions import rank_of_quotients
from ._invariants import common_denominator, invariants_up_to
from ._maps import Arithmetic, KahanMap, check_map

_MOST = 500  # monomials up to a degree


@dataclass(frozen=True)
class HKBasis:
    """Linear relations between `monomials` along orbits, as `hk_bases` returns them.

    The rows of `basis`, `dimension` of them, are coefficients of relations along the orbit of
    `point`: the last nonzero entry of a row is 1, and 0 in the others. They are None if they are
    too long to reconstruct. On random orbits, `independent` of the coefficients are independent
    first integrals. The quotients of the polynomials `integrals` are first integrals too, and
    `complete` is True if as many of these are independent. `degree` is that of the monomials.
    """

    degree: int
    monomials: Exponents = field(repr=False)
    dimension: int
    independent: int
    integrals: Polynomials
    complete: bool
    point: Point = field(repr=False)
    basis: Matrix | None = field(repr=False)

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        return _exact.polynomials_with(self.basis, self.monomials)

    def __repr__(self) -> str:
        text = (
            f"HKBasis(degree={self.degree}, dimension={self.dimension}, "
            f"independent={self.independent}, integrals={self.integrals}, complete={self.complete})"
        )
        if self.complete:
            return text
        missing = self.independent - rank_of_quotients(self.integrals)
        return f"{text}; {missing} more independent: try a higher degree, or `report`"


@filled
def hk_bases(
    map: KahanMap, monomials: int | Sequence[Sequence[int]], *, point: Any = None, seed: int = 0
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits (arXiv:1008.1040).

    An orbit has 10 points more than there are monomials, and is extended until the number of
    relations remains constant. The coefficients of a relation in the form of `HKBasis.basis` are
    first integrals; the rank of their derivatives is the number of independent ones. If the
    relations of all orbits together span one dimension more than those of one orbit, then quotients
    of these polynomials are first integrals, too; otherwise, Darboux polynomials of equal cofactor
    are sought.

    Parameters
    ----------
    %(map)s
    monomials : int or sequence of exponents
        A degree, or the exponents (e1, ..., eD) of each monomial. For a degree, all monomials up
        to it are examined; the basis is that of the lowest degree that shows as many independent
        integrals.
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
    >>> hk_bases(map, 1).dimension, hk_bases(map, 4).dimension
    (0, 1)
    >>> hk_bases(map, 4).integrals
    (4*x1^2 + x2^2, x1*x2 + 1024)
    """
    check_map(map)
    n, rng = map.dimension, random.Random(seed)
    exponents = _exponents(monomials, n)
    start = rng.sample(range(2, 100), n) if point is None else exact_array("point", point, (n,))
    highest, by_degree = _degree(exponents), isinstance(monomials, int | np.integer)
    search = Relations(map, rng)
    _, independent = search.counts(exponents)
    candidates: list[Polynomials] = [()]
    for d in range(1, highest + 1) if by_degree and independent else ():
        exponents = _exact.exponents_up_to(d, n)
        candidates.append(search.integrals(exponents))
        if search.counts(exponents)[1] == independent:
            break
    if not by_degree:
        candidates.append(search.integrals(exponents))
    elif rank_of_quotients(max(candidates, key=rank_of_quotients)) < independent:
        with contextlib.suppress(ArithmeticError):  # too long
            found = invariants_up_to(map, _degree(exponents))
            candidates.append(common_denominator(found.quotients))
    integrals = max(candidates, key=rank_of_quotients)
    dimension, _ = search.counts(exponents)
    basis: Matrix | None = ()
    if dimension > 0 or point is not None:
        basis = _exact.over_rationals(rng, lambda p: search.relations(p, exponents, start))
        dimension = dimension if basis is None else len(basis)
    complete = rank_of_quotients(integrals) == independent
    where = tuple(Fraction(a) for a in start)
    return HKBasis(
        _degree(exponents), exponents, dimension, independent, integrals, complete, where, basis
    )


class Relations:
    """Relations between monomials along random orbits."""

    def __init__(self, map: KahanMap, rng: random.Random) -> None:
        self.map, self.rng = map, rng
        self.counts = cache(self._counts)

    def relations(self, p: int, exponents: Exponents, point: Any = None) -> Residues:
        """Return the relations along an orbit, in the form of `HKBasis.basis`."""
        steps = Arithmetic(self.map, p)
        x = steps.point(self._random_point() if point is None else point)
        length, before = len(exponents) + MORE, None
        while True:
            rows = [list(monomial_values(exponents, y)) for y in steps.orbit(x, length)]
            relations = _exact.null_space(steps.matrix(rows))
            if len(relations) in (0, before):
                return relations
            before, length = len(relations), 2 * length

    def _random_point(self) -> list[int]:
        return [self.rng.randrange(2**61) for _ in range(self.map.dimension)]

    def _counts(self, exponents: Exponents) -> tuple[int, int]:
        """Return the number of relations, and of independent first integrals that they show."""

        def count(p: int) -> tuple[int, int]:
            relations = self.relations(p, exponents, start := self._random_point())
            rank = self._rank_of_derivatives(p, exponents, start, relations) if relations else 0
            return len(relations), rank

        return _exact.confirmed(self.rng, count)  # type: ignore[no-any-return]

    def _rank_of_derivatives(
        self, p: int, exponents: Exponents, start: list[int], relations: Residues
    ) -> int:
        """Return the rank of the derivatives of the coefficients of relations by the orbit's start.

        For each k, ``sum_i c_i m_i(x_k) = 0`` is differentiated with respect to x_0.
        """
        steps, n = Arithmetic(self.map, p), self.map.dimension
        ring = _exact.polynomial_ring(n, flint.nmod_mpoly_ctx, modulus=p)
        polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
        gradients = [[each.derivative(i) for i in range(n)] for each in polynomials]
        derivative = steps.matrix(np.eye(n, dtype=int).tolist())  # of x_k
        rows = []
        for y in steps.orbit(steps.point(start), len(exponents) + MORE):
            values = [[each(*y[:-1]) for each in row] for row in gradients]
            changes = steps.matrix(values) * derivative
            rows.append([*monomial_values(exponents, y), *changes.entries()])
            derivative = steps.derivative(y) * derivative
        reduced = steps.matrix(rows).rref()[0].tolist()[: len(exponents) - len(relations)]
        starts = range(len(exponents), len(rows[0]), n)
        return int(steps.matrix([row[k : k + n] for row in reduced for k in starts]).rank())

    def integrals(self, exponents: Exponents) -> Polynomials:
        """Return the polynomials of all relations if their quotients are first integrals."""
        if (dimension := self.counts(exponents)[0]) == 0:
            return ()

        def span(p: int) -> Residues:
            rows = [row for _ in range(3) for row in self.relations(p, exponents)]
            reduced, rank = flint.nmod_mat(rows, p).rref()
            return _exact.integer_rows(reduced)[:rank] if rank == dimension + 1 else []

        return _exact.polynomials_with(_exact.over_rationals(self.rng, span), exponents)


def _degree(exponents: Exponents) -> int:
    return max(sum(e) for e in exponents)


def _exponents(monomials: Any, n: int) -> Exponents:
    """Return the exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        degree = integer("monomials", monomials, 0)
        _exact.check_unknowns("monomials", degree, n, _MOST)
        return _exact.exponents_up_to(degree, n)
    try:
        exponents = tuple(tuple(integer("monomials", e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong("monomials", "a degree or a list of exponents", monomials, TypeError) from None
    for each in exponents:
        if len(each) != n:
            raise wrong("monomials", f"{n} exponents for each monomial", each)
    if not exponents or len({*exponents}) < len(exponents):
        raise wrong("monomials", "at least one monomial, and none twice", monomials)
    return exponents


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
    check_map(map)
    degree = integer("degree", degree, 0)
    _exact.check_unknowns("degree", degree, map.dimension)
    exponents = _exact.exponents_up_to(degree, map.dimension)
    homogeneous = [(*e, degree - sum(e)) for e in exponents]
    C = map.determinant if cofactor is None else cofactor
    if not callable(C):
        constant = rational("cofactor", cofactor)
        C = lambda x: constant  # noqa: E731
    rng = random.Random(seed)
    equations: list[list[int]] = []
    for _ in range(2 * (len(exponents) + MORE)):
        x = tuple(Fraction(rng.randrange(-(2**12), 2**12)) for _ in range(map.dimension))
        with contextlib.suppress(ZeroDivisionError):  # at poles
            image, c = map(x), rational("cofactor", C(x), exact=True)
            # With image = numerators / d, the equations times d**degree have integer coefficients.
            d = math.lcm(*(a.denominator for a in image))
            before = d**degree * monomial_values(exponents, [int(a) for a in x])
            after = monomial_values(homogeneous, [int(a * d) for a in (*image, Fraction(1))])
            equations.append(list(c.denominator * after - c.numerator * before))
        if len(equations) == len(exponents) + MORE:
            return _exact.polynomials_with(_exact.null_space(flint.fmpz_mat(equations)), exponents)
    raise ArithmeticError("the map or the cofactor is undefined at most points")
