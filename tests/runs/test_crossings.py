"""Crossings are those that a loop over all states of `iterate` finds, bit for bit."""

import pickle

import numpy as np
import pytest
from children import TWO_THREADS
from samples import POLES, random_bodies
from systems import HENON_HEILES, LORENZ

import suslov_fast as sf
from suslov_fast.maps import MAPS
from suslov_fast.runs import search as module

# x'' = -x: states on ellipses around 0.
OSCILLATOR = sf.QuadraticField.from_function(lambda x: (x[1], -x[0]), 2)
# x' = x^2, from x0 > 0 to a pole, and beyond it from minus infinity to 0.
BLOW_UP = sf.QuadraticField([[[1]]])


def first(x):
    return x[..., 0]


def sample_of(map):
    """Return a body, and a state at a pole, or any state where the map has none."""
    if map.name in POLES:
        return POLES[map.name]
    body = random_bodies(map.name)[0](np.random.default_rng(1), ())
    return body, np.full(body.dimension, 0.3)


def slow(body, omega0, eps, steps, surface, direction=1, transient=0, most=None, method="auto"):
    """Find the crossings of each trajectory in all its states, one by one, as defined."""
    run = sf.iterate(body, omega0, eps, transient + steps, method=method, on_singular="ignore")
    batch, D = run.status.shape, run.states.shape[-1]
    values = np.asarray(surface(run.states), float).reshape(len(run), -1)
    states = run.states.reshape(len(run), -1, D)
    eps = np.broadcast_to(eps, batch).ravel()
    final = run.final.reshape(-1, D).copy()
    status, failed_at = run.status.ravel().copy(), run.failed_at.ravel().copy()
    rows, count = [], []
    for i in range(values.shape[1]):
        number = 0
        for n in range(transient, transient + steps):
            a, b = float(values[n, i]), float(values[n + 1, i])
            if not (np.isfinite(a) and np.isfinite(b)):
                continue
            up, down = a < 0 <= b, b < 0 <= a and (n or a > 0)
            if (up and direction >= 0) or (down and direction <= 0):
                fraction = a / (a - b)
                before, after = states[n, i], states[n + 1, i]
                point = before + fraction * (after - before)
                rows.append((i, n, before, after, fraction, point, (n + fraction) * eps[i]))
                number += 1
                if number == most:
                    final[i] = after
                    if failed_at[i] > n:
                        begin = sf.iterate(
                            body, omega0, eps.reshape(batch), transient, on_singular="ignore"
                        )
                        status[i], failed_at[i] = begin.status.ravel()[i], -1
                    break
        count.append(number)
    shapes = (0,), (0,), (0, D), (0, D), (0,), (0, D), (0,)
    columns = zip(*rows, strict=True) if rows else map(np.empty, shapes)
    found = dict(zip(COLUMNS, map(np.array, columns), strict=True))
    return found | {
        "count": np.reshape(count, batch),
        "final": final.reshape(*batch, D),
        "status": status.reshape(batch),
        "failed_at": failed_at.reshape(batch),
    }


COLUMNS = "trajectory", "n", "before", "after", "fraction", "states", "time"


def compare(points, expected):
    for name, value in expected.items():
        np.testing.assert_array_equal(getattr(points, name), value, err_msg=name)
        assert getattr(points, name).shape == value.shape, name
    assert len(points) == expected["count"].sum()


def check(*arguments, **options):
    points = sf.crossings(*arguments, on_singular="ignore", **options)
    compare(points, slow(*arguments, **options))
    return points


BATCHES = [
    (sf.Suslov3D(4, 1, -0.5, -0.3), (30,), [[0.2], [-0.3]], 50),
    (sf.Suslov3D([4, 3, 2], 1, -0.5, -0.3), (30, 3), 1.7, 40),  # t >= 1: poles are next to orbits
    (sf.SuslovGyrostat(4, 2, -0.5, -0.3, [[0.4], [2.0]]), (4,), [0.3, 0.2, -0.2, 0.1], 200),
    (sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5]), (20, 2), 0.4, 60),
    (LORENZ, (140,), 1 / 32, 60),
    (OSCILLATOR, (), -1 / 16, 300),
]


