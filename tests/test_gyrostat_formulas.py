"""The gyrostat's step and quantities against its implicit equations in 60 digits."""

import mpmath
import naive
import numba
import numpy as np
import pytest

from suslov_fast._formulas import gyrostat
from suslov_fast._kernels import states as kernels

REFERENCE = (2.3, 1.4, 0.5, -0.7, 0.9, 0.35), (1.1, -0.4)


def implicit(I1, I2, I13, I23, k, eps, omega, following):
    """Left side minus right side: (ds1), and k (Omega_i + Omega_i_next) / 2 for k Omega_i."""
    (w1, w2), (v1, v2) = omega, following
    first, second = naive.ds1(I1, I2, I13, I23, eps, omega, following)
    return [first + eps * k * (w2 + v2) / 2, second - eps * k * (w1 + v1) / 2]


def exact_step(parameters, omega):
    parameters = naive.exactly(*parameters)
    return naive.solve_affine(lambda v: implicit(*parameters, omega, v), 2)


@numba.njit(error_model="numpy")
def orbit(I1, I2, I13, I23, k, eps, omega1, omega2, steps):
    """The last of so many states, and l there."""
    body = gyrostat.normal_gyrostat(I1, I2, I13, I23, k, eps)
    b1, b2, K, c, L, Z, omega1, omega2, _, _, W = gyrostat.enter(*body, omega1, omega2)
    l0 = L
    for _ in range(steps):
        L, Z, omega1, omega2 = gyrostat.step(b1, b2, K, c, L, Z, omega1, omega2)
    return omega1 * 2.0**W, omega2 * 2.0**W, L / l0


def evaluate(name, parameters, omega, size=1):
    out, report = np.zeros((1, size)), np.zeros((1, 3), np.int64)
    arrays = tuple(np.array([float(each)]) for each in parameters)
    kernel = getattr(kernels, f"gyrostat_{name}").serial
    kernel(arrays, np.array([omega], float), out, 1, report)
    return out[0]


def random_problem(rng):
    parameters = (*rng.uniform(0.5, 4, 2), *rng.normal(size=3), rng.uniform(-1, 1))
    return parameters, rng.normal(size=2) * 10 ** rng.uniform(-1, 1)


def error(computed, exact):
    computed, exact = mpmath.matrix(np.asarray(computed).tolist()), mpmath.matrix(exact)
    return float(mpmath.norm(computed - exact) / mpmath.norm(exact))


def rotor(parameters, omega):
    """l = I13 Omega1 + I23 Omega2 + k."""
    I13, I23, k = naive.exactly(*parameters[2:5])
    w1, w2 = (mpmath.mpf(each) for each in omega)
    return I13 * w1 + I23 * w2 + k


def exact_integral(parameters, omega):
    I1, I2, _, _, _, eps = naive.exactly(*parameters)
    w1, w2 = (mpmath.mpf(each) for each in omega)
    return (I1 * w1**2 + I2 * w2**2) / (4 * I1 * I2 + (eps * rotor(parameters, omega)) ** 2)


def exact_jacobian(parameters, omega):
    return naive.derivative(lambda state: exact_step(parameters, state), naive.exactly(*omega))


def test_reference():
    parameters, omega = REFERENCE
    expected = ["1.1380011603577656871", "0.043858910560513770418"]
    assert (
        naive.relative_error(orbit(*parameters, *omega, 1)[:2], map(mpmath.mpf, expected)) < 4e-16
    )
    F = evaluate("first_integral", parameters, omega)[0]
    assert abs(F / 0.2270011273244378509 - 1) < 4e-16


def test_against_the_implicit_equations(rng):
    for _ in range(40):
        parameters, omega = random_problem(rng)
        following = exact_step(parameters, naive.exactly(*omega))
        stretch = 1 + float(mpmath.norm(following)) / np.hypot(*omega)
        assert naive.relative_error(orbit(*parameters, *omega, 1)[:2], following) < 1e-14 * stretch
        assert error(evaluate("jacobian", parameters, omega, 4).reshape(2, 2),
                     exact_jacobian(parameters, omega)) < 1e-14 * stretch**2  # fmt: skip
        I1, I2, _, _, _, eps = parameters
        l, (w1, w2) = rotor(parameters, omega), omega
        assert (
            error(evaluate("vector_field", parameters, omega, 2), [-l * w2 / I1, l * w1 / I2])
            < 1e-15
        )
        F = exact_integral(parameters, omega)
        assert error(evaluate("first_integral", parameters, omega), [F]) < 3e-15
        density = 1 / (l * (4 * mpmath.mpf(I1) * I2 + (mpmath.mpf(eps) * l) ** 2))
        assert error(evaluate("invariant_density", parameters, omega), [density]) < 3e-15


