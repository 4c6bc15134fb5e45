"""Orbits of the points to which curves are contracted, and proofs that they never end.

An orbit ends at a point without an image. It never ends if it is periodic; if it is periodic modulo
a small prime, where all its points have images; or if it is on a line on which the map is a Moebius
transformation, and no power of that maps its first point to one without an image.
"""

from __future__ import annotations

import math
import operator
import random
from collections.abc import Sequence
from fractions import Fraction

import flint

from .arithmetic import fmpq
from .contracted_curves import LONGEST, Passage, Plane, PlaneModulo
from .polynomials import cleared, modulo, primitive, value_at

SMALL_PRIMES = (5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79)
_TRIES = 3  # points and numbers in place of eps for each of these
POINTS = 13  # of an orbit over the rationals
_NUMBER = Fraction(3, 7)  # in place of a symbolic eps
_PRIME = 2**61 - 1  # numbers with different residues are different


def why_never(plane: Plane, number: int, passage: Passage) -> str:
    """Return why an orbit never ends after its last point without an image; "" if unknown."""
    for p in SMALL_PRIMES:
        rng = random.Random(p)
        for _ in range(_TRIES):
            eps = rng.randrange(1, p)
            residues = PlaneModulo(plane, p, (eps,), rng.randrange(99))
            if _is_periodic_modulo(residues, number, passage):
                at = f" and {plane.map.letter} = {eps}" if plane.symbolic else ""
                return f"never, since modulo {p}{at} the orbit is periodic"
    if passage.common_orders:
        return ""
    at = ""
    if plane.symbolic:  # an orbit that never ends for one number does not for a general one
        line = primitive(*cleared(modulo(plane.curves[number], 0, [fmpq(_NUMBER)])))
        at = f" at {plane.map.letter} = {_NUMBER}"
        plane = Plane(plane.map.subs(**{plane.map.letter: _NUMBER}))
        if line not in plane.curves:
            return ""
        number = plane.curves.index(line)
    points = points_of_line(plane, number)
    if len({*points}) < len(points):
        return f"never, since{at} the orbit is periodic"
    if len(points) == POINTS and _never_ends_on_a_line(plane, points):
        return f"never, since{at} the orbit is on a line with a Moebius transformation"
    return ""


def _is_periodic_modulo(residues: PlaneModulo, number: int, passage: Passage) -> bool:
    """Return True if the orbit modulo a prime is periodic, and all its points have images.

    A smooth point of the curve modulo p is the residue of a point over the p-adic numbers. If
    images do not vanish modulo p, they are residues of the true orbit.
    """
    if any(P == 0 for P in (*residues.forms, residues.curves[number])):
        return False
    germ, terms = residues.germ(residues.curves[number]), 1 + sum(passage.common_orders)
    for expected in (0, *passage.common_orders):
        if germ is None or (step := residues.step(germ, terms)) is None:
            return False
        germ = step.germ
        terms -= step.common_order
        if step.common_order != expected:
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


def points_of_line(plane: Plane, number: int, most: int = POINTS) -> list[tuple[int, ...]]:
    """Return the successive points to which a line with rational coefficients is mapped.

    There are at most `most` points, and points may be equal. The result is empty for other curves,
    and for a symbolic eps.
    """
    points: list[tuple[int, ...]] = []
    if plane.symbolic or plane.degrees[number] != 1:
        return points
    line = [int(plane.curves[number].derivative(j).leading_coefficient() or 0) for j in range(3)]
    rng, x = random.Random(0), None
    while x is None:
        on_line = _cross(line, [rng.randrange(-50, 50) for _ in range(3)])
        x = _image(plane, on_line) if any(on_line) else None
    while x is not None and len(points) < most and max(map(abs, x)).bit_length() <= LONGEST:
        points.append(x)
        x = _image(plane, x)
    return points


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


# On a line that the map takes to itself.


def _never_ends_on_a_line(plane: Plane, points: Sequence[Sequence[int]]) -> bool:
    """Return True if an orbit is on a line that is mapped to itself one to one, and never ends."""
    a, b, *_ = points
    line = [flint.fmpz_poly([*ends]) for ends in zip(a, b, strict=True)]  # a + t b
    images = [value_at(F, line) for F in plane.forms]
    common = images[0].gcd(images[1]).gcd(images[2])
    images = [P // common for P in images]
    across = _cross(a, b)
    of_a, of_b = ([int(P[k]) for P in images] for k in range(2))
    is_one_to_one = max(P.degree() for P in images) == 1
    if not is_one_to_one or sum(map(operator.mul, across, of_b)) != 0:
        return False
    place = next(k for k in range(3) if across[k])
    # Its multiple that takes a to r b, and b to p a + q b.
    r, p, q = (_cross(*pair)[place] for pair in ((a, of_a), (of_b, b), (a, of_b)))
    # The k-th image of a is a multiple of a + t b, t = n / d, where w_k = d v - n u = 0 for its
    # coordinates u and v. They satisfy w_(k + 1) = q w_k + p r w_(k - 1).
    roots = [f for f, _ in common.factor()[1] if f.degree() == 1] if common.degree() > 0 else []
    return all(has_no_zero(int(f[0]), int(f[1]) * r, q, p * r) for f in roots)


def has_no_zero(first: int, second: int, q: int, s: int) -> bool:
    """Return True if w_(k + 1) = q w_k + s w_(k - 1), from w_0 != 0 and w_1, is never 0.

    With the roots x and y of z^2 = q z + s, w_k = 0 if the power k of l = x / y is a number m.
    Heights of l and m allow one k only. If l is a root of unity, the result is False.
    """
    norm = second * second - q * first * second - s * first * first
    if norm == 0:  # w_k is a multiple of x^k or y^k
        return True
    trace_of_l = -Fraction(q * q, s) - 2  # l + 1 / l
    if trace_of_l == 2:  # w_k is a multiple of (k - zero) x^k
        zero = Fraction(first * q, first * q - 2 * second)
        return zero < 0 or zero.denominator > 1
    trace_of_m = 2 + Fraction(first * first * (q * q + 4 * s), norm)
    if trace_of_l in (-2, -1, 0, 1):
        return False
    for _ in range(round(_height(trace_of_m) / _height(trace_of_l))):
        first, second = second, (q * second + s * first) % _PRIME
    return first % _PRIME != 0


def _height(trace: Fraction) -> float:
    """Return twice the logarithmic height of l, with l + 1 / l = trace."""
    m, n = abs(trace.numerator), trace.denominator
    if m <= 2 * n:
        return math.log(n)
    return math.log(m) + math.log1p(math.sqrt(1 - (2 * n / m) ** 2)) - math.log(2)
