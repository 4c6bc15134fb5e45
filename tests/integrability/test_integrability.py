"""Exact computations for Kahan maps and other birational maps, against published results."""

import functools
import math
import pickle
import random
from fractions import Fraction as F
from itertools import product

import flint
import numpy as np
import pytest
import sympy
from papers import assert_holds, assert_text, by_text
from systems import exactly

from suslov_fast import Field, Map, Suslov3D, SuslovND, iterate
from suslov_fast.integrability import (
    RationalMap,
    arithmetic,
    cofactors,
    darboux_polynomials,
    degrees,
    growth as growth_of,
    hk_bases,
    kahan,
    rational_map,
    report,
    zoo,
)


@functools.cache
def reported(given, eps=None, degree=3):
    """Return a report that several tests read: some take seconds."""
    return report(given, eps=eps, degree=degree)


BODY = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.25)
EPS = F(1, 4)
J, I = [1.25, 2.125, 3.75, 5, 7], [0.5, -0.75, 0.25, 1, -0.5]
from_hamiltonian = Field.from_hamiltonian
MAP = kahan(BODY._field, EPS)
EULER = Field(lambda x: (2 * x[1] * x[2], -3 * x[2] * x[0], x[0] * x[1]), 3)
CUBIC = from_hamiltonian(
    lambda x: x[0] ** 3 + 2 * x[0] * x[1] ** 2 - x[1] ** 3 + x[0] * x[1] + x[0] ** 2 - 3 * x[1], 2
)
LINEAR = Field(lambda x: (8 * x[0] + 16 * x[1], 8 * x[0] + 8 * x[1]), 2)
PREY = Field(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)
FORCED = Field(lambda x: (x[0] * x[1], -(x[0] ** 2) - 1), 2)
SIR = Field(lambda x: (-2 * x[0] * x[1], 2 * x[0] * x[1] - x[1], x[1]), 3)
CHAIN = Field(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - x[2]), x[2] * (x[1] - 1)), 3)
CYCLE = Field(lambda x: [x[k] * (x[(k + 1) % 3] - x[k - 1]) for k in range(3)], 3)
ENERGY = from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
SOLVED = SuslovND(J=[2, 2, 2], I=I[:3])._field
ZOO = zoo()
PLANAR, HENON_HEILES_FIELD = ZOO["generic planar field"][0], ZOO["Henon-Heiles"][0]
TODD = rational_map(Map(lambda x: (x[1], x[2], (1 + x[1] + x[2]) / x[0]), 3))
LYNESS = rational_map(Map(lambda x: (x[1], (x[1] + 3) / x[0]), 2))
# Its orbits are on lines y = u x + v with two integrals u and v.
SHEAR = rational_map(Map(lambda x: (x[0] + 1, x[1] + x[2], x[2]), 3))


def volterra(n):
    """Kouloukas, Quispel, Vanhaecke (2016)."""
    return Field(lambda x: [x[i] * (sum(x[i + 1 :]) - sum(x[:i])) for i in range(n)], n)


CLEBSCH = kahan(ZOO["Clebsch"][0], 1)


def random_field(n, seed=0):
    rng = np.random.default_rng(seed)
    return Field.from_terms(*(rng.integers(-3, 4, (n,) * k) for k in (3, 2, 1)))


def value(P, x):
    terms = P.to_dict().items()
    return sum(int(c) * math.prod(map(pow, x, map(int, powers))) for powers, c in terms)


def assert_derivative(map, x):
    """The Jacobian is that of central differences."""
    jacobian, h = map.jacobian(x), F(1, 10**20)
    for j in range(len(x)):
        ahead, behind = (map([a + s * h * (i == j) for i, a in enumerate(x)]) for s in (1, -1))
        for i, row in enumerate(jacobian):
            assert abs((ahead[i] - behind[i]) / (2 * h) - row[j]) < F(1, 10**28)
    rows = [[flint.fmpq(a.numerator, a.denominator) for a in row] for row in jacobian]
    assert map.determinant(x) == F(str(flint.fmpq_mat(rows).det()))
    assert all(type(a) is F for a in (*map(x), *jacobian[0], map.determinant(x)))


# --------------------------------------------------------------------------------------------- maps
@pytest.mark.sampled(2)
@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_the_map_its_inverse_and_its_derivative(n):
    field, eps = random_field(n), F(-2, 7)
    map, rng = kahan(field, eps), random.Random(1)
    x = [F(rng.randrange(-99, 99), 7) for _ in range(n)]
    image = map(x)
    middle = [(a + b) / 2 for a, b in zip(x, image, strict=True)]
    rates = [exactly(map.terms, each) for each in (middle, x, image)]
    for a, b, m, *ends in zip(x, image, *rates, strict=True):
        assert (b - a) / eps == 2 * m - sum(ends) / 2
    assert map.inverse(image) == tuple(x)
    assert_derivative(map, x)
    symbolic = kahan(field)
    assert tuple(f.subs(eps=eps)([]) for f in symbolic(x)) == image
    assert symbolic.subs(eps=eps) == map == pickle.loads(pickle.dumps(map))
    assert symbolic.inverse.subs(eps=eps) == map.inverse != symbolic.subs(eps=eps)
    assert pickle.loads(pickle.dumps(symbolic.inverse)).inverse == symbolic != symbolic.inverse


