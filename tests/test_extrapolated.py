"""Extrapolated steps of fields: order 10 from columns of steps of Kahan's map."""

import json
from fractions import Fraction

import numpy as np
import pytest
from children import TWO_THREADS
from test_orders import FLOWS, LORENZ, SQUARE, motion

import suslov_fast as sf
from suslov_fast import Status, compiled
from suslov_fast.command import main
from suslov_fast.core import operations, steps_field, tangent
from suslov_fast.core.stages import extrapolation, weights_of
from suslov_fast.engine import threads
from suslov_fast.maps import map_of

METHOD = "extrapolated"
COLUMNS = 2, 4, 6, 8, 10
# From the polynomial in 1 / n**2 through the ends of the columns, at 0 (Lagrange).
WEIGHTS = [
    float(np.prod([Fraction(1, m * m) / (Fraction(1, m * m) - Fraction(1, n * n))
                   for m in COLUMNS if m != n]))
    for n in COLUMNS
]  # fmt: skip


def by_columns(field, x, eps, columns=COLUMNS):
    """The combination of the ends of columns, each of steps of Kahan's map."""
    total = 0.0
    for n in columns:
        end = x
        for _ in range(n):
            end = sf.step(field, end, np.asarray(eps) / n)
        others = [m for m in columns if m != n]
        weight = np.prod([1 / m**2 / (1 / m**2 - 1 / n**2) for m in others])
        total = total + weight * (end - x)
    return x + total


def test_record_and_weights():
    record = map_of(LORENZ, METHOD)
    assert (record.name, record.order) == ("Kahan, extrapolated", 10)
    stages = record.stages
    assert stages == extrapolation(*COLUMNS)
    assert stages.fractions == tuple(1 / n for n in COLUMNS for _ in range(n))
    weights = weights_of(stages)
    assert np.count_nonzero(weights, axis=0).tolist() == [5, 4]
    assert abs(weights[weights[:, 0] != 0, 0] - WEIGHTS).max() < 1e-13
    assert abs(weights.sum(axis=0) - 1).max() < 1e-14
    # sum_n w_n / n**(2 j) = 0, up to j = 4 and, without the shortest column, to j = 3
    n = 1 / np.array(stages.fractions)[:, None]
    for j in range(1, 5):
        sums = (weights / n ** (2 * j)).sum(axis=0)
        assert (abs(sums[: 2 if j < 4 else 1]) < 1e-15).all()
    z = -np.logspace(-3, 9, 1000)
    factor = sum(
        w * ((1 + z / 2 / m) / (1 - z / 2 / m)) ** m for m, w in zip(COLUMNS, WEIGHTS, strict=True)
    )
    assert abs(factor).max() <= 1 + 1e-13


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", FLOWS)
def test_order(name):
    """By regression, forward and backward in time."""
    field, start, time = FLOWS[name]
    first = {"Lorenz": 12, "Henon-Heiles": 8, "chain": 5, "Euler's top": 7, "epidemic": 9}[name]
    counts, errors = [round(first * 1.15**k) for k in range(4)], []
    for steps in counts:
        run = sf.iterate(field, start, time / steps, steps, save_every=None, method=METHOD)
        errors.append(float(abs(run.final - motion(name)).max()))
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert abs(slope - 10) < 1, (slope, errors)
    end, steps = motion(name).astype(float), 20 if name != "Lorenz" else 600
    back = sf.iterate(field, end, -time / steps, steps, save_every=None, method=METHOD).final
    assert abs(back - start).max() < (1e-6 if name == "Lorenz" else 1e-9)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", FLOWS)
