"""Exact experiments on Kahan maps, against facts known from elsewhere and exact arithmetic."""

import math
import random
import re
import subprocess
import sys
from fractions import Fraction
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from suslov_fast import Suslov3D, SuslovGyrostat, SuslovND

pytest.importorskip("flint")
sympy = pytest.importorskip("sympy")

from suslov_fast import integrability  # noqa: E402
from suslov_fast.integrability import (  # noqa: E402
    QuadraticField,
    darboux_polynomials,
    degrees,
    growth,
    hk_bases,
    kahan,
)

F = Fraction
BODY = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25)
EPS = F(1, 4)
GENERIC = SuslovND(J=[1.25, 2.125, 3.75], I=[0.5, -0.75, 0.25])
EQUAL = SuslovND(J=[2, 2, 2], I=[0.5, -0.75, 0.25])


ROTOR = SuslovGyrostat(2, 3, 0.5, -0.25, 0.75)


def field_of(f, dimension):
    return QuadraticField.from_function(f, dimension)


def random_field(n, seed=0):
    rng = np.random.default_rng(seed)
    return QuadraticField(
        rng.integers(-3, 4, (n, n, n)), rng.integers(-3, 4, (n, n)), rng.integers(-3, 4, n)
    )


def euler_top(x):
    return 2 * x[1] * x[2], -3 * x[2] * x[0], x[0] * x[1]


def clebsch(x):
    """Petrera, Pfadler, Suris (2011): (m, p) with omega = (1, 2, 5)."""
    m, p, omega = x[:3], x[3:], (1, 2, 5)
    after = [((i + 1) % 3, (i + 2) % 3) for i in range(3)]
    return (
        *((omega[k] - omega[j]) * p[j] * p[k] for j, k in after),
        *(m[k] * p[j] - m[j] * p[k] for j, k in after),
    )


def cubic_hamiltonian(x):
    return x[0] ** 3 + 2 * x[0] * x[1] ** 2 - x[1] ** 3 + x[0] * x[1] + x[0] ** 2 - 3 * x[1]


def of_cubic_hamiltonian(x):
    q, p = x
    return 4 * q * p - 3 * p**2 + q - 3, -(3 * q**2 + 2 * p**2 + p + 2 * q)


def forced(x):
    """The three-dimensional problem in (x, y), with a = 1 and a constant force along y."""
    return x[0] * x[1], -(x[0] ** 2) - 1


def points(n, count, seed=1):
    rng = random.Random(seed)
    return [tuple(F(rng.randrange(-99, 99), 7) for _ in range(n)) for _ in range(count)]


def value(polynomial, point):
    """Of a polynomial of flint, term by term."""
    return sum(
        int(a) * math.prod(x ** int(e) for x, e in zip(point, each, strict=True))
        for each, a in polynomial.to_dict().items()
    )


def same_span(found, expected, n=2):
    """Whether polynomials of flint, a basis, span the same space as SymPy expressions."""
    x = sympy.symbols(f"x1:{n + 1}")
    terms = [sympy.Poly(each, *x).as_dict() for each in (*found.as_sympy(), *expected)]
    monomials = sorted({e for each in terms for e in each})
    matrix = sympy.Matrix([[each.get(e, 0) for e in monomials] for each in terms])
    return matrix.rank() == len(found) == len(expected)


def at(expression, symbols, values):
    """A SymPy expression with exact values for its symbols."""
    return expression.xreplace(dict(zip(symbols, map(sympy.sympify, values), strict=True)))


# --- The map --------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_the_map_solves_its_equations(n):
    """Kahan's method as a Runge-Kutta method, which does without polarisation."""
    field, eps = random_field(n), F(2, 7)
    map = kahan(field, eps)
    for x in points(n, 3):
        image = map(x)
        middle = field([(a + b) / 2 for a, b in zip(x, image, strict=True)])
        for a, b, *f in zip(x, image, middle, field(x), field(image), strict=True):
            assert (b - a) / eps == 2 * f[0] - f[1] / 2 - f[2] / 2
        assert map.inverse(image) == x
        assert map.inverse.inverse == map