def test_a_letter_in_the_coefficients():
    map = rational_map(
        Map(lambda x, λ: (x[1], λ * (x[1] + 1) / (x[0] * (λ - 2))), 2, λ=1),
        Map(lambda x, λ: (λ * (x[0] + 1) / (x[1] * (λ - 2)), x[0]), 2, λ=1),
        letters="λ",
    )
    assert pickle.loads(pickle.dumps(map)) == map
    found, value, x = report(map), F(5, 3), (F(1, 2), F(3))
    assert found.planar.proved
    at_number = map.subs(λ=value)
    assert at_number((1, 2)) == (2, value * 3 / (value - 2)) == map.subs(λ="5/3")((1, 2))
    assert tuple(f.subs(λ=value)([]) for f in map((1, 2))) == at_number((1, 2))
    assert at_number.inverse(at_number(x)) == x
    (integral,) = found.integrals
    assert integral.letter == "λ" in str(integral)
    assert integral(at_number(x), λ=value) == integral(x, λ=value) == integral.subs(λ=value)(x)
    assert degrees(map, 9) == degrees(at_number, 9)
    with pytest.raises(ArithmeticError, match="no map"):
        map.subs(λ=2)


# ------------------------------------------------------------------------- degrees and their growth
HENON_HEILES = [3, 7, 17, 39, 93, 215, 495, 1137, 2615, 6007, 13797]  # eps = 1/2


@pytest.mark.parametrize(
    ("sequence", "kind", "entropy"),
    [
        ([2, 3] * 4, "bounded", 0),
        ([2, 3, 4, 5, 6, 6, 6, 6, 6, 6], "bounded", 0),
        ([2, 4, 6, 8, 10, 12, 14], "linear", 0),
        ([2, 4, 8, 13, 15, 17, 19, 21, 23, 25], "linear", 0),
        ([k**3 for k in range(1, 13)], "cubic", 0),
        ([7, 3, *(3**k + 1 for k in range(1, 60))], "exponential", math.log(3)),
        ([1, 2, 3, 5, 8, 13, 21], "exponential", math.log((1 + math.sqrt(5)) / 2)),
        # The identity, of degree 1, is a term of the recurrence.
        ([1, 2, 3, 5, 8, 13], "exponential", math.log((1 + math.sqrt(5)) / 2)),
        ([5, 21, 85, 341, 1365, 5461], "exponential", math.log(4)),
        ([3, 9, 27, 81], "exponential", math.log(3)),
        # One more term gives a recurrence.
        ([9, 5, 7, 7, 7, 7, 7], "bounded", 0),
        ([9, 5, 7, 7, 7, 7], "unclear", math.nan),
        # No recurrence: the last three quotients tell.
        (HENON_HEILES, "exponential", math.nan),
        ([5, 25, 109, 465, 1973], "exponential", math.nan),
        ([4, 13, 28, 49, 76], "unclear", math.nan),
        ([7, 10, 14, 20, 28, 39], "unclear", math.nan),  # below 1.5
        ([], "unclear", math.nan),
        ([2, 0, 3], "unclear", math.nan),
    ],
)
def test_growth_of_sequences(sequence, kind, entropy):
    found = growth_of(sequence)
    assert kind != "linear" or found.based_on.startswith("d(k+2) = 2 d(k+1) - d(k)")
    assert found.kind == kind
    assert found.entropy == pytest.approx(entropy, abs=1e-14, nan_ok=True)


def test_a_singularity_that_is_confined_late():
    """From the step of confinement on all degrees obey a recurrence for a while, by accident."""
    # Exponents (2, 2) of the maps of three lines.
    sequence = [2, 4, 8, 16, 32, 63, 124, 244, 480, 944, 1856, 3649, 7174, 14104]
    for n in range(8, len(sequence) + 1):
        found = growth_of(sequence[:n], planar=True).entropy
        assert math.isnan(found) or found == pytest.approx(0.6759746921034222, abs=1e-6)
    assert growth_of(sequence).entropy == pytest.approx(0.6759746921034222, abs=1e-14)


