"""Components that lose digits and grow again: the trajectory is computed again, with digits."""

import warnings

import numpy as np
import pytest
from children import TWO_THREADS
from scipy.integrate import solve_ivp
from systems import field, oregonator, robertson, van_der_pol

import suslov_fast as sf
from suslov_fast.core.flow import batch_solver


def solved(f, x0, time, **options):
    """Return the last state, and the texts of warnings."""
    times = np.linspace(time, 0.0, options.pop("asked", 1), endpoint=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = sf.flow(f, x0, time=times[::-1], **options)
    return np.asarray(motion.states[-1]), [str(each.message) for each in caught]


def in_logarithms(f, x0, time):
    """Return the last state by LSODA, for the logarithms of positive components."""

    def rates(t, u):
        x = np.exp(np.maximum(u, -700.0))  # below it rates of logarithms stay as they are
        return np.divide(f(x), x)

    options = {"method": "LSODA", "rtol": 1e-9, "atol": 1e-9}
    return np.exp(solve_ivp(rates, (0.0, time), np.log(x0), **options).y[:, -1])


def sir(s, b=1800, birth=0.02, removal=100):
    new = b * s[0] * s[1]
    return birth * (1 - s[0]) - new, new - (removal + birth) * s[1]


def seir(s):
    infected = 1250 * s[0] * s[2]
    return 0.02 * (1 - s[0]) - infected, infected - 45.62 * s[1], 45.6 * s[1] - 73.02 * s[2]


def laser(s):
    return 0.01 * (2 - s[0]) - s[0] * s[1], 300 * s[1] * (s[0] - 1) + 1e-12


def prey(s):
    return s[0] * (1 - s[0] / 10 - s[1] / (1 + s[0])), 30 * s[1] * (s[0] / (1 + s[0]) - 0.6)


CASES = {
    "SIR": (sir, "S I", [0.99, 0.01], 40.0, [0.055639783, 1.9533e-4]),
    "SEIR": (seir, "S E I", [0.9, 1e-3, 1e-3], 40.0, [0.0583832, 3.6597e-4, 2.2866e-4]),
    "laser": (laser, "n I", [0.1, 1e-3], 300.0, [0.99969606, 0.00388995]),
    "prey": (prey, "x y", [5.0, 2.0], 60.0, [0.0402015667, 1.82944e-9]),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"rtol": 1e-12},
        *({"atol": a} for a in (0, 1e-12)),
        {"stiff": True},
        {"stiff": False},
        {"asked": 41},
    ],
)
def test_growth_is_right(name, options):
    """Right values by LSODA in logarithms; the laser's noise is below an atol of 1e-12."""
    f, names, x0, time, right = CASES[name]
    found, texts = solved(field(f, names), x0, time, **options)
    np.testing.assert_allclose(found, right, rtol=1e-3, atol=1e-9)
    assert not texts


def foxes(a):
    return lambda s: (s[0] * (1 - s[1]), a * s[1] * (s[0] - 1))


def seasons(s):
    food = np.where(np.mod(s[2], 1) < 0.5, 1.1, 0.9)
    return s[0] * (1 - s[1]) * food, s[1] * (s[0] - 1), 1.0


@pytest.mark.parametrize(
    ("f", "x0", "rtol"),
    [
        (foxes(3), [5.0, 1.0], 1e-6),
        (foxes(30.095), [1.9435, 1.4353], 1e-7),
        (foxes(1), [20.0, 20.0], 1e-9),
        (seasons, [20.0, 20.0, 0.0], 1e-9),
    ],
)
def test_foxes_that_fall_near_their_allowed_error_have_digits(f, x0, rtol):
    """The first ones fall to 33 and 65 allowed errors, the second ones in a single step."""
    system = field(f, len(x0))
    found, right = (solved(system, x0, 40.0, rtol=rtol, **k)[0] for k in ({}, {"atol": 0}))
    np.testing.assert_allclose(found, right, rtol=1e-3)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_what_others_feed_is_not_computed_again(rtol):
    """Components of relaxation oscillations and of Robertson's reaction, which begins at 0."""
    cycle = field(van_der_pol, "x v", mu=1000)
    reaction = field(robertson, "a b c")
    assert sf.flow(reaction, [1.0, 0.0, 0.0], time=1e9, rtol=rtol).steps < 180
    starts = np.array([2.0, 0.0]) + np.random.default_rng(3).uniform(-0.2, 0.2, (64, 2))
    motion = sf.flow(cycle, starts, time=2000.0, rtol=rtol)
    assert np.count_nonzero(motion._again) <= 3
    assert ("computed again" in repr(motion)) == motion._again.any()


