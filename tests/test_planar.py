"""Entropy of birational maps of the plane from contracted curves, against degrees and papers."""

import json
import math
import pickle
import random
from fractions import Fraction as F

import pytest

from suslov_fast import QuadraticField

pytest.importorskip("flint")

from suslov_fast.integrability import (
    PlanarEntropy,
    confinement,
    degrees,
    growth,
    kahan,
    never_confined,
    planar,
    planar_entropy,
    rational_map,
    report,
    zoo,
)
from suslov_fast.integrability.contracted import Passage, Plane

field_of = QuadraticField.from_function
THIRD = F(1, 3)
ZOO = zoo()


def three_lines(a, b):
    """Zander (2021): exponents (a, b, 1)."""
    return field_of(
        lambda x: (
            b * x[0] * (x[0] + x[1]) + x[0] * x[1],
            -a * x[1] * (x[0] + x[1]) - x[0] * x[1],
        ),
        2,
    )


def nahm(a, b, c, d):
    return field_of(lambda x: (2 * x[0] ** 2 + a * x[1] ** 2, b * x[0] * x[1] + c * x[1] ** 2), 2)


HALF = F(5, 2)
ICOSAHEDRAL = field_of(lambda x: (2 * x[0] ** 2 - x[1] ** 2, -10 * x[0] * x[1] + x[1] ** 2), 2)
TETRAHEDRAL = field_of(lambda x: (x[0] ** 2 - x[1] ** 2, -2 * x[0] * x[1]), 2)
QUARTIC = field_of(lambda x: (x[0] ** 2 + 3 * x[0] * x[1], 2 * x[0] * x[1] - x[1] ** 2), 2)
HIETARINTA_VIALLET = rational_map(
    lambda x: (x[1], x[1] + 1 / x[1] ** 2 - x[0]),
    2,
    inverse=lambda x: (x[0] + 1 / x[0] ** 2 - x[1], x[0]),
)
HENON = rational_map(
    lambda x: (x[1], x[1] ** 2 + 3 - 2 * x[0]),
    2,
    inverse=lambda x: ((x[0] ** 2 + 3 - x[1]) / 2, x[0]),
)


@pytest.mark.parametrize(
    ("map", "lengths", "entropy", "minimal", "proved"),
    [
        (kahan(*ZOO["Nahm, octahedral"]), [2, 4, 4], 0, "x - 1", True),
        (kahan(ICOSAHEDRAL, THIRD), [2, 3, 6], 0, "x - 1", True),
        (kahan(TETRAHEDRAL), [3, 3, 3], 0, "x - 1", True),
        (kahan(QUARTIC, THIRD), [None, None, 4], 0.656256, "x^4 - x^3 - x^2 - x - 1", True),
        (kahan(QUARTIC), [None, None, 4], 0.656256, "x^4 - x^3 - x^2 - x - 1", True),
        (
            kahan(three_lines(2, 2), THIRD),
            [None, None, 5],
            0.6759746921034222,
            "x^5 - x^4 - x^3 - x^2 - x - 1",
            True,
        ),
        (kahan(three_lines(HALF, HALF), THIRD), [None, None, 6], 0.684905, None, True),
        (kahan(three_lines(HALF, F(1, 2)), THIRD), [None, 4, 8], 0.653433, None, True),
        (kahan(*ZOO["Suslov body"]), [None, 2, 2], 0, "x - 1", True),
        (kahan(*ZOO["Lotka-Volterra"]), [None] * 3, math.log(2), "x - 2", True),
        (kahan(*ZOO["generic planar field"]), [None] * 3, math.log(2), "x - 2", True),
        (ZOO["Lyness"][0], [1, 1, 7], 0, "x - 1", True),
        (ZOO["Hone-Quispel"][0], [2, 2, 4, 4], 0, "x - 1", False),
        (HIETARINTA_VIALLET, [3], math.log((3 + math.sqrt(5)) / 2), "x^2 - 3*x + 1", True),
        (HENON, [None], math.log(2), "x - 2", True),
        (kahan(field_of(lambda x: (x[0], 2 * x[1]), 2), THIRD), [], 0, "x - 1", True),
    ],
)
def test_known_entropies(map, lengths, entropy, minimal, proved):
    found = planar_entropy(map)
    assert found.entropy == pytest.approx(entropy, abs=1e-6)
    assert minimal is None or str(found.minimal) == minimal
    assert sorted(found.lengths, key=lambda n: n or 0) == lengths
    assert (found.proved, found.entropy_error, found.reason) == (proved, 0, "")
    assert [*found.degrees[:10]] == degrees(map, 10)
    assert planar_entropy(map, seed=7) == found == pickle.loads(pickle.dumps(found))
    assert found.root == pytest.approx(math.exp(entropy), abs=1e-5)
    coefficients = {int(e): int(c) for (e,), c in found.minimal.to_dict().items()}
    assert abs(sum(c * found.root**k for k, c in coefficients.items())) < 1e-9
    assert growth(found.degrees, planar=True).entropy == pytest.approx(found.entropy, abs=1e-3)
    for each in found.contractions:
        assert str(each) in repr(found)
        assert each.how in found.based_on


