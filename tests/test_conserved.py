"""Conserved quantities and coordinates against the paper's expressions in 60 digits."""

import naive
import numpy as np
import pytest

import suslov_fast as sf


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
    return parameters, rng.uniform(-1, 1), rng.normal(size=2) * 10 ** rng.uniform(-1, 1.5)


def test_first_integral(rng):
    for _ in range(50):
        parameters, eps, omega = random_problem(rng)
        exact = float(naive.first_integral(*parameters, eps, omega))
        F = sf.first_integral(sf.Suslov3D(*parameters), omega, eps)
        assert abs(F / exact - 1) < 2e-15


def test_first_integral_is_an_integral_of_the_exact_map(rng):
    """Lemma 1 itself, in 60 digits."""
    parameters, eps, omega = random_problem(rng)
    states = naive.orbit(*parameters, eps, omega, 20)
    F = [naive.first_integral(*parameters, eps, state) for state in states]
    assert max(abs(value / F[0] - 1) for value in F) < 1e-50


def test_energy(body):
    assert sf.energy(body, [1, 0.5]) == 2.125
    assert sf.energy(body, np.ones((3, 4, 2))).shape == (3, 4)
    assert sf.energy(sf.Suslov3D(1, 1, [0.1, 0.2], 0), [1, 1]).tolist() == [1, 1]


def test_energy_is_F_for_small_steps(body):
    np.testing.assert_allclose(
        sf.first_integral(body, [1, 0.5], 1e-9), 2 * sf.energy(body, [1, 0.5]) / 16, rtol=1e-15
    )


def test_xy(rng):
    for _ in range(50):
        parameters, _, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        exact = naive.xy(*parameters, omega)
        xy = sf.to_xy(body, omega)
        assert abs(xy[0] / float(exact[0]) - 1) < 3e-16
        assert naive.relative_error(xy, exact) < 1e-15
        np.testing.assert_allclose(sf.from_xy(body, xy), omega, rtol=1e-13)


@pytest.mark.parametrize("distance", [1e-6, 1e-12, 1e-16])
def test_x_is_accurate_next_to_the_line(rng, distance):
    for _ in range(20):
        parameters, _, _ = random_problem(rng)
        I13, I23 = parameters[2:]
        omega = np.array([I23, -I13]) * (1 + distance * rng.normal(size=2))
        exact = float(naive.xy(*parameters, omega)[0])
        x = sf.to_xy(sf.Suslov3D(*parameters), omega)[0]
        assert abs(x - exact) <= 3e-16 * abs(exact)


def test_xy_in_batches(rng):
    body = sf.Suslov3D(rng.uniform(1, 2, (4, 1)), 1, 0.3, 0.2)
    omega = rng.normal(size=(3, 2))
    xy = sf.to_xy(body, omega)
    assert xy.shape == (4, 3, 2)
    np.testing.assert_allclose(sf.from_xy(body, xy), np.broadcast_to(omega, (4, 3, 2)), rtol=1e-13)


@pytest.mark.parametrize("scale", [1e-150, 1e-105, 1e105, 1e150])
def test_xy_of_light_and_heavy_bodies(scale):
    body = sf.Suslov3D(4 * scale, scale, -0.5 * scale, -0.3 * scale)
    np.testing.assert_allclose(
        sf.to_xy(body, [1.0, 0.5]), np.array([-0.65, -0.95]) * [scale, 0] + [0, -0.95 * scale**2],
        rtol=1e-14,
    )  # fmt: skip
    back = sf.from_xy(body, sf.to_xy(body, [1.0, 0.5]))
    np.testing.assert_allclose(back, [1.0, 0.5], rtol=1e-13)


def test_criticality(rng):
    for _ in range(50):
        parameters, eps, omega = random_problem(rng)
        t = sf.criticality(sf.Suslov3D(*parameters), omega, eps)
        assert abs(t / float(naive.criticality(*parameters, eps, omega)) - 1) < 3e-15


def test_criticality_is_constant_along_orbits(rng):
    body = sf.Suslov3D(3, 3, -0.2, -0.2)
    for omega in ([1.0, 2.0], [-40.0, -250.0]):
        t = sf.criticality(body, sf.iterate(body, omega, 1, 50).omega, 1)
        np.testing.assert_allclose(t, t[0], rtol=1e-13)


def test_criticality_agrees_with_the_status(rng):
    """Also next to t = 1, where |y| = 2 I1 I2 / |eps|."""
    body = sf.Suslov3D(1, 1, 1, 0)
    y = 2 * (1 + np.array([-1e-15, -1.2e-16, 0, 2.3e-16, 1e-15]))
    x = np.array([0, 1e-9, 1e-3, 1, 1e6])[:, None]
    omega = np.stack(np.broadcast_arrays(x, y), axis=-1)
    for eps in (1, -1):
        result = sf.iterate(body, omega, eps, 0)
        t = sf.criticality(body, omega, eps)
        assert ((abs(t) >= 1) == (result.status == sf.Status.SUPERCRITICAL)).all()
        assert ((abs(t) >= 1) == (abs(y) >= 2)).all()
        assert (np.sign(t) == eps).all()


def test_criticality_of_special_cases(body):
    assert sf.criticality(body, [0, 0], 0.2) == 0
    assert sf.criticality(body, [1, 2], 0) == 0
    assert sf.criticality(sf.Suslov3D(1, 2, 0, 0), [1, 2], 1) == 0
