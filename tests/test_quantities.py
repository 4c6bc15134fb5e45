"""Quantities of states against the paper's equations in 60 digits."""

from functools import partial

import mpmath
import naive
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import evaluation as engine


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
    turns = mpmath.atan(e * mpmath.sqrt(max(square, 0))) / mpmath.pi
    return turns * mpmath.sign(k)


# Errors relative to the size of the exact numbers.
IN_3D = {
    "first_integral": (naive.first_integral, 2e-15),
    "modified_energy": (modified_energy_in_3d, 3e-15),
    "criticality": (naive.criticality, 3e-15),
    "invariant_density": (naive.invariant_density, 3e-15),
    "matrix": (naive.matrix, 1e-15),
    "rotation_number": (rotation_number, 1e-15),
    "energy": (lambda *p, k: naive.energy_nd(p[:2], p[5]), 5e-16),
    "to_xy": (lambda *p, k: naive.xy(*p[:4], p[5]), 1e-15),
    "vector_field": (lambda *p, k: naive.vector_field(*p[:4], p[5], k), 1e-15),
    "momentum": (momentum_in_3d, 1e-15),
}
WITHOUT_STEP = {"energy", "to_xy", "vector_field", "momentum"}


def error(computed, exact):
    """Error of a number, vector or matrix relative to its norm."""
    return naive.relative_error(np.ravel(computed), np.ravel(np.array(exact, object)))


@pytest.mark.parametrize("name", IN_3D)
@pytest.mark.parametrize("k", [0.0, 1e-3, 0.9, -20.0])
@pytest.mark.parametrize("near", [False, True])
def test_in_three_dimensions(rng, name, k, near):
    """Quantities in 60 digits, also next to the steady states, where l is a small difference."""
    exact, tolerance = IN_3D[name]
    if k and name == "to_xy":
        return
    for _ in range(40):
        parameters, eps, omega = random_problem(rng, 2.0)
        if near and name != "matrix":
            products = np.array(parameters[2:])
            omega = products[::-1] * [1, -1] - k * products / (products @ products)
            omega *= 1 + 1e-12 * rng.normal(size=2)
            eps = 1e7 * eps if name == "first_integral" else eps
        arguments = () if name in WITHOUT_STEP else (eps,)
        body = sf.SuslovGyrostat(*parameters, k) if k else sf.Suslov3D(*parameters)
        computed = getattr(sf, name)(body, omega, *arguments)
        expected = exact(*parameters, eps, omega, k=k)
        assert error(computed, expected) < tolerance
        if name == "to_xy":
            assert abs(computed[0] / expected[0] - 1) < 3e-16


@pytest.mark.parametrize("m", [1, 2, 3, 7, 40])
def test_in_n_dimensions(rng, m):
    for _ in range(5):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        body, eps = sf.SuslovND(J, I), rng.uniform(-1, 1)
        assert error(sf.energy(body, omega), naive.energy_nd(J, omega)) < 3e-15
        # f.Jf may be small beside its terms.
        exact = exact_modified_energy(J, naive.vector_field_nd(J, I, omega), eps, omega)
        assert error(sf.modified_energy(body, omega, eps), exact) < 1e-13
        exact = np.array(naive.vector_field_nd(J, I, omega), float)
        size = np.linalg.norm(I) * np.linalg.norm(omega) ** 2 / J.min()
        assert abs(sf.vector_field(body, omega) - exact).max() < 5e-16 * size
        if m < 7:
            assert error(sf.matrix(body, omega, eps), matrix_nd(J, I, eps, omega)) < 1e-15
            exact = naive.derivative(partial(naive.step_nd, J, I, 0.2 * eps), omega)
            assert error(sf.jacobian(body, omega, 0.2 * eps), exact) < 1e-13
    assert sf.modified_energy(body, np.zeros(m), 0.3) == 0


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_measures_of_bodies_along_an_axis(rng, axis):
    """rho(next) det DPhi = rho in 60 digits; its sign, its poles, and eps = 0."""
    I = np.zeros(3)
    for _ in range(5):
        J, omega, eps = rng.uniform(0.5, 4, 3), rng.normal(size=3), rng.uniform(-1, 1)
        I[axis] = rng.normal()
        found = [sf.invariant_density(sf.SuslovND(J, I), omega, eps)]
        following = naive.step_nd(J, I, eps, naive.exactly(*omega))
        derivative = naive.derivative(partial(naive.step_nd, J, I, eps), omega)
        det = mpmath.det(mpmath.matrix(derivative))
        exact = [density_along(J, I, eps, v) for v in (naive.exactly(*omega), following)]
        assert abs(exact[1] * det - exact[0]) < 1e-35 * abs(exact[0])
        assert error(found, exact[:1]) < 1e-14 / min(1, abs(exact[0]))
    rest = np.roll([0.5, 1.0, -0.25], axis)
    assert sf.invariant_density(sf.SuslovND(J, I), rest, 0.0) == -4
    rest[axis - 1] = 0.0
    assert sf.invariant_density(sf.SuslovND(J, I), rest, 0.3) == np.inf


