"""Fields whose right-hand side is smooth and not quadratic."""

import ctypes
import functools
import math
import pickle
import re
from math import exp

import numpy as np
import pytest
from children import TWO_THREADS
from numba import config, njit
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from suslov_fast import (
    LiftedField,
    PoleWarning,
    QuadraticField,
    SingularStepWarning,
    Status,
    body_from_dict,
    energy,
    flow,
    iterate,
    jacobian,
    matrix,
    modified_energy,
    step,
    vector_field,
)
from suslov_fast.bodies.polynomials import HOW
from suslov_fast.compiled import step_system, system, work
from suslov_fast.core import listed_code, machine_code, steps_field
from suslov_fast.core.words import Words
from suslov_fast.maps.methods import FRACTIONS

S, C = np.sin, np.cos


def kepler(x):
    x, y, u, v = x
    r3 = (x**2 + y**2) ** (-3 / 2)
    return u, v, -x * r3, -y * r3


def predator_prey(x, K=4):
    N, P = x
    return N * (1 - N / K) - N * P / (1 + N), N * P / (1 + N) - P / 3


def double_pendulum(x):
    a, b, c, d = x
    below = 3 - C(2 * a - 2 * b)
    first = -3 * S(a) - S(a - 2 * b) - 2 * S(a - b) * (d**2 + c**2 * C(a - b))
    second = 2 * S(a - b) * (2 * c**2 + 2 * C(a) + d**2 * C(a - b))
    return c, d, first / below, second / below


def three_bodies(x, mu=0.0123):
    x, y, u, v = x
    first, second = (((x + a) ** 2 + y**2) ** 1.5 for a in (mu, mu - 1))
    ax = x + 2 * v - (1 - mu) * (x + mu) / first - mu * (x - 1 + mu) / second
    return u, v, ax, y - 2 * u - (1 - mu) * y / first - mu * y / second


def toda(x):
    q, p = x[:3], x[3:]
    e = [np.exp(q[i - 1] - q[i]) for i in range(3)]
    return *p, *(e[i] - e[(i + 1) % 3] for i in range(3))


def repressilator(x):
    m, p = x[:3], x[3:]
    genes = (-m[i] + 216 / (1 + p[i - 1] ** 2) + 0.2 for i in range(3))
    return *genes, *(-5 * (p[i] - m[i]) for i in range(3))


def arrhenius(x):
    rate = x[0] * np.exp(-1 / (1 + x[1]))
    return -rate, rate - x[1] / 2


def sitnikov(x):
    return x[1], -x[0] / (x[0] ** 2 + (0.5 * (1 - 0.2 * C(x[2]))) ** 2) ** 1.5, 1


def degree_six(x):
    return x[2], x[3], -x[0] - 6 * x[0] ** 5 - 2 * x[0] * x[1] ** 4, -x[1] - 4 * x[1] ** 3


# Equations, dimension, a state, and the most variables that the lifted field may have.
FIELDS = {
    "pendulum": (lambda x: (x[1], -S(x[0])), [2.5, 0.0], 4),
    "kepler": (kepler, [0.4, 0.0, 0.0, 2.0], 12),
    "predator and prey": (predator_prey, [1.0, 1.0], 6),
    "hill": (lambda x: (2 / (1 + x[0] ** 4) - x[0],), [0.1], 8),
    "brusselator": (
        lambda x: (1 + x[0] ** 2 * x[1] - 4 * x[0], 3 * x[0] - x[0] ** 2 * x[1]),
        [1.0, 1.0],
        4,
    ),
    "double pendulum": (double_pendulum, [1.0, 0.5, 0.0, 0.0], 43),
    "arrhenius": (arrhenius, [1.0, 0.0], 8),
    "three bodies": (three_bodies, [0.5, 0.1, 0.2, 0.8], 30),
    "toda": (toda, [0.1, 0.3, -0.2, 0.5, -0.1, 0.2], 9),
    "repressilator": (repressilator, [1.0, 2.0, 3.0, 0.5, 0.4, 0.3], 21),
    "sitnikov": (sitnikov, [0.5, 0.1, 0.0], 60),
    "van der pol": (lambda x: (x[1], 10 * (1 - x[0] ** 2) * x[1] - x[0]), [2.0, 0.0], 3),
    # Words that bring the most products within reach at once are one fewer than those by degree.
    "two ways": (lambda x: (x[0] ** 3 * x[1], x[0] * x[1] ** 2), [0.4, 0.3], 4),
    "degree 6": (degree_six, [0.1, 0.2, 0.3, 0.4], 9),
    "hyperbolic": (lambda x: (np.tanh(x[1]), np.cosh(x[0] / 2) - np.sinh(x[0])), [0.4, 0.3], 10),
    "logarithm": (lambda x: (-np.log1p(x[1] ** 2), np.log2(x[0] + 2)), [0.4, 0.3], 20),
    "tangent": (lambda x: (np.tan(x[1] / 4), -np.arctan(x[0])), [0.4, 0.3], 20),
    "roots": (lambda x: (np.cbrt(x[1] + 2), -(np.hypot(x[0], 1) ** 0.3)), [0.4, 0.3], 30),
    "powers": (lambda x: (2 ** x[1], -(x[0] ** 2.3) + np.expm1(-x[1])), [0.4, 0.3], 20),
}


