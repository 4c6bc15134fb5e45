"""First integrals and invariant measures that follow from known Darboux polynomials.

If P and Q have the same cofactor, P / Q is a first integral. If P has the cofactor det DPhi, 1 / P
is the density of an invariant measure. A product of powers of Darboux polynomials has the product
of powers of their cofactors: it is a first integral if ``C_1**e_1 ... C_n**e_n = 1``, and these
exponents form a lattice.

The polynomials of one cofactor span a space. Its basis in normal form has reducible polynomials
before others, and stays independent in the limit for eps to 0.
"""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from operator import itemgetter
from typing import Any, NamedTuple

import flint

from . import arithmetic, polynomials, rational_functions
from .arithmetic import EPS, divided_out
from .birational_maps import RationalMap
from .pencils import count_factors, reducible_members
from .polynomials import coefficient_of, degree_of, has_constant_term, sort_key, without_content
from .rational_functions import IDENTITY, MODULAR, RationalFunction, factored, quotient_of
from .tolerances import (
    HIGHEST_DEGREE_OF_LIMITS,
    LARGEST_PRIME_FACTOR,
    MOST_LETTERS_OF_PENCIL,
    MOST_PRODUCTS,
    POINTS_OF_SIGNS,
    WEIGHT_OF_EQUATIONS,
)


class Product(NamedTuple):
    """A product g_1**e_1 g_2**e_2 ... of generators: its degree, and the first `powers` e."""

    degree: int
    powers: tuple[int, ...]  # powers after the last one are 0


_ONE = Product(0, ())


