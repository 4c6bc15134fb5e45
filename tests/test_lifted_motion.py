"""`flow` of lifted fields, by the steps that quadratic fields take."""

import re

import numpy as np
import pytest
from children import TWO_THREADS
from numba import config
from scipy.integrate import solve_ivp
from scipy.special import expi, lambertw
from test_lifted import FIELDS

from suslov_fast import LiftedField, PoleWarning, flow
from suslov_fast.bodies.structure import Lift
from suslov_fast.core import flow as core_flow
from suslov_fast.core import tolerance
from suslov_fast.core.agreement import compared, follows
from suslov_fast.core.lift import ONE, Variables
from suslov_fast.core.operations import Values, evaluate
from suslov_fast.engine import threads

S, E = np.sin, np.exp


def kepler(x):
    x, y, u, v = x
    r3 = (x**2 + y**2) ** (-3 / 2)
    return u, v, -x * r3, -y * r3


def predator_prey(x, K=4.0, m=1 / 3):
    N, P = x
    return N * (1 - N / K) - N * P / (1 + N), N * P / (1 + N) - m * P


def van_der_pol(x, mu=1000):
    return x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]


def brusselator(x):
    return 1 + x[0] ** 2 * x[1] - 4 * x[0], 3 * x[0] - x[0] ** 2 * x[1]


def arrhenius(x):
    rate = x[0] * E(-1 / (1 + x[1]))
    return -rate, rate - x[1] / 2


def of(f, dimension, **parameters):
    return LiftedField.from_function(f, dimension, **parameters)


def solution(f, x, times, method="DOP853"):
    """Return states by SciPy."""
    options = {"rtol": 1e-13, "atol": 1e-15}
    return solve_ivp(lambda t, y: f(y), (0, times[-1]), x, method, times, **options).y.T


# ---------------------------------------------------------------------------------------- accuracy
@pytest.mark.parametrize(
    ("f", "start", "time"),
    [
        (lambda x: (x[1], -S(x[0])), [2.5, 0.0], 20.0),
        (kepler, [0.4, 0.0, 0.0, 2.0], 2 * np.pi),
        (predator_prey, [1.0, 1.0], 50.0),
        (brusselator, [1.0, 1.0], 20.0),
        (arrhenius, [1.0, 0.0], 10.0),
        (lambda x: (2 / (1 + x[0] ** 4) - x[0],), [0.1], 10.0),
        (
            lambda x: (np.tanh(x[1]), -((x[0] ** 2 + 1) ** 0.3) * np.log1p(x[0] ** 2)),
            [0.4, 1.3],
            5.0,
        ),
    ],
)
def test_solutions_have_their_tolerance(f, start, time):
    exact = solution(f, start, [time / 2, time])
    for rtol in (1e-6, 1e-9, 1e-12):
        found = flow(of(f, len(start)), start, [time / 2, time], rtol=rtol)
        assert abs(found - exact).max() < 100 * rtol


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "name", ["double pendulum", "three bodies", "sitnikov", "toda", "tangent", "roots", "powers"]
)
def test_fields_of_many_variables_and_functions(name):
    f, start, _ = FIELDS[name]
    found = flow(of(f, len(start)), start, 3.0, rtol=1e-10)
    assert abs(found - solution(f, start, [3.0])[0]).max() < 1e-8


def test_the_pendulum_swings_back_and_forth():
    field = of(lambda x: (x[1], -S(x[0])), 2)
    there = flow(field, [2.5, 0.1], 7.0, rtol=1e-12)
    assert abs(flow(field, there, -7.0, rtol=1e-12) - [2.5, 0.1]).max() < 1e-10


@pytest.mark.parametrize(("rtol", "error"), [(1e-6, 5e-6), (1e-8, 1e-7), (1e-12, 5e-11)])
def test_stiff_relaxation(rtol, error):
    if config.DISABLE_JIT and rtol < 1e-8:
        pytest.skip("a minute and a half in NumPy")
    field = of(van_der_pol, "x v")
    found = flow(field, [2.0, 0.0], np.arange(1.0, 12) * 200, rtol=rtol)
    # Test set for initial value problems (Mazzia and Magherini), whose time is 1000 times shorter.
    assert abs(found[-2, 0] - 1.706167732170469) < error


