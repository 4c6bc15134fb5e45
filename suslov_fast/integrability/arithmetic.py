"""Exact numbers, points and matrices, over the rationals and modulo random primes.

Modulo a prime, random numbers replace letters such as eps.
"""

import contextlib
import random
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from ..checks import refuse, wrong
from ..fields.exact_numbers import exact as as_fraction, from_lists
from .tolerances import (
    LEAST_DENOMINATOR_OF_DECIMAL,
    LEAST_WHOLE_FLOAT,
    MOST_DENOMINATOR_OF_RATIO,
    MOST_PRIMES_DRAWN,
)

Point = tuple[Fraction, ...]
Residues = list[list[int]]  # a matrix modulo a prime
Values = tuple[int, ...]  # numbers in place of letters
# A matrix of functions N / D of letters: N and D are {exponents of the letters: coefficient}.
Rows = Sequence[Sequence[tuple[dict[Values, Any], dict[Values, Any]]]]

# Fixed numbers that replace letters (eps first), and serve as random numbers.
EPS = (2**40 + 7, *random.Random(0).sample(range(2**40, 2**41), 11))


# Rational numbers.


def rational(name: str, value: Any) -> Fraction:
    """Return a number as a fraction, a float by its binary value; errors begin with `name`."""
    refuse(name, value)
    return as_fraction(name, value)


def rationals(name: str, value: Any, count: int) -> Point:
    """Return the `count` coordinates of a point `value` as fractions; errors begin with `name`."""
    given = np.asarray(value, object)
    if given.shape != (count,):
        how = ": pass one state at a time, as in [f(x) for x in states]" * (given.ndim > 1)
        raise wrong(name, f"have the shape ({count},)", f"{given.shape}{how}")
    return tuple(rational(name, a) for a in given)


def constant(name: str, value: Any) -> Fraction:
    """Return a number, also of a text "1/3", as a fraction; floats become numbers `as_written`."""
    value = from_lists(name, value)
    exact = rational(name, value)
    return as_written(exact) if isinstance(value, float) else exact


def as_written(a: Any) -> Fraction:
    """Return the number that was typed for a float `a`: a decimal, as 0.1, or a ratio, as 8/3.

    A decimal of 12 digits, then a ratio with a denominator up to 1000, is accepted if the float
    differs from this number by rounding errors only. Otherwise the result is the decimal of 15
    digits that rounds to the float, or the binary value of the float if no such decimal exists.
    """
    binary = Fraction(a)
    q = binary.denominator
    odd = q // (q & -q)  # the odd factor of q, which is 1 for a float
    # A fraction of a float, as in the gradient of a Hamiltonian with a term / 3.
    if 1 < odd < MOST_DENOMINATOR_OF_RATIO:
        return as_written(binary * odd) / odd
    if odd > 1 or (q < LEAST_DENOMINATOR_OF_DECIMAL and abs(binary) < LEAST_WHOLE_FLOAT):
        return binary
    near, exact = (Fraction(f"{float(binary):.{digits}g}") for digits in (12, 15))
    for written in (near, binary.limit_denominator(MOST_DENOMINATOR_OF_RATIO)) if q > 1 else ():
        if abs(written - binary) <= abs(binary) / 2**50:
            return written
    return exact if float(exact) == binary else binary


def fmpq(a: Any) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def divided_out(a: Any, divisor: Any) -> tuple[Any, int]:
    """Divide an integer or polynomial as often as possible; return the quotient and the power."""
    power = 0
    while a != 0 and a % divisor == 0:
        a, power = a // divisor, power + 1
    return a, power


# Residues modulo a prime. Points are (x1, ..., xD, 1).


def random_prime(rng: random.Random, bits: int = 62) -> int:
    while True:
        p = rng.getrandbits(bits) | 1 << (bits - 1) | 1
        if flint.fmpz(p).is_prime():
            return p


def point_modulo(p: int, x: Sequence[Any]) -> list[Any]:
    """Return the point (x1, ..., xD, 1) modulo a prime p, for rational numbers x."""
    return [flint.nmod(fmpq(a), p) for a in (*x, 1)]


def prime_for(numbers: Iterable[Any]) -> int:
    """Return a random prime of 62 bits with the seed `numbers`, which it divides only by chance."""
    return random_prime(random.Random(" ".join(map(hex, numbers))))


def random_point(n: int, p: int, rng: random.Random | None = None) -> list[Any]:
    """Return a random point (x1, ..., xn, 1) modulo p; without `rng` the same one in each call."""
    rng = rng or random.Random(0)
    return point_modulo(p, [rng.randrange(p) for _ in range(n)])


def random_values(rng: random.Random, p: int) -> Values:
    """Return 12 random numbers modulo p, which replace the letters of a map in their order."""
    first = rng.randrange(2, p)
    others = random.Random(first)
    return (first, *(others.randrange(2, p) for _ in EPS[1:]))


def agreed_by_primes(rng: random.Random, compute: Callable[[int, Values], Any]) -> Any:
    """Call ``compute(p, values)`` for random primes p until two results agree; return this result.

    `values` are random numbers that replace letters such as eps. One result alone may be wrong,
    because a number that is not 0 may be 0 modulo p.
    """
    results: list[Any] = []
    for _ in range(MOST_PRIMES_DRAWN):
        with contextlib.suppress(ZeroDivisionError):
            p = random_prime(rng)
            results.append(compute(p, random_values(rng, p)))
            if results.count(results[-1]) > 1:
                return results[-1]
    if not results:
        raise ArithmeticError("the iterates reach poles of the map")
    raise ArithmeticError(f"results modulo primes do not agree: {results}")


# Matrices.


def moduli(a: Any) -> list[int]:
    """Return [p] for a number `a` modulo p, else []: the last arguments of a flint matrix."""
    return [int(a.modulus())] if isinstance(a, flint.nmod) else []


def matrix(rows: Sequence[Sequence[Any]]) -> Any:
    """Return the flint matrix of these rows of rational numbers, or of numbers modulo a prime."""
    modulus = moduli(rows[0][0])
    return flint.nmod_mat(rows, *modulus) if modulus else flint.fmpq_mat(rows)


def null_space(matrix: Any) -> Residues:
    """Return a basis of the null space of a matrix modulo a prime, as rows in echelon form.

    The last nonzero entry of a row is 1, and all other rows have 0 in this column.
    """
    columns, dimension = matrix.nullspace()
    return integer_rows(columns.transpose(), dimension)


def row_space(rows: Residues, p: int) -> Residues:
    """Return the span of rows modulo a prime p by its basis in reduced row echelon form."""
    reduced, rank = flint.nmod_mat(rows, p).rref()
    return integer_rows(reduced, rank)


def integer_rows(matrix: Any, count: int | None = None) -> Residues:
    """Return the first `count` rows of a matrix as integers, by default all rows."""
    return [[int(a) for a in row] for row in matrix.tolist()[:count]]


# From residues to rational numbers.


def simplest_fraction(residue: int, modulus: int) -> Fraction:
    """Return the fraction a / b with a = residue * b modulo `modulus` and the least a^2 + b^2."""
    if residue in (0, 1):  # most entries of rows in echelon form
        return Fraction(residue)
    shortest = flint.fmpz_mat([[modulus, 0], [residue, 1]]).lll()
    return Fraction(int(shortest[0, 0]), int(shortest[0, 1]))
