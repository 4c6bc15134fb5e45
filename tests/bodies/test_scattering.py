"""The scattering angle, against its formula, special cases and the discrete problem."""

import mpmath
import naive
import numpy as np
import pytest
from mpmath import mpf

import suslov_fast as sf


def closed_form(I1, I2, I13, I23):
    """Return the angle by the formula of the docstring in 60 digits, and alpha + beta + |gamma|."""
    I1, I2, I13, I23 = naive.exactly(I1, I2, I13, I23)
    D, k = I13**2 * I2 + I23**2 * I1, mpmath.hypot(I13, I23)
    alpha, beta = I1 * I2 * k / D, mpmath.sqrt(I1 * I2) / k
    gamma = beta * I13 * I23 * (I2 - I1) / D
    kappa = mpmath.sqrt((alpha - 1j * gamma) ** 2 - beta**2)
    c, half = mpmath.cosh(mpmath.pi * kappa / 2), mpmath.pi * alpha / 2
    square = (mpmath.re(c) / mpmath.cosh(half)) ** 2 + (mpmath.im(c) / mpmath.sinh(half)) ** 2
    return 2 * mpmath.asin(mpmath.sqrt(square)), float(alpha + beta + abs(gamma))


@pytest.mark.parametrize("parameters", [(4, 1, -0.5, -0.3), (4, 2, 0, -1.2), (2, 2, 1.5, -2.5)])
def test_the_discrete_angle_tends_to_it_with_order_2(parameters):
    """Runs from next to the repelling half to next to the attracting one."""
    body, angles = sf.Suslov3D(*parameters), []
    middle = [1.0, 0.0] @ np.linalg.inv(body.to_xy(np.eye(2)))
    time = 22 / abs(body.closed_form(middle, 0.0).k1)
    start = sf.flow(body, middle, time=-time).states[0]
    for steps in (2000, 4000):
        run = sf.iterate(body, start, 2 * time / steps, steps, attitude=True)
        first, last = (
            R[:, :2] @ x for R, x in zip(run.attitude[[0, -1]], run.states[[0, -1]], strict=True)
        )
        angles.append(np.arctan2(np.linalg.norm(np.cross(first, last)), first @ last))
    expected = body.scattering_angle()
    coarse, fine = np.subtract(angles, expected)
    assert abs(np.log2(coarse / fine) - 2) < 0.01
    assert abs((4 * angles[1] - angles[0]) / 3 - expected) < 1e-7


def test_to_rounding(rng):
    """Angles are accurate to rounding, also if they are exponentially small."""
    signs = np.ones((4, 60))
    signs[2:] = rng.choice([-1, 0, 1], (2, 60))
    parameters = signs * 10 ** rng.uniform(-3, 3, (4, 60))
    angles = sf.Suslov3D(*parameters).scattering_angle()
    assert (np.isnan(angles) == ~parameters[2:].any(axis=0)).all()
    for each, angle in zip(parameters.T, angles, strict=True):
        if each[2:].any():
            expected, size = closed_form(*each)
            bound = 1e-15 * (1 + size) ** 2 * expected if size < 300 else 2e-15 * size
            assert abs(mpf(angle) - expected) <= bound