@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("rate", [1e3, 1e6, 1e9])
def test_fast_modes_that_begin_away_from_their_equilibrium(rtol, rate):
    """Extrapolated steps multiply very fast modes by almost 1, so an estimate does not see them."""
    field = of(lambda x: (rate * (1 - x[0]), -E(-x[1])), "x y")  # y = log(e - t)
    times = np.array([0.1, 1.0, 1e5, 1e9]) / 1e9
    found = flow(field, [0.0, 1.0], [*times, 1.0, 2.0], rtol=rtol)
    wanted = -np.expm1(-rate * np.array([*times, 1.0, 2.0]))
    assert abs(found[:, 0] - wanted).max() < 2 * rtol
    assert abs(found[-2:, 1] - np.log(np.e - np.array([1.0, 2.0]))).max() < 20 * rtol


def test_populations_stay_positive():
    field = of(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1) / (1 + 1e-6 * x[0])), "x y")
    times = np.linspace(0, 60, 301)[1:]
    found = flow(field, [20.0, 20.0], times, rtol=1e-6)
    assert (found > 0).all()
    exact = np.exp(solution_of_logarithms(times))
    assert exact.min() < 1e-14
    assert abs(found - exact).max() < 0.1


def test_a_component_decays_to_0():
    """Of 0.6 u - 2 with u = 1/(x + 0.3), rounding leaves a sign that is no solution's."""
    times = np.array([1.0, 4.0, 7.0, 30.0, 300.0])
    exact = 0.3 * lambertw(np.exp((1 - 2 * times) / 0.3) / 0.3).real
    field = of(lambda x: (-2 * x[0] / (x[0] + 0.3),), 1)
    for rtol in (1e-4, 1e-9, 1e-13):
        found = flow(field, [[1.0], [-0.1]], times, rtol=rtol)
        assert abs(found[:, 0, 0] - exact).max() < 10 * rtol
        assert (np.sign(found[..., 0]) == [1, -1]).all()


@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
@pytest.mark.parametrize(
    ("g", "integral"),
    [
        (lambda x: np.tanh(100 * x), lambda x: np.log(2 * np.cosh(100 * x)) / 100),
        (lambda x: 1 / (1 + np.exp(-100 * x)), lambda x: np.logaddexp(0, 100 * x) / 100),
        (lambda x: 1 / (1 + np.exp(100 * x)), lambda x: -np.logaddexp(0, -100 * x) / 100),
        (
            lambda x: np.sqrt(x**2 + 1e-6),
            lambda x: (x * np.sqrt(x**2 + 1e-6) + 1e-6 * np.arcsinh(1e3 * x)) / 2,
        ),
    ],
    ids=["tanh", "rises", "falls", "modulus"],
)
def test_no_step_passes_over_a_change_of_the_rate(g, integral, rtol):
    """Of y' = g(t) from t = -2 on, though words may agree that no state has."""
    field, times = of(lambda x: (1 + 0 * x[0], g(x[0])), 2), np.array([1.9, 2.1, 4.0])
    found = flow(field, [-2.0, 0.0], times, rtol=rtol)[:, 1]
    assert abs(found - (integral(times - 2) - integral(-2.0))).max() < 3e-5


def test_components_without_a_rate_stay():
    """Those of a family, too, where the only term that a component has is 0."""
    times = np.array([0.5, 3.0])
    given = of(lambda x: (x[1] - np.sin(x[1]), 2 + 0 * x[0], 0 * x[0]), 3)
    found = flow(given, [0.0, 0.0, 0.7], times, rtol=1e-9)
    assert (found[:, 2] == 0.7).all()
    exact = times**2 + (np.cos(2 * times) - 1) / 2
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-8)
    family = of(lambda x, a: (a * x[0], -x[1] / (1 + x[1])), 2, a=np.array([0.0, 0.5]))
    found = flow(family, [1.5, 1.0], times, rtol=1e-9)
    assert (found[:, 0, 0] == 1.5).all()
    np.testing.assert_allclose(found[:, 1, 0], 1.5 * np.exp(times / 2), rtol=1e-8)
    exact = lambertw(np.exp(1 - times)).real
    np.testing.assert_allclose(found[:, :, 1].T, [exact, exact], rtol=1e-8)