@pytest.mark.parametrize("n", [1, 2, 4])
def test_the_derivative(n):
    """The error of a central difference is of order h**2, in exact arithmetic."""
    map = kahan(random_field(n, seed=3), F(1, 5))
    (x,) = points(n, 1)
    h = F(1, 10**20)
    J = map.jacobian(x)
    for j in range(n):
        ahead, behind = ([a + s * h * (i == j) for i, a in enumerate(x)] for s in (1, -1))
        for i, (a, b) in enumerate(zip(map(ahead), map(behind), strict=True)):
            assert abs((a - b) / (2 * h) - J[i][j]) < F(1, 10**30)
    assert map.determinant(x) == sympy.Matrix(J).det()
    assert all(isinstance(a, Fraction) for a in (*map(x), *J[0], map.determinant(x)))


def test_bodies():
    """One step of reference states, known to 17 digits."""
    four = SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5])
    rotor = SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9)
    cases = [
        (four, 0.4, (0.3, 0.9, -0.6), (0.0963301365636447737, 0.914131910759529574)),
        (rotor, 0.35, (1.1, -0.4), (1.1380011603577656871, 0.043858910560513770418)),
    ]
    for body, eps, start, after in cases:
        image = kahan(QuadraticField.of(body), eps)(start)
        assert [float(a) for a in image[:2]] == pytest.approx(after, rel=1e-15)
    resting = QuadraticField.of(Suslov3D(1, 2, 0, 0))
    assert resting == QuadraticField(np.zeros((2, 2, 2)))


def test_all_numbers_are_taken_exactly():
    field = QuadraticField([[[0.1]]], [[np.int64(3)]], [np.float32(0.1)])
    assert field.quadratic[0][0][0] == F(0.1) != F(1, 10)
    assert field.constant[0] == F(float(np.float32(0.1)))
    assert QuadraticField([[[F(1, 10)]]])([10]) == (10,)
    assert kahan(field, 0.1).eps == F(0.1)
    large = field_of(lambda x: (np.int64(2**40) * x[0] * x[0] + np.int64(3),), 1)
    assert large([2**40])[0] == 2**120 + 3
    halves = QuadraticField([[[0, 1], [0, 0]], [[0, 0], [0, 0]]])
    assert halves == QuadraticField([[[0, 0.5], [0.5, 0]], [[0, 0], [0, 0]]])
    assert hash(halves) == hash(QuadraticField(halves.quadratic))


# --- Degrees --------------------------------------------------------------------------------------


def degrees_by_sympy(field, eps, n):
    """Of the iterates along a line over the rationals, from the Runge-Kutta form of the method."""
    t = sympy.Symbol("t")
    x = sympy.symbols(f"a:{field.dimension}")
    y = sympy.symbols(f"b:{field.dimension}")
    z = sympy.symbols(f"x1:{field.dimension + 1}")
    f = field.components.as_sympy()
    middle = [(a + b) / 2 for a, b in zip(x, y, strict=True)]
    rates = [(at(each, z, middle), at(each, z, x), at(each, z, y)) for each in f]
    equations = [
        sympy.expand(b - a - eps * (2 * m - before / 2 - after / 2))
        for a, b, (m, before, after) in zip(x, y, rates, strict=True)
    ]
    solution = sympy.solve(equations, y)
    state = [sympy.Integer(3 + 2 * i) + (5 - 7 * i) * t for i in range(field.dimension)]
    found = []
    for _ in range(n):
        parts = [sympy.fraction(sympy.cancel(at(solution[b], x, state))) for b in y]
        state = [a / b for a, b in parts]
        common = sympy.lcm_list([b for _, b in parts])
        numerators = [sympy.cancel(a * common / b) for a, b in parts]
        found.append(max(sympy.degree(each, t) for each in (common, *numerators)))
    return found


