"""Hirota-Kimura bases: what linear relations ``sum_i c_i m_i(x_k) = 0`` along orbits show.

The relations hold for all points x_k of an orbit, so that quotients of their coefficients c_i are
first integrals (Petrera, Pfadler and Suris, arXiv:1008.1040).
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..checks import integer, short, wrong
from . import arithmetic, functions
from .arithmetic import Exponents, Point, Polynomials
from .functions import rank_of_quotients
from .maps import RationalMap, check_map
from .reconstruction import over_rationals, polynomials_with
from .relations import counts, integrals_of, relations_along
from .search import Search

_MOST = 500  # monomials up to a degree

Matrix = tuple[Point, ...]


@dataclass(frozen=True)
class HKBasis:
    """Linear relations between `monomials` along orbits, as `hk_bases` returns them.

    The rows of `basis`, `dimension` of them, are coefficients of relations along the orbit of
    `point`: the last nonzero entry of a row is 1, and 0 in the others; None if they are too long,
    or eps is symbolic. On random orbits, `independent` of the coefficients are independent first
    integrals. The quotients of `integrals` are first integrals too, and `complete` is True if as
    many of these are independent. `degree` is that of the monomials.
    """

    degree: int
    monomials: Exponents = field(repr=False)
    dimension: int
    independent: int
    integrals: Polynomials
    complete: bool
    point: Point = field(repr=False)
    basis: Matrix | None = field(repr=False)
    names: tuple[str, ...] | None = field(default=None, repr=False)  # if not x1, ..., xD

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        rows = [[[a] for a in row] for row in self.basis or ()]
        found = polynomials_with(rows, self.monomials)
        return tuple(arithmetic.renamed(P, self.names) for P in found)

    def __repr__(self) -> str:
        text = (
            f"HKBasis(degree={self.degree}, dimension={self.dimension}, "
            f"independent={self.independent}, integrals={self.integrals}, complete={self.complete})"
        )
        if self.complete:
            return text
        missing = self.independent - rank_of_quotients(self.integrals)
        return f"{text}; {missing} more independent: try a higher degree, or `report`"


def hk_bases(
    map: RationalMap,
    monomials: int | Sequence[Sequence[int]],
    *,
    point: Any = None,
    seed: int = 0,
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits (arXiv:1008.1040).

    The coefficients of a relation in the form of `HKBasis.basis` are first integrals; the rank of
    their derivatives is the number of independent ones. If the relations of all orbits span one
    dimension more than those of one orbit, quotients of relations are first integrals, too;
    if a degree is given, Darboux polynomials of equal cofactor are sought, too. An orbit has 10
    points more than there are monomials.

    Parameters
    ----------
    map, seed
        As in :func:`darboux_polynomials`.
    monomials : int or sequence of exponents
        The exponents (e1, ..., eD) of each monomial, or a largest degree: then the basis is that of
        the lowest degree that shows as many independent integrals.
    point : sequence of D rational numbers, optional
        Point whose orbit `basis` and `dimension` belong to; by default random integers below 100.

    Returns
    -------
    HKBasis
        If its `dimension` is 0, no quotient of two linear combinations of the monomials is a first
        integral.

    Raises
    ------
    ArithmeticError
        If there is no map, or the orbit of `point`, or of most points, ends at a pole.

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
    n, seed = map.dimension, integer("seed", seed, 0)
    exponents, by_degree = exponents_of(monomials, n), isinstance(monomials, int | np.integer)
    rng = random.Random(seed)
    start = arithmetic.rationals(
        "point", rng.sample(range(2, 100), n) if point is None else point, n
    )
    dimension, independent = counts(map, exponents, seed)
    integrals: Polynomials = ()
    if by_degree and independent:
        integrals = _integrals(map, _degree(exponents), independent, seed)
        for d in range(1, _degree(exponents)):
            lower = arithmetic.exponents_up_to(d, n)
            if counts(map, lower, seed)[1] == independent:
                exponents, (dimension, _) = lower, counts(map, lower, seed)
                break
    elif independent:
        integrals = integrals_of(map, exponents, seed)
    complete = rank_of_quotients(integrals) == independent
    basis: Any = None if map.has_letter else ()
    if not map.has_letter and (dimension > 0 or point is not None):
        rows = over_rationals(
            rng,
            lambda p, eps: relations_along(
                map, exponents, p, eps, arithmetic.point_modulo(p, start)
            ),
        )
        basis = rows and tuple(tuple(a for (a,) in row) for row in rows)
        dimension = dimension if basis is None else len(basis)
    return HKBasis(
        _degree(exponents),
        exponents,
        dimension,
        independent,
        tuple(arithmetic.renamed(P, map.names) for P in integrals),
        complete,
        start,
        basis,
        map.names,
    )


def _integrals(map: RationalMap, degree: int, enough: int, seed: int) -> Polynomials:
    """Return polynomials whose quotients are first integrals, until enough are independent."""
    search = Search(map, degree, seed, only_integrals=True)
    for _ in search.queue:
        if len(search.known.integrals) >= enough:
            break
    polynomials = functions.over_common_denominator(search.known.integrals, map.ring)
    return tuple(sorted(polynomials, key=arithmetic.size))


def _degree(exponents: Exponents) -> int:
    return max(sum(e) for e in exponents)


def exponents_of(monomials: Any, n: int) -> Exponents:
    """Return the exponents of monomials in n variables, those up to a degree in ascending order."""
    if isinstance(monomials, int | np.integer):
        degree = integer("monomials", monomials, 0)
        arithmetic.check_unknowns("monomials", degree, n, _MOST)
        return arithmetic.exponents_up_to(degree, n)
    try:
        exponents = tuple(tuple(integer("monomials", e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong("monomials", "a degree or a list of exponents", monomials, TypeError) from None
    if {*map(len, exponents)} != {n} or not len({*exponents}) == len(exponents) <= _MOST:
        expected = f"at most {_MOST} different tuples of {n} exponents"
        raise wrong("monomials", expected, short(monomials))
    return exponents