@pytest.mark.parametrize(
    ("g", "integral"),
    [
        (lambda t: np.exp(-((t - 4.4) ** 2) / 1e-4), np.sqrt(np.pi * 1e-4)),
        (lambda t: 1 / np.cosh((t - 4.4) / 0.02) ** 2, 0.04),
        (lambda t: sum(np.exp(-((t - k) ** 2) / 1e-5) for k in (2, 3)), 2 * np.sqrt(np.pi * 1e-5)),
    ],
    ids=["exp", "cosh", "two"],
)
@pytest.mark.parametrize("direction", [1, -1])
def test_no_step_passes_over_a_pulse(g, integral, direction):
    """Of x' = g(t) from rest, where g is 0 in floating point but for the pulse."""
    field = of(lambda x: (g(direction * x[1]), 1), 2)
    found = flow(field, [0.0, 0.0], direction * 10.0, rtol=1e-6)
    assert abs(found[0] - direction * integral) < 1e-5 * integral


# Interpreted, the long one takes minutes.
LONG = pytest.param(0.0, 1e4, marks=pytest.mark.compiled)


@pytest.mark.parametrize(("start", "time"), [LONG, (1e7, 10.0)])
def test_time_may_be_large_where_all_else_is_small(start, time):
    """x'' = -x - x' / 10 + 1e-7 cos(3 t) from rest, whose solution is a sum of exponentials."""
    rates = np.array([3j, *np.roots([1, 0.1, 1])])
    of_force = 1e-7 / (rates[0] ** 2 + 0.1 * rates[0] + 1) * np.exp(rates[0] * start)
    others = np.linalg.solve([[1, 1], rates[1:]], [-of_force.real, -(3j * of_force).real])
    exact = (np.array([of_force, *others]) * np.exp(rates * time)).sum().real
    field = of(lambda x: (x[1], 1e-7 * np.cos(3 * x[2]) - x[0] - 0.1 * x[1], 1), 3)
    found = flow(field, [0.0, 0.0, start], time)
    assert abs(found[0] - exact) < 1e-5 * abs(of_force)


def solution_of_logarithms(times):
    def f(z):
        x, y = np.exp(z)
        return 1 - y, (x - 1) / (1 + 1e-6 * x)

    return solution(f, np.log([20.0, 20.0]), times)


# -------------------------------------------------------------------------------------------- ends
@pytest.mark.parametrize(
    ("f", "start", "end"),
    [
        (lambda x: (E(x[0]),), [1.0], np.exp(-1)),  # x = -log(e**-1 - t)
        (lambda x: (-E(-x[0]),), [1.0], np.e),  # y = log(e - t)
        (lambda x: (-1 / x[0],), [1.0], 0.5),  # sqrt(1 - 2 t)
        (lambda x: (-np.sqrt(x[0]) / x[0],), [1.0], 2 / 3),
        (lambda x: (1 + x[0] ** 4,), [0.0], np.pi / 8**0.5),
        (lambda x: (np.log(x[0]),), [0.5], -expi(np.log(0.5))),
    ],
)
def test_solutions_that_end(f, start, end):
    field = of(f, 1)
    times = np.array([0.5, 0.99, 1.01, 2.0]) * end
    with pytest.warns(PoleWarning, match="1 of 1 solutions end") as record:
        found = flow(field, start, times)
    [told] = re.findall(r"near t = (\S+)$", str(record[0].message))
    assert abs(float(told) - end) < 1e-6
    np.testing.assert_allclose(found[:2], solution(f, start, times[:2]), rtol=1e-7)
    assert np.isnan(found[2:]).all()


