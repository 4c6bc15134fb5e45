"""Promises of the public functions of states and steps: a test for each, of the table `promises`.

Each is tested for the random bodies of all records that have it: a new record is tested by being
there.
"""

import inspect
from typing import get_args

import numpy as np
import promises
import pytest
from children import TWO_THREADS
from promises import KINDS, LANES, RECORDS, ROWS, SIZE, WITH_EPS, hard, same, sample

import suslov_fast as sf
from suslov_fast.bodies import exact
from suslov_fast.core.numba import decorators as compiling
from suslov_fast.maps import batch, kernel_calls
from suslov_fast.maps.map_records import MAPS, Method


def cases(threaded=False):
    rows = {name: row for name, row in ROWS.items() if row.threads or not threaded}
    every = [(name, kind) for name in rows for kind in KINDS if promises.has(kind, name)]
    ids = [f"{name}, {kind}" for name, kind in every]
    return pytest.mark.parametrize(("name", "kind"), every, ids=ids)


def test_type_checkers_know_all_methods():
    assert {*get_args(Method)} == {name for map in MAPS.values() for name in map.methods}


def test_every_function_with_threads_is_in_the_table():
    functions = {name: getattr(sf, name) for name in sf.__all__ if name.islower()}
    functions |= {"exact": sf.Suslov3D.exact}
    batched = {n for n, f in functions.items() if "threads" in inspect.signature(f).parameters}
    assert batched - {"crossings"} - {name.split(":")[0] for name in ROWS} == set()


# Shapes of the body, of omega but for its last axis, and of eps.
SHAPES = [((SIZE,),) * 3, ((2, 1), (3,), (5, 1, 1)), ((), (4, 2), (2,))]
SHAPES += [((3,), (0, 3), ()), ((0,), (3, 1), ())]


@pytest.mark.sampled(8)
@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
@cases()
def test_a_batch_is_a_loop_in_any_order(rng, monkeypatch, name, kind):
    """Also where functions evaluate a batch in parts, between which Ctrl-C is heard."""
    row = ROWS[name]
    monkeypatch.setattr("suslov_fast.maps.evaluation.NUMBERS_OF_PART", 30)
    for shapes in SHAPES:
        body, omega, eps = sample(rng, kind, *shapes, name=name)
        batch, values = row.batch(body, omega, eps), list(row.values(body, omega, eps))
        state = np.broadcast_to(omega, (*batch, omega.shape[-1]))
        step = np.broadcast_to(eps if row.given(body, eps) else 0.0, batch)
        assert all(each.shape[: len(batch)] == batch for each in values)
        some = [i for i in np.ndindex(batch) if i[0] in (1, LANES - 1, LANES, SIZE - 1)]
        for index in (*some, rng.permutation(batch[0])):
            alone = row.values(promises.part(body, index, batch), state[index], step[index])
            same(alone, [each[index] for each in values])


@pytest.mark.sampled(4)
@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
@pytest.mark.compiled
@cases(threaded=True)
def test_threads_and_chunks(rng, monkeypatch, name, kind):
    row, problem = ROWS[name], sample(rng, kind, name=name)
    alone = list(row.values(*problem, threads=1))
    monkeypatch.setattr(kernel_calls, "STEPS_OF_SERIAL_CALL", 0)
    monkeypatch.setattr(compiling, "WARM_UP", -1.0)  # kernels, not NumPy
    same(alone, row.values(*problem, threads=TWO_THREADS))
    for name in ("WORK_OF_CHUNK", "WORK_OF_CHUNK_WITH_TURNS"):
        monkeypatch.setattr(batch, name, 2**6)
    monkeypatch.setattr(exact, "SLICE", 2**6)
    same(alone, row.values(*problem))


