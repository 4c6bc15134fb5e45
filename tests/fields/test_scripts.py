"""Functions as users of SciPy write them: f(t, y), arrays that f fills, `if`, `math`, tables."""

import functools
import gc
import math
import pickle
from math import sin

import numpy as np
import pytest
from numpy import zeros
from scipy import fftpack
from scipy.interpolate import BSpline, CubicSpline, interp1d, make_interp_spline

from suslov_fast import Event, Field, Map, flow, iterate
from suslov_fast.fields.right_hand_sides import with_events
from suslov_fast.motions.events import actions_of
from suslov_fast.status import IntegrationWarning


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
    with pytest.raises(TypeError, match="t0 must be left out: a Map takes no time"):
        iterate(Map(lambda x: (x[0] / 2,), 1), [1.0], steps=1, t0=0.0)
    with pytest.raises(ValueError, match="x0 must have the shape"):
        flow(Field(lambda t, y: (t - y[0],), 1), [2.0, 0.0], time=1.0)
    own = Field(lambda s: (-s[0], 1.0), "x t")
    with pytest.raises(TypeError, match="takes no time, which this function reads"):
        flow(own, [1.0, 0.0], time=1.0, events=Event(lambda t, y: t - 1))
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

    with pytest.raises(TypeError, match="f: asks too often"):
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


class Pump:
    """An object with methods, as controllers of scripts are."""

    def __init__(self, k):
        self.k, self.table = k, CubicSpline(X, Y)

    def rate(self, t, h):
        return max(self.k * (1.0 - h), 0.0) * self.table(t)

    def rates(self, t, y):
        d = np.zeros(2)
        d[0] = self.rate(t, y[0])
        d[1] = math.atan2(y[1], 1.0 + t)
        return d


PUMP = Pump(2.0)


def shorter(t, y):
    import math as m

    rate = functools.partial(PUMP.rate, t)
    return [rate(y[0]), m.atan2(y[1], 1.0 + t)]


class Slower(Pump):
    @property
    def deficit(self):
        return math.fabs(1.0 - self.height)

    def rates(self, t, y):
        d = super().rates(t, y)
        self.height = y[0]
        assert self.deficit >= 0
        d[0] = super().rate(t, y[0])
        return d


class Law:
    def __call__(self, t, y):
        return [f(t, y[k]) for k, f in enumerate([PUMP.rate, lambda t, a: math.atan2(a, 1 + t)])]


@pytest.mark.parametrize(
    "f", [PUMP.rates, Slower(2.0).rates, shorter, Law(), functools.partial(Law())]
)
def test_names_lead_to_functions_that_take_symbols(f):
    """Methods, objects that can be called, partial functions, lists, names imported in f."""
    field, states = Field(f, "h z"), np.random.default_rng(1).normal(size=(20, 3))
    expected = [PUMP.rates(t, y) for t, *y in states]
    np.testing.assert_allclose(field(states[:, 1:], t=states[:, 0]), expected, rtol=1e-13)


def test_calls_of_f_are_two_and_one_for_each_further_path():
    for n in range(6):
        calls = []

        def f(y, calls=calls, n=n):
            calls.append(1)
            return [sum((2.0**k if y[k] > 0 else 0.0) for k in range(n)) for _ in y]

        field, signs = Field(f, 6), np.random.default_rng(n).normal(size=(20, 6))
        assert len(calls) == 2**n + 1
        calls.clear()
        assert field(signs).tolist() == [f(row) for row in signs]


def test_the_first_error_is_shown():
    def f(y):
        d = np.zeros(2)
        d[0] = y[1]
        d[1] = unknown_force(y[0])  # noqa: F821
        return d

    with pytest.raises(NameError, match="unknown_force"):
        Field(f, 2)

    def g(y):
        d = np.array([0.0, 0.0])
        d[0] = y[1]
        d[1] = [1.0, 2.0][int(y[0])]
        return d

    with pytest.raises(TypeError, match="is no float"):
        Field(g, 2)


