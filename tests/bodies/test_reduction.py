"""Bodies whose J has equal entries, against their implicit equations in fractions."""

import itertools
import math
from fractions import Fraction

import naive
import numpy as np
import pytest
from sympy.utilities.iterables import partitions

import suslov_fast as sf
from suslov_fast.integrability import report

EPS = 0.375


# All ways to write 3 to 6 (n = 4 to 7) as sums of numbers that do not increase.
MULTIPLICITIES = [
    tuple(k for k, count in each.items() for _ in range(count))
    for m in (3, 4, 5, 6)
    for each in partitions(m)
]
POSITIONS = "anywhere", "along an axis", "in an eigenspace", "across one", "zero"


def some(rng, m):
    """Numbers other than 0 that fractions hold in few digits."""
    return rng.choice([-1, 1], m) * rng.integers(1, 8, m) / rng.choice([2, 4, 8], m)


def problem(rng, multiplicities, position):
    """J with these multiplicities, in any order, I in this position, and a state."""
    values = rng.choice(np.arange(2, 12), len(multiplicities), replace=False) / 2
    J = rng.permutation(np.repeat(values, multiplicities))
    m, E = len(J), np.equal(J, rng.choice(values))
    kept = {
        "anywhere": np.ones(m, bool),
        "along an axis": np.arange(m) == rng.integers(m),
        "in an eigenspace": E,
        "across one": ~E | (E.sum() == m),
        "zero": np.zeros(m, bool),
    }
    return J, np.where(kept[position], some(rng, m), 0.0), some(rng, m)


def states_of(rng, J, I, omega):
    """The state, and others with parts that vanish."""
    E = np.equal(J, rng.choice(J))
    yield omega
    yield np.where(E, 0.0, omega)
    yield np.where(E, I, omega)  # without a part across I in E
    yield np.where(rng.random(len(J)) < 0.5, 0.0, omega)


def decimal(fraction):
    return naive.mpf(fraction.numerator) / fraction.denominator


def coordinates(J, I, omega):
    """J, I and the state of the reduced body, with the modulus of r."""
    found = []
    for a, square, along, across in naive.parts_by_eigenvalue(J, I, omega):
        if square:
            length = naive.mpmath.sqrt(decimal(square))
            if len(across) == 1:  # then the coordinate and its coupling keep their signs
                length *= np.sign(sum(I[np.equal(J, a)]))
            found.append((a, length, decimal(along) / length))
        if len(across) > bool(square):
            found.append((a, 0, naive.mpmath.sqrt(decimal(sum(x * x for x in across)))))
    return np.array(found, float).T


def orbit(J, I, eps, omega, steps):
    states = [[*map(Fraction, omega)]]
    for _ in range(steps):
        states.append(naive.rational_step_nd(J, I, eps, states[-1]))
    return states


@pytest.mark.sampled(37)
@pytest.mark.parametrize("position", POSITIONS)
@pytest.mark.parametrize("multiplicities", MULTIPLICITIES, ids=str)
def test_states_of_the_reduced_body(rng, multiplicities, position):
    """Directions are constant in fractions, and the reduced body has the states of this one."""
    J, I, omega = problem(rng, multiplicities, position)
    body = sf.SuslovND(J=J, I=I)
    reduced, to_reduced, from_reduced = body.reduced()
    for state in states_of(rng, J, I, omega):
        exact = orbit(J, I, EPS, state, 3)
        parts = [naive.parts_by_eigenvalue(J, I, each) for each in exact]
        for first, *others in zip(*parts, strict=True):
            for (*_, x), (*_, y) in itertools.product([first], others):
                for i, j in itertools.combinations(range(len(x)), 2):
                    assert x[i] * y[j] == x[j] * y[i]
        J_wanted, I_wanted, wanted = coordinates(J, I, state)
        np.testing.assert_array_equal(reduced.J, J_wanted)
        np.testing.assert_allclose(reduced.I, I_wanted, rtol=1e-15)
        x, size = to_reduced(state), np.linalg.norm(state)
        signed = np.where(I_wanted == 0.0, abs(x), x)
        np.testing.assert_allclose(signed, wanted, rtol=0.0, atol=1e-15 * size)
        run = sf.iterate(reduced, x, EPS, 3, method="gauss")
        found, exact = from_reduced(run.states, state), np.array(exact, float)
        sizes = np.linalg.norm(exact, axis=1)
        np.testing.assert_allclose(
            found, exact, rtol=0.0, atol=1e-13 * sizes.max() ** 2 / (sizes.min() or 1.0)
        )


def test_no_two_equal():
    """Then nothing changes; J that differ in the last bit are different, in all functions."""
    J, I = [2.0, 2.0 + 2.0**-51, 1.5], [0.4, -0.7, 0.5]
    body, omega = sf.SuslovND(J=J, I=I), np.array([0.3, -0.9, 0.6])
    reduced, to_reduced, from_reduced = body.reduced()
    assert reduced == body
    assert (to_reduced(omega) == omega).all()
    assert (from_reduced(2 * omega, omega) == 2 * omega).all()
    assert sf.SuslovND(J=[1, 2, 2], I=[1, 1e-20, 0]).reduced()[0].dimension == 3  # not 0, either
    for J_i, solved in ((2.0 + 2.0**-51, False), (2.0, True)):
        body = sf.SuslovND(J=[2.0, J_i, 2.0], I=I)
        assert body.reduced()[0].dimension == (2 if solved else 3)
        for function, *given in (
            (sf.SuslovND.first_integral, 0.2),
            (sf.SuslovND.exact, 0.2, 3),
            (sf.SuslovND.limits, 0.2),
            (sf.kahan.invariant_density, 0.2),
        ):
            if solved:
                assert np.isfinite(function(body, omega, *given)).all()
            else:
                with pytest.raises(sf.NotIntegrableError, match=function.__name__):
                    function(body, omega, *given)


