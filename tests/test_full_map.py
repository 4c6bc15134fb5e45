"""Runs of the scheme (ds) before Omega3 is set to 0."""

import naive
import numba
import numpy as np
import pytest

import suslov_fast as sf
from suslov_fast._engine import problem
from suslov_fast._formulas import full_map
from suslov_fast._formulas.elementary import exponent

# With eps = 1 the map has no next state where y = 2 + x**2; here x = Omega1 and y = -Omega2.
UNIT = sf.Suslov3D(1, 1, 1, 0)
ON_A_POLE = [1.0, -3.0, 0.0]


def run(body, omega0, eps, steps, I3, **options):
    return sf.iterate_full(body, omega0, eps, steps, I3, on_singular="ignore", **options)


def mixed_batch(rng, size):
    body = sf.Suslov3D(*rng.uniform(0.5, 4, (2, size)), *rng.normal(size=(2, size)))
    return (
        body,
        rng.normal(size=(size, 3)),
        rng.choice([-0.2, 0.0, 0.1], size),
        rng.uniform(1, 4, size),
    )


def test_against_the_printed_scheme(rng):
    for _ in range(5):
        parameters = (*rng.uniform(0.5, 4, 2), *rng.normal(size=2))
        eps, I3, omega = rng.choice([-0.3, 0.3]), rng.uniform(0.5, 4), rng.normal(size=3)
        orbit = run(sf.Suslov3D(*parameters), omega, eps, 6, I3).omega
        state = omega
        for computed in orbit[1:]:
            state = naive.step_full(*parameters, eps, I3, state)
            assert naive.relative_error(computed, state) < 2e-13


def test_the_sign_of_the_third_component(body):
    orbit = run(body, [1.0, 0.5, 0.25], 0.1, 50, 3)
    assert (orbit.omega[::2, 2] == 0.25).all()
    assert (orbit.omega[1::2, 2] == -0.25).all()


def test_on_the_constraint_it_is_the_map(body, rng):
    omega = rng.normal(size=(6, 2))
    full = run(body, np.column_stack([omega, np.zeros(6)]), 0.2, 100, 3)
    np.testing.assert_allclose(
        full.omega[..., :2], sf.iterate(body, omega, 0.2, 100).omega, atol=1e-13
    )
    assert (full.omega[..., 2] == 0).all()


def test_no_limit_unless_the_third_component_vanishes(body):
    """The table of the docstring."""
    for eps, still, moving in (
        (0.1, 0.0750, -0.178),
        (0.01, 0.0806, -2.42),
        (0.001, 0.0812, -24.9),
    ):
        for third, expected in ((0.0, still), (0.1, moving)):
            orbit = run(body, [1.0, 0.5, third], eps, 1, 3)
            quotient = (orbit.final[0] - 1.0) / eps
            assert f"{quotient:.3g}" == f"{expected:.3g}"


