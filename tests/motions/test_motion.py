"""`flow`: the motion at given times, and its result, `Motion`."""

import inspect
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields

import mpmath
import numpy as np
import pytest
from samples import SQUARE
from scipy.integrate import solve_ivp
from scipy.special import exp1
from systems import FLOWS, FRICTION, HENON_HEILES, LORENZ, by_taylor

import suslov_fast as sf
from suslov_fast import Event, Field, IntegrationWarning, Status, flow
from suslov_fast.core.flow import batch_solver

SQUARES = Field(lambda z: (z[0] ** 2 - z[1] ** 2, 2 * z[0] * z[1]), 2)  # z' = z**2
PENDULUM = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")


def at(field, x, time, **options):
    """The states at a time, of all trajectories."""
    return flow(field, x, time=time, **options).states[0]


# ---------------------------------------------------------------------------------------- accuracy
@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", FLOWS)
def test_motions_beside_taylor_series(name):
    f, field, start, time = FLOWS[name]
    end = np.array(by_taylor(f, start, time), float)
    largest = abs(end).max()
    tolerances = np.array([1e-4, 1e-6, 1e-9, 1e-12])
    errors = [abs(at(field, start, time, rtol=rtol) - end).max() / largest for rtol in tolerances]
    assert (errors < (3e3 if name == "Lorenz" else 20) * tolerances).all(), errors
    assert errors[3] < errors[2] < errors[1] < errors[0]
    back = at(field, end, -time, rtol=1e-12)
    assert abs(back - start).max() < (1e-5 if name == "Lorenz" else 1e-10)


def test_a_pendulum_in_elliptic_functions():
    """sin(q / 2) = k sn(K - t) from rest at q0, k = sin(q0 / 2)."""
    times, q0 = [0.5, 3.0, 20.0], 2.5
    with mpmath.workdps(30):
        m = mpmath.sin(mpmath.mpf(q0) / 2) ** 2
        sn = [mpmath.ellipfun("sn", mpmath.ellipk(m) - t, m=m) for t in times]
        wanted = [float(2 * mpmath.asin(mpmath.sqrt(m) * each)) for each in sn]
    for rtol in (1e-6, 1e-9, 1e-12):
        motion = flow(PENDULUM, [q0, 0.0], time=times, rtol=rtol)
        assert abs(motion.states[:, 0] - wanted).max() < 100 * rtol
        assert abs(motion.energy() - np.cos(q0 - np.pi)).max() < 30 * rtol


def test_exact_solutions_of_bodies(rng):
    start, times = rng.normal(size=(40, 2)), [20.0, 3.0]
    for body in (sf.Suslov3D(4, 1, -0.5, -0.3), sf.Suslov3D(2, 1, -0.5, -0.3, 0.1)):
        exact = flow(body, start, time=times)
        found = flow(body.field(), start, time=times)
        assert abs(found.states - exact.states).max() < 1e-8
        assert not exact.steps.any()
        assert found.steps.all()


def test_bodies_without_a_closed_form_go_member_by_member():
    bodies = sf.SuslovND(J=[[1.0, 2, 3], [1, 1, 1]], I=[0.1, 0.2, 0.3])
    whole = flow(bodies, [1.0, 1, 1], time=[0.5, 2.0])
    assert (whole.steps > 0).tolist() == [True, False]
    for k in range(2):
        own = flow(bodies[k], [1.0, 1, 1], time=[0.5, 2.0])
        assert (own.states == whole.states[:, k]).all()
    by_field = flow(bodies.field(), [1.0, 1, 1], time=[0.5, 2.0])
    assert abs(by_field.states - whole.states).max() < 1e-8


def test_small_components_have_digits_with_atol():
    """y' = -y beside 1: 1e-12 of the largest has no digits by default."""
    field = Field(lambda x: (-1e-3 * x[0], 1e-14 * x[0] - 50 * x[1]), 2)
    exact = 1e-14 * np.exp(-1e-2) / (50 - 1e-3)
    small = at(field, [1.0, 0.0], 10.0, rtol=1e-8, atol=0.0)[1]
    assert small == pytest.approx(exact, rel=1e-6)
    assert flow(field, [1.0, 0.0], time=10.0, atol=[1e-3, 0.0]).atol == (1e-3, 0.0)


