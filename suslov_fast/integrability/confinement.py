"""Proofs of what becomes of a contracted curve: orders of a germ, and that an orbit never ends.

Orders are exact for a line with rational coefficients, whose points are a + s b: the coordinates of
the germ are then polynomials in s, and in eps if it is symbolic. Those of conjugate lines are
exact if they are multiplicities of the forms at the points of the orbit, which is computed in the
number field of a point of the curve.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from fractions import Fraction
from functools import reduce
from typing import Any

import flint

from . import arithmetic
from .arithmetic import value_at
from .contracted import Passage, Plane, Residues
from .maps import coprime

_TERMS = 4, 8, 16  # of power series in t
_BITS = 20_000  # of the coefficients of coordinates, at most
_MONOMIALS = 2_000  # of coordinates, at most
_SMALL_PRIMES = (5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79)
_TRIES = 3  # points and numbers in place of eps for each of these
_PERIODS = 1, 2, 3  # of invariant lines
_EXACT = 12  # points of an orbit that are looked at over the rationals


def is_proved(plane: Plane, number: int, passage: Passage) -> bool:
    """Return True if the steps of a passage are exact, up to its end or its last point of no image.

    The orders modulo a prime are at least the true ones, so those that are 0 are exact.
    """
    if passage.endless:
        return False
    if not passage.common:
        return passage.steps is None
    if plane.degrees[number] == 1:
        return _is_exact_on_a_line(plane, number, passage)
    if any(passage.common[:-1]) or passage.steps is None:
        return False
    return _is_exact_in_a_field(plane, number, passage)


def _is_exact_on_a_line(plane: Plane, number: int, passage: Passage) -> bool:
    """Follow a germ with polynomials in eps, s and t as coordinates."""
    names = ["eps"] * plane.letter + ["s", "t"]
    of = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
    *eps, s, t = of.gens()
    line = [_coefficient(plane, number, j, of) for j in range(3)]
    pivot = next(j for j in range(3) if line[j] != 0)
    i, j = (k for k in range(3) if k != pivot)
    u, v = 2 + 3 * s, 5 + 7 * s
    start = [of.constant(0)] * 3
    start[i], start[j] = line[pivot] * u, line[pivot] * v
    start[pivot] = t - line[i] * u - line[j] * v
    for most in _TERMS:
        x, terms, found = start, most, []
        for _ in range(len(passage.common) + 1):
            y = [_cut(F.compose(*eps, *x, ctx=of), terms) for F in plane.forms]
            met = [_order(_cut(C.compose(*eps, *x, ctx=of), terms), terms) for C in plane.curves]
            order = min(_order(P, terms) for P in y)
            if order == terms:
                break
            x, terms = _without_content([_divided(P, order) for P in y], of), terms - order
            if _size(x) > _BITS or sum(map(len, x)) > _MONOMIALS:
                return False
            found.append((order, tuple(met)))
        else:
            expected = [*zip(passage.common, passage.met, strict=True)]
            if found[1:] == expected:
                return _is_constant(x, of) == (passage.steps is None)
    return False


def _coefficient(plane: Plane, number: int, j: int, of: Any) -> Any:
    """Return the coefficient of a coordinate in the equation of a line."""
    k = plane.letter
    terms = {(*e[:k], 0, 0): c for e, c in plane.curves[number].to_dict().items() if e[k + j]}
    return of.from_dict(terms)


def _cut(P: Any, terms: int) -> Any:
    return P.context().from_dict({e: c for e, c in P.to_dict().items() if e[-1] < terms})


def _order(P: Any, terms: int) -> int:
    return min((int(e[-1]) for e in P.monoms()), default=terms)


def _divided(P: Any, order: int) -> Any:
    terms = P.to_dict().items()
    return P.context().from_dict({(*e[:-1], e[-1] - order): c for e, c in terms})


def _without_content(x: Sequence[Any], of: Any) -> list[Any]:
    """Divide polynomials by their common factor that does not depend on t."""
    common = of.constant(0)
    for P in x:
        parts: dict[int, dict[Any, Any]] = {}
        for e, c in P.to_dict().items():
            parts.setdefault(int(e[-1]), {})[(*e[:-1], 0)] = c
        for part in parts.values():
            common = common.gcd(of.from_dict(part))
    return [P // common for P in x]


def _size(x: Sequence[Any]) -> int:
    return max((int(abs(c)).bit_length() for P in x for c in P.coeffs()), default=0)


def _is_constant(x: Sequence[Any], of: Any) -> bool:
    """Return True if a germ begins at a point that does not depend on s."""
    first = coprime([_cut(P, 1) for P in x])
    return all(e[-2] == 0 for P in first for e in P.monoms())


def _is_exact_in_a_field(plane: Plane, number: int, passage: Passage) -> bool:
    """Follow the orbit of a point of a curve, with coordinates in a field with this point."""
    field = _Field(plane, number)
    if field.modulus is None:
        return False
    x = field.start
    for k in range(len(passage.common) + 1):
        if k:
            orders = [*zip(plane.curves, passage.met[k - 1], strict=True)]
            orders += [(F, passage.common[k - 1]) for F in plane.forms]
            if not all(_has_multiplicity(P, order, x, field) for P, order in orders):
                return False
        y = field.values(plane.forms, x)
        is_base_point = all(a == 0 for a in y)
        if is_base_point or k == len(passage.common):
            return is_base_point and k == len(passage.common)
        x = _without_content(y, field.of)
        if _size(x) > _BITS or sum(map(len, x)) > _MONOMIALS:
            return False
    return False


def _has_multiplicity(P: Any, order: int, x: Sequence[Any], field: _Field) -> bool:
    """Return True if all derivatives of a form below this order vanish at a point."""
    forms, first = [P] if order else [], P.context().nvars() - 3
    for _ in range(order - 1):
        forms = [each.derivative(first + j) for each in forms for j in range(3)]
    return all(a == 0 for a in field.values(forms, x))


class _Field:
    """The field of the coordinates of a point of a curve: polynomials in s modulo another one.

    Their coefficients are integers, or polynomials in eps; homogeneous coordinates need no others.
    """

    def __init__(self, plane: Plane, number: int) -> None:
        names = ["eps"] * plane.letter + ["s"]
        self.of = flint.fmpz_mpoly_ctx.get(names, ordering="deglex")
        *self._eps, s = self.of.gens()
        self.start = [2 + 3 * s, 5 + 7 * s, 11 - 4 * s]
        self.modulus: Any = None  # of a point of one component; conjugate ones behave alike
        on_line = plane.curves[number].compose(*self._eps, *self.start, ctx=self.of)
        for factor, _ in arithmetic.factors(on_line):
            if _degree_in_s(factor) > 0:
                self.modulus = factor

    def values(self, forms: Sequence[Any], x: Sequence[Any]) -> list[Any]:
        """Return the values of forms at a point, times a common factor."""
        found = [F.compose(*self._eps, *x, ctx=self.of) for F in forms]
        n, (*_, s) = _degree_in_s(self.modulus), self.of.gens()
        leading = self._coefficient(self.modulus, n)
        for k in range(max(map(_degree_in_s, found), default=0), n - 1, -1):
            found = [
                leading * P - self._coefficient(P, k) * s ** (k - n) * self.modulus for P in found
            ]
        return found

    def _coefficient(self, P: Any, k: int) -> Any:
        terms = {(*e[:-1], 0): c for e, c in P.to_dict().items() if e[-1] == k}
        return self.of.from_dict(terms)


def _degree_in_s(P: Any) -> int:
    return max((int(e[-1]) for e in P.monoms()), default=-1)


# An orbit that never comes to a point without an image.


def why_never(plane: Plane, number: int, passage: Passage) -> str:
    """Return why an orbit never ends after its last point without an image; "" if unknown."""
    for p in _SMALL_PRIMES:
        rng = random.Random(p)
        for _ in range(_TRIES):
            eps = rng.randrange(1, p)
            if _never_ends_modulo(Residues(plane, p, eps, rng.randrange(99)), number, passage):
                at = f" and eps = {eps}" if plane.letter else ""
                return f"never, since modulo {p}{at} the orbit is periodic"
    return "" if passage.common else _never_on_a_line(plane, number)


def _never_ends_modulo(residues: Residues, number: int, passage: Passage) -> bool:
    """Return True if the orbit modulo a prime is periodic, and all its points have images.

    A point of the curve modulo p at which the curve is smooth is that of one over p-adic numbers;
    if images do not vanish modulo p, they are those of the true orbit.
    """
    if any(P == 0 for P in (*residues.forms, residues.curves[number])):
        return False
    germ, terms = residues.germ(residues.curves[number]), 1 + sum(passage.common)
    for expected in (0, *passage.common):
        if germ is None or (step := residues.step(germ, terms)) is None:
            return False
        germ, order, _ = step
        terms -= order
        if order != expected:
            return False
    x = [P[0] for P in germ or ()]
    seen = set()
    while any(x):
        pivot = next(a for a in x if a)
        point = tuple(int(a / pivot) for a in x)
        if point in seen:
            return True
        seen.add(point)
        x = [value_at(F, x) for F in residues.forms]
    return False


def _never_on_a_line(plane: Plane, number: int) -> str:
    """Decide about the orbit of a rational line on invariant lines, on which the map is Moebius.

    If eps is symbolic, one number in its place suffices.
    """
    if plane.degrees[number] != 1:
        return ""
    for eps in (Fraction(3, 7), Fraction(2, 5)) if plane.letter else (None,):
        now = plane if eps is None else Plane(plane.map.subs(eps))  # type: ignore[attr-defined]
        lines = [k for k, degree in enumerate(now.degrees) if degree == 1]
        wanted = plane.curves[number]
        if eps is not None:
            here = arithmetic.modulo(wanted, 0, arithmetic.fmpq(eps)).to_dict()
            scale = math.lcm(*(int(c.q) for c in here.values()))
            whole = now.ring.from_dict({e: (c * scale).p for e, c in here.items()})
            wanted = arithmetic.primitive(whole)
        found = next((k for k in lines if now.curves[k] == wanted), None)
        if found is not None and (reason := _on_invariant_lines(now, found)):
            return reason
    return ""


def _on_invariant_lines(plane: Plane, number: int) -> str:
    """Return how invariant lines decide that an orbit never ends; "" if they do not."""
    orbit = [_point_of(plane, number)]
    for _ in range(_EXACT):
        x = _image(plane, orbit[-1])
        if x is None or max(map(abs, x)).bit_length() > _BITS:
            break
        if x in orbit:
            return f"never, since the orbit is periodic, of period {len(orbit) - orbit.index(x)}"
        orbit.append(x)
    for period in _PERIODS:
        if len(orbit) > 2 * period:
            starts = [(orbit[k], orbit[k + period]) for k in range(period)]
            if all(_avoids(plane, first, second, period) for first, second in starts):
                which = "an invariant line" if period == 1 else f"{period} lines that are permuted"
                return f"never, since the orbit is on {which}, with a Moebius transformation"
    return ""


def _point_of(plane: Plane, number: int) -> tuple[int, ...]:
    """Return the point to which a line with rational coefficients goes."""
    line = [int(plane.curves[number].derivative(j).leading_coefficient() or 0) for j in range(3)]
    rng = random.Random(0)
    while True:
        x = _cross(line, [rng.randrange(-50, 50) for _ in range(3)])
        if any(x) and (y := _image(plane, x)) is not None:
            return y


def _image(plane: Plane, x: Sequence[int]) -> tuple[int, ...] | None:
    """Return the image of a point with integer coordinates; None if it has none."""
    y = [int(value_at(F, x)) for F in plane.forms]
    if not (common := math.gcd(*y)):
        return None
    sign = 1 if next(a for a in y if a) > 0 else -1
    return tuple(sign * a // common for a in y)


def _avoids(plane: Plane, x: Sequence[int], y: Sequence[int], period: int) -> bool:
    """Return True if the line through x and y is invariant, and the orbit of x never ends there."""
    # Two other points of the line, a and b.
    a, b = ([c * u + d * v for u, v in zip(x, y, strict=True)] for c, d in ((31, 17), (-13, 43)))
    line = [flint.fmpz_poly([u, v]) for u, v in zip(a, b, strict=True)]  # a + s b
    images = [value_at(F, line) for F in plane.forms]
    ends = reduce(lambda P, Q: P.gcd(Q), images)  # points of the line without an image
    for _ in range(period - 1):
        images = [value_at(F, coprime(images)) for F in plane.forms]
    images = coprime(images)
    normal = _cross(a, b)
    if sum((n * P for n, P in zip(normal, images, strict=True)), flint.fmpz_poly([0])) != 0:
        return False
    i, j = next((i, j) for i in range(3) for j in range(i) if a[i] * b[j] != a[j] * b[i])
    # (u, v) = image of s: the parameter of a point z is (z x a) / (b x z) in the coordinates i, j.
    above = images[i] * a[j] - images[j] * a[i]
    below = b[i] * images[j] - b[j] * images[i]
    above, below = coprime([above, below])
    if max(above.degree(), below.degree()) != 1:
        return False
    start = Fraction(x[i] * a[j] - x[j] * a[i], b[i] * x[j] - b[j] * x[i])
    matrix = [[int(above[1]), int(above[0])], [int(below[1]), int(below[0])]]
    roots = [f for f, _ in ends.factor()[1] if f.degree() == 1] if ends.degree() > 0 else []
    return all(_never_meets(matrix, start, Fraction(-int(f[0]), int(f[1]))) for f in roots)


def _cross(a: Sequence[int], b: Sequence[int]) -> list[int]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _never_meets(matrix: list[list[int]], start: Fraction, end: Fraction) -> bool:
    """Return True if no power of a Moebius transformation takes a number to another.

    With the multiplier l and the cross ratio m of start, end and fixed points, the k-th power does
    so if l^k = m. Heights of algebraic numbers allow one k only.
    """
    (a, b), (c, d) = matrix

    def fixed(s: Fraction) -> Fraction:  # 0 at fixed points
        return c * s * s + (d - a) * s - b

    if fixed(start) == 0:
        return start != end
    if fixed(end) == 0:
        return True
    ratio = Fraction((a + d) ** 2, a * d - b * c) - 2  # l + 1 / l
    if c == 0 or ratio in (-2, -1, 0, 1):
        return False
    if ratio == 2:  # a translation of 1 / (s - f) with the fixed point f
        f = Fraction(a - d, 2 * c)
        image = (a * start + b) / (c * start + d) if c * start + d else None
        first, last = 1 / (start - f), 1 / (end - f)
        moved = 0 if image is None else 1 / (image - f)
        steps = (last - first) / (moved - first)
        return steps < 0 or steps.denominator > 1
    cross = 2 * start * end + (start + end) * Fraction(d - a, c) - 2 * Fraction(b, c)
    ratio_of_points = cross * cross * c * c / (fixed(start) * fixed(end)) - 2  # m + 1 / m
    k = round(_height(ratio_of_points) / _height(ratio))
    s = (start.numerator, start.denominator)
    p = 2**61 - 1
    for _ in range(k):
        s = (a * s[0] + b * s[1]) % p, (c * s[0] + d * s[1]) % p
    return (s[0] * end.denominator - s[1] * end.numerator) % p != 0


def _height(ratio: Fraction) -> float:
    """Return twice the logarithmic height of l, with l + 1 / l = ratio."""
    m, n = abs(ratio.numerator), ratio.denominator
    if m <= 2 * n:
        return math.log(n)
    return math.log(m) + math.log1p(math.sqrt(1 - 4 * (n / m) ** 2)) - math.log(2)
