"""Functions as users of SciPy write them: f(t, y), arrays that f fills, `if`, `math`, tables."""

import math
import pickle
from math import sin

import numpy as np
import pytest
from numpy import zeros
from scipy.interpolate import BSpline, CubicSpline, interp1d, make_interp_spline

from suslov_fast import Event, Field, flow


def test_time_is_hidden():
    forced = Field(lambda t, y: (y[1], np.cos(t) - y[0]), "x v")
    same = Field(lambda y, time: (y[1], np.cos(time) - y[0]), "x v")
    assert forced == same == pickle.loads(pickle.dumps(forced)) == Field.from_dict(forced.to_dict())
    assert hash(forced) == hash(same)
    assert forced != Field(lambda s: (s[1], np.cos(s[2]) - s[0], 1.0), "x v t")
    assert (forced.names, forced.dimension) == (("x", "v"), 2)
    assert str(forced) == "Field(x' = v, v' = cos(t) - x)"
    assert (forced.to_dict()["time"], forced.to_dict()["names"]) == ("t", ["x", "v", "t"])
    np.testing.assert_allclose(forced([1.0, 2.0], t=[0.0, 3.0]), [[2, 0], [2, np.cos(3) - 1]])
    assert forced.jacobian([1.0, 2.0]).tolist() == [[0, 1], [-1, 0]]
    free = Field(lambda t, y, k: (y[1], -k * y[0]), "x v", k=2.0)
    assert (free.names, free([1.0, 2.0]).tolist()) == (("x", "v"), [2, -2])


def test_what_is_refused_of_time():
    with pytest.raises(ValueError, match="names: 't' is the time, which f takes"):
        Field(lambda t, y: (y[1], -y[0]), "x t")
    with pytest.raises(TypeError, match="t0 must be left out: f of this system takes no time"):
        flow(lambda y: (-y[0],), [1.0], time=1.0, t0=0.0)
    with pytest.raises(ValueError, match="x0 must have the shape"):
        flow(Field(lambda t, y: (t - y[0],), 1), [2.0, 0.0], time=1.0)
    with pytest.raises(TypeError, match="takes no time, which this function reads"):
        flow(lambda s: (-s[0], 1.0), [1.0, 0.0], time=1.0, events=Event(lambda t, y: t - 1))
    with pytest.raises(TypeError, match="not one of"):
        Field(lambda x, t=300.0: -x * t, "x")


def test_the_start_is_at_time_0_or_t0():
    field = Field(lambda t, y: (t - y[0],), 1)
    hand = Field(lambda s: (s[1] - s[0], 1.0), "x1 t")
    for t0 in (None, 0.0, 1.5):
        expected = flow(hand, [2.0, t0 or 0.0], time=3.0).states[:, :1]
        for x0 in ([2.0], 2.0, {"x1": 2.0}):
            np.testing.assert_array_equal(flow(field, x0, time=3.0, t0=t0).states, expected)
    with pytest.warns(UserWarning, match="times count from x0, where t is 0: .* pass t0=5"):
        flow(field, [2.0], time=[5.0, 6.0])


def test_events_take_time_and_state():
    def falls(t, y):
        return [y[1], -9.81]

    ground = Event(lambda t, y: y[0], direction=-1, to=lambda t, y: (y[0], -y[1]))
    run = flow(falls, [10.0, 0.0], time=2.0, events=ground)
    assert run.events.time[0] == pytest.approx(math.sqrt(20 / 9.81), rel=1e-9)
    late = flow(falls, [10.0, 0.0], time=2.0, t0=4.0, events=Event(lambda t, y: t - 5.5))
    assert late.events.time == pytest.approx([1.5])


def test_f_fills_arrays_branches_and_calls_math():
    def f(t, y):
        d = zeros(2)
        d[0] = max(y[1], 0.5)
        if t < 1 or not y[0] > 0:
            d[1] = -sin(y[0])
        elif t <= 2:
            d[1] = math.exp(-t)
        return d

    field, states = Field(f, 2), np.random.default_rng(0).normal(size=(40, 3)) * 2
    expected = [f(s[2], s[:2]) for s in states]
    np.testing.assert_allclose(field(states[:, :2], t=states[:, 2]), expected, rtol=1e-14)
    assert zeros is np.zeros
    assert math.sin is sin
    assert "max" not in globals()


def test_schedules_of_many_times_are_few_paths():
    def f(t, y):
        for k in range(40):
            if k <= t < k + 1:
                return [k % 3 - y[0]]
        return [-y[0]]

    field = Field(f, 1)
    for t in (-1.0, 0.5, 17.5, 39.5, 41.0):
        assert field([2.0], t=t)[0] == f(t, [2.0])[0]


def test_errors_that_f_catches_do_not_become_formulas():
    def f(s):
        try:
            u = 1.0 if s[1] > 1 else 0.0
        except TypeError:
            u = 7.0
        return u - s[0], 1.0

    assert flow(Field(f, "y t"), [0, 0], time=3.0).states[0, 0] == pytest.approx(1 - np.exp(-2))

    def g(s):
        try:
            return [1.0, 2.0][int(s[0])]
        except TypeError:
            return 7.0

    with pytest.raises(TypeError, match="catches an error"):
        Field(g, 1)


def test_loops_on_the_state_are_an_error():
    def f(y):
        while y[0] > 1:
            y = y / 2
        return y

    with pytest.raises(TypeError, match="f: asks whether"):
        Field(f, 1)


X, Y = np.linspace(0, 10, 9), np.sin(np.linspace(0, 10, 9))


@pytest.mark.parametrize(
    "table",
    [
        interp1d(X, Y, fill_value="extrapolate"),
        interp1d(X, Y, "cubic", bounds_error=False, fill_value=(3.0, 4.0)),
        interp1d(X, Y, "previous", fill_value="extrapolate"),
        interp1d(X, Y, "nearest", bounds_error=False),
        CubicSpline(X, Y),
        CubicSpline(X, np.stack([Y, Y**2], 1)),
        BSpline(*make_interp_spline(X, Y, k=5).tck),
    ],
)
def test_tables_of_scipy(table):
    t = np.linspace(-1.05, 11.07, 201)
    field = Field(lambda t, y: np.sum(table(t)) - 0 * y[0], 1)
    expected = [np.sum(table(each)) for each in t]
    np.testing.assert_allclose(field([0.0], t=t)[:, 0], expected, atol=1e-12)
