import naive
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import suslov_fast as sf


def orthogonality(R):
    return abs(R @ R.swapaxes(-2, -1) - np.eye(3)).max()


def test_against_cayley_matrices(body):
    omega = sf.iterate(body, [1.0, 0.5], 0.2, 30).omega
    exact = naive.attitude(omega, 0.2)
    computed = sf.attitude(body, omega, 0.2)
    for R, expected in zip(computed, exact, strict=True):
        assert abs(R - np.array(expected.tolist(), float)).max() < 5e-15
    assert (computed[0] == np.eye(3)).all()


def test_order_2(body):
    """Against the integration of R' = R Omega along the exact flow; order by regression."""

    def derivative(time, R):
        w1, w2 = sf.flow(body, [1.0, 0.5], time)
        return (R.reshape(3, 3) @ [[0, 0, w2], [0, 0, -w1], [-w2, w1, 0]]).ravel()

    solution = solve_ivp(derivative, (0, 3.0), np.eye(3).ravel(), "DOP853", rtol=1e-13, atol=1e-13)
    exact = solution.y[:, -1].reshape(3, 3)
    steps = 2 ** np.arange(5, 10)
    errors = []
    for n in steps:
        omega = sf.iterate(body, [1.0, 0.5], 3.0 / n, int(n)).omega
        errors.append(abs(sf.attitude(body, omega, 3.0 / n)[-1] - exact).max())
    order = -np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(order - 2) < 0.02


@pytest.mark.compiled
def test_orthogonal_over_a_million_steps(body):
    omega = sf.iterate(body, [1.0, 0.5], 0.2, 1_000_000).omega
    R = sf.attitude(body, omega, 0.2)
    assert orthogonality(R) < 3e-15
    assert abs(np.linalg.det(R[::1000]) - 1).max() < 3e-15


def test_steady_rotation(body):
    """About a fixed axis, by 2 atan(eps |omega| / 2) each step."""
    omega = np.array([0.375, -0.625])
    R = sf.attitude(body, np.tile(omega, (11, 1)), 0.2)
    angle = 2 * np.arctan(0.1 * np.hypot(*omega)) * np.arange(11)
    vectors = angle[:, None] * np.append(omega, 0) / np.hypot(*omega)
    np.testing.assert_allclose(R, Rotation.from_rotvec(vectors).as_matrix(), atol=1e-14)
    assert len(Rotation.from_matrix(R.reshape(-1, 3, 3))) == 11


def test_batches(body, rng):
    omega = sf.iterate(body, rng.normal(size=(4, 1, 2)), [0.1, 0.2], 12).omega
    R0 = Rotation.from_quat(rng.normal(size=(4, 4))).as_matrix()[:, None]
    R = sf.attitude(body, omega, [0.1, 0.2], R0)
    assert R.shape == (4, 2, 13, 3, 3)
    alone = sf.attitude(body, omega[3, 1], 0.2, R0[3, 0])
    assert (R[3, 1] == alone).all()
    assert sf.attitude(body, np.empty((0, 3, 2)), 0.2).shape == (0, 3, 3, 3)


def test_failed_trajectories(unit):
    omega = sf.iterate(unit, [[1.0, -3.0], [0.3, 0.1]], 1, 5, on_singular="ignore").omega
    R = sf.attitude(unit, omega, 1)
    assert np.isnan(R[0, 1:]).all()
    assert np.isfinite(R[0, 0]).all()
    assert np.isfinite(R[1]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 0.5], 0.2), r"omega: expected shape \(..., N \+ 1, 2\), got \(2,\)"),
        ((np.ones((0, 2)), 0.2), r"omega: expected shape \(..., N \+ 1, 2\), got \(0, 2\)"),
        ((np.ones((4, 3)), 0.2), r"omega: expected shape \(..., 2\), got \(4, 3\)"),
        (([[np.inf, 1]], 0.2), "omega: expected finite real numbers, got inf"),
        ((np.ones((5, 4, 2)), [1, 2]), r"broadcast .* omega \(5,\), eps \(2,\)"),
        ((np.ones((4, 2)), 0.2, np.eye(2)), r"R0: expected shape \(..., 3\), got \(2, 2\)"),
        ((np.ones((4, 2)), 0.2, np.ones(3)), r"R0: expected shape \(..., 3, 3\), got \(3,\)"),
        ((np.ones((4, 2)), 0.2, 2 * np.eye(3)), "R0: expected rotation matrices, got .* = 3"),
        ((np.ones((4, 2)), 0.2, -np.eye(3)), "R0: expected rotation .* determinant -1"),
    ],
)
def test_bad_input(body, arguments, message):
    with pytest.raises(ValueError, match=message):
        sf.attitude(body, *arguments)
