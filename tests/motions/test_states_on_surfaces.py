"""Events that leave states on surfaces of other events, against loops with exact fractions."""

import inspect
from contextlib import nullcontext
from fractions import Fraction

import numpy as np
import pytest

from suslov_fast import Event, Field, Status, flow, periodic_orbit

FREE = Field(lambda s: (s[1], 0.0), "x v")
N = 60


def exact(x, v, T, events):
    """Return the events (number, time) of x' = v up to time T, and the last state.

    Each event is a level of x, a direction, and a function (x, v) or None. A state on a level
    belongs to the side to which it moves.
    """
    x, v, left, found = Fraction(x), Fraction(v), Fraction(T), []

    def side(k):
        s = x - events[k][0] or v
        return (s > 0) - (s < 0)

    sides = [side(k) for k in range(len(events))]
    while True:
        ahead = [(a - x) / v for a, *_ in events if v and (a - x) / v > 0]
        if not ahead or min(ahead) > left:
            return found, (x + v * left, v)
        x, left = x + v * min(ahead), left - min(ahead)
        was_there, acts = set(), True
        while acts:
            acts = False
            for k, (level, direction, to) in enumerate(events):
                now, before = side(k), sides[k]
                sides[k] = now
                if now == before or (x == level and k in was_there):
                    continue
                was_there |= {k} if x == level else set()
                if direction in (0, now):
                    found.append((k, T - left))
                    if to is not None:
                        x, v = to(x, v)
                        sides[k], acts = side(k), True
                        was_there -= {k} if sides[k] == before else set()


def compare(motion, loops, way=1):
    """Assert that a motion of a batch has the events and ends of `loops`, results of `exact`."""
    assert motion.ok.all()
    events = motion.events
    for k, (found, (x, v)) in enumerate(loops):
        own = events.trajectory == k
        assert events.which[own].tolist() == [which for which, _ in found]
        right = [way * float(t) for _, t in found]
        np.testing.assert_allclose(events.time[own], right, rtol=1e-10)
        np.testing.assert_allclose(motion.states[-1, k, :2], [float(x), float(v)], atol=1e-9)


def field(sign=1.0):
    return Field(lambda s, **_: (sign * s[1], 0.0), "x v", a=1.0, b=2.0, q=1.0, c=0.0, d=0.0)


def crossing(name, direction, to=None):
    """Return the event at which x passes the parameter `name`."""
    return Event(lambda s, **p: s[0] - p[name], direction=direction, to=to)


# The actions in both guards of a family.
ACTIONS = {
    "exactly": (lambda s, a, q: (a, q * s[1]), lambda s, b, q: (b, q * s[1])),
    "by the width": (lambda s, a, b, q: (s[0] - b + a, q * s[1]),
                     lambda s, a, b, q: (s[0] - a + b, q * s[1])),
    "mirrors": (lambda s, a, b, q: (a + b - s[0], q * s[1]),) * 2,
    "walls": (lambda s, q: (s[0], -q * s[1]),) * 2,
    "refill": (None, lambda s, b: (b, s[1])),
}  # fmt: skip


def in_fractions(action, values):
    """Return an action as a function of x and v."""
    if action is None:
        return None
    own = {name: values[name] for name in [*inspect.signature(action).parameters][1:]}
    return lambda x, v: action((x, v), **own)


def family(rng, name, n=N):
    """Return parameters a < b, q, c, d, and starts of n motions between a and b."""
    a = rng.choice([0.0, 0.3, -1.7], n)
    b = a + rng.choice([0.7, 1.0, *rng.uniform(0.1, 4, 8)], n)
    q = rng.choice([1.0, 0.9, 0.5, 1.1, 1e-5], n)
    if name == "mirrors":
        b = abs(b) + 0.1
        a = -b
    c = np.choose(rng.integers(0, 3, n), [a, b, rng.uniform(a, b)])
    d = np.choose(rng.integers(0, 3, n), [a, b, rng.uniform(a, b)])
    v = (b - a) * rng.choice([-1.0, 1.0, *rng.uniform(-3, 3, 6)], n)
    if name == "refill":
        v = -abs(v)
    x = np.choose(rng.integers(0, 4, n), [a, b, *rng.uniform(a, b, (2, n))])
    return {"a": a, "b": b, "q": q, "c": c, "d": d}, np.stack([x, v], axis=-1)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("name", ACTIONS)