def test_steps_combine_columns(name, rng):
    field, start, time = FLOWS[name]
    x = np.array(start) + rng.normal(size=(19, field.dimension)) / 8
    eps = np.linspace(-1, 1, 19) * time / 40
    run = sf.iterate(field, x, eps, 8, method=METHOD)
    now, largest = x, np.zeros_like(x)
    for k in range(8):
        later = by_columns(field, now, eps[:, None].ravel())
        without = by_columns(field, now, eps, COLUMNS[1:])
        largest = np.maximum(largest, abs(later - without))
        now = later
        assert abs(run.x[k + 1] - now).max() < 1e-12 * abs(now).max()
    assert abs(run.local_error - largest).max() < 1e-11 * abs(x).max()
    assert (run.local_error[9] == 0).all()  # eps = 0
    assert (run.x[:, 9] == x[9]).all()
    for k in (0, 9, 18):
        alone = sf.iterate(field, x[k], eps[k], 8, method=METHOD)
        assert (alone.x == run.x[:, k]).all()
        assert (alone.local_error == run.local_error[k]).all()
    assert (sf.step(field, x, eps, method=METHOD) == run.x[1]).all()


@pytest.mark.compiled
def test_affine_integrals_are_kept():
    """To 1e-12 of their terms over 10,000 steps."""

    def species(x):
        return x[0] * (x[1] - x[2]), x[1] * (x[2] - x[0]), x[2] * (x[0] - x[1])

    for field, start in (
        (sf.QuadraticField.from_function(species, 3), (0.5, 0.3, 0.2)),
        FLOWS["chain"][:2],
        FLOWS["epidemic"][:2],
    ):
        run = sf.iterate(field, start, 0.3, 10_000, save_every=10, method=METHOD)
        assert abs(run.x.sum(axis=-1) / sum(start) - 1).max() < 1e-12


@pytest.mark.compiled  # 30,000 steps take minutes as Python
def test_totals_are_kept_near_rest():
    """Where the same rounding errors occur at each step: an epidemic near its equilibrium."""

    def immunity_wanes(x, infection, onset, recovery, loss):
        new, ill, well, again = infection * x[0] * x[2], onset * x[1], recovery * x[2], loss * x[3]
        return again - new, new - ill, ill - well, well - again

    infection, onset, recovery, loss = np.random.default_rng(1).uniform(
        [1, 0.05, 0.05, 0.05], [4, 0.6, 0.6, 0.6], (8, 4)
    ).T  # fmt: skip
    field = sf.QuadraticField.from_function(
        immunity_wanes, 4, infection=infection, onset=onset, recovery=recovery, loss=loss
    )
    for eps in (0.05, 0.25, 0.4):
        run = sf.iterate(
            field, [0.98, 0.01, 0.01, 0], eps, 10_000, save_every=100, method=METHOD
        )  # fmt: skip
        assert abs(run.x.sum(axis=-1) - 1).max() < 1e-13
    assert abs(run.x[-1] - run.x[-2]).max() < 1e-14


@pytest.mark.filterwarnings("ignore::suslov_fast.PoleWarning")  # R(z) < 0 changes the sign
def test_decaying_modes_are_bounded():
    decay = sf.QuadraticField.from_function(lambda x, a: (-a * x[0],), 1, a=np.logspace(0, 9, 91))
    with pytest.warns(sf.PoleWarning, match="cannot change its sign did"):
        run = sf.iterate(decay, [1.0], 0.01, 300, method=METHOD)
    assert abs(run.x).max() <= 1 + 1e-13
    assert run.ok
    fast = sf.iterate(decay.sel(a=1e3), [1.0], 0.01, 300, method=METHOD)
    assert abs(fast.final).max() < 1e-12


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", FLOWS)
def test_jacobian(name, rng):
    """The sum of products over columns, and differences of steps; NaN gives NaN."""
    field, start, time = FLOWS[name]
    D, eps = field.dimension, time / 20
    x = np.array(start) + rng.normal(size=(5, D)) / 4
    slopes = sf.jacobian(field, x, eps, method=METHOD)
    wanted = np.zeros((5, D, D)) + np.eye(D)
    for n, weight in zip(COLUMNS, WEIGHTS, strict=True):
        product, now = np.eye(D), x
        for _ in range(n):
            product = sf.jacobian(field, now, eps / n) @ product
            now = sf.step(field, now, eps / n)
        wanted += weight * (product - np.eye(D))
    assert abs(slopes - wanted).max() < 1e-12 * abs(wanted).max()
    differences = [
        sf.step(field, x + e, eps, method=METHOD) - sf.step(field, x - e, eps, method=METHOD)
        for e in 1e-6 * np.eye(D)
    ]
    assert abs(slopes - np.stack(differences, axis=-1) / 2e-6).max() < 1e-6 * abs(slopes).max()
    assert np.isnan(sf.jacobian(field, np.full(D, np.nan), eps, method=METHOD)).all()
    assert (sf.jacobian(field, x[2], eps, method=METHOD) == slopes[2]).all()


