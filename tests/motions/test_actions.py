"""Changes of the state along motions: right values, order, ends, bits."""

import numpy as np
import pytest
from children import TWO_THREADS

from suslov_fast import (
    Event,
    Field,
    Status,
    Suslov3D,
    crossings,
    flow,
    periodic_orbit,
)

DECAY = Field(lambda x: (-x[0],), "x")
GUT = Field(lambda x, k, dose: (-k * x[0], k * x[0] - 0.1 * x[1]), "gut blood",
                          k=1.0, dose=100.0)  # fmt: skip
DOSE = {"to": lambda x, dose: (x[0] + dose, x[1])}


def after_doses(times, dose, k, t):
    """Return the amounts in gut and blood at time t, after doses at these times."""
    s = t - np.asarray(times, float)
    s = s[s >= 0.0]
    in_gut = np.exp(-k * s)
    in_blood = k / (0.1 - k) * (in_gut - np.exp(-0.1 * s))
    return dose * np.array([in_gut.sum(), in_blood.sum()])


@pytest.mark.parametrize("stiff", [None, True, False])
def test_doses_of_subjects_at_times_of_their_own(stiff):
    rng = np.random.default_rng(0)
    times = np.sort(rng.uniform(0.0, 80.0, (20, 6)), axis=1)
    times[3, 4:], times[4, 0] = np.nan, 0.0
    own = GUT.with_parameters(k=rng.uniform(0.5, 2.0, 20), dose=rng.uniform(50, 100, 20))
    motion = flow(own, [0.0, 0.0], time=[0.0, 20.0, times[5, 2], 80.0], stiff=stiff,
                  events=Event(times=times, **DOSE))  # fmt: skip
    pairs = zip(times, own.parameters["dose"], own.parameters["k"], strict=True)
    right = np.array([[after_doses(*each, t) for t in motion.time] for each in pairs])
    np.testing.assert_allclose(motion.states, right.swapaxes(0, 1), atol=3e-7)
    assert motion.ok.all()
    assert motion.events.count[:, 0].tolist() == (~np.isnan(times)).sum(axis=1).tolist()
    np.testing.assert_array_equal(motion.events.time, times[~np.isnan(times)])
    given = motion.events.states - motion.events.before
    np.testing.assert_allclose(given[:, 0], own.parameters["dose"][motion.events.trajectory])
    alone = flow(own[7], [0.0, 0.0], time=motion.time, stiff=stiff,
                 events=Event(times=times[7], **DOSE))  # fmt: skip
    if times[5, 2] not in times[7]:
        np.testing.assert_array_equal(alone.states, motion.states[:, 7])


ADD = [Event(times=[1], to=lambda x: (x[0] + 12,)), Event(times=[1], to=lambda x: (10 * x[0],))]


@pytest.mark.parametrize(
    ("changes", "right"),
    [
        (Event(times=[1, 1], to=lambda x: (x[0] + 1,)), [0, 2]),
        (ADD, [0, 120]),
        (ADD[::-1], [0, 12]),
        (Event(times=[0], to=lambda x: (x[0] + 1,)), [1, np.exp(-1)]),
        (Event(times=[np.nan, -1, 2, 0, np.inf], to=lambda x: (x[0] + 1,)), [1, np.exp(-1)]),
    ],
)
def test_order_and_times(changes, right):
    """At one instant in the order of the list; at a time asked, the state after it."""
    motion = flow(DECAY, [0.0], time=[0.0, 1.0], events=changes)
    np.testing.assert_allclose(motion.states[:, 0], right, rtol=1e-9, atol=1e-15)


def test_backwards():
    change = Event(times=[-1.0], to=lambda x: (x[0] + 1,))
    motion = flow(DECAY, [1.0], time=[-2.0, -1.0, -0.5], events=change)
    right = [np.e * (np.e + 1), np.e + 1, np.e**0.5]
    np.testing.assert_allclose(motion.states[:, 0], right, rtol=1e-9)


@pytest.mark.parametrize(("keywords", "end"), [({"terminal": True}, 1.0), ({"most": 2}, 2.0)])
def test_times_that_end(keywords, end):
    motion = flow(DECAY, [1.0], time=[3.0, 1.0, 2.0], events=Event(times=[1, 2, 3], **keywords))
    assert (motion.status, motion.end) == (Status.STOPPED, end)
    assert np.isnan(motion.states[:, 0]).tolist() == [True, False, end == 1.0]


