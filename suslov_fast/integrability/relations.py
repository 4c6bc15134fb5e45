"""Linear relations between monomials along orbits modulo primes, and the integrals they show.

They are the null space of the monomials at the points of an orbit, which has some points more than
there are monomials (arXiv:1008.1040).
"""

import random
from functools import lru_cache
from typing import Any

import flint

from . import arithmetic
from .arithmetic import MORE, Exponents, Polynomials, Residues, monomial_values
from .maps import RationalMap
from .reconstruction import over_rationals, polynomials_with


def relations_along(
    map: RationalMap, exponents: Exponents, p: int, eps: int, x: list[Any]
) -> Residues:
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
        relations = relations_along(map, exponents, p, eps, x)
        if not relations:
            return 0, 0
        ring = arithmetic.ring(n, False, flint.nmod_mpoly_ctx, p)
        polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
        gradients = [[each.derivative(i) for i in range(n)] for each in polynomials]
        rows = []
        for y, derivative in map.at(eps).variations(x, count + MORE):
            values = [[each(*y[:-1]) for each in row] for row in gradients]
            changes = flint.nmod_mat(values, p) * derivative
            rows.append([*monomial_values(exponents, y), *changes.entries()])
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
        rows = [row for x in points for row in relations_along(map, exponents, p, eps, x)]
        reduced, rank = flint.nmod_mat(rows, p).rref()
        return arithmetic.integer_rows(reduced)[:rank] if rank == dimension + 1 else []

    rows = over_rationals(rng, span, map.has_letter)
    return polynomials_with(rows or [], exponents, map.has_letter)
