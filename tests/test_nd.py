"""The n-dimensional problem against the implicit equations (dsn) in 60 digits, and (nsus)."""

from itertools import pairwise

import naive
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import suslov_fast as sf
from suslov_fast import _map
from suslov_fast._core.cpu import map_nd as loops
from suslov_fast._engine import threads

METHODS = ("rank2", "gauss")
BODY_C = ([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])


def random_problem(rng, m, speed=1.0):
    J, I = rng.uniform(1, 4, m), rng.normal(size=m) / np.sqrt(m)
    return J, I, 0.3 * rng.choice([-1, 1]), speed * rng.normal(size=m) / np.sqrt(m)


def worst_error(states, exact):
    return max(map(naive.relative_error, states, exact))


@pytest.mark.parametrize("method", METHODS)
def test_reference_c(method):
    body = sf.SuslovND(*BODY_C)
    orbit = sf.iterate(body, [0.3, 0.9, -0.6], 0.4, 10, method=method)
    expected = [0.0963301365636447737, 0.914131910759529574, -0.609721283056756574]
    np.testing.assert_allclose(orbit.omega[1], expected, rtol=1e-15)
    expected = [-0.446836007179248331, 0.851727033488146456, -0.603889880601884106]
    np.testing.assert_allclose(orbit.final, expected, rtol=3e-15)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [1, 2, 3, 4, 7, 16])
@pytest.mark.parametrize("speed", [0.3, 2.0, 8.0])
def test_orbits(rng, method, m, speed):
    for _ in range(4 if m < 10 else 1):
        J, I, eps, omega = random_problem(rng, m, speed)
        exact = naive.orbit_nd(J, I, eps, omega, 12)
        orbit = sf.iterate(sf.SuslovND(J, I), omega, eps, 12, method=method)
        largest = max(np.hypot.reduce(np.array(state, float)) for state in exact)
        smallest = min(np.hypot.reduce(np.array(state, float)) for state in exact)
        assert orbit.ok
        assert worst_error(orbit.omega, exact) < 5e-14 * (largest / smallest) ** 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 0.0])
@pytest.mark.parametrize("m", [3, 6])
def test_one_small_d(rng, method, gap, m):
    """Where a d_i nearly vanishes A is regular, and the sums of the O(n) step are not."""
    for k in range(m):
        J, I, eps, omega = random_problem(rng, m)
        omega = omega * 2 * J[k] * (1 - gap) / (eps * (I @ omega))
        exact = naive.step_nd(J, I, eps, naive.exactly(*omega))
        computed = sf.iterate(sf.SuslovND(J, I), omega, eps, 1, method=method).final
        size = np.hypot.reduce(np.array(exact, float)) / np.hypot.reduce(omega)
        assert naive.relative_error(computed, exact) < 1e-11 * max(1, size)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("gap", [1e-4, 1e-12, 0.0])
def test_two_small_d(rng, method, gap):
    for _ in range(5):
        J, I, eps, omega = random_problem(rng, 5)
        J[3] = J[1]
        omega = omega * 2 * J[1] * (1 - gap) / (eps * (I @ omega))
        exact = naive.step_nd(J, I, eps, naive.exactly(*omega))
        computed = sf.iterate(sf.SuslovND(J, I), omega, eps, 1, method=method).final
        size = np.hypot.reduce(np.array(exact, float)) / np.hypot.reduce(omega)
        assert naive.relative_error(computed, exact) < 1e-11 * max(1, size)


def test_many_with_two_small_d(rng):
    """They are eliminated side by side, beside others that are not."""
    J, I = np.array([1.5, 2.0, 2.0, 3.0, 2.5]), rng.normal(size=5)
    omega = rng.normal(size=(20, 5))
    hard = np.arange(20) % 3 > 0
    omega[hard] *= 2 * J[1] / (0.3 * (omega[hard] @ I))[:, None]
    body = sf.SuslovND(J, I)
    together = sf.iterate(body, omega, 0.3, 4, method="rank2").omega
    for state, orbit in zip(omega, together, strict=True):
        assert (sf.iterate(body, state, 0.3, 4, method="rank2").omega == orbit).all()
    eliminated = sf.iterate(body, omega, 0.3, 1, method="gauss").final
    size = abs(together[:, 1]).max(axis=-1, keepdims=True)
    assert (abs(together[:, 1] - eliminated) / size).max() < 1e-11


