"""Families of integrable maps with all their letters, and maps that are composed of others."""

from fractions import Fraction

import pytest

from suslov_fast import Map
from suslov_fast.integrability import degrees, growth, rational_map, report

A = [f"a{i}{j}" for i in range(3) for j in range(3)]
B = [[2, 1, 0], [1, -1, 3], [1, 1, -3]]
SYMMETRIC = "a b c d e f", "p q r s u v"


def other_root(x, y, A, B):
    """Return the other x at which the quotient of the biquadratics A and B has the same value."""
    a, b = ([p * y * y + q * y + r for p, q, r in rows] for rows in (A, B))
    f = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return (f[0] - x * f[1]) / (f[1] - x * f[2])


def transposed(A):
    return [*zip(*A, strict=True)]


def asymmetric(a):
    """Return the QRT map of the matrix with the entries a, and of B, and its inverse."""
    A = [a[:3], a[3:6], a[6:]]

    def forward(x):
        u = other_root(*x, A, B)
        return u, other_root(x[1], u, transposed(A), transposed(B))

    def backward(x):
        v = other_root(x[1], x[0], transposed(A), transposed(B))
        return other_root(x[0], v, A, B), v

    return forward, backward


def symmetric(a, b, c, d, e, f):
    return [[a, b, c], [b, d, e], [c, e, f]]


def biquadratic(A, x):
    (x, y), rows = x, A
    return sum(
        c * x ** (2 - i) * y ** (2 - j) for i, row in enumerate(rows) for j, c in enumerate(row)
    )


def with_names(f, names):
    """Return f(x, numbers) as a function of x and arguments with these names."""
    return eval(f"lambda x, {', '.join(names)}: of(x, [{', '.join(names)}])", {"of": f})


@pytest.mark.slow
def test_the_symmetric_qrt_map_of_twelve_letters():
    names = " ".join(SYMMETRIC).split()

    def forward(x, a):
        return x[1], other_root(x[0], x[1], symmetric(*a[:6]), symmetric(*a[6:]))

    def backward(x, a):
        return other_root(x[1], x[0], symmetric(*a[:6]), symmetric(*a[6:])), x[0]

    numbers = dict(zip(names, (3, 1, -2, 5, 4, 7, 2, -1, 6, -3, 1, 8), strict=True))
    maps = [Map(with_names(f, names), "x y", **numbers) for f in (forward, backward)]
    found = report(rational_map(*maps, letters=names), degree=4)
    (F,) = found.integrals
    assert (F.basis, found.growth.kind, found.proved_entropy) == ("identity", "quadratic", 0.0)
    for shift in (1, 2):
        at = {name: Fraction(a + shift, 3) for name, a in numbers.items()}
        x = [Fraction(2, 7), Fraction(-5, 3)]
        y = forward(x, [*at.values()])
        assert F(x, **at) == F(y, **at)
        P, Q = (symmetric(*[*at.values()][k : k + 6]) for k in (0, 6))
        assert biquadratic(P, x) / biquadratic(Q, x) == biquadratic(P, y) / biquadratic(Q, y)


@pytest.mark.slow
def test_the_asymmetric_qrt_map_of_nine_letters():
    numbers = dict(zip(A, (1, 0, 2, -1, 3, 1, 0, 2, -2), strict=True))
    maps = [
        Map(with_names(lambda x, a, k=k: asymmetric(a)[k](x), A), "x y", **numbers) for k in (0, 1)
    ]
    found = report(rational_map(*maps, letters=A), degree=4)
    (F,) = found.integrals
    assert (F.basis, found.growth.kind, found.proved_entropy) == ("identity", "quadratic", 0.0)
    at = {name: Fraction(a + k, 3) for k, (name, a) in enumerate(numbers.items())}
    x = [Fraction(2, 7), Fraction(-5, 3)]
    assert F(x, **at) == F(asymmetric([*at.values()])[0](x), **at)


def test_a_generic_qrt_map_has_quadratic_growth():
    maps = [Map(f, "x y") for f in asymmetric([1, 0, 2, -1, 3, 1, 0, 2, -2])]
    found = report(rational_map(*maps), degree=4)
    assert (found.growth.kind, found.proved_entropy) == ("quadratic", 0.0)
    assert [F.basis for F in found.integrals] == ["identity"]


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
    assert [F.basis for F in found.integrals] == ["identity"] * 2 == ["identity"] * found.relations
    x, a = [Fraction(k, 3) for k in (2, -5, 7, 4)[:D]], Fraction(7, 5)
    y = [*x[1:], (a + sum(x[1:])) / x[0]]
    for F in found.integrals:
        assert F(x, a=a) == F(y, a=a)
    assert found.growth.kind == "quadratic"


def test_a_composition():
    """Its stages are found in the program of f(f(x)); powers of x are computed once for both."""

    def f(x):
        return x[1], (x[1] ** 2 + x[1] + 3) / (x[0] * x[1] ** 2 + 1)

    once, twice = rational_map(Map(f, 2)), rational_map(Map(lambda x: f(f(x)), 2))
    assert len(twice.stages) == 2
    assert twice([2, 5]) == once(once([2, 5])) == tuple(F([2, 5]) for F in twice.formulas)
    assert degrees(twice, 3) == degrees(once, 6)[1::2]
    matrix = twice.jacobian([2, 5])
    first, second = once.jacobian([2, 5]), once.jacobian(once([2, 5]))
    assert matrix == tuple(
        tuple(sum(second[i][k] * first[k][j] for k in (0, 1)) for j in (0, 1)) for i in (0, 1)
    )