@pytest.mark.sampled(24)
@pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning")
@cases()
def test_lists_integers_and_other_memory(rng, name, kind):
    """Lists, other memory and integers; nothing that is passed in changes; NaN gives NaN."""
    row, (body, omega, eps) = ROWS[name], sample(rng, kind, (), (3, 4), (), name)
    omega = np.round(omega * 4)
    kept, expected = omega.copy(), list(row.values(body, omega, eps))
    strided = np.zeros((4, 3, 2 * omega.shape[-1])).swapaxes(0, 1)[..., ::2]
    strided[:] = omega
    strided.flags.writeable = False
    for given in (omega.tolist(), strided, omega.astype(int), omega.astype(np.float32)):
        same(row.values(body, given, eps), expected)
    assert (omega == kept).all()
    omega[1, 2, 0] = np.nan
    for one, other in zip(row.values(body, omega, eps), expected, strict=True):
        if one.dtype.kind == "f":
            assert np.isnan(one[1, 2]).any()
        np.testing.assert_array_equal(np.delete(one, 1, axis=0), np.delete(other, 1, axis=0))


@cases()
def test_bad_input(rng, name, kind):
    row, (body, omega, eps) = ROWS[name], sample(rng, kind, (), (2,), (), name)
    state = "x|x0" if RECORDS[kind].body in (sf.Field, sf.Map) else "omega0?|xy|x0?"
    omega[1, 1] = -np.inf
    with pytest.raises(ValueError, match=rf"^({state}) must be .* -inf at index \(1, 1\)"):
        list(row.values(body, omega, eps))
    with pytest.raises(ValueError, match=f"^({state}) must "):
        list(row.values(body, np.ones(9), eps))
    if name.partition(":")[0] in sf.__all__ or name in sf.kahan.__all__:  # no methods
        with pytest.raises(TypeError, match=r"^(body|system) must"):
            row.call(1, omega, *(eps,) * row.eps)
    with pytest.raises(ValueError, match="broadcast"):
        row.call(promises.part(body, ..., (3,)), np.ones_like(omega), *row.given(body, eps))
    for wrong in (np.inf, 1e-51, 1e51, "a") if row.given(body, eps) else ():
        with pytest.raises((ValueError, TypeError), match=r"^eps must"):
            list(row.values(body, np.ones_like(omega), wrong))
    for count in (0, 1.5, 10**6) if row.threads else ():
        with pytest.raises((ValueError, TypeError), match=r"^threads must"):
            list(row.values(body, np.ones_like(omega), eps, threads=count))


with_options = pytest.mark.parametrize(("kind", "options"), promises.OPTIONS, ids=str)


@pytest.mark.sampled(4)
@with_options
def test_runs_with_other_states_saved(rng, kind, options):
    body, omega, *eps = hard(rng, kind)
    problem = body, omega, *eps * (not isinstance(body, sf.Map))
    options = options | {"on_singular": "ignore"}
    whole = sf.iterate(*problem, 30, **options)
    assert {-2, 0} <= {*whole.status}
    if kind == "Suslov3D 0":
        assert whole.failed_at[11:14].tolist() == [1, 2, 3]
        assert (whole.status[11:14] == sf.Status.SINGULAR).all()
    for save_every in (1, 7, None):
        run = sf.iterate(*problem, 30, save_every=save_every, **options)
        same([run.states, run.final, run.status], [whole.states[run.n], whole.final, whole.status])
        if run.attitude is not None:
            same([run.attitude], [whole.attitude[run.n]])


@pytest.mark.parametrize("kind", KINDS)
def test_states_saved_seldom(rng, kind):
    """Small states of one body, with one step size, for which kernels have loops of their own."""
    body, omega, _ = sample(rng, kind, (), (2 * LANES + 9,), ())
    options = {"on_singular": "ignore"}  # orbits may diverge
    eps = (0.1,) * (not isinstance(body, sf.Map))
    whole = sf.iterate(body, 0.1 * omega, *eps, promises.STEPS, **options)
    for save_every in (2, 3):
        run = sf.iterate(body, 0.1 * omega, *eps, promises.STEPS, save_every=save_every, **options)
        same([run.states], [whole.states[::save_every]])


@pytest.mark.sampled(5)
@with_options
def test_failures_are_marked_at_any_step(rng, kind, options):
    body, omega, *eps = hard(rng, kind)
    run = sf.iterate(
        body, omega, *eps * (not isinstance(body, sf.Map)), 100, on_singular="ignore", **options
    )
    exist = np.isfinite(run.states).all(axis=-1)
    failed = run.status < 0
    assert (failed == ~exist[-1]).all()
    assert (run.failed_at[failed] == exist.argmin(axis=0)[failed]).all()
    assert (exist == np.where(failed, run.n[:, None] < run.failed_at, True)).all()
    assert np.isnan(run.states[~exist]).all()


