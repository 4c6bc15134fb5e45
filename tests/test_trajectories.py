"""`Trajectories`: methods, and conversion to labelled arrays."""

import re
from dataclasses import asdict, replace
from functools import cache, partial

import numpy as np
import pytest
import xarray

import suslov_fast as sf

BODY = sf.Suslov3D(4, 1, -0.5, -0.3)
BODY_ND = sf.SuslovND([1.3, 2.1, 3.7], [0.4, -0.7, 0.5])
GYROSTAT = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, 0.9)
GYROSTATS = sf.SuslovGyrostat(2.3, 1.4, 0.5, -0.7, [0.0, 0.9, 1.8])


@pytest.fixture
def sweep(rng):
    """Three bodies along the first axis, two step sizes along the second, and two saved states."""
    body = sf.Suslov3D(rng.uniform(1, 2, (3, 1)), 1, 0.3, 0.2)
    return sf.iterate(body, [1, 0.5], [0.1, 0.2], 5, save_every=4)


def same(a, b):
    a, b = np.asarray(a), np.asarray(b)
    return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())


def assert_same_run(a, b, resume=True):
    for name in ("states", "n", "eps", "status", "failed_at", "final", "time"):
        assert same(getattr(a, name), getattr(b, name)), name
    assert type(a.eps) is type(b.eps)
    assert a.body == b.body
    assert a._map is b._map
    assert (a.method, a.steps, a.save_every) == (b.method, b.steps, b.save_every)
    assert type(b.steps) is int
    assert same(a.attitude, b.attitude)
    assert a == b
    if resume:
        assert a._resume.keys() == b._resume.keys()
        assert all(same(a._resume[name], b._resume[name]) for name in a._resume)


# No body has the I3 of some runs of the scheme in three components.
pytestmark = pytest.mark.filterwarnings("ignore:I3")
STARTS = np.random.default_rng(3).normal(size=(5, 2))
THREES, FOURS = np.column_stack([STARTS, STARTS[:, 0]]), STARTS[:, [0, 1, 1]]
ODD = np.array([[0.3, -0.0], [1.0, 2.0]])
SIZES = [0.1, 0.2, 0.3, 0.4, 0.5]
SHORT = sf.Suslov3D([[[2.0]]], [1.0], 0.1, [[0.1]])
POLES = sf.Suslov3D(1, 1, 1, 0)
EQUAL = sf.SuslovND([2.0] * 3, [0.1, 0.2, 0.3])

