"""Stored runs equal one call, bit for bit, whatever happened in between."""

import signal
import sys
import time
from fractions import Fraction
from types import ModuleType

import children
import cloudpickle
import numpy as np
import pytest
import xarray
from distributed import Client, LocalCluster
from systems import lorenz

import suslov_fast as sf
from suslov_fast import Event, Field, Suslov3D, ensemble, flow, iterate
from suslov_fast.results.frames import to_xarray

BODY = Suslov3D(4, 1, -0.5, -0.3)
WELL = Field(lambda x, c: (x[1], x[0] - x[0] ** 3 - c * x[1]), "q p", c=0.2)
LORENZ = Field(lorenz, "x y z", rho=np.linspace(10.0, 40.0, 3)[:, None])
X0 = np.random.default_rng(1).uniform(-2.0, 2.0, (10, 2))
EACH = {"eps": np.linspace(0.1, 0.3, 10), "steps": 10, "save_every": 5, "attitude": True}
ACTING = [Event("q", direction=1), Event(times=[0.5], to=lambda x, c: (x[0] + c, x[1]))]


def starts(k, n=3):
    return np.random.default_rng([5, k]).uniform(-2.0, 2.0, (n, 2))


def same(data, run):
    """Compare all variables of a store with those of a run, bit for bit."""
    names = [*run.to_xarray().status.dims[:-1], "trajectory"]
    expected = to_xarray(run, names)
    assert {*data.variables} >= {*expected.variables} - {"time"}
    for name in {*data.variables}:
        found, other = data[name], expected[name]
        assert found.dims == other.dims, name
        assert found.dtype == other.dtype or name == "component"
        if name == "component":
            assert found.values.tolist() == other.values.tolist()
        else:
            assert found.values.tobytes() == other.values.tobytes(), name
    assert {*data.coords} == {*expected.coords} - ({"time"} - {*data.coords})


RUNS = {
    "body, step sizes, orientations": (BODY, X0, EACH),
    "grid of a family": (LORENZ, np.linspace(1, 2, 7)[:, None] + np.arange(3.0), {"time": [0, 1]}),
    "map of a grid": (LORENZ, np.ones((7, 3)), {"eps": 0.01, "steps": 9, "save_every": 3}),
    "members": (WELL.with_parameters(c=np.linspace(0, 1, 10)), [1.0, 0.0], {"time": 2.0}),
    "events": (WELL, X0, {"time": [1.0, 2.0], "events": ACTING, "rtol": 1e-6}),
    "last states": (BODY, X0, {"eps": 0.2, "steps": 100, "save_every": None}),
}


@pytest.mark.parametrize(
    ("name", "chunks"), [*((name, 4) for name in RUNS), (next(iter(RUNS)), 1), ("members", 99)]
)
def test_bits_of_one_call(tmp_path, name, chunks):
    system, x0, options = RUNS[name]
    data = ensemble(system, x0, tmp_path / "run", chunks=chunks, **options)
    run = (flow if "time" in options else iterate)(system, x0, **options)
    same(data, run)
    same(xarray.open_zarr(tmp_path / "run"), run)
    counts, options = [], options | {"chunks": chunks}
    ensemble(system, x0, tmp_path / "run", progress=lambda *n: counts.append(n), **options)
    assert counts == [(data.sizes["trajectory"],) * 2]  # nothing is computed twice


def test_states_of_each_chunk(tmp_path):
    data = ensemble(WELL, starts, tmp_path / "run", time=[0.0, 1.0], chunks=4)
    same(data, flow(WELL, np.concatenate([starts(k) for k in range(4)]), time=[0.0, 1.0]))
    members = WELL.with_parameters(c=np.linspace(0.0, 1.0, 12))
    data = ensemble(members, starts, tmp_path / "family", time=1.0, chunks=4)
    same(data, flow(members, np.concatenate([starts(k) for k in range(4)]), time=1.0))
    with pytest.raises(ValueError, match="as many states as"):
        ensemble(WELL, lambda k: starts(k, 3 + k), tmp_path / "other", time=1.0, chunks=4)


def test_a_function_in_place_of_a_field(tmp_path):
    f = lambda t, x: (x[1], np.cos(t) - x[0])  # noqa: E731
    at, x0 = {"time": [0.5, 1.0], "t0": 2.0}, np.arange(10.0).reshape(5, 2)
    run = flow(Field(f, 2), x0, **at)
    same(ensemble(f, x0, tmp_path / "a", chunks=2, **at), run)
    own = {"chunks": 5, **at}
    same(ensemble(f, lambda k: x0[k : k + 1], tmp_path / "b", **own), run)
    same(ensemble(f, x0, tmp_path / "a", chunks=2, **at), run)


