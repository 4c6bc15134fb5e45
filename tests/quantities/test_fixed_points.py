"""Fixed points of fields, against points that are known in closed form."""

from fractions import Fraction as F

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast import QuadraticField, fixed_points


def _near(f, near, **parameters):
    return fixed_points(sf.Field.from_function(f, np.shape(near)[-1], **parameters), near=near)


TORQUES = np.array([0.0, 0.3, 0.6, 1.0, 1.2])


def test_equilibria_of_families_and_folds():
    """Of a pendulum with a torque; at torque 1 two of them meet."""
    with pytest.warns(UserWarning, match=r"4 of 10 starts.*\(0, 3\) of member 3 \(m=1.0\)") as told:
        found = _near(
            lambda x, m: (x[1], m - np.sin(x[0]) - 0.1 * x[1]), [[[0.1, 0]], [[0.2, 0]]], m=TORQUES
        )
    assert len(told) == 1
    q = np.arcsin(TORQUES[:3])
    np.testing.assert_allclose(found.states[:, :3, 0], [q, q], atol=1e-14)
    np.testing.assert_allclose(found.states[:, :3, 1], 0.0, atol=1e-14)
    roots = -0.05 + np.sqrt(0.0025 - np.cos(q) + 0j)
    np.testing.assert_allclose(found.eigenvalues[1, :3, 0], roots, rtol=1e-12)
    assert np.isnan(found.states[:, 3:]).all()
    assert np.isnan(found.eigenvalues[:, 3:]).all()
    S = sf.Status
    assert found.status.tolist() == [[S.OK, S.OK, S.OK, S.DEGENERATE, S.NOT_FOUND]] * 2


@pytest.mark.parametrize(
    ("f", "near", "status"),
    [
        (lambda x: (x[0] ** 2,), [0.1], sf.Status.DEGENERATE),
        (lambda x: (x[0] ** 2,), [0.0], sf.Status.DEGENERATE),
        (lambda x: ((x[0] - 1) ** 2, -x[1]), [0.1, 0.2], sf.Status.DEGENERATE),
        (lambda x: (-(x[0] ** 3),), [0.1], sf.Status.DEGENERATE),
        (lambda x: (x[0] - 1, (1e14 * x[1] - 1) ** 2), [1.1, 1.2e-14], sf.Status.DEGENERATE),
        (lambda x: (x[0] ** 2 + 1, -x[1]), [0.1, 0.2], sf.Status.NOT_FOUND),
        (lambda x: (x[1], x[1] + 1), [0.1, 0.2], sf.Status.NOT_FOUND),
        (lambda x: (np.log(x[0]),), [-1.0], sf.Status.NONFINITE),
    ],
)
def test_states_without_a_regular_equilibrium(f, near, status):
    with pytest.warns(UserWarning, match="1 of 1 starts"):
        found = _near(f, near)
    assert found.status == status
    assert np.isnan(found.states).all()


def test_equilibria_that_newton_reaches_from_afar():
    found = _near(lambda x: (np.exp(x[0]) - 1,), [[0.1], [0.0], [5.0], [-3.0], [np.nan]])
    np.testing.assert_allclose(found.states[:, 0], [0, 0, 0, 0, np.nan], atol=1e-15)
    assert found.status.tolist() == [0, 0, 0, 0, sf.Status.NONFINITE]
    assert _near(lambda x: (np.log(x[0]),), [20.0]).states.tolist() == [1.0]
    lorenz = QuadraticField.from_function(
        lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - F(8, 3) * x[2]), 3
    )
    starts = np.random.default_rng(0).normal(size=(30, 3)) * 20
    found = fixed_points(lorenz, near=starts)
    points = np.array([[0, 0, 0], *([s * 72**0.5, s * 72**0.5, 27] for s in (1, -1))])
    far = abs(found.states[:, np.newaxis] - points).max(axis=-1).min(axis=-1)
    assert far.max() < 1e-12
    assert not found.status.any()


def test_equilibria_of_components_of_different_sizes():
    """A radical, whose rates k r are as large as others: the last ones were 0.2 to 2 % off."""
    k = np.array([1.0, 1e6, 1e12, 1e15])
    found = _near(
        lambda x, k: (1 - x[0] - k * x[1] * x[0] + x[2] / 2,
                      x[2] / 1000 - k * x[1] * (x[0] + 0.1) / 10,
                      x[0] - 0.9 * x[2] + k * x[1] / 10),
        np.stack([2.24 + 0 * k, 0.0108 / k, 2.4 + 0 * k], axis=-1), k=k,
    )  # fmt: skip
    states = found.states * np.stack([1 + 0 * k, k, 1 + 0 * k], axis=-1)
    np.testing.assert_allclose(states, states[:1] * np.ones((4, 1)), rtol=1e-12)


def test_clocks_and_curves_of_equilibria():
    """Clocks keep their values; a conserved sum leaves a curve, of which a near point is found."""
    found = _near(lambda s: (s[1], -np.sin(s[0]) - 0.1 * s[1] + np.sin(s[2]), 1.0), [0.1, 0.0, 0.5])
    np.testing.assert_allclose(found.states, [0.5, 0.0, 0.5], atol=1e-14)
    assert found.eigenvalues.shape == (2,)
    found = _near(lambda x: (1.0,), [3.0])
    assert (found.states.tolist(), found.eigenvalues.shape) == ([3.0], (0,))
    bound = _near(lambda x: (x[2] - 3 * x[0] * x[1],) * 2 + (3 * x[0] * x[1] - x[2],), [1, 1.1, 1])
    a, b, c = bound.states
    assert abs(c - 3 * a * b) < 1e-14
    assert abs(bound.states - [1, 1.1, 1]).max() < 1.0
    assert (abs(bound.eigenvalues) < 1e-14).sum() == 2
    plane = _near(lambda x: [-x[0] * (1 + a * a) for a in x], [0.1, 0, 1.28, 0, 0])
    assert (plane.status, abs(plane.states[0]) < 1e-14) == (sf.Status.OK, True)


def test_steady_states_near_those_of_bodies():
    bodies = sf.Suslov3D([4, 3], 1, -0.5, [-0.3, -0.25])
    found = fixed_points(bodies, near=[[[1.0, 0.5]], [[0.3, -0.2]]])
    assert abs(sf.vector_field(bodies, found.states)).max() < 1e-16
    np.testing.assert_allclose(found.states[0, 0], -0.05 / 0.34 * np.array([-0.3, 0.5]))
    body = sf.SuslovND([1, 2, 3], [0.1, 0.2, 0.3])
    assert abs(sf.vector_field(body, fixed_points(body, near=[1, 0.5, 0.2]).states)).max() < 1e-15
    still = fixed_points(sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0), near=[1.0, 0.5])
    of_body = fixed_points(sf.Suslov3D(4, 1, -0.5, -0.3), near=[1.0, 0.5])
    np.testing.assert_array_equal(still.states, of_body.states)
    rotor = sf.SuslovGyrostat(4, 1, -0.5, -0.3, 1)
    found = fixed_points(rotor, near=[1.0, 0.5])
    assert abs(sf.vector_field(rotor, found.states)).max() < 1e-15