def test_multipliers():
    point = [np.sqrt(72), np.sqrt(72), 27]
    mu = np.linalg.eigvals(2 * (np.eye(3) - sf.matrix(LORENZ, point, 1.0)))
    for eps in (1 / 64, -1 / 16, 0.3):
        z = eps * mu / 2
        ends = [((1 + z / n) / (1 - z / n)) ** n for n in COLUMNS]
        wanted = sum(w * end for w, end in zip(WEIGHTS, ends, strict=True))
        wanted = wanted[np.lexsort((-wanted.imag, -abs(wanted)))]
        found = sf.multipliers(LORENZ, point, eps, method=METHOD)
        assert abs(found - wanted).max() < 1e-12 * abs(wanted).max()
        slopes = sf.jacobian(LORENZ, point, eps, method=METHOD)
        assert abs(np.prod(found) - np.linalg.det(slopes)) < 1e-11 * abs(np.prod(wanted))
    growing = sf.QuadraticField(np.zeros((1, 1, 1)), [[1]])
    assert np.isinf(sf.multipliers(growing, [0.0], 4.0, method=METHOD)).all()


@pytest.mark.compiled
def test_exponents():
    mu = np.array([0.3, -0.2, -1.5])
    linear = sf.QuadraticField(np.zeros((3, 3, 3)), np.diag(mu))
    found = sf.lyapunov_exponents(linear, [1, 1, 1], 0.1, 50, method=METHOD)
    assert abs(found - 0.1 * mu).max() < 1e-13
    x, eps = np.array([[1.0, 2, 20], [5, 5, 25], [-3, 1, 15]]), 1 / 10
    found = sf.lyapunov_exponents(LORENZ, x, eps, 4000, transient=100, method=METHOD) / eps
    assert abs(found.mean(axis=0) - [0.906, 0, -14.572]).max() < 0.05
    alone = sf.lyapunov_exponents(LORENZ, x[1], eps, 400, method=METHOD)
    several = sf.lyapunov_exponents(LORENZ, x, eps, 400, method=METHOD)
    assert abs(alone - several[1]).max() < 1e-12


def test_bits_do_not_depend_on_batch_cuts_and_threads(rng, monkeypatch, tmp_path):
    x = np.array([1.0, 1, 20]) + rng.normal(size=(37, 3))
    run = sf.iterate(LORENZ, x, 1 / 8, 40, method=METHOD)
    error = run.local_error
    assert error.shape == (37, 3)
    assert (error > 0).all()
    for part in (slice(0, 1), slice(3, 5), slice(3, 9), slice(9, 37), slice(None, None, -1)):
        some = sf.iterate(LORENZ, x[part], 1 / 8, 40, method=METHOD)
        assert (some.x == run.x[:, part]).all()
        assert (some.local_error == error[part]).all()
    every = sf.iterate(LORENZ, x, 1 / 8, 40, save_every=7, method=METHOD)
    assert (every.x == run.x[::7]).all()
    first = sf.iterate(LORENZ, x, 1 / 8, 13, method=METHOD)
    assert (first.local_error <= error).all()
    assert first.extend(27) == run
    assert (first.extend(27).local_error == error).all()
    first.save(tmp_path / "run.npz")
    loaded = sf.Trajectories.load(tmp_path / "run.npz")
    assert loaded == first
    assert (loaded.local_error == first.local_error).all()
    assert (loaded.extend(27).local_error == error).all()
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    several = sf.iterate(LORENZ, x, 1 / 8, 40, method=METHOD, threads=TWO_THREADS)
    assert several == run
    assert (several.local_error == error).all()