@pytest.mark.parametrize("method", METHODS)
def test_three_small_d_are_singular(method):
    """With three equal J and d = 0 the matrix has rank n - 1 - 3 + 2."""
    J, I = [2.0, 2.0, 2.0, 3.0], [1.0, 0.0, 0.5, 0.25]
    omega = np.array([[2.0, 1.0, 3.0, 2.0], [0.1, 0.2, 0.3, 0.4]])
    assert omega[0] @ I == 4.0
    with pytest.warns(sf.SingularStepWarning, match="1 of 2 trajectories: singular step, first: 0"):
        result = sf.iterate(sf.SuslovND(J, I), omega, 1.0, 5, method=method)
    assert result.status.tolist() == [sf.Status.SINGULAR, sf.Status.OK]
    assert result.failed_at.tolist() == [1, -1]
    assert np.isnan(result.omega[0, 1:]).all()
    alone = sf.iterate(sf.SuslovND(J, I), omega[1], 1.0, 5, method=method)
    assert (result.omega[1] == alone.omega).all()


@pytest.mark.parametrize("method", METHODS)
def test_eight_equal_moments(rng, method):
    body = sf.SuslovND(np.full(7, 2.5), rng.normal(size=7))
    omega = rng.normal(size=7)
    orbit = sf.iterate(body, omega, 0.3, 40, method=method)
    exact = naive.orbit_nd(body.J, body.I, 0.3, omega, 12)
    assert worst_error(orbit.omega, exact) < 1e-13
    np.testing.assert_allclose(orbit.omega, sf.exact(body, omega, 0.3, orbit.n), atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_overflow(method):
    """Next to a pole of the body of n = 3 with I13 = 1, where the next state is beyond float64."""
    body = sf.SuslovND([1.0, 1.0], [-1.0, 0.0])
    omega = np.array([[-3.0 + 1e-10, -1.0], [0.1, 0.2]]) * 1e300
    result = sf.iterate(body, omega, 1e-300, 3, method=method, on_singular="ignore")
    assert result.status.tolist() == [sf.Status.NONFINITE, sf.Status.OK]
    assert result.failed_at.tolist() == [1, -1]
    assert np.isnan(result.omega[0, 1:]).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [2.0**-900, 2.0**-400, 2.0**400, 2.0**900])
def test_scales(rng, method, scale):
    J, I, eps, omega = random_problem(rng, 5)
    expected = sf.iterate(sf.SuslovND(J, I), omega, eps, 20, method=method).omega
    fast = sf.iterate(sf.SuslovND(J, I), omega * scale, eps / scale, 20, method=method).omega
    assert (fast / scale == expected).all()
    heavy = sf.SuslovND(J * scale, I * scale)
    assert (sf.iterate(heavy, omega, eps, 20, method=method).omega == expected).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("largest", [5e-324, 1e-310, 1.6e308])
def test_the_ends_of_the_range(method, largest):
    body, omega = sf.SuslovND(*BODY_C), largest * np.array([1.0, 0.5, -0.25])
    result = sf.iterate(body, omega, min(1e300, 0.1 / largest), 2, method=method)
    assert result.ok
    expected = sf.iterate(body, omega / largest, 0.1 * (largest > 1), 2, method=method).final
    np.testing.assert_allclose(result.final, largest * expected, rtol=1e-9, atol=1e-323)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed", [1e2, 1e4, 1e8, 1e16])
def test_steps_far_too_long(rng, method, speed):
    """One step goes from |omega| to |omega| / speed**2 or so."""
    for _ in range(5):
        J, I, eps, omega = random_problem(rng, 4, speed)
        exact = naive.orbit_nd(J, I, eps, omega, 3)
        computed = sf.iterate(sf.SuslovND(J, I), omega, eps, 3, method=method).omega
        assert naive.relative_error(computed[1], exact[1]) < 2e-13


@pytest.mark.parametrize("method", METHODS)
def test_identity(rng, method):
    omega = rng.normal(size=(3, 4))
    for body, eps in (
        (sf.SuslovND(np.ones(4), np.zeros(4)), 0.3),
        (sf.SuslovND(*[np.ones(4)] * 2), 0),
    ):
        assert (sf.iterate(body, omega, eps, 7, method=method).omega == omega[:, None]).all()


