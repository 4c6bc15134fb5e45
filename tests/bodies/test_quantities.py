"""Quantities of states against the paper's equations in 60 digits."""

from functools import partial

import mpmath
import naive
import numpy as np
import pytest
from promises import ROWS
from samples import quantity
from systems import HENON_HEILES

import suslov_fast as sf


def exact_matrix(f, eps, x):
    """1 - (eps / 2) f'."""
    derivative = mpmath.matrix(naive.derivative(f, naive.exactly(*x)))
    return mpmath.eye(len(x)) - naive.mpf(eps) / 2 * derivative


def random_problem(rng, size=0.0):
    """Random parameters, step size and state, with t below and above 1."""
    parameters = (*rng.uniform(0.5, 4, 2), *rng.uniform(-0.5, 0.5, 2))
    return parameters, rng.uniform(-0.5, 0.5), rng.normal(size=2) * 10 ** rng.uniform(-size, size)


def exact_modified_energy(J, slope, eps, omega):
    """E**2 / (E + eps**2 f.Jf / 8)."""
    E = naive.energy_nd(J, omega)
    return E**2 / (E + naive.mpf(eps) ** 2 / 4 * naive.energy_nd(J, slope))


def modified_energy_in_3d(*problem, k):
    slope = naive.vector_field(*problem[:4], problem[5], k)
    return exact_modified_energy(problem[:2], slope, *problem[4:])


def momentum_in_3d(I1, I2, I13, I23, eps, omega, k):
    (w1, w2), (I1, I2) = naive.exactly(*omega), naive.exactly(I1, I2)
    return I1 * w1, I2 * w2, naive.rotor(I13, I23, omega, k)


def rotation_number(I1, I2, I13, I23, eps, omega, k):
    """Turns per step, where k**2 is above its value at the onset."""
    I1, I2, k = naive.exactly(I1, I2, k)
    square = k**2 - 4 * I1 * I2 * naive.level(I1, I2, I13, I23, eps, omega, k)
    e = eps / (2 * mpmath.sqrt(I1 * I2))
    return mpmath.atan(e * mpmath.sqrt(max(square, 0))) / mpmath.pi * mpmath.sign(k)


# Errors relative to the size of the exact numbers.
IN_3D = {
    "first_integral": (naive.first_integral, 2e-15),
    "modified_energy": (modified_energy_in_3d, 3e-15),
    "criticality": (naive.criticality, 3e-15),
    "invariant_density": (naive.invariant_density, 3e-15),
    "matrix": (naive.matrix, 1e-15),
    "rotation_number": (rotation_number, 1e-14),
    "energy": (lambda *p, k: naive.energy_nd(p[:2], p[5]), 5e-16),
    "to_xy": (lambda *p, k: naive.xy(*p[:4], p[5]), 1e-15),
    "__call__": (lambda *p, k: naive.vector_field(*p[:4], p[5], k), 1e-15),
    "momentum": (momentum_in_3d, 1e-15),
}


def error(computed, exact):
    """Error of a number, vector or matrix relative to its norm."""
    return naive.relative_error(np.ravel(computed), np.ravel(np.array(exact, object)))


@pytest.mark.sampled(23)  # all names, which change fastest
@pytest.mark.parametrize("name", IN_3D)
@pytest.mark.parametrize("k", [0.0, 1e-3, 0.9, -20.0])
@pytest.mark.parametrize("near", [False, True])
def test_quantities_in_three_dimensions(rng, name, k, near):
    """Quantities in 60 digits, also next to steady states, as far as rounded inputs decide them."""
    exact, tolerance = IN_3D[name]
    if k and name == "to_xy":
        return
    for _ in range(40):
        parameters, eps, omega = random_problem(rng, 2.0)
        products = np.array(parameters[2:])
        if near:
            omega = products[::-1] * [1, -1] - k * products / (products @ products)
            omega *= 1 + 1e-6 * rng.normal(size=2)
        arguments = (eps,) if ROWS[name].eps else ()
        computed = quantity(name)(sf.Suslov3D(*parameters, k), omega, *arguments)
        l = abs(float(naive.rotor(*products, omega, k)))
        condition = (abs(products * omega).sum() + abs(k)) / l
        assert error(computed, exact(*parameters, eps, omega, k=k)) < tolerance * condition


