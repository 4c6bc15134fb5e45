"""Darboux polynomials: of one cofactor, at random points, or of all, on random lines."""

import itertools
import math
import random
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, partial
from typing import Any

import flint
import numpy as np

from ..checks import integer, wrong
from . import exact
from .exact import MORE, Polynomials, Residues, degree_of, modulo, monomial_values, value_at
from .functions import RationalFunction, quotient_of
from .maps import RationalMap, check_map, on_line, random_line, rational_roots
from .reconstruction import over_rationals, polynomials_with

Powers = tuple[int, ...]  # of the hyperplane at infinity and the factors of the map


def darboux_polynomials(
    map: RationalMap, degree: int, cofactor: Any = None, *, seed: int = 0
) -> Polynomials:
    """Find the polynomials P with P(map(x)) = C(x) P(x) (arXiv:1902.04715).

    For the default cofactor, 1 / P is the density of an invariant measure. For any cofactor,
    quotients of two such polynomials are first integrals. The equations are those of random points
    modulo a prime, 10 more than unknowns; the solution is confirmed modulo another prime.

    Parameters
    ----------
    map : KahanMap or RationalMap
        Made by `kahan` or `rational_map`.
    degree : int
        Largest degree of P.
    cofactor : number, RationalFunction or callable, optional
        C: a rational number, a function that `cofactors` found, or, unless eps is a letter, one of
        a tuple of fractions that returns a rational number. By default ``map.determinant``.
    seed : int, optional
        Seed of the random primes and points.

    Returns
    -------
    tuple of flint.fmpz_mpoly
        A basis of these polynomials in x1, ..., xD, whose coefficients have no common factor.

    Raises
    ------
    ArithmeticError
        If there is no map, or the map or the cofactor is undefined at most points.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, Suslov3D
    >>> from suslov_fast.integrability import darboux_polynomials, kahan
    >>> map = kahan(QuadraticField.of(Suslov3D(4, 1, -0.5, -0.25)), eps=0.25)
    >>> for P in darboux_polynomials(map, 3):
    ...     print(P.factor())
    (1, [(2*x1 + x2, 1), (4*x1^2 + x2^2, 1)])
    (1, [(2*x1 + x2, 1), (x1*x2 + 1024, 1)])
    """
    check_map(map)
    degree = integer("degree", degree, 0)
    exact.check_unknowns("degree", degree, map.dimension)
    rng = random.Random(integer("seed", seed, 0))
    if cofactor is not None and not callable(cofactor):
        cofactor = RationalFunction((), exact.rational("cofactor", cofactor))
    if map.has_letter and not isinstance(cofactor, RationalFunction | None):
        raise wrong("cofactor", "a number or RationalFunction", "another function", TypeError)
    return with_cofactor(map, degree, cofactor, rng)


def with_cofactor(map: RationalMap, degree: int, cofactor: Any, rng: random.Random) -> Polynomials:
    """Return a basis of the polynomials up to a degree that have a cofactor, None for det DPhi."""
    exponents = exact.exponents_up_to(degree, map.dimension)

    def search(p: int, eps: int) -> Residues:
        here, D, rows = map.at(eps), map.dimension, []
        for _ in range(2 * (len(exponents) + MORE)):
            x = exact.point_modulo(p, [rng.randrange(-(2**12), 2**12) for _ in range(D)])
            try:
                image, c = here.image(x), value_of(cofactor, here, p, eps, x)
            except ZeroDivisionError:  # at a pole
                continue
            before, after = (monomial_values(exponents, y) for y in (x, image))
            rows.append([b - c * a for a, b in zip(before, after, strict=True)])
            if len(rows) == len(exponents) + MORE:
                return exact.null_space(flint.nmod_mat(rows, p))
        raise ArithmeticError("the map or the cofactor is undefined at most points")

    rows = over_rationals(rng, search, map.has_letter)
    if rows is None:
        raise ArithmeticError("the coefficients are too long")
    return polynomials_with(rows, exponents, map.has_letter)