def test_time_0_alone():
    motion = flow(DECAY, [1.0], time=0.0, events=Event(times=[0, 0], to=lambda x: (3 * x[0],)))
    assert motion.states.tolist() == [[9.0]]
    assert motion.ok.all()


@pytest.mark.parametrize("times", [[0.0, 1.0], [1.0, 0.0]])
def test_a_start_without_a_value_is_the_state_at_time_0(times):
    root = Field(lambda x: (np.sqrt(x[0]),), "x")
    with pytest.warns(RuntimeWarning, match="no value"):
        motion = flow(root, [-1.0], time=times, events=Event(times=[0.5], to=lambda x: (4.0,)))
    np.testing.assert_array_equal(motion.states[:, 0], np.where(times, np.nan, -1.0))


def test_other_systems():
    """Fields by terms have lists for changes, and bodies take steps."""

    def f(x, a):
        return a * x[0] * x[1], 1 - x[1]

    change = Event(times=[1], to=lambda x: (x[0] / 2, 0))
    product = np.zeros((2, 2, 2, 2))
    product[:, 0, 0, 1] = [1.0, 2.0]
    by_terms = Field.from_terms(product, [[0, 0], [0, -1]], [0, 1], "u v")
    own = Field(f, "u v", a=[1.0, 2.0]), by_terms
    first, second = (flow(each, [1.0, 0.5], time=2.0, events=change).states for each in own)
    np.testing.assert_allclose(first, second, rtol=1e-14)
    body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    motion = flow(body, [1.0, 0.5], time=2.0, events=Event(times=[1.0]))
    np.testing.assert_allclose(motion.states, flow(body, [1.0, 0.5], time=2.0).states, rtol=1e-9)
    section = crossings(body, [1.0, 0.5], surface="Omega2", time=20.0, direction="both")
    assert len(section.states) == 1
    assert abs(section.states[0, 1]) < 1e-14
    found = flow(body, [1.0, 0.5], time=20.0, events=Event("Omega2")).events
    np.testing.assert_array_equal(found.time, section.time)


# ----------------------------------------------------------------------------------- surfaces
BALL = Field(lambda x, g, e: (x[1], -g), "h v", g=9.81, e=0.9)
BOUNCE = Event("h", direction=-1, to=lambda x, e: (x[0], -e * x[1]))
FALL = np.sqrt(2.0 / 9.81)  # the time from height 1
CLOCK = Field(lambda x: (1.0, 0.0), "t n")


def height(e, t):
    """Return the height at time t of a ball that falls from 1."""
    first, v = FALL, e * 9.81 * FALL
    while t >= first + 2.0 * v / 9.81:
        first, v = first + 2.0 * v / 9.81, e * v
    s = t - first
    return 1.0 - 9.81 * t * t / 2.0 if s < 0.0 else v * s - 9.81 * s * s / 2.0


@pytest.mark.parametrize("stiff", [False, True])
def test_bouncing_balls(stiff):
    time = np.linspace(0.1, 5.0, 20)
    motion = flow(BALL.with_parameters(e=[0.9, 0.95]), [1.0, 0.0], time=time, events=BOUNCE,
                  rtol=1e-11, stiff=stiff, max_step=1.0)  # fmt: skip
    np.testing.assert_allclose(motion.states[:, 0, 0], [height(0.9, t) for t in time], atol=1e-9)
    assert motion.events.count.ravel().tolist() == [8, 7]
    assert motion.events.before[:, 0].min() > -1e-13


@pytest.mark.filterwarnings("ignore:.*have events that follow one another")
@pytest.mark.parametrize("e", [0.0, 1e-16, 1e-12, 1e-8, 1e-4, 0.01, 0.1, 0.5, 0.9, 0.97])
def test_balls_that_come_to_rest(e):
    motion = flow(BALL.with_parameters(e=e), [1.0, 0.0], time=100.0, events=BOUNCE)
    assert motion.status == Status.ACCUMULATES
    assert abs(motion.end - FALL * (1.0 + 2.0 * e / (1.0 - e))) < 1e-10
    assert motion.events.states[:, 0].min() > -1e-12


