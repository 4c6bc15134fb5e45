"""Bodies that come to rest, start on a surface, or stay on it; changes that pile up."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from systems import on_a_table

from suslov_fast import Event, Field, Status, crossings, flow

pytestmark = pytest.mark.filterwarnings("ignore:.*have events that follow one another")
BALL = Field(lambda x, g, e: (x[1], -g), "h v", g=9.81, e=0.9)
BOUNCE = Event("h", direction=-1, to=lambda x, e: (x[0], -e * x[1]))


def balls(rng, n=60):
    """Return balls above floors of any height, their bounces, their starts, and all numbers."""
    floor = rng.choice([-1.0, 1.0], n) * 10 ** rng.uniform(-3, 4, n)
    floor[: n // 5] = 0.0
    g, e = 10 ** rng.uniform(-3, 3, n), rng.choice([0.0, 1e-12, 0.05, 0.3, 0.5, 0.8, 0.95], n)
    h, v = rng.uniform(0.1, 3.0, n), rng.normal(size=n)
    field = Field(lambda x, g, e, floor: (x[1], -g), "y v", g=g, e=e, floor=floor)
    bounce = Event(lambda x, floor: x[0] - floor, direction=-1, to=lambda x, e: (x[0], -e * x[1]))
    return field, bounce, np.stack([floor + h, v], axis=-1), (floor, g, e, h, v)


@pytest.mark.parametrize(("rtol", "stiff"), [(1e-6, None), (1e-11, None), (1e-11, True)])
def test_balls_rest_on_floors_anywhere(rng, rtol, stiff):
    """Among heights that are rounding; one of 60 is so high that it ends there, the others rest.

    Gravity and reaction cancel with a rounding error; T**2 / 2 times that would be 1e-4. Heights at
    rest are those of the floors, to the last digit.
    """
    ball, bounce, starts, (floor, g, e, h, v) = balls(rng)
    speed = np.sqrt(v * v + 2 * g * h)
    first = (v + speed) / g
    right = first + 2 * speed * e / g / (1 - e)
    assert right.max() < 1e5
    motion = flow(ball, starts, time=1e6, events=bounce, rtol=rtol, stiff=stiff)
    ends = motion.status == Status.ACCUMULATES
    assert (ends | motion.ok).all()
    assert ends.sum() <= 1
    allowed = max(1e-9, rtol) + 1e-7 * np.sqrt(abs(floor) / h) / (1 - e) * first / right
    assert (abs(motion.end / right - 1) < allowed)[ends].all()
    allowed = np.stack([0.0 * g + 1e-20, 1e-13 * g], axis=-1)
    rest = np.stack([floor, 0.0 * floor], axis=-1)
    assert (abs(motion.final - rest) <= allowed)[motion.ok].all()


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize(("side", "direction"), [(1, -1), (1, 0), (-1, 1), (-1, 0)])
@pytest.mark.parametrize("T", [1e4, -1e4])
def test_no_ball_of_little_restitution_falls_through_its_floor(rng, stiff, side, direction, T):
    """A hit at the height -1e-16 may throw the ball up by less than that, so it stays below 0."""
    n = 200
    floor, e = rng.choice([0.0, 0.0, 1.0, -1.0], n), 10 ** rng.uniform(-13, -1, n)
    g, h, v = 10 ** rng.uniform(-2, 2, n), rng.uniform(0.1, 3.0, n), rng.normal(size=n)
    values = {"g": side * g, "e": e, "floor": side * floor}
    ball = Field(lambda x, g, e, floor: (x[1], -g), "y v", **values)
    bounce = Event(lambda x, floor: x[0] - floor, direction=direction,
                   to=lambda x, e: (x[0], -e * x[1]))  # fmt: skip
    starts = np.stack([side * (floor + h), v], axis=-1)
    motion = flow(ball, starts, time=T, events=bounce, stiff=stiff)
    assert motion.ok.all()
    np.testing.assert_allclose(motion.final[:, 0], side * floor, atol=1e-12)
    hits = motion.events
    is_toward = np.sign(hits.before[:, 1]) == -side * np.sign(T)
    assert is_toward.all()


@pytest.mark.parametrize("rtol", [1e-3, 1e-9, 1e-12])
def test_balls_that_start_on_a_table_rest_on_it(rng, rtol):
    """The rounding error of the phase w t is larger than that of sin(w t)."""
    n = 300
    A = 10 ** rng.uniform(-1.5, 0.3, n)
    w, e = np.sqrt(rng.uniform(0.05, 0.95, n) * 9.81 / A), rng.uniform(0.0, 0.9, n)
    t, v = rng.uniform(0.0, 3.0, n), 10 ** rng.uniform(-6, -1, n)
    A[0], w[0], e[0] = 0.10284188083015185, 7.08880856111813, 0.14929962715251346
    t[0], v[0] = 2.667723492741909, 0.001279777762266519
    ball = Field(lambda s, A, w, e: (s[1], -9.81, 1.0), "h v t", A=A, w=w, e=e)

    def to(s, A, w, e):
        return s[0], (1 + e) * A * w * np.cos(w * s[2]) - e * s[1], s[2]

    hit = Event(lambda s, A, w: s[0] - A * np.sin(w * s[2]), direction=-1, to=to)
    starts = np.stack([A * np.sin(w * t), A * w * np.cos(w * t) + v, t], axis=-1)
    motion = flow(ball, starts, time=1.0, events=hit, rtol=rtol)
    assert motion.ok.all()
    h, _, t = motion.final.T
    np.testing.assert_allclose(h, A * np.sin(w * t), atol=1e-7 + 1e-2 * rtol)


@pytest.mark.parametrize(
    ("rtol", "T", "n"), [*((10.0**k, 100.0, 501) for k in (-6, -9, -12)), (1e-9, 10_000.0, 7)]
)
def test_no_ball_falls_through_a_table_that_vibrates(rtol, T, n):
    """No table with A <= 1 throws a ball that has come to rest; that with A = 3 does."""
    A = np.append(np.linspace(0.0, 0.999, n), [0.5625, 0.6, 1.0, 3.0])
    ball, hit = on_a_table(A, 0.5)
    motion = flow(ball, [5.0, 0.0, 0.0], time=T, events=hit, rtol=rtol)
    assert motion.ok.all()
    h, v, _ = motion.final.T
    np.testing.assert_allclose(h[:-1], A[:-1] * np.sin(T), atol=1e-9 + 3e-12 * T)
    np.testing.assert_allclose(v[:-1], A[:-1] * np.cos(T), atol=1e-9)
    assert h[-1] > 3.0 * np.sin(T)


def test_balls_rest_on_a_stair():
    """The surface jumps at the edge, far from where they rest."""
    e = np.array([0.0, 1e-12, 0.05, 0.3, 0.5, 0.8])
    ball = Field(lambda s, e: (s[1], -9.81, 1.0), "h v x", e=e)
    bounce = Event(lambda s: s[0] - np.where(s[2] < 50.0, 1.0, 0.0), direction=-1,
                   to=lambda s, e: (s[0], -e * s[1], s[2]))  # fmt: skip
    motion = flow(ball, [2.0, 0.0, 0.0], time=100.0, events=bounce)
    assert motion.ok.all()  # at 50 they fall off the edge, to the floor
    np.testing.assert_allclose(motion.final[:, :2], 0.0, atol=1e-12)


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


@pytest.mark.parametrize("direction", ["up", "down", "both"])
def test_a_start_on_a_surface_is_no_event_beside_others(direction):
    rate = np.array([-1.0, 0.0, 1.0])
    field = Field(lambda p, rate: (rate, 0.0), "p q", rate=rate)
    changes = [
        Event("p - 0.3", direction=direction, to=("p", "q + 1")),
        Event(times=[0], to=("p", 5)),
    ]
    motion = flow(field, [0.1 + 0.2, 0.0], time=1.0, events=changes)
    assert motion.events.count.tolist() == [[0, 1]] * 3
    right = np.stack([0.3 + rate, 0 * rate + 5.0], 1)
    np.testing.assert_allclose(motion.states[0], right, rtol=1e-12)


TOUCHING = (
    lambda u: np.cos(u) - 1,
    lambda u: -u * u,
    lambda u: np.exp(-u * u) - 1,
)


@pytest.mark.parametrize("g", TOUCHING)
def test_a_start_where_the_state_turns_and_the_surface_touches_0(g):
    """Of x" = c - x from x = a at rest: g(x - a) is 0 at the start, and below 0 for one turn."""
    rng = np.random.default_rng(3)
    a, distance = rng.uniform(-2, 2, 8), rng.uniform(0.3, 2, 8) * ([1, -1] * 4)
    field = Field(lambda s, a, d: (s[1], a + d - s[0]), "x v", a=a, d=distance)
    starts = np.stack([a, 0 * a], axis=-1)
    assert not len(crossings(field, starts, lambda s, a: g(s[0] - a), time=6.0).time)


