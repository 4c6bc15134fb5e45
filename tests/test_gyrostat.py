"""The gyrostat against its implicit equations in 60 digits: steps, derivatives, closed form.

Parameters are I1, I2, I13, I23, k and eps.
"""

from functools import partial

import mpmath
import naive
import numpy as np
import pytest
from test_quantities import error, rotation_number

import suslov_fast as sf


def exact_step(parameters, omega):
    *body, k, eps = parameters
    return naive.step(*body, eps, omega, k)


def exact_orbit(parameters, omega, steps):
    return naive.iterated(partial(exact_step, parameters), omega, steps)


def run(parameters, omega, steps, **options):
    """Iterate by steps."""
    body, options = sf.SuslovGyrostat(*parameters[:5]), {"method": "canonical"} | options
    return sf.iterate(body, omega, parameters[5], steps, **options)


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.normal(size=3), rng.uniform(-1, 1))
    return parameters, rng.normal(size=2) * 10 ** rng.uniform(-1, 1)


def rotor(parameters, omega):
    _, _, I13, I23, k, *_ = parameters
    return naive.rotor(I13, I23, omega, k)


@pytest.mark.parametrize("distance", [1e-6, 1e-12, 1e-15])
def test_next_to_the_steady_states(rng, distance):
    """l, and its growth over many steps, keep their relative accuracy."""
    for _ in range(5):
        (I1, I2, I13, I23, k, eps), _ = random_problem(rng)
        parameters = I1, I2, I13, I23, k, 0.2 * eps
        along = rng.normal() * np.array([I23, -I13]) - k * np.array([I13, I23]) / (I13**2 + I23**2)
        omega = along * (1 + distance)
        states = exact_orbit(parameters, omega, 31)
        slope = sf.vector_field(sf.SuslovGyrostat(I1, I2, I13, I23, k), omega)
        assert error(slope, naive.vector_field(I1, I2, I13, I23, omega, k)) < 2e-15
        growth = rotor(parameters, states[31]) / rotor(parameters, states[1])
        first, last = (run(parameters, omega, n)._resume["state"][0, 0] for n in (1, 31))
        assert abs(float(last / first / growth) - 1) < 1e-10


@pytest.mark.parametrize(
    ("parameters", "omega", "steps"),
    [
        ((1.62, 2.44, 0.38, 0.26, 0.99, 7.646489055091985), [1.7, -2.97], 10),
        ((1.0, 2.0, 0.0, 1.0, 0.0, 1.0), [8 + 8e-12, 2.0], 3),
        ((2.3, 1.4, 0.5, -0.7, 0.0, 1e20), [1.1, -0.4], 2),
        ((2.3, 1.4, 0.5, -0.7, 1e6, 0.35), [1.1, -0.4], 1000),
    ],
)
def test_orbits_that_start_next_to_poles_or_take_long_steps(parameters, omega, steps):
    """Y_next is a quotient, in which large terms do not cancel."""
    exact = exact_orbit(parameters, omega, steps)[-1]
    assert naive.relative_error(run(parameters, omega, steps).final, exact) < 5e-14


def exact_reaction(parameters, omega):
    omega, following = naive.exactly(*omega), exact_step(parameters, omega)
    slope = naive.quotient(parameters[5], omega, following)
    return naive.reaction(*parameters[:4], omega, following, slope)


def of_body(parameters):
    I1, I2, I13, I23, k, _ = parameters
    return sf.SuslovGyrostat(I1, I2, I13, I23, k) if k else sf.Suslov3D(I1, I2, I13, I23)


@pytest.mark.parametrize("k", [0.0, 1.0, -30.0])
@pytest.mark.parametrize("Y", [1e3, -1e8, 1e20])
def test_derivative_and_reaction_far_from_the_steady_states(rng, k, Y):
    """Products of order Y**2 cancel to order Y in A(omega; eps)**-1 A(omega_next; -eps), and sums
    over next states in the reaction.
    """
    for I1, I2, I13, I23, eps in ((1.0, 1.0, 0.5, 0.0, 1.0), (2.0, 2.0, 0.25, 0.5, -0.5)):
        parameters = I1, I2, I13, I23, k, eps
        across = np.array([-I13, I23]) * Y / (I13**2 + I23**2) * [0, 1] + [0.5, 0]
        for omega in ([0.5, Y], [Y, 0.7], across):
            omega = np.array(omega)
            jacobian = sf.jacobian(of_body(parameters), omega, eps)
            exact = naive.derivative(partial(exact_step, parameters), omega)
            assert error(jacobian, exact) < 2e-15
            computed = sf.reaction(of_body(parameters), omega, eps)
            assert error(computed, exact_reaction(parameters, omega)) < 5e-15