def test_spikes():
    """Of leaky neurons, whose period is log(I / (I - 1))."""
    current = np.linspace(1.2, 3.0, 5)
    neuron = Field(lambda x, I: (I - x[0],), "v", I=current)
    spike = Event(lambda x: x[0] - 1, direction="up", to=lambda x: (0,))
    found = flow(neuron, [0.0], time=20.0, events=spike).events
    period = np.log(current / (current - 1.0))
    assert found.count[:, 0].tolist() == np.floor(20.0 / period).tolist()
    number = np.concatenate([np.arange(1, 1 + n) for n in found.count[:, 0]])
    np.testing.assert_allclose(found.time, number * period[found.trajectory], rtol=3e-9)


@pytest.mark.parametrize(
    ("v", "direction", "times"),
    [(1, 0, [0.2038736]), (-1, 0, []), (1, -1, [0.2038736]), (-1, 1, []), (1, 1, [])],
)
def test_a_start_on_a_surface_is_no_change(v, direction, times):
    change = Event("h", direction=direction, to=BOUNCE.to)
    found = flow(BALL, [0.0, v], time=0.3, events=change).events
    np.testing.assert_allclose(found.time, times, atol=1e-7)
    slow = Field(lambda x, e: (v * 1e-4, 0.0), "h v", e=0.9)
    assert len(flow(slow, [0.0, 0.0], time=0.3, events=change).events.states) == 0


def test_order_at_surfaces():
    """Both act, in the order of the list, each with the state that the other one has left."""
    changes = [
        Event(lambda x: x[0] - 1, to=lambda x: (x[0], x[1] + 1)),
        Event(lambda x: 2 * x[0] - 2, to=lambda x: (x[0], 10 * x[1])),
    ]
    for own, n in ((changes, 10.0), (changes[::-1], 1.0)):
        motion = flow(CLOCK, [0.0, 0.0], time=2.0, events=own)
        np.testing.assert_allclose(motion.states, [[2.0, n]], rtol=1e-12)


def test_a_dose_over_a_threshold_acts_at_once():
    rest = Field(lambda x: (-x[0], 0.0), "x n")
    spike = Event(lambda x: x[0] - 1, direction=1, to=lambda x: (0.5, x[1] + 1))
    dose = Event(times=[0.0, 1.0], to=lambda x: (x[0] + 2, x[1]))
    motion = flow(rest, [0.0, 0.0], time=1.0, events=[spike, dose])
    assert motion.states.tolist() == [[0.5, 2.0]]
    assert motion.events.which.tolist() == [1, 0, 1, 0]


def test_resets_fill_the_buffer_of_records():
    reset = Event(lambda x: x[0] - 0.01, direction=1, to=lambda x: (0, x[1] + 1))
    found = flow(CLOCK, np.zeros((20, 2)), time=10.0, events=reset, threads=TWO_THREADS).events
    assert found.count.ravel().tolist() == [999] * 20
    assert found.trajectory.tolist() == [k for k in range(20) for _ in range(999)]
    right = np.tile(0.01 * np.arange(1, 1000), 20)
    np.testing.assert_allclose(found.time, right, atol=1e-10)


def test_surfaces_and_new_states_with_conditions():
    change = Event(lambda x: np.abs(x[0] - 2) - 1, to=lambda x: (x[0], np.where(x[1] > 0, 7, 1)))
    found = flow(CLOCK, [0.0, 0.0], time=5.0, events=change).events
    np.testing.assert_allclose(found.time, [1.0, 3.0], rtol=1e-12)
    assert found.states[:, 1].tolist() == [1.0, 7.0]