@pytest.mark.parametrize("method", METHODS)
def test_inverse_and_steady_states(rng, method):
    J, I, eps, omega = random_problem(rng, 6, 0.5)
    body = sf.SuslovND(J, I)
    there = sf.iterate(body, omega, eps, 5, method=method).final
    back = sf.iterate(body, there, -eps, 5, method=method).final
    np.testing.assert_allclose(back, omega, atol=1e-14)
    np.testing.assert_allclose(
        sf.iterate(body, 0.7 * I, eps, 20, method=method).final, 0.7 * I, rtol=1e-13
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("save_every", [1, 3, None])
def test_alone_or_in_a_batch(rng, method, save_every):
    size, m = 45, 5
    body = sf.SuslovND(rng.uniform(1, 4, (size, m)), rng.normal(size=(size, m)))
    omega = rng.normal(size=(size, m)) * 10 ** rng.uniform(-1, 1, (size, 1))
    eps = rng.choice([-0.5, 0.0, 0.1, 0.5], size)
    options = {"method": method, "save_every": save_every, "on_singular": "ignore"}
    together = sf.iterate(body, omega, eps, 20, **options)
    order = rng.permutation(size)
    shuffled = sf.iterate(
        sf.SuslovND(body.J[order], body.I[order]), omega[order], eps[order], 20, **options
    )
    assert np.array_equal(together.omega[order], shuffled.omega, equal_nan=True)
    for i in (0, 1, 31, 32, 44):
        alone = sf.iterate(sf.SuslovND(body.J[i], body.I[i]), omega[i], eps[i], 20, **options)
        assert np.array_equal(alone.omega, together.omega[i], equal_nan=True)
        assert alone.status == together.status[i]
    fortran = sf.iterate(body, omega, eps, 20, order="F", **options)
    assert np.array_equal(fortran.omega, together.omega, equal_nan=True)
    assert fortran.omega.flags.f_contiguous


@pytest.mark.parametrize("method", METHODS)
def test_save_every_slices_and_threads(rng, monkeypatch, method):
    body = sf.SuslovND(*BODY_C)
    omega = rng.normal(size=(70, 3))
    every = sf.iterate(body, omega, 0.2, 60, method=method)
    some = sf.iterate(body, omega, 0.2, 60, method=method, save_every=7)
    assert (some.omega == every.omega[:, ::7]).all()
    assert (some.final == every.final).all()
    monkeypatch.setattr(_map, "_SLICE", 70 * 24 * 8)
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    seen = []
    sliced = sf.iterate(
        body, omega, 0.2, 60, method=method, save_every=7, progress=lambda *n: seen.append(n)
    )
    assert len(seen) > 2
    assert (sliced.omega == some.omega).all()
    assert (sliced.final == some.final).all()


def every_way_through_a_step(rng, size, m):
    """Bodies, step sizes and states: d at or next to 0, singular A, speeds of all orders."""
    J, I = rng.uniform(1, 4, (size, m)), rng.normal(size=(size, m))
    J[::2] = 2.0
    eps = rng.choice([-0.5, 0.1, 1.0], size)
    omega = rng.normal(size=(size, m)) * 10 ** rng.uniform(-2, 2, (size, 1))
    gap = rng.choice([0.0, 1e-9, 1e-3], size)
    near = rng.random(size) < 0.5
    omega[near] *= (2 * J[:, 0] * (1 - gap) / (eps * (I * omega).sum(axis=1)))[near, None]
    omega[::7] *= 1e300
    return J, I, eps, omega


def call(loop, method, J, I, eps, omega, cuts=(0, 12)):
    """Saved states, last states, statuses and first missing states of `loops_nd.iterate`."""
    size, m = omega.shape
    out, final = np.empty((size, 13, m)), np.empty((size, m))
    status, failed_at = np.zeros(size, np.int8), np.full(size, -1)
    for start, stop in pairwise(cuts):
        with np.errstate(all="ignore"):
            loop(
                method, J, I, eps, omega, start, stop, 1, out, False, final, status, failed_at
            )  # fmt: skip
        omega = final
    return out, final, status, failed_at


def same(first, second):
    return all(np.array_equal(*pair, equal_nan=True) for pair in zip(first, second, strict=True))


@pytest.mark.parametrize("method", [loops.GAUSS, loops.RANK2])
@pytest.mark.parametrize("m", [1, 2, 4, 9])
def test_cut_into_calls_and_alone(rng, method, m):
    arguments = every_way_through_a_step(rng, 43, m)
    together = call(loops.iterate.serial, method, *arguments)
    assert same(together, call(loops.iterate.serial, method, *arguments, cuts=(0, 1, 2, 7, 12)))
    for i in range(0, 43, 3):
        alone = call(loops.iterate.serial, method, *(each[i : i + 1] for each in arguments))
        assert same(alone, [each[i : i + 1] for each in together])


@pytest.mark.compiled
@pytest.mark.parametrize("method", [loops.GAUSS, loops.RANK2])
def test_compiled_equals_interpreted(rng, method):
    arguments = every_way_through_a_step(rng, 43, 6)
    compiled = call(loops.iterate.serial, method, *arguments)
    assert set(compiled[2]) >= {sf.Status.OK, sf.Status.SINGULAR}
    assert same(compiled, call(loops.iterate.parallel, method, *arguments))
    assert same(compiled, call(loops.iterate.serial.py_func, method, *arguments))


def test_auto_is_rank2(rng):
    body, omega = sf.SuslovND(*BODY_C), rng.normal(size=(4, 3))
    auto = sf.iterate(body, omega, 0.2, 9)
    assert (auto.omega == sf.iterate(body, omega, 0.2, 9, method="rank2").omega).all()
    assert (sf.step(body, omega, 0.2) == auto.omega[:, 1]).all()


@pytest.mark.compiled
def test_large_populations_and_dimensions(rng):
    body = sf.SuslovND(rng.uniform(1, 4, (100_000, 9)), rng.normal(size=(100_000, 9)))
    result = sf.iterate(body, rng.normal(size=(100_000, 9)), 0.1, 20, save_every=None)
    assert result.ok
    J, I = rng.uniform(1, 4, 4999), rng.normal(size=4999) / 70
    single = sf.iterate(sf.SuslovND(J, I), rng.normal(size=4999) / 70, 0.1, 50, save_every=10)
    assert single.ok
    assert np.ptp(sf.energy(single.body, single.omega)) < 1e-2


def test_n_3_is_the_three_dimensional_map(rng):
    """(Omega_13, Omega_23) = (Omega2, -Omega1), J = (I2, I1), I = (-I13, -I23)."""
    I1, I2, I13, I23 = 3.0, 2.0, -0.4, 0.7
    three, nd = sf.Suslov3D(I1, I2, I13, I23), sf.SuslovND([I2, I1], [-I13, -I23])
    omega = rng.normal(size=(5, 2))
    states = np.stack([omega[:, 1], -omega[:, 0]], axis=-1)

    def as_nd(v):
        return np.stack([v[..., 1], -v[..., 0]], axis=-1)

    for function in (
        lambda body, w: sf.iterate(body, w, 0.4, 30).omega,
        lambda body, w: sf.exact(body, w, 0.4, np.arange(-3, 9)),
        lambda body, w: sf.flow(body, w, [0.0, 1.0, -7.0]),
        lambda body, w: sf.limits(body, w, 0.4)[1],
        sf.vector_field,
    ):
        np.testing.assert_allclose(function(nd, states), as_nd(function(three, omega)), atol=1e-13)
    for function in (
        sf.energy,
        lambda body, w: sf.first_integral(body, w, 0.4),
        lambda body, w: sf.modified_energy(body, w, 0.4),
        lambda body, w: sf.criticality(body, w, 0.4),
    ):
        np.testing.assert_allclose(function(nd, states), function(three, omega), rtol=1e-13)
    np.testing.assert_allclose(
        sf.multipliers(nd, 0.6, 0.4), sf.multipliers(three, 0.6, 0.4), rtol=1e-14
    )
    np.testing.assert_allclose(
        sf.reaction(nd, states)[:, 1, 0], sf.reaction(three, omega), rtol=1e-12
    )
    R = sf.attitude(nd, sf.iterate(nd, states, 0.4, 20).omega, 0.4)
    np.testing.assert_allclose(
        R, sf.attitude(three, sf.iterate(three, omega, 0.4, 20).omega, 0.4), atol=1e-13
    )


INTEGRABLE = [
    sf.SuslovND([2.0] * 5, [0.4, -0.7, 0.5, 0.0, 0.3]),
    sf.SuslovND([2.0, 2.0, 2.0, 3.0], [0.0, 0.0, 0.0, -0.7]),
    sf.SuslovND([2.0, 1.0, 2.0], [0.0, 0.6, 0.0]),
    sf.SuslovND([2.0, 1.0], [0.3, 0.6]),
    sf.SuslovND([1.5], [0.6]),
]


@pytest.mark.parametrize("body", INTEGRABLE, ids=lambda body: f"n={body.dimension + 1}")
def test_the_integrable_class(rng, body):
    omega = rng.normal(size=(6, body.dimension))
    orbit = sf.iterate(body, omega, 0.3, 40)
    np.testing.assert_allclose(sf.exact(body, omega, 0.3, orbit.n), orbit.omega, atol=2e-14)
    for values in (orbit.first_integral(), sf.modified_energy(body, orbit.omega, 0.3)):
        assert abs(values / values[:, :1] - 1).max() < 1e-13
    minus, plus = sf.limits(body, omega, 0.3)
    np.testing.assert_allclose(sf.exact(body, omega, 0.3, 10**12), plus, atol=1e-14)
    np.testing.assert_allclose(sf.exact(body, omega, 0.3, -(10**12)), minus, atol=1e-14)
    t = sf.criticality(body, orbit.omega, 0.3)
    np.testing.assert_allclose(t, np.broadcast_to(t[:, :1], t.shape), rtol=1e-13)
    assert (sf.exact(body, omega, 0.3, 0) == omega).all()

    def derivative(_, state):
        return sf.vector_field(body, state)

    solution = solve_ivp(derivative, (0, 2.0), omega[0], "DOP853", rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(sf.flow(body, omega[0], 2.0), solution.y[:, -1], atol=1e-11)


@pytest.mark.parametrize("body", INTEGRABLE[:3], ids=lambda body: f"n={body.dimension + 1}")
def test_steady_states_stay_for_ever(body):
    """Exactly steady ones: multiples of I by powers of two, or on its axis."""
    for c in (-4.0, 0.5, 1.0):
        omega = c * body.I
        states = sf.exact(body, omega, 0.2, [-(10**12), -1, 3, 10**12])
        np.testing.assert_allclose(states, np.tile(omega, (4, 1)), rtol=1e-15)
        np.testing.assert_allclose(sf.flow(body, omega, 1e9), omega, rtol=1e-15)
        for limit in sf.limits(body, omega, 0.2):
            np.testing.assert_allclose(limit, omega, rtol=1e-15)


def test_steady_states_on_an_axis(rng):
    body = sf.SuslovND([2.0, 2.0, 1.3], [0.0, 0.0, 0.3])
    omega = np.zeros((200, 3))
    omega[:, 2] = rng.normal(size=200)
    np.testing.assert_allclose(sf.exact(body, omega, 0.2, 10**6), omega, rtol=1e-15)
    single = sf.SuslovND([1.5], [0.6])
    omega = rng.normal(size=(200, 1))
    np.testing.assert_allclose(sf.exact(single, omega, 0.2, 10**6), omega, rtol=1e-15)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-10])
