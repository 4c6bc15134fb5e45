"""Exact computations for Kahan maps, against published results and SymPy."""

import json
import math
import random
from fractions import Fraction as F
from itertools import product

import numpy as np
import pytest
import sympy

from suslov_fast import QuadraticField, Suslov3D, SuslovGyrostat, SuslovND
from suslov_fast._cli import main
from suslov_fast.integrability import (
    _exact,
    _growth,
    cofactors,
    darboux_polynomials,
    degrees,
    growth,
    hk_bases,
    kahan,
    report,
    zoo,
)

BODY = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25)
ROTOR = SuslovGyrostat(2, 3, 0.5, -0.25, 0.75)
EPS = F(1, 4)
J, I = [1.25, 2.125, 3.75, 5, 7], [0.5, -0.75, 0.25, 1, -0.5]
field_of, of = QuadraticField.from_function, QuadraticField.of
MAP = kahan(of(BODY), EPS)
EULER = kahan(field_of(lambda x: (2 * x[1] * x[2], -3 * x[2] * x[0], x[0] * x[1]), 3), 1)
# H = x^3 + 2 x y^2 - y^3 + x y + x^2 - 3 y
CUBIC = field_of(
    lambda x: (
        4 * x[0] * x[1] - 3 * x[1] ** 2 + x[0] - 3,
        -(3 * x[0] ** 2 + 2 * x[1] ** 2 + x[1] + 2 * x[0]),
    ),
    2,
)
PREY = kahan(field_of(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2), EPS)
FORCED = field_of(lambda x: (x[0] * x[1], -(x[0] ** 2) - 1), 2)


def clebsch(x):
    """Petrera, Pfadler, Suris (2011): (m, p) with omega = (1, 2, 5)."""
    m, p, omega = x[:3], x[3:], (1, 2, 5)
    after = [((i + 1) % 3, (i + 2) % 3) for i in range(3)]
    return (
        *((omega[k] - omega[j]) * p[j] * p[k] for j, k in after),
        *(m[k] * p[j] - m[j] * p[k] for j, k in after),
    )


CLEBSCH = kahan(field_of(clebsch, 6), 1)


def random_field(n, seed=0):
    rng = np.random.default_rng(seed)
    return QuadraticField(*(rng.integers(-3, 4, (n,) * k) for k in (3, 2, 1)))


def value(P, x):
    terms = P.to_dict().items()
    return sum(int(c) * math.prod(map(pow, x, map(int, powers))) for powers, c in terms)


def assert_same_span(found, expected):
    x = sympy.symbols("x1 x2")
    terms = [sympy.Poly(str(each), *x).as_dict() for each in (*found, *expected)]
    monomials = {e for each in terms for e in each}
    matrix = sympy.Matrix([[each.get(e, 0) for e in monomials] for each in terms])
    assert matrix.rank() == len(found) == len(expected)


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_the_map_its_inverse_and_its_derivative(n):
    field, eps, h = random_field(n), F(-2, 7), F(1, 10**20)
    map, rng = kahan(field, eps), random.Random(1)
    x = [F(rng.randrange(-99, 99), 7) for _ in range(n)]
    image, jacobian = map(x), map.jacobian(x)
    middle = field([(a + b) / 2 for a, b in zip(x, image, strict=True)])
    for a, b, m, *ends in zip(x, image, middle, field(x), field(image), strict=True):
        assert (b - a) / eps == 2 * m - sum(ends) / 2
    assert map.inverse(image) == tuple(x)
    for j in range(n):
        ahead, behind = (map([a + s * h * (i == j) for i, a in enumerate(x)]) for s in (1, -1))
        for i in range(n):
            assert abs((ahead[i] - behind[i]) / (2 * h) - jacobian[i][j]) < F(1, 10**28)
    assert map.determinant(x) == sympy.Matrix(jacobian).det()
    assert all(type(a) is F for a in (*image, *jacobian[0], map.determinant(x)))


