"""Polynomials of python-flint in x1, ..., xD, with coefficients that may contain letters.

Coefficients are integers. Letters are further variables, before x1, ..., xD. A single letter is
called `eps` in computations, and has its own name in results. Modulo a prime, numbers replace them.
"""

import copyreg
import math
import random
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from itertools import accumulate, combinations_with_replacement, takewhile
from operator import mul
from typing import Any, TypeVar

import flint

from ..fields.names import labels
from .arithmetic import EPS, Rows, divided_out, fmpq, prime_for

Exponents = tuple[tuple[int, ...], ...]
Polynomials = tuple[Any, ...]
A = TypeVar("A")

_LETTER = "_letter_"  # prefix of letters other than eps; a ring's single letter may be called eps


def _from_terms(names: Any, terms: Any) -> Any:
    return flint.fmpz_mpoly_ctx.get(names, ordering="deglex").from_dict(terms)


# python-flint 0.9 does not pickle polynomials.
copyreg.pickle(flint.fmpz_mpoly, lambda P: (_from_terms, (P.context().names(), P.to_dict())))


# Rings and names of variables.


def polynomial_ring(n: int, letters: Sequence[str] = ()) -> Any:
    """Return the ring of polynomials in letters and n variables; a single letter is called eps."""
    names = [name if name == "eps" else _LETTER + _encoded(name) for name in letters]
    first = ["eps"] if len(names) == 1 else names
    return flint.fmpz_mpoly_ctx.get((*first, *labels(n)), ordering="deglex")


def ring_modulo(p: int, n: int) -> Any:
    """Return the ring of polynomials in n variables modulo a prime."""
    return flint.nmod_mpoly_ctx.get(labels(n), p, ordering="deglex")


def renamed(P: Any, names: Sequence[str] | None, letter: str = "") -> Any:
    """Return a polynomial with new names of its variables x and of its only letter.

    None and "" keep the old ones. Names that are not ASCII are encoded, since python-flint refuses
    them; `decoded` writes them back.
    """
    old, symbolic = P.context().names(), letters_in(P)
    first = old[:symbolic] if letter in ("", "eps") else [_LETTER + letter] * symbolic
    new = (*first, *(old[symbolic:] if names is None else names))
    if new == old:
        return P
    return _from_terms((*map(_encoded, new),), P.to_dict())


def with_plain_letters(P: Any) -> Any:
    """Return a polynomial for users: letters have their own names, without an internal prefix."""
    names = tuple(name.removeprefix(_LETTER) for name in P.context().names())
    return _from_terms(names, P.to_dict())


def _encoded(name: str) -> str:
    return re.sub(r"[^\x00-\x7f]", lambda a: f"_u{ord(a[0]):x}_", name)


def decoded(text: str) -> str:
    """Return a text of polynomials with variable names as the user wrote them."""
    text = text.replace(_LETTER, "")
    return re.sub(r"_u([89a-f][0-9a-f]|[0-9a-f]{3,6})_", lambda code: chr(int(code[1], 16)), text)


def letters_in(P: Any) -> int:
    """Return the number of letters, such as eps, which come before the variables x."""
    return len(letters_of(P.context()))


def letters_of(ring: Any) -> tuple[str, ...]:
    """Return the letters of a ring, by their names in the ring."""
    return (*takewhile(lambda name: name == "eps" or name.startswith(_LETTER), ring.names()),)


def variables_of(P: Any) -> int:
    """Return the number of variables x of P."""
    return int(P.context().nvars()) - letters_in(P)


# Monomials and degrees in x.


def exponents_up_to(degree: int, n: int) -> Exponents:
    """Return the exponents of all monomials in n variables up to a degree, in ascending order."""
    return tuple(
        tuple(factors.count(i) for i in range(n))
        for d in range(degree + 1)
        for factors in combinations_with_replacement(range(n), d)
    )


