"""Where n dimensions are solved, `auto` takes states from the closed form."""


import naive
import numba
import numpy as np
import pytest
from naive import mp, mpf, mpmath

import suslov_fast as sf
from suslov_fast._bodies.reduction import is_solved
from suslov_fast._engine import closed_form, jump, threads
from suslov_fast._engine import run as engine
from suslov_fast._engine.layout import for_loops
from suslov_fast._formulas.reduction import as_product


def same(first, second):
    return np.array_equal(first, second, equal_nan=True)


def solved_body(rng, m, kind):
    """J and I: all J equal, or I along one axis and the other J equal."""
    J, I = np.full(m, rng.uniform(1, 4)), rng.normal(size=m)
    if kind == "axis":
        k = rng.integers(m)
        J[k] *= 10 ** rng.uniform(-1, 1)
        I = np.where(np.arange(m) == k, I, 0.0)
    return J, I


def other_moment(J, I):
    """J on the vectors orthogonal to I."""
    return J[0 if abs(I).argmax() else -1]


def canonical_y(J, I, eps, omega):
    """Y of the closed form: 1 at criticality."""
    return eps * (I @ omega) / (2 * other_moment(J, I))


def starts(rng, J, I, eps, where):
    """A state in some part of phase space."""
    omega = rng.normal(size=len(J))
    omega *= rng.uniform(0.05, 0.9) / abs(canonical_y(J, I, eps, omega))
    if where == "next to the steady states":
        omega = I * (I @ omega) / (I @ I)
        omega *= np.sign(eps * (I @ omega)) * (1 + 10.0 ** rng.uniform(-15, -5))
        omega += rng.normal(size=len(J)) * 10.0 ** rng.uniform(-15, -6)
    elif where == "next to criticality":
        omega *= (1 - 10 ** rng.uniform(-10, -3)) / canonical_y(J, I, eps, omega)
    elif where == "beyond criticality":
        omega *= -(10 ** rng.uniform(0.05, 2)) / canonical_y(J, I, eps, omega)
    return omega


def state_of_orbit(J, I, eps, omega, n):
    """State n in 60 digits: the closed form of Section 4 with x = |I| |across|, y = b I.omega."""
    k = abs(I).argmax()
    a, b = mpf(float(other_moment(J, I))), mpf(float(J[k]))
    I, omega, (eps,) = naive.exactly(*I), naive.exactly(*omega), naive.exactly(eps)
    with mp.workdps(700):
        square, p = mpmath.fdot(I, I), mpmath.fdot(I, omega)
        across = [w - p / square * i for w, i in zip(omega, I, strict=True)]
        x, y, sign = mpmath.sqrt(square * mpmath.fdot(across, across)), b * p, 1
    if x < mpf(10) ** -600:
        return omega
    if eps < 0:
        y, eps, sign = -y, -eps, -1
    q, level = 4 * a * b + eps**2 * x**2, mpmath.sqrt((a * b * x**2 + y**2) / (a * b))
    t = eps * level / mpmath.sqrt(q)
    limit, c = 2 * a * b * level / mpmath.sqrt(q), 1 / (a * b * (1 + t) ** 2)
    G = (2 * a * b - eps * y) * (2 * a * b + eps * y) / q
    if y < 0:
        B = limit - y
        A, power, powers = x**2 * G / B, (c * G) ** n, (c * G) ** (2 * n)
    else:
        A, B = limit + y, x**2 / (limit + y)
        power, powers = c * (c * G) ** (n - 1), c * (c * G) ** (2 * n - 1)
    x_n, y_n = x * power * 2 * limit, sign * limit * (powers * A - B)
    D = powers * A + B
    return [y_n / D / (b * square) * i + x_n / D / x * v for i, v in zip(I, across, strict=True)]


def energy_error(J, computed, exact):
    """In the norm of the energy."""
    difference = [mpf(float(c)) - e for c, e in zip(computed, exact, strict=True)]
    size = naive.energy_nd(J, exact)
    return float(mpmath.sqrt(naive.energy_nd(J, difference) / size)) if size else np.inf


WHERE = (
    "anywhere",
    "next to the steady states",
    "next to criticality",
    "beyond criticality",
)


