"""Affine reversing symmetries of Kahan maps.

R(x) = S x + b transforms the Kahan map of a field f to the Kahan map of S f(R^-1 x). So R takes the
map to its inverse, for every eps, if f(S x + b) = -S f(x): quadratic equations in the entries of S
and b. An involution also satisfies S S = 1 and S b = -b. Products of these equations and monomials
up to some degree are linear equations in monomials, which are solved modulo a prime, for each trace
of S.

Where solutions of a trace come in families, f commutes with affine fields A x + a. Their flows
conjugate each solution R to others. So R is isolated only if it commutes with these flows, which
gives linear equations for S and b. Conversely, near an R that commutes with them, other solutions
are R exp(A), and no involutions. In families only signed permutations are found.
"""

import math
import random
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, permutations, product
from operator import add, mul
from typing import Any

import flint
import numpy as np

from ..fields.exact_numbers import text_of
from ..fields.names import labels
from . import arithmetic
from .arithmetic import EPS, Point, simplest_fraction
from .kahan_maps import KahanMap
from .polynomials import exponents_up_to, ring_modulo
from .tolerances import LARGEST_ENTRY_OF_SYMMETRY, MOST_DIMENSIONS_OF_SHIFT

DEGREES = {1: 5, 2: 5, 3: 4}  # by dimension: the largest degree of an equation times a monomial


@dataclass(frozen=True)
class Reversor:
    """A reversing symmetry x -> S x + b: an involution that takes the map to its inverse."""

    S: tuple[Point, ...]
    b: Point
    names: tuple[str, ...]  # names of the variables

    def __call__(self, x: Any) -> Point:
        """Return the image of a point, D rational numbers."""
        point = arithmetic.rationals("x", x, len(self.b))
        return tuple(sum(map(mul, row, point), c) for row, c in zip(self.S, self.b, strict=True))

    def __repr__(self) -> str:
        texts = []
        for row, constant in zip(self.S, self.b, strict=True):
            terms = {(): constant} | {(i,): a for i, a in enumerate(row)}
            texts.append(text_of({i: c for i, c in terms.items() if c}, self.names))
        return f"x -> ({', '.join(texts)})"


def reversors(map: KahanMap) -> tuple[list[Reversor], str]:
    """Return affine involutions with rational entries that reverse a map, and what was sought.

    They are the signed permutations and, up to three variables, the isolated ones.
    """
    D, p, letters = map.dimension, map.prime, map.letters
    numbers = [*EPS[: len(letters)], *[0] * D]  # values of letters and x
    rates = map._rates[0]
    terms = [(place, int(v(*numbers) if map.in_letters else v) % p) for place, v in rates]
    x, found, left_out = arithmetic.random_point(D, p)[:-1], list[list[Any]](), set[str]()
    for order in (e for e in permutations(range(D)) if all(e[j] == i for i, j in enumerate(e))):
        for signs in product((1, -1), repeat=D):
            rows = [[signs[i] * (order[i] == j) for j in range(D)] for i in range(D)]
            if not any(_identities(terms, rows, [0] * D, x)):
                found.append([*chain(*rows)])
    if D in DEGREES:
        unknowns = ring_modulo(p, D * D + D * (D <= MOST_DIMENSIONS_OF_SHIFT))
        equations, diagonal = _equations(D, terms, unknowns), unknowns.gens()[: D * D : D + 1]
        for trace in range(-D, D, 2):  # the trace D belongs to S = 1, which reverses no map
            every = [*equations, sum(diagonal) - trace]
            isolated = _isolated_solutions(every, unknowns, DEGREES[D])
            if isolated is None:
                if commuting := _commuting(D, terms, unknowns):
                    left_out.add("in families")
                isolated = _isolated_solutions([*every, *commuting], unknowns, DEGREES[D])
                if isolated is None:
                    left_out.add("of equations of high degree")
            found += isolated or []
    symmetries = dict[Reversor, None]()
    for solution in found:
        values = [*solution, *[0] * D][: D * D + D]  # b = 0 if it is not among the unknowns
        entries = [simplest_fraction(int(a) % p, p) for a in values]
        if all(max(abs(a.numerator), a.denominator) < LARGEST_ENTRY_OF_SYMMETRY for a in entries):
            S = tuple(tuple(entries[D * i : D * i + D]) for i in range(D))
            reversor = Reversor(S, tuple(entries[D * D :]), labels(D))
            if reversor not in symmetries and reverses(reversor, map):
                symmetries[reversor] = None
    ordered = sorted(symmetries, key=lambda reversor: (len(repr(reversor)), repr(reversor)))
    names = map.field._layout.components
    sought = "signed permutations"
    if D in DEGREES:
        kind = "affine" if D <= MOST_DIMENSIONS_OF_SHIFT else "linear"
        sought += f", and {kind} ones with rational entries"
        sought += "; not others, " * bool(left_out) + " or ".join(sorted(left_out))
    return [replace(reversor, names=names) for reversor in ordered], sought


