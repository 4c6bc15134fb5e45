"""Maps with published integrals, measures and degrees."""

from fractions import Fraction as F

import numpy as np
import pytest

from suslov_fast import Field, Map

pytest.importorskip("flint")

from suslov_fast.integrability import cofactors, degrees, kahan, rational_map, report
from suslov_fast.integrability.rational_functions import IDENTITY

POINT = F(3, 7), F(-5, 11), F(2, 9)


def test_a_map_is_the_rational_map_of_its_function():
    """With the names of its variables; decimals are what was written, unless they are not."""
    lyness = Map(lambda x, a: (x[1], (x[1] + a) / x[0]), "x y", a=3)
    henon = Map(lambda x, a, b: (1 - a * x[0] ** 2 + x[1], b * x[0]), "x y", a=1.4, b=0.3)
    assert rational_map(lyness)((2, 5)) == (5, 4)
    assert str(rational_map(henon)) == "rational_map(-(7*x^2 - 5*y - 5)/5, 3*x/10)"
    assert degrees(henon, 5) == [2, 4, 8, 16, 32]
    assert [str(c) for c in cofactors(lyness, 1)] == ["1", "(y + 3)/x^2"]
    assert [str(f) for f in report(lyness).integrals] == ["(x + 1)*(y + 1)*(x + y + 3)/(x*y)"]


# QRT maps (Quispel, Roberts and Thompson 1988): A and B are the matrices of two biquadratics.


def ratio(A, B, x, y):
    above, below = (np.array((x**2, x, 1)) @ M @ (y**2, y, 1) for M in (A, B))
    return above / below


def qrt(A, B):
    """The asymmetric QRT map of I = A / B and its inverse, as functions."""

    def across(x, f):
        return (f[0] - x * f[1]) / (f[1] - x * f[2])

    def products(matrices, y):
        return np.cross(*([sum(np.multiply(row, (y**2, y, 1))) for row in M] for M in matrices))

    def horizontal(x, y):
        return across(x, products((A, B), y))

    def vertical(x, y):
        return across(y, products((np.transpose(A), np.transpose(B)), x))

    def forward(x):
        first = horizontal(*x)
        return first, vertical(first, x[1])

    def backward(x):
        second = vertical(*x)
        return horizontal(x[0], second), second

    return forward, backward


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 12))]
)
def test_the_integral_of_a_qrt_map_is_found_and_proved(seed):
    """It is a fractional linear function of A / B. What the search does later is left out."""
    A, B = np.random.default_rng(seed).integers(-3, 4, (2, 3, 3)).astype(object)
    forward, backward = qrt(A, B)
    map = rational_map(Map(forward, 2), Map(backward, 2))
    found = report(map, degree=4, progress=lambda done, parts: done < 28)
    (integral,) = found.integrals
    assert (integral.basis, integral.degree, found.finished) == (IDENTITY, 4, False)
    assert str(found).endswith("Not finished.")
    assert found.proved_entropy is None
    x = POINT[:2]
    assert integral(map(x)) == integral(x)
    # A / B and the integral have parallel gradients: those of a second function at this point.
    values = [(f(x), f(map(x))) for f in (integral, lambda x: ratio(A, B, *x))]
    assert all(before == after for before, after in values)


@pytest.mark.slow
def test_a_report_of_a_qrt_map_ends():
    A, B = np.array([[0, 1, 1], [1, -1, 0], [1, 0, 2]]), np.diag([0, 0, 3])
    B[1, 2] = B[2, 1] = 1
    forward, backward = qrt(A.astype(object), B.astype(object))
    found = report(rational_map(Map(forward, 2), Map(backward, 2)), degree=4)
    assert found.finished
    assert found.proved_entropy == 0
    assert found.degrees[:3] == [6, 19, 42]
    assert {f.basis for f in (*found.integrals, *found.measures)} == {IDENTITY}