@pytest.mark.sampled(8)
@pytest.mark.parametrize("kind", WITH_EPS)
def test_the_jacobian_is_that_of_the_steps(rng, kind):
    """By central differences, where eps |f'| is 1/2: that of another discretization is far off."""
    map, (body, omega, _) = RECORDS[kind], sample(rng, kind, (), (9,), ())
    omega, h, method = np.clip(omega, -1, 1), 1e-5, next(iter(map.methods))
    slopes = sf.kahan.jacobian(body, omega, 1e-6, method=method) - np.eye(omega.shape[-1])
    eps = 0.5e-6 / np.linalg.norm(slopes, 2, axis=(-2, -1))
    found = sf.kahan.jacobian(body, omega, eps, method=method)
    moved = omega + h * np.multiply.outer([1, -1], np.eye(omega.shape[-1]))[:, :, None]
    for method in map.methods:
        run = sf.iterate(body, moved, eps, 1, method=method, on_singular="ignore")
        slopes = np.moveaxis(np.subtract(*run.final) / (2 * h), 0, -1)
        there = np.isfinite(slopes).all(axis=(-2, -1))
        assert there.any()
        np.testing.assert_allclose(found[there], slopes[there], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("kind", [each for each in promises.BY_DEFAULT if each in WITH_EPS])
def test_units_and_inverse(rng, kind):
    body, omega, eps = sample(rng, kind, (9,), (9,), (9,))
    omega, eps = np.clip(omega, -2, 2), eps / 4
    there = sf.step(body, omega, eps)
    np.testing.assert_allclose(sf.step(body, there, -eps), omega, rtol=1e-11, atol=1e-12)
    if kind.startswith(("Suslov3D", "SuslovND")):
        for unit in (1e-30, 3.7, 1e25):
            rotor = {"k": body.k * unit} if "k" in body.parameters else {}
            other = type(body)(**{**body.parameters, **rotor})
            found = sf.step(other, omega * unit, eps / unit) / unit
            np.testing.assert_allclose(found, there, rtol=1e-12, atol=1e-13)
        found = sf.step(body.field(), omega, eps)
        np.testing.assert_allclose(found, there, rtol=1e-11, atol=1e-12)


PREY = sf.Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
STILL = [
    (sf.Suslov3D(2, 3, 0, 0), [[0.3, -0.7], [0.0, 0.0]], 0.5),
    (sf.Suslov3D(1, 1, 1, 0), [[0.0, 0.3], [0.0, -1e7]], 1.0),
    (sf.Suslov3D(1, 1, 1, 0, 0.5), [[0.0, 0.0], [1.0, 2.0]], [0.5, 0.0]),
    (sf.SuslovND(J=[1.0, 2.0, 3.0], I=[0.0] * 3), [0.3, 0.9, -0.6], 0.3),
    (sf.SuslovND(J=[2.0] * 3, I=[0.0, 0.7, 0.0]), [0.0, -0.3, 0.0], 0.3),
    (sf.SuslovND(J=[3.0], I=[0.7]), [[0.3], [-5.0]], 0.2),
    (sf.Field.from_terms([[[1]]], [[-1]]), [[0.0], [1.0]], 0.5),
    (PREY, [[1.0, 1.0], [0.0, 0.0]], 0.3),
]


@pytest.mark.parametrize(("body", "omega", "eps"), STILL)
def test_states_at_rest_keep_their_bits(body, omega, eps):
    run = sf.iterate(body, omega, eps, 600)
    assert run.ok.all()
    assert (run.states == omega).all()
    assert (sf.step(body, omega, eps) == omega).all()
    solved = not isinstance(body, sf.Field)
    if solved and not (isinstance(body, sf.SuslovND) and np.ptp(body.J)):
        assert (body.exact(omega, eps, [-(10**12), 7, 10**12]) == omega).all()
        if np.all(eps):
            assert (np.array(body.limits(omega, eps)) == omega).all()
            assert (sf.flow(body, omega, time=[1e9, 0.5, 1e9]).states == omega).all()