@pytest.mark.parametrize(("surface", "direction", "times"), [
    (lambda s: np.sign(np.sin(3 * s[1])), 1, 2 * np.pi / 3 * np.arange(1, 5)),
    (lambda s: np.sign(np.sin(3 * s[1])), -1, np.pi / 3 * np.arange(1, 9, 2)),
    (lambda s: np.mod(s[1], 2) - 1, 0, np.arange(1, 9)),
    (lambda s: s[0] - np.where(s[1] < 4, 2, -4), 0, [1, 4, 7]),
    (lambda s: np.arctan2(np.sin(3 * s[1]), np.cos(3 * s[1])) - 0.3, 0,
     np.sort(np.append(0.1 + 2 * np.pi / 3 * np.arange(5), np.pi / 3 * np.arange(1, 9, 2)))),
])  # fmt: skip
@pytest.mark.parametrize("to", [None, lambda s: s])
def test_surfaces_that_jump(surface, direction, times, to):
    """Also against their rate, and from 0 at the start, which is no change."""
    falls = Field(lambda s: (-1.0, 1.0), "x t")
    change = Event(surface, direction=direction, to=to)
    motion = flow(falls, [3.0, 0.0], time=8.6, events=change, max_step=0.5)
    np.testing.assert_allclose(motion.events.time, times, atol=1e-9)
    assert motion.status == Status.OK


@pytest.mark.parametrize("f", [np.sign, lambda x: np.abs(x) / x, lambda x: np.floor(x / 8) * 2 + 1,
                               lambda x: np.interp(x, [-3, -2, 2, 3], [-1, -1, 1, 1])])  # fmt: skip
def test_changes_over_surfaces_of_f(f):
    """A state that changes over a jump or a kink of f goes on with the other choice."""
    switched = Field(lambda x: (-f(x[0]), 0.0), "x n")
    turn = Event(lambda x: np.abs(x[0]) - 4, direction=-1, to=lambda x: (-x[0] - 1, x[1] + 1))
    motion = flow(switched, [4.5, 0.0], time=[0.25, 1.0], events=turn)
    np.testing.assert_allclose(motion.states, [[4.25, 0.0], [-4.5, 1.0]], rtol=1e-9)


@pytest.mark.parametrize(
    "surface",
    [lambda x: np.minimum(x[0], 0), lambda x: np.floor(x[0]), lambda x: np.sign(x[0]) - 1],
)
def test_actions_to_where_the_surface_is_0_all_around(surface):
    jump = Event(surface, direction=-1, to=lambda x: (x[0] + 2,))
    motion = flow(Field(lambda x: (-1.0,), "x"), [1.0], time=10.0, events=jump)
    np.testing.assert_allclose(motion.events.time, [1.0, 3.0, 5.0, 7.0, 9.0], atol=1e-8)


@pytest.mark.parametrize(("keywords", "n"), [({"terminal": True}, 1), ({"most": 3}, 3)])
def test_surfaces_that_end(keywords, n):
    change = Event(lambda x: x[0] - 2, direction=1, to=lambda x: (0, x[1] + 1), **keywords)
    motion = flow(CLOCK, [[0.0, 0.0], [1.0, 0.0]], time=20.0, events=change)
    np.testing.assert_allclose(motion.end, [2 * n, 2 * n - 1], rtol=1e-12)
    assert motion.status.tolist() == [Status.STOPPED] * 2
    assert "stopped: 2 of 2" in repr(motion)
    assert motion.events.count.ravel().tolist() == [n, n]
    assert np.isnan(motion.states).all()


@pytest.mark.filterwarnings("ignore:.*have events that follow one another")
def test_endless_changes_at_one_instant():
    changes = [
        Event(lambda x: x[0] - 1, direction=1, to=lambda x: (0, x[1])),
        Event(lambda x: x[0] - 0.5, direction=-1, to=lambda x: (2, x[1])),
    ]
    motion = flow(CLOCK, [0.0, 0.0], time=3.0, events=changes)
    assert (motion.status, motion.end) == (Status.ACCUMULATES, pytest.approx(1.0))


@pytest.mark.parametrize("apart", [0.0, 1e-15, 1e-13, 1e-9])
def test_many_that_act_once_within_an_instant_go_on(apart):
    """Seventy neurons in step spike four times, ln 3 apart."""
    N = range(70)
    cells = Field(lambda v: tuple(1.5 - v[k] for k in N), [f"v{k}" for k in N])

    def fires(k):
        to = tuple("0" if j == k else f"v{j}" for j in N)
        return Event(lambda v: v[k] - 1, direction=1, to=to)

    found = flow(cells, apart * np.arange(70), time=5.0, events=[fires(k) for k in N]).events
    assert found.count.tolist() == [4] * 70
    np.testing.assert_allclose(found.time, np.repeat(np.log(3) * np.arange(1, 5), 70), atol=1e-6)