@pytest.mark.parametrize("rtol", [1e-4, 1e-9, 1e-12])
def test_populations_stay_positive(rtol):
    """They fall to 1e-27 and below 1e-200; one below 0 would end at -1e80."""
    field = Field(lambda x: (x[0] * (1 - x[1] / 2), x[1] * (x[0] / 2 - 1)), 2)
    times = np.linspace(0, 300, 61)
    starts = [[100.0, 50.0], [2.0, 1e-250], [-100.0, 50.0]]
    found = flow(field, starts, time=times, rtol=rtol).states
    assert (found[:, :2] > 0).all()
    assert (found[:, 2] * [-1, 1] >= 0).all()  # one of them below the least number
    [exact] = np.exp(
        solve_ivp(
            lambda t, u: (1 - np.exp(u[1]) / 2, np.exp(u[0]) / 2 - 1),
            (0, 5), np.log([100.0, 50.0]), "DOP853", [5.0], rtol=1e-12, atol=1e-12,
        ).y.T
    )  # fmt: skip
    assert abs(found[1, 0] - exact).max() < 100 * rtol


# -------------------------------------------------------------------------- clocks, jumps, max_step
def test_max_step_finds_pulses():
    """A pulse of 0.01 in a time of 100; its area is 1."""
    pulse = Field(
        lambda s: (1.0, np.exp(-((1e3 * (s[0] - 61.7)) ** 2)) * 1e3 / np.sqrt(np.pi)), "t y"
    )
    motion = flow(pulse, [0.0, 0.0], time=100.0, max_step=1e-3)
    assert motion.states[-1, 1] == pytest.approx(1.0, abs=1e-7)
    assert motion.max_step == 1e-3
    assert motion.steps >= 1e5


# ------------------------------------------------------------------------------------------- times
def test_times_in_any_order(rng):
    x = rng.normal(size=(2, 3, 4)) / 8
    times = [3.0, 1.0, 0.0, 3.0, 0.5, 2.0, 1.0]
    found = flow(HENON_HEILES, x, time=times)
    assert found.states.shape == (7, 2, 3, 4)
    assert (found.time == times).all()
    assert (found.states[0] == found.states[3]).all()
    assert (found.states[1] == found.states[6]).all()
    assert (found.states[2] == x).all()
    ascending = flow(HENON_HEILES, x, time=np.sort(times))
    assert (ascending.states == found.states[np.argsort(times, kind="stable")]).all()
    for time, states in zip(times, found.states, strict=True):
        assert abs(at(HENON_HEILES, x, time) - states).max() < 1e-8
    back = flow(HENON_HEILES, x, time=[-2.0, 0.0, -1.0])
    assert (back.states[1] == x).all()
    assert abs(at(HENON_HEILES, back.states[0], 2.0) - x).max() < 1e-8


def test_many_times_do_not_shorten_steps(rng):
    x, times = rng.normal(size=4) / 8, np.sort(rng.uniform(0, 20, 1001))
    few = flow(HENON_HEILES, x, time=times[-1])
    many = flow(HENON_HEILES, x, time=times)
    assert many.steps == few.steps
    exact = flow(HENON_HEILES, x, time=times, rtol=1e-13)
    assert abs(many.states - exact.states).max() < 1e-7