@pytest.mark.parametrize(
    ("g", "start", "exact", "pole"),
    [
        (lambda t: 1 / (t - 1), 0.0, lambda t: 1 - t, 1.0),
        (lambda t: np.cos(t) / np.sin(t), 1.0, lambda t: np.sin(t), np.pi),
        (lambda t: -np.tan(t), 0.0, lambda t: np.cos(t), np.pi / 2),
    ],
    ids=["1/(t - 1)", "cot", "tan"],
)
def test_no_step_passes_over_a_pole_of_the_rate(g, start, exact, pole):
    """Of x' = g(t) x, though x tends to 0 there."""
    field, times = of(lambda x: (x[0] * g(x[1]), 1), 2), (pole - start) * np.array([0.5, 0.9, 2])
    with pytest.warns(PoleWarning, match="1 of 1 solutions end") as record:
        found = flow(field, [exact(start), start], times)[:, 0]
    [told] = re.findall(r"near t = (\S+)$", str(record[0].message))
    assert abs(float(told) - (pole - start)) < 1e-6
    np.testing.assert_allclose(found[:2], exact(start + times[:2]), rtol=1e-7)
    assert np.isnan(found[2])


def test_which_words_are_compared_with_those_of_the_state():
    """To an eighth of the larger one, tanh to an eighth of 1; no sine, and no product."""
    names = "sin", "exp", "inverse", "tanh"
    definitions = tuple((name, ((ONE, (0,)),), None) for name in names)
    lift = Lift(1, 0, definitions, ((1,), (2,), (0, 2), (3,), (4,), (2, 2)), ())
    values, words = Values(7, ()), range(1, 7)
    own, near = compared(values, Variables(values, lift, 7), lift, words)
    x, of_state = 2.0, [S(2.0), E(2.0), 2 * E(2.0), 0.5, np.tanh(2.0), E(4.0)]
    for moved, expected in (
        ([9.0, 1.14, 9.0, 0.88, 1.0, 9.0], [True, True, True]),
        ([1.0, 1.15, 1.0, 0.87, 1.0, 1.0], [False, False, True]),
        ([1.0, 1.0, 1.0, 1.0, 0.88, 1.0], [True, True, True]),
        ([1.0, 1.0, 1.0, 1.0, 0.86, 1.0], [True, True, False]),
    ):
        found = dict(enumerate([x, *np.multiply(of_state, moved)]))
        evaluate(values.operations, found)
        np.testing.assert_allclose([found[number] for number in own], of_state, rtol=1e-15)
        assert [bool(found[number]) for number in near] == expected


@pytest.mark.parametrize(
    ("function", "used", "before", "after", "expected"),
    [
        ("sin", False, -7.0, 8.5, True),
        ("cos", False, -7.0, 9.5, False),
        ("inverse", True, -1.0, 1.0, False),  # a word that is a term of its own
        ("inverse", True, 1.0, 2.0, True),
        ("inverse", False, -1.0, 1.0, True),
        ("tan", True, 1.0, 2.0, False),
        ("tan", True, 1.0, 1.5, True),
        ("tan", False, 1.0, 2.0, True),
        ("cosh", False, -9.0, 9.0, False),
        ("cosh", False, -9.0, 7.0, True),
        ("cosh", False, 9.0, 90.0, True),
    ],
)
def test_which_steps_variables_follow(function, used, before, after, expected):
    assert followed(function, (0,), used, before, after) == expected


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [(-2.0, 2.0, False), (-2.0, 0.5, True), (-0.5, 2.0, True), (2.0, 9.0, True)],
)
def test_which_pulses_steps_follow(before, after, expected):
    """exp(-t**2), whose exponent rises by up to 8 at first, or falls by up to 8 at last."""
    assert followed("exp", (0, 0), True, before, after) == expected


def followed(function, variables, used, *ends):
    """Return whether a step between these times follows g(p), p = t, or exp(-t**2)."""
    lift = Lift(1, 1, ((function, ((0, variables),), None),), ((1,),), ())
    indices, values = np.array([[0], [1], [2]])[:, : int(used)], Values(3, ())
    found = follows(indices, values, {0}, *(Variables(values, lift, 2, [k]) for k in range(2)))
    numbers = dict(enumerate([*ends, -1.0 if function == "exp" else 1.0]))
    with np.errstate(all="ignore"):
        evaluate(values.operations, numbers)
    return all(bool(numbers[number]) for number in found)


