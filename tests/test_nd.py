"""The n-dimensional map against the implicit equations (dsn) in 60 digits."""

from itertools import pairwise

import naive
import numpy as np
import pytest
from scipy.optimize import brentq

import suslov_fast as sf
from suslov_fast._engine import run as parts
from suslov_fast._engine import threads
from suslov_fast._engine.iterate import iterate_nd as run
from suslov_fast._engine.layout import flat_parameter, for_loops
from suslov_fast._engine.run import Run
from suslov_fast._maps.registry import map_of

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
    for i, state in enumerate(omega):
        alone = sf.iterate(body, state, 0.3, 4, method="rank2")
        assert (alone.omega == together[:, i]).all()
    eliminated = sf.iterate(body, omega, 0.3, 1, method="gauss").final
    size = abs(together[1]).max(axis=-1, keepdims=True)
    assert (abs(together[1] - eliminated) / size).max() < 1e-11


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
    assert np.isnan(result.omega[1:, 0]).all()
    alone = sf.iterate(sf.SuslovND(J, I), omega[1], 1.0, 5, method=method)
    assert (result.omega[:, 1] == alone.omega).all()


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
    assert np.isnan(result.omega[1:, 0]).all()


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
        assert (sf.iterate(body, omega, eps, 7, method=method).omega == omega).all()


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
    assert np.array_equal(together.omega[:, order], shuffled.omega, equal_nan=True)
    for i in (0, 1, 31, 32, 44):
        alone = sf.iterate(sf.SuslovND(body.J[i], body.I[i]), omega[i], eps[i], 20, **options)
        assert np.array_equal(alone.omega, together.omega[:, i], equal_nan=True)
        assert alone.status == together.status[i]


@pytest.mark.parametrize("method", METHODS)
def test_save_every(rng, method):
    body = sf.SuslovND(*BODY_C)
    omega = rng.normal(size=(70, 3))
    every = sf.iterate(body, omega, 0.2, 60, method=method)
    some = sf.iterate(body, omega, 0.2, 60, method=method, save_every=7)
    assert (some.omega == every.omega[::7]).all()
    assert (some.final == every.final).all()


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


def problem(J, I, eps, omega, stop=12, every=1, method="rank2", **options):
    """A problem as `iterate` hands it to the engine; `before` is the outcome to go on from."""
    size, m = omega.shape
    before = options.pop("before", None)
    start = options.pop("start", 0)
    rows = stop // every - (start // every if start else -1)
    turns = rows if "orientation" in options else 0
    body = sf.SuslovND(J, I)
    return Run(
        map_of(body), body, (size,), omega, eps, stop, every, method,
        parameters=for_loops(body, eps, (size,)),
        time_step=flat_parameter(eps, (size,)),
        start=start,
        saved=np.full((rows, size, m), 7.0),
        turns=np.full((turns, size, m + 1, m + 1), 7.0),
        resume=before.resume if before else {},
        **options,
    )


def everything(problem):
    """All that a run writes."""
    outcome = run(problem)
    arrays = [problem.saved, problem.turns, outcome.final, outcome.status, outcome.failed_at]
    return arrays + [outcome.resume[name] for name in sorted(outcome.resume)]


def in_cuts(cuts, *arguments, **options):
    """The same, where a run is gone on with at each of `cuts`."""
    before, saved, turns = None, [], []
    for start, stop in pairwise(cuts):
        piece = problem(*arguments, stop=stop, start=start, before=before, **options)
        before = run(piece)
        saved.append(piece.saved)
        turns.append(piece.turns)
    arrays = [np.concatenate(saved), np.concatenate(turns)]
    arrays += [before.final, before.status, before.failed_at]
    return arrays + [before.resume[name] for name in sorted(before.resume)]


def same(first, second):
    return all(np.array_equal(*pair, equal_nan=True) for pair in zip(first, second, strict=True))


def of(chosen, arguments):
    return [each[chosen] if len(each) else each for each in arguments]


def last_orientation(outcome):
    return outcome.resume["columns"].swapaxes(1, 2)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [1, 2, 4, 9])