def field_of(name):
    f, x, _ = FIELDS[name]
    return LiftedField.from_function(f, len(x))


def complex_step(field, x, fractions):
    """Take Kahan's steps of the lifted field, as printed, from a complex state."""
    functions = {name: getattr(np, name) for name in ("sin", "cos", "exp")}
    scope = dict(zip(field.names, x, strict=True))
    for name, text in field.added.items():
        scope[name] = eval(text, functions, scope)
    z, lifted = np.array([*scope.values()]), field.lifted
    q, l, c = (a.astype(float) for a in (lifted.quadratic, lifted.linear, lifted.constant))
    for h in fractions:
        slope = 2 * np.einsum("ijk,k->ij", q, z) + l
        rates = np.einsum("ijk,j,k", q, z, z) + l @ z + c
        z = z + h * np.linalg.solve(np.eye(len(z)) - h / 2 * slope, rates)
    return z[: len(x)]


@pytest.mark.parametrize("method", ["auto", "order6"])
@pytest.mark.parametrize("name", ["pendulum", "kepler", "predator and prey", "hill", "toda"])
def test_the_jacobian_is_that_of_a_complex_step(name, method):
    field, x = field_of(name), np.array(FIELDS[name][1])
    fractions = [0.1] if method == "auto" else [0.1 * part for part in FRACTIONS[6]]
    columns = [complex_step(field, x + 1e-30j * unit, fractions) for unit in np.eye(len(x))]
    wanted = np.imag(columns).T / 1e-30
    found = jacobian(field, x, 0.1, method=method)
    assert abs(found - wanted).max() < 1e-12 * abs(wanted).max()


@pytest.mark.parametrize("name", FIELDS)
def test_the_lifted_field_is_the_given_one_where_it_is_lifted(name):
    f, x, most = FIELDS[name]
    field = field_of(name)
    assert field.lifted.dimension == len(x) + len(field.added) <= most
    z, h = field.lift(x), 2.0**-20
    np.testing.assert_allclose(field(x), f(x), rtol=1e-12)
    np.testing.assert_allclose(vector_field(field, x), f(x), rtol=1e-12)
    # The lifted rates are those of the added variables along the motion.
    along = (field.lift(x + h * field(x)) - field.lift(x - h * field(x))) / (2 * h)
    np.testing.assert_allclose(field.lifted(z), along, rtol=1e-6, atol=1e-8)


ORDERS = {"auto": (2, 32), "order4": (4, 32), "order6": (6, 16), "order8": (8, 12)}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", ["pendulum", "kepler", "predator and prey", "brusselator"])
@pytest.mark.parametrize("method", [*ORDERS, "extrapolated"])
def test_steps_have_the_order_of_the_method(name, method):
    f, x, _ = FIELDS[name]
    field, time = field_of(name), 2.0
    exact = solve_ivp(lambda t, y: f(y), (0, time), x, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    order, steps = ORDERS.get(method, (10, 8))
    errors = []
    for n in (steps, 2 * steps, 4 * steps):
        run = iterate(field, x, time / n, n, save_every=None, method=method)
        assert run.status == Status.OK
        errors.append(abs(run.final - exact).max())
    assert errors[-1] < 1e-12 or 2 ** (order - 0.7) < errors[1] / errors[2] < 2 ** (order + 3)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "order6", "extrapolated"])
def test_the_jacobian_is_that_of_differences(method):
    for name in ("pendulum", "kepler", "roots", "powers"):
        field, x = field_of(name), np.array(FIELDS[name][1])
        h, ends = 1e-5, []
        for sign in (1, -1):
            ends.append(step(field, x + sign * h * np.eye(len(x)), 0.1, method=method))
        slopes = ((ends[0] - ends[1]) / (2 * h)).T
        np.testing.assert_allclose(jacobian(field, x, 0.1, method=method), slopes, atol=1e-8)


def test_bits_depend_on_nothing_but_the_trajectory():
    family = LiftedField.from_function(predator_prey, "N P", K=np.linspace(2, 4, 21))
    starts = np.random.default_rng(3).uniform(0.3, 2, (21, 2))
    for method in ("auto", "order4", "extrapolated"):
        run = iterate(family, starts, 0.1, 30, method=method, threads=1)
        again = iterate(family, starts, 0.1, 30, method=method, threads=TWO_THREADS)
        np.testing.assert_array_equal(again.x, run.x)
        for k in (0, 7, 20):
            alone = iterate(family[k], starts[k], 0.1, 11, method=method).extend(19)
            np.testing.assert_array_equal(alone.x, run.x[:, k])
        some = iterate(family[3:6], starts[3:6], 0.1, 30, method=method)
        np.testing.assert_array_equal(some.x, run.x[:, 3:6])


def test_a_quadratic_right_hand_side_has_the_bits_of_the_quadratic_field():
    def lorenz(x):
        return 10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]

    lifted, quadratic = (kind.from_function(lorenz, 3) for kind in (LiftedField, QuadraticField))
    assert lifted.added == {}
    for method in ("auto", "order4"):
        runs = [iterate(each, [1, 2, 3], 0.01, 50, method=method) for each in (lifted, quadratic)]
        np.testing.assert_array_equal(runs[0].x, runs[1].x)


