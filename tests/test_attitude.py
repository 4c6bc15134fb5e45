"""The orientation of the body, in three dimensions and in n."""

import itertools

import naive
import numpy as np
import pytest
from scipy.linalg import eigvals

import suslov_fast as sf


def states(body, omega0, eps, steps):
    return sf.iterate(body, omega0, eps, steps, on_singular="ignore").omega


def orthogonality(R):
    return abs(R @ R.swapaxes(-2, -1) - np.eye(R.shape[-1])).max()


@pytest.mark.parametrize("eps", [0.2, -0.2, 3.0])
def test_against_cayley_matrices(rng, body, eps):
    others = [sf.SuslovND(rng.uniform(1, 3, m), rng.normal(size=m)) for m in (1, 2, 3, 8)]
    for each in (body, *others):
        omega = states(each, rng.normal(size=(2, each.dimension)), eps, 30)
        R = sf.attitude(each, omega, eps)
        assert (R[0] == np.eye(R.shape[-1])).all()
        exact = naive.attitude(sf.to_matrix(each, omega[:, 1])[..., :-1, -1], eps)
        exact = [np.array(matrix.tolist(), float) for matrix in exact]
        np.testing.assert_allclose(R[:, 1], exact, rtol=0, atol=5e-15)


@pytest.mark.compiled
@pytest.mark.slow
def test_orthogonal_over_a_million_steps(case):
    body, omega0 = case
    R = sf.attitude(body, states(body, omega0, 0.2, 1_000_000), 0.2)
    assert orthogonality(R) < 4e-15
    assert abs(np.linalg.det(R[::1000]) - 1).max() < 6e-15


def test_orthogonal_after_a_thousand_steps_in_many_dimensions(rng):
    """Without reorthogonalization, the error would be 2e-14."""
    body = sf.SuslovND(rng.uniform(1, 3, 8), rng.normal(size=8))
    R = sf.attitude(body, states(body, rng.normal(size=8), 0.3, 1000), 0.3)
    assert orthogonality(R) < 5e-15


@pytest.mark.parametrize(
    ("eps", "size"),
    [(sign * 1.0, 10.0**k) for sign in (1, -1) for k in (14, 100, 153, 155, 200, 307.9)]
    + [(sign * 1e308, size) for sign in (1, -1) for size in (1e-157, 1e-120, 1e200)]
    + [(1e-280, 1e307), (1e-150, 1e307), (1e155, 1.0), (1e300, 1e-280), (1e300, 1e300)],
)
def test_half_a_turn(eps, size):
    """For huge |eps omega| a step is a half turn: R = 2 u u^T - 1 about u, or in the plane of u."""
    u, e = np.array([0.6, -0.8, 0.0, 0.0]), np.eye(4)[-1]
    in_3d = 2 * np.outer(u[:3], u[:3]) - np.eye(3)
    in_4d = np.eye(4) - 2 * np.outer(u, u) - 2 * np.outer(e, e)
    still = sf.SuslovND(np.ones(3), np.zeros(3))
    for body, expected in ((sf.Suslov3D(1, 2, 0, 0), in_3d), (still, in_4d)):
        omega = size * u[: body.dimension]
        for R in (
            sf.attitude(body, np.tile(omega, (3, 1)), eps),
            sf.iterate(body, omega, eps, 2, attitude=True).attitude,
        ):
            np.testing.assert_allclose(R[1], expected, atol=1e-12)
            np.testing.assert_allclose(R[2], np.eye(len(expected)), atol=1e-12)


def test_nan_from_the_first_nan_on(case):
    body, omega0 = case
    omega = states(body, omega0, 0.2, 40)
    whole = sf.attitude(body, omega, 0.2)
    for first in (0, 1, 17, 40):
        broken = omega.copy()
        broken[first, -1] = np.nan
        R = sf.attitude(body, broken, 0.2)
        assert np.array_equal(R[:first], whole[:first])
        assert np.isnan(R[first:]).all()


