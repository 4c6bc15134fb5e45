"""Reducible members of a space of polynomials, over the complex numbers too.

On a plane with coordinates u and v, f = f_1 ... f_r has r independent pairs (g, h) of polynomials
of lower degree with d/dv (g / f) = d/du (h / f): those with g = f (d/du f_i) / f_i (Ruppert 1986,
Gao 2003). One combination of them is the gradient of f. So a space of polynomials has a matrix that
is linear in its coordinates, and loses rank at the reducible members: at eigenvalues, if the space
is a pencil first + t second.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from typing import Any

import flint

from .arithmetic import EPS, Residues, over_rationals
from .functions import RationalFunction, rational_roots
from .polynomials import (
    degree_of,
    exponents_up_to,
    has_eps,
    modulo,
    prime_of,
    rank,
    ring_modulo,
    variables_of,
    without_content,
)

_LARGEST = 3  # dimension of a space whose reducible members are sought
_HIGHEST = 6  # degree of its polynomials
_WIDTHS = range(2, 5)  # of resultants, in powers of s
_MORE = 3  # numbers of factors more than two, if a curve of members is reducible


class _Equations:
    """Equations for the pairs (g, h) of polynomials f in x of a degree, on a random plane."""

    def __init__(self, n: int, degree: int, p: int, rng: random.Random) -> None:
        self._p, self._ring = p, ring_modulo(p, 2)
        u, v = self._ring.gens()
        draws = [[rng.randrange(1, p) for _ in range(3)] for _ in range(n)]
        self._points = [a + b * u + c * v for a, b, c in draws]
        self._lower = [self._ring.from_dict({e: 1}) for e in exponents_up_to(degree - 1, 2)]
        self._exponents = exponents_up_to(2 * degree - 2, 2)

    def equations(self, P: Any, eps: int) -> Any:
        """Return the matrix of the equations for f = P, without its first column.

        The columns are the terms of f^2 (d/dv (g / f) - d/du (h / f)) for g, then h, a monomial.
        Without the first one, the gradient of f, which always solves the equations, does not.
        """
        f = modulo(P, self._p, eps).compose(*self._points, ctx=self._ring)
        columns = []
        for variable, sign in ((1, 1), (0, -1)):
            slope = f.derivative(variable)
            for g in self._lower:
                terms = (sign * (g.derivative(variable) * f - g * slope)).to_dict()
                columns.append([int(terms.get(e, 0)) for e in self._exponents])
        return flint.nmod_mat(columns[1:], self._p).transpose()


def count_factors(P: Any) -> int:
    """Return the number of irreducible factors over the complex numbers, if all are single."""
    degree, n = degree_of(P), variables_of(P)
    if degree < 1 or n < 2:
        return degree
    matrix = _Equations(n, degree, prime_of([P]), random.Random(0)).equations(P, EPS)
    return 1 + int(matrix.ncols() - matrix.rank())


def reducible_members(space: Sequence[Any]) -> Iterator[Any]:
    """Yield the reducible members of a space of dimension 2 or 3 with rational coordinates."""
    degree = max(degree_of(P) for P in space)
    is_small = 2 <= len(space) <= _LARGEST and 2 <= degree <= _HIGHEST
    if not is_small or variables_of(space[0]) < 2:
        return
    rng = random.Random(0)
    # Generic members, so that those that are sought have finite coordinates.
    generic = [sum(rng.randrange(1, 100) * P for P in space) for _ in space]
    if rank(generic) < len(space):
        return
    first, second, *others = generic
    if not others:
        yield from _reducible_in_pencil(first, second)
        return
    (third,) = others
    for more in range(_MORE):
        for t in _parameters(generic, more):
            yield from _reducible_in_pencil(_combination(first, second, t), third, more)


def _reducible_in_pencil(first: Any, second: Any, more: int = 0) -> Iterator[Any]:
    """Yield the reducible members of first + t second, with 2 + more factors."""
    for t in _parameters([first, second], more):
        yield without_content(_combination(first, second, t))


def _combination(first: Any, second: Any, t: RationalFunction) -> Any:
    """Return a multiple of first + t second."""
    numerator, denominator = t.as_quotient(first.context())
    return denominator * first + numerator * second


def _parameters(space: Sequence[Any], more: int) -> Iterator[RationalFunction]:
    """Yield the t for which first + t second, or first + t second + s third for an s, is reducible.

    With 2 + more factors its matrix loses the rank 1 + more, so it has `more` columns too many.
    """
    n, degree = variables_of(space[0]), max(degree_of(P) for P in space)

    def search(p: int, eps: int) -> Residues:
        rng = random.Random(p)
        common = flint.nmod_poly([0], p)
        for _ in range(2):  # roots that depend on the plane are left out
            on_plane = _Equations(n, degree, p, rng)
            matrices = [on_plane.equations(P, eps) for P in space]
            columns = matrices[0].ncols()
            mix = _random_matrix(columns, columns - more, p, rng)
            first, second, *others = (matrix * mix for matrix in matrices)
            if others:
                without_s = _without_s(first, second, others[0], p)
                if without_s is None:  # a curve of members is reducible
                    return []
                first, second = without_s
            if first.rank() < first.ncols():  # all members are reducible
                return []
            common = common.gcd(_values_of_lost_rank(first, second, p, rng))
        # A root is multiple if the rank falls further there; each is wanted once.
        common //= common.gcd(common.derivative()) if common.degree() > 0 else 1
        return [[int(c) for c in common.coeffs()]] if common.degree() > 0 else []

    symbolic = has_eps(space[0])
    rows = over_rationals(random.Random(prime_of(space)), search, symbolic)
    yield from rational_roots(rows[0], space[0].context()) if rows else ()


def _without_s(first: Any, second: Any, third: Any, p: int) -> tuple[Any, Any] | None:
    """Return matrices A + t B that lose rank where first + t second + s third does for some s.

    They are those of the products with powers of s (a resultant); None if a curve of members loses
    rank, so that no number of powers suffices.
    """
    for width in _WIDTHS:
        tall = _times_powers(first, third, width, p)
        if tall.rank() == tall.ncols():
            zero = flint.nmod_mat(first.nrows(), first.ncols(), p)
            return tall, _times_powers(second, zero, width, p)
    return None


def _times_powers(constant: Any, linear: Any, width: int, p: int) -> Any:
    """Return the matrix of s^k (constant + s linear) v, k < width, for the unknowns v, s v, ..."""
    rows, columns = constant.nrows(), constant.ncols()
    table = [[0] * (columns * (width + 1)) for _ in range(rows * width)]
    for k in range(width):
        for part, power in ((constant, k), (linear, k + 1)):
            for i, row in enumerate(part.tolist()):
                start = columns * power
                table[rows * k + i][start : start + columns] = [int(a) for a in row]
    return flint.nmod_mat(table, p)


def _values_of_lost_rank(first: Any, second: Any, p: int, rng: random.Random) -> Any:
    """Return the polynomial whose roots t are those where first + t second loses rank.

    The matrices have more rows than columns; random combinations of rows make them square, and
    roots that depend on these are left out.
    """
    n = first.ncols()
    common = flint.nmod_poly([0], p)
    for _ in range(2):
        mix = _random_matrix(n, first.nrows(), p, rng)
        A, B = mix * first, mix * second
        # det(A + t B) = 0 for t = -1 / s with eigenvalues s of the inverse of A times B. So the
        # coefficients are those of its characteristic polynomial, backwards, with changing signs.
        backward = A.solve(B).charpoly().coeffs()[::-1]
        coefficients = [int(-c if k % 2 else c) for k, c in enumerate(backward)]
        common = common.gcd(flint.nmod_poly(coefficients, p))
    return common


def _random_matrix(rows: int, columns: int, p: int, rng: random.Random) -> Any:
    return flint.nmod_mat(rows, columns, [rng.randrange(p) for _ in range(rows * columns)], p)
