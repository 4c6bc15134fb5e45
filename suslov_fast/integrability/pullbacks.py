"""Search for the Darboux polynomials of all cofactors."""

from __future__ import annotations

import contextlib
import itertools
import random
from collections.abc import Iterator
from functools import cache, cached_property, partial
from typing import Any

import flint
import numpy as np

from . import exact
from .darboux import value_of
from .exact import MORE, Polynomials, Residues, degree_of, modulo
from .maps import BirationalMap, on_line, random_line, rational_roots
from .reconstruction import over_rationals, polynomials_with

Powers = tuple[int, ...]  # of the hyperplane at infinity and the factors of the map


def invariant_spaces(map: BirationalMap, degree: int) -> Iterator[Polynomials]:
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

    Columns are monomials. On random lines, with the parameter t = 0 at infinity, divisibility by a
    factor is that of polynomials in t; all else is found at random points.
    """

    def __init__(self, map: BirationalMap, degree: int, p: int, eps: int) -> None:
        self.map, self.degree, self.p, self.eps = map, degree, p, eps
        self.rng, self.steps = random.Random(p), map.steps(p, eps)
        self.exponents = exact.exponents_up_to(degree, map.dimension)
        self.monomials = [(*e, degree - sum(e)) for e in self.exponents]
        self.everything = self._matrix(np.eye(len(self.exponents), dtype=int).tolist())
        self.factors = [modulo(f, p, eps) for f in map.factors or ()]
        self.degrees = [int(f.total_degree()) for f in self.factors]
        self._line, self._sample = cache(self._new_line), cache(self._new_sample)
        self._equations = cache(self._divisible_by)

    def _matrix(self, rows: Any) -> Any:
        return flint.nmod_mat(rows, self.p)

    def _new_line(self, k: int) -> tuple[list[Any], list[Any]]:
        """Return the k-th random line, and the monomials of its image."""
        line = random_line(self.map.dimension, self.p, self.rng)
        return line, list(exact.monomial_values(self.monomials, self.steps.reduced(line)))

    def _divisible_by(self, i: int, power: int) -> Any:
        """Return equations for the polynomials whose pullback has factor i to this power."""
        rows: Residues = []
        for k in itertools.count():
            line, images = self._line(k)
            factor = line[-1] if i == 0 else on_line(self.factors[i - 1], line, self.degrees[i - 1])
            remainders = [f % factor**power for f in images]
            rows += [[f[j] for f in remainders] for j in range(power * factor.degree())]
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
        total = self.degree * (self.map.degree - 1)
        degrees = [1, *self.degrees]
        most = [0] * len(degrees)
        # If others were allowed, any of them that goes to another one would have a cofactor.
        for i, exceptional in enumerate(exceptional_factors(self.map)):
            basis = self.everything if exceptional else None
            while basis is not None and (most[i] + 1) * degrees[i] <= total:
                basis = self._divisible(basis, i, most[i] + 1)
                most[i] += basis is not None
        products = [a * b for a, b in zip(most, degrees, strict=True)]

        def descend(basis: Any, left: int, powers: Powers) -> Iterator[Any]:
            """Yield the powers of all factors that continue these, and what they leave."""
            i = len(powers)
            if i == len(degrees):
                yield basis, powers
                return
            least = max(0, left - sum(products[i + 1 :]))
            for power in range(-(-least // degrees[i]), min(most[i], left // degrees[i]) + 1):
                reduced = self._divisible(basis, i, power) if power else basis
                if reduced is None:
                    break
                yield from descend(reduced, left - power * degrees[i], (*powers, power))

        for basis, powers in descend(self.everything, total, ()):
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
            c = value_of(c, self.steps, self.eps, [])
            basis = self._solutions(pulled - self._scalar(c, pulled.nrows()), basis)
        return [] if basis is None else exact.integer_rows(basis.rref()[0])

    def _scalar(self, c: Any, n: int) -> Any:
        return self._matrix([[int(c) * (i == j) for j in range(n)] for i in range(n)])

    def _new_sample(self, k: int) -> tuple[list[Any], list[Any], list[Any]]:
        """At the k-th random point: the monomials, those of the image under F, and the factors."""
        while True:
            x = self.steps.point([self.rng.randrange(self.p) for _ in range(self.map.dimension)])
            with contextlib.suppress(ZeroDivisionError):
                image, denominator = self.steps.image(x), self._denominator(*x[:-1])
                here, there = (exact.monomial_values(self.exponents, y) for y in (x, image))
                known = [x[-1], *(f(*x[:-1]) for f in self.factors)]
                return list(here), list(there * denominator**self.degree), known

    @cached_property
    def _denominator(self) -> Any:
        return modulo(self.map.forms[-1], self.p, self.eps)

    def _invariant(self, basis: Any, powers: Powers) -> tuple[Any, Any]:
        """Return the polynomials with pullbacks ``factors**powers`` times one of them.

        They are the rows of the first matrix. The second one is the pullback in their coordinates.
        """
        while basis is not None:
            r = basis.nrows()
            before, after = [], []
            for here, there, known in map(self._sample, range(2 * r + MORE)):
                weight = flint.nmod(1, self.p)
                for a, power in zip(known, powers, strict=True):
                    weight *= a**power
                before.append([weight * a for a in here])
                after.append(there)
            both = (self._matrix(rows) * basis.transpose() for rows in (before, after))
            joined = [a + b for a, b in zip(*(each.tolist() for each in both), strict=True)]
            reduced, rank = self._matrix(joined).rref()
            right = [row[r:] for row in reduced.tolist()[:rank]]
            if rank == r:
                return basis, self._matrix(right)
            basis = self._solutions(self._matrix(right[r:]), basis)
        return None, None


def exceptional_factors(map: BirationalMap) -> list[bool]:
    """Return which of the hyperplane at infinity and the factors have a lower-dimensional image.

    They divide the Jacobian determinant of F in homogeneous coordinates, F_0^(D + 1) det DPhi.
    """
    powers = {str(f): e for f, e in exact.factors(map.forms[-1])}
    powers = {name: (map.dimension + 1) * e for name, e in powers.items()}
    for f, e in map.jacobian_cofactor.factors if map.jacobian_cofactor else ():
        powers[str(f)] = powers.get(str(f), 0) + e
    known = map.factors or ()
    left = (map.dimension + 1) * (map.degree - 1)
    left -= sum(powers.get(str(f), 0) * degree_of(f) for f in known)
    return [left > 0, *(powers.get(str(f), 0) > 0 for f in known)]
