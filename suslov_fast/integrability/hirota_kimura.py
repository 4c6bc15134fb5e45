"""Hirota-Kimura bases: relations between monomials along an orbit, with rational coefficients.

`linear_relations` says how they are found, and why they give first integrals.
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from ..checks import integer, short, wrong
from ..fields.base import Body
from ..keywords import public
from . import arithmetic, polynomials, rational_functions
from .arithmetic import Point, Residues, Rows, Values
from .birational_maps import RationalMap
from .darboux import checked_degree
from .exact_maps import checked_map
from .interpolation import over_rationals
from .linear_relations import count_relations, integrals_of_relations, relations_along
from .polynomials import Exponents, Polynomials, exponents_up_to, renamed, sort_key
from .rational_functions import RationalFunction, over_common_denominator, quotient_of
from .search import Search
from .tolerances import MOST_MONOMIALS_OF_RELATIONS


@dataclass(frozen=True)
class HKBasis:
    """Linear relations between `monomials` along orbits, as `hk_bases` returns them.

    The `dimension` rows of `basis` are coefficients of relations along the orbit of `point`. The
    last nonzero entry of a row is 1, and 0 in the other rows. `basis` is None if the numbers are
    too long, or eps is symbolic. `independent` is the number of independent first integrals among
    coefficients on random orbits. `integrals` are formulas: quotients of the polynomials `forms`.
    `complete` is True if `integrals` has formulas for all of them. `degree` is the highest degree
    of `monomials`.
    """

    degree: int
    monomials: Exponents
    dimension: int
    independent: int
    forms: Polynomials
    complete: bool
    point: Point
    basis: tuple[Point, ...] | None
    names: tuple[str, ...] | None = None  # names of the variables, if not x1, ..., xD

    @property
    def integrals(self) -> tuple[RationalFunction, ...]:
        """First integrals, as `report` returns them: the quotients of `forms` by the last one."""
        return tuple(quotient_of(P, self.forms[-1], "") for P in self.forms[:-1])

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        one: dict[Values, Any] = {(): Fraction(1)}
        rows: Rows = [[({(): a}, one) for a in row] for row in self.basis or ()]
        space = polynomials.polynomials_with(rows, self.monomials)
        return tuple(renamed(P, self.names) for P in space)

    def __repr__(self) -> str:
        text = (
            f"HKBasis(degree={self.degree}, dimension={self.dimension}, "
            f"independent={self.independent}, integrals={self.integrals}, complete={self.complete})"
        )
        if self.complete:
            return text
        missing = self.independent - rational_functions.rank_of_quotients(self.forms)
        return f"{text}; {missing} more independent: try a higher degree, or `report`"


@public
def hk_bases(
    map: RationalMap | Body,
    monomials: int | Sequence[Sequence[int]],
    *,
    point: Any = None,
    letters: Any = None,
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits (arXiv:1008.1040).

    The coefficients of a relation in the form of `HKBasis.basis` are first integrals; the rank of
    their derivatives is the number of independent ones. If a degree is given, quotients of Darboux
    polynomials are sought as well. An orbit has 10 points more than there are monomials.

    Parameters
    ----------
    map
        As in :func:`darboux_polynomials`.
    monomials : int or sequence of exponents
        The exponents (e1, ..., eD) of each monomial, or a largest degree: then the basis is for the
        lowest degree that shows as many independent integrals.
    point : sequence of D rational numbers, optional
        `basis` and `dimension` belong to its orbit. By default random integers below 100.
    letters : str or sequence of str, optional
        As in :func:`darboux_polynomials`: then `integrals` hold for all values of these parameters.

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
    >>> from suslov_fast import Field, Suslov3D
    >>> from suslov_fast.integrability import hk_bases, kahan
    >>> map = kahan(Suslov3D(4, 1, -0.5, -0.25).field(), eps=0.25)
    >>> hk_bases(map, 1).dimension, hk_bases(map, 4).dimension
    (0, 1)
    >>> hk_bases(map, 4).integrals
    ((4*Omega1^2 + Omega2^2)/(Omega1*Omega2 + 1024),)
    """
    map = checked_map(map, letters)
    n = map.dimension
    exponents = _exponents_of(monomials, n)
    given = random.Random(0).sample(range(2, 100), n) if point is None else point
    start = arithmetic.rationals("point", given, n)
    dimension, independent = count_relations(map, exponents)
    integrals: Polynomials = ()
    if independent and isinstance(monomials, int | np.integer):
        integrals = _integrals_up_to(map, int(monomials), independent)
        for d in range(1, int(monomials)):
            lower = exponents_up_to(d, n)
            counted = count_relations(map, lower)
            if counted.integrals == independent:
                exponents, dimension = lower, counted.relations
                break
    elif independent:
        integrals = integrals_of_relations(map, exponents)
    complete = rational_functions.rank_of_quotients(integrals) == independent
    basis: tuple[Point, ...] | None = None if map.is_symbolic else ()
    if not map.is_symbolic and (dimension > 0 or point is not None):

        def search(p: int, eps: Values) -> Residues:
            return relations_along(map, exponents, eps, arithmetic.point_modulo(p, start))

        rows = over_rationals(map.generator(), search)
        basis = None if rows is None else tuple(tuple(N[()] for N, _ in row) for row in rows)
        dimension = dimension if basis is None else len(basis)
    return HKBasis(
        degree=max(sum(e) for e in exponents),
        monomials=exponents,
        dimension=dimension,
        independent=independent,
        forms=tuple(renamed(P, map.names, map.letter) for P in integrals),
        complete=complete,
        point=start,
        basis=basis,
        names=map.names,
    )


def _exponents_of(monomials: Any, n: int) -> Exponents:
    """Return `monomials`, a degree or exponents in n variables, as a checked tuple of exponents."""
    if isinstance(monomials, int | np.integer):
        return exponents_up_to(
            checked_degree("monomials", monomials, n, most=MOST_MONOMIALS_OF_RELATIONS), n
        )
    most = MOST_MONOMIALS_OF_RELATIONS
    expected = f"a degree, or a list of at most {most} different tuples of {n} exponents"
    try:
        exponents = tuple(tuple(integer("monomials", e, 0) for e in each) for each in monomials)
    except TypeError:
        raise wrong("monomials", expected, short(monomials), TypeError) from None
    are_different = len({*exponents}) == len(exponents)
    if (
        {*map(len, exponents)} != {n}
        or not are_different
        or len(exponents) > MOST_MONOMIALS_OF_RELATIONS
    ):
        raise wrong("monomials", expected, short(monomials))
    return exponents


def _integrals_up_to(map: RationalMap, degree: int, enough: int) -> Polynomials:
    """Search for `enough` integrals to a degree; return numerators and a common denominator."""
    search = Search(map, degree, only_integrals=True)
    for _ in search.queue:
        if len(search.known.integrals) >= enough:
            break
    return (*sorted(over_common_denominator(search.known.integrals, map.ring), key=sort_key),)