@pytest.mark.parametrize(
    ("field", "n"),
    [
        (QuadraticField.of(BODY), 3),
        (QuadraticField.of(ROTOR), 3),
        (random_field(2), 3),
        (field_of(of_cubic_hamiltonian, 2), 3),
        (field_of(euler_top, 3), 2),
        (random_field(1), 3),
    ],
)
def test_degrees_are_those_of_sympy(field, n):
    assert degrees(kahan(field, F(1, 3)), n) == degrees_by_sympy(field, sympy.Rational(1, 3), n)


@pytest.mark.parametrize(
    ("field", "n", "expected", "kind", "entropy"),
    [
        (QuadraticField.of(BODY), 30, lambda k: 2 * k, "linear", 0),
        (QuadraticField.of(ROTOR), 12, lambda k: 2 * k, "linear", 0),
        (QuadraticField.of(EQUAL), 12, lambda k: 2 * k, "linear", 0),
        (QuadraticField.of(SuslovND([2, 2, 3], [0, 0, 1])), 12, lambda k: 2 * k, "linear", 0),
        (QuadraticField.of(GENERIC), 6, lambda k: 3**k, "exponential", math.log(3)),
        (
            QuadraticField.of(SuslovND([1.25, 2.125, 3.75, 5], [0.5, -0.75, 0.25, 1])),
            5,
            lambda k: 4**k,
            "exponential",
            math.log(4),
        ),
        (
            QuadraticField.of(SuslovND([1.25, 2.125, 3.75, 5, 7], [0.5, -0.75, 0.25, 1, -0.5])),
            4,
            lambda k: 5**k,
            "exponential",
            math.log(5),
        ),
        (field_of(euler_top, 3), 12, lambda k: 2 * k**2 + 1, "quadratic", 0),
        (field_of(forced, 2), 8, lambda k: 2**k, "exponential", math.log(2)),
        (field_of(lambda x: (x[0] ** 2 + 1,), 1), 8, lambda k: 1, "bounded", 0),
        (QuadraticField.of(Suslov3D(1, 2, 0, 0)), 6, lambda k: 1, "bounded", 0),
        # eps l = -2: all points have the same image.
        (field_of(lambda x: (-8 * x[0] + 1,), 1), 6, lambda k: 0, "bounded", 0),
    ],
)
def test_growth_of_degrees(field, n, expected, kind, entropy):
    found = degrees(kahan(field, EPS), n)
    assert found == [expected(k) for k in range(1, n + 1)]
    result = growth(found)
    assert (result.kind, result.entropy) == (kind, pytest.approx(entropy, abs=1e-14))


def test_planar_cubic_hamiltonians_and_clebsch_grow_quadratically():
    """Their level sets are elliptic curves, and Abelian surfaces."""
    assert growth(degrees(kahan(field_of(of_cubic_hamiltonian, 2), EPS), 16)).kind == "quadratic"
    assert growth(degrees(kahan(field_of(clebsch, 6), 1), 11)).kind == "quadratic"


def test_a_prime_of_bad_reduction_is_passed_over():
    prime = next(integrability._primes(kahan(QuadraticField.of(BODY), 1)))
    for eps in (F(1, prime), F(prime), F(3, prime)):
        map = kahan(QuadraticField.of(BODY), eps)
        assert degrees(map, 5) == [2, 4, 6, 8, 10]
        assert hk_bases(map, 2).dimension == 1
        assert len(darboux_polynomials(map, 3)) == 2


