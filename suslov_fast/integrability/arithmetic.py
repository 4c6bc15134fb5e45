"""Exact numbers, points and matrices, over the rationals and modulo random primes."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from ..bodies.fields.polynomials import exact as as_fraction, from_lists
from ..checks import refuse, wrong

Point = tuple[Fraction, ...]
Residues = list[list[int]]  # a matrix modulo a prime

EPS = 2**40 + 7  # as good as a random number
EXTRA = 10  # equations more than unknowns
DRAWS = 8  # of primes with points or lines, of which two must agree


# Rational numbers.


def rational(name: str, value: Any) -> Fraction:
    """Return a number as a fraction, a float as its binary value."""
    refuse(name, value)
    return as_fraction(name, value)


def rationals(name: str, value: Any, count: int) -> Point:
    """Return a point with `count` coordinates, as fractions."""
    given = np.asarray(value, object)
    if given.shape != (count,):
        how = ": pass one state at a time, as in [f(x) for x in states]" * (given.ndim > 1)
        raise wrong(name, f"have the shape ({count},)", f"{given.shape}{how}")
    return tuple(rational(name, a) for a in given)


def step_size(eps: Any) -> Fraction:
    """Return eps, a number or a string, as a fraction."""
    return rational("eps", from_lists("eps", eps))


def fmpq(a: Any) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


# Residues. Points are (x1, ..., xD, 1).


def random_prime(rng: random.Random, bits: int = 62) -> int:
    while True:
        p = rng.getrandbits(bits) | 1 << (bits - 1) | 1
        if flint.fmpz(p).is_prime():
            return p


def point_modulo(p: int, x: Sequence[Any]) -> list[Any]:
    """Return the point (x1, ..., xD, 1) modulo a prime."""
    return [flint.nmod(fmpq(a), p) for a in (*x, 1)]


def prime_for(numbers: Iterable[Any]) -> int:
    """Return a prime for computations with these integers, always the same one for them.

    It is drawn by a generator that they seed: whatever they are multiples of, it is another prime.
    """
    return random_prime(random.Random(" ".join(map(hex, numbers))))


def random_point(n: int, p: int, rng: random.Random | None = None) -> list[Any]:
    """Return a random point modulo a prime; without `rng` always the same one."""
    rng = rng or random.Random(0)
    return point_modulo(p, [rng.randrange(p) for _ in range(n)])


def agreed_by_primes(rng: random.Random, compute: Callable[[int, int], Any]) -> Any:
    """Return the first result on which two primes agree, each with points or lines of its own.

    The function is called with a prime and a random number in place of eps, if this is symbolic.
    """
    results: list[Any] = []
    for _ in range(DRAWS):
        with contextlib.suppress(ZeroDivisionError):
            p = random_prime(rng)
            results.append(compute(p, rng.randrange(2, p)))
            if results.count(results[-1]) > 1:
                return results[-1]
    if not results:
        raise ArithmeticError("the iterates reach poles of the map")
    raise ArithmeticError(f"results modulo primes do not agree: {results}")


# Matrices.


def moduli(a: Any) -> list[int]:
    """Return [p] for a number modulo p, and [] for a rational one: what a matrix of them takes."""
    return [int(a.modulus())] if isinstance(a, flint.nmod) else []


def matrix(rows: Sequence[Sequence[Any]]) -> Any:
    """Return a matrix of rational numbers, or of numbers modulo a prime."""
    modulus = moduli(rows[0][0])
    return flint.nmod_mat(rows, *modulus) if modulus else flint.fmpq_mat(rows)


def null_space(matrix: Any) -> Residues:
    """Basis of the null space: the last nonzero entry, 1 modulo a prime, is 0 in the others."""
    columns, dimension = matrix.nullspace()
    return [[int(a) for a in row] for row in columns.transpose().tolist()[:dimension]]


def row_space(rows: Residues, p: int) -> Residues:
    """Return the basis in reduced row echelon form of the span of rows modulo a prime."""
    reduced, rank = flint.nmod_mat(rows, p).rref()
    return integer_rows(reduced, rank)


def integer_rows(matrix: Any, count: int | None = None) -> Residues:
    """Return the first rows of a matrix, by default all."""
    return [[int(a) for a in row] for row in matrix.tolist()[:count]]