@pytest.mark.filterwarnings("ignore:.*have events that follow one another")
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


# -------------------------------------------------------------------------------- derivatives
def by_complex_steps(f, values):
    """Return the derivatives of f(*values) by each value, in the last axis."""
    columns = []
    for k in range(len(values)):
        own = [value + 1e-30j * (j == k) for j, value in enumerate(values)]
        columns.append(np.imag(f(*own)) / 1e-30)
    return np.stack(columns, -1)


def state_of_ball(h, v, g, e, t):
    """Return the state at time t of a ball that bounces."""
    first = (v + np.sqrt(v * v + 2.0 * g * h)) / g
    up = e * (g * first - v)
    while np.real(first + 2.0 * up / g) <= t:
        first, up = first + 2.0 * up / g, e * up
    s = t - first
    return np.array([up * s - g * s * s / 2.0, up - g * s])


@pytest.mark.parametrize(("count", "stiff"), [(1, None), (9, False), (9, True)])
def test_derivatives_through_bounces(count, stiff):
    values, time = (1.0, 0.3, 9.81, 0.9), [1.0, 2.0, 5.0]
    motion = flow(BALL, [values[:2]] * count, time=time, events=BOUNCE, stiff=stiff,
                  derivatives=("x0", "g", "e"))  # fmt: skip
    right = [by_complex_steps(lambda *a, t=t: state_of_ball(*a, t), values) for t in time]
    found = [motion.derivatives["x0"], *(motion.derivatives[p][..., None] for p in "ge")]
    found = np.concatenate(found, axis=-1)[:, -1]
    np.testing.assert_allclose(found, right, rtol=1e-10)


def test_derivatives_of_spikes_by_the_current_and_the_threshold():
    def potential(I, threshold):
        period = np.log(I / (I - threshold))
        return I * (1.0 - np.exp(np.floor(np.real(7.3 / period)) * period - 7.3))

    neuron = Field(lambda x, I, threshold: (I - x[0],), "v", I=1.5, threshold=1.0)
    spike = Event(lambda x, threshold: x[0] - threshold, direction=1, to=lambda x: (0,))
    motion = flow(neuron, [0.0], time=7.3, events=spike, derivatives=("I", "threshold"))
    found = [motion.derivatives[name][0, 0] for name in ("I", "threshold")]
    np.testing.assert_allclose(found, by_complex_steps(potential, (1.5, 1.0)), rtol=3e-9)


def test_derivatives_of_doses_at_time_0_and_later():
    def amounts(k, dose):
        s = 6.0 - np.array([0.0, 1.0, 5.0])
        first = np.exp(-k * s)
        return dose * np.array([first.sum(), (k / (0.1 - k) * (first - np.exp(-0.1 * s))).sum()])

    dose = Event(times=[0, 1, 5], **DOSE)
    motion = flow(GUT, [0.0, 0.0], time=[0.0, 6.0], events=dose, derivatives=("k", "dose"))
    found = np.stack([motion.derivatives[name] for name in ("k", "dose")], -1)
    np.testing.assert_array_equal(found[0], [[0.0, 1.0], [0.0, 0.0]])
    np.testing.assert_allclose(found[1], by_complex_steps(amounts, (1.0, 100.0)), rtol=1e-8)


def test_a_second_change_at_an_instant_has_the_time_of_the_first():
    """A crossing makes the clock cross another surface: its columns move with the first one."""
    clock = Field(lambda x, a: (1.0 + 0.5 * x[1], 0.0), "t r", a=1.0)
    changes = [
        Event(lambda x, a: x[0] - a, direction=1, to=lambda x: (x[0] + 1, 1)),
        Event(lambda x: x[0] - 1.5, direction=1, to=lambda x: (2 * x[0], 3 * x[1])),
    ]
    motion = flow(clock, [0.0, 0.0], time=2.0, events=changes, derivatives=("x0", "a"))
    # x(2) = 2 (a + 1) + 2.5 (2 - (a - t_0)), with r = 3
    np.testing.assert_allclose(motion.states, [[6.5, 3.0]], rtol=1e-12)
    np.testing.assert_allclose(motion.derivatives["a"], [[-0.5, 0.0]], rtol=1e-12)
    np.testing.assert_allclose(motion.derivatives["x0"][0, :, 0], [2.5, 0.0], rtol=1e-12)


