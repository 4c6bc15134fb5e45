"""Exact numbers, polynomials with integer coefficients, and linear algebra modulo primes.

Polynomials are those of python-flint in x1, ..., xD, with `eps` before them if eps is symbolic.
"""

from __future__ import annotations

import contextlib
import copyreg
import math
import random
import re
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import combinations_with_replacement
from typing import Any

import flint
import numpy as np

from ..bodies.polynomials import exact as as_fraction
from ..bodies.polynomials import from_lists
from ..checks import refuse, wrong

Point = tuple[Fraction, ...]
Residues = list[list[int]]  # a matrix modulo a prime
Exponents = tuple[tuple[int, ...], ...]
Polynomials = tuple[Any, ...]

PRIME, EPS = 2**61 - 1, 2**40 + 7  # as good as random ones
MORE = 10  # equations more than unknowns
DRAWS = 8  # of primes with points or lines, of which two must agree


def _polynomial(names: Any, terms: Any) -> Any:
    return flint.fmpz_mpoly_ctx.get(names, ordering="deglex").from_dict(terms)


# python-flint 0.9 does not pickle polynomials.
copyreg.pickle(flint.fmpz_mpoly, lambda P: (_polynomial, (P.context().names(), P.to_dict())))


def rational(name: str, value: Any) -> Fraction:
    """Return a number as a fraction, a float as its binary value."""
    refuse(name, value)
    return as_fraction(name, value)


def rationals(name: str, value: Any, count: int) -> Point:
    """Return a point with `count` coordinates, as fractions."""
    given = np.asarray(value, object)
    if given.shape != (count,):
        raise wrong(name, f"have the shape ({count},)", given.shape)
    return tuple(rational(name, a) for a in given)


def step_size(eps: Any) -> Fraction:
    """Return eps, a number or a string, as a fraction."""
    return rational("eps", from_lists("eps", eps))


def fmpq(a: Any) -> Any:
    return flint.fmpq(a.numerator, a.denominator)


def fraction(a: Any) -> Fraction:
    return Fraction(int(a.p), int(a.q))


def ring(n: int, letter: bool, context: Any = flint.fmpz_mpoly_ctx, *modulus: int) -> Any:
    """Return the ring of polynomials in n variables, and in eps if it is symbolic."""
    names = ["eps"] * letter + [f"x{i}" for i in range(1, n + 1)]
    return context.get(names, *modulus, ordering="deglex")


def renamed(P: Any, names: Sequence[str] | None) -> Any:
    """Return a polynomial in x1, ..., xD as one in variables with other names.

    python-flint takes names in ASCII only: others are encoded, and `decoded` in formulas.
    """
    if names is None:
        return P
    encoded = (re.sub(r"[^\x00-\x7f]", lambda a: f"_u{ord(a[0]):x}_", name) for name in names)
    return _polynomial((*["eps"] * has_letter(P), *encoded), P.to_dict())


def decoded(text: str) -> str:
    """Return a text of polynomials with the names of their variables as the user wrote them."""
    return re.sub(r"_u([89a-f][0-9a-f]|[0-9a-f]{3,6})_", lambda code: chr(int(code[1], 16)), text)


def has_letter(P: Any) -> bool:
    return bool(P.context().names()[:1] == ("eps",))


def degree_of(P: Any) -> int:
    """Return the degree of a polynomial in x."""
    first = int(has_letter(P))
    return max((int(sum(e[first:])) for e in P.monoms()), default=0)


def size(P: Any) -> tuple[Any, ...]:
    """Return the key by which polynomials are sorted, short ones first.

    The monomials in x come before the coefficients, so that the order is the same if eps is
    symbolic and if it is a number.
    """
    first = int(has_letter(P))
    monomials = sorted({(-sum(e[first:]), *(-k for k in e[first:])) for e in P.monoms()})
    return degree_of(P), len(monomials), monomials, str(P)


def primitive(P: Any) -> Any:
    """Return the multiple with coprime coefficients, the first of which is positive.

    If eps is symbolic, it is the first of the terms of lowest order in eps, so that the limit for
    eps to 0 decides: a polynomial then has one sign wherever it stands.
    """
    P = P.primitive()[1]
    return -P if _first_coefficient(P) < 0 else P


def _first_coefficient(P: Any) -> Any:
    if not has_letter(P) or P == 0:
        return P.leading_coefficient()
    exponents = P.monoms()
    lowest = min(e[0] for e in exponents)
    return next(c for e, c in zip(exponents, P.coeffs(), strict=True) if e[0] == lowest)


def exponents_up_to(degree: int, n: int) -> Exponents:
    """Return the exponents of all monomials in n variables up to a degree, in ascending order."""
    return tuple(
        tuple(chosen.count(i) for i in range(n))
        for d in range(degree + 1)
        for chosen in combinations_with_replacement(range(n), d)
    )