class DarbouxInvariants:
    """The known Darboux polynomials of a map, and the integrals and measures that they imply.

    None of the `generators` is a linear combination of products of others. Methods identify a
    cofactor by its `value` at a random point modulo a prime.
    """

    def __init__(self, map: RationalMap, degree: int) -> None:
        self.map, self.degree, self.p = map, degree, map.prime
        self.generators: list[RationalFunction] = []
        # Products of generators up to a degree, by the values of their cofactors.
        self.products: dict[int, list[Product]] = {1: [_ONE]}
        self._degree_of_products = degree
        self.cofactors: dict[int, RationalFunction] = {1: RationalFunction(())}
        # Integrals in normal form, by the value of the cofactor of numerator and denominator.
        self.forms: dict[int, list[RationalFunction]] = {}
        self._normal: dict[int, str] = {}  # by cofactor value: the space in normal form, as text
        # Lists of polynomials with the same unknown cofactor.
        self.spaces: list[list[RationalFunction]] = []
        self.densities: list[RationalFunction] = []  # 1 / det A of Kahan's map, for a Hamiltonian
        self.early_densities: list[RationalFunction] = []  # found before det DPhi is factored
        # Pencils in echelon form whose reducible members, the second list, are known.
        self.reducible: list[tuple[list[Any], list[Any]]] = []
        self.has_factors = False  # True when the factors of det DPhi are known
        self._point = arithmetic.random_point(map.dimension, self.p)

    def value(self, cofactor: Any) -> int:
        """Return the value of a cofactor at a random point modulo a prime."""
        return int(cofactor.values_modulo(self.p, EPS, [self._point])[0])

    # Generators and their products.

    def multiply_up_to(self, degree: int) -> None:
        """Compute products of Darboux polynomials up to a degree, unless they are known."""
        if degree > self._degree_of_products:
            self._degree_of_products = degree
            self._start_with(self.generators)

    def add(self, generator: RationalFunction) -> list[tuple[int, int]]:
        """Add a Darboux polynomial; return (value of the cofactor, degree) of each new product."""
        self.multiply_up_to(generator.degree)
        added = self._multiply_by(generator)
        kept = [g for g in self.generators if not self._is_combination(g)]
        if len(kept) < len(self.generators):
            self._start_with(kept)
        return added

    def is_known(self, P: Any, cofactor: Any) -> bool:
        """Return True if P is constant, or a linear combination of products with this cofactor."""
        degree = degree_of(P)
        self.multiply_up_to(degree)
        space = [*map(self.polynomial, self.elements(self.value(cofactor), degree))]
        return degree == 0 or polynomials.rank([*space, P]) == len(space)

    def _start_with(self, generators: list[RationalFunction]) -> None:
        self.generators, self.products = [], {1: [_ONE]}
        for g in generators:
            self._multiply_by(g)

    def _is_combination(self, generator: RationalFunction) -> bool:
        """Return True if a generator is a linear combination of products of generators."""
        products = self.products[self.value(generator.cofactor)]
        of_several = (product.powers for product in products if sum(product.powers) > 1)
        lower = [self.polynomial(self.power_product(powers)) for powers in of_several]
        return polynomials.rank([*lower, self.polynomial(generator)]) == polynomials.rank(lower)

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
            while degree + generator.degree <= self._degree_of_products and count < MOST_PRODUCTS:
                degree, power = degree + generator.degree, power + 1
                value = value * factor % self.p
                self.products.setdefault(value, []).append(Product(degree, (*powers, power)))
                if value not in self.cofactors:
                    self.cofactors[value] = self.cofactors[old_value] * cofactor**power
                new.append((value, degree))
                count += 1
        return new

    def normalize(self, value: int) -> list[RationalFunction]:
        """Replace generators of a cofactor by `normal_basis`; return those that are new."""
        elements = self.elements(value)
        space = [self.polynomial(f) for f in elements]
        if not space or self._normal.get(value) == str(space):
            return []
        modified = self.map.modified_energy
        preferred = [modified.as_quotient(self.map.ring)[0]] if modified else []
        basis = normal_basis(space, preferred, self.reducible)
        denominator, *others = map(factored, basis)
        self.forms[value] = [rational_functions.without_constant(P / denominator) for P in others]
        # The generators of this cofactor are replaced. Products of several generators stay.
        texts = {str(self.generators[k]) for k in self._numbers(value)}
        kept = [P for f, P in zip(elements, space, strict=True) if str(f) not in texts]
        simple = sorted(polynomials.selected(basis, kept), key=degree_of)
        numbers = sorted(self._numbers(value), key=lambda k: self.generators[k].degree)
        new = []
        if [self.generators[k].degree for k in numbers] == [degree_of(P) for P in simple]:
            proof = IDENTITY if all(f.basis == IDENTITY for f in elements) else MODULAR
            for k, P in zip(numbers, simple, strict=True):
                old = self.generators[k]
                g = replace(factored(P), constant=Fraction(1), basis=proof, cofactor=old.cofactor)
                if str(g) != str(old):
                    self.generators[k] = g
                    new.append(g)
        self._normal[value] = str([*map(self.polynomial, self.elements(value))])
        return new

    def _numbers(self, value: int) -> list[int]:
        """Return the numbers of the generators with this cofactor value."""
        return [k for k, g in enumerate(self.generators) if self.value(g.cofactor) == value]

    def elements(self, value: int, degree: int | None = None) -> list[RationalFunction]:
        """Return linearly independent products with this cofactor value, short ones first.

        Their degrees are at most `degree`, by default the highest of a generator of the cofactor.
        """
        if degree is None:
            degree = max((self.generators[k].degree for k in self._numbers(value)), default=0)
        products = [product for product in self.products.get(value, ()) if product.degree <= degree]
        functions = [self.power_product(product.powers) for product in products]
        pairs = [(f, self.polynomial(f)) for f in functions]
        pairs.sort(key=lambda pair: sort_key(pair[1]))
        return [f for f, _ in polynomials.selected(pairs, of=itemgetter(1))]

    def polynomial(self, f: RationalFunction) -> Any:
        """Return f, a product of polynomials, as one polynomial, without constant denominator."""
        return f.as_quotient(self.map.ring)[0]

    def power_product(self, powers: Sequence[int]) -> RationalFunction:
        factors = (g**e for g, e in zip(self.generators, powers, strict=False) if e)
        return math.prod(factors, start=RationalFunction((), basis=IDENTITY))

    # Integrals and measures.

    @property
    def integrals(self) -> tuple[RationalFunction, ...]:
        """Independent integrals of least degree: P / Q of one cofactor, products of cofactor 1."""
        relations = _multiplicative_relations([g.cofactor for g in self.generators])
        products = (_f_or_reciprocal(self.power_product(powers)) for powers in relations)
        candidates = sorted(self._quotients(), key=_sort_key)
        candidates += sorted(map(_with_varying_limit, products), key=_sort_key)
        functions = rational_functions.independent(candidates, self.p)
        return tuple(map(_without_constant_term, functions))

    def _quotients(self) -> Iterator[RationalFunction]:
        """Yield quotients of polynomials with the same cofactor, in normal form if it is known."""
        for value in dict.fromkeys(self.value(g.cofactor) for g in self.generators):
            functions = self.elements(value)
            forms = self.forms.get(value, [])
            if len(forms) == len(functions) - 1:
                proof = IDENTITY if all(f.basis == IDENTITY for f in functions) else MODULAR
                yield from (replace(f, basis=proof) for f in forms)
            else:
                yield from self._quotients_by_one(functions)
        for functions in self.spaces:
            yield from self._quotients_by_one(functions)

    def _quotients_by_one(self, functions: list[RationalFunction]) -> Iterator[RationalFunction]:
        """Yield f / g for `functions` f and one g of least degree, with g(0) != 0 if possible."""
        lowest = [f for f in functions if f.degree == functions[0].degree]
        denominator = max(lowest, key=lambda f: has_constant_term(f.as_quotient()[0]))
        others = (f for f in functions if f is not denominator)
        yield from (_with_varying_limit(f / denominator) for f in others)

    @property
    def measures(self) -> tuple[RationalFunction, ...]:
        """Densities rho of invariant measures: rho(Phi) det DPhi = rho.

        Densities are products of powers of Darboux polynomials, mostly 1 / P. If no density is
        found, the result may contain a rho with rho(Phi) det DPhi = -rho and the `cofactor` -1.
        """
        densities = [*self.densities, *self.early_densities]
        det = self.map.jacobian_cofactor if self.has_factors else None
        if det is not None:
            densities += self._densities(det)
            densities = densities or self._density_from_relations(det)
            up_to_sign = [] if densities else self._densities(-det)[:1]
            densities += [replace(f, cofactor=-RationalFunction(())) for f in up_to_sign]
        different = {str(f): f for f in densities}.values()

        def order(f: RationalFunction) -> tuple[Any, ...]:
            P = f.as_quotient()[1]
            return f.degree, min(map(sum, polynomials.exponents_in_x(P))), *_sort_key(f)

        return tuple(sorted(different, key=order))

    def _densities(self, cofactor: RationalFunction) -> list[RationalFunction]:
        """Return the densities 1 / P for products P of generators with this cofactor."""
        most = self.map.degree * self.degree
        return [f**-1 for f in self.elements(self.value(cofactor), most)]

    def _density_from_relations(self, det: RationalFunction) -> list[RationalFunction]:
        """Return [f], f a product of powers of generators with the cofactor 1 / det DPhi, or []."""
        rows = _multiplicative_relations([det, *(g.cofactor for g in self.generators)])
        single = [row for row in rows if abs(row[0]) == 1]
        return [self.power_product([sign * e for e in powers]) for sign, *powers in single[:1]]

    @property
    def polynomials(self) -> tuple[RationalFunction, ...]:
        """The Darboux polynomials, without products of others."""
        return tuple(sorted(self.generators, key=lambda g: sort_key(self.polynomial(g))))

    def parts_of(self, functions: Iterable[RationalFunction]) -> Iterator[RationalFunction]:
        """Yield numerators and denominators, without a common factor, that are no generators.

        Of an integral N / D both are Darboux polynomials: N(F) D = D(F) N, so that N divides N(F).
        Of a density 1 / P, P is one.
        """
        parts = ((P, f.basis) for f in functions for P in f.as_quotient(self.map.ring))
        for P, basis in {str(P): (P, basis) for P, basis in parts if degree_of(P)}.values():
            cofactor = self.map.cofactor(P)
            if cofactor is None or not self.has_factors:
                f = replace(factored(P), constant=Fraction(1), basis=basis)
                yield replace(f, cofactor=cofactor or Cofactor(self.map, f))  # type: ignore[arg-type]