def test_where_a_definition_has_no_value_a_trajectory_ends_alone():
    inverse = LiftedField.from_function(lambda x: (1 / x[0],), "x")
    run = iterate(inverse, [[0.0], [1.0], [-2.0]], 0.1, 10, on_singular="ignore")
    assert run.status.tolist() == [Status.NONFINITE, 0, 0]
    assert run.failed_at.tolist() == [1, -1, -1]
    np.testing.assert_allclose(run.final[1:, 0], [math.sqrt(3), -math.sqrt(6)], rtol=1e-3)
    logarithm = LiftedField.from_function(lambda x: (np.log(x[0]), np.sqrt(x[0])), 2)
    run = iterate(logarithm, [[-1.0, 0.0], [2.0, 1.0]], 0.1, 5, on_singular="ignore")
    assert run.status.tolist() == [Status.NONFINITE, 0]


@pytest.mark.parametrize("method", ["auto", "order4", "extrapolated"])
@pytest.mark.parametrize(
    ("f", "x", "definition"),
    [
        (np.log, 0.0, "log(x)"),
        (np.log, -1.0, "log(x)"),
        (lambda x: 1 / x, 0.0, "1/x"),
        (np.sqrt, -1.0, "x**(-1/2)"),
        (np.exp, 800.0, "exp(x)"),
    ],
)
def test_a_start_without_a_value_is_named(f, x, definition, method):
    """It is no pole that was passed, whatever a determinant of NaN says."""
    field = LiftedField.from_function(lambda z: (f(z[0]) - z[1] / 2, z[0]), "x y")
    starts, told = (
        [[2.0, 1.0], [x, 1.0]],
        rf"{re.escape(definition)} has no finite value at the start",
    )
    with pytest.warns(SingularStepWarning, match=rf"1 at step 1; {told} of trajectory 1$"):
        run = iterate(field, starts, 1 / 64, 5, method=method)
    assert (run.failed_at.tolist(), run.first_pole.tolist()) == ([-1, 1], [-1, -1])
    with pytest.warns(
        PoleWarning,
        match=rf"1 of 2 solutions end; first: 1 near t = 0; {told} of trajectory 1$",
    ):
        states = flow(field, starts, [0.0, 0.1])
    np.testing.assert_array_equal(np.isnan(states[..., 0]), [[False, False], [False, True]])
    values = field(starts)
    np.testing.assert_array_equal(np.isnan(values), [[False, False], [True, True]])
    np.testing.assert_allclose(values[0], [f(2.0) - 0.5, 2.0])


def test_poles_are_those_of_the_given_equations():
    # det A of the lifted field is negative at nearly all of these states.
    for eps in (1 / 8, 1 / 16):
        assert iterate(field_of("hill"), [0.1], eps, 200).status == Status.OK
    assert iterate(field_of("kepler"), [0.4, 0, 0, 2], 1 / 64, 800).status == Status.OK
    # x' = x**2 + x / (1 + x**2) from 1 ends near t = 0.75.
    blow_up = LiftedField.from_function(lambda x: (x[0] ** 2 + x[0] / (1 + x[0] ** 2),), "x")
    run = iterate(blow_up, [1.0], 0.02, 80, on_singular="ignore")
    assert 0.7 < run.first_pole * 0.02 < 0.95


def test_positive_components_keep_their_signs_or_it_is_told():
    field = LiftedField.from_function(lambda x: (-x[0] * (1 + 40 * x[0] / (1 + x[0])),), "x")
    run = iterate(field, [3.0], 1.0, 3, on_singular="ignore")
    assert (run.x < 0).any()
    assert run.status == Status.PASSED_POLE


@pytest.mark.parametrize("method", ["auto", "order8"])
def test_real_powers_near_0(method):
    """1/x is a variable of x**2.5163: a state 0 is refused, and small ones lose no digits."""
    field = LiftedField.from_function(lambda x: (-(x[0] ** 2.5163),), "x")
    x = np.array([1.0, 1e-3, 1e-30, 1e-100, 0.0, -1.0])[:, np.newaxis]
    run = iterate(field, x, 1 / 8, 40, method=method, on_singular="ignore")
    exact = (x[:4] ** -1.5163 + 1.5163 * 5) ** (-1 / 1.5163)
    np.testing.assert_allclose(run.final[:4], exact, rtol=1e-3 if method == "auto" else 1e-9)
    assert run.status.tolist() == [0, 0, 0, 0, Status.NONFINITE, Status.NONFINITE]