def test_closed_form_next_to_the_repelling_half(rng, distance):
    for body in INTEGRABLE[:3]:
        omega = 0.5 * body.I + distance * rng.normal(size=body.dimension)
        exact = naive.orbit_nd(body.J, body.I, 0.4, omega, 60)
        assert worst_error(sf.exact(body, omega, 0.4, np.arange(61)), exact) < 2e-14


def test_bodies_that_are_not_integrable():
    generic = sf.SuslovND(*BODY_C)
    for call in (
        lambda body: sf.exact(body, [1, 2, 3], 0.1, 3),
        lambda body: sf.flow(body, [1, 2, 3], 3),
        lambda body: sf.limits(body, [1, 2, 3], 0.1),
        lambda body: sf.criticality(body, [1, 2, 3], 0.1),
        lambda body: sf.first_integral(body, [1, 2, 3], 0.1),
    ):
        with pytest.raises(sf.NotIntegrableError, match=r"body 0 is not, .* use iterate"):
            call(generic)
    mixed = sf.SuslovND([[2, 2, 2], [1, 2, 3]], [0.4, -0.7, 0.5])
    with pytest.raises(sf.NotIntegrableError, match=r"exact: .* body 1 is not"):
        sf.exact(mixed, [1, 2, 3], 0.1, 3)
    assert issubclass(sf.NotIntegrableError, ValueError)
    with pytest.raises(sf.NotIntegrableError):
        sf.iterate(generic, [1, 2, 3], 0.1, 3).first_integral()


