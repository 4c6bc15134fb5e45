"""First integrals and invariant measures that follow from known Darboux polynomials."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import flint

from . import arithmetic
from .arithmetic import EPS, PRIME, degree_of, modulo, rank, size
from .functions import IDENTITY, RationalFunction, independent
from .maps import RationalMap

_TRIAL = 2**16  # prime factors of constants that are found; composite rests serve as well
_WEIGHT = 2**40  # of equations in a lattice
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
        # Products of generators up to the degree, by the values of their cofactors.
        self.products: dict[int, list[Product]] = {1: [Product(0, ())]}
        self.cofactors: dict[int, RationalFunction] = {1: RationalFunction(())}
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

    def add(self, generator: RationalFunction) -> list[tuple[int, int]]:
        """Add a generator; return the value of the cofactor and the degree of each new product."""
        added = self._multiply(generator)
        kept = [g for g in self.generators if not self._is_combination(g)]
        if len(kept) < len(self.generators):
            self.generators.clear()
            self.products = {1: [Product(0, ())]}
            for g in kept:
                self._multiply(g)
        return added

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
            while degree <= max(self.degree, generator.degree) and count < _PRODUCTS:
                self.products.setdefault(now, []).append(Product(degree, (*powers, power)))
                if now not in self.cofactors:
                    self.cofactors[now] = self.cofactors[v] * cofactor**power
                added.append((now, degree))
                count += 1
                degree, power, now = degree + generator.degree, power + 1, now * value % PRIME
        return added

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
        products = [_upright(f) for f in map(self._power_product, relations)]
        products.sort(key=_length)
        return independent([*sorted(self._quotients(), key=_length), *products])

    def _quotients(self) -> Iterator[RationalFunction]:
        """Yield quotients of polynomials of one cofactor: over one of least degree, not 0 at 0."""
        own: dict[int, int] = {}  # the highest degree of a generator of each cofactor
        for g in self.generators:
            value = self.value(g.cofactor)
            own[value] = max(own.get(value, 0), g.degree)
        spaces = [self.elements(value, degree) for value, degree in own.items()]
        for functions in (*spaces, *self.spaces):
            lowest = [f for f in functions if f.degree == functions[0].degree]
            below = next((f for f in lowest if _constant_term(f.numerator)), functions[0])
            yield from (f / below for f in functions if f is not below)

    @property
    def measures(self) -> tuple[RationalFunction, ...]:
        """Densities of invariant measures, from one cofactor or else from several."""
        found, det = [*self.densities, *self.raw], None
        if self.has_factors:
            det = self.map.jacobian_cofactor
        if det is not None:
            found += [f**-1 for f in self.elements(self.value(det), self.map.degree * self.degree)]
        if not found and det is not None:
            rows = _multiplicative_relations([det, *(g.cofactor for g in self.generators)])
            single = [row for row in rows if abs(row[0]) == 1]
            found += [self._power_product([a * b for b in row]) for a, *row in single[:1]]
        different = {str(f): f for f in found}.values()
        return tuple(sorted(different, key=_length))

    @property
    def polynomials(self) -> tuple[RationalFunction, ...]:
        """The Darboux polynomials, without products of others."""
        return tuple(sorted(self.generators, key=lambda g: size(self.polynomial(g))))


def _length(f: RationalFunction) -> tuple[int, int, str]:
    return f.degree, len(str(f)), str(f)


def _upright(f: RationalFunction) -> RationalFunction:
    """Return f or 1 / f: the one whose numerator has the higher degree, or is 0 at 0."""

    def order(f: RationalFunction) -> tuple[int, bool]:
        return degree_of(f.numerator), _constant_term(f.denominator)

    return max((f, f**-1), key=order)


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
