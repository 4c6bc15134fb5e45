"""`auto` uses the closed form for the n-dimensional bodies that have one."""

from functools import partial

import naive
import numba
import numpy as np
import pytest
from naive import mpf

import suslov_fast as sf
from suslov_fast._kernels.reduced_states import as_product


def solved_body(rng, m, kind):
    """Random J and I with a closed form: all J equal, or I along one axis and the other J equal."""
    J, I = np.full(m, rng.uniform(1, 4)), rng.normal(size=m)
    if kind == "axis":
        k = rng.integers(m)
        J[k] *= 10 ** rng.uniform(-1, 1)
        I = np.where(np.arange(m) == k, I, 0.0)
    return J, I


def starts(rng, J, I, eps, where):
    """Random state in a region of phase space."""
    omega = rng.normal(size=len(J))
    # Y = half . omega, with J of a direction orthogonal to I; Y = 1 at criticality.
    half = eps * I / (2 * J[abs(I).argmax() - 1])
    omega *= rng.uniform(0.05, 0.9) / abs(half @ omega)
    if where == "next to the steady states":
        omega = I * (I @ omega) / (I @ I)
        omega *= np.sign(eps * (I @ omega)) * (1 + 10.0 ** rng.uniform(-15, -5))
        omega += rng.normal(size=len(J)) * 10.0 ** rng.uniform(-15, -6)
    elif where == "next to criticality":
        omega *= (1 - 10 ** rng.uniform(-10, -3)) / (half @ omega)
    elif where == "at slow speed":  # depends on every digit of the level of the first integral
        omega *= 1e-5
    elif where == "beyond criticality":
        omega *= -(10 ** rng.uniform(0.05, 2)) / (half @ omega)
    return omega


WHERE = [
    "anywhere", "next to the steady states", "next to criticality", "beyond criticality",
    "at slow speed",
]  # fmt: skip