def _sort_key(f: RationalFunction) -> tuple[Any, ...]:
    """Return the sort key of a function f: by degree, then by number of terms."""
    keys = [(sort_key(P), e) for P, e in f.factors]
    return f.degree, sum(count for (_, count, *_), _ in keys), keys


def _f_or_reciprocal(f: RationalFunction) -> RationalFunction:
    """Return f or 1 / f: that with a numerator of higher degree, or with denominator(0) != 0."""
    P, Q = f.as_quotient()
    is_kept = (degree_of(P), has_constant_term(Q)) >= (degree_of(Q), has_constant_term(P))
    return f if is_kept else f**-1


def _with_varying_limit(f: RationalFunction) -> RationalFunction:
    """Return f, or a fractional linear function of f, with a limit for eps to 0 that varies."""
    if not f.degree or not f.is_symbolic or f.degree > HIGHEST_DEGREE_OF_LIMITS:
        return rational_functions.without_constant(f)
    numerator, denominator = (without_content(P) for P in f.as_quotient())
    denominator, numerator = polynomials.with_independent_limits([denominator, numerator])
    return rational_functions.without_constant(quotient_of(numerator, denominator, f.basis))


def _without_constant_term(f: RationalFunction) -> RationalFunction:
    """Return a polynomial f without its constant term; return powers and quotients unchanged."""
    if any(e != 1 for P, e in f.factors if degree_of(P)):
        return f
    P = f.as_quotient()[0]
    if (constant := coefficient_of(P, (0,) * polynomials.variables_of(P))) == 0:
        return f
    return quotient_of(without_content(P - constant), P.context().constant(1), f.basis)