@pytest.mark.parametrize("direction", [1, -1, 0])
@pytest.mark.parametrize(("body", "batch", "eps", "steps"), BATCHES)
def test_crossings_are_those_of_all_states(rng, body, batch, eps, steps, direction):
    omega0 = rng.normal(size=(*batch, body.dimension))
    if batch:
        omega0[(0,) * len(batch)] = np.nan
    shape = np.broadcast_shapes(batch, body.shape, np.shape(eps))
    level = rng.normal(size=shape) / 5  # a surface for each trajectory
    options = {"direction": direction, "transient": 2}
    points = check(body, omega0, eps, steps, lambda x: first(x) - level, **options)
    assert len(points)
    assert points.ok == (points.status >= 0).all() == (not batch)


@pytest.mark.parametrize("method", ["order4", "order8"])
def test_points_of_every_method_lie_on_the_chord(rng, method):
    starts = rng.normal(size=(30, 3))
    assert len(check(LORENZ, starts, 1 / 32, 60, first, direction=0, method=method))


@pytest.mark.parametrize("method", ["auto", "order8"])
def test_bits_depend_on_no_cut(rng, monkeypatch, method):
    starts, arguments = rng.uniform(-0.25, 0.25, (9, 4)), {"method": method, "direction": 0}
    whole = sf.crossings(HENON_HEILES, starts, 1 / 8, 200, first, threads=TWO_THREADS, **arguments)
    assert len(whole)
    assert whole == sf.crossings(HENON_HEILES, starts, 1 / 8, 200, first, threads=1, **arguments)
    one = sf.crossings(HENON_HEILES, starts[4], 1 / 8, 200, first, **arguments)
    np.testing.assert_array_equal(one.states, whole.states[whole.trajectory == 4])
    monkeypatch.setattr(module, "PIECE", 64)
    monkeypatch.setattr(module, "STATES", 3)
    assert whole == sf.crossings(HENON_HEILES, starts, 1 / 8, 200, first, **arguments)


@pytest.mark.parametrize("most", [1, 3])
def test_trajectories_end(rng, most, monkeypatch):
    """A failure after the end is not told; one before it keeps the crossings; in any pieces."""
    # x3 comes to a pole after up to 20 steps.
    field = sf.QuadraticField.from_function(lambda x: (3 * x[1], -3 * x[0], x[2] ** 2), 3)
    starts = rng.uniform(-1, 1, (60, 3))
    starts[:, 2] = sf.iterate(BLOW_UP, [2.0], -0.5, 60).x[rng.integers(0, 20, 60), 0]
    starts[7] = np.nan
    points = check(field, starts, 0.5, 60, first, direction=0, most=most)
    for name in ("PIECE", "STATES"):
        monkeypatch.setattr(module, name, 5)
    assert check(field, starts, 0.5, 60, first, direction=0, most=most) == points
    ended = points.count == most
    assert (points.failed_at[ended] == -1).all()
    assert not np.isnan(points.final[ended]).any()
    later = sf.iterate(field, starts, 0.5, 60, on_singular="ignore")
    assert (later.status[ended] < 0).any()
    assert ((points.status < 0) & (points.count > 0)).any() or most == 1


def test_a_formula_of_components_is_the_surface_where_it_is_0():
    starts = [[1.0, 0.0], [0.3, 0.2]]
    expected = sf.crossings(OSCILLATOR, starts, 1 / 16, 300, lambda x: x[..., 1])
    found = sf.crossings(OSCILLATOR, starts, 1 / 16, 300, "x2")
    assert found == expected
    expected = sf.crossings(OSCILLATOR, starts, 1 / 16, 300, lambda x: abs(x[..., 1]) - 0.1)
    assert sf.crossings(OSCILLATOR, starts, 1 / 16, 300, "abs(x2) - 0.1") == expected
    both = sf.crossings(OSCILLATOR, starts, surface=["x1", lambda x: x[..., 1]], time=20.0)
    one = sf.crossings(OSCILLATOR, starts, surface="x1", time=20.0)
    assert (both.time[both.surface == 0] == one.time).all()
    assert len(both) > len(one) > 0