iterate, full = (partial(partial, f, on_singular="ignore") for f in (sf.iterate, sf.iterate_full))
SWEPT = sf.Suslov3D([[1.0], [2.0], [3.0]], 1, [[0.1, 0.2]], 0)
SWEPT_ND = sf.SuslovND([[[1.0, 2.0]], [[3.0, 1.0]]], [0.2, 0.1])
THIRD = sf.QuadraticField.from_function(lambda x: (x[0] / 3, x[0] - x[1]), 2)
HENON = sf.QuadraticField.from_hamiltonian(
    lambda x: (x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3, 2
)
FIELDS = sf.QuadraticField(np.arange(54.0).reshape(2, 3, 3, 3), np.eye(3))


# Runs of every map, with and without optional data.
RUNS = {
    "batch": iterate(BODY, STARTS, 0.2, 20, save_every=5),
    "one": iterate(BODY, STARTS[0], -0.2, 3),
    "last": iterate(BODY, STARTS, 0.2, 40, save_every=None),
    "last_few": iterate(BODY, STARTS, 0.2, 7, save_every=None, method="ds2"),
    "not_saved": iterate(BODY, STARTS, 0.2, 7, save_every=5, method="canonical"),
    "turning": iterate(BODY, STARTS, SIZES, 7, save_every=5, attitude=True),
    "turning_last": iterate(BODY, STARTS, 0.2, 7, save_every=None, attitude=True),
    "no_steps": iterate(BODY, STARTS, 0.2, 0, method="ds2"),
    "empty": iterate(BODY, np.empty((0, 2)), 0.2, 3, attitude=True),
    "empty_axis": iterate(BODY, np.empty((2, 0, 2)), np.full((2, 1), 0.1), 3),
    "bodies": iterate(SWEPT, ODD, 0.1, 4),
    "short_axes": iterate(SHORT, STARTS[:1, None], np.array([[0.1]]), 4),
    "failed": iterate(POLES, [[1.0, -3.0], [0.3, 0.1]], 1, 5),
    "nd": iterate(BODY_ND, FOURS, SIZES, 6, save_every=4),
    "nd_turning": iterate(BODY_ND, FOURS, SIZES, 6, save_every=4, attitude=True),
    "nd_last": iterate(BODY_ND, FOURS, 0.1, 6, save_every=None, attitude=True),
    "nd_solved": iterate(EQUAL, FOURS, 0.1, 60, save_every=20),
    "nd_bodies": iterate(SWEPT_ND, STARTS, 0.1, 4, method="gauss"),
    "gyrostat": iterate(GYROSTAT, STARTS, SIZES, 6, save_every=4, attitude=True),
    "gyrostat_last": iterate(GYROSTATS, ODD[0], 0.35, 6, save_every=None),
    "field": iterate(THIRD, STARTS, 0.01, 5),
    "fields": iterate(FIELDS, THREES[:2], 0.01, 5, save_every=None),
    "hamiltonian": iterate(HENON, STARTS, 0.01, 5),
    "full": full(BODY, THREES, SIZES, 6, 3.0, save_every=4),
    "full_bodies": full(sf.Suslov3D(4, 2, -0.5, -0.3, I3=[[3.0], [4.0]]), THREES, 0.1, 4),
    "full_last": full(BODY, THREES[0], 0.1, 4, 3.0, save_every=None),
    "full_failed": full(POLES, [[1.0, -3.0, 0.0]], 1, 5, 3.0),
}


@cache
def run_of(name):
    return RUNS[name]()


QUANTITIES = ("first_integral", "energy", "modified_energy", "criticality", "to_xy", "reaction")


@pytest.mark.parametrize(
    ("name", "message", "missing"),
    [
        ("full", "expected a map that has it, got a run of suslov3d_full", QUANTITIES),
        ("nd", "body: expected Suslov3D, got SuslovND", ("to_xy",)),
        ("gyrostat", "instead of to_xy use iterate or flow", ("to_xy",)),
        *((name, "", ()) for name in ("one", "bodies", "empty")),
    ],
)
def test_a_run_has_the_quantities_of_its_map(name, message, missing):
    run = run_of(name)
    for quantity in missing:
        with pytest.raises(TypeError, match=message):
            getattr(run, quantity)()
    for quantity in set(QUANTITIES) - set(missing):
        if name == "nd" and quantity in ("first_integral", "criticality"):
            with pytest.raises(sf.NotIntegrableError):
                getattr(run, quantity)()
        else:
            eps = () if quantity in ("energy", "to_xy") else (run.eps,)
            expected = getattr(sf, quantity)(run.body, run.omega, *eps)
            assert same(getattr(run, quantity)(), expected), quantity


def test_times(body, sweep):
    """Times broadcast against states, even if there are as many states as step sizes."""
    assert same(run_of("batch").time, 0.2 * np.array([0, 5, 10, 15, 20]))
    assert sf.iterate(body, [0.0, 0.0], 1e308, 3).time[-1] == np.inf
    assert sweep.time.shape == (2, 1, 2)
    assert np.broadcast_shapes(sweep.time.shape, sweep.omega.shape[:-1]) == sweep.omega.shape[:-1]
    assert same(sweep.time[:, 0], np.multiply.outer([0, 4], sweep.eps))


def test_repr_is_one_line():
    for run in map(run_of, RUNS):
        assert re.fullmatch(r"Trajectories\((omega|x): .{,98}\)", repr(run))
    about = "omega: (6, 2, 2), n: 0, 1 ... 5, eps: 1, failed: 1 of 2"
    assert repr(run_of("failed")) == f"Trajectories({about})"
    assert repr(run_of("empty_axis")).endswith("eps: 0.1, failed: 0 of 0)")


@pytest.mark.parametrize("engine", [None, "netcdf4", "zarr2", "zarr3"])
@pytest.mark.parametrize("name", RUNS)
@pytest.mark.sampled(32)
def test_through_xarray(name, engine, tmp_path):
    """Round trip through a dataset in memory, and through files by xarray with default options."""
    run, path = run_of(name), tmp_path / "run"
    opened = data = run.to_xarray()
    if engine == "netcdf4":
        data.to_netcdf(path, engine=engine)
        opened = xarray.open_dataset(path, engine=engine)
    elif engine:
        options = {"consolidated": engine == "zarr2"}
        data.to_zarr(path, zarr_format=int(engine[-1]), **options)
        opened = xarray.open_dataset(path, engine="zarr", **options)
    with opened:
        back = sf.Trajectories.from_xarray(opened)
    assert_same_run(run, back, resume=False)
    with pytest.raises(ValueError, match="does not hold the data needed to resume"):
        back.extend(3)


def test_a_parameter_as_a_coordinate():
    sizes = np.array([0.1, 0.2, 0.3])[:, None, None]
    body = sf.Suslov3D(4, 1, np.array([[-0.5], [-0.4]]), -0.3)
    run = sf.iterate(body, [[1.0, 0.5], [0.2, -0.7]], sizes, 5)
    data = run.to_xarray(dims=("eps", "I13", "start"))
    assert same(data.omega.sel(eps=0.2, I13=-0.4).values, run.omega[:, 1, 1])
    assert same(data.time.sel(eps=0.3).values, 0.3 * np.arange(6))
    assert_same_run(run, sf.Trajectories.from_xarray(data), resume=False)
    part = sf.Trajectories.from_xarray(data.sel(eps=0.2))
    assert same(part.omega, run.omega[:, 1])
    assert same(part.energy(), run.energy()[:, 1])
    one = sf.iterate(BODY, [[1.0, 0.5]], [0.2], 5).to_xarray(dims="eps")
    assert one.omega.sel(eps=0.2).shape == (6, 2)
    for dims in (("I13", "eps", "start"), ("eps", "I13", "I1"), ("a", "b", "eps")):
        with pytest.raises(ValueError, match=r"expected .* for an axis along which it varies"):
            run.to_xarray(dims=dims)


def test_contents_of_a_dataset():
    """A dataset has no data for continuation, no `Conventions`, and units for pure numbers only."""
    run = run_of("turning")
    data = run.to_xarray()
    names = "omega n time eps status failed_at final attitude component I1 I2 I13 I23"
    assert set(data.variables) == set(names.split())
    about = {"method": "auto", "steps": 7, "save_every": 5, "version": sf.__version__}
    assert about.items() <= data.attrs.items()
    assert "Conventions" not in data.attrs
    assert {data[name].attrs.get("units", "1") for name in data.variables} == {"1"}
    assert "units" not in data.omega.attrs | data.eps.attrs
    assert data.omega.dims == ("n", "trajectory", "component")
    assert (data.omega.sel(n=5, component="Omega2") == run.omega[1, :, 1]).all()
    assert same(data.time.values, run.time)
    assert data.status.attrs["flag_values"].dtype == np.int8
    names = data.status.attrs["flag_meanings"].split()
    for value, name in zip(data.status.attrs["flag_values"], names, strict=True):
        assert sf.Status[name] == value
    assert run_of("nd").to_xarray().component.values.tolist() == ["Omega1n", "Omega2n", "Omega3n"]


def test_names_and_coordinates_of_the_user(sweep):
    coords = {"mass": ["a", "b", "c"], "colour": ("step", [1, 2])}
    data = sweep.to_xarray(dims=("mass", "step"), coords=coords)
    assert data.omega.dims == ("n", "mass", "step", "component")
    assert same(data.omega.sel(mass="c").isel(step=1).values, sweep.omega[:, 2, 1])
    assert data.colour.dims == ("step",)
    assert_same_run(sweep, sf.Trajectories.from_xarray(data), resume=False)
    assert run_of("batch").to_xarray(dims="start").omega.dims == ("n", "start", "component")


def test_other_orders_and_parts_of_a_batch(sweep):
    data = sweep.to_xarray().transpose("component", "batch_1", "n", "batch_0")
    turned = sf.Trajectories.from_xarray(data)
    assert same(turned.omega, np.swapaxes(sweep.omega, 1, 2))
    assert same(turned.first_integral(), np.swapaxes(sweep.first_integral(), 1, 2))
    part = sf.Trajectories.from_xarray(sweep.to_xarray().isel(batch_0=2))
    assert same(part.omega, sweep.omega[:, 2])
    assert np.ravel(part.body.I1) == sweep.body.I1[2, 0]
    assert same(part.energy(), sweep.energy()[:, 2])
    part = sf.Trajectories.from_xarray(sweep.to_xarray().isel(batch_1=[1]))
    assert same(part.omega, sweep.omega[:, :, 1:])
    assert same(part.eps, sweep.eps[1:])


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"dims": "a"}, ValueError, "for each of the 2 axes of the batch, got 'a'"),
        ({"dims": ("a", "a")}, ValueError, "a distinct name"),
        ({"dims": ("a", "n")}, ValueError, "of which n is taken"),
        ({"dims": ("a", "omega")}, ValueError, "of which omega is taken"),
        ({"dims": ("a", 3)}, TypeError, "dims: expected names"),
        ({"coords": {"omega": 3}}, ValueError, "expected names not in use, got omega"),
        ({"coords": {"batch_0": [1, 2]}}, ValueError, "coords: conflicting sizes"),
        ({"coords": {"stranger": [1, 2]}}, ValueError, "got new dimensions stranger"),
        ({"coords": [1, 2]}, TypeError, "coords: expected a mapping"),
    ],
)
def test_bad_labels(sweep, arguments, error, message):
    with pytest.raises(error, match=message):
        sweep.to_xarray(**arguments)


