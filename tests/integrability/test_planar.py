"""Entropy of birational maps of the plane from contracted curves, against degrees and papers."""

import math
import pickle
from dataclasses import replace
from fractions import Fraction as F
from itertools import islice

import numpy as np
import pytest
from papers import three_lines

from suslov_fast import Field, Map
from suslov_fast.integrability import (
    contracted_curves,
    entropy as planar,
    growth,
    kahan,
    planar_entropy,
    rational_map,
    report,
    zoo,
)
from suslov_fast.integrability.contracted_curves import Plane
from suslov_fast.integrability.degrees_of_iterates import agreed_degrees

THIRD = F(1, 3)
ZOO = zoo()


HALF = F(5, 2)
ICOSAHEDRAL = Field(lambda x: (2 * x[0] ** 2 - x[1] ** 2, -10 * x[0] * x[1] + x[1] ** 2), 2)
TETRAHEDRAL = Field(lambda x: (x[0] ** 2 - x[1] ** 2, -2 * x[0] * x[1]), 2)
QUARTIC = Field(lambda x: (x[0] ** 2 + 3 * x[0] * x[1], 2 * x[0] * x[1] - x[1] ** 2), 2)
HIETARINTA_VIALLET = rational_map(
    Map(lambda x: (x[1], x[1] + 1 / x[1] ** 2 - x[0]), 2),
    Map(lambda x: (x[0] + 1 / x[0] ** 2 - x[1], x[0]), 2),
)
HENON = rational_map(
    Map(lambda x: (x[1], x[1] ** 2 + 3 - 2 * x[0]), 2),
    Map(lambda x: ((x[0] ** 2 + 3 - x[1]) / 2, x[0]), 2),
)


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("map", "lengths", "entropy", "minimal"),
    [
        (kahan(*ZOO["Nahm, octahedral"]), [2, 4, 4], 0, "x - 1"),
        (kahan(ICOSAHEDRAL, THIRD), [2, 3, 6], 0, "x - 1"),
        (kahan(TETRAHEDRAL), [3, 3, 3], 0, "x - 1"),
        (kahan(QUARTIC, THIRD), [None, None, 4], 0.656256, "x^4 - x^3 - x^2 - x - 1"),
        (kahan(QUARTIC), [None, None, 4], 0.656256, "x^4 - x^3 - x^2 - x - 1"),
        (
            kahan(three_lines(2, 2), THIRD),
            [None, None, 5],
            0.6759746921034222,
            "x^5 - x^4 - x^3 - x^2 - x - 1",
        ),
        (kahan(three_lines(HALF, HALF), THIRD), [None, None, 6], 0.684905, None),
        (kahan(three_lines(HALF, F(1, 2)), THIRD), [None, 4, 8], 0.653433, None),
        (kahan(*ZOO["Suslov body"]), [None, 2, 2], 0, "x - 1"),
        (kahan(*ZOO["Lotka-Volterra"]), [None] * 3, math.log(2), "x - 2"),
        (kahan(*ZOO["generic planar field"]), [None] * 3, math.log(2), "x - 2"),
        (ZOO["Lyness"][0], [1, 1, 7], 0, "x - 1"),
        (ZOO["Hone-Quispel"][0], [2, 2, 4, 4], 0, "x - 1"),
        (ZOO["McMillan"][0], [2, 2], 0, "x - 1"),
        (HIETARINTA_VIALLET, [3], math.log((3 + math.sqrt(5)) / 2), "x^2 - 3*x + 1"),
        (HENON, [None], math.log(2), "x - 2"),
        (kahan(Field(lambda x: (x[0], 2 * x[1]), 2), THIRD), [], 0, "x - 1"),
    ],
)
def test_known_entropies(map, lengths, entropy, minimal):
    found = planar_entropy(map)
    assert check_entropy(map, found) == pytest.approx(entropy, abs=1e-6)
    assert minimal is None or str(found.minimal) == minimal
    assert sorted(found.lengths, key=lambda n: n or 0) == lengths
    # A conic that the map of Hone and Quispel contracts has no proof.
    assert (found.proved, found.reason) == (lengths != [2, 2, 4, 4], "")
    assert found == pickle.loads(pickle.dumps(found))
    for each in found.contractions:
        assert str(each) in repr(found)
        assert each.how in found.based_on


def test_maps_without_an_entropy():
    flat = planar_entropy(rational_map(Map(lambda x: (x[1], (x[1] + 3) / x[0]), 2)))
    assert (flat.entropy, flat.proved) == (None, False)
    assert "no inverse was given" in repr(flat)
    constant = kahan(Field.from_terms([[[0, 0], [0, 0]]] * 2, [[-8, 0], [0, -8]], [1, 1]), F(1, 4))
    assert "det DPhi = 0" in planar_entropy(constant).reason
    with pytest.raises(ValueError, match="two variables"):
        planar_entropy(kahan(ZOO["Euler top"][0], 1))
    with pytest.raises(TypeError, match="map "):
        planar_entropy(len)


