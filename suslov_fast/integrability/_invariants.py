"""First integrals and invariant measures from the Darboux polynomials of all cofactors."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, lru_cache, reduce
from typing import Any, NamedTuple

import flint

from .._checks import integer
from . import _exact
from ._darboux import Powers, invariant_spaces
from ._exact import Polynomials
from ._functions import (
    IDENTITY,
    MODULAR,
    RationalFunction,
    independent,
    product_of,
    quotient_of,
    rank,
    size,
)
from ._maps import KahanMap, check_map
from ._projective import TERMS, Projective

_TRIAL = 2**16  # prime factors of constants that are found; composite rests serve as well
_WEIGHT = 2**40  # of equations in a lattice


class Cofactor(NamedTuple):
    """A constant times powers of the factors of a map."""

    powers: Powers
    constant: Fraction


class Darboux(NamedTuple):
    """A Darboux polynomial that is no combination of products of others."""

    P: Any
    cofactor: Cofactor
    basis: str


class Invariants:
    """The Darboux polynomials of a map, degree by degree, and what follows from them."""

    def __init__(self, map: Projective) -> None:
        self.map = map
        self.generators: list[Darboux] = []
        self.cofactors: list[Cofactor] = []
        self.quotients: list[RationalFunction] = []  # of equal cofactor, not independent
        self.densities: list[RationalFunction] = []

    def up_to(self, degree: int) -> Iterator[int]:
        """Find the polynomials up to a degree, and yield each degree when it is done."""
        for k in range(1, degree + 1):
            self.of_degree(k, k)
            yield k
        # The map may permute a hypersurface and the hyperplane at infinity: their union is
        # invariant.
        self.of_degree(degree + 1, degree)

    @property
    def integrals(self) -> list[RationalFunction]:
        """First integrals: quotients, and products of powers whose cofactors multiply to 1."""
        relations = _multiplicative_relations([g.cofactor for g in self.generators])
        return self.quotients + [self._power_product(row) for row in relations]

    @property
    def measures(self) -> list[RationalFunction]:
        """Densities of invariant measures, from one cofactor or else from several."""
        found, one = [*self.densities], self.map.affine_ring.constant(1)
        if self.map.determinant == self.map.backward:  # det DPhi(x) is det A(Phi(x)) / det A(x)
            found.append(quotient_of(one, self.map.affine(self.map.determinant), IDENTITY))
        if not self.densities and self.map.affine_factors is not None:
            rows = _multiplicative_relations(
                [self.determinant, *(g.cofactor for g in self.generators)]
            )
            single = [row for row in rows if abs(row[0]) == 1]
            found += [self._power_product([a * b for b in row]) for a, *row in single[:1]]
        different = {str(f): f for f in found}.values()
        return sorted(different, key=lambda f: (f.degree, len(str(f))))

    @property
    def polynomials(self) -> list[RationalFunction]:
        """The Darboux polynomials, without products of others."""
        generators = sorted(self.generators, key=lambda g: size(g.P))
        return [
            RationalFunction(((P, 1),), basis=basis, cofactor=self.function(cofactor))
            for P, cofactor, basis in generators
        ]

    def of_degree(self, k: int, affine: int) -> None:
        for powers, polynomials in invariant_spaces(self.map, k, affine):
            self.map.pulse()
            proofs = {self.basis_of(P, k, powers) for P in polynomials}
            basis = IDENTITY if proofs == {IDENTITY} else MODULAR
            (cofactor,) = {self._cofactor(P, k, powers) for P in polynomials}
            self.cofactors.append(cofactor)
            span = self._products_with(cofactor, affine)
            for P in sorted(polynomials, key=size):
                if rank([*span, P]) > len(span):
                    self.generators.append(Darboux(P, cofactor, basis))
                    span = self._products_with(cofactor, affine)
            span.sort(key=size)
            self.quotients += [quotient_of(P, span[0], basis) for P in span[1:]]
            if not self.densities and cofactor == self.determinant:
                one = self.map.affine_ring.constant(1)
                self.densities = [quotient_of(one, P, basis) for P in span]

    def add_modified_energy(self) -> None:
        """Add the integral H + grad H (x~ - x) / 3 of a field with a Hamiltonian."""
        ring, D = self.map.affine_ring, self.map.D
        H = self.map.map.field.hamiltonian
        scale = math.lcm(*(c.denominator for c in H.terms.values()))
        H = ring.from_dict(
            {tuple(map(e.count, range(D))): int(c * scale) for e, c in H.terms.items()}
        )
        *numerators, F = map(self.map.affine, self.map.F)
        steps = (f - x * F for f, x in zip(numerators, ring.gens(), strict=True))
        change = sum((H.derivative(i) * step for i, step in enumerate(steps)), 0 * H)
        modified = quotient_of(3 * H * F + change, 3 * F, MODULAR)
        if not (k := modified.degree):
            return
        P, Q = (self.map.homogeneous(f, k) for f in (modified.numerator, modified.denominator))
        if self.map.terms(k) + math.comb(D + k, k) <= TERMS:
            if self.map.pullback(P) * Q != self.map.pullback(Q) * P:
                raise ArithmeticError(f"{modified}: expected an integral")
            modified = replace(modified, basis=IDENTITY)
        self.quotients.append(modified)

    def _products_with(self, cofactor: Cofactor, degree: int) -> list[Any]:
        """Return independent products of generators up to a degree that have a cofactor."""
        span: list[Any] = []
        for P, c in self._products(degree, 0):
            if c == cofactor and rank([*span, P]) > len(span):
                span.append(P)
        return span

    def _products(self, degree: int, first: int) -> Iterator[tuple[Any, Cofactor]]:
        """Yield the products of generators up to a degree, each once."""
        yield self.map.affine_ring.constant(1), Cofactor((0,) * len(self.map.factors), Fraction(1))
        for i, (Q, cofactor, _) in enumerate(self.generators[first:], start=first):
            if (remaining := degree - int(Q.total_degree())) >= 0:
                for P, (powers, c) in self._products(remaining, i):
                    together = tuple(map(sum, zip(powers, cofactor.powers, strict=True)))
                    yield P * Q, Cofactor(together, c * cofactor.constant)

    @cached_property
    def determinant(self) -> Cofactor:
        """The determinant of the map's derivative."""
        return self._with_constant(self.map.of_determinant, self.map.map.determinant)

    def _cofactor(self, P: Any, degree: int, powers: Powers) -> Cofactor:
        """Return the cofactor of a polynomial whose pullback is P times these powers."""
        pairs = zip(powers, self.map.of_denominator, strict=True)
        return self._with_constant(
            [a - degree * b for a, b in pairs],
            lambda x: _exact.value_at(P, self.map.map(x)) / _exact.value_at(P, x),
        )

    def _with_constant(self, powers: Sequence[int], f: Callable[[Any], Fraction]) -> Cofactor:
        """Return a function, a constant times these powers of factors, as a cofactor."""
        product, rng = self.function(Cofactor(tuple(powers), Fraction(1))), random.Random(0)
        while True:
            with contextlib.suppress(ZeroDivisionError):
                x = [Fraction(rng.randrange(-99, 99), 7) for _ in range(self.map.D)]
                return Cofactor(tuple(powers), f(x) / product(x))

    def function(self, cofactor: Cofactor) -> RationalFunction:
        """Return a cofactor as a function."""
        pairs = zip(self.map.affine_factors or (), cofactor.powers[1:], strict=True)
        return RationalFunction(tuple((f, e) for f, e in pairs if e), cofactor.constant)

    def basis_of(self, P: Any, degree: int, powers: Sequence[int]) -> str:
        """Check a polynomial's pullback as an identity, if it is not too long."""
        if self.map.terms(degree) > TERMS:
            return MODULAR
        P = self.map.homogeneous(P, degree)
        factors = zip(self.map.factors, powers, strict=True)
        product = math.prod((f**e for f, e in factors), start=P)
        pulled = self.map.pullback(P)
        if pulled * product.leading_coefficient() != product * pulled.leading_coefficient():
            raise ArithmeticError(f"{product}: expected a constant multiple of it, got {pulled}")
        return IDENTITY

    def _power_product(self, powers: Sequence[int]) -> RationalFunction:
        chosen = [(g, e) for g, e in zip(self.generators, powers, strict=True) if e]
        basis = MODULAR if any(g.basis == MODULAR for g, _ in chosen) else IDENTITY
        return product_of(((g.P, e) for g, e in chosen), basis)