@pytest.mark.parametrize("m", [1, 2, 3, 7, 40])
def test_quantities_in_n_dimensions(rng, m):
    for _ in range(5):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        body, eps = sf.SuslovND(J=J, I=I), rng.uniform(-1, 1)
        assert error(body.energy(omega), naive.energy_nd(J, omega)) < 3e-15
        # f.Jf may be small beside its terms.
        exact = exact_modified_energy(J, naive.vector_field_nd(J, I, omega), eps, omega)
        assert error(sf.kahan.modified_energy(body, omega, eps), exact) < 1e-13
        exact = np.array(naive.vector_field_nd(J, I, omega), float)
        size = np.linalg.norm(I) * np.linalg.norm(omega) ** 2 / J.min()
        assert abs(body(omega) - exact).max() < 1e-15 * size
        if m < 7:
            A = exact_matrix(partial(naive.vector_field_nd, J, I), eps, omega)
            assert error(sf.kahan.matrix(body, omega, eps), A.tolist()) < 1e-15
    assert sf.kahan.modified_energy(body, np.zeros(m), 0.3) == 0


ALONG = [sf.SuslovND(J=[1.3, 2.1, 3.7], I=I) for I in np.diag([0.7, -1.3, 0.4])]


SOME_EQUAL = [
    ([2, 5, 2, 2, 2], [0, 0.75, 0, 0, 0]),
    ([2, 2, 3], [1, 2, 0]),
    ([5, 3, 3, 7], [1, 0, 0, 0]),
    ([5, 5, 5, 3, 3], [2, 0, 0, 0, 0]),
    # A distance from I has no sign, and an odd power.
    ([2, 2, 2, 2], [1, -2, 2, 4]),
    ([5, 5, 3, 3, 3], [0.5, -1, 0, 0, 0]),
    ([2, 2, 7, 7, 7, 7], [0, 0, 0, 1, 2, -1]),
]
EQUAL = [sf.SuslovND(J=J, I=I) for J, I in SOME_EQUAL]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("body", [sf.Suslov3D(4, 1, -0.5, -0.3), *ALONG, *EQUAL, HENON_HEILES])
def test_densities_are_those_of_invariant_measures(rng, body):
    """rho(next) det DPhi = rho."""
    omega, eps = rng.normal(size=(9, body.dimension)), rng.uniform(-1, 1, 9)
    before, after = (
        sf.kahan.invariant_density(body, w, eps) for w in (omega, sf.step(body, omega, eps))
    )
    det = np.linalg.det(sf.kahan.jacobian(body, omega, eps))
    ratio = after * det / before
    np.testing.assert_allclose(abs(ratio) if body in EQUAL[4:] else ratio, 1.0, rtol=1e-11)


def test_a_density_where_a_pivot_is_small():
    """For eps = 1 the matrix A is [[0, -1], [-1, 2]]; its determinant is 1 - 2 eps**2."""
    H = lambda x: 2 * x[0] * x[1] + x[1] ** 2 - x[0] ** 2  # noqa: E731
    field, eps = sf.Field.from_hamiltonian(H, 2), np.array([1, 1 - 2.0**-29, 0.5, -0.25])
    for some in (eps, eps[2:0:-1], eps[1]):
        density = sf.kahan.invariant_density(field, [0.25, -3.0], some)
        np.testing.assert_allclose(density, 1 / (1 - 2 * some**2), rtol=1e-15)


def test_quantities_of_special_states(body, unit):
    still = sf.Suslov3D(1, 2, 0, 0)
    assert body.energy([1, 0.5]) == 2.125
    assert body.criticality([0, 0], 0.2) == body.criticality([1, 2], 0) == 0
    assert still.criticality([1, 2], 1) == sf.kahan.modified_energy(body, [0, 0], 0.3) == 0
    assert sf.kahan.invariant_density(unit, [0.0, 1.0], 0.3) == np.inf
    assert sf.kahan.invariant_density(ALONG[0], [0.5, 1.0, -0.25], 0.0) == -4
    assert sf.kahan.invariant_density(ALONG[1], [0.0, 1.0, 0.5], 0.3) == np.inf
    assert (sf.kahan.jacobian(body, [1, 2], 0) == np.eye(2)).all()
    assert (sf.kahan.jacobian(still, [1, 2], 0.3) == np.eye(2)).all()
    far_apart = sf.SuslovND(J=[0.6, 1.2, 0.8], I=[-0.95, 0.0, 0.0])  # terms in A that cancel
    assert sf.kahan.matrix(far_apart, [-0.86, -1e-12, 7e-6], 6e8)[0, 0] == 1
    constant = sf.Field.from_terms(np.zeros((2, 2, 2)), constant=[1, 2])
    assert constant([[5.0, 6.0]]).tolist() == [[1, 2]]