def test_only_solutions_that_end_are_nan():
    field = of(lambda x: (E(x[0]),), 1)
    start = np.array([[1.0], [-1.0], [np.nan], [0.0], [800.0]])
    with pytest.warns(
        PoleWarning,
        match=r"3 of 5 solutions end; first: 0 near t = 0.36787944",
    ):
        found = flow(field, start, [2.0])[0, :, 0]
    assert np.isnan(found).tolist() == [True, False, True, True, True]
    assert abs(found[1] + np.log(np.e - 2)) < 1e-8


def test_a_state_without_rates_waits_for_others():
    """The last state before the end of a solution is the same beside others that go on."""
    field, times = of(lambda x: (-1 / x[0],), 1), [0.5 - 1e-13, 0.5, 0.6]
    with pytest.warns(PoleWarning):
        alone = flow(field, [1.0], times)
    with pytest.warns(PoleWarning):
        together = flow(field, [[1.0], [2.0], [5.0]], times)
    np.testing.assert_array_equal(together[:, 0], alone)


# ---------------------------------------------------------------------------------------- contract
def cases(rng):
    K = np.array([2.0, 4.0, 3.0, 2.5, 3.5] * 12)
    m = np.where(np.arange(60) % 7, 1 / 3, 0.0)  # with other terms
    family = of(predator_prey, "N P", K=K, m=m)
    powers = of(lambda x, h: (x[0] * (1 - x[0] ** h), E(-x[1])), 2, h=np.linspace(0.5, 3, 60))
    starts = rng.uniform(0.3, 2, (60, 2))
    return (family, starts), (of(lambda x: (x[1], -S(x[0])), 2), starts), (powers, starts)


def test_bits_do_not_depend_on_batch_and_threads(rng, monkeypatch):
    for field, x in cases(rng):
        whole = flow(field, x, [0.3, 2.0])
        for part in (slice(0, 1), slice(3, 5), slice(7, 12), slice(20, 60), slice(None, None, -1)):
            own = field[part] if field.shape else field
            assert (flow(own, x[part], [0.3, 2.0]) == whole[:, part]).all()
        with monkeypatch.context() as patch:
            patch.setattr(threads, "CROSSOVER", 0)
            assert (flow(field, x, [0.3, 2.0], threads=TWO_THREADS) == whole).all()
            patch.setattr(core_flow, "BUDGET", 1)  # a pause after each step
            assert (flow(field, x, [0.3, 2.0]) == whole).all()


def test_families_have_the_solutions_of_their_members(rng):
    (family, x), *_ = cases(rng)
    found = flow(family, x, [5.0], rtol=1e-10)[0]
    for k in (0, 1, 7, 59):
        K, m = (family.parameters[name][k] for name in "Km")
        exact = solution(lambda z, K=K, m=m: predator_prey(z, K, m), x[k], [5.0])
        assert abs(found[k] - exact[0]).max() < 1e-8


def test_parameters_of_families_in_arrays():
    """As NumPy writes coupled phases, and a matrix of parameters."""
    own, K, start = np.linspace(-1, 1, 4), np.array([0.5, 2.0]), [0.1, 0.7, 1.5, 2.0]

    def phases(x, K):
        x = np.array(x)
        return own + K / 4 * np.sin(x[None, :] - x[:, None]).sum(axis=1)

    def turned(x, K):
        return np.array([[0, K], [-K, 0]]) @ np.array([np.sin(x[0]), x[1]])

    for f, x in (phases, start), (turned, start[:2]):
        family = LiftedField.from_function(f, len(x), K=K)
        found = flow(family, x, [2.0])[0]
        for k in (0, 1):
            exact = solution(lambda z, f=f, k=k: f(z, K[k]), x, [2.0])[0]
            assert abs(found[k] - exact).max() < 1e-7