@pytest.mark.parametrize(
    ("field", "n", "law", "kind", "entropy"),
    [
        (of(BODY), 30, lambda k: 2 * k, "linear", 0),
        (of(ROTOR), 12, lambda k: 2 * k, "linear", 0),
        (of(SuslovND([2, 2, 2], I[:3])), 12, lambda k: 2 * k, "linear", 0),
        (of(SuslovND(J[:3], I[:3])), 6, lambda k: 3**k, "exponential", math.log(3)),
        (of(SuslovND(J[:4], I[:4])), 5, lambda k: 4**k, "exponential", math.log(4)),
        (of(SuslovND(J, I)), 5, lambda k: 5**k, "exponential", math.log(5)),
        (EULER.field, 12, lambda k: 2 * k**2 + 1, "quadratic", 0),
        (FORCED, 8, lambda k: 2**k, "exponential", math.log(2)),
        (random_field(1), 8, lambda k: 1, "bounded", 0),
        # Every point has the same image.
        (QuadraticField([[[0]]], [[-8]], [1]), 6, lambda k: 0, "bounded", 0),
        # Elliptic curves and Abelian surfaces.
        (CUBIC, 16, None, "quadratic", 0),
        (CLEBSCH.field, 9, None, "quadratic", 0),
    ],
)
def test_growth_of_degrees(field, n, law, kind, entropy):
    found = degrees(kahan(field, EPS), n)
    assert not law or found == [law(k) for k in range(1, n + 1)]
    assert growth(found)[:2] == (kind, pytest.approx(entropy, abs=1e-14))


HENON_HEILES = [3, 7, 17, 39, 93, 215, 495, 1137, 2615, 6007, 13797]  # eps = 1/2


@pytest.mark.parametrize(
    ("sequence", "kind", "entropy", "error"),
    [
        ([2, 3] * 4, "bounded", 0, 0),
        ([0] * 5, "bounded", 0, 0),
        ([2, 3, 4, 4, 4, 4, 4, 4], "bounded", 0, 0),
        ([2, 4, 6, 8, 10, 12], "linear", 0, 0),
        ([2, 4, 5, 7, 8, 10, 11, 13, 14, 16], "linear", 0, 0),
        ([6, 19, 42, 73, 114, 163, 222, 289, 366], "quadratic", 0, 0),
        ([k**3 for k in range(1, 13)], "cubic", 0, 0),
        ([7, 3, *(3**k + 1 for k in range(1, 60))], "exponential", math.log(3), 0),
        ([1, 2, 3, 5, 8, 13, 21], "exponential", math.log((1 + math.sqrt(5)) / 2), 0),
        # Fits. The true value is within their spread.
        ([1, 2, 3, 5, 8, 13], "exponential", math.log((1 + math.sqrt(5)) / 2), 0.06),
        ([round(1.5**k) for k in range(1, 20)], "exponential", math.log(1.5), 0.01),
        (HENON_HEILES, "exponential", 0.832, 0.002),
        (HENON_HEILES[:7], "exponential", 0.832, 0.04),
        ([round(k**2.05) for k in range(1, 30)], "quadratic", 0, 0.08),
        # Nothing fits.
        ([1, 5, 2, 7, 9, 1, 1, 1], "unclear", None, None),
        ([2, 4, 8, 16, 32, 64, 100], "unclear", None, None),
        ([5, 9, 2, 8, 4, 9, 1, 3, 7, 6, 2, 5], "unclear", None, None),
        ([1, 1, 1, 1, 1, 1, 2], "unclear", None, None),
        ([2, 3, 4], "unclear", None, None),
        ([], "unclear", None, None),
    ],
)
def test_growth_of_sequences(sequence, kind, entropy, error):
    found = growth(sequence)
    assert found.kind == kind
    if entropy is None:
        assert math.isnan(found.entropy)
        assert math.isnan(found.entropy_error)
    elif error:
        assert abs(found.entropy - entropy) <= found.entropy_error <= error
    else:
        assert found[1:3] == (pytest.approx(entropy, abs=1e-14), 0)


def test_growth_states_its_basis():
    assert growth([1, 1, 2, 3, 5, 8, 13]).based_on == "d(k+2) = 1 d(k+1) + 1 d(k), all 7 degrees"
    assert growth([2, 4, 8]).based_on == "3 degrees without a short recurrence"
    assert growth(HENON_HEILES).based_on.startswith("a fit to the last 5 of 11 degrees")


