"""Tests of results for systems with constraints of mechanics: all of them satisfy these."""

import numpy as np
import pytest
from numpy import cos, sin
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import ellipk

from suslov_fast import (
    Event,
    Field,
    IntegrationWarning,
    Status,
    compiled,
    crossings,
    ensemble,
    equilibria,
    flow,
    lyapunov_exponents,
    periodic_orbit,
)
from suslov_fast.motions import tangents


def pendulum(friction=0.0, **parameters):
    """A point on a circle of radius 1 in the plane, y upwards."""
    return Field.from_lagrangian(
        lambda q, v, g=1.0: v @ v / 2 - g * q[1],
        "x y",
        constraints=lambda q, v: q @ q - 1,
        forces=lambda q, v: -friction * v,
        **parameters,
    )


def at(angle, rate=0.0):
    return [sin(angle), -cos(angle), rate * cos(angle), rate * sin(angle)]


def by_angle(friction=0.0):
    return Field(lambda x: (x[1], -sin(x[0]) - friction * x[1]), "a w")


def double_pendulum():
    return Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1] - q[3],
        "x1 y1 x2 y2",
        constraints=lambda q, v: (q[:2] @ q[:2] - 1, (q[2:] - q[:2]) @ (q[2:] - q[:2]) - 1),
    )


# ------------------------------------------------------------------------------ equilibria
def test_equilibria_of_a_pendulum():
    starts = [at(3.0), at(0.1), [0.9, -0.5, 0.3, 0.0]]  # the last one is off the circle
    found = equilibria(pendulum(), starts)
    assert_allclose(found.states, [at(np.pi), at(0), at(0)], atol=1e-13)
    assert_allclose(found.eigenvalues, [[1, -1], [1j, -1j], [1j, -1j]], atol=1e-13)
    assert found.kind.tolist() == ["saddle", "centre", "centre"]
    assert (found.status == Status.OK).all()
    damped = equilibria(pendulum(0.4), [at(0.1), at(3.0)])
    assert damped.kind.tolist() == ["attracting focus", "saddle"]
    assert damped.stable.tolist() == [True, False]
    assert_allclose(damped.eigenvalues[0], -0.2 + np.sqrt(0.96) * np.array([1j, -1j]), rtol=1e-12)


def test_equilibria_of_a_family():
    found = equilibria(pendulum(g=[1.0, 4.0, 9.0]), at(0.5))
    assert_allclose(found.states, [at(0)] * 3, atol=1e-13)
    assert_allclose(found.eigenvalues[:, 0], [1j, 2j, 3j], atol=1e-12)


def test_equilibria_of_a_double_pendulum():
    near = [[0.1, y1, 0.1, y2, 0, 0, 0, 0] for y1, y2 in ((-1, -2), (-1, 0.1), (1, 0), (1, 2))]
    found = equilibria(double_pendulum(), near)
    exact = [[0, y1, 0, y2, 0, 0, 0, 0] for y1, y2 in ((-1, -2), (-1, 0), (1, 0), (1, 2))]
    assert_allclose(found.states, exact, atol=1e-12)
    squares = np.sort((found.eigenvalues**2).real, axis=1)[:, ::2]
    root = np.sqrt(2)
    assert_allclose(
        squares, [[-2 - root, root - 2], [-root, root], [-root, root], [2 - root, 2 + root]]
    )


@pytest.mark.parametrize("R", [1e-3, 1e3, 1e6])
def test_equilibria_far_from_their_start(R):
    circle = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y", constraints=lambda q, v: q @ q - R * R
    )
    starts = np.zeros((30, 4))
    starts[:, :2] = R * np.random.default_rng(0).normal(size=(30, 2))
    found = equilibria(circle, starts)
    assert (found.status == Status.OK).all()
    assert_allclose(abs(found.states) / R, [[0, 1, 0, 0]] * 30, atol=1e-9)


def test_a_bead_that_falls_along_a_line_is_never_at_rest():
    """Its velocities have constant rates, but they are no clocks."""
    bead = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y", constraints=lambda q, v: q[0] - q[1]
    )
    with pytest.warns(UserWarning, match="no result"):
        found = equilibria(bead, [0.3, 0.3, 0, 0])
    assert found.status == Status.NOT_FOUND
    assert_allclose(flow(bead, [0, 0, 0, 0], time=2.0).states, [[-1, -1, -1, -1]], atol=1e-14)


