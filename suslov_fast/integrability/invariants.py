"""First integrals and invariant measures that follow from known Darboux polynomials.

If P and Q have one cofactor, P / Q is a first integral; if P has the cofactor det DPhi, 1 / P is
the density of a measure. Products of powers have products of cofactors: relations between these,
``C_1**e_1 ... C_n**e_n = 1``, are vectors of a lattice.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import flint

from . import arithmetic
from .arithmetic import EPS, PRIME, degree_of, modulo, rank, size
from .functions import (
    IDENTITY,
    MODULAR,
    RationalFunction,
    factored,
    independent,
    quotient_of,
    without_constant,
    without_content,
)
from .maps import RationalMap
from .normal_form import with_independent_limits

_TRIAL = 2**16  # prime factors of constants that are found; composite rests serve as well
_WEIGHT = 2**40  # of equations in a lattice
_HIGHEST = 8  # degree of functions whose limits for eps to 0 are looked at
_PRODUCTS = 20_000  # of generators that are looked at

Powers = tuple[int, ...]  # of the generators; those that are left out are 0


@dataclass(frozen=True)
class Product:
    """A product of powers of generators."""

    degree: int
    powers: Powers


class Invariants:
    """The Darboux polynomials of a map that were found, and what follows from them.

    Cofactors are told apart by their values at one random point modulo a prime.
    """

    def __init__(self, map: RationalMap, degree: int) -> None:
        self.map, self.degree = map, degree
        # Darboux polynomials that are no combinations of products of others.
        self.generators: list[RationalFunction] = []
        # Products of generators up to a degree, by the values of their cofactors.
        self.products: dict[int, list[Product]] = {1: [Product(0, ())]}
        self._degree_of_products = degree
        self.cofactors: dict[int, RationalFunction] = {1: RationalFunction(())}
        # Integrals in normal form, by the value of the cofactor of numerator and denominator.
        self.forms: dict[int, list[RationalFunction]] = {}
        # Generators with a symbolic eps in place of its number, by formula.
        self.lifts: dict[str, Any] = {}
        # Polynomials of equal cofactor, without one that is known.
        self.spaces: list[list[RationalFunction]] = []
        self.densities: list[RationalFunction] = []  # of a theorem
        self.raw: list[RationalFunction] = []  # densities, while factors of det DPhi are unknown
        self.has_factors = False  # whether these are known
        self._point = arithmetic.random_point(map.dimension)[:-1]

    def value(self, cofactor: Any) -> int:
        """Return the value of a cofactor by which it is known."""
        found = flint.nmod(arithmetic.fmpq(cofactor.constant), PRIME)
        for P, e in cofactor.factors:
            found *= flint.nmod(modulo(P, PRIME, EPS)(*self._point), PRIME) ** e
        return int(found)

    def multiply_up_to(self, degree: int) -> None:
        """Make the products of generators up to a degree, if they are not made yet."""
        if degree > self._degree_of_products:
            self._degree_of_products = degree
            self._begin_with(self.generators)

    def add(self, generator: RationalFunction) -> list[tuple[int, int]]:
        """Add a generator; return the value of the cofactor and the degree of each new product."""
        self.multiply_up_to(generator.degree)
        added = self._multiply(generator)
        kept = [g for g in self.generators if not self._is_combination(g)]
        if len(kept) < len(self.generators):
            self._begin_with(kept)
        return added

    def _begin_with(self, generators: list[RationalFunction]) -> None:
        self.generators, self.products = [], {1: [Product(0, ())]}
        for g in generators:
            self._multiply(g)

    def _is_combination(self, generator: RationalFunction) -> bool:
        """Return True for a combination of products of generators of lower degree."""
        products = self.products[self.value(generator.cofactor)]
        proper = [each for each in products if sum(each.powers) > 1]
        lower = [self.polynomial(self.product_of(each)) for each in proper]
        return rank([*lower, self.polynomial(generator)]) == rank(lower)

    def _multiply(self, generator: RationalFunction) -> list[tuple[int, int]]:
        cofactor: Any = generator.cofactor
        value, added = self.value(cofactor), []
        number = len(self.generators)
        self.generators.append(generator)
        known = [(v, product) for v, products in self.products.items() for product in products]
        count = len(known)
        for v, product in known:
            powers = product.powers + (0,) * (number - len(product.powers))
            degree, power, now = product.degree + generator.degree, 1, v * value % PRIME
            while degree <= self._degree_of_products and count < _PRODUCTS:
                self.products.setdefault(now, []).append(Product(degree, (*powers, power)))
                if now not in self.cofactors:
                    self.cofactors[now] = self.cofactors[v] * cofactor**power
                added.append((now, degree))
                count += 1
                degree, power, now = degree + generator.degree, power + 1, now * value % PRIME
        return added

    def replace(self, value: int, polynomials: list[Any], basis: str) -> list[RationalFunction]:
        """Replace the generators of a cofactor by others of the same degrees; return these."""
        numbers = [k for k, g in enumerate(self.generators) if self.value(g.cofactor) == value]
        numbers.sort(key=lambda k: self.generators[k].degree)
        polynomials = sorted(polynomials, key=degree_of)
        old = [self.generators[k].degree for k in numbers]
        if old != [degree_of(P) for P in polynomials]:
            return []
        new = []
        for k, P in zip(numbers, polynomials, strict=True):
            known = self.generators[k]
            g = replace(factored(P), constant=Fraction(1), basis=basis, cofactor=known.cofactor)
            if str(g) != str(known):
                self.generators[k] = g
                new.append(g)
        return new

    def highest(self, value: int) -> int:
        """Return the highest degree of generators with a cofactor."""
        degrees = (g.degree for g in self.generators if self.value(g.cofactor) == value)
        return max(degrees, default=0)

    def texts(self, value: int) -> set[str]:
        """Return the formulas of the generators with a cofactor."""
        return {str(g) for g in self.generators if self.value(g.cofactor) == value}

    def elements(self, value: int, degree: int) -> list[RationalFunction]:
        """Return independent products up to a degree with a cofactor, the shortest first."""
        products = [each for each in self.products.get(value, ()) if each.degree <= degree]
        pairs = [(f, self.polynomial(f)) for f in map(self.product_of, products)]
        pairs.sort(key=lambda pair: size(pair[1]))
        chosen: list[tuple[RationalFunction, Any]] = []
        for f, P in pairs:
            if rank([P, *(Q for _, Q in chosen)]) > len(chosen):
                chosen.append((f, P))
        return [f for f, _ in chosen]

    def polynomial(self, f: RationalFunction) -> Any:
        """Return a product of generators as one polynomial."""
        return f.quotient_in(self.map.ring)[0]

    def product_of(self, product: Product) -> RationalFunction:
        return self._power_product(product.powers)

    def _power_product(self, powers: Sequence[int]) -> RationalFunction:
        chosen = (g**e for g, e in zip(self.generators, powers, strict=False) if e)
        return math.prod(chosen, start=RationalFunction((), basis=IDENTITY))

    @property
    def integrals(self) -> tuple[RationalFunction, ...]:
        """Independent first integrals of least degree.

        They are quotients, and products of powers whose cofactors multiply to 1.
        """
        relations = _multiplicative_relations([g.cofactor for g in self.generators])
        products = sorted(map(self._product_in_normal_form, relations), key=_length)
        return independent([*sorted(self._quotients(), key=_length), *products])

    def _product_in_normal_form(self, powers: Sequence[int]) -> RationalFunction:
        """Return the integral of a relation, if possible that with a symbolic eps at its number."""
        product = self._power_product(powers)
        pairs = [(str(g), e) for g, e in zip(self.generators, powers, strict=True) if e]
        if pairs and all(name in self.lifts for name, _ in pairs):
            powers_of = (factored(self.lifts[name]) ** e for name, e in pairs)
            lifted = math.prod(powers_of, start=RationalFunction(()))
            map: Any = self.map
            return _with_limit(_upright(replace(lifted, basis=product.basis))).subs(map.eps)
        return _with_limit(_upright(product))

    def _quotients(self) -> Iterator[RationalFunction]:
        """Yield quotients of polynomials of one cofactor: over one of least degree, not 0 at 0."""
        for value in dict.fromkeys(self.value(g.cofactor) for g in self.generators):
            functions = self.elements(value, self.highest(value))
            forms = self.forms.get(value, [])
            if len(forms) == len(functions) - 1:
                basis = max((f.basis for f in functions), key=lambda basis: basis == MODULAR)
                yield from (replace(f, basis=basis) for f in forms)
            else:
                yield from self._over_one(functions)
        for functions in self.spaces:
            yield from self._over_one(functions)

    def _over_one(self, functions: list[RationalFunction]) -> Iterator[RationalFunction]:
        lowest = [f for f in functions if f.degree == functions[0].degree]
        below = next((f for f in lowest if _constant_term(f.numerator)), functions[0])
        yield from (_with_limit(f / below) for f in functions if f is not below)

    @property
    def measures(self) -> tuple[RationalFunction, ...]:
        """Densities of invariant measures, from one cofactor or else from several.

        If there is none, one up to sign, which has the cofactor -1.
        """
        found, det = [*self.densities, *self.raw], None
        if self.has_factors:
            det = self.map.jacobian_cofactor
        if det is not None:
            found += self._densities(det)
        if not found and det is not None:
            rows = _multiplicative_relations([det, *(g.cofactor for g in self.generators)])
            single = [row for row in rows if abs(row[0]) == 1]
            found += [self._power_product([a * b for b in row]) for a, *row in single[:1]]
        if not found and det is not None:
            minus = RationalFunction((), Fraction(-1))
            found = [replace(f, cofactor=minus) for f in self._densities(-det)[:1]]
        different = {str(f): f for f in found}.values()
        return tuple(sorted(different, key=_order))

    def _densities(self, cofactor: RationalFunction) -> list[RationalFunction]:
        """Return 1 / P for the products P with a cofactor."""
        most = self.map.degree * self.degree
        return [f**-1 for f in self.elements(self.value(cofactor), most)]

    @property
    def polynomials(self) -> tuple[RationalFunction, ...]:
        """The Darboux polynomials, without products of others."""
        return tuple(sorted(self.generators, key=lambda g: size(self.polynomial(g))))


def _length(f: RationalFunction) -> tuple[Any, ...]:
    """Return the key by which functions are sorted, short ones first, as by `size`."""
    sizes = [(size(P), e) for P, e in f.factors]
    return f.degree, sum(count for (_, count, *_), _ in sizes), sizes


def _upright(f: RationalFunction) -> RationalFunction:
    """Return f or 1 / f: the one whose numerator has the higher degree, or is 0 at 0."""

    def order(f: RationalFunction) -> tuple[int, bool]:
        return degree_of(f.numerator), _constant_term(f.denominator)

    return max((f, f**-1), key=order)


def _with_limit(f: RationalFunction) -> RationalFunction:
    """Return a function of f whose limit for eps to 0 is not constant."""
    if not f.degree or not f.has_letter or f.degree > _HIGHEST:
        return without_constant(f)
    above, below = (without_content(P) for P in f.quotient_in())
    below, above = with_independent_limits([below, above])
    return without_constant(quotient_of(above, below, f.basis))


def _order(f: RationalFunction) -> tuple[Any, ...]:
    """Return the key of densities: a zero of the denominator at 0 is of low order."""
    P = f.denominator
    first = int(arithmetic.has_letter(P))
    return f.degree, min(sum(e[first:]) for e in P.monoms()), *_length(f)


def _constant_term(P: Any) -> bool:
    first = int(arithmetic.has_letter(P))
    return any(not any(e[first:]) for e in P.monoms())


def _multiplicative_relations(cofactors: Sequence[Any]) -> list[list[int]]:
    """Return short exponents with which products of cofactors are 1, a basis of all."""
    exponents = []
    for cofactor in cofactors:
        of = {str(f): e for f, e in cofactor.factors}
        of["sign"] = int(cofactor.constant < 0)
        for sign, number in ((1, cofactor.constant.numerator), (-1, cofactor.constant.denominator)):
            primes = flint.fmpz(abs(number)).factor(trial_limit=_TRIAL)
            of |= {str(q): sign * int(e) for q, e in primes}
        exponents.append(of)
    exponents.append({"sign": 2})
    names, n = dict.fromkeys(name for of in exponents for name in of), len(cofactors)
    rows = [
        [int(i == j) for j in range(n)] + [_WEIGHT * of.get(name, 0) for name in names]
        for i, of in enumerate(exponents)
    ]
    reduced = arithmetic.integer_rows(flint.fmpz_mat(rows).lll())
    return [row[:n] for row in reduced if any(row[:n]) and not any(row[n:])]