@pytest.mark.parametrize(
    ("body", "k"), [(BODY, 0), (ROTOR, F(3, 4)), (Suslov3D(4.1, 1, -0.7, 0.3), 0)]
)
@pytest.mark.sampled(2)
def test_integral_and_measure_of_lemma_1(body, k):
    a, b, c, d, eps, k = (
        sympy.Rational(str(F(each))) for each in (body.I1, body.I2, body.I13, body.I23, EPS, k)
    )
    x1, x2 = sympy.symbols("x1 x2")
    x = c * x1 + d * x2 + k
    lemma = [a * x1**2 + b * x2**2, 4 * a * b + eps**2 * x**2]
    map = kahan(of(body), EPS)
    assert hk_bases(map, 1).dimension == 0
    found = hk_bases(map, 2)
    assert (found.dimension, found.independent) == (1, 1)
    assert_same_span(found.integrals, lemma)
    assert darboux_polynomials(map, 2) == ()
    assert_same_span(darboux_polynomials(map, 3), [x * each for each in lemma])


@pytest.mark.parametrize(
    ("map", "monomials", "dimension", "independent"),
    [
        (EULER, 2, 2, 2),
        (kahan(CUBIC, EPS), 3, 1, 1),
        (CLEBSCH, [*(2 * np.eye(6, dtype=int))[3:], [0] * 6], 1, 1),
        (kahan(of(SuslovND([2, 2, 2], I[:3])), EPS), 1, 1, 1),
    ],
)
def test_hirota_kimura_bases(map, monomials, dimension, independent):
    found = hk_bases(map, monomials)
    assert (found.dimension, found.independent) == (dimension, independent)
    assert found == hk_bases(map, monomials)
    x = y = found.point
    start = [F(k, 7) for k in range(2, 2 + map.dimension)]
    before, after = ([value(P, z) for P in found.integrals] for z in (start, map(start)))
    assert all(a * before[0] == b * after[0] for a, b in zip(after, before, strict=True))
    assert len(found.integrals) > 1
    for _ in range(4):
        x, y = map(x), map.inverse(y)
        assert all(value(P, z) == 0 for P in found.polynomials for z in (x, y))


SIR = field_of(lambda x: (-2 * x[0] * x[1], 2 * x[0] * x[1] - x[1], x[1]), 3)
FOOD_CHAIN = field_of(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - x[2]), x[2] * (x[1] - 1)), 3)
CYCLE = field_of(lambda x: [x[k] * (x[(k + 1) % 3] - x[k - 1]) for k in range(3)], 3)


@pytest.mark.parametrize(
    ("field", "lowest", "independent"),
    [(EULER.field, 2, 2), (of(BODY), 2, 1), (SIR, 1, 1), (FOOD_CHAIN, 2, 1), (CYCLE, 3, 2)],
)
def test_a_higher_degree_loses_no_integral(field, lowest, independent):
    map = kahan(field, EPS)
    start = [F(k, 7) for k in range(2, 2 + map.dimension)]
    for degree in range(lowest, 5):
        found = hk_bases(map, degree)
        assert (found.degree, found.independent, found.complete) == (lowest, independent, True)
        assert "try" not in repr(found)
        assert len(found.integrals) == independent + 1
        before, after = ([value(P, z) for P in found.integrals] for z in (start, map(start)))
        assert all(a * before[0] == b * after[0] for a, b in zip(after, before, strict=True))
    assert lowest == 1 or hk_bases(map, lowest - 1).independent < independent


def test_cofactors():
    """Every cofactor with a polynomial is found, and each is a product of the factors."""
    found = cofactors(PREY, 2)
    polynomials = {str(P) for C in found for P in darboux_polynomials(PREY, 2, C)}
    assert polynomials == {"1", "x1", "x2", "x1*x2", "x1^2", "x2^2"}
    x = (F(1, 7), F(-3, 5))
    values = [C(x) for C in found]
    assert {F(1), PREY.determinant(x), PREY(x)[0] / x[0]} < {*values}
    C = found[1]
    assert C(x) == F(value(C.numerator, x)) / value(C.denominator, x)
    assert float(sympy.sympify(str(C)).subs({"x1": x[0], "x2": x[1]})) == float(C(x))