def test_equilibria_on_a_line():
    """A knife edge in a potential: all states at rest with x = angle = 0 are equilibria."""
    edge = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q @ q / 2,
        "x y angle",
        constraints=lambda q, v: v[0] * sin(q[2]) - v[1] * cos(q[2]),
    )
    with pytest.warns(UserWarning, match="family"):
        found = equilibria(edge, [0.1, 0.3, 0.2, 0, 0, 0])
    assert_allclose(found.states[[0, 2, 3, 4, 5]], 0, atol=1e-9)
    assert found.eigenvalues.shape == (5,)
    assert abs(found.eigenvalues).min() < 1e-9


def blade():
    """A blade that does not move sideways, on a slope."""
    return Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[0],
        "x y angle",
        constraints=lambda q, v: v[0] * sin(q[2]) - v[1] * cos(q[2]),
    )


def wire():
    """A damped pendulum on a wire with a center that moves."""
    return Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1],
        "x y",
        constraints=lambda q, v, t: (q[0] - 0.3 * sin(t)) ** 2 + q[1] ** 2 - 1,
        forces=lambda q, v: -0.4 * v,
    )


# ------------------------------------------------------------------------------ exponents
def test_exponents_of_a_damped_pendulum():
    found = lyapunov_exponents(pendulum(0.4), at(1.0), time=200.0, transient=50.0)
    assert found.shape == (2,)
    assert_allclose(found, -0.2, atol=0.004)
    assert_allclose(found.sum(), -0.4, rtol=1e-8)


@pytest.mark.parametrize("R", [1e-3, 1.0, 1e3])
def test_exponents_over_short_times_are_those_of_the_angle(R):
    """Areas of tangent spaces do not depend on the velocity: the sum is 0 at all times."""
    circle = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - 9.81 * q[1], "x y", constraints=lambda q, v: q @ q - R * R
    )
    angle = Field(lambda x: (x[1], -9.81 / R * sin(x[0])), "a w")
    found = lyapunov_exponents(circle, R * np.array(at(2.0)), time=1.0)
    assert_allclose(found, lyapunov_exponents(angle, [2.0, 0.0], time=1.0), rtol=1e-8)
    assert abs(found.sum()) < 1e-8 * found[0]


def test_exponents_of_a_blade():
    """Rows without holonomic constraints: displacements are free, velocities are not."""
    found = lyapunov_exponents(blade(), [0, 0, 0, 0, 0, 1.0], time=20.0)
    assert found.shape == (5,)
    by_hand = Field(lambda x: (x[3] * cos(x[2]), x[3] * sin(x[2]), x[4], -cos(x[2]), 0 * x[4]), 5)
    exact = lyapunov_exponents(by_hand, [0, 0, 0, 0, 1.0], time=20.0)
    assert_allclose(found, exact, atol=0.05)  # they have other norms
    assert abs(found.sum()) < 1e-7


def test_exponents_of_a_batch_have_the_bits_of_single_ones():
    field, starts = pendulum(g=[1.0, 2.0]), [at(1.0), at(2.0)]
    together = lyapunov_exponents(field, starts, time=20.0)
    for k in range(2):
        assert_array_equal(together[k], lyapunov_exponents(field[k], starts[k], time=20.0))


def test_exponents_with_constraints_in_time():
    x0 = wire().mechanics.projected([0.3, -1.0, 0, 0])
    found = lyapunov_exponents(wire(), x0, time=200.0, transient=50.0)
    assert_allclose(found, -0.2, atol=0.004)
    assert_allclose(found.sum(), -0.4, atol=0.001)  # areas differ from those of angles


@pytest.mark.parametrize("time", [20.0, 2000.0])
def test_exponents_of_a_stiff_pendulum_are_those_of_the_angle(time):
    """In coordinates of the tangent space no direction off the constraints grows."""
    found = lyapunov_exponents(pendulum(1000.0), at(2.0), time=time)
    assert_allclose(found, lyapunov_exponents(by_angle(1000.0), [2.0, 0.0], time=time), rtol=1e-7)