@pytest.mark.parametrize(
    ("f", "g"),
    [
        (np.rint, np.rint),
        (lambda a: round(a, 1), lambda a: np.round(a, 1)),
        (np.sinc, np.sinc),
        (lambda a: math.fmod(a, 0.7), lambda a: np.fmod(a, 0.7)),
        (lambda a: math.copysign(2.0, a), lambda a: np.copysign(2.0, a)),
        (lambda a: float(np.fmax(a, 0.3)), lambda a: np.fmax(a, 0.3)),
        (lambda a: math.dist([a, 1], [0, 3]), lambda a: np.hypot(a, 2)),
        (math.erfc, np.vectorize(math.erfc)),
    ],
)
def test_functions_made_of_others(f, g):
    a = np.array([-1.5, -0.5, 0.0, 0.25, 0.5, 1.5, 2.5, 1.23456])
    field = Field(lambda y: [f(y[0])], 1)
    np.testing.assert_allclose(field(a[:, np.newaxis])[:, 0], g(a), rtol=1e-14, atol=1e-15)


def test_lists_of_symbols_are_arrays_in_numpys_functions():
    def f(z):
        return np.imag([z[0], 2 * z[1]]) + np.linalg.norm([z[0], z[1]]), zeros(1, complex)[0] + 1j

    z = np.array([1 + 2j, 3 - 4j])
    expected = [2 + np.sqrt(30), 1j]
    assert Field(lambda z: np.imag([z, 2 * z])[1], 2, complex=True)(z).tolist() == [4, -8]

    def skew(y):
        rows = np.array([[0.0, -y[1]], [y[1], 0.0]])
        return np.block([[rows, y.reshape(2, 1)], [-y.reshape(1, 2), np.zeros((1, 1))]])[0, :2]

    assert Field(skew, 2)([3.0, 4.0]).tolist() == [0, -4]
    with pytest.raises(TypeError, match=r"write cmath\.sin"):
        Field(lambda z: math.sin(z[0]), 1, complex=True)
    np.testing.assert_allclose(Field(lambda z: (f(z)[0][0], f(z)[1]), 2, complex=True)(z), expected)


def test_linear_algebra_of_symbols_beside_numpy():
    def by_solve(y):
        M = np.array([[2 + np.cos(y[1]), 0.3, 0.0], [0.3, 1.0 + y[0] ** 2, y[2]], [0.0, y[2], 1.0]])
        return np.linalg.solve(M, y) + np.linalg.inv(M) @ y * np.linalg.det(M)

    def by_numbers(y):
        J = np.zeros((3, 3))
        J[0, 1], J[1, 2], J[2, 0] = 1.0, 2.0, 4.0
        return np.linalg.inv(J) @ y

    states = np.random.default_rng(0).normal(size=(30, 3))
    for f in (by_solve, by_numbers):
        expected = [f(y) for y in states]
        np.testing.assert_allclose(Field(f, 3)(states), expected, rtol=1e-11, atol=1e-12)
    with pytest.raises(TypeError, match="singular"):
        Field(lambda y: np.linalg.solve([[y[0], y[1]], [y[0], y[1]]], y), 2)


@pytest.mark.parametrize(
    "f",
    [
        lambda u: np.fft.ifft(1j * np.arange(-8, 8) * np.fft.fft(u)).real,
        lambda u: np.fft.irfft(1j * np.arange(9) * np.fft.rfft(u)),
        lambda u: fftpack.diff(u, period=3.0, order=3),
        lambda u: u * np.gradient(u, 0.25),
        lambda u: np.gradient(u, np.arange(16.0) ** 1.5, edge_order=2),
    ],
)
def test_transforms_and_differences_beside_numpy(f):
    u = np.random.default_rng(3).normal(size=(4, 16))
    np.testing.assert_allclose(
        Field(lambda t, u: f(u), 16)(u), [f(row) for row in u], atol=1e-11, rtol=1e-12
    )


def test_functions_that_differ_in_numbers_share_machine_code():
    """An f that is made anew in a loop is compiled once, whatever number it captures."""
    codes = []
    for k in (3.0, 5.0, 7.5):

        def f(s, k=k):
            drag = k / 4 * s[1] * abs(s[1]) if s[0] < k / 9 else 0.0
            return [s[1], -k * s[0] * np.cos(s[0]) - drag]

        field = Field(f, 2)
        bounce = Event(lambda s, k=k: s[0] - k / 8, to=lambda s, k=k: (s[0], -s[1] / k))
        for events in ((), (bounce,)):
            [(_, code, _)] = with_events(field, actions_of(field, events))
            codes.append(code.key)
    assert len({*codes}) == 2


