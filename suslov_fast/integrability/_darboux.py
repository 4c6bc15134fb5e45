"""Search for the Darboux polynomials of all cofactors."""

from __future__ import annotations

import random
from collections.abc import Iterator
from fractions import Fraction
from functools import cache, cached_property, partial
from itertools import accumulate
from typing import Any

import flint
import numpy as np

from . import _exact
from ._exact import MORE, Polynomials, Residues
from ._maps import Arithmetic, image_by_minors, random_line
from ._projective import Projective

Powers = tuple[int, ...]  # of the factors of the map
_ITERATES = 6  # of a point on a factor


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

    def _at(self, x: Any) -> list[Any]:
        """Return all monomials at a point of projective space, of numbers or polynomials."""
        return list(_exact.monomial_values(self.monomials, x))

    @cached_property
    def _lines(self) -> list[tuple[list[Any], ...]]:
        """Random lines, the map, and its factors on them."""
        known = [self._modular(f) for f in (self.map.common, *self.map.factors)]
        lines: list[tuple[list[Any], ...]] = []
        for _ in range(len(self.exponents) + MORE):
            line = random_line(self.map.map, self.p, self.rng)
            common, *factors = self._restricted(known, line)
            minors = image_by_minors(self.map.map, line)
            lines.append((line, [each // common for each in minors], factors))
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
        """Return equations for the polynomials whose pullback has factor i to this power.

        The polynomial of an invariant hypersurface with the first power vanishes on all iterates
        of the factor's image: there are few unless the singularity is confined.
        """
        rows: Residues = []
        for _, image, factors in self._lines:
            if len(rows) > 2 * len(self.exponents):
                break
            modulus = factors[i] ** power
            if power > 1:
                remainders = [f % modulus for f in self._at(image)]
                rows += [[f[k] for f in remainders] for k in range(modulus.degree())]
            elif roots := modulus.roots():
                rows += self._orbit([f(roots[0][0]) for f in image])
        return self._matrix(rows or [[0] * len(self.exponents)])

    def _orbit(self, x: list[Any]) -> Residues:
        """Return the monomials at iterates of a point."""
        rows: Residues = []
        steps = Arithmetic(self.map.map, self.p)
        while any(x) and len(rows) < _ITERATES:
            rows.append(self._at(x))
            try:
                x = steps.image(x)
            except ZeroDivisionError:  # the singularity may be confined
                break
        return rows

    def _solutions(self, equations: Any, basis: Any) -> Any:
        """Return the combinations of rows of a basis that solve equations; None if only 0 does."""
        chosen = _exact.null_space(equations)
        return self._matrix(chosen) * basis if chosen else None

    def _divisible(self, basis: Any, i: int, power: int) -> Any:
        self.map.pulse()
        return self._solutions(self._equations(i, power) * basis.transpose(), basis)

    def search(self) -> Iterator[tuple[Powers, Fraction | None]]:
        """Yield the powers of invariant spaces, and the constant if there are several for them."""
        total = self.degree * (self.map.delta - 1)
        degrees = [int(f.total_degree()) for f in self.map.factors]
        most, dimension = [0] * len(degrees), [0] * len(degrees)
        for i, exceptional in enumerate(self.map.of_jacobian):
            basis = self.everything if exceptional else None
            while basis is not None and (most[i] + 1) * degrees[i] <= total:
                basis = self._divisible(basis, i, most[i] + 1)
                if basis is not None:
                    most[i], dimension[i] = most[i] + 1, basis.nrows()
        order = sorted((i for i, a in enumerate(most) if a), key=lambda i: (dimension[i], i))
        reach = [*accumulate((most[i] * degrees[i] for i in order[::-1]), initial=0)][::-1]

        def descend(k: int, basis: Any, left: int, powers: Powers) -> Iterator[Any]:
            if left == 0:
                yield basis, powers
            elif k < len(order) and left <= reach[k]:
                i = order[k]
                for power in range(min(most[i], left // degrees[i]) + 1):
                    if power:
                        basis = self._divisible(basis, i, power)
                    if basis is None:
                        break
                    raised = (*powers[:i], power, *powers[i + 1 :])
                    yield from descend(k + 1, basis, left - power * degrees[i], raised)

        for basis, powers in descend(0, self.everything, total, (0,) * len(degrees)):
            _, pulled = self._invariant(basis, powers)
            if pulled is not None:
                for c, _ in pulled.charpoly().roots():
                    several = pulled != self._scalar(c, pulled.nrows())
                    yield powers, _exact.reconstructed(int(c), self.p) if several else None

    def space(self, powers: Powers, c: Fraction | None) -> Residues:
        """Return a basis, in echelon form, of the polynomials with these powers and constant."""
        basis = self.everything
        for i, power in enumerate(powers):
            for k in range(power):
                basis = basis and self._divisible(basis, i, k + 1)
        basis, pulled = self._invariant(basis, powers)
        if basis is not None and c is not None:
            constant = flint.nmod(_exact.fmpq(c), self.p)
            basis = self._solutions(pulled - self._scalar(constant, pulled.nrows()), basis)
        return [] if basis is None else _exact.integer_rows(basis.rref()[0])

    def _scalar(self, c: Any, n: int) -> Any:
        return self._matrix([[int(c) * (i == j) for j in range(n)] for i in range(n)])

    @cached_property
    def _samples(self) -> list[tuple[list[Any], list[Any], list[Any]]]:
        """At random points: the factors, the monomials, and the monomials at the image."""
        samples = []
        for each in self._lines:
            t = flint.nmod(self.rng.randrange(self.p), self.p)
            x, image, factors = ([f(t) for f in polynomials] for polynomials in each)
            samples.append((factors, self._at(x), self._at(image)))
        return samples

    def _invariant(self, basis: Any, powers: Powers) -> tuple[Any, Any]:
        """Return the polynomials with pullbacks ``factors**powers`` times one of them.

        They are the rows of the first matrix. The second one is the pullback in their coordinates.
        """
        while basis is not None:
            r = basis.nrows()
            before, after = [], []
            for factors, here, there in self._samples[: 2 * r + MORE]:
                weight = flint.nmod(1, self.p)
                for a, power in zip(factors, powers, strict=True):
                    weight *= a**power
                before.append([weight * a for a in here])
                after.append(there)
            both = (self._matrix(rows) * basis.transpose() for rows in (before, after))
            joined = [a + b for a, b in zip(*map(_exact.integer_rows, both), strict=True)]
            reduced, rank = self._matrix(joined).rref()
            right = [row[r:] for row in _exact.integer_rows(reduced)[:rank]]
            if rank == r:
                return basis, self._matrix(right)
            basis = self._solutions(self._matrix(right[r:]), basis)
        return None, None
