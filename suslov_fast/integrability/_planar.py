"""The pencil of invariant curves of a planar map, and the Manin involutions of the map."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import flint
import numpy as np

from ._exact import factors, null_space, value_at
from ._functions import RationalFunction
from ._projective import Projective

_HIGHEST = 3  # degree of pencils whose singular members and involutions are sought
_POINTS = [3, -7, 2], [11, 5, -4]
Center = tuple[int, ...]  # (X, Y, Z), the point (X/Z, Y/Z), or at infinity if Z = 0


@dataclass(frozen=True)
class Pencil:
    """The invariant curves P = c Q of a planar map.

    `base_points` are the rational ones in homogeneous coordinates, with multiplicities;
    `irrational` counts the others, with multiplicity. `genus` is that of a general member.
    `singular` has the irreducible polynomials in c of the singular members other than Q; it is None
    for degrees above 3.
    `involutions` are two centers a, b: the map takes a point to its image under the Manin
    involution of b, which exchanges the points where a line through b meets a curve, then under
    that of a. They are checked as an identity. None if no rational pair was found.
    """

    P: Any
    Q: Any
    degree: int
    base_points: tuple[tuple[Center, int], ...]
    irrational: int
    genus: int
    singular: tuple[Any, ...] | None
    involutions: tuple[Center, Center] | None

    def __repr__(self) -> str:
        kind = {0: "rational", 1: "elliptic"}.get(self.genus, f"genus {self.genus}")
        points = [_text(p) + (f"^{m}" if m > 1 else "") for p, m in self.base_points]
        points += [f"{self.irrational} irrational"] if self.irrational else []
        text = f"P = c Q of degree {self.degree}, {kind}; base points {', '.join(points)}"
        if self.singular is not None:
            text += f"; singular for {', '.join(f'{f} = 0' for f in self.singular)}"
        if self.involutions is not None:
            a, b = map(_text, self.involutions)
            text += f"; the map is the product of the Manin involutions of {a} and {b} (proved)"
        return text


def _text(point: Center) -> str:
    return f"({':'.join(map(str, point))})"


def pencil(map: Projective, integral: RationalFunction) -> Pencil:
    """Return the pencil of an integral."""
    degree = integral.degree
    P, Q = (map.homogeneous(f, degree) for f in (integral.numerator, integral.denominator))
    points = _base_points(P, Q)
    singular = _singular(P, Q) if degree <= _HIGHEST else None
    centers: list[Center] = []
    if degree == 2:
        roots = [c for f in singular or () for c in _rational_roots(f)]
        conics = [Q, *(c.denominator * P - c.numerator * Q for c in roots)]
        centers = sorted((p for P in conics for p in _double_point(P)), key=lambda p: (p[2], p))
    elif degree == 3:
        centers = [p for p, _ in points]
    return Pencil(
        integral.numerator,
        integral.denominator,
        degree,
        points,
        degree**2 - sum(power for _, power in points),
        _genus(P, Q),
        singular,
        _involutions(P, Q, map.F, centers),
    )


def _in_new_coordinates(curves: Sequence[Any], seed: int) -> tuple[list[Any], list[list[int]]]:
    """Return curves in random coordinates, with the matrix that takes these to the old ones."""
    rng, ring = random.Random(seed), curves[0].context()
    while True:
        matrix = [[rng.randrange(-9, 10) for _ in range(3)] for _ in range(3)]
        if flint.fmpz_mat(matrix).det() != 0:
            forms = [sum(a * x for a, x in zip(row, ring.gens(), strict=True)) for row in matrix]
            return [P.compose(*forms, ctx=ring) for P in curves], matrix


def _rational_roots(f: Any) -> dict[Fraction, int]:
    """Return the roots of a polynomial in one of its variables, and their multiplicities."""
    constant = (0,) * f.context().nvars()
    return {
        Fraction(-int(factor.to_dict().get(constant, 0)), int(factor.leading_coefficient())): power
        for factor, power in factors(f)
        if factor.total_degree() == 1
    }


def _base_points(P: Any, Q: Any) -> tuple[tuple[Center, int], ...]:
    """Return the rational common zeros with multiplicities."""
    (p, q), matrix = _in_new_coordinates([P, Q], seed=1)
    first, second = (
        _rational_roots(p.resultant(q, other).subs({"x3": 1})) for other in ("x2", "x1")
    )
    points = []
    for y, multiplicity in second.items():
        for z in ((x, y, 1) for x in first):
            if value_at(p, z) == value_at(q, z) == 0:
                points.append((_coprime(np.array(matrix) @ z), multiplicity))
    return tuple(sorted(points))


def _coprime(point: Sequence[Any]) -> Center:
    """Return integers without a common divisor, the last of which that is not 0 is positive."""
    scale = math.lcm(*(a.denominator for a in point))
    integers = [int(a * scale) for a in point]
    last = next(a for a in reversed(integers) if a)
    divisor = math.gcd(*integers) * (1 if last > 0 else -1)
    return tuple(a // divisor for a in integers)


def _genus(P: Any, Q: Any) -> int:
    """Return the genus of a general member.

    Its singular points are assumed to be double, or to have smooth branches. On a generic
    projection to a line, its discriminant then has a root of odd multiplicity where the curve is
    ramified.
    """
    rng = random.Random(2)
    (member,), _ = _in_new_coordinates([rng.randrange(2**20) * P + rng.randrange(2**20) * Q], 2)
    discriminant = member.subs({"x3": 1}).discriminant("x1")
    ramified = sum(int(f.total_degree()) for f, e in factors(discriminant) if e % 2)
    return 1 - int(P.total_degree()) + ramified // 2


def _singular(P: Any, Q: Any) -> tuple[Any, ...]:
    """Return the polynomials in c for which P - c Q is singular."""
    ring = flint.fmpz_mpoly_ctx.get(["x1", "x2", "c"], ordering="deglex")
    found = []
    for seed in (3, 4):  # what depends on the projection is not singular
        curves, _ = _in_new_coordinates([P, Q], seed)
        p, q = (ring.from_dict(f.subs({"x3": 1}).to_dict()) for f in curves)
        found.append((p - ring.gens()[2] * q).discriminant("x1").discriminant("x2"))
    single = flint.fmpz_mpoly_ctx.get(["c"], ordering="deglex")
    singular = factors(found[0].gcd(found[1]))
    return tuple(single.from_dict({e[2:]: k for e, k in f.to_dict().items()}) for f, _ in singular)


def _double_point(conic: Any) -> list[Center]:
    """Return the point in which a pair of lines meet; none of other conics."""
    units = np.eye(3, dtype=int).tolist()
    gradients = [[int(value_at(conic.derivative(i), e)) for e in units] for i in range(3)]
    points = null_space(flint.fmpz_mat(gradients))
    return [_coprime(points[0])] if len(points) == 1 else []


def _involutions(P: Any, Q: Any, F: Sequence[Any], centers: Sequence[Center]) -> Any:
    """Return two centers, the first of these, whose Manin involutions give the map."""

    def cross(a: Any, b: Any) -> Any:
        return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]

    images = [[value_at(f, x) for f in F] for x in _POINTS]
    pairs = (_POINTS[0], images[0]), (P.context().gens(), F)
    for a in centers:
        lines = [cross(x, _manin(P, Q, a, y)) for x, y in zip(_POINTS, images, strict=True)]
        if any(b := cross(*lines)):
            b = _coprime(b)
            products = ((_manin(P, Q, a, _manin(P, Q, b, x)), y) for x, y in pairs)
            if all(any(z) and not any(cross(y, z)) for z, y in products):
                return a, b
    return None


def _manin(P: Any, Q: Any, center: Sequence[int], x: Sequence[Any]) -> list[Any]:
    """Return the other point of the line through x and the center on the curve of x.

    For degree 3, the center is a base point.
    """
    p, q = value_at(P, x), value_at(Q, x)

    def along(f: Any, at: Sequence[Any], direction: Sequence[Any]) -> Any:
        return sum(value_at(f.derivative(i), at) * b for i, b in enumerate(direction))

    tangent = q * along(P, x, center) - p * along(Q, x, center)
    if P.total_degree() == 3:
        far = q * along(P, center, x) - p * along(Q, center, x)
    else:
        far = q * value_at(P, center) - p * value_at(Q, center)
    return [far * a - tangent * b for a, b in zip(x, center, strict=True)]
