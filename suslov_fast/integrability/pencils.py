"""Reducible members of a pencil of polynomials, and numbers of factors over complex numbers.

On a plane with coordinates u and v, f = f_1 ... f_r has r independent pairs (g, h) of polynomials
of lower degree with d/dv (g / f) = d/du (h / f): g = f (d/du f_i) / f_i, and h in the same way
(Ruppert 1986, Gao 2003). One combination of these pairs is the gradient of f. For a member first +
t second of a pencil the matrix of these equations is linear in t. Its rank falls at the reducible
members, where t is an eigenvalue.
"""

import random
from collections.abc import Iterator, Sequence
from typing import Any

import flint
import numpy as np

from . import polynomials
from .arithmetic import EPS, Values
from .polynomials import coefficients_in, degree_of, exponents_up_to, modulo, prime_of, variables_of
from .rational_functions import factors_in_t
from .tolerances import HIGHEST_PENCIL


def _equations(space: Sequence[Any], degree: int, p: int, rng: random.Random) -> Iterator[Any]:
    """Yield the matrix of d/dv (g / f) = d/du (h / f), on one random plane, for each f of `space`.

    Columns are the terms of f^2 (d/dv (g / f) - d/du (h / f)) for each monomial g, then h. The
    first column is left out, so that the gradient of f is no solution.
    """
    ring = polynomials.ring_modulo(p, 2)
    u, v = ring.gens()
    draws = [[rng.randrange(1, p) for _ in range(3)] for _ in range(variables_of(space[0]))]
    points = [a + b * u + c * v for a, b, c in draws]
    monomials = [ring.from_dict({e: 1}) for e in exponents_up_to(degree - 1, 2)]
    exponents = exponents_up_to(2 * degree - 2, 2)
    for f in (P.compose(*points, ctx=ring) for P in space):
        columns = []
        for variable, sign in ((1, 1), (0, -1)):
            slope = f.derivative(variable)
            for g in monomials:
                terms = (sign * (g.derivative(variable) * f - g * slope)).to_dict()
                columns.append([int(terms.get(e, 0)) for e in exponents])
        yield flint.nmod_mat(columns[1:], p).transpose()


def count_factors(P: Any) -> int:
    """Return the number of irreducible factors of P over complex numbers, if none is repeated."""
    degree, n = degree_of(P), variables_of(P)
    if degree < 1 or n < 2:
        return degree
    p = prime_of([P])
    (matrix,) = _equations([modulo(P, p, EPS)], degree, p, random.Random(0))
    return 1 + int(matrix.ncols() - matrix.rank())


def reducible_members(space: Sequence[Any]) -> Iterator[Any]:
    """Yield the reducible combinations a P + b Q of a space [P, Q]; a and b are rational."""
    return (P for P, equation in conjugate_members(space) if len(equation) == 2)


class AllReducible(ArithmeticError):
    """Raised for a pencil of which all members are reducible."""


def conjugate_members(space: Sequence[Any]) -> Iterator[tuple[Any, list[Any]]]:
    """Yield products of conjugate reducible combinations P - h Q of a space [P, Q].

    With each product, yield the coefficients [c_0, c_1, ...] of the irreducible equation for h,
    polynomials in letters. The equation of Q itself is [1, 0].
    """
    degree, n = max(degree_of(P) for P in space), variables_of(space[0])
    if len(space) != 2 or not 2 <= degree <= HIGHEST_PENCIL or n < 2:
        return
    rng = random.Random(0)
    # Two generic members of the pencil: each reducible one is then first + t second, with finite t.
    weights = [[rng.randrange(1, 100) for _ in space] for _ in space]
    first, second = (sum(a * P for a, P in zip(row, space, strict=True)) for row in weights)
    if polynomials.rank([first, second]) < 2:
        return

    def search(p: int, eps: Values) -> list[Any]:
        rng, residues = random.Random(p), [modulo(P, p, eps) for P in (first, second)]
        common = flint.nmod_poly([0], p)
        for _ in range(2):  # two random planes: roots t of only one plane are left out
            A, B = _equations(residues, degree, p, rng)
            if A.rank() < A.ncols():
                raise AllReducible
            common = common.gcd(_values_of_lost_rank(A, B, p, rng))
        # Where the rank falls by more than 1, t is a multiple root; here it becomes a simple one.
        common //= common.gcd(common.derivative()) if common.degree() > 0 else 1
        return common.coeffs() if common.degree() > 0 else []

    ring, rng = first.context(), random.Random(prime_of([first, second]))
    for g in factors_in_t(rng, search, ring):
        # The product of first + t second for all roots t of g; h = -(b + d t) / (a + c t) for it.
        coefficients = [c.project_to_context(ring) for c in coefficients_in(g, -1)]
        n, ((a, b), (c, d)) = len(coefficients) - 1, weights
        terms = (e * (-first) ** k * second ** (n - k) for k, e in enumerate(coefficients))
        h = flint.fmpz_poly([0, 1])
        # t = -(b + a h) / (d + c h)
        powers = [(-(b + a * h)) ** k * (d + c * h) ** (n - k) for k in range(n + 1)]
        equation = [
            sum(e * int(P[j]) for e, P in zip(coefficients, powers, strict=True))
            for j in range(n + 1)
        ]
        yield polynomials.without_content(sum(terms, 0 * first)), equation


def _values_of_lost_rank(first: Any, second: Any, p: int, rng: random.Random) -> Any:
    """Return a polynomial in t that is 0 where the matrix first + t second loses rank.

    Random combinations of rows make the matrices square; further roots depend on their choice.
    """
    columns, rows = first.ncols(), first.nrows()
    draws = np.frombuffer(rng.randbytes(8 * columns * rows), np.uint64) >> 2
    mix = flint.nmod_mat(columns, rows, draws.tolist(), p)
    A, B = mix * first, mix * second
    # As a polynomial in t, det(A + t B) / det A has the coefficients of the characteristic
    # polynomial of A**-1 B in reverse order, with alternating signs.
    backward = A.solve(B).charpoly().coeffs()[::-1]
    return flint.nmod_poly([int(-c if k % 2 else c) for k, c in enumerate(backward)], p)
