"""First integrals given by relations between few monomials, and their formulas."""

import pickle
import random
from fractions import Fraction as F
from functools import cache, partial

import naive
import numpy as np
import pytest
from systems import exactly

from suslov_fast import Field, Map
from suslov_fast.integrability import ImplicitIntegral, kahan, rational_map, report, zoo
from suslov_fast.integrability.linear_relations import (
    count_relations,
    implicit_integrals,
    written_out,
)
from suslov_fast.integrability.polynomials import exponents_up_to
from suslov_fast.integrability.rational_functions import independent_of

ZOO = zoo()
PAIRS = [(i, j) for i in range(4) for j in range(i + 1, 4)]


def manakov(x):
    """M' = [M, W] for 4 x 4 matrices, with W_ij = M_ij (b_i - b_j) / (a_i - a_j)."""
    a, b = (1, 2, 4, 7), (1, 4, 16, 49)
    M, W = np.zeros((4, 4), object), np.zeros((4, 4), object)
    for value, (i, j) in zip(x, PAIRS, strict=True):
        M[i, j], M[j, i] = value, -value
        W[i, j], W[j, i] = (s * F(b[i] - b[j], a[i] - a[j]) * value for s in (1, -1))
    bracket = M @ W - W @ M
    return [bracket[i, j] for i, j in PAIRS]


def three_waves(x):
    """z_1' = i s_1 conj(z_2 z_3) and so on, with s = (1, 2, -3)."""
    z, s = [x[:2], x[2:4], x[4:]], (1, 2, -3)
    after = [((i + 1) % 3, (i + 2) % 3) for i in range(3)]
    products = [
        (z[j][0] * z[k][0] - z[j][1] * z[k][1], z[j][0] * z[k][1] + z[j][1] * z[k][0])
        for j, k in after
    ]
    return [part for c, (re, im) in zip(s, products, strict=True) for part in (c * im, c * re)]


SYSTEMS = {
    "Clebsch": ZOO["Clebsch"],
    "Kirchhoff": ZOO["Kirchhoff"],
    "Lagrange": ZOO["Lagrange top"],
    "so(4)": (Field(manakov, 6), F(1, 3)),
    "three waves": (Field(three_waves, 6), F(1, 3)),
}
DEGREES = {
    "Clebsch": [2, 6, 8, 10],
    "Kirchhoff": [1, 2, 8, 8],
    "Lagrange": [1, 3, 4, 8],
    "so(4)": [2, 8, 8, 12],
    "three waves": [2, 2],
}


def reported(name):
    field, eps = SYSTEMS[name]
    return report(field, eps=eps, degree=2)


QUADRATIC = exponents_up_to(2, 6)
PRIME = 2**61 - 1


@cache
def chosen(name, symbolic=False):
    field, eps = SYSTEMS[name]
    candidates = implicit_integrals(kahan(field, None if symbolic else eps), QUADRATIC)
    return [*independent_of((), candidates, PRIME)]


def step(field, eps, x):
    """The next state, in fractions."""
    return naive.kahan_step(partial(exactly, kahan(field).terms), eps, x, F)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", SYSTEMS)
def test_integrals_of_systems_with_six_variables(name):
    """They are constant along exact orbits from random points, and independent."""
    field, eps = SYSTEMS[name]
    integrals = chosen(name)
    assert [each.degree for each in integrals] == DEGREES[name]
    assert len(integrals) == count_relations(kahan(field, eps), QUADRATIC).integrals
    rng = random.Random(name)
    for _ in range(2):
        x = [F(rng.randrange(1, 20) * rng.choice([-1, 1]), 2) for _ in range(6)]
        values = [each(x) for each in integrals]
        assert all(type(value) is F for value in values)
        y = step(field, eps, x)
        assert [each(y) for each in integrals] == values
        assert [each([2 * a + 1 for a in x]) for each in integrals] != values
    h = F(1, 2**30)
    rows = []
    for each, value in zip(integrals, values, strict=True):
        moved = [[a + h * (i == j) for i, a in enumerate(x)] for j in range(6)]
        slope = np.array([float((each(y) / value - 1) / h) for y in moved])
        rows.append(slope / abs(slope).max())
    assert np.linalg.svd(rows)[1][-1] > 1e-3  # the rank of the gradients


@pytest.mark.slow
def test_reports_hold_the_integrals_that_are_too_long():
    """Those that are short are written; with the others they are as many as relations show."""
    found = reported("Lagrange")
    assert [each.degree for each in found.integrals] == [1, 3, 4]
    assert [each.degree for each in found.implicit] == [8]
    assert len([*independent_of(found.integrals, found.implicit, PRIME)]) == 1
    assert (found.dimension, found.independent) == (2, 4)
    x = [F(k * k - 7, 5) for k in range(1, 7)]
    y = step(*SYSTEMS["Lagrange"], x)
    assert all(f(x) == f(y) for f in (*found.integrals, *found.implicit))
    (long,) = found.implicit
    assert isinstance(long, ImplicitIntegral)
    assert pickle.loads(pickle.dumps(long)) == long
    assert str(long) == "c(x6)/c(x1^2) of the relation between 1, x6, x1^2, x2^2, x6^2"
    assert (long.degree, long.basis) == (8, "modulo a prime, at random points")


@pytest.mark.slow
def test_a_report_that_may_have_missed_integrals():
    found = reported("three waves")
    assert [each.degree for each in found.integrals] == [2, 2, 7]
    assert not found.implicit
    assert found.dimension == 3
    assert "larger degree" in repr(found)


@pytest.mark.slow
def test_symbolic_eps():
    field, eps = SYSTEMS["Lagrange"]
    symbolic = chosen("Lagrange", symbolic=True)
    assert [each.degree for each in symbolic] == DEGREES["Lagrange"]
    x = [F(k * k - 7, 5) for k in range(1, 7)]
    for integral, number in zip(symbolic, chosen("Lagrange"), strict=True):
        assert integral(x, eps=eps) == number(x)
        with pytest.raises(TypeError, match=r"^eps"):
            integral(x)
    formula = written_out(symbolic[1])
    assert "eps" in str(formula)
    y = step(field, eps, x)
    assert formula(x, eps=eps) == formula(y, eps=eps)


def test_points_without_a_value():
    integral = chosen("Clebsch")[2]
    with pytest.raises(ZeroDivisionError, match="more relations"):
        integral([0, 0, 0, 1, 0, 0])  # a steady state
    with pytest.raises(ValueError, match=r"x must have the shape \(6,\)"):
        integral([1, 2])
    map = rational_map(Map(lambda x: (x[1], (x[1] + 3) / x[0]), 2))
    (curve,) = independent_of((), implicit_integrals(map, exponents_up_to(3, 2)), PRIME)
    assert curve(map([2, 7])) == curve([2, 7])
    with pytest.raises(ZeroDivisionError, match="pole of the map"):
        curve([0, 1])