def test_bits_of_a_family(rng, monkeypatch):
    """Each member with its own step size, and with others whose coefficients are 0.

    Derivatives at many states of each member take its table of numbers, not one for each state.
    """
    tables, tables_of = [], tangent.tables_of

    def noted(scheme, values, eps, W):
        tables.append(len(values))
        return tables_of(scheme, values, eps, W)

    monkeypatch.setattr(tangent, "tables_of", noted)
    a = np.array([0.0, 1.0, 0.3, -0.2] * 5)
    family = sf.QuadraticField.from_function(
        lambda x, a: (x[1] - a * x[0] ** 2, -x[0] + x[0] * x[1], a - x[2]), 3, a=a
    )
    x, eps = rng.normal(size=(20, 3)) / 4, np.linspace(-0.5, 0.5, 20)
    run = sf.iterate(family, x, eps, 9, method=METHOD)
    slopes = sf.jacobian(family, run.x, eps, method=METHOD)
    assert tables == [5, 15]  # members with a = 0, and others
    for k in range(20):
        alone = sf.iterate(family[k], x[k], eps[k], 9, method=METHOD)
        assert (alone.x == run.x[:, k]).all()
        assert (alone.local_error == run.local_error[k]).all()
        own = sf.jacobian(family[k], run.x[:, k], eps[k], method=METHOD)
        np.testing.assert_array_equal(own, slopes[:, k])


@pytest.mark.slow
@pytest.mark.parametrize("is_long", [False, True])
def test_numpy_carries_out_the_same_steps(rng, monkeypatch, is_long):
    """With the same bits, in states next to poles, beyond them, and out of range."""
    if is_long:  # columns are then combined from states
        monkeypatch.setattr(operations, "MANY", 0)
    x = np.concatenate([rng.normal(size=(20, 1)), [[2.0], [1e308], [np.nan], [3.7], [1e200]]])
    cases = (SQUARE, x, 1.0), (LORENZ, rng.normal(size=(11, 3)) * 8 + [0, 0, 25], 0.3)
    compiled_runs = [sf.iterate(*case, 7, method=METHOD, on_singular="ignore") for case in cases]
    for name in ("code_of", "listed_code"):
        monkeypatch.setattr(steps_field, name, lambda *arguments, **options: None)
    for case, expected in zip(cases, compiled_runs, strict=True):
        run = sf.iterate(*case, 7, method=METHOD, on_singular="ignore")
        assert run == expected
        np.testing.assert_array_equal(run.local_error, expected.local_error)


def test_statuses():
    """Of x' = x**2 from 1, whose columns agree beyond the pole, and of others."""
    x = [[0.5], [2.0], [1.0], [3.7], [np.nan], [1e308]]
    run = sf.iterate(SQUARE, x, 1.0, 5, method=METHOD, on_singular="ignore")
    S = Status
    assert run.status.tolist() == [
        S.SINGULAR, S.SINGULAR, S.SINGULAR, S.PASSED_POLE, S.NONFINITE, S.NONFINITE,
    ]  # fmt: skip
    assert run.failed_at.tolist() == [2, 1, 1, 1, 0, 1]
    assert np.isnan(run.x[4:, 0]).all()
    exact = 3.7 / (1 - 3.7 * np.arange(6))
    assert abs(run.x[:, 3, 0] - exact).max() < 1e-13
    assert np.isnan(run.local_error[[1, 2, 4, 5]]).all()
    assert (run.local_error[[0, 3]] < 1e-14).all()
    # The sum of columns overflows: no next state.
    turning = sf.QuadraticField(np.zeros((2, 2, 2)), [[0, 3], [-3, 0]])
    run = sf.iterate(
        turning, [[1e308, 1.2e308], [1, 2]], 1.0, 5, method=METHOD, on_singular="ignore"
    )
    assert run.status.tolist() == [S.NONFINITE, S.OK]
    assert run.failed_at.tolist() == [1, -1]
    assert np.isnan(run.x[1:, 0]).all()
    assert np.isnan(run.local_error[0]).all()
    # x' = 1 + x**2, which keeps no sign, has its pole at pi / 2 - arctan(x).
    run = sf.iterate(
        sf.QuadraticField([[[1.0]]], constant=[1.0]), [[0.1], [3.0]], 1.0, 1, method=METHOD,
        on_singular="ignore",
    )  # fmt: skip
    assert run.status.tolist() == [S.OK, S.PASSED_POLE]