def test_exceptional_lines_are_drawn_again(monkeypatch):
    """A line of steady states has images of degree 1."""
    map = kahan(QuadraticField.of(BODY), EPS)
    true = integrability._degrees_on_a_line
    calls = []

    def with_exceptions(map, n, p, rng):
        calls.append(p)
        if len(calls) == 1:
            return iter([[1] * k for k in range(1, n + 1)])
        if len(calls) == 2:
            raise integrability._BadDrawError
        return true(map, n, p, rng)

    monkeypatch.setattr(integrability, "_degrees_on_a_line", with_exceptions)
    assert degrees(map, 4) == [2, 4, 6, 8]
    assert len({*calls}) == len(calls) == 4

    monkeypatch.setattr(
        integrability,
        "_degrees_on_a_line",
        lambda map, n, p, rng: iter([[rng.randrange(10**9)]]),
    )
    with pytest.raises(ArithmeticError, match="do not agree"):
        degrees(map, 1)


def test_progress():
    calls = []
    degrees(kahan(QuadraticField.of(BODY), EPS), 3, progress=lambda *each: calls.append(each))
    assert calls == [(k, 6) for k in range(1, 7)]


@pytest.mark.parametrize(
    ("sequence", "kind", "entropy"),
    [
        ([2, 2, 2, 2], "bounded", 0),
        ([2, 3, 2, 3, 2, 3, 2, 3], "bounded", 0),
        ([2, 4, 5, 7, 8, 10, 11, 13, 14, 16], "linear", 0),
        ([k**2 + k % 2 for k in range(1, 14)], "quadratic", 0),
        ([k**3 for k in range(1, 13)], "cubic", 0),
        ([k**4 for k in range(1, 13)], "polynomial of degree 4", 0),
        ([7, 3, *(3**k + 1 for k in range(1, 9))], "exponential", math.log(3)),
        ([1, 2, 3, 5, 8, 13], "exponential", math.log((1 + math.sqrt(5)) / 2)),
        ([2, 3, 4], "unclear", math.nan),
        ([], "unclear", math.nan),
        # Without a recurrence: rounded powers.
        ([round(1.5**k) for k in range(1, 20)], "exponential", pytest.approx(math.log(1.5), 0.01)),
        ([round(k**2.05) for k in range(1, 30)], "quadratic", 0),
        ([5, 9, 2, 8, 4, 9, 1, 3, 7, 6, 2, 5], "bounded", 0),
    ],
)
def test_growth_of_sequences(sequence, kind, entropy):
    result = growth(sequence)
    assert result.kind == kind
    assert result.entropy == entropy or (math.isnan(result.entropy) and math.isnan(entropy))


def test_growth_says_what_it_is_based_on():
    assert growth([3, 9, 27, 81]).based_on == "d(k+1) = 3 d(k), all 4 degrees"
    assert growth([1, 0, 1, 0, 1, 0]).based_on == "d(k+2) = d(k), all 6 degrees"
    assert growth([2, 4, 8]).based_on == "3 degrees without a short recurrence"
    assert growth([round(1.5**k) for k in range(1, 20)]).based_on.startswith("a fit to the last 10")


# --- Hirota-Kimura bases --------------------------------------------------------------------------


def assert_relations_hold(map, result):
    """Along the exact orbit, forwards and backwards."""
    x = y = result.point
    for _ in range(5):
        assert all(value(each, z) == 0 for each in result.polynomials for z in (x, y))
        x, y = map(x), map.inverse(y)
    assert sympy.Matrix(result.basis).rank() == len(result.basis) == result.dimension


def assert_quotients_are_integrals(map, polynomials):
    for x in points(map.dimension, 3):
        before, after = ([value(P, y) for P in polynomials] for y in (x, map(x)))
        assert all(a * before[0] == b * after[0] for a, b in zip(after, before, strict=True))


def lemma_1(body, eps, k=0):
    """Numerator and denominator of the first integral of Lemma 1, and of theory's last section."""
    x1, x2 = sympy.symbols("x1 x2")
    I1, I2, I13, I23, eps, k = (
        sympy.Rational(str(F(a))) for a in (body.I1, body.I2, body.I13, body.I23, eps, k)
    )
    x = I13 * x1 + I23 * x2 + k
    return x, I1 * x1**2 + I2 * x2**2, sympy.expand(4 * I1 * I2 + eps**2 * x**2)


