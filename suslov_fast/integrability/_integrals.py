"""First integrals and invariant measures from the Darboux polynomials of all cofactors."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import flint

from .._checks import instance, integer
from . import _exact
from ._darboux import Powers, Pulse, invariant_spaces
from ._exact import Polynomials
from ._maps import KahanMap
from ._projective import TERMS, Projective, RationalFunction, projective

IDENTITY, MODULAR = "identity", "modulo a prime, at random points"
_TRIAL = 2**16  # prime factors of constants that are found; composite rests serve as well
_WEIGHT = 2**40  # of equations in a lattice


@dataclass(frozen=True, repr=False)
class Found(RationalFunction):
    """A first integral, the density of a measure or a Darboux polynomial, and what it rests on."""

    basis: str = MODULAR
    cofactor: RationalFunction | None = None

    @property
    def maps_to_infinity(self) -> bool:
        """True if the map sends the zeros of a Darboux polynomial to infinity."""
        factors = () if self.cofactor is None else self.cofactor.factors
        return any(e < 0 and f % self.numerator == 0 for f, e in factors)


Key = tuple[tuple[int, ...], Fraction]  # the exponents and the constant of a cofactor


@dataclass(frozen=True)
class Darboux:
    """A Darboux polynomial that is no combination of products of others, and its cofactor."""

    P: Any
    key: Key
    basis: str


class Invariants:
    """The Darboux polynomials of a map, degree by degree, and what follows from them."""

    def __init__(self, map: Projective, pulse: Pulse = lambda: None) -> None:
        self.map, self.pulse = map, pulse
        self.generators: list[Darboux] = []
        self.keys: list[Key] = []  # of all cofactors
        self.integrals: list[Found] = []  # quotients of equal cofactor, not independent
        self.densities: list[Found] = []

    def up_to(self, degree: int) -> Invariants:
        for _ in self.steps(degree):
            pass
        return self

    def steps(self, degree: int) -> Iterator[int]:
        """Find the polynomials up to a degree, and yield each degree when it is done."""
        for k in range(1, degree + 1):
            self.of_degree(k, k)
            yield k
        # The map may permute a hypersurface and the hyperplane at infinity: their union is
        # invariant.
        self.of_degree(degree + 1, degree)

    @property
    def products(self) -> list[Found]:
        """First integrals that are products of powers of Darboux polynomials."""
        return [self._power_product(row) for row in _relations([g.key for g in self.generators])]

    @property
    def measures(self) -> list[Found]:
        """Densities of invariant measures, from one cofactor or else from several."""
        keys = [self.determinant, *(g.key for g in self.generators)]
        found = [row for row in _relations(keys) if abs(row[0]) == 1]
        products = [self._power_product([a * b for b in rest]) for a, *rest in found[:1]]
        return self.densities or products

    @property
    def polynomials(self) -> list[Found]:
        """The Darboux polynomials, without products of others."""
        found = (
            Found(((g.P, 1),), basis=g.basis, cofactor=self.function(g.key))
            for g in self.generators
        )
        return sorted(found, key=lambda f: _size(f.numerator))

    def of_degree(self, k: int, affine: int) -> None:
        for space in invariant_spaces(self.map, k, affine, self.pulse):
            self.pulse()
            proofs = {self.basis_of(P, k, space.powers) for P in space.polynomials}
            basis = IDENTITY if proofs == {IDENTITY} else MODULAR
            pairs = zip(space.powers[1:], self.map.of_denominator, strict=True)
            key = self._key(tuple(a - k * b for a, b in pairs), space.polynomials[0])
            self.keys.append(key)
            span = self._span(affine, key)
            for P in sorted(space.polynomials, key=_size):
                if _rank([*span, P]) > len(span):
                    self.generators.append(Darboux(P, key, basis))
                    span = self._span(affine, key)
            span.sort(key=_size)
            self.integrals += [quotient(P, span[0], basis) for P in span[1:]]
            if not self.densities and key == self.determinant:
                densities = (quotient(self.map.ring.constant(1), P, basis) for P in span)
                self.densities = sorted(densities, key=lambda f: (f.degree, len(str(f))))

    def _span(self, degree: int, key: Key) -> list[Any]:
        """Return independent products of generators up to a degree that have a cofactor."""
        span: list[Any] = []
        for P, own in self._products(degree, 0):
            if own == key and _rank([*span, P]) > len(span):
                span.append(P)
        return span

    def _products(self, degree: int, first: int) -> Iterable[tuple[Any, Key]]:
        """Yield the products of generators up to a degree, each once."""
        yield self.map.ring.constant(1), ((0,) * len(self.map.of_denominator), Fraction(1))
        for i, each in enumerate(self.generators[first:], start=first):
            if (own := int(each.P.total_degree())) <= degree:
                for P, (powers, c) in self._products(degree - own, i):
                    together = tuple(map(sum, zip(powers, each.key[0], strict=True)))
                    yield P * each.P, (together, c * each.key[1])

    @cached_property
    def determinant(self) -> Key:
        """The determinant of the map's derivative."""
        return self._key(tuple(self.map.of_determinant), None)

    def function(self, key: Key) -> RationalFunction:
        """Return a cofactor as a function."""
        factors = zip(self.map.factors or (), key[0], strict=True)
        return RationalFunction(tuple((f, e) for f, e in factors if e), key[1])

    def _key(self, powers: tuple[int, ...], P: Any) -> Key:
        """Return powers of the factors with the constant of the cofactor of P, or of det DPhi."""
        product, rng = self.function((powers, Fraction(1))), random.Random(0)
        f = None if P is None else RationalFunction(((P, 1),))
        while True:
            with contextlib.suppress(ZeroDivisionError):
                x = [Fraction(rng.randrange(-99, 99), 7) for _ in range(self.map.D)]
                value = self.map.map.determinant(x) if f is None else f(self.map.map(x)) / f(x)
                return powers, value / product(x)

    def basis_of(self, P: Any, degree: int, powers: Powers) -> str:
        """Check a polynomial's pullback as an identity, if it is not too long."""
        if self.map.terms(degree) > TERMS:
            return MODULAR
        factors = zip(self.map.factors or (), powers[1:], strict=True)
        product = math.prod((f**e for f, e in factors), start=P)
        require_multiple(self.map.pullback(P, degree), product)
        return IDENTITY

    def density(self, P: Any) -> Found:
        """Return 1 / P, and whether it is proved to be the density of an invariant measure."""
        degree, v = int(P.total_degree()), self.map.valuation
        known = zip(v(self.map.pullback(P, degree)), self.map.of_denominator, v(P), strict=True)
        powers = tuple(a - degree * b - c for a, b, c in known)
        product = math.prod((f**a for f, a in zip(self.map.factors or (), v(P), strict=True)))
        proved = self._key(powers, P) == self.determinant and (P // product).is_constant()
        return quotient(self.map.ring.constant(1), P, IDENTITY if proved else MODULAR)

    def _power_product(self, powers: Sequence[int]) -> Found:
        chosen = [(g, e) for g, e in zip(self.generators, powers, strict=True) if e]
        basis = MODULAR if any(g.basis == MODULAR for g, _ in chosen) else IDENTITY
        return Found(_sorted((g.P, e) for g, e in chosen), basis=basis)


def independent(candidates: Iterable[Found]) -> tuple[Found, ...]:
    """Return functions of least degree on which the others depend."""
    p = _exact.random_prime(rng := random.Random(0))
    chosen: list[Found] = []
    rows: list[list[Any]] = []
    x: list[int] = []
    for each in sorted(candidates, key=lambda f: (f.degree, len(str(f)), str(f))):
        D = each.factors[0][0].context().nvars()
        x = x or [rng.randrange(p) for _ in range(D)]
        row = [flint.nmod(0, p)] * D
        for P, e in each.factors:  # the derivative of the logarithm
            f = _exact.modulo(P, p)
            scale = flint.nmod(e, p) / flint.nmod(int(f(*x)), p)
            row = [a + scale * int(f.derivative(i)(*x)) for i, a in enumerate(row)]
        if flint.nmod_mat([*rows, row], p).rank() > len(rows):
            chosen, rows = [*chosen, each], [*rows, row]
    return tuple(chosen)


def require_multiple(P: Any, Q: Any) -> None:
    if P * Q.leading_coefficient() != Q * P.leading_coefficient():
        raise ArithmeticError(f"{Q}: expected a constant multiple of it, got {P}")


def rank_of_quotients(polynomials: Sequence[Any]) -> int:
    """Return the number of independent quotients of polynomials."""
    first, *others = polynomials or (None,)
    return len(independent(quotient(P, first, MODULAR) for P in others))


def common_denominator(functions: Iterable[Found]) -> Polynomials:
    """Return polynomials whose quotients are the independent ones of the functions."""
    chosen = [(f.numerator, f.denominator) for f in independent(functions)]
    if not chosen:
        return ()
    common = reduce(lambda a, b: a * b // a.gcd(b), (Q for _, Q in chosen))
    return (common, *(P * (common // Q) for P, Q in chosen))


def quotient(P: Any, Q: Any, basis: str) -> Found:
    """Return a quotient of polynomials in irreducible factors, without a constant."""
    exponents: dict[str, int] = {}
    polynomials = {}
    for each, sign in ((P, 1), (Q, -1)):
        for f, e in _exact.factors(each):
            polynomials[str(f)] = f
            exponents[str(f)] = exponents.get(str(f), 0) + sign * e
    powers = ((f, exponents[name]) for name, f in polynomials.items() if exponents[name])
    return Found(_sorted(powers), basis=basis)


def _sorted(powers: Iterable[tuple[Any, int]]) -> tuple[tuple[Any, int], ...]:
    return tuple(sorted(powers, key=lambda power: _size(power[0])))


def _size(P: Any) -> tuple[int, int, str]:
    return int(P.total_degree()), len(P.to_dict()), str(P)


def _rank(polynomials: Sequence[Any]) -> int:
    terms = [P.to_dict() for P in polynomials]
    monomials = sorted({e for each in terms for e in each})
    return int(flint.fmpz_mat([[each.get(e, 0) for e in monomials] for each in terms]).rank())


def _relations(keys: Sequence[Key]) -> list[list[int]]:
    """Return short exponents with which products of cofactors are 1, a basis of all."""
    if not keys:
        return []
    vectors = []
    for powers, c in keys:
        vector: dict[Any, int] = dict(enumerate(powers))
        for number, sign in ((c.numerator, 1), (c.denominator, -1)):
            for q, e in flint.fmpz(abs(number)).factor(trial_limit=_TRIAL):
                vector[f"{q}"] = vector.get(f"{q}", 0) + sign * int(e)
        vectors.append(vector)
    n, names = len(keys), dict.fromkeys(name for vector in vectors for name in vector)
    rows = [
        [int(i == j) for j in range(n)] + [_WEIGHT * vector.get(name, 0) for name in names]
        for i, vector in enumerate(vectors)
    ]
    reduced = _exact.integer_rows(flint.fmpz_mat(rows).lll())
    found = [row[:n] for row in reduced if not any(row[n:])]
    # If a product is -1, its square is 1.
    odd = [sum(a for a, (_, c) in zip(row, keys, strict=True) if c < 0) % 2 for row in found]
    return [[(1 + b) * a for a in row] for row, b in zip(found, odd, strict=True)]


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
    instance("map", map, KahanMap)
    found = Invariants(factored(map)).up_to(integer("degree", degree, 0))
    one = (tuple(0 for _ in found.map.of_denominator), Fraction(1))
    return tuple(
        found.function(key) for key in dict.fromkeys([one, found.determinant, *found.keys])
    )


def factored(map: KahanMap) -> Projective:
    """Return the projective map; ArithmeticError if its factors are not known."""
    if (found := projective(map)).factors is None:
        raise ArithmeticError(
            f"expected a map with an inverse and factors of det DPhi of at most {TERMS} terms"
        )
    return found