@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("kind", ["equal", "axis"])
@pytest.mark.parametrize("m", [2, 3, 5, 9])
def test_orbits_against_the_implicit_equations(rng, kind, where, m):
    for eps in (0.3, -0.3):
        J, I = solved_body(rng, m, kind)
        omega = starts(rng, J, I, eps, where)
        exact = naive.orbit_nd(J, I, eps, omega, 12)
        orbit = sf.iterate(sf.SuslovND(J, I), omega, eps, 12)
        assert orbit.status == sf.Status.OK
        assert max(energy_error(J, *each) for each in zip(orbit.omega, exact, strict=True)) < 1e-14
        assert energy_error(J, orbit.omega[-1], state_of_orbit(J, I, eps, omega, 12)) < 1e-14


@pytest.mark.parametrize("where", WHERE)
@pytest.mark.parametrize("kind", ["equal", "axis"])
@pytest.mark.parametrize("n", [300, 10**4, 10**6])
def test_far_states_against_60_digits(rng, kind, where, n):
    for m in (3, 4, 17):
        J, I = solved_body(rng, m, kind)
        eps = rng.choice([-0.4, 0.4])
        omega = starts(rng, J, I, eps, where)
        exact, body = state_of_orbit(J, I, eps, omega, n), sf.SuslovND(J, I)
        for save_every in (n, None):
            final = sf.iterate(body, omega, eps, n, save_every=save_every).final
            assert energy_error(J, final, exact) < 1e-14
        many = sf.iterate(body, omega, eps, n, save_every=max(n // 100, 1)).omega
        assert energy_error(J, many[-1], exact) < 1e-14


def test_slow_orbits_turn_after_very_many_steps(rng):
    """Every digit of the level counts there."""
    J, I = solved_body(rng, 4, "equal")
    omega = 1e-5 * starts(rng, J, I, 1.0, "anywhere")
    for n in (10**5, 10**6):
        final = sf.iterate(sf.SuslovND(J, I), omega, 1.0, n, save_every=n).final
        assert energy_error(J, final, state_of_orbit(J, I, 1.0, omega, n)) < 1e-14


def test_two_numbers_whose_product_has_76_bits(rng):
    product = numba.njit(lambda p, lost: as_product(p, lost))
    ends = [1.0, 2.0, 4.0, np.nextafter(4.0, 0.0), np.nextafter(1.0, 0.0), 1e-290, 1e290]
    for p in (*ends, *rng.normal(size=100) * 10 ** rng.uniform(-20, 20, 100)):
        for lost in rng.uniform(-1, 1, 3) * 2.0**-53 * abs(p):
            if p + lost == p:
                A, B = product(p, lost)
                error = mpf(float(A)) * mpf(float(B)) - mpf(float(p)) - mpf(float(lost))
                assert abs(error) < mpf(2) ** -76 * abs(p)
                assert 0.999 < B < 2.001


def solved(body):
    return is_solved(*for_loops(body, 0.2, body.shape)[:2])


def test_which_bodies_are_solved():
    """To the last bit of J and I; the functions that say so by name allow for rounding."""
    after = np.nextafter(2.0, 3.0)
    cases = [
        ([2.0, 2.0, 2.0], [0.1, 0.2, 0.3], True),
        ([2.0, 2.0, after], [0.1, 0.2, 0.3], False),
        ([2.0, 2.0, 5.0], [0.0, 0.0, 0.3], True),
        ([2.0, 2.0, 5.0], [0.0, 0.0, -0.3], True),
        ([2.0, 2.0, 5.0], [0.0, 1e-300, 0.3], False),
        ([2.0, after, 5.0], [0.0, 0.0, 0.3], False),
        ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0], True),
    ]
    for J, I, expected in cases:
        assert solved(sf.SuslovND(J, I)).tolist() == [expected]
    J, I, expected = zip(*cases, strict=True)
    assert solved(sf.SuslovND(J, I)).tolist() == list(expected)
    assert solved(sf.SuslovND([3.0], [0.1])).all()


def test_other_bodies_are_iterated(rng):
    """As `rank2` does, bit for bit; and so is the orientation, one step, and few to the last."""
    omega, near = rng.normal(size=(9, 3)), [2.0, 2.0, np.nextafter(2.0, 3.0)]
    solved, other = sf.SuslovND([2.0] * 3, [0.1, 0.2, 0.3]), sf.SuslovND(near, [0.1, 0.2, 0.3])
    for body, options in (
        (other, {}),
        (other, {"save_every": None}),
        (solved, {"attitude": True}),
        (solved, {"save_every": None}),
    ):
        steps = 20 if body is solved else 100
        auto = sf.iterate(body, omega, 0.3, steps, **options)
        rank2 = sf.iterate(body, omega, 0.3, steps, method="rank2", **options)
        assert same(auto.omega, rank2.omega)
        assert same(auto.final, rank2.final)
    jumped = sf.iterate(solved, omega, 0.3, 100)
    stepped = sf.iterate(solved, omega, 0.3, 100, method="rank2")
    assert not same(jumped.omega, stepped.omega)
    np.testing.assert_allclose(jumped.omega, stepped.omega, rtol=0, atol=1e-13)