def test_derivatives_where_f_jumps_at_a_change():
    """Friction and a bounce: f has the other sign after it."""
    f = Field(lambda x, mu: (x[1], -1 - mu * np.sign(x[1])), "h v", mu=0.25)
    bounce = Event("h", direction=-1, to=lambda x: (x[0], -x[1]))

    def state(h, mu):  # at t = 3: falls with 1 - mu, and rises with 1 + mu
        fall = np.sqrt(2 * h / (1 - mu))
        v, s = (1 - mu) * fall, 2.0 - fall
        return np.array([v * s - (1 + mu) * s * s / 2, v - (1 + mu) * s])

    motion = flow(f, [1.0, 0.0], time=2.0, events=bounce, derivatives=("x0", "mu"))
    found = np.stack([motion.derivatives["x0"][0, :, 0], motion.derivatives["mu"][0]], -1)
    np.testing.assert_allclose(found, by_complex_steps(state, (1.0, 0.25)), rtol=1e-9)


def test_a_dose_over_a_section_is_recorded():
    section = Event(lambda x: x[0] - 1)
    dose = Event(times=[0.0, 2.0], to=lambda x: (x[0] + 2,))
    found = flow(DECAY, [0.0], time=2.5, events=[section, dose]).events
    assert found.which.tolist() == [1, 0, 0, 1, 0]
    np.testing.assert_allclose(found.time, [0.0, 0.0, np.log(2), 2.0, 2.0], rtol=1e-9)


@pytest.mark.parametrize(("start", "period"), [([0.0, 0.5], 1.0), ([0.3, 1.5], None)])
def test_spiking_cycles(start, period):
    f = Field(lambda x, I, a: (I - x[0], -a * x[1]), "v w", I=1.5, a=0.3)
    spike = Event(lambda x: x[0] - 1, direction=1, to=lambda x: (0, x[1] + 0.5))
    orbit = periodic_orbit(f, start, period, events=spike)
    T = np.log(3.0)
    assert abs(orbit.period - T) < 1e-10
    np.testing.assert_allclose(orbit.multipliers, [1.0, np.exp(-0.3 * T)], rtol=1e-9)
    motion = flow(f, orbit.state, time=[T, 2 * T], events=spike, rtol=1e-12)
    np.testing.assert_allclose(motion.states, [orbit.state] * 2, rtol=1e-9)


def by_differences(field, orbit, changes):
    """Return the multipliers, and 1 for a clock, by differences of motions, the largest first."""
    near = 1e-6 * np.eye(len(orbit.state))
    starts = orbit.state + np.array([near, -near])
    above, below = flow(field, starts, time=orbit.period, events=changes, rtol=1e-12).states[0]
    return np.linalg.eigvals((above - below) / 2e-6)


def test_the_simplest_walker():
    """On a slope of .009: a stable walk, of the long period, with the state after a step."""

    def legs(s):
        theta, phi, u, v = s
        pull = np.sin(theta - 0.009)
        return u, v, pull, pull + np.sin(phi) * (u**2 - np.cos(theta - 0.009))

    def step(s):
        c = np.cos(2 * s[0])
        return -s[0], -2 * s[0], c * s[2], c * (1 - c) * s[2]

    field = Field(legs, "theta phi u v")
    strike = Event(lambda s: s[1] - 2 * s[0], direction=1, to=step)
    orbit = periodic_orbit(field, [0.2, 0.4, -0.2, -0.02], events=strike)
    found = flow(field, orbit.state, time=orbit.period, events=strike).events.states
    np.testing.assert_allclose(found, [[0.2003, 0.4006, -0.1998, -0.0158]], atol=5e-5)
    pair = -0.1900998 + np.array([0.5575988j, -0.5575988j])
    np.testing.assert_allclose(orbit.multipliers, [1.0, *pair, 0.0], atol=1e-7)
    right = by_differences(field, orbit, strike)
    for multiplier in orbit.multipliers:
        assert abs(right - multiplier).min() < 1e-7