@pytest.mark.parametrize(("body", "k"), [(BODY, 0), (ROTOR, ROTOR.k)])
def test_first_integral_and_measure_in_three_dimensions(body, k):
    map = kahan(QuadraticField.of(body), EPS)
    x, energy, denominator = lemma_1(body, EPS, k)
    assert hk_bases(map, 1).dimension == 0
    found = hk_bases(map, 2)
    assert (found.dimension, found.independent) == (1, 1)
    assert_relations_hold(map, found)
    assert_quotients_are_integrals(map, found.integrals)
    assert same_span(found.integrals, [energy, denominator])
    assert darboux_polynomials(map, 2) == ()
    densities = darboux_polynomials(map, 3)
    assert same_span(densities, [sympy.expand(x * each) for each in (energy, denominator)])


def test_bodies_whose_problem_is_solved():
    map = kahan(QuadraticField.of(EQUAL), EPS)
    plane = hk_bases(map, 1)  # the direction orthogonal to I is constant
    assert (plane.dimension, plane.independent) == (1, 1)
    assert_quotients_are_integrals(map, plane.integrals)
    found = hk_bases(map, 2)
    assert found.independent == 2
    assert_relations_hold(map, found)


def test_first_integral_of_a_solved_body():
    map = kahan(QuadraticField.of(SuslovND(J=[2, 2, 3], I=[0, 0, 1])), F(1, 2))
    # det DPhi without its part that the direction orthogonal to I has.
    found = darboux_polynomials(map, 2, lambda x: map.determinant(x) * (x[0] / map(x)[0]) ** 2)
    # 2E and 4 a b + eps**2 |I|**2 |Omega_perp|**2
    assert_quotients_are_integrals(map, found)
    x = sympy.symbols("x1:4")
    expected = [
        2 * x[0] ** 2 + 2 * x[1] ** 2 + 3 * x[2] ** 2,
        24 + (x[0] ** 2 + x[1] ** 2) / 4,
    ]
    assert same_span(found, expected, 3)


@pytest.mark.parametrize(("n", "degree"), [(4, 10), (5, 8), (6, 6)])
def test_no_rational_integral_of_a_generic_body(n, degree):
    J = [1.25, 2.125, 3.75, 5.5, 7][: n - 1]
    I = [0.5, -0.75, 0.25, 1, -0.625][: n - 1]
    map = kahan(QuadraticField.of(SuslovND(J=J, I=I)), 0.5)
    assert hk_bases(map, degree).dimension == 0
    assert darboux_polynomials(map, 6 if n == 4 else 3) == ()


def test_euler_top():
    """Hirota and Kimura (2000); Petrera and Suris (2007) for the measures."""
    map = kahan(field_of(euler_top, 3), 1)
    found = hk_bases(map, 2)
    assert (found.dimension, found.independent) == (2, 2)
    assert_relations_hold(map, found)
    assert_quotients_are_integrals(map, found.integrals)
    x = sympy.symbols("x1:4")
    alpha = (2, -3, 1)
    of = [1 - sympy.Rational(alpha[i - 2] * alpha[i - 1], 4) * x[i] ** 2 for i in range(3)]
    assert same_span(found.integrals, of, 3)
    squares = [sympy.expand(of[i] * of[j]) for i in range(3) for j in range(i + 1)]
    assert same_span(darboux_polynomials(map, 4), squares, 3)


def test_clebsch():
    """Petrera, Pfadler, Suris (2011): dimensions 4 and 1, four independent integrals."""
    map = kahan(field_of(clebsch, 6), 1)
    units = np.eye(6, dtype=int)
    squares = (2 * units).tolist()
    mixed = [(units[i] + units[i + 3]).tolist() for i in range(3)]
    found = hk_bases(map, [*squares, *mixed, [0] * 6])
    assert (found.dimension, found.independent) == (4, 4)
    assert_relations_hold(map, found)
    of_p = hk_bases(map, [*squares[3:], [0] * 6])
    assert (of_p.dimension, of_p.independent) == (1, 1)
    assert_quotients_are_integrals(map, of_p.integrals)
    assert hk_bases(map, squares).dimension == 0


