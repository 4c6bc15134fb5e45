"""What is conserved, against the paper's expressions in 60 digits."""

import naive
import numpy as np
import pytest
from mpmath import mp

import suslov_fast as sf


def random_problem(rng):
    """Parameters of a body, a step size and a state, t below and above 1."""
    parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
    return parameters, rng.uniform(-1, 1), rng.normal(size=2) * 10 ** rng.uniform(-1, 2)


def random_body_nd(rng, m):
    return sf.SuslovND(rng.uniform(0.5, 4, m), rng.normal(size=m))


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


def test_first_integral_next_to_the_line_of_a_long_step(rng):
    """Where eps x counts although omega, times its rounding, is larger."""
    parameters, _, _ = random_problem(rng)
    I13, I23 = parameters[2:]
    omega = 1e8 * np.array([I23, -I13]) + 1e-8 * rng.normal(size=2)
    exact = float(naive.first_integral(*parameters, 1e7, omega))
    assert abs(sf.first_integral(sf.Suslov3D(*parameters), omega, 1e7) / exact - 1) < 2e-15


def test_energy(body):
    assert sf.energy(body, [1, 0.5]) == 2.125
    assert sf.energy(body, np.ones((3, 4, 2))).shape == (3, 4)
    assert sf.energy(sf.Suslov3D(1, 1, [0.1, 0.2], 0), [1, 1]).tolist() == [1, 1]


def test_energy_is_F_for_small_steps(body):
    np.testing.assert_allclose(
        sf.first_integral(body, [1, 0.5], 1e-9), 2 * sf.energy(body, [1, 0.5]) / 16, rtol=1e-15
    )


def test_modified_energy(rng):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        E = naive.energy_nd(parameters[:2], omega)
        slope = naive.vector_field(*naive.exactly(*parameters), naive.exactly(*omega))
        excess = naive.mpf(eps) ** 2 / 4 * naive.energy_nd(parameters[:2], slope)
        exact = float(E**2 / (E + excess))
        computed = sf.modified_energy(sf.Suslov3D(*parameters), omega, eps)
        assert abs(computed / exact - 1) < 3e-15


def test_modified_energy_is_a_multiple_of_F(body, rng):
    omega = rng.normal(size=(20, 2))
    np.testing.assert_allclose(
        sf.modified_energy(body, omega, 0.3), 8 * sf.first_integral(body, omega, 0.3), rtol=1e-15
    )
    assert sf.modified_energy(body, [0, 0], 0.3) == 0


@pytest.mark.parametrize("m", [1, 2, 3, 5, 40])
def test_energies_in_n_dimensions(rng, m):
    for _ in range(10):
        body, eps = random_body_nd(rng, m), rng.uniform(-1, 1)
        omega = rng.normal(size=m) * 10 ** rng.uniform(-1, 2)
        E = naive.energy_nd(body.J, omega)
        slope = naive.vector_field_nd(body.J, body.I, omega)
        excess = naive.mpf(eps) ** 2 / 4 * naive.energy_nd(body.J, slope)
        assert abs(sf.energy(body, omega) / float(E) - 1) < 3e-15
        # f.Jf may be small beside its terms.
        relative = abs(sf.modified_energy(body, omega, eps) / float(E**2 / (E + excess)) - 1)
        assert relative < 1e-13
    assert sf.modified_energy(body, np.zeros(m), 0.3) == 0


def test_three_dimensions_and_n_agree(rng):
    for _ in range(20):
        (I1, I2, I13, I23), eps, (w1, w2) = random_problem(rng)
        three, nd = sf.Suslov3D(I1, I2, I13, I23), sf.SuslovND([I2, I1], [-I13, -I23])
        for function in (sf.first_integral, sf.modified_energy, sf.criticality):
            expected = function(three, [w1, w2], eps)
            np.testing.assert_allclose(function(nd, [w2, -w1], eps), expected, rtol=1e-13)