PLANAR = zoo()["generic planar field"][0]
ENERGY = QuadraticField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)


@pytest.mark.parametrize(
    ("body", "degree", "kind", "integrals", "measures", "planes", "left"),
    [
        (BODY, 3, "linear", [2], 3, ["2*x1 + x2"], 1),
        (CYCLE, 3, "quadratic", [1, 3], 2, ["x1", "x2", "x3", "x1 + x2 + x3"], 1),
        # The map sends the line det A = 0 to infinity.
        (ENERGY, 1, "quadratic", [3], 1, [], 1),
        (PLANAR, 3, "exponential", [], None, [], 2),
    ],
)
def test_report(body, degree, kind, integrals, measures, planes, left):
    found, map = report(body, EPS, degree), kahan(of(body), EPS)
    x = [F(k, 7) for k in range(2, 2 + map.dimension)]
    assert (found.growth.kind, found.dimension, found.finished) == (kind, left, True)
    assert [each.degree for each in found.integrals] == integrals
    assert [str(each) for each in found.hyperplanes] == planes
    assert all(f(map(x)) == f(x) for f in found.integrals)
    assert all(f(map(x)) * map.determinant(x) == f(x) for f in found.measures)
    assert all(P(map(x)) == P.cofactor(x) * P(x) for P in found.polynomials)
    assert [f.degree for f in found.measures[:1]] == ([measures] if measures else [])
    for each in (*found.integrals, *found.measures, *found.polynomials):
        assert each.basis == "identity"
        parameters = dict(zip(sympy.symbols("x1 x2 x3"), map_to_sympy(x), strict=False))
        assert sympy.sympify(str(each)).subs(parameters) == sympy.Rational(str(each(x)))
    text = repr(found)
    assert 8 <= len(text.splitlines()) <= 12
    assert max(len(line) for line in text.splitlines()) < 340
    assert text.count(f"none found up to degree {degree}") == text.count(": none")
    assert text.count(": none") == (not integrals) * 3 + (not planes)
    assert ("evidence, not a proof" in text, "proved" in text) == (True, bool(integrals))
    assert (
        found._repr_latex_().count("&=") == 1 + len(integrals) + len(found.polynomials) + left % 2
    )
    plain = json.loads(json.dumps(found.to_dict()))
    assert [each["degree"] for each in plain["integrals"]] == integrals
    assert QuadraticField.from_dict(plain["field"]) == of(body)
    assert repr(report(body, str(EPS), degree, seed=5)) == text


def test_reports_beyond_the_degree_and_with_long_numbers():
    """The quadratic integrals have irrational coefficients; those of degree 4 are norms of them."""

    def nambu(x):
        a, b = (2 * x[0], 4 * x[1], 6 * x[2]), (x[1], x[0], 2 * x[2] + 1)
        return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]

    found = report(field_of(nambu, 3), F(1, 3), 2)
    assert (found.relations, [each.degree for each in found.integrals]) == (2, [4, 4])
    assert "up to degree 4, since relations show more" in repr(found)
    map = kahan(of(Suslov3D(2.3, 1.4, 0.5, -0.7)), EPS)
    (energy,) = report(map.field, EPS, 4).integrals
    assert energy(map([1, 2])) == energy([1, 2])


def map_to_sympy(x):
    return [sympy.Rational(a.numerator, a.denominator) for a in x]


def other_point(curves, center, x):
    """The other point of the line through x and the center on the curve of x."""
    X, Y, Z = center
    step = (F(X), F(Y)) if Z == 0 else tuple(F(c, Z) - a for c, a in zip((X, Y), x, strict=True))
    P, Q = curves
    c = value(P, x) / value(Q, x)

    def on_line(t):
        y = [a + t * b for a, b in zip(x, step, strict=True)]
        return value(P, y) - c * value(Q, y)

    if curves[0].total_degree() == 2 or Z == 0:  # the value is t (a + b t)
        a, b = (on_line(1) - on_line(-1)) / 2, (on_line(1) + on_line(-1)) / 2
        t = -a / b
    else:  # it is a t (t - 1) (t - b), with the base point at t = 1
        ratio = on_line(2) / on_line(-1)  # (b - 2) / (b + 1)
        t = (2 + ratio) / (1 - ratio)
    return [a + t * b for a, b in zip(x, step, strict=True)]