def test_result(body, rng):
    omega0, eps = rng.normal(size=(4, 1, 3)), np.array([0.1, 0.2])
    orbits = run(body, omega0, eps, 10, [[3.0, 4.0]], save_every=3)
    assert orbits.omega.shape == (4, 4, 2, 3)
    assert orbits.n.tolist() == [0, 3, 6, 9]
    assert orbits.final.shape == (4, 2, 3)
    assert (orbits.status == sf.Status.OK).all()
    assert (orbits.failed_at == -1).all()
    assert (orbits.omega[0] == np.broadcast_to(omega0, (4, 2, 3))).all()
    state = orbits.omega[0]
    for n in range(1, 11):
        state = sf.step_full(body, state, eps, [[3.0, 4.0]])
        if n % 3 == 0:
            assert (orbits.omega[n // 3] == state).all()
    assert (orbits.final == state).all()
    last = run(body, omega0, eps, 10, [[3.0, 4.0]], save_every=None)
    assert last.n.tolist() == [10]
    assert (last.omega[0] == state).all()
    assert (last.final == state).all()


@pytest.mark.parametrize("steps", [0, 3])
@pytest.mark.parametrize("save_every", [1, 5, None])
def test_few_steps_and_empty_batches(body, steps, save_every):
    orbit = run(body, [1.0, 0.5, 0.1], 0.1, steps, 3, save_every=save_every)
    assert len(orbit.omega) == (1 if save_every in (5, None) else steps + 1)
    if steps == 0:
        assert orbit.final.tolist() == [1.0, 0.5, 0.1]
    empty = run(body, np.empty((2, 0, 3)), 0.1, steps, 3, save_every=save_every)
    assert empty.omega.shape == (len(orbit.omega), 2, 0, 3)


def test_out(body, rng):
    omega0 = rng.normal(size=(5, 3))
    out = np.full((11, 5, 3), np.nan)
    orbits = run(body, omega0, 0.1, 10, 3, out=out)
    assert orbits.omega is out
    assert (out == run(body, omega0, 0.1, 10, 3).omega).all()
    last = np.empty((1, 5, 3))
    assert run(body, omega0, 0.1, 10, 3, out=last, save_every=None).omega is last
    assert (last[0] == out[-1]).all()
    overlapping = np.empty((11, 5, 3))
    overlapping[3] = omega0
    assert (run(body, overlapping[3], 0.1, 10, 3, out=overlapping).omega == out).all()


def test_alone_or_in_a_batch(rng):
    body, omega0, eps, I3 = mixed_batch(rng, 300)
    orbits = run(body, omega0, eps, 40, I3)
    for i in (0, 127, 128, 299):
        one = sf.Suslov3D(*(each[i] for each in body.parameters))
        alone = run(one, omega0[i], eps[i], 40, I3[i])
        assert np.array_equal(alone.omega, orbits.omega[:, i], equal_nan=True)
        assert alone.status == orbits.status[i]
        assert alone.failed_at == orbits.failed_at[i]


def test_a_run_that_is_gone_on_with(rng):
    body, omega0, eps, I3 = mixed_batch(rng, 20)
    whole = run(body, omega0, eps, 60, I3, save_every=7)
    gone_on = run(body, omega0, eps, 33, I3, save_every=7).extend(27, on_singular="ignore")
    for name in ("omega", "final", "status", "failed_at"):
        assert np.array_equal(getattr(gone_on, name), getattr(whole, name), equal_nan=True)


@pytest.mark.parametrize("threads", [1, pytest.param(2, marks=pytest.mark.compiled)])
@pytest.mark.parametrize("save_every", [1, 7, None])
def test_parts_and_threads(rng, threads, save_every, monkeypatch, request):
    body, omega0, eps, I3 = mixed_batch(rng, 300)
    omega0[::50] = np.nan
    expected = run(body, omega0, eps, 60, I3, save_every=save_every)
    request.getfixturevalue("small_parts")
    monkeypatch.setattr("suslov_fast._engine.threads.CROSSOVER", 0)
    done = []
    cut = run(
        body,
        omega0,
        eps,
        60,
        I3,
        save_every=save_every,
        threads=threads,
        progress=lambda now, total: done.append((now, total)),
    )
    assert len(done) > 1
    assert done[-1] == (60, 60)
    for name in ("omega", "final", "status", "failed_at"):
        assert np.array_equal(getattr(cut, name), getattr(expected, name), equal_nan=True)


def test_failures(rng):
    starts = [[0.3, 0.1, 0.2], ON_A_POLE, [np.nan, 1.0, 0.0], [1e200, 1e200, 1e200]]
    with pytest.warns(sf.SingularStepWarning, match="1 of 4 trajectories: singular step"):
        orbits = sf.iterate_full(UNIT, starts, [1.0, 1.0, 1.0, 1e200], 5, 3.0)
    status = sf.Status
    assert orbits.status.tolist() == [
        status.OK,
        status.SINGULAR,
        status.NONFINITE,
        status.NONFINITE,
    ]
    assert orbits.failed_at.tolist() == [-1, 1, 0, 1]
    assert np.isfinite(orbits.omega[:, 0]).all()
    assert orbits.omega[0, 1].tolist() == ON_A_POLE
    for i, first in ((1, 1), (2, 0), (3, 1)):
        assert np.isnan(orbits.omega[max(first, 1) :, i]).all()
    assert np.isnan(orbits.final[1:]).all()
    with pytest.raises(sf.SingularStepError) as caught:
        sf.iterate_full(UNIT, ON_A_POLE, 1.0, 5, 3.0, on_singular="raise")
    assert caught.value.trajectories.failed_at == 1


@pytest.mark.parametrize("cut", [False, True])
def test_failure_after_several_steps(monkeypatch, request, cut):
    """In the middle of a part or at its end."""
    if cut:
        request.getfixturevalue("small_parts")
        monkeypatch.setattr(problem, "_PART", 1)
    before_a_pole = run(UNIT, [1.0, -3.0, 0.0], -1.0, 4, 3.0).final
    orbit = run(UNIT, before_a_pole, 1.0, 9, 3.0)
    assert orbit.status == sf.Status.SINGULAR
    assert orbit.failed_at == 5
    huge = run(UNIT, [1e-3, 1.0, 1e150], 1e150, 9, 3.0)
    assert huge.status == sf.Status.NONFINITE
    for each in (orbit, huge):
        assert np.isnan(each.omega[each.failed_at :]).all()
        assert np.isfinite(each.omega[: each.failed_at]).all()


@pytest.mark.parametrize(
    ("parameters", "pole"), [((1, 1, 1, 0), [1.0, -8.0, 1.0]), ((1, 1, 0, 1), [8.0, 1.0, 1.0])]
)
def test_poles_where_the_third_component_counts(parameters, pole):
    """With eps = 1 and I3 = 3 the determinant of the two equations is 0 without rounding."""
    body = sf.Suslov3D(*parameters)
    orbit = run(body, [[0.1, 0.2, 0.3], pole], 1.0, 3, 3.0)
    assert orbit.status.tolist() == [sf.Status.OK, sf.Status.SINGULAR]
    assert orbit.failed_at.tolist() == [-1, 1]
    assert (orbit.omega[0, 1] == pole).all()
    assert np.isnan(orbit.omega[1:, 1]).all()


def test_nan_states_are_no_failure_of_a_step(body):
    states = sf.step_full(body, [[np.nan, 1.0, 0.0], [1.0, 0.5, 0.1]], 0.2, 3)
    assert np.isnan(states[0]).all()
    assert np.isfinite(states[1]).all()


@pytest.mark.parametrize("k", [-600, 600])
def test_units(body, k):
    omega0 = np.array([1.0, 0.5, 0.1])
    expected = run(body, omega0, 0.2, 30, 3).omega
    faster = run(body, np.ldexp(omega0, k), np.ldexp(0.2, -k), 30, 3).omega
    assert (faster == np.ldexp(expected, k)).all()
    heavier = sf.Suslov3D(*(np.ldexp(each, k) for each in body.parameters))
    assert (run(heavier, omega0, 0.2, 30, np.ldexp(3.0, k)).omega == expected).all()


@numba.njit(error_model="numpy")
def formula_step(I1, I2, I13, I23, eps, I3, omega):
    """A step by the formulas alone, of a state in its own unit."""
    W = exponent(np.abs(omega).max())
    k = full_map.full_coefficients(I1, I2, I13, I23, eps, I3, W)
    state = omega * 2.0**-W
    next1, next2, next3 = full_map.full_step(k, state[0], state[1], state[2])
    return np.array([next1, next2, next3]) * 2.0**W


@pytest.mark.parametrize("decades", [0, 60, 100, 140])
def test_the_formulas_in_any_units(rng, decades):
    """Whatever is finite is found, of steps far too long for any motion too."""
    with naive.mp.workdps(900):
        for _ in range(100):
            parameters = rng.uniform(0.5, 4, 6) * 10.0 ** rng.uniform(-decades, decades)
            parameters[2:5] *= rng.choice([-1, 1], 3)
            parameters[4] *= 10.0 ** rng.uniform(-decades, decades)
            omega = rng.normal(size=3) * 10.0 ** rng.uniform(-decades, decades)
            exact = naive.step_full(*parameters, omega)
            assert naive.relative_error(formula_step(*parameters, omega), exact) < 1e-12


@pytest.mark.parametrize("k", [-1000, -332, 332, 900])
def test_the_formulas_scale_exactly(rng, k):
    for _ in range(20):
        (*body, I3), omega = rng.uniform(0.5, 4, 5), rng.normal(size=3)
        expected = formula_step(*body, 0.3, I3, omega)
        faster = formula_step(*body, np.ldexp(0.3, -k), I3, np.ldexp(omega, k))
        assert (faster == np.ldexp(expected, k)).all()
        heavier = formula_step(*np.ldexp(body, k), 0.3, np.ldexp(I3, k), omega)
        assert (heavier == expected).all()


def test_poles_to_rounding(rng):
    """Next to a pole of a large state the determinant is rounding of its terms, and no number."""
    found = 0
    for _ in range(300):
        (I1, I2, I3), (I13, I23) = rng.uniform(0.5, 4, 3), rng.uniform(0.5, 2, 2)
        w2, w3 = -(10 ** rng.uniform(2, 5)), rng.normal()

        def determinant(w1, body=(I1, I2, I13, I23, 1.0, I3), rest=(w2, w3)):
            state = [w1, *naive.exactly(*rest)]
            body = naive.exactly(*body)
            zero = naive.ds(*body, state, naive.exactly(0, 0, -state[2]))
            columns = []
            for unit in ((1, 0), (0, 1)):
                one = naive.ds(*body, state, [*naive.exactly(*unit), -state[2]])
                columns.append([one[i] - zero[i] for i in (0, 1)])
            return columns[0][0] * columns[1][1] - columns[0][1] * columns[1][0]

        values = [determinant(naive.mpf(x)) for x in (-1, 0, 1)]  # of a quadratic polynomial
        a, b = (values[0] + values[2]) / 2 - values[1], (values[2] - values[0]) / 2
        root = b * b - 4 * a * values[1]
        if root < 0 or a == 0:
            continue
        found += 1
        w1 = float((-b + naive.mpmath.sqrt(root)) / (2 * a))
        assert np.isnan(formula_step(I1, I2, I13, I23, 1.0, I3, np.array([w1, w2, w3]))).all()
    assert found > 50


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"omega0": [1.0, 2.0]}, r"omega0: expected shape \(..., 3\), got \(2,\)"),
        ({"omega0": [1.0, 2.0, np.inf]}, "omega0: expected finite real numbers, got inf"),
        ({"eps": np.nan}, "eps: expected finite real numbers, got nan"),
        ({"I3": 0.0}, "I3: expected a positive moment of inertia, got 0.0"),
        ({"I3": [1.0, 2.0], "eps": [1.0] * 3}, "broadcast"),
        ({"steps": -1}, "steps: expected an integer of at least 0, got -1"),
        ({"save_every": 0}, "save_every: expected None or an integer of at least 1, got 0"),
        ({"on_singular": "no"}, "on_singular: expected one of"),
        ({"threads": 0}, "threads: expected"),
        ({"out": np.empty((3, 3))}, r"out: expected shape \(5, 3\), got \(3, 3\)"),
        ({"out": np.empty((5, 3), order="F")}, "out: expected a C-contiguous array"),
    ],
)
def test_bad_input(body, change, message):
    arguments = {"omega0": [1.0, 0.5, 0.1], "eps": 0.1, "steps": 4, "I3": 3.0} | change
    with pytest.raises(ValueError, match=message):
        sf.iterate_full(body, **arguments)
    with pytest.raises(TypeError, match="body: expected Suslov3D"):
        sf.iterate_full(sf.SuslovND([1, 2], [1, 2]), [1.0, 0.5, 0.1], 0.1, 4, 3.0)


@pytest.mark.parametrize("suffix", [".npz", ".nc", ".zarr"])
def test_files_of_runs(suffix, tmp_path, body):
    whole = sf.iterate_full(body, [[1.0, 0.5, 0.1], [0.2, -0.7, 0.0]], 0.2, 20, 3)
    sf.iterate_full(body, [[1.0, 0.5, 0.1], [0.2, -0.7, 0.0]], 0.2, 12, 3).save(
        tmp_path / f"run{suffix}"
    )
    loaded = sf.Trajectories.load(tmp_path / f"run{suffix}")
    assert loaded.body.I3 == 3
    assert (loaded.extend(8).omega == whole.omega).all()
    with pytest.raises(
        TypeError, match="energy: expected a map that has it, got a run of suslov3d_full"
    ):
        loaded.energy()
