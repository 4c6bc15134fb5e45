"""Results depend on the trajectory alone, bit for bit."""

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import suslov_fast as sf
from suslov_fast._engine import problem, threads
from suslov_fast._kernels import maps_3d as loops
from suslov_fast._kernels import tiles
from suslov_fast._kernels.iterate import LANES

METHODS = ("auto", "canonical", "ds2")


def same(first, second):
    return np.array_equal(first, second, equal_nan=True)


def mixed_batch(rng, size):
    """Trajectories of every kind, each with a body and a step size of its own."""
    body = sf.Suslov3D(
        *rng.uniform(0.5, 4, (2, size)), *(rng.normal(size=(2, size)) * rng.choice([0, 0.5], size))
    )
    omega = rng.normal(size=(size, 2)) * 10 ** rng.uniform(-1, 1.5, (size, 1))
    eps = rng.choice([-0.5, 0.0, 0.1, 0.5], size)
    return body, omega, eps


def part(body, chosen):
    return sf.Suslov3D(*(parameter[chosen] for parameter in body.parameters))


def run(body, omega, eps, steps=40, **options):
    return sf.iterate(body, omega, eps, steps, on_singular="ignore", **options)


@pytest.mark.parametrize("save_every", [1, 3, None])
@pytest.mark.parametrize("method", METHODS)
def test_alone_or_in_a_batch(rng, method, save_every):
    size = LANES + 22
    body, omega, eps = mixed_batch(rng, size)
    options = {"method": method, "save_every": save_every}
    together = run(body, omega, eps, **options)
    assert set(np.unique(together.status)) >= {sf.Status.OK, sf.Status.SUPERCRITICAL}
    for i in (0, 1, 7, LANES - 1, LANES, size - 1):
        alone = run(part(body, i), omega[i], eps[i], **options)
        assert same(alone.omega, together.omega[:, i])
        assert same(alone.final, together.final[i])
        assert alone.status == together.status[i]


@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize("method", METHODS)
def test_order_of_the_batch(rng, method, save_every):
    body, omega, eps = mixed_batch(rng, 2 * LANES + 5)
    shuffled = rng.permutation(len(omega))
    options = {"method": method, "save_every": save_every}
    first = run(body, omega, eps, **options)
    second = run(part(body, shuffled), omega[shuffled], eps[shuffled], **options)
    assert same(first.omega[:, shuffled], second.omega)
    assert same(first.status[shuffled], second.status)


@pytest.mark.compiled
@pytest.mark.parametrize("save_every", [1, None])
@pytest.mark.parametrize("method", METHODS)
def test_number_of_threads(rng, monkeypatch, method, save_every):
    monkeypatch.setattr(threads, "CROSSOVER", 0)
    body, omega, eps = mixed_batch(rng, 5 * LANES + 3)
    options = {"method": method, "save_every": save_every}
    counts = [None, *range(1, numba.config.NUMBA_NUM_THREADS + 1)]
    results = [run(body, omega, eps, threads=threads, **options) for threads in counts]
    for result in results[1:]:
        assert same(result.omega, results[0].omega)
        assert same(result.status, results[0].status)


@pytest.mark.parametrize("method", METHODS)
def test_large_states_alone_or_beside_others(rng, method):
    """A state that need not be guarded alone is, where its neighbours must be."""
    unit = sf.Suslov3D(1, 1, 1, 0)
    omega = rng.uniform(-1, 1, (64, 2)) * 10 ** rng.uniform(0, 6, (64, 1))
    omega[:, 1] = rng.uniform(-1, 2, 64)
    wild = np.array([[0.3, -5.0]])
    beside = run(unit, np.concatenate([omega, wild]), 1.0, 4, method=method)
    for i, state in enumerate(omega):
        alone = run(unit, state, 1.0, 4, method=method)
        assert same(alone.omega, beside.omega[:, i])
        assert alone.status == beside.status[i]


