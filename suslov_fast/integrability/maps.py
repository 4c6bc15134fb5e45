"""Birational maps, exact: Kahan maps of quadratic fields, and what all maps have in common."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import flint
import numpy as np

from ..bodies.field import QuadraticField
from ..checks import wrong
from .exact import (
    Point,
    degree_of,
    factors,
    fmpq,
    fraction,
    modulo,
    random_prime,
    rational,
    rationals,
    ring,
    size,
)
from .functions import RationalFunction, exact_quotient, product_of

TERMS = 20_000  # of the largest polynomial that is written out
_SPARSE = 100  # terms of a component; of sparse maps all polynomials are


class BirationalMap:
    """A map whose components are F_i / F_0, with polynomials F in x without a common factor.

    Called with a point, D rational numbers, it returns the next one, a tuple of fractions. At a
    pole, a point without an image, its methods raise `ZeroDivisionError`.
    """

    dimension: int
    has_letter = False  # whether eps is a letter
    inverse: BirationalMap | None = None

    def steps(self, p: int | None, eps: int = 0) -> Any:
        """Return the steps of the map modulo a prime, or over the rationals for None.

        They have `point`, `image`, `derivative`, `matrix`, `orbit` and `forms`, which returns F at
        homogeneous coordinates of any type, up to a common factor; eps is taken for the letter.
        """
        raise NotImplementedError

    def minors(self, x: Sequence[Any]) -> list[Any]:
        """Return F, up to a common factor, at homogeneous coordinates in the ring of `ring`."""
        raise NotImplementedError

    def jacobian_at(self, x: Sequence[Any], F: Sequence[Any], steps: Any = None) -> tuple[Any, Any]:
        """Return numerator and denominator of det DPhi, given F at homogeneous coordinates x."""
        raise NotImplementedError

    def _with_all_factors(self) -> Iterator[Any]:
        """Yield polynomials of which each factor of F_0 and of det DPhi divides one."""
        raise NotImplementedError

    def _name(self) -> str:
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._name()

    def __call__(self, point: Any) -> tuple[Any, ...]:
        """Return the image of a point, exactly; functions of eps if it is a letter."""
        x = rationals("point", point, self.dimension)
        if self.has_letter:
            *above, below = self.minors(self.constants(x))
            if below == 0:
                raise self._pole(x)
            return tuple(exact_quotient(a, below) if a else RationalFunction((), a) for a in above)
        steps = self.steps(None)
        return tuple(map(fraction, self._at(x, steps.image)[:-1]))

    def jacobian(self, point: Any) -> tuple[Point, ...]:
        """Return the matrix of derivatives at a point, exactly, as a tuple of rows."""
        x = rationals("point", point, self.dimension)
        rows = self._at(x, self.steps(None).derivative).tolist()
        return tuple(tuple(map(fraction, row)) for row in rows)

    def determinant(self, point: Any) -> Fraction:
        """Return the determinant of the matrix of derivatives at a point, exactly."""
        x = rationals("point", point, self.dimension)
        return fraction(self._at(x, self.steps(None).derivative).det())

    def _at(self, x: Point, method: Any) -> Any:
        if self.has_letter:
            raise TypeError("eps: expected a number here, as in map.subs(eps=Fraction(1, 3))")
        try:
            return method([fmpq(a) for a in (*x, 1)])
        except ZeroDivisionError:
            raise self._pole(x) from None

    def _pole(self, x: Point) -> ZeroDivisionError:
        where = ", ".join(map(str, x))
        return ZeroDivisionError(f"({where}) has no image: it is a pole of the map")

    def constants(self, x: Point) -> list[Any]:
        """Return a point as homogeneous coordinates in the ring of the map."""
        scale = math.lcm(*(a.denominator for a in x))
        return [self.ring.constant(int(a * scale)) for a in (*x, 1)]

    @property
    def why_none(self) -> str:
        """Say why there is no map, if there is none."""
        return ""

    @cached_property
    def ring(self) -> Any:
        """The ring of polynomials in x, and eps if it is a letter."""
        return ring(self.dimension, self.has_letter)

    @cached_property
    def forms(self) -> list[Any]:
        """The polynomials F_1, ..., F_D, F_0."""
        minors = self.minors([*self.ring.gens()[self.has_letter :], self.ring.constant(1)])
        common = reduce(lambda a, b: a.gcd(b), minors)
        return [each // common for each in minors]

    @cached_property
    def degree(self) -> int:
        """The degree of the map of projective space."""
        return max(map(degree_of, self.forms))

    def terms(self, degree: int) -> int:
        """Return an upper bound of the number of terms in x of a pullback."""
        return math.comb(self.dimension + degree * self.degree, self.dimension)

    def writes_out(self, degree: int) -> bool:
        """Return True if the pullback of a polynomial is not too long to be written out."""
        longest = max(map(len, self.forms))
        eps = 1 + max(int(F.degrees()[0]) for F in self.forms) if self.has_letter else 1
        return self.terms(degree) * eps <= TERMS or longest <= _SPARSE

    def pullback(self, P: Any, degree: int, at: Sequence[Any] | None = None) -> Any:
        """Return F_0^degree P(F / F_0), for F as polynomials or at a point."""
        k, D = int(self.has_letter), self.dimension
        whole = ring(D + 1, self.has_letter)
        terms = {(*e, degree - sum(e[k:])): c for e, c in P.to_dict().items()}
        values = self.forms if at is None else at
        return whole.from_dict(terms).compose(*self.ring.gens()[:k], *values, ctx=self.ring)

    @cached_property
    def is_invertible(self) -> bool:
        """Whether det DPhi is not 0 everywhere."""
        x = self.constants(
            tuple(map(Fraction, random.Random(0).sample(range(2, 2**20), self.dimension)))
        )
        return bool(self.jacobian_at(x, self.minors(x))[0] != 0)

    @cached_property
    def factors(self) -> list[Any] | None:
        """The irreducible factors of F_0 and of det DPhi; None if they are too long."""
        if not self.is_invertible:
            return None
        found: dict[str, Any] = {}
        for P in self._with_all_factors():
            if P is None:
                return None
            found |= {str(f): f for f, _ in factors(P) if degree_of(f)}
        return sorted(found.values(), key=size)

    def cofactor(self, P: Any) -> RationalFunction | None:
        """Return C with P(Phi) = C P, a product of powers of factors; None if there is none."""
        p = random_prime(rng := random.Random(1))
        eps, k = rng.randrange(p), degree_of(P)
        line = random_line(self.dimension, p, rng)
        F = self.steps(p, eps).reduced(line)
        before, after = (homogeneous_value(modulo(P, p, eps), x, k) for x in (line, F))
        if after % before != 0:
            return None
        return self._as_product(
            after // before,
            F[-1] ** k,
            line,
            (p, eps),
            lambda x, F: (self.pullback(P, k, F), self.pullback(P, k, x) * F[-1] ** k),
        )

    @cached_property
    def jacobian_cofactor(self) -> RationalFunction | None:
        """The determinant of the derivative, as a product of powers of factors."""
        p = random_prime(rng := random.Random(2))
        eps = rng.randrange(p)
        line, steps = random_line(self.dimension, p, rng), self.steps(p, eps)
        F = steps.reduced(line)
        above, below = self.jacobian_at(line, F, steps)
        return self._as_product(above, below, line, (p, eps), self.jacobian_at)

    @cached_property
    def proves_jacobian(self) -> bool:
        """Whether `jacobian_cofactor` is checked as an identity."""
        C = self.jacobian_cofactor
        if C is None or not self.writes_out(self.dimension):
            return False
        x = [*self.ring.gens()[self.has_letter :], self.ring.constant(1)]
        (above, below), (a, b) = self.jacobian_at(x, self.forms), C.quotient_in(self.ring)
        return bool(above * b == below * a)

    def _as_product(self, above: Any, below: Any, line: Any, at: Any, value: Any) -> Any:
        """Return a quotient as a product of powers of factors, given it on a line modulo a prime.

        Its constant is that of ``value(x, F)``, numerator and denominator at a point.
        """
        powers = []
        for f in self.factors or ():
            divisor, power = on_line(modulo(f, *at), line, degree_of(f)), 0
            while above.degree() > 0 and above % divisor == 0:
                above, power = above // divisor, power + 1
            while below.degree() > 0 and below % divisor == 0:
                below, power = below // divisor, power - 1
            powers.append((f, power))
        # What is left may be a power of the hyperplane at infinity, t = 0.
        if any(any(each.coeffs()[:-1]) for each in (above, below)):
            return None
        product, rng = product_of(powers, ""), random.Random(0)
        while True:
            x = self.constants(tuple(Fraction(rng.randrange(2, 99)) for _ in range(self.dimension)))
            F = self.minors(x)
            if F[-1] == 0:
                continue
            a, b = value(x, F)
            for f, e in product.factors:
                scale = self.pullback(f, degree_of(f), x)
                a, b = (a, b * scale**e) if e > 0 else (a * scale**-e, b)
            if a != 0 and b != 0:
                return product * exact_quotient(a, b)


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

    def _name(self) -> str:
        return f"kahan({self.field}{'' if self.eps is None else f', eps={self.eps}'})"

    def __reduce__(self) -> Any:
        return KahanMap, (self.field, self.eps)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, KahanMap) and (self.field, self.eps) == (other.field, other.eps)

    def __hash__(self) -> int:
        return hash((self.field, self.eps))

    @cached_property
    def _rows(self) -> list[list[list[tuple[int, int, int]]]]:
        """The rows of (A | b), forms in x1, ..., xD, 1, of the equations A(x) x~ = b(x).

        A form is a list of (k, a, b), for the terms (a + b eps) x_k. Each row is multiplied by a
        common denominator.
        """
        field, D = self.field, self.dimension
        unit = np.eye(D, dtype=int)
        half = np.array(field.linear, object) / Fraction(2)
        slopes = np.dstack([-np.array(field.quadratic, object), -half])
        b = np.column_stack([half, np.array(field.constant, object)])
        slopes = np.hstack([slopes, b[:, np.newaxis]])
        ones = np.zeros((D, D + 1, D + 1), int)
        ones[:, :D, D], ones[:, D, :D] = unit, unit
        rows = []
        for first, second in zip(ones, slopes, strict=True):
            scale = math.lcm(*(Fraction(a).denominator for a in second.flat))
            pairs = [
                [
                    (k, int(a) * scale, int(b * scale))
                    for k, (a, b) in enumerate(zip(*form, strict=True))
                ]
                for form in zip(first, second, strict=True)
            ]
            rows.append([[term for term in form if any(term[1:])] for form in pairs])
        return rows

    def equations(self, eps: Any, unit: Any = 1) -> Any:
        """Return the rows with numbers (k, c), for eps as a quotient with this denominator."""
        return [
            [[(k, a * unit + b * eps) for k, a, b in form] for form in row] for row in self._rows
        ]

    @cached_property
    def _quotient(self) -> tuple[Any, Any]:
        """The numerator and denominator of eps."""
        if self.eps is None:
            return self.ring.gens()[0], 1
        return self.eps.numerator, self.eps.denominator

    @cached_property
    def _both(self) -> tuple[Any, Any]:
        above, below = self._quotient
        return self.equations(above, below), self.equations(-above, below)

    def steps(self, p: int | None, eps: int = 0) -> _KahanSteps:
        both = (self.equations(e) for e in (eps, -eps)) if self.has_letter else self._both
        return _KahanSteps(p, *both)

    def minors(self, x: Sequence[Any]) -> list[Any]:
        return _cramer(_values(self._both[0], x))

    def jacobian_at(self, x: Sequence[Any], F: Sequence[Any], steps: Any = None) -> tuple[Any, Any]:
        # With det A homogeneous of degree D: det A(F; -eps) / (F_0^D det A(x)), x_0 = 1.
        forward, backward = self._both if steps is None else (steps.forward, steps.backward)
        above, below = _determinant(backward, F), _determinant(forward, x)
        return above, F[-1] ** self.dimension * below

    def _with_all_factors(self) -> Iterator[Any]:
        x = [*self.ring.gens()[self.has_letter :], self.ring.constant(1)]
        yield self.forms[-1]
        yield self.minors(x)[-1]
        for f, _ in factors(_cramer(_values(self._both[1], x))[-1]):
            yield self.pullback(f, degree_of(f)) if self.writes_out(degree_of(f)) else None

    @property
    def why_none(self) -> str:
        steps, rng = self.steps(2**61 - 1, 2**40 + 7), random.Random(0)
        for _ in range(3):
            x = steps.point([rng.randrange(2**60) for _ in range(self.dimension)])
            rows = [row[:-1] for row in _values(steps.forward, x)]
            if steps.matrix(rows).det() != 0:
                return ""
        return f"A = 1 - (eps/2) f'(x) has no inverse at any x for eps = {self.eps}"


class Steps:
    """Steps of a map over the rationals, or modulo a prime p. Points are (x1, ..., xD, 1)."""

    def __init__(self, p: int | None) -> None:
        self.p = p

    def point(self, x: Iterable[Any]) -> list[Any]:
        numbers = map(fmpq, (*x, 1))
        return [*numbers] if self.p is None else [flint.nmod(a, self.p) for a in numbers]

    def matrix(self, rows: Any) -> Any:
        return flint.fmpq_mat(rows) if self.p is None else flint.nmod_mat(rows, self.p)

    def orbit(self, x: Sequence[Any], length: int) -> Iterator[Sequence[Any]]:
        for _ in range(length):
            yield x
            x = self.image(x)

    def reduced(self, line: Sequence[Any]) -> list[Any]:
        """Return F on a line, without a common factor."""
        F = self.forms(line)
        common = reduce(lambda a, b: a.gcd(b), F)
        return [each // common for each in F]

    def image(self, x: Sequence[Any]) -> list[Any]:
        raise NotImplementedError

    def forms(self, x: Sequence[Any]) -> list[Any]:
        raise NotImplementedError


class _KahanSteps(Steps):
    def __init__(self, p: int | None, forward: Any, backward: Any) -> None:
        super().__init__(p)
        self.forward, self.backward = forward, backward

    def _equations(self, equations: Any, x: Sequence[Any]) -> tuple[Any, Any]:
        rows = _values(equations, x)
        return self.matrix([row[:-1] for row in rows]), self.matrix([row[-1:] for row in rows])

    def image(self, x: Sequence[Any]) -> list[Any]:
        A, b = self._equations(self.forward, x)
        return [*A.solve(b).entries(), x[-1] ** 0]

    def derivative(self, x: Sequence[Any]) -> Any:
        backward, _ = self._equations(self.backward, self.image(x))
        return self._equations(self.forward, x)[0].solve(backward)

    def forms(self, x: Sequence[Any]) -> list[Any]:
        return _cramer(_values(self.forward, x))


def _values(equations: Any, x: Sequence[Any]) -> list[list[Any]]:
    zero = 0 * x[-1]
    return [[sum((a * x[k] for k, a in form), zero) for form in row] for row in equations]


def _determinant(equations: Any, x: Sequence[Any]) -> Any:
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


def random_line(dimension: int, p: int, rng: random.Random) -> list[Any]:
    """Return a line modulo a prime; its parameter t is the last coordinate, 0 at infinity."""
    ends = ([rng.randrange(p), rng.randrange(p)] for _ in range(dimension))
    return [flint.nmod_poly(each, p) for each in (*ends, [0, 1])]


def on_line(P: Any, line: Sequence[Any], degree: int) -> Any:
    """Return a polynomial modulo a prime, homogeneous of a degree, on a line; t is the last."""
    p = int(line[-1].modulus())
    of = ring(1, False, flint.nmod_mpoly_ctx, modulus=p)
    by_inverse = [of.from_dict({(0,): int(x[1]), (1,): int(x[0])}) for x in line[:-1]]  # of x / t
    terms = P.compose(*by_inverse, ctx=of).to_dict()
    return flint.nmod_poly([int(terms.get((degree - k,), 0)) for k in range(degree + 1)], p)


def homogeneous_value(P: Any, x: Sequence[Any], degree: int) -> Any:
    """Return x_0^degree P(x / x_0) for coordinates of any type."""
    powers = [[a**k for k in range(degree + 1)] for a in x]
    terms = (
        math.prod(
            (of[k] for of, k in zip(powers, (*e, degree - sum(e)), strict=True)), start=int(c)
        )
        for e, c in P.to_dict().items()
    )
    return sum(terms, 0 * x[-1])


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


def step_size(eps: Any) -> Fraction:
    """Return eps as a fraction."""
    if not isinstance(eps, str):
        return rational("eps", eps)
    try:
        return Fraction(eps)
    except (ValueError, ZeroDivisionError):
        raise wrong("eps", "a number such as 1/3 or 0.1", repr(eps)) from None


def check_map(map: Any) -> None:
    """Raise an error for anything but a map, and for equations that define none."""
    if not isinstance(map, BirationalMap):
        expected = "a map, as kahan(field, eps) or rational_map(f, dimension) returns it"
        raise wrong("map", expected, type(map).__name__, TypeError)
    if map.why_none:
        raise ArithmeticError(f"{map} is no map: {map.why_none}")
