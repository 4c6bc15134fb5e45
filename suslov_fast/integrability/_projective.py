"""A Kahan map as a map of projective space, and the factors of its derivative's determinant."""

from __future__ import annotations

import contextlib
import math
import random
from collections.abc import Callable
from functools import cached_property, reduce
from typing import Any

from . import _exact
from ._functions import size
from ._maps import KahanMap, image_by_minors

TERMS = 20_000  # of the largest polynomial that is written out
_SPARSE = 100  # terms of a component; of sparse maps all polynomials are


class Projective:
    """The map as homogeneous polynomials (F_1, ..., F_D, F_0) without a common factor.

    F_i / F_0 are the components of the map. The last variable is 1, or 0 at infinity.

    A hypersurface P = 0 is invariant if P(F) is a constant times P and powers of `factors`. If P
    has degree k, and F degree `delta`, their degrees add up to k (delta - 1).
    """

    def __init__(self, map: KahanMap, pulse: Callable[[], object] = lambda: None) -> None:
        self.map, self.D = map, map.dimension
        self.pulse = pulse  # called often; it may raise an error
        self.ring, self.affine_ring = (_exact.polynomial_ring(self.D + k) for k in (1, 0))
        minors = image_by_minors(map, self.ring.gens())
        self.determinant = minors[-1]  # of A, up to a constant
        self.common = reduce(lambda a, b: a.gcd(b), minors)
        self.F = [each // self.common for each in minors]
        self.delta = int(self.F[-1].total_degree())
        self.backward = None  # the determinant of the inverse, if there is one
        with contextlib.suppress(ZeroDivisionError):
            backward = image_by_minors(map.inverse, self.ring.gens())[-1]
            rng = random.Random(0)
            x = [rng.randrange(2**30) for _ in range(self.D + 1)]
            if _exact.value_at(backward, [_exact.value_at(f, x) for f in self.F]) != 0:
                self.backward = backward

    def homogeneous(self, P: Any, degree: int) -> Any:
        return self.ring.from_dict({(*e, degree - sum(e)): c for e, c in P.to_dict().items()})

    def affine(self, P: Any) -> Any:
        return self.affine_ring.from_dict({e[:-1]: c for e, c in P.to_dict().items()})

    def terms(self, degree: int) -> int:
        """Return an upper bound of the number of terms of a pullback."""
        return math.comb(self.D + degree * self.delta, self.D)

    def pullback(self, P: Any) -> Any:
        """Return P(F) for a homogeneous polynomial P."""
        return P.compose(*self.F, ctx=self.ring)

    @cached_property
    def affine_factors(self) -> list[Any] | None:
        """The irreducible factors of the denominator and of det DPhi.

        None if they are too large, or if there is no inverse.
        """
        if self.backward is None:
            return None
        sparse = max(map(len, self.F)) <= _SPARSE
        found = self._factors(self.F[-1]) + self._factors(self.determinant)
        for f in self._factors(self.backward):
            degree = int(f.total_degree())
            if self.terms(degree) > TERMS and not sparse:
                return None
            found += self._factors(self.pullback(self.homogeneous(f, degree)))
        return sorted({str(f): f for f in found}.values(), key=size)

    @cached_property
    def factors(self) -> list[Any]:
        """The last variable, and the homogeneous factors."""
        factors = self.affine_factors or ()
        others = (self.homogeneous(f, int(f.total_degree())) for f in factors)
        return [self.ring.gens()[-1], *others]

    def _factors(self, P: Any) -> list[Any]:
        return [f for f, _ in _exact.factors(self.affine(P))]

    def valuation(self, P: Any) -> list[int]:
        """Return the exponents of the factors in a polynomial."""
        exponents = []
        for f in self.factors:
            exponents.append(0)
            while P % f == 0:
                P, exponents[-1] = P // f, exponents[-1] + 1
        return exponents

    @cached_property
    def of_denominator(self) -> list[int]:
        """The exponents of the factors in F_0, divided by the last variable."""
        infinity, *others = self.valuation(self.F[-1])
        return [infinity - 1, *others]

    @cached_property
    def of_determinant(self) -> list[int]:
        """The exponents of the factors in det DPhi, the quotient of det A of inverse and map."""
        above = self.valuation(self.pullback(self.backward))
        below = zip(self.of_denominator, self.valuation(self.determinant), strict=True)
        return [a - self.D * b - c for a, (b, c) in zip(above, below, strict=True)]

    @cached_property
    def of_jacobian(self) -> list[int]:
        """The exponents of the factors in the Jacobian determinant of F."""
        pairs = zip(self.of_determinant, self.of_denominator, strict=True)
        return [a + (self.D + 1) * b for a, b in pairs]