def _multiplicative_relations(cofactors: Sequence[Any]) -> list[list[int]]:
    """Return short integer vectors e that span the solutions of ``C_1**e_1 ... C_n**e_n = 1``."""
    # Exponents of a C_i: of its polynomials, of coprime factors of its constant, and of its sign.
    vectors = []
    constants = [cofactor.constant for cofactor in cofactors]
    parts = (part for c in constants for part in (abs(c.numerator), c.denominator))
    base = _coprime_factors(
        q for part in parts for q, _ in flint.fmpz(part).factor(LARGEST_PRIME_FACTOR)
    )
    for cofactor, constant in zip(cofactors, constants, strict=True):
        vector = {str(f): e for f, e in cofactor.factors}
        vector["sign"] = int(constant < 0)
        for b in base:
            above, below = (divided_out(c, b)[1] for c in constant.as_integer_ratio())
            vector[str(b)] = above - below
        vectors.append(vector)
    vectors.append({"sign": 2})  # signs count modulo 2
    names, n = dict.fromkeys(name for vector in vectors for name in vector), len(cofactors)
    rows = [
        [int(i == j) for j in range(n)]
        + [WEIGHT_OF_EQUATIONS * vector.get(name, 0) for name in names]
        for i, vector in enumerate(vectors)
    ]
    reduced = arithmetic.integer_rows(flint.fmpz_mat(rows).lll())
    return [row[:n] for row in reduced if any(row[:n]) and not any(row[n:])]