def test_interpolated_states_are_tested_at_any_choice_of_times():
    def f(x):
        pulse = np.exp(-((19 * (x[2] - 2.2)) ** 2))
        return x[1] + pulse, -19 * np.sin(x[0]) / (1 + x[1] ** 2), 1

    def states(times, rtol):
        kicks = Event(times=starts, to=lambda x: (x[0], x[1] + 0.1, x[2]))
        return flow(Field(f, "x y t"), [1, 0.3, 0], time=times, rtol=rtol, events=kicks).states

    starts, times = np.arange(0.5, 3.0, 0.5), np.linspace(0.0, 4.0, 200)
    few = states(times, 1e-8)
    assert abs(few - states(times, 1e-13)).max() < 2e-8  # 15e-8 without the test
    # Times just after steps begin need none, but must not switch it off for others in the step.
    more = np.sort(np.concatenate([times, starts + 1e-12]))
    np.testing.assert_array_equal(states(more, 1e-8)[np.searchsorted(more, times)], few)


@pytest.mark.parametrize("after", [[1], [1, 30], [30]])
def test_times_within_rounding_after_the_start_of_a_step(after):
    field = Field(lambda x: (x[1] * x[2], -np.sin(3 * x[0]) * x[2] / (1 + x[1] ** 2), 0), "x y on")
    options = {"rtol": 1e-2, "events": Event(times=[1e7], to=lambda x: (x[0], x[1], 1.0))}
    later = 1e7 + 0.04 * np.arange(1, 60)
    few = flow(field, [1, 0.3, 0], time=later, **options)
    times = np.concatenate([1e7 + np.spacing(1e7) * np.array(after), later])
    more = flow(field, [1, 0.3, 0], time=times, **options)
    np.testing.assert_array_equal(more.states[len(after) :], few.states)
    assert few.status == Status.OK


def test_a_quarter_of_a_step_that_hits_a_missing_value():
    field = Field(lambda x, c: (np.sin(x[1] - c) / (x[1] - c), 1), "x t", c=0.25 / 96)
    times = [1e-12, 0.01, 0.0275, 0.055, 1.0]
    states = flow(field, [1, 0], time=times, max_step=0.25, rtol=1e-3, stiff=False).states
    assert abs(states[:, 0] - [1, 1.01, 1.027499, 1.054992, 1.946495]).max() < 1e-5


def test_empty_and_trivial_calls():
    events = [sf.Event("x1"), sf.Event(times=[0.5, 1.0])]
    never = flow(HENON_HEILES, [0.1, 0, 0, 0.2], time=[], events=events)
    assert (never.states.shape, never.events.count.tolist()) == ((0, 4), [0, 0])
    empty = flow(HENON_HEILES, np.empty((0, 4)), time=[1.0, 2.0], events=events)
    assert (empty.states.shape, empty.events.count.shape) == ((2, 0, 4), (0, 2))
    assert empty.ok.all()
    nobody = FRICTION.with_parameters(mu=[])
    assert flow(nobody, [1.0, 0.0], time=[1.0, 2.0]).states.shape == (2, 0, 2)
    none = sf.crossings(HENON_HEILES, np.empty((0, 4)), surface="x1", time=1.0, most=2)
    assert (none.states.shape, none.final.shape) == ((0, 4), (0, 4))
    assert (at(LORENZ, [0.0, 0.0, 0.0], 1e300) == 0.0).all()
    tripled = sf.Event(times=[0, 0], to=lambda x: (3 * x[0],))
    assert flow(SQUARE, [1.0], time=[0.0], events=tripled).states == 9.0
    nothing = flow(SQUARE, [[1.0], [np.nan]], time=[0.0])
    assert nothing.status.tolist() == [Status.OK, Status.NONFINITE]
    assert nothing.steps.tolist() == [0, 0]


# ------------------------------------------------------------------------------- ends and warnings
@pytest.mark.parametrize(
    ("field", "start", "end"),
    [
        (SQUARE, [1.0], 1.0),
        (SQUARES, [1.0, 0.0], 1.0),
        (Field(lambda x: (-(x[0] ** 2),), 1), [4.0], -0.25),
        (Field(np.exp, 1), [0.0], 1.0),
        # Where f has no value.
        (Field(lambda x: -1 / x, 1), [1.0], 0.5),
        (Field(lambda x: -np.sqrt(x) - 0.1, 1), [1.0], 2 - 0.2 * np.log(11)),
        (Field(lambda x: np.log(x) - 1, 1), [0.5], np.e * exp1(1 + np.log(2))),
    ],
)
def test_solutions_that_end(field, start, end):
    times = np.array([0.5, 0.99, 1.01, 2.0]) * end
    with pytest.warns(IntegrationWarning) as record:
        found = flow(field, start, time=times)
    assert len(record) == 1
    assert found.end == pytest.approx(end, abs=1e-6)
    assert (found.status, found.ok) == (Status.ENDED, False)
    assert np.isfinite(found.states[:2]).all()
    assert np.isnan(found.states[2:]).all()