@pytest.mark.parametrize(("direction", "falls"), [(0, 1), (-1, 1), (1, 0)])
def test_a_start_on_a_surface_is_no_change(direction, falls):
    """Balls that are thrown up come back to it, those that fall do not."""
    change = Event("h", direction=direction, to=BOUNCE.to)
    found = flow(BALL, [[0.0, 1.0], [0.0, -1.0]], time=0.3, events=change).events
    assert found.count.tolist() == [[falls], [0]]
    np.testing.assert_allclose(found.time, [2 / 9.81] * falls, rtol=1e-7)
    slow = Field(lambda x, v: (v, 0.0), "h n", v=[1e-4, -1e-4])
    rises = Event("h", direction=direction, to=lambda x: (x[0], x[1] + 1))
    assert not flow(slow, [0.0, 0.0], time=0.3, events=rises).events.count.any()


@pytest.mark.parametrize("rtol", [1e-6, 1e-12])
def test_two_tanks_with_one_tap(rtol, rng):
    """Water leaves both; the tap turns to the one that is empty, ever more often until both are."""
    out = rng.uniform(0.5, 1.0, (2, 40))
    tap = out.max(axis=0) + rng.uniform(0.05, 0.9, 40) * out.min(axis=0)
    values = {"a": out[0], "b": out[1], "w": tap}
    tanks = Field(lambda s, a, b, w: (w * s[2] - a, w * (1 - s[2]) - b, 0.0), "x y first", **values)
    turns = [Event(s, direction=-1, to=("x", "y", q)) for s, q in (("x", 1), ("y", 0))]
    full = rng.uniform(0.5, 2.0, (40, 2))
    motion = flow(tanks, np.c_[full, np.ones(40)], time=1000.0, events=turns, rtol=rtol)
    assert (motion.status == Status.ACCUMULATES).all()
    np.testing.assert_allclose(motion.end, full.sum(axis=1) / (out.sum(axis=0) - tap), rtol=1e-9)