def test_recurrences_that_are_refused():
    """Double largest roots, always; in the plane two roots outside the unit circle, and cubes."""
    assert math.isnan(growth_of([2**k * (k + 1) for k in range(1, 14)]).entropy)
    powers = growth_of([2**k for k in range(1, 12)], planar=True)
    assert powers[:2] == ("exponential", math.log(2))
    both = [2**k + 3**k for k in range(1, 12)]
    assert growth_of(both).entropy == pytest.approx(math.log(3))
    assert math.isnan(growth_of(both, planar=True).entropy)
    cubes = [k**3 for k in range(1, 14)]
    assert (growth_of(cubes).kind, growth_of(cubes, planar=True).kind) == ("cubic", "unclear")
    # A transient needs as many terms to spare as it has itself.
    late = [2, 3, 5, 9, 14, 7, 7, 7, 7, 7]
    assert math.isnan(growth_of(late).entropy)
    assert growth_of([*late, 7, 7])[:2] == ("bounded", 0)


# ------------------------------------------ relations along orbits, and polynomials of one cofactor
def assert_basis(found, map):
    """Polynomials vanish along the orbit of the point; quotients of integrals are conserved."""
    x = found.point
    for _ in range(4):
        x = map(x)
        assert all(value(P, x) == 0 for P in found.polynomials)
    start = [F(k, 7) for k in range(2, 2 + map.dimension)]
    before, after = ([value(P, x) for P in found.forms] for x in (start, map(start)))
    assert len(found.integrals) == found.independent
    assert all(f(map(start)) == f(start) for f in found.integrals)
    assert all(a * before[0] == b * after[0] for a, b in zip(after, before, strict=True))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("field", "lowest", "independent"),
    [(EULER, 2, 2), (BODY._field, 2, 1), (SIR, 1, 1), (CHAIN, 2, 1), (CYCLE, 3, 2), (CUBIC, 3, 1)],
)
def test_a_higher_degree_loses_no_integral(field, lowest, independent):
    map = kahan(field, EPS)
    for degree in range(lowest, 5):
        found = hk_bases(map, degree)
        assert (found.degree, found.independent, found.complete) == (lowest, independent, True)
        assert "try" not in repr(found)
        assert_basis(found, map)
    assert lowest == 1 or hk_bases(map, lowest - 1).independent < independent


