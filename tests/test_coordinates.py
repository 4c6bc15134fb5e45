"""The paper's coordinates (x, y), against 60 digits."""

import naive
import numpy as np
import pytest

import suslov_fast as sf


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
    return parameters, rng.normal(size=2) * 10 ** rng.uniform(-1, 1.5)


def test_xy(rng):
    for _ in range(50):
        parameters, omega = random_problem(rng)
        body = sf.Suslov3D(*parameters)
        exact = naive.xy(*parameters, omega)
        xy = sf.to_xy(body, omega)
        assert abs(xy[0] / float(exact[0]) - 1) < 3e-16
        assert naive.relative_error(xy, exact) < 1e-15
        np.testing.assert_allclose(sf.from_xy(body, xy), omega, rtol=1e-13)


@pytest.mark.parametrize("distance", [1e-6, 1e-12, 1e-16])
def test_x_is_accurate_next_to_the_line(rng, distance):
    for _ in range(20):
        parameters, _ = random_problem(rng)
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
    alone = sf.to_xy(sf.Suslov3D(body.I1[2, 0], 1, 0.3, 0.2), omega[1])
    assert (xy[2, 1] == alone).all()


@pytest.mark.parametrize("scale", [1e-150, 1e-105, 1e105, 1e150])
def test_xy_of_light_and_heavy_bodies(scale):
    body = sf.Suslov3D(4 * scale, scale, -0.5 * scale, -0.3 * scale)
    expected = np.array([-0.65, -0.95]) * [scale, 0] + [0, -0.95 * scale**2]
    np.testing.assert_allclose(sf.to_xy(body, [1.0, 0.5]), expected, rtol=1e-14)
    back = sf.from_xy(body, sf.to_xy(body, [1.0, 0.5]))
    np.testing.assert_allclose(back, [1.0, 0.5], rtol=1e-13)


def test_from_xy_needs_a_coupling():
    with pytest.raises(ValueError, match="body: expected I13 or I23 other than 0, got both 0"):
        sf.from_xy(sf.Suslov3D(1, 2, [0, 1], 0), [1, 2])
    assert sf.to_xy(sf.Suslov3D(1, 2, 0, 0), [1, 2]).tolist() == [0, 0]


def test_coordinates_that_are_missing(body):
    states = [[1, 2], [np.nan, 2], [1, np.nan]]
    assert np.isnan(sf.to_xy(body, states)).all(axis=1).tolist() == [False, True, True]
    assert np.isnan(sf.from_xy(body, states)).all(axis=1).tolist() == [False, True, True]
    with pytest.raises(ValueError, match="xy: expected finite"):
        sf.from_xy(body, [np.inf, 1])
    with pytest.raises(ValueError, match=r"xy: expected shape \(..., 2\)"):
        sf.from_xy(body, [1, 2, 3])


def test_coordinates_that_are_0(body):
    assert sf.to_xy(body, [0, 0]).tolist() == sf.from_xy(body, [0, 0]).tolist() == [0, 0]
    np.testing.assert_allclose(sf.from_xy(body, [0, 1e-300]), sf.from_xy(body, [0, 1]) * 1e-300)