# Three-dimensional QRT maps (Alonso, Suris and Wei 2023): each involution goes along a generator of
# x1 x2 = lambda x3 to its second point on a quadric P_0 = mu P_1.


def P_0(x, h=1):
    x, y, z = x
    return x * z + 2 * h * y + z**2 - h**2


def P_1(x, h=1):
    x, y, z = x
    return x**2 - y * z + 2 * h**2


def along_generator(x, k):
    """Multiply x_k and x_3 by the second root; the other terms of P are those with k away."""
    parts = [
        [x[i] if i in (k, 2) else 0 for i in range(3)],
        [0 if i in (k, 2) else x[i] for i in range(3)],
    ]
    (A, B), (C, D) = ((P_0(part, h), P_1(part, h)) for h, part in enumerate(parts))
    root = (C * P_1(x) - D * P_0(x)) / (A * P_1(x) - B * P_0(x))
    return tuple(root * a if i in (k, 2) else a for i, a in enumerate(x))


@pytest.mark.parametrize("finished", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_qrt_map_in_three_dimensions(finished):
    """The volume form dx / (Q_1 P_1), here with Q_1 = x3, is that of Alonso and Suris 2025."""
    forward, backward = (
        lambda x, order=order: along_generator(along_generator(x, order[0]), order[1])
        for order in ((0, 1), (1, 0))
    )
    map, x = rational_map(Map(forward, 3), Map(backward, 3)), POINT
    y = map(x)
    for f in (lambda x: x[0] * x[1] / x[2], lambda x: P_0(x) / P_1(x)):
        assert f(y) == f(x)
    assert map.determinant(x) * x[2] * P_1(x) == y[2] * P_1(y)
    found = report(map, degree=2, progress=lambda done, parts: finished or done < 15)
    integrals = *found.integrals, *found.implicit
    assert found.independent == len(integrals) == 2
    assert all((f.degree, f(y)) == (2, f(x)) for f in integrals)
    if finished:
        assert found.degrees[:4] == [15, 55, 121, 215]
        assert found.growth.kind == "quadratic"
    assert (
        found.finished == finished == any(f(y) * map.determinant(x) == f(x) for f in found.measures)
    )


# Lotka-Volterra systems of trees (van der Kamp, McLachlan, McLaren and Quispel 2023): equations of
# neighbours i and k differ only in the columns i and k, and a x_i + b x_k is a Darboux polynomial.


@pytest.mark.parametrize(
    ("A", "edges"),
    [
        ([[2, 3, 5], [-1, 1, 5], [-1, 4, -3]], [(0, 1), (1, 2)]),
        ([[2, 3, 5, 1], [4, 1, 5, 1], [-1, 3, -2, 1], [6, 3, 5, -4]], [(0, k) for k in (1, 2, 3)]),
    ],
)
def test_a_tree_of_species(A, edges):
    n = len(A)
    assert all(A[i][j] == A[k][j] for i, k in edges for j in {*range(n)} - {i, k})
    tree = Field(lambda x: [x[i] * sum(A[i][j] * x[j] for j in range(n)) for i in range(n)], n)
    lines = [(i, k, A[k][i] - A[i][i], A[k][k] - A[i][k]) for i, k in edges]

    def density(x):
        product = F(1)
        for i in range(n):
            product *= F(x[i]) ** (sum(i in edge for edge in edges) - 2)
        for i, k, a, b in lines:
            product /= a * x[i] + b * x[k]
        return product

    map, x = kahan(tree, 1), [F(2, 7), F(-3, 5), F(4, 3), F(1, 9)][:n]
    assert density(map(x)) * map.determinant(x) == density(x)
    assert degrees(map, 5) == [n**k for k in range(1, 6)]
    if n == 3:
        found = report(map, degree=1)
        assert len(found.polynomials) == 2 * n - 1
        assert found.growth.entropy == pytest.approx(np.log(n))
        (measure,) = found.measures
        assert measure(x) / density(x) == measure(map(x)) / density(map(x))