def test_lists_of_monomials():
    units = np.eye(6, dtype=int)
    squares, mixed = 2 * units, units[:3] + units[3:]
    found = hk_bases(CLEBSCH, [*squares, *mixed, [0] * 6])
    assert (found.dimension, found.independent, found.integrals) == (4, 4, ())
    assert not found.complete
    assert repr(found).endswith("; 4 more independent: try a higher degree, or `report`")
    assert hk_bases(CLEBSCH, squares).dimension == 0
    assert_basis(hk_bases(CLEBSCH, [*squares[3:], [0] * 6]), CLEBSCH)
    assert hk_bases(kahan(SOLVED, EPS), 2).independent == 2
    # One relation, and two orbits always span one dimension more: a third one tells.
    found = hk_bases(SHEAR, [(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    assert (found.dimension, found.independent, found.integrals) == (1, 2, ())


def test_the_orbit_of_a_point():
    found = hk_bases(MAP, 2, point=[1, 2])
    assert str(found.polynomials[0]) == "2052*Omega1^2 - 4*Omega1*Omega2 + 513*Omega2^2 - 4096"
    assert hk_bases(MAP, 2, point=MAP([1, 2])).basis == found.basis
    assert hk_bases(MAP, 1, point=[1, -2]).dimension == 2  # a steady state
    with pytest.raises(ArithmeticError, match="poles"):
        hk_bases(kahan(Field.from_terms([[[1]]]), 1), 2, point=[F(1, 3)])  # 1/3, 1/2, 1


def test_iterates_without_an_image():
    """The third iterate is at infinity and has no image: degrees and reports say so."""
    map = rational_map(Map(lambda x: (x[1], 0 * x[2], 1 / x[0]), 3))
    assert degrees(map, 3) == [2, 1, 0]
    for call in (lambda: degrees(map, 4), lambda: report(map, degree=1)):
        with pytest.raises(ArithmeticError, match="poles"):
            call()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("map", "degree", "cofactor", "expected"),
    [
        (MAP, 2, 2, "()"),
        (kahan(FORCED, EPS), 3, "det", "(x1^3 + 63*x1,)"),
        (kahan(PREY, EPS), 2, "det", "(x1*x2,)"),
        (LYNESS, 2, "det", "(x1*x2,)"),
    ],
)
def test_darboux_polynomials(map, degree, cofactor, expected):
    cofactor = map.determinant if cofactor == "det" else cofactor
    found = darboux_polynomials(map, degree, cofactor)
    assert repr(found) == expected
    for x in product((F(1, 7), F(-3, 5), F(4)), repeat=2):
        C = cofactor(x) if callable(cofactor) else cofactor
        assert all(value(P, map(x)) == C * value(P, x) for P in found)


def test_darboux_polynomials_of_all_cofactors():
    """Those that a report lists: no products, and those of the poles among them."""
    euler = Field(lambda x: (x[1] * x[2], -2 * x[0] * x[2], x[0] * x[1]), 3)
    for eps, last in ((1, "x3^2 + 2"), (None, "eps^2*x3^2 + 2")):
        found = darboux_polynomials(kahan(euler, eps), 2)
        assert [*map(str, found)] == ["x1 + x3", "x1 - x3", "2*x1^2 + x2^2", last]
    cycle = kahan(CYCLE, EPS)
    *found, poles = darboux_polynomials(cycle, 2)
    assert [*map(str, found)] == ["x1", "x2", "x3", "x1 + x2 + x3"]
    assert cycle.denominator % poles == 0
    assert repr(darboux_polynomials(kahan(LINEAR), 2)) == "(x1^2 - 2*x2^2,)"
    inversion = rational_map(Map(lambda x: (2 / x[0], 3 * x[1]), 2))
    assert [*map(str, cofactors(inversion, 1))] == ["1", "-6/x1^2", "3", "2/x1^2"]
    assert {"6/x1^2", "4/x1^4"} <= {*map(str, cofactors(inversion, 2))}
    assert repr(darboux_polynomials(inversion, 1)) == "(x1, x2)"


def test_cofactors():
    """Every cofactor with a polynomial is found, and each is a product of the factors."""
    prey = kahan(PREY, EPS)
    found = cofactors(prey, 2)
    assert repr(darboux_polynomials(prey, 2)) == "(x1, x2)"
    polynomials = {str(P) for C in found for P in darboux_polynomials(prey, 2, C)}
    assert polynomials == {"1", "x1", "x2", "x1*x2", "x1^2", "x2^2"}
    x = (F(1, 7), F(-3, 5))
    values = [C(x) for C in found]
    assert {F(1), prey.determinant(x), prey(x)[0] / x[0]} < {*values}
    C = found[1]
    assert C(x) == F(value(C.numerator, x)) / value(C.denominator, x) == by_text(C, x)
    # x2 goes to -x1 and x1 to x2: x1^2 + x2^2 has the cofactor 1, x1^2 - x2^2 and x1 x2 have -1.
    quarter = kahan(Field(lambda x: (2 * x[1], -2 * x[0]), 2), 1)
    assert {str(C) for C in cofactors(quarter, 2)} == {"1", "-1"}
    assert [str(P) for P in darboux_polynomials(quarter, 2, -1)] == ["x1*x2", "x1^2 - x2^2"]


def test_exceptional_primes_and_lines_are_drawn_again():
    prime = arithmetic.random_prime(random.Random(0))
    for eps in (F(1, prime), F(prime)):
        map = kahan(BODY._field, eps)
        assert degrees(map, 5) == [2, 4, 6, 8, 10]
        assert hk_bases(map, 2).dimension == 1
        assert len(darboux_polynomials(map, 3, map.determinant)) == 2
    results = iter([[1], [2], [3], [2]])
    assert arithmetic.agreed_by_primes(random.Random(0), lambda p, eps: next(results)) == [2]
    with pytest.raises(ArithmeticError, match="do not agree"):
        arithmetic.agreed_by_primes(random.Random(0), lambda p, eps: p)


# ------------------------------------------------------------------------------------------ reports
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("given", "degree", "kind", "integrals", "measure", "planes"),
    [
        (BODY, 3, "linear", [2], [3], ["2*Omega1 + Omega2"]),
        (CYCLE, 3, "quadratic", [1, 3], [2], ["x1", "x2", "x3", "x1 + x2 + x3"]),
        # The map sends the line det A = 0 to infinity.
        (ENERGY, 1, "quadratic", [3], [1], ["3*x1 + 32"]),
        # More Darboux polynomials of one cofactor than products of lower degree; a norm.
        (SOLVED, 4, "linear", [1, 2], [4], None),
        (volterra(4), 3, "linear", [1, 2, 2], [3], None),
        (PLANAR, 3, "exponential", [], [], []),
        # The density is a product of powers of polynomials of several cofactors.
        (SIR, 1, "exponential", [1], [2], ["x1", "x2", "x1 + x2 + x3"]),
        # The modified energy and 1/det A, of degrees 4 and 2.
        (HENON_HEILES_FIELD, 1, "exponential", [4], [2], []),
        (Field.from_terms([[[4]]], constant=[-3]), 3, "bounded", [], None, None),
        (from_hamiltonian(lambda x: 0 * x[0] + 1, 2), 3, "bounded", [1, 1], None, None),
        (Field(lambda x: (x[1] ** 2, 1), 2), 3, "bounded", [3], None, None),
        # det DPhi = -1, and several constants for the same factors.
        (LINEAR, 3, "bounded", [4], None, None),
        # Fibres that move are no integral.
        (Field(lambda x: (x[0], x[0] * x[1]), 2), 3, "linear", [], None, None),
        (ZOO["McMillan"][0].inverse, 4, "quadratic", [4], [0], None),
        (ZOO["Hone-Quispel"][0], 4, "quadratic", [4], [2], None),
        (rational_map(Map(lambda x: (x[1], x[0], x[2] + 1), 3)), 4, "bounded", [1, 2], None, None),
        (TODD, 4, "bounded", [4, 4, 4], None, None),
        (SHEAR, 4, "bounded", [1, 2], None, None),
    ],
)
def test_report(given, degree, kind, integrals, measure, planes):
    is_map = isinstance(given, RationalMap)
    eps = None if is_map else EPS
    found = reported(given, eps, degree)
    n = found.map.dimension
    assert (found.growth.kind, found.finished) == (kind, True)
    assert [each.degree for each in found.integrals] == integrals
    assert found.dimension == n - len(integrals)
    assert planes is None or {str(f) for f in found.polynomials if f.degree == 1} == {*planes}
    assert measure is None or [f.degree for f in found.measures[:1]] == measure
    assert ("fibration" in repr(found)) == (kind == "linear" and n == 2)
    assert_holds(found)
    assert_text(found)
    for each in (*found.integrals, *found.measures, *found.polynomials):
        assert each.basis == "identity"
    assert pickle.loads(pickle.dumps(found)).integrals == found.integrals
    assert any("not checked" in note for note in found.notes) == (found.map.inverse is None)


def test_a_map_without_inverse_and_no_map():
    projection = rational_map(Map(lambda x: (x[0], x[0]), 2))
    found = report(projection)
    assert (found.growth.kind, found.integrals, found.relations) == ("bounded", (), None)
    assert "no inverse" in repr(found)
    assert found.finished
    nowhere = Field.from_terms([[[0]]], [[2]])
    no_map = kahan(nowhere, 1)
    for call in (report, lambda map: degrees(map, 3), lambda map: hk_bases(map, 1)):
        with pytest.raises(ArithmeticError, match=r"eps=1.*no solution"):
            call(no_map)
    assert report(nowhere).finished


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("field", "eps"),
    [
        (Field(lambda x: (x[0], 2 * x[1]), 2), -1),
        (Field(lambda x: (x[0], 2 * x[1]), 2), 2),
        (Field(lambda x: (x[0], 2 * x[1], x[0] * x[1]), 3), -2),
        (Field(lambda x: (2 * x[0], 2 * x[1], 2 * x[2], 2 * x[3], 1), 5), -1),
        (Field.from_terms([[[0]]], [[-8]], [1]), EPS),
    ],
)
def test_degenerate_step_sizes(field, eps):
    with pytest.raises(ArithmeticError, match=f"eps={eps}"):
        report(field, eps=eps)
    assert report(field, degree=1).finished
    assert report(field, eps=F(eps) / 3, degree=1).finished


