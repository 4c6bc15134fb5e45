"""Interpolation of matrices of rational functions of letters, from their values modulo primes.

A search modulo a prime p, with numbers in place of letters, returns a matrix in echelon form. Its
entries are interpolated as functions of the letters, and reconstructed from several p. The result
is accepted if it predicts the matrix for another p and other numbers.

On a line s + z t through a point s an entry is a quotient N / D of polynomials in z, which Euclid's
algorithm finds (Cuyt and Lee 2011). The coefficient of z^k is a homogeneous polynomial in t. Its
monomials follow from the recurrence that its values at t = (2^i, 3^i, 5^i, ...) satisfy (Ben-Or and
Tiwari 1988). No bounds of degrees are needed, and the time grows with the number of terms.
"""

import contextlib
import itertools
import math
import random
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar
from functools import partial
from typing import Any

import flint
import numpy as np

from . import arithmetic
from .arithmetic import Residues, Rows, Values, divided_out, fmpq, random_prime, random_values
from .tolerances import (
    LARGEST_DEGREE_IN_LETTERS,
    LARGEST_DEGREE_IN_ONE_LETTER,
    MOST_LINES_OF_INTERPOLATION,
    MOST_PRIMES_OF_INTERPOLATION,
    MOST_SEARCHES,
)

Search = Callable[[int, Values], Residues]  # called with a prime and numbers for letters
Terms = dict[tuple[int, ...], Any]  # a polynomial in letters: {exponents: coefficient}

_BASES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)
MOST = len(_BASES)  # largest number of letters


class Watch:
    """Callbacks of `over_rationals`, to show progress; an exception in one ends the search."""

    def at_values(self, done: int) -> None:
        """Note how many searches are done; called before each, with numbers in place of letters."""

    def gave_up(self, reason: str) -> None:
        """Take the reason why `over_rationals` returns None."""


_NOBODY = Watch()
watch = ContextVar("watch", default=_NOBODY)


class Unknown(ArithmeticError):
    """Raised if functions have too many terms, or too high degrees, to be interpolated."""


def over_rationals(rng: random.Random, search: Search, count: int = 0) -> Rows | None:
    """Return the matrix that `search` evaluates, with functions N / D of letters, as pairs (N, D).

    ``search(p, values)`` must return the matrix modulo p, with the numbers `values` for the `count`
    letters. The result is None if coefficients are too long, or if there are too many terms.
    """
    residues = defaultdict[Any, list[tuple[Any, int]]](list)  # (residues, p), by exponents
    candidate: Rows | None = None
    for _ in range(MOST_PRIMES_OF_INTERPOLATION):
        with contextlib.suppress(ZeroDivisionError):
            p = random_prime(rng)
            values = random_values(rng, p)
            matrix = search(p, values)
            if candidate is not None and _predicts(candidate, matrix, values[:count], p):
                return candidate
            try:
                rows = _rows_modulo(search, matrix, count, p)
            except Unknown as error:
                watch.get().gave_up(str(error))
                return None
            exponents = tuple(tuple((*map(tuple, pair),) for pair in row) for row in rows)
            coefficients = [c for row in rows for pair in row for P in pair for c in P.values()]
            known = residues[exponents]
            known.append((np.array(coefficients, object), p))
            if len(known).bit_count() == 1:  # a power of two, as `_simplest` takes time
                candidate = _simplest(exponents, known)
    if not residues:
        raise ArithmeticError("the iterates reach poles of the map")
    watch.get().gave_up("coefficients are too long")
    return None


def _rows_modulo(search: Search, matrix: Residues, count: int, p: int) -> Any:
    """Return a matrix of rational functions modulo p, for `over_rationals`, by interpolation.

    `matrix` is its value where the variables have some random numbers.
    """
    if not count:
        return [[({(): c}, {(): 1}) for c in row] for row in matrix]
    lengths, done = [*map(len, matrix)], itertools.count()

    def entries(values: Sequence[int]) -> list[int]:
        watch.get().at_values(number := next(done))
        if number == MOST_SEARCHES:
            raise Unknown("there are too many terms")
        rows = search(p, tuple(values))
        if [*map(len, rows)] != lengths:  # the numbers are special; another prime may work
            raise ZeroDivisionError
        return [a for row in rows for a in row]

    pairs = iter(_interpolated(entries, count, p, random.Random(p)) if matrix else ())
    return [[next(pairs) for _ in row] for row in matrix]


def _simplest(exponents: Any, residues: Sequence[tuple[Any, int]]) -> Rows:
    """Return a matrix of pairs (N, D) with the simplest rational coefficients for these residues.

    `exponents` are the exponents in all N and D. `residues` has a pair for each prime p: all
    coefficients modulo p, and p.
    """
    total, modulus = np.zeros((), object), 1
    for coefficients, p in residues:  # the Chinese remainder theorem
        total = total + modulus * ((coefficients - total) * pow(modulus, -1, p) % p)
        modulus *= p
    fractions = iter([arithmetic.simplest_fraction(a, modulus) for a in total])
    return [
        [({e: next(fractions) for e in N}, {e: next(fractions) for e in D}) for N, D in row]
        for row in exponents
    ]


