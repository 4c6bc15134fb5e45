"""Stored runs equal those of `iterate`, bit for bit, for any chunks and continuations."""

import os
import signal
import sys
import threading
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import children
import dask.array
import distributed
import numpy as np
import pytest
import xarray
from ensemble_runs import BODY, BODY_4D, CUT, KINDS, assert_same, assert_undisturbed, contents, made
from scipy.spatial.transform import Rotation

import suslov_fast as sf
from suslov_fast import RandomStarts, Status, Suslov3D, ensemble, iterate, open_ensemble

GYROSTAT = sf.SuslovGyrostat(4, 1, -0.5, -0.3, 0.7)


@pytest.fixture
def store(tmp_path):
    return tmp_path / "run.zarr"


def compare(store, body, omega0, eps, steps, *, ours=None, **settings):
    """Run `ensemble`, with additional settings `ours`, and `iterate`; compare the results."""
    dataset = ensemble(body, omega0, eps, steps, store=store, **(ours or {}), **settings)
    orbits = iterate(body, omega0, eps, steps, on_singular="ignore", **settings)
    assert_same(dataset, orbits)
    return dataset, orbits


CHUNK, LZ4 = {"chunk": {"trajectory": 7, "n": 8}}, {"compression": "lz4"}
TURNING = {"attitude": True}
TURNS = Rotation.random(20, random_state=1).as_matrix()


@pytest.mark.parametrize(
    ("body", "shape", "eps", "ours", "settings"),
    [
        (BODY, 20, 0.3, CHUNK, {"save_every": None}),
        (BODY, 20, 0.3, CHUNK | LZ4, {"save_every": 4}),
        (BODY, 20, 0.3, CHUNK, {"save_every": 1} | TURNING),
        (BODY, 20, 0.3, CHUNK | {"compression": "zstd"}, {"save_every": 1, "method": "canonical"}),
        (BODY, 20, 0.3, CHUNK, {"save_every": None, "method": "ds2"} | TURNING),
        (BODY, 20, 0.3, CHUNK, {"save_every": 100, "method": "ds2"}),
        (BODY_4D, 20, 0.3, CHUNK, {"save_every": None} | TURNING),
        (BODY_4D, 20, 0.3, CHUNK | LZ4, {"save_every": 1, "method": "gauss"} | TURNING),
        (BODY_4D, 20, 0.3, CHUNK, {"save_every": 4, "method": "rank2"}),
        (GYROSTAT, 20, 0.3, CHUNK, {"save_every": 1} | TURNING),
        (GYROSTAT, 20, 0.3, CHUNK, {"save_every": None}),
        (BODY, 20, [[0.2], [0.3]], {}, {"save_every": 1}),
        (BODY, 20, np.linspace(0.1, 0.3, 20), {"chunk": 7}, {"save_every": None}),
        (BODY, 20, 0.3, CHUNK, {"save_every": 4, "attitude": TURNS}),
        (BODY, 20, 0.3, {"chunk": {"n": 10**18}}, {"save_every": 4}),
        (BODY, 20, [0.2], {"chunk": {"n": 1}}, {"save_every": 1, "method": "ds2"} | TURNING),
        *[(BODY, shape, 0.2, {}, {"save_every": 5}) for shape in ((), (0,), (1,), (3, 0))],
    ],
)
@pytest.mark.sampled(8)
def test_a_stored_run_equals_iterate(store, rng, body, shape, eps, ours, settings):
    """A run is created, extended by less than a chunk and by more, and verified."""
    omega0 = rng.uniform(-2.0, 2.0, np.append(shape, body.dimension).astype(int))
    if shape == 20:
        omega0[3], omega0[9] = np.nan, 1e308
    for steps in (0, 40, 41, 73):
        more = {**ours, "verify": steps == 73}
        dataset, orbits = compare(store, body, omega0, eps, steps, ours=more, **settings)
        done, tiles = dataset.attrs["tiles_done"].split(" of ")
        assert done == tiles
    assert_same(xarray.open_zarr(store), orbits)