def test_one_warning_names_the_first():
    start = np.array([[-1.0], [0.5], [1.0], [np.nan], [0.1]])
    with pytest.warns(IntegrationWarning, match=r"2 of 5 solutions end.* 1 at t = 2$") as record:
        found = flow(SQUARE, start, time=[3.0, 0.0])
    assert len(record) == 1
    statuses = [Status.OK, Status.ENDED, Status.ENDED, Status.NONFINITE, Status.OK]
    assert found.status.tolist() == statuses
    assert np.isnan(found.states[0, :, 0]).tolist() == [False, True, True, True, False]
    assert found.end.tolist() == pytest.approx([3.0, 2.0, 1.0, 0.0, 3.0])
    with pytest.warns(IntegrationWarning, match="1 of 1"):
        none = flow(LORENZ, [1e200, 1e200, 1.0], time=1.0)
    assert (none.status, none.end) == (Status.NONFINITE, 0.0)
    assert np.isnan(none.states).all()


def test_times_that_look_like_values_of_a_clock():
    field = Field(lambda s: (-s[0] + np.cos(s[1]), 1.0), "x t")
    times = np.linspace(5.0, 10.0, 6)
    with pytest.warns(UserWarning, match="time - 5"):
        found = flow(field, [[1.0, 5.0], [2.0, 5.0]], time=times)
    np.testing.assert_allclose(found.states[:, 0, 1], times + 5.0, rtol=1e-14)
    flow(field, [5.0, 0.0], time=times)  # a state, not a clock: no warning
    flow(field, [1.0, 5.0], time=times - 5.0)


@pytest.mark.compiled
def test_solutions_that_need_ever_shorter_steps():
    """Backward in time Lorenz's y and z turn at the rate x, which grows like exp(-10 t)."""
    with pytest.warns(IntegrationWarning, match=r"1 of 2 .*250,000"):
        found = flow(LORENZ, [[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]], time=[-50.0, -1.0])
    assert found.status.tolist() == [Status.TOO_MANY_STEPS, Status.OK]
    assert -2.0 < found.end[0] < -1.0
    assert np.isnan(found.states[0, 0]).all()
    np.testing.assert_allclose(found.states[0, 1, 2], np.exp(8 / 3 * 50.0), rtol=1e-6)


# ---------------------------------------------------------------------------------------- progress
def test_progress(rng, monkeypatch):
    monkeypatch.setattr(batch_solver, "WORK_WITHOUT_PAUSE", 2**12)
    x, times, seen = rng.normal(size=(40, 4)) / 9, [0.0, 1.0, 1.0, 200.0], []
    found = flow(HENON_HEILES, x, time=times, progress=lambda *each: seen.append(each))
    assert len(seen) > 2
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    assert {total for _, total in seen} == {160}
    assert seen[-1] == (160, 160)  # though a time is asked twice
    assert found.ok.all()
    stopped = flow(HENON_HEILES, x, time=times, progress=lambda done, total: len(seen) < 0)
    assert (stopped.status == Status.TOO_MANY_STEPS).any()
    is_there = ~np.isnan(stopped.states)
    assert not is_there.all()
    assert (stopped.states[is_there] == found.states[is_there]).all()