def test_exponents_of_a_stiff_chain():
    """By angles, tangent vectors have other norms; areas do not depend on norms."""
    chain = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1] - q[3],
        "x1 y1 x2 y2",
        constraints=lambda q, v: (q[:2] @ q[:2] - 1, (q[2:] - q[:2]) @ (q[2:] - q[:2]) - 1),
        forces=lambda q, v: -300.0 * v,
    )
    x0 = np.concatenate([at(2.0)[:2], np.add(at(2.0), at(-0.7))[:2], np.zeros(4)])
    found = lyapunov_exponents(chain, x0, time=40.0)
    assert_allclose(found.sum(), -600.0, rtol=1e-9)
    assert_allclose(found, [0.0, 0.0, -300.0, -300.0], atol=0.05)


@pytest.mark.parametrize("system", ["turning", "blade", "wire"])
def test_frames_within_constraints_give_the_exponents_of_columns(system, monkeypatch):
    """Here frames replace columns from the first segments on, also where nothing is stiff."""
    if system == "turning":  # the tangent space turns many times
        field, x0 = pendulum(0.1), at(0.0, 8.0)
    elif system == "blade":
        field, x0 = blade(), [0, 0, 0.3, cos(0.3), sin(0.3), 1.0]
    else:
        field, x0 = wire(), wire().mechanics.projected([0.3, -1.0, 0, 0])
    expected = lyapunov_exponents(field, x0, time=20.0)
    frames = []
    with_frame = tangents.with_frame
    monkeypatch.setattr(tangents, "with_frame", lambda *of: frames.append(of) or with_frame(*of))
    monkeypatch.setattr(tangents, "FEW_SEGMENTS", 1)
    monkeypatch.setattr(tangents, "PART_OF_FEW_SEGMENTS", 2.0)
    assert_allclose(lyapunov_exponents(field, x0, time=20.0), expected, atol=1e-7)
    assert frames


# ------------------------------------------------------------------------------ periodic orbits
def test_period_of_a_pendulum():
    orbit = periodic_orbit(pendulum(), at(1.0))  # the energy explains its family
    assert_allclose(orbit.period, 4 * ellipk(sin(0.5) ** 2), rtol=1e-12)
    assert_allclose(orbit.multipliers, [1, 1], atol=1e-5)


@pytest.mark.parametrize("start", [0.1, 1.2])
def test_forced_orbit_is_that_of_the_angle(start):
    forced = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1],
        "x y",
        constraints=lambda q, v: q @ q - 1,
        forces=lambda q, v, t: [0.3 * cos(2 * t) - 0.4 * v[0], -0.4 * v[1]],
    )
    angle = Field(
        lambda x: (x[1], -sin(x[0]) - 0.4 * x[1] + 0.3 * cos(2 * x[2]) * cos(x[0]), 1.0), "a w t"
    )
    found = periodic_orbit(forced, at(start), np.pi)
    exact = periodic_orbit(angle, [start, 0.0, 0.0], np.pi)
    assert_allclose(found.state[:4], at(*exact.state[:2]), atol=1e-11)
    assert_allclose(found.multipliers, exact.multipliers, rtol=1e-9)
    assert found.stable


def test_a_start_that_closes_is_the_orbit():
    """All motions return after the period of the force."""
    field = Field(lambda x: (x[1] * (1 + cos(x[2]) / 2), -x[0] * (1 + cos(x[2]) / 2), 1.0), 3)
    for start in ([1.0, 0.0, 0.0], [0.3, 0.4, 0.0]):
        with pytest.warns(UserWarning, match="family"):
            orbit = periodic_orbit(field, start, 2 * np.pi)
        assert_allclose(orbit.state, start, atol=0.05)
        assert orbit.residual < 1e-12


# ------------------------------------------------------------------------------ starts
def test_starts_off_constraints_are_refused(tmp_path):
    field, off = pendulum(), [0.9, -0.5, 0, 0]
    calls = [
        lambda: flow(field, off, time=1.0),
        lambda: crossings(field, off, "x", time=1.0),
        lambda: lyapunov_exponents(field, off, time=1.0),
        lambda: periodic_orbit(field, off),
        lambda: ensemble(field, [off], tmp_path / "store", time=1.0),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=r"on the constraints, not off by 0\.06"):
            call()