def test_out_of_range_there_is_a_warning_and_no_number(body):
    huge = np.array([[1.0, 2.0], [1e200, 1.0]])
    for name, *eps in (("energy",), ("first_integral", 0.2), ("reaction", 0.2)):
        with pytest.warns(sf.IntegrationWarning, match=r"1 of 2 states.*first: 1"):
            found = getattr(body, name)(huge, *eps)
        assert np.isnan(found[1]).all()
        assert np.isfinite(found[0]).all()
    still = sf.SuslovND(J=[2.0, 2.0, 2.0], I=[0.5, -0.75, 0.25])
    small = np.array([[1.0, 0.5, 2.0], [1e-200, 0.5e-200, 2e-200]])
    slow, slower = still.criticality(small, 1e-30)
    assert abs(slower / slow / 1e-200 - 1) < 1e-15
    for size in (1e20, 1e180, 1e300):  # where eps ell is large: |g| |z| / |ell|
        t = sf.Suslov3D(1, 1, 1, 1).criticality([size, 0.0], 1e3)
        assert abs(t / 2**0.5 - 1) < 1e-15


def test_criticality_agrees_with_the_status(unit, rng):
    """Criticality and status agree, also next to t = 1, where |y| = 2 I1 I2 / |eps|."""
    x, y = np.meshgrid([0, 1e-9, 1e-3, 1, 1e6], [2 - 2e-15, 2 - 2.4e-16, 2, 2 + 4.6e-16, 2 + 2e-15])
    omega = np.stack([x, y], axis=-1)
    for eps in (1, -1):
        t = eps * unit.criticality(omega, eps)
        assert ((t >= 1) == (y >= 2)).all()
        assert (abs(t - 1) < 4e-15).all()
        status = sf.iterate(unit, omega, eps, 0).status
        assert ((t >= 1) == (status == sf.Status.SUPERCRITICAL)).all()
    # States at t = 1 to rounding: there the formula of t is often on the other side of 1.
    I1, I2, I13, I23 = *rng.uniform(1, 4, (2, 300)), *rng.uniform(-0.9, 0.9, (2, 300))
    bodies, near = sf.Suslov3D(I1, I2, I13, I23), rng.normal(size=(300, 2))
    squares = I1 * near[:, 0] ** 2 + I2 * near[:, 1] ** 2
    x = I13 * near[:, 0] + I23 * near[:, 1]
    rest = squares * (I13**2 / I1 + I23**2 / I2) - x**2
    near *= np.sqrt(4 * I1 * I2 / rest)[:, np.newaxis]
    t = bodies.criticality(near, 1.0)
    assert (abs(t - 1) < 3e-15).all()
    status = sf.iterate(bodies, near, 1.0, 0).status
    assert ((t >= 1) == (status == sf.Status.SUPERCRITICAL)).all()
    gyrostat, states = sf.Suslov3D(2.3, 1.4, 0.5, -0.7, [0.05, 3.0]), omega.reshape(-1, 1, 2)
    status = sf.iterate(gyrostat, states, 0.7, 0).status
    is_large = abs(gyrostat.criticality(states, 0.7)) >= 1
    assert ((status == sf.Status.SUPERCRITICAL) == is_large).all()
    identity = sf.Suslov3D(1, 1, 0, 0)
    assert not sf.iterate(identity, omega * 1e9, 1, 0).status.any()


def test_closed_form(rng, unit):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        h, k1, k2, t = sf.Suslov3D(*parameters).closed_form(omega, eps)
        assert t == sf.Suslov3D(*parameters).criticality(omega, eps)
        exact = naive.closed_form(*parameters, eps, omega)
        assert abs(h / exact[0] - 1) < 5e-15
        if abs(t) < 1:
            assert abs(k1 / exact[1] - 1) < 1e-14
            assert abs(k2 - exact[2]) < 1e-14 * (1 + abs(k2))
        else:
            assert np.isnan([k1, k2]).all()
    found = unit.closed_form([1.0, -0.5], 0.0)  # x = 1, y = 1/2: the flow
    expected = 0.3125, -2 * 0.3125**0.5, np.arctanh(0.5 / (2 * 0.3125**0.5)), 0
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    k2 = unit.closed_form([[0.0, -1.0], [0.0, 1.0], [0.0, 0.0], [np.nan, 1.0]], 0.5).k2
    np.testing.assert_array_equal(k2, [np.inf, -np.inf, 0, np.nan])
    assert sf.Suslov3D(1, 2, 0, 0).closed_form([1.0, 2.0], 0.5) == (0, 0, 0, 0)


