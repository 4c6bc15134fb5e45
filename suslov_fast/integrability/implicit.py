"""First integrals that are too long to write out, from relations between few monomials.

The coefficients of a relation ``sum_i c_i m_i = 0`` between monomials along an orbit depend on the
orbit alone. If there is no relation between fewer of these monomials, it is unique up to a factor,
so each quotient c_i / c_j is a rational first integral. Its formula may have thousands of terms;
its value at a point follows from a few points of the orbit.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import accumulate, combinations
from typing import Any

import flint

from ..bodies.polynomials import Polynomial
from . import arithmetic
from .arithmetic import EPS, MORE, PRIME, Exponents, monomial_values
from .functions import MODULAR, RationalFunction, gradient_of_logarithm, quotient_of
from .kahan import KahanMap
from .maps import RationalMap
from .reconstruction import over_rationals, polynomials_with

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
    >>> field, eps = zoo()["Clebsch"]
    >>> found = report(field, eps, degree=2)
    >>> integral = found.implicit[0]
    >>> integral.degree, len(integral.monomials)
    (6, 6)
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

    def __call__(self, x: Sequence[Any], eps: Any = None) -> Fraction:
        """Return the value at a point; if eps is symbolic, at a value of eps."""
        map = self.map
        if map.has_letter:
            if eps is None:
                raise TypeError("eps is symbolic here: pass a number, as f(x, eps=Fraction(1, 3))")
            assert isinstance(map, KahanMap)
            map = map.subs(eps)
        point = (*arithmetic.rationals("x", x, map.dimension), Fraction(1))
        return arithmetic.fraction(self.value(map, [arithmetic.fmpq(a) for a in point]))

    def value(self, map: RationalMap, x: list[Any]) -> Any:
        """Return the value at a point (x1, ..., xD, 1) of exact numbers of any type."""
        others = [e for e in self.monomials if e != self.denominator]
        orbit = _orbit_around(map, x, len(others))
        # With the coefficient 1 of the denominator, the others solve a linear system.
        rows = [[*monomial_values(others, y)] for y in orbit]
        right = [[-monomial_values([self.denominator], y)[0]] for y in orbit]
        try:
            solution = arithmetic.matrix(rows).solve(arithmetic.matrix(right))
        except ZeroDivisionError:
            text = "there are more relations along its orbit, or the denominator is 0"
            raise ZeroDivisionError(f"the integral has no value at this point: {text}") from None
        return solution[others.index(self.numerator), 0]

    def gradient_of_logarithm(self) -> list[Any]:
        """Return the gradient of its logarithm at the random point of `arithmetic`."""
        gradients = _gradients(self.map, self.monomials)
        above, below = gradients[self.numerator], gradients[self.denominator]
        return [a - b for a, b in zip(above, below, strict=True)]

    def __str__(self) -> str:
        variables = self.map.names or [f"x{i + 1}" for i in range(self.map.dimension)]
        names = [_text(e, variables) for e in (self.numerator, self.denominator)]
        relation = ", ".join(_text(e, variables) for e in self.monomials)
        return f"c({names[0]})/c({names[1]}) of the relation between {relation}"

    def __repr__(self) -> str:
        return f"ImplicitIntegral({self}; degree {self.degree})"


def _text(exponents: Sequence[int], names: Sequence[str]) -> str:
    """Return the text of a monomial."""
    indices = [i for i, power in enumerate(exponents) for _ in range(power)]
    return Polynomial([(indices, Fraction(1))]).text(names)


def _orbit_around(map: RationalMap, x: list[Any], length: int) -> list[Sequence[Any]]:
    """Return points of an orbit around x, as numbers are shorter there; after x without inverse."""
    before = 0 if map.inverse is None else (length - 1) // 2
    backward = [*map.inverse.orbit(x, before + 1)] if before else [x]
    return [*backward[:0:-1], *map.orbit(x, length - before)]


# A circuit is a set of monomials that has one relation along orbits, without a zero coefficient.


def _values(map: RationalMap, monomials: Exponents, x: Sequence[Any], length: int) -> Any:
    """Return the values of monomials at the points of an orbit modulo a prime, in rows."""
    return flint.nmod_mat([[*monomial_values(monomials, y)] for y in map.orbit(x, length)], PRIME)


def circuits(map: RationalMap, monomials: Exponents, rng: random.Random) -> list[Exponents]:
    """Return circuits among monomials, those of few monomials first.

    Whatever the order of the monomials, each row of the reduced row echelon form of the relations
    belongs to a circuit.
    """
    x = arithmetic.random_point(map.dimension, PRIME, rng)
    relations = arithmetic.null_space(_values(map.at(EPS), monomials, x, len(monomials) + MORE))
    positions = range(len(monomials))
    found = set()
    for _ in range(_ORDERS if relations else 0):
        order = rng.sample(positions, len(positions))
        rows = [[row[k] for k in order] for row in relations]
        reduced = flint.nmod_mat(rows, PRIME).rref()[0].tolist()
        for row in reduced:
            found.add(tuple(sorted(k for k, c in zip(order, row, strict=True) if c != 0)))
    shortest = sorted(found, key=lambda circuit: (len(circuit), circuit))
    counts = accumulate(math.comb(len(circuit), 2) for circuit in shortest)
    chosen = [each for each, count in zip(shortest, counts, strict=True) if count <= _QUOTIENTS]
    return [tuple(monomials[k] for k in circuit) for circuit in chosen]


class _Line:
    """The relations of circuits at points of a random line, of which `extend` adds more."""

    def __init__(self, map: RationalMap, circuits: list[Exponents], rng: random.Random) -> None:
        self.map, self.circuits, self.rng = map.at(EPS), circuits, rng
        self.monomials = tuple({e: None for circuit in circuits for e in circuit})
        self.columns = [[self.monomials.index(e) for e in circuit] for circuit in circuits]
        draw = (arithmetic.random_point(map.dimension, PRIME, rng)[:-1] for _ in range(2))
        self.ends = list(zip(*draw, strict=True))
        self.parameters: list[Any] = []
        self.coefficients: list[list[list[int]]] = []  # by point, circuit and monomial

    def extend(self, count: int) -> None:
        """Compute relations at further points, until there are `count` points."""
        length = max(map(len, self.circuits))
        while len(self.parameters) < count:
            t = flint.nmod(self.rng.randrange(PRIME), PRIME)
            x = [*(a + b * t for a, b in self.ends), t**0]
            values = _values(self.map, self.monomials, x, length).tolist()
            columns = ([[row[k] for k in each] for row in values] for each in self.columns)
            spaces = [arithmetic.null_space(flint.nmod_mat(rows, PRIME)) for rows in columns]
            self.parameters.append(t)
            self.coefficients.append([space[0] for space in spaces])
        powers = [[t**k for k in range(count)] for t in self.parameters]
        self._inverse = flint.nmod_mat(powers, PRIME).inv()
        self._product = flint.nmod_poly([1], PRIME)
        for t in self.parameters:
            self._product *= flint.nmod_poly([-t, 1], PRIME)

    def degree(self, circuit: int, above: int, below: int) -> int | None:
        """Return the degree of the quotient of two coefficients; None if more points are needed.

        A quotient N / D of polynomials in the parameter is determined by deg N + deg D + 1 points;
        two more must agree with it.
        """
        coefficients = [each[circuit] for each in self.coefficients]
        quotients = [[flint.nmod(c[above], PRIME) / c[below]] for c in coefficients]
        through = (self._inverse * flint.nmod_mat(quotients, PRIME)).entries()
        count = len(quotients)
        # Euclid's algorithm keeps N = D through modulo the product of all t - t_k.
        N, last_N = flint.nmod_poly(through, PRIME), self._product
        D, last_D = flint.nmod_poly([1], PRIME), flint.nmod_poly([0], PRIME)
        while N.degree() > (count - 1) // 2:
            factor = last_N // N
            N, last_N = last_N - factor * N, N
            D, last_D = last_D - factor * D, D
        degrees = max(0, N.degree()), D.degree()
        return max(degrees) if sum(degrees) <= count - 3 else None


@lru_cache(maxsize=1024)
def _gradients(map: RationalMap, circuit: Exponents) -> dict[tuple[int, ...], Any]:
    """Return the gradients of the logarithms of the coefficients of a relation, by monomial.

    They are evaluated at the random point x_0 of `arithmetic`, and follow from the derivatives of
    ``sum_i c_i m_i(x_k) = 0`` with respect to x_0, for each k. The first coefficient is 1.
    """
    n, now, x = map.dimension, map.at(EPS), arithmetic.random_point(map.dimension)
    others = circuit[1:]
    values = _values(now, circuit, x, len(others)).tolist()
    rows = flint.nmod_mat([row[1:] for row in values], PRIME)
    coefficients = rows.solve(flint.nmod_mat([[-row[0]] for row in values], PRIME)).entries()
    ring = arithmetic.ring(n, False, flint.nmod_mpoly_ctx, PRIME)
    relation = ring.from_dict(dict(zip(circuit, [1, *(int(c) for c in coefficients)], strict=True)))
    slopes = [relation.derivative(i) for i in range(n)]
    changes = []
    for y, derivative in now.variations(x, len(others)):
        slope = flint.nmod_mat([[each(*y[:-1]) for each in slopes]], PRIME)
        changes.append((slope * derivative * -1).entries())
    changed = rows.solve(flint.nmod_mat(changes, PRIME)).tolist()
    logarithms = [[a / c for a in row] for row, c in zip(changed, coefficients, strict=True)]
    return dict(zip(circuit, [[0 * x[0]] * n, *logarithms], strict=True))


def independent_of(
    known: Sequence[RationalFunction], candidates: Iterable[ImplicitIntegral]
) -> Iterator[ImplicitIntegral]:
    """Yield the candidates that are independent of known integrals and of earlier candidates."""
    rows = [gradient_of_logarithm(f) for f in known]
    rank = len(rows)
    for each in candidates:
        rows.append(each.gradient_of_logarithm())
        if flint.nmod_mat(rows, PRIME).rank() > rank:
            rank += 1
            yield each
        else:
            rows.pop()


def implicit_integrals(map: RationalMap, monomials: Exponents) -> Iterator[ImplicitIntegral]:
    """Yield integrals from relations between few of the monomials, those of least degree first.

    Most of them are functions of others: `independent_of` selects independent ones.
    """
    rng = random.Random(0)
    chosen = circuits(map, monomials, rng)
    if not chosen:
        return
    line = _Line(map, chosen, rng)
    unknown = [
        (k, *pair) for k, each in enumerate(chosen) for pair in combinations(range(len(each)), 2)
    ]
    for most in _DEGREES:
        line.extend(2 * most + 3)
        degrees = {quotient: line.degree(*quotient) for quotient in unknown}
        unknown = [quotient for quotient in unknown if degrees[quotient] is None]
        found = [(degree, *quotient) for quotient, degree in degrees.items() if degree]
        for degree, k, above, below in sorted(found):
            circuit = chosen[k]
            yield ImplicitIntegral(map, circuit, circuit[above], circuit[below], degree)


def is_short(integral: ImplicitIntegral) -> bool:
    """Return True if a formula of this degree has few enough terms to be written out."""
    D = integral.map.dimension
    return math.comb(D + integral.degree, D) <= _TERMS


def written_out(integral: ImplicitIntegral) -> RationalFunction | None:
    """Return the formula of an integral, if it is not too long, else None."""
    if not is_short(integral):
        return None
    map, D = integral.map, integral.map.dimension
    exponents = arithmetic.exponents_up_to(integral.degree, D)

    def search(p: int, eps: int) -> arithmetic.Residues:
        rng, now = random.Random(p), map.at(eps)
        rows = []
        for _ in range(2 * len(exponents) + MORE):
            x = arithmetic.random_point(D, p, rng)
            values, quotient = monomial_values(exponents, x), integral.value(now, x)
            rows.append([*values, *(-quotient * values)])
        space = arithmetic.null_space(flint.nmod_mat(rows, p))
        return space if len(space) == 1 else []

    rows = over_rationals(random.Random(integral.degree), search, map.has_letter)
    if not rows:
        return None
    # An additional variable distinguishes the denominator.
    parts = tuple((*e, part) for part in (0, 1) for e in exponents)
    (whole,) = polynomials_with(rows, parts, map.has_letter)
    above, below = (
        map.ring.from_dict({(*e,): c for (*e, own), c in whole.to_dict().items() if own == part})
        for part in (0, 1)
    )
    return quotient_of(above, below, MODULAR) if len(whole) <= _TERMS else None
