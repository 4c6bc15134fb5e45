"""Derivatives along orbits: the kernel behind Lyapunov exponents."""

from itertools import pairwise

import naive
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast.core import tangent


def lorenz(x):
    return 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 2.5 * x[2]


LORENZ = sf.QuadraticField.from_function(lorenz, 3)
ND = sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])


def grown(field, x, eps, cuts):
    """Sums of logarithms of lengths, and of determinants, and statuses."""
    indices, values = field.field().terms
    x, values, eps = np.array(x, ndmin=2, dtype=float), np.atleast_2d(values), np.atleast_1d(eps)
    size, D = x.shape
    carry, sums, of_det = np.empty((size, D + D * D)), np.zeros((size, D)), np.zeros(size)
    status, failed_at = np.zeros(size, np.int8), np.full(size, -1)
    for start, stop in pairwise(cuts):
        arguments = (indices, values, eps), x, carry, (0, size, start, stop)
        tangent.growth.serial(*arguments, sums, of_det, status, failed_at)
    return sums, of_det, status, failed_at


def log_of_step(f, eps, x, following):
    """log |det DPhi| from 1 - (eps/2) f'(x) and 1 + (eps/2) f'(x_next), in 60 digits."""
    dets = []
    for state, half in ((x, -eps / 2), (following, eps / 2)):
        slope = naive.mpmath.matrix(naive.derivative(f, state))
        dets.append(naive.mpmath.det(naive.mpmath.eye(len(x)) + half * slope))
    return naive.mpmath.log(abs(dets[1] / dets[0]))


@pytest.mark.parametrize(
    ("start", "eps", "steps"),
    [
        ((1.0, 2.0, 20.0), 1 / 64, 40),
        ((1.0, 2.0, 20.0), 1e-9, 4),
        ((1.0, 2.0, 20.0), 0.5, 12),  # with pivots
        ((1.0, 2.0, 20.0), -4.0, 12),
        ((-4.0, 300.0, 8.0), 1e-3, 12),
    ],
)
def test_the_sum_is_that_of_determinants(start, eps, steps):
    """To rounding of the mean modulus of their logarithms, for short steps, too."""
    states = naive.iterated(lambda x: naive.kahan_step(lorenz, eps, x), start, steps)
    logs = [log_of_step(lorenz, naive.mpf(eps), *each) for each in pairwise(states)]
    modulus = float(sum(map(abs, logs)))
    sums, of_det, status, _ = grown(LORENZ, start, eps, (0, steps))
    assert status == sf.Status.OK
    assert abs(float(of_det[0] - sum(logs))) < 1e-11 * modulus
    assert abs(sums.sum() - float(sum(logs))) < 1e-11 * max(modulus, 1.0)


@pytest.mark.parametrize(("body", "eps"), [(LORENZ, 1 / 64), (LORENZ, 0.5), (ND, 0.4), (ND, 30.0)])
def test_cuts_change_rounding_alone(rng, body, eps):
    x = rng.normal(size=(133, 3))
    sums, of_det, _, _ = grown(body, x, eps, (0, 20))
    cut = grown(body, x, eps, (0, 3, 4, 20))
    np.testing.assert_allclose(cut[0], sums, atol=1e-11)
    np.testing.assert_allclose(cut[1], of_det, atol=1e-11)


def test_growth_ends_with_its_orbit():
    square = sf.QuadraticField([[[1]]])
    sums, of_det, status, failed_at = grown(square, [[2.0], [np.nan], [-1.0]], 0.5, (0, 5))
    assert status.tolist() == [sf.Status.SINGULAR, sf.Status.NONFINITE, sf.Status.OK]
    assert failed_at.tolist() == [1, 0, -1]
    assert np.isnan(sums[:, 0]).tolist() == np.isnan(of_det).tolist() == [True, True, False]
    collapse = sf.QuadraticField(np.zeros((2, 2, 2)), [[-2, 0], [0, 1]])
    sums, of_det, status, _ = grown(collapse, [[1.0, 2.0]], 1.0, (0, 3))
    assert (of_det[0], sums[0, 0], status[0]) == (-np.inf, -np.inf, sf.Status.OK)
    assert sums[0, 1] == pytest.approx(3 * np.log(3), rel=1e-14)


def test_growth_over_many_orders_of_magnitude():
    """|det DPhi| over the whole run underflows, and the logarithms do not."""
    field = sf.QuadraticField(np.zeros((2, 2, 2)), [[-1.0, 0.0], [0.5, -4.0]])
    sums, of_det, _, _ = grown(field, [1.0, 1.0], 0.25, (0, 5000))
    first, second = np.log(0.875 / 1.125), np.log(0.5 / 1.5)
    assert of_det == pytest.approx(5000 * (first + second), rel=1e-12)
    np.testing.assert_allclose(np.sort(sums[0]), [5000 * second, 5000 * first], rtol=1e-3)


@pytest.mark.parametrize("eps", [0.4, -3.0, 60.0])
@pytest.mark.parametrize("m", [3, 4, 6])
def test_derivatives_of_a_step(rng, m, eps):
    J, I, omega = rng.uniform(1, 4, m), *rng.normal(size=(2, m))
    body = sf.SuslovND(J, I)
    exact = naive.derivative(lambda v: naive.step_nd(J, I, eps, v), omega)
    error = naive.relative_error(sf.jacobian(body, omega, eps).ravel(), sum(exact, ()))
    assert error < 2e-14 * np.linalg.cond(sf.matrix(body, omega, eps))
