"""Normal forms of integrals: of the polynomials of one cofactor those that factor.

Polynomials of one cofactor span a space, and any two of them have a first integral as quotient. Its
members that are reducible, over the complex numbers too, do not depend on the basis. Where eps is
symbolic, the limit of numerator and denominator for eps to 0 counts as well.
"""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator, Sequence
from typing import Any

import flint

from . import arithmetic
from .arithmetic import EPS, PRIME, Residues, degree_of, modulo, rank
from .functions import RationalFunction, factored, without_constant, without_content
from .maps import rational_roots
from .reconstruction import over_rationals

_LARGEST = 3  # dimension of a space whose reducible members are sought
_HIGHEST = 6  # degree of its polynomials
_SPARE = 12  # rows more than unknowns
_SIGNS = 70  # random points at which a definite polynomial has one sign
_WIDTHS = range(2, 5)  # of resultants
_FACTORS = 3  # most factors of reducible members of a curve of them, less one


# Reducible members. On a plane, f = f_1 ... f_r has r independent pairs (g, h) of polynomials of
# lower degree with d/dv (g / f) = d/du (h / f): those with g = f (d/du f_i) / f_i (Ruppert, Gao).
# One of them is the gradient of f. A space of polynomials has a matrix that is linear in its
# coordinates, and loses rank at the reducible members.


class _Plane:
    """Equations for the pairs (g, h) of polynomials f in x of a degree, on a random plane."""

    def __init__(self, n: int, degree: int, p: int, rng: random.Random) -> None:
        self.degree, self._p = degree, p
        self._ring = arithmetic.ring(2, False, flint.nmod_mpoly_ctx, p)
        u, v = self._ring.gens()
        draws = [[rng.randrange(1, p) for _ in range(3)] for _ in range(n)]
        self._plane = [a + b * u + c * v for a, b, c in draws]
        self._below = [
            self._ring.from_dict({e: 1}) for e in arithmetic.exponents_up_to(degree - 1, 2)
        ]
        self._monomials = arithmetic.exponents_up_to(2 * degree - 2, 2)

    def equations(self, P: Any, eps: int) -> Any:
        """Return the matrix for f = P, without the column by which its gradient is normalized."""
        f = modulo(P, self._p, eps).compose(*self._plane, ctx=self._ring)
        columns = []
        for direction, sign in ((1, 1), (0, -1)):
            slope = f.derivative(direction)
            for g in self._below:
                terms = (sign * (g.derivative(direction) * f - g * slope)).to_dict()
                columns.append([int(terms.get(e, 0)) for e in self._monomials])
        return flint.nmod_mat(columns[1:], self._p).transpose()


def count_factors(P: Any) -> int:
    """Return the number of irreducible factors over the complex numbers, if all are single."""
    degree, n = degree_of(P), P.context().nvars() - arithmetic.has_letter(P)
    if degree < 1 or n < 2:
        return degree
    matrix = _Plane(n, degree, PRIME, random.Random(0)).equations(P, EPS)
    return 1 + int(matrix.ncols() - matrix.rank())


def _random_matrix(rows: int, columns: int, p: int, rng: random.Random) -> Any:
    return flint.nmod_mat(rows, columns, [rng.randrange(p) for _ in range(rows * columns)], p)


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
        # det(A + t B) = 0 for t = -1 / s and eigenvalues s of the inverse of A times B.
        reverse = A.solve(B).charpoly().coeffs()[::-1]
        signs = [-c if k % 2 else c for k, c in enumerate(reverse)]
        common = common.gcd(flint.nmod_poly([int(c) for c in signs], p))
    return common


def _stacked(constant: Any, linear: Any, width: int, p: int) -> Any:
    """Return the matrix of the products of (constant + s linear) v with powers of s."""
    rows, columns = constant.nrows(), constant.ncols()
    table = [[0] * (columns * (width + 1)) for _ in range(rows * width)]
    for k in range(width):
        for part, shift in ((constant, k), (linear, k + 1)):
            for i, row in enumerate(part.tolist()):
                start = columns * shift
                table[rows * k + i][start : start + columns] = [int(a) for a in row]
    return flint.nmod_mat(table, p)


