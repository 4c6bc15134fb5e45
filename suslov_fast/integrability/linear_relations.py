"""Linear relations ``sum_i c_i m_i(x_k) = 0`` of monomials along orbits, and their integrals.

Relations are the null space of the monomials at the points x_k of an orbit, which has some more
points than there are monomials (Petrera, Pfadler and Suris, arXiv:1008.1040). The coefficients
depend on the orbit alone. If there is no relation between fewer of its monomials, a relation is
unique up to a factor, so each quotient c_i / c_j is a rational first integral. Its formula may have
thousands of terms; its value at a point follows from a few points of the orbit.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import accumulate, combinations, islice
from typing import Any, NamedTuple

import flint

from ..fields.exact_numbers import text_of
from ..keywords import public
from . import arithmetic
from .arithmetic import EPS, EXTRA, Residues, Values
from .birational_maps import RationalMap
from .interpolation import Line, over_rationals
from .polynomials import (
    Exponents,
    Polynomials,
    exponents_up_to,
    letters_of,
    monomial_values,
    polynomials_with,
    ring_modulo,
)
from .rational_functions import MODULAR, RationalFunction, quotient_of

_ORBITS = 3  # whose relations span those of all orbits


def monomials_along(map: RationalMap, exponents: Exponents, x: Sequence[Any], length: int) -> Any:
    """Return the matrix of monomials (columns) at `length` points (rows) of the orbit of x."""
    return arithmetic.matrix([monomial_values(exponents, y) for y in map.orbit(x, length)])


def relations_along(
    map: RationalMap, exponents: Exponents, eps: Values, x: Sequence[Any]
) -> Residues:
    """Return rows c: ``sum_i c_i m_i = 0`` for monomials m_i on the orbit of x modulo a prime."""
    length = len(exponents) + EXTRA
    return arithmetic.null_space(monomials_along(map.at_eps(eps), exponents, x, length))


def gradients_of_coefficients(
    map: RationalMap,
    exponents: Exponents,
    relations: Residues,
    x: Sequence[Any],
    length: int,
    first: int = 0,
) -> list[list[list[Any]]]:
    """Return grad c_i for the coefficients c_i of relations, by relation, then by coefficient.

    They solve ``sum_i m_i(x_k) dc_i = -sum_i c_i dm_i(x_k)``, the derivatives of the relations at
    `length` points x_k of the orbit of x, from x_k = x_first on. Relations must be a basis in
    echelon form. Coefficients that this form fixes at 0 or 1 are constant, and are left out.
    """
    p, n, count = int(x[0].modulus()), map.dimension, len(exponents)
    ring = ring_modulo(p, n)
    polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
    slopes = [[P.derivative(i) for i in range(n)] for P in polynomials]
    rows = []  # the equations at x_k: all m_i, and right sides for each relation
    for y, derivative in islice(map.variations(x, first + length), first, None):
        values = flint.nmod_mat([[dP(*y[:-1]) for dP in of_relation] for of_relation in slopes], p)
        rows.append([*monomial_values(exponents, y), *(values * derivative * -1).entries()])
    solved = flint.nmod_mat(rows, p).rref()[0].tolist()[: count - len(relations)]
    return [[row[k : k + n] for row in solved] for k in range(count, len(rows[0]), n)]


class Counted(NamedTuple):
    """The number of relations along an orbit, and of the independent integrals they show."""

    relations: int
    integrals: int


@lru_cache(maxsize=32)
def count_relations(map: RationalMap, exponents: Exponents) -> Counted:
    """Count relations of monomials along a random orbit, and integrals by them, by two primes.

    If det DPhi = 0, coefficients are the same along an orbit only from a general point of the
    images of all iterates on.
    """
    rng, first = map.generator(), 0 if map.is_invertible else map.dimension

    def count_modulo(p: int, eps: Values) -> Counted:
        x = arithmetic.random_point(map.dimension, p, rng)
        at_eps, length = map.at_eps(eps), len(exponents) + EXTRA
        *_, start = at_eps.orbit(x, first + 1)
        relations = relations_along(at_eps, exponents, eps, start)
        if not relations:
            return Counted(0, 0)
        gradients = gradients_of_coefficients(at_eps, exponents, relations, x, length, first)
        rows = [gradient for of_relation in gradients for gradient in of_relation]
        return Counted(len(relations), int(flint.nmod_mat(rows, p).rank()))

    return arithmetic.agreed_by_primes(rng, count_modulo)


def integrals_of_relations(map: RationalMap, exponents: Exponents) -> Polynomials:
    """Return polynomials that span the relations of all orbits, if quotients are integrals; or ().

    Quotients are integrals if relations of one orbit span d dimensions, and of all orbits d + 1.
    """
    rng, dimension = map.generator(), count_relations(map, exponents).relations
    if dimension == 0 or not map.is_invertible:
        return ()

    def span(p: int, eps: Values) -> Residues:
        points = [arithmetic.random_point(map.dimension, p, rng) for _ in range(_ORBITS)]
        rows = [row for x in points for row in relations_along(map, exponents, eps, x)]
        basis = arithmetic.row_space(rows, p)
        return basis if len(basis) == dimension + 1 else []

    rows = over_rationals(rng, span, len(map.letters))
    return polynomials_with(rows or [], exponents, letters_of(map.ring))


_ORDERS = 200  # random orders of the monomials, each of which gives circuits
_QUOTIENTS = 4_000  # of coefficients, whose degrees are compared
_DEGREES = 5, 11, 23  # quotients of a higher degree than the last are left out
_TERMS = 300  # of a formula that is written out, at most


@dataclass(frozen=True, repr=False)
class ImplicitIntegral:
    """A first integral of a map, given by a relation between monomials along orbits.

    Between the `monomials`, given by their exponents, there is one relation along the orbit of a
    generic point, up to a factor. The integral is the quotient of the coefficients of two of these
    monomials, `numerator` and `denominator`. It is a rational function of the point; `degree` is
    the larger of the degrees of its numerator and denominator on a generic line.

    Called with a point, D rational numbers or floats, it returns its exact value, a `Fraction`,
    computed from one point of the orbit fewer than there are monomials. If eps is symbolic, pass
    its value, as in ``integral(x, eps=Fraction(1, 3))``. A point at which the relation is not
    unique, or the denominator is 0, raises a `ZeroDivisionError`.

    Examples
    --------
    >>> from suslov_fast.integrability import kahan, report, zoo
    >>> field, eps = zoo()["Lagrange top"]
    >>> found = report(field, eps=eps, degree=2)
    >>> integral = found.implicit[0]
    >>> integral.degree, len(integral.monomials)
    (8, 5)
    >>> x = [1, 2, 3, 4, 5, 6]
    >>> integral(x) == integral(found.map(x))
    True
    """

    map: RationalMap
    monomials: Exponents
    numerator: tuple[int, ...]
    denominator: tuple[int, ...]
    degree: int
    basis: str = MODULAR

    @public
    def __call__(self, x: Sequence[Any], *unnamed: Any, **values: Any) -> Fraction:
        """Return the value at a point; if eps is symbolic, at a value of eps."""
        map = self.map.subs(*unnamed, **values) if self.map.is_symbolic else self.map
        point = (*arithmetic.rationals("x", x, map.dimension), Fraction(1))
        return arithmetic.fraction(self.value(map, [arithmetic.fmpq(a) for a in point]))

    def value(self, map: RationalMap, x: list[Any]) -> Any:
        """Return the value at a point (x1, ..., xD, 1) of exact numbers; `map` has no letters."""
        others = [e for e in self.monomials if e != self.denominator]
        orbit = _orbit_around(map, x, len(others))
        # With the coefficient 1 of the denominator, the others solve a linear system.
        rows = [monomial_values(others, y) for y in orbit]
        right = [[-monomial_values([self.denominator], y)[0]] for y in orbit]
        try:
            solution = arithmetic.matrix(rows).solve(arithmetic.matrix(right))
        except ZeroDivisionError:
            text = "there are more relations along its orbit, or the denominator is 0"
            raise ZeroDivisionError(f"the integral has no value at this point: {text}") from None
        return solution[others.index(self.numerator), 0]

    def gradient_of_logarithm(self, p: int) -> list[Any]:
        """Return the gradient of log(integral) at `arithmetic.random_point` modulo p."""
        gradients = _gradients_of_logarithms(self.map, self.monomials, p)
        pairs = zip(gradients[self.numerator], gradients[self.denominator], strict=True)
        return [a - b for a, b in pairs]

    def __str__(self) -> str:
        variables = self.map.names or [f"x{i + 1}" for i in range(self.map.dimension)]
        numerator, denominator = (_text(e, variables) for e in (self.numerator, self.denominator))
        relation = ", ".join(_text(e, variables) for e in self.monomials)
        return f"c({numerator})/c({denominator}) of the relation between {relation}"

    def __repr__(self) -> str:
        return f"ImplicitIntegral({self}; degree {self.degree})"


def _text(exponents: Sequence[int], names: Sequence[str]) -> str:
    """Return the text of a monomial."""
    indices = tuple(i for i, power in enumerate(exponents) for _ in range(power))
    return text_of({indices: 1}, names)


def _orbit_around(map: RationalMap, x: list[Any], length: int) -> list[Sequence[Any]]:
    """Return `length` points of an orbit; x is in the middle, or the first without an inverse."""
    before = (length - 1) // 2 if map.inverse else 0
    backward = [*map.inverse.orbit(x, before + 1)] if before else [x]
    return [*backward[:0:-1], *map.orbit(x, length - before)]


# A circuit is a set of monomials that has one relation along orbits, without a zero coefficient.


def circuits(map: RationalMap, monomials: Exponents, rng: random.Random) -> list[Exponents]:
    """Return circuits, minimal sets of `monomials` with a relation on orbits, small ones first.

    In any order of monomials, a row of the reduced echelon form of the relations gives a circuit.
    """
    p = map.prime
    relations = relations_along(map, monomials, EPS, arithmetic.random_point(map.dimension, p, rng))
    positions = range(len(monomials))
    supports = set()  # of rows: the positions of monomials with a coefficient
    for _ in range(_ORDERS if relations else 0):
        order = rng.sample(positions, len(positions))
        rows = [[relation[k] for k in order] for relation in relations]
        for row in flint.nmod_mat(rows, p).rref()[0].tolist():
            supports.add(tuple(sorted(k for k, c in zip(order, row, strict=True) if c != 0)))
    shortest = sorted(supports, key=lambda support: (len(support), support))
    quotients = accumulate(math.comb(len(support), 2) for support in shortest)
    return [
        tuple(monomials[k] for k in support)
        for support, count in zip(shortest, quotients, strict=True)
        if count <= _QUOTIENTS
    ]


class _RelationsOnLine:
    """Relations along orbits of points of a random line, to find the degrees of integrals."""

    def __init__(self, map: RationalMap, circuits: list[Exponents], rng: random.Random) -> None:
        self.map, self.circuits, self.rng = map.at_eps(EPS), circuits, rng
        self.p = map.prime
        self.monomials = tuple({e: None for circuit in circuits for e in circuit})
        self.columns = [[self.monomials.index(e) for e in circuit] for circuit in circuits]
        a, b = (arithmetic.random_point(map.dimension, self.p, rng)[:-1] for _ in range(2))
        self.line = list(zip(a, b, strict=True))  # a + b t
        self.parameters: list[int] = []
        self.coefficients: list[list[list[int]]] = []  # by point, circuit and monomial

    def extend(self, count: int) -> None:
        """Compute relations at further points, until there are `count` points."""
        p, length = self.p, max(map(len, self.circuits))
        while len(self.parameters) < count:
            t = flint.nmod(self.rng.randrange(p), p)
            x = [*(a + b * t for a, b in self.line), t**0]
            values = monomials_along(self.map, self.monomials, x, length).tolist()
            matrices = ([[row[k] for k in columns] for row in values] for columns in self.columns)
            spaces = [arithmetic.null_space(flint.nmod_mat(rows, p)) for rows in matrices]
            self.parameters.append(int(t))
            self.coefficients.append([space[0] for space in spaces])
        self._quotients = Line(self.parameters, p)

    def degree(self, circuit: int, numerator: int, denominator: int) -> int | None:
        """Return the degree of c[numerator] / c[denominator]; None if points are too few.

        The list c has the coefficients of relation number `circuit` between few monomials.
        """
        coefficients = [of_point[circuit] for of_point in self.coefficients]
        values = [c[numerator] * pow(c[denominator], -1, self.p) for c in coefficients]
        pair = self._quotients.quotient(values, lowest=(len(values) - 1) // 2)
        return pair and max(0, *(int(P.degree()) for P in pair))


@lru_cache(maxsize=1024)
def _gradients_of_logarithms(
    map: RationalMap, circuit: Exponents, p: int
) -> dict[tuple[int, ...], Any]:
    """Return {m: grad log c} for monomials m in `circuit`, at a random point x, modulo p.

    c(x) are the coefficients of the relation sum c m = 0, which holds along the orbit of x.
    """
    map, x, length = map.at_eps(EPS), arithmetic.random_point(map.dimension, p), len(circuit) - 1
    (relation,) = arithmetic.null_space(monomials_along(map, circuit, x, length))
    (gradients,) = gradients_of_coefficients(map, circuit, [relation], x, length)
    logarithms = [[a / c for a in row] for row, c in zip(gradients, relation, strict=False)]
    return dict(zip(circuit, [*logarithms, [0 * x[0]] * map.dimension], strict=True))


def implicit_integrals(map: RationalMap, monomials: Exponents) -> Iterator[ImplicitIntegral]:
    """Yield (mostly dependent) integrals by relations of few of the `monomials`, by degree."""
    rng = random.Random(0)
    with_relation = circuits(map, monomials, rng)
    if not with_relation:
        return
    on_line = _RelationsOnLine(map, with_relation, rng)
    # Quotients of coefficients: the number of a circuit, and the positions of two monomials.
    unknown = [
        (k, *pair)
        for k, circuit in enumerate(with_relation)
        for pair in combinations(range(len(circuit)), 2)
    ]
    for most in _DEGREES:
        on_line.extend(2 * most + 3)
        degrees = {quotient: on_line.degree(*quotient) for quotient in unknown}
        unknown = [quotient for quotient in unknown if degrees[quotient] is None]
        known = [(degree, *quotient) for quotient, degree in degrees.items() if degree]
        for degree, k, numerator, denominator in sorted(known):
            circuit = with_relation[k]
            yield ImplicitIntegral(map, circuit, circuit[numerator], circuit[denominator], degree)


def is_short(integral: ImplicitIntegral) -> bool:
    """Return True if a formula of the integral's degree has few enough terms to be written out."""
    D = integral.map.dimension
    return math.comb(D + integral.degree, D) <= _TERMS


