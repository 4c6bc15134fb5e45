"""Linear relations ``sum_i c_i m_i(x_k) = 0`` of monomials along orbits, and their integrals.

The rows of a matrix are the values of monomials m_i at points x_k of one orbit, some more points
than monomials. Its null space consists of the relations (Petrera, Pfadler and Suris,
arXiv:1008.1040). They depend on the orbit alone. If no part of the monomials has a relation, the
relation of all is unique up to a factor, and each quotient c_i / c_j is a rational first integral.
Its formula may have thousands of terms, but its value at a point follows from a few points of an
orbit.
"""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import accumulate, combinations, islice
from typing import Any, NamedTuple

import flint
import numpy as np

from ..fields.exact_numbers import text_of
from ..fields.names import labels
from ..keywords import public
from . import arithmetic, polynomials
from .arithmetic import EPS, Residues, Values
from .birational_maps import RationalMap
from .interpolation import Line, over_rationals
from .polynomials import Exponents, Polynomials, exponents_up_to, monomial_values, polynomials_with
from .rational_functions import MODULAR, RationalFunction, quotient_of
from .tolerances import (
    EXTRA_EQUATIONS,
    MOST_QUOTIENTS,
    MOST_TERMS_WRITTEN,
    ORBITS_OF_RELATIONS,
    ORDERS_OF_MONOMIALS,
)


def monomials_along(map: RationalMap, exponents: Exponents, x: Sequence[Any], length: int) -> Any:
    """Return the matrix of monomials (columns) at `length` points (rows) of the orbit of x."""
    return arithmetic.matrix([monomial_values(exponents, y) for y in map.orbit(x, length)])


def relations_along(
    map: RationalMap, exponents: Exponents, eps: Values, x: Sequence[Any]
) -> Residues:
    """Return a basis of the relations along the orbit of a point x modulo a prime, as rows."""
    length = len(exponents) + EXTRA_EQUATIONS
    return arithmetic.null_space(monomials_along(map.at_eps(eps), exponents, x, length))


def gradients_of_coefficients(
    map: RationalMap,
    exponents: Exponents,
    relations: Residues,
    x: Sequence[Any],
    length: int,
    first: int = 0,
) -> list[list[list[Any]]]:
    """Return the gradients of the coefficients c_i of each relation with respect to x.

    They solve ``sum_i m_i(x_k) dc_i = -sum_i c_i dm_i(x_k)`` for `length` points x_k of the orbit
    of x, from x_first on. The relations must be a basis in echelon form; coefficients that this
    form fixes at 0 or 1 are left out.
    """
    p, n, count = int(x[0].modulus()), map.dimension, len(exponents)
    ring = polynomials.ring_modulo(p, n)
    forms = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
    slopes = [[P.derivative(i) for i in range(n)] for P in forms]
    rows = []  # the equations at x_k: all m_i, then the right sides of each relation
    for y, derivative in islice(map.variations(x, first + length), first, None):
        values = flint.nmod_mat([[dP(*y[:-1]) for dP in gradient] for gradient in slopes], p)
        rows.append([*monomial_values(exponents, y), *(values * derivative * -1).entries()])
    solved = flint.nmod_mat(rows, p).rref()[0].tolist()[: count - len(relations)]
    return [[row[k : k + n] for row in solved] for k in range(count, len(rows[0]), n)]


class Counted(NamedTuple):
    """Numbers of relations along an orbit and of independent integrals among coefficients."""

    relations: int
    integrals: int


@lru_cache(maxsize=32)
def count_relations(map: RationalMap, exponents: Exponents) -> Counted:
    """Count the relations of monomials along a random orbit, and the integrals that they give.

    Two primes must give the same numbers. If det DPhi = 0, the first D points of an orbit are left
    out, because only later points are in the images of all iterates.
    """
    rng, first = map.generator(), 0 if map.is_invertible else map.dimension

    def count_modulo(p: int, eps: Values) -> Counted:
        x = arithmetic.random_point(map.dimension, p, rng)
        at_eps, length = map.at_eps(eps), len(exponents) + EXTRA_EQUATIONS
        *_, start = at_eps.orbit(x, first + 1)
        relations = relations_along(at_eps, exponents, eps, start)
        if not relations:
            return Counted(0, 0)
        gradients = gradients_of_coefficients(at_eps, exponents, relations, x, length, first)
        rows = [row for of_relation in gradients for row in of_relation]
        return Counted(len(relations), int(flint.nmod_mat(rows, p).rank()))

    return arithmetic.agreed_by_primes(rng, count_modulo)