@pytest.mark.slow
def test_integrals_with_irrational_coefficients():
    """Those of degree 2 have irrational coefficients; those of degree 4 are norms of them."""

    def nambu(x):
        a, b = (2 * x[0], 4 * x[1], 6 * x[2]), (x[1], x[0], 2 * x[2] + 1)
        return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]

    found = report(Field(nambu, 3), eps=F(1, 3), degree=2)
    assert (found.relations, [each.degree for each in found.integrals]) == (2, [4, 4])
    assert_holds(found)


def test_determinants_that_are_too_long():
    """Without the factors of det DPhi there are still relations, and the cofactors 1, det DPhi."""
    found = report(random_field(5), eps=EPS, degree=1)
    assert "too long" in repr(found)
    assert found.finished
    with pytest.raises(ArithmeticError, match="at most"):
        cofactors(kahan(random_field(5), EPS), 1)


# Integrals of the equations of the zoo, and of its maps, in the literature.
OF_TOPS = lambda x: np.stack([x[3] ** 2 + x[4] ** 2 + x[5] ** 2, x[:3] @ x[3:]])  # noqa: E731
OF_DIRECTION = lambda x: x[2] ** 2 + x[3] ** 2 + x[4] ** 2  # noqa: E731
IN_LITERATURE = {
    "cubic Hamiltonian": lambda x: (x[1] ** 2 - x[0] ** 2) / 2 + x[0] ** 3 / 3,
    "Nahm, octahedral": lambda x: x[1] * (2 * x[0] + 3 * x[1]) * (x[0] - x[1]) ** 2,
    "Euler top": lambda x: np.stack([3 * x[0] ** 2 + 2 * x[1] ** 2, x[1] ** 2 + 3 * x[2] ** 2]),
    **dict.fromkeys(
        (f"Zhukovsky-Volterra, {n}" for n in ("one beta", "two betas", "three betas")),
        lambda x: x @ x,
    ),
    "Nambu": lambda x: x[2] ** 2 + x[0] * (x[1] + x[2]),
    **dict.fromkeys(
        (f"Volterra chain, N = {n}" for n in (3, 4, 5)), lambda x: np.stack([x.sum(), x.prod()])
    ),
    **dict.fromkeys(("Lagrange top", "Kirchhoff", "Clebsch", "body in a fluid"), OF_TOPS),
    **dict.fromkeys(("Klebsch-Tisserand", "Suslov, Lagrange axis", "Kharlamova"), OF_DIRECTION),
    "Suslov on so(4)": lambda x: np.array([3, 6, 6, 7, 7]) @ x**2,
    "Lotka-Volterra": lambda x: x.sum() - np.log(x.prod()),
    "Henon-Heiles": lambda x: x @ x / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3,
    "Lyness": lambda x: (x[0] + 1) * (x[1] + 1) * (x[0] + x[1] + 3) / (x[0] * x[1]),
    "McMillan": lambda x: (x[0] * x[1]) ** 2 + x[0] ** 2 + x[1] ** 2 - 6 * x[0] * x[1],
}