def test_a_singularity_that_is_confined_after_17_points():
    """The degrees 2, 3, 4, ... end at 18."""
    map = kahan(field_of(lambda x: (1, x[0] * x[1]), 2), F(1, 2))
    found = planar_entropy(map)
    assert {*found.lengths} == {None, 17}
    # The other curve goes to points without an image for ever.
    assert (found.entropy, found.proved) == (0, False)
    assert found.entropy_error < 0.1
    assert [*found.degrees] == degrees(map, 24)
    assert found.degrees[15:18] == (17, 18, 18)


@pytest.mark.parametrize("seed", range(12))
def test_random_fields(seed):
    """Degrees of iterates agree with what contracted curves predict."""
    rng = random.Random(seed)
    rows = [[rng.choice([0, rng.randrange(-3, 4)]) for _ in range(6)] for _ in range(2)]
    field = field_of(
        lambda x: [
            sum(c * m for c, m in zip(row, (x[0] ** 2, x[0] * x[1], x[1] ** 2, *x, 1), strict=True))
            for row in rows
        ],
        2,
    )
    map = kahan(field, THIRD if seed % 3 else None)
    if map.is_planar:
        found = planar_entropy(map)
        assert found.reason or [*found.degrees[:8]] == degrees(map, 8)


def test_maps_without_an_entropy():
    flat = planar_entropy(rational_map(lambda x: (x[1], (x[1] + 3) / x[0]), 2))
    assert (flat.entropy, flat.proved) == (None, False)
    assert "no inverse was given" in repr(flat)
    constant = kahan(QuadraticField([[[0, 0], [0, 0]]] * 2, [[-8, 0], [0, -8]], [1, 1]), F(1, 4))
    assert "det DPhi = 0" in planar_entropy(constant).reason
    with pytest.raises(ValueError, match="two variables"):
        planar_entropy(kahan(ZOO["Euler top"][0], 1))
    with pytest.raises(TypeError, match="map "):
        planar_entropy(ZOO["Suslov body"][0])


@pytest.mark.parametrize(
    ("field", "entropy"),
    [
        (field_of(lambda x: (x[1] ** 2, 0), 2), 0),
        (field_of(lambda x: (x[0] * x[1], 0), 2), 0),
        (field_of(lambda x: (3 * x[0] + 2 * x[1], x[0] ** 2), 2), math.log((1 + math.sqrt(5)) / 2)),
        (field_of(lambda x: (2 * x[1] - 2 * x[0] * x[1], -x[0] - x[1] ** 2 * 3), 2), None),
    ],
)
def test_orbits_that_come_to_points_without_an_image_again_and_again(field, entropy, monkeypatch):
    """What the first steps show is no proof."""
    map = kahan(field, F(1, 2))
    found = planar_entropy(map)
    assert entropy is None or found.entropy == pytest.approx(entropy, abs=1e-9)
    assert [*found.degrees[:10]] == degrees(map, min(10, len(found.degrees)))
    if "again and again" in found.based_on:
        assert not found.proved
        monkeypatch.setattr(planar, "rational_series", lambda terms: None)
        assert "without a rule" in planar_entropy(map).reason


