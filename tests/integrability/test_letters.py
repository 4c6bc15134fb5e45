"""Reports with letters: theorems of the literature, and values at random numbers."""

import functools
import random
from fractions import Fraction

import flint
import numpy as np
import pytest
import sympy
from papers import assert_holds, assert_text

from suslov_fast import Field, Map, Suslov3D
from suslov_fast.integrability import (
    cofactors,
    darboux_polynomials,
    degrees,
    hk_bases,
    interpolation,
    kahan,
    rational_map,
    report,
)
from suslov_fast.integrability.rational_functions import independent


def euler(x, a, b, c):
    return a * x[1] * x[2], b * x[2] * x[0], c * x[0] * x[1]


def chain(x, a, b, c):
    return x[0] * (a * x[1] - c * x[2]), x[1] * (b * x[2] - a * x[0]), x[2] * (c * x[0] - b * x[1])


def volterra(x, a, b, c):
    return a * x[1] * x[2], (b * x[0] + 1) * x[2], (c * x[0] - 1) * x[1]


def prey(x, a, b, c, d):
    return x[0] * (a - b * x[1]), -x[1] * (c - d * x[0])


def cubic(x, a, b, c, d, e, f, g, h, i, j):
    q, p = x
    third = a * q**3 + b * q**2 * p + c * q * p**2 + d * p**3
    return third + e * q**2 + f * q * p + g * p**2 + h * q + i * p + j


def qrt(x, a, b, c, d, e):
    y = x[1]
    return y, -(b * y * y + d * y + e) / (a * y * y + b * y + c) - x[0]


def values_of(names, rng):
    """Random fractions, which floats hold exactly, for names."""
    return {name: Fraction(rng.randint(1, 40), 16) for name in names}


def point_of(n, rng):
    return [Fraction(2 * rng.randint(-15, 15) + 1, 7) for _ in range(n)]


BODY = "I1 I2 I13 I23"
# The integrals of the literature: Dragovic and Gajic; Hirota and Kimura; of x''' = a x x',
# Celledoni and others (2014).
KNOWN = {
    "Lemma 1": (
        lambda **a: Suslov3D(**a), BODY,
        [lambda x, eps, I1, I2, I13, I23: (I1 * x[0]**2 + I2 * x[1]**2)
         / (4 * I1 * I2 + eps**2 * (I13 * x[0] + I23 * x[1])**2)],
    ),
    "gyrostat": (
        lambda **a: Suslov3D(**a), f"{BODY} k",
        [lambda x, eps, I1, I2, I13, I23, k: (I1 * x[0]**2 + I2 * x[1]**2)
         / (4 * I1 * I2 + eps**2 * (I13 * x[0] + I23 * x[1] + k)**2)],
    ),
    "Euler top": (
        lambda **a: Field(euler, 3, **a), "a b c",
        [lambda x, eps, a, b, c: (a * x[1]**2 - b * x[0]**2) / (4 - eps**2 * a * c * x[1]**2),
         lambda x, eps, a, b, c: (a * x[2]**2 - c * x[0]**2) / (4 - eps**2 * a * b * x[2]**2)],
    ),
    "Volterra chain": (
        lambda **a: Field(chain, 3, **a), "a b c", [lambda x, eps, a, b, c: sum(x)],
    ),
    "Zhukovski-Volterra": (
        lambda **a: Field(volterra, 3, **a), "a b c",
        [lambda x, eps, a, b, c: (a * c * x[2]**2 - (c * x[0] - 1)**2)
         / (4 - eps**2 * a * c * x[1]**2),
         lambda x, eps, a, b, c: (a * b * x[1]**2 - (b * x[0] + 1)**2)
         / (4 - eps**2 * a * b * x[2]**2)],
    ),
    "Lotka-Volterra": (lambda **a: Field(prey, "x y", **a), "a b c d", []),
    "Ishii": (
        lambda **a: Field(lambda x, a: (x[1], x[2], a * x[0] * x[1]), 3, **a), "a",
        [lambda x, eps, a: x[2] - a * x[0]**2 / 2 + a * eps**2 / 8 * x[1]**2],
    ),
    "QRT map": (
        lambda **a: Map(qrt, 2, **a), "a b c d e",
        [lambda x, eps, a, b, c, d, e: a * (x[0] * x[1])**2 + c * (x[0]**2 + x[1]**2)
         + (b * x[0] * x[1] + e) * (x[0] + x[1]) + d * x[0] * x[1]],
    ),
}  # fmt: skip


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", KNOWN)
def test_theorems_of_the_literature(name):
    """Reports with letters, at four numbers, and with eps alone have the known integrals."""
    make, letters, known = KNOWN[name]
    rng, names = random.Random(name), letters.split()
    found = with_letters(name)
    assert len(found.integrals) == found.relations
    for _ in range(4):
        numbers, eps = values_of(names, rng), Fraction(rng.randint(1, 40), 16)
        system = make(**{n: float(a) for n, a in numbers.items()})
        step = {} if isinstance(system, Map) else {"eps": eps}
        at_numbers = report(system, degree=found.degree, **step)
        map, own = at_numbers.map, [F.subs(**step, **numbers) for F in found.integrals]
        assert len(at_numbers.integrals) == len(own)
        assert len(independent([*own, *at_numbers.integrals], map.prime)) == len(own)
        for x in (point_of(map.dimension, rng) for _ in range(2)):
            assert_holds(found, map, x, **step, **numbers)
            for given in known:  # as many, so that each is a function of the others
                assert given(x, eps=eps, **numbers) == given(map(x), eps=eps, **numbers)
    other = report(system, degree=found.degree)
    assert [len(other.integrals), growth_of(other)] == [found.relations, growth_of(found)]
    assert_holds(other, map, **step)
    assert_text(other)
    for one in (*found.integrals, *found.measures, *other.integrals, *other.measures):
        assert one.basis == "identity"