def value_of(cofactor: Any, map: RationalMap, p: int, eps: int, x: list[Any]) -> Any:
    """Return the value of a cofactor at a point modulo a prime."""
    if cofactor is None:
        return map.derivative(x).det()
    if isinstance(cofactor, RationalFunction):
        value = flint.nmod(exact.fmpq(cofactor.constant), p)
        for P, e in cofactor.factors:
            letter = [flint.nmod(eps, p)] if exact.has_letter(P) else []
            value *= value_at(P, [*letter, *x]) ** e
        return value
    half = p // 2
    found = cofactor(tuple(Fraction((int(a) + half) % p - half) for a in x[:-1]))
    if isinstance(found, float):
        raise wrong("cofactor", "exact numbers", "float", TypeError)
    return flint.nmod(exact.fmpq(exact.rational("cofactor", found)), p)


def invariant_spaces(map: RationalMap, degree: int) -> Iterator[Polynomials]:
    """Yield the polynomials whose pullback is a constant times them and powers of the factors.

    The factors of the map must be known. All have the degree, or have the hyperplane at infinity as
    a factor.
    """
    pullbacks = cache(lambda p, eps: Pullbacks(map, degree, p, eps))
    rng = random.Random(degree)
    p = exact.random_prime(rng)
    first, letter = pullbacks(p, rng.randrange(2, p)), map.has_letter

    def charpoly(powers: Powers, p: int, eps: int) -> Residues:
        return pullbacks(p, eps).charpoly(powers)

    def space(powers: Powers, c: Any, p: int, eps: int) -> Residues:
        return pullbacks(p, eps).space(powers, c)

    for powers, several in [*first.search()]:
        constants: list[Any] = [None]
        if several:
            rows = over_rationals(rng, partial(charpoly, powers), letter)
            constants = rational_roots(rows[0], letter) if rows else []
        for c in constants:
            if rows := over_rationals(rng, partial(space, powers, c), letter):
                yield polynomials_with(rows, first.exponents, letter)