def spoil(**changes):
    return lambda data: data.assign(changes)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda data: data.omega, TypeError, "expected an xarray.Dataset, got DataArray"),
        (lambda data: data.drop_vars("I1"), ValueError, "got one without I1"),
        (lambda data: data.drop_attrs(), ValueError, "expected a run of this package, got other"),
        (lambda data: data.isel(n=[0]), ValueError, r"expected shape \(2, 3, 2, 2\)"),
        (
            lambda data: data.isel(component=[0]),
            ValueError,
            r"omega: expected shape \(2, 3, 2, 2\), got",
        ),
        (lambda data: data.isel(component=[1, 0]), ValueError, "dataset: expected the components"),
        (spoil(n=("n", [0, 3])), ValueError, "n: expected the saved steps of a run of 5"),
        (lambda data: data.isel(n=0), ValueError, "expected omega along n, batch_0"),
        (spoil(status=("x", [0])), ValueError, "expected eps along the batch, got batch_1"),
        (spoil(eps=("x", [0.1])), ValueError, "expected eps along the batch, got x"),
    ],
)
def test_other_datasets(sweep, change, error, message):
    with pytest.raises(error, match=message):
        sf.Trajectories.from_xarray(change(sweep.to_xarray()))


@pytest.mark.parametrize("components", [(0, 1), (2, 0)])
def test_plot(components):
    orbits = sf.iterate(BODY_ND, [[[0.3, 0.9, -0.6]], [[0.1, 0.2, 0.3]]], 0.4, 30)
    axes = orbits.plot(components=components)
    shown = "1 and 2" if components == (0, 1) else "3 and 1"
    assert axes.get_title() == f"components {shown} of 3"
    assert (axes.lines[0].get_color() != axes.lines[1].get_color()).any()
    assert orbits.plot(ax=axes) is axes
    for k, line in enumerate(axes.lines[:2]):
        drawn = np.transpose(line.get_data())
        assert np.array_equal(drawn, orbits.omega[:, k, 0][:, list(components)])
    with pytest.raises(ValueError, match="components: expected an integer from 0 to 2, got 3"):
        orbits.plot(components=(0, 3))


