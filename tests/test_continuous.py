"""Vector field, reaction, derivative of the map, multipliers."""

import naive
import numpy as np
import pytest

import suslov_fast as sf


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
    return parameters, rng.uniform(-0.5, 0.5), rng.normal(size=2)


def test_vector_field(rng):
    for _ in range(30):
        parameters, _, omega = random_problem(rng)
        exact = naive.vector_field(*naive.exactly(*parameters), naive.exactly(*omega))
        assert naive.relative_error(sf.vector_field(sf.Suslov3D(*parameters), omega), exact) < 1e-15


def test_vector_field_vanishes_on_the_line():
    body = sf.Suslov3D(4, 1, -0.5, -0.25)
    assert (sf.vector_field(body, [[0.375, -0.75], [0, 0]]) == 0).all()


def test_reaction(rng):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        body, state = sf.Suslov3D(*parameters), naive.exactly(*omega)
        slope = naive.vector_field(*naive.exactly(*parameters), state)
        exact = float(naive.reaction(*parameters, state, slope))
        size = max(parameters[:2]) * np.hypot(*omega) ** 2
        assert abs(sf.reaction(body, omega) - exact) < 2e-15 * size

        following = naive.step(*parameters, eps, state)
        exact = float(naive.discrete_reaction(*parameters, eps, state, following))
        assert abs(sf.reaction(body, omega, eps) - exact) < 2e-14 * size
        known = sf.reaction(body, omega, eps, omega_next=[float(v) for v in following])
        assert abs(known - exact) < 2e-14 * size


def test_the_discrete_reaction_tends_to_the_continuous_one(body):
    """And does not lose digits on the way."""
    continuous = sf.reaction(body, [1.0, 0.5])
    for eps in (1e-6, 1e-12, 1e-300, 0.0):
        assert abs(sf.reaction(body, [1.0, 0.5], eps) - continuous) < 2 * eps + 1e-15


def test_reaction_along_a_trajectory(rng):
    body = sf.Suslov3D(rng.uniform(1, 2, (3, 1)), 1, 0.3, 0.2)
    omega = sf.iterate(body, [[1, 0.5]], 0.2, 20).omega
    assert omega.shape == (3, 1, 21, 2)
    one = sf.Suslov3D(body.I1[2, 0], 1, 0.3, 0.2)
    values = sf.reaction(one, omega[2, 0, :-1], 0.2, omega[2, 0, 1:])
    np.testing.assert_allclose(values, sf.reaction(one, omega[2, 0, :-1], 0.2), rtol=1e-12)
    assert sf.reaction(body, [[1, 0.5]] * 4).shape == (3, 4)
    assert sf.reaction(body, [[1, 0.5]] * 4, [0.1, 0.2, 0.3, 0.4]).shape == (3, 4)


def test_reaction_needs_eps(body):
    with pytest.raises(ValueError, match="eps: expected a step size together with omega_next"):
        sf.reaction(body, [1, 2], omega_next=[1, 2])


def test_jacobian(rng):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        exact = naive.jacobian(*parameters, eps, omega)
        computed = sf.jacobian(sf.Suslov3D(*parameters), omega, eps)
        np.testing.assert_allclose(computed, np.array(exact, float), atol=1e-13, rtol=1e-13)


def test_jacobian_preserves_the_invariant_density(body, rng):
    """The density 1 / (x (4a + eps**2 x**2)) in (x, y) coordinates."""
    omega = rng.normal(size=(50, 2))
    following = sf.step(body, omega, 0.2)

    def density(state):
        x = sf.to_xy(body, state)[:, 0]
        return 1 / (x * (4 * body.I1 * body.I2 + 0.04 * x * x))

    det = np.linalg.det(sf.jacobian(body, omega, 0.2))
    np.testing.assert_allclose(det * density(following), density(omega), rtol=1e-12)


def test_jacobian_shapes_and_poles(unit):
    with pytest.warns(sf.SingularStepWarning, match="1 of 6 states: singular or") as seen:
        computed = sf.jacobian(unit, [[[1, -3]], [[0.3, 0.1]], [[1, 1]]], [1, 0.5])
    assert seen[0].filename == __file__
    assert computed.shape == (3, 2, 2, 2)
    assert np.isnan(computed[0, 0]).all()
    assert np.isfinite(computed[1:]).all()
    assert (sf.jacobian(unit, [1, 2], 0) == np.eye(2)).all()


def test_multipliers_are_eigenvalues_of_the_jacobian(rng):
    for _ in range(20):
        (I1, I2, I13, I23), eps, _ = random_problem(rng)
        body, c = sf.Suslov3D(I1, I2, I13, I23), rng.normal()
        computed = sf.multipliers(body, c, eps)
        eigenvalues = np.linalg.eigvals(sf.jacobian(body, c * np.array([I23, -I13]), eps))
        assert computed[0] == 1
        np.testing.assert_allclose(np.sort(computed), np.sort(eigenvalues.real), rtol=1e-12)


def test_multipliers_tell_which_half_attracts(body):
    towards, away = sf.multipliers(body, [-3.0, 3.0], 0.2)[:, 1]
    assert 0 < towards < 1 < away
    assert towards * away == pytest.approx(1, abs=1e-15)
    assert sf.multipliers(body, np.zeros((2, 1)), [0.1, 0.2, 0.3]).shape == (2, 3, 2)


def test_multipliers_at_the_pole(unit):
    assert sf.multipliers(unit, 2.0, 1.0).tolist() == [1.0, np.inf]


def test_modified_energy(body, rng):
    omega = rng.normal(size=(20, 2))
    E, f = sf.energy(body, omega), sf.vector_field(body, omega)
    expected = E**2 / (E + 0.3**2 / 8 * (f**2 @ [body.I1, body.I2]))
    np.testing.assert_allclose(sf.modified_energy(body, omega, 0.3), expected, rtol=1e-14)
    np.testing.assert_allclose(
        sf.modified_energy(body, omega, 0.3), 8 * sf.first_integral(body, omega, 0.3), rtol=1e-15
    )
    assert sf.modified_energy(body, [0, 0], 0.3) == 0
