"""Multipliers of fixed points, against the Jacobian and a spectrum in 60 digits."""

import mpmath
import naive
import numpy as np
import pytest
from systems import LORENZ, lorenz

import suslov_fast as sf
from suslov_fast.maps.formulas import eigenvalues_in_order

FOCUS = [72**0.5, 72**0.5, 27.0]


@pytest.mark.parametrize(
    ("body", "x", "eps", "dtype"),
    [
        (sf.Suslov3D(4, 1, -0.5, -0.3), [0.6, -1.0], 0.2, float),
        (sf.Suslov3D(4, 1, -0.5, [-0.3, -0.25]), [[0.6, -1.0], [-0.5, 1.0]], -0.2, float),
        (
            sf.SuslovND(J=[1.3, 2.1, 3.7], I=[0.4, -0.7, 0.5]),
            [-0.8, 1.4, -1.0],
            [[0.2], [0.4]],
            float,
        ),
        (sf.SuslovND(J=[1.3, 2.1, 3.7, 4.0], I=[0, -0.7, 0.5, 0.0]), [0, 1.4, -1.0, 0], 0.4, float),
        (sf.Suslov3D(2, 1, 0.5, -0.5, 0.25), [0.5, 1.0], 0.35, complex),
        (sf.Suslov3D(2, 1, 0.5, -0.5, [0.25, -0.25]), [0.0, 0.0], 0.35, complex),
        (LORENZ, [FOCUS, [0.0, 0.0, 0.0]], 1 / 64, complex),
    ],
)
def test_they_are_eigenvalues_of_the_jacobian(body, x, eps, dtype):
    found, derivatives = sf.kahan.multipliers(body, x, eps), sf.kahan.jacobian(body, x, eps)
    assert (found.dtype, found.shape) == (dtype, derivatives.shape[:-1])
    others = np.linalg.eigvals(derivatives)
    order = np.lexsort((-others.imag, -abs(others).round(9)), axis=-1)
    others = np.take_along_axis(others, order, axis=-1)
    np.testing.assert_allclose(found, others, rtol=1e-11, atol=1e-13)
    assert body is LORENZ or not np.any(x) or (abs(found - 1).min(axis=-1) < 1e-15).all()


def test_at_poles_and_missing_states(body, unit):
    away, towards = sf.kahan.multipliers(body, [[-0.9, 1.5], [0.9, -1.5]], 0.2)
    assert (away[1], towards[0]) == (1, 1)
    assert 0 < towards[1] < 1 < away[0]
    assert towards[1] * away[0] == pytest.approx(1, abs=1e-15)
    assert sf.kahan.multipliers(unit, [0.0, -2.0], 1.0).tolist() == [np.inf, 1.0]
    assert sf.kahan.multipliers(sf.SuslovND(J=[2.0], I=[1.0]), [3.0], 1.0) == 1.0
    still = sf.SuslovND(J=[2, 3, 4], I=[0, 0, 0])
    assert sf.kahan.multipliers(still, [3.0, 1, 2], 1.0).tolist() == [1] * 3
    square = sf.Field.from_terms([[[1]]], constant=[-1])
    found = sf.kahan.multipliers(square, [[1.0], [np.nan], [-1.0]], 1.0)
    np.testing.assert_array_equal(found, [[np.inf], [np.nan], [0.0]])
    assert np.isnan(sf.kahan.multipliers(body, [0.6, np.nan], 0.2)).all()
    family = sf.Field(lambda x, a: (a * x[0], -x[1]), 2, a=[1.0, 3.0])
    np.testing.assert_allclose(sf.kahan.multipliers(family, [0.0, 0.0], 0.5)[:, 0], [5 / 3, 7])


def test_states_that_move():
    for body, x, where in (
        (sf.SuslovND(J=[1, 2, 3], I=[1, 2, 3]), [[np.nan] * 3, [1, 2, 3], [1, 2, 3.1]], "first: 2"),
        (sf.Suslov3D(2, 1, 0.5, -0.5, 0.25), [0.0, 1e-9], "not a fixed point"),
    ):
        with pytest.raises(ValueError, match=f"^x.*{where}"):
            sf.kahan.multipliers(body, x, 0.1)


