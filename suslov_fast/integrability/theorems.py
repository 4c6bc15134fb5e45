"""Integrals and measures of maps with letters, proved by identities of polynomials.

Which integrals there are, and which monomials they have, is the structure at small primes in place
of the letters. Integrals are quotients of coefficients of relations along orbits (Hirota and
Kimura), black boxes that `interpolation` turns into formulas; densities solve linear equations with
det DPhi. A null space at numbers is at least as large as for letters: what the structure lacks,
quotients of polynomials up to a degree, there is not for letters either.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce
from itertools import combinations_with_replacement
from math import prod
from typing import Any

import flint

from . import arithmetic
from .arithmetic import EXTRA, null_space, random_prime, row_space
from .functions import IDENTITY, MODULAR, RationalFunction, factored, independent_of, quotient_of
from .interpolation import Unknown, value_of
from .letters import Scalings
from .polynomials import (
    degree_of,
    determinant,
    exponents_in_x,
    exponents_up_to,
    irreducible_factors,
    limit,
    monomial_values,
    without_content,
)
from .relations import ImplicitIntegral, count_relations, implicit_integrals

_LARGEST = 3  # dimension of maps with proofs of densities as identities
_FACTORS = 5  # of a density, at most
_TERMS = 20_000  # of a pullback that is factored, at most


def lift(map: Any, found: Any) -> None:
    """Put formulas in the letters of a map into a report at numbers, in place of its own."""
    numbers = ", ".join(f"{name} = {a}" for name, a in map.numbers.items())
    missing, formulas = list[str](), list[tuple[Any, Any]]()
    if map.energy:
        formulas.append(map.energy)
    for integral in _structure(map, found, formulas):
        try:
            if integral.degree > found.degree:
                raise Unknown("above that of the report")
            N, D = _lifted(map, integral)
        except Unknown as error:
            missing.append(f"Not lifted: an integral of degree {integral.degree}, {error}.")
        else:
            formulas.append(_short(map, N, D))
    proved = [(N, D) for N, D in formulas if _is_integral(map, N, D)]
    pool: dict[str, Any] = {}
    for P in (*(D for _, D in proved), *(N for N, _ in proved)):
        pool |= {str(f): f for f, _ in irreducible_factors(P) if degree_of(f)}
    densities = list[RationalFunction]()
    for density in found.measures[:1]:
        try:
            P = _density(map, density.degree, -1 if density.cofactor else 1, [*pool.values()])
        except Unknown as error:
            missing.append(f"Not lifted: a density of degree {density.degree}, {error}.")
            continue
        pool |= {str(f): f for f, _ in irreducible_factors(P) if degree_of(f)}
        is_short = map.dimension <= _LARGEST and not density.cofactor
        basis = IDENTITY if is_short and _is_density(map, P) else MODULAR
        one = map.ring.constant(1)
        densities.append(replace(quotient_of(one, P, basis), cofactor=density.cofactor))
    missing += ["Not lifted: what holds at these numbers and is no identity in the letters."] * (
        len(proved) < len(formulas)
    )
    integrals = [quotient_of(N, D, IDENTITY) for N, D in proved]
    polynomials = [*_polynomials(map, pool.values())]
    found.map, found.implicit, found.symmetries = map, (), ()
    found.planar = found.level = found.on_level = None
    for name, functions in (
        ("integrals", integrals), ("measures", densities), ("polynomials", polynomials),
    ):  # fmt: skip
        setattr(found, name, tuple(f.renamed(map.names) for f in functions))
    found.special_eps = ()
    found.notes += [
        f"Degrees and searches are those at {numbers}; formulas hold for all.",
        *missing,
    ]


# Integrals.


def _structure(map: Any, found: Any, formulas: Sequence[Any]) -> Iterator[ImplicitIntegral]:
    """Yield integrals at numbers, of least degree, which are independent of known formulas."""
    at_numbers, wanted = map.at_numbers, found.relations or 0
    known: list[Any] = [quotient_of(N, D, MODULAR)._with(map.numbers) for N, D in formulas]
    for degree in range(1, found.degree + 1):
        exponents = exponents_up_to(degree, map.dimension)
        if len(known) < count_relations(at_numbers, exponents).integrals:
            candidates = implicit_integrals(at_numbers, exponents)
            for integral in independent_of(known, candidates, at_numbers.prime):
                known.append(integral)
                yield integral
                if len(known) >= wanted:
                    return


def _lifted(map: Any, integral: ImplicitIntegral) -> tuple[Any, Any]:
    """Return numerator and denominator of an integral in letters and x."""
    count, n = len(map.letters), map.dimension

    def value(at: Any, x: Sequence[Any]) -> int:
        return int(integral.value(at, [*x]))

    def box(p: int, values: list[int]) -> list[int]:
        x = [*(flint.nmod(a, p) for a in values[count:]), flint.nmod(1, p)]
        return [value(map.at(values[:count], p), x)]

    rng = random.Random(0)
    p = random_prime(rng)
    at = map.at([rng.randrange(1, p) for _ in map.letters], p)
    x = arithmetic.random_point(n, p, rng)
    if value(at, x) != value(at, at.image(x)):
        raise Unknown("which these numbers alone have")
    scalings = Scalings(map)
    of_numerator, of_denominator = (
        scalings.weight(e) for e in (integral.numerator, integral.denominator)
    )
    weight = [b - a for a, b in zip(of_numerator, of_denominator, strict=True)]
    ((N, D),) = scalings.lifted(box, [weight], count + n)
    return N, D


def _short(map: Any, P: Any, Q: Any) -> tuple[Any, Any]:
    """Return a quotient of two members of a pencil that are short, the denominator first.

    They lack a monomial, or are conics that are two lines.
    """
    of_P, of_Q, zero = _by_monomials(P), _by_monomials(Q), 0 * P
    members = [P, Q]
    for e in {**of_P, **of_Q}:
        members.append(of_Q.get(e, zero) * P - of_P.get(e, zero) * Q)
    if map.dimension == 2 and max(degree_of(P), degree_of(Q)) == 2:
        members += _conics(map, P, Q)
    found = {str(R): R for R in (without_content(R) for R in members if R != 0)}

    def key(R: Any) -> Any:
        in_letters = max(
            sum(e) - sum(f) for e, f in zip(R.monoms(), exponents_in_x(R), strict=True)
        )
        is_whole = not _is_reducible(map, R)
        return degree_of(limit(R)), degree_of(R), is_whole, in_letters, len(R), str(R)

    D, *others = sorted(found.values(), key=key)

    def place(R: Any) -> Any:
        both_constant = degree_of(limit(D)) == degree_of(limit(R)) == 0
        return both_constant, not _is_reducible(map, R), len(R), str(R)

    N = min(others, key=place)
    return N, D


def _by_monomials(P: Any) -> dict[tuple[int, ...], Any]:
    """Return the coefficients of a polynomial in x, polynomials in the letters."""
    found: dict[tuple[int, ...], dict[Any, Any]] = {}
    for e, in_x, c in zip(P.monoms(), exponents_in_x(P), P.coeffs(), strict=True):
        key = tuple(map(int, in_x))
        rest = (*e[: len(e) - len(key)], *(0,) * len(key))
        found.setdefault(key, {})[rest] = c
    return {key: P.context().from_dict(terms) for key, terms in found.items()}


def _form(P: Any) -> list[list[Any]]:
    """Return the symmetric matrix of a conic, in homogeneous coordinates, times 2."""
    terms, zero = _by_monomials(P), 0 * P

    def entry(i: int, j: int) -> Any:
        e = tuple((i == k) + (j == k) for k in range(2))
        return terms.get(e, zero) * (2 if i == j else 1)

    return [[entry(i, j) for j in range(3)] for i in range(3)]


def _is_reducible(map: Any, P: Any) -> bool:
    """Return True if a polynomial has factors with x, or is a conic that is two lines."""
    if sum(degree_of(f) > 0 for f, _ in irreducible_factors(P)) > 1:
        return True
    if map.dimension != 2 or degree_of(P) != 2:
        return False
    rng = random.Random(1)
    p = random_prime(rng)
    x = [rng.randrange(1, p) for _ in map.ring.gens()]
    rows = [[value_of(a.to_dict(), x, p) for a in row] for row in _form(P)]
    return bool(flint.nmod_mat(rows, p).rank() < 3)


def _conics(map: Any, P: Any, Q: Any) -> Iterator[Any]:
    """Yield the conics of a pencil that are two lines, with coefficients that are rational."""
    size = len(map.letters)
    names = (*map.ring.names(), "t")
    with_t = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
    *gens, t = with_t.gens()
    forms = [[[a.compose(*gens, ctx=with_t) for a in row] for row in _form(R)] for R in (P, Q)]
    rows = [[a + t * b for a, b in zip(*pair, strict=True)] for pair in zip(*forms, strict=True)]
    try:
        discriminant = determinant(rows)
    except ZeroDivisionError:
        return
    for f, _ in discriminant.factor()[1]:
        if f.degrees()[-1] == 1:
            slope = f.derivative(size + 2)
            rest = slope * t - f
            a, b = (R.project_to_context(map.ring) for R in (slope, rest))
            yield a * P + b * Q


def _is_integral(map: Any, N: Any, D: Any) -> bool:
    """Return True if N(Phi) D = D(Phi) N, as an identity in letters and x."""
    d = max(degree_of(N), degree_of(D))
    return bool(map.pullback(N, d) * D == map.pullback(D, d) * N)


# Densities and Darboux polynomials.


def _density(map: Any, degree: int, sign: int, pool: list[Any]) -> Any:
    """Return a polynomial P with P(Phi) = det DPhi P, a product of known ones and one more."""
    rng, n, scalings = random.Random(2), map.dimension, Scalings(map)
    p = random_prime(rng)
    values = [rng.randrange(1, p) for _ in map.letters]
    degrees = [degree_of(P) for P in pool]
    places = range(len(pool))
    products = [
        (degree - sum(degrees[k] for k in product), product)
        for count in range(_FACTORS)
        for product in combinations_with_replacement(places, count)
    ]
    for rest, product in sorted(each for each in products if each[0] >= 0):
        known = reduce(lambda P, k: P * pool[k], product, map.ring.constant(1))
        exponents = exponents_up_to(rest, n)
        space = _space(map, known, exponents, sign, p, values)
        if len(space) != 1:
            continue
        pivot = next(e for e, c in zip(exponents, space[0], strict=True) if c)
        weights = [
            [a - b for a, b in zip(scalings.weight(pivot), scalings.weight(e), strict=True)]
            for e in exponents
        ]

        def box(p: int, values: list[int], known: Any = known, exponents: Any = exponents) -> Any:
            space = _space(map, known, exponents, sign, p, values)
            if len(space) != 1:
                raise ZeroDivisionError
            return space[0]

        pairs = scalings.lifted(box, weights, len(map.letters))
        factor = _polynomial(map, pairs, exponents)
        return without_content(known * factor)
    raise Unknown("of which there are several or none")


def _is_density(map: Any, P: Any) -> bool:
    """Return True if P(Phi) = det DPhi P, as an identity in letters and x."""
    J, F_0, d = determinant(map._rows()), map.forms[-1], degree_of(P)
    # det DPhi = J / F_0^(D + 1)
    return bool(map.pullback(P, d) * F_0 ** (map.dimension + 1) == J * P * F_0**d)


def _space(
    map: Any, known: Any, exponents: Any, sign: int, p: int, values: Sequence[int]
) -> list[list[int]]:
    """Return the polynomials R, in echelon form, with P(Phi) = det DPhi P for P = known R."""
    at, rng, rows, terms = map.at(values, p), random.Random(p), [], known.to_dict()
    terms = {e: int(c) for e, c in terms.items()}
    for _ in range(len(exponents) + EXTRA):
        x = arithmetic.random_point(map.dimension, p, rng)
        y = at.image(x)
        here, there = (flint.nmod(value_of(terms, [*values, *_integers(z)], p), p) for z in (x, y))
        a = sign * at.derivative(x).det() * here
        pairs = zip(monomial_values(exponents, x), monomial_values(exponents, y), strict=True)
        rows.append([a * m - there * n for m, n in pairs])
    space = null_space(flint.nmod_mat(rows, p))
    return row_space(space, p) if space else []


def _integers(x: Sequence[Any]) -> list[int]:
    return [int(a) for a in x[:-1]]


def _polynomial(map: Any, pairs: Sequence[Any], exponents: Any) -> Any:
    """Return the polynomial with quotients of polynomials in letters as coefficients."""
    common = reduce(lambda P, Q: P * Q // P.gcd(Q), (D + 0 * map.ring.gens()[0] for _, D in pairs))
    x, total = map.variables, map.ring.constant(0)
    for (N, D), e in zip(pairs, exponents, strict=True):
        total += N * (common // D) * prod((a**k for a, k in zip(x, e, strict=False)), start=x[-1])
    return total


def _polynomials(map: Any, pool: Any) -> Iterator[RationalFunction]:
    """Yield those of polynomials that divide their pullback, with their cofactors."""
    for P in pool:
        d = degree_of(P)
        pulled = map.pullback(P, d)
        if len(pulled) <= _TERMS and pulled % P == 0:
            cofactor = factored(pulled // P) / factored(map.forms[-1]) ** d
            yield RationalFunction(((P, 1),), basis=IDENTITY, cofactor=cofactor)