def test_decay_and_rotation_below_allowed_errors_take_long_steps():
    """Modes with the rates -10 + 100 i and -1e4 decay for good beside a slow one."""
    f = field(
        lambda y: (-10 * y[0] + 100 * y[1], -100 * y[0] - 10 * y[1], -1e4 * y[2], -0.1 * y[3]),
        "a b c d",
    )
    motion = sf.flow(f, [1.0, 1.0, 1.0, 1.0], time=100.0, stiff=True)
    np.testing.assert_allclose(motion.states[-1, 3], np.exp(-10.0), rtol=1e-4)
    assert motion.steps < 400


@pytest.mark.parametrize("count", [8, pytest.param(30, marks=pytest.mark.slow)])
def test_random_epidemics_are_right(count):
    rng, told = np.random.default_rng(7), 0
    for _ in range(count):
        birth, removal = 10 ** rng.uniform(-2.5, -1), 10 ** rng.uniform(1, 2.3)
        values = {"b": rng.uniform(2, 40) * (removal + birth), "birth": birth, "removal": removal}
        x0, time = [rng.uniform(0.5, 0.99), 10 ** rng.uniform(-5, -2)], rng.uniform(20, 60)
        right = in_logarithms(lambda s, values=values: sir(s, **values), x0, time)
        found, texts = solved(field(sir, "S I", **values), x0, time)
        assert texts or np.allclose(found, right, rtol=1e-3, atol=1e-9)
        told += bool(texts)
    assert told <= count // 10  # of those that fall below 1e-300