def test_planar_cubic_hamiltonian():
    """Celledoni, McLachlan, Owren, Quispel (2013): a modified Hamiltonian, and a measure."""
    field, eps = field_of(of_cubic_hamiltonian, 2), F(1, 3)
    map = kahan(field, eps)
    found = hk_bases(map, 3)
    assert (found.dimension, found.independent) == (1, 1)
    assert_relations_hold(map, found)

    q, p = sympy.symbols("q p")
    H = cubic_hamiltonian((q, p))
    f = sympy.Matrix([H.diff(p), -H.diff(q)])
    step = sympy.Rational(1, 3)
    gradient = sympy.Matrix([H.diff(q), H.diff(p)])
    solved = (sympy.eye(2) - step / 2 * f.jacobian([q, p])).LUsolve(f)
    modified = H + step / 3 * gradient.dot(solved)
    for x in points(2, 3):
        assert at(modified, (q, p), map(x)) == at(modified, (q, p), x)
    (density,) = darboux_polynomials(map, 2)[:1]
    for x in points(2, 3):
        assert value(density, map(x)) == map.determinant(x) * value(density, x)


def test_the_orbit_of_a_point_of_ones_own():
    map = kahan(QuadraticField.of(BODY), EPS)
    found = hk_bases(map, 2, point=[1, 0.5])
    assert found.point == (1, F(1, 2))
    (row,) = found.basis
    assert row[-1] == 1
    assert_relations_hold(map, found)
    # The coefficients are the same for all points of the orbit, and differ between orbits.
    assert hk_bases(map, 2, point=map([1, 0.5])).basis == found.basis
    assert hk_bases(map, 2, point=[2, 0.5]).basis != found.basis
    assert hk_bases(map, 1, point=[1, -2]).dimension == 2  # a steady state


# --- Darboux polynomials --------------------------------------------------------------------------


def test_lotka_volterra_has_the_measure_of_the_continuous_problem():
    map = kahan(field_of(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2), EPS)
    assert [str(P) for P in darboux_polynomials(map, 2)] == ["x1*x2"]
    assert hk_bases(map, 4).dimension == 0
    assert growth(degrees(map, 8)).kind == "exponential"


def test_a_constant_force_leaves_a_measure_but_no_integral():
    map = kahan(field_of(forced, 2), EPS)
    assert [str(P) for P in darboux_polynomials(map, 3)] == ["x1^3 + 63*x1"]
    assert hk_bases(map, 6).dimension == 0


def test_cofactors():
    map = kahan(QuadraticField.of(BODY), EPS)
    line, energy, denominator = lemma_1(BODY, EPS)
    constants = darboux_polynomials(map, 2, 1)
    assert [str(P) for P in constants] == ["1"]

    def factor(x):
        before, after = (at(line, sympy.symbols("x1 x2"), each) for each in (x, map(x)))
        return after / before

    found = darboux_polynomials(map, 1, factor)
    assert same_span(found, [line])
    found = darboux_polynomials(map, 2, lambda x: map.determinant(x) / F(str(factor(x))))
    assert same_span(found, [energy, denominator])
    assert darboux_polynomials(map, 2, F(2)) == ()


def test_long_coefficients():
    """Parameters that are floats have denominators of 2**54."""
    body = Suslov3D(I1=4.1, I2=1.3, I13=-0.7, I23=-0.3)
    map = kahan(QuadraticField.of(body), 0.2)
    x, energy, denominator = lemma_1(body, 0.2)
    assert same_span(hk_bases(map, 2).integrals, [energy, denominator])
    assert same_span(
        darboux_polynomials(map, 3), [sympy.expand(x * each) for each in (energy, denominator)]
    )