def test_modified_energy_drifts_with_order_4(rng):
    body = sf.SuslovND([1.3, 2.1, 3.7, 2.9], [0.4, -0.7, 0.5, 0.6])
    omega, time = [0.3, 0.9, -0.6, 0.4], 6.4
    eps = 0.4 / 2 ** np.arange(5)
    modified, plain = [], []
    for step in eps:
        states = sf.iterate(body, omega, step, round(time / step)).omega
        modified.append(np.ptp(sf.modified_energy(body, states, step)))
        plain.append(np.ptp(sf.energy(body, states)))
    assert abs(np.polyfit(np.log(eps), np.log(modified), 1)[0] - 4) < 0.3
    assert abs(np.polyfit(np.log(eps), np.log(plain), 1)[0] - 2) < 0.3
    assert sf.modified_energy(body, np.zeros(4), 0.1) == 0


def inertia_of(body):
    """A matrix of the paper's form with J_i = I_ii + I_nn."""
    m = body.dimension
    matrix = np.diag(np.append(body.J - 0.5, 0.5))
    matrix[:m, m] = matrix[m, :m] = body.I
    return matrix


def hat(omega):
    m = len(omega)
    Omega = np.zeros((m + 1, m + 1))
    Omega[:m, m], Omega[m, :m] = omega, -omega
    return Omega