@pytest.mark.parametrize("m", [2, 3, 5])
@pytest.mark.parametrize("eps", [None, 1e-12, 0.3])
def test_reaction_in_n_dimensions(rng, m, eps):
    """The discrete one loses no digits as eps tends to 0."""
    for _ in range(5):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        state = after = naive.exactly(*omega)
        slope = naive.vector_field_nd(J, I, omega)
        if eps:
            after = naive.step_nd(J, I, eps, state)
            slope = naive.quotient(eps, state, after)
        exact = np.array(naive.reaction_nd(J, I, state, after, slope), float)
        computed = sf.SuslovND(J=J, I=I).reaction(omega, eps)
        np.testing.assert_allclose(computed, exact, atol=3e-14 * (1 + np.linalg.norm(exact)))
        assert (computed == -computed.T).all()


def discrete_reaction(parameters, eps, omega, k):
    """Return the reaction along a step, and the next state."""
    state = naive.exactly(*omega)
    following = naive.step(*parameters, eps, state, k)
    slope = naive.quotient(eps, state, following)
    return float(naive.reaction(*parameters, state, following, slope)), following


@pytest.mark.parametrize("k", [0.0, 0.9])
def test_reaction(rng, k):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        body, state = sf.Suslov3D(*parameters, k), naive.exactly(*omega)
        slope = naive.vector_field(*parameters, omega, k)
        exact = float(naive.reaction(*parameters, state, state, slope))
        size = max(parameters[:2]) * np.hypot(*omega) ** 2 + k * np.hypot(*omega)
        assert abs(body.reaction(omega) - exact) < 2e-15 * size
        assert body.reaction(omega, 1e-12) == pytest.approx(exact, abs=1e-10)
        exact, following = discrete_reaction(parameters, eps, omega, k)
        size = max(size, max(parameters[:2]) * float(naive.mpmath.norm(following)) ** 2)
        assert abs(body.reaction(omega, eps) - exact) < 1e-14 * size


def test_reaction_of_large_states(rng):
    """Relative to the value, also where products of a large and a small component cancel."""
    assert sf.Suslov3D(1, 1, 0, 1).reaction([2e8, 0.7], 1.0) == pytest.approx(
        -1.400000015715, rel=1e-14
    )
    for _ in range(40):
        parameters, *_ = random_problem(rng)
        eps, omega = 10 ** rng.uniform(-3, 0.5), rng.normal(size=2) * 10 ** rng.uniform(-3, 8, 2)
        exact, _ = discrete_reaction(parameters, eps, omega, 0.9)
        value = sf.Suslov3D(*parameters, 0.9).reaction(omega, eps)
        assert value == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("k", [0.0, 0.9, -20.0])
def test_jacobian(rng, k):
    """Against differences in 60 digits, to 3e-15 times the condition of A."""
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        omega *= 10 ** rng.uniform(-2, 3)
        exact = naive.derivative(partial(naive.step, *parameters, eps, k=k), omega)
        body = sf.Suslov3D(*parameters, k)
        condition = np.linalg.cond(sf.kahan.matrix(body, omega, eps))
        assert error(sf.kahan.jacobian(body, omega, eps), exact) < 3e-15 * condition


@pytest.mark.parametrize("name", ["jacobian", "reaction"])
@pytest.mark.parametrize("m", [2, 4])
def test_poles_are_counted(rng, name, m):
    body = sf.Suslov3D(1, 1, 1, 0) if m == 2 else sf.SuslovND(J=[2, 2, 2, 3], I=[1, 0, 0.5, 0.25])
    omega = 0.1 * rng.normal(size=(4, 400, m))
    omega[2, 17] = omega[2, 399] = omega[3, 5] = [1.0, -3.0] if m == 2 else [2, 1, 3, 2]
    omega[2, 16, 0] = np.nan
    with pytest.warns(sf.IntegrationWarning, match=r"^3 of 1600 .*first: \(2, 17\)") as caught:
        values = quantity(name)(body, omega, 1.0)
    assert len(caught) == 1
    missing = np.isnan(values.reshape(4, 400, -1)).all(axis=-1)
    assert np.argwhere(missing).tolist() == [[2, 16], [2, 17], [2, 399], [3, 5]]