NAHM = zoo()["Nahm, octahedral"][0]
LINES = QuadraticField.from_hamiltonian(lambda x: x[0] * x[1] * (x[0] + x[1] - 1), 2)


@pytest.mark.parametrize(
    ("body", "degree", "genus", "rational", "involutions"),
    [
        (BODY, 2, 0, 0, True),
        (ROTOR, 2, 0, 0, True),
        (LINES, 3, 1, 9, True),
        (NAHM, 4, 1, 16, False),
    ],
)
def test_pencils(body, degree, genus, rational, involutions):
    found, map = report(body, EPS, degree).pencil, kahan(of(body), EPS)
    assert (found.degree, found.genus, found.irrational) == (degree, genus, degree**2 - rational)
    curves = found.P, found.Q
    for (X, Y, Z), _ in found.base_points:
        for P in curves:  # in homogeneous coordinates
            terms = P.to_dict().items()
            assert sum(int(c) * X**i * Y**j * Z ** (degree - i - j) for (i, j), c in terms) == 0
    assert sum(m for _, m in found.base_points) == rational
    assert bool(found.involutions) == involutions
    if involutions:
        last, first = found.involutions
        for x in ([F(1, 3), F(2, 5)], [F(-7, 4), F(3)]):
            assert tuple(other_point(curves, last, other_point(curves, first, x))) == map(x)
    if body is BODY:
        # At infinity of the line of steady states, and where the map is undefined.
        D = body.I13**2 * body.I2 + body.I23**2 * body.I1
        scale = F(2 * body.I1 * body.I2 / D) / EPS
        X, Y, Z = first
        assert (F(X, Z), F(Y, Z)) == (F(body.I23) * scale, -F(body.I13) * scale)
        assert last[0] * body.I13 == -last[1] * body.I23
        assert last[2] == 0


def test_singular_curves():
    """The curves through the product of three lines, and those of the Suslov body, by hand."""
    pencil = report(LINES, EPS, 3).pencil
    x1, x2, c = sympy.symbols("x1 x2 c")
    P, Q = (sympy.sympify(str(each).replace("^", "**")) for each in (pencil.P, pencil.Q))
    member = P - c * Q
    for f in pencil.singular:
        (value_of_c,) = sympy.solve(sympy.sympify(str(f)), c)
        curve = member.subs(c, value_of_c)
        singular = sympy.solve([curve, curve.diff(x1), curve.diff(x2)], [x1, x2], dict=True)
        assert singular
    assert len(pencil.singular) == 4


@pytest.mark.parametrize(
    ("field", "integrals"),
    [
        # Every point has the same image.
        (QuadraticField([[[0]]], [[-8]], [1]), []),
        (QuadraticField([[[4]]], constant=[-4]), []),
        (QuadraticField.from_hamiltonian(lambda x: 0 * x[0] + 1, 2), [1, 1]),
        (field_of(lambda x: (x[1] ** 2, 1), 2), [3]),
        (field_of(lambda x: (x[1], -x[0]), 2), [2]),
        (field_of(lambda x: (8 * x[0] + 16 * x[1], 8 * x[0] + 8 * x[1]), 2), [4]),  # det DPhi = -1
    ],
)
def test_reports_of_simple_fields(field, integrals):
    found = report(field, EPS)
    assert (found.growth.kind, [f.degree for f in found.integrals]) == ("bounded", integrals)
    map = kahan(field, EPS)
    x = [F(k, 7) for k in range(2, 2 + map.dimension)]
    assert all(f(map(x)) == f(x) for f in found.integrals)
    assert all(f(map(x)) * map.determinant(x) == f(x) for f in found.measures)


def test_a_report_that_is_cut_short():
    assert not report(CYCLE, EPS, time_limit=0).finished

    def interrupt(done, parts):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        report(CYCLE, EPS, progress=interrupt)
    found = stopped.value.report
    assert (found.growth.kind, found.relations, found.integrals) == ("quadratic", 2, ())
    assert "Not finished" in repr(found)
    assert "First integrals: none found so far" in repr(found)
    assert "0.1 is taken exactly" in repr(report(BODY, 0.1, 1))
    assert "Fraction(1, 10)" in repr(report(BODY, 0.1, 1))