@pytest.mark.parametrize("derivatives", [(), "x0"])
def test_steps_of_loops_from_starts_off_constraints(derivatives):
    constants = compiled.system(pendulum(), time=1.0, derivatives=derivatives)
    memory = compiled.work(constants)
    x = np.zeros(constants.dimension)
    for start, status in ((at(1.0), Status.OK), ([0.9, -0.5, 0, 0], Status.NONFINITE)):
        x[:4] = start
        assert compiled.step_system(constants, x, x, memory) == status
        assert np.isfinite(x).all() == (status == Status.OK)


def test_projected_states_of_a_family():
    field = pendulum(g=[1.0, 2.0])
    assert_allclose(
        field.mechanics.residuals(field.mechanics.projected([1.0, 1.0, 0.2, 0.0])), 0, atol=1e-15
    )
    with pytest.raises(TypeError, match="has no mechanics"):
        by_angle().mechanics.projected([1.0, 0.0])


# ------------------------------------------------------------------------------ actions
def test_an_impulse_has_a_reaction():
    kick = Event(times=[1.0], to=lambda x: (x[0], x[1], x[2] + 0.5, x[3]))
    motion = flow(pendulum(), at(1.0), time=3.0, events=kick)
    a, w = flow(by_angle(), [1.0, 0.0], time=1.0).final
    after = a, w + 0.5 * cos(a)
    assert_allclose(motion.events.states[0], at(*after), atol=1e-9)
    assert_allclose(motion.final, at(*flow(by_angle(), after, time=2.0).final), atol=1e-8)
    assert_allclose(motion.residuals(), 0, atol=1e-14)


def test_new_positions_are_on_constraints():
    mirror = Event(times=[1.0], to=lambda x: (-x[0], x[1], -x[2], x[3]))
    assert flow(pendulum(), at(1.0), time=3.0, events=mirror).ok
    away = Event(times=[1.0], to=lambda x: (1.01 * x[0], x[1], x[2], x[3]))
    with pytest.warns(IntegrationWarning, match="coordinates off the constraints"):
        motion = flow(pendulum(), at(1.0), time=3.0, events=away)
    assert motion.status == Status.ENDED


LAWS = {
    "all": lambda x: (x[0], x[1], -x[2] / 2, -x[3] / 2),
    "x alone": lambda x: (x[0], x[1], -x[2] / 2, x[3]),
}


@pytest.mark.parametrize("stiff", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_bounces_from_a_wall(law, stiff):
    """The wall is at x = sin(0.3); the body comes to rest there."""
    wall = Event(lambda x: x[0] - sin(0.3), to=LAWS[law], direction="down")
    motion = flow(pendulum(), at(1.0), time=60.0, events=wall, stiff=stiff)
    exact = Event(lambda x: x[0] - 0.3, to=lambda x: (x[0], -x[1] / 2), direction="down")
    events = flow(by_angle(), [1.0, 0.0], time=60.0, events=exact).events
    assert_allclose(motion.events.time[:12], events.time[:12], rtol=1e-7)
    assert_allclose(motion.final, at(0.3), atol=1e-12)
    assert motion.ok


FLOORS = {
    "all": lambda x: (x[0], x[1], x[2], -x[3] / 2, -x[4] / 2, x[5]),
    "y alone": lambda x: (x[0], x[1], x[2], x[3], -x[4] / 2, x[5]),
    "both": lambda x: (x[0], x[1], x[2], x[3] - 1.5 * x[4], -x[4] / 2, x[5]),
    "at zero": lambda x: (x[0], 0.0, x[2], -x[3] / 2, -x[4] / 2, x[5]),
    "stops": lambda x: (x[0], x[1], x[2], 0.0, 0.0, x[5]),
}


@pytest.mark.parametrize("floor", FLOORS)
def test_rest_on_a_floor_within_a_plane(floor):
    """On the plane x = y the body falls at g/2, rests at y = 0, and slides along z."""
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y z", constraints=lambda q, v: q[0] - q[1]
    )
    event = Event(lambda x: x[1], to=FLOORS[floor], direction="down")
    motion = flow(field, [1.0, 1.0, 0, 0, 0, 1.0], time=30.0, events=event)
    assert_allclose(motion.events.time[0], 2.0, rtol=1e-9)
    assert_allclose(motion.final, [0, 0, 30, 0, 0, 1], atol=1e-9)
    assert motion.ok
    assert "rests: 1" in repr(motion.phases)