def growth_of(found):
    return found.degrees[:7], found.growth.kind, bool(found.measures)


def test_lemma_1_as_the_paper_prints_it():
    found = with_letters("Lemma 1")
    (F,) = found.integrals
    x, y, eps, I1, I2, I13, I23 = sympy.symbols("Omega1 Omega2 eps I1 I2 I13 I23")
    paper = (I1 * x**2 + I2 * y**2) / (4 * I1 * I2 + eps**2 * (I13 * x + I23 * y) ** 2)
    assert sympy.simplify(sympy.sympify(F) - paper) == 0
    assert F.letters == ("eps", "I1", "I2", "I13", "I23")
    assert str(F.numerator) == "I1*Omega1^2 + I2*Omega2^2"
    assert F.denominator.context().names() == (*F.letters, "Omega1", "Omega2")
    assert "I_{13}" in sympy.latex(F)
    assert sympy.simplify(sympy.sympify(F.subs(eps=0, I2=3)) - paper.subs({eps: 0, I2: 3})) == 0
    assert "letters eps, I1" in str(found)


@functools.cache
def with_letters(name):
    make, letters, _ = KNOWN[name]
    system = make(**dict.fromkeys(letters.split(), 1))
    return report(system, letters=letters, degree=4 if isinstance(system, Map) else 3)


@pytest.mark.slow
def test_modified_hamiltonian_of_ten_coefficients():
    """H + grad H (x~ - x) / 3 for all planar cubic H (Celledoni and others, 2013)."""
    rng, names = random.Random(4), "abcdefghij"
    field = Field.from_hamiltonian(cubic, "q p", **dict.fromkeys(names, 1))
    (F,) = report(field, letters=" ".join(names), degree=2).integrals
    assert F.basis == "identity"
    numbers, eps = values_of(names, rng), Fraction(1, 8)
    given = {n: float(a) for n, a in numbers.items()}
    map = kahan(Field.from_hamiltonian(cubic, "q p", **given), eps)
    pairs = []
    for x in ([1, 2], [Fraction(1, 3), -1], [5, Fraction(2, 7)]):
        q, p = sympy.symbols("q p")
        H = cubic((q, p), **{n: sympy.Rational(a) for n, a in numbers.items()})
        at = {q: sympy.Rational(x[0]), p: sympy.Rational(x[1])}
        steps = (sympy.Rational(b) - sympy.Rational(a) for a, b in zip(x, map(x), strict=True))
        modified = H + sum(H.diff(v) * d for v, d in zip((q, p), steps, strict=True)) / 3
        pairs.append((modified.subs(at), sympy.Rational(F(x, eps=eps, **numbers))))
    (H, F), *others = pairs
    (ratio,) = {(H - modified) / (F - value) for modified, value in others}
    assert ratio != 0


def test_maps_with_letters():
    forward = Map(lambda x, a, b: (x[1], (a * x[1] + b) / x[0]), 2, a=1, b=1)
    backward = Map(lambda x, a, b: ((a * x[0] + b) / x[1], x[0]), 2, a=1, b=1)
    lyness = rational_map(forward, backward, letters="a b")
    assert [str(value) for value in lyness([1, 2])] == ["2", "2*a + b"]
    assert lyness.subs(a=1, b=3)([1, 2]) == (2, 5)
    assert str(lyness(lyness([1, 2]))) == "(2*a + b, (2*a^2 + a*b + b)/2)"
    named = kahan(Field(lambda x, a: (a * x[1], x[0]), "u v", a=2))
    step = named.subs(eps=1)
    assert [F.subs(eps=1).constant for F in named(named([1, 2]))] == [*step(step([1, 2]))]
    with pytest.raises(TypeError, match="b: pass"):
        lyness.subs(a=1)
    with pytest.raises(TypeError, match="a is symbolic"):
        lyness.jacobian([1, 2])
    found = report(lyness, degree=4)
    (F,) = found.integrals
    at_one = "(x1 + 1)*(x2 + 1)*(x1 + x2 + 3)/(x1*x2)"
    difference = sympy.simplify(sympy.sympify(F.subs(a=1, b=3)) - sympy.sympify(at_one))
    assert difference.is_number
    assert found.proved_entropy == 0.0
    assert "a = 1, b = 1" in found.notes[-1]  # the period is 5
    assert "2 independent integrals" in found.notes[-1]


