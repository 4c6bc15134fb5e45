"""Hirota-Kimura bases and Darboux polynomials."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from .._checks import instance, integer
from ._exact import (
    DRAWS,
    Matrix,
    Point,
    Residues,
    confirmed,
    exact_array,
    integer_rows,
    null_space,
    over_rationals,
    random_prime,
)
from ._maps import Arithmetic, KahanMap
from ._polynomials import (
    Exponents,
    Polynomials,
    exponents_of,
    monomial_values,
    polynomial_ring,
    polynomials_with,
)

_MORE = 10  # equations more than unknowns


@dataclass(frozen=True, repr=False)
class HKBasis:
    """Linear relations between `monomials` along orbits, which `hk_bases` returns.

    The rows of `basis`, `dimension` of them, are coefficients of relations along the orbit of
    `point`: the last nonzero entry of a row is 1, and 0 in the others. They are None if they are
    too long to reconstruct. On random orbits `independent` of the coefficients are independent
    first integrals. So are quotients of the polynomials `integrals`, which the fewest monomials
    give: with more there are none, as the relations of one orbit have multiples.
    """

    monomials: Exponents
    dimension: int
    independent: int
    integrals: Polynomials
    point: Point
    basis: Matrix | None

    @property
    def polynomials(self) -> Polynomials:
        """Polynomials that vanish on the orbit of `point`, with the same span as the relations."""
        return polynomials_with(self.basis, self.monomials)

    def as_sympy(self, symbols: Sequence[Any] | None = None) -> list[Any]:
        """Return `polynomials` as SymPy expressions."""
        return self.polynomials.as_sympy(symbols)

    def __repr__(self) -> str:
        return (
            f"<HKBasis of dimension {self.dimension} among {len(self.monomials)} monomials, "
            f"independent={self.independent}, integrals={self.integrals}>"
        )


def hk_bases(
    map: KahanMap, monomials: int | Sequence[Sequence[int]], *, point: Any = None, seed: int = 0
) -> HKBasis:
    """Find the linear relations between monomials that hold along orbits (arXiv:1008.1040).

    An orbit has 10 points more than there are monomials, and is made longer until the number of
    relations remains the same. The coefficients of a relation in the form of `HKBasis.basis` are
    functions of the orbit, that is, first integrals; the rank of their derivatives tells how many
    are independent. If the relations of all orbits together span one dimension more than those of
    one orbit, then values of these polynomials at two points of an orbit are proportional, and
    their quotients are first integrals.

    Parameters
    ----------
    map : KahanMap
        Made by `kahan`.
    monomials : int or sequence of exponents
        All monomials up to a degree, 1 included, or the exponents (e1, ..., eD) of each.
    point : sequence of D rational numbers, optional
        Point whose orbit `basis` and `dimension` belong to; by default one with small integers
        whose orbit has as many relations as a random one.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    HKBasis
        If its `dimension` is 0, no quotient of two linear combinations of the monomials is a first
        integral.

    Raises
    ------
    TypeError, ValueError, ArithmeticError
        If an argument is not as above; if the orbit of `point`, or of most points, ends at a pole.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, hk_bases, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> hk_bases(map, 1).dimension, hk_bases(map, 2).dimension
    (0, 1)
    >>> hk_bases(map, 2).integrals
    (4*x1^2 + x2^2, x1*x2 + 1024)
    """
    instance("map", map, KahanMap)
    exponents, rng = exponents_of(monomials, map.dimension), random.Random(seed)

    def relations(p: int, point: Any = None) -> Residues:
        modular = Arithmetic(map, p)
        x = modular.random_point(rng) if point is None else [modular.number(a) for a in point]
        return _relations(modular, exponents, x)

    def ordinary_point() -> Any:
        p = random_prime(rng)
        for _ in range(DRAWS):
            x = exact_array("point", rng.choices(range(-9, 10), k=map.dimension))
            with contextlib.suppress(ZeroDivisionError):
                if len(relations(p, x)) == dimension:
                    return x
        raise ArithmeticError("the orbits of small integers are exceptional: pass `point`")

    def span(p: int) -> Residues:
        rows = [row for _ in range(3) for row in relations(p)]
        reduced, rank = flint.nmod_mat(rows, p).rref()
        return integer_rows(reduced)[:rank] if rank == dimension + 1 else []

    start = None if point is None else exact_array("point", point, (map.dimension,))
    dimension = of_point = confirmed(rng, lambda p: len(relations(p)))
    basis: Matrix | None = ()
    if start is None:
        start = ordinary_point()
    if dimension > 0 or point is not None:
        basis = over_rationals(rng, lambda p: relations(p, start))
        of_point = dimension if basis is None else len(basis)
    independent, integrals = 0, Polynomials()
    if dimension > 0:
        independent = confirmed(rng, lambda p: _independent(Arithmetic(map, p), exponents, rng))
        integrals = polynomials_with(over_rationals(rng, span), exponents)
    return HKBasis(exponents, of_point, independent, integrals, tuple(start), basis)


def _relations(modular: Arithmetic, exponents: Exponents, x: Sequence[Any]) -> Residues:
    """Relations along the orbit of a point, in the form of `HKBasis.basis`."""
    steps, before = len(exponents) + _MORE, None
    while True:
        rows = [list(monomial_values(exponents, y)) for y in modular.orbit(x, steps)]
        relations = null_space(rows, modular.p)
        if len(relations) in (0, before):
            return relations
        before, steps = len(relations), 2 * steps


def _independent(modular: Arithmetic, exponents: Exponents, rng: random.Random) -> int:
    """Rank of the derivatives of the coefficients of the relations with respect to the orbit.

    For each k, ``sum_i c_i m_i(x_k) = 0`` is differentiated with respect to x_0.
    """
    n, x = modular.dimension, modular.random_point(rng)
    relations = _relations(modular, exponents, x)
    ring = polynomial_ring(n, flint.nmod_mpoly_ctx, modulus=modular.p)
    polynomials = [ring.from_dict(dict(zip(exponents, c, strict=True))) for c in relations]
    gradients = [[each.derivative(i) for i in range(n)] for each in polynomials]
    derivative = modular.matrix(np.eye(n, dtype=int).tolist())  # of x_k
    rows = []
    for y in modular.orbit(x, len(exponents) + _MORE):
        changes = modular.matrix([[each(*y) for each in row] for row in gradients]) * derivative
        rows.append([*monomial_values(exponents, y), *changes.entries()])
        derivative = modular.derivative(y) * derivative
    reduced = modular.matrix(rows).rref()[0].tolist()[: len(exponents) - len(relations)]
    starts = range(len(exponents), len(rows[0]), n)
    return int(modular.matrix([row[k : k + n] for row in reduced for k in starts]).rank())


def darboux_polynomials(
    map: KahanMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) (arXiv:1902.04715).

    For the default cofactor 1 / P is the density of an invariant measure. For any cofactor the
    quotients of two such polynomials are first integrals. The equations for the coefficients are
    those of random integer points, 10 more than there are monomials, solved modulo primes; fresh
    points confirm the result over the rationals.

    Parameters
    ----------
    map : KahanMap
        Made by `kahan`.
    degree : int
        Largest degree of P.
    cofactor : number or callable, optional
        C: a rational number, or a function that takes a point, a tuple of fractions, and returns
        a rational number, exactly. By default it is ``map.determinant``.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    Polynomials
        A basis of these polynomials: a tuple of ``flint.fmpz_mpoly`` in x1, ..., xD, whose
        coefficients have no common factor. `as_sympy()` converts them.

    Raises
    ------
    TypeError, ValueError, ArithmeticError
        If an argument, or what `cofactor` returns, is not as above; if the coefficients have more
        than 1000 digits, or the map or the cofactor is undefined at most points.

    Examples
    --------
    >>> from suslov_fast import Suslov3D
    >>> from suslov_fast.integrability import QuadraticField, darboux_polynomials, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> for P in darboux_polynomials(map, 3):
    ...     print(P.factor())
    (1, [(2*x1 + x2, 1), (4*x1^2 + x2^2, 1)])
    (1, [(2*x1 + x2, 1), (x1*x2 + 1024, 1)])
    """
    instance("map", map, KahanMap)
    exponents = exponents_of(integer("degree", degree, 0), map.dimension)
    C = map.determinant if cofactor is None else cofactor
    if not callable(C):
        constant = exact_array("cofactor", cofactor, ()).item()
        C = lambda x: constant  # noqa: E731
    rng = random.Random(seed)

    def samples(count: int) -> list[tuple[Point, Point, Fraction]]:
        found = []
        for _ in range(2 * count):
            x = tuple(Fraction(rng.randrange(-(2**30), 2**30)) for _ in range(map.dimension))
            with contextlib.suppress(ZeroDivisionError):  # at poles
                found.append((x, map(x), exact_array("cofactor", C(x), (), exact=True).item()))
            if len(found) == count:
                return found
        raise ArithmeticError("the map or the cofactor is undefined at most points")

    equations = samples(len(exponents) + _MORE)

    def solutions(p: int) -> Residues:
        number = Arithmetic(map, p).number
        rows = []
        for x, image, c in equations:
            before, after = (monomial_values(exponents, [number(a) for a in y]) for y in (x, image))
            rows.append(list(after - number(c) * before))
        return null_space(rows, p)

    basis = over_rationals(rng, solutions)
    if basis is None:
        raise ArithmeticError("the coefficients have more than 1000 digits")
    for x, image, c in samples(3):
        defect = monomial_values(exponents, image) - c * monomial_values(exponents, x)
        if any(np.array(row) @ defect for row in basis):
            raise ArithmeticError("the polynomials fail at fresh points")
    return polynomials_with(basis, exponents)
