"""Solutions that slide along surfaces at which f jumps, beside Filippov's solutions by SciPy."""

import numpy as np
import pytest
from scipy.optimize import brentq
from systems import rubbing

from suslov_fast import Event, Field, Status, crossings, flow, load

from ..filippov import Undecided, solution

COUNT = 50
MOST_UNDECIDED = 8  # of COUNT cases that the reference leaves undecided, or that end


class Family:
    """A random family of equations with signs m of surfaces s(x): f(x, m, p) with parameters p."""

    def __init__(self, names, f, surfaces, ranges, starts, time):
        rng = np.random.default_rng(11)
        self.f, self.surfaces, self.time = f, surfaces, time
        self.parameters = {
            name: rng.uniform(*pair, COUNT) if len(pair) == 2 else rng.choice(pair, COUNT)
            for name, pair in ranges.items()
        }
        self.starts = np.stack([rng.uniform(low, high, COUNT) for low, high in starts], axis=1)

        def right(x, **p):
            return f(x, [np.sign(a) for a in surfaces(x, **p)], **p)

        self.field = Field(right, names, **self.parameters)

    def right(self, k, max_step):
        """Return the reference's last state of case k."""
        p = {name: float(values[k]) for name, values in self.parameters.items()}
        f, surfaces = lambda x, m: self.f(x, m, **p), lambda x: self.surfaces(x, **p)
        return solution(f, surfaces, self.starts[k], self.time, max_step=max_step)[0]


def _network(x, m, **p):
    drive = (p[f"k{i}"] * (0.5 + 0.5 * p[f"q{i}"] * m[i - 1]) for i in range(3))
    return [a + 0.5 * p[f"z{i}"] * (1 + m[i]) - x[i] for i, a in enumerate(drive)]


def _quadrants(x, m, **p):
    return [
        sum(
            p[f"a{i}{2 * (u > 0) + (v > 0)}"] * (1 + u * m[0]) / 2 * (1 + v * m[1]) / 2
            for u in (-1, 1)
            for v in (-1, 1)
        )
        - x[i]
        for i in range(2)
    ]


def _halves(x, m, **p):
    def side(i, a, b, c):
        return p[f"{a}{i}"] * x[0] + p[f"{b}{i}"] * x[1] + p[f"{c}{i}"]

    return [
        (1 + m[0]) / 2 * side(i, "a", "b", "c") + (1 - m[0]) / 2 * side(i, "d", "e", "g")
        for i in (1, 2)
    ]