def integrals_of_relations(map: RationalMap, exponents: Exponents) -> Polynomials:
    """Return polynomials that span the relations of all orbits; () unless they give integrals.

    Quotients of these polynomials are integrals if the map is invertible, one orbit has d > 0
    independent relations, and the relations of all orbits span d + 1 dimensions.
    """
    rng, dimension = map.generator(), count_relations(map, exponents).relations
    if dimension == 0 or not map.is_invertible:
        return ()

    def span(p: int, eps: Values) -> Residues:
        points = [
            arithmetic.random_point(map.dimension, p, rng) for _ in range(ORBITS_OF_RELATIONS)
        ]
        rows = [row for x in points for row in relations_along(map, exponents, eps, x)]
        basis = arithmetic.row_space(rows, p)
        return basis if len(basis) == dimension + 1 else []

    rows = over_rationals(rng, span, len(map.letters))
    return polynomials_with(rows or [], exponents, polynomials.letters_of(map.ring))


_DEGREES = 5, 11, 23  # bounds of the degrees of quotients, tried in this order


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
        """Return the value at a point, and at a number for each letter that the map has."""
        map = self.map.subs(*unnamed, **values) if self.map.is_symbolic else self.map
        point = (*arithmetic.rationals("x", x, map.dimension), Fraction(1))
        return arithmetic.fraction(self.value(map, [arithmetic.fmpq(a) for a in point]))

    def value(self, map: RationalMap, x: list[Any]) -> Any:
        """Return the value at a point (x1, ..., xD, 1) of exact numbers; `map` has no letters."""
        others = [e for e in self.monomials if e != self.denominator]
        before = (len(others) - 1) // 2 if map.inverse else 0  # how many points before x
        earlier = [*map.inverse.orbit(x, before + 1)][:0:-1] if before else []
        orbit = [*earlier, *map.orbit(x, len(others) - before)]
        # If the monomial `denominator` has the coefficient 1, a linear system gives the others.
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
        names = self.map.names or labels(self.map.dimension)

        def text(exponents: Sequence[int]) -> str:
            return text_of({tuple(np.repeat(range(len(names)), exponents).tolist()): 1}, names)

        relation = ", ".join(map(text, self.monomials))
        quotient = f"c({text(self.numerator)})/c({text(self.denominator)})"
        return f"{quotient} of the relation between {relation}"

    def __repr__(self) -> str:
        return f"ImplicitIntegral({self}; degree {self.degree})"


# A circuit is a minimal set of monomials with a relation along orbits: no coefficient is 0.


def circuits(map: RationalMap, monomials: Exponents, rng: random.Random) -> list[Exponents]:
    """Return circuits, minimal sets of `monomials` with a relation along orbits; small sets first.

    A circuit is the set of monomials in a row of the reduced echelon form of the relations. Random
    orders of the monomials give different circuits; some circuits may be missed.
    """
    p = map.prime
    relations = relations_along(map, monomials, EPS, arithmetic.random_point(map.dimension, p, rng))
    positions = range(len(monomials))
    supports = set()  # the positions of nonzero coefficients in rows
    for _ in range(ORDERS_OF_MONOMIALS if relations else 0):
        order = rng.sample(positions, len(positions))
        rows = [[relation[k] for k in order] for relation in relations]
        for row in flint.nmod_mat(rows, p).rref()[0].tolist():
            supports.add(tuple(sorted(k for k, c in zip(order, row, strict=True) if c != 0)))
    shortest = sorted(supports, key=lambda support: (len(support), support))
    quotients = accumulate(math.comb(len(support), 2) for support in shortest)
    return [
        tuple(monomials[k] for k in support)
        for support, count in zip(shortest, quotients, strict=True)
        if count <= MOST_QUOTIENTS
    ]


