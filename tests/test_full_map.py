"""The scheme with three components, before Omega3 is set to 0."""

from functools import partial

import naive
import numpy as np
import pytest

import suslov_fast as sf

# No body has the I3 of some runs of the scheme in three components.
pytestmark = pytest.mark.filterwarnings("ignore:I3")
# With eps = 1 and Omega3 = 0 the map has no next state where y = 2 + x**2; here x = Omega1 and
# y = -Omega2. With I3 = 3 there is also none for the first of these.
UNIT = sf.Suslov3D(1, 1, 1, 0)
ON_A_POLE = [1.0, -5.0, 0.5]
# In units of 2**990 the next state overflows.
HUGE, NEXT_TO_THE_POLE = 2.0**990, np.array([1.0, -3.0 + 1e-11, 0.0])


def run(body, omega0, eps, steps, I3, **options):
    return sf.iterate_full(body, omega0, eps, steps, I3, on_singular="ignore", **options)


def test_against_the_printed_scheme(rng):
    for _ in range(4):
        parameters = (*rng.uniform(0.5, 4, 2), *rng.normal(size=2))
        eps, I3, omega = rng.choice([-0.3, 0.3]), rng.uniform(0.5, 4), rng.normal(size=3)
        orbit = run(sf.Suslov3D(*parameters), omega, eps, 6, I3).omega
        exact = naive.iterated(partial(naive.step_full, *parameters, eps, I3), omega, 6)
        assert naive.worst_error(orbit, exact) < 2e-13


def test_the_third_component(body, rng):
    """Omega3 changes sign at each step; for Omega3 = 0 the scheme equals the map."""
    orbit = run(body, [1.0, 0.5, 0.25], 0.1, 50, 3)
    assert (orbit.omega[:, 2] == np.resize([0.25, -0.25], 51)).all()
    omega = rng.normal(size=(6, 2))
    full = run(body, np.column_stack([omega, np.zeros(6)]), 0.2, 100, 3)
    expected = sf.iterate(body, omega, 0.2, 100).omega
    np.testing.assert_allclose(full.omega[..., :2], expected, atol=1e-13)
    assert (full.omega[..., 2] == 0).all()


@pytest.mark.parametrize(
    ("eps", "still", "moving"),
    [(0.1, "0.0782", "-0.174"), (0.01, "0.081", "-2.42"), (0.001, "0.0812", "-24.9")],
)
def test_no_limit_unless_the_third_component_vanishes(eps, still, moving):
    """Check the numbers in the docstring of `iterate_full`."""
    for third, expected in ((0.0, still), (0.1, moving)):
        orbit = run(sf.Suslov3D(4, 2, -0.5, -0.3), [1.0, 0.5, third], eps, 1, 3)
        assert f"{(orbit.final[0] - 1.0) / eps:.3g}" == expected


@pytest.mark.parametrize("cuts", [[9], [5, 4], [4, 1, 4]])
@pytest.mark.parametrize(
    ("pole", "unit", "status"),
    [(ON_A_POLE, 1.0, sf.Status.SINGULAR), (NEXT_TO_THE_POLE, HUGE, sf.Status.NONFINITE)],
)
def test_failure_after_several_steps(cuts, pole, unit, status):
    """The failing step is in the middle, at the end or at the beginning of a call."""
    before = run(UNIT, pole, -1.0, 4, 3.0).final
    orbit = run(UNIT, before * unit, 1.0 / unit, 0, 3.0)
    for more in cuts:
        orbit = orbit.extend(more, on_singular="ignore")
    assert orbit.status == status
    assert orbit.failed_at == 5
    assert np.isnan(orbit.omega[5:]).all()
    assert np.isfinite(orbit.omega[:5]).all()


def test_huge_states_and_steps():
    """Scaling prevents overflow: eps omega is 1e280, and the next state is small."""
    for omega in ([1e200, 1e200, 1e200], [1e200, -3e199, 2e199]):
        computed = run(UNIT, omega, 1e80, 1, 3.0)
        assert computed.ok
        with naive.mp.workdps(900):
            exact = naive.step_full(1, 1, 1, 0, 1e80, 3.0, omega)
        assert naive.relative_error(computed.final, exact) < 1e-14