def test_events_that_leave_states_on_other_surfaces(rng, name, way):
    events = [
        crossing("c", "both"), crossing("b", "up", ACTIONS[name][0]), crossing("d", "down"),
        crossing("a", "down", ACTIONS[name][1]), crossing("c", "up"),
    ]  # fmt: skip
    parameters, x0 = family(rng, name)
    motion = flow(field(way).with_parameters(**parameters), x0, time=3.3 * way, events=events)
    loops = []
    for k, (x, v) in enumerate(x0):
        own = {name: Fraction(of[k]) for name, of in parameters.items()}
        at_b, at_a = (in_fractions(action, own) for action in ACTIONS[name])
        a, b, _, c, d = own.values()
        levels = (c, 0, None), (b, 1, at_b), (d, -1, None), (a, -1, at_a), (c, 1, None)
        loops.append(exact(x, v, 3.3, levels))
    compare(motion, loops, way)


def test_records_and_actions_find_the_same_crossings():
    """The first event puts the state on the surface of the second, from where it goes back."""
    moved = Event(lambda s: s[0] - 1, to=(lambda s: (2.0, -1.0)))
    for own in ({}, {"terminal": True}, {"to": lambda s: (s[0] + 3, s[1])}):
        second = Event(lambda s: s[0] - 2, direction="down", **own)
        motion = flow(FREE, [0.0, 0.5], time=2.5, events=[moved, second])
        assert motion.events.count.tolist() == [1, 0]
        np.testing.assert_allclose(motion.states, [[1.5, -1.0]], rtol=1e-14)


def test_counters_on_a_torus(rng):
    """Both angles wrap at 1; a record counts where they start, and another one at 0."""
    f = Field(lambda s, u, w: (u, w), "x y", u=1.0, w=1.0)
    events = []
    for k, name in enumerate("xy"):
        by = [lambda s, sign=sign, k=k: tuple(s[i] + sign * (i == k) for i in range(2))
              for sign in (-1, 1)]  # fmt: skip
        events += [
            Event(f"{name} - 1", direction="up", to=by[0]), Event(name),
            Event(name, direction="down", to=by[1]), Event(f"{name} - 0.25"),
        ]  # fmt: skip
    rates, x0 = rng.normal(size=(2, N)) * 2, rng.choice([0.0, 0.25, 0.5, 0.9], (N, 2))
    motion = flow(f.with_parameters(u=rates[0], w=rates[1]), x0, time=4.7, events=events)
    assert motion.ok.all()
    for k in range(N):
        for i in range(2):
            levels = (
                (1, 1, lambda x, v: (x - 1, v)), (0, 0, None),
                (0, -1, lambda x, v: (x + 1, v)), (Fraction(1, 4), 0, None),
            )  # fmt: skip
            found, (x, _) = exact(x0[k, i], rates[i, k], 4.7, levels)
            right = [sum(which == j for which, _ in found) for j in range(4)]
            assert motion.events.count[k, 4 * i : 4 * i + 4].tolist() == right
            np.testing.assert_allclose(motion.states[-1, k, i], float(x), atol=1e-12)


def wheel(most=None):
    """Return a rimless wheel on a slope g, between its guards at g - a and g + a."""
    f = Field(lambda s, g, a: (s[1], np.sin(s[0]) + 0 * g * a), "theta w", g=0.1, a=0.3)
    forth = Event(lambda s, g, a: s[0] - (g + a), direction="up", most=most,
                  to=lambda s, a: (s[0] - 2 * a, np.cos(2 * a) * s[1]))  # fmt: skip
    back = Event(lambda s, g, a: s[0] - (g - a), direction="down", most=most,
                 to=lambda s, a: (s[0] + 2 * a, np.cos(2 * a) * s[1]))  # fmt: skip
    return f, [forth, back]