@pytest.mark.parametrize("name", IN_LITERATURE)
def test_systems_of_the_zoo_have_the_integrals_of_the_literature(name, rng):
    system, integral = ZOO[name][0], IN_LITERATURE[name]
    x = rng.uniform(0.5, 1.5, system.dimension)
    if ZOO[name][1] is None:
        after = np.array([float(a) for a in system([F(a) for a in x])])
        np.testing.assert_allclose(integral(after), integral(x), rtol=1e-12)
    else:  # the derivative along f, by a complex step
        along = integral(x + 1e-30j * system(x)).imag / 1e-30
        np.testing.assert_allclose(along, 0.0, atol=1e-13)


# -------------------------------------------------------------------- numbers, limits and bad input
def test_fractions_of_a_body_are_exact():
    """Their floats are those of the body; no warning says that the map has floats."""
    I1, I2, I13 = F(5, 3), F(1009, 1013), F(1, 3) + F(1, 2**70)
    body = Suslov3D(I1, I2, I13, 0)
    assert (body.I1, body.I13) == (5 / 3, 1 / 3)
    assert {abs(a) for a in kahan(body, 1).terms.values} == {I13 / I1, I13 / I2}
    many = SuslovND(J=[1, F(2, 1009)], I=[F(1, 3), 0.1])
    assert F(1009, 6) in {abs(a) for a in kahan(many, 1).terms.values}
    assert kahan(pickle.loads(pickle.dumps(body)), 1) == kahan(body, 1)


@pytest.mark.slow
def test_a_report_that_is_cut_short():
    def interrupt(done, parts):
        if done >= 150:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        report(CYCLE, eps=EPS, progress=interrupt)
    for found in (stopped.value.report, report(CYCLE, eps=EPS, progress=lambda n, _: n < 150)):
        # Proofs come last.
        assert (found.growth.kind, len(found.integrals)) == ("quadratic", 2)
        assert {f.basis for f in found.integrals} == {"modulo a prime, at random points"}
        assert "Not finished" in repr(found)
        assert_holds(found)


def test_integrals_that_are_polynomials_have_no_constant_term():
    (integral,) = reported(ZOO["McMillan"][0], degree=4).integrals
    assert str(integral) == "x1^2*x2^2 + x1^2 - 6*x1*x2 + x2^2"
    assert integral.basis == "identity"