def exponents_in_x(P: Any) -> list[tuple[int, ...]]:
    """Return the exponents of x in the terms of a polynomial."""
    first = letters_in(P)
    return [e[first:] for e in P.monoms()]


def degree_of(P: Any) -> int:
    """Return the degree of a polynomial in x."""
    return max((int(sum(e)) for e in exponents_in_x(P)), default=0)


def has_constant_term(P: Any) -> bool:
    """Return True if a polynomial is not 0 at x = 0."""
    return any(not any(e) for e in exponents_in_x(P))


def sort_key(P: Any) -> tuple[Any, ...]:
    """Return the sort key of polynomials: short ones first, in one order for any value of eps."""
    monomials = sorted({(-sum(e), *(-k for k in e)) for e in exponents_in_x(P)})
    return degree_of(P), len(monomials), monomials, str(P)


def coefficients_in(P: Any, place: int) -> list[Any]:
    """Return [c_0, c_1, ...] with P = sum of c_k y**k, for y = variable number `place` of P."""
    terms: list[dict[Any, Any]] = []
    for e, c in P.to_dict().items():
        others = [*e]
        power, others[place] = int(e[place]), 0
        terms += [{} for _ in range(len(terms), power + 1)]
        terms[power][*others] = c
    return [P.context().from_dict(of_power) for of_power in terms]


# Factors.


def primitive(P: Any) -> Any:
    """Return the multiple of P with coprime integer coefficients and a positive first coefficient.

    If P has letters, symbolic parameters, the positive coefficient is that of the first term of
    lowest order in the first letter.
    """
    P = P.primitive()[1]
    orders = [e[0] for e in P.monoms()] if letters_in(P) else [0]
    first = P.coeffs()[orders.index(min(orders))] if P != 0 else 0
    return -P if first < 0 else P


def irreducible_factors(P: Any) -> list[tuple[Any, int]]:
    """Return the primitive irreducible factors of a polynomial, and their powers, in a fixed order.

    They are computed over the rationals: over the integers python-flint 0.9 fails if a coefficient
    is large.
    """
    rationals = flint.fmpq_mpoly_ctx.get(P.context().names(), ordering="deglex")
    powers = rationals.from_dict(P.to_dict()).factor()[1]
    powers = sorted(powers, key=lambda pair: (int(pair[1]), [*pair[0].terms()]))
    return [(primitive(*cleared(factor)), int(power)) for factor, power in powers]


def cleared(*polynomials: Any) -> list[Any]:
    """Return rational polynomials times the least number that makes all coefficients integers."""
    scale = math.lcm(*(int(c.q) for P in polynomials for c in P.coeffs()))
    names, terms = polynomials[0].context().names(), [P.to_dict() for P in polynomials]
    return [_from_terms(names, {e: (c * scale).p for e, c in each.items()}) for each in terms]


def without_content(P: Any) -> Any:
    """Return a polynomial without factors that do not depend on x."""
    if not letters_in(P):
        return primitive(P)
    powers = irreducible_factors(P)
    return math.prod((f**e for f, e in powers if degree_of(f)), start=P.context().constant(1))