def reverses(reversor: Reversor, map: KahanMap) -> bool:
    """Return True if f(S x + b) = -S f(x), and the symmetry is an involution."""
    ring = flint.fmpq_mpoly_ctx.get(map.ring.names(), ordering="deglex")
    *S, b = ([arithmetic.fmpq(a) for a in row] for row in (*reversor.S, reversor.b))
    x = ring.gens()[len(map.letters) :]
    members = ((place, map.ring.constant(1) * v) for place, v in map._rates[0])
    terms = [(place, ring.from_dict(v.to_dict())) for place, v in members]
    return not any(P != 0 for P in _identities(terms, S, b, x))


def _identities(terms: Any, S: Any, b: Any, x: Any) -> list[Any]:
    """Return f(R(x)) + S f(x) and R(R(x)) - x for R(x) = S x + b; they are 0 for a symmetry.

    `terms` are pairs ((i, j, k), c) for c x_j x_k in f_i, up to a common factor.
    """
    zero = 0 * x[0]

    def image(y: Sequence[Any]) -> list[Any]:
        return [sum(map(mul, row, y), zero + c) for row, c in zip(S, b, strict=True)]

    def slopes(y: Sequence[Any]) -> list[Any]:
        factors, sums = [*y, zero + 1], [zero] * len(x)
        for (i, j, k), c in terms:
            sums[i] += c * factors[j] * factors[k]
        return sums

    here, there = slopes(x), slopes(image(x))
    reversing = [f + sum(map(mul, row, here)) for f, row in zip(there, S, strict=True)]
    return [*reversing, *(a - c for a, c in zip(image(image(x)), x, strict=True))]


def _equations(D: int, terms: Any, unknowns: Any) -> list[Any]:
    """Return the equations for S and b, in the ring `unknowns`, for a field with these terms."""
    n, p = unknowns.nvars(), int(unknowns.modulus())
    gens = ring_modulo(p, n + D).gens()
    S, b = [gens[D * i : D * i + D] for i in range(D)], gens[D * D : n] or [0] * D
    equations: list[Any] = []
    for P in _identities(terms, S, b, gens[n:]):
        by_monomial = defaultdict[Any, dict[Any, int]](dict)
        for e, c in P.to_dict().items():
            by_monomial[e[n:]][e[:n]] = int(c)
        equations += map(unknowns.from_dict, by_monomial.values())
    return [equation for equation in equations if equation != 0]


def _commuting(D: int, terms: Any, unknowns: Any) -> list[Any]:
    """Return the linear equations for S and b of maps that commute with the symmetries of a field.

    These are the affine fields A x + a, linear ones if b is not unknown, that commute with it.
    """
    p, count = int(unknowns.modulus()), unknowns.nvars()
    ring = ring_modulo(p, count + D)
    entries, x = ring.gens()[:count], ring.gens()[count:]
    A, a = [entries[D * i : D * i + D] for i in range(D)], entries[D * D :] or [0] * D
    field = [sum(map(mul, row, x), 0 * x[0] + c) for row, c in zip(A, a, strict=True)]
    rates = [0 * x[0]] * D
    for (i, j, k), c in terms:
        rates[i] += c * ([*x, 1][j]) * ([*x, 1][k])
    rows = list[list[int]]()
    for i in range(D):
        bracket = -sum(map(mul, A[i], rates), 0 * x[0])
        bracket += sum(rates[i].derivative(count + j) * field[j] for j in range(D))
        by_monomial = defaultdict[Any, list[int]](lambda: [0] * count)
        for e, c in bracket.to_dict().items():
            by_monomial[e[count:]][e.index(1)] = int(c)
        rows += by_monomial.values()
    *S, b = *(unknowns.gens()[D * i : D * i + D] for i in range(D)), unknowns.gens()[D * D :]
    equations = []
    for values in arithmetic.null_space(flint.nmod_mat(rows or [[0] * count], p)):
        A, a = [values[D * i : D * i + D] for i in range(D)], values[D * D :]
        for i in range(D):
            for j in range(D):
                terms_of_S = (S[i][k] * A[k][j] - S[k][j] * A[i][k] for k in range(D))
                equations.append(sum(terms_of_S, unknowns.constant(0)))
            if a:
                terms_of_b = (S[i][k] * a[k] - b[k] * A[i][k] for k in range(D))
                equations.append(sum(terms_of_b, unknowns.constant(-a[i] % p)))
    return [equation for equation in equations if equation != 0]