def test_a_hamiltonian_that_was_not_given():
    """Whatever the order of positions and momenta; other fields have none."""

    def f(x, y, u, v):
        return u, v, -x - 2 * x * y, -y - x**2 + y**2

    def H(x, y, u, v):
        return (u**2 + v**2 + x**2 + y**2) / 2 + x**2 * y - y**3 / 3

    order = 3, 0, 2, 1

    def reordered(x):
        values = f(*(x[k] for k in order))
        return [values[order.index(k)] for k in range(4)]

    energy = kahan(Field(reordered, 4)).hamiltonian
    points = ([F(a, 3) for a in each] for each in ((1, 2, 5, -1), (2, -7, 1, 4)))
    assert len({value(energy, (1, *x)) / H(*(x[k] for k in order)) for x in points}) == 1
    energy = kahan(Field(lambda x: (x[0] * x[1], -(x[1] ** 2) / 2), 2)).hamiltonian
    assert str(energy) == "x1*x2^2"
    for field in (PREY, CYCLE, FORCED):
        assert kahan(field).hamiltonian is None


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("field", "symmetries"),
    [
        # Lines through 0 are reflected at those of steady states.
        (BODY._field, ["(-Omega1, -Omega2)", "(1/2*Omega2, 2*Omega1)"]),
        (ENERGY, ["(x1, -x2)"]),
        (Field(lambda x: (x[0] ** 2 - x[0],), 1), ["(-x1 + 1)"]),
        (PREY, ["(x2, x1)"]),
        (CYCLE, ["(x1, x3, x2)", "(x2, x1, x3)", "(x3, x2, x1)", "(-x1, -x2, -x3)"]),
        (PLANAR, []),
        # These come in families, of which signed permutations are listed.
        (Field(lambda x: (x[1], 0 * x[0] - 1), 2), ["(x1, -x2)"]),
        (Field(lambda x: (x[0] ** 2, x[0] * x[1]), 2), ["(-x1, x2)", "(-x1, -x2)"]),
    ],
)
def test_reversing_symmetries(field, symmetries):
    found = report(field, eps=EPS, degree=1)
    assert [*map(str, found.symmetries)] == [f"x -> {text}" for text in symmetries]
    assert ("Reversing symmetries: " in repr(found)) == bool(symmetries)
    now = found.map
    x = [F(2 * k + 3, 7) for k in range(field.dimension)]
    assert all(now(R(now(x))) == R(x) and R(R(x)) == (*x,) for R in found.symmetries)


def in_other_coordinates(f, S):
    """The field of y = S x."""
    inverse = sympy.Matrix(S).inv()
    inverse = [[F(int(a.p), int(a.q)) for a in inverse.row(i)] for i in range(len(S))]

    def field(y):
        v = f([sum(a * b for a, b in zip(row, y, strict=True)) for row in inverse])
        return tuple(sum(a * b for a, b in zip(row, v, strict=True)) for row in S)

    return Field(field, len(S))


def test_an_isolated_symmetry_with_the_trace_of_a_family():
    """(x1, x2, -x3) beside reflections at planes; no signed permutation in these coordinates."""
    top = in_other_coordinates(
        lambda x: (x[1] * x[2], -x[0] * x[2], 0 * x[0]), [[1, 2, 0], [0, 1, 3], [1, 0, 1]]
    )
    found = report(top, eps=EPS, degree=1)
    assert [*map(str, found.symmetries)] == [
        "x -> (-x1, -x2, -x3)",
        "x -> (x1, 6/7*x1 - 5/7*x2 - 6/7*x3, 2/7*x1 - 4/7*x2 + 5/7*x3)",
    ]
    assert "linear ones with rational entries; not others, in families" in repr(found)


def test_reversing_symmetries_that_are_not_all_listed():
    found = report(Field(lambda x: (x[1], -x[0], x[2] ** 2), 3), eps=EPS, degree=1)
    assert "x -> (x1, -x2, -x3)" in map(str, found.symmetries)
    assert "not others, in families" in repr(found)
    three_waves = Field(lambda x: (x[1] * x[2], x[0] * x[2], x[0] * x[1], x[3]), 4)
    found = report(three_waves, eps=EPS, degree=1)
    assert len(found.symmetries) == 0
    assert "involutions that take the map to its inverse: signed permutations" in repr(found)


@pytest.mark.slow
def test_parts_of_integrals_are_darboux_polynomials():
    """Also where det DPhi is too long to be factored, as for three waves."""

    def waves(x):
        a, b, c, d, e, f = x
        first = b * c - e * f, -a * c - d * f, -a * b - d * e
        return *first, b * f + e * c, a * f - d * c, a * e - d * b

    found = report(Field(waves, 6), eps=EPS, degree=2)
    assert found.map.factors is None
    x = [1, 2, 3, -1, 5, F(1, 2)]
    names = {str(P): P for P in found.polynomials}
    for f in found.integrals:
        assert {str(f.numerator), str(f.denominator)} & names.keys()
    for P in found.polynomials:
        assert P(found.map(x)) == P.cofactor(x) * P(x)
    assert found.polynomials[0].subs().cofactor(x) == found.polynomials[0].cofactor(x)


@pytest.mark.slow
def test_a_density_up_to_sign():
    """The map of Lyness in three dimensions reverses the orientation: its measure is dx / |xyz|."""
    found = report(rational_map(Map(lambda x: (x[1], x[2], (2 + x[1] + x[2]) / x[0]), 3)), degree=3)
    assert [*map(str, (found.measures[0], found.measures[0].cofactor))] == ["1/(x1*x2*x3)", "-1"]
    assert "up to sign" in repr(found)
    assert_holds(found)