def test_most_counts_hits_and_phases_tell_rests():
    """A ball rests on a table that vibrates, and is thrown again and again: rests are no hits."""
    A = 1.2
    ball, hit = on_a_table(A, 0.2)
    whole = flow(ball, [5.0, 0.0, 0.0], time=100.0, events=hit, derivatives="x0")
    phases, times = whole.phases, whole.events.time
    rests = phases.time[phases.mode == "rests"]
    leaves = phases.time[phases.mode == "leaves"]
    assert len(leaves) >= 10
    # It is thrown where A sin(t) bends by more than g.
    np.testing.assert_allclose(np.sin(leaves), 1 / A, atol=1e-9)
    np.testing.assert_array_less(rests[: len(leaves)], leaves)
    n = int(np.searchsorted(times, leaves[5])) + 2  # the second hit after the sixth throw
    given = {"events": replace(hit, most=n), "derivatives": "x0"}
    few = flow(ball, [5.0, 0.0, 0.0], time=[10.0, 100.0], **given)
    assert few.status == Status.STOPPED
    assert few.events.count == n
    assert few.end == pytest.approx(times[n - 1])
    assert few.phases.time.max() <= few.end
    assert np.isnan(few.states[1]).all()
    assert np.isnan(few.derivatives["x0"][1]).all()
    np.testing.assert_allclose(few.final, whole.events.states[n - 1])


def test_balls_without_restitution_stay_above_tables_that_throw_them(rng):
    """Each hit ends on the surface with ds/dt = 0; the next flight may be shorter than a step."""
    n = 300
    w = rng.uniform(0.3, 3.0, n)
    A = rng.uniform(0.0, 4.0, n) / w**2
    c = rng.choice([0.0, 1.0, 1000.0], n) * rng.uniform(0.5, 1, n)
    phase = rng.uniform(0.0, 6.0, n)
    ball = Field(lambda s, A, w, c, p: (s[1], -1.0, 1.0), "h v t", A=A, w=w, c=c, p=phase)
    hit = Event(lambda s, A, w, c, p: s[0] - (c + A * np.sin(w * s[2] + p)), direction=-1,
                to=lambda s, A, w, p: (s[0], A * w * np.cos(w * s[2] + p), s[2]))  # fmt: skip
    starts = np.stack([c + A + rng.uniform(0.1, 3.0, n), rng.uniform(-1, 1, n), 0 * c], axis=1)
    motion = flow(ball, starts, time=np.linspace(0.0, 50.0, 51), events=hit)
    assert motion.ok.mean() > 0.97
    gap = motion["h"] - (c + A * np.sin(w * motion["t"] + phase))
    assert (gap >= -1e-9 * abs(motion["h"]).max(axis=0))[:, motion.ok].all()