def written_out(integral: ImplicitIntegral) -> RationalFunction | None:
    """Return the formula of an integral that is short enough; None if it has too many terms."""
    map, D = integral.map, integral.map.dimension
    # One polynomial for both: an additional variable y distinguishes the denominator.
    exponents = tuple((*e, y) for y in (0, 1) for e in exponents_up_to(integral.degree, D))

    def search(p: int, eps: Values) -> arithmetic.Residues:
        rng, at_number = random.Random(p), map.at_eps(eps)
        rows = []
        for _ in range(len(exponents) + EXTRA):
            x = arithmetic.random_point(D, p, rng)
            quotient = integral.value(at_number, x)
            # numerator - quotient denominator = 0
            rows.append(monomial_values(exponents, [*x[:-1], -quotient]))
        space = arithmetic.null_space(flint.nmod_mat(rows, p))
        return space if len(space) == 1 else []

    # Most monomials are in neither: those of one solution are enough for the others.
    (first,) = search(map.prime, EPS) or [[]]
    exponents = tuple(e for e, c in zip(exponents, first, strict=False) if c)
    rows = over_rationals(map.generator(integral.degree), search, len(map.letters))
    if not rows:
        return None
    (both,) = polynomials_with(rows, exponents, letters_of(map.ring))
    if len(both) > _TERMS:
        return None
    numerator, denominator = (
        map.ring.from_dict({(*e,): c for (*e, y), c in both.to_dict().items() if y == part})
        for part in (0, 1)
    )
    return quotient_of(numerator, denominator, MODULAR)