def test_orbits_that_are_not_decided(monkeypatch):
    """Then the error is that of a confinement at the first step that is not looked at."""
    monkeypatch.setattr(planar, "why_never", lambda *given: "")
    found = planar_entropy(kahan(*ZOO["generic planar field"]))
    assert (found.proved, found.lengths) == (False, (None,) * 3)
    # If all three were confined, the entropy would be that of x**81 (x - 2) + 3.
    assert found.entropy_error * 2.0**82 == pytest.approx(3)
    assert "not confined within 80 steps" in found.based_on
    monkeypatch.setattr(planar, "_STEPS", 5)
    assert 1e-3 < planar_entropy(kahan(QUARTIC, THIRD)).entropy_error < 0.1


def test_powers_of_a_moebius_transformation():
    """All kinds, against iteration: it meets a point of its orbit, and no other."""
    matrices = [
        [2, 0, 1, 1],
        [3, 1, 1, 2],
        [1, 1, 1, 0],
        [3, -4, 4, 3],
        [2, -1, 1, 0],
        [1, 2, -2, 5],
        [5, 1, 12, 7],
    ]
    for a, b, c, d in matrices:
        start, orbit = F(3, 7), []
        for _ in range(30):
            start = (a * start + b) / (c * start + d)
            orbit.append(start)
        matrix = [[a, b], [c, d]]
        for end in (orbit[3], orbit[17], orbit[29]):
            assert not never_confined._never_meets(matrix, orbit[0], end)
        for end in (F(1, 11), F(-5, 3), orbit[0]):
            assert never_confined._never_meets(matrix, orbit[1], end)
    assert never_confined._never_meets([[0, -1], [1, 0]], F(1, 3), F(2)) is False  # of finite order


@pytest.mark.parametrize("map", [kahan(QUARTIC, THIRD), kahan(QUARTIC)])
def test_invariant_lines_decide_where_no_small_prime_does(map, monkeypatch):
    monkeypatch.setattr(never_confined, "_SMALL_PRIMES", ())
    found = planar_entropy(map)
    assert found.proved
    assert found.based_on.count("never, since the orbit is on an invariant line") == 2
    by_lines = planar_entropy(kahan(*ZOO["generic planar field"]))
    assert (by_lines.proved, by_lines.lengths) == (False, (None,) * 3)


def test_a_wrong_passage_is_no_proof():
    map = kahan(*ZOO["Nahm, octahedral"])
    plane = Plane(map)
    passages = planar.passages_across(plane, 80, 0)
    for number, right in enumerate(passages):
        assert confinement.is_proved(plane, number, right)
        longer = Passage(
            (0, *right.common_orders), (right.curve_orders[0], *right.curve_orders), right.steps + 1
        )
        *before, last = right.curve_orders
        tangent = right._replace(curve_orders=(*before, tuple(2 * k for k in last)))
        for wrong in (longer, tangent, right._replace(steps=None)):
            assert not confinement.is_proved(plane, number, wrong)
        assert never_confined.why_never(plane, number, longer) == ""


def test_reports_list_it_beside_the_growth(monkeypatch):
    field, eps = ZOO["Suslov body"]
    found = report(field, eps, 2)
    assert "Entropy from contracted curves (proved): 0; lengths" in repr(found)
    assert json.loads(json.dumps(found.to_dict()))["planar"]["proved"] is True
    assert report(ZOO["Euler top"][0], eps, 1).planar is None
    found.planar = PlanarEntropy(reason="no prime was found")
    assert "Entropy from contracted curves: none, no prime was found" in repr(found)
    late = report(kahan(three_lines(2, 2), THIRD), degree=1)
    assert "log of the largest root of x^5 - x^4 - x^3 - x^2 - x - 1" in repr(late)
    late.degrees = [2**k for k in range(1, 8)]  # as for a singularity that is confined at step 8
    assert late.growth.entropy_error == pytest.approx(math.log(2) - 0.6759746921034222)
    assert "by accident" in late.growth.based_on
    wrong = planar.planar_entropy(kahan(three_lines(2, 2), THIRD))
    monkeypatch.setattr(planar, "planar_entropy", lambda map, seed: wrong)
    with pytest.raises(ArithmeticError, match="an error of the package"):
        report(field, eps, 1)