def test_vector_field_and_reaction_from_the_matrix_equation(rng):
    """M' = [M, Omega] + Lambda with M = I Omega + Omega I, equation (nsus)."""
    J, I, eps, omega = random_problem(rng, 5)
    body = sf.SuslovND(J, I)
    matrix = inertia_of(body)

    def momentum(w):
        return matrix @ hat(w) + hat(w) @ matrix

    M, Omega = momentum(omega), hat(omega)
    remainder = momentum(sf.vector_field(body, omega)) - (M @ Omega - Omega @ M)
    np.testing.assert_allclose(remainder[:5, 5], 0, atol=1e-14)
    np.testing.assert_allclose(remainder[:5, :5], sf.reaction(body, omega), atol=1e-14)
    # Discrete: difference quotient, and the commutator polarised.
    following = sf.step(body, omega, eps)
    N, Following = momentum(following), hat(following)
    commutator = 0.5 * (M @ Following - Following @ M + N @ Omega - Omega @ N)
    remainder = momentum(following - omega) / eps - commutator
    np.testing.assert_allclose(remainder[:5, 5], 0, atol=1e-13)
    np.testing.assert_allclose(remainder[:5, :5], sf.reaction(body, omega, eps), atol=1e-13)


def test_jacobian_and_multipliers(rng):
    J, I, eps, omega = random_problem(rng, 4)
    body, h = sf.SuslovND(J, I), 1e-6
    moved = sf.step(body, omega + h * np.eye(4), eps) - sf.step(body, omega - h * np.eye(4), eps)
    np.testing.assert_allclose(sf.jacobian(body, omega, eps), moved.T / (2 * h), atol=1e-8)
    eigenvalues = np.linalg.eigvals(sf.jacobian(body, 0.8 * I, eps))
    np.testing.assert_allclose(
        np.sort(sf.multipliers(body, 0.8, eps)), np.sort(eigenvalues.real), rtol=1e-12
    )
    assert sf.multipliers(body, np.zeros((2, 1)), [0.1, 0.2, 0.3]).shape == (2, 3, 4)
    with pytest.warns(sf.SingularStepWarning):
        singular = sf.jacobian(
            sf.SuslovND([2, 2, 2, 3], [1, 0, 0.5, 0.25]), [[2, 1, 3, 2], [0.1, 0.2, 0.3, 0.4]], 1.0
        )
    assert np.isnan(singular[0]).all()
    assert np.isfinite(singular[1]).all()


