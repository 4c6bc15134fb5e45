"""Components that fall below their allowed errors and grow again: right, or warned of once."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from systems import field, oregonator, robertson

import suslov_fast as sf


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


def is_right_or_warned(f, names, x0, time, right, **options):
    found, texts = solved(field(f, names), x0, time, **options)
    is_right = np.allclose(found, right, rtol=1e-3, atol=1e-6)
    ends = options.get("stiff") is False and np.isnan(found).any()  # which is told of as well
    return is_right or (len(texts) == 1 + ends and "atol=0" in texts[-1])


def sir(s):
    return 0.02 * (1 - s[0]) - 1800 * s[0] * s[1], 1800 * s[0] * s[1] - 100.02 * s[1]


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
    [{}, {"rtol": 1e-12}, {"atol": 1e-12}, {"stiff": True}, {"stiff": False}, {"asked": 41}],
)
def test_growth_is_right_or_warned_of(name, options):
    """Right values by LSODA in logarithms; the laser's noise is below an atol of 1e-12."""
    assert is_right_or_warned(*CASES[name], **options)


def test_with_atol_0_growth_is_right():
    found, texts = solved(field(sir, "S I"), [0.99, 0.01], 40.0, atol=0)
    np.testing.assert_allclose(found, CASES["SIR"][-1], rtol=1e-3)
    assert not texts


def foxes(a):
    return lambda s: (s[0] * (1 - s[1]), a * s[1] * (s[0] - 1))


@pytest.mark.parametrize(
    ("a", "x0", "rtol"),
    [
        (3, [5.0, 1.0], 1e-6),
        (30, [1.5, 1.5], 1e-3),
        (1, [5.0, 1.0], 1e-4),
        (22.7, [1.39, 2.14], 1e-4),
        (30.095, [1.9435, 1.4353], 1e-7),
    ],
)
def test_foxes_that_fall_near_their_allowed_error_are_told_of(a, x0, rtol):
    """The foxes fall to 33, 3.5, 70, 170 and 65 allowed errors; the last ones in a single step."""
    assert len(solved(field(foxes(a), "x y"), x0, 40.0, rtol=rtol)[1]) == 1


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_what_others_feed_is_not_warned_of(rtol):
    """Components of relaxation oscillations and of Robertson's reaction, which begins at 0."""
    cycle = field(lambda s: (s[1], 1000 * (1 - s[0] ** 2) * s[1] - s[0]), "x v")
    reaction = field(robertson, "a b c")
    assert not solved(cycle, [2.0, 0.0], 2000.0, rtol=rtol)[1]
    assert not solved(reaction, [1.0, 0.0, 0.0], 1e9, rtol=rtol)[1]


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
def test_random_epidemics_are_right_or_warned_of(count):
    rng = np.random.default_rng(7)
    for _ in range(count):
        birth, removal = 10 ** rng.uniform(-2.5, -1), 10 ** rng.uniform(1, 2.3)
        rate = rng.uniform(2, 40) * (removal + birth)

        def epidemic(s, birth=birth, removal=removal, rate=rate):
            new = rate * s[0] * s[1]
            return birth * (1 - s[0]) - new, new - (removal + birth) * s[1]

        x0, time = [rng.uniform(0.5, 0.99), 10 ** rng.uniform(-5, -2)], rng.uniform(20, 60)
        right = in_logarithms(epidemic, x0, time)
        assert is_right_or_warned(epidemic, "S I", x0, time, right)


@pytest.mark.parametrize("count", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_random_lasers_go_on_or_are_warned_of(count):
    """Light grows from noise that is below its allowed error."""

    def light(s, pump, level, gain, noise):
        return pump * (level - s[0]) - s[0] * s[1], gain * s[1] * (s[0] - 1) + noise

    rng = np.random.default_rng(3)
    for _ in range(count):
        pump, gain, noise = 10 ** rng.uniform([-3, 1, -16], [-1, 4, -6])
        values = {"pump": pump, "level": rng.uniform(1.2, 4.0), "gain": gain, "noise": noise}
        x0 = [rng.uniform(0.05, 1.5), 10 ** rng.uniform(-6, -1)]
        time = rng.uniform(1, 4) / pump
        right = in_logarithms(lambda s, values=values: np.array(light(s, **values)), x0, time)
        for options in ({}, {"atol": 1e-12}, {"atol": 1e-9}, {"stiff": True}):
            found, texts = solved(field(light, "n I", **values), x0, time, **options)
            assert texts or np.allclose(found[0], right[0], rtol=0.02)


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("stiff", [None, True])
def test_the_oregonator_at_large_tolerances(rtol, stiff):
    """Against its published state at 360, of 1 beside peaks of 1e5: right, or warned of as well."""
    f = field(oregonator, "a b c")
    found, texts = solved(f, [1.0, 2.0, 3.0], 360.0, rtol=rtol, stiff=stiff)
    np.testing.assert_allclose(found[0], 1.000814870318523, rtol=1e-3)
    assert texts or np.allclose(
        found, [1.000814870318523, 1228.178521549917, 132.0554942846706], rtol=0.01
    )
