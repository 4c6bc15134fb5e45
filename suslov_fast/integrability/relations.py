"""Linear relations ``sum_i c_i m_i(x_k) = 0`` between monomials along orbits, modulo primes.

They are the null space of the monomials at the points x_k of an orbit, which has some points more
than there are monomials (Petrera, Pfadler and Suris, arXiv:1008.1040). The coefficients depend on
the orbit alone. `bases`, `implicit`, `locus` and `search` use them.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import flint

from . import arithmetic
from .arithmetic import EXTRA, Residues
from .maps import RationalMap
from .polynomials import Exponents, Polynomials, monomial_values, ring_modulo
from .reconstruction import over_rationals, polynomials_with

_ORBITS = 3  # whose relations span those of all orbits


def monomials_along(map: RationalMap, exponents: Exponents, x: Sequence[Any], length: int) -> Any:
    """Return the values of monomials at the points of an orbit modulo a prime, in rows."""
    return arithmetic.matrix([monomial_values(exponents, y) for y in map.orbit(x, length)])


def relations_along(map: RationalMap, exponents: Exponents, eps: int, x: list[Any]) -> Residues:
    """Return the relations along an orbit modulo a prime, in the form of `HKBasis.basis`."""
    length = len(exponents) + EXTRA
    return arithmetic.null_space(monomials_along(map.at_eps(eps), exponents, x, length))


def gradients_of_coefficients(
    map: RationalMap, exponents: Exponents, relations: Residues, x: Sequence[Any], length: int
) -> list[list[list[Any]]]:
    """Return the gradients by x of the coefficients of relations, by relation and coefficient.

    They solve ``sum_i m_i(x_k) dc_i = -sum_i c_i dm_i(x_k)``, the derivatives of the relations at
    the points x_k of the orbit of x. Relations must be a basis in echelon form: the coefficients
    that can be chosen freely, as many as relations, are constant and left out.
    """
    p, n, count = int(x[0].modulus()), map.dimension, len(exponents)
    ring = ring_modulo(p, n)
    polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
    slopes = [[P.derivative(i) for i in range(n)] for P in polynomials]
    rows = []  # the equations at x_k: all m_i, and right sides for each relation
    for y, derivative in map.variations(x, length):
        values = flint.nmod_mat([[dP(*y[:-1]) for dP in of_relation] for of_relation in slopes], p)
        rows.append([*monomial_values(exponents, y), *(values * derivative * -1).entries()])
    solved = flint.nmod_mat(rows, p).rref()[0].tolist()[: count - len(relations)]
    return [[row[k : k + n] for row in solved] for k in range(count, len(rows[0]), n)]


@lru_cache(maxsize=32)
def count_relations(map: RationalMap, exponents: Exponents, seed: int) -> tuple[int, int]:
    """Return the number of relations along an orbit, and of the independent integrals they show.

    The latter is the rank of the gradients of their coefficients.
    """
    rng = map.generator(seed)

    def count_modulo(p: int, eps: int) -> tuple[int, int]:
        x = arithmetic.random_point(map.dimension, p, rng)
        relations = relations_along(map, exponents, eps, x)
        if not relations:
            return 0, 0
        length = len(exponents) + EXTRA
        gradients = gradients_of_coefficients(map.at_eps(eps), exponents, relations, x, length)
        rows = [gradient for of_relation in gradients for gradient in of_relation]
        return len(relations), int(flint.nmod_mat(rows, p).rank())

    return arithmetic.agreed_by_primes(rng, count_modulo)  # type: ignore[no-any-return]


def integrals_of_relations(map: RationalMap, exponents: Exponents, seed: int) -> Polynomials:
    """Return the polynomials of all relations if their quotients are first integrals, else ().

    They are if the relations of all orbits span one dimension more than those of one orbit.
    """
    rng, (dimension, _) = map.generator(seed), count_relations(map, exponents, seed)
    if dimension == 0:
        return ()

    def span(p: int, eps: int) -> Residues:
        points = [arithmetic.random_point(map.dimension, p, rng) for _ in range(_ORBITS)]
        rows = [row for x in points for row in relations_along(map, exponents, eps, x)]
        basis = arithmetic.row_space(rows, p)
        return basis if len(basis) == dimension + 1 else []

    rows = over_rationals(rng, span, map.is_symbolic)
    return polynomials_with(rows or [], exponents, map.is_symbolic)