def test_speeds_of_rimless_wheels(rng):
    """The energy w**2 / 2 + cos(theta) tells which spoke comes next, and how fast."""
    f, events = wheel(4)
    g, a, w = rng.uniform(-0.2, 0.2, N), rng.uniform(0.15, 0.5, N), 1.5 * rng.normal(size=N)
    x0 = np.stack([g - a * np.sign(w), w], axis=-1)
    found = flow(f.with_parameters(g=g, a=a), x0, time=6.0, events=events).events
    for k in range(N):
        which, speed = [], []
        ends, at, now = (g[k] - a[k], g[k] + a[k]), int(w[k] < 0), w[k]
        for _ in range(8):
            energy = now**2 / 2 + np.cos(ends[at])
            barrier = 1.0 if ends[0] < 0 < ends[1] else np.cos(ends[1 - at])
            other = 1 - at if energy > barrier else at
            now = np.sqrt(2 * (energy - np.cos(ends[other]))) * (1 if other else -1)
            now, at = now * np.cos(2 * a[k]), 1 - other
            which.append(1 - other)
            speed.append(now)
        own = found.trajectory == k
        n = min(own.sum(), 8)
        assert found.which[own][:n].tolist() == which[:n]
        np.testing.assert_allclose(found.states[own][:n, 1], speed[:n], rtol=1e-6)


def test_the_cycle_of_a_rimless_wheel():
    f, events = wheel()
    orbit = periodic_orbit(f, [-0.1, 0.7], 1.0, events=events)
    section = np.cos(orbit.state[0]) + orbit.state[1] ** 2 / 2
    square = 4 * np.sin(0.1) * np.sin(0.3) / np.sin(0.6) ** 2  # of w before it lands
    np.testing.assert_allclose(section, np.cos(0.4) + square / 2, rtol=1e-9)
    others = orbit.multipliers[np.argsort(abs(orbit.multipliers - 1))[1:]]
    np.testing.assert_allclose(others, [np.cos(0.6) ** 2], rtol=1e-6)


@pytest.mark.parametrize("name", ["exactly", "by the width", "mirrors"])
def test_derivatives_through_guards(rng, name):
    parameters, x0 = family(rng, name)
    x0[:, 0] = rng.uniform(parameters["a"], parameters["b"])
    events = [crossing("b", "up", ACTIONS[name][0]), crossing("a", "down", ACTIONS[name][1])]
    motion = flow(field().with_parameters(**parameters), x0, time=3.3, events=events,
                  derivatives=("x0", "b", "q"))  # fmt: skip
    d = Fraction(1, 2**40)

    def end(k, **changes):
        own = {name: Fraction(of[k]) for name, of in parameters.items()}
        own |= {"x": Fraction(x0[k, 0]), "v": Fraction(x0[k, 1])}
        own |= {name: own[name] + by for name, by in changes.items()}
        at_b, at_a = (in_fractions(action, own) for action in ACTIONS[name])
        levels = (own["b"], 1, at_b), (own["a"], -1, at_a)
        return np.array(exact(own["x"], own["v"], 3.3, levels)[1])

    for k in range(N):
        columns = [((end(k, **{of: d}) - end(k, **{of: -d})) / (2 * d)).astype(float)
                   for of in ("x", "v", "b", "q")]  # fmt: skip
        found = motion.derivatives
        np.testing.assert_allclose(found["x0"][-1, k], np.stack(columns[:2], -1), atol=1e-7)
        np.testing.assert_allclose(found["b"][-1, k], columns[2], atol=1e-7)
        np.testing.assert_allclose(found["q"][-1, k], columns[3], atol=1e-7)