UNIT = (-1.0, 1.0)
FAMILIES = {
    "belt": lambda: Family(
        "x v",
        lambda x, m, b, c, k: (x[1], -x[0] - c * x[1] - k * m[0]),
        lambda x, b, **_: [x[1] - b],
        {"k": (0.1, 0.8), "b": (0.1, 0.8), "c": (0, 0.2)},
        [UNIT, UNIT],
        20.0,
    ),
    "Stribeck": lambda: Family(
        "x v",
        lambda x, m, b, k: (x[1], -x[0] - k * m[0] * (1 + 1 / (1 + 2 * m[0] * (x[1] - b))) / 2),
        lambda x, b, **_: [x[1] - b],
        {"k": (0.3, 0.8), "b": (0.1, 0.6)},
        [UNIT, UNIT],
        30.0,
    ),
    "sliding-mode control": lambda: Family(
        "x y z t",
        lambda x, m, a, c, d, k: (x[1], x[2], -a * x[1] - k * m[0] + d * np.sin(2 * x[3]), 1.0),
        lambda x, c, **_: [x[0] + c * x[1] + x[2]],
        {"k": (3, 6), "c": (1.5, 3), "d": (0, 0.8), "a": UNIT},
        [UNIT, UNIT, UNIT, (0, 0)],
        20.0,
    ),
    "two blocks": lambda: Family(
        "x v y u",
        lambda x, m, k, l, q: (
            x[1],
            -x[0] - q * (x[0] - x[2]) - k * m[0],
            x[3],
            -x[2] + q * (x[0] - x[2]) - l * m[1],
        ),
        lambda x, **_: [x[1] - 0.3, x[3] - 0.3],
        {"k": (0.2, 0.8), "l": (0.2, 0.8), "q": (0.3, 2)},
        [UNIT] * 4,
        15.0,
    ),
    "block on block": lambda: Family(
        "x v y u t",
        lambda x, m, k, l, w, F, M: (
            x[1],
            -x[0] + F * np.sin(w * x[4]) - k * m[0] - l * m[1],
            x[3],
            l * m[1] / M,
            1.0,
        ),
        lambda x, **_: [x[1], x[1] - x[3]],
        {"k": (0.1, 0.4), "l": (0.1, 0.5), "M": (0.5, 2), "F": (0.8, 2), "w": (0.5, 1.5)},
        [UNIT, UNIT, (0, 0), UNIT, (0, 0)],
        20.0,
    ),
    "thermostat": lambda: Family(
        "T h t",
        lambda x, m, a, b, e, g, k: (
            -a * (x[0] - 5 * np.sin(x[2] / 3)) + x[1],
            b * (k * (1 - m[0]) / 2 - x[1]) - g * m[0],
            1.0,
        ),
        lambda x, e, **_: [x[0] + e * x[1] - 20],
        {"a": (0.1, 0.4), "b": (0.5, 2), "k": (8, 15), "g": (0.5, 3), "e": (0.1, 0.5)},
        [(10, 22), (0, 3), (0, 6)],
        20.0,
    ),
    "linear in half planes": lambda: Family(
        "x y",
        _halves,
        lambda x, **_: [x[0] - 0.2 * x[1]],
        {f"{a}{i}": (-1, 0.2) if a in "ad" else UNIT for a in "abcdeg" for i in (1, 2)},
        [UNIT, UNIT],
        5.0,
    ),
    "ellipse": lambda: Family(
        "x y",
        lambda x, m, e, k, q, r, w: (
            r * x[0] - w * x[1] - k * m[0] * x[0],
            w * x[0] + r * x[1] - k * q * m[0] * x[1],
        ),
        lambda x, e, **_: [x[0] ** 2 + e * x[1] ** 2 - 1],
        {"r": (-0.2, 0.4), "w": (0.5, 2), "k": (-0.1, 0.5), "q": (0, 1), "e": (0.4, 2)},
        [UNIT, UNIT],
        10.0,
    ),
    "three genes": lambda: Family(
        "x y z",
        _network,
        lambda x, **p: [x[i] - p[f"h{i}"] for i in range(3)],
        {f"k{i}": (0.8, 2) for i in range(3)}
        | {f"q{i}": (-1.0, 1.0, 1.0) if i else (-1.0, -1.0, -1.0) for i in range(3)}
        | {f"h{i}": (0.3, 0.7) for i in range(3)}
        | {f"z{i}": (-1, 0) for i in range(3)},
        [(0, 1.5)] * 3,
        20.0,
    ),
    "quadrants": lambda: Family(
        "x y",
        _quadrants,
        lambda x, **_: [x[0] - 0.5, x[1] - 0.5],
        {f"a{i}{j}": (-1, 2) for i in range(2) for j in range(4)},
        [(0, 1.2)] * 2,
        10.0,
    ),
    "three relays": lambda: Family(
        "x y z",
        lambda x, m, **p: [
            p[f"b{i}"] - 0.2 * x[i] + sum(p[f"c{i}{k}"] * m[k] for k in range(3)) for i in range(3)
        ],
        lambda x, **_: [*x],
        {f"b{i}": UNIT for i in range(3)}
        | {f"c{i}{k}": (-1.5, -0.5) if i == k else UNIT for i in range(3) for k in range(3)},
        [UNIT] * 3,
        3.0,
    ),
}


def checked(family, cases, rtol=1e-9, stiff=None):
    """Compare cases with the reference; return how many are right: all that do not end."""
    motion = flow(family.field, family.starts, time=family.time, rtol=rtol, stiff=stiff)
    right = 0
    for k in cases:
        try:
            expected = family.right(k, max_step=0.1)
        except Undecided:
            continue
        if motion.status[k] == Status.SLIDING:
            continue
        assert motion.status[k] == Status.OK
        tolerance = {"rtol": 1e-7, "atol": max(1e-7, 1e3 * rtol)}
        if not np.allclose(motion.final[k], expected, **tolerance):
            expected = family.right(k, max_step=0.01)  # the reference may have missed crossings
        np.testing.assert_allclose(motion.final[k], expected, **tolerance)
        right += 1
    return right