@pytest.mark.parametrize("chunk", [None, 5, {"I13": 2, "start": 3, "n": 2}])
@pytest.mark.sampled(1)
def test_parameters_are_axes_of_the_batch(store, rng, chunk):
    body = Suslov3D(4, 1, np.linspace(-0.5, 0.5, 3)[:, None], -0.3)
    eps = np.array([0.1, 0.5])[:, None, None]
    ours = {"dims": ("eps", "I13", "start"), "coords": {"start": list("abcdefgh")}, "chunk": chunk}
    omega0 = rng.uniform(-2.0, 2.0, (8, 2))
    for steps in (20, 30):
        dataset, orbits = compare(store, body, omega0, eps, steps, ours=ours, save_every=3)
    assert dataset.omega.dims == ("n", "eps", "I13", "start", "component")
    one = dataset.sel(eps=0.5, I13=0.0, start="c")
    assert np.array_equal(one.omega, orbits.omega[:, 1, 1, 2])
    assert np.array_equal(dataset.time.sel(eps=0.5), 0.5 * orbits.n)
    again = sf.Trajectories.from_xarray(dataset)
    assert again.body == body
    assert np.array_equal(again.omega, orbits.omega)


@pytest.mark.parametrize("method", ["auto", "canonical", "ds2"])
@pytest.mark.sampled(1)
def test_failed_trajectories_are_not_recomputed(store, monkeypatch, method):
    body = Suslov3D(1, 1, 1, 0)
    omega0 = [[1.0, -3.0], [1.0, 0.5], [np.nan, 0.0], [1e308, 1e308], [2.0, 3.0]]
    settings = {"save_every": 2, "method": method, "attitude": True, "store": store, "chunk": 3}
    for steps in (9, 20):
        ensemble(body, omega0, 1.0, steps, **settings)
    pieces = made(monkeypatch)
    dataset = ensemble(body, omega0, 1.0, 20, verify=True, **settings)
    assert pieces == []
    assert dataset.failed_at.values.tolist() == [1, -1, 0, 1, -1]


@pytest.mark.parametrize("save_every", [None, 10**14])
def test_steps_of_the_closed_form_cost_nothing(store, monkeypatch, save_every):
    pieces = made(monkeypatch)
    compare(store, BODY, [[1.0, 0.5], [0.3, -0.2]], 0.2, 10**15, save_every=save_every)
    assert len(pieces) < 20


def test_sources_of_initial_states(tmp_path):
    random = RandomStarts((5, 10), 2.0, seed=5)
    array = random.states(50).reshape(5, 10, 2)
    np.save(tmp_path / "starts.npy", array)
    sources = {
        "random": random, "array": array, "file": tmp_path / "starts.npy",
        "mapped": np.load(tmp_path / "starts.npy", mmap_mode="r"),
        "dask": dask.array.from_array(array, chunks=(2, 7, 2)),
    }  # fmt: skip
    orbits = iterate(BODY, random, 0.2, 20, save_every=None)
    assert orbits == iterate(BODY, array, 0.2, 20, save_every=None)
    for name, omega0 in sources.items():
        store = tmp_path / f"{name}.zarr"
        assert_same(ensemble(BODY, omega0, 0.2, 20, store=store, chunk=9), orbits)
    for size in (0, (2, 0), (0, 2)):
        shape = np.shape(np.empty(size))
        assert iterate(BODY, RandomStarts(size, 2.0), 0.2, 3).states.shape == (4, *shape, 2)
    cube = RandomStarts((2, 3, 4), 2.0, seed=5)
    stored = ensemble(BODY, cube, 0.2, 0, store=tmp_path / "cube.zarr", chunk=2)
    assert np.array_equal(stored.final, array.reshape(-1, 2)[:24].reshape(2, 3, 4, 2))
    # A run is identified by its initial states, not by their source.
    ensemble(BODY, array, 0.2, 20, store=tmp_path / "file.zarr")
    array[-1, -1, -1] += 1e-9
    np.save(tmp_path / "starts.npy", array)
    with pytest.raises(ValueError, match=r"omega0 .*sha256"):
        ensemble(BODY, sources["file"], 0.2, 20, store=tmp_path / "file.zarr")


@pytest.mark.parametrize("dimension", [1, 2, 3, 8])
def test_a_random_state_depends_on_seed_and_number_alone(dimension):
    starts = RandomStarts(1000, 3.0, seed=2)
    whole = starts.states(1000, dimension=dimension)
    for start, count in ((0, 1), (1, 1), (7, 13), (998, 2)):
        part = starts.states(count, start, dimension)
        assert np.array_equal(part, whole[start : start + count])
    assert not np.isin(whole, RandomStarts(1000, 3.0, seed=3).states(1000, 0, dimension)).any()
    assert np.unique(whole).size == whole.size
    assert abs(whole).max() <= 3.0
    assert abs(whole.mean()) < 0.1
    assert whole.std() == pytest.approx(3.0 / np.sqrt(3.0), rel=0.05)