def test_an_integral_proves_entropy_0(monkeypatch):
    monkeypatch.setattr(planar, "is_proved", lambda *given: False)
    map = ZOO["Lyness"][0]
    by_curves = planar_entropy(map)
    assert (by_curves.entropy, by_curves.proved) == (0, False)
    found = report(map)
    assert found.planar.proved
    assert str(found.integrals[0]) in found.planar.based_on
    assert "Entropy (proved): 0" in repr(found)
    # One that is checked at random points proves nothing.
    (integral,) = found.integrals
    unproved = replace(integral, basis="modulo a prime, at random points")
    assert planar.proved_by_integral(by_curves, [unproved]) is by_curves


def test_an_orbit_that_no_small_prime_decides():
    """On a line that the map takes to itself by a translation."""
    found = planar_entropy(kahan(three_lines(-1, F(3, 2)), THIRD))
    assert (found.proved, found.entropy, found.lengths.count(None)) == (False, 0, 2)
    assert "not confined within 80 steps" in found.based_on


def test_points_that_orbits_visit():
    """The pattern of Lyness' map passes points without an image; conjugate lines have a root r."""
    pattern = next(c for c in planar_entropy(ZOO["Lyness"][0]).contractions if c.length == 7)
    points = [tuple(map(str, x)) for x in pattern.points]
    assert points[:3] == [("-3", "0", "1"), ("0", "-1", "1"), ("0", "1", "0")]
    assert points[3:] == [("-1", "1", "0"), ("1", "0", "0"), ("-1", "0", "1"), ("0", "-3", "1")]
    step = kahan(*ZOO["Nahm, octahedral"])
    for curve in planar_entropy(step).contractions:
        *orbit, last = [[f.constant for f in x[:2]] for x in curve.points]
        assert len(curve.points) == curve.length
        assert [step(x) for x in orbit] == [*map(tuple, [*orbit[1:], last])]
        with pytest.raises(ZeroDivisionError):
            step(last)
    body = planar_entropy(kahan(*ZOO["Suslov body"])).contractions[1]
    first, second = body.points
    assert str(body.root) == "3*r^2 + 128*r + 4096"
    assert [str(f) for f in (*first, *second)] == ["r", "r + 64", "1", "-r", "-(r + 64)", "1"]


def test_a_wrong_order_is_no_proof():
    """Orders along a conic, which are multiplicities at its one base point."""
    plane = Plane(kahan(*ZOO["Suslov body"]))
    right = planar.passages_across(plane, 80)[1]
    assert contracted_curves.is_proved(plane, 1, right)
    first, (order, other) = right.curve_orders
    wrong = right._replace(curve_orders=(first, (order + 1, other)))
    assert not contracted_curves.is_proved(plane, 1, wrong)


GOLDEN = math.log((1 + math.sqrt(5)) / 2)


def cheap_degrees(map):
    """The degrees on random lines, as long as they take little time."""
    found = []
    for degree in islice(agreed_degrees(map), 14):
        found.append(degree)
        if degree > 150:
            break
    return found


def check_entropy(map, found):
    """Compare it with degrees, which are computed on lines, and return it."""
    assert found.entropy is not None, found.reason
    d = cheap_degrees(map)
    assert [*found.degrees[: len(d)]] == d
    c = [int(found.polynomial.to_dict().get((k,), 0)) for k in range(len(found.polynomial) + 99)]
    c = c[: max(k for k, a in enumerate(c) if a) + 1]
    sequence = [1, *found.degrees]
    for k in range(len(sequence) - len(c) + 1):
        assert sum(a * b for a, b in zip(c, sequence[k:], strict=False)) == 0
    assert math.exp(found.entropy) == pytest.approx(max(1, *abs(np.roots(c[::-1]))), abs=1e-3)
    by_degrees = growth(d, planar=True)
    if not math.isnan(by_degrees.entropy):
        assert found.entropy == pytest.approx(by_degrees.entropy, abs=1e-9)
    return found.entropy


@pytest.mark.parametrize(
    ("map", "entropy"),
    [
        (kahan(Field(lambda x: (3 * x[0] + 2 * x[1], x[0] ** 2), 2), F(1, 2)), GOLDEN),
        (
            rational_map(
                Map(lambda x: (x[0] ** 2 * x[1], x[0] * x[1]), 2),
                Map(lambda x: (x[0] / x[1], x[1] ** 2 / x[0]), 2),
            ),
            2 * GOLDEN,
        ),
    ],
)
def test_orbits_that_come_to_points_without_an_image_again_and_again(map, entropy):
    found = planar_entropy(map)
    assert not found.proved
    assert "again and again" in repr(found)
    assert check_entropy(map, found) == pytest.approx(entropy, abs=1e-12)
    assert str(found.minimal) == ("x^2 - x - 1" if entropy == GOLDEN else "x^2 - 3*x + 1")


