"""Periodic orbits of motions, against published values, exact ones, and other motions."""

import numpy as np
import pytest
from scipy.optimize import brentq
from systems import LORENZ, kepler, on_a_table, three_bodies, van_der_pol

import suslov_fast as sf
from suslov_fast import Event, Field, NoConvergence, flow, periodic_orbit
from suslov_fast.motions import shooting

# Those of integrals that are not known are told by one warning, which a test below asks for.
pytestmark = pytest.mark.filterwarnings("ignore:periodic_orbit found a member of a family")

VAN_DER_POL = Field(
    lambda x, mu: (x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]), "x v", mu=np.array([0.5, 1.0, 3.0])
)
VOLTERRA = Field(lambda x: (x[0] * (1 - x[1]), x[1] * (x[0] - 1)), 2)


def roessler(c):
    return Field(lambda x: (-x[1] - x[2], x[0] + 0.2 * x[1], 0.2 + x[2] * (x[0] - c)), 3)


def morris_lecar(s):
    v, w = s
    m, rest = 0.5 * (1 + np.tanh((v + 1.2) / 18)), 0.5 * (1 + np.tanh((v - 2) / 30))
    current = 90 - 2 * (v + 60) - 4.4 * m * (v - 120) - 8 * w * (v + 84)
    return current / 20, 0.04 * np.cosh((v - 2) / 60) * (rest - w)


def of_masses(s):
    """Three equal masses in the plane."""
    places, rates = s[:6].reshape(3, 2), [*s[6:]]
    for i in range(3):
        ways = [places[j] - places[i] for j in range(3) if j != i]
        rates += [*sum(d / (d[0] ** 2 + d[1] ** 2) ** 1.5 for d in ways)]
    return rates


