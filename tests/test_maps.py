"""The contract of every map of the package, and of one that a test registers."""

import json
from copy import copy
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._bodies.base import Body
from suslov_fast._cli import main
from suslov_fast._engine import arguments
from suslov_fast._engine.problem import NO_TRAJECTORIES, Driver, Kept, Map
from suslov_fast._kernels import blocks, blocks_nd, map_canonical
from suslov_fast._maps import MAPS, map_named, map_of


@dataclass(frozen=True, eq=False, repr=False)
class Growth(Body):
    """A body of the smallest map: x1 and x2 are multiplied by 1 + rate eps."""

    m: Any
    rate: Any

    _meanings: ClassVar = {"m": "mass", "rate": "rate of growth"}
    _positive: ClassVar = ("m",)

    @property
    def _labels(self):
        return "x1", "x2"


def grow(problem, span, output):
    _, rate, eps = problem.parameters
    state = span.resume["state"] if span.start else problem.omega0
    for n in range(span.start, span.steps + 1):
        if n > span.start:
            state = state * (1.0 + rate * eps)[:, np.newaxis]
        if len(output.saved) and n % span.every == 0 and (n > span.start or n == 0):
            output.saved[n // span.every - span.rows_before] = state
    failed = np.isnan(state).any(axis=-1)
    output.status[:] = np.where(failed, sf.Status.NONFINITE, sf.Status.OK)
    output.failed_at[failed] = 0
    output.final[:], output.resume["state"] = state, state
    return NO_TRAJECTORIES


GROWTH = Map(
    name="growth", body=Growth, title="Growth", variable="weights", meaning="size",
    drivers=lambda problem, span: [Driver(grow)], kept=(Kept("state", ("flat", "component")),),
    samples=((Growth(2.0, -0.5), (1.0, 2.0)),),
)  # fmt: skip


@pytest.fixture(params=[*MAPS, "growth"])
def record(request, monkeypatch):
    """The record of each map of the package, and of one that is registered here."""
    monkeypatch.setitem(MAPS, "growth", GROWTH)
    return map_named(request.param)


@pytest.fixture
def problem(record):
    """The functions that step and iterate, a sample body, and states."""
    body, state = record.samples[0]
    full = map_of(body) is not record
    starts = 0.1 * np.array(state) * [[1.0], [-0.5], [0.3]]
    return *((sf.step_full, sf.iterate_full) if full else (sf.step, sf.iterate)), body, starts


def test_steps_runs_and_continuation(record, problem):
    step, iterate, body, starts = problem
    run = iterate(body, starts, 0.1, 6)
    assert run._map is record
    assert getattr(run, record.variable) is run.states is np.asarray(run)
    for name in {"omega", "x", "weights"} - {record.variable}:
        with pytest.raises(AttributeError, match=name):
            getattr(run, name)
    assert getattr(copy(run), record.variable) is run.states
    np.testing.assert_allclose(run.states[1:], step(body, run.states[:-1], 0.1), rtol=1e-12)
    assert (run.states[0] == starts).all()
    for save_every, rows in ((1, [0, 1, 2, 3, 4, 5, 6]), (4, [0, 4]), (None, [6])):
        for method in record.methods:
            options = {"save_every": save_every} | ({"method": method} if method != "auto" else {})
            whole = iterate(body, starts, 0.1, 6, **options)
            assert whole.n.tolist() == rows
            np.testing.assert_allclose(whole.states, run.states[rows], rtol=1e-9)
            assert iterate(body, starts, 0.1, 5, **options).extend(1) == whole
    for name in record.conserved(body):
        assert len(getattr(run, name)()) == len(run)
    lost = iterate(body, [starts[0] * np.nan, starts[1]], 0.1, 3, on_singular="ignore")
    assert lost.status.tolist() == [sf.Status.NONFINITE, run.status[1]]
    assert lost.failed_at.tolist() == [0, -1]


def test_files_datasets_and_labels(record, problem, tmp_path):
    step, iterate, body, starts = problem
    run = iterate(body, starts, 0.1, 6, save_every=3)
    run.save(tmp_path / "run.npz")
    loaded = sf.Trajectories.load(tmp_path / "run.npz")
    assert loaded == run
    assert loaded.extend(2) == run.extend(2)
    data = run.to_xarray()
    assert data.attrs["title"] == record.title
    states = data[record.variable]
    assert states.attrs["long_name"] == record.meaning
    assert sf.Trajectories.from_xarray(data) == run
    again = step(body, states.isel(n=0, drop=True), 0.1)
    assert (again == step(body, starts, 0.1)).all()
    own = states.component.values.tolist()
    for labels in ([*own[1:], "a"], *([own[::-1]] if len(own) > 1 else [])):
        with pytest.raises(ValueError, match="expected the components"):
            step(body, states.isel(n=0, drop=True).assign_coords(component=labels), 0.1)


def test_orientations(record, problem):
    _, iterate, body, starts = problem
    if iterate is sf.iterate_full:
        with pytest.raises(TypeError, match="attitude"):
            iterate(body, starts, 0.1, 6, attitude=True)
    elif not record.carries_attitude:
        for attitude in (True, np.eye(3)):
            with pytest.raises(TypeError, match="attitude: expected False"):
                iterate(body, starts, 0.1, 6, attitude=attitude)
    else:
        run = iterate(body, starts, 0.1, 6, attitude=True)
        n = body.dimension + 1
        assert run.attitude.shape == (7, 3, n, n)
        turned = sf.attitude(body, run.states, 0.1)
        np.testing.assert_allclose(turned, run.attitude, rtol=0, atol=1e-13)


def test_ensembles(record, problem, tmp_path):
    _, iterate, body, starts = problem
    if iterate is sf.iterate_full:
        return
    data = sf.ensemble(body, starts, 0.1, 6, store=tmp_path / "a.zarr", save_every=2, chunk=2)
    run = iterate(body, starts, 0.1, 6, save_every=2)
    np.testing.assert_array_equal(data[record.variable].values, run.states)
    if not record.carries_attitude:
        with pytest.raises(TypeError, match="attitude: expected False, as states"):
            sf.ensemble(body, starts, 0.1, 6, store=tmp_path / "b.zarr", attitude=True)
        assert not (tmp_path / "b.zarr").exists()
        sf.ensemble(body, starts, 0.1, 6, store=tmp_path / "b.zarr", attitude=np.False_)


def test_the_command(record, problem, tmp_path, capsys, monkeypatch):
    """A body is read from a file, or given by options, which need not be of one body alone."""
    *_, body, _ = problem
    monkeypatch.setattr(arguments, "AnyBody", arguments.AnyBody | Growth)
    (tmp_path / "body.json").write_text(json.dumps(body.to_dict()))
    lines = [["--body", str(tmp_path / "body.json")]]
    values = {name: np.asarray(value) for name, value in body._values.items()}
    if isinstance(body, arguments.AnyBody):
        of = {name: ",".join(map(repr, each.ravel().tolist())) for name, each in values.items()}
        lines.append([f"--{name}={text}" for name, text in of.items()])
    for number, own in enumerate(lines):
        file = str(tmp_path / f"run{number}.npz")
        line = f"--eps 0.1 --steps 5 --trajectories 4 --extent 0.1 -o {file}"
        with pytest.raises(SystemExit, match="0"):
            main(["run", *own, *line.split()])
        assert "trajectories" in capsys.readouterr().out
        assert sf.Trajectories.load(file).body == body


def test_plots(record, problem):
    _, iterate, body, starts = problem
    symbols = record.symbols(body)
    components = (0, len(symbols) - 1)
    run = iterate(body, starts, 0.1, 6)
    if len(symbols) == 1:
        with pytest.raises(ValueError, match="expected states with at least 2 components, got 1"):
            run.plot()
        return
    axes = run.plot(components=components)
    assert [axes.get_xlabel(), axes.get_ylabel()] == [symbols[k] for k in components]


def test_a_map_without_slopes_has_no_exponents(monkeypatch):
    monkeypatch.setitem(MAPS, "growth", GROWTH)
    with pytest.raises(TypeError, match=r"body: expected Suslov3D or .*, got Growth"):
        sf.lyapunov_exponents(GROWTH.samples[0][0], [1.0, 2.0], 0.1, 5)


def test_objects_of_a_subclass_are_bodies():
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    own = type("OfUser", (sf.Suslov3D,), {})(4, 1, -0.5, -0.3)
    assert map_of(own) is map_of(body)
    for function in (sf.step, sf.first_integral, sf.jacobian):
        np.testing.assert_array_equal(function(own, [1, 0.5], 0.2), function(body, [1, 0.5], 0.2))
    with pytest.raises(
        TypeError, match=r"body: expected Suslov3D or SuslovND or .*, got RigidBody"
    ):
        sf.step(sf.SuslovND.__base__(), [1, 0.5], 0.2)


def test_modules_of_maps_are_checked():
    """Functions are missing, misspelled, or take other arguments than the loop passes."""
    good = {name: each for name, each in vars(map_canonical).items() if name[:2] != "__"}

    def module(**changes):
        made = ModuleType(map_canonical.__name__)
        contents = {name: each for name, each in (good | changes).items() if each is not None}
        vars(made).update(contents)
        return made

    def ours(function):
        function.__module__ = map_canonical.__name__
        return function

    blocks.map_kernel("good", module(settle=None, guarded=None))
    for changes, message in (
        ({"advance": None}, "no advance"),
        ({"cause": None, "show": None}, "no show, no cause"),
        ({"setle": good["settle"], "settle": None}, "also setle"),
        ({"guarded": ours(lambda k, s, n: s)}, "guarded of 3 arguments"),
    ):
        with pytest.raises(TypeError, match=rf"map_canonical: expected enter\(.*, got {message}"):
            blocks.map_kernel("bad", module(**changes))
    with pytest.raises(TypeError, match=r"expected block\(parameters, memory, task\), .* no block"):
        blocks_nd.map_kernel("bad", module())
