"""Maps on levels of their integrals: entropies, against degrees of iterates and papers."""

import math
import pickle
from fractions import Fraction as F

import numpy as np
import pytest
from papers import lotka_volterra

from suslov_fast import Field, Map, SuslovND
from suslov_fast.integrability import (
    degrees,
    growth,
    kahan,
    on_level,
    planar_entropy,
    rational_map,
    report,
    zoo,
)

SILVER = math.log(1 + math.sqrt(2))
ZOO = zoo()


def of_zoo(name):
    field, eps = ZOO[name]
    return report(field, eps=eps)


def total(x):
    return x[0] + x[1] + x[2]


def rotors(a, b):
    """The gyrostat of Zhukovsky and Volterra."""
    products = lambda x: (x[1] * x[2], x[2] * x[0], x[0] * x[1])  # noqa: E731
    return Field(lambda x: np.array(a) * products(x) + np.cross(x, b), 3)


def third_order(z):
    """The map of a recurrence x_(n+3) = z(x_n, x_(n+1), x_(n+2)) that is the same backwards."""
    return rational_map(
        Map(lambda x: (x[1], x[2], z(*x)), 3), Map(lambda x: (z(*x[::-1]), x[0], x[1]), 3)
    )


# Hietarinta and Viallet: z' = z - y + h / z^2, with the integral h.
LATE = (
    third_order(lambda x, y, z: z - y + (z + x - y) * y**2 / z**2),
    [lambda x: (x[2] + x[0] - x[1]) * x[1] ** 2],
)
HENON = rational_map(
    Map(lambda x: (x[1], x[2], x[2] ** 2 + x[2] - x[1] ** 2 + 2 * x[0] - 2 * x[1]), 3),
    Map(lambda x: ((x[2] - x[1] - x[1] ** 2 + x[0] ** 2) / 2 + x[0], x[0], x[1]), 3),
)
BETAS = kahan(rotors((1, 2, -3), (1, 2, 0)), F(1, 2))
OF_BETAS = [lambda x: (4 * x[0] ** 2 - 2 * x[1] ** 2 + 4 * x[0] + 8 * x[1] - 7) / (x[2] ** 2 - 8)]

CASES = [  # a map, its integrals, the entropy
    *((kahan(lotka_volterra(*k), F(1, 2)), [total], 0) for k in ((1, 1, 1), (1, 1, 0), (1, 2, -2))),
    *((kahan(lotka_volterra(*k), F(1, 3)), [total], 0) for k in ((1, -3, 3), (2, 3, -2))),
    (BETAS, OF_BETAS, SILVER),
    (*LATE, math.log((3 + math.sqrt(5)) / 2)),
    (HENON, [lambda x: x[2] - x[1] ** 2 + 2 * x[0]], math.log(2)),
    (
        third_order(lambda x, y, z: (y * z + 3) / x),
        [lambda x: x[0] / x[2] + x[2] / x[0] + 3 / (x[1] * x[2]) + 3 / (x[0] * x[1])],
        0,
    ),
    *(
        (kahan(lotka_volterra(*k), F(1, 2)), [total], math.log(2))
        for k in ((1, 2, 3), (2, 1, 3), (3, 1, 1), (1, 2, 0), (4, 1, 1), (0, 1, 2))
    ),
    (kahan(rotors((1, 2, -3), (1, 1, 0)), F(1, 2)), None, SILVER),
    (kahan(rotors((2, 1, -3), (1, 0, 3)), F(1, 2)), None, SILVER),
    (kahan(rotors((1, 4, -5), (0, 3, 0)), F(1, 2)), None, 0),
    # The cross product of two gradients of quadratic forms.
    (kahan(Field(lambda x: np.cross(x * (1, 2, 3), x * (2, 1, 0)), 3), F(1, 4)), None, 0),
    (kahan(*ZOO["Kharlamova"]), None, SILVER),
    # Four conjugate lines go to points over a number field with the letter.
    (kahan(*ZOO["Euler top"]), None, 0),
    (kahan(SuslovND(J=[2, 2, 2], I=[1, 2, -1]).field(), F(1, 4)), None, 0),
    (kahan(SuslovND(J=[2, 2, 2, 2], I=[1, 2, -1, 3]).field(), F(1, 4)), None, 0),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("map", "integrals", "entropy"), CASES)
def test_entropies_on_the_generic_level(map, integrals, entropy):
    level = on_level(map, integrals or report(map).integrals[: map.dimension - 2])
    found = planar_entropy(level.map)
    assert found.proved, found
    assert found.entropy == pytest.approx(entropy, abs=1e-12)
    by_degrees = growth(degrees(map, 8)).entropy
    assert math.isnan(by_degrees) or by_degrees == pytest.approx(entropy, abs=1e-9)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("map", "integrals", "point"),
    [
        (kahan(lotka_volterra(1, 2, 3), F(1, 2)), [total], (1, 2, 4)),
        (BETAS, OF_BETAS, (1, F(1, 3), 2)),
        (HENON, [lambda x: x[2] - x[1] ** 2 + 2 * x[0]], (F(2, 7), 1, -1)),
    ],
)
def test_a_level_through_a_point(map, integrals, point):
    """Chart and embedding are inverse to each other, and take the map to that of the level."""
    level = on_level(map, integrals, point=point)
    assert level.map == pickle.loads(pickle.dumps(level)).map
    assert not level.map.is_symbolic
    (integral,) = integrals
    u = (F(3, 5), F(-7, 11))
    x = [f(u) for f in level.embedding]
    assert integral(x) == integral([F(a) for a in point])
    assert tuple(f(x) for f in level.chart) == u
    assert tuple(f(map(x)) for f in level.chart) == level.map(u)
    assert level.map.inverse(level.map(u)) == u
    # The same with a letter, at its value for this level.
    generic = on_level(map, integrals)
    assert planar_entropy(generic.map).entropy == planar_entropy(level.map).entropy
    y = [f(u, h=F(5, 3)) for f in generic.embedding]
    after = [f(map(y), h=F(5, 3)) for f in generic.chart]
    assert tuple(after) == generic.map.subs(h=F(5, 3))(u)