def test_rules_of_zero():
    """The map x -> x + 1 visits prescribed values of the surface, one after the other."""
    count_up = sf.QuadraticField.from_function(lambda x: (1,), 1)
    values = [0, -1, 0, 2, -0.0, -3, -3, 1, np.nan, -1, 1, np.inf, -2, -np.inf, 5, -1e308, np.inf]
    values = np.array(values)

    def surface(x):
        return values[np.minimum(x[..., 0].astype(int), len(values) - 1)]

    for direction, expected in ((1, [1, 6, 9]), (-1, [4, 14]), (0, [1, 4, 6, 9, 14])):
        points = check(count_up, [0.0], 1.0, 16, surface, direction=direction)
        assert points.n.tolist() == expected
    assert sf.crossings(count_up, [0.0], 1.0, 9, surface, direction=-1).fraction.tolist() == [0]
    # With 0, an orbit that touches the surface from below crosses twice.
    touch = sf.crossings(count_up, [0.0], 1.0, 2, lambda x: -((x[..., 0] - 1) ** 2), direction=0)
    assert (touch.n.tolist(), touch.fraction.tolist()) == ([0, 1], [1, 0])
    # The difference of the values need not be finite.
    for size in (6e307, 1.5e308):
        wide = sf.crossings(
            count_up, [0.0], 1.0, 2, lambda x, size=size: size * np.sign(x[..., 0] - 0.5)
        )
        assert wide.fraction.tolist() == [0.5]


@pytest.mark.parametrize("method", ["auto", "order4"])
@pytest.mark.parametrize("direction", [1, -1, 0])
def test_a_start_on_the_surface_is_no_crossing(direction, method):
    starts, options = [[0.0, 1.0], [0.0, -1.0]], {"direction": direction, "method": method}
    points = sf.crossings(OSCILLATOR, starts, 1 / 16, 80, first, **options)
    assert points.count.tolist() == {1: [0, 1], -1: [1, 0], 0: [1, 1]}[direction]
    np.testing.assert_allclose(points.time, np.pi, rtol=1e-3)


@pytest.mark.filterwarnings("ignore::suslov_fast.PoleWarning")
@pytest.mark.parametrize("name", MAPS)
def test_every_map(name):
    """States at poles, and random starts."""
    body, pole = sample_of(MAPS[name])
    starts = np.vstack([sf.RandomStarts(8, 1.0, seed=3).states(8, dimension=len(pole)), pole])
    for most in (None, 2):
        check(body, starts, 1.0, 30, first, direction=0, most=most)
        check(body, starts, 1.0, 27, first, direction=0, most=most, transient=3)
    random = sf.RandomStarts((2, 3), 1.0, seed=5)
    points = sf.crossings(body, random, 0.1, 30, first, direction=0)
    assert points == sf.crossings(
        body, random.states(6, dimension=len(pole)).reshape(2, 3, -1), 0.1, 30, first, direction=0
    )


def test_failures_are_told_once_or_raised_with_the_crossings():
    body, pole = POLES["Suslov3D"]
    starts = [[1.0, 0.5], pole, [0.3, 0.2], pole]
    with pytest.warns(sf.SingularStepWarning) as caught:
        points = sf.crossings(body, starts, 1.0, 30, first)
    (warning,) = caught
    assert str(warning.message) == "2 of 4 trajectories: singular step, first: 1 at step 1"
    assert warning.filename == __file__
    assert not points.ok
    with pytest.raises(sf.SingularStepError, match="singular step, first: 0 at step 1") as caught:
        sf.crossings(body, pole, 1.0, 5, first, on_singular="raise")
    assert isinstance(caught.value.crossings, sf.Crossings)
    assert caught.value.trajectories is None
    again = pickle.loads(pickle.dumps(caught.value))
    assert again.crossings == caught.value.crossings
    with pytest.raises(sf.SingularStepError) as caught:
        sf.iterate(body, pole, 1.0, 5, on_singular="raise")
    assert caught.value.trajectories.failed_at == 1