def rod(m1=1.0, m2=3.0):
    """Two points, m1 below m2, at the distance 1."""
    return Field.from_lagrangian(
        lambda q, v: (m1 * v[:2] @ v[:2] + m2 * v[2:] @ v[2:]) / 2 - m1 * q[1] - m2 * q[3],
        "x1 y1 x2 y2",
        constraints=lambda q, v: (q[2:] - q[:2]) @ (q[2:] - q[:2]) - 1,
    )


ON_FLOOR = {
    "all": lambda x: (*x[:4], x[4], -x[5] / 2, x[6], -x[7] / 2),
    "y1 alone": lambda x: (*x[:4], x[4], -x[5] / 2, x[6], x[7]),
}


@pytest.mark.parametrize("law", ON_FLOOR)
def test_upright_rods_come_to_rest(law):
    """Projections move y1 by the rounding of y2: no bounce near the end is lost."""
    rng = np.random.default_rng(1)
    heights, speeds = rng.uniform(0.5, 2.0, 40), rng.normal(size=40)
    x0 = [[0, h, 0, h + 1, u, 0, u, 0] for h, u in zip(heights, speeds, strict=True)]
    floor = Event(lambda x: x[1], to=ON_FLOOR[law], direction="down")
    motion = flow(rod(), x0, time=20.0, events=floor)
    exact = [[20 * u, 0, 20 * u, 1, u, 0, u, 0] for u in speeds]
    assert_allclose(motion.final, exact, atol=1e-9)
    assert motion.ok.all()
    bounces = motion.events.time[motion.events.trajectory == 0][:8]
    assert_allclose(bounces, np.sqrt(2 * heights[0]) * (3 - 2.0 ** (1 - np.arange(8))), rtol=1e-8)


def test_rods_lie_down_on_two_contacts():
    x0 = [[0, 1, cos(b), 1 + sin(b), 0, 0, 0, 0] for b in (0.0, 0.3, 1.5, 2.8)]
    foot, head = (
        Event(lambda x: x[1], to=ON_FLOOR["y1 alone"], direction="down"),
        Event(lambda x: x[3], to=lambda x: (*x[:7], -x[7] / 2), direction="down"),
    )
    motion = flow(rod(), x0, time=60.0, events=[foot, head])
    assert motion.ok.all()
    assert_allclose(motion.final[:, [1, 3]], 0, atol=1e-12)
    centre = motion.final[:, 0] + 3 * motion.final[:, 2]
    assert_allclose(centre, 3 * np.array(x0)[:, 2], atol=1e-8)  # no force acts sideways


def test_balls_with_kept_energy_come_to_rest():
    field = Field.from_hamiltonian(lambda x: (x[2] ** 2 + x[3] ** 2) / 2 + x[1], "x y u v")
    rng = np.random.default_rng(1)
    x0 = np.c_[np.zeros(50), rng.uniform(0.5, 2, 50), rng.normal(size=50), np.zeros(50)]
    bounce = Event(lambda x: x[1], to=lambda x: (x[0], x[1], x[2], -x[3] / 2), direction="down")
    motion = flow(field.conserving(), x0, time=20.0, events=bounce)
    assert_allclose(motion.final[:, [1, 3]], 0, atol=1e-9)
    assert_allclose(motion.final[:, 0], 20 * x0[:, 2], atol=1e-9)


