"""Proofs that the orbit of a contracted curve never comes to another point without an image.

Either the orbit is periodic modulo a small prime, and all of its points have images; or it is on
invariant lines, on which the map is a Moebius transformation of their parameter.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from fractions import Fraction
from itertools import islice
from typing import Any

import flint

from . import arithmetic
from .contracted import Passage, Plane, PlaneModulo
from .polynomials import cleared, coprime, modulo, primitive, value_at

_SMALL_PRIMES = (5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79)
_PRIME = 2**61 - 1  # numbers with different residues are different
_TRIES = 3  # points and numbers in place of eps for each of these
_PERIODS = 1, 2, 3  # of invariant lines
_STEPS = 12  # of an orbit over the rationals
_BITS = 20_000  # of its coordinates, at most
_NUMBERS = Fraction(3, 7), Fraction(2, 5)  # in place of a symbolic eps


def why_never(plane: Plane, number: int, passage: Passage) -> str:
    """Return why an orbit never ends after its last point without an image; "" if unknown."""
    for p in _SMALL_PRIMES:
        rng = random.Random(p)
        for _ in range(_TRIES):
            eps = rng.randrange(1, p)
            residues = PlaneModulo(plane, p, eps, rng.randrange(99))
            if _is_periodic_modulo(residues, number, passage):
                at = f" and eps = {eps}" if plane.symbolic else ""
                return f"never, since modulo {p}{at} the orbit is periodic"
    if passage.common_orders or plane.degrees[number] != 1:
        return ""
    return _why_never_on_a_line(plane, number)


# Modulo a small prime.


def _is_periodic_modulo(residues: PlaneModulo, number: int, passage: Passage) -> bool:
    """Return True if the orbit modulo a prime is periodic, and all its points have images.

    A point of the curve modulo p at which the curve is smooth is that of one over p-adic numbers;
    if images do not vanish modulo p, they are those of the true orbit.
    """
    if any(P == 0 for P in (*residues.forms, residues.curves[number])):
        return False
    germ, terms = residues.germ(residues.curves[number]), 1 + sum(passage.common_orders)
    for expected in (0, *passage.common_orders):
        if germ is None or (step := residues.step(germ, terms)) is None:
            return False
        germ, order, _ = step
        terms -= order
        if order != expected:
            return False
    x = [P[0] for P in germ or ()]
    visited = set()
    while any(x):
        pivot = next(a for a in x if a)
        point = tuple(int(a / pivot) for a in x)
        if point in visited:
            return True
        visited.add(point)
        x = [F(*point) for F in residues.forms]
    return False


# On invariant lines, for a contracted line with rational coefficients.


def _why_never_on_a_line(plane: Plane, number: int) -> str:
    """Return how invariant lines decide that an orbit never ends; "" if they do not.

    If eps is symbolic, one number in its place suffices.
    """
    if not plane.symbolic:
        return _why_never_at_number(plane, number)
    for eps in _NUMBERS:
        at_number = Plane(plane.map.subs(eps))
        line = primitive(cleared(modulo(plane.curves[number], 0, arithmetic.fmpq(eps))))
        lines = [k for k, degree in enumerate(at_number.degrees) if degree == 1]
        same = next((k for k in lines if at_number.curves[k] == line), None)
        if same is not None and (reason := _why_never_at_number(at_number, same)):
            return reason
    return ""


def _why_never_at_number(plane: Plane, number: int) -> str:
    orbit: list[tuple[int, ...]] = []
    for x in islice(_images_of_line(plane, number), 1 + _STEPS):
        if x in orbit:
            return f"never, since the orbit is periodic, of period {len(orbit) - orbit.index(x)}"
        orbit.append(x)
    for period in _PERIODS:
        if len(orbit) > 2 * period:
            pairs = [(orbit[k], orbit[k + period]) for k in range(period)]
            if all(_never_ends_on_line_through(plane, x, y, period) for x, y in pairs):
                which = "an invariant line" if period == 1 else f"{period} lines that are permuted"
                return f"never, since the orbit is on {which}, with a Moebius transformation"
    return ""


def orbit_of_line(plane: Plane, number: int, length: int | None) -> tuple[tuple[int, ...], ...]:
    """Return the first points to which a line with rational coefficients goes, without repetition.

    At most `length` points, or some. Other curves, and a symbolic eps, have none.
    """
    if plane.symbolic or plane.degrees[number] != 1:
        return ()
    points = islice(_images_of_line(plane, number), length or 1 + _STEPS)
    return tuple(dict.fromkeys(points))


def _images_of_line(plane: Plane, number: int) -> Iterator[tuple[int, ...]]:
    """Yield the points to which a line goes, up to one without an image."""
    x: tuple[int, ...] | None = _image_of_line(plane, number)
    while x is not None and max(map(abs, x)).bit_length() <= _BITS:
        yield x
        x = _image(plane, x)


def _image_of_line(plane: Plane, number: int) -> tuple[int, ...]:
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


def _cross(a: Sequence[int], b: Sequence[int]) -> list[int]:
    """Return the line through two points, or the point on two lines."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _never_ends_on_line_through(
    plane: Plane, x: Sequence[int], y: Sequence[int], period: int
) -> bool:
    """Return True if an iterate maps a line to itself, and the orbit of x never ends there.

    The line is that through x and y, and the iterate the one that takes x to y.
    """
    # Two other points of the line, a and b, so that its points are a + s b.
    a, b = ([c * u + d * v for u, v in zip(x, y, strict=True)] for c, d in ((31, 17), (-13, 43)))
    line = [flint.fmpz_poly([u, v]) for u, v in zip(a, b, strict=True)]
    images = [value_at(F, line) for F in plane.forms]
    ends = images[0].gcd(images[1]).gcd(images[2])  # points of the line without an image
    for _ in range(period - 1):
        images = [value_at(F, coprime(images)) for F in plane.forms]
    images = coprime(images)
    through = _cross(a, b)
    if sum((n * P for n, P in zip(through, images, strict=True)), flint.fmpz_poly([0])) != 0:
        return False
    i, j = next((i, j) for i in range(3) for j in range(i) if a[i] * b[j] != a[j] * b[i])

    def parameter(z: Sequence[Any]) -> tuple[Any, Any]:
        """Return numerator and denominator of the s with z = a + s b, up to a factor."""
        return z[i] * a[j] - z[j] * a[i], b[i] * z[j] - b[j] * z[i]

    numerator, denominator = coprime(parameter(images))
    if max(numerator.degree(), denominator.degree()) != 1:
        return False
    matrix = [[int(P[1]), int(P[0])] for P in (numerator, denominator)]
    start = Fraction(*parameter(x))
    roots = [f for f, _ in ends.factor()[1] if f.degree() == 1] if ends.degree() > 0 else []
    return all(_never_meets(matrix, start, Fraction(-int(f[0]), int(f[1]))) for f in roots)