@pytest.mark.parametrize("k", [1e-3, 0.9, -20.0])
def test_reaction(rng, k):
    for _ in range(15):
        (*body, _, eps), omega = random_problem(rng)
        state, slope = naive.exactly(*omega), naive.vector_field(*body, omega, k)
        exact = naive.reaction(*body, state, state, slope)
        assert abs(float(sf.reaction(sf.SuslovGyrostat(*body, k), omega) / exact - 1)) < 1e-13
        exact = exact_reaction((*body, k, eps), omega)
        assert abs(float(sf.reaction(sf.SuslovGyrostat(*body, k), omega, eps) / exact - 1)) < 1e-12


@pytest.mark.parametrize("gap", [1e-3, 1e-9, 1e-13, -1e-9])
def test_the_rotation_number_next_to_its_onset(gap):
    """A**2 and k**2 agree in most digits, and mu is their difference."""
    I1, I2, I13, I23 = parameters = 2.3, 1.4, 0.5, -0.7
    eps, omega = 0.35, [1.1, -0.4]
    onset = mpmath.findroot(lambda k: of_onset(*parameters, eps, omega, k) - 1, 0.9)
    k = float(onset) * (1 + gap)
    exact = rotation_number(*parameters, eps, omega, k)
    for sign in (1, -1):
        body = sf.SuslovGyrostat(I1, I2, sign * I13, sign * I23, sign * k)
        computed = sf.rotation_number(body, omega, eps)
        assert error(computed, sign * exact) < 1e-15
        assert sf.rotation_number(body, omega, -eps) == -computed


def test_the_rotation_number_counts_turns():
    """Turns of Omega in a long run, where abs(e) A < 1."""
    body = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, [1.8, -1.8, 3.0])
    omega, steps = [1.1, -0.4], 20000
    for eps in (0.35, -0.35):
        w = sf.iterate(body, omega, eps, steps).omega
        angle = np.unwrap(np.arctan2(np.sqrt(1.4) * w[..., 1], np.sqrt(2.3) * w[..., 0]), axis=0)
        turns = (angle[-1] - angle[0]) / (2 * np.pi * steps)
        number = sf.rotation_number(body, omega, eps)
        assert abs(turns - number).max() < 1 / steps
        assert (np.sign(number) == np.sign(body.k * eps)).all()
    assert sf.rotation_number(sf.Suslov3D(2.3, 1.4, 0.5, -0.7), [omega, [np.nan, 0]], 0.35)[0] == 0


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e150])
def test_steps_out_of_range_fail_with_a_status(scale):
    """Long steps are computed as they are, or fail; they are not replaced by shorter ones."""
    parameters = (
        8.398263621037692e-38, 8.398263621037692e-38, 4.337998088528932, 1.561520618688691e20,
        1.35615046914525e-68, 3.1561824957925115e30 * scale,
    )  # fmt: skip
    omega = [-1.3979326002487293e34, -150756675552641.88]
    result = run(parameters, omega, 1, on_singular="ignore")
    if result.status == sf.Status.NONFINITE:
        assert scale == 1e150
        assert result.failed_at == 1
        assert np.isnan(result.final).all()
    else:
        assert naive.relative_error(result.final, exact_step(parameters, omega)) < 1e-14


@pytest.mark.parametrize("k", [0.0, 0.3, 3.0])
@pytest.mark.parametrize("root", [1e3, 1e10, 1e40])
def test_steps_of_bodies_whose_moments_are_far_apart(k, root):
    """L and L_next cancel in omega_next, each component of which is accurate."""
    parameters, omega = (1 / root, root, 0.1, 0.2, k, 0.1), [1.0, 0.5]
    found = run(parameters, omega, 1, method="canonical").final
    for component, exact in zip(found, exact_step(parameters, omega), strict=True):
        assert naive.relative_error([component], [exact]) < 1e-15