def test_eps_stays_symbolic():
    map = kahan(lotka_volterra(1, 2, 3))
    level = on_level(map, [total], point=(1, 2, 4))
    assert (level.map.letter, planar_entropy(level.map).proved) == ("eps", True)
    at_number = on_level(map.subs(eps=F(1, 2)), [total], point=(1, 2, 4))
    assert level.map.subs(eps=F(1, 2))((3, 5)) == at_number.map((3, 5))
    with pytest.raises(ValueError, match=r"^point .*eps"):
        on_level(map, [total])


CYCLE = kahan(lotka_volterra(1, 1, 1), 1)  # with the integral x1 x2 x3 / (...), too
PRODUCT = third_order(lambda x, y, z: y * z / x)  # with x1 / x3
SCALED = rational_map(
    Map(lambda x: (2 * x[0], x[1] / 2, x[2] + 1), 3),
    Map(lambda x: (x[0] / 2, 2 * x[1], x[2] - 1), 3),
)


@pytest.mark.parametrize(
    ("map", "integrals", "given", "argument"),
    [
        # x1 / x3 is 0 / 0 there.
        (PRODUCT, [lambda x: x[0] / x[2]], {"point": (0, 1, 0)}, "point"),
        # The vertex of a cone, and a point where two planes meet.
        (BETAS, OF_BETAS, {"point": (F(-1, 2), 2, 0)}, "point"),
        (SCALED, [lambda x: x[0] * x[1]], {"point": (0, 0, 1)}, "point"),
        # Not conserved; too many; dependent; no function; a point of other variables.
        (CYCLE, [lambda x: x[0] + 2 * x[1]], {}, "integrals"),
        (CYCLE, [total, total], {}, "integrals"),
        (CYCLE, [lambda x: 0 * x[0] + 3], {}, "integrals"),
        (CYCLE, [3.0], {}, "integrals"),
        (CYCLE, [total], {"point": (1, 2)}, "point"),
        (CYCLE, [total], {"letter": "x2"}, "letter"),
        (kahan(*ZOO["Lotka-Volterra"]), [], {}, "map"),
        (rational_map(Map(lambda x: (x[1], x[2], x[1] * x[2] / x[0]), 3)), [], {}, "map"),
    ],
)
def test_hostile_arguments(map, integrals, given, argument):
    with pytest.raises((ValueError, TypeError), match=f"^{argument}"):
        on_level(map, integrals, **given)


def test_components_of_levels():
    """The one through the point counts, if it is taken to itself."""
    squared = on_level(CYCLE, [lambda x: total(x) ** 2])
    assert (squared.map.degree, planar_entropy(squared.map).entropy) == (2, 0)
    on_plane = on_level(SCALED, [lambda x: x[0] * x[1]], point=(0, 3, 1))
    assert on_plane.map((3, 1)) == (F(3, 2), 2)
    with pytest.raises(ArithmeticError, match="to poles"):  # the plane x3 = 0 goes to a line
        on_level(PRODUCT, [lambda x: x[0] / x[2]], point=(1, 2, 0))
    swapped = rational_map(
        Map(lambda x: (-x[0], x[1] + 1, x[2] * x[1]), 3),
        Map(lambda x: (-x[0], x[1] - 1, x[2] / (x[1] - 1)), 3),
    )
    for point in ((1, 2, 3), None):
        with pytest.raises(ArithmeticError, match="to itself"):
            on_level(swapped, [lambda x: x[0] ** 2], point=point)


PERIODIC = third_order(lambda x, y, z: 1 / (y * z) - x)  # the fifth iterate is


def test_a_map_with_as_many_integrals_as_variables():
    found = report(PERIODIC)
    assert len(found.integrals) == 3
    assert (found.proved_entropy, found.dimension) == (0.0, 0)
    assert "points" in repr(found)
    (squared,) = (f for f in found.integrals if f.factors[0][1] == 2)
    with pytest.raises(ArithmeticError, match="to itself"):
        on_level(PERIODIC, [squared])


@pytest.mark.slow
def test_reports_say_the_entropy_on_the_generic_level():
    found = of_zoo("Zhukovsky-Volterra, two betas")
    assert (found.on_level.entropy, found.on_level.proved) == (pytest.approx(SILVER), True)
    assert all(text in repr(found) for text in ("0.881374", "x^2 - 2*x - 1"))
    no_rule = of_zoo("Suslov, Lagrange axis")
    assert no_rule.on_level.entropy is None
    with pytest.raises(ValueError, match=r"^integrals .* degree 2, \d in x1"):
        on_level(no_rule.map, no_rule.integrals)
