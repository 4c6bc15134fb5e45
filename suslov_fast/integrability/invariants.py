"""First integrals and invariant measures that follow from known Darboux polynomials.

If P and Q have one cofactor, P / Q is a first integral; if P has the cofactor det DPhi, 1 / P is
the density of a measure. Products of powers have products of cofactors: relations between these,
``C_1**e_1 ... C_n**e_n = 1``, are vectors of a lattice.

The polynomials of one cofactor span a space, and quotients of any two are first integrals. A basis
in normal form consists of the reducible members of a pencil, if there are any. If eps is symbolic,
the limits of numerator and denominator for eps to 0 count as well.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from operator import itemgetter
from typing import Any, NamedTuple

import flint

from . import arithmetic
from .arithmetic import EPS
from .birational_maps import RationalMap
from .pencils import count_factors, reducible_members
from .polynomials import (
    coefficient_of,
    degree_of,
    exponents_in_x,
    has_constant_term,
    letters_in,
    limit,
    rank,
    selected,
    sort_key,
    variables_of,
    with_independent_limits,
    without_content,
)
from .rational_functions import (
    IDENTITY,
    MODULAR,
    RationalFunction,
    factored,
    independent,
    quotient_of,
    without_constant,
)

_TRIAL = 2**16  # prime factors of constants that are found; coprime rests serve as well
_WEIGHT = 2**40  # of equations in a lattice
_HIGHEST = 8  # degree of functions whose limits for eps to 0 are computed
_LETTERS = 6  # with which reducible members of a pencil are sought: with more they take long
_PRODUCTS = 20_000  # of generators, at most

Powers = tuple[int, ...]  # of the generators; those that are left out are 0


class Product(NamedTuple):
    """A product g_1**e_1 g_2**e_2 ... of Darboux polynomials: its degree and the `powers` e."""

    degree: int
    powers: Powers


_ONE = Product(0, ())


class Invariants:
    """The Darboux polynomials found of a map, and the integrals and measures that they imply.

    `generators` are Darboux polynomials that are no combinations of products of others. In methods,
    `value` stands for a cofactor: its value at one random point modulo a prime identifies it.
    """

    def __init__(self, map: RationalMap, degree: int) -> None:
        self.map, self.degree, self.p = map, degree, map.prime
        # Darboux polynomials that are no combinations of products of others.
        self.generators: list[RationalFunction] = []
        # Products of generators up to a degree, by the values of their cofactors.
        self.products: dict[int, list[Product]] = {1: [_ONE]}
        self._degree_of_products = degree
        self.cofactors: dict[int, RationalFunction] = {1: RationalFunction(())}
        # Integrals in normal form, by the value of the cofactor of numerator and denominator.
        self.forms: dict[int, list[RationalFunction]] = {}
        # Polynomials of equal cofactor, which is not known.
        self.spaces: list[list[RationalFunction]] = []
        self.densities: list[RationalFunction] = []  # by a theorem
        self.early_densities: list[RationalFunction] = []  # before the factors of det DPhi
        self.has_factors = False  # whether these are known
        self._point = arithmetic.random_point(map.dimension, self.p)

    def value(self, cofactor: Any) -> int:
        """Return the value of a cofactor at a random point modulo a prime, which identifies it."""
        return int(cofactor.values_modulo(self.p, EPS, [self._point])[0])

    # Generators and their products.

    def multiply_up_to(self, degree: int) -> None:
        """Compute products of Darboux polynomials up to a degree, unless they are known."""
        if degree > self._degree_of_products:
            self._degree_of_products = degree
            self._start_with(self.generators)

    def add(self, generator: RationalFunction) -> list[tuple[int, int]]:
        """Add a Darboux polynomial; return (value of cofactor, degree) of each new product."""
        self.multiply_up_to(generator.degree)
        added = self._multiply_by(generator)
        kept = [g for g in self.generators if not self._is_combination(g)]
        if len(kept) < len(self.generators):
            self._start_with(kept)
        return added

    def is_known(self, P: Any, cofactor: Any) -> bool:
        """Return True if P is constant, or a combination of known products with this cofactor."""
        degree = degree_of(P)
        self.multiply_up_to(degree)
        elements = self.elements(self.value(cofactor), degree)
        return degree == 0 or rank([*map(self.polynomial, elements), P]) == len(elements)

    def _start_with(self, generators: list[RationalFunction]) -> None:
        self.generators, self.products = [], {1: [_ONE]}
        for g in generators:
            self._multiply_by(g)

    def _is_combination(self, generator: RationalFunction) -> bool:
        """Return True if a generator is a combination of products of generators of lower degree."""
        products = self.products[self.value(generator.cofactor)]
        of_several = [product for product in products if sum(product.powers) > 1]
        lower = [self.polynomial(self.power_product(product.powers)) for product in of_several]
        return rank([*lower, self.polynomial(generator)]) == rank(lower)

    def _multiply_by(self, generator: RationalFunction) -> list[tuple[int, int]]:
        """Add a generator and its products with others; return (cofactor value, degree) of each."""
        cofactor: Any = generator.cofactor
        factor, new = self.value(cofactor), []
        number = len(self.generators)
        self.generators.append(generator)
        known = [(v, product) for v, products in self.products.items() for product in products]
        count = len(known)
        for old_value, (degree, old_powers) in known:
            powers = old_powers + (0,) * (number - len(old_powers))
            value, power = old_value, 0
            while degree + generator.degree <= self._degree_of_products and count < _PRODUCTS:
                degree, power = degree + generator.degree, power + 1
                value = value * factor % self.p
                self.products.setdefault(value, []).append(Product(degree, (*powers, power)))
                if value not in self.cofactors:
                    self.cofactors[value] = self.cofactors[old_value] * cofactor**power
                new.append((value, degree))
                count += 1
        return new

    def replace(self, value: int, polynomials: list[Any], basis: str) -> list[RationalFunction]:
        """Replace generators of the cofactor that `value` identifies; return those that change.

        None change if degrees of `polynomials` differ; `basis` says how these were confirmed.
        """
        numbers = [k for k, g in enumerate(self.generators) if self.value(g.cofactor) == value]
        numbers.sort(key=lambda k: self.generators[k].degree)
        polynomials = sorted(polynomials, key=degree_of)
        degrees = [self.generators[k].degree for k in numbers]
        if degrees != [degree_of(P) for P in polynomials]:
            return []
        new = []
        for k, P in zip(numbers, polynomials, strict=True):
            old = self.generators[k]
            g = replace(factored(P), constant=Fraction(1), basis=basis, cofactor=old.cofactor)
            if str(g) != str(old):
                self.generators[k] = g
                new.append(g)
        return new

    def highest(self, value: int) -> int:
        """Return the highest degree of known polynomials with this cofactor value, or 0."""
        degrees = (g.degree for g in self.generators if self.value(g.cofactor) == value)
        return max(degrees, default=0)

    def texts(self, value: int) -> set[str]:
        """Return the formulas of known Darboux polynomials with this cofactor value."""
        return {str(g) for g in self.generators if self.value(g.cofactor) == value}

    def elements(self, value: int, degree: int) -> list[RationalFunction]:
        """Return independent products up to a degree with this cofactor value, short ones first."""
        products = [product for product in self.products.get(value, ()) if product.degree <= degree]
        functions = [self.power_product(product.powers) for product in products]
        pairs = [(f, self.polynomial(f)) for f in functions]
        pairs.sort(key=lambda pair: sort_key(pair[1]))
        return [f for f, _ in selected(pairs, of=itemgetter(1))]

    def polynomial(self, f: RationalFunction) -> Any:
        """Return f, a product of polynomials, multiplied out, without a constant denominator."""
        return f.as_quotient(self.map.ring)[0]

    def power_product(self, powers: Sequence[int]) -> RationalFunction:
        factors = (g**e for g, e in zip(self.generators, powers, strict=False) if e)
        return math.prod(factors, start=RationalFunction((), basis=IDENTITY))

    # What follows.

    @property
    def integrals(self) -> tuple[RationalFunction, ...]:
        """Independent integrals of least degree: P / Q of one cofactor, products of cofactor 1."""
        relations = _multiplicative_relations([g.cofactor for g in self.generators])
        products = sorted(map(self._product_in_normal_form, relations), key=_sort_key)
        found = independent([*sorted(self._quotients(), key=_sort_key), *products], self.p)
        return tuple(map(_without_constant_term, found))

    def _product_in_normal_form(self, powers: Sequence[int]) -> RationalFunction:
        """Return the integral that is the product of g**e for generators g and e in `powers`."""
        return _with_varying_limit(_f_or_reciprocal(self.power_product(powers)))

    def _quotients(self) -> Iterator[RationalFunction]:
        """Yield quotients of polynomials of one cofactor, of the `normal_basis` if it is known."""
        for value in dict.fromkeys(self.value(g.cofactor) for g in self.generators):
            functions = self.elements(value, self.highest(value))
            forms = self.forms.get(value, [])
            if len(forms) == len(functions) - 1:
                proved = all(f.basis == IDENTITY for f in functions)
                yield from (replace(f, basis=IDENTITY if proved else MODULAR) for f in forms)
            else:
                yield from self._quotients_by_one(functions)
        for functions in self.spaces:
            yield from self._quotients_by_one(functions)

    def _quotients_by_one(self, functions: list[RationalFunction]) -> Iterator[RationalFunction]:
        """Yield f / g for other `functions` f; g is of least degree, with g(0) != 0 if possible."""
        lowest = [f for f in functions if f.degree == functions[0].degree]
        denominator = next(
            (f for f in lowest if has_constant_term(f.as_quotient()[0])), functions[0]
        )
        others = (f for f in functions if f is not denominator)
        yield from (_with_varying_limit(f / denominator) for f in others)

    @property
    def measures(self) -> tuple[RationalFunction, ...]:
        """Densities of invariant measures: 1 / P for the cofactor det DPhi, or other products.

        If there is none, a density up to sign: rho(Phi) det DPhi = -rho, with the `cofactor` -1.
        """
        densities = [*self.densities, *self.early_densities]
        det = self.map.jacobian_cofactor if self.has_factors else None
        if det is not None:
            densities += self._densities(det)
            densities = densities or self._density_from_relations(det) or self._up_to_sign(det)
        different = {str(f): f for f in densities}.values()
        return tuple(sorted(different, key=_order_of_densities))

    def _densities(self, cofactor: RationalFunction) -> list[RationalFunction]:
        """Return the densities 1 / P for products P of generators with this cofactor."""
        most = self.map.degree * self.degree
        return [f**-1 for f in self.elements(self.value(cofactor), most)]

    def _density_from_relations(self, det: RationalFunction) -> list[RationalFunction]:
        """Return [f], f a product of powers of generators with the cofactor 1 / det DPhi, or []."""
        rows = _multiplicative_relations([det, *(g.cofactor for g in self.generators)])
        single = [row for row in rows if abs(row[0]) == 1]
        return [self.power_product([sign * e for e in powers]) for sign, *powers in single[:1]]

    def _up_to_sign(self, det: RationalFunction) -> list[RationalFunction]:
        minus_one = RationalFunction((), Fraction(-1))
        return [replace(f, cofactor=minus_one) for f in self._densities(-det)[:1]]

    @property
    def polynomials(self) -> tuple[RationalFunction, ...]:
        """The Darboux polynomials, without products of others."""
        return tuple(sorted(self.generators, key=lambda g: sort_key(self.polynomial(g))))


def _sort_key(f: RationalFunction) -> tuple[Any, ...]:
    """Return the sort key of a function f: low degrees, then few terms."""
    keys = [(sort_key(P), e) for P, e in f.factors]
    return f.degree, sum(count for (_, count, *_), _ in keys), keys


def _order_of_densities(f: RationalFunction) -> tuple[Any, ...]:
    """Return the sort key of densities: the degree, then the order of the denominator at x = 0."""
    return f.degree, min(map(sum, exponents_in_x(f.as_quotient()[1]))), *_sort_key(f)


def _f_or_reciprocal(f: RationalFunction) -> RationalFunction:
    """Return f or 1 / f: the numerator has the higher degree; if equal, denominator(0) != 0."""

    def order(f: RationalFunction) -> tuple[int, bool]:
        P, Q = f.as_quotient()
        return degree_of(P), has_constant_term(Q)

    return max((f, f**-1), key=order)


def _with_varying_limit(f: RationalFunction) -> RationalFunction:
    """Return f, or a function of f, such that its limit for eps to 0 is not constant."""
    if not f.degree or not f.is_symbolic or f.degree > _HIGHEST:
        return without_constant(f)
    numerator, denominator = (without_content(P) for P in f.as_quotient())
    denominator, numerator = with_independent_limits([denominator, numerator])
    return without_constant(quotient_of(numerator, denominator, f.basis))


def _without_constant_term(f: RationalFunction) -> RationalFunction:
    """Return a polynomial f without its constant term; powers and quotients are unchanged."""
    if any(e != 1 for P, e in f.factors if degree_of(P)):
        return f
    P = f.as_quotient()[0]
    if (constant := coefficient_of(P, (0,) * variables_of(P))) == 0:
        return f
    return quotient_of(without_content(P - constant), P.context().constant(1), f.basis)


def _multiplicative_relations(cofactors: Sequence[Any]) -> list[list[int]]:
    """Return short basis vectors e of the lattice ``C_1**e_1 ... C_n**e_n = 1`` of `cofactors` C_i.

    The vector of a cofactor contains the exponents of its polynomials, of coprime factors of its
    constant, and of -1. For -1 only the parity of the exponent counts.
    """
    vectors = []
    constants = [cofactor.constant for cofactor in cofactors]
    parts = (part for c in constants for part in (abs(c.numerator), c.denominator))
    base = _coprime_factors(q for part in parts for q, _ in flint.fmpz(part).factor(_TRIAL))
    for cofactor, constant in zip(cofactors, constants, strict=True):
        vector = {str(f): e for f, e in cofactor.factors}
        vector["sign"] = int(constant < 0)
        for b in base:
            vector[str(b)] = _power_in(constant.numerator, b) - _power_in(constant.denominator, b)
        vectors.append(vector)
    vectors.append({"sign": 2})
    names, n = dict.fromkeys(name for vector in vectors for name in vector), len(cofactors)
    rows = [
        [int(i == j) for j in range(n)] + [_WEIGHT * vector.get(name, 0) for name in names]
        for i, vector in enumerate(vectors)
    ]
    reduced = arithmetic.integer_rows(flint.fmpz_mat(rows).lll())
    return [row[:n] for row in reduced if any(row[:n]) and not any(row[n:])]


def _coprime_factors(numbers: Iterable[Any]) -> list[int]:
    """Return coprime numbers above 1; each given number is a product of their powers."""
    base: list[int] = []
    left = [*map(int, numbers)]
    while left:
        n = left.pop()
        for b in base:
            if (common := math.gcd(n, b)) > 1:
                base.remove(b)
                left += [common, n // common, b // common]
                break
        else:
            base += [n] * (n > 1)
    return base


def _power_in(number: int, factor: int) -> int:
    """Return the highest power of a factor that divides a number."""
    power = 0
    while number % factor == 0:
        number, power = number // factor, power + 1
    return power


_SIGNS = 70  # random points at which a definite polynomial has one sign


class NormalForms:
    """Replaces the Darboux polynomials of a cofactor by `normal_basis`, for simple quotients."""

    def __init__(self, invariants: Invariants) -> None:
        self.invariants, self.map = invariants, invariants.map
        self._done: dict[int, str] = {}  # spaces in normal form, by the value of the cofactor

    def update(self, value: int) -> list[RationalFunction]:
        """Replace P of the cofactor that `value` identifies by a simpler basis; return new P."""
        known = self.invariants
        elements = known.elements(value, known.highest(value))
        space = [known.polynomial(f) for f in elements]
        if not space or self._done.get(value) == str(space):
            return []
        basis = normal_basis(space, _modified_energy(self.map))
        # Products of generators of other cofactors stay; the others are replaced.
        texts = known.texts(value)
        kept = [P for f, P in zip(elements, space, strict=True) if str(f) not in texts]
        proved = all(f.basis == IDENTITY for f in elements)
        new = known.replace(value, [*selected(basis, kept)], IDENTITY if proved else MODULAR)
        known.forms[value] = quotients(basis)
        elements = known.elements(value, known.highest(value))
        self._done[value] = str([*map(known.polynomial, elements)])
        return new


def _modified_energy(map: RationalMap) -> list[Any]:
    """Return [P], P the numerator of the modified energy; [] for a map without one."""
    modified = map.modified_energy
    return [modified.as_quotient(map.ring)[0]] if modified else []


def quotients(basis: Sequence[Any]) -> list[RationalFunction]:
    """Return the quotients P_i / Q of a basis [Q, P_1, P_2, ...], without constant factors."""
    denominator, *others = basis
    return [without_constant(factored(P) / factored(denominator)) for P in others]


def normal_basis(space: Sequence[Any], preferred: Sequence[Any] = ()) -> list[Any]:
    """Return a basis [Q, P_1, P_2, ...] of the span of `space`, for simple integrals P_i / Q.

    Polynomials in `space` share a cofactor. Q has the least degree in the limit for eps to 0. All
    limits are independent. The P_i come by degree, then `preferred` ones, then by many factors.
    """
    echelon = in_echelon_form(space)
    basis = with_independent_limits(echelon)
    candidates = {str(P): P for P in (*basis, *echelon)}
    if letters_in(basis[0]) <= (1 if preferred else _LETTERS):
        with contextlib.suppress(ArithmeticError):  # a number is special, or all are reducible
            candidates |= {str(P): P for P in reducible_members(echelon)}
    first = {str(P): P for P in map(without_content, preferred) if rank([*space, P]) == len(space)}
    candidates |= first
    highest = max(degree_of(P) for P in basis)

    def order(P: Any) -> tuple[Any, ...]:
        complex_factors = count_factors(P) + (degree_of(P) < highest)  # that at infinity
        factors = sum(e for _, e in factored(P).factors)
        simplest = len(P), has_constant_term(P), -factors, str(P)
        return degree_of(P), str(P) not in first, -complex_factors, *simplest

    ordered = sorted(candidates.values(), key=order)
    denominator = min(ordered, key=_order_of_denominator)
    return [denominator, *selected(ordered, [denominator], of=limit)]


def _order_of_denominator(P: Any) -> tuple[Any, ...]:
    """Return the sort key of denominators P: low degrees, then P(0) != 0, then P of one sign."""
    in_limit = limit(P)
    return degree_of(in_limit), degree_of(P), not has_constant_term(in_limit), not is_definite(P)


def is_definite(P: Any) -> bool:
    """Return True if a polynomial has one sign at random points, near 0 and far away."""
    rng, signs = random.Random(0), set()
    symbolic, n = letters_in(P), variables_of(P)
    for k in range(_SIGNS):
        size = 10 ** (k % 7)
        x = [rng.randrange(-size, size + 1) for _ in range(n)]
        value = P(*(rng.randrange(1, 9) for _ in range(symbolic)), *x)
        signs |= {value > 0} if value else set()
    return len(signs) == 1


def in_echelon_form(space: Sequence[Any]) -> list[Any]:
    """Return a basis of the span of `space`, with different leading monomials, highest first.

    The lowest monomial of each polynomial has the coefficient 0 in the polynomials before it.
    """
    monomials = {e for P in space for e in exponents_in_x(P)}
    descending = sorted(monomials, key=lambda e: (sum(e), e), reverse=True)
    rows, left = [], list(space)
    for monomial in descending:
        pivot = next((P for P in left if coefficient_of(P, monomial) != 0), None)
        if pivot is not None:
            left.remove(pivot)
            left = [_without(P, pivot, monomial) for P in left]
            rows.append(pivot)
    for k in reversed(range(len(rows))):
        last = next(e for e in reversed(descending) if coefficient_of(rows[k], e) != 0)
        rows[:k] = [_without(P, rows[k], last) for P in rows[:k]]
    return [*map(without_content, rows)]


def _without(P: Any, pivot: Any, monomial: tuple[int, ...]) -> Any:
    """Return the combination of polynomials P and `pivot` that does not contain `monomial`."""
    if (c := coefficient_of(P, monomial)) == 0:
        return P
    return without_content(coefficient_of(pivot, monomial) * P - c * pivot)