def test_an_instant_ends_with_the_trajectory():
    """Each gate puts the state on the other one, from where it goes on at once."""
    gates = [
        Event(lambda s: s[0] - 0.3, direction="up", to=lambda s: (-1, s[1]), most=3),
        Event(lambda s: s[0] + 0.5, direction="down", to=lambda s: (1, s[1])),
    ]
    motion = flow(FREE, [0.1, 1.0], time=1.9, events=gates)
    assert motion.events.count.tolist() == [3, 2]


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("level", [0.0, 1.0])
def test_events_at_the_last_time(rng, stiff, level):
    v = rng.normal(size=500) * 10 ** rng.uniform(-4, 2, 500)
    for T in (0.3, 1.0, 7.1):
        x0 = np.stack([level - v * T, v], axis=-1)
        event = Event(f"x - {level}")
        motion = flow(FREE, x0, time=[T / 3, T], events=event, stiff=stiff)
        assert (motion.events.count == 1).all()


@pytest.mark.parametrize("factor", [1e-290, 1e-305, 1e-310])
def test_surfaces_near_the_least_numbers(factor):
    found = flow(FREE, [[-1.0, 1.0], [0.0, 1.0]], time=2.0, events=Event(lambda s: factor * s[0]))
    assert found.events.count.tolist() == [[1], [0]]


FLAT = {
    "minimum": lambda s: np.minimum(s[0], 0.0),
    "where": lambda s: np.where(s[0] < 0, s[0], 0.0),
    "cubed": lambda s: np.minimum(s[0], 0.0) ** 3,
    "above": lambda s: np.maximum(s[0], 0.0),  # never below 0
    "modulus": lambda s: abs(s[0]) + s[0],  # never below 0; the slope of abs at 0 is that beside it
    "minus modulus": lambda s: s[0] - abs(s[0]),
}
NEVER_BELOW = "above", "modulus"


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("name", FLAT)
def test_surfaces_that_are_flat_on_one_side(name, stiff):
    """A crossing into s = 0 counts even if the last one was located at q = 0 exactly."""
    events = [Event(FLAT[name], direction=direction) for direction in (0, 1, -1)]
    right = np.pi * (np.arange(0 if name in NEVER_BELOW else 10) + 0.5)
    oscillator = Field(lambda s: (s[1], -s[0]), "q p")
    for rtol in (1e-6, 1e-8, 1e-9, 6e-10, 4e-10, 1e-10, 3e-11, 1e-11, 3e-12, 1e-12):
        found = flow(oscillator, [1.0, 0.0], time=31, events=events, rtol=rtol, stiff=stiff).events
        for k, times in enumerate((right, right[1::2], right[::2])):
            np.testing.assert_allclose(found.time[found.which == k], times, atol=1e3 * rtol)


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("name", FLAT)
def test_starts_where_a_surface_begins_to_be_flat(name, stiff):
    starts = [[0.0, 1.0], [0.0, -1.0]]
    oscillator = Field(lambda s: (s[1], -s[0]), "q p")
    found = flow(oscillator, starts, time=10, events=Event(FLAT[name]), stiff=stiff).events
    # A start is above if s is 0 a moment later, too; else it is on the side to which it leads.
    right = np.pi * np.arange(1, 4)
    for k in (0, 1):
        own = found.time[found.trajectory == k]
        np.testing.assert_allclose(own, right if name not in NEVER_BELOW else [], rtol=1e-8)