def test_a_stopped_run_goes_on(tmp_path):
    store, options = tmp_path / "run", {"eps": 0.1, "steps": 20, "chunks": 5}
    part = ensemble(BODY, X0, store, progress=lambda done, total: done < 4, **options)
    assert (part.status.values == [0] * 4 + [-128] * 6).all()
    assert np.isnan(part.states.values[:, 4:]).all()
    assert not np.isnan(part.states.values[:, :4]).any()
    # A chunk without its status, as by a kill while it was written, is computed again.
    (store / "status/c/1").unlink()
    counts = []
    data = ensemble(BODY, X0, store, progress=lambda *n: counts.append(n[0]), **options)
    assert counts == [2, 4, 6, 8, 10]
    same(data, iterate(BODY, X0, 0.1, 20))


STARTS = np.concatenate([starts(k) for k in range(6)])
# With a second argument the states of chunk 3 take ten minutes.
KILLED = """
    import sys, time
    import numpy as np
    import suslov_fast as sf
    import dask.array, xarray, zarr

    def starts(k):
        if k == 3 and sys.argv[2:]:
            print("computed", flush=True)
            time.sleep(600)
        return np.random.default_rng([5, k]).uniform(-2.0, 2.0, (3, 2))

    print("begins", flush=True)
    sf.ensemble(sf.Suslov3D(4, 1, -0.5, -0.3), starts, sys.argv[1], eps=0.1, steps=20, chunks=6)
"""
kills = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no such signal")


@kills
@pytest.mark.slow
def test_a_killed_process_leaves_what_it_has_computed(tmp_path):
    store = tmp_path / "run"
    with children.start(KILLED, store, "waits") as child:
        assert child.stdout.readline() + child.stdout.readline() == "begins\ncomputed\n"
        child.send_signal(signal.SIGKILL)
    assert ((xarray.open_zarr(store).status.values == 0) == (np.arange(18) < 9)).all()
    counts = []
    data = ensemble(
        BODY, starts, store, eps=0.1, steps=20, chunks=6, progress=lambda *n: counts.append(n[0])
    )
    assert counts == [9, 12, 15, 18]
    same(data, iterate(BODY, STARTS, 0.1, 20))


@kills
@pytest.mark.slow
def test_the_same_call_goes_on_after_a_kill_at_any_moment(tmp_path):
    store = tmp_path / "run"
    for milliseconds in (5, 20, 40, 60, 80, 100, 150):
        with children.start(KILLED, store) as child:
            assert child.stdout.readline() == "begins\n"
            time.sleep(milliseconds / 1000)
            child.send_signal(signal.SIGKILL)
    with children.start(KILLED, store) as one, children.start(KILLED, store) as other:
        assert (one.wait(60), other.wait(60)) == (0, 0)
    same(xarray.open_zarr(store), iterate(BODY, STARTS, 0.1, 20))
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


@pytest.mark.parametrize(
    "processes", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["threads", "processes"]
)
def test_workers_write_the_same(tmp_path, processes, monkeypatch):
    cloudpickle.register_pickle_by_value(sys.modules[__name__])
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=processes, dashboard_address=":0"
        ) as cluster,
        Client(cluster) as client,
    ):
        data = ensemble(BODY, starts, tmp_path / "a", eps=0.1, steps=20, chunks=9, client=client)
        same(data, iterate(BODY, np.concatenate([starts(k) for k in range(9)]), 0.1, 20))
        options = {"time": [1.0, 2.0], "events": ACTING}
        data = ensemble(WELL, X0, tmp_path / "b", chunks=4, client=client, **options)
        same(data, flow(WELL, X0, **options))
        with pytest.raises(ValueError, match="as many states as"):
            ensemble(
                WELL, lambda k: starts(k, 3 + k), tmp_path / "c", time=1.0, chunks=4, client=client
            )
        if processes:  # which cannot import this module: the error is raised, and nothing waits
            monkeypatch.setitem(sys.modules, "nowhere", ModuleType("nowhere"))
            monkeypatch.setattr(sys.modules["nowhere"], "starts", starts, raising=False)
            monkeypatch.setattr(starts, "__module__", "nowhere")
            with pytest.raises(ModuleNotFoundError, match="nowhere"):
                ensemble(BODY, starts, tmp_path / "d", eps=0.1, steps=2, chunks=2, client=client)