@pytest.mark.filterwarnings("ignore::suslov_fast.status.IntegrationWarning")
def test_two_surfaces_beside_filippov_by_scipy():
    assert checked(FAMILIES["block on block"](), range(5)) == 5


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::suslov_fast.status.IntegrationWarning")
@pytest.mark.parametrize("name", FAMILIES)
def test_families_beside_filippov_by_scipy(name):
    assert checked(FAMILIES[name](), range(COUNT)) >= COUNT - MOST_UNDECIDED


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::suslov_fast.status.IntegrationWarning")
@pytest.mark.parametrize("name", ["belt", "Stribeck", "two blocks", "ellipse", "three genes"])
@pytest.mark.parametrize(("rtol", "stiff"), [(1e-4, None), (1e-6, True), (1e-12, None)])
def test_tolerances_and_integrators(name, rtol, stiff):
    assert checked(FAMILIES[name](), range(12), rtol, stiff) >= 9


def stribeck(s, k):
    """A block on a spring and on a belt, whose friction is weaker the faster it slips."""
    slip = s[1] - 0.3
    return s[1], -s[0] - k * np.sign(slip) * (1 + 1 / (1 + abs(slip))) / 2


def test_what_is_decided_does_not_depend_on_the_times_asked():
    """A block that leaves its belt leaves it tangentially; a time asked there changed its mode."""
    belt = Field(stribeck, "x v", k=0.4)
    starts = np.array([[0.0, 1.0], [0.0, 0.0], [0.3, 0.3], [-1.0, 0.7]])
    one, few, many = (flow(belt, starts, time=np.linspace(0, 40, n)[1:]) for n in (2, 41, 401))
    assert one.ok.all()
    np.testing.assert_allclose(few.final, one.final, atol=1e-7)
    np.testing.assert_allclose(many.final, one.final, atol=1e-7)
    np.testing.assert_allclose(many.states[9::10], few.states, atol=1e-7)


def test_a_sign_as_a_quotient():
    """x / |x| is 0 / 0 on the surface."""
    block, same = (
        Field(lambda s, f=f: (s[1], -s[0] - 0.4 * f(s[1] - 0.3)), "x v")
        for f in (np.sign, lambda u: u / abs(u))
    )
    expected = flow(block, [0.5, 1.0], time=20.0).final
    np.testing.assert_allclose(flow(same, [0.5, 1.0], time=20.0).final, expected, atol=1e-9)


@pytest.mark.slow
def test_a_chain_of_ten_blocks_sticks():
    """All blocks ride on the belt as long as the springs are weak."""
    n, springs = 10, np.eye(10, k=1) + np.eye(10, k=-1)
    springs -= np.diag(springs.sum(axis=0))
    chain = Field(lambda s: [*s[n:], *(springs @ s[:n] - np.sign(s[n:] - 0.1))], 2 * n)
    motion = flow(chain, [0.0] * (2 * n), time=5.0)
    # Friction of 1 takes each block from v = 0 to 0.1 within 0.1.
    np.testing.assert_allclose(motion.final[:n], 0.005 + 0.1 * 4.9, atol=1e-9)
    np.testing.assert_allclose(motion.final[n:], 0.1, atol=1e-12)


@pytest.mark.filterwarnings("ignore::suslov_fast.status.IntegrationWarning")
def test_what_is_not_continued():
    """Filippov's mixture of a product of signs is not unique where both surfaces slide."""
    product = Field(
        lambda s: (
            -np.sign(s[0]) - 0.5 * np.sign(s[0]) * np.sign(s[1]),
            -np.sign(s[1]) + 0.3 * np.sign(s[0]) * np.sign(s[1]),
        ),
        "x y",
    )
    motion = flow(product, [[1.0, 0.5], [1.0, 9.0]], time=3.0)
    assert motion.status.tolist() == [Status.SLIDING, Status.OK]
    assert abs(motion.final[1, 0]) < 1e-12
    quantizer = Field(lambda s: (s[1], -s[0] - 0.15 * np.floor(s[1])), "x v")
    assert flow(quantizer, [1.0, 0.0], time=20.0).status == Status.SLIDING