def test_theory(rng):
    """F and the measure are conserved by the exact map."""
    parameters, omega = random_problem(rng)
    following = exact_step(parameters, naive.exactly(*omega))
    F, F_next = (exact_integral(parameters, each) for each in (omega, following))
    assert abs(F_next / F - 1) < 1e-50

    def density(state):
        l, (I1, I2, eps) = (
            rotor(parameters, state),
            naive.exactly(*(parameters[i] for i in (0, 1, 5))),
        )
        return 1 / (l * (4 * I1 * I2 + eps**2 * l**2))

    det = mpmath.det(mpmath.matrix(exact_jacobian(parameters, omega)))
    assert abs(density(following) * det / density(omega) - 1) < 1e-15


@pytest.mark.parametrize("k", [0.0, 1e-3, 0.9])
def test_long_orbits(rng, k):
    """Beyond a hundred steps also of a body whose state turns about its axis, I13 = I23 = 0."""
    for products in ((0.5, -0.7), (0.0, 0.0)):
        parameters = (2.3, 1.4, *products, k, 0.35)
        state = naive.exactly(1.1, -0.4)
        for _ in range(120):
            state = exact_step(parameters, state)
        assert naive.relative_error(orbit(*parameters, 1.1, -0.4, 120)[:2], state) < 3e-13


@pytest.mark.parametrize("distance", [1e-6, 1e-12, 1e-15])
def test_next_to_the_steady_states(rng, distance):
    """l and its growth keep their digits, also over many steps."""
    for _ in range(5):
        (I1, I2, I13, I23, k, eps), _ = random_problem(rng)
        parameters = I1, I2, I13, I23, k, 0.2 * eps
        along = rng.normal() * np.array([I23, -I13]) - k * np.array([I13, I23]) / (I13**2 + I23**2)
        omega = along * (1 + distance)
        state = naive.exactly(*omega)
        l = rotor(parameters, state)
        field = evaluate("vector_field", parameters, omega, 2)
        assert error(field, [-l * state[1] / I1, l * state[0] / I2]) < 2e-15
        for _ in range(30):
            state = exact_step(parameters, state)
        growth = rotor(parameters, state) / l
        assert abs(float(orbit(*parameters, *omega, 30)[2] / growth) - 1) < 1e-10


def test_next_to_poles(rng):
    """1 - Y + L (2 L - K) / (I1 I2) = 0: the error stays below that of rounding the state."""
    for gap in (1e-3, 1e-6, 1e-9):
        omega = np.array([np.sqrt(2 * gap), -2 * (1 - gap)])
        parameters = 1.0, 1.0, 1.0, 0.0, 0.0, 1.0
        following = exact_step(parameters, naive.exactly(*omega))
        assert naive.relative_error(orbit(*parameters, *omega, 1)[:2], following) < 3e-15
    on_a_pole = orbit(1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, -3.0, 1)
    assert np.isnan(on_a_pole).all()
    assert np.isnan(evaluate("jacobian", (1, 1, 1, 0, 0, 1), (1.0, -3.0), 4)).all()


@pytest.mark.parametrize(
    "units", [(332, 332, 0), (-332, -332, 0), (0, 0, 332), (0, 0, -332), (300, -200, 100)], ids=str
)
def test_units(rng, units):
    """Powers of two of the moments, of the products and of omega scale all results exactly."""
    moments, products, omegas = units
    of_k, of_eps = products + omegas, moments - products - omegas
    powers = [moments, moments, products, products, of_k, of_eps]
    for _ in range(5):
        parameters, omega = random_problem(rng)
        other, moved = np.ldexp(parameters, powers), np.ldexp(omega, omegas)
        expected = orbit(*parameters, *omega, 20)
        assert orbit(*other, *moved, 20) == (*np.ldexp(expected[:2], omegas), expected[2])
        for name, size, unit in (
            ("first_integral", 1, 2 * omegas - moments),
            ("vector_field", 2, products + 2 * omegas - moments),
            ("jacobian", 4, 0),
            ("invariant_density", 1, -products - omegas - 2 * moments),
        ):
            if abs(unit) < 1000:
                value = np.ldexp(evaluate(name, parameters, omega, size), unit)
                assert (evaluate(name, other, moved, size) == value).all()