def test_n_3_is_the_three_dimensional_run(rng):
    I1, I2, I13, I23 = rng.uniform(1, 4, (2, 9)).tolist() + rng.normal(size=(2, 9)).tolist()
    omega = 30 * rng.normal(size=(9, 2))
    three = sf.iterate(sf.Suslov3D(I1, I2, I13, I23), omega, 0.4, 50)
    nd = sf.SuslovND(np.stack([I2, I1], axis=-1), -np.stack([I13, I23], axis=-1))
    states = np.stack([omega[:, 1], -omega[:, 0]], axis=-1)
    run = sf.iterate(nd, states, 0.4, 50)
    expected = np.stack([three.omega[..., 1], -three.omega[..., 0]], axis=-1)
    assert same(run.omega[0], states)
    np.testing.assert_allclose(run.omega, expected, rtol=0, atol=1e-12)
    assert set(three.status) == {sf.Status.OK, sf.Status.SUPERCRITICAL}
    assert set(run.status) == {sf.Status.OK}


def mixed_batch(rng, size, m):
    """Solved bodies and others, states of all kinds, some without a next one."""
    J, I = np.empty((2, size, m))
    for b in range(size):
        J[b], I[b] = solved_body(rng, m, ("equal", "axis")[b % 2])
    J[::5, 0] *= 1.5  # solved no more, but for n = 3 or where I is along e_1
    I[3::11] = 0.0
    eps = rng.choice([-0.5, 0.0, 0.1, 0.5], size)
    omega = rng.normal(size=(size, m)) * 10 ** rng.uniform(-1, 1.5, (size, 1))
    omega[4::13] = I[4::13] * rng.uniform(-2, 2, (len(omega[4::13]), 1))
    omega[2::17] *= 1e280
    omega[6] = np.nan
    at_pole = 1
    J[at_pole], I[at_pole], omega[at_pole], eps[at_pole] = 1.0, 0.0, 0.0, 1.0
    I[at_pole, 0], omega[at_pole, :2] = 1.0, [3.0, 1.0][:m]
    return sf.SuslovND(J, I), omega, eps


def run(body, omega, eps, steps=40, **options):
    return sf.iterate(body, omega, eps, steps, on_singular="ignore", **options)


def some(body, chosen):
    return sf.SuslovND(body.J[chosen], body.I[chosen])


@pytest.mark.parametrize("save_every", [1, 3, None])
@pytest.mark.parametrize("m", [1, 2, 3, 8, 11])
def test_alone_or_in_a_batch(rng, m, save_every):
    body, omega, eps = mixed_batch(rng, 150, m)
    together = run(body, omega, eps, save_every=save_every)
    assert together.status[6] == sf.Status.NONFINITE
    assert m == 1 or (together.status[1], together.failed_at[1]) == (sf.Status.SINGULAR, 1)
    assert not np.isinf(together.omega).any()
    order = rng.permutation(150)
    shuffled = run(some(body, order), omega[order], eps[order], save_every=save_every)
    for name in ("omega", "final", "status", "failed_at"):
        axis = 1 if name == "omega" else 0
        assert same(getattr(together, name).take(order, axis), getattr(shuffled, name)), name
    for i in (0, 1, 2, 3, 4, 5, 6, 63, 64, 149):
        alone = run(some(body, i), omega[i], eps[i], save_every=save_every)
        assert same(alone.omega, together.omega[:, i])
        assert same(alone.final, together.final[i])
        assert alone.status == together.status[i]
        assert alone.failed_at == together.failed_at[i]


@pytest.mark.parametrize("m", [2, 3, 8])
def test_how_they_end_is_how_iteration_ends_them(rng, m):
    body, omega, eps = mixed_batch(rng, 150, m)
    auto, rank2 = run(body, omega, eps), run(body, omega, eps, method="rank2")
    assert (auto.status == rank2.status).all()
    assert (auto.failed_at == rank2.failed_at).all()
    assert same(np.isnan(auto.omega), np.isnan(rank2.omega))
    states = auto.omega[:, auto.status >= 0]
    assert np.isfinite(states).all()