@pytest.mark.parametrize("save_every", [None, 4])
@pytest.mark.parametrize("body", [BODY, BODY_4D])
@pytest.mark.sampled(2)
def test_reductions(store, rng, body, save_every):
    omega0 = rng.uniform(-2.0, 2.0, (20, body.dimension))
    observables = {"modified_energy_drift": sf.modified_energy}
    if body is BODY:
        observables["first_integral_drift"] = sf.first_integral
    names = [*observables, "energy_drift", "omega_min", "omega_max"]
    for steps in (30, 50):
        settings = {"chunk": CUT, "reductions": names, "save_every": save_every}
        dataset = ensemble(body, omega0, 0.3, steps, store=store, **settings)
        orbits = iterate(body, omega0, 0.3, steps, save_every=save_every or 1)
        if save_every:
            assert_same(dataset, orbits)
        assert ("omega" in dataset) == ("n" in dataset.sizes) == (save_every is not None)
        assert np.array_equal(dataset.final, orbits.final)
        assert np.array_equal(dataset.status, orbits.status)
        assert np.array_equal(dataset.omega_min, orbits.omega.min(axis=0))
        assert np.array_equal(dataset.omega_max, orbits.omega.max(axis=0))
        for name, observable in observables.items():
            change = abs(observable(body, orbits.omega, 0.3) / observable(body, omega0, 0.3) - 1.0)
            assert np.array_equal(dataset[name], change.max(axis=0))


def distance(centre):
    return lambda x: np.hypot(*np.moveaxis(x - centre, -1, 0))


def total(omega):
    return omega.sum()


def test_functions_of_the_user(store, rng):
    """Values at all saved states, NaN too; another source or another carried value is refused."""
    omega0 = rng.uniform(-2.0, 2.0, (20, 2))
    chosen = {"log": lambda x: np.log(x[..., 0]), "up": lambda x: x[..., 1] > 0}
    chosen["distance"] = distance(1.0)
    settings = {"save_every": 3, "reductions": chosen}
    for steps, verify in ((30, False), (50, False), (50, True)):
        ours = {"store": store, "chunk": CUT, "verify": verify}
        dataset = ensemble(BODY, omega0, 0.3, steps, **ours, **settings)
        orbits = iterate(BODY, omega0, 0.3, steps, save_every=3)
        assert_same(dataset, orbits)
        for name, function in chosen.items():
            with np.errstate(invalid="ignore"):
                assert np.array_equal(dataset[name], function(orbits.omega), equal_nan=True)
    for other in (distance(2.0), lambda x: np.hypot(x[..., 0] - 1.0, x[..., 1] - 1.0)):
        others = settings | {"reductions": {**chosen, "distance": other}}
        with pytest.raises(ValueError, match=r"reductions .* instead of"):
            ensemble(BODY, omega0, 0.3, 50, store=store, **others)
    (store / "up" / "c" / "0" / "0").unlink()
    again = ensemble(BODY, omega0, 0.3, 50, **ours, **settings)
    assert np.array_equal(again.up, dataset.up)


BAD_FUNCTIONS = [
    (np.sin, "whose Python source can be read, .*sin"), (eval("lambda x: x[..., 0]"), "source"),
    (Status(0).__reduce__, "source"), (total, r"values \(...\), here \(3, 2\), got r with .* \(\)"),
    (lambda x: x[..., 0] * 1j, "real values, got r .* complex128"),
    (lambda x: np.cumsum(x[..., 0], axis=0), "one state, got r"),
    (lambda x: x[..., 9], "got r, which raises IndexError"),
]  # fmt: skip


def test_functions_that_cannot_be_stored(store):
    for function, message in BAD_FUNCTIONS:
        with pytest.raises((TypeError, ValueError), match=f"reductions: expected .*{message}"):
            ensemble(**ASKED, store=store, reductions={"r": function})
    for name in ("omega", "time", "energy_drift", "eps", "a/b", 5):
        with pytest.raises(ValueError, match="reductions: expected"):
            ensemble(**ASKED, store=store, reductions={name: distance(1.0)})
    assert list(store.parent.iterdir()) == []


ASKED = {"body": BODY, "omega0": [[1.0, 0.5]], "eps": 0.2, "steps": 20, "save_every": 2}