POLES = {  # s, and a function of q and t with the zeros of s alone
    "tan": (lambda s: np.tan(s[0]), lambda q, t: np.sin(q)),
    "quotient": (lambda s: (s[0] - 1.2) / (s[0] + 0.3), lambda q, t: q - 1.2),
    "inverse": (lambda s: 1 / s[0] - 0.7, lambda q, t: 1 - 0.7 * q),
    "cube": (lambda s: (s[0] - 1.2) / (s[0] + 0.3) ** 3, lambda q, t: q - 1.2),
    "of time": (lambda s: np.tan(s[2]) - s[0], lambda q, t: np.sin(t) - q * np.cos(t)),
    # Here s has the same sign on both sides of the pole, where a step ends at the kink of abs.
    "logarithm": (lambda s: np.log(abs(s[0])), lambda q, t: abs(q) - 1),
    "modulus": (lambda s: 1 / abs(s[0]) - 0.7, lambda q, t: 1 - 0.7 * abs(q)),
}


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("name", POLES)
def test_poles_of_surfaces_are_no_crossings(name, stiff, rng):
    """q = 2 cos(w t + a) passes poles, where s changes its sign, too, and zeros beyond them."""
    surface, zeros = POLES[name]
    w, a = rng.uniform(0.7, 1.9, 20), rng.uniform(0.0, 6.28, 20)
    field = Field(lambda s, w: (s[1], -w * w * s[0], 1.0), "q p t", w=w)
    starts = np.c_[2 * np.cos(a), -2 * w * np.sin(a), 0 * a]
    t = np.linspace(0.0, 20.0, 40_001)
    values = zeros(2 * np.cos(w * t[:, np.newaxis] + a), t[:, np.newaxis])
    changes = np.sign(values[1:]) != np.sign(values[:-1])
    for rtol in (1e-5, 1e-9):
        found = flow(field, starts, time=20, events=Event(surface), rtol=rtol, stiff=stiff).events
        for k in range(20):
            own = found.time[found.trajectory == k]
            np.testing.assert_allclose(own, t[1:][changes[:, k]], atol=6e-4 + 300 * rtol)


def test_jumps_of_surfaces_are_crossings():
    """Remainders jump from .5 to -.5, and a gate from 1e-9 to -1."""
    clock = Field(lambda s: [1.0], "t")
    for surface, right in (
        (lambda s: np.fmod(s[0], 1.0) - 0.5, 0.5 * np.arange(1, 8)),
        (lambda s: s[0] % 1 - 0.5, 0.5 * np.arange(1, 8)),
        (lambda s: np.where(s[0] < 1, 1e-9 * (2 - s[0]), s[0] - 2), [1.0, 2.0]),
    ):
        found = flow(clock, [0.2], time=3.7, events=Event(surface)).events
        np.testing.assert_allclose(found.time + 0.2, right, rtol=1e-12)


@pytest.mark.parametrize("name", ["minimum", "where"])
def test_an_action_that_leads_to_a_flat_side(name):
    events = [Event(FLAT[name]), Event(times=[1.0], to=lambda s: (0.75, s[1]))]
    found = flow(Field(lambda s: (-1.0, 0.0), "x v"), [0.5, 0.0], time=4, events=events).events
    np.testing.assert_allclose(found.time, [0.5, 1.0, 1.0, 1.75], rtol=1e-14)
    assert found.which.tolist() == [0, 1, 0, 0]


@pytest.mark.parametrize("stiff", [None, True])
def test_events_at_the_edge_of_f(rng, stiff):
    """h' = -a - b sqrt(h) has no value below 0; a tank is filled again there."""
    a, b, h = 10 ** rng.uniform(-2, 2, (3, 100))
    f = Field(lambda s, a, b: (-a - b * np.sqrt(s[0]),), "h", a=a, b=b)

    def fall(h):
        return 2 / b * (np.sqrt(h) - a / b * np.log1p(b * np.sqrt(h) / a))

    times = fall(h) + fall(1.0) * np.array([[0.0], [1.0], [2.0]])
    for own, n in (({}, 1), ({"terminal": True}, 1), ({"to": lambda s: (1.0,), "most": 3}, 3)):
        with pytest.warns() if not own else nullcontext():
            motion = flow(
                f, h[:, None], time=2 * times.max(), events=Event("h", **own), stiff=stiff
            )
        assert (motion.events.count == n).all()
        assert (motion.status == (Status.STOPPED if own else Status.ENDED)).all()
        right = times[:n].T.ravel()
        np.testing.assert_allclose(motion.events.time, right, rtol=1e-6)