def test_orders_that_repeat():
    """McMillan's map and a constant: the singularity is never confined, and orders repeat."""
    broken = rational_map(
        Map(lambda x: (x[1], 3 - x[0] + (2 * x[1] + 1) / (1 - x[1] ** 2)), 2),
        Map(lambda x: (3 - x[1] + (2 * x[0] + 1) / (1 - x[0] ** 2), x[0]), 2),
    )
    found = planar_entropy(broken)
    assert (str(found.minimal), found.proved, found.lengths) == (
        "x^3 - 2*x^2 - 2",
        False,
        (None,) * 2,
    )
    assert check_entropy(broken, found) == pytest.approx(0.8583666967, abs=1e-9)


def test_equations_without_a_map_are_not_invertible():
    """x' = 2 x at eps = 1 has det A = 1 - eps = 0 everywhere."""
    assert kahan(Field(lambda x: (2 * x[0], x[0] * x[1]), 2), 1).is_invertible is False
    assert kahan(Field(lambda x: (2 * x[0], x[0] * x[1]), 2), 2).is_invertible is True


MCMILLAN = rational_map(
    Map(lambda x: (x[1], -x[0] + (2 * x[1] + 1) / (1 - x[1] ** 2)), 2),
    Map(lambda x: (-x[1] + (2 * x[0] + 1) / (1 - x[0] ** 2), x[0]), 2),
)


@pytest.mark.parametrize(
    ("map", "degree"),
    [
        (MCMILLAN, 4),
        (kahan(three_lines(1, 1), THIRD), 3),
        (kahan(three_lines(2, 3), THIRD), 6),
        (HIETARINTA_VIALLET, None),
    ],
)
def test_the_degree_of_an_invariant_pencil(map, degree):
    """A report finds its integral, though it has a higher degree than was asked for."""
    assert planar_entropy(map).pencil == degree
    assert [f.degree for f in report(map, degree=2).integrals] == ([degree] if degree else [])


def repaired(x, a, d, eps):
    return (a + eps**2 * d) * x[0] ** 2 + x[1] ** 2 + x[1] + d, -2 * x[0] * x[1]


def test_a_repair():
    """The map of x' = 2 x^2 + y^2 + y + d, y' = -2 x y is repaired by eps^2 d x^2."""
    flow = Field(lambda x, a, d: repaired(x, a, d, 0), "x y", a=2, d=1)
    assert round(planar_entropy(kahan(flow, THIRD)).entropy, 6) == round(math.log(2), 6)
    step = kahan(Field(repaired, "x y", a=2, d=1, eps=7), letters="eps d")
    at_third = step.subs(eps=THIRD, d=3)
    assert at_third.inverse(at_third((1, 2))) == (1, 2)
    assert at_third((1, 2)) == kahan(Field(repaired, "x y", a=2, d=3, eps=THIRD), THIRD)((1, 2))
    assert planar_entropy(at_third).lengths == (2, 4, 4)


@pytest.mark.parametrize(
    ("exponents", "lengths"),
    [
        (lambda k: (1, 1, 2 / (1 + k)), [2, 4, 4]),
        (lambda k: (1, 2 / (1 + k), (3 + k) / (1 + 3 * k)), [2, 3, 6]),
    ],
)
def test_repaired_exponents_of_three_lines(exponents, lengths):
    """Coefficients of large degree in eps: orders are proved at the points of one orbit."""

    def f(x, eps):
        (u, v), w, (a, b, c) = x, x[0] + x[1] + 2, exponents(eps**2)
        return b * u * w + c * u * v, -(a * v * w + c * u * v)

    found = planar_entropy(kahan(Field(f, "x y", eps=1), letters="eps"))
    assert (found.entropy, found.proved, sorted(found.lengths)) == (0, True, lengths)


@pytest.mark.slow
@pytest.mark.parametrize("letters", ["eps", "eps d"])
def test_a_repair_is_proved(letters):
    found = report(Field(repaired, "x y", a=2, d=2, eps=1), letters=letters, degree=4)
    (F_1,) = found.integrals
    assert (F_1.basis, F_1.degree, found.proved_entropy) == ("identity", 4, 0.0)
    limit = F_1.subs(eps=0, d=2) if "d" in letters else F_1.subs(eps=0)
    assert str(limit.numerator.factor()[1][0][0]) in ("y", "12*x^2 + 3*y^2 + 4*y + 12")