@pytest.mark.parametrize(
    "method", [pytest.param("order4", marks=pytest.mark.slow), "order8", "extrapolated"]
)
def test_rounding_is_no_pole(method):
    """A substrate that decays to 0 keeps its sign, though terms of 0.6 u - 2 cancel."""
    field = LiftedField.from_function(lambda x: (-2 * x[0] / (x[0] + 0.3),), "x")
    starts, eps, steps = np.linspace(0.1, 2.0, 9)[:, np.newaxis], 0.2, 60
    run = iterate(field, starts, eps, steps, method=method)
    assert run.ok
    assert (run.status == Status.OK).all()
    assert (run.x > 0).all()
    assert (run.x[-10:] < 1e-15).all()
    exact = 0.3 * lambertw(starts / 0.3 * np.exp((starts - 2 * eps) / 0.3)).real
    np.testing.assert_allclose(run.x[1], exact, rtol=0, atol=1e-4)
    for k in 0, 8:
        alone = iterate(field, starts[k], eps, 25, method=method)
        alone = iterate(field, alone.final, eps, steps - 25, method=method)
        np.testing.assert_array_equal(alone.final, run.final[k])
    negative = iterate(field, -starts[:2] / 10, eps, steps, method=method)
    assert (negative.status == Status.OK).all()
    assert (negative.x < 0).all()
    fast = LiftedField.from_function(lambda x: (-2 * x[0] * x[1] / (x[0] + 0.3), -x[1]), "x y")
    faster = iterate(fast, np.insert(starts[::8], 1, 1e6, axis=1), eps / 1e6, steps, method=method)
    assert (faster.status == Status.OK).all()
    if not config.DISABLE_JIT:
        x = starts[:1].copy()
        assert (after(system(field, eps, method=method), x, steps) == Status.OK).all()
        np.testing.assert_array_equal(x, run.final[:1])
    long = iterate(field, starts, 2.0, 9, method="order8", on_singular="ignore")
    assert (long.status[1:] == Status.PASSED_POLE).all()
    if not config.DISABLE_JIT and method == "order8":
        first = iterate(field, starts, 2.0, 1, method=method, on_singular="ignore")
        assert Status.PASSED_POLE in first.status
        np.testing.assert_array_equal(
            after(system(field, 2.0, method=method), starts, 1), first.status
        )


def test_a_parameter_as_exponent_is_a_real_power():
    family = LiftedField.from_function(lambda x, m: (-(x[0] ** m),), "x", m=[2.0, 3.0])
    assert family.added == {"u1": "x**m", "u2": "1/x"} | family.added
    with pytest.warns(SingularStepWarning, match=r"undefined at x = 0: make one field for each n$"):
        iterate(family, [0.0], 0.1, 2)
    with pytest.warns(SingularStepWarning, match=r"no finite value at the start of trajectory 0$"):
        iterate(LiftedField.from_function(lambda x: (x[0] ** 0.3,), "x"), [0.0], 0.1, 2)


@njit
def after(system, x, steps):
    """Take some steps of states (batch, D), in place; return the last statuses."""
    status, memory = np.zeros(len(x), np.int64), work(system)
    for k in range(len(x)):
        for _ in range(steps):
            status[k] = step_system(system, x[k], x[k], memory)
    return status


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="needs machine code")
@pytest.mark.slow
def test_compiled_loops_take_the_same_steps():
    family = LiftedField.from_function(predator_prey, "N P", K=[2.0, 4.0])
    inverse = LiftedField.from_function(lambda x: (1 / x[0],), "x")
    beyond = LiftedField.from_function(
        lambda x: (np.exp(x[0]),), "x"
    )  # det(1 - h f') < 0, no signs
    for method in ("auto", "order4", "extrapolated"):
        for field, starts, eps in (
            (field_of("kepler"), np.array([FIELDS["kepler"][1], [1.0, 0, 0, 1]]), 1 / 16),
            (beyond, np.array([[-3.0], [1.0]]), 2.0),
            (family[1], np.array([[1.0, 1.0], [3.0, 0.1], [0.0, 2.0]]), 3.0),
            (inverse, np.array([[1.0], [0.0]]), 0.1),
        ):
            run, x = iterate(field, starts, eps, 7, method=method, on_singular="ignore"), starts
            told = np.array([Status.OK] * len(x))
            for n in range(7):
                x = x.copy()
                status = after(system(field, eps, method=method), x, 1)
                np.testing.assert_array_equal(x, run.x[n + 1])
                told = np.where((told == Status.OK) | (status < 0), status, told)
            np.testing.assert_array_equal(told, run.status)
    with pytest.raises(TypeError, match="in its own process alone"):
        pickle.dumps(system(inverse, 0.1))