def _coprime_factors(numbers: Iterable[Any]) -> list[int]:
    """Return coprime numbers above 1; each given number is a product of their powers."""
    base: list[int] = []
    remaining = [*map(int, numbers)]
    while remaining:
        n = remaining.pop()
        for b in base:
            if (common := math.gcd(n, b)) > 1:
                base.remove(b)
                remaining += [common, n // common, b // common]
                break
        else:
            base += [n] * (n > 1)
    return base


@dataclass(frozen=True)
class Cofactor:
    """The cofactor P(Phi) / P of a Darboux polynomial P, where its formula is too long."""

    map: RationalMap
    P: RationalFunction
    given: Any = field(default_factory=dict)  # numbers for some letters

    def __call__(self, x: Sequence[Any], **values: Any) -> Fraction:
        """Return the value at a point, and at a number for each letter that the map has."""
        values = {**self.given, **values}
        map = self.map.subs(**values) if self.map.is_symbolic else self.map
        return self.P(map(x), **values) / self.P(x, **values)

    def renamed(self, *_: Any) -> Any:
        return self

    def _with(self, numbers: Mapping[str, Fraction]) -> Any:
        return replace(self, given={**self.given, **numbers})


def normal_basis(
    space: Sequence[Any], preferred: Sequence[Any], reducible: list[tuple[list[Any], list[Any]]]
) -> list[Any]:
    """Return a basis [Q, P_1, P_2, ...] of the span of `space`, for simple integrals P_i / Q.

    Limits for eps to 0 are independent, and Q is the polynomial with the limit of least degree. The
    P_i are sorted by degree, then members of `preferred` come first, then those with many factors.
    The reducible members of a pencil are added to `reducible`.
    """
    echelon = in_echelon_form(space)
    basis = polynomials.with_independent_limits(echelon)
    candidates = {str(P): P for P in (*basis, *echelon)}
    if polynomials.letters_in(basis[0]) <= (1 if preferred else MOST_LETTERS_OF_PENCIL):
        with contextlib.suppress(ArithmeticError):  # an unlucky random number, or all are reducible
            members = [*reducible_members(echelon)]
            candidates |= {str(P): P for P in members}
            if len(echelon) == 2:
                reducible.append((echelon, members))
    wanted = map(without_content, preferred)
    first = {str(P): P for P in wanted if polynomials.rank([*space, P]) == len(space)}
    candidates |= first
    highest = max(degree_of(P) for P in basis)

    def order(P: Any) -> tuple[Any, ...]:
        # In homogeneous coordinates, a P of lower degree also has a factor at infinity.
        complex_factors = count_factors(P) + (degree_of(P) < highest)
        factors = sum(e for _, e in factored(P).factors)
        simplest = len(P), has_constant_term(P), -factors, str(P)
        return degree_of(P), str(P) not in first, -complex_factors, *simplest

    def as_denominator(P: Any) -> tuple[Any, ...]:
        in_limit = polynomials.limit(P)
        is_zero_at_0 = not has_constant_term(in_limit)
        return degree_of(in_limit), degree_of(P), is_zero_at_0, not is_definite(P)

    ordered = sorted(candidates.values(), key=order)
    denominator = min(ordered, key=as_denominator)
    return [denominator, *polynomials.selected(ordered, [denominator], of=polynomials.limit)]


def is_definite(P: Any) -> bool:
    """Return True if a polynomial has the same sign at all random points, near 0 and far away."""
    rng, signs = random.Random(0), set()
    symbolic, n = polynomials.letters_in(P), polynomials.variables_of(P)
    for k in range(POINTS_OF_SIGNS):
        size = 10 ** (k % 7)
        x = [rng.randrange(-size, size + 1) for _ in range(n)]
        value = P(*(rng.randrange(1, 9) for _ in range(symbolic)), *x)
        signs |= {value > 0} if value else set()
    return len(signs) == 1


def in_echelon_form(space: Sequence[Any]) -> list[Any]:
    """Return a basis of the span of `space` with different leading monomials, highest first.

    Then the lowest monomial of each polynomial is eliminated from all polynomials before it.
    """
    monomials = {e for P in space for e in polynomials.exponents_in_x(P)}
    descending = sorted(monomials, key=lambda e: (sum(e), e), reverse=True)
    rows, remaining = [], list(space)
    for monomial in descending:
        pivot = next((P for P in remaining if coefficient_of(P, monomial) != 0), None)
        if pivot is not None:
            remaining.remove(pivot)
            remaining = [_without(P, pivot, monomial) for P in remaining]
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
