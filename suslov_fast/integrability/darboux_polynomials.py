"""The Darboux polynomials of a map up to a degree, of one cofactor or of all.

Combinations of products of polynomials of lower degree are left out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ..checks import integer, kind_of, wrong
from ..fields.base import Body
from ..keywords import public
from . import arithmetic
from .birational_maps import RationalMap
from .darboux import check_unknowns, cofactors_of_degree, space_of
from .invariants import Invariants, NormalForms
from .letters import checked_map
from .polynomials import Polynomials, renamed, sort_key, with_plain_letters
from .rational_functions import RationalFunction, factored


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
        Names of parameters of a field or a body that stay symbols beside eps, ``"a b"``. The
        polynomials have them as variables before x1, ..., xD.

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
    degree = integer("degree", degree, 0)
    check_unknowns("degree", degree, map.dimension)
    if cofactor is None:
        found = _of_all_cofactors(map, degree)
    elif cofactor == map.determinant:
        found = space_of(map, degree, None)
    else:
        if callable(cofactor) and not isinstance(cofactor, RationalFunction):
            expected = "map.determinant, a number or a result of cofactors(map, degree)"
            raise wrong("cofactor", expected, kind_of(cofactor), TypeError)
        if not callable(cofactor):
            cofactor = RationalFunction((), arithmetic.rational("cofactor", cofactor))
        found = space_of(map, degree, cofactor)
    return tuple(with_plain_letters(renamed(P, map.names, map.letter)) for P in found)


def _of_all_cofactors(map: RationalMap, degree: int) -> Polynomials:
    known = Invariants(map, degree)
    forms = NormalForms(known)
    usual = [RationalFunction(()), map.jacobian_cofactor]
    for k in range(1, degree + 1):
        for cofactor in dict.fromkeys([*cofactors_of_degree(map, k), *usual]):
            for P in sorted(space_of(map, k, cofactor), key=sort_key):
                if not known.is_known(P, cofactor):
                    known.add(replace(factored(P), cofactor=cofactor))
            forms.update(known.value(cofactor))
    return tuple(known.polynomial(g) for g in known.polynomials)