def _roots(space: Sequence[Any], letter: bool, less: int = 0) -> Iterator[RationalFunction]:
    """Yield the t for which a member of (first + t second) + s (others) is reducible.

    With `less` columns fewer, it has two factors and so many more.
    """
    n = space[0].context().nvars() - letter
    degree = max(degree_of(P) for P in space)

    def search(p: int, eps: int) -> Residues:
        rng = random.Random(p)
        common = flint.nmod_poly([0], p)
        for _ in range(2):  # roots that depend on the plane are left out
            plane = _Plane(n, degree, p, rng)
            matrices = [plane.equations(P, eps) for P in space]
            columns = matrices[0].ncols()
            mix = _random_matrix(columns, columns - less, p, rng)
            first, second, *others = (matrix * mix for matrix in matrices)
            for width in _WIDTHS if others else ():
                tall = _stacked(first, others[0], width, p)
                if tall.rank() == tall.ncols():
                    zero = flint.nmod_mat(first.nrows(), first.ncols(), p)
                    first, second = tall, _stacked(second, zero, width, p)
                    break
            else:
                if others:  # a curve of members is reducible
                    return []
            if first.rank() < first.ncols():  # all members are reducible
                return []
            common = common.gcd(_values_of_lost_rank(first, second, p, rng))
        return [[int(c) for c in common.coeffs()]] if common.degree() > 0 else []

    rows = over_rationals(random.Random(0), search, letter)
    yield from rational_roots(rows[0], space[0].context()) if rows else ()


def reducible_members(space: Sequence[Any]) -> Iterator[Any]:
    """Yield the reducible members of a space of dimension 2 or 3 with rational coordinates."""
    letter = arithmetic.has_letter(space[0])
    degree = max(degree_of(P) for P in space)
    n = space[0].context().nvars() - letter
    if not 2 <= len(space) <= _LARGEST or not 2 <= degree <= _HIGHEST or n < 2:
        return
    rng = random.Random(0)
    # Generic members, so that those that are sought have finite coordinates.
    mixed = [sum(rng.randrange(1, 100) * P for P in space) for _ in space]
    if rank(mixed) < len(space):
        return
    first, second, *others = mixed
    if not others:
        yield from _members(mixed, letter, 0)
        return
    for less in range(_FACTORS):
        for t in _roots(mixed, letter, less):
            yield from _members([_combination(first, second, t), *others], letter, less)


def _members(pencil: Sequence[Any], letter: bool, less: int) -> Iterator[Any]:
    first, second = pencil
    for t in _roots(pencil, letter, less):
        yield without_content(_combination(first, second, t))


def _combination(first: Any, second: Any, t: RationalFunction) -> Any:
    above, below = t.quotient_in(first.context())
    return below * first + above * second


# The choice.


def limit(P: Any) -> Any:
    """Return the limit of a polynomial for eps to 0, in the same ring."""
    if not arithmetic.has_letter(P):
        return P
    return P.context().from_dict({e: c for e, c in P.to_dict().items() if not e[0]})


def with_independent_limits(space: Sequence[Any]) -> list[Any]:
    """Return a basis whose limits for eps to 0 are independent."""
    basis = list(space)
    if not arithmetic.has_letter(basis[0]):
        return basis
    (eps, *_) = basis[0].context().gens()
    while rank(limits := [*map(limit, basis)]) < len(basis):
        monomials = [*{e: None for P in limits for e in P.monoms()}]
        terms = [P.to_dict() for P in limits]
        rows = flint.fmpz_mat([[int(each.get(e, 0)) for each in terms] for e in monomials])
        relations, _ = rows.nullspace()
        relation = [int(relations[i, 0]) for i in range(len(basis))]
        last = max(i for i, c in enumerate(relation) if c)
        combination = sum(c * P for c, P in zip(relation, basis, strict=True))
        while combination != 0 and limit(combination) == 0:
            combination = combination // eps
        basis[last] = without_content(combination)
    return basis


