"""The derivative of the map, the matrix A, and the multipliers of steady states."""

import mpmath
import naive
import numpy as np
import pytest

import suslov_fast as sf


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
    return parameters, rng.uniform(-0.5, 0.5), rng.normal(size=2)


def error(computed, exact):
    """Of matrices, relative to the norm."""
    exact = mpmath.matrix(exact)
    return float(mpmath.norm(mpmath.matrix(computed.tolist()) - exact) / mpmath.norm(exact))


def test_jacobian(rng):
    for _ in range(60):
        parameters, eps, omega = random_problem(rng)
        omega *= 10 ** rng.uniform(-2, 3)
        exact = naive.jacobian(*parameters, eps, omega)
        body = sf.Suslov3D(*parameters)
        # As accurate as the step itself: |1 - Y + X**2| may be small beside its terms.
        following = naive.step(*parameters, eps, omega)
        allowed = 1e-14 + 10 * naive.relative_error(sf.step(body, omega, eps), following)
        assert error(sf.jacobian(body, omega, eps), exact) < allowed


@pytest.mark.parametrize("g", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
@pytest.mark.parametrize("eps", [1.0, -1.0])
def test_jacobian_next_to_the_pole(unit, g, eps):
    """X = eps Omega1 / sqrt(2), Y = -eps Omega2 / 2: the distance from the pole is 2 g."""
    for sign in (1, -1):
        omega = np.array([sign * np.sqrt(2 * g), -eps * 2 * (1 - g)])
        exact = derivative_near_poles(omega, eps)
        assert error(sf.jacobian(unit, omega, eps), exact) < 2e-15


def derivative_near_poles(omega, eps):
    return naive.derivative(
        lambda state: naive.step(1, 1, 1, 0, eps, state),
        naive.exactly(*omega),
        30,
    )


def test_jacobian_next_to_the_pole_of_any_body(rng):
    for _ in range(20):
        parameters = random_problem(rng)[0]
        body, g = sf.Suslov3D(*parameters), 10 ** rng.uniform(-12, -3)
        a = parameters[0] * parameters[1]
        omega = sf.from_xy(body, [np.sqrt(2 * a * g), 2 * a * (1 - g)])
        exact = naive.derivative(
            lambda state, p=parameters: naive.step(*p, 1, state),
            naive.exactly(*omega),
            30,
        )
        assert error(sf.jacobian(body, omega, 1.0), exact) < 1e-14


@pytest.mark.parametrize("size", [0.1, 3.0, 1e120])
def test_jacobian_of_mirror_images(unit, size):
    """x changes sign, bit for bit; so do y and the step size together."""
    of_omega = sf.jacobian(unit, [size, 0.7 * size], 1.0)
    assert np.isfinite(of_omega).all()
    for signs in ([-1, 1], [1, -1]):
        mirrored = sf.jacobian(unit, np.array([size, 0.7 * size]) * signs, signs[1])
        assert (mirrored == of_omega * [[1, -1], [-1, 1]]).all()


def test_jacobian_of_states_that_are_missing(unit):
    """NaN in all entries, where nothing moves too."""
    missing = [[np.nan, 1.0], [1.0, np.nan]]
    for body, eps in ((unit, 0.0), (sf.Suslov3D(1, 2, 0, 0), 0.2), (unit, 0.2)):
        assert np.isnan(sf.jacobian(body, missing, eps)).all()


def test_jacobian_far_beyond_the_poles(unit):
    for omega in ([1e6, 3.0], [1e3, -1e9], [3e4, 5e8], [1e8, 1e8]):
        assert error(sf.jacobian(unit, omega, 1.0), derivative_near_poles(omega, 1.0)) < 1e-14


def test_jacobian_of_small_steps_is_the_identity_and_the_derivative_of_the_field(rng):
    """Its small parts keep their digits."""
    for _ in range(10):
        parameters, _, omega = random_problem(rng)
        slope = naive.derivative(
            lambda state, p=parameters: naive.vector_field(*naive.exactly(*p), state),
            naive.exactly(*omega),
        )
        computed = sf.jacobian(sf.Suslov3D(*parameters), omega, 1e-12)
        off = np.array([computed[0, 1], computed[1, 0]]) / 1e-12
        np.testing.assert_allclose(off, [float(slope[0][1]), float(slope[1][0])], rtol=1e-8)
    assert (sf.jacobian(sf.Suslov3D(2, 1, 0.3, 0.2), [1, 2], 0) == np.eye(2)).all()
    assert (sf.jacobian(sf.Suslov3D(2, 1, 0, 0), [1, 2], 0.3) == np.eye(2)).all()


def test_jacobian_shapes_and_poles(unit):
    with pytest.warns(sf.SingularStepWarning, match=r"1 of 6 states: .*, first: \(0, 0\)") as seen:
        computed = sf.jacobian(unit, [[[1, -3]], [[0.3, 0.1]], [[1, 1]]], [1, 0.5])
    assert seen[0].filename == __file__
    assert computed.shape == (3, 2, 2, 2)
    assert np.isnan(computed[0, 0]).all()
    assert np.isfinite(computed[1:]).all()


def test_jacobian_agrees_with_the_step_on_what_is_a_pole(unit):
    """One after the other through the pole at (1, -3), and next to the point (0, -2)."""
    omega2 = -3.0 + 2.0**-51 * np.arange(-10, 11)
    near = [[1, w2] for w2 in omega2] + [[1e-9, -2], [1e-7, -2], [0, -2], [0, -1.9]]
    with pytest.warns(sf.SingularStepWarning):
        computed, following = sf.jacobian(unit, near, 1.0), sf.step(unit, near, 1.0)
    assert (np.isnan(computed[:, 0, 0]) == np.isnan(following[:, 0])).all()


@pytest.mark.parametrize("m", [1, 2, 3, 5])
def test_jacobian_in_n_dimensions(rng, m):
    for _ in range(5):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        exact = naive.jacobian_nd(J, I, 0.2, omega)
        assert error(sf.jacobian(sf.SuslovND(J, I), omega, 0.2), exact) < 1e-13


def test_jacobian_in_n_dimensions_at_a_pole():
    nd = sf.SuslovND([1, 1], [-1, 0])
    with pytest.warns(sf.SingularStepWarning, match=r"1 of 2 states: .*, first: 1") as seen:
        computed = sf.jacobian(nd, [[1, -1], [-3, -1]], 1.0)
    assert seen[0].filename == __file__
    assert np.isnan(computed[1]).all()
    assert np.isfinite(computed[0]).all()


def test_matrix(rng):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        computed = sf.matrix(sf.Suslov3D(*parameters), omega, eps)
        assert error(computed, naive.matrix(*parameters, eps, omega)) < 1e-15


@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_matrix_in_n_dimensions(rng, m):
    """Its columns are the coefficients of the unknowns in (dsn), over J."""
    J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
    J_, I_, state, (eps,) = (naive.exactly(*v) for v in (J, I, omega, [0.3]))
    zero = naive.dsn(J_, I_, eps, state, [naive.mpf(0)] * m)
    columns = []
    for j in range(m):
        unknown = [naive.mpf(int(i == j)) for i in range(m)]
        column = naive.dsn(J_, I_, eps, state, unknown)
        columns.append([(c - z) / J_[i] for i, (c, z) in enumerate(zip(column, zero, strict=True))])
    exact = [[columns[j][i] for j in range(m)] for i in range(m)]
    assert error(sf.matrix(sf.SuslovND(J, I), omega, 0.3), exact) < 1e-15


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


def test_multipliers_at_the_pole_and_beyond(unit):
    assert sf.multipliers(unit, 2.0, 1.0).tolist() == [1.0, np.inf]
    assert sf.multipliers(unit, 1e200, 1e200).tolist() == [1.0, -1.0]


@pytest.mark.parametrize("m", [1, 2, 3, 6, 20])
def test_multipliers_in_n_dimensions(rng, m):
    for _ in range(5):
        J, I = rng.uniform(0.5, 4, m), rng.normal(size=m) * 10 ** rng.uniform(-2, 0, m)
        c, eps = rng.normal(), rng.uniform(-1, 1)
        computed = sf.multipliers(sf.SuslovND(J, I), c, eps)
        assert computed[0] == 1
        exact = exact_multipliers(J, I, c, eps)
        np.testing.assert_allclose(computed, exact, rtol=1e-13)


def exact_multipliers(J, I, c, eps):
    """1, and the others in the order of the spectrum of J**-1 (|I|**2 - I I^T), ascending."""
    J, I, (c, eps) = naive.exactly(*J), naive.exactly(*I), naive.exactly(c, eps)
    m = len(J)
    symmetric = mpmath.matrix(m)
    for i in range(m):
        for j in range(m):
            entry = sum(v * v for v in I) * (i == j) - I[i] * I[j]
            symmetric[i, j] = entry / mpmath.sqrt(J[i] * J[j])
    spectrum = sorted(mpmath.eigsy(symmetric, eigvals_only=True))[1:]
    Y = [eps * c * s / 2 for s in spectrum]
    return [1.0] + [float((1 + y) / (1 - y)) for y in Y]


def test_the_multiplier_of_the_line_is_1_however_stiff_the_body():
    J = [0.0059, 5012, 1185, 0.114, 82, 0.000217]
    I = [-2091, -1.98, 365, -0.016, -0.102, 0.061]
    computed = sf.multipliers(sf.SuslovND(J, I), 1e3, 1e-9)
    assert computed[0] == 1
    np.testing.assert_allclose(computed, exact_multipliers(J, I, 1e3, 1e-9), rtol=1e-11)
    assert sf.multipliers(sf.SuslovND(J, I), 1e3, 0.2)[0] == 1


def test_multipliers_of_bodies_without_couplings():
    assert (
        sf.multipliers(sf.SuslovND([[1, 2, 3]] * 2, [[0, 0, 0], [0, 0, 1]]), 1, 1)[0] == 1
    ).all()
    assert (sf.multipliers(sf.Suslov3D(1, 2, 0, 0), 1, 1) == 1).all()