def _predicts(rows: Rows, matrix: Residues, values: Sequence[int], p: int) -> bool:
    """Return True if `rows`, with the numbers `values` for the letters, equal `matrix` modulo p."""
    x = [flint.nmod(a, p) for a in values]

    def value(terms: Terms) -> Any:
        return sum(flint.nmod(fmpq(c), p) * math.prod(map(pow, x, e)) for e, c in terms.items())

    return [*map(len, rows)] == [*map(len, matrix)] and all(
        value(N) == a * value(D)
        for row, numbers in zip(rows, matrix, strict=True)
        for (N, D), a in zip(row, numbers, strict=True)
    )


# Modulo one prime.


def _interpolated(
    entries: Callable[[Sequence[int]], list[int]], count: int, p: int, rng: random.Random
) -> list[tuple[Terms, Terms]]:
    """Return the functions N / D of letters with the values `entries`, as pairs (N, D) modulo p.

    Raise `ZeroDivisionError` if a random point or line is special; another prime may work.
    """

    def point() -> list[int]:
        return [rng.randrange(1, p) for _ in range(count)]

    def along(t: Sequence[int], z: Sequence[int]) -> list[list[int]]:
        """Return values of the matrix at letters s + c t, c in z: a row for each varying entry."""
        rows = [entries([(a + c * b) % p for a, b in zip(s, t, strict=True)]) for c in z]
        return [[row[i] for row in rows] for i in varying]

    s, zeros = point(), (0,) * count
    first, second = entries(s), entries(point())
    varying = [i for i, (a, b) in enumerate(zip(first, second, strict=True)) if a != b]
    pairs: list[tuple[Terms, Terms]] = [({zeros: a} if a else {}, {zeros: 1}) for a in first]
    if not varying:
        return pairs
    t, numbers = point(), range(1, 2**60)
    if count == 1:  # then s + z t is z, the letter itself
        s, t = [0], [1]
    most = 2 * (LARGEST_DEGREE_IN_ONE_LETTER if count == 1 else LARGEST_DEGREE_IN_LETTERS)
    quotients = _quotients(partial(along, t), len(varying), rng.sample(numbers, most), p)
    if count == 1:
        for i, pair in zip(varying, quotients, strict=True):
            in_z = ({(k,): int(c) for k, c in enumerate(P.coeffs()) if c} for P in pair)
            pairs[i] = _with_unit(in_z, p)
        return pairs
    # For each entry, how many coefficients in z N and D have: on each line as many as on the first.
    sizes = [[max(P.degree(), 0) + 1 for P in pair or ()] for pair in quotients]
    line = Line(rng.sample(numbers, max(map(sum, sizes)) + 1), p)
    for i, part in zip(varying, _of_lines(along, s, line, sizes), strict=True):
        pairs[i] = _with_unit(part, p)
    return pairs


def _quotients(
    values_at: Callable[[list[int]], list[list[int]]], count: int, z: list[int], p: int
) -> list[Any]:
    """Return N and D in z for each of `count` entries, from as few numbers z as determine them."""
    size = 4
    known: list[list[int]] = [[] for _ in range(count)]  # values at the first numbers of z
    while True:
        for values, more in zip(known, values_at(z[len(known[0]) : size]), strict=True):
            values += more
        line = Line(z[:size], p)
        quotients = [line.quotient(values) for values in known]
        if all(quotients):
            return quotients
        if (size := 2 * size) > len(z):
            raise Unknown("degrees are too high")


def _with_unit(parts: Iterable[Any], p: int) -> tuple[Terms, Terms]:
    """Return `parts`, N and D, with sorted terms, and 1 as the last coefficient of D."""
    N, D = parts
    scale = pow(D[max(D)], -1, p)
    N, D = ({e: c * scale % p for e, c in sorted(P.items())} for P in (N, D))
    return N, D


class Line:
    """Points `z` of a line modulo p, which determine a quotient of polynomials by its values."""

    def __init__(self, z: Sequence[int], p: int) -> None:
        self.p, self.z = p, z
        rows = [[pow(c, k, p) for k in range(len(z))] for c in z]
        self._from_values = flint.nmod_mat(rows, p).inv()
        self._zeros = math.prod(flint.nmod_poly([-c, 1], p) for c in z)

    def quotient(self, values: Sequence[int], lowest: int = -1) -> Any:
        """Return the polynomials (N, D) of least degrees such that N / D has these values; or None.

        The result is None if the values are too few, or if N has at most the degree `lowest`.
        """
        column = flint.nmod_mat(len(values), 1, list(values), self.p)
        N = flint.nmod_poly([*map(int, (self._from_values * column).entries())], self.p)
        D, last_N, last_D = N * 0 + 1, self._zeros, N * 0
        while max(N.degree(), 0) + D.degree() + 3 > len(values):
            if N.degree() <= lowest:
                return None
            q = last_N // N  # Euclid's algorithm keeps N = D * value at each point z
            N, last_N, D, last_D = last_N - q * N, N, last_D - q * D, D
        common = N.gcd(D)
        return N // common, D // common