def test_events_while_a_block_sticks():
    """Records, a kick at a given time, and a terminal event see the block stick at v = 0.3."""
    belt = Field(rubbing, "x v", k=0.4)
    events = [
        Event("x - 0.1", direction="up"),
        Event(times=[0.5], to=lambda s: (s[0], s[1] - 1.0)),
        Event("x - 0.35", terminal=True),
    ]
    motion = flow(belt, [0.0, 0.3], time=10.0, events=events)
    first = motion.events.time[motion.events.which == 0][0]
    assert first == pytest.approx(1 / 3, abs=1e-9)
    kicked = motion.events.states[motion.events.which == 1]
    np.testing.assert_allclose(kicked, [[0.15, -0.7]], atol=1e-12)
    assert motion.status == Status.STOPPED
    np.testing.assert_allclose(motion.final, [0.35, 0.3], atol=1e-9)


def test_phases_of_a_belt(tmp_path):
    """From rest on the belt the block is pulled off at x = k, after k / 0.3."""
    k = np.array([0.4, 0.3])
    belt = Field(rubbing, "x v", k=k)
    motion = flow(belt, [0.0, 0.3], time=[1.0, 10.0])
    phases = motion.phases
    begins = phases.time == 0.0
    assert phases.mode[begins].tolist() == ["slides"] * 2
    assert set(phases.surface) == {"v - 0.3"}
    for i in range(2):
        own = phases.trajectory == i
        assert phases.mode[own].tolist()[:3] == ["slides", "leaves", "slides"]
        # Then it swings about x = k / 0.3 from there and comes back with v = 0.3 a period later.
        assert phases.time[own][1] == pytest.approx(k[i] / 0.3, abs=1e-9)
        own_run = motion.member(i).phases
        assert own_run.time.tolist() == phases.time[own].tolist()
        assert not own_run.trajectory.any()
    motion.save(tmp_path / "run.npz")
    assert load(tmp_path / "run.npz") == motion
    assert load(tmp_path / "run.npz").phases.mode.tolist() == phases.mode.tolist()
    assert len(flow(belt, [0.0, 0.3], time=0.5).phases.to_dataframe()) == 2
    assert not len(flow(Field(lambda x: (-x[0],), "x"), [1.0], time=1.0).phases.time)


def test_starts_on_a_surface_along_which_the_solution_slides():
    """There is no time yet to which the times between changes are short; f has a kink there."""
    belt = Field(stribeck, "x v", k=[0.4, 0.8])
    motion = flow(belt, [0.0, 0.3], time=[1.0, 30.0])
    np.testing.assert_allclose(motion.states[0], [[0.3, 0.3]] * 2, atol=1e-12)
    assert motion.ok.all()
    assert motion.steps.max() < 500


@pytest.mark.parametrize("at", [0.0, 0.1])
def test_events_on_the_surface_of_sliding_are_no_rounding(at):
    """One for each solution that comes to the surface and stays there; x0 decides which ones do."""
    rng = np.random.default_rng(9)
    k, c, (x, y) = rng.uniform(0.3, 1.5, 300), rng.uniform(-2, 2, 300), rng.normal(0, 1.5, (2, 300))
    f = Field(lambda s, k, c: (c * s[1] - k * np.sign(s[0] - at), -0.2 * s[1]), "x y", k=k, c=c)
    slow = abs(c * y) < k  # so that all come to the surface and slide for good
    assert slow.sum() > 100
    for to in (None, lambda s: (s[0], 0.7 * s[1])):
        event = Event(lambda s: s[0] - at, to=to)
        motion = flow(f, np.stack([x, y], axis=1), time=[30.0, 60.0], events=event)
        assert (np.bincount(motion.events.trajectory, minlength=300)[slow] == 1).all()
    soon = slow & (abs(x) < 20 * (k - abs(c * y)))  # before 30
    right = 0.7 * y * np.exp(-6.0)
    np.testing.assert_allclose(motion.states[0, soon, 1], right[soon], rtol=1e-7)