def test_the_command(tmp_path, capsys):
    path = tmp_path / "field.json"
    path.write_text(json.dumps(CYCLE.to_dict()))
    command = ["report", "--body", str(path), "--eps", "1/4", "--degree", "1"]
    for more, status in (([], 0), (["--json"], 0), (["--degree", "99"], 2), (["--eps", "1/0"], 2)):
        with pytest.raises(SystemExit) as end:
            main([*command, *more])
        assert end.value.code == status
        printed, error = capsys.readouterr()
        assert ("expected" in error) == bool(status)
        if not status:
            whole = json.loads(printed) if more else {"integrals": [{"formula": printed}]}
            assert "x1 + x2 + x3" in whole["integrals"][0]["formula"]


def test_relations_without_a_quotient():
    units = np.eye(6, dtype=int)
    squares, mixed = 2 * units, units[:3] + units[3:]
    found = hk_bases(CLEBSCH, [*squares, *mixed, [0] * 6])
    assert (found.dimension, found.independent, found.integrals) == (4, 4, ())
    assert not found.complete
    assert repr(found).endswith("; 4 more independent: try a higher degree, or `report`")
    assert hk_bases(CLEBSCH, squares).dimension == 0
    assert hk_bases(kahan(of(SuslovND([2, 2, 2], I[:3])), EPS), 2).independent == 2


def test_the_orbit_of_a_point():
    found = hk_bases(MAP, 2, point=[1, 2])
    assert str(found.polynomials[0]) == "2052*x1^2 - 4*x1*x2 + 513*x2^2 - 4096"
    assert hk_bases(MAP, 2, point=MAP([1, 2])).basis == found.basis
    assert hk_bases(MAP, 1, point=[1, -2]).dimension == 2  # a steady state
    with pytest.raises(ArithmeticError, match="reach poles of the map"):
        hk_bases(kahan(QuadraticField([[[1]]]), 1), 2, point=[F(1, 3)])  # 1/3, 1/2, 1


@pytest.mark.parametrize(("n", "degree"), [(4, 8), (5, 5), (6, 4)])
def test_generic_bodies_have_no_integral(n, degree):
    map = kahan(of(SuslovND(J[: n - 1], I[: n - 1])), 0.5)
    assert hk_bases(map, degree).dimension == 0
    assert darboux_polynomials(map, 5 if n == 4 else 3) == ()


@pytest.mark.parametrize(
    ("map", "degree", "cofactor", "expected"),
    [
        (MAP, 2, 1, "(1,)"),
        (MAP, 1, lambda x: sum(np.multiply(MAP(x), (2, 1))) / F(2 * x[0] + x[1]), "(2*x1 + x2,)"),
        (MAP, 2, 2, "()"),
        (kahan(FORCED, EPS), 3, None, "(x1^3 + 63*x1,)"),
        (PREY, 2, None, "(x1*x2,)"),
    ],
)
def test_darboux_polynomials(map, degree, cofactor, expected):
    found = darboux_polynomials(map, degree, cofactor)
    assert repr(found) == expected
    for x in product((F(1, 7), F(-3, 5), F(4)), repeat=2):
        C = cofactor(x) if callable(cofactor) else cofactor or map.determinant(x)
        assert all(value(P, map(x)) == C * value(P, x) for P in found)


def test_exceptional_primes_and_lines_are_drawn_again(monkeypatch):
    prime = _exact.random_prime(random.Random(0))
    for eps in (F(1, prime), F(prime)):
        map = kahan(of(BODY), eps)
        assert degrees(map, 5) == [2, 4, 6, 8, 10]
        assert hk_bases(map, 2).dimension == 1
        assert len(darboux_polynomials(map, 3)) == 2
    true, calls = _growth.degrees_on_a_line, []

    def exceptional(map, p, rng):
        calls.append(p)
        return true(map, p, rng) if len(calls) > 1 else iter([1] * 9)

    monkeypatch.setattr(_growth, "degrees_on_a_line", exceptional)
    assert degrees(MAP, 4) == [2, 4, 6, 8]
    assert len({*calls}) == 3
    monkeypatch.setattr(_growth, "degrees_on_a_line", lambda map, p, rng: iter([p]))
    with pytest.raises(ArithmeticError, match="do not agree"):
        degrees(MAP, 1)