# --- What users see -------------------------------------------------------------------------------


def test_results_depend_on_nothing_but_the_seed():
    map = kahan(field_of(euler_top, 3), 1)
    assert hk_bases(map, 2) == hk_bases(map, 2)
    assert hk_bases(map, 2).point != hk_bases(map, 2, seed=1).point
    assert darboux_polynomials(map, 4) == darboux_polynomials(map, 4)
    assert degrees(map, 4) == degrees(map, 4, seed=5)


def test_what_is_printed():
    field = QuadraticField.of(BODY)
    assert repr(field) == (
        "QuadraticField(x1' = 1/8*x1*x2 + 1/16*x2^2, x2' = -1/2*x1^2 - 1/4*x1*x2)"
    )
    map = kahan(field, 0.25)
    assert repr(map) == f"kahan({field}, eps=1/4)"
    assert repr(hk_bases(map, 2)) == (
        "<HKBasis of dimension 1 among 6 monomials, independent=1, "
        "integrals=(4*x1^2 + x2^2, x1*x2 + 1024)>"
    )
    a, b = sympy.symbols("a b")
    assert hk_bases(map, 2).integrals.as_sympy([a, b]) == [4 * a**2 + b**2, a * b + 1024]
    (relation,) = hk_bases(map, 2, point=[1, 2]).as_sympy()
    assert str(relation) == "2052*x1**2 - 4*x1*x2 + 513*x2**2 - 4096"
    assert len(repr(QuadraticField(np.ones((9, 9, 9))))) < 320