@pytest.mark.parametrize(
    ("omega0", "eps", "steps"),
    [(np.empty((0, 3)), 0.1, 9), ([1.0, 1, 1], 0.1, 0), ([[1.0, 1, 1]], 0.0, 9)],
)
def test_runs_without_crossings(omega0, eps, steps):
    for options in ({}, {"transient": 4}, {"direction": 0, "most": 2}):
        points = check(LORENZ, omega0, eps, steps, first, **options)
        assert len(points) == 0
        assert points.states.shape == (0, 3)
        points.to_xarray()
        points.plot()
        repr(points)


SIGNS = {
    "floats": lambda x: np.where(first(x) > 0, 1.0, -1.0),
    "integers": lambda x: np.where(first(x) > 0, 1, -1),
    "int8": lambda x: np.sign(first(x)).astype(np.int8),
    "unsigned": lambda x: (first(x) > 0).astype(np.uint8),
    "int64": lambda x: np.sign(first(x)).astype(int),
}


@pytest.mark.parametrize("kind", SIGNS)
@pytest.mark.parametrize("piece", [1, 2**17])
def test_there_is_no_crossing_to_a_state_that_is_nan(monkeypatch, kind, piece):
    """Functions with integer values make a number of it: int(NaN) is negative."""
    monkeypatch.setattr(module, "PIECE", piece)
    monkeypatch.setattr(module, "STATES", 1)
    starts = [[1.0], [2.0], [0.5], [np.nan]]  # a pole, one of eps = 1, a pole, no state
    for direction, counts in ((0, [0, 1, 0, 0]), (-1, [0, 1, 0, 0]), (1, [0, 0, 0, 0])):
        points = sf.crossings(
            BLOW_UP, starts, 1.0, 5, SIGNS[kind], direction=direction, on_singular="ignore"
        )
        expected = [0, 0, 0, 0] if kind == "unsigned" else counts  # which is never negative
        assert points.count.tolist() == expected
        one = sf.crossings(
            BLOW_UP, starts, 1.0, 5, SIGNS[kind], direction=direction, most=1, on_singular="ignore"
        )
        assert one.count.tolist() == expected
        assert np.isfinite(one.after).all()


def test_progress_stops_where_the_run_ends():
    done = []
    arguments = OSCILLATOR, [1.0, 0.0], 0.1, 10_000, first
    sf.crossings(*arguments, transient=50, progress=lambda *given: done.append(given))
    assert done[-1] == (10_050, 10_050)
    assert done == sorted(done)
    done.clear()
    points = sf.crossings(*arguments, most=1, progress=lambda *given: done.append(given))
    assert points.n[0] < done[-1][0] < 1000
    assert {total for _, total in done} == {10_000}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stop", [1, 40, 99, 100, 101])
def test_a_run_that_ended_in_its_transient(monkeypatch, stop, tmp_path):
    """It has no crossings."""
    monkeypatch.setattr("suslov_fast.engine.stretches.BETWEEN", 1)
    monkeypatch.setattr("suslov_fast.engine.stretches.STRETCH", 1)
    monkeypatch.setattr(module, "PIECE", 1)
    monkeypatch.setattr(module, "STATES", 1)
    points = sf.crossings(
        LORENZ, TWO, 1 / 64, 300, plane, transient=100, progress=lambda done, total: done < stop
    )
    np.testing.assert_array_equal(points.final, sf.iterate(LORENZ, TWO, 1 / 64, stop).final)
    assert (len(points), points.steps) == (0, max(stop - 100, 0))
    points.save(tmp_path / "p.npz")
    assert sf.load(tmp_path / "p.npz") == points


TWO = np.array([[1.0, 1.0, 20.0], [-2.0, 1.0, 20.0]])


def plane(x):
    return x[..., 2] - 27
