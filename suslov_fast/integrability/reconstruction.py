"""Rows of rational numbers, or of polynomials in eps, from their residues modulo primes.

A search modulo a prime p and at a number e in place of eps returns a matrix in echelon form. Its
rows, up to factors, are interpolated over several e and reconstructed from several p. The result
is accepted if it predicts the matrix for another p and e.
"""

import contextlib
import math
import random
from collections import defaultdict
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from . import arithmetic
from .arithmetic import Residues
from .polynomials import Exponents, Polynomials, polynomial_ring, primitive

Search = Callable[[int, int], Residues]  # of a prime and a number in place of eps
Rows = Sequence[Sequence[Sequence[Any]]]  # the coefficients of entries, in ascending powers of eps

_PRIMES = 128  # enough for numerators and denominators of 1000 decimal digits
_POINTS = 48  # values of eps, enough for polynomials of degree 20


def over_rationals(rng: random.Random, search: Search, symbolic: bool = False) -> Rows | None:
    """Return the rows whose residues a search finds; None if their entries are too long."""
    known = defaultdict[Any, list[tuple[Any, int]]](list)  # residues and primes, by their shape
    candidate: Rows | None = None
    for _ in range(_PRIMES):
        with contextlib.suppress(ZeroDivisionError):
            p = arithmetic.random_prime(rng)
            e = rng.randrange(2, p)
            found = search(p, e)
            if candidate is not None and _predicts(candidate, found, p, e):
                return candidate
            numbers: Rows = [[[c] for c in row] for row in found]
            rows = _interpolated(search, p, e, found) if symbolic and found else numbers
            if rows is None:
                return None
            residues = known[np.shape(rows)]
            residues.append((np.array(rows, object), p))
            if len(residues).bit_count() == 1:  # a power of two
                candidate = _simplest_rows(residues)
    if not known:
        raise ArithmeticError("the iterates reach poles of the map")
    return None


def _simplest_rows(residues: Sequence[tuple[Any, int]]) -> Any:
    """Return the rows of the simplest fractions with these residues modulo primes."""
    total, modulus = np.zeros((), object), 1
    for rows, p in residues:  # the Chinese remainder theorem
        total = total + modulus * ((rows - total) * pow(modulus, -1, p) % p)
        modulus *= p
    return [[[simplest_fraction(a, modulus) for a in entry] for entry in row] for row in total]


def simplest_fraction(residue: int, modulus: int) -> Fraction:
    """Return the simplest fraction with this residue: the shortest (a, b) with a = residue * b."""
    if residue in (0, 1):  # most entries of rows in echelon form
        return Fraction(residue)
    shortest = flint.fmpz_mat([[modulus, 0], [residue, 1]]).lll()
    return Fraction(int(shortest[0, 0]), int(shortest[0, 1]))


def _predicts(rows: Rows, found: Residues, p: int, e: int) -> bool:
    """Return True if rows at a number e are multiples of those found modulo a prime."""

    def are_parallel(row: Sequence[Sequence[Any]], values: list[int]) -> bool:
        polynomials = ([flint.nmod(arithmetic.fmpq(c), p) for c in entry] for entry in row)
        at_e = [flint.nmod_poly(coefficients, p)(e) for coefficients in polynomials]
        return bool(flint.nmod_mat([at_e, values], p).rank() == 1)

    return [*map(len, rows)] == [*map(len, found)] and all(map(are_parallel, rows, found))


def _interpolated(search: Search, p: int, e: int, found: Residues) -> Rows | None:
    """Return the rows as polynomials in eps modulo p; None if their degree is too high."""
    rng = random.Random(p)
    candidate: Rows | None = None
    points: list[int] = []
    values: list[Residues] = []
    while len(points) < _POINTS:
        if candidate is not None and _predicts(candidate, found, p, e):
            return candidate
        points.append(e)
        values.append(found)
        if len(points) % 3 == 2:
            candidate = _through(points, values, p)
        e = rng.randrange(2, p)
        found = search(p, e)
        if np.shape(found) != np.shape(values[0]):  # one of the numbers is special
            raise ZeroDivisionError
    return None


def _through(points: list[int], values: list[Residues], p: int) -> Any:
    """Return the polynomials of least degree that are multiples of these rows at the points."""
    n, k, rows = len(points), (len(points) + 1) // 2, []
    powers = np.array([[pow(e, i, p) for i in range(n)] for e in points], object)
    inverse = flint.nmod_mat(powers.tolist(), p).inv()  # of values at the points, to coefficients
    for row in np.array(values, object).transpose(1, 2, 0):
        # A row is multiplied by a polynomial so that this and all products have degrees below k.
        products = [inverse * flint.nmod_mat((c * powers.T[:k]).T.tolist(), p) for c in row]
        high = [coefficients for product in products for coefficients in product.tolist()[k:]]
        if not (multipliers := arithmetic.null_space(flint.nmod_mat(high, p))):
            return None
        multiplier = flint.nmod_mat(k, 1, multipliers[0], p)
        rows.append([[int(c) for c in (P * multiplier).entries()[:k]] for P in products])
    entries = np.array(rows, object)
    width = 1 + np.flatnonzero(entries.any(axis=(0, 1)))[-1]
    return entries[..., :width].tolist()


def polynomials_with(rows: Rows, exponents: Exponents, symbolic: bool = False) -> Polynomials:
    """Return primitive polynomials with the same span; with a number eps they are short."""
    ring, integers = polynomial_ring(len(exponents[0]), symbolic), []
    for row in rows:
        scale = math.lcm(*(c.denominator for entry in row for c in entry))
        integers.append([int(c * scale) for entry in row for c in entry])
    if integers and not symbolic:
        integers = flint.fmpz_mat(integers).lll().tolist()
    powers = range(len(rows[0][0]) if rows else 0)
    monomials = [(*[k] * symbolic, *e) for e in exponents for k in powers]
    terms = (dict(zip(monomials, row, strict=True)) for row in integers)
    return tuple(primitive(ring.from_dict(of_one)) for of_one in terms)
