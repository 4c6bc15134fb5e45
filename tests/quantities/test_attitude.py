"""The orientation of the body along given states, in three dimensions and in n."""

import naive
import numpy as np
import pytest
from numba import config

import suslov_fast as sf


def states(body, omega0, eps, steps):
    return sf.iterate(body, omega0, eps, steps, on_singular="ignore").omega


@pytest.mark.sampled(1)
@pytest.mark.parametrize("eps", [0.2, -0.2, 3.0])
def test_against_cayley_matrices(rng, body, eps):
    others = [sf.SuslovND(rng.uniform(1, 3, m), rng.normal(size=m)) for m in (1, 2, 3, 8)]
    others.append(sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9))
    for each in (body, *others):
        omega = states(each, rng.normal(size=(2, each.dimension)), eps, 30)
        R = sf.attitude(each, omega, eps)
        assert (R[0] == np.eye(R.shape[-1])).all()
        exact = naive.attitude(sf.to_matrix(each, omega[:, 1])[..., :-1, -1], eps)
        exact = [np.array(matrix.tolist(), float) for matrix in exact]
        np.testing.assert_allclose(R[:, 1], exact, rtol=0, atol=5e-15)


def test_it_begins_at_r0_and_agrees_with_a_run(case, rng):
    body, omega0 = case
    n = body.dimension + 1
    R0, _ = np.linalg.qr(rng.normal(size=(3, n, n)))
    R0[..., 0] *= np.linalg.det(R0)[:, None]
    run = sf.iterate(body, omega0, 0.2, 50, attitude=R0)
    found = sf.attitude(body, run.omega, 0.2, R0)
    np.testing.assert_array_equal(found, run.attitude)
    np.testing.assert_array_equal(found[:, 1], sf.attitude(body, run.omega[:, 1], 0.2, R0[1]))
    assert abs(found @ found.swapaxes(-2, -1) - np.eye(n)).max() < 2e-14
    assert sf.attitude(body, [omega0], 0.2).shape == (1, n, n)


@pytest.mark.parametrize(("eps", "size"), [(1.0, 1e14), (-1.0, 1e100), (1e50, 1e-20), (1.0, 1e200)])
def test_half_a_turn(eps, size):
    """For huge |eps omega| a step is a half turn: R = 2 u u^T - 1 about u, or in the plane of u."""
    u, e = np.array([0.6, -0.8, 0.0, 0.0]), np.eye(4)[-1]
    in_3d = 2 * np.outer(u[:3], u[:3]) - np.eye(3)
    in_4d = np.eye(4) - 2 * np.outer(u, u) - 2 * np.outer(e, e)
    still = sf.SuslovND(np.ones(3), np.zeros(3))
    for body, expected in ((sf.Suslov3D(1, 2, 0, 0), in_3d), (still, in_4d)):
        R = sf.attitude(body, np.tile(size * u[: body.dimension], (3, 1)), eps)
        np.testing.assert_allclose(R[1], expected, atol=1e-12)
        np.testing.assert_allclose(R[2], np.eye(len(expected)), atol=1e-12)


def test_orientations_remain_orthogonal(case):
    run = sf.iterate(*case, 0.3, 300 if config.DISABLE_JIT else 100_000, attitude=True)
    error = run.attitude @ run.attitude.swapaxes(-2, -1) - np.eye(run.attitude.shape[-1])
    assert abs(error).max() < 1e-14


def test_nan_from_the_first_nan_on(case):
    body, omega0 = case
    omega = states(body, omega0, 0.2, 40)
    whole = sf.attitude(body, omega, 0.2)
    for first in (0, 1, 17, 40):
        broken = omega.copy()
        broken[first, -1] = np.nan
        R = sf.attitude(body, broken, 0.2)
        assert np.array_equal(R[:first], whole[:first])
        assert np.isnan(R[first:]).all()


def test_states_that_are_not_consecutive(case):
    body, omega0 = case
    omega = states(body, [omega0, np.multiply(1.1, omega0)], 0.2, 60).copy()
    for wrong in (omega[::2], omega[::-1], omega[::59], 2 * omega):
        with pytest.raises(ValueError, match=r"state 0 of trajectory 0 to the next"):
            sf.attitude(body, wrong, 0.2)
    for eps in (0.2001, -0.2, 0.4, 0.0):
        with pytest.raises(ValueError, match=r"omega\b"):
            sf.attitude(body, omega, eps)
    slow = states(body, omega0, 1e-8, 4)
    sf.attitude(body, slow, 1e-8)
    with pytest.raises(ValueError, match="state 0 to the next"):
        sf.attitude(body, slow[::2], 1e-8)
    omega[24:, 1] = omega[23, 1]
    with pytest.raises(ValueError, match="state 23 of trajectory 1 to the next"):
        sf.attitude(body, omega, 0.2)
    with pytest.raises(ValueError, match="state 23 to the next"):
        sf.attitude(body, omega[:, 1], 0.2)


@pytest.mark.parametrize("m", [2, "gyrostat", 3, 8])
def test_states_of_iterate_are_accepted(rng, m):
    """`attitude` accepts all states of `iterate`, in any regime, and next to poles."""
    size, decades = 20 if config.DISABLE_JIT else 200, 4
    if m in (2, "gyrostat"):
        products = rng.normal(size=(2, size)) * rng.choice([0, 1], size)
        parameters = *10 ** rng.uniform(-4, 4, (2, size)), *products
        k = rng.normal(size=size) * 10 ** rng.uniform(-3, 3, size)
        body = sf.Suslov3D(*parameters) if m == 2 else sf.SuslovGyrostat(*parameters, k)
    else:
        I = rng.normal(size=(size, m))
        body, decades = sf.SuslovND(10 ** rng.uniform(-2, 2, I.shape), I), 3
    speed, eps = 10 ** rng.uniform(-decades, decades, (2, size)) * rng.choice([-1, 1], (2, size))
    omega0 = rng.normal(size=(size, body.dimension)) * speed[:, None]
    omega0[7] = np.nan
    run = sf.iterate(body, omega0, eps, 50, attitude=True, on_singular="ignore")
    R = sf.attitude(body, run.omega, eps)
    assert (np.isfinite(R).all((-2, -1)) == np.isfinite(run.omega).all(-1)).all()
    np.testing.assert_array_equal(R, run.attitude)