@pytest.mark.parametrize("steps", [700, 701])  # the last state is saved, or not
@pytest.mark.parametrize("attitude", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_parts(rng, request, method, attitude, steps):
    """A run that is cut into parts, to look for Ctrl-C, goes on as if it were not."""
    body, omega, eps = mixed_batch(rng, 70)
    options = {"method": method, "attitude": attitude}
    whole = run(body, omega, eps, steps, save_every=7, **options)
    last = run(body, omega, eps, steps, save_every=None, **options)
    request.getfixturevalue("small_parts")
    parts = []
    cut = run(
        body,
        omega,
        eps,
        steps,
        save_every=7,
        progress=lambda *seen: parts.append(seen),
        **options,
    )
    if method != "auto":
        assert len(parts) > 3
    assert parts[-1] == (steps, steps)
    assert same(whole.omega, cut.omega)
    assert same(whole.final, cut.final)
    assert same(whole.status, cut.status)
    assert not attitude or same(whole.attitude, cut.attitude)
    assert same(last.final, run(body, omega, eps, steps, save_every=None, **options).final)


@given(st.integers(1, 10**6), st.integers(1, 10**6), st.sampled_from([8, 64, 128]))
def test_parts_are_alike(size, most, lanes):
    """As few as can be, but for whole lanes, and none of them much shorter than others."""
    length = problem.alike(size, most, lanes)
    count = -(-size // length)
    assert length % lanes == 0
    assert length < most + lanes
    assert count <= -(-size // most)
    assert size - (count - 1) * length > length - count * lanes


@pytest.mark.parametrize("attitude", [False, True])
@pytest.mark.parametrize("save_every", [1, 4, None])
@pytest.mark.parametrize("method", METHODS)
def test_a_run_that_is_gone_on_with(rng, method, save_every, attitude):
    """30 steps are 15 and 15, or 1, 0, 28 and 1: the states, where they end, and how."""
    body, omega, eps = mixed_batch(rng, 70)
    omega[3] = np.nan
    options = {"method": method, "save_every": save_every, "attitude": attitude}
    for steps, cuts in ((30, (15, 15)), (30, (1, 0, 28, 1)), (300, (20, 280)), (300, (256, 44))):
        whole = run(body, omega, eps, steps, **options)
        gone_on = run(body, omega, eps, cuts[0], **options)
        for more in cuts[1:]:
            gone_on = gone_on.extend(more, on_singular="ignore")
        for name in ("omega", "n", "final", "status", "failed_at", "attitude"):
            expected, got = getattr(whole, name), getattr(gone_on, name)
            assert (expected is None and got is None) or same(expected, got), name


@pytest.mark.parametrize("save_every", [1, 4, None])
def test_the_orientation_is_that_of_every_step(body, rng, save_every):
    """Whatever is saved, it is the one that `attitude` finds along all states."""
    omega = rng.normal(size=(5, 2))
    start = sf.attitude(body, run(body, omega, 0.1, 3).omega, 0.1)[-1]
    states = run(body, omega, 0.3, 40, method="canonical").omega
    for given_start in (True, start):
        turns = run(
            body, omega, 0.3, 40, method="canonical", save_every=save_every, attitude=given_start
        )
        R0 = None if given_start is True else start
        expected = sf.attitude(body, states, 0.3, R0)
        assert turns.attitude.shape == (len(turns.n), 5, 3, 3)
        np.testing.assert_allclose(turns.attitude, expected[turns.n], rtol=0, atol=1e-15)


@pytest.mark.parametrize("method", ["canonical", "ds2"])
def test_save_every(rng, method):
    body, omega, eps = mixed_batch(rng, 20)
    every = run(body, omega, eps, 300, method=method)
    assert same(every.omega[-1], every.final)
    for k in (2, 7, 64, 300, 1000):
        some = run(body, omega, eps, 300, method=method, save_every=k)
        assert (some.n == np.arange(0, 301, k)).all()
        assert same(some.omega, every.omega[::k])
        assert same(some.final, every.final)
    last = run(body, omega, eps, 300, method=method, save_every=None)
    assert (last.n == [300]).all()
    assert same(last.omega, every.omega[-1:])


def test_auto_agrees_with_canonical(body, rng):
    omega = rng.uniform(-5, 5, (300, 2))
    for steps in (1, 2, 255, 256, 257, 1000):
        auto = run(body, omega, 0.2, steps, save_every=None).final
        canonical = run(body, omega, 0.2, steps, save_every=None, method="canonical").final
        scale = np.hypot(*canonical.T)[:, None]
        assert (abs(auto - canonical) / scale).max() < 5e-14


@pytest.mark.parametrize("batch", [(), (3,), (2, 3), (2, 1, 3), (0,), (2, 0)])
def test_shapes(rng, batch):
    body = sf.Suslov3D(rng.uniform(1, 2, batch), 1.5, 0.3, -0.2)
    omega = rng.normal(size=(*batch, 2))
    expected = run(body, omega, 0.3, 33, save_every=2)
    assert expected.omega.shape == (17, *batch, 2)
    assert expected.omega.flags.c_contiguous
    assert expected.final.shape == (*batch, 2)
    assert expected.status.shape == expected.failed_at.shape == batch
    out = np.full((17, *batch, 2), 7.0)
    other = run(body, omega, 0.3, 33, save_every=2, out=out)
    assert other.omega is out
    assert same(expected.omega, out)
    assert same(expected.final, other.final)


def test_out_for_the_last_state(body, rng):
    omega = rng.normal(size=(6, 2))
    last = np.empty((1, 6, 2))
    result = run(body, omega, 0.2, 10, out=last, save_every=None)
    assert result.omega is last
    assert same(last[0], result.final)


def test_out_may_overlap_the_input(body, rng):
    buffer = rng.normal(size=(4, 5, 2))
    eps, omega = buffer[1, :, 0], buffer[0]
    expected = run(body, omega.copy(), eps.copy(), 3)
    result = run(body, omega, eps, 3, out=buffer)
    assert same(result.omega, expected.omega)
    assert same(result.eps, expected.eps)
    flat = rng.normal(size=12)
    expected = run(body, flat[:2].copy(), flat[2:4].copy(), 2)
    assert same(run(body, flat[:2], flat[2:4], 2, out=flat.reshape(3, 2, 2)).omega, expected.omega)


def test_a_run_keeps_what_it_began_with(body):
    """Whoever writes to the input afterwards does not change what a run goes on from."""
    omega = np.array([[1.0, 0.5], [0.3, 0.2]])
    whole = run(body, omega, 0.2, 60, save_every=None)
    half = run(body, omega, 0.2, 10, save_every=None)
    omega[:] = 7.0
    assert same(half.extend(50).final, whole.final)


def test_any_layout_of_the_input(body, rng):
    omega = rng.normal(size=(6, 2))
    expected = run(body, omega, 0.2, 5)
    read_only = omega.copy()
    read_only.flags.writeable = False
    inputs = [
        omega.tolist(),
        np.asfortranarray(omega),
        np.repeat(omega, 2, axis=0)[::2],
        read_only,
        omega.astype(">f8"),
        omega.astype(object),
        np.ma.masked_array(omega),
    ]
    compiled = len(getattr(loops.canonical.serial, "signatures", ()))
    for given_input in inputs:
        assert same(run(body, given_input, 0.2, 5).omega, expected.omega)
    assert len(getattr(loops.canonical.serial, "signatures", ())) == compiled
    assert sf.step(body, [1, 2], 1).dtype == np.float64
    single = run(body, omega.astype(np.float32), np.float32(0.25), 5)
    assert single.omega.dtype == np.float64


def test_broadcasting(rng):
    body = sf.Suslov3D(rng.uniform(1, 2, (3, 1)), 1.5, 0.3, [-0.2, 0.1])
    eps = np.array([0.1, 0.2, -0.1, 0.05]).reshape(4, 1, 1)
    omega = rng.normal(size=(2, 2))
    result = run(body, omega, eps, 10)
    assert result.omega.shape == (11, 4, 3, 2, 2)
    assert result.time.shape == (11, 4, 1, 1)
    for i, j, k in np.ndindex(4, 3, 2):
        one = sf.Suslov3D(body.I1[j, 0], 1.5, 0.3, body.I23[k])
        alone = run(one, omega[k], eps[i, 0, 0], 10)
        assert same(alone.omega, result.omega[:, i, j, k])


@pytest.mark.parametrize("axes", [1, 29, 31, 32, 33, 64])
def test_batches_of_many_axes(body, axes):
    """What NumPy cannot hold is said to be too much before anything is computed."""
    most = 29 if np.lib.NumpyVersion(np.__version__) < "2.0.0" else 32
    try:
        eps = np.full((1,) * axes, 0.2)
    except ValueError:
        pytest.skip("this NumPy has no such array")
    options = {"attitude": True, "method": "canonical"}
    if axes > most:
        with pytest.raises(ValueError, match=r"axes|maximum supported dimension"):
            run(body, [1.0, 0.5], eps, 3, **options)
    else:
        result = run(body, [1.0, 0.5], eps, 3, **options)
        assert result.omega.shape == (4, *eps.shape, 2)
        assert result.attitude.shape == (4, *eps.shape, 3, 3)
        assert same(result.omega.reshape(4, 2), run(body, [1.0, 0.5], 0.2, 3, **options).omega)


def test_no_steps(body):
    result = run(body, [[1, 2], [3, 4]], 0.2, 0)
    assert (result.omega == [[[1, 2], [3, 4]]]).all()
    assert (result.final == [[1, 2], [3, 4]]).all()
    assert (run(body, [1, 2], 0.2, 0, save_every=None).omega == [[1, 2]]).all()


def test_times_and_description(body):
    result = run(body, [1, 2], 0.25, 10, save_every=5)
    assert (result.time == [0, 1.25, 2.5]).all()
    assert result.eps == 0.25
    assert result.body is body
    assert repr(result) == (
        "Trajectories(omega: (3, 2), n: 0, 5 ... 10, eps: 0.25, failed: 0 of 1)"
    )
    assert "n: 10, eps: -1 ... 1" in repr(run(body, [1, 2], [-1, 1], 10, save_every=None))
    assert "eps: none" in repr(run(body, np.empty((0, 2)), np.empty(0), 10))


@given(st.integers(1, 300), st.integers(0, 70), st.integers(1, 20))
def test_any_batch_size_number_of_steps_and_saving(size, steps, save_every):
    rng = np.random.default_rng(size)
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    omega = rng.normal(size=(size, 2))
    result = run(body, omega, 0.2, steps, save_every=save_every)
    assert result.omega.shape == (steps // save_every + 1, size, 2)
    assert np.isfinite(result.omega).all()
    i = size - 1
    assert same(result.omega[:, i], run(body, omega[i], 0.2, steps, save_every=save_every).omega)


@pytest.mark.parametrize("steps", [1, 255, 257])
def test_a_whole_block_whose_states_are_all_saved(body, rng, steps):
    omega = rng.uniform(-1, 1, (LANES, 2))
    saved = run(body, omega, 0.2, steps, method="canonical").omega
    assert same(saved[:, :3], run(body, omega[:3], 0.2, steps, method="canonical").omega)
    last = run(body, omega, 0.2, steps, method="canonical", save_every=None).final
    assert same(saved[-1], last)


def test_blocks_without_any_orbit_that_needs_no_care(unit, rng):
    """Vectors of orbits that all start next to the repelling half or beyond it."""
    omega = np.column_stack([rng.uniform(-0.1, 0.1, 16), rng.uniform(-2.5, -1.2, 16)])
    together = run(unit, omega, 1.0, 20, method="canonical")
    for i in range(16):
        alone = run(unit, omega[i], 1.0, 20, method="canonical")
        assert same(together.omega[:, i], alone.omega)


@pytest.mark.parametrize("method", ["canonical", "ds2"])
@pytest.mark.parametrize("attitude", [False, True])
def test_whole_blocks_by_every_method(body, rng, method, attitude):
    """Next to orbits that need no care, what a trajectory is asked for is what it gets."""
    omega, options = rng.uniform(-1, 1, (LANES, 2)), {"method": method, "attitude": attitude}
    together = run(body, omega, 0.2, 5, **options)
    for i in (0, LANES - 1):
        alone = run(body, omega[i], 0.2, 5, **options)
        assert same(together.omega[:, i], alone.omega)
        assert same(together.final[i], alone.final)
        if attitude:
            assert same(together.attitude[:, i], alone.attitude)


@pytest.mark.parametrize("shift", range(8))
@pytest.mark.parametrize("batch", [0, 1, 7, LANES - 3, LANES, LANES + 8, 3 * LANES + 5])
def test_memory_of_saved_states(body, rng, monkeypatch, batch, shift):
    """Wherever `out` begins and however its rows lie to the cache lines, all is written."""
    monkeypatch.setattr(tiles, "_LARGE", 0)  # for kernels that are not compiled
    omega = rng.uniform(-2, 2, (batch, 2))
    steps = 10
    options = {"save_every": None, "method": "canonical"}
    last = [sf.iterate(body, omega, 0.2, n, **options).final for n in range(steps + 1)]
    expected = np.stack(last)
    memory = np.full(batch * (steps + 1) * 2 + 16, 7.0)
    out = memory[shift : shift + memory.size - 16].reshape((steps + 1, batch, 2))
    sf.iterate(body, omega, 0.2, steps, out=out, method="canonical")
    assert (out == expected).all()
    assert (memory[:shift] == 7).all()
    assert (memory[shift + out.size :] == 7).all()


@pytest.mark.compiled
@pytest.mark.parametrize("batch", [1023, 1024])
def test_saved_states_beyond_the_caches(body, rng, batch):
    omega = rng.uniform(-2, 2, (batch, 2))
    steps = tiles._LARGE // 2 // batch + 9
    states = sf.iterate(body, omega, 0.2, steps, method="canonical").omega
    some = slice(5, 12)
    few = sf.iterate(body, omega[some], 0.2, steps, method="canonical").omega
    assert few.size < tiles._LARGE
    assert same(states[:, some], few)