MAP = kahan(QuadraticField.of(BODY), EPS)
BAD = [
    (lambda: QuadraticField([[1, 2], [3, 4]]), ValueError, r"quadratic: .*\(D, D, D\).*\(2, 2\)"),
    (lambda: QuadraticField(3), ValueError, r"quadratic: .*got \(\)"),
    (lambda: QuadraticField([]), ValueError, r"quadratic: .*got \(0,\)"),
    (lambda: QuadraticField([[[1, 2], [3]]]), ValueError, "quadratic: .*rows of different lengths"),
    (lambda: QuadraticField([[[1j]]]), TypeError, "quadratic: .*fractions or floats, got complex"),
    (lambda: QuadraticField([[[math.nan]]]), ValueError, "quadratic: .*finite numbers, got nan"),
    (lambda: QuadraticField([[[1]]], [1, 2]), ValueError, r"linear: .*\(1, 1\), got \(2,\)"),
    (lambda: QuadraticField([[[1]]], None, 1), ValueError, r"constant: .*\(1,\), got \(\)"),
    (lambda: field_of(lambda x: (x[0] ** 3,), 1), ValueError, "f: .*degree 2"),
    (lambda: field_of(lambda x: x, 0), ValueError, "dimension: .*at least 1, got 0"),
    (lambda: field_of(lambda x: (1, 2), 1), ValueError, r"the value of f: .*\(1,\), got \(2,\)"),
    (lambda: QuadraticField.of(3), TypeError, "body: expected Suslov3D.*got int"),
    (
        lambda: QuadraticField.of(Suslov3D([1, 2], 1, 0, 1)),
        ValueError,
        r"body: expected a single body, got a batch of shape \(2,\)",
    ),
    (lambda: kahan(BODY, 1), TypeError, r"field: .*got Suslov3D; QuadraticField\.of"),
    (lambda: kahan(QuadraticField.of(BODY), "x"), TypeError, "eps: .*got str"),
    (lambda: kahan(QuadraticField.of(BODY), [1, 2]), ValueError, r"eps: .*shape \(\)"),
    (lambda: kahan(QuadraticField.of(BODY), None), TypeError, "eps: .*got NoneType"),
    (lambda: kahan(field_of(lambda x: (2 * x[0],), 1), 1), ValueError, "singular everywhere"),
    (lambda: MAP([1]), ValueError, r"point: .*\(2,\), got \(1,\)"),
    (lambda: kahan(QuadraticField([[[1]]]), 1)([1]), ZeroDivisionError, r"\(1\) has no image"),
    (lambda: degrees(BODY, 3), TypeError, "map: .*got Suslov3D"),
    (lambda: degrees(MAP, -1), ValueError, "n: .*got -1"),
    (lambda: degrees(MAP, 2.0), TypeError, "n: .*got float"),
    (lambda: degrees(MAP, 2, progress=3), TypeError, "progress: "),
    (lambda: growth([1, 2.5]), TypeError, "degrees: .*got float"),
    (lambda: growth(3), TypeError, "degrees: expected a sequence of integers, got int"),
    (lambda: growth([1, -2]), ValueError, "degrees: .*got -2"),
    (lambda: hk_bases(MAP, -1), ValueError, "monomials: .*got -1"),
    (lambda: hk_bases(MAP, 2.5), TypeError, "monomials: .*a degree or a list.*2.5"),
    (lambda: hk_bases(MAP, []), ValueError, "monomials: .*at least one"),
    (lambda: hk_bases(MAP, [(1, 0), (1, 0)]), ValueError, "monomials: .*none twice"),
    (lambda: hk_bases(MAP, [(1, 0, 0)]), ValueError, r"monomials: expected 2 .*\(1, 0, 0\)"),
    (lambda: hk_bases(MAP, 2, point=[1, 2, 3]), ValueError, r"point: .*\(2,\), got \(3,\)"),
    (lambda: MAP.field.components.as_sympy([1]), ValueError, "symbols: expected 2, got 1"),
    (lambda: darboux_polynomials(MAP, 1.5), TypeError, "degree: .*got float"),
    (lambda: darboux_polynomials(MAP, 1, "x"), TypeError, "cofactor: .*got str"),
    (lambda: darboux_polynomials(MAP, 1, lambda x: 0.5), TypeError, "cofactor: .*got float"),
    (lambda: field_of(lambda x: (0.1 * x[0],), 1), TypeError, "the value of f: .*got float"),
    (lambda: darboux_polynomials(MAP, 1, lambda x: x), ValueError, r"cofactor: .*shape \(\)"),
    (lambda: darboux_polynomials(MAP, 1, lambda x: 1 / F(0)), ArithmeticError, "undefined at most"),
]


@pytest.mark.parametrize(("call", "error", "message"), BAD)
def test_bad_input(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_units_are_refused():
    class Quantity(float):
        unit = "ms"

    with pytest.raises(TypeError, match="eps: expected numbers without units, got Quantity"):
        kahan(QuadraticField.of(BODY), Quantity(20))


def test_an_orbit_that_ends_at_a_pole():
    map = kahan(QuadraticField([[[1]]]), 1)
    with pytest.raises(ArithmeticError, match="points without an image"):
        hk_bases(map, 2, point=[F(1, 3)])  # 1/3, 1/2, 1


def test_without_python_flint():
    code = (
        "import sys; sys.modules['flint'] = None\n"
        "import suslov_fast\n"
        "try:\n    from suslov_fast import integrability\n"
        "except ImportError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == (
        "suslov_fast.integrability needs python-flint: pip install 'suslov_fast[algebra]'"
    )


def test_primes():
    primes = list(islice(integrability._primes(MAP), 3))
    assert [2**62 - p for p in primes] == sorted(2**62 - p for p in primes)
    assert all(sympy.isprime(p) for p in primes)


def test_the_reference_has_every_public_name():
    text = (Path(__file__).parent.parent / "docs" / "api.md").read_text(encoding="utf-8")
    listed = re.findall(r"^   integrability\.(\w+)$", text, re.MULTILINE)
    assert sorted(listed) == sorted(integrability.__all__)
