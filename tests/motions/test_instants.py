"""What happens at a crossing or a time of a change: rest, sides, order, times asked, bounds."""

import numpy as np
import pytest

from suslov_fast import Event, Field, Status, crossings, flow

ENDLESS = pytest.mark.filterwarnings("ignore:.*have events that follow one another")


def table(rng, n):
    """Return floors, gravities, restitutions, heights above floors and speeds of n balls."""
    floor = rng.choice([-1.0, 1.0], n) * 10 ** rng.uniform(-3, 4, n)
    floor[: n // 5] = 0.0
    g, e = 10 ** rng.uniform(-3, 3, n), rng.choice([0.0, 1e-12, 0.05, 0.3, 0.5, 0.8, 0.95], n)
    return floor, g, e, rng.uniform(0.1, 3.0, n), rng.normal(size=n)


@ENDLESS
@pytest.mark.parametrize("stiff", [None, True])
def test_balls_rest_on_floors_anywhere(rng, stiff):
    """The last bounces are sought among heights that are rounding beside the floor."""
    floor, g, e, h, v = table(rng, 60)
    ball = Field(lambda x, g, e, floor: (x[1], -g), "y v", g=g, e=e, floor=floor)
    bounce = Event(lambda x, floor: x[0] - floor, direction=-1, to=lambda x, e: (x[0], -e * x[1]))
    speed = np.sqrt(v * v + 2 * g * h)
    first = (v + speed) / g
    right = first + 2 * speed * e / g / (1 - e)
    motion = flow(ball, np.stack([floor + h, v], 1), time=10 * right.max(), events=bounce,
                  rtol=1e-11, stiff=stiff)  # fmt: skip
    assert (motion.status == Status.ACCUMULATES).all()
    allowed = 1e-9 + 1e-7 * np.sqrt(abs(floor) / h) / (1 - e) * first / right
    assert (abs(motion.end / right - 1) < allowed).all()


def test_a_ball_at_rest_is_kicked_at_time_0():
    ball = Field(lambda x: (x[1], -9.8), "h v")
    changes = [Event("h", direction=-1, to=("h", "-v/2")), Event(times=[0], to=(0, 5))]
    motion = flow(ball, [0.0, 0.0], time=[0.1, 1.1], events=changes)
    s = 1.1 - 10 / 9.8
    right = [[0.451, 4.02], [2.5 * s - 4.9 * s * s, 2.5 - 9.8 * s]]
    np.testing.assert_allclose(motion.states, right, rtol=1e-9)


@ENDLESS
@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_no_ball_falls_through_a_table_that_vibrates(rtol):
    """A table whose acceleration is less than g never throws a ball that has come to rest."""
    A = np.append(np.linspace(0.0, 0.999, 501), [0.5625, 0.6])
    ball = Field(lambda s, A: (s[1], -1.0, 1.0), "h v t", A=A)
    hit = Event(lambda s, A: s[0] - A * np.sin(s[2]), direction=-1,
                 to=lambda s, A: (s[0], -0.5 * s[1] + 1.5 * A * np.cos(s[2]), s[2]))  # fmt: skip
    motion = flow(ball, [5.0, 0.0, 0.0], time=100.0, events=hit, rtol=rtol)
    assert (motion.status == Status.ACCUMULATES).all()
    np.testing.assert_allclose(motion.end[-2:], [7.955658, 7.794786], atol=1e-6)
    assert abs(motion.end[0] - 3 * np.sqrt(10)) < 1e-8  # of a table at rest


def test_a_state_that_stays_where_its_change_put_it_is_no_event():
    line = Field(lambda x: (x[1], 0 * x[1]), "x v")
    stop = Event(lambda x: x[0] - 1, to=("x", 0))
    motion = flow(line, [0.0, 1.0], time=[0.5, 2, 100], events=stop)
    np.testing.assert_allclose(motion.states[:, 0], [0.5, 1, 1], rtol=1e-14)
    assert motion.events.count.tolist() == [1]
    valve = Field(lambda s: ((1 - s[1]) * (10 - s[0]), 0.0), "out sat")
    full = Event(lambda s: s[0] - 1, to=("out", 1))
    freed = Event(times=[5], to=(0.5, 0))
    motion = flow(valve, [0, 0], time=[0.05, 0.2, 4, 5.02, 10], events=[full, freed])
    right = [10 - 10 * np.exp(-0.05), 1, 1, 10 - 9.5 * np.exp(-0.02), 1]
    np.testing.assert_allclose(motion.states[:, 0], right, rtol=1e-9)
    assert motion.events.count.tolist() == [2, 1]


def test_bodies_slide_along_walls(rng):
    """A wall takes the part of the velocity into it; what is left is rounding, of either sign."""
    n = rng.normal(size=(200, 2))
    n /= np.linalg.norm(n, axis=1)[:, None]
    v, offset = rng.normal(size=(200, 2)), rng.uniform(-100, 100, (200, 2))
    into = (n * v).sum(axis=1)
    c = (n * offset).sum(axis=1) + into
    body = Field(lambda s, m, n, c: (s[2], s[3], 0, 0), "x y u v",
                               m=n[:, 0], n=n[:, 1], c=c)  # fmt: skip

    def slide(s, m, n):
        into = m * s[2] + n * s[3]
        return s[0], s[1], s[2] - m * into, s[3] - n * into

    wall = Event(lambda s, m, n, c: m * s[0] + n * s[1] - c, to=slide)
    motion = flow(body, np.c_[offset, v], time=50.0, events=wall)
    right = offset + v + 49 * (v - n * into[:, None])
    assert motion.ok.all()
    assert (motion.events.count == 1).all()
    np.testing.assert_allclose(motion.states[0, :, :2], right, atol=1e-10)


@pytest.mark.parametrize("to", [None, lambda x: x])
def test_records_see_each_state_of_an_instant(to):
    clock = Field(lambda x: (1.0,), "x")
    changes = [
        Event(times=[0.5], to=lambda x: (x[0] + 5,)),
        Event(lambda x: x[0] - 1, to=to),
        Event(lambda x: x[0] - 4, direction=1, to=lambda x: (x[0] - 5.2,)),
    ]
    found = flow(clock, [0.0], time=1.0, events=changes).events
    assert found.count.tolist() == [1, 2, 1]
    assert found.which.tolist() == [0, 1, 2, 1]
    assert found.time.tolist() == [0.5] * 4
    np.testing.assert_allclose(found.before[:, 0], [0.5, 5.5, 5.5, 0.3])


@pytest.mark.filterwarnings("ignore:.*more than 250,000")
def test_changes_between_two_times_are_bounded():
    """The number grows as exp(10 t): 248,396 by 1.3."""
    field = Field(lambda s: (-s[1], 0 * s[1]), "x y")
    more = Event("x", direction=-1, to=("x + 1/10", "y + 1"))
    motion = flow(field, [0.1, 1.0], time=[1.3, 3.0], events=more)
    assert motion.status == Status.TOO_MANY_STEPS
    assert motion.events.count[0] == 248_396 + 250_001
    assert np.isnan(motion.states[:, 0]).tolist() == [False, True]


@pytest.mark.parametrize("direction", ["up", "down", "both"])
@pytest.mark.parametrize("rate", [-1.0, 0.0, 1.0])
def test_a_start_on_a_surface_is_no_event_beside_others(direction, rate):
    field = Field(lambda p: (rate, 0.0), "p q")
    changes = [
        Event("p - 0.3", direction=direction, to=("p", "q + 1")),
        Event(times=[0], to=("p", 5)),
    ]
    motion = flow(field, [0.1 + 0.2, 0.0], time=1.0, events=changes)
    assert motion.events.count.tolist() == [0, 1]
    np.testing.assert_allclose(motion.states, [[0.3 + rate, 5.0]], rtol=1e-12)


@pytest.mark.parametrize("surface", [
    lambda s, at: s[1] - at, lambda s, at: np.cos(np.pi / 2 * (s[1] / at)),
    lambda s, at: np.mod(s[1] / at, 2) - 1,
])  # fmt: skip
def test_a_time_asked_at_a_surface_has_the_state_after_it(surface):
    """Also as the last time alone, and where the surface lies beyond it by rounding."""
    at = np.arange(1, 200) / 10
    field = Field(lambda s, at: (0.0, 1.0, -s[2]), "n t y", at=at)
    change = Event(surface, to=lambda s: (s[0] + 1, s[1], s[2]))
    inputs = [0.0, 0.0, 1.0]
    motion = flow(field, inputs, time=at, events=change)
    n = np.diagonal(motion["n"])
    assert (n == 1).all()
    for k in range(3, 199, 60):
        for times in ([at[k]], [at[k] / 3, at[k]], [at[k], 1.7 * at[k]]):
            alone = flow(field[k], inputs, time=times, events=change)
            assert alone["n"][times.index(at[k])] == 1


def test_a_time_that_never_comes_is_told_of():
    clock = Field(lambda x: (1.0,), "t")
    for times in ([6], [-2, -1]):
        with pytest.warns(UserWarning, match="number 1 never acts"):
            flow(clock, [5.0], time=4.0, events=[Event(times=[1]), Event(times=times)])


def test_a_new_state_without_a_value_is_no_pole():
    clock = Field(lambda x: (1.0,), "x")
    change = Event("x - 1", to=lambda x: (np.sqrt(x[0] - 2),))
    with pytest.warns(RuntimeWarning, match="new state, `to`, has no value"):
        motion = flow(clock, [0.0], time=2.0, events=change)
    assert motion.end == 1.0


def test_a_clock_that_equals_a_number_is_an_event():
    with pytest.raises(ValueError, match=r"Event\(times=\[10\]"):
        Field(lambda s: (np.where(s[1] == 10, 5.0, -s[0]), 1.0), "x t")
    Field(lambda s: (np.where(s[0] == 0, 1.0, np.sin(s[0]) / s[0]), 1.0), "x t")


TOUCHING = (
    lambda u: np.cos(u) - 1,
    lambda u: -u * u,
    lambda u: 1 / (1 + u * u) - 1,
    lambda u: np.exp(-u * u) - 1,
    lambda u: 1 - np.cosh(u),
)


@pytest.mark.parametrize("g", TOUCHING)
def test_a_start_where_the_state_turns_and_the_surface_touches_0(g):
    """Of x" = c - x from x = a at rest: g(x - a) is 0 at the start, and below 0 for one turn."""
    rng = np.random.default_rng(3)
    a, distance = rng.uniform(-2, 2, 8), rng.uniform(0.3, 2, 8) * ([1, -1] * 4)
    field = Field(lambda s, a, d: (s[1], a + d - s[0]), "x v", a=a, d=distance)
    starts = np.stack([a, 0 * a], axis=-1)
    assert not len(crossings(field, starts, lambda s, a: g(s[0] - a), time=6.0).time)
