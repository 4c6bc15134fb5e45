"""`Trajectories`: attributes, methods, orientations, and conversion to labelled arrays."""

import re
from dataclasses import replace

import naive
import numpy as np
import pytest
import samples
from example_runs import BODY, FOUR, RUNS, STARTS, run_of
from numba import config

import suslov_fast as sf
from suslov_fast.results.schema import in_datasets

QUANTITIES = {"first_integral", "energy", "modified_energy"}
HAS = {
    "batch": QUANTITIES,
    "gyrostat": QUANTITIES,
    "four": {"energy", "modified_energy"},
    "field": set(),
    "hamiltonian": {"energy", "modified_energy"},
}


@pytest.mark.parametrize("name", HAS)
def test_a_run_has_the_functions_of_its_map(name):
    run = run_of(name)
    for quantity in HAS[name]:
        eps = () if quantity == "energy" else (run.eps,)
        expected = samples.quantity(quantity)(run.body, run.states, *eps)
        np.testing.assert_array_equal(getattr(run, quantity)(), expected)
    for quantity in QUANTITIES - HAS[name]:
        with pytest.raises((TypeError, AttributeError, sf.NotIntegrableError)):
            getattr(run, quantity)()


@pytest.mark.parametrize("name", RUNS)
def test_attributes(name):
    run, (body, _, eps, steps, options) = run_of(name), RUNS[name]
    every = options.get("save_every", 1)
    assert run.n.tolist() == ([steps] if every is None else [*range(0, steps + 1, every)])
    assert run.states.shape == (len(run.n), *run.status.shape, body.dimension)
    assert len(run.states) == len(run.time) == len(run.n)
    np.testing.assert_array_equal(run.time, np.multiply.outer(run.n, eps))
    assert (run.status.dtype, run.failed_at.dtype) == (np.int8, np.int64)
    assert run.ok.shape == run.status.shape
    assert run.ok.all() == (name != "failed")
    assert (run.method, run.steps, run.save_every) == (options.get("method", "auto"), steps, every)
    assert re.fullmatch(r"Trajectories\(states: .{,98}\)", repr(run))
    more = f" ... {run.n[-1]}" if len(run.n) > 2 else ""
    assert f" n: {', '.join(map(str, run.n[:2]))}{more}, " in repr(run)
    for name in ("x", "omega", "savefig"):
        with pytest.raises(AttributeError, match=name):
            getattr(run, name)


def test_a_run_as_an_array():
    run, other = run_of("failed"), run_of("batch")
    assert np.asarray(run) is run.states
    assert np.array(run) is not run.states
    assert np.asarray(run, np.float32).dtype == np.float32
    assert (run == replace(run)) is True
    assert (run == replace(run, states=run.states + 1.0)) is (run == other) is (run == 1) is False
    assert run != replace(run, attitude=np.ones(3))
    with pytest.raises(TypeError, match="unhashable"):
        hash(run)


def test_step_sizes_that_change_later_do_not_change_a_run():
    eps = np.full(5, 0.2)
    run = sf.iterate(BODY, STARTS, eps, 3)
    eps[:] = 9.0
    assert (run.eps == 0.2).all()


@pytest.mark.parametrize("name", RUNS)
def test_a_run_goes_on_from_its_last_states(name):
    """With the bits of one run; those of bodies in three dimensions may have other last digits."""
    body, omega0, eps, _, options = RUNS[name]
    given = {"on_singular": "ignore", "save_every": None, "method": options.get("method", "auto")}
    whole, half = (sf.iterate(body, omega0, eps, steps, **given) for steps in (60, 40))
    last = sf.iterate(body, half, eps, 20, **given).final
    if isinstance(body, sf.Suslov3D):
        np.testing.assert_allclose(last, whole.final, rtol=1e-13, atol=1e-13)
    else:
        np.testing.assert_array_equal(last, whole.final)


def test_a_run_of_a_driven_system_goes_on_at_its_time():
    field = sf.Field(lambda t, x: (x[1], -t * x[0]), "x v")
    eps = np.array([0.01, 0.02])
    whole, half = (sf.iterate(field, [1.0, 0.0], eps, steps, t0=0.5) for steps in (300, 200))
    np.testing.assert_allclose(sf.iterate(field, half, eps, 100).final, whole.final, 1e-12)
    expected = sf.flow(field, half.final, time=1.0, t0=0.5 + 200 * eps)
    np.testing.assert_array_equal(sf.flow(field, half, time=1.0).final, expected.final)


def test_parameters_as_coordinates():
    sizes = np.array([0.1, 0.2, 0.3])[:, None, None]
    body = sf.Suslov3D(4, 1, np.array([[-0.5], [-0.4]]), -0.3)
    run = sf.iterate(body, [[1.0, 0.5], [0.2, -0.7]], sizes, 5)
    data = run.to_xarray()
    assert data.states.dims == ("n", "eps", "I13", "batch_2", "component")
    assert (data.states.sel(eps=0.2, I13=-0.4).values == run.states[:, 1, 1]).all()
    assert (data.time.sel(eps=0.3).values == 0.3 * np.arange(6)).all()
    family = run_of("field").to_xarray()
    assert (family.states.sel(a=2).values == run_of("field").states[:, 1]).all()


