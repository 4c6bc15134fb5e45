"""Search for the Darboux polynomials of all cofactors."""

from __future__ import annotations

import random
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, cached_property, partial
from typing import Any

import flint
import numpy as np

from . import _exact
from ._exact import MORE, Polynomials, Residues
from ._maps import image_by_minors, random_line
from ._projective import Projective

Powers = tuple[int, ...]  # of the factors of the map


def invariant_spaces(
    map: Projective, degree: int, affine: int
) -> Iterator[tuple[Powers, Polynomials]]:
    """Yield the polynomials whose pullback is a constant times them and powers of the factors.

    The factors of the map must be known. A polynomial of lower degree, of at most `affine` if that
    is less than `degree`, has powers of the hyperplane at infinity as a factor.
    """
    rng, pullbacks = random.Random(degree), cache(partial(_Pullbacks, map, degree, affine))
    first = pullbacks(_exact.random_prime(rng))
    for powers, c in [*first.search()]:

        def space(p: int, powers: Powers = powers, c: Fraction | None = c) -> Residues:
            return pullbacks(p).space(powers, c)

        if rows := _exact.over_rationals(random.Random(degree), space):
            yield powers, _exact.polynomials_with(rows, first.exponents)


class _Pullbacks:
    """Pullbacks of the polynomials of a degree, modulo a prime; columns are monomials."""

    def __init__(self, map: Projective, degree: int, affine: int, p: int) -> None:
        self.map, self.degree, self.p, self.rng = map, degree, p, random.Random(p)
        self.exponents = _exact.exponents_up_to(affine, map.D)
        self.monomials = [(*e, degree - sum(e)) for e in self.exponents]
        self.everything = self._matrix(np.eye(len(self.exponents), dtype=int).tolist())
        self._equations = cache(self._divisible_by)

    def _matrix(self, rows: Any) -> Any:
        return flint.nmod_mat(rows, self.p)

    @cached_property
    def _lines(self) -> list[tuple[list[Any], ...]]:
        """On random lines: the monomials, the monomials of the image, and the factors."""
        known = [self._modular(f) for f in (self.map.common, *self.map.factors)]
        lines: list[tuple[list[Any], ...]] = []
        for _ in range(len(self.exponents) + MORE):
            line = random_line(self.map.map, self.p, self.rng)
            common, *factors = self._restricted(known, line)
            minors = image_by_minors(self.map.map, line)
            image = [each // common for each in minors]
            monomials = (_exact.monomial_values(self.monomials, x) for x in (line, image))
            lines.append((*map(list, monomials), factors))
        return lines

    def _modular(self, P: Any) -> tuple[Any, int]:
        """Return a homogeneous polynomial with the last variable 1, and its degree."""
        ring = _exact.polynomial_ring(self.map.D, flint.nmod_mpoly_ctx, modulus=self.p)
        terms = {e[:-1]: int(c) % self.p for e, c in P.to_dict().items()}
        return ring.from_dict(terms), int(P.total_degree())

    def _restricted(self, polynomials: list[Any], line: list[Any]) -> list[Any]:
        """Return polynomials on a line, on which the last coordinate is the parameter t."""
        ring = _exact.polynomial_ring(1, flint.nmod_mpoly_ctx, modulus=self.p)
        by_inverse = [ring.from_dict({(0,): x[1], (1,): x[0]}) for x in line[:-1]]  # of x / t
        restricted = []
        for P, degree in polynomials:
            terms = P.compose(*by_inverse, ctx=ring).to_dict()
            c = [int(terms.get((degree - k,), 0)) for k in range(degree + 1)]
            restricted.append(flint.nmod_poly(c, self.p))
        return restricted

    def _divisible_by(self, i: int, power: int) -> Any:
        """Return equations for the polynomials whose pullback has factor i to this power."""
        rows: Residues = []
        for _, images, factors in self._lines:
            modulus = factors[i] ** power
            remainders = [f % modulus for f in images]
            rows += [[f[k] for f in remainders] for k in range(modulus.degree())]
            if len(rows) > 2 * len(self.exponents):
                break
        return self._matrix(rows)

    def _solutions(self, equations: Any, basis: Any) -> Any:
        """Return the combinations of rows of a basis that solve equations; None if only 0 does."""
        columns, dimension = equations.nullspace()
        chosen = columns.transpose().tolist()[:dimension]
        return self._matrix(chosen) * basis if chosen else None

    def _divisible(self, basis: Any, i: int, power: int) -> Any:
        self.map.pulse()
        return self._solutions(self._equations(i, power) * basis.transpose(), basis)

    def search(self) -> Iterator[tuple[Powers, Fraction | None]]:
        """Yield the powers of invariant spaces, and the constant if there are several for them."""
        total = self.degree * (self.map.delta - 1)
        degrees = [int(f.total_degree()) for f in self.map.factors]
        most = [0] * len(degrees)
        for i, exceptional in enumerate(self.map.of_jacobian):
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
                for c, _ in pulled.charpoly().roots():
                    several = pulled != self._scalar(c, pulled.nrows())
                    yield powers, _exact.reconstructed(int(c), self.p) if several else None

    def space(self, powers: Powers, c: Fraction | None) -> Residues:
        """Return a basis, in echelon form, of the polynomials with these powers and constant."""
        basis = self.everything
        for i, power in enumerate(powers):
            if power:
                basis = basis and self._divisible(basis, i, power)
        basis, pulled = self._invariant(basis, powers)
        if basis is not None and c is not None:
            constant = flint.nmod(_exact.fmpq(c), self.p)
            basis = self._solutions(pulled - self._scalar(constant, pulled.nrows()), basis)
        return [] if basis is None else _exact.integer_rows(basis.rref()[0])

    def _scalar(self, c: Any, n: int) -> Any:
        return self._matrix([[int(c) * (i == j) for j in range(n)] for i in range(n)])

    @cached_property
    def _samples(self) -> list[tuple[list[Any], ...]]:
        """At random points of the lines: the monomials, those of the image, and the factors."""
        samples = []
        for each in self._lines:
            t = flint.nmod(self.rng.randrange(self.p), self.p)
            samples.append(tuple([f(t) for f in polynomials] for polynomials in each))
        return samples

    def _invariant(self, basis: Any, powers: Powers) -> tuple[Any, Any]:
        """Return the polynomials with pullbacks ``factors**powers`` times one of them.

        They are the rows of the first matrix. The second one is the pullback in their coordinates.
        """
        while basis is not None:
            r = basis.nrows()
            before, after = [], []
            for here, there, factors in self._samples[: 2 * r + MORE]:
                weight = flint.nmod(1, self.p)
                for a, power in zip(factors, powers, strict=True):
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