def test_numbers_of_numpy_are_numbers(tmp_path):
    own = {"eps": np.float32(0.5), "steps": np.int64(4), "save_every": np.int64(2)}
    run = ensemble(BODY, X0, tmp_path / "a", **own)
    assert run.identical(ensemble(BODY, X0, tmp_path / "a", eps=0.5, steps=4, save_every=2))
    own = {"time": np.float64(1.0), "stiff": np.True_}
    run = ensemble(BODY, X0, tmp_path / "b", **own)
    assert run.identical(ensemble(BODY, X0, tmp_path / "b", time=1.0, stiff=True))


def test_the_store_of_another_run_is_refused(tmp_path):
    store, options = tmp_path / "run", {"eps": 0.1, "steps": 20}
    ensemble(BODY, X0, store, chunks=3, **options)
    others = {
        "parameter I23": lambda: ensemble(
            Suslov3D(4, 1, -0.5, -0.2), X0, store, chunks=3, **options
        ),
        "x0": lambda: ensemble(BODY, X0[::-1], store, chunks=3, **options),
        "chunks": lambda: ensemble(BODY, X0, store, chunks=5, **options),
        "time": lambda: ensemble(BODY, X0, store, chunks=3, time=1.0),
    }
    for name, call in others.items():
        with pytest.raises(ValueError, match=f"another .*{name}"):
            call()
    # A parameter with the name of an entry of the dictionary does not hide it.
    fields = [
        Field.from_hamiltonian(lambda x, H, c=c: H * x[1] ** 2 / 2 + x[0] ** c, 2, H=1.0)
        for c in (2, 4)
    ]
    ensemble(fields[0], [[1.0, 0.0]], tmp_path / "H", time=1.0)
    with pytest.raises(ValueError, match=r"another .*system"):
        ensemble(fields[1], [[1.0, 0.0]], tmp_path / "H", time=1.0)
    xarray.Dataset({"a": 1}).to_zarr(tmp_path / "other", consolidated=False)
    (tmp_path / "file").write_text("a file")
    for name, error in (("other", ValueError), ("file", OSError)):
        with pytest.raises(error):
            ensemble(BODY, X0, tmp_path / name, **options)
    assert (tmp_path / "file").read_text() == "a file"


def test_errors_come_before_any_work(tmp_path):
    def never(k):
        raise AssertionError

    wrong = [
        (TypeError, (BODY, X0, 3), {"time": 1.0}),
        (TypeError, (BODY, X0, "run"), {}),
        (TypeError, (BODY, X0, "run"), {"time": 1.0, "eps": 0.1}),
        (TypeError, (BODY, X0, "run"), {"time": 1.0, "nothing": 0.1}),
        (ValueError, (BODY, X0, "run"), {"time": 1.0, "chunks": 0}),
        (ValueError, (BODY, X0, "run"), {"eps": 0.1, "steps": -2}),
        (ValueError, (BODY, never, "run"), {"time": 1.0}),
        (ValueError, (BODY, X0[:, :1], "run"), {"time": 1.0}),
    ]
    for error, (system, x0, store), options in wrong:
        with pytest.raises(error):
            ensemble(system, x0, tmp_path / store if store == "run" else store, **options)
    assert not (tmp_path / "run").exists()


def test_one_warning_counts_what_fails(tmp_path):
    field = sf.Field.from_terms([[[1.0]]])  # x' = x**2
    x0 = np.linspace(-1.1, 2.2, 10)[:, None]
    with pytest.warns(sf.IntegrationWarning, match=r"4 of 10 .* 4 ENDED") as told:
        data = ensemble(field, x0, tmp_path / "run", time=1.0, chunks=4)
    assert len(told) == 1
    assert data["end"].values[6:] == pytest.approx(1 / x0[6:, 0])


def test_the_warning_counts_passed_poles(tmp_path):
    field = sf.Field.from_terms([[[1.0]]])  # its map x -> x/(1 - x/2), whose pole 2 is jumped over
    x0 = [0.5, 0.3, -1.0, 0.75]
    with pytest.warns(sf.IntegrationWarning, match=r"1 SINGULAR; 2 of 4 .* passed a pole") as told:
        data = ensemble(field, np.transpose([x0]), tmp_path / "run", eps=0.5, steps=40)
    assert len(told) == 1
    for first, status in zip(map(Fraction, x0), data.status.values, strict=True):
        x, signs = first, set()
        for _ in range(40 if x else 0):
            signs.add(x > 0)
            x = 0 if x == 2 else x / (1 - x / 2)
        assert status == (-1 if x == 0 else 2 * (len(signs) == 2))


def test_stores_of_zarr(tmp_path):
    from zarr.storage import MemoryStore

    store = MemoryStore()
    same(ensemble(BODY, X0, store, time=1.0, chunks=2), flow(BODY, X0, time=1.0))