def density_along(J, I, eps, omega):
    (a,) = np.flatnonzero(I)
    b, c = (k for k in range(3) if k != a)
    eps, (Ja, Jb, Jc), (u, v, w) = mpmath.mpf(eps), J[[a, b, c]], (omega[k] for k in (a, b, c))
    part = (Ja * u**2 - (mpmath.mpf(Jc) - Jb) * (v**2 - w**2)) / (4 * mpmath.mpf(Ja) * Jb * Jc)
    return 1 / (v * w * (1 - (eps * I[a]) ** 2 * part))


def test_bodies_with_a_measure():
    axes, omega = [[0, 0.5, 0], [0.1, 0.5, 0]], [0.3, 0.9, -0.6]
    with pytest.raises(sf.NotIntegrableError, match=r"^invariant_density: .* body 1 is not"):
        sf.invariant_density(sf.SuslovND([1, 2, 3], axes), omega, 0.1)
    with pytest.raises(sf.NotIntegrableError, match=r"body 0 is not.*use jacobian"):
        sf.invariant_density(sf.SuslovND([1, 2, 3, 4], [0, 0, 1, 0]), [*omega, 1], 0.1)


def test_the_vector_field_where_components_are_far_apart():
    """The terms of p and |omega|**2 of a component cancel in its own equation."""
    problem = [1e-15, 1e15, 1.0], [1e-12, 1e3, 2.0], [1e20, 1e-10, 3.0]
    found = sf.vector_field(sf.SuslovND(*problem[:2]), problem[2])
    exact = np.array(naive.vector_field_nd(*problem), float)
    np.testing.assert_allclose(found, exact, rtol=2e-15)


def matrix_nd(J, I, eps, omega):
    """Coefficients of the unknowns in equation (15), divided by J."""
    J, I, omega, (eps,) = (naive.exactly(*v) for v in (J, I, omega, [eps]))
    slope = naive.derivative(lambda v: naive.dsn(J, I, eps, omega, v), omega)  # affine
    return [[entry / J_i for entry in row] for J_i, row in zip(J, slope, strict=True)]


def test_the_diagonal_of_the_matrix_for_long_steps():
    """The terms of component i in A_ii cancel exactly."""
    body = sf.SuslovND([0.6, 1.2, 0.8], [-0.95, 0.0, 0.0])
    assert sf.matrix(body, [-0.86, -1e-12, 7e-6], 6e8)[0, 0] == 1


def test_three_dimensions_and_n_agree(rng):
    for _ in range(20):
        (I1, I2, I13, I23), eps, omega = random_problem(rng)
        three, nd = sf.Suslov3D(I1, I2, I13, I23), sf.SuslovND([I1, I2], [I23, -I13])
        for function in (sf.first_integral, sf.criticality, sf.invariant_density):
            assert function(nd, omega, eps) == function(three, omega, eps)