def test_tilted_rod_bounces_as_newton_says():
    """The impulse on the foot is upwards; the rod in coordinates without constraints."""
    m1, m2 = 1.0, 3.0
    free = Field.from_lagrangian(
        lambda q, v: (
            m1 * (v[0] ** 2 + v[1] ** 2) / 2
            + m2 * ((v[0] + v[2] * cos(q[2])) ** 2 + (v[1] - v[2] * sin(q[2])) ** 2) / 2
            - m1 * q[1]
            - m2 * (q[1] + cos(q[2]))
        ),
        "x y a",
    )

    def law(x):
        turn = sin(x[2]) / m1
        side = -m2 * cos(x[2]) * turn / (m1 + m2)
        up = (1 + m2 * sin(x[2]) * turn) / (m1 + m2)
        k = -1.5 * x[4] / up
        return (*x[:3], x[3] + k * side, x[4] + k * up, x[5] + k * turn)

    exact = flow(
        free, [0, 1, 0.4, 0, 0, 0], time=2.5, events=Event(lambda x: x[1], law, direction="down")
    )
    floor = Event(lambda x: x[1], to=ON_FLOOR["y1 alone"], direction="down")
    x0 = [0, 1, sin(0.4), 1 + cos(0.4), 0, 0, 0, 0]
    motion = flow(rod(m1, m2), x0, time=2.5, events=floor)
    x, y, a = exact.final[:3]
    assert_allclose(motion.final[:4], [x, y, x + sin(a), y + cos(a)], atol=1e-8)
    assert_allclose(motion.energy()[-1], free.energy(exact.final), rtol=1e-8)


def test_a_forced_body_at_a_wall_is_that_of_the_angle():
    """The force and the restitution depend on time."""
    forced = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1],
        "x y",
        constraints=lambda q, v: q @ q - 1,
        forces=lambda q, v, t: [0.9 * cos(2 * t) - 0.1 * v[0], -0.1 * v[1]],
    )
    angle = Field(
        lambda t, y: (y[1], -sin(y[0]) - 0.1 * y[1] + 0.9 * cos(2 * t) * cos(y[0])), "a w"
    )
    rest = lambda t: 0.7 + 0.2 * sin(t)  # noqa: E731
    wall = Event(
        lambda x: x[0] - sin(0.3),
        to=lambda t, x: (x[0], x[1], -rest(t) * x[2], x[3]),
        direction="down",
    )
    exact = Event(lambda y: y[0] - 0.3, lambda t, y: (y[0], -rest(t) * y[1]), direction="down")
    times = np.linspace(0.0, 10.0, 6)
    motion = flow(forced, at(1.0), time=times, events=wall, t0=0.5)
    same = flow(angle, [1.0, 0.0], time=times, events=exact, t0=0.5)
    assert_allclose(motion.events.time, same.events.time, rtol=1e-7)
    assert_allclose(motion.states[:, :4], np.array(at(*same.states.T)).T, atol=1e-7)
    assert_allclose(motion.residuals(), 0, atol=1e-14)
    assert len(same.events.time) > 2
    found = crossings(forced, at(1.0), lambda x: x[0], time=20.0, t0=0.5)
    assert_allclose(
        found.time, crossings(angle, [1.0, 0.0], "a", time=20.0, t0=0.5).time, rtol=1e-7
    )


def test_an_impulse_in_a_moving_frame():
    """A sleigh: the impulse (0, 1, 0) without its part along the constraint (0, 1, -0.3)."""
    algebra = np.zeros((3, 3, 3))
    algebra[0, 2, 1], algebra[2, 0, 1], algebra[1, 2, 0], algebra[2, 1, 0] = -1, 1, 1, -1
    sleigh = Field.from_lagrangian(
        lambda q, u: (u @ u) / 2,
        "x y a",
        "u w s",
        frame=lambda q, u: (
            u[0] * cos(q[2]) - u[1] * sin(q[2]),
            u[0] * sin(q[2]) + u[1] * cos(q[2]),
            u[2],
        ),
        algebra=algebra,
        constraints=lambda q, u: u[1] - 0.3 * u[2],
    )
    kick = Event(times=[1.0], to=lambda x: (*x[:4], x[4] + 1.0, x[5]))
    motion = flow(sleigh, sleigh.mechanics.projected([0, 0, 0, 1.0, 0, 0.5]), time=2.0, events=kick)
    change = motion.events.states[0, 3:] - motion.events.before[0, 3:]
    assert_allclose(change, [0, 1 - 1 / 1.09, 0.3 / 1.09], atol=1e-14)
    assert_allclose(motion.residuals(), 0, atol=1e-14)