def test_from_inertia(rng):
    body = sf.SuslovND(*BODY_C)
    same, rotation = sf.SuslovND.from_inertia(inertia_of(body))
    np.testing.assert_allclose(same.J, body.J, rtol=1e-15)
    assert (same.I == body.I).all()
    assert (rotation == np.eye(4)).all()
    for n in (2, 3, 4, 7):
        root = rng.normal(size=(n, n))
        matrix, axis = root @ root.T + np.eye(n), rng.normal(size=n)
        turned_body, rotation = sf.SuslovND.from_inertia(matrix, axis)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(n), atol=1e-14)
        assert np.linalg.det(rotation) > 0
        np.testing.assert_allclose(
            rotation @ axis / np.linalg.norm(axis), np.eye(n)[-1], atol=1e-14
        )
        adapted = rotation @ matrix @ rotation.T
        block = adapted[:-1, :-1]
        np.testing.assert_allclose(block, np.diag(np.diag(block)), atol=1e-13)
        np.testing.assert_allclose(turned_body.J, np.diag(block) + adapted[-1, -1], rtol=1e-13)
        np.testing.assert_allclose(turned_body.I, adapted[:-1, -1], atol=1e-13)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 2], [1, 2, 3]), r"expected shapes \(..., n - 1\) .* got \(2,\) and \(3,\)"),
        ((1.0, 2.0), r"got \(\) and \(\)"),
        (([], []), r"got \(0,\) and \(0,\)"),
        (([1, -2], [1, 2]), r"J: expected positive sums I_ii \+ I_nn, got -2.0"),
        (([1, np.nan], [1, 2]), "J: expected finite real numbers"),
        ((np.ones((2, 3)), np.ones((3, 3))), r"broadcast .* J \(2,\), I \(3,\)"),
    ],
)
def test_bad_bodies(arguments, message):
    with pytest.raises(ValueError, match=message):
        sf.SuslovND(*arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones((2, 3)),), r"I: expected shape \(n, n\), got \(2, 3\)"),
        ((np.ones((1, 1)),), r"I: expected shape \(n, n\) with n > 1, got \(1, 1\)"),
        ((np.triu(np.ones((3, 3))),), "I: expected a symmetric inertia matrix"),
        ((np.diag([1.0, -1, 2]) + 0.5,), "I: expected a positive definite inertia matrix"),
        ((np.diag([1.0, -3, 2]),), "J: expected positive sums"),
        ((np.eye(3), [1, 2]), r"a: expected shape \(..., 3\), got \(2,\)"),
        ((np.eye(3), [0, 0, 0]), "a: expected an axis other than 0"),
        ((np.eye(3), np.eye(3)), r"a: expected shape \(3,\), got \(3, 3\)"),
    ],
)
def test_bad_inertia(arguments, message):
    with pytest.raises(ValueError, match=message):
        sf.SuslovND.from_inertia(*arguments)


def test_reaction_broadcasts():
    body, omega = sf.SuslovND(*BODY_C), [0.3, 0.9, -0.6]
    following = sf.step(body, omega, 0.4)
    assert sf.reaction(body, omega, [0.4, 0.4], following).shape == (2, 3, 3)
    assert sf.reaction(body, [omega] * 4, 0.1).shape == (4, 3, 3)


def test_warnings_point_at_the_caller():
    body = sf.SuslovND([2, 2, 2, 3], [1, 0, 0.5, 0.25])
    omega = [2.0, 1.0, 3.0, 2.0]
    for call in (sf.step, sf.jacobian, sf.reaction):
        with pytest.warns(sf.SingularStepWarning) as caught:
            call(body, omega, 1.0)
        assert caught[0].filename == __file__


def test_bad_arguments():
    body = sf.SuslovND(*BODY_C)
    with pytest.raises(ValueError, match=r"omega0: expected shape \(..., 3\), got \(2,\)"):
        sf.iterate(body, [1, 2], 0.1, 3)
    with pytest.raises(ValueError, match="method: expected one of 'auto', 'gauss', 'rank2'"):
        sf.iterate(body, [1, 2, 3], 0.1, 3, method="ds2")
    with pytest.raises(TypeError, match="body: expected Suslov3D, got SuslovND"):
        sf.step_full(body, [1, 2, 3], 0.1, 3)


def test_bodies_are_values():
    body = sf.SuslovND(*BODY_C)
    assert body == sf.SuslovND(*map(np.array, BODY_C))
    assert hash(body) == hash(sf.SuslovND(*BODY_C))
    assert body != sf.SuslovND(BODY_C[0], BODY_C[0])
    assert body != 3
    import pickle

    again = pickle.loads(pickle.dumps(body))
    assert again == body
    with pytest.raises(ValueError, match="read-only"):
        again.J[0] = 1


def test_to_xarray(rng):
    body = sf.SuslovND(*BODY_C)
    data = sf.iterate(body, rng.normal(size=(5, 3)), 0.2, 4).to_xarray()
    assert data.component.values.tolist() == ["Omega1n", "Omega2n", "Omega3n"]
    assert data.J.shape == (5, 3)