def test_special_cases(body, unit):
    still = sf.Suslov3D(1, 2, 0, 0)
    assert sf.energy(body, [1, 0.5]) == 2.125
    assert sf.criticality(body, [0, 0], 0.2) == sf.criticality(body, [1, 2], 0) == 0
    assert sf.criticality(still, [1, 2], 1) == sf.modified_energy(body, [0, 0], 0.3) == 0
    assert sf.invariant_density(unit, [0.0, 1.0], 0.3) == np.inf
    np.testing.assert_allclose(sf.first_integral(body, [1, 0.5], 1e-9), 4.25 / 16, rtol=1e-15)
    assert (sf.vector_field(sf.Suslov3D(4, 1, -0.5, -0.25), [[0.375, -0.75], [0, 0]]) == 0).all()
    slow = sf.Suslov3D(1e300, 2e300, 1e-300, 1e-300)
    fast = sf.Suslov3D(1e-300, 2e-300, 1e300, 1e300)
    assert (sf.vector_field(slow, [1e-300, 1e-300]) == 0).all()
    assert sf.vector_field(fast, [1e300, 1e300]).tolist() == [-np.inf, np.inf]
    # Squares of eps omega are in range up to 1e100.
    assert abs(sf.first_integral(unit, [1e200, 1e200], 1e-110) / 2e220 - 1) < 1e-14
    assert abs(sf.modified_energy(unit, [1e200, 1e200], 1e-110) / 4e220 - 1) < 1e-14


def test_coordinates(rng):
    for _ in range(20):
        parameters, _, omega = random_problem(rng, 1.0)
        body = sf.Suslov3D(*parameters)
        np.testing.assert_allclose(sf.from_xy(body, sf.to_xy(body, omega)), omega, rtol=1e-13)
    assert sf.to_xy(body, [0, 0]).tolist() == sf.from_xy(body, [0, 0]).tolist() == [0, 0]
    np.testing.assert_allclose(sf.from_xy(body, [0, 1e-300]), sf.from_xy(body, [0, 1]) * 1e-300)


def test_integrals_of_solved_bodies_in_n_dimensions(rng):
    """F and t are constant along orbits if all J are equal or I is along one axis."""
    for J, I in (([2.0] * 4, [0.3, -0.4, 0.2, 0.1]), ([1.5, 1.5, 1.5, 4.0], [0, 0, 0, -0.7])):
        body = sf.SuslovND(J, I)
        omega = rng.normal(size=(5, 4))
        states = np.array([naive.orbit_nd(J, I, 0.2, w, 10) for w in omega], float).swapaxes(0, 1)
        for function in (sf.first_integral, sf.criticality):
            values = function(body, states, 0.2)
            assert values.shape == (11, 5)
            np.testing.assert_allclose(values, np.broadcast_to(values[0], (11, 5)), rtol=1e-13)


def test_criticality_agrees_with_the_status(unit):
    """Criticality and status agree, also next to t = 1, where |y| = 2 I1 I2 / |eps|."""
    x, y = np.meshgrid([0, 1e-9, 1e-3, 1, 1e6], [2 - 2e-15, 2 - 2.4e-16, 2, 2 + 4.6e-16, 2 + 2e-15])
    omega = np.stack([x, y], axis=-1)
    for eps in (1, -1):
        t = eps * sf.criticality(unit, omega, eps)
        assert ((t >= 1) == (y >= 2)).all()
        status = sf.iterate(unit, omega, eps, 0).status
        assert ((t >= 1) == (status == sf.Status.SUPERCRITICAL)).all()
        assert (t > 0).all()