@pytest.mark.parametrize("count", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_random_lasers_go_on(count):
    """Light grows from noise that is below its allowed error."""

    def light(s, pump, level, gain, noise):
        return pump * (level - s[0]) - s[0] * s[1], gain * s[1] * (s[0] - 1) + noise

    rng = np.random.default_rng(3)
    for _ in range(count):
        pump, gain, noise = 10 ** rng.uniform([-3, 1, -16], [-1, 4, -6])
        values = {"pump": pump, "level": rng.uniform(1.2, 4.0), "gain": gain, "noise": noise}
        x0 = [rng.uniform(0.05, 1.5), 10 ** rng.uniform(-6, -1)]
        time = rng.uniform(1, 4) / pump
        right = in_logarithms(lambda s, values=values: light(s, **values), x0, time)
        for options in ({}, {"atol": 1e-12}, {"atol": 1e-9}, {"stiff": True}):
            found, texts = solved(field(light, "n I", **values), x0, time, **options)
            assert not texts
            np.testing.assert_allclose(found[0], right[0], rtol=0.02)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
@pytest.mark.parametrize("stiff", [None, True])
def test_the_oregonator(rtol, stiff):
    """Against its published state at 360, and states at 320 and 322 with rtol 1e-12, atol 0."""
    f = field(oregonator, "a b c")
    motion = sf.flow(f, [1.0, 2.0, 3.0], time=[320.0, 322.0, 360.0], rtol=rtol, stiff=stiff)
    right = [4.9478139, 8.9176361, 1.000814870318523]
    np.testing.assert_allclose(motion.states[:, 0], right, rtol=1e-4)


EPIDEMIC = field(sir, "S I", b=[1800.0, 150.0, 1500.0])


def same_as_with_atol_0(found, right):
    np.testing.assert_allclose(found.states, right.states, rtol=1e-5, atol=1e-12)
    assert found._again[[0, 2]].all()
    assert f"computed again: {found._again.sum()} of 3" in repr(found)


def test_events_of_the_first_try_are_dropped():
    """Vaccinations, and crossings of a surface; trajectory 1 is calm."""
    events = [
        sf.Event(times=[10.0, 20.0], to=lambda s: (0.9 * s[0], s[1])),
        sf.Event(lambda s: s[1] - 0.01, direction="up"),
    ]
    times = np.linspace(0.0, 40.0, 21)
    found, right = (
        sf.flow(EPIDEMIC, [0.99, 0.01], time=times, events=events, atol=a) for a in (None, 0)
    )
    same_as_with_atol_0(found, right)
    for k in range(3):
        own, other = (m.events.time[m.events.trajectory == k] for m in (found, right))
        np.testing.assert_allclose(own, other, rtol=1e-5)
        alone = sf.flow(EPIDEMIC[k], [0.99, 0.01], time=times, events=events)
        np.testing.assert_array_equal(alone.states, found.states[:, k])
        np.testing.assert_array_equal(alone.events.time, own)


def test_derivatives_threads_and_large_batches():
    x0 = np.tile([0.99, 0.01], (100, 3, 1))
    x0[..., 1] *= np.linspace(0.9, 1.1, 100)[:, np.newaxis]
    options = {"time": [20.0, 40.0], "derivatives": ("x0", "b")}
    found = sf.flow(EPIDEMIC, x0, **options, threads=TWO_THREADS)
    few, right = (sf.flow(EPIDEMIC, x0[7], **options, atol=a) for a in (None, 0))
    np.testing.assert_array_equal(found.states[:, 7], few.states)
    same_as_with_atol_0(few, right)
    for name in ("x0", "b"):
        np.testing.assert_array_equal(found.derivatives[name][:, 7], few.derivatives[name])
        own, other = (m.derivatives[name] for m in (few, right))
        np.testing.assert_allclose(own, other, rtol=1e-4, atol=1e-9 * abs(other).max())


def test_exponents_of_epidemics():
    a, b = (
        sf.lyapunov_exponents(EPIDEMIC, [0.99, 0.01], time=60.0, transient=5.0, rtol=rtol)
        for rtol in (1e-6, 1e-10)
    )
    np.testing.assert_allclose(a, b, atol=1e-4)
    alone = sf.lyapunov_exponents(EPIDEMIC[2], [0.99, 0.01], time=60.0, transient=5.0, rtol=1e-6)
    np.testing.assert_array_equal(alone, a[2])


RESET = field(lambda s, k, d: (k * s[0] * (1 - s[0]) + 0.0 * d,), "x", k=1.0, d=1.0)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("count", [20, pytest.param(300, marks=pytest.mark.slow)])
def test_growth_after_a_reset_is_right(rtol, count):
    """An event multiplies a component by 1e-3 to 1e-30; explicit steps are long at once."""
    rng = np.random.default_rng(5)
    times, factor = rng.uniform(1, 8, count), 10.0 ** -rng.uniform(3, 30, count)
    k, x0, right = rng.uniform([0.5, 0.05, 0.01], [5, 2, 0.99], (count, 3)).T
    begins = factor / (1 + (1 / x0 - 1) * np.exp(-k * times))  # of x' = k x (1 - x)
    ends = times + np.log(right / (1 - right) * (1 / begins - 1)) / k
    for n in range(count):
        event = sf.Event(times=[times[n]], to=lambda s, d: (d * s[0],))
        own = RESET.with_parameters(k=k[n], d=factor[n])
        found, texts = solved(own, [x0[n]], ends[n], rtol=rtol, events=event)
        np.testing.assert_allclose(found, right[n], rtol=max(1e-3, 100 * rtol))
        assert not texts


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_growth_after_a_rate_has_turned_is_right(rtol):
    f, rng = field(lambda s: (s[1] * s[0], 0.0, 1.0), "y r t"), np.random.default_rng(5)
    for _ in range(15):
        rate, turn = rng.uniform(5, 30), rng.uniform(1, 4)
        grows, final = rate * rng.uniform(0.5, 2), rng.uniform(max(1e-6, 1e3 * rtol), 1.0)
        event = sf.Event(lambda s, at=turn: s[2] - at, to=lambda s, k=grows: (s[0], k, s[2]))
        time = turn + (np.log(final) + rate * turn) / grows
        found, _ = solved(f, [1.0, -rate, 0.0], time, rtol=rtol, events=event)
        np.testing.assert_allclose(found[0], final, rtol=max(1e-3, 100 * rtol))


def test_groups_that_grow_with_few_ratios_of_their_components():
    """Both exposed and infected grow if E / I is between 5.4 and 9.6."""

    def slow(s):
        new = 305.83 * s[0] * s[2]
        left = 0.0217 * (1 - s[0]) - new
        return left, new - 14.925 * s[1], 14.903 * s[1] - 80.586 * s[2]

    f, times = field(slow, "S E I"), np.linspace(0.7, 27.3, 39)
    found, right = (
        sf.flow(f, [0.738, 1.09e-3, 2.07e-4], time=times, rtol=rtol).states for rtol in (1e-4, 1e-9)
    )
    np.testing.assert_allclose(found, right, rtol=0.01, atol=1e-4)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
def test_groups_that_feed_one_another(rtol):
    """Measles with a seasonal rate, against DOP853 and Radau in logarithms."""

    def measles(s):
        new = 1800 * (1 + 0.28 * np.cos(2 * np.pi * s[3])) * s[0] * s[2]
        born = 0.02 * (1 - s[0])
        return born - new, new - 45.62 * s[1], 45.6 * s[1] - 73.02 * s[2], 1.0

    found, texts = solved(field(measles, "S E I t"), [0.05, 1e-4, 1e-4, 0.0], 20.0, rtol=rtol)
    np.testing.assert_allclose(found[1], 2.585855e-7, rtol=1e-4)
    assert not texts


def test_only_components_that_grow_have_relative_digits():
    """A decay beside them takes no steps, and one that passes 0 does not end the solution."""
    alone = field(sir, "S I")
    both = field(lambda s: (*sir(s), -50 * s[2], s[4], -s[3]), "S I a p q")
    few = sf.flow(alone, [0.99, 0.01], time=40.0)
    many = sf.flow(both, [0.99, 0.01, 1.0, 1.0, 0.0], time=40.0)
    assert few._again == many._again == 1
    np.testing.assert_allclose(many.states[:, :2], few.states, rtol=1e-5)
    np.testing.assert_allclose(many.states[-1, 3], np.cos(40.0), rtol=1e-6)
    assert many.steps < 1.5 * few.steps


def test_a_second_try_that_ends_is_no_answer(monkeypatch):
    """Relative digits would take too many steps; the first try has all but the small component."""
    monkeypatch.setattr(batch_solver, "MOST_TRIES", 20_000)

    def shaken(s):
        y, t, p, q = s
        return y * (20 * np.tanh(t - 3) + 1e7 * np.sin(1e9 * t) / (1 + (y * 1e14) ** 2)), 1.0, q, -p

    with pytest.warns(UserWarning, match="1 of 1"):
        motion = sf.flow(field(shaken, "y t p q"), [1.0, 0.0, 1.0, 0.0], time=5.5, rtol=1e-6)
    assert motion.ok
    assert motion._again
    np.testing.assert_allclose(motion.states[-1, 2], np.cos(5.5), rtol=1e-4)


@pytest.mark.filterwarnings("ignore:.* solutions end")
@pytest.mark.parametrize("rtol", [1e-4, 1e-6])
def test_relaxation_oscillations_jump_at_the_right_time(rtol):
    """Tyson's oscillator: small components decide when it jumps. It may end at its pole."""
    least, most = [-2.3, -0.2, -3.5], [-1.5, 0.3, -2.5]
    e, w, q = 10 ** np.random.default_rng(8).uniform(least, most, (40, 3)).T

    def tyson(s, e, w, q):
        x, z = s
        return (x * (1 - x) - w * z * (x - q) / (x + q)) / e, x - z

    cycle = field(tyson, "x z", e=e, w=w, q=q)
    times = np.linspace(0.5, 20.0, 40)
    found, right = (
        sf.flow(cycle, [0.2, 0.1], time=times, rtol=r, atol=a).states
        for r, a in ((rtol, None), (1e-11, 0))
    )
    allowed = max(1e-3, 100 * rtol) * abs(right) + 100 * rtol * abs(right).max(axis=0)
    is_right = (abs(found - right) <= allowed).all(axis=(0, 2))
    assert np.count_nonzero(~is_right) <= 2


def test_with_atol_0_ends_are_told_how_to_go_on():
    """f is noise near an event at V = 0, where V / (exp(V) - 1) is 0/0; expm1 has all digits."""
    starts = np.column_stack([np.linspace(-3.3, -2.7, 40), np.ones(40)])
    options = {"time": 8.0, "rtol": 1e-9, "atol": 0, "events": sf.Event(lambda s: s[0])}

    def channel(minus_1):
        return field(
            lambda s: (1.0 + 0.3 * s[1] * s[0] / minus_1(s[0]), -s[1] + np.cos(3 * s[0])), "V w"
        )

    with pytest.warns(sf.IntegrationWarning, match=r"write exp\(x\) - 1 as np.expm1\(x\)"):
        sf.flow(channel(lambda v: np.exp(v) - 1), starts, **options)
    motion = sf.flow(channel(np.expm1), starts, **options)
    right = sf.flow(channel(np.expm1), starts, time=8.0, rtol=1e-12)
    assert motion.ok.all()
    assert len(motion.events.time) == 40
    np.testing.assert_allclose(motion.states, right.states, rtol=1e-7)


@pytest.mark.parametrize("B", [1, 100])
def test_solutions_below_the_normal_numbers_are_told_though_none_ends(B):
    """exp(357 (cos(t) - 1)) falls to 1e-310, which has few digits, and should return to 1."""
    dip = field(lambda s: (-357 * np.sin(s[1]) * s[0], 1.0), "x t")
    with pytest.warns(UserWarning, match=f"{B} of {B} .*1e-300"):
        motion = sf.flow(dip, np.tile([1.0, 0.0], (B, 1)), time=2 * np.pi, atol=0)
    assert motion.ok.all()
    assert (abs(motion.final[:, 0] - 1) > 1).all()


def test_populations_at_loose_tolerances():
    """Their floor of 1e-6 keeps x + y - log(x y); with rtol its error is three times as large."""
    prey = field(lambda s: (s[0] - s[0] * s[1], s[0] * s[1] - s[1]), "u v")
    starts = np.repeat(np.linspace(3.0, 9.0, 40), 2).reshape(40, 2)
    motion = sf.flow(prey, starts, time=100.0, rtol=1e-4)
    conserved = (motion.final - np.log(motion.final)).sum(axis=1)
    np.testing.assert_allclose(conserved, (starts - np.log(starts)).sum(axis=1), rtol=6e-4)


# ------------------------------------------------------------------------- small, read by events
@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("level", [0.5, 1.0, 2.0, 5.0])
def test_events_that_compare_small_components(level, stiff):
    """z / x = exp(-0.1 t) is exp(-level) at 10 level, where both are below their allowed errors."""
    decay = sf.Field(lambda s: (-s[0], -1.1 * s[1]), "x z")
    for surface in (lambda s: s[1] / s[0] - np.exp(-level), lambda s: s[1] - np.exp(-level) * s[0]):
        end = sf.flow(
            decay, [1.0, 1.0], time=60.0, events=sf.Event(surface, terminal=True), stiff=stiff
        )
        assert abs(end.end / (10 * level) - 1) < 1e-8


@pytest.mark.parametrize("stiff", [None, True])
def test_an_event_of_the_logarithm_of_a_small_component(stiff):
    """x falls to exp(-80), then rises for 78."""
    turn = sf.Event(lambda s: np.log(s[0]) + 80, direction="down", to=lambda s: (s[0], 1.0))
    field = sf.Field(lambda s: (s[1] * s[0], 0.0), "x k")
    motion = sf.flow(field, [1.0, -1.0], time=158.0, events=turn, stiff=stiff)
    np.testing.assert_allclose(motion.events.time, [80.0])
    np.testing.assert_allclose(motion.final, [np.exp(-2.0), 1.0])


def test_crossings_of_an_oscillation_that_decays():
    """To exp(-30); the times are known. Levels far above what decays need no digits of it."""
    field, w = sf.Field(lambda s: (s[1], -s[0] - 0.2 * s[1]), "x v"), np.sqrt(0.99)
    found = sf.crossings(field, [1.0, 0.0], "x", time=300.0)
    right = (np.pi - np.arctan2(w, 0.1) + np.pi * np.arange(95)) / w
    np.testing.assert_allclose(found.time, right, atol=1e-8)
    assert "again" not in repr(sf.flow(field, [1.0, 0.0], time=300.0, events=sf.Event("x - 0.01")))
    fall = sf.Field(lambda s: -s, "x")
    assert "again" not in repr(sf.flow(fall, [1.0], time=500.0, events=sf.Event("x - 0.5")))


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 4e-10, 1e-10, 3e-11, 1e-11, 1e-12])
def test_the_oregonator_at_close_tolerances(rtol):
    """It jumps when components have decayed to 1e-3 of their largest values. Values of CWI."""
    right = [1.000814870318523, 1228.178521549917, 132.0554942846706]
    f, x0, times = field(oregonator, "a b c"), [1.0, 2.0, 3.0], np.linspace(3.0, 360.0, 120)
    motion = sf.flow(f, x0, time=360.0, rtol=rtol)
    np.testing.assert_allclose(motion.final, right, rtol=200 * rtol + 1e-13)
    states = sf.flow(f, x0, time=times, rtol=1e-13, atol=0).states
    found = sf.flow(f, x0, time=times, rtol=rtol).states
    np.testing.assert_allclose(found, states, rtol=200 * rtol)