@pytest.mark.parametrize(
    ("parameters", "pole"), [((1, 1, 1, 0), [1.0, -8.0, 1.0]), ((1, 1, 0, 1), [8.0, 1.0, 1.0])]
)
def test_poles_where_the_third_component_counts(parameters, pole):
    """With eps = 1 and I3 = 3 the determinant of the two equations is exactly 0."""
    orbit = run(sf.Suslov3D(*parameters), [[0.1, 0.2, 0.3], pole], 1.0, 3, 3.0)
    assert orbit.status.tolist() == [sf.Status.OK, sf.Status.SINGULAR]
    assert orbit.failed_at.tolist() == [-1, 1]
    assert (orbit.omega[0, 1] == pole).all()
    assert np.isnan(orbit.omega[1:, 1]).all()


def step(I1, I2, I13, I23, eps, I3, omega):
    return sf.step_full(sf.Suslov3D(I1, I2, I13, I23, I3), omega, eps)


@pytest.mark.parametrize("decades", [0, 50])
@pytest.mark.sampled(1)
def test_any_units(rng, decades):
    """Finite next states are accurate in any units and for steps of any length."""
    with naive.mp.workdps(900):
        for _ in range(25):
            parameters = rng.uniform(0.5, 4, 6) * 10.0 ** rng.uniform(-decades, decades)
            parameters[2:5] *= rng.choice([-1, 1], 3)
            parameters[4] *= 10.0 ** rng.uniform(-decades, decades)
            omega = rng.normal(size=3) * 10.0 ** rng.uniform(-decades, decades)
            exact = naive.step_full(*parameters, omega)
            assert naive.relative_error(step(*parameters, omega), exact) < 1e-12


def test_poles_to_rounding(rng):
    """Next to a pole of a large state, the determinant is only the rounding error of its terms."""
    found = 0
    while found < 25:
        (I1, I2, I3), (I13, I23) = rng.uniform(0.5, 4, 3), rng.uniform(0.5, 2, 2)
        body, rest = (I1, I2, I13, I23, 1.0, I3), (-(10 ** rng.uniform(2, 5)), rng.normal())
        # The determinant is a quadratic polynomial of Omega1.
        low, middle, high = (determinant(body, (w1, *rest)) for w1 in (-1, 0, 1))
        a, b = (low + high) / 2 - middle, (high - low) / 2
        w1 = (-b + naive.mpmath.sqrt(b * b - 4 * a * middle)) / (2 * a)
        if w1.imag == 0:
            found += 1
            with pytest.warns(sf.SingularStepWarning):
                assert np.isnan(step(*body, [float(w1.real), *rest])).all()


def determinant(body, state):
    """Determinant of the two linear equations for the next Omega1 and Omega2."""
    body, state = naive.exactly(*body), naive.exactly(*state)
    rows = naive.derivative(lambda v: naive.ds(*body, state, [*v, -state[2]])[:2], state[:2])
    return naive.mpmath.det(naive.mpmath.matrix(rows))


@pytest.mark.parametrize(
    "problem",
    [
        (1.0, 1.0, 1.0, -1.0, 1.6e15, 1.0, [-1.7, -1.7, 0.14]),
        (2.5e-17, 1.6e41, 0.0, -2e10, -0.23, 1.5e-40, [0.038, -1e-22, 0.001]),
        (2.9e30, 3.6e-41, 1e-32, 7.7e-49, -3.2e-25, 6.4e-35, [-1.9e-19, 3.9e26, 5.5e19]),
        (4.6e-11, 4.8e47, -1.5e-11, 0.0, 7e-06, 7.9e-35, [-1.5e5, 1.4e-24, 1.0]),
        (1.5e17, 342.0, 2.2e8, 0.0, -5.6e-08, 342.0, [1.1e-07, -3.7e-10, -2.1e7]),
        (4e-21, 0.041, 2e-18, -11.0, 6.8e-27, 4e-21, [2.9e-32, 3.7e-4, -5e26]),
    ],
)
@pytest.mark.filterwarnings("ignore:I3")
def test_terms_that_cancel(problem):
    """Next to the steady states, and for moments far apart; each component is accurate."""
    *parameters, omega = problem
    with naive.mp.workdps(300):
        exact = naive.step_full(*parameters, omega)
    found = step(*parameters, omega)
    assert found[2] == -omega[2]
    for one, other in zip(found, exact, strict=True):
        assert abs(one / other - 1) < 3e-15
