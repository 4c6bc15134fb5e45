"""First integrals and invariant measures from the Darboux polynomials of all cofactors."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import flint

from . import arithmetic
from .arithmetic import Polynomials, degree_of, factors, rank, size
from .darboux import cofactors_of, darboux_polynomials
from .functions import IDENTITY, MODULAR, RationalFunction, factored, quotient_of
from .maps import RationalMap

_TRIAL = 2**16  # prime factors of constants that are found; composite rests serve as well
_WEIGHT = 2**40  # of equations in a lattice


class Invariants:
    """The Darboux polynomials of a map that were found, and what follows from them."""

    def __init__(self, map: RationalMap) -> None:
        self.map = map
        # Darboux polynomials that are no combinations of products of others.
        self.generators: list[Any] = []
        self.quotients: list[RationalFunction] = []  # of equal cofactor, not independent
        self.densities: list[RationalFunction] = []  # of polynomials with the cofactor det DPhi
        self.known: list[RationalFunction] = []  # densities of a theorem

    @property
    def integrals(self) -> list[RationalFunction]:
        """First integrals: quotients, and products of powers whose cofactors multiply to 1."""
        relations = _multiplicative_relations([g.cofactor for g in self.generators])
        products = map(self._power_product, relations)

        def order(f: RationalFunction) -> tuple[int, bool]:
            return degree_of(f.numerator), _constant_term(f.denominator)

        return [max((f, f**-1), key=order) for f in (*self.quotients, *products)]

    @property
    def measures(self) -> list[RationalFunction]:
        """Densities of invariant measures, from one cofactor or else from several."""
        found, det = [*self.densities], self.map.jacobian_cofactor
        if not found and not self.known and det is not None:
            rows = _multiplicative_relations([det, *(g.cofactor for g in self.generators)])
            single = [row for row in rows if abs(row[0]) == 1]
            found += [self._power_product([a * b for b in row]) for a, *row in single[:1]]
        different = {str(f): f for f in (*self.known, *found)}.values()
        return sorted(different, key=lambda f: (f.degree, len(str(f))))

    @property
    def polynomials(self) -> list[RationalFunction]:
        """The Darboux polynomials, without products of others."""
        return sorted(self.generators, key=lambda g: size(g.numerator))

    def of_degree(self, degree: int) -> None:
        """Find the polynomials up to a degree with products of powers of factors as cofactors."""
        for cofactor in cofactors_of(self.map, degree):
            self.of_cofactor(cofactor, degree)

    def of_cofactor(self, cofactor: RationalFunction | None, degree: int) -> None:
        """Find the polynomials up to a degree that have a cofactor, None for det DPhi."""
        with contextlib.suppress(ArithmeticError):  # too long
            space = darboux_polynomials(self.map, degree, cofactor, seed=degree)
            self.add(space, cofactor or self.map.jacobian_cofactor, measures=cofactor is None)

    def add(
        self, space: Polynomials, cofactor: RationalFunction | None = None, measures: bool = False
    ) -> None:
        """Add polynomials of one cofactor, by default unknown; `measures` if it is det DPhi."""
        if not space:
            return
        space = tuple(sorted(space, key=size))
        functions = [replace(factored(P), basis=MODULAR) for P in space]
        if self.map.factors is not None:
            for f in (f for P in space for f, _ in factors(P) if degree_of(f)):
                if (own := self.map.cofactor(f)) is not None:
                    self._add_generator(f, own)
            if cofactor := cofactor or self.map.cofactor(space[0]):
                for P in space:
                    self._add_generator(P, cofactor)
                products = self._products_with(cofactor, degree_of(space[-1]))
                functions = [f for f, P in sorted(products, key=lambda each: size(each[1]))]
                measures = measures or cofactor == self.map.jacobian_cofactor
        # The denominator is of least degree, and not 0 at 0 if possible.
        lowest = [f for f in functions if f.degree == functions[0].degree]
        below = next((f for f in lowest if _constant_term(f.numerator)), functions[0])
        self.quotients += [self._checked(f / below) for f in functions if f is not below]
        if measures and not self.densities:
            self.densities = [f**-1 for f in functions]

    def _add_generator(self, P: Any, cofactor: RationalFunction) -> None:
        """Add a Darboux polynomial, unless it is a combination of products of others."""
        span = [Q for _, Q in self._products_with(cofactor, degree_of(P))]
        if rank([*span, P]) > len(span):
            found = replace(factored(P), basis=MODULAR, cofactor=cofactor)
            self.generators.append(self._checked(found))

    def _checked(self, f: RationalFunction) -> RationalFunction:
        """Check what the pullback of a function is as an identity, if it is not too long."""
        map, k = self.map, f.degree
        if f.basis == IDENTITY or not map.writes_out(k):
            return f
        parts = [each.quotient_in(map.ring) for each in (f, f.cofactor or RationalFunction(()))]
        (P, Q), (above, below) = parts
        if map.pullback(P, k) * Q * below != map.pullback(Q, k) * P * above:
            raise ArithmeticError(f"{f}: expected the cofactor {f.cofactor or 1}")
        return replace(f, basis=IDENTITY)

    def _products_with(self, cofactor: RationalFunction, degree: int) -> list[Any]:
        """Return independent products up to a degree that have a cofactor, and as polynomials."""
        found: list[Any] = []
        for f, c in self._products(degree, 0):
            if c == cofactor:
                P, _ = f.quotient_in(self.map.ring)
                if rank([P, *(Q for _, Q in found)]) > len(found):
                    found.append((f, P))
        return found

    def _products(self, degree: int, first: int) -> Iterator[tuple[Any, RationalFunction]]:
        """Yield the products of generators up to a degree, each once, and their cofactors."""
        yield RationalFunction((), basis=IDENTITY), RationalFunction(())
        for i, g in enumerate(self.generators[first:], start=first):
            if (remaining := degree - g.degree) >= 0:
                for f, c in self._products(remaining, i):
                    yield f * g, c * g.cofactor

    def add_hamiltonian(self, H: Any) -> None:
        """Add the integral H + grad H (x~ - x) / 3 of a field with a Hamiltonian, and 1/det A."""
        map = self.map
        *x, one = map.variables
        *above, F = map.forms
        self.known.append(quotient_of(one, map.denominator, IDENTITY))
        numerator = 3 * H * F
        for i, (f, y) in enumerate(zip(above, x, strict=True), map.has_letter):
            numerator += H.derivative(i) * (f - y * F)
        modified = self._checked(quotient_of(numerator, 3 * F, MODULAR))
        if modified.degree:
            self.quotients.append(modified)
            if modified.basis == IDENTITY:
                self.add(modified.quotient_in())

    def _power_product(self, powers: Sequence[int]) -> RationalFunction:
        chosen = (g**e for g, e in zip(self.generators, powers, strict=True) if e)
        return math.prod(chosen, start=RationalFunction((), basis=IDENTITY))


def _constant_term(P: Any) -> bool:
    first = int(arithmetic.has_letter(P))
    return any(not any(e[first:]) for e in P.monoms())


def _multiplicative_relations(cofactors: Sequence[RationalFunction]) -> list[list[int]]:
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