@pytest.mark.parametrize("method", ["auto", "canonical"])
def test_a_body_out_of_range_has_no_next_state(method):
    body = 1e-80, 1e80, 0.1, 0.2, 0.3, 0.1
    result = run(body, [1, 0.5], 3, method=method, on_singular="ignore")
    assert result.status == sf.Status.NONFINITE
    assert result.failed_at == 1
    assert np.isnan(result.states[1:]).all()
    assert np.isnan(result.final).all()


def of_onset(I1, I2, I13, I23, eps, omega, k):
    """k**2 / A**2, for A**2 = 4 I1 I2 F (I13**2 / I1 + I23**2 / I2); 1 at the onset of turns."""
    A2 = 4 * naive.mpf(I1) * I2 * naive.level(I1, I2, I13, I23, eps, omega, k)
    return naive.mpf(k) ** 2 / A2


def state(parameters, omega, n):
    return sf.exact(sf.SuslovGyrostat(*parameters[:5]), omega, parameters[5], n)


def test_a_tail_beside_periodic_orbits():
    """A component that becomes 0 does so at the same step beside orbits of another kind."""
    n, omega = np.arange(720), [1.0, 0.8]
    both = sf.exact(sf.SuslovGyrostat(1, 1, 1, 0, [0.0, 3.0]), omega, 0.75, n)[:, 0]
    alone = sf.exact(sf.SuslovGyrostat(1, 1, 1, 0, 0.0), omega, 0.75, n)
    np.testing.assert_array_equal(both, alone)
    # Between multiples of 64, where powers are computed directly.
    assert (alone[:688, 0] != 0).all()
    assert (alone[688:, 0] == 0).all()


@pytest.mark.parametrize("gap", [0.0, 1e-15, -1e-12, 1e-8, -1e-4, 1e-2, -0.2])
@pytest.mark.parametrize("eps", [0.35, 20.0])
def test_next_to_the_parabolic_orbit(gap, eps):
    """|k| = A (1 + gap): orbits that take ever longer past the one steady state."""
    body, omega, k = (2.3, 1.4, 0.5, -0.7), [1.1, -0.4], 1.0
    for _ in range(60):  # A depends on k
        k /= float(mpmath.sqrt(of_onset(*body, eps, omega, k)))
    parameters = *body, k * (1 + gap), eps
    assert abs(of_onset(*body, eps, omega, parameters[4]) - 1) < 3 * abs(gap) + 1e-14
    exact = exact_orbit(parameters, omega, 200)
    moved = *body, parameters[4] * (1 + mpmath.mpf(10) ** -25), eps
    sensitivity = 1e25 * naive.worst_error(exact_orbit(moved, omega, 200), exact)
    found = state(parameters, omega, np.arange(201))
    assert naive.worst_error(found, exact) < 3e-16 * (10 + 3 * sensitivity)


@pytest.mark.parametrize("k", [0.0, 0.3, -2.0])
@pytest.mark.parametrize("eps", [3.0, -10.0, 1e3])
def test_closed_form_of_long_steps(rng, k, eps):
    """Beyond criticality, where Omega jumps, on both sides of |k| = A."""
    for _ in range(6):
        parameters = (*rng.uniform(1, 4, 2), *rng.uniform(-0.9, 0.9, 2), k, eps)
        omega = rng.uniform(-2, 2, 2)
        exact = exact_orbit(parameters, omega, 40)
        errors = map(naive.relative_error, state(parameters, omega, np.arange(41)), exact)
        assert np.quantile(list(errors), 0.9) < 3e-13
        auto = run(parameters, omega, 40, method="auto")
        assert naive.relative_error(auto.final, exact[-1]) < 1e-11