def common_denominator(functions: Iterable[RationalFunction]) -> Polynomials:
    """Return polynomials whose quotients are the independent ones of the functions."""
    chosen = [(f.numerator, f.denominator) for f in independent(functions)]
    if not chosen:
        return ()
    common = reduce(lambda a, b: a * b // a.gcd(b), (Q for _, Q in chosen))
    return (common, *(P * (common // Q) for P, Q in chosen))


def _multiplicative_relations(cofactors: Sequence[Cofactor]) -> list[list[int]]:
    """Return short exponents with which products of cofactors are 1, a basis of all."""
    exponents = []
    for powers, c in cofactors:
        of: dict[Any, int] = dict(enumerate(powers))
        of["sign"] = int(c < 0)
        for number, sign in ((c.numerator, 1), (c.denominator, -1)):
            for q, e in flint.fmpz(abs(number)).factor(trial_limit=_TRIAL):
                of[str(q)] = of.get(str(q), 0) + sign * int(e)
        exponents.append(of)
    exponents.append({"sign": 2})
    names, n = dict.fromkeys(name for of in exponents for name in of), len(cofactors)
    rows = [
        [int(i == j) for j in range(n)] + [_WEIGHT * of.get(name, 0) for name in names]
        for i, of in enumerate(exponents)
    ]
    reduced = _exact.integer_rows(flint.fmpz_mat(rows).lll())
    return [row[:n] for row in reduced if any(row[:n]) and not any(row[n:])]


def cofactors(map: KahanMap, degree: int) -> tuple[RationalFunction, ...]:
    """Find the cofactors that polynomials up to a degree can have (arXiv:1902.04715).

    They are constants times products of powers of the irreducible factors over the rationals of
    det DPhi and of the map's denominator. Of these products the ones are returned for which there
    is a polynomial modulo a prime, and 1 and det DPhi.

    Parameters
    ----------
    map : KahanMap
        Made by `kahan`.
    degree : int
        Largest degree of the polynomials.

    Returns
    -------
    tuple of RationalFunction
        They can be called with a point, and are arguments of `darboux_polynomials`.

    Raises
    ------
    TypeError, ValueError
        If an argument has a wrong type or value.
    ArithmeticError
        If the map has no inverse, or the factors are too long to write out.

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> from suslov_fast.integrability import cofactors, darboux_polynomials, kahan
    >>> prey = QuadraticField.from_function(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
    >>> map = kahan(prey, eps=1)
    >>> for C in cofactors(map, 1):
    ...     print(C, darboux_polynomials(map, 1, C))
    1 (1,)
    -(3*x1 + x2 + 1)*(3*x1 + x2 - 9)/(x1 - 3*x2 - 3)^2 ()
    (3*x1 + x2 - 9)/(x1 - 3*x2 - 3) (x1,)
    -(3*x1 + x2 + 1)/(x1 - 3*x2 - 3) (x2,)
    """
    check_map(map)
    degree = integer("degree", degree, 0)
    _exact.check_unknowns("degree", degree, map.dimension)
    found = invariants_up_to(map, degree)
    one = Cofactor((0,) * len(found.map.factors), Fraction(1))
    different = dict.fromkeys([one, found.determinant, *found.cofactors])
    return tuple(found.function(c) for c in different)


@lru_cache(maxsize=8)
def invariants_up_to(map: KahanMap, degree: int) -> Invariants:
    """Return the Darboux polynomials; ArithmeticError if the factors of the map are not known."""
    if (projective := Projective(map)).affine_factors is None:
        raise ArithmeticError(
            f"expected a map with an inverse and factors of det DPhi of at most {TERMS} terms"
        )
    found = Invariants(projective)
    for _ in found.up_to(degree):
        pass
    return found