@pytest.mark.filterwarnings("ignore:events. x0 rests:UserWarning")
@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_crossings_where_a_block_sticks_and_leaves(rtol):
    """Each comes to v = 0 from one side, sticks, and goes on to the other: two crossings a time."""
    mu = np.linspace(1.2, 1.95, 20)
    field = Field(lambda s, mu: (2 * np.sin(s[1]) - mu * np.sign(s[0]), 1.0), "v c", mu=mu)
    surface, same = Event("v"), lambda s: s
    both = [surface, Event("v", to=same)]
    found = [flow(field, [0.0, 0.0], time=20, events=e, rtol=rtol) for e in ([surface], both)]
    for k, m in enumerate(mu):
        first = np.arcsin(m / 2)

        def speed(t, a=first, m=m):
            return 2 * (np.cos(a) - np.cos(t)) - m * (t - a)

        comes = brentq(speed, first + 0.5, first + 3.1)
        right = np.sort(np.add.outer([first, comes], np.pi * np.arange(7)).ravel())
        right = right[right < 20]
        for motion in found:
            events = motion.member(k).events
            own = events.time[events.which == 0]
            np.testing.assert_allclose(own, right, atol=100 * rtol + 1e-8)
    most = crossings(field.with_parameters(mu=1.5), [0.0, 0.0], "v", time=20, most=4, transient=2)
    assert most.time.shape == (4,)


@pytest.mark.parametrize("level", [2.0, 2.0 + 2.0**-30])
def test_constants_are_no_numbers_of_variables(level):
    """z is variable number 2, and the surfaces y = 2.0 and y = z are not one."""
    field = Field(
        lambda s: (1.0, 0.2 * s[0] - 1.5 * np.sign(s[1] - level) - np.sign(s[1] - s[2]), 0.3),
        "x y z",
    )
    motion = flow(field, [0.0, 0.5, 4.0], time=[2.0, 3.0, 20.0])
    left = level + 0.1 * (3.0 - 2.5) ** 2
    np.testing.assert_allclose(motion["y"][:2], [level, left], rtol=1e-9)
    assert "y - z" in motion.phases.surface


def test_a_quotient_beside_a_modulus():
    """|x| is value number 3; y / 3 is no quotient by this value."""
    field = Field(lambda s: (-abs(s[0]), s[1] / 3.0, -np.sign(s[2])), "x y z")
    final = flow(field, [1.0, 2.0, 3.0], time=4.0).final
    np.testing.assert_allclose(final, [np.exp(-4.0), 2.0 * np.exp(4 / 3), 0.0], atol=1e-8)


def clutches(drive, strength, closes):
    """Return discs in a row; clutch k has the torque strength(k, t) from the time closes[k] on."""

    def right(s):
        t, n = s[-1], len(closes)
        torques = [
            np.where(t >= closes[k], strength(k, t), 0.0) * np.sign(s[k] - s[k + 1])
            for k in range(n)
        ]
        return [a - b for a, b in zip([drive(t), *torques], [*torques, 0.0], strict=True)] + [1.0]

    return Field(right, len(closes) + 2)


@pytest.mark.parametrize("torque", [1.0, -1.0])
def test_open_clutches_between_discs_at_equal_speeds(torque):
    """Jumps are 0 before t = 1, and before t = 9. Disc 1 drives disc 2, to its speed at t = 2."""
    field = clutches(lambda t: torque, lambda k, t: 1.0, [1.0, 9.0])
    motion = flow(field, np.zeros(4), time=[1.0, 2.0, 4.0])
    right = torque * np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    np.testing.assert_allclose(motion.states[..., :3], right, atol=1e-12)