def test_symmetries_with_letters():
    field = Field(lambda x, a, b: (a * x[0] * x[1], b * x[0] * x[1]), "x y", a=1, b=2)
    (reversor,) = report(field, letters="a b", degree=1).symmetries
    assert reversor((2, 3)) == (-2, -3)


def test_fractions_of_a_body_beside_letters_are_exact():
    body = Suslov3D(Fraction(5, 3), 1, Fraction(1, 3), 0.1)
    (F,) = report(body, letters="I2").integrals
    numbers = {"eps": Fraction(1, 2), "I2": Fraction(7, 3)}
    others = {"I1": Fraction(5, 3), "I13": Fraction(1, 3), "I23": Fraction(1, 10)}
    paper = KNOWN["Lemma 1"][2][0]
    points = [2, 5], [1, -3], [4, 7]
    assert len({F(x, **numbers) / paper(x, **numbers, **others) for x in points}) == 1


def kirchhoff(x, a, b, c, d):
    m, p = x[:3], x[3:]
    w, u = (a * m[0], a * m[1], b * m[2]), (c * p[0], c * p[1], d * p[2])
    return (*np.add(np.cross(m, w), np.cross(p, u)), *np.cross(p, w))


def clebsch(x, a, b, c):
    m, p = x[:3], x[3:]
    return (*np.cross(p, (a * p[0], b * p[1], c * p[2])), *np.cross(p, m))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("f", "names", "written", "degrees"),
    [
        (kirchhoff, "abcd", 2, [8, 8]),
        (clebsch, "abc", 1, [6, 8, 10]),
    ],
)
def test_bodies_in_six_variables(f, names, written, degrees):
    """The other integrals are too long: they are given by their bases."""
    rng = random.Random(3)
    found = report(Field(f, 6, **dict.fromkeys(names, 1)), letters=" ".join(names), degree=2)
    assert [integral.degree for integral in found.implicit] == degrees
    assert [F.basis for F in found.integrals] == ["identity"] * written
    for _ in range(4):
        numbers, eps = values_of(names, rng), Fraction(rng.randint(1, 40), 16)
        map = kahan(Field(f, 6, **{n: float(a) for n, a in numbers.items()}), eps)
        x = point_of(6, rng)
        for F in found.integrals:
            at_numbers = F.subs(eps=eps, **numbers)
            assert at_numbers(map(x)) == at_numbers(x) == F(x, eps=eps, **numbers)


def test_the_other_functions_take_letters():
    top, rng = Field(euler, 3, a=1, b=1, c=1), random.Random(5)
    basis = hk_bases(top, 2, letters="a b c")
    assert (basis.dimension, basis.independent, basis.complete) == (2, 2, True)
    found = darboux_polynomials(top, 2, letters="a b c")
    assert found[0].context().names() == ("eps", "a", "b", "c", "x1", "x2", "x3")
    numbers, eps = values_of("abc", rng), Fraction(3, 8)
    map = kahan(Field(euler, 3, **{n: float(a) for n, a in numbers.items()}), eps)
    x = point_of(3, rng)
    y = map(x)
    assert all(F(x, eps=eps, **numbers) == F(y, eps=eps, **numbers) for F in basis.integrals)
    rational = [flint.fmpq(a.numerator, a.denominator) for a in (eps, *numbers.values())]
    points = [[*rational, *(flint.fmpq(a.numerator, a.denominator) for a in at)] for at in (x, y)]
    over_q = flint.fmpq_mpoly_ctx.get(found[0].context().names())
    (q, *others) = ([over_q.from_dict(P.to_dict())(*at) for at in points] for P in found)
    assert all(p[0] * q[1] == p[1] * q[0] for p in others)  # they have one cofactor
    assert str(cofactors(top, 1, letters="a")[0]) == "1"


def test_degrees_are_those_of_general_letters():
    """x2' / x1 (x2 + a): the map of Lyness has degrees of its own where a = b."""
    map = rational_map(
        Map(lambda x, a, b: (x[1], (x[1] + a) / (x[0] + b)), 2, a=1, b=1), letters="a b"
    )
    general = degrees(map, 8)
    assert general == degrees(map.subs(a=7, b=3), 8)
    assert general != degrees(map.subs(a=5, b=0), 8)


def test_a_report_with_letters_ends_when_progress_says_so():
    calls = []

    def until(done, parts):
        calls.append(done)
        return len(calls) < 60

    found = report(Suslov3D(4, 1, -0.5, -0.25), letters=BODY, progress=until)
    assert len(calls) == 60
    assert not found.finished
    assert found.relations == 1
    assert max(calls) < 30  # the others came while a formula was interpolated


def test_progress_tells_degrees_and_a_report_what_it_leaves_out(monkeypatch, capsys):
    monkeypatch.setattr(interpolation, "MOST_SEARCHES", 70)
    found = report(Suslov3D(4, 1, -0.5, -0.25), letters=BODY, degree=2, progress=True)
    assert "64 of at most 4096" in capsys.readouterr().err
    assert (found.integrals, found.independent) == ((), 1)
    assert any("too many terms: quotients" in note for note in found.notes)