OF_DEGREE_64 = Map(lambda x: (x[1] - x[0] ** 64, x[0]), 2)
SWAP = Map(lambda x, h: (x[1], h * x[0]), 2, h=1)
OF_H = rational_map(Map(lambda x, h: (x[1], (x[1] + h) / x[0]), 2, h=1), letters="h")


ROOT = Field(lambda x, a: (x[0] * np.sqrt(a),), 1, a=2)


class Quantity(float):
    unit = "ms"


@pytest.mark.parametrize(
    ("error", "argument", "call"),
    [
        (ValueError, "field", lambda: kahan(Suslov3D([1, 2], 1, 0, 1)._field, 1)),
        (TypeError, "eps", lambda: kahan(CUBIC, Quantity(1))),
        (ZeroDivisionError, r"\(1\)", lambda: kahan(Field.from_terms([[[1]]]), 1)([1])),
        (TypeError, "eps", lambda: kahan(CUBIC).jacobian([1, 2])),
        (TypeError, "map", lambda: degrees(len, 3)),
        (ValueError, "n", lambda: degrees(MAP, -1)),
        (TypeError, "degrees", lambda: growth_of([1, 2.5])),
        (ValueError, "monomials .* 30 .*999", lambda: hk_bases(MAP, 999)),
        (ValueError, "monomials", lambda: hk_bases(MAP, [(1, 0, 0)])),
        (ValueError, "degree .* 4 .*462", lambda: report(CLEBSCH, degree=5)),
        (ValueError, "eps", lambda: report(MAP, eps=EPS)),
        (TypeError, r"report.* as degree=", lambda: report(BODY, 2)),
        (TypeError, "progress", lambda: report(BODY, eps=EPS, progress=3)),
        (TypeError, "cofactor", lambda: darboux_polynomials(MAP, 1, lambda x: 0.5)),
        (TypeError, "map", lambda: rational_map(Map(lambda x: (np.sin(x[0]), 1), 2))),
        (ValueError, "map", lambda: rational_map(Map(lambda x: (1 / (x[0] - x[0]), 1), 2))),
        (TypeError, ".*comparison", lambda: rational_map(Map(lambda x: (x[1], np.maximum(*x)), 2))),
        (
            ValueError,
            ".*at most 2 ",
            lambda: degrees(OF_DEGREE_64, 30),
        ),
        (ValueError, "inverse", lambda: rational_map(SWAP, Map(lambda x: x, 2))),
        (ValueError, "letters", lambda: rational_map(SWAP, letters="x1")),
        (TypeError, "h", lambda: OF_H.subs()),
        (ValueError, "h", lambda: OF_H.subs(h=math.nan)),
        (TypeError, ".*quotient", lambda: report(Map(np.sin, "x"))),
        (ValueError, ".*a single one", lambda: report(Map(lambda x, a: a * x, 1, a=[1, 2]))),
        (ValueError, ".*left out", lambda: report(SWAP, eps=0.1)),
        (TypeError, ".*iterate", lambda: kahan(SWAP)),
        (ValueError, ".*names of its", lambda: report(SWAP, letters="b")),
        (ValueError, ".*I1, I2", lambda: report(BODY, letters="I4")),
        (ValueError, ".*eps", lambda: report(BODY, letters="I1", eps=1)),
        (ValueError, ".*single", lambda: report(Suslov3D([4, 3], 1, -0.5, 0), letters="I1")),
        (TypeError, ".*letters", lambda: report(ROOT, letters="a")),
    ],
)
def test_bad_input(error, argument, call):
    with pytest.raises(error, match=f"^{argument}"):
        call()


def test_functions_along_orbits_are_floats():
    """Integrals at the states of a run are arrays; at one point they are fractions."""
    field = Field(lambda x: (x[1], 6 * x[0] ** 2), 2)
    found = report(field, degree=3)
    run = iterate(field, [[0.1, 0.2], [0.3, 0.1]], 1 / 8, 3)
    for f in (*found.integrals, *found.measures, *found.polynomials):
        values = f(run.states, eps=F(1, 8))
        assert (values.shape, values.dtype) == ((4, 2), float)
        assert values[3, 1] == pytest.approx(
            float(f(run.states[3, 1].tolist(), eps=F(1, 8))), rel=1e-13
        )
    for f in found.integrals:
        assert np.ptp(f.subs(eps=F(1, 8))(run.states[:, 0])) < 1e-14
        with pytest.raises(ValueError, match=r"shape \(\.\.\., \d\)"):
            f(run.states[..., :1], eps=F(1, 8))
    huge = found.integrals[0] * 10**400 / 10**399
    np.testing.assert_allclose(huge(run.states, eps=1), 10 * found.integrals[0](run.states, eps=1))