@pytest.mark.parametrize("stiff", [None, True])
def test_no_hop_on_a_table_hides_a_hit(rng, stiff):
    """Until its next hit or its rest each ball is on a parabola, which is above the table."""
    n = 300
    A = rng.uniform(1.1, 4.0, n)
    ball, hit = on_a_table(A, 0.3)
    starts = np.stack([A + rng.uniform(0.5, 5.0, n), 0.0 * A, 0.0 * A], axis=1)
    motion = flow(ball, starts, time=60.0, events=hit, stiff=stiff)
    hits, phases = motion.events, motion.phases
    rests = (phases.trajectory + 1j * phases.time)[phases.mode == "rests"]
    flies = ~np.isin(hits.trajectory + 1j * hits.time, rests)[:-1]
    (k,) = np.nonzero(flies & (hits.trajectory[1:] == hits.trajectory[:-1]))
    assert len(k) > 20 * n
    (h, v, t), A = hits.states[k].T, A[hits.trajectory[k]]
    since = np.linspace(0.0, 1.0, 200)[:, np.newaxis] * (hits.time[k + 1] - hits.time[k])
    gap = h + v * since - since**2 / 2 - A * np.sin(t + since)
    assert gap.min() > -1e-10


def test_a_hop_after_a_step_of_a_few_last_digits():
    """A step ends 4e-15 before the hit at 3.546; the hop then lasts .003, a step .018."""
    A, w, e = 0.021406417413854108, 35.49792234906192, 0.06974233400779069
    ball = Field(lambda s: (s[1], -9.81, 1.0), "h v t")
    hit = Event(
        lambda s: s[0] - A * np.sin(w * s[2]), direction=-1,
        to=lambda s: (s[0], (1 + e) * A * w * np.cos(w * s[2]) - e * s[1], s[2]),
    )  # fmt: skip
    times = np.linspace(0.0, 12.0, 1201)
    motion = flow(ball, [0.3976028986374855, -0.04109291800862082, 0.0], time=times, events=hit)
    assert (motion["h"] - A * np.sin(w * times)).min() > -1e-10


@pytest.mark.parametrize("T", [0.02, 0.1, 1.0, 2.0, 5.0])
def test_balls_that_start_on_a_table_come_to_rest(T):
    """The clock is not 0 at the start, so that its rounding is large beside the time."""
    A, w = 0.1, 10.0
    ball = Field(lambda s: (s[1], -9.81, 1.0), "h v t")
    hit = Event(lambda s: s[0] - A * np.sin(w * s[2]), direction=-1,
                to=lambda s: (s[0], 1.5 * A * w * np.cos(w * s[2]) - 0.5 * s[1], s[2]))  # fmt: skip
    t, up = np.array([0.31, 0.95]), np.array([0.001, 0.01])
    motion = flow(
        ball, np.stack([A * np.sin(w * t), A * w * np.cos(w * t) + up, t], axis=1), time=T,
        events=hit,
    )  # fmt: skip
    assert motion.ok.all()
    np.testing.assert_allclose(motion["h"][0], A * np.sin(w * (t + T)), atol=1e-9)


def test_two_balls_in_a_pile_come_to_rest(rng):
    """Neither falls through the floor or through the other one, which has hit it at rest."""
    n = 60
    e, d, mu = rng.uniform(0, 0.9, n), rng.uniform(0.05, 0.3, n), rng.uniform(0.2, 3, n)
    balls = Field(lambda s, e, d, mu: (s[1], -9.81, s[3], -9.81), "h v y u", e=e, d=d, mu=mu)

    def collide(s, e, mu):
        r = (1 + e) * (s[3] - s[1]) / (1 + mu)
        return s[0], s[1] + mu * r, s[2], s[3] - r

    events = [
        Event("h", direction=-1, to=lambda s, e: (s[0], -e * s[1], s[2], s[3])),
        Event(lambda s, d: s[2] - s[0] - d, direction=-1, to=collide),
    ]
    lower = np.where(rng.random(n) < 0.5, 0.0, rng.uniform(0.1, 1, n))
    starts = np.stack([lower, 0 * e, lower + d + rng.uniform(0.05, 0.5, n), 0 * e], axis=1)
    motion = flow(balls, starts, time=60.0, events=events)
    assert motion.ok.mean() > 0.8
    rest = np.stack([0 * d, 0 * d, d, 0 * d], axis=-1)
    np.testing.assert_allclose(motion.final[motion.ok], rest[motion.ok], atol=1e-12)