def _never_meets(matrix: list[list[int]], start: Fraction, end: Fraction) -> bool:
    """Return True if no power of a Moebius transformation takes a number to another.

    With the multiplier l and the cross ratio m of start, end and fixed points, the k-th power does
    so if l^k = m. Heights of algebraic numbers allow one k only.
    """
    (a, b), (c, d) = matrix

    def vanishing_at_fixed_points(s: Fraction) -> Fraction:
        return c * s * s + (d - a) * s - b

    if vanishing_at_fixed_points(start) == 0:
        return start != end
    if vanishing_at_fixed_points(end) == 0:
        return True
    trace_of_l = Fraction((a + d) ** 2, a * d - b * c) - 2  # l + 1 / l
    if c == 0 or trace_of_l in (-2, -1, 0, 1):  # infinity is fixed, or l is a root of unity
        return False
    if trace_of_l == 2:
        return _translation_never_meets(matrix, start, end)
    cross = 2 * start * end + (start + end) * Fraction(d - a, c) - 2 * Fraction(b, c)
    product = vanishing_at_fixed_points(start) * vanishing_at_fixed_points(end)
    trace_of_m = cross * cross * c * c / product - 2  # m + 1 / m
    k = round(_height(trace_of_m) / _height(trace_of_l))
    s = (start.numerator, start.denominator)
    for _ in range(k):
        s = (a * s[0] + b * s[1]) % _PRIME, (c * s[0] + d * s[1]) % _PRIME
    return (s[0] * end.denominator - s[1] * end.numerator) % _PRIME != 0


def _translation_never_meets(matrix: list[list[int]], start: Fraction, end: Fraction) -> bool:
    """Return the result of `_never_meets` for one fixed point f: 1 / (s - f) is translated."""
    (a, b), (c, d) = matrix
    f = Fraction(a - d, 2 * c)
    denominator = c * start + d
    moved = 1 / ((a * start + b) / denominator - f) if denominator else 0
    first, last = 1 / (start - f), 1 / (end - f)
    steps = (last - first) / (moved - first)
    return steps < 0 or steps.denominator > 1


def _height(trace: Fraction) -> float:
    """Return twice the logarithmic height of l, with l + 1 / l = trace."""
    m, n = abs(trace.numerator), trace.denominator
    if m <= 2 * n:
        return math.log(n)
    return math.log(m) + math.log1p(math.sqrt(1 - 4 * (n / m) ** 2)) - math.log(2)