def in_echelon_form(space: Sequence[Any]) -> list[Any]:
    """Return the basis with different first monomials, of high degree before low.

    No polynomial has the last monomial of one after it: constants are in the last.
    """
    letter = arithmetic.has_letter(space[0])
    monomials = {e[letter:] for P in space for e in P.monoms()}
    descending = sorted(monomials, key=lambda e: (sum(e), e), reverse=True)
    rows, left = [], list(space)
    for monomial in descending:
        pivot = next((P for P in left if _coefficient(P, monomial) != 0), None)
        if pivot is not None:
            left.remove(pivot)
            left = [_without(P, pivot, monomial) for P in left]
            rows.append(pivot)
    for k in reversed(range(len(rows))):
        last = next(e for e in reversed(descending) if _coefficient(rows[k], e) != 0)
        rows[:k] = [_without(P, rows[k], last) for P in rows[:k]]
    return [*map(without_content, rows)]


def _coefficient(P: Any, monomial: tuple[int, ...]) -> Any:
    """Return the coefficient of a monomial in x, a polynomial in eps if it is symbolic."""
    k = int(arithmetic.has_letter(P))
    zeros = [0] * len(monomial)
    terms = {(*e[:k], *zeros): c for e, c in P.to_dict().items() if e[k:] == monomial}
    return P.context().from_dict(terms)


def _without(P: Any, pivot: Any, monomial: tuple[int, ...]) -> Any:
    """Return a combination of two polynomials that lacks a monomial of the second."""
    if (c := _coefficient(P, monomial)) == 0:
        return P
    return without_content(_coefficient(pivot, monomial) * P - c * pivot)


def is_definite(P: Any) -> bool:
    """Return True if a polynomial has one sign at random points, near 0 and far away."""
    rng, signs = random.Random(0), set()
    letter = arithmetic.has_letter(P)
    count = P.context().nvars() - letter
    for k in range(_SIGNS):
        size = 10 ** (k % 7)
        x = [rng.randrange(-size, size + 1) for _ in range(count)]
        value = P(*[rng.randrange(1, 9)] * letter, *x)
        signs |= {value > 0} if value else set()
    return len(signs) == 1


def chosen(space: Sequence[Any], preferred: Sequence[Any] = ()) -> list[Any]:
    """Return a basis of a space in normal form: first the denominator of its integrals.

    The denominator is of least degree in the limit, the others make the limit of their quotients
    independent; those that are preferred, and then polynomials with many factors, come first.
    """
    echelon = in_echelon_form(space)
    basis = with_independent_limits(echelon)
    candidates = {str(P): P for P in (*basis, *echelon)}
    with contextlib.suppress(ArithmeticError):  # a number is special, or all are reducible
        candidates |= {str(P): P for P in reducible_members(echelon)}

    first = {str(P): P for P in map(without_content, preferred) if rank([*space, P]) == len(space)}
    candidates |= first

    def order(P: Any) -> tuple[Any, ...]:
        f = factored(P)
        many = -count_factors(P) - (degree_of(P) < degree), -sum(e for _, e in f.factors)
        return degree_of(P), str(P) not in first, *many, len(P), str(P)

    degree = max(degree_of(P) for P in basis)
    ordered = sorted(candidates.values(), key=order)
    below = min(ordered, key=lambda P: _order_of_denominator(P))
    result = [below]
    for P in ordered:
        if rank([*map(limit, result), limit(P)]) > len(result):
            result.append(P)
    return result


def _order_of_denominator(P: Any) -> tuple[Any, ...]:
    """Return the key of denominators; of equal ones the first is taken."""
    first = int(arithmetic.has_letter(P))
    has_constant = any(not any(e[first:]) for e in limit(P).monoms())
    return degree_of(limit(P)), degree_of(P), not has_constant, not is_definite(P)


def quotients(basis: Sequence[Any]) -> list[RationalFunction]:
    """Return the quotients of a basis by its first polynomial."""
    below, *others = basis
    return [without_constant(factored(P) / factored(below)) for P in others]