@pytest.mark.parametrize("every", [1, 5, 99])
def test_cut_into_calls_and_alone(rng, method, m, every):
    arguments = every_way_through_a_step(rng, 43, m)
    together = everything(problem(*arguments, method=method, every=every))
    cuts = in_cuts((0, 1, 2, 7, 12), *arguments, method=method, every=every)
    assert same(together, cuts)
    for i in range(0, 43, 3):
        alone = everything(problem(*of([i], arguments), method=method, every=every))
        assert same(alone[:2], [each[:, [i]] for each in together[:2]])
        assert same(alone[2:], of([i], together[2:]))


@pytest.mark.compiled
@pytest.mark.parametrize("method", METHODS)
def test_parallel_build(rng, method, monkeypatch):
    arguments = every_way_through_a_step(rng, 43, 6)
    orientation = np.tile(np.eye(7), (43, 1, 1))
    options = {"method": method, "orientation": orientation, "every": 3, "stop": 20}
    compiled = everything(problem(*arguments, **options))
    assert set(compiled[3]) >= {sf.Status.OK, sf.Status.SINGULAR}
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    assert same(compiled, everything(problem(*arguments, **options)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("oriented", [False, True])
def test_parts_and_threads(rng, monkeypatch, method, oriented):
    """However the engine cuts a run, and though statuses are looked at in between."""
    arguments = every_way_through_a_step(rng, 70, 4)
    options = {"method": method, "every": 7, "stop": 60}
    if oriented:
        options["orientation"] = np.tile(np.eye(5), (70, 1, 1))
    whole = everything(problem(*arguments, **options))
    monkeypatch.setattr(parts, "_PART", 1)
    monkeypatch.setattr(parts, "_ABREAST", 16)
    monkeypatch.setattr(parts, "_LENGTH", 9)
    monkeypatch.setattr(parts, "_SHORT", -1.0)
    monkeypatch.setattr(parts, "_LONG", np.inf)
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    seen = []
    options["progress"] = lambda *n: seen.append(n)
    assert same(whole, everything(problem(*arguments, **options)))
    assert len(seen) >= 60
    assert seen == sorted(seen)
    assert seen[-1] == (60, 60)


@pytest.mark.parametrize("m", [4, 9])
def test_elimination_without_room_beforehand(rng, m):
    """Runs with orientations have room for it; others compute anew what turns out to need it."""
    arguments = every_way_through_a_step(rng, 70, m)
    without = everything(problem(*arguments, every=5))
    still = np.zeros((70, m + 1, m + 1)) + np.eye(m + 1)
    turned = problem(*arguments, every=5, orientation=still)
    outcome = run(turned)
    assert same(without[:1] + without[2:5], [turned.saved, *outcome[:3]])
    assert same(without, in_cuts((0, 4, 12), *arguments, every=5))
    J, I, eps, omega = arguments
    gaps = abs(1 - eps[:, None] / 2 * (I * omega).sum(axis=1)[:, None] / J)
    assert (np.sort(gaps)[:, 1] < 0.1).any()  # for which the step of rank 2 is not enough


@pytest.mark.parametrize("method", METHODS)
def test_what_is_gone_on_from_stays(rng, method):
    arguments = every_way_through_a_step(rng, 20, 3)
    before = run(problem(*arguments, stop=5, method=method))
    kept = {name: array.copy() for name, array in before.resume.items()}
    first = everything(problem(*arguments, start=5, before=before, method=method))
    assert same(before.resume.values(), kept.values())
    assert same(first, everything(problem(*arguments, start=5, before=before, method=method)))


def test_auto_is_rank2(rng):
    body, omega = sf.SuslovND(*BODY_C), rng.normal(size=(4, 3))
    auto = sf.iterate(body, omega, 0.2, 9)
    assert (auto.omega == sf.iterate(body, omega, 0.2, 9, method="rank2").omega).all()
    assert (sf.step(body, omega, 0.2) == auto.omega[1]).all()


@pytest.mark.compiled
def test_large_populations_and_dimensions(rng):
    body = sf.SuslovND(rng.uniform(1, 4, (100_000, 9)), rng.normal(size=(100_000, 9)))
    result = sf.iterate(body, rng.normal(size=(100_000, 9)), 0.1, 20, save_every=None)
    assert result.ok
    J, I = rng.uniform(1, 4, 4999), rng.normal(size=4999) / 70
    single = sf.iterate(sf.SuslovND(J, I), rng.normal(size=4999) / 70, 0.1, 50, save_every=10)
    assert single.ok
    assert np.ptp(sf.energy(single.body, single.omega)) < 1e-2


@pytest.mark.parametrize("shift", [0, 1, 5])
@pytest.mark.parametrize("batch", [1, 7, 64, 131])
@pytest.mark.parametrize("m", [1, 2, 3, 7, 8, 11, 24])
def test_memory_of_saved_states(rng, m, batch, shift):
    """Wherever `out` begins and however its rows lie to the cache lines, all is written."""
    J, I, eps, _ = random_problem(rng, m)
    body, omega, steps = sf.SuslovND(J, I), rng.normal(size=(batch, m)) / m, 4
    alone = [sf.iterate(body, omega, eps, n, save_every=None, method="rank2") for n in range(5)]
    last = [run.final for run in alone]
    memory = np.full(batch * (steps + 1) * m + 16, 7.0)
    out = memory[shift : shift + memory.size - 16].reshape((steps + 1, batch, m))
    sf.iterate(body, omega, eps, steps, out=out, method="rank2")
    assert np.array_equal(out, last)
    assert (memory[:shift] == 7).all()
    assert (memory[shift + out.size :] == 7).all()


def test_n_3_is_the_three_dimensional_map(rng):
    """(Omega_13, Omega_23) = (Omega2, -Omega1), J = (I2, I1), I = (-I13, -I23)."""
    I1, I2, I13, I23 = 3.0, 2.0, -0.4, 0.7
    three, nd = sf.Suslov3D(I1, I2, I13, I23), sf.SuslovND([I2, I1], [-I13, -I23])
    omega = rng.normal(size=(5, 2))
    states = np.stack([omega[:, 1], -omega[:, 0]], axis=-1)
    expected = sf.iterate(three, omega, 0.4, 30).omega
    expected = np.stack([expected[..., 1], -expected[..., 0]], axis=-1)
    np.testing.assert_allclose(sf.iterate(nd, states, 0.4, 30).omega, expected, atol=1e-13)


@pytest.mark.parametrize("method", METHODS)
def test_states_that_do_not_exist(rng, method):
    arguments = every_way_through_a_step(rng, 20, 3)
    arguments[3][4, 1] = np.nan
    with_nan = run(problem(*arguments, method=method, orientation=np.tile(np.eye(4), (20, 1, 1))))
    assert with_nan.status[4] == sf.Status.NONFINITE
    assert with_nan.failed_at[4] == 0
    assert np.isnan(last_orientation(with_nan)[4]).all()
    without = [3, 5, 6]
    given = problem(*arguments, method=method)
    outcome = run(given)
    assert np.isnan(given.saved[:, 4]).all()
    assert np.isnan(outcome.final[4]).all()
    others = problem(*of(without, arguments), method=method)
    run(others)
    assert np.array_equal(given.saved[:, without], others.saved, equal_nan=True)
    later = run(problem(*arguments, start=12, stop=15, before=outcome, method=method))
    assert later.failed_at[4] == 0
    assert later.status[4] == sf.Status.NONFINITE


@pytest.mark.parametrize("method", METHODS)
def test_failures_stay_what_they_were(rng, method):
    arguments = every_way_through_a_step(rng, 60, 5)
    arguments[3][0] = np.nan
    before = run(problem(*arguments, method=method))
    failed = before.failed_at >= 0
    assert set(before.status[failed]) == {sf.Status.SINGULAR, sf.Status.NONFINITE}
    after = run(problem(*arguments, start=12, stop=20, before=before, method=method))
    assert (after.failed_at[failed] == before.failed_at[failed]).all()
    assert (after.status[failed] == before.status[failed]).all()
    assert np.isnan(after.final[failed]).all()


AT_REST = [1e200, 1e-200, 1.0], [5e-324, 0.0, -1.7e308], [-0.0, 0.0, 1e-310]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("omega", AT_REST)
def test_what_does_not_move_stays_as_it_was_given(method, omega):
    omega = np.array([omega] * 3)
    J, I = np.tile([1.0, 2.0, 3.0], (3, 1)), np.array([[0.0] * 3, [1.0, 0.0, 1.0], [0.0] * 3])
    eps = np.array([0.3, 0.0, 0.0])
    for cuts in ((0, 7), (0, 3, 7), (0, 0, 7)):
        saved, _, final, *_ = in_cuts(cuts, J, I, eps, omega, method=method)
        assert (saved == omega).all()
        assert (final == omega).all()


@pytest.mark.parametrize("method", METHODS)
def test_the_state_at_the_start_is_what_was_given(method):
    omega = np.array([[1e200, 1e-200, 1.0]])
    arguments = [[1.0, 2.0, 3.0]], [[0.5, 0.2, 1.0]], np.array([1e-200]), omega
    given = problem(*arguments, stop=1, method=method)
    run(given)
    assert (given.saved[0] == omega).all()
    assert (run(problem(*arguments, stop=0, method=method)).final == omega).all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("exponent", [-1000, -600, -100, 100, 600, 1000])
@pytest.mark.parametrize("which", ["eps", "inertia", "coupling"])
def test_units_by_powers_of_two_are_exact(rng, method, exponent, which):
    J, I, eps, omega = every_way_through_a_step(rng, 30, 4)
    omega = np.clip(omega, -1e3, 1e3)
    expected = everything(problem(J, I, eps, omega, method=method))
    scale = 2.0**exponent
    if which == "eps":
        far = everything(problem(J, I, eps / scale, omega * scale, method=method))
        assert np.array_equal(far[0] / scale, expected[0], equal_nan=True)
    elif which == "inertia":
        far = everything(problem(J * scale, I * scale, eps, omega, method=method))
        assert np.array_equal(far[0], expected[0], equal_nan=True)
    else:
        far = everything(problem(J, I * scale, eps / scale, omega, method=method))
        assert np.array_equal(far[0], expected[0], equal_nan=True)
    assert (far[3] == expected[3]).all()


@pytest.mark.parametrize("method", METHODS)
def test_subnormal_states_alone_in_a_batch_and_in_cuts(rng, method):
    size = 200
    J, I = rng.uniform(1, 4, (size, 3)), rng.normal(size=(size, 3))
    scale = np.exp2(rng.integers(-1074, -1000, (size, 1)))
    omega = rng.uniform(1, 3, (size, 3)) * scale
    eps = rng.uniform(0.05, 1.5, size) * 1e300
    arguments = J, I * 1e10, eps, omega
    together = everything(problem(*arguments, stop=30, method=method))
    assert same(together, in_cuts((0, 15, 30), *arguments, method=method))
    assert (np.ptp(together[0], axis=0) > 0).any()
    for i in range(0, size, 7):
        alone = everything(problem(*of([i], arguments), stop=30, method=method))
        assert same(alone[2:], of([i], together[2:]))


def naive_attitude(eps, states):
    """R_next = R cay(eps (Omega + Omega_next) / 2), with matrices as they stand."""
    n = states.shape[1] + 1
    R, all_R = np.eye(n), [np.eye(n)]
    for v, w in pairwise(states):
        S = np.zeros((n, n))
        S[:-1, -1] = 0.5 * eps * (v + w)
        S[-1, :-1] = -S[:-1, -1]
        R = R @ np.linalg.solve(np.eye(n) - S / 2, np.eye(n) + S / 2)
        all_R.append(R)
    return np.array(all_R)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("m", [1, 3, 6])
def test_orientation(rng, method, m):
    """Carried along at each step, whatever is saved."""
    J, I, eps, _ = random_problem(rng, m)
    arguments = np.tile(J, (9, 1)), np.tile(I, (9, 1)), np.full(9, eps), rng.normal(size=(9, m))
    start = np.linalg.qr(rng.normal(size=(9, m + 1, m + 1)))[0]
    options = {"method": method, "stop": 100, "orientation": start}
    all_states = problem(*arguments, **options)
    outcome = run(all_states)
    assert (all_states.turns[0] == start).all()
    assert (last_orientation(outcome) == all_states.turns[-1]).all()
    for b in range(9):
        expected = start[b] @ naive_attitude(eps, all_states.saved[:, b])
        np.testing.assert_allclose(all_states.turns[:, b], expected, atol=1e-13)
    some = problem(*arguments, every=7, **options)
    run(some)
    assert (some.turns == all_states.turns[::7]).all()
    last = problem(*arguments, every=101, **options)
    assert (last_orientation(run(last)) == last_orientation(outcome)).all()
    del options["stop"]
    in_pieces = in_cuts((0, 5, 48, 100), *arguments, **options)
    assert same(in_pieces[:2], [all_states.saved, all_states.turns])


def test_orientations_are_orthogonal_to_rounding(rng):
    J, I, eps, _ = random_problem(rng, 4)
    omega = rng.normal(size=(3, 4))
    bodies = np.tile(J, (3, 1)), np.tile(I, (3, 1)), np.full(3, eps)
    start = np.tile(np.eye(5), (3, 1, 1))
    R = last_orientation(run(problem(*bodies, omega, stop=2000, every=2001, orientation=start)))
    assert abs(R @ R.swapaxes(1, 2) - np.eye(5)).max() < 4e-15


def test_rounding_of_orientations_is_undone_each_16_steps(rng):
    """Larger errors than those of rounding too, so that few steps show it."""
    J, I, eps, omega = random_problem(rng, 4)
    start = np.linalg.qr(rng.normal(size=(1, 5, 5)))[0] + 1e-9 * rng.normal(size=(1, 5, 5))
    one = problem(J[None], I[None], np.full(1, eps), omega[None], stop=16, orientation=start)
    run(one)
    errors = abs(one.turns[:, 0] @ one.turns[:, 0].swapaxes(1, 2) - np.eye(5)).max(axis=(1, 2))
    assert (errors[:16] > 1e-10).all()
    assert errors[16] < 4e-15


def test_half_a_turn_at_very_high_speed():
    """An angle whose square is beyond float64."""
    omega = np.array([[3e200, 0.0, 4e200]])
    still = problem(
        [[1.0, 2.0, 3.0]], [[0.0] * 3], np.ones(1), omega, stop=1, orientation=np.eye(4)[None]
    )
    R = last_orientation(run(still))[0]
    axis = np.array([0.6, 0.0, 0.8])
    expected = np.diag([1.0, 1.0, 1.0, -1.0])
    expected[:3, :3] -= 2 * np.outer(axis, axis)
    np.testing.assert_allclose(R, expected, atol=1e-15)


def test_orientation_ends_with_its_trajectory():
    J, I, omega = [[2.0, 2.0, 2.0, 3.0]], [[1.0, 0.0, 0.5, 0.25]], [[2.0, 1.0, 3.0, 2.0]]
    singular = problem(
        J, I, np.ones(1), np.array(omega), stop=3, orientation=np.eye(5)[None]
    )  # fmt: skip
    run(singular)
    assert (singular.turns[0] == np.eye(5)).all()
    assert np.isnan(singular.turns[1:]).all()


def with_small_d(rng, size, gaps):
    """Problems in which d_i / J_i is gaps[i] for the first i."""
    J, I = rng.uniform(1, 4, (size, 4)), rng.normal(size=(size, 4)) / 2
    eps, omega = np.full(size, 0.3), rng.normal(size=(size, 4))
    omega *= (2 * J[:, 0] * (1 - gaps[0]) / (eps * (I * omega).sum(axis=1)))[:, None]
    for i, gap in enumerate(gaps[1:], 1):
        J[:, i] = J[:, 0] * (1 - gaps[0]) / (1 - gap)
    return J, I, eps, omega


def errors(method, J, I, eps, omega):
    final = run(problem(J, I, eps, omega, stop=1, method=method)).final
    return np.array(
        [
            naive.relative_error(final[b], naive.step_nd(J[b], I[b], eps[b], omega[b]))
            for b in range(len(omega))
        ]
    )


@pytest.mark.parametrize(
    ("low", "high", "factor"),
    [
        pytest.param([0.05], [0.1], 25, id="one in between"),
        pytest.param([0.0, 0.001], [0.01, 0.02], 5, id="two small"),
    ],
)
def test_the_short_step_is_left_where_elimination_is_better(rng, low, high, factor):
    size = 150
    gaps = [
        rng.uniform(*ends, size) * rng.choice([-1, 1], size) for ends in zip(low, high, strict=True)
    ]
    arguments = with_small_d(rng, size, gaps)
    eliminated = np.maximum(errors("gauss", *arguments), 1e-16)
    ratio = errors("rank2", *arguments) / eliminated
    assert np.quantile(ratio, 0.9) < factor


def matrix_of(J, I, eps, omega):
    """A of equation (dsn), Id - (eps/2) f'(omega)."""
    coupling = (2 * np.outer(I, omega) - np.outer(omega, I)) * (eps / 2 / J)[:, None]
    return np.diag(1 - eps * (I @ omega) / (2 * J)) + coupling


def at_a_pole(rng):
    """A problem whose A is singular to rounding, with one small d; none if chance wills so."""
    J, I, omega = rng.uniform(1, 4, 3), rng.normal(size=3), rng.normal(size=3)
    speeds = np.linspace(0.1, 10, 400)
    det = [np.linalg.det(matrix_of(J, I, 1.0, s * omega)) for s in speeds]
    for k in np.flatnonzero(np.diff(np.sign(det))):
        s = brentq(
            lambda s: np.linalg.det(matrix_of(J, I, 1.0, s * omega)),
            *speeds[k : k + 2],
            xtol=1e-300,
        )
        d = np.sort(abs(1 - s * (I @ omega) / (2 * J)))
        if d[0] < 0.2 and d[1] > 0.15:
            return J, I, s * omega
    return None


def test_poles_beside_one_small_d_are_poles(rng):
    found = [each for each in (at_a_pole(rng) for _ in range(600)) if each]
    J, I, omega = (np.array(each) for each in zip(*found, strict=True))
    assert len(J) > 20
    eliminated, short = (
        run(problem(J, I, np.ones(len(J)), omega, stop=1, method=method))
        for method in METHODS[::-1]
    )
    singular = eliminated.status == sf.Status.SINGULAR
    assert singular.sum() > 10
    assert (short.status[singular] == sf.Status.SINGULAR).all()


def test_large_singular_matrices(rng):
    """Rounding leaves pivots that grow with the number of equations."""
    size, m = 60, 30
    J, I, omega = rng.uniform(1, 4, (size, m)), *rng.normal(size=(2, size, m))
    J[:, :3] = 2.0
    omega *= (4.0 / (I * omega).sum(axis=1))[:, None]
    status = run(problem(J, I, np.ones(size), omega, stop=1, method="gauss")).status
    assert np.count_nonzero(status == sf.Status.SINGULAR) > size - 3


@pytest.mark.parametrize("method", METHODS)
def test_poles_of_large_states(rng, method):
    """What is left of a pivot by rounding is zero beside the pivots before it."""
    I, x = rng.uniform(0.5, 4, 200), 10 ** rng.uniform(0, 5, 200)
    body = sf.SuslovND(np.column_stack([np.ones(200), I]), [-1.0, 0.0])
    omega = np.column_stack([-(2 * I + x * x), -x])
    status = sf.iterate(body, omega, 1.0, 1, method=method, on_singular="ignore").status
    assert np.count_nonzero(status == sf.Status.SINGULAR) > 190


@pytest.mark.parametrize("method", METHODS)
def test_next_to_a_pole_there_is_a_state(method):
    """Two variables are the 3D map, where X = 0.5 has its pole at Y = 1.25."""
    body = sf.SuslovND([1.0, 1.0], [-1.0, 0.0])
    x, y = 0.5 * np.sqrt(2), 2 * (1.25 - 2.0**-47)
    pole = sf.iterate(body, [-y, -x], 1.0, 1, method=method, on_singular="ignore")
    assert pole.status == sf.Status.OK


@pytest.mark.parametrize("method", METHODS)
def test_beyond_float64_is_not_called_singular(method):
    body = sf.SuslovND([1.0, 2.0, 3.0], [1e300, 1e300, 0.0])
    far = sf.iterate(body, [1e300, 1.0, 1.0], 1e300, 1, method=method, on_singular="ignore")
    assert far.status == sf.Status.NONFINITE


@pytest.mark.parametrize("method", METHODS)
def test_units_follow_the_state(rng, method):
    """Kept states are of the order of 1, however far omega has gone: here down to 1e-40 of it."""
    J, I, _, omega = random_problem(rng, 4)
    outcome = run(problem(J[None], I[None], np.full(1, 1e40), omega[None], stop=1, method=method))
    assert abs(outcome.final).max() < 1e-35
    assert 2.0**-100 < abs(outcome.resume["state"]).max() < 2.0**100
    exponent = outcome.resume["exponent"][:, None]
    assert (np.ldexp(outcome.resume["state"], exponent.astype(int)) == outcome.final).all()


def test_no_room_for_elimination():
    """Matrices beyond any address space are refused before anything is computed."""
    m = 2**22
    with pytest.raises(MemoryError, match="elimination works in"):
        run(
            problem(
                np.ones((1, m)), np.ones((1, m)), np.ones(1), np.ones((1, m)), 1, method="gauss"
            )
        )