class Pullbacks:
    """Pullbacks of the polynomials of a degree, modulo a prime and for one eps.

    Columns are monomials. The equations are those of polynomials in the parameter t of random
    lines, whose points at infinity have t = 0.
    """

    def __init__(self, map: RationalMap, degree: int, p: int, eps: int) -> None:
        self.map, self.degree, self.p, self.eps = map, degree, p, eps
        self.rng, self.here = random.Random(p), map.at(eps)
        self.exponents = exact.exponents_up_to(degree, map.dimension)
        self.everything = self._matrix(np.eye(len(self.exponents), dtype=int).tolist())
        infinity = map.ring.constant(1)  # its value on a line is t
        factors = [infinity, *(map.factors or ()), map.forms[-1]]
        self.degrees = [1, *(degree_of(f) for f in map.factors or ()), map.degree]
        self.polynomials = [modulo(P, p, eps) for P in factors]
        self._line, self._equations = cache(self._new_line), cache(self._divisible_by)

    def _matrix(self, rows: Any) -> Any:
        return flint.nmod_mat(rows, self.p)

    def _new_line(self, k: int) -> tuple[list[Any], list[Any], list[Any]]:
        """Return the monomials on the k-th random line, those of its image, and the factors."""
        line = random_line(self.map.dimension, self.p, self.rng)
        polynomials = zip(self.polynomials, self.degrees, strict=True)
        *factors, below = (on_line(P, line, degree) for P, degree in polynomials)
        image = self.here.reduced(line)
        scale = below.leading_coefficient() / image[-1].leading_coefficient()
        image = [scale * F for F in image]
        monomials = [(*e, self.degree - sum(e)) for e in self.exponents]
        here, there = (list(monomial_values(monomials, x)) for x in (line, image))
        return here, there, factors

    def _divisible_by(self, i: int, power: int) -> Any:
        """Return equations for the polynomials whose pullback has factor i to this power."""
        rows: Residues = []
        for k in itertools.count():
            _, images, factors = self._line(k)
            divisor = factors[i] ** power
            remainders = [f % divisor for f in images]
            rows += [[f[j] for f in remainders] for j in range(divisor.degree())]
            if len(rows) > 2 * len(self.exponents):
                return self._matrix(rows)
        raise AssertionError

    def _solutions(self, equations: Any, basis: Any) -> Any:
        """Return the combinations of rows of a basis that solve equations; None if only 0 does."""
        columns, dimension = equations.nullspace()
        chosen = columns.transpose().tolist()[:dimension]
        return self._matrix(chosen) * basis if chosen else None

    def _divisible(self, basis: Any, i: int, power: int) -> Any:
        return self._solutions(self._equations(i, power) * basis.transpose(), basis)

    def search(self) -> Iterator[tuple[Powers, bool]]:
        """Yield the powers of invariant spaces, and whether there are several for them."""
        total, degrees = self.degree * (self.map.degree - 1), self.degrees[:-1]
        most = [0] * len(degrees)
        # If others were allowed, any of them that goes to another one would have a cofactor.
        for i, exceptional in enumerate(exceptional_factors(self.map)):
            basis = self.everything if exceptional else None
            while basis is not None and (most[i] + 1) * degrees[i] <= total:
                basis = self._divisible(basis, i, most[i] + 1)
                most[i] += basis is not None
        products = [a * b for a, b in zip(most, degrees, strict=True)]
        spaces: list[Any] = [(self.everything, total, ())]
        for i, degree in enumerate(degrees):
            before, spaces = spaces, []
            rest = sum(products[i + 1 :])
            for basis, left, powers in before:
                least = max(0, -((rest - left) // degree))
                for power in range(least, min(most[i], left // degree) + 1):
                    reduced = self._divisible(basis, i, power) if power else basis
                    if reduced is None:
                        break
                    spaces.append((reduced, left - power * degree, (*powers, power)))
        for basis, _, powers in spaces:
            _, pulled = self._invariant(basis, powers)
            if pulled is not None:
                yield powers, pulled != self._scalar(pulled[0, 0], pulled.nrows())

    def charpoly(self, powers: Powers) -> Residues:
        """Return the coefficients of the characteristic polynomial of the pullback."""
        _, pulled = self._invariant(self.everything, powers)
        return [] if pulled is None else [[int(c) for c in pulled.charpoly().coeffs()]]

    def space(self, powers: Powers, c: Any) -> Residues:
        """Return a basis, in echelon form, of the polynomials with these powers and constant."""
        basis, pulled = self._invariant(self.everything, powers)
        if basis is not None and c is not None:
            c = value_of(c, self.here, self.p, self.eps, [])
            basis = self._solutions(pulled - self._scalar(c, pulled.nrows()), basis)
        return [] if basis is None else exact.integer_rows(basis.rref()[0])

    def _scalar(self, c: Any, n: int) -> Any:
        return self._matrix([[int(c) * (i == j) for j in range(n)] for i in range(n)])

    def _invariant(self, basis: Any, powers: Powers) -> tuple[Any, Any]:
        """Return the polynomials with pullbacks ``factors**powers`` times one of them.

        They are the rows of the first matrix. The second one is the pullback in their coordinates.
        """
        before: Residues = []
        after: Residues = []
        rows = range(1 + self.degree * self.map.degree)
        for k in range(1 + 4 * basis.nrows() // len(rows)):
            here, there, factors = self._line(k)
            weight = math.prod(f**power for f, power in zip(factors, powers, strict=True))
            here = [weight * f for f in here]
            before += [[f[j] for f in here] for j in rows]
            after += [[f[j] for f in there] for j in rows]
        left, right = self._matrix(before), self._matrix(after)
        while basis is not None:
            r = basis.nrows()
            both = ((each * basis.transpose()).tolist() for each in (left, right))
            reduced, rank = self._matrix([a + b for a, b in zip(*both, strict=True)]).rref()
            pulled = [row[r:] for row in reduced.tolist()[:rank]]
            if rank == r:
                return basis, self._matrix(pulled)
            basis = self._solutions(self._matrix(pulled[r:]), basis)
        return None, None


def exceptional_factors(map: RationalMap) -> list[bool]:
    """Return which of the hyperplane at infinity and the factors have a lower-dimensional image.

    They divide the Jacobian determinant of F in homogeneous coordinates, F_0^(D + 1) det DPhi.
    """
    below: Any = quotient_of(map.forms[-1], map.ring.constant(1), "")
    found = (below ** (map.dimension + 1) * map.jacobian_cofactor).factors
    left = (map.dimension + 1) * (map.degree - 1) - sum(e * degree_of(f) for f, e in found)
    return [left > 0, *(f in [g for g, _ in found] for f in map.factors or ())]
