"""The pencil of invariant curves of a planar map, and the Manin involutions of the map."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import flint

from . import _exact
from ._integrals import Found
from ._projective import Projective

_HIGHEST = 3  # degree of pencils whose singular members and involutions are sought
Center = tuple[int, ...]  # (X, Y, Z), the point (X/Z, Y/Z), or at infinity if Z = 0


@dataclass(frozen=True)
class Pencil:
    """The invariant curves P = c Q of a planar map.

    `base_points` are the rational ones in homogeneous coordinates, with multiplicities;
    `irrational` counts the others, with multiplicity. `genus` is that of a general member.
    `singular` has the irreducible polynomials in c (written x1) of the singular members other than
    Q; it is None for degrees above 3.
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
        names = {0: "rational", 1: "elliptic"}
        kind = names.get(self.genus, f"genus {self.genus}")
        points = [
            f"({':'.join(map(str, p))})" + (f"^{m}" if m > 1 else "") for p, m in self.base_points
        ]
        points += [f"{self.irrational} irrational"] if self.irrational else []
        text = f"P = c Q of degree {self.degree}, {kind}; base points {', '.join(points)}"
        if self.singular is not None:
            text += f"; singular for {', '.join(f'{f} = 0' for f in self.singular)}".replace(
                "x1", "c"
            )
        if self.involutions is not None:
            a, b = (f"({':'.join(map(str, p))})" for p in self.involutions)
            text += f"; the map is the product of the Manin involutions of {a} and {b} (proved)"
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the pencil as numbers, strings and lists."""
        return {
            "P": str(self.P),
            "Q": str(self.Q),
            "degree": self.degree,
            "base_points": [[list(p), m] for p, m in self.base_points],
            "irrational": self.irrational,
            "genus": self.genus,
            "singular": self.singular and [str(f).replace("x1", "c") for f in self.singular],
            "involutions": self.involutions and [list(p) for p in self.involutions],
        }


def pencil(map: Projective, integral: Found, lines: Sequence[Any]) -> Pencil:
    """Return the pencil of an integral; `lines` are invariant ones that may have the centers."""
    degree = integral.degree
    ring = _exact.polynomial_ring(3, flint.fmpz_mpoly_ctx)
    P, Q = (_homogeneous(each, degree, ring) for each in (integral.numerator, integral.denominator))
    F = [_homogeneous(each, map.delta, ring) for each in (*map.F[1:], map.F[0])]
    points, irrational = _base_points(P, Q, degree)
    found = Manin(P, Q, degree, F)
    centers: Iterator[tuple[Center, Center]] = iter(())
    if degree == 2:
        forms = [_homogeneous(line, 1, ring) for line in lines]
        pairs = [pair for form in forms for pair in found.on_line(form)]
        centers = iter(sorted(pairs, key=lambda pair: (pair[0][2], pair)))
    elif degree == 3:
        centers = permutations((p for p, _ in points), 2)
    return Pencil(
        integral.numerator,
        integral.denominator,
        degree,
        points,
        irrational,
        _genus(P, Q, degree),
        _singular(P, Q) if degree <= _HIGHEST else None,
        next(filter(found.give_the_map, centers), None),
    )


def _homogeneous(P: Any, degree: int, ring: Any) -> Any:
    return ring.from_dict({(*e, degree - sum(e)): c for e, c in P.to_dict().items()})


def _random_coordinates(rng: random.Random, ring: Any) -> tuple[list[Any], Any]:
    """Return linear forms in new coordinates, and their matrix."""
    while True:
        matrix = flint.fmpz_mat([[rng.randrange(-9, 10) for _ in range(3)] for _ in range(3)])
        if matrix.det() != 0:
            rows = _exact.integer_rows(matrix)
            return [_combined(row, ring.gens()) for row in rows], matrix


def _combined(numbers: Sequence[int], values: Sequence[Any]) -> Any:
    first, *others = (a * b for a, b in zip(numbers, values, strict=True))
    return sum(others, first)


def _base_points(P: Any, Q: Any, degree: int) -> tuple[tuple[tuple[Center, int], ...], int]:
    """Return the rational common zeros with multiplicities, and the number of the others."""
    ring = P.context()
    forms, matrix = _random_coordinates(random.Random(1), ring)
    p, q = (each.compose(*forms, ctx=ring) for each in (P, Q))
    points = []
    for factor, power in _exact.factors(p.resultant(q, "x1").subs({"x3": 1})):
        if factor.total_degree() == 1:
            b, c = -_coefficient(factor, (0, 0, 0)), _coefficient(factor, (0, 1, 0))
            line = ring.gen(0), ring.constant(b), ring.constant(c)
            (root, _), *_ = _exact.factors(
                p.compose(*line, ctx=ring).gcd(q.compose(*line, ctx=ring))
            )
            a, scale = -_coefficient(root, (0, 0, 0)), _coefficient(root, (1, 0, 0))
            there = matrix * flint.fmpz_mat(3, 1, [a, b * scale, c * scale])
            points.append((_primitive(there.entries()), power))
    return tuple(sorted(points)), degree**2 - sum(power for _, power in points)


def _coefficient(P: Any, exponents: tuple[int, ...]) -> int:
    return int(P.to_dict().get(exponents, 0))


def _primitive(point: Sequence[Any]) -> Center:
    """Return integers without a common divisor, the last of which that is not 0 is positive."""
    integers = [int(a) for a in point]
    last = next(a for a in reversed(integers) if a)
    return tuple(a // (math.gcd(*integers) * (1 if last > 0 else -1)) for a in integers)


def _genus(P: Any, Q: Any, degree: int) -> int:
    """Return the genus of a general member.

    Its singular points are assumed to be double, or to have smooth branches. On a generic
    projection to a line, its discriminant then has a root of odd multiplicity where the curve is
    ramified.
    """
    forms, _ = _random_coordinates(rng := random.Random(2), P.context())
    member = (rng.randrange(2**20) * P + rng.randrange(2**20) * Q).compose(*forms, ctx=P.context())
    discriminant = member.subs({"x3": 1}).discriminant("x1")
    ramified = sum(int(f.total_degree()) for f, e in _exact.factors(discriminant) if e % 2)
    return 1 - degree + ramified // 2


def _singular(P: Any, Q: Any) -> tuple[Any, ...]:
    """Return the polynomials in c, written x1, for which P - c Q is singular."""
    ring, rng = P.context(), random.Random(3)
    wide = _exact.polynomial_ring(4, flint.fmpz_mpoly_ctx)
    found = []
    for _ in range(2):  # what depends on the projection is not singular
        forms, _ = _random_coordinates(rng, ring)
        curves = (each.compose(*forms, ctx=ring).subs({"x3": 1}) for each in (P, Q))
        p, q = (wide.from_dict({(*e, 0): k for e, k in f.to_dict().items()}) for f in curves)
        last = (p - wide.gen(3) * q).discriminant("x1").discriminant("x2")
        found.append(ring.from_dict({(e[3], 0, 0): k for e, k in last.to_dict().items()}))
    return tuple(f for f, _ in _exact.factors(found[0].gcd(found[1])))


class Manin:
    """Manin involutions of the curves of a pencil, in homogeneous coordinates."""

    def __init__(self, P: Any, Q: Any, degree: int, F: Sequence[Any]) -> None:
        self.P, self.Q, self.degree, self.F = P, Q, degree, F

    def __call__(self, p: Sequence[int], x: Sequence[Any]) -> list[Any]:
        """Return the other point of the line through p and x on the curve of x.

        For degree 3, p is a base point.
        """
        P, Q = self._at(self.P, x), self._at(self.Q, x)

        def along(f: Any, at: Sequence[Any], direction: Sequence[Any]) -> Any:
            return sum(self._at(f.derivative(i), at) * b for i, b in enumerate(direction))

        tangent = Q * along(self.P, x, p) - P * along(self.Q, x, p)
        far = Q * self._at(self.P, p) - P * self._at(self.Q, p)
        if self.degree == 3:
            far = Q * along(self.P, p, x) - P * along(self.Q, p, x)
        return [far * a - tangent * b for a, b in zip(x, p, strict=True)]

    def _at(self, f: Any, x: Sequence[Any]) -> Any:
        if isinstance(x[0], int):
            return int(f(*x))
        return f.compose(*x, ctx=x[0].context())

    def give_the_map(self, centers: tuple[Center, Center]) -> bool:
        """Compare the product of two involutions with the map, as an identity."""
        a, b = centers
        for x in ([3, -7, 2], [11, 5, -4], [*self.P.context().gens()]):
            y, z = self(a, self(b, x)), [self._at(F, x) for F in self.F]
            same = (y[i] * z[j] == y[j] * z[i] for i, j in ((0, 1), (0, 2), (1, 2)))
            if not all(same) or not any(y):
                return False
        return True

    def on_line(self, line: Any) -> Iterator[tuple[Center, Center]]:
        """Yield centers on a line that give the images of two points, for conics."""
        l = [_coefficient(line, e) for e in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        ends = [(0, -l[2], l[1]), (l[2], 0, -l[0]), (-l[1], l[0], 0)]
        del ends[next(i for i, a in enumerate(l) if a)]  # the others are independent
        maps = []
        for x in ([3, -7, 2], [11, 5, -4]):
            y, images = [self._at(F, x) for F in self.F], []
            for q in (*ends, _sum(*ends)):
                z = self(q, x)
                # This point is on the line, and on that through y and z.
                p = _sum([_combined(l, z) * a for a in y], [-_combined(l, y) * a for a in z])
                images.append(_on_basis(p, ends))
            columns = flint.fmpq_mat([*zip(*images[:2], strict=True)])
            if columns.det() == 0:
                return
            s, t = columns.solve(flint.fmpq_mat(2, 1, images[2])).entries()
            if s == 0 or t == 0:
                return
            maps.append(columns * flint.fmpq_mat([[s, 0], [0, t]]))
        both = maps[1].inv() * maps[0]
        for value, _ in both.charpoly().roots():
            rows = (both - flint.fmpq_mat([[value, 0], [0, value]])).tolist()
            for row in [each for each in rows if any(each)][:1]:
                fixed = flint.fmpq_mat([[-row[1]], [row[0]]])
                coordinates = (each.numer_denom()[0].entries() for each in (maps[0] * fixed, fixed))
                a, b = (
                    _sum(*([s * e for e in end] for s, end in zip(each, ends, strict=True)))
                    for each in coordinates
                )
                yield _primitive(a), _primitive(b)


def _sum(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [k + l for k, l in zip(a, b, strict=True)]


def _on_basis(p: Sequence[int], ends: Sequence[Center]) -> list[Any]:
    """Return the coordinates of a point of a line with respect to two others, up to a factor."""
    a, b = ends
    i, j = next((i, j) for i, j in ((0, 1), (0, 2), (1, 2)) if a[i] * b[j] != a[j] * b[i])
    return [flint.fmpq(p[i] * b[j] - p[j] * b[i]), flint.fmpq(a[i] * p[j] - a[j] * p[i])]