def test_contents_of_a_dataset():
    run = run_of("turning")
    data = run.to_xarray()
    others = {column.short for column in in_datasets("Trajectories")}
    assert {*data.variables} - others == {*"n time eps component I1 I2 I13 I23".split()}
    assert (data.attrs["method"], data.attrs["save_every"]) == ("auto", 5)
    assert (data.states.sel(n=5, component="Omega2") == run.states[1, :, 1]).all()
    names = data.status.attrs["flag_meanings"].split()
    for value, name in zip(data.status.attrs["flag_values"], names, strict=True):
        assert sf.Status[name] == value
    assert run_of("four").to_xarray().component.values.tolist() == ["Omega1n", "Omega2n", "Omega3n"]
    several = sf.iterate(FOUR, np.full((5, 3), 0.3), 0.4, 2, method="gauss").to_xarray()
    assert (several.J.dims, several.states.shape) == (("component",), (3, 5, 3))


SHORT = {"WORK_OF_CHUNK": 2**10, "WORK_OF_CHUNK_WITH_TURNS": 2**10, "STEPS_BETWEEN_REPORTS": 1}


@pytest.mark.compiled
@pytest.mark.parametrize("name", RUNS)
def test_a_callable_ends_a_run(monkeypatch, name):
    """All trajectories stand at the step of the call; the run is that of so many steps."""
    body, omega0, eps, _, options = RUNS[name]
    options = options | {"on_singular": "ignore"}
    for short, value in SHORT.items():
        monkeypatch.setattr(f"suslov_fast.maps.batch.{short}", value)
    for first in (0, 23, 299):
        seen = []

        def progress(done, total, seen=seen, first=first):
            seen.append((done, total))
            return np.False_ if done >= first else None

        run = sf.iterate(body, omega0, eps, 300, **options, progress=progress)
        steps = run.steps
        assert seen[-1] == (steps, 300)
        assert steps == 300 or not first or steps - first < 100
        assert run == sf.iterate(body, omega0, eps, steps, **options)


# -------------------------------------------------------------------------------- orientations
@pytest.mark.sampled(1)
@pytest.mark.parametrize("eps", [0.2, -0.2, 3.0])
def test_orientations_are_products_of_cayley_matrices(rng, body, eps):
    others = [
        sf.SuslovND(J=rng.uniform(1, 3, m), I=rng.uniform(-0.5, 0.5, m)) for m in (1, 2, 3, 8)
    ]
    others.append(sf.Suslov3D(2.3, 1.4, 0.5, -0.7, 0.9))
    for each in (body, *others):
        starts = rng.normal(size=(2, each.dimension))
        run = sf.iterate(each, starts, eps, 30, attitude=True, on_singular="ignore")
        R = run.attitude
        assert (R[0] == np.eye(R.shape[-1])).all()
        states = run.states[:, 1]
        if isinstance(each, sf.Suslov3D):  # the last column of the matrix Omega
            states = states[:, ::-1] * [1, -1]
        exact = naive.attitude(states, eps)
        exact = [np.array(matrix.tolist(), float) for matrix in exact]
        np.testing.assert_allclose(R[:, 1], exact, rtol=0, atol=5e-15)


def test_orientations_begin_at_given_ones(case, rng):
    body, omega0 = case
    n = body.dimension + 1
    R0, _ = np.linalg.qr(rng.normal(size=(3, n, n)))
    R0[..., 0] *= np.linalg.det(R0)[:, None]
    R = sf.iterate(body, omega0, 0.2, 50, attitude=R0).attitude
    np.testing.assert_array_equal(R[0], R0)
    from_identity = sf.iterate(body, omega0, 0.2, 50, attitude=True).attitude
    np.testing.assert_allclose(R, R0 @ from_identity[:, np.newaxis], rtol=0, atol=2e-14)
    assert abs(R @ R.swapaxes(-2, -1) - np.eye(n)).max() < 2e-14


@pytest.mark.parametrize(("eps", "size"), [(1.0, 1e14), (-1.0, 1e100), (1e50, 1e-20), (1.0, 1e200)])
def test_half_a_turn(eps, size):
    """For huge |eps omega| a step is a half turn: R = 2 u u^T - 1 about u, or in the plane of u."""
    u, e = np.array([0.6, -0.8, 0.0, 0.0]), np.eye(4)[-1]
    in_3d = 2 * np.outer(u[:3], u[:3]) - np.eye(3)
    in_4d = np.eye(4) - 2 * np.outer(u, u) - 2 * np.outer(e, e)
    still = sf.SuslovND(J=np.ones(3), I=np.zeros(3))
    for body, expected in ((sf.Suslov3D(1, 2, 0, 0), in_3d), (still, in_4d)):
        R = sf.iterate(body, size * u[: body.dimension], eps, 2, attitude=True).attitude
        np.testing.assert_allclose(R[1], expected, atol=1e-12)
        np.testing.assert_allclose(R[2], np.eye(len(expected)), atol=1e-12)


def test_orientations_remain_orthogonal(case):
    run = sf.iterate(*case, 0.3, 300 if config.DISABLE_JIT else 100_000, attitude=True)
    error = run.attitude @ run.attitude.swapaxes(-2, -1) - np.eye(run.attitude.shape[-1])
    assert abs(error).max() < 1e-14