@pytest.mark.compiled
@pytest.mark.slow
def test_compiled_steps_without_a_plan(monkeypatch):
    """As of fields of many variables, by elimination with pivoting."""
    monkeypatch.setattr("suslov_fast.core.operations.MOST", 0)
    field = LiftedField.from_function(lambda x: (x[1], -S(5 * x[0]) / (1 + x[1] ** 2)), "a b")
    for method in ("auto", "extrapolated"):
        x, out = np.array([1.0, 0.5]), np.array([[1.0, 0.5]])
        assert (after(system(field, 0.1, method=method), out, 40) == Status.OK).all()
        final = iterate(field, x, 0.1, 40, method=method).final
        np.testing.assert_allclose(out[0], final, rtol=1e-12)


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("is_sparse", "methods"),
    [
        (True, ["auto"]),
        *(
            pytest.param(is_sparse, ["auto", "order4", "extrapolated"], marks=pytest.mark.slow)
            for is_sparse in (False, True)
        ),
    ],
)
def test_fields_that_are_too_large_to_plan(rng, monkeypatch, is_sparse, methods):
    """Loops over the terms take the stages; a start is NaN, one passes a pole, one has no word."""
    family = LiftedField.from_function(
        lambda x, a: (x[1] - x[0] ** 3 / a, -S(5 * x[0]) / (1 + x[1] ** 2) + np.log(a + x[0])),
        "x y",
        a=np.linspace(2, 3, 9),
    )
    x0 = rng.uniform(0, 1, (9, 2))
    x0[2], x0[4], x0[5], eps = [np.nan, 0.0], [-9.0, 0.0], [0.6, 0.0], np.full(9, 0.05)
    eps[5] = 1.5

    def found():
        for method in methods:
            run = iterate(family, x0, eps, 7, method=method, save_every=3, on_singular="ignore")
            one = iterate(family[6], x0[6], 0.05, 7, method=method).final
            np.testing.assert_array_equal(one, run.final[6])
            yield from (run.x, run.final, run.status, run.failed_at, run.first_pole)

    planned = [*found()]
    assert (planned[2][[2, 4, 6]] < 0).tolist() == [True, True, False]
    assert planned[4].tolist() == [1 if k == 5 else -1 for k in range(9)]
    monkeypatch.setattr("suslov_fast.core.operations.MOST", -1)
    monkeypatch.setattr("suslov_fast.core.operations.PART_OF_DENSE", 0)
    monkeypatch.setattr("suslov_fast.core.in_calls.is_sparse", lambda *_: is_sparse)
    own, calls = Words.at, []
    monkeypatch.setattr(Words, "at", lambda *given: calls.append(given) or own(*given))
    again = functools.cache(steps_field._lifted_step_of.__wrapped__)
    monkeypatch.setattr(steps_field, "_lifted_step_of", again)
    unplanned = [*found()]
    for one, other in zip(unplanned, planned, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10)
    assert calls
    monkeypatch.setattr("suslov_fast.core.words.runs_code", lambda *_: None)
    for one, other in zip(found(), unplanned, strict=True):  # by NumPy, the same bits
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow_to_compile
@pytest.mark.compiled
def test_long_lists_are_carried_out_by_a_loop(rng, monkeypatch):
    """With the bits of compiled lists: all functions, words of parameters alone, the constant 1."""
    family = LiftedField.from_function(
        lambda x, a: (
            x[1] * np.exp(-(x[0] ** 2)) + np.cbrt(1 + a) + S(a),
            -S(x[0]) / (1 + x[1] ** 2) - np.tan(x[0] / 8) ** 2 - np.arctan(x[1]) * np.sinh(x[0] / 4)
            + np.log(a + x[0]) - (2 + x[0]) ** a + np.tanh(x[1]) * np.cbrt(2 + x[0]),
        ),
        "q p",
        a=np.linspace(2, 3, 9),
    )  # fmt: skip
    x0, eps = rng.uniform(0, 0.5, (9, 2)), np.full(9, 0.02)
    x0[2], x0[4], x0[5], eps[5] = [np.nan, 0.0], [-9.0, 0.0], [1.0, 0.0], 3.0

    def found():
        for method in ("auto", "order4", "extrapolated"):
            run = iterate(family, x0, eps, 7, method=method, save_every=3, on_singular="ignore")
            one = iterate(family[6], x0[6], 0.02, 7, method=method).final
            np.testing.assert_array_equal(one, run.final[6])
            of_system, out = system(family[6], 0.02, method=method), x0[6].copy()
            memory = work(of_system)
            for _ in range(7):
                step_system(of_system, out, out, memory)
            np.testing.assert_array_equal(one, out)
            yield from (run.x, run.final, run.status, run.failed_at, run.first_pole)

    usual = [*found()]
    assert usual[4].max() > 0
    monkeypatch.setattr("suslov_fast.core.operations.MANY", 0)
    calls, own = [], listed_code.carry_out
    monkeypatch.setattr("suslov_fast.core.words.carry_out", lambda *a: calls.append(own(*a)))
    for k, (one, other) in enumerate(zip(found(), usual, strict=True)):
        if k < 10:
            np.testing.assert_array_equal(one, other)
        else:  # columns are combined from states
            np.testing.assert_allclose(one, other, rtol=1e-13)
    assert calls


def test_oscillators_that_are_all_coupled_are_refused_beyond_a_number(monkeypatch):
    """N phases have N (N - 1) sines and cosines, each with 2 (N - 1) terms in its derivative."""
    N = 6
    monkeypatch.setattr("suslov_fast.bodies.lifting.MOST_TERMS", N * (N - 1) * 2 * (N - 1) - 1)
    match = r"^f: the derivatives .* some 300 terms, and at most 299 .*: use SciPy's solve_ivp$"
    with pytest.raises(ValueError, match=match):
        LiftedField.from_function(lambda x: [sum(S(other - each) for other in x) for each in x], N)


def test_a_system_needs_machine_code(monkeypatch):
    monkeypatch.setattr("suslov_fast.core.lifted_system.code_of", lambda *_, **__: None)
    with pytest.raises(RuntimeError, match=r"^body: steps of a LiftedField need machine code here"):
        system(field_of("pendulum"), 0.1)