def test_stores_of_other_runs_are_refused(store):
    ensemble(**ASKED, store=store)
    before = contents(store)
    others = {
        "body": Suslov3D(4, 1, -0.5, -0.31), "eps": -0.2, "omega0": [[1.0, 0.5 + 1e-12]],
        "save_every": None, "method": "ds2", "attitude": True, "reductions": ["omega_min"],
        "dims": "start", "steps": 19,
    }  # fmt: skip
    for name, value in others.items():
        with pytest.raises(ValueError, match=name):
            ensemble(**{**ASKED, name: value}, store=store)
    assert contents(store) == before


def oscillator(constant, half=Fraction(1, 2), K=None):
    H = lambda x: half * (x[0] ** 2 + x[1] ** 2) + constant  # noqa: E731
    return sf.QuadraticField.from_hamiltonian(H, 2, K)


def test_a_store_of_a_field_is_that_of_its_H_and_K(store):
    asked = {**ASKED, "reductions": ["energy_drift"], "store": store}
    ensemble(**asked | {"body": oscillator(0)})
    before = contents(store)
    ensemble(**asked | {"body": oscillator(0.0, half=0.5)})
    with pytest.raises(ValueError, match=r"with body H .* instead of .*9\.0"):
        ensemble(**asked | {"body": oscillator(9)})
    K = [[0, 2], [-2, 0]]
    with pytest.raises(ValueError, match=r"with body H .* body K .* instead of .*2\.0"):
        ensemble(**asked | {"body": oscillator(0, Fraction(1, 4), K)})  # the same coefficients
    assert contents(store) == before


UNKNOWN = dask.array.ones((5, 2))
UNKNOWN = UNKNOWN[UNKNOWN[:, 0] > 0]
FIELD_DRIFT = {"reductions": ["first_integral_drift"], "body": sf.QuadraticField.of(BODY)}
BAD = [
    ({"omega0": "starts.txt"}, ValueError, r"omega0.*\.npy"),
    ({"save_every": 0}, ValueError, "save_every"), ({"chunk": 0}, ValueError, "chunk"),
    ({"chunk": {"time": 3}}, ValueError, "chunk.*time"), ({"chunk": "many"}, TypeError, "chunk"),
    ({"reductions": ["mean"]}, ValueError, "reductions.*mean"),
    ({"reductions": "omega_min"}, TypeError, "reductions"),
    (FIELD_DRIFT, (TypeError, ValueError), "reductions: first_integral_drift"),
    ({"compression": "gzip"}, ValueError, "compression"),
    ({"dims": ("a", "b")}, ValueError, "dims"),
    ({"coords": {"trajectory": [1, 2]}}, ValueError, "coords"),
    *[
        ({"coords": {name: 3}}, ValueError, f"coords: expected names without '/'.*got {name!r}")
        for name in ("a/b", "progress", "zarr.json", "", ".", "..", "__a", "a" * 256, 5)
    ],
    ({"dims": "a/b"}, ValueError, "dims: .*got 'a/b'"),
    ({"dims": "energy_drift"}, ValueError, "dims: .*got 'energy_drift'"),
    ({"coords": {"a": Fraction(1, 3)}}, ValueError, "coords: expected values that Zarr can store"),
    ({"omega0": UNKNOWN}, ValueError, r"omega0: .*\(nan, 2\): call its compute_chunk_sizes"),
    ({"omega0": RandomStarts(10**15, 1)}, OSError, r"space for the run.* [\d,]+ .*[\d,]{18} bytes"),
    ({"store": "memory://large", "omega0": RandomStarts(10**15, 1)}, MemoryError, "bytes"),
    ({"store": "memory://large", "steps": 10**15}, MemoryError, "raise save_every"),
    ({"store": None}, TypeError, "store: expected the name of a folder.*got None"),
    ({"scheduler": 5}, TypeError, "scheduler"), ({"progress": 5}, TypeError, "progress"),
    ({"body": "rigid"}, TypeError, "body"),
]  # fmt: skip