def test_states_that_are_not_consecutive(case):
    body, omega0 = case
    omega = states(body, [omega0, np.multiply(1.1, omega0)], 0.2, 60)
    other = type(body)(*body.parameters[:-1], body.parameters[-1] + 0.1)
    for wrong in (omega[::2], omega[::-1], omega[::59], 2 * omega):
        with pytest.raises(ValueError, match=r"states 0 and 1 of trajectory 0 that are not"):
            sf.attitude(body, wrong, 0.2)
    for eps in (0.2001, -0.2, 0.4, 0.0):
        for k in (-900, -400, 0, 400, 900):
            with pytest.raises(ValueError, match="omega: expected consecutive states"):
                sf.attitude(body, np.ldexp(omega, k), np.ldexp(eps, -k))
    with pytest.raises(ValueError, match="expected consecutive states"):
        sf.attitude(other, omega, 0.2)
    slow = states(body, omega0, 1e-8, 4)
    sf.attitude(body, slow, 1e-8)
    with pytest.raises(ValueError, match="states 0 and 1 that are not"):
        sf.attitude(body, slow[::2], 1e-8)
    apart = states(body, omega0, 1e-9, 1)  # steps far below rounding errors of 1e-8
    apart[1] *= 1 + 1e-8
    with pytest.raises(ValueError, match="expected consecutive states"):
        sf.attitude(body, apart, 1e-9)
    omega[24:, 1] = omega[23, 1]
    with pytest.raises(ValueError, match="states 23 and 24 of trajectory 1 that are not"):
        sf.attitude(body, omega, 0.2)
    with pytest.raises(ValueError, match="states 23 and 24 that are not"):
        sf.attitude(body, omega[:, 1], 0.2)


@pytest.mark.parametrize(
    ("method", "n", "size"),
    [("auto", None, 300), ("canonical", None, 300), ("ds2", None, 300)]
    + [(method, *each) for method in ("rank2", "gauss") for each in ((2, 60), (4, 60), (9, 20))],
)
def test_states_of_iterate_are_accepted(rng, method, n, size):
    """`attitude` accepts all states of `iterate`, in any regime and unit, and next to poles."""
    if n is None:
        products = rng.normal(size=(2, size)) * rng.choice([0, 1], size)
        body, decades = sf.Suslov3D(*10 ** rng.uniform(-4, 4, (2, size)), *products), 6
    else:
        I = rng.normal(size=(size, n - 1))
        body, decades = sf.SuslovND(10 ** rng.uniform(-2, 2, I.shape), I), 3
    speed, eps = 10 ** rng.uniform(-decades, decades, (2, size)) * rng.choice([-1, 1], (2, size))
    omega0 = rng.normal(size=(size, body.dimension)) * speed[:, None]
    run = sf.iterate(body, omega0, eps, 50, method=method, on_singular="ignore")
    R = sf.attitude(body, run.omega, eps)
    assert (np.isfinite(R).all((-2, -1)) == np.isfinite(run.omega).all(-1)).all()


def next_to_a_pole(rng, body, eps, gap, near_steady):
    """A state on a random line where det A is about `gap` times the largest of its terms."""
    m = body.dimension
    line = rng.normal(size=m)
    if near_steady:
        I = np.array(body.I if isinstance(body, sf.SuslovND) else [body.I13, body.I23])
        line -= I * (I @ line) / (I @ I) + 10 ** rng.uniform(-9, 0) * rng.normal(size=m)
    start = sf.matrix(body, np.zeros(m), eps)
    sizes = eigvals(start, start - sf.matrix(body, line, eps))
    sizes = sizes[np.isfinite(sizes) & (abs(sizes.imag) < 1e-12 * abs(sizes))].real
    return rng.choice(sizes) * line * (1 + gap) if len(sizes) else None


@pytest.mark.parametrize(
    ("kind", "methods"),
    [
        (sf.Suslov3D, ("auto", "canonical", "ds2")),
        (sf.SuslovGyrostat, ("auto", "canonical")),
        (sf.SuslovND, ("gauss", "rank2")),
    ],
)
def test_states_next_to_poles(rng, kind, methods):
    """They are accepted, but not every second one."""
    for n in range(240):
        decades, eps = rng.choice([0, 2, 4]), 10 ** rng.uniform(-3, 3) * rng.choice([-1, 1])
        m = rng.integers(3, 10) if kind is sf.SuslovND else 2
        J, I = 10 ** rng.uniform(-decades, decades, m), rng.normal(size=m)
        rotor = rng.normal(size=1 if kind is sf.SuslovGyrostat else 0)
        body = kind(J, I) if kind is sf.SuslovND else kind(*J, *I, *rotor)
        gap = 10 ** rng.uniform(-15, -1) * rng.choice([-1, 1])
        omega = next_to_a_pole(rng, body, eps, gap, n % 3)
        for method, sign in itertools.product(methods if omega is not None else (), (1, -1)):
            run = sf.iterate(body, omega, sign * eps, 4, method=method, on_singular="ignore")
            sf.attitude(body, run.omega, sign * eps)
            first, second, third, *_ = run.omega
            changes = abs(third - first).max(), abs(third - second).max()
            if n % 3 == 0 and abs(gap) > 1e-4 and min(changes) > 1e-3 * abs(third).max():
                with pytest.raises(ValueError, match="states 0 and 1 that are not"):
                    sf.attitude(body, run.omega[::2], sign * eps)