HALO = Field(three_bodies, 6, mu=0.01215058560962404)
ARENSTORF = Field(three_bodies, 6, mu=0.012277471)
X, V = np.array([0.97000436, -0.24308753]), np.array([-0.93240737, -0.86473146])
FAR = Field(lambda x: van_der_pol([x[0] - 1e5, x[1]]), 2)
# A field, a start, an approximate period or None, the period and how exact it is, or None.
KNOWN = {
    "AB, no period": (LORENZ, [-13.76, -19.58, 27.0], None, 1.558652210716175, 1e-12),
    "AAB": (LORENZ, [-12.6, -17.0, 27.0], 2.3, 2.3059072639398, 1e-12),
    "Roessler": (roessler(5.7), [0.0, -8.4, 0.03], None, 5.881088455555, 1e-11),
    "halo": (
        HALO, [1.0134037728554581, 0, -0.1753622728109184, 0, -0.083688427472776439, 0], 1.396,
        1.3960732332950263, 1e-10,
    ),
    "Arenstorf": (
        ARENSTORF, [0.994, 0, 0, 0, -2.00158510637908252, 0], None, 17.0652165601579625, 2e-9
    ),
    "Morris-Lecar": (Field(morris_lecar, 2), [-35.0, 0.06], None, 102.72716533, 2e-9),
    "Lyapunov": (
        Field(three_bodies, 6, mu=0.01215), [0.82, 0, 0, 0, 0.1625, 0], 2.8, 2.7803, 4e-5
    ),
    "far from the origin": (FAR, [1e5 + 2.0, 0.0], 6.6, 6.6632868593231, 1e-6),
    "far from the origin, no period": (FAR, [1e5 + 2.0, 0.0], None, 6.6632868593231, 1e-6),
    "figure eight": (
        Field(of_masses, 12), [*X, *-X, 0, 0, *-V / 2, *-V / 2, *V], 6.3, 6.32591398,
        2e-8,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_published_periods(name):
    field, start, about, period, digits = KNOWN[name]
    if name == "Morris-Lecar":
        start = flow(field, start, time=500.0).states[0]
    orbit = periodic_orbit(field, start, about)
    assert abs(orbit.period / period - 1) < digits
    assert orbit.residual < 1e-10
    # Of a system with an integral 1 is double, and has the root of the errors.
    assert abs(orbit.multipliers - 1).min() < 5e-4
    back = flow(field, orbit.state, time=orbit.period, rtol=1e-12).states[0]
    assert abs(back - orbit.state).max() < 3e-8 * abs(orbit.state).max()
    if name == "Roessler":
        np.testing.assert_allclose(orbit.multipliers[:2], [-2.4039535318, 1], rtol=0, atol=1e-9)
    if field is LORENZ:  # the trace of f' is -41 / 3
        det = np.exp(-41 / 3 * orbit.period)
        np.testing.assert_allclose(np.prod(orbit.multipliers), det, rtol=0, atol=1e-13)


def test_a_family_is_followed_to_its_bifurcation():
    """Roessler's system with a = b = 0.2 doubles its period at c = 2.832445."""
    orbit = periodic_orbit(roessler(2.5), flow(roessler(2.5), [1, 1, 0], time=300.0).states[0])

    def distance(c):
        nonlocal orbit
        orbit = periodic_orbit(roessler(c), orbit.state, orbit.period)
        others = np.delete(orbit.multipliers, abs(orbit.multipliers - 1).argmin())
        return others.real.min() + 1

    assert abs(brentq(distance, 2.7, 2.9, xtol=1e-9) - 2.832445) < 1e-6


def test_several_arcs():
    """The orbit of a circle beside a saddle whose differences grow by 2e27 in a period."""
    field = Field(lambda x: (x[1], -x[0], 10 * x[2]), 3)
    orbit = periodic_orbit(field, [1.0, 0.0, 0.0], 6.0)
    assert orbit.period == pytest.approx(2 * np.pi, rel=1e-12)
    assert orbit.multipliers[0] == pytest.approx(np.exp(20 * np.pi), rel=1e-8)


def test_systems_with_an_integral():
    """Of a family of orbits one near the start is found; both multipliers are 1."""
    orbit = periodic_orbit(VOLTERRA, [1.0, 2.0], 6.8)
    assert abs(orbit.state - [1, 2]).max() < 0.1
    assert abs(orbit.multipliers - 1).max() < 1e-5
    back = sf.crossings(VOLTERRA, orbit.state, lambda x: x[0] - orbit.state[0], time=8, rtol=1e-12)
    assert abs(back.time[-1] / orbit.period - 1) < 1e-8


def test_forces_keep_their_period():
    """By a variable t, and the same by two variables: the orbit is known."""
    forced = Field(lambda s: (s[1], -s[0] - s[1] + np.cos(2 * s[2]), 1), "q p t")
    amplitude = 1 / (1 - 4 + 2j)  # of q = Re(amplitude exp(2 i t))
    for t in (0.0, 0.7):
        orbit = periodic_orbit(forced, [0.5, 0.1, t], np.pi)
        turned = amplitude * np.exp(2j * t)
        assert abs(orbit.state[:2] - [turned.real, (2j * turned).real]).max() < 1e-11
        assert orbit.state[2] == t
        assert orbit.period == np.pi
        assert len(orbit.multipliers) == 2
        assert abs(orbit.multipliers) == pytest.approx(np.exp(-np.pi / 2))
    for period in (None, 3.0, np.pi / 2, 3.1416):
        with pytest.raises(ValueError, match="period"):
            periodic_orbit(forced, [0.5, 0.1, 0.0], period)
    assert periodic_orbit(forced, [0.5, 0.1, 0.0], 3.1415927).residual < 1e-11
    own = Field(lambda s: (s[1], -s[0] - s[1] + s[2], -2 * s[3], 2 * s[2]), "q p c s")
    orbit = periodic_orbit(own, [-0.2, 0.3, 1.0, 0.0], np.pi)
    turned = amplitude * complex(*orbit.state[2:])
    assert abs(orbit.state[:2] - [turned.real, (2j * turned).real]).max() < 1e-9


@pytest.mark.parametrize(
    ("field", "start", "period", "reason"),
    [
        (LORENZ, [0, 0, 0], None, "equilibrium"),
        (VOLTERRA, [1.0, 1.0 + 1e-9], 3.0, "equilibrium"),
        (LORENZ, [1e200, 1, 1], 1.0, "ends"),
        (Field(lambda x: (1 - x[0],), 1), [0.5], None, "falls to"),
        (Field(lambda x: (1 + x[1] ** 2, x[0]), 2), [1, 1], 0.5, "orbit"),
        (
            Field(lambda x: (x[1], -x[0], 400 * x[2]), 3), [1, 0, 0],
            2 * np.pi, "range",
        ),
    ],
)  # fmt: skip
def test_what_is_no_orbit_is_told(field, start, period, reason):
    with pytest.raises(NoConvergence, match=reason):
        periodic_orbit(field, start, period)


def fitzhugh_nagumo(s, e):
    return (s[0] - s[0] ** 3 / 3 - s[1] + 0.5) / e, s[0] + 0.7 - 0.8 * s[1]


# A field, and a time in which it settles from (1, 0.5).
RELAXATION = [
    (Field(van_der_pol, 2, mu=12.0), 200.0),
    (Field(van_der_pol, 2, mu=1038.02), 6e3),
    (Field(fitzhugh_nagumo, 2, e=1e-4), 20.0),
    (Field(fitzhugh_nagumo, 2, e=2e-3), 20.0),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rtol", [1e-9, 1e-12])
@pytest.mark.parametrize(("field", "time"), RELAXATION)
def test_relaxation_cycles(field, time, rtol):
    """The period is that between sections."""
    settled = flow(field, [1.0, 0.5], time=time, rtol=1e-10).states[0]
    section = sf.crossings(field, settled, "x1", most=3, time=time, direction="up", rtol=1e-12)
    orbit = periodic_orbit(field, settled * 1.0001, rtol=rtol)
    assert orbit.period == pytest.approx(section.time[2] - section.time[1], rel=1e3 * rtol)
    assert orbit.residual < 10 * rtol


REST = {
    "Mathieu": (lambda x, v, t: -x * (1 + 0.5 * np.cos(2 * t)), np.pi, 0.0),
    "inverted": (lambda x, v, t: (1 + 99 * np.cos(20 * t)) * np.sin(x), 0.1 * np.pi, 0.0),
    "elsewhere": (lambda x, v, t: -(x - 5) * (1 + 0.5 * np.cos(2 * t)) - 0.1 * v, np.pi, 5.0),
}


@pytest.mark.parametrize("way", [0.0, 0.01])
@pytest.mark.parametrize("name", REST)
def test_rest_states_of_forced_systems(name, way):
    """Their multipliers are the question; Newton's method comes to them, too."""
    force, period, rest = REST[name]
    field = Field(lambda s: (s[1], force(*s), 1.0), "x v t")
    orbit = periodic_orbit(field, [rest + way, 0.0, 0.25], period)
    np.testing.assert_allclose(orbit.state, [rest, 0.0, 0.25], atol=1e-9)
    motion = flow(field, [rest, 0.0, 0.25], time=period, rtol=1e-12, derivatives="x0")
    expected = np.linalg.eigvals(motion.derivatives["x0"][0, :2, :2])
    np.testing.assert_allclose(sorted(abs(orbit.multipliers)), sorted(abs(expected)), rtol=1e-7)


def test_time_scales_with_its_unit():
    unit = 2.0**-14
    fast = Field(lambda x: (x[0] * (1 - 8 * x[1]) / unit, x[1] * (8 * x[0] - 1) / unit), 2)
    for about in (None, 6.5):
        one = periodic_orbit(VOLTERRA, [1.0, 2.0], about)
        other = periodic_orbit(fast, [0.125, 0.25], about and about * unit)
        np.testing.assert_allclose(8 * other.state, one.state, rtol=1e-8)
        assert abs(other.period / (one.period * unit) - 1) < 1e-8


@pytest.mark.parametrize("turns", [2, 3, 4])
def test_one_turn_of_an_orbit(turns):
    with pytest.warns(UserWarning, match=f"{turns} times around") as told:
        orbit = periodic_orbit(Field(van_der_pol, 2), [2.0, 0.0], period=6.65 * turns)
    assert len(told) == 1
    assert orbit.period == pytest.approx(6.663286859323, rel=1e-11)


def test_an_orbit_far_from_x0_is_told():
    """From this start of a three-body problem arcs close about the Earth, .81 away."""

    def H(s, mu=0.01215058560962404):
        earth, moon = np.hypot(s[0] + mu, s[1]), np.hypot(s[0] - 1 + mu, s[1])
        turning = s[1] * s[2] - s[0] * s[3]
        return (s[2] ** 2 + s[3] ** 2) / 2 + turning - (1 - mu) / earth - mu / moon

    moon = Field.from_hamiltonian(H, "x y px py")
    with pytest.warns(UserWarning, match=r"period 1\.852 .* distance of 0\.81"):
        periodic_orbit(moon, [0.82, 0, 0, 0.96], period=2.75)
    orbit = periodic_orbit(moon, [0.82, 0, 0, 0.82 + 0.16248], period=2.75)
    motion = flow(moon, orbit.state, time=np.linspace(0, orbit.period, 100))
    assert 2.69 < orbit.period < 2.8  # of Lyapunov's family, about the point at .8369
    assert (abs(motion["x"] - 0.8369) < 0.03).all()


def test_clocks_that_nothing_depends_on_or_that_stand():
    def f(s, rate):
        x, y, _, t = s
        r = 1 - x * x - y * y
        return x * r - y + 0.1 * np.cos(t), y * r + x, 1.0, rate

    with pytest.raises(ValueError, match="depend on t,"):
        periodic_orbit(Field(f, "x y phi t", rate=1.0), [1.0, 0.0, 0.0, 0.0])
    orbit = periodic_orbit(Field(f, "x y phi t", rate=0.0), [1, 0, 0, np.pi / 2])
    assert orbit.period == pytest.approx(2 * np.pi)
    np.testing.assert_allclose(orbit.multipliers, [1.0, np.exp(-4 * np.pi)], atol=1e-9)


FORCED = "x v c s", lambda s: (s[1], -0.2 * s[1] - s[0] ** 3 + 0.3 * s[2], s[3], -s[2])


@pytest.mark.parametrize(
    ("field", "start", "period"),
    [
        (Field(FORCED[1], FORCED[0]), [0, 0, 1, 0], 2 * np.pi),
        (VOLTERRA, [1.0, 2.0], None),
        (Field(kepler, "x y u v"), [1.0, 0.0, 0.0, 1.1], None),
    ],
    ids=["force as states", "Volterra", "Kepler"],
)
def test_a_member_of_a_family_is_told(field, start, period):
    with pytest.warns(UserWarning, match="family") as told:
        periodic_orbit(field, start, period)
    assert len(told) == 1


@pytest.mark.filterwarnings("error")
def test_known_integrals_and_isolated_orbits_are_no_families():
    H = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")
    assert periodic_orbit(H, [1.0, 0.0]).period == pytest.approx(6.699975664370, rel=1e-11)
    time = Field(lambda s: (s[1], -0.2 * s[1] - s[0] ** 3 + 0.3 * np.cos(s[2]), 1.0), "x v t")
    orbit = periodic_orbit(time, [0.0, 0.0, 0.0], 2 * np.pi)
    settled = flow(time, [0.0, 0.0, 0.0], time=100 * np.pi, rtol=1e-11).final
    np.testing.assert_allclose(orbit.state[:2], settled[:2], atol=1e-8)
    cycle = Field(  # x + y + z is constant, and given by the start
        lambda x: (x[1], (1 - x[0] ** 2) * x[1] - x[0], -x[1] - (1 - x[0] ** 2) * x[1] + x[0]), 3
    )
    assert periodic_orbit(cycle, [2.0, 0.0, 0.0]).period == pytest.approx(6.663286859, rel=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_motions_that_fall_to_an_equilibrium(seed):
    """Of an oscillator with friction, about any state, in other coordinates."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(2, 2))
    B = A @ np.array([[0.0, 1.0], [-1.0, -rng.uniform(0.05, 0.5)]]) @ np.linalg.inv(A)
    rest = rng.normal(size=2)
    field = Field(lambda x: [*(B @ (np.array(x) - rest))], 2)
    with pytest.raises(NoConvergence, match="the equilibrium") as told:
        periodic_orbit(field, rest + rng.normal(size=2))
    found = str(told.value).split("equilibrium [")[1].split("]")[0]
    np.testing.assert_allclose([float(a) for a in found.split(", ")], rest, atol=1e-4)


# ----------------------------------------------------------------------- with events and jumps
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


def test_a_ball_on_a_vibrating_table():
    """It bounces once in a period at the phase p with A cos p = pi (1 - e)/(1 + e), g = 1."""
    e, T = 0.5, 2 * np.pi
    of_cos, of_sin = T / 2 * (1 - e) / (1 + e), 1.5 / (1 + e) ** 2
    A, p = np.hypot(of_cos, of_sin), np.arctan2(of_sin, of_cos)
    ball, hit = on_a_table(A, e)
    start = [A * np.sin(p) + T**2 / 8 + 0.01, 0.01, p + T / 2]
    orbit = periodic_orbit(ball, start, T, events=hit)
    # Of multipliers m: m**2 - (1 + e**2 - (1 + e)**2 A sin p) m + e**2 = 0.
    right = np.roots([1.0, -(1 + e**2 - 1.5), e**2])
    np.testing.assert_allclose(
        np.sort_complex(orbit.multipliers), np.sort_complex(right), rtol=1e-8
    )
    with pytest.raises(ValueError, match=r"^period must be given"):
        periodic_orbit(ball, start, events=hit)
    with pytest.raises(ValueError, match=r"^period "):
        periodic_orbit(ball, start, 1.1 * T, events=hit)


def test_a_relay_that_drives_an_oscillator():
    # v' = -x - v/5 + sign(v)/2: in half a turn, which lasts pi/w, the amplitude A becomes
    # (A + 1/2) q + 1/2.
    relay = Field(lambda s: (s[1], -s[0] - 0.2 * s[1] + 0.5 * np.sign(s[1])), "x v")
    w = np.sqrt(0.99)
    q = np.exp(-0.1 * np.pi / w)
    A = 0.5 * (1 + q) / (1 - q)
    orbit = periodic_orbit(relay, [-1.1 * A, 0.1], period=6.0)
    assert orbit.period == pytest.approx(2 * np.pi / w, rel=1e-9)
    np.testing.assert_allclose(orbit.multipliers, [1.0, q * q], rtol=1e-8)
    phases = {"time": 5 * orbit.period, "transient": 20 * orbit.period}
    exponents = sf.lyapunov_exponents(relay, orbit.state, **phases)
    np.testing.assert_allclose(exponents, [0.0, -0.1], atol=1e-5)


def test_integrals_that_events_do_not_keep_leave_out_no_multiplier():
    """Kicks change the energy of an oscillator: a speed 1 + d becomes 1 + k d each turn."""
    field = Field.from_hamiltonian(lambda x: (x[0] ** 2 + x[1] ** 2) / 2, "q p")
    for k, is_stable in ((1.5, False), (0.5, True)):
        kick = Event(lambda x: x[0], direction=1, to=lambda x, k=k: (x[0], 1 + k * (x[1] - 1)))
        orbit = periodic_orbit(field, [0.0, -1.0], 6.28, events=kick)
        np.testing.assert_allclose(np.sort(orbit.multipliers.real), sorted([1.0, k]), atol=1e-9)
        assert orbit.stable is is_stable
    marker = Event(lambda x: x[0])  # which changes nothing
    assert periodic_orbit(field, [0.1, -1.0], 6.28, events=marker).stable


@pytest.mark.slow_cases("8", "11")
@pytest.mark.parametrize("turns", [5, 8, 11])
def test_turns_of_an_unstable_orbit(turns):
    """Its multiplier is 64: Newton's method for all turns led to other orbits near it."""
    x0 = [-4.473777426249161, -8.595978309705247, 8.410608458823141]
    with pytest.warns(UserWarning, match=f"{turns} times around") as told:
        orbit = periodic_orbit(LORENZ, x0, period=turns * 4.534075383577647)
    assert len(told) == 1
    assert orbit.period == pytest.approx(4.5341079489651, rel=1e-11)
    assert abs(orbit.multipliers[0]) == pytest.approx(64.4670024, rel=1e-6)


def test_a_doubled_orbit_beside_the_single_one():
    """Just after a period doubling the given period, two turns, chooses between them."""
    field = roessler(2.9)
    x0 = flow(field, [1, 1, 0], time=3000, rtol=1e-8).final
    orbit = periodic_orbit(field, 1.001 * x0, period=11.5)
    assert orbit.period > 11
    assert orbit.stable


@pytest.mark.parametrize("start", [[1.0, 1.0], [0.01, 0.0], [4.0, -3.0]])
def test_a_start_far_from_an_orbit_that_attracts_it(start):
    """The motion does not return to the start, but to its later states."""
    orbit = periodic_orbit(VAN_DER_POL[1], start)
    assert orbit.period == pytest.approx(6.6632868593231, rel=1e-11)
    with pytest.raises(NoConvergence, match="does not return"):
        periodic_orbit(Field(lambda x: (1.0 + 0 * x[0], 0.1 * x[1]), 2), [0.0, 1.0])


@pytest.mark.parametrize(("c", "period"), [(2.5, 5.748991), (3.8, 11.569277), (4.1, 23.197558)])
def test_a_doubled_orbit_that_attracts(c, period):
    """The attractor, not the unstable orbit of half its period beside it."""
    orbit = periodic_orbit(roessler(c), [1.0, 1.0, 0.0])
    assert orbit.stable
    assert orbit.period == pytest.approx(period, abs=1e-6)


# ---------------------------------------------------------------------- batches, and derivatives


def test_orbits_of_a_family_and_of_starts():
    """Bits of single calls; NaN and one warning for members without an orbit."""
    cycles = periodic_orbit(VAN_DER_POL, [2.0, 0.0], period=[[6.4, 6.6, 8.9]] * 2)
    assert cycles.state.shape == (2, 3, 2)
    assert cycles.stable.all()
    for k, T in enumerate([6.4, 6.6, 8.9]):
        one = periodic_orbit(VAN_DER_POL[k], [2.0, 0.0], period=T)
        for values, wanted in zip(cycles[:5], one[:5], strict=True):
            np.testing.assert_array_equal(values[1, k], wanted)
    field = Field(lambda x, mu: (x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]), "x v", mu=[1, -0.2, 1])
    with pytest.warns(UserWarning, match=r"1 of 3 .*first: trajectory 1: .*falls"):
        cycles = periodic_orbit(field, [[2.0, 0.0], [1.0, 0.0], [np.nan, 0.0]], derivatives="mu")
    for values in (cycles.state[:, 0], cycles.period, cycles.derivatives["mu"].period):
        assert np.isnan(values).tolist() == [False, True, True]
    assert cycles.stable.tolist() == [True, False, False]


def test_derivatives_of_periods_of_integrate_and_fire_neurons():
    """T = log(I / (I - 1)) between spikes, and the orbit through the middle."""
    currents = np.array([1.5, 2.0, 3.0])
    neuron = Field(lambda x, I: (I - x[0],), "v", I=currents)
    spike = Event("v - 1", direction="up", to=[0.0])
    cycles = periodic_orbit(neuron, [0.2], events=spike, derivatives="I")
    np.testing.assert_allclose(cycles.period, np.log(currents / (currents - 1)), rtol=1e-10)
    wanted = 1 / currents - 1 / (currents - 1)
    np.testing.assert_allclose(cycles.derivatives["I"].period, wanted, rtol=1e-9)


FORCED = Field(
    lambda t, y, mu: (y[1], -y[0] - 0.3 * y[1] - mu * y[0] ** 3 + np.cos(1.3 * t)), "x v", mu=0.1
)
LORENZ_BY_RHO = Field(
    lambda x, mu: (10 * (x[1] - x[0]), x[0] * (mu - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]),
    3,
    mu=28.0,
)
VARIED = [
    (VAN_DER_POL[2], [2.0, 0.0], None),
    (LORENZ_BY_RHO, [-13.8, -19.6, 27], 1.56),
    (FORCED, [0.0, 0.0], 2 * np.pi / 1.3),
]


@pytest.mark.parametrize(("field", "start", "period"), VARIED)
@pytest.mark.parametrize("arcs", [(1,), (4,)])
def test_derivatives_beside_differences(field, start, period, arcs, monkeypatch):
    """Of the period, and of the state up to its motion along the orbit."""
    monkeypatch.setattr(shooting, "_ARCS", (1, *arcs))
    monkeypatch.setattr(shooting, "GROWTH_OF_ARC", 1.0)  # so that more arcs are tried
    mu = field.parameters["mu"]
    given = periodic_orbit(field, start, period, derivatives="mu").derivatives["mu"]
    h = 1e-4 * mu
    fields = (field.with_parameters(mu=mu + s * h) for s in (1, -1))
    after, before = (periodic_orbit(each, start, period) for each in fields)
    difference = (after.period - before.period) / (2 * h)
    assert given.period == pytest.approx(difference, rel=1e-6, abs=1e-9)
    if field is FORCED:
        difference = (after.state - before.state) / (2 * h)
        np.testing.assert_allclose(given.state, difference, rtol=1e-5)
    else:
        orbit = periodic_orbit(field, start, period)
        along = given.state @ field(orbit.state) / np.linalg.norm(field(orbit.state))
        assert abs(along) < 1e-9 * np.linalg.norm(given.state)


def test_a_member_of_a_family_has_no_derivatives():
    pendulum = Field.from_hamiltonian(lambda x, g: x[1] ** 2 / 2 - g * np.cos(x[0]), "q p", g=1.0)
    with pytest.warns(UserWarning, match="no derivatives"):
        orbit = periodic_orbit(pendulum, [1.0, 0.0], derivatives="g")
    assert np.isnan(orbit.derivatives["g"].period)
    with pytest.raises(KeyError, match="was not asked for"):
        _ = orbit.derivatives["q"]
    with pytest.raises(ValueError, match="parameters"):
        periodic_orbit(pendulum, [1.0, 0.0], derivatives="x0")