@pytest.mark.parametrize("n", [12, 300, 10**4, 10**6])
@pytest.mark.parametrize("kind", ["equal", "axis"])
@pytest.mark.parametrize("where", WHERE)
def test_states(rng, kind, where, n):
    for m, eps in ((2, 0.3), (3, -0.4), (17, 0.4)):
        J, I = solved_body(rng, m, kind)
        omega, body = starts(rng, J, I, eps, where), sf.SuslovND(J, I)
        exact = naive.far_state_nd(J, I, eps, omega, n)
        for save_every in (n, None, n // 100) if n > 12 else (1,):
            orbit = sf.iterate(body, omega, eps, n, save_every=save_every)
            assert orbit.status == sf.Status.OK
            assert naive.energy_error(J, orbit.omega[-1], exact) < 1e-14
        if n == 12 and m < 17:  # against the implicit equations
            states = naive.orbit_nd(J, I, eps, omega, n)
            assert max(map(partial(naive.energy_error, J), orbit.omega, states)) < 1e-14
            assert naive.relative_error(exact, states[-1]) < 1e-15


def test_two_numbers_whose_product_has_76_bits(rng):
    product = numba.njit(lambda p, lost: as_product(p, lost))
    ends = [1.0, 2.0, 4.0, np.nextafter(4.0, 0.0), np.nextafter(1.0, 0.0), 1e-290, 1e290]
    for p in (*ends, *rng.normal(size=30) * 10 ** rng.uniform(-20, 20, 30)):
        for lost in rng.uniform(-1, 1, 3) * 2.0**-53 * abs(p):
            if p + lost == p:
                A, B = product(p, lost)
                error = mpf(float(A)) * mpf(float(B)) - mpf(float(p)) - mpf(float(lost))
                assert abs(error) < mpf(2) ** -76 * abs(p)
                assert 0.999 < B < 2.001


AFTER_2 = np.nextafter(2.0, 3.0)


@pytest.mark.parametrize(
    ("J", "I", "solved"),
    [
        ([2.0, 2.0, 2.0], [0.1, 0.2, 0.3], True), ([2.0, 2.0, AFTER_2], [0.1, 0.2, 0.3], False),
        ([2.0, 2.0, 5.0], [0.0, 0.0, -0.3], True), ([2.0, 2.0, 5.0], [0.0, 1e-300, 0.3], False),
        ([2.0, AFTER_2, 5.0], [0.0, 0.0, 0.3], False),
    ],
)  # fmt: skip
def test_iterated_bodies(rng, J, I, solved):
    """J and I are compared exactly; few steps and orientations are iterated for any body."""
    body, omega = sf.SuslovND(J, I), rng.normal(size=(9, 3))
    runs = (100, 1, False), (32, None, False), (20, None, False), (20, 1, True)
    for steps, save_every, attitude in runs:
        options = {"save_every": save_every, "attitude": attitude}
        auto = sf.iterate(body, omega, 0.3, steps, **options)
        rank2 = sf.iterate(body, omega, 0.3, steps, method="rank2", **options)
        assert (auto.omega == rank2.omega).all() == (steps == 20 or not solved)
        np.testing.assert_allclose(auto.final, rank2.final, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("J", "I", "omega", "eps"),
    [
        *(([1.0] * 4, [0.5] * 4, [1.3, 0.7, 1.2, 0.8], 1 - gap) for gap in (1e-6, 1e-12, 1e-15)),
        ([1.0, 4.0], [0.0, 0.5], [1e-8, 4 - 4e-9], 1.0),
    ],
)
def test_few_steps_from_next_to_a_pole(J, I, omega, eps):
    """One step is as accurate as many, and the division of a run changes no bit."""
    body, exact = sf.SuslovND(J, I), naive.step_nd(J, I, eps, omega)
    last, two, five = (sf.iterate(body, omega, eps, n, save_every=None) for n in (1, 2, 5))
    for state in (sf.step(body, omega, eps), last.final):
        assert naive.relative_error(state, exact) < 1e-15
    assert (two.extend(3).final == five.final).all()


def test_no_times_and_no_states():
    for J in ([1.3, 2.1], [1.0, 1.0, 1.0]):
        body, D = sf.SuslovND(J, np.ones(len(J))), len(J)
        for omega, times in ((np.ones(D), []), (np.ones((0, D)), [1, 2]), (np.ones((0, D)), [])):
            expected = (len(times), *omega.shape)
            assert sf.exact(body, omega, 0.1, times).shape == expected
            assert sf.flow(body, omega, times).shape == expected


def test_orbits_past_their_pole_jump():
    """States of orbits that pass a pole after about 800 steps, against `rank2` and `exact`."""
    body = sf.SuslovND([1.0] * 4, [0.0, 1.0, 0.0, 0.0])
    omega = np.array([[1.0, 1e3, 0.0, 0.0], [0.6, 1e3, 0.0, 0.8]])
    stepped = sf.iterate(body, omega, 1.0, 1000, method="rank2")
    assert (stepped.omega[0, :, 1] > 0).all()
    assert (stepped.omega[-1, :, 1] < 0).all()
    jumped = sf.iterate(body, omega, 1.0, 1000)
    size = np.linalg.norm(stepped.omega, axis=-1, keepdims=True)
    assert (abs(jumped.omega - stepped.omega) / size).max() < 1e-9
    far = sf.iterate(body, omega, 1.0, 10**12, save_every=10**10)
    assert far.ok
    expected = sf.exact(body, omega, 1.0, far.n)
    np.testing.assert_allclose(far.omega[1:], expected[1:], rtol=1e-9, atol=1e-9)


def test_singular_equations():
    """On Y = 1, with equal J, the next state is not unique; the closed form gives a solution."""
    J, I, omega = [2.0] * 4, [1.0, 0.0, 0.5, 0.25], [2.0, 1.0, 3.0, 2.0]
    body = sf.SuslovND(J, I)
    states = sf.iterate(body, omega, 1.0, 1).omega
    for residual in naive.dsn(naive.exactly(*J), naive.exactly(*I), 1, *states.tolist()):
        assert abs(residual) < 1e-14
    there, *beside = sf.jacobian(body, np.outer([1, 1 - 1e-6, 1 + 1e-6], omega), 1.0)
    np.testing.assert_allclose(there, sum(beside) / 2, atol=1e-9)


@pytest.mark.parametrize("across", [1e-250, 1e-150, 1e-30])
def test_orbits_next_to_the_steady_states(across):
    """Each component is accurate relative to itself, not only to the largest."""
    J, I = [3.0, 2.0, 2.0, 2.0], [0.7, 0.0, 0.0, 0.0]
    omega = [1.0, 0.3 * across, -0.4 * across, 1.1 * across]
    for n in (10, 700, 3000):
        final = sf.iterate(sf.SuslovND(J, I), omega, 0.3, n, save_every=n).final
        exact = naive.far_state_nd(J, I, 0.3, omega, n)
        for computed, expected in zip(final, exact, strict=True):
            if abs(expected) > 1e-280:
                assert abs(computed / expected - 1) < 1e-14


def test_problems_out_of_range_are_iterated(rng):
    """`auto` equals `rank2` bit for bit at the ends of the range of float64 and for huge steps."""
    omega = rng.normal(size=(5, 3)) * np.array([1e-300, 1e300, 1.6e307, 5e-310, 1.0])[:, None]
    eps = np.array([1e299, 1e-300, 1e-308, 1e300, 1e100])
    for problem in (
        (sf.SuslovND([2.0] * 3, [0.1, 0.2, 0.3]), omega, eps),
        (sf.SuslovND([1e-95, 1.0, 1.0], [0.3, 0.0, 0.0]), omega[-1], 0.1),
    ):
        auto, rank2 = (
            sf.iterate(*problem, 9, method=method, on_singular="ignore")
            for method in ("auto", "rank2")
        )
        np.testing.assert_array_equal(auto.omega, rank2.omega)
        assert (auto.status == rank2.status).all()