def test_dictionaries_hold_the_equations_as_text():
    family = LiftedField.from_function(predator_prey, "N P", K=[2.0, 3.0, 4.0])
    hamiltonian = LiftedField.from_hamiltonian(lambda x: x[1] ** 2 / 2 - C(x[0]), "q p")
    for field in (family, family[1], hamiltonian, field_of("double pendulum"), field_of("kepler")):
        again = body_from_dict(field.to_dict())
        assert again == field
        assert hash(again) == hash(field)
        assert pickle.loads(pickle.dumps(field)) == field
        np.testing.assert_array_equal(again.lifted.terms[1], field.lifted.terms[1])
    assert float(energy(hamiltonian, [0.0, 1.0])) == -0.5
    assert repr(hamiltonian) == "LiftedField(q' = p, p' = -sin(q), H = 1/2*p**2 - cos(q))"
    assert family.to_dict()["equations"][1] == "N*P*u1 - 1/3*P"


@pytest.mark.parametrize(
    "text",
    ["__import__('os')", "q.real", "[q]", "lambda: q", "eval(q)", "q if q else p", "z", "9**9**9"],
)
def test_texts_are_read_by_a_grammar_of_their_own(text):
    saved = LiftedField.from_function(lambda x: (x[1], -S(x[0])), "q p").to_dict()
    with pytest.raises(ValueError, match=r"equations: .*(not allowed|cannot be read)"):
        LiftedField.from_dict(saved | {"equations": [text, "p"]})


@pytest.mark.parametrize("text", ["exp(q, p)", "exp()", "q/(p - p)", "1/0", "sqrt(-1)"])
def test_texts_without_a_value_are_quoted(text):
    saved = LiftedField.from_function(lambda x: (x[1], -S(x[0])), "q p").to_dict()
    quoted = r"coefficients|sqrt" if text == "sqrt(-1)" else re.escape(repr(text))
    for change in ({"equations": [text, "p"]}, {"definitions": {"u1": text, "u2": "cos(q)"}}):
        with pytest.raises(ValueError, match=quoted):
            LiftedField.from_dict(saved | change)


def two(f):
    return lambda: LiftedField.from_function(f, "x y")


def of_a(f):
    return lambda: LiftedField.from_function(f, "x", a=[0.5, 2.0])


def test_a_single_field_may_branch_on_its_parameters():
    def f(x, a):
        return S(x[0]) if a > 1 else x[0], np.where(a > 1, S(x[0]), x[1]) * abs(a)

    for a, equations in ((2, "x' = sin(x), y' = 2*sin(x)"), (-2.0, "x' = x, y' = 2*y")):
        assert repr(LiftedField.from_function(f, "x y", a=a)) == f"LiftedField({equations})"


def test_long_fractions_are_rounded_for_readers_alone():
    mu = 0.012277471
    field = LiftedField.from_function(lambda x: (1 / np.sqrt((x[0] + mu) ** 2 + 1),), "x")
    assert "1.00015" in repr(field)
    assert "1.00015" in field.added["u1"]
    assert body_from_dict(field.to_dict()) == field
    field = LiftedField.from_function(lambda x: (np.log10(2 + x[0] ** 2),), "x")
    assert repr(field) == "LiftedField(x' = 0.434294*log(x**2 + 2))"
    assert field.to_dict()["equations"] == [f"{math.log10(math.e)}*u1"]


@pytest.mark.parametrize(
    "f",
    [
        lambda x, a, b, c: (-c * S(x[0]) - a * (b * (c * x[0])),),  # letters that round once
        lambda x, a, b, c: (a * (c * (x[0] + b)) + 0.1 * a,),
        lambda x, a, b, c: (b + 1 / a - x[0] / b + (-b) * (a * c) * x[0],),
        lambda x, a, b, c: ((1 + x[0] ** 2) ** (-b) * np.sqrt(2) * a + (a + 1) ** 2 * x[0],),
        lambda x, a, b, c: ((1.5 + C(-b * x[0])) ** (-b) / 3 + S((a - c) - x[0]),),
        lambda x, a, b, c: ((2.5 + 0 * x[0]) ** 0.37 * C((a - c) - x[0]) * (-0.3) ** 2,),
    ],
)
def test_texts_of_families_are_read_to_the_bit(rng, f):
    """Their texts, too, by which a store knows its run."""
    a, b, c = rng.uniform(0.5, 2, (3, 40))
    family = LiftedField.from_function(f, "x", a=a, b=b, c=c)
    found = body_from_dict(family.to_dict())
    assert found == family
    assert found.to_dict() == family.to_dict()
    np.testing.assert_array_equal(step(found, [0.3], 0.1), step(family, [0.3], 0.1))


def fills_an_array(x):
    derivative = np.zeros(2)
    derivative[0] = x[1]
    return derivative