def test_integrals_of_solved_bodies_in_n_dimensions(rng):
    """All J equal, or I along one axis: F and t are those of the orbit, and constant along it."""
    for J, I in (([2.0] * 4, [0.3, -0.4, 0.2, 0.1]), ([1.5, 1.5, 1.5, 4.0], [0, 0, 0, -0.7])):
        body = sf.SuslovND(J, I)
        omega = rng.normal(size=(5, 4))
        states = np.array([naive.orbit_nd(J, I, 0.2, w, 10) for w in omega], float).swapaxes(0, 1)
        for function in (sf.first_integral, sf.criticality):
            values = function(body, states, 0.2)
            assert values.shape == (11, 5)
            np.testing.assert_allclose(values, np.broadcast_to(values[0], (11, 5)), rtol=1e-13)
    with pytest.raises(sf.NotIntegrableError, match="first_integral: expected"):
        sf.first_integral(sf.SuslovND([1, 2, 3], [1, 1, 1]), [1, 2, 3], 0.1)


def test_criticality(rng):
    for _ in range(50):
        parameters, eps, omega = random_problem(rng)
        t = sf.criticality(sf.Suslov3D(*parameters), omega, eps)
        assert abs(t / float(naive.criticality(*parameters, eps, omega)) - 1) < 3e-15


def test_criticality_is_constant_along_orbits():
    body = sf.Suslov3D(3, 3, -0.2, -0.2)
    for omega in ([1.0, 2.0], [-40.0, -250.0]):
        t = sf.criticality(body, sf.iterate(body, omega, 1, 50).omega, 1)
        np.testing.assert_allclose(t, t[0], rtol=1e-13)


def test_criticality_agrees_with_the_status():
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


@pytest.mark.parametrize("x", [0.0, 1e-9, 1e-3, 1.0, 1e6])
def test_criticality_next_to_1(unit, x):
    for gap in (-1e-15, -1.2e-16, 0.0, 2.3e-16, 1e-15):
        omega = [x, 2 * (1 + gap)]
        exact = naive.criticality(1, 1, 1, 0, 1, omega)
        assert abs(float(sf.criticality(unit, omega, 1.0) / exact - 1)) < 3e-16


def test_criticality_far_beyond_1(unit):
    """On the line t = |eps y| / 2, of any size; off it t tends to the ratio of states."""
    for y in (1e100, 1e200, 1e260):
        assert sf.criticality(unit, [0.0, y], 1.0) == 0.5 * y
        t = sf.criticality(unit, [y, 3 * y], 1.0)
        assert abs(t / np.sqrt(10) - 1) < 1e-15


def test_criticality_of_special_cases(body):
    assert sf.criticality(body, [0, 0], 0.2) == 0
    assert sf.criticality(body, [1, 2], 0) == 0
    assert sf.criticality(sf.Suslov3D(1, 2, 0, 0), [1, 2], 1) == 0


def test_invariant_density(rng):
    for _ in range(50):
        parameters, eps, omega = random_problem(rng)
        exact = float(naive.invariant_density(*parameters, eps, omega))
        density = sf.invariant_density(sf.Suslov3D(*parameters), omega, eps)
        assert abs(density / exact - 1) < 3e-15


# t below, next to and above 1, both signs of x, eps of both signs, and an orbit that jumps.
REGIMES = [([0.5, 0.3], 0.3), ([-3.0, 1.0], -0.7), ([0.1, -1.99], 1.0), ([2.0, -5.0], 1.0)]


@pytest.mark.parametrize(("omega", "eps"), REGIMES)
def test_the_map_preserves_the_invariant_density(omega, eps):
    """rho(Phi(omega)) det DPhi(omega) = rho(omega), signs included."""
    for body in (sf.Suslov3D(1, 1, 1, 0), sf.Suslov3D(2, 1, -0.4, 0.9)):
        density = sf.invariant_density(body, omega, eps)
        after = sf.invariant_density(body, sf.step(body, omega, eps), eps)
        det = np.linalg.det(sf.jacobian(body, omega, eps))
        np.testing.assert_allclose(after * det, density, rtol=1e-11)


def test_the_density_on_the_line_of_steady_states(unit):
    assert sf.invariant_density(unit, [0.0, 1.0], 0.3) == np.inf