def _scaled(pair: Any, sizes: Sequence[int]) -> list[list[int]]:
    """Return `sizes` coefficients in z of N and of D on a line s + z t, scaled to D = 1 at s."""
    if pair is None or pair[1][0] == 0:
        raise ZeroDivisionError
    scale = 1 / pair[1][0]
    return [[int(P[k] * scale) for k in range(size)] for P, size in zip(pair, sizes, strict=True)]


def _terms(coefficients: Any, s: Sequence[int], points: Any, p: int) -> Terms | None:
    """Return the terms of a polynomial in letters; None if more lines s + z t are needed.

    `coefficients` has, for each t in `points`, the coefficients in z of the polynomial at s + z t.
    """
    lower, terms = [[*of_line] for of_line in coefficients], Terms()
    for k in range(len(lower[0]) - 1, -1, -1):
        top = _homogeneous([c[k] for c in lower], len(s), k, p)
        if top is None:
            return None
        terms |= top
        for c, t in zip(lower, points, strict=True):
            for j, a in enumerate(_on_line(top, s, t, p)):
                c[j] -= a
    return terms


def _on_line(terms: Terms, s: Sequence[int], t: Sequence[int], p: int) -> list[int]:
    """Return the coefficients in z, lowest first, of a polynomial with `terms` at s + z t."""
    factors = [flint.nmod_poly([*pair], p) for pair in zip(s, t, strict=True)]
    products = (math.prod((f**k for f, k in zip(factors, e, strict=True) if k), start=c)
                for e, c in terms.items())  # fmt: skip
    return [*map(int, sum(products, flint.nmod_poly([], p)).coeffs())]


def _homogeneous(values: Sequence[int], count: int, degree: int, p: int) -> Terms | None:
    """Return the homogeneous polynomial in `count` letters with these values at (2^i, 3^i, ...).

    The values, for i = 0, 1, ..., satisfy a linear recurrence. Its roots are the values of the
    monomials at (2, 3, 5, ...). The result is None if the recurrence needs more values.
    """
    values = [a % p for a in values]
    if not any(values):
        return {}
    shortest = flint.fmpz_mod_poly_ctx(flint.fmpz_mod_ctx(p)).minpoly(values)
    size = shortest.degree()
    if 2 * size + 1 > len(values):
        return None
    roots = [int(root) for root, _ in flint.nmod_poly([*map(int, shortest.coeffs())], p).roots()]
    if len(roots) < size:
        return None
    exponents = [_exponents(root, count) for root in roots]
    if any(sum(e) != degree for e in exponents):
        return None
    powers = flint.nmod_mat([[pow(root, i, p) for root in roots] for i in range(size)], p)
    column = powers.solve(flint.nmod_mat(size, 1, values[:size], p))
    return dict(zip(exponents, map(int, column.entries()), strict=True))


def _exponents(number: int, count: int) -> tuple[int, ...]:
    """Return e with number = 2^e_1 3^e_2 5^e_3 ... for `count` primes; (-1,) if none exists."""
    exponents = []
    for base in _BASES[:count]:
        number, power = divided_out(number, base)
        exponents.append(power)
    return tuple(exponents) if number == 1 else (-1,)


def _of_lines(along: Any, s: list[int], line: Line, sizes: list[list[int]]) -> list[Any]:
    """Return the terms of N and D of each entry, from their coefficients on lines s + z t."""
    coefficients: list[Any] = [[] for _ in sizes]
    parts: list[Any] = [None for _ in sizes]
    points: list[list[int]] = []
    while None in parts:
        if len(points) > MOST_LINES_OF_INTERPOLATION:
            raise Unknown("there are too many terms")
        for i in range(len(points), 2 * len(points) or 4):
            points.append([pow(base, i, line.p) for base in _BASES[: len(s)]])
            for k, values in enumerate(along(points[-1], line.z)):
                coefficients[k].append(_scaled(line.quotient(values), sizes[k]))
        for k in [k for k, part in enumerate(parts) if part is None]:
            of_N_and_D = zip(*coefficients[k], strict=True)
            N_and_D = [_terms(of_lines, s, points, line.p) for of_lines in of_N_and_D]
            parts[k] = None if None in N_and_D else N_and_D
    return parts