def test_the_derivative_of_a_power_does_not_depend_on_how_it_is_written():
    """Forms with the same operations share machine code, whichever came first."""

    def powers(x):
        return x[0] ** 1.5, x[1] ** 2.5, x[2] ** 3, (1 + x[3]) ** 4

    def products(x):
        square = (1 + x[3]) * (1 + x[3])
        return np.sqrt(x[0]) * x[0], x[1] * x[1] * np.sqrt(x[1]), x[2] * x[2] * x[2], square**2

    x = [0.0, 0.3, 1.7, 2e8]
    [a, b] = (Field(f, 4).jacobian(x) for f in (powers, products))
    np.testing.assert_array_equal(a, b)
    exact = [0.0, 2.5 * 0.3**1.5, 3 * 1.7**2, 4 * (1 + 2e8) ** 3]
    np.testing.assert_allclose(a, np.diag(exact), rtol=1e-15)
    for k in (2.0, 3.0):
        field = Field(lambda x, k=k: [-k * x[0] ** 1.5], 1)
        [(_, code, table)] = field._motion_lists(())
        assert code.of_x.jacobian(np.zeros(1), table[0]) == 0.0


def test_time_has_any_place_in_lagrangians():
    first, *others = (
        Field.from_lagrangian(L, "x", k=2.0)
        for L in (
            lambda q, v, t, k: v @ v / 2 - k * np.cos(t) * q @ q,
            lambda t, q, v, k: v @ v / 2 - k * np.cos(t) * q @ q,
            lambda q, v, k, t: v @ v / 2 - k * np.cos(t) * q @ q,
            lambda q, v, k, *, time: v @ v / 2 - k * np.cos(time) * q @ q,
        )
    )
    assert all(each == first for each in others)
    np.testing.assert_allclose(first([1.0, 0.5], t=0.7), [0.5, -4 * np.cos(0.7)])


def test_arguments_of_scipy_become_parameters():
    def f(t, y, k, m):
        return [y[1], -k / m * y[0]]

    for call in (
        lambda: Field(f, "x v", args=(2.0, 3.0)),
        lambda: flow(f, [1.0, 0.0], time=1.0, args=(2.0, 3.0)),
    ):
        with pytest.raises(TypeError, match=r"Field\(f, names, k=2\.0, m=3\.0\)"):
            call()
    with pytest.raises(TypeError, match=r"Field\(lambda y, t: f\(y, t, \*args\), names\)"):
        Field(lambda y, t, K: K @ y, "x v", args=(np.eye(2),))


BUFFER, OUT = np.zeros(2), np.zeros(2)


def raising(y):
    if y[0] < 0.5:
        raise ValueError("below a half")
    return [-y[0], y[1]]


def asking(y):
    assert y[0] >= 0.5
    return [-y[0] if isinstance(y[0], float) and np.isscalar(y[0]) else 7.0, np.float64(y[1])]


@pytest.mark.parametrize("f", [raising, asking])
def test_a_path_that_raises_has_no_value(f):
    field = Field(f, 2)
    assert field([2.0, 3.0]).tolist() == [-2, 3]
    assert np.isnan(field([0.4, 3.0])).all()
    with pytest.warns(IntegrationWarning, match="has no value there"):
        motion = flow(field, [1.0, 1.0], time=2.0)
    assert motion.end == pytest.approx(math.log(2), abs=1e-6)


def after_two_comparisons(y):
    a, d = np.sqrt(y[0]), 7.0
    if a > 1:
        d = 1.0
    elif a <= 1:
        d = 2.0
    return [d]


def without_a_last_branch(y):
    a = y[0] / abs(y[0])
    if a > 0:
        d = 1.0
    elif a <= 0:
        d = 2.0
    return [d]


def test_nan_is_on_neither_side():
    """Python takes neither branch for NaN; a function that has no value then is NaN."""
    field = Field(after_two_comparisons, 1)
    assert [field([a])[0] for a in (4.0, 0.25, -1.0)] == [1, 2, 7]
    field = Field(without_a_last_branch, 1)
    assert [field([a])[0] for a in (4.0, -0.25)] == [1, 2]
    assert np.isnan(field([0.0])).all()