def test_closed_form(rng):
    for _ in range(100):
        parameters, eps, omega = random_problem(rng)
        h, k1, k2, t = sf.closed_form(sf.Suslov3D(*parameters), omega, eps)
        assert t == sf.criticality(sf.Suslov3D(*parameters), omega, eps)
        exact = naive.closed_form(*parameters, eps, omega)
        assert abs(h / float(exact[0]) - 1) < 5e-15
        if abs(t) < 1:
            # Next to t = 1 the constants hang on the distance from it, which |y| decides.
            assert abs(k1 / float(exact[1]) - 1) < 1e-14
            assert abs(k2 - float(exact[2])) < 1e-14 * (1 + abs(k2))
        else:
            assert np.isnan(k1)
            assert np.isnan(k2)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("gap", [1e-6, 1e-12, 1e-15, 3e-16])
def test_closed_form_next_to_the_critical_line(gap, sign):
    """Of a body whose Y is rounded: k1 hangs on digits of 1 - |Y| that Y alone lacks."""
    parameters, eps = (1.7, 2.3, 0.3, -0.7), 0.3
    body = sf.Suslov3D(*parameters)
    omega = sf.from_xy(body, [1e-3, sign * 2 * 1.7 * 2.3 / eps * (1 - gap)])
    h, k1, k2, _ = sf.closed_form(body, omega, eps)
    for computed, exact in zip(
        (h, k1, k2), naive.closed_form(*parameters, eps, omega), strict=True
    ):
        assert abs(float(computed / exact - 1)) < 2e-15


def test_closed_form_gives_the_orbit(body):
    omega = np.array([[1.0, 0.5], [-2.0, 3.0], [0.1, -0.2]])
    eps = np.array([0.2, -0.3, 0.5])
    h, k1, k2, _ = sf.closed_form(body, omega, eps)
    states = sf.iterate(body, omega, eps, 20).omega
    theta = k1 * eps * np.arange(21)[:, None] + k2
    a = body.I1 * body.I2
    sign = np.sign(sf.to_xy(body, omega)[:, 0])
    x = sign * 2 * np.sqrt(h * a / (a - h * eps**2)) / np.cosh(theta)
    xy = np.stack([x, 2 * np.sqrt(h * a) * np.tanh(theta)], axis=-1)
    np.testing.assert_allclose(sf.from_xy(body, xy), states, rtol=1e-12, atol=1e-13)


def test_closed_form_of_special_cases(body, unit):
    h, k1, k2, t = sf.closed_form(unit, [1.0, -0.5], 0.0)  # x = 1, y = 1/2: the flow
    assert (h, t) == (0.3125, 0)
    assert k1 == -2 * np.sqrt(0.3125)
    assert abs(k2 - np.arctanh(0.5 / (2 * np.sqrt(0.3125)))) < 1e-15
    assert sf.closed_form(unit, [0.0, -1.0], 0.5)[2] == np.inf
    assert sf.closed_form(unit, [0.0, 1.0], 0.5)[2] == -np.inf
    assert sf.closed_form(body, [0.0, 0.0], 0.5) == (0, 0, 0, 0)
    assert sf.closed_form(sf.Suslov3D(1, 2, 0, 0), [1.0, 2.0], 0.5) == (0, 0, 0, 0)
    assert np.isnan(sf.closed_form(unit, [np.nan, 1.0], 0.5)).all()
    found = sf.closed_form(unit, np.ones((3, 1, 2)), [0.1, 0.2])
    assert [each.shape for each in found] == [(3, 2)] * 4


@pytest.mark.parametrize("omega", [(0.0, 1e305), (1e-250, 1e305), (1e-290, 1e250), (1e300, 1e305)])
@pytest.mark.parametrize("eps", [1.0, 1e-300, -1e250])
def test_criticality_beyond_squares(omega, eps):
    """On the line and next to it t grows with the step; elsewhere it has a limit."""
    with mp.workdps(60):
        X, Y = mp.mpf(eps) * omega[0] / mp.sqrt(2), -mp.mpf(eps) * omega[1] / 2
        expected = mp.sign(eps) * mp.sqrt((X**2 + 2 * Y**2) / (2 + X**2))
    found = sf.criticality(sf.Suslov3D(1, 1, 1, 0), omega, eps)
    if abs(expected) > 1.7e308:
        assert found == np.sign(eps) * np.inf
    else:
        assert found == pytest.approx(float(expected), rel=1e-14)


def test_criticality_of_moments_far_apart():
    body = sf.Suslov3D(1, 1e-250, 1e-3, 1e-3)
    assert sf.criticality(body, [1e200, 0.0], 1.0) == pytest.approx(1e125, rel=1e-14)
