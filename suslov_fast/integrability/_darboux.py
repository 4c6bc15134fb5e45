"""Search for the Darboux polynomials of all cofactors."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property, partial
from itertools import accumulate
from typing import Any

import flint
import numpy as np

from . import _exact
from ._exact import Polynomials, Residues
from ._maps import Arithmetic, cramer, evaluate
from ._projective import Projective

Powers = tuple[int, ...]  # of the hyperplane at infinity and of the factors of the map
Pulse = Callable[[], object]  # called often; it may raise an error
_MORE = 10  # equations more than unknowns
_ITERATES = 6  # of a point on a factor


@dataclass(frozen=True)
class InvariantSpace:
    """All polynomials of a degree whose pullback is a constant times them and these powers."""

    degree: int
    powers: Powers
    polynomials: Polynomials


def invariant_spaces(
    map: Projective, degree: int, affine: int, pulse: Pulse = lambda: None
) -> tuple[InvariantSpace, ...]:
    """Return the spaces of Darboux polynomials of a degree over the rationals.

    The factors of the map must be known. A polynomial of lower degree, of at most `affine` if that
    is less than `degree`, has powers of the hyperplane at infinity as a factor.
    """
    if (degree, affine) not in map.spaces:
        rng, spaces = random.Random(degree), []
        pullbacks = cache(partial(_Pullbacks, map, degree, affine))
        first = pullbacks(_exact.random_prime(rng))
        for powers, c in [*first.search(pulse)]:

            def residues(p: int, powers: Powers = powers, c: Fraction | None = c) -> Residues:
                pulse()
                return pullbacks(p).space(powers, c)

            if rows := _exact.over_rationals(random.Random(degree), residues):
                polynomials = _exact.polynomials_with(rows, first.exponents)
                spaces.append(InvariantSpace(degree, powers, polynomials))
        map.spaces[degree, affine] = tuple(spaces)
    return map.spaces[degree, affine]


class _Pullbacks:
    """Pullbacks of the polynomials of a degree, modulo a prime; columns are monomials."""

    def __init__(self, map: Projective, degree: int, affine: int, p: int) -> None:
        self.map, self.degree, self.p, self.rng = map, degree, p, random.Random(p)
        self.exponents = _exact.exponents_up_to(affine, map.D)
        self.monomials = tuple((degree - sum(e), *e) for e in self.exponents)
        self.everything = self._matrix(np.eye(len(self.exponents), dtype=int).tolist())
        self.forms = Arithmetic(map.map, p).forward
        self.F = [_exact.modulo(F, p) for F in map.F]
        self.factors = [_exact.modulo(f, p) for f in map.factors or ()]
        self._vanishing = cache(self._rows)

    def _matrix(self, rows: Any) -> Any:
        return flint.nmod_mat(rows, self.p)

    def _random(self) -> list[int]:
        return [self.rng.randrange(self.p) for _ in range(self.map.D)]

    def _at(self, X: Any) -> list[Any]:
        """Return all monomials at a point of projective space, of numbers or polynomials."""
        return list(_exact.monomial_values(self.monomials, X))

    @cached_property
    def _samples(self) -> list[tuple[list[Any], list[Any], list[Any]]]:
        """At random points: the factors, the monomials, and the monomials at the image."""

        def numbers(values: Any) -> list[Any]:
            return [flint.nmod(int(a), self.p) for a in values]

        return [
            (
                numbers([1, *(f(*x) for f in self.factors)]),
                self._at(numbers([1, *x])),
                self._at(numbers(F(*x) for F in self.F)),
            )
            for x in (self._random() for _ in range(len(self.exponents) + _MORE))
        ]

    @cached_property
    def _lines(self) -> list[tuple[list[Any], ...]]:
        """F and the factors on random lines."""
        ring = flint.nmod_mpoly_ctx.get(["t"], ordering="deglex", modulus=self.p)

        def on_line(f: Any, line: Any) -> Any:
            terms = f.compose(*line, ctx=ring).to_dict()
            top = max((e for (e,) in terms), default=0)
            return flint.nmod_poly([int(terms.get((e,), 0)) for e in range(top + 1)], self.p)

        lines = []
        for _ in range(len(self.exponents) + _MORE):
            ends = zip(self._random(), self._random(), strict=True)
            line = [ring.from_dict({(0,): a, (1,): b}) for a, b in ends]
            both = ([on_line(f, line) for f in each] for each in (self.F, self.factors))
            lines.append(tuple(both))
        return lines

    def _rows(self, i: int, power: int) -> Any:
        """Return rows orthogonal to polynomials whose pullback has this power of factor i.

        The polynomial of an invariant hypersurface with the first power vanishes on all iterates
        of the factor's image: there are few unless the singularity is confined.
        """
        rows: Residues = []
        for F, factors in self._lines:
            if len(rows) <= 2 * len(self.exponents):
                K = factors[i - 1] if i else None
                rows += self._on_orbit(F, K) if power == 1 else self._on_line(F, K, power)
        return self._matrix(rows or [[0] * len(self.exponents)])

    def _on_orbit(self, F: list[Any], K: Any) -> Residues:
        if K is None:
            X = [f[self.map.delta] for f in F]
        elif roots := K.roots():
            X = [f(roots[0][0]) for f in F]
        else:
            return []
        rows: Residues = []
        while any(X) and len(rows) < _ITERATES:
            rows.append(self._at(X))
            try:
                constants = [flint.nmod_poly([int(a)], self.p) for a in X]
                X = [a[0] for a in cramer(evaluate(self.forms, constants))]
            except ZeroDivisionError:  # the singularity may be confined
                break
        return rows

    def _on_line(self, F: list[Any], K: Any, power: int) -> Residues:
        polynomials, top = self._at(F), self.degree * self.map.delta
        places = range(top - power + 1, top + 1)
        if K is not None:
            places = range((K**power).degree())
            polynomials = [each % K**power for each in polynomials]
        return [[each[k] for each in polynomials] for k in places]

    def _solutions(self, equations: Any, basis: Any) -> Any:
        """Return the combinations of rows of a basis that solve equations; None if only 0 does."""
        columns, dimension = equations.nullspace()
        chosen = _exact.integer_rows(columns.transpose())[:dimension]
        return self._matrix(chosen) * basis if chosen else None

    def _divisible(self, basis: Any, i: int, power: int) -> Any:
        return self._solutions(self._vanishing(i, power) * basis.transpose(), basis)

    def search(self, pulse: Pulse) -> Iterator[tuple[Powers, Fraction | None]]:
        """Yield the powers of invariant spaces, and the constant if there are several for them."""
        total, degrees = self.degree * (self.map.delta - 1), self.map.degrees
        most, size = [0] * len(degrees), [0] * len(degrees)
        for i, a in enumerate(self.map.of_jacobian):
            basis = self.everything
            while a > 0 and basis is not None and (most[i] + 1) * degrees[i] <= total:
                pulse()
                basis = self._divisible(basis, i, most[i] + 1)
                if basis is not None:
                    most[i], size[i] = most[i] + 1, basis.nrows()
        order = sorted((i for i, a in enumerate(most) if a), key=lambda i: (size[i], i))
        reach = [*accumulate((most[i] * degrees[i] for i in order[::-1]), initial=0)][::-1]

        def descend(k: int, basis: Any, left: int, powers: Powers) -> Iterator[Any]:
            pulse()
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
                eigenvalues = [int(c) for c, _ in pulled.charpoly().roots()]
                for c in eigenvalues:
                    several = pulled != self._scalar(c, pulled.nrows())
                    yield powers, _exact.reconstructed(c, self.p) if several else None

    def space(self, powers: Powers, c: Fraction | None) -> Residues:
        """Return a basis, in echelon form, of the polynomials with these powers and constant."""
        basis = self.everything
        for i, power in enumerate(powers):
            for k in range(power):
                basis = basis and self._divisible(basis, i, k + 1)
        basis, pulled = self._invariant(basis, powers)
        if basis is not None and c is not None:
            constant = int(flint.nmod(_exact.fmpq(c), self.p))
            basis = self._solutions(pulled - self._scalar(constant, pulled.nrows()), basis)
        return [] if basis is None else _exact.integer_rows(basis.rref()[0])

    def _scalar(self, c: int, n: int) -> Any:
        return self._matrix((c * np.eye(n, dtype=object)).tolist())

    def _invariant(self, basis: Any, powers: Powers) -> tuple[Any, Any]:
        """Return the polynomials with pullbacks ``factors**powers`` times one of them.

        They are the rows of the first matrix. The second one is the pullback in their coordinates.
        """
        while basis is not None:
            r = basis.nrows()
            before, after = [], []
            for factors, here, there in self._samples[: 2 * r + _MORE]:
                weight = flint.nmod(1, self.p)
                for a, power in zip(factors, powers, strict=True):
                    weight *= a**power
                before.append([weight * a for a in here])
                after.append(there)
            both = (self._matrix(rows) * basis.transpose() for rows in (before, after))
            joined = [[*a, *b] for a, b in zip(*map(_exact.integer_rows, both), strict=True)]
            reduced, rank = self._matrix(joined).rref()
            right = [row[r:] for row in _exact.integer_rows(reduced)[:rank]]
            if rank == r:
                return basis, self._matrix(right)
            basis = self._solutions(self._matrix(right[r:]), basis)
        return None, None