@pytest.mark.compiled  # interpreted, 250,000 steps take minutes
@pytest.mark.parametrize(("f", "parameters"), [
    (lambda x: (-np.cbrt(x[0]),), {}), (lambda x, a: (-np.cbrt(a * x[0]),), {"a": [1.0, 1.0]}),
])  # fmt: skip
def test_steps_that_shrink_where_an_equation_is_not_smooth(f, parameters):
    """x' = -cbrt(x) comes to 0, where its derivative is infinite, at t = 3 / 2 from x = 1."""
    field = LiftedField.from_function(f, 1, **parameters)
    told = r"take more than 250,000 steps .*; later states are NaN: .* grows to .* not smooth where"
    with pytest.warns(RuntimeWarning, match=told):
        found = flow(field, [1.0], [1.0, 2.0])
    np.testing.assert_allclose(found[0], (1 / 3) ** 1.5, rtol=1e-7)
    assert np.isnan(found[1]).all()


@pytest.mark.filterwarnings("ignore::suslov_fast.PoleWarning")
def test_numpy_takes_the_same_steps(rng, monkeypatch):
    field = of(lambda x: (E(x[0] - x[1]), -np.sqrt(x[1])), 2)
    starts = np.array([[-1.0, 1.0], [0.5, 2.0], [0.0, -1.0], [3.0, 1e-3], [np.nan, 1.0]])
    some = [(field, starts, [0.5, 1.5]), *((each[:9], x[:9], [1.0]) for each, x in cases(rng)[::2])]
    expected = [flow(*case) for case in some]
    monkeypatch.setattr(core_flow, "code_of", lambda *arguments, **options: None)
    for case, wanted in zip(some, expected, strict=True):
        np.testing.assert_array_equal(flow(*case), wanted)


@pytest.mark.slow_to_compile
@pytest.mark.parametrize("has_plan", [pytest.param(True, marks=pytest.mark.compiled), False])
def test_many_variables(rng, monkeypatch, has_plan):
    """Loops in place of code: the same to rounding; bits over batches and fields."""
    family = of(predator_prey, 2, K=[2.0, 3.0, 4.0])
    starts = rng.uniform(0.5, 1.5, (11, 1, 2)) * np.ones((3, 1))
    falling, times = of(lambda x: (-1 / x[0], x[0]), 2), [0.5, -1.0, 2.0]
    wanted = flow(family, starts, times)
    monkeypatch.setattr(core_flow, "MOST", 0)
    monkeypatch.setattr(core_flow, "MOST_OF_ONE", 0)
    monkeypatch.setattr(core_flow, "code_of", lambda *_: pytest.fail("compiled"))
    if not has_plan:
        monkeypatch.setattr("suslov_fast.core.operations.MOST", -1)
        monkeypatch.setattr("suslov_fast.core.operations.PART_OF_DENSE", 0)
    tolerance._stage_of.cache_clear()
    try:
        found = flow(family, starts, times)
        assert abs(found - wanted).max() < 1e-8
        assert (found == wanted).all() or not has_plan
        assert (flow(family, starts[3], times) == found[:, 3]).all()
        assert (flow(family[1], starts[:, 1], times) == found[:, :, 1]).all()
        with pytest.warns(PoleWarning, match=r"near t = 0\.5$"):  # x**2 = 1 - 2 t
            ended = flow(falling, [[1.0, 0.0], [3.0, 0.0]], [0.4, 2.0])
        assert np.isnan(ended).all(axis=2).tolist() == [[False, False], [True, False]]
        assert ended[:, 1, 0] == pytest.approx([8.2**0.5, 5**0.5], rel=1e-8)
    finally:
        tolerance._stage_of.cache_clear()


def test_loops_raise_to_powers(monkeypatch):
    """Exponents, which are rows of loops, of a single field and of a family."""
    monkeypatch.setattr(core_flow, "MOST", 0)
    monkeypatch.setattr(core_flow, "MOST_OF_ONE", 0)
    family = of(lambda x, a: (x[1] - (1 + x[0] ** 2) ** a, -x[0]), 2, a=[0.4, 1.37])
    found = flow(family, [0.3, 0.5], 1.0)
    assert (flow(family[1], [0.3, 0.5], 1.0) == found[1]).all()
    for a, state in zip([0.4, 1.37], found, strict=True):
        [exact] = solution(lambda x, a=a: (x[1] - (1 + x[0] ** 2) ** a, -x[0]), [0.3, 0.5], [1.0])
        assert abs(state - exact).max() < 1e-8