@pytest.mark.parametrize("size", [1, 3, 8, 100])
@pytest.mark.parametrize("steps", [31, 300])
def test_one_body_for_all(rng, size, steps):
    for kind in ("equal", "axis"):
        J, I = solved_body(rng, 4, kind)
        body, omega = sf.SuslovND(J, I), rng.normal(size=(size, 4))
        for save_every in (1, 7, None):
            together = run(body, omega, 0.2, steps, save_every=save_every)
            for i in (0, size // 2, size - 1):
                alone = run(body, omega[i], 0.2, steps, save_every=save_every)
                assert same(alone.omega, together.omega[:, i])
                assert same(alone.final, together.final[i])


@pytest.mark.compiled
@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize("m", [2, 4])
def test_number_of_threads(rng, monkeypatch, m, save_every):
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    body, omega, eps = mixed_batch(rng, 333, m)
    counts = [None, *range(1, numba.config.NUMBA_NUM_THREADS + 1)]
    results = [run(body, omega, eps, threads=each, save_every=save_every) for each in counts]
    for result in results[1:]:
        assert same(result.omega, results[0].omega)
        assert same(result.status, results[0].status)


@pytest.mark.parametrize("save_every", [1, 4, None])
@pytest.mark.parametrize("m", [2, 3, 9])
def test_a_run_that_is_gone_on_with(rng, tmp_path, m, save_every):
    body, omega, eps = mixed_batch(rng, 70, m)
    for steps, cuts in ((30, (15, 15)), (30, (1, 0, 28, 1)), (300, (20, 280)), (300, (256, 44))):
        whole = run(body, omega, eps, steps, save_every=save_every)
        gone_on = run(body, omega, eps, cuts[0], save_every=save_every)
        for more in cuts[1:]:
            gone_on.save(tmp_path / "run.npz")
            gone_on = sf.Trajectories.load(tmp_path / "run.npz").extend(more, on_singular="ignore")
        for name in ("omega", "n", "final", "status", "failed_at"):
            assert same(getattr(whole, name), getattr(gone_on, name)), name


@pytest.mark.parametrize("m", [2, 4])
def test_however_the_engine_cuts_a_run(rng, monkeypatch, m):
    body, omega, eps = mixed_batch(rng, 150, m)
    whole = run(body, omega, eps, 500, save_every=2)
    chosen = solved(body) & (abs(omega).max(axis=-1) < 1e100)
    alone = run(some(body, chosen), omega[chosen], eps[chosen], 500, save_every=2)
    assert same(alone.omega, whole.omega[:, chosen])
    calls = []
    monkeypatch.setattr(closed_form, "SLICE", 2**12)
    monkeypatch.setattr(jump, "_TOGETHER", 2**11)
    monkeypatch.setattr(engine, "_TOGETHER", 2**12)
    original = threads.run
    monkeypatch.setattr(threads, "run", lambda *each: (calls.append(each[1]), original(*each)))
    seen = []
    cut = run(body, omega, eps, 500, save_every=2, progress=lambda *each: seen.append(each))
    assert seen == sorted(seen)
    assert seen[-1] == (500, 500)
    alone_too = run(some(body, chosen), omega[chosen], eps[chosen], 500, save_every=2)
    assert len(calls) > 10
    assert same(whole.omega, cut.omega)
    assert same(whole.status, cut.status)
    assert same(whole.final, cut.final)
    assert same(alone.omega, alone_too.omega)


@pytest.mark.parametrize("batch", [1, 3, 7, 8, 9, 66])
@pytest.mark.parametrize("m", [1, 3, 8, 19])
def test_memory_of_saved_states(rng, batch, m):
    """However rows lie to the cache lines, all is written, and nothing beside it."""
    rows = 70
    J, I = solved_body(rng, m, "equal")
    body, omega, size = sf.SuslovND(J, I), rng.normal(size=(batch, m)), rows * batch * m
    expected = None
    for shift in (0, 3):
        memory = np.full(size + 16, 7.0)
        out = memory[shift : shift + size].reshape((rows, batch, m))
        sf.iterate(body, omega, 0.2, rows - 1, out=out, threads=1)
        expected = out if expected is None else expected
        assert same(out, expected)
        assert (memory[:shift] == 7.0).all()
        assert (memory[shift + size :] == 7.0).all()
    few = sf.iterate(body, omega, 0.2, 60).omega
    assert same(few, expected[:61])
    last = sf.iterate(body, omega, 0.2, rows - 1, save_every=rows - 1).final
    np.testing.assert_allclose(expected[-1], last, rtol=0, atol=1e-14 * abs(omega).max())


def test_states_that_do_not_move(rng):
    J, I = np.full((4, 3), 2.0), rng.normal(size=(4, 3))
    omega, eps = rng.normal(size=(4, 3)), np.array([0.3, 0.0, 0.3, 0.3])
    I[0] = 0.0
    I[2], omega[2] = [0.5, -1.0, 0.25], [1.0, -2.0, 0.5]
    I[3], omega[3] = [0.0, 0.7, 0.0], [0.0, -0.3, 0.0]
    for steps, save_every in ((7, 1), (10**12, 10**11), (10**12, None)):
        result = sf.iterate(sf.SuslovND(J, I), omega, eps, steps, save_every=save_every)
        assert result.ok
        assert (result.omega == omega).all()
    line = sf.SuslovND([3.0], [0.7])
    assert (sf.iterate(line, [[0.3], [-5.0]], 0.2, 50).omega == [[0.3], [-5.0]]).all()
    # From the one steady state whose d vanishes the map leads nowhere.
    ends = sf.iterate(sf.SuslovND([1.0] * 3, [1.0, 0.0, 0.0]), [2.0, 0, 0], 1.0, 40, **QUIET)
    assert ends.status == sf.Status.SINGULAR
    assert ends.failed_at == 1


QUIET = {"on_singular": "ignore"}
POLE = [3.0, 1.0, 0.0]  # of a body that is the unit of three dimensions: Y = 1.5, X**2 = 0.5


def test_poles():
    body = sf.SuslovND([1.0] * 3, [1.0, 0.0, 0.0])
    with pytest.warns(sf.SingularStepWarning, match="1 of 3 trajectories: singular step, first: 1"):
        result = sf.iterate(body, [[0.1, 0.2, 0.3], POLE, [5.0, 0.0, 0.1]], 1.0, 100)
    assert result.status.tolist() == [sf.Status.OK, sf.Status.SINGULAR, sf.Status.OK]
    assert result.failed_at.tolist() == [-1, 1, -1]
    assert (result.omega[0, 1] == POLE).all()
    assert np.isnan(result.omega[1:, 1]).all()
    with pytest.raises(sf.SingularStepError):
        sf.iterate(body, POLE, 1.0, 100, save_every=None, on_singular="raise")


def test_orbits_past_their_pole_jump():
    """Far states of orbits that pass it after some 800 steps, in few steps of many."""
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


def test_where_an_orbit_beyond_a_matrix_that_is_singular_goes():
    """On Y = 1 (dsn) leaves a direction open if three J are equal: what it allows goes on."""
    J, I, omega = [2.0] * 4, [1.0, 0.0, 0.5, 0.25], [2.0, 1.0, 3.0, 2.0]
    states = sf.iterate(sf.SuslovND(J, I), omega, 1.0, 1).omega
    for residual in naive.dsn(naive.exactly(*J), naive.exactly(*I), 1, *states.tolist()):
        assert abs(residual) < 1e-14


@pytest.mark.parametrize("kind", ["equal", "axis"])
@pytest.mark.parametrize("exponent", [-800, -500, -100, 100, 500, 800])
@pytest.mark.parametrize("m", [2, 4])
def test_units_by_powers_of_two_are_exact(rng, kind, exponent, m):
    J, I = solved_body(rng, m, kind)
    omega, scale = 5 * rng.normal(size=(30, m)), 2.0**exponent
    for save_every in (1, None):
        options = {"save_every": save_every, "on_singular": "ignore"}
        expected = sf.iterate(sf.SuslovND(J, I), omega, 0.3, 40, **options).omega
        for body, state, eps in (
            (sf.SuslovND(J, I), omega * scale, 0.3 / scale),
            (sf.SuslovND(J * scale, I * scale), omega, 0.3),
            (sf.SuslovND(J, I * scale), omega, 0.3 / scale),
        ):
            far = sf.iterate(body, state, eps, 40, **options).omega
            unit = scale if state is not omega else 1.0
            assert same(far / unit, expected)


@pytest.mark.parametrize("scale", [1e-150, 1e150])
@pytest.mark.parametrize("what", ["time", "inertia", "coupling"])
def test_any_units(rng, scale, what):
    J, I = solved_body(rng, 5, "equal")
    omega, eps = rng.normal(size=5), 0.3
    if what == "time":
        omega, eps = omega * scale, eps / scale
    elif what == "inertia":
        J, I = J * scale, I * scale
    else:
        I, eps = I * scale, eps / scale
    states = sf.iterate(sf.SuslovND(J, I), omega, eps, 12).omega
    for n in (1, 5, 12):
        assert energy_error(J, states[n], state_of_orbit(J, I, eps, omega, n)) < 1e-14


@pytest.mark.parametrize("across", [1e-250, 1e-150, 1e-30])
def test_however_close_to_the_steady_states(across):
    """The direction of the other part keeps its digits."""
    J, I = [3.0, 2.0, 2.0, 2.0], [0.7, 0.0, 0.0, 0.0]
    omega = [1.0, 0.3 * across, -0.4 * across, 1.1 * across]
    for n in (10, 700, 3000):
        states = sf.iterate(sf.SuslovND(J, I), omega, 0.3, n, save_every=n)
        exact = state_of_orbit(np.array(J), np.array(I), 0.3, omega, n)
        # All components to their last digits, not beside the largest.
        for computed, expected in zip(states.final, exact, strict=True):
            if abs(expected) > 1e-280:
                assert abs(mpf(float(computed)) - expected) < 1e-14 * abs(expected)


def test_what_is_out_of_range_is_iterated(rng):
    """As `rank2` does, bit for bit: states at the ends of float64, steps far too long."""
    body = sf.SuslovND([2.0] * 3, [0.1, 0.2, 0.3])
    omega = rng.normal(size=(5, 3)) * np.array([1e-300, 1e300, 1.6e307, 5e-310, 1.0])[:, None]
    eps = np.array([1e299, 1e-300, 1e-308, 1e300, 1e100])
    auto, rank2 = (run(body, omega, eps, 9, method=each) for each in ("auto", "rank2"))
    assert same(auto.omega, rank2.omega)
    assert (auto.status == rank2.status).all()
    apart = sf.SuslovND([1e-95, 1.0, 1.0], [0.3, 0.0, 0.0])
    auto, rank2 = (run(apart, omega[-1], 0.1, 9, method=each) for each in ("auto", "rank2"))
    assert same(auto.omega, rank2.omega)


@pytest.mark.parametrize("m", [2, 3, 6])
def test_the_cost_is_that_of_what_is_saved(rng, monkeypatch, m):
    """Whatever lies between: no step is taken, and loops are told of the same work."""
    for name in ("iterate_nd", "_iterate"):
        monkeypatch.setattr(jump, name, lambda *_: pytest.fail("a step was taken"))
    work, original = [], threads.run
    monkeypatch.setattr(threads, "run", lambda *each: (work.append(each[1]), original(*each)))
    J, I = solved_body(rng, m, "equal")
    omega, found = rng.normal(size=(30, m)), []
    for every in (1, 1000, 10**12):
        work.clear()
        sf.iterate(sf.SuslovND(J, I), omega, 0.1, 50 * every, save_every=every)
        found.append(sum(work))
    assert found[0] == found[1] == found[2]
    work.clear()
    sf.iterate(sf.SuslovND(J, I), omega, 0.1, 10**15, save_every=None)
    assert sum(work) < found[0]


def test_integrals_along_a_run(rng):
    for kind in ("equal", "axis"):
        J, I = solved_body(rng, 5, kind)
        omega = rng.normal(size=(20, 5))
        orbits = sf.iterate(sf.SuslovND(J, I), omega, 0.05, 10**6, save_every=10**4)
        F = orbits.first_integral()
        assert (abs(F / F[0] - 1)).max() < 1e-14
        across = omega - np.outer(omega @ I, I) / (I @ I)
        moved = orbits.omega - (orbits.omega @ I)[..., None] * I / (I @ I)
        # The part orthogonal to I keeps its direction.
        along = (moved * across).sum(axis=-1, keepdims=True) / (across**2).sum(axis=-1)[:, None]
        np.testing.assert_allclose(moved, along * across, rtol=0, atol=1e-14 * abs(omega).max())


def test_ensembles(rng, tmp_path):
    pytest.importorskip("zarr")
    body, omega, eps = mixed_batch(rng, 40, 3)
    omega[6] = 0.1
    for name, save_every, chunk in (("saved", 3, {"n": 7}), ("last", None, None)):
        expected = run(body, omega, eps, 100, save_every=save_every)
        data = sf.ensemble(
            body, omega, eps, 100, store=tmp_path / name, save_every=save_every, chunk=chunk
        )
        assert same(data.omega.to_numpy(), expected.omega)
        assert same(data.status.to_numpy(), expected.status)
        assert same(data.failed_at.to_numpy(), expected.failed_at)
