"""Motions over a time as steps of compiled loops: the bits and statuses of `flow`."""

import pickle

import numpy as np
import pytest
from hybrid import SYSTEMS
from numba import njit, prange
from systems import oregonator, van_der_pol

import suslov_fast as sf
from suslov_fast import Event, Field, compiled
from suslov_fast.compiled import step_system, system, with_parameters, with_time, work

# Some of each kind are compiled in the ordinary suite, too.
FAST = (
    "test_has_the_bits_of_flow[others0-smooth]",
    "test_has_the_bits_of_flow[others0-bounces]",
    "test_refuses_the_memory_of_another_system",
)
pytestmark = [
    pytest.mark.slow_to_compile(but=FAST),
    pytest.mark.filterwarnings("ignore::suslov_fast.IntegrationWarning"),
]

PENDULUM = Field(lambda x, u: (x[1], u - np.sin(x[0])), "q v", u=0.0)
VAN_DER_POL = Field(van_der_pol, 2, mu=1000.0)
BALL = Field(lambda x, g: (x[1], -g), "h v", g=9.81)
DRIVEN = Field(lambda s, w: (s[1], -(s[0] ** 3) + np.cos(w * s[2]), 1.0), "x v t", w=1.3)
BOUNCE = Event("h", direction=-1, to=lambda x: (x[0], -0.9 * x[1]))
CASES = {
    "smooth": (PENDULUM, [1.0, 0.3], (0.0, 1e-3, 20.0, -3.0), ()),
    "stiff in parts": (VAN_DER_POL, [2.0, 0.5], (1.0, 2000.0), ()),  # turns often
    "a late clock": (DRIVEN, [0.4, 0.1, 1.7e9], (0.0, 5.0, -5.0), ()),
    "functions of parameters": (
        Field(lambda x, a, b: (np.sin(a * b) * x[1], -np.exp(-a / b) * x[0]), 2, a=0.3, b=0.7),
        [1.0, 0.5],
        (4.0,),
        (),
    ),
    "a pole": (Field(lambda x: (x[0] ** 2,), 1), [0.5], (1.0, 20.0), ()),
    "no value": (PENDULUM, [np.nan, 1.0], (1.0,), ()),
    "bounces": (BALL, [1.0, 0.0], (0.1, 3.0), BOUNCE),
    "terminal": (BALL, [1.0, 0.0], (3.0,), [BOUNCE, Event("h", direction=1, terminal=True)]),
    **{
        name: (Field(own.f, own.names, **own.parameters), own.start, (own.time,), own.events)
        for name, own in SYSTEMS.items()
        if name in ("jumps of an acceleration", "a table of the state", "doses")
    },
    "terms": (Field.from_terms([[[0, 1], [0, 0]], [[-1, 0], [0, 0]]]), [0.3, 0.2], (7.0,), ()),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("others", [{}, {"atol": 1e-10}, {"stiff": True}, {"max_step": 50.0}])
def test_has_the_bits_of_flow(name, others):
    field, x0, times, events = CASES[name]
    first = system(field, time=1.0, events=events, **others)
    out, memory = np.empty(len(x0)), work(first)
    for time in times:
        own = system(field, time=time, events=events, **others) if time < 0 else first
        own = with_time(own, time)
        motion = sf.flow(field, x0, time=time, events=events, **others)
        for _ in range(2):  # the memory is as good as new
            assert step_system(own, np.array(x0), out, memory) == motion.status
            assert out.tobytes() == motion.final.tobytes()
        if motion.status != 0 and not np.isnan(x0[0]):
            assert compiled.end(own, memory) == motion.end


@njit
def controlled(system, x, steps):
    memory, u = work(system), np.zeros(1)
    own = with_parameters(system, u)
    for k in range(steps):
        u[0] = -0.5 * x[1] - 0.1 * x[0]
        own = with_time(own, 0.1 + 0.01 * (k % 3))
        step_system(own, x, x, memory)
    return x


def test_parameters_and_time_change_within_a_loop():
    x = y = np.array([1.0, 0.3])
    for k in range(20):
        own = PENDULUM.with_parameters(u=-0.5 * y[1] - 0.1 * y[0])
        y = sf.flow(own, y, time=0.1 + 0.01 * (k % 3)).final
    assert controlled(system(PENDULUM, time=1.0), x.copy(), 20).tobytes() == y.tobytes()


@pytest.mark.parametrize("name", ["smooth", "a late clock", "bounces", "terminal", "a pole"])
@pytest.mark.parametrize("others", [{}, {"atol": 1e-10}])
def test_derivatives_have_the_bits_of_flow(name, others):
    field, x0, times, events = CASES[name]
    names, D = ("x0", *field.parameters), len(x0)
    others = {"events": events, "derivatives": names} | others
    own = system(field, time=1.0, **others)
    C, memory, x = own.dimension // D - 1, work(own), np.zeros(own.dimension)
    for time in times:
        if time < 0.0:
            own = system(field, time=time, **others)
        motion, x[:D] = sf.flow(field, x0, time=time, **others), x0
        assert step_system(with_time(own, time), x, x, memory) == motion.status
        np.testing.assert_array_equal(x[:D], motion.final)
        each = {name: values[-1] for name, values in motion.derivatives.items()}
        if motion.status == sf.Status.STOPPED:
            each = {name: of.states[-1] for name, of in motion.events.derivatives.items()}
        columns = [each["x0"], *(each[name][:, np.newaxis] for name in names[1:])]
        np.testing.assert_array_equal(x[D:].reshape(D, C), np.concatenate(columns, axis=1))


@njit
def shoot(system, target):
    """Newton's method for the start (0, v) from which the motion is at `target`."""
    memory, x, v = work(system), np.empty(system.dimension), 0.0
    for _ in range(20):
        x[:2] = 0.0, v
        step_system(system, x, x, memory)
        v += (target - x[0]) / x[3]
    return v, x[2:].copy()


def test_shooting_in_a_loop():
    """x'' = w: x = v t + w t**2 / 2, whose derivatives are known."""
    falls = Field(lambda x, w: (x[1], w + 0.0 * x[0]), 2, w=-9.81)
    v, derivatives = shoot(system(falls, time=2.0, derivatives=("w", "x0")), 1.0)
    assert abs(v - (1.0 + 2.0 * 9.81) / 2.0) < 1e-12
    right = [1.0, 2.0, 2.0, 0.0, 1.0, 2.0]  # of x by (x, v) and w, then of v
    np.testing.assert_allclose(derivatives, right, rtol=1e-12, atol=1e-12)


@njit(parallel=True)
def in_threads(system, x):
    for k in prange(len(x)):
        step_system(system, x[k], x[k], work(system))
    return x


def test_threads_have_memory_of_their_own():
    x = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    states = sf.flow(PENDULUM, x, time=2.0).final
    assert np.array_equal(in_threads(system(PENDULUM, time=2.0), x), states)


def test_parameters_are_those_of_the_field():
    for a, b in np.random.default_rng(1).uniform(0.1, 3, (5, 2)):
        field, x0, (time,), _ = CASES["functions of parameters"]
        own, out = system(field, time=time), np.empty(2)
        step_system(own._replace(parameters=np.array([a, b])), np.array(x0), out, work(own))
        right = sf.flow(field.with_parameters(a=a, b=b), x0, time=time).final
        np.testing.assert_array_equal(out, right)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("eps must be left out beside time", lambda: system(BALL, eps=0.1, time=1.0)),
        ("method must be left out", lambda: system(BALL, time=1.0, method="order4")),
        ("rtol must be left out", lambda: system(BALL, eps=0.1, rtol=1e-3)),
        ("time must be a number", lambda: system(BALL, time=[1.0, 2.0])),
        ("as many", lambda: with_parameters(system(BALL, time=1.0), np.zeros(2))),
        ("other direction", lambda: with_time(system(BALL, time=1.0), -1.0)),
        ("in each process", lambda: pickle.dumps(system(BALL, time=1.0))),
        ("single field", lambda: system(BALL.with_parameters(g=[1.0, 2.0]), time=1.0)),
    ],
)
def test_refuses_arguments_of_the_other_kind(message, call):
    with pytest.raises((TypeError, ValueError), match=message):
        call()


