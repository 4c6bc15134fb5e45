"""Maps and families of maps with published integrals, measures and degrees; compositions."""

from fractions import Fraction as F

import numpy as np
import pytest

from suslov_fast import Field, Map
from suslov_fast.integrability import cofactors, degrees, growth, kahan, rational_map, report
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
def biquadratic(A, x, y):
    return np.array((x**2, x, 1)) @ np.array(A, object) @ (y**2, y, 1)


def other_root(x, y, A, B):
    """Return the other x at which the quotient of the biquadratics A and B has the same value."""
    a, b = ([p * y * y + q * y + r for p, q, r in rows] for rows in (A, B))
    f = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return (f[0] - x * f[1]) / (f[1] - x * f[2])


def qrt(A, B):
    """Return the asymmetric QRT map of A / B."""
    AT, BT = ([*zip(*matrix, strict=True)] for matrix in (A, B))

    def forward(x):
        u = other_root(*x, A, B)
        return u, other_root(x[1], u, AT, BT)

    def backward(x):
        v = other_root(x[1], x[0], AT, BT)
        return other_root(x[0], v, A, B), v

    return rational_map(Map(forward, "x y"), Map(backward, "x y"))


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 12))]
)
def test_the_integral_of_a_qrt_map_is_found_and_proved(seed):
    """It is a fractional linear function of A / B. What the search does later is left out."""
    A, B = np.random.default_rng(seed).integers(-3, 4, (2, 3, 3)).astype(object)
    map = qrt(A, B)
    found = report(map, degree=4, progress=lambda done, parts: done < 28)
    (integral,) = found.integrals
    assert (integral.basis, integral.degree, found.finished) == (IDENTITY, 4, False)
    assert str(found).endswith("Not finished.")
    assert found.proved_entropy is None
    x = POINT[:2]
    assert integral(map(x)) == integral(x)
    # A / B and the integral have parallel gradients: those of a second function at this point.
    before, after = (biquadratic(A, *z) / biquadratic(B, *z) for z in (x, map(x)))
    assert before == after


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


def lyness(D):
    """x_D~ = (a + x_2 + ... + x_D) / x_1, and the inverse."""
    forward = Map(lambda x, a: (*x[1:], (a + sum(x[1:])) / x[0]), D, a=3)
    return forward, Map(lambda x, a: ((a + sum(x[:-1])) / x[-1], *x[:-1]), D, a=3)


def test_the_growth_of_lyness_maps_of_four_variables():
    map = rational_map(*lyness(4))
    assert growth(degrees(map, 24)).kind == "unclear"
    assert report(map, degree=1).growth.kind == "quadratic"


@pytest.mark.slow
@pytest.mark.parametrize(("D", "degree"), [(3, 4), (4, 5)])
def test_all_integrals_of_lyness_maps(D, degree):
    """Two, one of which is (a + sum x) prod (1 + x_i) / prod x_i."""
    found = report(rational_map(*lyness(D), letters="a"), degree=degree)
    assert [f.basis for f in found.integrals] == [IDENTITY] * 2 == [IDENTITY] * found.relations
    x, a = [F(k, 3) for k in (2, -5, 7, 4)[:D]], F(7, 5)
    y = [*x[1:], (a + sum(x[1:])) / x[0]]
    for f in found.integrals:
        assert f(x, a=a) == f(y, a=a)
    assert found.growth.kind == "quadratic"


def test_a_composition():
    """Its stages are found in the program of f(f(x)); powers of x are computed once for both."""

    def f(x):
        return x[1], (x[1] ** 2 + x[1] + 3) / (x[0] * x[1] ** 2 + 1)

    once, twice = rational_map(Map(f, 2)), rational_map(Map(lambda x: f(f(x)), 2))
    assert len(twice.stages) == 2
    assert twice([2, 5]) == once(once([2, 5])) == tuple(g([2, 5]) for g in twice.formulas)
    assert degrees(twice, 3) == degrees(once, 6)[1::2]
    matrix = twice.jacobian([2, 5])
    first, second = once.jacobian([2, 5]), once.jacobian(once([2, 5]))
    assert matrix == tuple(
        tuple(sum(second[i][k] * first[k][j] for k in (0, 1)) for j in (0, 1)) for i in (0, 1)
    )