def test_bad_arguments_leave_nothing_behind(store):
    for change, error, message in BAD:
        with pytest.raises(error, match=message):
            ensemble(**{"store": store, **ASKED, **change})
    for arguments in ((-1, 1.0), (3, 0.0), (3, [1.0]), (3, 1.0, -1), (2.5, 1.0)):
        with pytest.raises(TypeError if 2.5 in arguments else ValueError):
            RandomStarts(*arguments)
    assert list(store.parent.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.sampled(1)
def test_a_signal_stops_after_the_current_chunks(store, rng, number):
    omega0 = rng.uniform(-2.0, 2.0, (50, 2))
    before = signal.getsignal(number)
    ours = {"chunk": {"trajectory": 10, "n": 5}}
    for steps in (30, 60):  # a new store, and an extended one
        calls = []

        def ask(done, total, calls=calls):
            calls.append(done)
            if len(calls) == 9:  # some tiles are finished by then, and some are not
                os.kill(os.getpid(), number)

        with pytest.raises(KeyboardInterrupt, match=r"of 5 tiles .*resume"):
            ensemble(BODY, omega0, 0.2, steps, store=store, save_every=2, progress=ask, **ours)
        assert signal.getsignal(number) is before
        unfinished = open_ensemble(store)
        missing = unfinished.status.values == -128
        assert missing.any()
        assert not missing.all()
        assert np.isnan(unfinished.final.values[missing]).all()
        assert unfinished.attrs["tiles_done"] == f"{5 - missing.sum() // 10} of 5"
        stored = unfinished.omega.values[:, ~missing]
        _, orbits = compare(store, BODY, omega0, 0.2, steps, ours=ours, save_every=2)
        assert np.array_equal(stored, orbits.omega[:, ~missing])


def test_a_run_larger_than_its_disk_is_refused(store, monkeypatch):
    """A finished store needs no space, compressed or not; an extended one that of what is added."""
    free = 0
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=free))
    asked = {**ASKED, "omega0": RandomStarts(1000, 1.0), "store": store, "compression": "zstd"}
    size = 1000 * (16 * 11 + 16 + 1 + 8 + 8 + 16 + 9)  # with the records of a tile
    with pytest.raises(OSError, match=f" 0 bytes are free, got {size:,} bytes"):
        ensemble(**asked)
    assert list(store.parent.iterdir()) == []
    free = size
    ensemble(**asked)
    free = 0
    ensemble(**asked)
    free = 95_999
    with pytest.raises(OSError, match=r" 95,999 bytes are free, got 96,000 bytes"):
        ensemble(**asked | {"steps": 22})  # half of the chunks of states
    free = 96_000
    ensemble(**asked | {"steps": 22, "verify": True})
    assert [path.name for path in store.parent.iterdir()] == [store.name]  # no lock is left


def test_an_absent_scheduler_is_named(store, caplog):
    at_once = dask.config.set({"distributed.comm.timeouts.connect": "10ms"})
    with at_once, pytest.raises(OSError, match=r"scheduler: .* at 127\.0\.0\.1:1, got none"):
        ensemble(**ASKED, store=store, scheduler="127.0.0.1:1")
    assert caplog.messages == ["waiting for the scheduler 127.0.0.1:1"]
    assert list(store.parent.iterdir()) == []


def test_progress_reaches_the_end_in_a_thread(store):
    seen = []
    asked = {**ASKED, "omega0": RandomStarts(20, 1.0), "chunk": 7, "store": store}
    asked["progress"] = lambda done, total: seen.append((done, total))
    thread = threading.Thread(target=ensemble, kwargs=asked)
    thread.start()
    thread.join()
    assert seen[0] == (0, 400)
    assert seen[-1] == (400, 400)
    assert seen == sorted(seen)


def test_workers_of_a_cluster(store):
    random = RandomStarts(50, 1.5)
    states = random.states(50, dimension=3)
    orbits = iterate(BODY_4D, states, 0.2, 40, save_every=3, method="rank2")
    with distributed.Client(n_workers=1, processes=False, dashboard_address=None) as client:
        for name, omega0 in (("random", random), ("states", states)):
            settings = {"save_every": 3, "method": "rank2", "chunk": CUT, "scheduler": client}
            place = store.with_name(f"{name}.zarr")
            assert_same(ensemble(BODY_4D, omega0, 0.2, 40, store=place, **settings), orbits)


@pytest.mark.compiled
@pytest.mark.skipif(sys.platform == "win32", reason="no fork, no SIGKILL")
@pytest.mark.parametrize(("kind", "kills"), [("3d attitude", 3), *((kind, 15) for kind in KINDS)])
@pytest.mark.sampled(1)
def test_a_killed_run_is_finished(store, kind, kills):
    script = Path(__file__).with_name("ensemble_runs.py")
    children.run(script, store, kind, 2, kills, timeout=600)
    assert_undisturbed(store, kind)