def needs_too_many(x):
    u = np.exp(S(x[0] * x[1]) * C(x[0] + x[1])) / (1 + x[0] ** 2 * x[1] ** 5) ** 0.7
    return u + np.tanh(x[0] * x[1] ** 2), np.log(2 + x[0] ** 4 * np.cosh(x[1])) * np.hypot(u, x[0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (two(lambda x: (abs(x[0]), x[1])), r"of x: it is not smooth: write np\.sqrt\(x\*\*2"),
        (two(lambda x: (np.sign((0.3 - x[0]) / 3), x[1])), r"calls sign of -1/3\*x \+ 0.1: it"),
        (two(lambda x: (np.floor(x[0]), x[1])), "calls floor of x: .* use SciPy's solve_ivp"),
        (two(lambda x: (np.maximum(x[0], 0), x[1])), "calls maximum"),
        (
            two(lambda x: (x[0] if x[0] > 0 else 0, x[1])),
            r"compares x, .* write a step as \(1 \+ np\.tanh",
        ),
        (two(lambda x: (np.arctan2(x[0], x[1]), x[1])), r"np\.arctan\(y/x\) .* make the angle"),
        (two(lambda x: (math.exp(-x[0]), x[1])), r"write np\.exp, as in np\.exp\(-x\[0\]\)"),
        (two(lambda x: (exp(-x[0]), x[1])), r"write np\.exp, as in np\.exp\(-x\[0\]\)"),
        (two(lambda x: (math.floor(2.5) * math.exp(-x[0]), x[1])), r"write np\.exp, as in"),
        (two(lambda x: (float(x[0]), x[1])), "float has no rule"),
        (two(lambda x: (np.deg2rad(x[0]), x[1])), r"calls deg2rad.* write np\.pi/180 \* x"),
        (two(lambda x: (round(x[0]), x[1])), "calls round of x: it is not smooth"),
        (two(lambda x: (int(x[0]), x[1])), "int has no rule"),
        (two(fills_an_array), r"derivative\[0\] = x\[1\]: an array of floats.* return a tuple"),
        (two(lambda t, y: (y[1], S(t))), r"\(\*f\(s\[-1\], s\[:-1\]\), 1\), \"x y t\""),
        (two(lambda y, t: (y[1], math.cos(t))), r"f\(s\[:-1\], s\[-1\]\), 1\), \"x y t\""),
        (two(lambda t, y: (y[1], S(y[0]))), r"pass lambda x: f\(None, x\)"),
        (two(needs_too_many), r"more than 200 variables would be added, .* sin\(x2 - x1\)"),
        (of_a(lambda x, a: (S(x[0]) if a > 1 else x[0],)), "compares the parameter a.* one field"),
        (of_a(lambda x, a: (S(x[0]) * max(a, 1),)), "compares the parameter a"),
        (of_a(lambda x, a: (S(x[0]) if a else 1,)), "asks whether a is true"),
        (of_a(lambda x, a: (S(x[0]) * abs(a),)), "calls absolute of the parameter a.* one field"),
    ],
)
def test_what_has_no_rule_is_named_in_words_of_the_user(call, message):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


@pytest.mark.parametrize("function", [f for f in HOW if f not in ("expit", "logistic")])
def test_what_is_advised_for_functions_without_a_rule(function):
    advised = eval(f"lambda x, y: {HOW[function].partition(' for ')[0]}", {"np": np})
    x = [1.25, 0.5] if function == "arccosh" else [0.25, 0.5]
    arguments = {"arctan2": x[::-1], "logaddexp": x}.get(function, x[:1])
    field = LiftedField.from_function(lambda s: (advised(*s), -s[1]), "x y")
    assert field(x)[0] == pytest.approx(getattr(np, function)(*arguments), rel=1e-14)


def test_the_angle_as_a_variable():
    """Its derivative is the one that is advised in place of arctan2."""
    x, y, h = 0.5, -0.75, 1e-6

    def with_angle(s):
        x, y, a = s
        dx, dy = y, -a
        return dx, dy, (x * dy - y * dx) / (x**2 + y**2)

    dx, dy, da = LiftedField.from_function(with_angle, "x y a")([x, y, np.arctan2(y, x)])
    assert "(x*y' - y*x')/(x**2 + y**2)" in HOW["arctan2"]
    ahead, behind = np.arctan2(y + h * dy, x + h * dx), np.arctan2(y - h * dy, x - h * dx)
    assert da == pytest.approx((ahead - behind) / (2 * h), rel=1e-8)


def pendulum_of(x, g):
    return x[1], -g * S(x[0])


def test_what_a_lifted_field_has_not_is_refused_with_what_to_use():
    pendulum = field_of("pendulum")
    for function, advice in ((matrix, "use jacobian"), (modified_energy, "use energy")):
        with pytest.raises(TypeError, match=advice):
            function(pendulum, [1.0, 0.0], 0.1)


def test_high_powers():
    """Of a Hill function, and powers that are variables of their own: u' by the chain rule."""
    for f in (
        lambda x: (1 / (1 + x[0] ** 20) - x[0],),
        *(lambda x, n=n: (-(x[0] ** n),) for n in (40, 150, -120, 150.5)),
    ):
        field, x, h = LiftedField.from_function(f, 1), np.array([1.02]), 1e-6
        assert body_from_dict(field.to_dict()) == field
        assert field.lifted.dimension <= 12
        rate = f(x)[0]
        slopes = (field.lift(x + h * rate) - field.lift(x - h * rate)) / (2 * h)
        found = vector_field(field.lifted, field.lift(x))
        np.testing.assert_allclose(found[0], rate, rtol=1e-13)
        np.testing.assert_allclose(found, slopes, rtol=1e-5, atol=1e-7)
    assert LiftedField.from_function(lambda x: (x[0] ** (10**9),), 1).added["u2"] == "1/x1"


