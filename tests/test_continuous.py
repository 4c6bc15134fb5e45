"""Vector field and reaction, against 60 digits."""

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


@pytest.mark.parametrize("m", [1, 2, 3, 7, 40])
def test_vector_field_in_n_dimensions(rng, m):
    for _ in range(5):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        exact = naive.vector_field_nd(J, I, omega)
        size = np.linalg.norm(I) * np.linalg.norm(omega) ** 2 / J.min()
        error = sf.vector_field(sf.SuslovND(J, I), omega) - np.array(exact, float)
        assert abs(error).max() < 5e-16 * size


def test_vector_field_beyond_float64():
    """Far below the least number it is 0, far above the largest infinite."""
    slow = sf.Suslov3D(1e300, 2e300, 1e-300, 1e-300)
    assert (sf.vector_field(slow, [1e-300, 1e-300]) == 0).all()
    fast = sf.Suslov3D(1e-300, 2e-300, 1e300, 1e300)
    assert sf.vector_field(fast, [1e300, 1e300]).tolist() == [-np.inf, np.inf]


@pytest.mark.parametrize("k", [-600, 600])
def test_reaction_where_one_of_its_terms_is_far_below_the_other(rng, k):
    """Products of inertia in another unit than moments, as the square of which the terms differ."""
    for _ in range(5):
        (I1, I2, I13, I23), _, omega = random_problem(rng)
        parameters = (I1, I2, *np.ldexp([I13, I23], k))
        state = np.ldexp(omega, -k // 2)
        slope = naive.vector_field(*naive.exactly(*parameters), naive.exactly(*state))
        exact = naive.reaction(*parameters, naive.exactly(*state), slope)
        computed = sf.reaction(sf.Suslov3D(*parameters), state)
        assert abs(float(computed / exact - 1)) < 3e-14


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
        size = max(size, max(parameters[:2]) * float(naive.mpmath.norm(following)) ** 2)
        assert abs(sf.reaction(body, omega, eps) - exact) < 1e-14 * size


def test_the_discrete_reaction_depends_on_eps(body):
    first, second = sf.reaction(body, [1.0, 0.5], [0.1, 0.2])
    assert abs(first - second) > 1e-3


@pytest.mark.parametrize("m", [2, 3, 5])
def test_reaction_in_n_dimensions(rng, m):
    for _ in range(5):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        eps, body, state = rng.uniform(-0.5, 0.5), sf.SuslovND(J, I), naive.exactly(*omega)
        slope = naive.vector_field_nd(J, I, omega)
        exact = np.array(naive.reaction_nd(J, I, state, state, slope), float)
        computed = sf.reaction(body, omega)
        np.testing.assert_allclose(computed, exact, atol=1e-14 * np.linalg.norm(exact) + 1e-14)
        assert (computed == -computed.T).all()

        following = naive.step_nd(J, I, eps, state)
        quotient = [(v - w) / naive.mpf(eps) for v, w in zip(following, state, strict=True)]
        exact = np.array(naive.reaction_nd(J, I, state, following, quotient), float)
        computed = sf.reaction(body, omega, eps)
        np.testing.assert_allclose(computed, exact, atol=1e-13 * np.linalg.norm(exact) + 1e-14)
        assert (computed == -computed.T).all()


def test_reactions_in_three_dimensions_and_n_agree(rng):
    for _ in range(10):
        (I1, I2, I13, I23), eps, (w1, w2) = random_problem(rng)
        three, nd = sf.Suslov3D(I1, I2, I13, I23), sf.SuslovND([I2, I1], [-I13, -I23])
        for step_size in (None, eps):
            expected = sf.reaction(three, [w1, w2], step_size)
            # lambda_12 of the matrix is minus the third component of the vector.
            computed = sf.reaction(nd, [w2, -w1], step_size)
            np.testing.assert_allclose(computed, [[0, -expected], [expected, 0]], atol=1e-14)


def test_the_discrete_reaction_tends_to_the_continuous_one(body):
    """And does not lose digits on the way."""
    continuous = sf.reaction(body, [1.0, 0.5])
    for eps in (1e-6, 1e-12, 1e-300, 0.0):
        assert abs(sf.reaction(body, [1.0, 0.5], eps) - continuous) < 2 * eps + 1e-15


def test_reaction_where_there_is_no_next_state(unit):
    """The pole of the body is the line Omega2 = -2 - Omega1**2 for eps = 1."""
    with pytest.warns(sf.SingularStepWarning, match=r"1 of 3 states: .*, first: 1") as seen:
        values = sf.reaction(unit, [[1, 1], [1, -3], [np.nan, 1]], 1.0)
    assert seen[0].filename == __file__
    assert np.isnan(values).tolist() == [False, True, True]


def test_reaction_in_n_dimensions_where_there_is_no_next_state():
    """The same body, whose state is (Omega2, -Omega1) here."""
    nd = sf.SuslovND([1, 1], [-1, 0])
    with pytest.warns(sf.SingularStepWarning, match=r"1 of 2 states: .*, first: 1") as seen:
        values = sf.reaction(nd, [[1, -1], [-3, -1]], 1.0)
    assert seen[0].filename == __file__
    assert np.isnan(values).all(axis=(1, 2)).tolist() == [False, True]


def test_reaction_of_bodies_without_couplings():
    """Nothing moves, and the torque is that of a steady rotation."""
    body = sf.Suslov3D(3, 1, 0, 0)
    assert sf.reaction(body, [2.0, 5.0]) == sf.reaction(body, [2.0, 5.0], 0.7) == -20