def test_an_impulse_with_a_constraint_on_the_speed():
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y", constraints=lambda q, v: v @ v - 1
    )
    kick = Event(times=[1.0], to=lambda x: (x[0], x[1], x[2] + 0.5, x[3]))
    motion = flow(field, [0, 0, 1, 0], time=3.0, events=kick)
    assert_allclose(motion.residuals(), 0, atol=1e-14)
    wanted = motion.events.before[0, 2:] + [0.5, 0]
    assert_allclose(motion.events.states[0, 2:], wanted / np.hypot(*wanted), atol=1e-14)


def test_a_clock_that_is_kicked_is_that_of_the_angle():
    kick = Event(lambda x: x[0], lambda x: (x[0], x[1], x[2] + 0.3, x[3] + 0.7), direction="up")
    orbit = periodic_orbit(pendulum(0.2), at(0.44), 6.4, events=kick)
    by = Event(
        lambda x: x[0],
        lambda x: (x[0], x[1] + 0.3 * cos(x[0]) + 0.7 * sin(x[0])),
        direction="up",
    )
    exact = periodic_orbit(by_angle(0.2), [0.8, 0.0], events=by)
    assert_allclose(orbit.period, exact.period, rtol=1e-10)
    assert_allclose(orbit.multipliers, exact.multipliers, atol=1e-9)
    assert_allclose(flow(pendulum(0.2), orbit.state, time=0.0).residuals(), 0, atol=1e-14)


@pytest.mark.parametrize("restitution", [1.0, 0.5, 0.1])
def test_bounces_with_a_constraint_on_the_speed(restitution):
    """The new ds/dt is kept; the speed 1 and the symmetry of the wall give the other velocities."""
    point = Field.from_lagrangian(
        lambda q, v: v @ v / 2, "x y z", constraints=lambda q, v: v @ v - 1
    )
    wall = Event("z", lambda x: (*x[:5], -restitution * x[5]), direction="down")
    motion = flow(point, [0, 0, 1, 0.36, 0.48, -0.8], time=2.0, events=wall)
    [state] = motion.events.states
    along = np.sqrt(1 - (0.8 * restitution) ** 2)
    assert_allclose(state[3:], [0.6 * along, 0.8 * along, 0.8 * restitution], rtol=1e-13)
    assert_allclose(motion.final[:3], state[:3] + 0.75 * state[3:], rtol=1e-9)


def test_bounces_with_a_constraint_of_appell():
    """On a wall that is not a plane of symmetry: constraints and the new ds/dt hold."""
    cone = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[2],
        "x y z",
        constraints=lambda q, v: v[2] ** 2 - 2 * (v[0] ** 2 + v[1] ** 2),
    )
    wall = Event(
        lambda x: x[0] + x[2] + 0.5,
        lambda x: (*x[:3], x[3] - 0.75 * (x[3] + x[5]), x[4], x[5] - 0.75 * (x[3] + x[5])),
        most=1,
    )
    x0 = cone.mechanics.projected([0, 0, 0, -1, 0.3, -1.2])
    events = flow(cone, x0, time=2.0, events=wall).events
    before, after = events.before[0, 3:], events.states[0, 3:]
    assert_allclose(after[0] + after[2], -0.5 * (before[0] + before[2]), rtol=1e-13)
    assert_allclose(after[2] ** 2, 2 * (after[0] ** 2 + after[1] ** 2), rtol=1e-13)


def test_bounces_that_constraints_do_not_allow():
    point = Field.from_lagrangian(lambda q, v: v @ v / 2, "x y", constraints=lambda q, v: v @ v - 1)
    wall = Event("y", lambda x: (*x[:3], -1.5 * x[3]))
    with pytest.warns(IntegrationWarning, match="no value"):
        motion = flow(point, [0, 1, 0.6, -0.8], time=2.0, events=wall)
    assert_allclose(motion.end, 1.25, rtol=1e-9)