@pytest.mark.parametrize("name", [*IN_3D, "jacobian", "reaction"])
def test_out_of_range_there_is_a_warning_and_no_number(name):
    """Moments, products or step sizes so far apart that squares may be out of range."""
    function = getattr(sf, name)
    eps = () if name in WITHOUT_STEP else (1.0,)
    calls = [
        (sf.Suslov3D(1e-120, 1e120, 0.5, 0.5), *eps),
        (sf.Suslov3D(2, 3, 1e-300, 0.5), *eps),
        *([(sf.Suslov3D(2, 3, 0.5, 0.5), 1e200)] if eps else []),
    ]
    for body, *eps in calls:
        if name in ("energy", "momentum"):  # need no square of a product
            assert sf.energy(body, [0.0, 2.0]) == sf.momentum(body, [0.0, 2.0])[1] == 2 * body.I2
            continue
        with pytest.warns(sf.SingularStepWarning, match="1 of 1 states"):
            assert np.isnan(function(body, [1.0, 2.0], *eps)).all()


def test_closed_form(rng):
    for _ in range(100):
        parameters, eps, omega = random_problem(rng)
        h, k1, k2, t = sf.closed_form(sf.Suslov3D(*parameters), omega, eps)
        assert t == sf.criticality(sf.Suslov3D(*parameters), omega, eps)
        exact = naive.closed_form(*parameters, eps, omega)
        assert abs(h / exact[0] - 1) < 5e-15
        if abs(t) < 1:
            assert abs(k1 / exact[1] - 1) < 1e-14
            assert abs(k2 - exact[2]) < 1e-14 * (1 + abs(k2))
        else:
            assert np.isnan([k1, k2]).all()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("gap", [1e-6, 1e-12, 1e-15, 3e-16])
def test_closed_form_next_to_the_critical_line(gap, sign):
    """k1 depends on digits of 1 - |Y| that the rounded Y of this body has lost."""
    body = sf.Suslov3D(1.7, 2.3, 0.3, -0.7)
    omega = sf.from_xy(body, [1e-3, sign * 2 * 1.7 * 2.3 / 0.3 * (1 - gap)])
    exact = naive.closed_form(*body.parameters, 0.3, omega)
    computed = sf.closed_form(body, omega, 0.3)[:3]
    assert all(abs(c / e - 1) < 2e-15 for c, e in zip(computed, exact, strict=True))


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