def coprime(polynomials: Sequence[Any]) -> list[Any]:
    """Return polynomials divided by their greatest common divisor."""
    common = reduce(lambda P, Q: P.gcd(Q), polynomials)
    return [P // common for P in polynomials]


# Values, at points of any type of numbers.


def value_at(P: Any, x: Sequence[Any], degree: int | None = None) -> Any:
    """Return P(x); if `degree` is given, ``t^degree P(x / t)`` with the last coordinate t of x."""
    exponents = P.monoms()
    if degree is not None:
        exponents = [(*e, degree - sum(e)) for e in exponents]
    terms = zip(P.coeffs(), monomial_values(exponents, x), strict=True)
    return sum((int(c) * a for c, a in terms), 0 * x[-1])


def homogenized(P: Any, degree: int, forms: Sequence[Any], ring: Any) -> Any:
    """Return ``F_0^degree P(F_1 / F_0, ..., F_n / F_0)`` for forms F_1, ..., F_n, F_0 of a ring."""
    count = letters_in(P)
    terms = zip(P.monoms(), exponents_in_x(P), P.coeffs(), strict=True)
    homogeneous = {(*e, degree - sum(in_x)): c for e, in_x, c in terms}
    names = (*P.context().names()[:count], *labels(len(forms)))
    return _from_terms(names, homogeneous).compose(*ring.gens()[:count], *forms, ctx=ring)


def monomial_values(exponents: Sequence[tuple[int, ...]], x: Sequence[Any]) -> list[Any]:
    """Return the products ``x_1^e_1 x_2^e_2 ...`` for each e in `exponents`, at a point x."""
    one, highest = x[0] ** 0, map(max, zip(*exponents, strict=True))
    powers = [
        [*accumulate([a] * int(most), mul, initial=one)]
        for a, most in zip(x, highest, strict=False)
    ]
    places = [[(i, k) for i, k in enumerate(e) if k] for e in exponents]
    return [reduce(mul, (powers[i][k] for i, k in each)) if each else one for each in places]


def modulo(P: Any, p: int, values: Sequence[Any]) -> Any:
    """Return P in x alone, `values` in place of letters, modulo p (over the rationals if p = 0)."""
    return _with_numbers(P, p, dict(zip(letters_of(P.context()), values, strict=False)))


def with_values(P: Any, values: Mapping[str, Any]) -> Any:
    """Return P over the rationals, with the numbers `values[letter]` in place of letters."""
    letters = (name for name in letters_of(P.context()) if decoded(name) in values)
    return _with_numbers(P, 0, {name: values[decoded(name)] for name in letters})


def _with_numbers(P: Any, p: int, numbers: Mapping[str, Any]) -> Any:
    """Return P modulo p, or over the rationals, with `numbers`, by name, in place of variables."""
    context, *modulus = (flint.nmod_mpoly_ctx, p) if p else (flint.fmpq_mpoly_ctx,)
    names = P.context().names()
    ring = context.get(names, *modulus, ordering="deglex")
    # python-flint 0.9 would keep terms that are 0 modulo p.
    P = ring.from_dict({e: c for e, c in P.to_dict().items() if not p or int(c) % p})
    if not numbers:
        return P
    others = tuple(name for name in names if name not in numbers)
    return P.subs(numbers).project_to_context(context.get(others, *modulus, ordering="deglex"))


def random_line(dimension: int, p: int, rng: random.Random) -> list[Any]:
    """Return a random line modulo a prime: homogeneous coordinates a + b t, and t as the last."""
    pairs = ([rng.randrange(p), rng.randrange(p)] for _ in range(dimension))
    return [flint.nmod_poly(pair, p) for pair in (*pairs, [0, 1])]


# Linear algebra.


def prime_of(polynomials: Sequence[Any]) -> int:
    """Return a prime that divides no coefficient, always the same one for the same polynomials."""
    return prime_for(c for P in polynomials for c in P.coeffs())


def rank(polynomials: Sequence[Any]) -> int:
    """Return the number of linearly independent polynomials."""
    p = prime_of(polynomials)
    terms = [modulo(P, p, EPS).to_dict() for P in polynomials]
    monomials = {e for of_one in terms for e in of_one}
    rows = [[int(of_one.get(e, 0)) for e in monomials] for of_one in terms]
    return int(flint.nmod_mat(rows, p).rank()) if monomials else 0


def selected(
    candidates: Iterable[A], known: Iterable[A] = (), of: Callable[[A], Any] = lambda P: P
) -> Iterator[A]:
    """Yield each candidate c for which ``of(c)`` is independent of `known` and earlier ones."""
    basis = [*map(of, known)]
    for each in candidates:
        if rank([*basis, of(each)]) > len(basis):
            basis.append(of(each))
            yield each


def cramer(system: list[list[Any]]) -> list[Any]:
    """Return [N_1, ..., N_n, det A], such that x_i = N_i / det A solve the linear system A x = b.

    `system` has the rows of (A | b); Bareiss's elimination overwrites them.
    """
    n, previous = len(system), 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        if pivot != k:  # the negated row keeps the sign of det A
            system[k], system[pivot] = system[pivot], [-a for a in system[k]]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [*(row[n] for row in system), previous]


def determinant(rows: Sequence[Sequence[Any]]) -> Any:
    """Return the determinant of a matrix of polynomials; raise `ZeroDivisionError` if it is 0."""
    return cramer([[*row, 0] for row in rows])[-1]


def polynomials_with(rows: Rows, exponents: Exponents, letters: Sequence[str] = ()) -> Polynomials:
    """Return a basis of the span of polynomials with these `rows` of coefficients of monomials.

    A coefficient is a pair (N, D), for a quotient N / D of polynomials in letters. The result has
    primitive polynomials; without letters, LLL makes their coefficients short.
    """
    names = (*letters, *labels(len(exponents[0])))
    if not letters:
        numbers = ([fmpq(N.get((), Fraction(0))) for N, _ in row] for row in rows)
        integers = [flint.fmpq_mat([row]).numer_denom()[0].entries() for row in numbers]
        short = flint.fmpz_mat(integers).lll().tolist() if integers else []
        terms = (dict(zip(exponents, row, strict=True)) for row in short)
        return tuple(primitive(_from_terms(names, of_one)) for of_one in terms)
    return tuple(_cleared_row(row, exponents, names) for row in rows)


def _cleared_row(row: Any, exponents: Exponents, names: Sequence[str]) -> Any:
    """Return the polynomial with coefficients N / D, pairs in `row`, times a common denominator."""
    over_q = flint.fmpq_mpoly_ctx.get(names, ordering="deglex")
    zeros = (0,) * len(exponents[0])

    def polynomial(terms: Mapping[Any, Fraction]) -> Any:
        return over_q.from_dict({(*e, *zeros): fmpq(c) for e, c in terms.items()})

    pairs = [(polynomial(N), polynomial(D)) for N, D in row]
    common = reduce(lambda P, Q: P * (Q // P.gcd(Q)), (D for _, D in pairs))
    total = over_q.from_dict({})
    for (N, D), e in zip(pairs, exponents, strict=True):
        monomial = (*[0] * (len(names) - len(e)), *e)
        total += N * (common // D) * over_q.from_dict({monomial: 1})
    return primitive(*cleared(total))


# Limits for eps to 0.


def limit(P: Any) -> Any:
    """Return the limit of a polynomial for eps to 0, in the same ring."""
    return P % P.context().gens()[0] if letters_in(P) else P


def with_independent_limits(space: Sequence[Any]) -> list[Any]:
    """Return a basis of the span of `space` with linearly independent limits for eps to 0.

    A combination with the limit 0 is divided by eps and replaces a member, until none is left.
    """
    basis = list(space)
    while letters_in(basis[0]) and rank([*map(limit, basis)]) < len(basis):
        eps, reduced = basis[0].context().gens()[0], list[tuple[Any, Any]]()
        for number, P in enumerate(basis):
            for Q, monomial in reduced:
                a, b = (coefficient_of(limit(R), monomial) for R in (Q, P))
                P = a * P - b * Q if b != 0 else P
            if limit(P) != 0:
                reduced.append((P, exponents_in_x(limit(P))[0]))
                continue
            basis[number] = without_content(divided_out(P, eps)[0])
            break
    return basis


def coefficient_of(P: Any, monomial: tuple[int, ...]) -> Any:
    """Return the coefficient, a polynomial in letters, of the monomial with these exponents."""
    count, zeros = letters_in(P), [0] * len(monomial)
    terms = {(*e[:count], *zeros): c for e, c in P.to_dict().items() if e[count:] == monomial}
    return P.context().from_dict(terms)