# -------------------------------------------------------------------------------------- the result
def test_the_result_is_no_sequence():
    found = flow(PENDULUM, [[2.5, 0.0], [1.0, 0.0]], time=[0.0, 1.0, 2.0])
    assert (np.asarray(found) == found.states).all()
    assert found.names == ("q", "p")
    assert found.energy().shape == (3, 2)
    assert "energy" in dir(found)
    assert not {"omega", "extend"} & {*dir(found)}
    with pytest.raises(AttributeError, match=r"run\.states"):
        _ = found.omega
    for wrong in (lambda: [*found], lambda: found[1], lambda: found[:, 0], lambda: len(found)):
        with pytest.raises(TypeError, match=r"states|has no len"):
            wrong()
    body = sf.Suslov3D(4, 1, -0.5, -0.3)
    exact = flow(body, [1.0, 0.5], time=[0.0, 1.0, 2.0])
    assert abs(np.diff(exact.energy())).max() < 1e-14
    assert abs(np.diff(exact.first_integral())).max() < 1e-14


FORCED = Field(
    lambda t, y, k, c: (y[1], -k * y[0] - c * y[1] + np.cos(1.3 * t)),
    "x v",
    k=np.array([1.0, 2.0, 3.0]),
    c=0.1,
)
BOUNCES = [
    Event("x", direction="down", to=lambda x, k: (x[0], -0.8 * x[1] / k)),
    Event(times=[[1.0, 2.0], [3.0, 4.0], [5.0, np.nan]], to=lambda t, y: (y[0], y[1] + t)),
]
CALLS = {
    "events of a forced family": (FORCED, [1.0, 0.0], {"t0": 0.3, "events": BOUNCES}),
    "derivatives": (FORCED, [1.0, 0.0], {"t0": 0.0, "derivatives": "k x0", "stiff": True}),
    "tolerances": (FORCED, [1.0, 0.0], {"t0": 0.0, "rtol": 1e-5, "atol": [1e-9, 1e-8]}),
    "complex": (Field(lambda z: 1j * z, "z", complex=True), [[1 + 0j], [2j]], {"max_step": 0.1}),
    "body": (sf.Suslov3D(4, 2, -0.5, [-0.25, -0.1]), [1.0, 0.5], {}),
    "a motion that ends": (SQUARES, [[1.0, 0.0], [0.1, 0.2]], {}),
}


@pytest.mark.filterwarnings("ignore:times count", "ignore:.*escape")
@pytest.mark.parametrize("name", CALLS)
def test_the_solution_as_a_function(name, tmp_path):
    """Bits as if asked at once: of the motion, its copies, its file and its members."""
    system, x0, options = CALLS[name]
    motion = flow(system, x0, time=[0.5, 2.0], **options)
    times = [7.7, 0.0, 3.5]
    states = flow(system, x0, time=times, **options).states
    motion.save(tmp_path / "motion.npz")
    for each in (motion, sf.load(tmp_path / "motion.npz"), pickle.loads(pickle.dumps(motion))):
        np.testing.assert_array_equal(each(times), states)
    np.testing.assert_array_equal(motion(7.7), at(system, x0, 7.7, **options))
    np.testing.assert_array_equal(motion(0.0), motion.x0)
    np.testing.assert_array_equal(motion.member(1)(times), states[:, 1])
    assert np.all(motion.t0 == options.get("t0", 0.0))


def test_the_solution_on_both_sides_of_its_start():
    motion = flow(PENDULUM, [2.5, 0.0], time=3.0)
    both = motion([-1.0, 2.0, 1.0])
    np.testing.assert_array_equal(both[1:], motion([2.0, 1.0]))
    np.testing.assert_allclose(both[0], both[2] * [1.0, -1.0], rtol=1e-8)  # even and odd in t
    assert motion([]).shape == (0, 2)
    with pytest.raises(ValueError, match="1-D"):
        motion([[1.0]])
    with pytest.raises(ValueError, match="read-only"):
        both[0] = 0.0


