"""Rational functions of several variables from their values: a black box modulo primes.

A box returns a list of values modulo a prime. On lines s + z t through a point s the values are
quotients N / D of polynomials in z, by Euclid's algorithm (Cuyt and Lee 2011). Their coefficients
of the highest power of z are homogeneous polynomials in t, of which the terms are the roots of a
recurrence of values at t = (2^i, 3^i, 5^i, ...) (Ben-Or and Tiwari 1988). No bounds of degrees are
needed, time grows with the number of terms, and all entries of a box share its calls.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections import defaultdict
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import flint

from .arithmetic import random_prime, simplest_fraction

Box = Callable[[int, list[int]], list[int]]  # of a prime and the values of the variables
Terms = dict[tuple[int, ...], Any]  # coefficients by exponents

_BASES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37)
MOST = len(_BASES)  # variables
_DEGREES = 64  # the sum of the degrees of numerator and denominator, at most
_LINES = 1024  # twice the number of terms of one degree, at most
_PRIMES = 12


class Unknown(ArithmeticError):
    """The functions have too many terms or too long coefficients."""


def over_rationals(box: Box, count: int, rng: random.Random) -> list[tuple[Terms, Terms]]:
    """Return numerators and denominators, over the rationals, of the entries of a box.

    They are interpolated modulo primes until they predict the box at another prime.
    """
    known = defaultdict[Any, list[tuple[Any, int]]](list)  # residues and primes, by their terms
    for _ in range(_PRIMES):
        with contextlib.suppress(ZeroDivisionError):
            p = random_prime(rng)
            found = _modulo(box, count, p, rng)
            shape = tuple(tuple(tuple(sorted(P)) for P in pair) for pair in found)
            known[shape].append((found, p))
            candidate = _simplest(shape, known[shape])
            q = random_prime(rng)
            x = [rng.randrange(1, q) for _ in range(count)]
            if _predicts(candidate, box(q, x), x, q):
                return candidate
    raise Unknown("coefficients are too long")


def _simplest(shape: Any, residues: Sequence[tuple[Any, int]]) -> list[tuple[Terms, Terms]]:
    """Return the terms with the simplest fractions that have these residues."""

    def fraction(entry: int, part: int, e: tuple[int, ...]) -> Fraction:
        total, modulus = 0, 1
        for found, p in residues:  # the Chinese remainder theorem
            c = found[entry][part][e]
            total += modulus * ((c - total) * pow(modulus, -1, p) % p)
            modulus *= p
        return simplest_fraction(total, modulus)

    return [
        ({e: fraction(i, 0, e) for e in N}, {e: fraction(i, 1, e) for e in D})
        for i, (N, D) in enumerate(shape)
    ]


def _predicts(candidate: Any, values: Sequence[int], x: list[int], p: int) -> bool:
    def value(terms: Terms) -> int:
        residues = {e: c.numerator * pow(c.denominator, -1, p) for e, c in terms.items()}
        return value_of(residues, x, p)

    pairs = zip(candidate, values, strict=True)
    return all((value(N) - a * value(D)) % p == 0 for (N, D), a in pairs)


def value_of(terms: Terms, x: Sequence[int], p: int) -> int:
    """Return the value of a polynomial modulo a prime."""
    products = (
        c * math.prod(pow(a, k, p) for a, k in zip(x, e, strict=True) if k)
        for e, c in terms.items()
    )
    return sum(products) % p


# Modulo one prime.


def _modulo(box: Box, count: int, p: int, rng: random.Random) -> list[tuple[Terms, Terms]]:
    """Return numerators and denominators modulo a prime; the first term of a denominator is 1.

    ZeroDivisionError where a point or a line is special.
    """

    def point() -> list[int]:
        return [rng.randrange(1, p) for _ in range(count)]

    def along(t: Sequence[int], z: Sequence[int]) -> list[list[int]]:
        """Return the values of each entry that varies at points s + z t."""
        rows = [box(p, [(a + c * b) % p for a, b in zip(s, t, strict=True)]) for c in z]
        return [[row[i] for row in rows] for i in varying]

    s, one = point(), {(0,) * count: 1}
    first, second = box(p, s), box(p, point())
    varying = [i for i, (a, b) in enumerate(zip(first, second, strict=True)) if a != b]
    found = [({(0,) * count: a} if a else {}, one) for a in first]
    if not varying:
        return found
    size, t = 4, point()
    while True:
        line = _Line(size, p, rng)
        on_line = [line.quotient(values) for values in along(t, line.z)]
        if all(on_line):
            break
        if (size := 2 * size) > 2 * _DEGREES:
            raise Unknown("degrees are too high")
    degrees = [[max(P.degree(), 0) for P in pair or ()] for pair in on_line]
    line = _Line(max(map(sum, degrees)) + 3, p, rng)
    entries = [_Entry(pair, s, p) for pair in degrees]
    points: list[list[int]] = []
    while not all(entry.parts for entry in entries):
        if len(points) > _LINES:
            raise Unknown("there are too many terms")
        for i in range(len(points), 2 * len(points) or 4):
            points.append([pow(base, i, p) for base in _BASES[:count]])
            for entry, values in zip(entries, along(points[-1], line.z), strict=True):
                entry.add(line.quotient(values))
        for entry in entries:
            entry.solve(points)
    for i, entry in zip(varying, entries, strict=True):
        N, D = entry.parts or ({}, {})
        scale = pow(D[max(D)], -1, p)
        found[i] = ({e: c * scale % p for e, c in N.items()},
                    {e: c * scale % p for e, c in D.items()})  # fmt: skip
    return found


class _Line:
    """Parameters z of points on a line, and quotients of polynomials in z by values there."""

    def __init__(self, size: int, p: int, rng: random.Random) -> None:
        self.p, self.z = p, rng.sample(range(1, 2**60), size)
        rows = [[pow(c, k, p) for k in range(size)] for c in self.z]
        self._from_values = flint.nmod_mat(rows, p).inv()
        self._zeros = flint.nmod_poly([1], p)
        for c in self.z:
            self._zeros *= flint.nmod_poly([-c, 1], p)

    def quotient(self, values: Sequence[int]) -> Any:
        """Return N and D of least degrees with N / D at the points; None if they are too many."""
        column = flint.nmod_mat(len(values), 1, list(values), self.p)
        N = flint.nmod_poly([*map(int, (self._from_values * column).entries())], self.p)
        D, last_N, last_D = N * 0 + 1, self._zeros, N * 0
        best = N, D
        while N != 0:  # Euclid's algorithm keeps N = D times the interpolating polynomial
            q = last_N // N
            N, last_N, D, last_D = last_N - q * N, N, last_D - q * D, D
            best = min(best, (N, D), key=_size)
        if _size(best) + 3 > len(values):
            return None
        common = best[0].gcd(best[1])
        return best[0] // common, best[1] // common


def _size(pair: tuple[Any, Any]) -> int:
    return int(max(pair[0].degree(), 0) + pair[1].degree())


class _Entry:
    """One function: the coefficients of N and D on lines, and its terms when they are known."""

    def __init__(self, degrees: Sequence[int], s: Sequence[int], p: int) -> None:
        self.degrees, self.s, self.p = degrees, s, p
        self.parts: list[Terms] | None = None
        self._on_lines: list[list[list[int]]] = []

    def add(self, pair: Any) -> None:
        """Add the quotient on a further line; that of s is D = 1."""
        if pair is None or pair[1][0] == 0:
            raise ZeroDivisionError
        scale = 1 / pair[1][0]
        self._on_lines.append(
            [
                [int(P[k] * scale) for k in range(d + 1)]
                for P, d in zip(pair, self.degrees, strict=True)
            ]
        )

    def solve(self, points: Sequence[Sequence[int]]) -> None:
        """Find the terms, if there are enough lines."""
        if not self.parts:
            parts = [self._part(number, points) for number in (0, 1)]
            self.parts = None if None in parts else parts  # type: ignore[assignment]

    def _part(self, number: int, points: Sequence[Sequence[int]]) -> Terms | None:
        """Return the terms of N or D; those of the highest degree are known first."""
        lower, terms = [[*of_line[number]] for of_line in self._on_lines], Terms()
        for k in range(self.degrees[number], -1, -1):
            top = _homogeneous([c[k] for c in lower], len(self.s), k, self.p)
            if top is None:
                return None
            terms |= top
            for c, t in zip(lower, points, strict=True):
                for j, a in enumerate(_on_line(top, self.s, t, self.p)):
                    c[j] -= a
        return terms


def _on_line(terms: Terms, s: Sequence[int], t: Sequence[int], p: int) -> list[int]:
    """Return the coefficients in z of a polynomial at s + z t."""
    factors = [flint.nmod_poly([*pair], p) for pair in zip(s, t, strict=True)]
    products = (math.prod((f**k for f, k in zip(factors, e, strict=True) if k), start=c)
                for e, c in terms.items())  # fmt: skip
    return [*map(int, sum(products, flint.nmod_poly([], p)).coeffs())]


def _homogeneous(values: Sequence[int], count: int, degree: int, p: int) -> Terms | None:
    """Return the homogeneous polynomial with values at (2^i, 3^i, ...), i = 0, 1, ...

    The values of its monomials at (2, 3, ...) are roots of their recurrence. None if there are too
    few values.
    """
    values = [a % p for a in values]
    if not any(values):
        return {}
    recurrence = _recurrence(values, p)
    size = recurrence.degree()
    if 2 * size + 1 > len(values):
        return None
    factors = recurrence.factor()[1]
    if len(factors) < size:
        return None
    roots = [int(-f[0] / f[1]) for f, _ in factors]
    exponents = [_exponents(root, count) for root in roots]
    if any(sum(e) != degree for e in exponents):
        return None
    powers = flint.nmod_mat([[pow(root, i, p) for root in roots] for i in range(size)], p)
    column = powers.solve(flint.nmod_mat(size, 1, values[:size], p))
    return dict(zip(exponents, map(int, column.entries()), strict=True))


def _exponents(number: int, count: int) -> tuple[int, ...]:
    """Return the exponents of a product of powers of primes; (-1,) for other numbers."""
    exponents = []
    for base in _BASES[:count]:
        exponents.append(0)
        while number and number % base == 0:
            number, exponents[-1] = number // base, exponents[-1] + 1
    return tuple(exponents) if number == 1 else (-1,)


def _recurrence(values: Sequence[int], p: int) -> Any:
    """Return the characteristic polynomial of the shortest linear recurrence of values.

    As Euclid's algorithm of z^n and the polynomial with these coefficients shows it.
    """
    n = len(values)
    last, R = flint.nmod_poly([0] * n + [1], p), flint.nmod_poly([*values[::-1]], p)
    last_C, C = flint.nmod_poly([], p), flint.nmod_poly([1], p)
    while 2 * R.degree() >= n:
        q = last // R
        last, R, last_C, C = R, last - q * R, C, last_C - q * C
    return C
