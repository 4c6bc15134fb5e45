"""Rows of rational numbers, or of rational functions of eps, from their residues modulo primes.

A search modulo a prime p and at a number e in place of eps returns a matrix in echelon form, whose
entries are interpolated over several e and reconstructed from several p. The result is accepted if
it predicts the matrix for another p and e.
"""

import contextlib
import math
import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any

import flint

from .exact import Exponents, Polynomials, Residues, fmpq, has_letter, primitive, random_prime, ring

Search = Callable[[int, int], Residues]  # of a prime and a number in place of eps
Quotient = tuple[list[Any], list[Any]]  # coefficients of numerator and denominator in eps
Rows = list[list[Quotient]]

_PRIMES = 128  # enough for numerators and denominators of 1000 decimal digits
_POINTS = 48  # values of eps, enough for degrees that add up to 40


def over_rationals(rng: random.Random, search: Search, letter: bool = False) -> Rows | None:
    """Return the rows whose residues are found by a search; None if they are too long."""
    known: dict[Any, _Residues] = {}
    for _ in range(_PRIMES):
        with contextlib.suppress(ZeroDivisionError):
            p = random_prime(rng)
            e = rng.randrange(2, p)
            found = search(p, e)
            for candidate in known.values():
                if candidate.predicts(found, p, e):
                    return candidate.rows
            quotients: Rows = [[([c], [1]) for c in row] for row in found]
            if letter:
                interpolated = _interpolated(search, p, e, found)
                if interpolated is None:
                    return None
                quotients = interpolated
            shape = tuple(tuple((len(a), len(b)) for a, b in row) for row in quotients)
            known.setdefault(shape, _Residues()).add(quotients, p)
    if not known:
        raise ArithmeticError("the iterates reach poles of the map")
    return None


class _Residues:
    """Rows of quotients modulo a growing product of primes."""

    def __init__(self) -> None:
        self.modulus, self.used = 1, 0
        self.residues: list[int] = []
        self.rows: Rows = []

    def add(self, rows: Rows, p: int) -> None:
        new = [c for row in rows for quotient in row for part in quotient for c in part]
        inverse = pow(self.modulus, -1, p)
        old = self.residues or [0] * len(new)
        self.residues = [
            a + self.modulus * ((b - a) * inverse % p) for a, b in zip(old, new, strict=True)
        ]
        self.modulus, self.used = self.modulus * p, self.used + 1
        if self.used & (self.used - 1) == 0:  # a power of two
            numbers = iter([simplest_fraction(a, self.modulus) for a in self.residues])
            self.rows = [
                [([next(numbers) for _ in a], [next(numbers) for _ in b]) for a, b in row]
                for row in rows
            ]

    def predicts(self, found: Residues, p: int, e: int) -> bool:
        if [len(row) for row in found] != [len(row) for row in self.rows]:
            return False

        def value(part: list[Fraction]) -> Any:
            return flint.nmod_poly([flint.nmod(fmpq(c), p) for c in part], p)(flint.nmod(e, p))

        return all(
            value(above) == c * value(below)
            for row, expected in zip(self.rows, found, strict=True)
            for (above, below), c in zip(row, expected, strict=True)
        )


def simplest_fraction(residue: int, modulus: int) -> Fraction:
    """Return the simplest fraction with this residue: the shortest (a, b) with a = residue * b."""
    if residue in (0, 1):
        return Fraction(residue)
    shortest = flint.fmpz_mat([[modulus, 0], [residue, 1]]).lll()
    return Fraction(int(shortest[0, 0]), int(shortest[0, 1]))


def _interpolated(search: Search, p: int, e: int, first: Residues) -> Rows | None:
    """Return the rational functions of eps modulo p; None if they are too long."""
    if not first:
        return []
    points: list[int] = []
    rng = random.Random(p)
    values: list[list[int]] = []
    found, following = first, 2
    candidate: list[tuple[Any, Any]] = []
    for count in range(1, _POINTS):
        points.append(e)
        values.append([c for row in found for c in row])
        pairs = zip(candidate, values[-1], strict=False)
        if candidate and all(a(e) == c * b(e) for (a, b), c in pairs):
            quotients = iter([tuple([*map(int, f.coeffs())] for f in each) for each in candidate])
            return [[next(quotients) for _ in row] for row in first]  # type: ignore[misc]
        if count == following:
            powers = flint.nmod_mat([[pow(e, k, p) for k in range(count)] for e in points], p)
            functions = powers.solve(flint.nmod_mat(values, p)).transpose().tolist()
            modulus = math.prod(flint.nmod_poly([-e, 1], p) for e in points)
            candidate = [_quotient(flint.nmod_poly(f, p), modulus) for f in functions]
            following += 1 + following // 2
        e = rng.randrange(2, p)
        found = search(p, e)
        if len(found) != len(first):  # one of the numbers is special
            raise ZeroDivisionError
    return None


def _quotient(f: Any, modulus: Any) -> tuple[Any, Any]:
    """Return the simplest quotient with this residue modulo a polynomial; its denominator monic."""
    zero, one = 0 * f, 0 * f + 1
    before, after, s, t = modulus, f, zero, one
    best, least = (f, one), f.degree()
    while after != zero:
        if after.degree() + t.degree() < least:
            best, least = (after, t), after.degree() + t.degree()
        q = before // after
        before, after, s, t = after, before - q * after, t, s - q * t
    scale = 1 / best[1].leading_coefficient()
    return best[0] * scale, best[1] * scale


def polynomials_with(rows: Rows, exponents: Exponents, letter: bool = False) -> Polynomials:
    """Return polynomials with the same span whose integer coefficients are short and coprime."""
    of, found = ring(len(exponents[0]), letter), []
    for row in rows:
        pairs = [[flint.fmpq_poly([fmpq(c) for c in part]) for part in pair] for pair in row]
        common = reduce(lambda a, b: a * b // a.gcd(b), (below for _, below in pairs))
        terms = {}
        for e, (above, below) in zip(exponents, pairs, strict=True):
            for k, c in enumerate((above * (common // below)).coeffs()):
                terms[(*[k] * letter, *e)] = c
        scale = math.lcm(*(int(c.q) for c in terms.values()))
        found.append(of.from_dict({e: (c * scale).p for e, c in terms.items() if c != 0}))
    return short_basis(found)


def short_basis(polynomials: Sequence[Any]) -> Polynomials:
    """Return primitive polynomials with the same span; without a letter they are short."""
    if polynomials and not has_letter(polynomials[0]):
        terms, of = [P.to_dict() for P in polynomials], polynomials[0].context()
        monomials = [*{e: None for each in terms for e in each}]
        reduced = flint.fmpz_mat([[each.get(e, 0) for e in monomials] for each in terms]).lll()
        rows = reduced.tolist()
        polynomials = [of.from_dict(dict(zip(monomials, row, strict=True))) for row in rows]
    return tuple(map(primitive, polynomials))