def test_a_chain_of_clutches_that_close_one_after_the_other():
    """All discs begin at rest, where no clutch has a jump; from 1.1 on they turn as one."""
    w = 0.4 * np.pi
    field = clutches(
        lambda t: 10.0 * np.sin(w * t),
        lambda k, t: 10.0 * (np.sin(w * t) if k == 0 else 1.0),
        [0.0, 0.4, 0.9],
    )
    motion = flow(field, np.zeros(5), time=[0.3, 0.8, 1.2, 1.5])
    turned = np.array([[1, 1, 0, 0], [1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 1, 1]])
    right = 10.0 / w * (1.0 - np.cos(w * motion.time)) / turned.sum(axis=1)
    np.testing.assert_allclose(motion.states[..., :4], right[:, np.newaxis] * turned, atol=1e-9)


def test_motions_wind_into_the_point_where_two_surfaces_meet(rng):
    """Filippov's example: |x - a| + |y - b| falls at the rate 2 to 0, and stays there."""
    n = 100
    a, b = np.where(np.arange(n) < n // 2, 0.0, rng.normal(0.0, 1.0, (2, n)))
    field = Field(
        lambda s, a, b: (
            2 * np.sign(s[1] - b) - np.sign(s[0] - a),
            -2 * np.sign(s[0] - a) - np.sign(s[1] - b),
        ),
        "x y",
        a=a,
        b=b,
    )
    away = rng.normal(0.0, 10.0 ** rng.uniform(-2, 1, n), (2, n))
    starts = np.stack([a + away[0], b + away[1]], axis=1)
    motion = flow(field, starts, time=np.linspace(0.0, 20.0, 41))
    assert motion.ok.all()
    far = abs(motion["x"] - a) + abs(motion["y"] - b)
    right = np.maximum(far[0] - 2.0 * motion.time[:, np.newaxis], 0.0)
    np.testing.assert_allclose(far, right, atol=1e-8)


@pytest.mark.parametrize("rtol", [1e-6, 1e-9, 1e-12])
def test_a_motion_winds_into_a_corner_and_leaves_it(rtol):
    """The push t is held to 2.5, then x to 3: y = -(t - 2.5)**2, x = (t - 3)**2 / 2."""
    field = Field(
        lambda s: (2 * np.sign(s[1]) - np.sign(s[0]) + s[2], -2 * np.sign(s[0]) - np.sign(s[1]), 1),
        "x y t",
    )
    motion = flow(field, [0.1, 0.1, 0.0], time=[1.0, 2.5, 3.0, 4.0], rtol=rtol)
    right = [[0.0, 0.0], [0.0, 0.0], [0.0, -0.25], [0.5, -1.25]]
    np.testing.assert_allclose(motion.states[:, :2], right, atol=1e-10)


@pytest.mark.parametrize("stiff", [None, True])
@pytest.mark.parametrize("n", [3, 4])
def test_relays_that_meet_are_left_one_after_the_other(n, stiff):
    """In x' = b t - sign(x) - c sum(sign(x)) all signs are w, with x' = 0, until the first is 1.

    With the sum S of the w of relays that are held, and m that are left, w = b t - c (S + m).
    """
    c, b = 0.3, 1.0 - 0.2 * np.arange(n)

    def rates(x, signs):
        total = c * sum(signs)
        return [*(b[i] * x[n] - signs[i] - total for i in range(n)), 1.0]

    field = Field(lambda x: rates(x, [np.sign(a) for a in x[:n]]), n + 1)
    starts = np.zeros((2, n + 1))
    starts[1, :n] = 0.1 * np.arange(n) - 0.15
    motion = flow(field, starts, time=[1.0, 8.0], stiff=stiff)
    assert motion.ok.all()
    for x, start in zip(motion.final, starts, strict=True):
        right, _ = solution(rates, lambda x: x[:n], start, 8.0)
        np.testing.assert_allclose(x, right, atol=1e-7)
    np.testing.assert_allclose(motion.states[0, :, :n], 0.0, atol=1e-13)
    held = n - np.arange(n)
    # The sum over the held ones: (1 + c held) S = B t - c held m.
    B, m = np.cumsum(b[::-1])[::-1], np.arange(n)
    share = c / (1 + c * held)
    left = (1 + c * m * (1 - share * held)) / (b - share * B)
    phases = motion.phases
    leaves = (phases.trajectory == 0) & (phases.mode == "leaves")
    np.testing.assert_allclose(phases.time[leaves], left[left < 8.0], rtol=1e-9)


@pytest.mark.parametrize("stiff", [None, True])
def test_components_at_rest_do_not_shorten_steps(stiff):
    """Where three coupled relays hold their states at 1e-17, only rounding changes these."""
    rng = np.random.default_rng(11)
    b, C = rng.uniform(-1, 1, (3, 40)), rng.uniform(-1, 1, (3, 3, 40))
    C[range(3), range(3)] -= 2.0
    p = {f"b{i}": b[i] for i in range(3)} | {
        f"c{i}{k}": C[i, k] for i in range(3) for k in range(3)
    }
    field = Field(
        lambda s, **p: [
            p[f"b{i}"] - 0.2 * s[i] + sum(p[f"c{i}{k}"] * np.sign(s[k]) for k in range(3))
            for i in range(3)
        ],
        3,
        **p,
    )
    motion = flow(field, rng.uniform(-1, 1, (40, 3)), time=3.0, stiff=stiff)
    assert motion.ok.all()
    assert motion.steps.max() < 500


@pytest.mark.parametrize("others", [0, 1, 2])
def test_motions_wind_into_a_corner_though_one_surface_repels(rng, others):
    """f leads away from y = 0, but each turn ends nearer to the corner of x = 0 and y = 0.

    A turn changes the distance by the factor .37, the product of y' / x' in two quadrants and of
    x' / y' in the two others. `others` further relays come to rest, coupled with the first.
    """
    size = 2 + others

    def rates(s):
        x, y, *signs = [np.sign(a) for a in s]
        last = [-u + 0.1 * x + 0.2 * sum(signs) - 0.2 * u for u in signs]
        return [-x - 2 * y, 3 * x + 0.5 * y, *last]

    starts = rng.uniform(-1.0, 1.0, (40, size))
    motion = flow(Field(rates, size), starts, time=40.0)
    assert motion.ok.all()
    np.testing.assert_allclose(motion.final, 0.0, atol=1e-9)


@pytest.mark.filterwarnings("ignore::suslov_fast.status.IntegrationWarning")
def test_a_corner_from_which_there_are_two_solutions():
    """At x = 0 the signs may become -.3 and .825, for ever, or x' = .15 and y' = 2.75."""
    field = Field(
        lambda s: (
            0.9 + 0.25 * np.sign(s[0]) - np.sign(s[1]),
            1.5 + 2.25 * np.sign(s[0]) - np.sign(s[1]),
        ),
        "x y",
    )
    motion = flow(field, [-1.4, 0.0], time=2.0)  # slides along y = 0 with x' = 1.4
    assert motion.status == Status.SLIDING
    np.testing.assert_allclose(motion.end, 1.0, rtol=1e-12)


def test_derivatives_where_relays_meet():
    """All relays are reached at once, and held: states do not depend on the start."""
    field = Field(lambda s: [-np.sign(a) - 0.2 * sum(map(np.sign, s)) for a in s], 3)
    motion = flow(field, [[0.8, 0.8, 0.8], [0.8, 0.3, -0.4]], time=2.0, derivatives="x0")
    np.testing.assert_allclose(motion.final, 0.0, atol=1e-14)
    np.testing.assert_allclose(motion.derivatives["x0"][-1], 0.0, atol=1e-12)


def relays(given, of):
    """x' = b + C sign(G x - d) for arrays `of` by name; those named in `given` are parameters."""
    parameters = {f"{n}{k}": a for n in given.split() for k, a in enumerate(np.ravel(of[n]))}

    def f(x, **p):
        b, C, G, d = (
            np.array([p.get(f"{n}{k}", a) for k, a in enumerate(np.ravel(of[n]))]).reshape(
                np.shape(of[n])
            )
            for n in "bCGd"
        )
        s = [
            np.sign(sum(a * y for a, y in zip(row, x, strict=True)) - c)
            for row, c in zip(G, d, strict=True)
        ]
        return tuple(
            a + sum(c * y for c, y in zip(row, s, strict=True)) for a, row in zip(b, C, strict=True)
        )

    return Field(f, "x y", **parameters)


@pytest.mark.parametrize(("turn", "level"), [
    (1.0, 0.3), (-1.0, 1.0),
    pytest.param(1.0, 1.0, marks=pytest.mark.slow), pytest.param(-1.0, 0.3, marks=pytest.mark.slow),
])  # fmt: skip
@pytest.mark.parametrize("by", ["d", "G d", "b C G d"])
def test_two_surfaces_that_parameters_make_one(by, turn, level):
    """Rows 0 and 2 of s = G x - d are one plane, y = d0, from t = d0 on; there x' = -1, y' = 0."""
    C = np.array([[2.0, -1.0, -2.0 * turn], [-1.0, 0.0, 0.0]])
    G = np.array([[0.0, 1.0], [-1.0, 0.0], [0.0, turn]])
    field = relays(by, {"b": [0.0, 0.0], "C": C, "G": G, "d": [level, -1.0, level * turn]})
    motion = flow(field, [-1.0, 0.0], time=[0.1, 2.0, 5.0])
    assert motion.ok
    np.testing.assert_allclose(motion.states, [[-1.1, 0.1], [-3, level], [-6, level]])


def test_a_surface_that_parameters_make_0_everywhere():
    """np.sign(0) is 0 there: the motion slides along s1 = 0 at an equilibrium."""
    C, G = [[-1.0, 0.0, -1.0], [0.0, 2.0, 1.0]], [[0.0, 0.0], [1.0, -1.0], [-1.0, -1.0]]
    field = relays("b C G d", {"b": [1.0, 0.0], "C": C, "G": G, "d": [0.0, -2.0, 0.0]})
    motion = flow(field, [-2.0, 0.0], time=5.0)
    assert motion.ok
    np.testing.assert_allclose(motion.final, [-2.0, 0.0], atol=1e-9)
    field = relays("b C G d", {
        "b": [0.5, -1.0], "C": [[-1.0, 1.0], [-1.0, -2.0]], "G": [[0.0, 0.0], [0.0, 1.0]],
        "d": [0.0, 2.0],
    })  # fmt: skip
    motion = flow(field, [0.0, 0.0], time=5.0)  # y rises at the rate 1 to 2, then x' = 0
    assert motion.ok
    np.testing.assert_allclose(motion.final, [-1.0, 2.0], atol=1e-9)


@pytest.mark.parametrize("factor", [2.0, 0.1, -3.0])
@pytest.mark.parametrize("form", ["constant", "parameter", "quotient"])
def test_surfaces_that_are_multiples_of_one(form, factor):
    """From b = 0 on f has two sides only, though it compares b and a multiple of b with 0."""
    turn = np.sign(factor)

    def f(x, k=factor):
        one = -turn * np.sign(k * x[1])
        if form == "quotient":
            one = -turn * ((k * x[1]) / abs(k * x[1]))
        return one + 0.1, -np.sign(x[1]) + 0.2 * x[0]

    field = Field(f, "a b", **({"k": factor} if form == "parameter" else {}))
    motion = flow(field, [0.5, 0.4], time=2.0)
    hit = np.roots([-0.09, -0.9, 0.4]).max()  # b = .4 - .9 t - .09 t**2, then a' = .1 - .2 a
    right = 0.5 - 0.9 * hit * np.exp(-0.2 * (2.0 - hit))
    assert motion.ok
    np.testing.assert_allclose(motion.final, [right, 0.0], atol=1e-9)


def test_three_lines_through_one_point():
    """The solution comes to the point along one of them, and stays, as with tanh(1e5 s)."""
    field = Field(
        lambda x: (-np.sign(x[0]) - 0.5 * np.sign(x[0] + x[1]), 0.2 - 0.7 * np.sign(x[1])), 2
    )
    motion = flow(field, [0.3, -0.6], time=[0.6, 2.0])  # at (0, 0) for t = 2/3
    assert motion.ok
    assert motion.end == 2.0
    np.testing.assert_allclose(motion.states, [[0.0, -0.06], [0.0, 0.0]], atol=1e-12)