@pytest.mark.parametrize("k", [-600, 0, 600])
def test_reaction(rng, k):
    """The terms differ by many orders if products of inertia and moments have different units."""
    for _ in range(15):
        (I1, I2, I13, I23), eps, omega = random_problem(rng)
        parameters, omega = (I1, I2, *np.ldexp([I13, I23], k)), np.ldexp(omega, -k // 2)
        body, state = sf.Suslov3D(*parameters), naive.exactly(*omega)
        slope = naive.vector_field(*parameters, omega)
        exact = naive.reaction(*parameters, state, state, slope)
        if k:
            assert abs(float(sf.reaction(body, omega) / exact - 1)) < 3e-14
            continue
        size = max(parameters[:2]) * np.hypot(*omega) ** 2
        assert abs(sf.reaction(body, omega) - float(exact)) < 2e-15 * size

        following = naive.step(*parameters, eps, state)
        slope = naive.quotient(eps, state, following)
        exact = float(naive.reaction(*parameters, state, following, slope))
        size = max(size, max(parameters[:2]) * float(naive.mpmath.norm(following)) ** 2)
        assert abs(sf.reaction(body, omega, eps) - exact) < 1e-14 * size


@pytest.mark.parametrize("m", [2, 3, 5])
def test_continuous_reaction_in_n_dimensions(rng, m):
    for k in range(6):
        J, I, omega = rng.uniform(0.5, 4, m), rng.normal(size=m), rng.normal(size=m)
        if k == 5:  # terms with |omega|**2 cancel
            J[:], I[-1], omega[-1] = 1.3, 0.0, 1e6
        state, slope = naive.exactly(*omega), naive.vector_field_nd(J, I, omega)
        exact = np.array(naive.reaction_nd(J, I, state, state, slope), float)
        computed = sf.reaction(sf.SuslovND(J, I), omega)
        np.testing.assert_allclose(computed, exact, atol=1e-14 * (1 + np.linalg.norm(exact)))
        assert (computed == -computed.T).all()


def test_the_discrete_reaction_tends_to_the_continuous_one(body):
    """No digits are lost as eps tends to 0."""
    continuous = sf.reaction(body, [1.0, 0.5])
    for eps in (1e-6, 1e-12, 1e-300, 0.0):
        assert abs(sf.reaction(body, [1.0, 0.5], eps) - continuous) < 2 * eps + 1e-15


@pytest.mark.parametrize("k", [0.0, 0.9, -20.0])
def test_jacobian(rng, k):
    for _ in range(30):
        parameters, eps, omega = random_problem(rng)
        omega *= 10 ** rng.uniform(-2, 3)
        exact = naive.derivative(partial(naive.step, *parameters, eps, k=k), omega)
        body = sf.SuslovGyrostat(*parameters, k) if k else sf.Suslov3D(*parameters)
        # The step has the same loss of digits: |1 - Y + X**2| may be small beside its terms.
        following = naive.step(*parameters, eps, omega, k)
        allowed = 1e-14 + 10 * naive.relative_error(sf.step(body, omega, eps), following)
        assert error(sf.jacobian(body, omega, eps), exact) < allowed


@pytest.mark.parametrize(
    ("omega", "eps", "tolerance"),
    # X = eps Omega1 / sqrt(2), Y = -eps Omega2 / 2: the distance from the pole is 2 g.
    [((sign * np.sqrt(2 * g), -eps * 2 * (1 - g)), eps, 2e-15)
     for g in (1e-3, 1e-6, 1e-9, 1e-12, 1e-15) for eps in (1.0, -1.0) for sign in (1, -1)]
    + [(omega, 1.0, 1e-14) for omega in ((1e6, 3.0), (1e3, -1e9), (3e4, 5e8), (1e8, 1e8))],
)  # fmt: skip
def test_jacobian_next_to_the_pole_and_far_beyond(unit, omega, eps, tolerance):
    exact = naive.derivative(partial(naive.step, 1, 1, 1, 0, eps), omega, 30)
    assert error(sf.jacobian(unit, omega, eps), exact) < tolerance


def test_jacobian_of_small_steps_is_the_identity_and_the_derivative_of_the_field(rng):
    """The off-diagonal entries keep their relative accuracy."""
    for _ in range(10):
        parameters, _, omega = random_problem(rng)
        slope = naive.derivative(partial(naive.vector_field, *parameters), omega)
        slope = np.array(slope, float) * (1 - np.eye(2))
        computed = sf.jacobian(sf.Suslov3D(*parameters), omega, 1e-12)
        np.testing.assert_allclose((computed - np.eye(2) * computed) / 1e-12, slope, rtol=1e-8)
    assert (sf.jacobian(sf.Suslov3D(2, 1, 0.3, 0.2), [1, 2], 0) == np.eye(2)).all()
    assert (sf.jacobian(sf.Suslov3D(2, 1, 0, 0), [1, 2], 0.3) == np.eye(2)).all()


def test_jacobian_and_step_agree_on_poles(unit):
    """Consecutive floats through the pole at (1, -3), and states next to (0, -2)."""
    omega2 = -3.0 + 2.0**-51 * np.arange(-10, 11)
    near = [[1, w2] for w2 in omega2] + [[1e-9, -2], [1e-7, -2], [0, -2], [0, -1.9]]
    with pytest.warns(sf.SingularStepWarning):
        computed, following = sf.jacobian(unit, near, 1.0), sf.step(unit, near, 1.0)
    assert (np.isnan(computed[:, 0, 0]) == np.isnan(following[:, 0])).all()


LORENZ = sf.QuadraticField.from_function(
    lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]), 3
)
FOCUS = [72**0.5, 72**0.5, 27.0]