def check_unknowns(name: str, degree: int, n: int, most: int = 300) -> None:
    if (unknowns := math.comb(n + degree, n)) > most:
        largest = next(d for d in range(degree) if math.comb(n + d + 1, n) > most)
        expected = f"at most {largest} for {n} variables ({math.comb(n + largest, n)} coefficients)"
        raise wrong(name, expected, f"{degree} ({unknowns} coefficients)")


def factors(P: Any) -> list[tuple[Any, int]]:
    """Return the primitive irreducible factors of a polynomial, and their powers.

    python-flint 0.9 sorts factors over the integers, and fails if a coefficient is large.
    """
    names, found = P.context().names(), []
    integers = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
    rationals = flint.fmpq_mpoly_ctx.get(names, ordering="deglex")
    for factor, power in rationals.from_dict(P.to_dict()).factor()[1]:
        scale = math.lcm(*(int(c.q) for c in factor.coeffs()))
        terms = {e: (c * scale).p for e, c in factor.to_dict().items()}
        found.append((primitive(integers.from_dict(terms)), int(power)))
    return found


def value_at(P: Any, x: Sequence[Any], degree: int | None = None) -> Any:
    """Return the value at a point of any type of numbers, or ``x_0^degree P(x / x_0)``."""
    exponents = P.monoms()
    if degree is not None:
        exponents = [(*e, degree - sum(e)) for e in exponents]
    terms = zip(P.coeffs(), monomial_values(exponents, x), strict=True)
    return sum((int(c) * a for c, a in terms), 0 * x[-1])


def monomial_values(exponents: Sequence[Sequence[int]], x: Sequence[Any]) -> Any:
    """Return monomials in the first coordinates of a point, which may be of any type of numbers."""
    values = np.ones(len(exponents), object)
    for a, (powers, highest) in zip(x, _by_variable(tuple(exponents)), strict=False):
        # NumPy takes univariate polynomials in a list for sequences.
        values *= np.fromiter((a**k for k in range(highest + 1)), object)[powers]
    return values


@lru_cache(maxsize=256)
def _by_variable(exponents: Exponents) -> list[tuple[Any, int]]:
    """Return the powers of each variable in monomials, and the highest of them."""
    columns = np.array(exponents, int).T if exponents else ()
    return [(powers, int(powers.max())) for powers in columns]


def modulo(P: Any, p: int, eps: Any) -> Any:
    """Return a polynomial in x, at this eps, modulo a prime p or, for p = 0, over the rationals."""
    of: Any = (flint.nmod_mpoly_ctx, p) if p else (flint.fmpq_mpoly_ctx,)
    letter = has_letter(P)
    n = P.context().nvars() - letter
    found = ring(n, letter, *of).from_dict(P.to_dict())
    return found.subs({"eps": eps}).project_to_context(ring(n, False, *of)) if letter else found


def point_modulo(p: int, x: Sequence[Any]) -> list[Any]:
    """Return a point (x1, ..., xD, 1) modulo a prime."""
    return [flint.nmod(fmpq(a), p) for a in (*x, 1)]


def random_point(n: int, p: int = PRIME, rng: random.Random | None = None) -> list[Any]:
    rng = rng or random.Random(0)
    return point_modulo(p, [rng.randrange(p) for _ in range(n)])


def matrix(rows: Sequence[Sequence[Any]]) -> Any:
    """Return a matrix of rational numbers, or of numbers modulo a prime."""
    first = rows[0][0]
    if isinstance(first, flint.nmod):
        return flint.nmod_mat(rows, int(first.modulus()))
    return flint.fmpq_mat(rows)


def null_space(matrix: Any) -> Residues:
    """Basis of the null space: the last nonzero entry, 1 modulo a prime, is 0 in the others."""
    columns, dimension = matrix.nullspace()
    return [[int(a) for a in row] for row in columns.transpose().tolist()[:dimension]]


def integer_rows(matrix: Any) -> Residues:
    return [[int(a) for a in row] for row in matrix.tolist()]


def rank(polynomials: Sequence[Any]) -> int:
    """Return the number of linearly independent polynomials."""
    terms = [modulo(P, PRIME, EPS).to_dict() for P in polynomials]
    monomials = {e for each in terms for e in each}
    rows = [[int(each.get(e, 0)) for e in monomials] for each in terms]
    return int(flint.nmod_mat(rows, PRIME).rank()) if monomials else 0


def random_prime(rng: random.Random, bits: int = 62) -> int:
    while True:
        p = rng.getrandbits(bits) | 1 << (bits - 1) | 1
        if flint.fmpz(p).is_prime():
            return p


def confirmed(rng: random.Random, compute: Callable[[int, int], Any]) -> Any:
    """Return the first result on which two primes agree, each with points or lines of its own.

    The function is called with a prime and a random number in place of eps, if this is symbolic.
    """
    found: list[Any] = []
    for _ in range(DRAWS):
        with contextlib.suppress(ZeroDivisionError):
            p = random_prime(rng)
            found.append(compute(p, rng.randrange(2, p)))
            if found.count(found[-1]) > 1:
                return found[-1]
    if not found:
        raise ArithmeticError("the iterates reach poles of the map")
    raise ArithmeticError(f"results modulo primes do not agree: {found}")
