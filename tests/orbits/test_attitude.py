"""The orientation of the body along runs, in three dimensions and in n."""

import naive
import numpy as np
import pytest
from numba import config

import suslov_fast as sf


@pytest.mark.sampled(1)
@pytest.mark.parametrize("eps", [0.2, -0.2, 3.0])
def test_against_cayley_matrices(rng, body, eps):
    others = [
        sf.SuslovND(J=rng.uniform(1, 3, m), I=rng.uniform(-0.5, 0.5, m)) for m in (1, 2, 3, 8)
    ]
    others.append(sf.Suslov3D(2.3, 1.4, 0.5, -0.7, 0.9))
    for each in (body, *others):
        starts = rng.normal(size=(2, each.dimension))
        run = sf.iterate(each, starts, eps, 30, attitude=True, on_singular="ignore")
        R = run.attitude
        assert (R[0] == np.eye(R.shape[-1])).all()
        states = run.states[:, 1]
        if isinstance(each, sf.Suslov3D):  # the last column of the matrix Omega
            states = states[:, ::-1] * [1, -1]
        exact = naive.attitude(states, eps)
        exact = [np.array(matrix.tolist(), float) for matrix in exact]
        np.testing.assert_allclose(R[:, 1], exact, rtol=0, atol=5e-15)


def test_it_begins_at_given_orientations(case, rng):
    body, omega0 = case
    n = body.dimension + 1
    R0, _ = np.linalg.qr(rng.normal(size=(3, n, n)))
    R0[..., 0] *= np.linalg.det(R0)[:, None]
    R = sf.iterate(body, omega0, 0.2, 50, attitude=R0).attitude
    np.testing.assert_array_equal(R[0], R0)
    from_identity = sf.iterate(body, omega0, 0.2, 50, attitude=True).attitude
    np.testing.assert_allclose(R, R0 @ from_identity[:, np.newaxis], rtol=0, atol=2e-14)
    assert abs(R @ R.swapaxes(-2, -1) - np.eye(n)).max() < 2e-14


@pytest.mark.parametrize(("eps", "size"), [(1.0, 1e14), (-1.0, 1e100), (1e50, 1e-20), (1.0, 1e200)])
def test_half_a_turn(eps, size):
    """For huge |eps omega| a step is a half turn: R = 2 u u^T - 1 about u, or in the plane of u."""
    u, e = np.array([0.6, -0.8, 0.0, 0.0]), np.eye(4)[-1]
    in_3d = 2 * np.outer(u[:3], u[:3]) - np.eye(3)
    in_4d = np.eye(4) - 2 * np.outer(u, u) - 2 * np.outer(e, e)
    still = sf.SuslovND(J=np.ones(3), I=np.zeros(3))
    for body, expected in ((sf.Suslov3D(1, 2, 0, 0), in_3d), (still, in_4d)):
        R = sf.iterate(body, size * u[: body.dimension], eps, 2, attitude=True).attitude
        np.testing.assert_allclose(R[1], expected, atol=1e-12)
        np.testing.assert_allclose(R[2], np.eye(len(expected)), atol=1e-12)


def test_orientations_remain_orthogonal(case):
    run = sf.iterate(*case, 0.3, 300 if config.DISABLE_JIT else 100_000, attitude=True)
    error = run.attitude @ run.attitude.swapaxes(-2, -1) - np.eye(run.attitude.shape[-1])
    assert abs(error).max() < 1e-14
