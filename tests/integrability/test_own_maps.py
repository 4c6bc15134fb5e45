"""Maps of one's own in the laboratory: integrals, degrees, letters, and what is no rational map."""

from fractions import Fraction

import numpy as np
import pytest

from suslov_fast import Map, iterate
from suslov_fast.integrability import (
    cofactors,
    degrees,
    kahan,
    planar_entropy,
    rational_map,
    report,
)

LYNESS = Map(lambda x, a: (x[1], (x[1] + a) / x[0]), "x y", a=3)
MCMILLAN = Map(lambda x, a: (x[1], 2 * a * x[1] / (1 + x[1] ** 2) - x[0]), "x y", a=0.7)
HENON = Map(lambda x, a, b: (1 - a * x[0] ** 2 + x[1], b * x[0]), "x y", a=1.4, b=0.3)


def test_a_map_is_the_rational_map_of_its_function():
    """With the names of its variables; decimals are what was written, unless they are not."""
    same = rational_map(Map(lambda x: (x[1], (x[1] + 3) / x[0]), 2))
    point = Fraction(2), Fraction(5)
    assert rational_map(LYNESS)(point) == same(point) == (5, 4)
    assert str(rational_map(HENON)) == "rational_map(-(7*x^2 - 5*y - 5)/5, 3*x/10)"
    binary = rational_map(HENON, decimals=False)
    assert binary(point)[1] == Fraction(0.3) * 2
    assert degrees(LYNESS, 8) == degrees(same, 8)
    assert degrees(HENON, 5) == [2, 4, 8, 16, 32]
    assert [str(c) for c in cofactors(LYNESS, 1)] == ["1", "(y + 3)/x^2"]


def test_integrals_of_lyness_and_mcmillan_are_proved():
    found = report(LYNESS)
    assert [str(F) for F in found.integrals] == ["(x + 1)*(y + 1)*(x + y + 3)/(x*y)"]
    assert found.growth.kind == "quadratic"
    [F] = report(MCMILLAN, degree=4).integrals
    along = [float(F(x)) for x in iterate(MCMILLAN, [0.3, 0.2], 20).states]
    assert np.ptp(along) < 1e-12 * abs(along[0])


def test_parameters_may_stay_letters():
    [F] = report(LYNESS, letters="a").integrals
    assert str(F.subs(a=3)) == "(x + 1)*(y + 1)*(x + y + 3)/(x*y)"


def test_an_inverse_gives_the_entropy():
    back = Map(lambda x, a: ((x[0] + a) / x[1], x[0]), "x y", a=3)
    assert planar_entropy(rational_map(LYNESS, inverse=back)).entropy == 0
    with pytest.raises(ValueError, match="inverse"):
        rational_map(LYNESS, inverse=LYNESS)


REFUSED = {
    "no quotient": (TypeError, lambda: report(Map(np.sin, "x"))),
    "a root": (TypeError, lambda: degrees(Map(lambda x: x**0.5, "x"), 3)),
    "a family": (ValueError, lambda: report(LYNESS.with_parameters(a=[1, 2]))),
    "eps": (ValueError, lambda: report(LYNESS, eps=0.1)),
    "no field": (TypeError, lambda: kahan(LYNESS)),
    "no such letter": (ValueError, lambda: report(LYNESS, letters="b")),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_rational_map(case):
    error, call = REFUSED[case]
    with pytest.raises(error, match=r"quotient|a single one|left out|iterate|names of its"):
        call()