@pytest.mark.parametrize("far", [1.0, 1e3, 1e6, 1e9])
def test_a_far_wall_does_not_change_when_a_ball_rests(far):
    """A ball that falls from 1 hits the floor after t = sqrt(2 / g), and rests at 9 t."""
    ball = BALL.with_parameters(g=9.8, e=0.8)
    wall = Event(lambda s: s[0] + far, to=lambda s: (s[0], -s[1]))
    alone, beside = (flow(ball, [1.0, 0.0], time=5.0, events=e) for e in (BOUNCE, [BOUNCE, wall]))
    np.testing.assert_allclose(beside.phases.time, [9.0 * np.sqrt(2.0 / 9.8)], rtol=3e-10)
    np.testing.assert_array_equal(beside.events.time, alone.events.time)


# ------------------------------------------------------- starts that are likely to be mistakes
SURFACES = {
    "floor": ((lambda s: s[0] - 0.3, lambda s: (s[0], -0.5 * s[1], s[2])), [0.3, 0.0, 0.0]),
    "table": (
        (
            lambda s: s[0] - 0.5 * np.sin(s[2]),
            lambda s: (s[0], 1.5 * 0.5 * np.cos(s[2]) - 0.5 * s[1], s[2]),
        ),
        [0.0, 0.5, 0.0],
    ),
    "bowl": ((lambda s: s[0] - s[1] ** 2, None), [0.0, 0.0, 0.0]),
}


@pytest.mark.parametrize("name", SURFACES)
@pytest.mark.parametrize("g", [9.81, [1.0, 1e3]])
def test_a_start_at_rest_on_its_floor(name, g):
    """A ball stays on the floor. Where no event acts, it falls, h0 - g t**2 / 2, and is told of."""
    (surface, to), x0 = SURFACES[name]
    ball = Field(lambda s, g: (s[1], -g, 1.0), "h v t", g=g)
    event = Event(surface, to=to, terminal=to is None, direction="down")
    words = f"x0 rests .* in {np.size(g)} of {np.size(g)}"
    with nullcontext() if to else pytest.warns(UserWarning, match=words):
        motion = flow(ball, x0, time=0.1, events=event)
    h = {"floor": 0.3, "table": 0.5 * np.sin(0.1), "bowl": np.asarray(g) * -0.005}[name]
    np.testing.assert_allclose(motion["h"][0], h, rtol=1e-9)
    for v in (-1.0, 2.0):  # with a speed it is no mistake
        flow(ball, [x0[0], x0[1] + v, 0.0], time=1e-3, events=event)
    up = Event(surface, to=to, terminal=to is None, direction="up")
    flow(ball, x0, time=0.1, events=up)


def test_a_start_at_rest_is_told_of_beside_a_mode():
    """f slides along v = 0, and no event holds the ball."""
    f = Field(lambda s: (s[1], -9.81, s[3], -s[2] - 0.15 * np.sign(s[3])), "h w x v")
    with pytest.warns(UserWarning, match="x0 rests"):
        motion = flow(
            f, [0.0, 0.0, 1.0, 0.0], time=20.0, events=Event("h", direction=-1, terminal=True)
        )
    np.testing.assert_allclose(motion.final, [-1962.0, -196.2, -0.1, 0.0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("k", [0.9, 0.2])
def test_actions_that_slow_a_body_hold_it_nowhere(k):
    fall = Field(lambda s: (s[1], -1.0), "h v")
    drag = Event(lambda s: s[0] - 1, to=lambda s: (s[0], k * s[1]))
    with pytest.warns(UserWarning, match="leaves it without an event"):
        motion = flow(fall, [[1.0, 0.0], [1.5, 0.0]], time=2.0, events=drag)
    v = -k  # after the action at t = 1, in the second
    np.testing.assert_allclose(motion.final, [[-1.0, -2.0], [1 + v - 0.5, v - 1]], atol=1e-9)
    assert len(motion.phases.mode) == 0