def test_arguments_of_the_functions():
    body = sf.SuslovND(J=[[2, 2, 2, 3], [2, 2, 2, 4]], I=[1, 2, -2, 3])
    _, to_reduced, from_reduced = body.reduced()
    with pytest.raises(ValueError, match=r"^omega must"):
        to_reduced([1, 2, 3])
    with pytest.raises(ValueError, match=r"^x must"):
        from_reduced([1, 2, 3, 4], [1, 2, 3, 4])
    assert np.isnan(to_reduced([np.nan, 1, 1, 1])).all()
    assert from_reduced(np.ones((5, 1, 3)), np.ones(4)).shape == (5, 2, 4)


def test_members_that_reduce_differently(rng):
    """Each has the coordinates and the bits that it has alone; further coordinates are 0."""
    J = np.array([[2, 2, 2, 2], [3, 2, 2, 2], [4, 5, 5, 4], [1, 1, 1, 2], [1, 2, 3, 4.0]])
    I = np.array([[1, 2, -2, 4], [0.7, 0, 0, 0], [0, 0, 0, 0], [1, 2, -2, 3], [1, 1, 0, 1.0]])
    omega, eps = rng.normal(size=(3, 5, 4)), 0.2
    bodies = sf.SuslovND(J=J, I=I)
    for some in (slice(0, 3), slice(0, 4), slice(0, 5)):
        reduced, to_reduced, from_reduced = bodies[some].reduced()
        x = to_reduced(omega[:, some])
        back = from_reduced(x, omega[:, some])
        np.testing.assert_allclose(back, omega[:, some], rtol=0.0, atol=1e-15 * 4)
        orbits = from_reduced(sf.iterate(reduced, x, eps, 9).states, omega[:, some])
        expected = sf.iterate(bodies[some], omega[:, some], eps, 9).states
        np.testing.assert_allclose(orbits, expected, rtol=0.0, atol=1e-13)
        for k, body in enumerate(bodies[some]):
            alone, to_alone, _ = body.reduced()
            size = alone.dimension
            assert (reduced.I[k] == [*alone.I, *[0.0] * (reduced.dimension - size)]).all()
            assert reduced[k].reduced()[0] == alone
            np.testing.assert_array_equal(x[:, k, :size], to_alone(omega[:, k]))
            assert (x[:, k, size:] == 0.0).all()
    solved = bodies[:3]
    for function, *given in (
        (sf.SuslovND.first_integral, eps),
        (sf.SuslovND.criticality, eps),
        (sf.kahan.invariant_density, eps),
        (sf.SuslovND.exact, eps, 7),
        (lambda *arguments: sf.flow(*arguments, time=0.7).states[0],),
        (lambda *arguments: sf.SuslovND.limits(*arguments)[1], eps),
    ):
        found = function(solved, omega[:, :3], *given)
        for k, body in enumerate(solved):
            np.testing.assert_array_equal(found[:, k], function(body, omega[:, k], *given))
    with pytest.raises(sf.NotIntegrableError, match="body 3"):
        bodies.exact(omega, eps, 7)


def test_the_map_goes_on_where_two_d_are_zero():
    """A pole of the map, which the reduced body passes, to the limit of the neighbours."""
    J, I, state = [2, 2, 2, 3], [1, 2, -2, 3], [1.0, 2.0, 0.5, 0.0]  # I . omega = 2 J_1 / eps
    body = sf.SuslovND(J=J, I=I)
    assert sf.iterate(body, state, 1.0, 1, on_singular="ignore").status == sf.Status.SINGULAR
    reduced, to_reduced, from_reduced = body.reduced()
    run = sf.iterate(reduced, to_reduced(state), 1.0, 2)
    near = [Fraction(1) + Fraction(1, 10**20), *map(Fraction, state[1:])]
    expected = np.array(orbit(J, I, 1, near, 2), float)
    np.testing.assert_allclose(from_reduced(run.states, state), expected, rtol=0.0, atol=1e-14)


def test_reports_name_the_reduction():
    body = sf.SuslovND(J=[2, 2, 2, 3], I=[1, 2, -1, 3])
    found = report(body, eps="1/2", degree=1)
    assert len(found.integrals) == 1
    x = np.array([0.3, -0.7, 0.4, 0.9])
    ratio = (2 * x[0] - x[1]) / (x[0] + x[2])
    q = found.integrals[0]
    for y in sf.iterate(body, x, 0.5, 3).states:
        assert math.isclose((2 * y[0] - y[1]) / (y[0] + y[2]), ratio, rel_tol=1e-12)
        assert math.isclose(q(y), q(x), rel_tol=1e-12)
    assert any("3 coordinates" in note for note in found.notes)
    assert not report(sf.SuslovND(J=[1, 2, 3], I=[1, 2, 3]), eps="1/2", degree=1).notes
