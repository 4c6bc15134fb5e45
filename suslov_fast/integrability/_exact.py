"""Exact numbers and polynomials, and reconstruction of rationals from residues modulo primes."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import combinations_with_replacement
from typing import Any

import flint
import numpy as np

from .._checks import wrong

Point = tuple[Fraction, ...]
Matrix = tuple[Point, ...]
Residues = list[list[int]]  # a matrix modulo a prime
Exponents = tuple[tuple[int, ...], ...]
Polynomials = tuple[Any, ...]  # of python-flint, in the variables x1, ..., xD

MORE = 10  # equations more than unknowns
_DRAWS = 8  # of primes with points or lines, of which two must agree
_PRIMES = 128  # enough for numerators and denominators of 1000 decimal digits


def fmpq(a: Any) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def polynomial_ring(n: int, context: Any = flint.fmpz_mpoly_ctx, **modulus: Any) -> Any:
    return context.get([f"x{i}" for i in range(1, n + 1)], ordering="deglex", **modulus)


def polynomials_with(rows: Any, exponents: Exponents) -> Polynomials:
    """Return polynomials with the same span whose integer coefficients are short and coprime."""
    if not rows:
        return ()
    integers = []
    for row in rows:
        factor = math.lcm(*(a.denominator for a in row))
        divisor = math.gcd(*(a.numerator for a in row))
        integers.append([int(a * factor) // divisor for a in row])
    ring = polynomial_ring(len(exponents[0]))
    reduced = flint.fmpz_mat(integers).lll().tolist()
    terms = (dict(zip(exponents, row, strict=True)) for row in reduced)
    return tuple(_primitive(ring.from_dict(each)) for each in terms)


def _primitive(P: Any) -> Any:
    """Return a multiple with coprime coefficients, the first of which is positive."""
    P = P.primitive()[1]
    return -P if P.leading_coefficient() < 0 else P


def exponents_up_to(degree: int, n: int) -> Exponents:
    """Return the exponents of all monomials in n variables up to a degree, in ascending order."""
    return tuple(
        tuple(chosen.count(i) for i in range(n))
        for d in range(degree + 1)
        for chosen in combinations_with_replacement(range(n), d)
    )


def check_unknowns(name: str, degree: int, n: int, most: int = 300) -> None:
    """Check the number of coefficients of a polynomial in n variables."""
    if (unknowns := math.comb(n + degree, n)) > most:
        largest = next(d for d in range(degree) if math.comb(n + d + 1, n) > most)
        expected = f"at most {largest} for {n} variables ({math.comb(n + largest, n)} coefficients)"
        raise wrong(name, expected, f"{degree} ({unknowns} coefficients)")


def factors(P: Any) -> list[tuple[Any, int]]:
    """Return the primitive irreducible factors of a polynomial, and their powers.

    python-flint 0.9 sorts factors over the integers, and fails if a coefficient is large.
    """
    ring = polynomial_ring(P.context().nvars(), flint.fmpq_mpoly_ctx)
    rational = ring.from_dict({e: flint.fmpq(c) for e, c in P.to_dict().items()})
    found = []
    for factor, power in rational.factor()[1]:
        scale = math.lcm(*(int(c.q) for c in factor.coeffs()))
        terms = {e: (c * scale).p for e, c in factor.to_dict().items()}
        found.append((_primitive(P.context().from_dict(terms)), int(power)))
    return found


def value_at(P: Any, x: Sequence[Any]) -> Any:
    """Return the value of a polynomial at a point, whose coordinates may be of any type."""
    return sum(int(c) * a for c, a in zip(P.coeffs(), monomial_values(P.monoms(), x), strict=True))


def monomial_values(exponents: Sequence[Sequence[int]], x: Sequence[Any]) -> Any:
    """Return monomials in the first coordinates of a point, which may be of any type of numbers."""
    values = np.ones(len(exponents), object)
    for a, e in zip(x, np.array(exponents, int).T, strict=False):
        # NumPy takes univariate polynomials in a list for sequences.
        values *= np.fromiter((a**k for k in range(int(e.max()) + 1)), object)[e]
    return values


def null_space(matrix: Any) -> Residues:
    """Basis of the null space: the last nonzero entry, 1 modulo a prime, is 0 in the others."""
    columns, dimension = matrix.nullspace()
    return integer_rows(columns.transpose())[:dimension]


def integer_rows(matrix: Any) -> Residues:
    return [[int(a) for a in row] for row in matrix.tolist()]


def random_prime(rng: random.Random) -> int:
    while True:
        p = rng.getrandbits(62) | 2**61 | 1
        if flint.fmpz(p).is_prime():
            return p


def confirmed(rng: random.Random, compute: Callable[[int], Any]) -> Any:
    """Return the first result on which two primes agree, each with points or lines of its own."""
    found: list[Any] = []
    for _ in range(_DRAWS):
        with contextlib.suppress(ZeroDivisionError):
            found.append(compute(random_prime(rng)))
            if found.count(found[-1]) > 1:
                return found[-1]
    if not found:
        raise ArithmeticError("the iterates reach poles of the map")
    raise ArithmeticError(f"results modulo primes do not agree: {found}")


def over_rationals(rng: random.Random, matrix: Callable[[int], Residues]) -> Matrix | None:
    """Return the rational matrix with these residues modulo primes; None if it is too long."""
    height = confirmed(rng, lambda p: len(matrix(p)))
    if height == 0:
        return ()
    modulus, used = 1, 0
    residues: Any = 0
    candidate: list[Fraction] = []
    for _ in range(_PRIMES):
        p = random_prime(rng)
        with contextlib.suppress(ZeroDivisionError):
            new = np.array(matrix(p), object)
            if len(new) != height:
                continue
            if candidate and [int(flint.nmod(fmpq(a), p)) for a in candidate] == [*new.flat]:
                return tuple(map(tuple, np.reshape(np.array(candidate, object), new.shape)))
            residues = residues + modulus * ((new - residues) * pow(modulus, -1, p) % p)
            modulus, used = modulus * p, used + 1
            if used & (used - 1) == 0:  # a power of two
                candidate = [reconstructed(r, modulus) for r in residues.flat]
    return None


def reconstructed(residue: int, modulus: int) -> Fraction:
    """Return the simplest fraction with this residue: the shortest (a, b) with a = residue * b."""
    shortest = flint.fmpz_mat([[modulus, 0], [residue, 1]]).lll()
    return Fraction(int(shortest[0, 0]), int(shortest[0, 1]))