def test_refuses_the_memory_of_another_system():
    with pytest.raises(ValueError, match="that of the system"):
        step_system(system(PENDULUM, time=1.0), *np.ones((2, 2)), work(system(BALL, time=1.0)))


@pytest.mark.parametrize("options", [{}, {"stiff": True}])
def test_components_that_lose_digits_and_grow_again(options):
    field = Field(oregonator, "a b c")
    own, x0 = {"time": 320.0, "rtol": 1e-6} | options, np.array([1.0, 2.0, 3.0])
    right, exact = (sf.flow(field, x0, **own | others) for others in ({}, {"atol": 0.0}))
    assert right.steps > exact.steps  # of two tries
    np.testing.assert_allclose(right.final, exact.final, rtol=1e-5)
    own.pop("time")
    motion = system(field, time=320.0, **own)
    memory = work(motion)
    for out in (np.empty(3), x0):  # in place, too
        assert step_system(motion, x0, out, memory) == right.status == sf.Status.OK
        np.testing.assert_array_equal(out, right.final)


def test_bodies_do_not_rest_in_loops():
    """The motion ends there with ACCUMULATES, where `flow` goes on with modes."""
    motion, out = system(BALL, time=100.0, events=BOUNCE), np.empty(2)
    memory = work(motion)
    assert step_system(motion, np.array([1.0, 0.0]), out, memory) == sf.Status.ACCUMULATES
    assert np.isnan(out).all()
    right = np.sqrt(2 / 9.81) * (1 + 2 * 0.9 / (1 - 0.9))
    assert abs(compiled.end(motion, memory) / right - 1) < 1e-8
