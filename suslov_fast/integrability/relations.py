"""Hirota-Kimura bases: linear relations between monomials along orbits."""

import contextlib
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import flint
import numpy as np

from ..checks import integer, short, wrong
from . import arithmetic, functions
from .arithmetic import MORE, Exponents, Point, Polynomials, Residues, monomial_values
from .functions import rank_of_quotients
from .invariants import Invariants
from .maps import RationalMap, check_map
from .reconstruction import over_rationals, polynomials_with

_MOST = 500  # monomials up to a degree

Matrix = tuple[Point, ...]


@dataclass(frozen=True)
class HKBasis:
    """Linear relations between `monomials` along orbits, as `hk_bases` returns them.

    The rows of `basis`, `dimension` of them, are coefficients of relations along the orbit of
    `point`: the last nonzero entry of a row is 1, and 0 in the others; None if they are too long,
    or eps is a letter. On random orbits, `independent` of the coefficients are independent first
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

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        rows = [[[a] for a in row] for row in self.basis or ()]
        return polynomials_with(rows, self.monomials)

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
    otherwise, if a degree is given, Darboux polynomials of equal cofactor are sought. An orbit has
    10 points more than there are monomials.

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
    exponents, by_degree = _exponents(monomials, n), isinstance(monomials, int | np.integer)
    rng = random.Random(seed)
    start = arithmetic.rationals(
        "point", rng.sample(range(2, 100), n) if point is None else point, n
    )
    _, independent = counts(map, exponents, seed)
    tried = [exponents]
    if by_degree and independent:
        tried = [arithmetic.exponents_up_to(d, n) for d in range(1, _degree(exponents) + 1)]
    integrals: Polynomials = ()
    for exponents in tried:
        integrals = max(integrals, integrals_of(map, exponents, seed), key=rank_of_quotients)
        dimension, shown = counts(map, exponents, seed)
        if shown == independent:
            break
    if by_degree and rank_of_quotients(integrals) < independent:
        invariants = Invariants(map)
        with contextlib.suppress(ArithmeticError, ValueError):  # too long
            for k in range(1, _degree(exponents) + 1):
                invariants.of_degree(k)
            found = functions.independent(invariants.quotients)
            *above, below = functions.over_common_denominator(found, map.ring)
            integrals = max(integrals, (below, *above), key=rank_of_quotients)
    complete = rank_of_quotients(integrals) == independent
    basis: Any = None if map.has_letter else ()
    if not map.has_letter and (dimension > 0 or point is not None):
        rows = over_rationals(
            rng,
            lambda p, eps: _relations(map, exponents, p, eps, arithmetic.point_modulo(p, start)),
        )
        basis = rows and tuple(tuple(a for (a,) in row) for row in rows)
        dimension = dimension if basis is None else len(basis)
    return HKBasis(
        _degree(exponents), exponents, dimension, independent, integrals, complete, start, basis
    )


def _relations(map: RationalMap, exponents: Exponents, p: int, eps: int, x: list[Any]) -> Residues:
    """Return the relations along an orbit, in the form of `HKBasis.basis`."""
    orbit = map.at(eps).orbit(x, len(exponents) + MORE)
    return arithmetic.null_space(
        flint.nmod_mat([[*monomial_values(exponents, y)] for y in orbit], p)
    )


@lru_cache(maxsize=32)
def counts(map: RationalMap, exponents: Exponents, seed: int) -> tuple[int, int]:
    """Return the number of relations along an orbit, and of the independent integrals they show.

    The latter is the rank of the derivatives of their coefficients c by the first point x_0, from
    the derivatives of ``sum_i c_i m_i(x_k) = 0`` for each k.
    """
    rng, n, count = random.Random(seed), map.dimension, len(exponents)

    def count_once(p: int, eps: int) -> tuple[int, int]:
        x = arithmetic.random_point(n, p, rng)
        relations = _relations(map, exponents, p, eps, x)
        if not relations:
            return 0, 0
        ring = arithmetic.ring(n, False, flint.nmod_mpoly_ctx, p)
        polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
        gradients = [[each.derivative(i) for i in range(n)] for each in polynomials]
        derivative = flint.nmod_mat(np.eye(n, dtype=int).tolist(), p)  # of x_k
        rows = []
        for y in map.at(eps).orbit(x, count + MORE):
            values = [[each(*y[:-1]) for each in row] for row in gradients]
            changes = flint.nmod_mat(values, p) * derivative
            rows.append([*monomial_values(exponents, y), *changes.entries()])
            derivative = map.at(eps).derivative(y) * derivative
        reduced = flint.nmod_mat(rows, p).rref()[0].tolist()[: count - len(relations)]
        starts = range(count, len(rows[0]), n)
        rank = flint.nmod_mat([row[k : k + n] for row in reduced for k in starts], p).rank()
        return len(relations), int(rank)

    return arithmetic.confirmed(rng, count_once)  # type: ignore[no-any-return]


def integrals_of(map: RationalMap, exponents: Exponents, seed: int) -> Polynomials:
    """Return the polynomials of all relations if their quotients are first integrals."""
    rng, (dimension, _) = random.Random(seed), counts(map, exponents, seed)
    if dimension == 0:
        return ()

    def span(p: int, eps: int) -> Residues:
        points = [arithmetic.random_point(map.dimension, p, rng) for _ in range(3)]
        rows = [row for x in points for row in _relations(map, exponents, p, eps, x)]
        reduced, rank = flint.nmod_mat(rows, p).rref()
        return arithmetic.integer_rows(reduced)[:rank] if rank == dimension + 1 else []

    rows = over_rationals(rng, span, map.has_letter)
    return polynomials_with(rows or [], exponents, map.has_letter)


def _degree(exponents: Exponents) -> int:
    return max(sum(e) for e in exponents)


def _exponents(monomials: Any, n: int) -> Exponents:
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
        expected = f"{n} exponents for each monomial, none twice, and at most {_MOST} monomials"
        raise wrong("monomials", expected, short(monomials))
    return exponents
