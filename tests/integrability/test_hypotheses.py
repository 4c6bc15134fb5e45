"""What theorems need: an inverse, det DPhi != 0, letters with general values."""

import math
import random
from fractions import Fraction

import pytest

from suslov_fast import Field, Map, SuslovND
from suslov_fast.integrability import hk_bases, kahan, rational_map, report
from suslov_fast.integrability.arithmetic import as_written


def test_integrals_prove_no_entropy_of_a_map_without_inverse():
    """(x, y, z^2) has two integrals, and the degrees 2^k."""
    found = report(Map(lambda s: (s[0], s[1], s[2] ** 2), "x y z"), degree=2)
    assert len(found.integrals) == 2
    assert found.proved_entropy is None
    assert "Entropy" not in str(found)
    assert found.growth.entropy == pytest.approx(math.log(2))


# Maps of a line or plane: (f, number of rational integrals).
SMALL = {
    1: [(lambda u: (u[0],), 1), (lambda u: (u[0] ** 2 + 1,), 0), (lambda u: (2 * u[0] + 1,), 0)],
    2: [
        (lambda u: (u[1], (3 + u[1]) / u[0]), 1),
        (lambda u: (u[1] + 1 - u[0] ** 2, 2 * u[0]), 0),
        (lambda u: (u[0], u[1] ** 2 + u[0]), 1),
    ],
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("seed", range(20))
def test_integrals_of_maps_with_a_smaller_image(seed):
    """Phi = iota(psi(x)) has as many integrals as psi(iota(u)), which is one of SMALL."""
    rng = random.Random(seed)
    D = rng.choice([2, 3])
    d = rng.randint(1, D - 1)
    small, expected = rng.choice(SMALL[d])
    a = [rng.randint(-3, 3) for _ in range(d)]
    rows = [[rng.randint(-2, 2) for _ in range(d + 1)] for _ in range(D - d)]
    power = rng.choice([1, 2])

    def f(x):
        u = [x[i] - a[i] * x[d] ** power for i in range(d)]
        h = [sum(c * b for c, b in zip(row, u, strict=False)) + row[-1] for row in rows]
        return (*(v + c * h[0] ** power for v, c in zip(small(u), a, strict=True)), *h)

    assert hk_bases(Map(f, D), 3).independent == expected


def test_a_special_value_without_inverse_adds_no_integrals():
    henon = Map(lambda s, a, b: (1 - a * s[0] ** 2 + s[1], b * s[0]), "x y", a=1, b=0)
    assert hk_bases(henon, 3).independent == 0
    assert not any("independent" in note for note in report(henon, letters="a b").notes)


@pytest.mark.parametrize("make", [Map, Field])
def test_a_pole_is_a_special_value(make):
    system = make(lambda s, a: (s[1], s[0] / (a - 1)), "x y", a=1)
    found = report(system, letters="a", degree=2)
    assert all(text in found.notes[-1] for text in ("a = 1", "no map"))
    assert found.relations == 1  # x^2 + (a - 1) y^2 over x y, or the energy
    assert found.finished


@pytest.mark.parametrize("make", [kahan, rational_map])
def test_no_variable_is_called_eps(make):
    f = (Field if make is kahan else Map)(lambda s: (s[1], -s[0]), "eps y")
    with pytest.raises(ValueError, match="eps"):
        make(f)


@pytest.mark.parametrize(
    ("typed", "value"),
    [
        (6.02214076e23, 602214076 * 10**15),
        (1.23456789012345e20, 123456789012345 * 10**6),
        (2.0**60, 2**60),
        (1e15, 10**15),
        (float(10**17 + 16), 10**17 + 16),
    ],
)
def test_large_floats_are_what_was_typed(typed, value):
    assert as_written(typed) == value


def potential(x, b):
    """The potential of Klebsch and Tisserand."""
    w1, w2, g1, g2, g3 = x
    return g2 * g3, b * g3 * g1, -w2 * g3, w1 * g3, w2 * g1 - w1 * g2


def chain(x, a, b, c, d):
    u, v, w, z = a * x[0] * x[1], b * x[1] * x[2], c * x[2] * x[3], d * x[3] * x[0]
    return u - z, v - u, w - v, z - w


@pytest.mark.parametrize(("f", "names", "integrals"), [(potential, "b", 2), (chain, "abcd", 1)])
def test_long_determinants_with_letters(f, names, integrals):
    """Polynomials of 13,000 terms: factored in one call they took over a minute."""
    D = 5 if f is potential else 4
    field = Field(f, D, **dict.fromkeys(names, 1))
    found = report(field, letters=" ".join(names), degree=2)
    assert [F.basis for F in found.integrals] == ["identity"] * integrals
    density = ["1/(x1*x2*x3*x4)"] if f is chain else []
    assert [str(rho) for rho in found.measures] == density
    assert any("too long" in text for text in found.searched) == (f is potential)


@pytest.mark.parametrize(
    ("n", "J"),
    [(2, (2, 2)), (2, (2, 3)), pytest.param(3, (2, 2, 2), marks=pytest.mark.slow)],
)
def test_bodies_in_n_dimensions_with_letters(n, J):
    rng = random.Random(2)

    def number():
        return Fraction(rng.randint(-9, 9), 8)

    found = report(SuslovND(J=J, I=[0.5, 0.25, 1][:n]), letters=True, degree=2)
    F = next(F for F in found.integrals if F.degree == 2)
    assert len(found.integrals) == n - 1
    x = [number() + Fraction(1, 3) for _ in range(n)]
    letters = {"J1": Fraction(9, 4), "J2": Fraction(7, 2), "eps": Fraction(1, 5)}
    letters |= {f"I{k + 1}": number() for k in range(n)}
    at = {name: letters[name] for name in F.letters}
    J1, J2, eps = letters["J1"], letters["J2"] if J[1] == 3 else letters["J1"], letters["eps"]
    if n == 2:  # the body in three dimensions with I1 I2 = J1 J2
        below = letters["I1"] * x[1] - letters["I2"] * x[0]
        value = (J1 * x[0] ** 2 + J2 * x[1] ** 2) / (4 * J1 * J2 + (eps * below) ** 2)
        value /= J1 if J1 == J2 else 1
    else:
        p = sum(letters[f"I{k + 1}"] * a for k, a in enumerate(x))
        value = sum(a * a for a in x) / ((2 * J1 - eps * p) * (2 * J1 + eps * p))
    assert F(x, **at) == value


def test_parameters_in_exponents_are_numbers():
    square = Field(lambda x, a: (x[1] ** a, -x[0]), 2, a=2)
    assert kahan(square, 1)([1, 2]) == kahan(Field(lambda x: (x[1] ** 2, -x[0]), 2), 1)([1, 2])
    inverse = rational_map(Map(lambda x, a: (x[1], x[0] ** a), 2, a=-2))
    assert str(inverse) == "rational_map(x2, 1/x1^2)"


def test_the_density_of_a_turn_is_without_eps():
    turn = report(Field(lambda x: (x[1], -x[0]), "x y"), degree=2)
    assert all("eps" not in str(rho) for rho in turn.measures)