@pytest.mark.parametrize("name", ["hyperbolic", "logarithm", "tangent", "roots", "powers"])
def test_slopes_of_added_variables_are_their_derivatives(name):
    field, h = field_of(name), 2.0**-18
    x = np.array(FIELDS[name][1]) + 0.1
    steps = h * np.eye(len(x))
    wanted = (field.lift(x + steps) - field.lift(x - steps)).T / (2 * h)
    np.testing.assert_allclose(field._slopes(x), wanted, rtol=1e-5, atol=1e-6)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "method", "fractions", "h"),
    [
        ("brusselator", "auto", [1.0], -0.2),
        ("brusselator", "order8", FRACTIONS[8], -0.2),
        ("three bodies", "auto", [1.0], 0.5),
    ],
)
def test_poles_are_told_by_the_determinant_of_the_given_equations(rng, name, method, fractions, h):
    """det(1 - h f'(x)) < 0, with h half of the longest sub-step."""
    field, eps = field_of(name), 2 * h / max(map(abs, fractions))
    x = rng.uniform(0.2, 2 if name == "three bodies" else 3, (300, field.dimension))
    run = iterate(field, x, eps, 1, method=method, on_singular="ignore")
    steps = 2.0**-18 * np.eye(field.dimension)[:, None]
    differences = vector_field(field, x + steps) - vector_field(field, x - steps)
    slopes = differences.transpose(1, 2, 0) * 2.0**17
    determinants = np.linalg.det(np.eye(field.dimension) - h * slopes)
    is_clear = (run.status >= 0) & (abs(determinants) > 1e-4)
    assert is_clear.sum() > 270
    assert 10 < (determinants < 0).sum() < 280
    assert ((run.status == Status.PASSED_POLE) == (determinants < 0))[is_clear].all()


@pytest.mark.parametrize("rate", [np.sin, lambda x: x - x**3])
def test_lattices_have_more_than_200_variables(rng, rate):
    def f(x):
        return rate(np.array(x)) + np.roll(x, 1)

    D = 101
    field, x = LiftedField.from_function(f, D), rng.normal(size=D)
    assert field.lifted.dimension == (3 * D if rate is np.sin else 2 * D)
    assert np.allclose(vector_field(field.lifted, field.lift(x))[:D], f(x), rtol=1e-13, atol=1e-13)


def test_functions_of_negative_arguments_need_no_variables(rng):
    """Kuramoto's oscillators: a sine and a cosine for each pair, not for each ordered pair."""

    def kuramoto(x):
        return [w + sum(np.sin(other - own) for other in x) for w, own in enumerate(x)]

    field, x = LiftedField.from_function(kuramoto, 6), rng.normal(size=(5, 6))
    assert field.lifted.dimension == 6 + 2 * 15
    rates = np.arange(6) + np.sin(x[:, None] - x[:, :, None]).sum(axis=2)
    assert np.allclose(vector_field(field, x), rates, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("name", "sin tan sinh tanh arctan cbrt cos cosh".split())
def test_odd_and_even_functions(rng, name):
    f, x = getattr(np, name), rng.uniform(0.1, 1, (5, 2))

    def both(x):
        return x[1], 2 * f(-x[0]) - f(x[0])

    field = LiftedField.from_function(both, 2)
    alone = LiftedField.from_function(lambda x: (x[1], f(-x[0])), 2)
    assert field.lifted.dimension == alone.lifted.dimension
    assert np.allclose(vector_field(field, x), np.stack(both(x.T), 1), rtol=1e-13)
    assert body_from_dict(field.to_dict()) == field


def test_a_parameter_and_its_inverse_cancel():
    """The derivative of sin(x / K) has the factor K / K."""
    K, x = np.array([0.5, 3.0]), np.array([[1.0], [2.0]])
    field = LiftedField.from_function(lambda x, K: (K * S(x[0] / K),), 1, K=K)
    z, h = field.lift(x), 2.0**-20
    along = (field.lift(x + h * field(x)) - field.lift(x - h * field(x))) / (2 * h)
    np.testing.assert_allclose(field.lifted(z), along, rtol=1e-8)


@pytest.mark.compiled
def test_code_that_writes_words_behind_a_state():
    """As `lift`; it returns 2 beyond a pole of the given equations."""
    field = LiftedField.from_function(predator_prey, "N P", K=[2.0, 4.0])[1]
    constants = system(field, 4.0)
    # Users may keep the system, so its code is never freed.
    lasting = {code for (*_, lasts), code in machine_code._codes.items() if lasts}
    assert {constants.address, constants.lift} <= lasting
    write = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 2)(constants.lift)
    for state, code in (([1.0, 1.0], 0), ([0.1, 0.1], 2)):
        words = np.array([*state, *[np.nan] * len(field.added)])
        assert write(words.ctypes.data, constants.table[0].ctypes.data) == code
        np.testing.assert_allclose(words, field.lift(state), rtol=1e-15)
        N, P = state
        slopes = [
            [1 - N / 2 - P / (1 + N) ** 2, -N / (1 + N)],
            [P / (1 + N) ** 2, N / (1 + N) - 1 / 3],
        ]
        assert (np.linalg.det(np.eye(2) - 2 * np.array(slopes)) < 0) == (code == 2)
