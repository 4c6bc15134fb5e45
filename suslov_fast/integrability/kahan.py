"""Kahan maps of quadratic fields, exact."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from typing import Any

from ..bodies.field import QuadraticField
from ..bodies.polynomials import terms_of
from ..checks import wrong
from .exact import degree_of, step_size
from .functions import exact_quotient
from .maps import TERMS, BirationalMap, Steps


class KahanMap(BirationalMap):
    """The Kahan map of a quadratic field, exact; made by `kahan`.

    Called with a point, D rational numbers, it returns the next one, a tuple of fractions. At a
    pole, a point without an image, its methods raise `ZeroDivisionError`. If its `eps` is None, it
    is a letter: `subs` puts a number in its place.
    """

    def __init__(self, field: QuadraticField, eps: Fraction | None) -> None:
        self.field, self.eps = field, eps
        self.dimension, self.has_letter = field.dimension, eps is None

    @cached_property
    def inverse(self) -> KahanMap:  # type: ignore[override]
        """The inverse map, which is the Kahan map of the same field with -eps."""
        if self.eps is None:
            raise TypeError("eps: expected a number here, as in map.subs(eps=Fraction(1, 3))")
        return KahanMap(self.field, -self.eps)

    def subs(self, eps: Any) -> KahanMap:
        """Return the map for a value of eps."""
        return kahan(self.field, eps)

    def __repr__(self) -> str:
        return f"kahan({self.field}{'' if self.eps is None else f', eps={self.eps}'})"

    def __reduce__(self) -> Any:
        return KahanMap, (self.field, self.eps)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, KahanMap) and (self.field, self.eps) == (other.field, other.eps)

    def __hash__(self) -> int:
        return hash((self.field, self.eps))

    @cached_property
    def _rows(self) -> list[Any]:
        """The rows of (A | b) of the equations A(x) x~ = b(x), times a common denominator.

        Entries are lists of (j, a, b), for the terms (a + b eps) x_j of forms in x1, ..., xD, 1.
        """
        D, rows = self.dimension, []
        for i, table in enumerate(self.field.table):
            scale = math.lcm(*(c.denominator for c in table.flat))
            ones = [D] * D + [i]  # A is the unit matrix at eps = 0, and b is x
            signs = [-scale] * D + [scale]
            rows.append(
                [
                    [
                        (j, scale * (k in (i, D) and j == ones[k]), int(signs[k] * table[j, k]))
                        for j in range(D + 1)
                    ]
                    for k in range(D + 1)
                ]
            )
        return rows

    def _equations(self, eps: Any, denominator: int = 1) -> Any:
        """Return the rows with terms (j, c), multiplied by the denominator of eps."""
        return [
            [[(j, a * denominator + b * eps) for j, a, b in form if a or b] for form in row]
            for row in self._rows
        ]

    @cached_property
    def _both(self) -> tuple[Any, Any]:
        """The equations of the map and of its inverse."""
        if self.eps is None:
            eps, denominator = self.ring.gens()[0], 1
        else:
            eps, denominator = self.eps.numerator, self.eps.denominator
        return self._equations(eps, denominator), self._equations(-eps, denominator)

    def steps(self, p: int | None, eps: int = 0) -> _KahanSteps:
        if self.has_letter and p is not None:
            return _KahanSteps(p, self._equations(eps), self._equations(-eps))
        return _KahanSteps(p, *self._both)

    def _parts_of_determinant(self) -> Iterator[tuple[Any, int]]:
        # With det A homogeneous of degree D: det A(F; -eps) / (F_0^D det A(x; eps)).
        forward, backward = (_determinant(each, self.variables) for each in self._both)
        whole = exact_quotient(backward, self.ring.constant(1))
        yield self.ring.constant(int(whole.constant)), 1
        yield self.forms[-1], -sum(degree_of(f) * e for f, e in whole.factors)
        yield forward, -1
        for f, e in whole.factors:
            P = self.pullback(f, degree_of(f)) if self.writes_out(degree_of(f)) else None
            yield P if P is not None and len(P) <= 3 * TERMS else None, e

    @property
    def why_none(self) -> str:
        rng, steps = random.Random(0), self.steps(2**61 - 1, 2**40 + 7)
        x = steps.point([rng.randrange(2**60) for _ in range(self.dimension)])
        if steps.system(steps.forward, x)[0].det() != 0:
            return ""
        return f"A = 1 - (eps/2) f'(x) has no inverse at any x for eps = {self.eps}"

    @cached_property
    def hamiltonian(self) -> Any:
        """An integer multiple of H of a field K grad H, in `ring`; None for other fields."""
        field, D = self.field, self.dimension
        if field.H is None:
            return None
        terms = terms_of(field.H.tensor)

        def H(x: Any) -> Any:
            return sum(math.prod((x[i] for i in powers), start=c) for powers, c in terms.items())

        # H and K of a field in a file of a batch are rounded.
        if QuadraticField.from_hamiltonian(H, D, field.K) != field:
            return None
        scale, letter = math.lcm(*(c.denominator for c in terms.values())), (0,) * self.has_letter
        return self.ring.from_dict(
            {(*letter, *map(e.count, range(D))): int(c * scale) for e, c in terms.items()}
        )


class _KahanSteps(Steps):
    """Steps with the equations of the map and of its inverse."""

    def __init__(self, p: int | None, forward: Any, backward: Any) -> None:
        super().__init__(p)
        self.forward, self.backward = forward, backward

    def system(self, equations: Any, x: Sequence[Any]) -> tuple[Any, Any]:
        """Return the matrices A and b at a point."""
        rows = _values(equations, x)
        return self.matrix([row[:-1] for row in rows]), self.matrix([row[-1:] for row in rows])

    def image(self, x: Sequence[Any]) -> list[Any]:
        A, b = self.system(self.forward, x)
        return [*A.solve(b).entries(), x[-1] ** 0]

    def derivative(self, x: Sequence[Any]) -> Any:
        # DPhi is A(x; eps)^-1 A(Phi(x); -eps).
        backward, _ = self.system(self.backward, self.image(x))
        return self.system(self.forward, x)[0].solve(backward)

    def forms(self, x: Sequence[Any]) -> list[Any]:
        return _cramer(_values(self.forward, x))


def _values(equations: Any, x: Sequence[Any]) -> list[list[Any]]:
    zero = 0 * x[-1]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in equations]


def _determinant(equations: Any, x: Sequence[Any]) -> Any:
    """Return det A, homogeneous of degree D."""
    try:
        return _cramer(_values(equations, x))[-1]
    except ZeroDivisionError:
        return 0 * x[-1]


def _cramer(system: list[list[Any]]) -> list[Any]:
    """Return the numerators of the solution of a linear system (A | b), and det A.

    Elimination without fractions (Bareiss).
    """
    n, previous = len(system), 1
    for k in range(n):
        pivot = next((i for i in range(k, n) if system[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        if pivot != k:  # the determinant keeps its sign
            system[k], system[pivot] = system[pivot], [-a for a in system[k]]
        top = system[k]
        for row in system[:k] + system[k + 1 :]:
            for j in range(k + 1, n + 1):
                row[j] = (top[k] * row[j] - row[k] * top[j]) // previous
        previous = top[k]
    return [*(row[n] for row in system), previous]


def kahan(field: QuadraticField, eps: Any = None) -> KahanMap:
    """Return the Kahan map of a field, ``(x~ - x) / eps = q(x, x~) + l((x + x~) / 2) + c``.

    Parameters
    ----------
    field : QuadraticField
        The field to discretize, a single one.
    eps : int, Fraction, float or str, optional
        Step size, of any sign. A float is taken exactly; a string may be "1/3" or "0.1". Without
        it, eps is a letter in all that is found for the map.

    Returns
    -------
    KahanMap
        It is callable, and has `inverse`, `jacobian`, `determinant`, `dimension`, `field`, `eps`,
        and `subs`.

    Raises
    ------
    TypeError, ValueError
        If an argument has a wrong type or value, or the field is a batch.

    Examples
    --------
    >>> from suslov_fast import QuadraticField
    >>> from suslov_fast.integrability import kahan
    >>> map = kahan(QuadraticField([[[1]]]), eps=1)  # x' = x**2
    >>> [str(x) for x in map([2])], [str(x) for x in map.inverse([-2])]
    (['-2'], ['2'])
    >>> kahan(map.field)([2])
    (-2/(2*eps - 1),)
    """
    if not isinstance(field, QuadraticField):
        raise wrong("field", "QuadraticField", type(field).__name__, TypeError)
    if field.shape:
        raise wrong("field", "a single field", f"a batch of shape {field.shape}")
    return KahanMap(field, None if eps is None else step_size(eps))
