"""Exact numbers, and results modulo random primes that are taken back to the rationals."""

from __future__ import annotations

import contextlib
import math
import random
import textwrap
from collections.abc import Callable
from fractions import Fraction
from numbers import Rational
from typing import Any

import flint
import numpy as np

from .._checks import wrong

Point = tuple[Fraction, ...]
Matrix = tuple[Point, ...]
Residues = list[list[int]]  # a matrix modulo a prime

DRAWS = 8  # of primes with points or lines, of which two must agree
_PRIMES = 128  # enough for numerators and denominators of 1000 decimal digits


def exact_array(name: str, value: Any, shape: Any = None, exact: bool = False) -> Any:
    """Array of fractions; floats are refused if `exact`."""
    if hasattr(value, "unit") or hasattr(value, "units"):
        raise wrong(name, "numbers without units", type(value).__name__, TypeError)
    array = np.array(value, dtype=object)
    if shape is not None and array.shape != shape:
        raise wrong(name, f"the shape {shape}", array.shape)
    for index, each in np.ndenumerate(array):
        number = each.item() if isinstance(each, np.generic) else each
        if not isinstance(number, Rational if exact else Rational | float):
            expected = "integers or fractions" if exact else "integers, fractions or floats"
            raise wrong(name, expected, type(each).__name__, TypeError)
        if isinstance(number, float) and not math.isfinite(number):
            raise wrong(name, "finite numbers", number)
        a = Fraction(number)
        array[index] = Fraction(int(a.numerator), int(a.denominator))  # of Python's own integers
    return array


def fmpq(a: Any) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def shortened(text: str) -> str:
    return textwrap.shorten(text, 300, placeholder=" ...")


def random_prime(rng: random.Random) -> int:
    while True:
        p = rng.getrandbits(62) | 2**61 | 1
        if flint.fmpz(p).is_prime():
            return p


def confirmed(rng: random.Random, compute: Callable[[int], Any]) -> Any:
    """The first result on which two primes agree, with points or lines of their own."""
    found: list[Any] = []
    for _ in range(DRAWS):
        with contextlib.suppress(ZeroDivisionError):
            found.append(compute(random_prime(rng)))
            if found.count(found[-1]) > 1:
                return found[-1]
    if not found:
        raise ArithmeticError("the iterates run into points without an image")
    raise ArithmeticError(f"results modulo primes do not agree: {found}")


def over_rationals(rng: random.Random, matrix: Callable[[int], Residues]) -> Matrix | None:
    """The rational matrix with these residues modulo primes; None if its entries are too long."""
    height = confirmed(rng, lambda p: len(matrix(p)))
    if height == 0:
        return ()
    modulus, used = 1, 0
    residues: list[int] = []
    candidate: list[Fraction] = []
    for _ in range(_PRIMES):
        p = random_prime(rng)
        with contextlib.suppress(ZeroDivisionError):
            rows = matrix(p)
            if len(rows) != height:
                continue
            new = [a for row in rows for a in row]
            if candidate and [int(flint.nmod(fmpq(a), p)) for a in candidate] == new:
                width = len(rows[0])
                return tuple(tuple(candidate[i : i + width]) for i in range(0, len(new), width))
            old, inverse = residues or [0] * len(new), pow(modulus, -1, p)
            residues = [
                r + modulus * ((a - r) * inverse % p) for r, a in zip(old, new, strict=True)
            ]
            modulus, used = modulus * p, used + 1
            if used & (used - 1) == 0:  # a power of two
                candidate = [_reconstructed(r, modulus) for r in residues]
    return None


def _reconstructed(residue: int, modulus: int) -> Fraction:
    """The simplest fraction with this residue: the shortest (a, b) with a = residue * b."""
    shortest = flint.fmpz_mat([[modulus, 0], [residue, 1]]).lll()
    return Fraction(int(shortest[0, 0]), int(shortest[0, 1]))


def null_space(rows: Any, p: Any) -> Residues:
    """Basis of the null space: the last nonzero entry of a vector is 1, and 0 in the others."""
    columns, dimension = flint.nmod_mat(rows, p).nullspace()
    return integer_rows(columns.transpose())[:dimension]


def integer_rows(matrix: Any) -> Residues:
    return [[int(a) for a in row] for row in matrix.tolist()]