def test_a_ball_on_a_vibrating_table():
    """It bounces once in a period at the phase p with A cos p = pi (1 - e)/(1 + e), g = 1."""
    e, T = 0.5, 2 * np.pi
    of_cos, of_sin = T / 2 * (1 - e) / (1 + e), 1.5 / (1 + e) ** 2
    A, p = np.hypot(of_cos, of_sin), np.arctan2(of_sin, of_cos)
    ball = Field(lambda s, A: (s[1], -1.0, 1.0), "h v t", A=A)
    hit = Event(lambda s, A: s[0] - A * np.sin(s[2]), direction=-1,
                 to=lambda s, A: (s[0], -e * s[1] + (1 + e) * A * np.cos(s[2]), s[2]))  # fmt: skip
    start = [A * np.sin(p) + T**2 / 8 + 0.01, 0.01, p + T / 2]
    orbit = periodic_orbit(ball, start, T, events=hit)
    # Of multipliers m: m**2 - (1 + e**2 - (1 + e)**2 A sin p) m + e**2 = 0.
    right = np.roots([1.0, -(1 + e**2 - 1.5), e**2])
    np.testing.assert_allclose(
        np.sort_complex(orbit.multipliers), np.sort_complex(right), rtol=1e-8
    )
    with pytest.raises(ValueError, match=r"^period must be given"):
        periodic_orbit(ball, start, events=hit)
    with pytest.raises(ValueError, match=r"^period must be a time after which the force"):
        periodic_orbit(ball, start, 1.1 * T, events=hit)


@pytest.mark.filterwarnings("ignore:.*have events that follow one another")
def test_balls_that_come_to_rest_on_a_vibrating_table():
    """The height above it is rounding long before 12 bounces follow one another at once."""
    ball = Field(lambda s, A: (s[1], -1.0, 1.0), "h v t", A=[0.6, 1.0, 3.0])
    hit = Event(lambda s, A: s[0] - A * np.sin(s[2]), direction=-1,
                 to=lambda s, A: (s[0], -0.5 * s[1] + 1.5 * A * np.cos(s[2]), s[2]))  # fmt: skip
    motion = flow(ball, [5.0, 0.0, 0.0], time=100.0, events=hit)
    assert (motion.status == Status.ACCUMULATES).all()
    assert motion.events.count.max() < 200
    changes, A = motion.events, ball.parameters["A"]
    speeds = changes.before[:, 1] - A[changes.trajectory] * np.cos(changes.time)
    for k in range(3):  # pauses become shorter by the factor e until then
        times = changes.time[(changes.trajectory == k) & (abs(speeds) > 1e-5)]
        limit = times[-1] + np.diff(times)[-1]
        assert abs(motion.end[k] - limit) < 1e-5


def test_a_change_at_a_knot_of_f():
    """From there a step ends on the knot, so near that the state does not move."""
    spring = Field(lambda s: (s[1], np.interp(s[0], [-1, 0.4, 1], [1, 0, -2])), "x v")
    bounce = Event(lambda s: s[0] - 0.4, to=lambda s: (s[0], -0.7 * s[1]), direction=1)
    motion = flow(spring, [0.4, -0.5], time=2.0, events=bounce)
    np.testing.assert_allclose(
        motion.states[0], flow(spring, [0.4, -0.5], time=2.0).states[0], atol=1e-12
    )


@pytest.mark.filterwarnings("ignore:.*have events that follow one another")
def test_bounces_that_accumulate_away_from_0():
    """There the state does not move any more while its value on the surface is not 0."""
    push = Field(lambda s: (s[1], -s[0] - 50 * (s[1] - np.where(s[0] > 0, 0.5, -0.2))), 2)
    bounce = Event(lambda s: s[0] - 0.4, to=lambda s: (s[0], -0.7 * s[1]), direction=1)
    starts = np.random.default_rng(1).normal(size=(20, 2))
    motion = flow(push, starts, time=10.0, events=bounce)
    assert set(motion.status.tolist()) <= {Status.OK, Status.ACCUMULATES}