def _products(equations: list[Any], unknowns: Any, degree: int) -> Any:
    """Return a matrix with a row for each equation times a monomial in `unknowns`, to a degree."""
    n, rows, entries = unknowns.nvars(), 0, list[int]()
    column = {e: k for k, e in enumerate(exponents_up_to(degree, n))}
    zeros = [0] * len(column)
    for equation in equations:
        terms = [(e, int(c)) for e, c in equation.to_dict().items()]
        for factor in exponents_up_to(degree - equation.total_degree(), n):
            start = len(entries)
            entries += zeros
            rows += 1
            for e, c in terms:
                entries[start + column[tuple(map(add, e, factor))]] = c
    return flint.nmod_mat(rows, len(column), entries, unknowns.modulus())


def _isolated_solutions(equations: list[Any], unknowns: Any, most: int) -> list[list[Any]] | None:
    """Return the solutions modulo a prime, from products of equations and monomials; else None.

    Products up to the degree `most` are a matrix. Its null space is spanned by vectors of the
    values that all monomials have at a solution. The result is None if there seem to be infinitely
    many.
    """
    n, p = unknowns.nvars(), int(unknowns.modulus())
    for degree in range(2, most + 1):
        space = arithmetic.null_space(_products(equations, unknowns, degree))
        # Vectors of solutions at infinity are 0 at monomials of low degree. In these columns the
        # rank is the number of other solutions, and so the same for two successive degrees.
        counts = [math.comb(n + d, n) for d in range(degree + 1)]  # of monomials up to degree d
        parts = [[row[:count] for row in space] or [[0]] for count in counts]
        ranks = [flint.nmod_mat(part, p).rank() for part in parts]
        stable = [d for d in range(1, degree) if ranks[d] == ranks[d - 1]]
        if stable:
            if not ranks[stable[-1]]:
                return []
            values = np.array(arithmetic.row_space(parts[stable[-1]], p), object).T
            return [*_by_multiplication(values, counts[stable[-1] - 1], n, degree, p)]
    return None


def _by_multiplication(values: Any, count: int, n: int, degree: int, p: int) -> Iterator[list[Any]]:
    """Yield the solutions, if the columns of `values` span the values of monomials at solutions.

    Rows belong to the monomials in n unknowns up to a degree. Multiplication by a random linear
    form acts on the first `count` rows; each eigenvector belongs to one solution.
    """
    monomials = exponents_up_to(degree, n)
    row = {e: k for k, e in enumerate(monomials)}
    units = [tuple(unit) for unit in np.eye(n, dtype=int).tolist()]
    solutions, rng = values.shape[1], random.Random(0)
    linear_form = np.array([rng.randrange(p) for _ in range(n)], object)
    products = []
    for e in monomials[:count]:
        times_variables = [row[tuple(map(add, e, unit))] for unit in units]
        products.append(linear_form @ values[times_variables] % p)
    # Random combinations of the `count` rows make matrices square: one row for each solution.
    draws = [rng.randrange(p) for _ in range(solutions * count)]
    mix = flint.nmod_mat(solutions, count, draws, p)
    before, after = (
        mix * flint.nmod_mat(np.array(rows).tolist(), p) for rows in (values[:count], products)
    )
    if before.rank() < solutions:
        return
    matrix = before.solve(after)
    identity = flint.nmod_mat(np.eye(solutions, dtype=int).tolist(), p)
    for eigenvalue, _ in matrix.charpoly().roots():
        eigenvectors = arithmetic.null_space(matrix - identity * eigenvalue)
        solution = values @ np.array(eigenvectors[0], object) % p
        # A single eigenvector is a solution times a factor: its entry for the monomial 1.
        if len(eigenvectors) == 1 and solution[0]:
            scale = pow(int(solution[0]), -1, p)
            yield [int(solution[row[unit]]) * scale % p for unit in units]
