"""Step and quantities of the gyrostat against its implicit equations in 60 digits."""

from functools import partial

import mpmath
import naive
import numpy as np
import pytest
from test_quantities import error

import suslov_fast as sf


def implicit(I1, I2, I13, I23, k, eps, omega, following):
    """Residuals of equations (4) with the terms in k, averaged over Omega and Omega_next."""
    (w1, w2), (v1, v2) = omega, following
    first, second = naive.ds1(I1, I2, I13, I23, eps, omega, following)
    return [first + eps * k * (w2 + v2) / 2, second - eps * k * (w1 + v1) / 2]


def exact_step(parameters, omega):
    parameters, omega = naive.exactly(*parameters), naive.exactly(*omega)
    return naive.solve_affine(lambda v: implicit(*parameters, omega, v), 2)


def exact_orbit(parameters, omega, steps):
    return naive.iterated(lambda state: exact_step(parameters, state), omega, steps)


def run(parameters, omega, steps, **options):
    return sf.iterate(sf.SuslovGyrostat(*parameters[:5]), omega, parameters[5], steps, **options)


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.normal(size=3), rng.uniform(-1, 1))
    return parameters, rng.normal(size=2) * 10 ** rng.uniform(-1, 1)


def rotor(parameters, omega):
    """l = I13 Omega1 + I23 Omega2 + k."""
    I13, I23, k = naive.exactly(*parameters[2:5])
    return mpmath.fdot((I13, I23), omega) + k


def test_against_the_implicit_equations(rng):
    for _ in range(20):
        parameters, omega = random_problem(rng)
        body, eps = sf.SuslovGyrostat(*parameters[:5]), parameters[5]
        following = exact_step(parameters, omega)
        stretch = 1 + float(mpmath.norm(following)) / np.hypot(*omega)
        assert naive.relative_error(run(parameters, omega, 1).final, following) < 1e-14 * stretch
        derivative = naive.derivative(partial(exact_step, parameters), omega)
        assert error(sf.jacobian(body, omega, eps), derivative) < 1e-14 * stretch**2
        I1, I2 = naive.exactly(*parameters[:2])
        l, (w1, w2) = rotor(parameters, omega), omega
        assert error(sf.vector_field(body, omega), [-l * w2 / I1, l * w1 / I2]) < 1e-15
        denominator = 4 * I1 * I2 + (mpmath.mpf(eps) * l) ** 2
        F = (I1 * w1**2 + I2 * w2**2) / denominator
        assert error(sf.first_integral(body, omega, eps), F) < 3e-15
        assert error(sf.invariant_density(body, omega, eps), 1 / (l * denominator)) < 3e-15


@pytest.mark.parametrize("k", [0.0, 1e-3, 0.9])
@pytest.mark.parametrize("products", [(0.5, -0.7), (0.0, 0.0)])
def test_long_orbits(k, products):
    """Long orbits, also for I13 = I23 = 0, when Omega turns steadily about the axis."""
    parameters = (2.3, 1.4, *products, k, 0.35)
    exact, orbit = exact_orbit(parameters, [1.1, -0.4], 120)[-1], run(parameters, [1.1, -0.4], 120)
    assert naive.relative_error(orbit.final, exact) < 3e-13
    np.testing.assert_allclose(orbit.first_integral(), orbit.first_integral()[0], rtol=1e-13)


@pytest.mark.parametrize("distance", [1e-6, 1e-12, 1e-15])
def test_next_to_the_steady_states(rng, distance):
    """l, and its growth over many steps, keep their relative accuracy."""
    for _ in range(5):
        (I1, I2, I13, I23, k, eps), _ = random_problem(rng)
        parameters = I1, I2, I13, I23, k, 0.2 * eps
        along = rng.normal() * np.array([I23, -I13]) - k * np.array([I13, I23]) / (I13**2 + I23**2)
        omega = along * (1 + distance)
        states = exact_orbit(parameters, omega, 31)
        l = rotor(parameters, states[0])
        slope = sf.vector_field(sf.SuslovGyrostat(I1, I2, I13, I23, k), omega)
        assert error(slope, [-l * omega[1] / I1, l * omega[0] / I2]) < 2e-15
        growth = rotor(parameters, states[31]) / rotor(parameters, states[1])
        first, last = (run(parameters, omega, n)._resume["state"][0, 0] for n in (1, 31))
        assert abs(float(last / first / growth) - 1) < 1e-10


@pytest.mark.parametrize(
    ("parameters", "omega", "steps"),
    [
        ((1.62, 2.44, 0.38, 0.26, 0.99, 7.646489055091985), [1.7, -2.97], 10),
        ((1.0, 2.0, 0.0, 1.0, 0.0, 1.0), [8 + 8e-12, 2.0], 3),
        ((2.3, 1.4, 0.5, -0.7, 0.0, 1e20), [1.1, -0.4], 2),
        ((2.3, 1.4, 0.5, -0.7, 1e6, 0.35), [1.1, -0.4], 1000),
    ],
)
def test_orbits_that_start_next_to_poles_or_take_long_steps(parameters, omega, steps):
    """Y_next is a quotient, in which large terms do not cancel."""
    exact = exact_orbit(parameters, omega, steps)[-1]
    assert naive.relative_error(run(parameters, omega, steps).final, exact) < 5e-14


def test_next_to_and_at_poles():
    """1 - Y + L (2 L - K) / (I1 I2) = 0 at poles; next to them the step is accurate to rounding."""
    parameters = 1.0, 1.0, 1.0, 0.0, 0.0, 1.0
    for gap in (1e-3, 1e-6, 1e-9):
        omega = np.array([np.sqrt(2 * gap), -2 * (1 - gap)])
        following = exact_step(parameters, omega)
        assert naive.relative_error(run(parameters, omega, 1).final, following) < 3e-15
    at = run(parameters, [1.0, -3.0], 3, on_singular="ignore")
    assert (at.status, at.failed_at) == (sf.Status.SINGULAR, 1)
    assert np.isnan(at.omega[1:]).all()
    with pytest.warns(sf.SingularStepWarning):
        assert np.isnan(sf.jacobian(sf.SuslovGyrostat(*parameters[:5]), [1.0, -3.0], 1.0)).all()