def test_a_wide_spread_of_moments(rng):
    """1, and those of the spectrum of J**-1 (|I|**2 - I I^T), each to a few digits of its own."""
    for m in (1, 2, 2, 3, 3, 3, 6, 6, 20):
        J, I = 10.0 ** rng.uniform(-8, 8, m), rng.normal(size=m) * 10 ** rng.uniform(-2, 0, m)
        x = -np.sqrt(J.min() * J.max()) / (I @ I) * I
        computed = sf.kahan.multipliers(sf.SuslovND(J=J, I=I), x, 1.0)
        assert abs(computed - 1).min() < 1e-15
        J, I, x, m = *(naive.exactly(*each) for each in (J, I, x)), range(m)
        square = mpmath.fdot(I, I)
        symmetric = mpmath.matrix(
            [[(square * (i == j) - I[i] * I[j]) / mpmath.sqrt(J[i] * J[j]) for j in m] for i in m]
        )
        rates = sorted(mpmath.eigsy(symmetric, eigvals_only=True))[1:]
        Y = [mpmath.fdot(I, x) / square * s / 2 for s in rates]
        exact = sorted([1.0] + [float((1 + y) / (1 - y)) for y in Y], key=lambda v: -abs(v))
        np.testing.assert_allclose(abs(computed), np.abs(exact), rtol=1e-13, atol=1e-15)


def test_points_that_a_solver_found_are_fixed():
    """scipy.optimize.root returns them off a component that is 0, where f has one term."""
    field = sf.Field(lambda x: (x[0] - x[0] ** 2 - x[0] * x[1], x[1] * (x[0] - 3)), 2)
    exact = sf.kahan.multipliers(field, [1.0, 0.0], 0.1)
    for x in ([1.0, -8e-15], [1.0 + 3e-13, 1e-12]):
        np.testing.assert_allclose(sf.kahan.multipliers(field, x, 0.1), exact, rtol=1e-11)
    for x in ([1.0, 1e-6], [1e-12, 1e-12], [0.0, 1e-300]):
        with pytest.raises(ValueError, match="not a fixed point"):
            sf.kahan.multipliers(field, x, 0.1)
    both = sf.kahan.multipliers(field, [[1.0, -8e-15], [np.nan, 1.0]], 0.1)
    assert np.isnan(both).all(axis=-1).tolist() == [False, True]


def fisher(u):
    """Growth and diffusion on a ring."""
    n = len(u)
    return [u[i - 1] - 2 * u[i] + u[(i + 1) % n] + u[i] * (1 - u[i]) for i in range(n)]


@pytest.mark.parametrize(
    ("f", "x"),
    [
        (lambda x: lorenz([*x]), [1e-4, 0.0, 0.0]),
        (lambda x: lorenz([*x]), [1e-20, 1e-40, 0.0]),
        (fisher, [0.0] * 5 + [0.5] + [0.0] * 6),
        (fisher, [10.0**-n for n in range(12)]),
    ],
)
def test_small_entries_of_jacobians_have_digits(f, x):
    found = sf.kahan.jacobian(sf.Field(f, len(x)), x, 1 / 64)
    with mpmath.workdps(150):
        exact = naive.derivative(lambda y: naive.kahan_step(f, 1 / 64, y), x, digits=45)
    np.testing.assert_allclose(found, np.array(exact, float), rtol=1e-14)


@pytest.mark.parametrize("seed", range(5))
def test_last_digits_do_not_choose_the_order(seed):
    """Of multipliers of modulus 1, of real parts 0, and of numbers that differ."""
    rng = np.random.default_rng(seed)
    circle = np.exp(1j * np.array([0.3, -0.3, 2.0, -2.0, 1.2, -1.2, 0.0, np.pi]))
    expected = np.exp(1j * np.array([1.2, -1.2, 2.0, -2.0, 0.3, -0.3, 0.0, np.pi]))
    noise = np.repeat(1 + 1e-15 * rng.normal(size=5), [2, 2, 2, 1, 1])
    order = rng.permutation(8)
    found = eigenvalues_in_order((circle * noise)[order], abs(circle * noise)[order])
    np.testing.assert_allclose(found, expected, atol=1e-14)
    axis = np.array([3j, -3j, 1j, -1j, 0.5, -0.2]) + np.repeat(1e-16 * rng.normal(size=4), 2)[:6]
    found = eigenvalues_in_order(axis[order[order < 6]], axis.real[order[order < 6]])
    np.testing.assert_allclose(found, [0.5, 3j, -3j, 1j, -1j, -0.2], atol=1e-14)
    many = eigenvalues_in_order(np.stack([circle, 2 * circle]), abs(np.stack([circle, circle])))
    np.testing.assert_allclose(many, [expected, 2 * expected], atol=1e-14)