def test_local_error_belongs_to_this_method():
    run = sf.iterate(LORENZ, [1.0, 1, 20], 1 / 32, 3)
    with pytest.raises(AttributeError, match="extrapolated"):
        run.local_error  # noqa: B018
    assert "local_error" not in dir(run)
    run = sf.iterate(LORENZ, [1.0, 1, 20], 1 / 32, 0, method=METHOD)
    assert "local_error" in dir(run)
    assert np.isnan(run.local_error).all()


def test_dataset_and_store(tmp_path):
    pytest.importorskip("zarr")
    x = [[1.0, 1, 20], [3, -2, 25], [-4, 4, 30]]
    run = sf.iterate(LORENZ, x, 1 / 8, 20, method=METHOD, save_every=5)
    data = run.to_xarray()
    assert data.local_error.dims == ("trajectory", "component")
    assert (data.local_error == run.local_error).all()
    store = tmp_path / "run.zarr"
    stored = sf.ensemble(LORENZ, x, 1 / 8, 20, store=store, method=METHOD, save_every=5, chunk=2)
    assert (stored.local_error.values == run.local_error).all()
    assert (stored.x.values == run.x).all()


def test_crossings(tmp_path):
    x = np.array([[1.0, 1, 20], [3, -2, 25], [-4, 4, 30]])

    def surface(states):
        return states[..., 2] - 27

    whole = sf.crossings(LORENZ, x, 1 / 16, 100, surface, transient=20, method=METHOD)
    states = sf.iterate(LORENZ, x, 1 / 16, 120, method=METHOD).x
    assert len(whole) > 10
    assert (whole.before == states[whole.n, whole.trajectory]).all()
    some = sf.crossings(LORENZ, x, 1 / 16, 40, surface, transient=20, method=METHOD)
    assert some.extend(60) == whole
    some.save(tmp_path / "section.npz")
    assert sf.Crossings.load(tmp_path / "section.npz").extend(60, surface=surface) == whole


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of interpreted code
def test_steps_in_loops_of_users():
    x, out = np.array([1.0, 1, 20]), np.empty(3)
    run = sf.iterate(LORENZ, x, 1 / 8, 5, method=METHOD)
    system = compiled.system(LORENZ, 1 / 8, method=METHOD)
    memory = compiled.work(system)
    for k in range(5):
        assert compiled.step_system(system, x, x, memory) == Status.OK
        assert abs(x - run.x[k + 1]).max() < 1e-12
    system = compiled.system(SQUARE, 1.0, method=METHOD)
    memory, out = compiled.work(system), np.empty(1)
    for start, status in ((3.7, 2), (2.0, -1), (1e308, -2), (0.3, 0)):
        assert compiled.step_system(system, np.array([start]), out, memory) == status
        assert np.isnan(out[0]) == (status < 0)


def test_command(tmp_path, capsys):
    (tmp_path / "field.json").write_text(json.dumps(LORENZ.to_dict()))
    words = f"run --body {tmp_path}/field.json --eps 0.125 --steps 20 --omega0 1,1,20"
    assert main([*words.split(), "--method", METHOD, "-o", str(tmp_path / "run.npz")]) == 0
    run = sf.Trajectories.load(tmp_path / "run.npz")
    assert run == sf.iterate(LORENZ, [[1, 1, 20]], 1 / 8, 20, save_every=None, method=METHOD)
    assert main(["info", str(tmp_path / "run.npz")]) == 0
    assert METHOD in capsys.readouterr().out


def test_bodies():
    """Their fields have the method, and the error says so."""
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    with pytest.raises(ValueError, match=r"QuadraticField\.of"):
        sf.iterate(body, [1, 0.5], 0.1, 3, method=METHOD)
    run = sf.iterate(sf.QuadraticField.of(body), [1, 0.5], 0.25, 4, method=METHOD)
    assert abs(run.final - sf.flow(body, [1, 0.5], 1.0)).max() < 1e-12