@pytest.mark.parametrize(
    ("parameters", "omega"),
    [
        ((2198.5430170585664, 0.35, 0.005855127778342371, 0.0, 0.0025005161246055988, -1.6e9),
         [-0.42706431341341494, -1.66e-7]),
        ((1.0, 1.0, 1.0, 0.0, 0.903013661327605, 0.5), [1.0, 0.0]),
        ((2.5, 0.96, 3.3e-13, 0.7, 11.338983442918682, -0.0136), [-1.7e-11, 16.279]),
        ((0.47, 0.58, -0.35, 0.0, -0.0420771362112688, -9.32), [0.1597, 0.0]),
    ],
)  # fmt: skip
def test_closed_form_where_squares_cancel(parameters, omega):
    """(K X)**2 is large, and a step turns by nearly a quarter, whose cosine is small; or |k| is
    next to A, at a steady state or where Y is 0.
    """
    body, n = sf.SuslovGyrostat(*parameters[:5]), [-1, 1, 2, 3, 4, 15]
    with mpmath.workdps(800):
        backward = exact_step((*parameters[:5], -parameters[5]), omega)
        exact = exact_orbit(parameters, omega, 15)
        expected = [backward, *(exact[j] for j in n[1:])]
        found = sf.exact(body, omega, parameters[5], n)
        for one, other in zip(found, expected, strict=True):
            assert naive.energy_error(parameters[:2], one, other) < 2e-15


@pytest.mark.parametrize("off", [-1, 2, 3000])
def test_state_1_where_large_terms_cancel(off):
    """Y and K X are large and nearly equal, and |k| is next to A."""
    d = 2.0**-15
    parameters, omega = (1.0, 1.0, 1.0, 0.0, 1.0, 2 / d), [d - 1, off * d * d - d - 1]
    row = run(parameters, omega, 100, method="auto").omega[1]
    backward = (*parameters[:5], -2 / d)
    for found in (row, state(parameters, omega, 1), state(backward, omega, -1)):
        assert naive.relative_error(found, exact_step(parameters, omega)) < 2e-16


@pytest.mark.parametrize("parameters", [(4.0, 6.0, -5.0, 0.3, -3.0, 1.4), (2.0, 1.0, 1e9, 0, 1, 2)])
def test_the_discrete_reaction_where_terms_of_the_rotor_cancel(parameters):
    """Next to a steady state with Omega2 = 0, I13 Omega1 + k is a small difference."""
    for off in (1e-14, 1e-9):
        omega = [-parameters[4] / parameters[2] * (1 + off), 0.0]
        computed = sf.reaction(of_body(parameters), omega, parameters[5])
        assert error(computed, exact_reaction(parameters, omega)) < 2e-15


@pytest.mark.parametrize("k", [0.4, 3.0])
def test_flow_is_the_limit_of_short_steps_and_a_group(k):
    body, omega = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, k), [1.1, -0.4]
    there = sf.flow(body, omega, 7.0)
    np.testing.assert_allclose(sf.flow(body, there, -7.0), omega, rtol=1e-13)
    np.testing.assert_allclose(sf.exact(body, omega, 1e-8, 7e8), there, rtol=1e-7)
    slope = (sf.flow(body, omega, 1e-5) - sf.flow(body, omega, -1e-5)) / 2e-5
    np.testing.assert_allclose(slope, sf.vector_field(body, omega), rtol=1e-9)


def test_limits_are_steady_states_of_the_orbit():
    omega, eps = np.array([1.1, -0.4]), 0.35
    body = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, [0.4, -0.4, 3.0, 0.4])
    omega = np.array([omega, omega, omega, [0.0, 0.0]])
    for limit, far in zip(sf.limits(body, omega, eps), (-(10**6), 10**6), strict=True):
        assert np.isnan(limit[2]).all()  # periodic
        assert (limit[3] == 0).all()
        assert abs(limit[:2] @ [0.5, -0.7] + [0.4, -0.4]).max() < 1e-15
        np.testing.assert_allclose(sf.exact(body, omega, eps, far)[:2], limit[:2], rtol=1e-14)
        F = sf.first_integral(body, omega, eps)[:2]
        two = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, [0.4, -0.4])
        np.testing.assert_allclose(sf.first_integral(two, limit[:2], eps), F, rtol=1e-14)