def test_a_failure_is_reported_once(unit):
    with pytest.warns(sf.SingularStepWarning, match="at step 1"):
        run = sf.iterate(unit, [1.0, -3.0], 1.0, 1)
    assert run.extend(3).failed_at == run.steps


def test_a_run_as_an_array():
    run, other = run_of("failed"), run_of("batch")
    assert len(run) == 6
    assert np.asarray(run) is run.states is run.omega
    assert np.array(run) is not run.states
    assert np.asarray(run, np.float32).dtype == np.float32
    assert (run == run.extend(0)) is True
    assert (run == replace(run, states=run.states + 1.0)) is (run == other) is (run == 1) is False
    assert run != replace(run, attitude=np.ones(3))
    with pytest.raises(TypeError, match="unhashable"):
        hash(run)
    for index in (2, -1, slice(None, None, 2), (..., 1), (slice(2), 0), run.n % 2 == 0, [0, 3]):
        assert same(run[index], run.states[index])
    assert [state.tobytes() for state in run] == [state.tobytes() for state in run.states]
    with pytest.raises(IndexError):
        _ = run[6]
    with pytest.raises(AttributeError, match="x: expected omega or states"):
        _ = run.x


@pytest.mark.parametrize(
    "name", ["not_saved", "turning", "nd_turning", "gyrostat", "fields", "full"]
)
def test_an_extended_run_stays_as_it_is(name):
    """It can be extended again, and differently."""
    run = run_of(name)
    once = run.extend(5, on_singular="ignore")
    assert_same_run(once, run.extend(5, on_singular="ignore"))
    assert_same_run(once, run.extend(2).extend(3, on_singular="ignore"))
    assert_same_run(run, RUNS[name]())