def test_linear_and_trivial_fields():
    """All polynomials are integrals of the identity; the squared radius is one of a rotation."""
    for map in (kahan(QuadraticField(np.zeros((2, 2, 2))), 1), kahan(CUBIC, 0)):
        assert len(hk_bases(map, 1).integrals) == len(darboux_polynomials(map, 1)) == 3
    rotation = kahan(field_of(lambda x: (x[1], -x[0]), 2), 1)
    assert repr(hk_bases(rotation, 2).integrals) == "(1, x1^2 + x2^2)"
    assert hk_bases(MAP, 0).dimension == 0


class Quantity(float):
    unit = "ms"


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: kahan(of(Suslov3D([1, 2], 1, 0, 1)), 1), ValueError, r"field: .*shape \(2,\)"),
        (lambda: kahan(BODY, 1), TypeError, "field: expected QuadraticField, got Suslov3D"),
        (lambda: kahan(CUBIC, None), TypeError, "eps: .*got NoneType"),
        (lambda: kahan(CUBIC, Quantity(1)), TypeError, "eps: .*without a unit, got Quantity"),
        (lambda: kahan(QuadraticField([[[0]]], [[2]]), 1)([1]), ZeroDivisionError, "no image"),
        (lambda: MAP([1]), ValueError, r"point: .*\(2,\), got \(1,\)"),
        (lambda: kahan(QuadraticField([[[1]]]), 1)([1]), ZeroDivisionError, r"\(1\) has no image"),
        (lambda: kahan(CUBIC, "1/0"), ValueError, "eps: expected a number such as 1/3 .*'1/0'"),
        (lambda: degrees(CUBIC, 3), TypeError, r"map: .*kahan\(field, eps\).*QuadraticField"),
        (lambda: growth(CUBIC), TypeError, r"degrees\(kahan\(field, eps\), n\).*QuadraticField"),
        (lambda: hk_bases(MAP, 999), ValueError, "at most 30 for 2 variables .*999 .500500 coef"),
        (lambda: degrees(MAP, -1), ValueError, "n: .*got -1"),
        (lambda: growth([1, 2.5]), TypeError, "degrees: .*got float"),
        (lambda: growth([1, -2]), ValueError, "degrees: .*got -2"),
        (lambda: hk_bases(MAP, 2.5), TypeError, "monomials: .*a degree or a list.*2.5"),
        (lambda: hk_bases(MAP, [(1, 0), (1, 0)]), ValueError, "monomials: .*none twice"),
        (lambda: hk_bases(MAP, [(1, 0, 0)]), ValueError, r"monomials: expected 2 .*\(1, 0, 0\)"),
        (lambda: report(Suslov3D([1, 2], 1, 0, 1), 1), ValueError, r"field: .*shape \(2,\)"),
        (lambda: report(BODY, EPS, 0), ValueError, "degree: .*got 0"),
        (lambda: report(CLEBSCH.field, 1, 5), ValueError, "at most 4 for 6 variables .*210.*462"),
        (lambda: report(BODY, EPS, time_limit="x"), TypeError, "time_limit"),
        (lambda: report(BODY, EPS, time_limit=-1), ValueError, "seconds of at least 0, got -1"),
        (lambda: report(1, EPS), TypeError, "body: .*got int"),
        (lambda: cofactors(CLEBSCH, -1), ValueError, "degree: .*got -1"),
        (lambda: darboux_polynomials(MAP, 1, "x"), TypeError, "cofactor: .*got str"),
        (lambda: darboux_polynomials(MAP, 1, lambda x: 0.5), TypeError, "cofactor: .*got float"),
        (lambda: darboux_polynomials(MAP, 1, lambda x: 1 / F(0)), ArithmeticError, "undefined"),
    ],
)
def test_bad_input(call, error, message):
    with pytest.raises(error, match=message):
        call()