def turned(parameters, omega, n, flow=False):
    """State n of a periodic orbit, or the flow at time n eps: a rotation of half-angles."""
    I1, I2, I13, I23, k, eps = naive.exactly(*parameters)
    z = mpmath.mpc(mpmath.sqrt(I1) * omega[0], mpmath.sqrt(I2) * omega[1])
    g = mpmath.mpc(I13 / mpmath.sqrt(I1), I23 / mpmath.sqrt(I2))
    e = unit = eps / (2 * mpmath.sqrt(I1 * I2))
    if flow:
        e = mpmath.mpf(0)
    zeta = z / mpmath.mpc(1, -e * rotor(parameters, omega))
    A = abs(zeta * g)
    psi, m = mpmath.arg(zeta / g), mpmath.sqrt(k * k - A * A)
    angle = n * (unit * m if flow else mpmath.atan(e * m))
    p, q, c, s = mpmath.sin(psi / 2), mpmath.cos(psi / 2), mpmath.cos(angle), mpmath.sin(angle) / m
    p, q = c * p + s * (A + k) * q, c * q + s * (A - k) * p
    z = mpmath.mpc(1, -e * k) * mpmath.mpc(q, p) ** 2 - mpmath.mpc(0, e * A) * (p * p + q * q)
    z *= abs(zeta) * g / abs(g) / (p * p + q * q - 2 * e * A * p * q)
    return z.real / mpmath.sqrt(I1), z.imag / mpmath.sqrt(I2)


@pytest.mark.parametrize("k", [1.5, -3.0, 1e3, -1e6, 1e12])
def test_far_along_a_periodic_orbit(rng, k):
    """The phase keeps its digits, up to 1e15 steps."""
    with mpmath.workdps(80):
        for n in (3, 10**3, -(10**6), 10**9, -(10**15)):
            parameters = (*rng.uniform(1, 4, 2), *rng.uniform(-0.5, 0.5, 2), k, 0.3)
            body, omega = sf.SuslovGyrostat(*parameters[:5]), rng.uniform(-1, 1, 2)
            expected = turned(parameters, omega, n)
            assert naive.relative_error(sf.exact(body, omega, 0.3, n), expected) < 5e-15
            time, unit = n * 2.0**-20, (*parameters[:5], 1.0)
            if abs(k * time) < 1e15:
                expected = turned(unit, omega, mpmath.mpf(time), flow=True)
                assert naive.relative_error(sf.flow(body, omega, time), expected) < 5e-15
            if n == 3:
                assert naive.relative_error(exact_orbit(parameters, omega, n)[-1],
                                            turned(parameters, omega, n)) < 1e-15  # fmt: skip
    for states, steps in ((sf.exact, (0.3, 1e19)), (sf.flow, (1e19 / abs(k),))):
        with pytest.warns(RuntimeWarning, match="1 of 1 states"):
            assert np.isnan(states(body, omega, *steps)).all()


@pytest.mark.parametrize(
    ("parameters", "omega"),
    [
        ((1.0, 1.0, 1.0, 0.0, 0.0, 1.0), [1.0, -3.0]),
        ((0.375, 1.5, -0.5, -1.0, 0.5, 2.0), [-0.5, 0.5]),  # a pole where |e| A = 1
        ((7.0, 7.0, -1.0, 1.5, 2.5, 4.0), [2.0, 0.5]),  # the same, where |e| A is rounded
        ((120.75, 11.5, -1.5, 1.5, 0.0, 4.0), [3.5, 3.5]),  # X = 0 and Y = 1, which is rounded
        ((238.0, 17.0, -2.0, -2.0, -1.0, 4.0), [-4.0, 3.5]),
    ],
)
def test_singular_states(parameters, omega):
    body, eps = sf.SuslovGyrostat(*parameters[:5]), parameters[5]
    for method in ("auto", "canonical"):
        found = sf.iterate(body, omega, eps, 50, method=method, on_singular="ignore")
        assert (found.status, found.failed_at) == (sf.Status.SINGULAR, 1)
        assert np.isnan(found.states[1:]).all()
    with pytest.warns(sf.SingularStepWarning):
        assert np.isnan(sf.exact(body, omega, eps, 1)).all()


def test_states_beyond_t_1():
    body = sf.SuslovGyrostat(1, 1, 1, 0, 0.2)
    for omega, status in (([0.3, -9.0], "SUPERCRITICAL"), ([0.3, -1.0], "OK")):
        for method in ("auto", "canonical"):
            assert sf.iterate(body, omega, 1, 50, method=method).status == sf.Status[status]
    with pytest.warns(RuntimeWarning, match="no state between two steps"):
        assert np.isnan(sf.exact(body, [0.3, -9.0], 1, 2.5)).all()
    assert np.isfinite(sf.exact(body, [0.3, -1.0], 1, 2.5)).all()