def test_the_last_orientation_is_that_of_a_run_that_saves_all():
    for name, body, states, eps, steps in (
        ("nd_last", BODY_ND, FOURS, 0.1, 6), ("turning_last", BODY, STARTS, 0.2, 7),
    ):  # fmt: skip
        whole = sf.iterate(body, states, eps, steps, attitude=True)
        assert same(run_of(name).attitude[-1], whole.attitude[-1])


def test_as_many_steps_as_there_can_be(tmp_path):
    run = sf.iterate(BODY, [1.0, 0.5], 0.2, 2**53, save_every=2**52)
    assert run.n.tolist() == [0, 2**52, 2**53]
    assert len(run) == len(run.time) == 3
    run.save(tmp_path / "run.npz")
    assert_same_run(run, sf.Trajectories.load(tmp_path / "run.npz"))


@pytest.mark.parametrize("name", ["gyrostat", "hamiltonian", "nd", "full"])
def test_copies_with_other_attributes_have_no_future(name):
    run = run_of(name)
    plain = asdict(run)
    assert same(plain["states"], run.states)
    assert plain["body"].keys() >= {*run.body._names()}
    for other in (replace(run, eps=0.5), replace(run, steps=run.steps + 1), replace(run)):
        with pytest.raises(ValueError, match=r"extend: expected a run of iterate, .* other attr"):
            other.extend(1)