# ------------------------------------------------------------- momenta as vectors and matrices
def test_momentum_by_definition(rng):
    for n in (2, 3, 5):
        root = rng.normal(size=(n, n))
        mass = root @ root.T
        axis = rng.normal(size=n)
        axis /= np.linalg.norm(axis)
        body = sf.SuslovND.from_mass_tensor(mass, axis)
        rotation = body.rotation
        v = rng.normal(size=n)
        Omega = np.outer(v, axis) - np.outer(axis, v)
        state = (rotation @ Omega @ rotation.T)[:-1, -1]
        M = mass @ Omega + Omega @ mass
        in_body = rotation @ M @ rotation.T
        np.testing.assert_allclose(body.momentum(state), in_body, atol=1e-12)
        np.testing.assert_allclose(body.energy(state), -np.trace(M @ Omega) / 4, rtol=1e-12)


def test_momenta_in_space(case):
    body, omega0 = case
    run = sf.iterate(body, [omega0, np.negative(omega0)], 0.1, 20, attitude=True)
    R = run.attitude
    Rt = R.swapaxes(-2, -1)
    vector = len(omega0) == 2
    v = body.momentum(run.states)
    expected = (R @ v[..., None])[..., 0] if vector else R @ v @ Rt
    np.testing.assert_allclose(body.momentum(run.states, attitude=R), expected, atol=1e-13)


# --------------------------------------------------------------------------- scattering angles
def angle_by_formula(I1, I2, I13, I23):
    """Return the angle by the formula of the docstring in 60 digits, and alpha + beta + |gamma|."""
    I1, I2, I13, I23 = naive.exactly(I1, I2, I13, I23)
    D, k = I13**2 * I2 + I23**2 * I1, mpmath.hypot(I13, I23)
    alpha, beta = I1 * I2 * k / D, mpmath.sqrt(I1 * I2) / k
    gamma = beta * I13 * I23 * (I2 - I1) / D
    kappa = mpmath.sqrt((alpha - 1j * gamma) ** 2 - beta**2)
    c, half = mpmath.cosh(mpmath.pi * kappa / 2), mpmath.pi * alpha / 2
    square = (mpmath.re(c) / mpmath.cosh(half)) ** 2 + (mpmath.im(c) / mpmath.sinh(half)) ** 2
    return 2 * mpmath.asin(mpmath.sqrt(square)), float(alpha + beta + abs(gamma))


@pytest.mark.parametrize("parameters", [(4, 1, -0.5, -0.3), (4, 2, 0, -1.2), (2, 2, 1.5, -2.5)])
def test_discrete_scattering_angles_tend_to_that_of_the_flow_with_order_2(parameters):
    """Runs from next to the repelling half to next to the attracting one."""
    body, angles = sf.Suslov3D(*parameters), []
    middle = [1.0, 0.0] @ np.linalg.inv(body.to_xy(np.eye(2)))
    time = 22 / abs(body.closed_form(middle, 0.0).k1)
    start = sf.flow(body, middle, time=-time).states[0]
    for steps in (2000, 4000):
        run = sf.iterate(body, start, 2 * time / steps, steps, attitude=True)
        first, last = (
            R[:, :2] @ x for R, x in zip(run.attitude[[0, -1]], run.states[[0, -1]], strict=True)
        )
        angles.append(np.arctan2(np.linalg.norm(np.cross(first, last)), first @ last))
    expected = body.scattering_angle()
    coarse, fine = np.subtract(angles, expected)
    assert abs(np.log2(coarse / fine) - 2) < 0.01
    assert abs((4 * angles[1] - angles[0]) / 3 - expected) < 1e-7


def test_scattering_angles_to_rounding(rng):
    signs = np.ones((4, 60))
    signs[2:] = rng.choice([-1, 0, 1], (2, 60))
    parameters = signs * 10 ** rng.uniform(-3, 3, (4, 60))
    angles = sf.Suslov3D(*parameters).scattering_angle()
    assert (np.isnan(angles) == ~parameters[2:].any(axis=0)).all()
    for each, angle in zip(parameters.T, angles, strict=True):
        if each[2:].any():
            expected, size = angle_by_formula(*each)
            bound = 1e-15 * (1 + size) ** 2 * expected if size < 300 else 2e-15 * size
            assert abs(naive.mpf(angle) - expected) <= bound
