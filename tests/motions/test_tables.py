"""Tables of np.interp: steps end at their knots, which are jumps where neighbours are equal."""

from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from systems import field

import suslov_fast as sf


def steps(knots, values):
    """Return the table that is values[i] from knots[i] on."""
    return np.repeat(knots, 2)[1:], np.repeat(values, 2)[:-1]


def relaxed(x, k, begin, end, xp, fp):
    """Return x at the time `end` from x at `begin`, where x' = np.interp(t, xp, fp) - k x."""
    inside = xp[(xp > min(begin, end)) & (xp < max(begin, end))]
    for a, b in pairwise([begin, *inside[:: 1 if end > begin else -1], end]):
        if a == b:
            continue
        u, v = np.interp([0.75 * a + 0.25 * b, 0.25 * a + 0.75 * b], xp, fp)
        slope, lost = 2.0 * (v - u) / (b - a), -np.expm1(-k * (b - a))
        first = u - slope * (b - a) / 4.0  # of the line at a
        x = (1.0 - lost) * x + (first * lost + slope * (b - a - lost / k)) / k
    return x


def fed(xp, fp, **given):
    return field(lambda s, k: (np.interp(s[1], xp, fp) - k * s[0], 1.0), "x t", **given)


@pytest.mark.parametrize("count", [1, 12, 5000])
def test_zero_order_hold_of_random_tables(count, rng):
    knots, values = np.sort(rng.uniform(0.0, 100.0, count)), rng.normal(size=count)
    xp, fp = steps(knots, values)
    times = np.linspace(0.0, 110.0, 12)
    motion = sf.flow(fed(xp, fp, k=0.3), [1.0, 0.0], time=times, derivatives="k")
    right = np.array([relaxed(1.0, 0.3 + 1e-30j, 0.0, t, xp, fp) for t in times])
    np.testing.assert_allclose(motion["x"], right.real, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(motion.derivatives["k"][:, 0], right.imag / 1e-30, atol=1e-8)
    assert motion.steps < 1.05 * count + 80


@pytest.mark.parametrize("sign", [1, -1])
def test_lines_between_jumps_both_ways_in_time(sign, rng):
    for _ in range(8):
        xp = np.sort(np.concatenate([rng.uniform(-6.0, 6.0, 9), rng.integers(-5, 6, 12)]))
        fp = rng.normal(size=len(xp))
        begin = float(rng.choice(xp)) if rng.random() < 0.5 else 0.0
        # It begins on a jump, passes others, of two and three equal knots, and ends on one.
        motion = sf.flow(fed(xp, fp, k=0.7), [1.0, begin], time=sign * np.array([3.0, 4.5, 9.0]))
        right = [relaxed(1.0, 0.7, begin, begin + t, xp, fp) for t in motion.time]
        np.testing.assert_allclose(motion["x"], right, rtol=1e-8, atol=1e-9)


def test_values_are_those_of_numpy_on_both_sides_of_jumps(rng):
    for ends in ({}, {"left": -1.0, "right": 7.0}):
        xp = np.sort(np.concatenate([[-2.0, -2.0, 2.0, 2.0], rng.integers(-2, 3, 9)]))
        fp = rng.normal(size=len(xp))
        x = np.concatenate([rng.uniform(-3, 3, 99), xp, np.nextafter(xp, 9), np.nextafter(xp, -9)])
        system = field(lambda s, xp=xp, fp=fp, ends=ends: (np.interp(s[0], xp, fp, **ends),), "x")
        np.testing.assert_array_equal(system(x[:, np.newaxis])[:, 0], np.interp(x, xp, fp, **ends))
        assert sf.Field.from_dict(system.to_dict()) == system


def test_a_day_that_repeats_from_a_clock_of_dates(rng):
    hours, values = np.array([0.0, 6.5, 9.0, 17.0, 23.0]), rng.uniform(0.0, 2.0, 5)
    xp, fp = steps(hours, values)
    day = field(lambda s, k: (np.interp(np.mod(s[1], 24), xp, fp) - k * s[0], 1.0), "x t", k=0.2)
    days = np.arange(100)[:, np.newaxis]
    xp, fp = steps((24.0 * days + hours).ravel(), np.tile(values, len(days)))
    for begin in (0.0, 7.25, 1.7e9):  # a clock that starts far from 0
        begin_of_day = begin % 24.0
        motion = sf.flow(day, [1.0, begin], time=[100.0, 24.0 * 30.0])
        right = [relaxed(1.0, 0.2, begin_of_day, begin_of_day + t, xp, fp) for t in motion.time]
        np.testing.assert_allclose(motion["x"], right, rtol=1e-8)


@pytest.mark.parametrize("start", [0.0, 1.7e9])
def test_tables_that_bend_and_jump_each_after_its_own_delay(start):
    """With derivatives, jumps of tables are conditions before all kinks."""
    bends = [0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.5, 0.2]
    jumps = steps([-9.0, 0.5, 1.7], [1.0, 2.0, -1.0])

    def f(s, c):
        later = np.interp(s[1] - (start + 0.3), *jumps)
        return c * np.interp(s[1] - start, *bends) + later, 1.0

    motion = sf.flow(field(f, "x t", c=2.0), [0.0, start], time=3.0, derivatives="c")
    np.testing.assert_allclose(motion.final[0], 2.0 * 1.6 + (0.8 + 2.4 - 1.0), rtol=1e-6)
    np.testing.assert_allclose(motion.derivatives["c"][-1, 0], 1.6, rtol=1e-6)


@pytest.mark.parametrize("time", [4.0, -3.0])
def test_tables_with_steep_and_level_parts(time, rng):
    """One begins on a knot; ramps last 1e-9 or one rounding; a part is constant."""
    xp = np.array([-4.0, -2.5, -1.0, 0.0, 0.5, 1.0, 2.0, 3.0])
    xp = np.sort([*xp, 0.5 + 1e-9, -1.0 + 1e-9, *np.nextafter([2.0, -2.5], 9.0)])
    for _ in range(3):
        fp = rng.normal(size=len(xp))
        fp[-2:] = fp[-3]
        motion = sf.flow(fed(xp, fp, k=1.0), [1.0, 0.0], time=time, rtol=1e-12)
        right = relaxed(1.0, 1.0, 0.0, time, xp, fp)
        np.testing.assert_allclose(motion.final[0], right, rtol=1e-10, atol=1e-10)
        assert motion.steps < 200


@pytest.mark.parametrize(
    ("start", "is_told"), [(-9.0, True), (-7.0, False), (7.0, False), (8.0, True)]
)
def test_times_before_or_after_a_table_are_told_of(start, is_told):
    table = np.array([[0, 4, 8], [1, 3, 1]])
    words = "from 0 to 8, and t from"
    with pytest.warns(UserWarning, match=words) if is_told else nullcontext():
        motion = sf.flow(fed(*table, k=0.3), [0.0, start], time=[1.0, 8.0])
    right = [relaxed(0.0, 0.3, start, start + t, *table) for t in motion.time]
    np.testing.assert_allclose(motion["x"], right, rtol=1e-8)


@pytest.mark.parametrize("period", [0.0, np.inf, np.nan])
def test_periods_of_tables_are_finite_and_not_0(period):
    with pytest.raises(TypeError, match="the period of"):
        sf.Field(lambda x: [np.interp(x[0], [0, 1], [1, 2], period=period)], "x")