# ------------------------------------------------------------------------------------- small calls
def test_a_parameter_that_changes_at_each_call():
    """Numbers of f that depend on parameters alone are those of the family, to the bit."""
    decay = Field(lambda x, a, b: (-np.exp(-a / b) * x[0],), 1, a=1.0, b=2.0)
    a = np.random.default_rng(5).uniform(0.5, 3.0, 600)  # more than NumPy computes
    each = [at(decay.with_parameters(a=value), [1.0], 1.5) for value in a]
    family = at(decay.with_parameters(a=a), [1.0], 1.5)
    np.testing.assert_array_equal(each, family)
    np.testing.assert_allclose(family[:, 0], np.exp(-1.5 * np.exp(-a / 2.0)), rtol=1e-8)


@pytest.mark.filterwarnings("ignore:times count", "ignore:.*escape")
@pytest.mark.parametrize("time", [2.0, [0.5, 2.0], [2.0, 0.0]])
@pytest.mark.parametrize("name", [*CALLS, "one orbit"])
def test_motions_are_read_only_and_have_arrays_of_their_own(name, time):
    system, x0, options = CALLS.get(name, (PENDULUM, [2.5, 0.0], {}))
    given = np.array(x0)
    motion = flow(system, given, time=time, **options)
    start, arrays = motion.x0.copy(), [a for a in vars(motion).values() if type(a) is np.ndarray]
    assert len(arrays) >= 8
    assert not any(array.flags.writeable for array in arrays)
    given[...] = 7.0  # the user's array stays the user's
    np.testing.assert_array_equal(motion.x0, start)


def test_small_calls_do_not_mix():
    """What one call keeps for the next is of its field, times, tolerance, shape and direction."""
    spring = Field(lambda x, k: (x[1], -k * x[0]), "x v", k=1.0)
    fields_of = {k: spring.with_parameters(k=k) for k in (1.0, 4.0)}
    calls = [
        (k, x0, time, rtol)
        for k in fields_of
        for x0 in ([1.0, 0.0], [[1.0, 0.0], [2.0, 0.0]], [[[3.0, 0.0]]])
        for time in (1.5, -1.5, 3.0, [0.5, 3.0])
        for rtol in (1e-6, 1e-11)
    ]

    def states(call):
        k, x0, time, rtol = call
        motion = flow(fields_of[k], x0, time=time, rtol=rtol)
        assert motion.rtol == rtol
        assert (motion.end == np.ravel(time)[-1]).all()
        times = np.reshape(time, (-1, *(1,) * np.ndim(x0)))
        wanted = np.cos(np.sqrt(k) * times) * x0
        np.testing.assert_allclose(motion.states[..., 0], wanted[..., 0], atol=1e3 * rtol)
        return motion.states

    order = np.random.default_rng(1).permutation(np.repeat(np.arange(len(calls)), 3))
    alone = [states(call) for call in calls]
    with ThreadPoolExecutor(4) as pool:
        for k, found in zip(order, pool.map(states, [calls[k] for k in order]), strict=True):
            np.testing.assert_array_equal(found, alone[k])


def test_a_surface_in_a_text_is_read_for_each_field():
    period = sf.crossings(Field(lambda x: (x[1], -x[0]), "x v"), [1.0, 0.0], "x", time=3.0)
    of_second = sf.crossings(Field(lambda x: (-4 * x[1], x[0]), "v x"), [0.0, 1.0], "x", time=3.0)
    np.testing.assert_allclose(period.time, [np.pi / 2], rtol=1e-8)
    np.testing.assert_allclose(of_second.time, [np.pi / 4, 3 * np.pi / 4], rtol=1e-8)
    with pytest.raises(ValueError, match="surface"):
        sf.crossings(Field(lambda x: (x[1], -x[0]), "q p"), [1.0, 0.0], "x", time=3.0)


def test_settings_and_columns_of_the_engine_are_everywhere():
    settings = [*batch_solver.Settings._fields]
    for function in (sf.flow, sf.crossings, sf.compiled.system):
        assert [k for k in inspect.signature(function).parameters if k in settings] == settings
    names = {each.name for each in fields(sf.Motion)}
    assert names >= {*settings, *batch_solver.COLUMNS}