@pytest.mark.parametrize(
    ("body", "x", "eps", "dtype"),
    [
        (sf.Suslov3D(4, 1, -0.5, -0.3), [0.6, -1.0], 0.2, float),
        (sf.Suslov3D(4, 1, -0.5, [-0.3, -0.25]), [[0.6, -1.0], [-0.5, 1.0]], -0.2, float),
        (sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]), [-0.8, 1.4, -1.0], [[0.2], [0.4]], float),
        (sf.SuslovND([1.3, 2.1, 3.7, 4.0], [0, -0.7, 0.5, 0.0]), [0, 1.4, -1.0, 0], 0.4, float),
        (sf.SuslovGyrostat(2, 1, 0.5, -0.5, 0.25), [0.5, 1.0], 0.35, complex),
        (sf.SuslovGyrostat(2, 1, 0.5, -0.5, [0.25, -0.25]), [0.0, 0.0], 0.35, complex),
        (LORENZ, [FOCUS, [0.0, 0.0, 0.0]], 1 / 64, complex),
    ],
)
def test_multipliers_are_eigenvalues_of_the_jacobian(body, x, eps, dtype):
    computed = sf.multipliers(body, x, eps)
    derivatives = sf.jacobian(body, x, eps)
    assert computed.dtype == dtype
    assert computed.shape == derivatives.shape[:-1]
    for found, derivative in zip(
        computed.reshape(-1, body.dimension),
        derivatives.reshape(-1, body.dimension, body.dimension),
        strict=True,
    ):
        others = sorted(np.linalg.eigvals(derivative), key=lambda v: (-round(abs(v), 9), -v.imag))
        np.testing.assert_allclose(found, others, rtol=1e-11, atol=1e-13)
        assert body is LORENZ or not np.any(x) or (found == 1).any()


def test_multipliers_at_poles_and_missing_states(body, unit):
    away, towards = sf.multipliers(body, [[-0.9, 1.5], [0.9, -1.5]], 0.2)
    assert (away[1], towards[0]) == (1, 1)
    assert 0 < towards[1] < 1 < away[0]
    assert towards[1] * away[0] == pytest.approx(1, abs=1e-15)
    assert sf.multipliers(unit, [0.0, -2.0], 1.0).tolist() == [np.inf, 1.0]
    assert sf.multipliers(unit, [0.0, -1e200], 1e200).tolist() == [1.0, -1.0]
    assert sf.multipliers(sf.SuslovND([2.0], [1.0]), [3.0], 1.0) == 1.0
    assert sf.multipliers(sf.SuslovND([2, 3, 4], [0, 0, 0]), [3.0, 1, 2], 1.0).tolist() == [1] * 3
    square = sf.QuadraticField([[[1]]], constant=[-1])
    found = sf.multipliers(square, [[1.0], [np.nan], [-1.0]], 1.0)
    np.testing.assert_array_equal(found, [[np.inf], [np.nan], [0.0]])
    assert np.isnan(sf.multipliers(body, [0.6, np.nan], 0.2)).all()


@pytest.mark.parametrize(
    ("body", "x", "where"),
    [
        (sf.Suslov3D(4, 1, -0.5, -0.3), [[0.6, -1.0], [0.6, -1.0 + 1e-6]], "1 .*first: 1"),
        (sf.SuslovND([1, 2, 3], [1, 2, 3]), [[np.nan] * 3, [1, 2, 3], [1, 2, 3.1]], "1 .*first: 2"),
        (sf.SuslovGyrostat(2, 1, 0.5, -0.5, 0.25), [0.0, 1e-9], "1 other states: use jacobian"),
        (LORENZ, [[FOCUS, [1e-9, 0, 0]], [FOCUS, [1, 2, 3]]], r"2 .*first: \(0, 1\)"),
    ],
)
def test_multipliers_of_states_that_move(body, x, where):
    with pytest.raises(ValueError, match=f"x: expected fixed points of the map, got {where}"):
        sf.multipliers(body, x, 0.1)


STIFF = ([0.0059, 5012, 1185, 0.114, 82, 0.000217], [-2091, -1.98, 365, -0.016, -0.102, 0.061])