def test_a_sum_of_two_comparisons_has_two_meanings():
    """It is 2 for Python's numbers and True for NumPy's; a sum that begins with a number is 2."""
    for f in (lambda y: [(y[0] > 0) + (y[0] > 1)], lambda y: ((y > 0) + (y > 1)) * 1.0):
        with pytest.raises(TypeError, match="True for NumPy"):
            Field(f, 1)
    for f in (lambda y: [sum([y[0] > 0, y[0] > 1])], lambda y: [np.sum([y[0] > 0, y[0] > 1])]):
        assert Field(f, 1)([2.0])[0] == f(np.array([2.0]))[0] == 2.0


def test_results_without_numbers():
    motion = flow(Field(lambda y: [-y[0]], 1), [1.0], time=1.0)
    for nothing in (lambda y: (), []):
        with pytest.raises((TypeError, ValueError), match=r"^values"):
            motion.values(nothing)


def test_errors_on_all_paths_are_raised():
    def f(y):
        if y[0] > 0:
            raise ValueError("no value above 0")
        raise ValueError("no value below 0")

    with pytest.raises(ValueError, match="no value above 0"):
        Field(f, 1)


def filled_by_flat_indices(y):
    v = np.array([0.0, 0.0])
    v.flat[0] = 2 * y[1]
    v.flat[1] = y[0]
    return v


def test_arrays_are_filled_by_flat_indices():
    assert Field(filled_by_flat_indices, 2)([1.0, 3.0]).tolist() == [6, 1]


def test_arrays_from_outside_are_filled_by_copies():
    def f(y, out=OUT):
        BUFFER[0] = y[1]
        out[:] = BUFFER[0], -y.astype(float)[0]
        return out

    assert Field(f, "x v") == Field(lambda y: (y[1], -y[0]), "x v")
    assert [*BUFFER, *OUT] == [0, 0, 0, 0]


def test_functions_of_numbers_on_arrays():
    square = np.vectorize(lambda a: math.sin(a) if a > 0 else 0.0)

    def f(y):
        return square(y) + np.vectorize(max)(y, 0.1) + divmod(y[0], 2)[1] * min(y, key=abs)

    states = np.random.default_rng(5).normal(size=(20, 3))
    np.testing.assert_allclose(Field(f, 3)(states), [f(y) for y in states], rtol=1e-14)


def test_numpys_ways_of_scripts():
    """Masks, truth values as integers, and functions of arrays that f filled with numbers."""

    def f(y):
        d, weights = y.copy(), np.ones((3, 3))
        d[d < 0] = -2.0
        d[y > 1] = 1.0
        d += np.linalg.pinv(weights) @ y * (y > 0).astype(int)
        return d if not np.allclose(y, 0.0) else 0 * y

    states = np.random.default_rng(8).normal(size=(30, 3))
    expected = [f(y) for y in states]
    np.testing.assert_allclose(Field(f, 3)(states), expected, rtol=1e-13, atol=1e-14)


def test_objects_of_users_do_not_change():
    class Integral:
        total = 0.0

        def add(self, e):
            self.total += e
            return self.total

    integral = Integral()
    with pytest.raises(ValueError, match="two calls of f differ"):
        Field(lambda y: [integral.add(y[0])], 1)
    assert integral.total == 0.0


def test_traces_leave_no_work_to_garbage_collection():
    def f(t, y):
        d = np.zeros(2)
        d[:] = y[1], sin(y[0]) if y[1] > 0 else max(t, 0.0)
        return d

    Field(f, "x v")
    gc.collect()
    gc.disable()
    try:
        Field(f, "x v")
        assert gc.collect() == 0
    finally:
        gc.enable()


def test_types_of_arrays_and_signs_of_zeros_are_those_of_numpy():
    def f(y):
        return np.copysign(y[0], -0.0), np.copysign(y[0], y[1]), np.array([y[0] > 1, 1], int).sum()

    x = [2.5, -1.5, 0.0]
    assert Field(f, 3)(x).tolist() == [*f(x)]
    for wrong in (
        lambda y: np.array([y[0], y[1]], dtype=int) * 1.0,
        lambda y: np.asarray(y, int),
        lambda y: (np.sum(y, dtype=int), y[1]),
        lambda y: (np.maximum(y[0], np.nan), y[1]),
        lambda y: (next(i for i in range(5) if y[0] < i), y[1]),
    ):
        with pytest.raises((TypeError, ValueError), match=r"^f: \w"):
            Field(wrong, "a b")