def _on_random_line(
    map: RationalMap, circuits: list[Exponents], rng: random.Random
) -> Iterator[tuple[int, list[list[int]]]]:
    """Yield t, and the coefficients of each circuit's relation, at points of a random line."""
    p, at_number, length = map.prime, map.at_eps(EPS), max(len(circuit) for circuit in circuits)
    monomials = tuple({e: None for circuit in circuits for e in circuit})
    columns = [[monomials.index(e) for e in circuit] for circuit in circuits]
    start, slope = (arithmetic.random_point(map.dimension, p, rng)[:-1] for _ in range(2))
    while True:
        t = flint.nmod(rng.randrange(p), p)
        x = [*(a + b * t for a, b in zip(start, slope, strict=True)), t**0]
        values = monomials_along(at_number, monomials, x, length).tolist()
        matrices = ([[row[k] for k in places] for row in values] for places in columns)
        yield int(t), [arithmetic.null_space(flint.nmod_mat(rows, p))[0] for rows in matrices]


@lru_cache(maxsize=1024)
def _gradients_of_logarithms(
    map: RationalMap, circuit: Exponents, p: int
) -> dict[tuple[int, ...], Any]:
    """Return {m: grad log c} for the relation sum c m = 0 of a circuit, at a point modulo p."""
    map, x, length = map.at_eps(EPS), arithmetic.random_point(map.dimension, p), len(circuit) - 1
    (relation,) = arithmetic.null_space(monomials_along(map, circuit, x, length))
    (gradients,) = gradients_of_coefficients(map, circuit, [relation], x, length)
    logarithms = [[a / c for a in row] for row, c in zip(gradients, relation, strict=False)]
    return dict(zip(circuit, [*logarithms, [0 * x[0]] * map.dimension], strict=True))


def implicit_integrals(map: RationalMap, monomials: Exponents) -> Iterator[ImplicitIntegral]:
    """Yield integrals c_i / c_j of circuits, low degrees first; many depend on earlier ones."""
    rng = random.Random(0)
    sets = circuits(map, monomials, rng)
    if not sets:
        return
    on_line, points = _on_random_line(map, sets, rng), list[tuple[int, list[list[int]]]]()
    # Quotients c_i / c_j of the relation of the circuit number k in `sets`, as (k, i, j).
    unknown = [(k, *pair) for k, e in enumerate(sets) for pair in combinations(range(len(e)), 2)]
    for most in _DEGREES:
        points += islice(on_line, 2 * most + 3 - len(points))
        line, known, others = Line([t for t, _ in points], map.prime), [], []
        for k, i, j in unknown:
            values = [c[k][i] * pow(c[k][j], -1, map.prime) for _, c in points]
            if (pair := line.quotient(values, lowest=most + 1)) is None:
                others.append((k, i, j))
            elif degree := max(0, *(int(P.degree()) for P in pair)):
                known.append((degree, k, i, j))
        unknown = others
        for degree, k, i, j in sorted(known):
            yield ImplicitIntegral(map, sets[k], sets[k][i], sets[k][j], degree)


def written_out(integral: ImplicitIntegral) -> RationalFunction | None:
    """Return the formula of an integral; None if it has too many terms."""
    map, D = integral.map, integral.map.dimension
    # One polynomial is sought, numerator + y denominator, with an additional variable y.
    exponents = tuple((*e, y) for y in (0, 1) for e in exponents_up_to(integral.degree, D))

    def search(p: int, eps: Values) -> Residues:
        rng, at_number = random.Random(p), map.at_eps(eps)
        rows = []
        for _ in range(len(exponents) + EXTRA_EQUATIONS):
            x = arithmetic.random_point(D, p, rng)
            quotient = integral.value(at_number, x)
            # An equation for coefficients: numerator - quotient * denominator = 0 at x.
            rows.append(monomial_values(exponents, [*x[:-1], -quotient]))
        space = arithmetic.null_space(flint.nmod_mat(rows, p))
        return space if len(space) == 1 else []

    # Most monomials do not occur. The monomials that occur for one prime suffice for other primes.
    (first,) = search(map.prime, EPS) or [[]]
    exponents = tuple(e for e, c in zip(exponents, first, strict=False) if c)
    rows = over_rationals(map.generator(integral.degree), search, len(map.letters))
    if not rows:
        return None
    (both,) = polynomials_with(rows, exponents, polynomials.letters_of(map.ring))
    if len(both) > MOST_TERMS_WRITTEN:
        return None
    P, Q = polynomials.coefficients_in(both, -1)
    return quotient_of(P.project_to_context(map.ring), Q.project_to_context(map.ring), MODULAR)