def test_multipliers_in_n_dimensions(rng):
    """1, and those of the spectrum of J**-1 (|I|**2 - I I^T), each to a few digits of its own."""
    problems = [(*STIFF, 1e3, 1e-9)]
    for m in (1, 2, 2, 3, 3, 3, 6, 6, 20):
        J, I = rng.uniform(0.5, 4, m), rng.normal(size=m) * 10 ** rng.uniform(-2, 0, m)
        problems.append((J, I, rng.normal(), rng.uniform(-1, 1)))
        J = 10.0 ** rng.uniform(-12, 12, m)
        problems.append((J, I, -np.sqrt(J.min() * J.max()) / (I @ I), 1.0))
    for J, I, c, eps in problems:
        x = c * np.array(I)
        computed = sf.multipliers(sf.SuslovND(J, I), x, eps)
        assert (computed == 1).any()
        J, I, x, (eps,) = (naive.exactly(*each) for each in (J, I, x, [eps]))
        m, square = range(len(J)), mpmath.fdot(I, I)
        symmetric = mpmath.matrix(
            [[(square * (i == j) - I[i] * I[j]) / mpmath.sqrt(J[i] * J[j]) for j in m] for i in m]
        )
        rates = sorted(mpmath.eigsy(symmetric, eigvals_only=True))[1:]
        Y = [eps * mpmath.fdot(I, x) / square * s / 2 for s in rates]
        exact = sorted([1.0] + [float((1 + y) / (1 - y)) for y in Y], key=lambda v: -abs(v))
        np.testing.assert_allclose(abs(computed), np.abs(exact), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize(
    ("moments", "products", "omegas"), [(0, 0, 500), (600, 600, 0), (200, -300, 10), (-500, 0, 90)]
)
def test_units_of_multipliers(rng, moments, products, omegas):
    eps, J, I = rng.uniform(-1, 1), rng.uniform(0.5, 4, 4), rng.normal(size=4)
    moved = np.ldexp(eps, moments - products - omegas)
    far_J, far_I = np.ldexp(J, moments), np.ldexp(I, products)
    for kind, J, I, x, far_J, far_I in (  # noqa: B020
        (sf.Suslov3D, J[:2], I[:2], I[[1, 0]] * [1, -1], far_J[:2], far_I[:2]),
        (sf.SuslovND, [J], [I], I, [far_J], [far_I]),
    ):
        found = sf.multipliers(kind(*far_J, *far_I), np.ldexp(x, omegas), moved)
        assert (found == sf.multipliers(kind(*J, *I), x, eps)).all()


@pytest.mark.parametrize("name", ["jacobian", "reaction", "step"])
@pytest.mark.parametrize("m", [2, 4])
def test_poles_are_counted(rng, monkeypatch, name, m):
    """One warning counts the poles and names the first in C order, for any number of tasks."""
    body = sf.Suslov3D(1, 1, 1, 0) if m == 2 else sf.SuslovND([2, 2, 2, 3], [1, 0, 0.5, 0.25])
    pole = [1.0, -3.0] if m == 2 else [2, 1, 3, 2]
    omega = 0.1 * rng.normal(size=(4, 400, m))
    omega[2, 17] = omega[2, 399] = omega[3, 5] = pole
    omega[2, 16, 0] = np.nan  # among the lanes of the first pole
    for tasks in (1, 64):
        monkeypatch.setattr(engine, "TASKS", tasks)
        with pytest.warns(sf.SingularStepWarning) as caught:
            values = getattr(sf, name)(body, omega, 1.0)
        (warning,) = caught
        assert str(warning.message).startswith("3 of 1600 ")
        assert "first: (2, 17)" in str(warning.message)
        assert warning.filename == __file__
        missing = np.isnan(values.reshape(4, 400, -1)).all(axis=-1)
        assert np.argwhere(missing).tolist() == [[2, 16], [2, 17], [2, 399], [3, 5]]
