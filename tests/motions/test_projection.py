"""Tests of steps that keep constraints and first integrals."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from suslov_fast import (
    Event,
    Field,
    IntegrationWarning,
    Status,
    compiled,
    crossings,
    ensemble,
    flow,
    load,
    lyapunov_exponents,
    periodic_orbit,
)


def pendulum():
    return Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), "q p")


def kepler():
    return Field.from_hamiltonian(
        lambda x: (x[2] ** 2 + x[3] ** 2) / 2 - 1 / np.sqrt(x[0] ** 2 + x[1] ** 2), "x y u v"
    )


def angular_momentum(x):
    return x[0] * x[3] - x[1] * x[2]


def oval():
    """A cubic potential; motions are regular at this energy."""
    return Field.from_hamiltonian(
        lambda x: (x @ x) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3, "x y u v"
    )


def test_kepler_keeps_integrals_and_phase():
    x0, field = [0.4, 0, 0, 2.0], kepler()
    kept = field.conserving(
        lambda x: (x[2] ** 2 + x[3] ** 2) / 2 - 1 / np.sqrt(x[0] ** 2 + x[1] ** 2),
        angular_momentum,
    )
    t = 2 * np.pi * np.arange(1, 1001)
    plain, motion = flow(field, x0, time=t), flow(kept, x0, time=t)
    assert_allclose(motion.energy(), -0.5, rtol=1e-14)
    assert_allclose(angular_momentum(motion.states.T), 0.8, rtol=1e-14)
    assert abs(motion.states[-1] - x0).max() < 2e-6
    assert abs(plain.states[-1] - x0).max() > 1e-3


@pytest.mark.parametrize("settings", [{}, {"rtol": 1e-2}, {"atol": 1e-8}, {"stiff": True}])
def test_states_between_steps_have_the_energy(settings):
    field, x0 = oval(), [0, 0.1, 0.5, 0]
    motion = flow(field.conserving(), x0, time=np.linspace(-20, 0, 2000), **settings)
    near = 1e-9 if "rtol" in settings else 1e-14  # one Newton step
    assert_allclose(motion.energy(), field.energy(np.array(x0)), atol=near)


def test_lanes_have_the_bits_of_single_motions():
    x0 = [0, 0.1, 0.5, 0] + 0.01 * np.random.default_rng(0).normal(size=(37, 4))
    field = oval().conserving()
    states = flow(field, x0, time=[5.0, 50.0]).states
    for k in (0, 7, 36):
        assert_array_equal(states[:, k], flow(field, x0[k], time=[5.0, 50.0]).states)


def test_families():
    field = Field.from_hamiltonian(
        lambda x, k: x[1] ** 2 / 2 - k * np.cos(x[0]), "q p", k=[1.0, 2.0, 5.0]
    )
    energy = flow(field.conserving(), [1.0, 0.0], time=[10.0, 1000.0]).energy()
    assert_allclose(energy - field.energy([1.0, 0.0]), 0, atol=2e-15)


@pytest.mark.parametrize("x0", [[0, 0], [np.pi, 0], [np.pi - 1e-9, 0], [1e-200, 0]])
def test_equilibria_where_slopes_are_0(x0):
    plain, motion = (flow(f, x0, time=15.0) for f in (pendulum(), pendulum().conserving()))
    assert motion.ok
    assert_allclose(motion.states, plain.states, rtol=1e-5)


def test_integrals_that_depend_on_one_another():
    H = lambda x: x[1] ** 2 / 2 - np.cos(x[0])  # noqa: E731
    field = pendulum().conserving(H, lambda x: (2 * H(x), H(x) ** 2))
    one = flow(pendulum().conserving(), [1, 0], time=100.0)
    assert_array_equal(flow(field, [1, 0], time=100.0).states, one.states)


def test_actions_of_events_set_new_values():
    ball = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 + x[0], "h v").conserving()
    bounce = Event(lambda x: x[0], direction="down", to=lambda x: (0 * x[0], -x[1] / 2))
    motion = flow(ball, [1, 0], time=[1.0, 2.0, 3.0, 4.0], events=bounce)
    assert_allclose(motion.energy(), 4.0 ** -np.array([0.0, 1.0, 2.0, 4.0]), rtol=1e-13)
    kick = Event(times=[1.0], to=lambda x: (x[0], x[1] + 0.3))
    energy = flow(pendulum().conserving(), [1, 0], time=[1.0, 500.0], events=kick).energy()
    assert_allclose(energy[1], energy[0], rtol=1e-14)


def test_forces_that_jump():
    field = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 + abs(x[0]), "q p")
    energy = flow(field.conserving(), [1, 0], time=[10.0, 1000.0]).energy()
    assert_allclose(energy, 1, rtol=1e-14)


def test_crossings_are_on_their_surface_and_keep_the_energy():
    field, x0 = oval(), [0, 0.1, 0.5, 0]
    found = crossings(field.conserving(), x0, "x", time=500.0)
    assert abs(found.states[:, 0]).max() < 1e-12
    assert_allclose(field.energy(found.states), field.energy(np.array(x0)), rtol=1e-14)


def test_derivatives_of_motions():
    settings = {"time": [10.0, 100.0], "derivatives": "x0"}
    exact = flow(pendulum(), [1, 0.5], rtol=1e-13, **settings).derivatives["x0"]
    found = flow(pendulum().conserving(), [1, 0.5], **settings).derivatives["x0"]
    assert_allclose(found, exact, rtol=1e-8, atol=1e-8)


def test_constraints_in_time_from_a_late_start():
    rod = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - 9.81 * q[1],
        "x y",
        constraints=lambda q, v, t: (q[0] - np.sin(t) / 2) ** 2 + q[1] ** 2 - 1,
    )
    near = [np.sin(1e6) / 2 + np.sin(1), -np.cos(1), np.cos(1e6) / 2, 0]
    x0 = rod.mechanics.projected(near, t=1e6)
    motion = flow(rod, x0, time=np.linspace(0, 100, 500), t0=1e6)
    assert_allclose(motion.residuals(), 0, atol=1e-9)  # times at 1e6 are rounded to 1e-10


def test_signs_of_populations():
    field = Field(lambda x: (x[0] * (1 - x[1]), 2 * x[1] * (x[0] - 1)), "u v")
    V = lambda x: 2 * (x[0] - np.log(x[0])) + x[1] - np.log(x[1])  # noqa: E731
    states = flow(field.conserving(V), [12, 1e-3], time=np.linspace(1, 2000, 4000)).states
    assert (states > 0).all()
    assert_allclose(V(states.T), V([12, 1e-3]), rtol=1e-14)


def test_stiff_equations_are_not_harmed():
    field = Field(
        lambda x: (
            -0.04 * x[0] + 1e4 * x[1] * x[2],
            0.04 * x[0] - 1e4 * x[1] * x[2] - 3e7 * x[1] ** 2,
            3e7 * x[1] ** 2,
        ),
        "a b c",
    )
    plain = flow(field, [1, 0, 0], time=4e5)
    kept = flow(field.conserving(lambda x: x[0] + x[1] + x[2]), [1, 0, 0], time=4e5)
    assert abs(kept.steps - plain.steps) <= 2
    assert_allclose(kept.states, plain.states, rtol=1e-9)


def test_functions_that_are_no_integrals():
    with pytest.raises(ValueError, match="function 1 changes"):
        pendulum().conserving(lambda x: x[1] ** 2 / 2 - np.cos(x[0]), lambda x: x[0])
    with pytest.raises(TypeError, match="no energy"):
        Field(lambda x: (x[1], -x[0]), 2).conserving()


def test_files_keep_integrals():
    for field in (pendulum().conserving(), kepler().conserving(angular_momentum)):
        again = Field.from_dict(field.to_dict())
        assert again == field
        x0 = [1.0, 0.0] if len(field.names) == 2 else [0.4, 0, 0, 2.0]
        one, other = (flow(f, x0, time=20.0).states for f in (field, again))
        assert_array_equal(one, other)
    assert pendulum().conserving() != pendulum()


def test_later_calls_add_integrals():
    both = kepler().conserving(angular_momentum).conserving()
    assert both != kepler().conserving()
    assert both.conserving() == both == both.conserving(angular_momentum)
    states = flow(both, [0.4, 0, 0, 2.0], time=[1e2, 1e3]).states
    assert_allclose(angular_momentum(states.T), 0.8, rtol=1e-14)
    assert_allclose(both.energy(states), -0.5, rtol=1e-14)


def test_subsystems_keep_their_integrals():
    square = lambda x: x[0] ** 2 + x[1] ** 2  # noqa: E731
    field = Field(lambda x: (x[1], -x[0], 0 * x[2]), "q p r")
    part = field.conserving(square, lambda x: x[2] * square(x)).subsystem("q p")
    assert part == Field(lambda x: (x[1], -x[0]), "q p").conserving(square)
    assert_allclose(square(flow(part, [1.0, 0.0], time=1e4, rtol=1e-6).final), 1, rtol=1e-14)


def test_integrals_that_change_later():
    """A pulse, and damping far away, change an integral that was tested before."""
    energy = lambda x, k: (k * x[0] ** 2 + x[1] ** 2) / 2  # noqa: E731
    field = Field(
        lambda x, k, c: (x[1], -k * x[0] - np.where(x @ x > 900, c * x[1], 0)), 2, k=1.0, c=0.0
    )
    kept = field.conserving(energy)
    flow(kept.with_parameters(k=[1.0, 2.0, 3.0]), [1.0, 0.0], time=[0.0, 1.0])  # no warning
    with pytest.warns(IntegrationWarning, match="function 0 changes along f in 1 of 1"):
        flow(kept.with_parameters(c=1e-8), [40.0, 0.0], time=1.0)
    with pytest.warns(
        IntegrationWarning, match=r"in 2 of 6 solutions \(first: trajectory \(0, 2\) at t = 0"
    ):
        flow(kept.with_parameters(k=[[1.0], [2.0]], c=[0, 0, 1e-3]), [40.0, 0.0], time=1.0)
    pulse = Field(
        lambda x: (x[1], -x[0] + np.where(x[2] > 8, 0.02 * x[1], 0), 1.0), "q p t"
    ).conserving(lambda x: x[0] ** 2 + x[1] ** 2)
    flow(pulse, [1.0, 0.0, 0.0], time=7.0)  # no warning
    with pytest.warns(IntegrationWarning, match=r"at t = 8\)"):
        flow(pulse, [1.0, 0.0, 0.0], time=[7.0, 9.0, 11.0])
    damped = kept.with_parameters(c=0.1)
    with pytest.warns(IntegrationWarning, match="function 0 changes"):
        lyapunov_exponents(damped, [40.0, 20.0], time=1.0)

    def swings(t, y):
        c = np.where(t > 30, 0.5, 0.0)
        return y[1], -(2 + c * np.cos(3 * t)) * y[0] - c * y[1]

    swing = Field(swings, "q p").conserving(lambda x: 2 * x[0] ** 2 + x[1] ** 2)
    with pytest.warns(IntegrationWarning, match=r"function 0 changes .* at t = 32\)"):
        rest = periodic_orbit(swing, [0.1, 0.1], period=2 * np.pi / 3, t0=32.0)
    assert_allclose(rest.state, 0, atol=1e-12)  # where no integral changes


def square(x):
    return x[0] ** 2 + x[1] ** 2


def pulsed():
    """The square grows by a factor exp(.02) or so while t is between 8 and 9."""
    return Field(
        lambda t, x: (x[1], -x[0] + np.where((t > 8) & (t < 9), 0.02 * x[1], 0)), "q p"
    ).conserving(square)


@pytest.mark.parametrize("rtol", [1e-2, 1e-3, 1e-5, 1e-8, 1e-11])
def test_pulses_between_saved_states(rtol, tmp_path):
    field, x0, at = (
        pulsed(),
        [[1.0, 0.0], [0.0, 0.0], [0.0, 0.5]],
        r"first: trajectory 0 at t = 8\)",
    )
    with pytest.warns(IntegrationWarning, match=f"function 0 .* 2 of 3 solutions .{at}"):
        motion = flow(field, x0, time=[0.0, 20.0], rtol=rtol)
    assert motion.status.tolist() == [Status.NOT_KEPT, Status.OK, Status.NOT_KEPT]
    assert motion.ok.all()
    assert (motion.end == 20).all()
    motion.save(tmp_path / "motion.npz")
    assert_array_equal(load(tmp_path / "motion.npz").status, motion.status)
    with pytest.warns(IntegrationWarning, match=r"t = 9\)"):
        back = flow(field, x0[0], time=[0.0, -20.0], t0=20.0, rtol=rtol)
    assert (back.status, back.end) == (Status.NOT_KEPT, -20.0)
    with pytest.warns(IntegrationWarning, match="2 of 3 solutions"):
        flow(field, x0, time=20.0, rtol=rtol, derivatives="x0")
    with pytest.warns(IntegrationWarning, match="function 0"):
        hits = crossings(field, x0[0], "q", time=20.0, most=6, rtol=rtol)
    assert hits.status == Status.STOPPED
    with pytest.warns(IntegrationWarning, match="2 of 3 trajectories do not keep"):
        data = ensemble(
            field, np.array(x0), tmp_path / "store", time=[0.0, 20.0], chunks=2, rtol=rtol
        )
    assert_array_equal(data.status, motion.status)
    system = compiled.system(field, time=20.0, rtol=rtol)
    found, out = [], np.empty(3)
    for x in x0:
        memory = compiled.work(system)
        found.append(compiled.step_system(system, np.array([*x, 0.0]), out, memory))
    assert found == motion.status.tolist()


def test_pulses_in_long_steps_are_seen_at_all_sizes():
    """The pulse is one step, or a few; a pulse of 1e-9 changes the square by 1e-9 or so."""
    field = Field(
        lambda t, x, c: (x[1], -x[0] + np.where((t > 8) & (t < 9), c * x[1], 0)), "q p", c=0.0
    ).conserving(square)
    c = [0.0, 1e-9, -1e-7, 1e-5, 1e-3, 0.1]
    for rtol in (1e-3, 1e-6, 1e-9, 1e-12):
        with pytest.warns(IntegrationWarning, match="5 of 6"):
            motion = flow(field.with_parameters(c=c), [1.0, 0.0], time=[0.0, 20.0], rtol=rtol)
        assert motion.status.tolist() == [Status.OK] + 5 * [Status.NOT_KEPT]


def test_projections_that_are_left_out():
    """At rtol = 1e-2 populations fall so far that steps to the integral would change their sign."""
    integral = lambda x: x[0] - np.log(x[0]) + x[1] - np.log(x[1])  # noqa: E731
    field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), "u v").conserving(integral)
    x0 = 10.0 ** np.random.default_rng(0).uniform(-6.0, 1.0, (300, 2))
    with pytest.warns(IntegrationWarning, match="functions could not be kept in .* of 300"):
        motion = flow(field, x0, time=np.linspace(0.0, 60.0, 200), rtol=1e-2)
    left_out = motion.status == Status.NOT_KEPT
    assert 1 <= left_out.sum() <= 150
    x, w = motion.final.T, 1e-2 * motion.states.max(axis=0).T
    allowed = abs(1 - 1 / x) * w + abs(1 - 1 / (x + w)) * w + abs(1 - 1 / (x - w)) * w
    change = abs(integral(x) - integral(x0.T))
    assert (change < allowed.sum(axis=0))[~left_out].all()
    motion = flow(field, x0, time=60.0, rtol=1e-6)
    assert (motion.status == Status.OK).all()
    assert abs(integral(motion.final.T) - integral(x0.T)).max() < 1e-7


def test_integrals_of_solutions_that_slide_or_rest():
    """The first of each pair is an integral there, too; the second is one of free motions alone."""
    bodies = Field(lambda x: (x[2], x[3], 0 * x[0], -1 + 0 * x[0]), "x y u v")
    floor = Event("y", to=["x", "y", "u", "-0.5*v"], direction="down")
    slides = Field(lambda x: (-np.sign(x[0]), x[2], -x[1], 1 + 0 * x[0]), "s q p a")
    x0 = [0.0, 1.0, 0.3, 0.0], [1.0, 1.0, 0.0, 0.0]
    for field, start, events, function, is_kept in (
        (bodies, x0[0], floor, lambda x: x[3] ** 2 / 2 + x[1], True),
        (bodies, x0[0], floor, lambda t, x: x[3] + t, False),
        (slides, x0[1], (), lambda x: x[1] ** 2 + x[2] ** 2, True),
        (slides, x0[1], (), lambda x: x[3] + abs(x[0]), False),
    ):
        kept, at = field.conserving(function), {"time": [0.0, 2.0, 10.0], "events": events}
        if is_kept:
            assert flow(kept, start, **at).status == Status.OK
            continue
        with pytest.warns(IntegrationWarning, match="function 0 changes along f in 1 of 1"):
            motion = flow(kept, start, **at)
        assert motion.status == Status.NOT_KEPT
        assert_allclose(motion.states, flow(field, start, **at).states, atol=1e-9)


def test_integrals_of_time_without_a_proof():
    field = Field(lambda t, x: (np.tanh(t) + 0 * x[0], x[0]), "a b").conserving(
        lambda t, x: x[0] - np.log(np.cosh(t))
    )
    for t0 in (-30.0, 0.0, 1e4):
        motion = flow(field, [1.0, 0.0], time=[0.0, 10.0], t0=t0)
        assert motion.status == Status.OK
        gain = np.logaddexp(t0 + 10, -t0 - 10) - np.logaddexp(t0, -t0)
        assert_allclose(motion.final[0], 1 + gain, rtol=1e-11)


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-7, 1e-10, 1e-13])
def test_integrals_that_are_kept_cause_no_warning(rtol):
    """Equilibria, states near them, circular orbits, L = 0, dependent integrals: no alarm."""
    rng = np.random.default_rng(2)
    near = 10.0 ** -np.arange(1.0, 17.0)
    starts = np.stack([np.pi + near, 0 * near], axis=-1)
    starts = np.concatenate([starts, starts[:, ::-1] * near[:, np.newaxis], [[0.0, 0.0], [1.0, 0]]])
    assert (flow(pendulum().conserving(), starts, time=50.0, rtol=rtol).status == Status.OK).all()
    shifted = Field(lambda x: (x[1], 1 - x[0]), "q p").conserving(
        lambda x: square((x[0] - 1, x[1]))
    )
    starts[:, 0] += 1.0
    assert (flow(shifted, starts, time=50.0, rtol=rtol).status == Status.OK).all()
    e = np.array([0.0, *near, 0.3, 0.9])
    orbits = np.stack([1 - e, 0 * e, 0 * e, np.sqrt((1 + e) / (1 - e))], axis=-1)

    def energy(x):
        return (x[2] ** 2 + x[3] ** 2) / 2 - 1 / np.sqrt(square(x))

    def axis(x):
        return x[3] * angular_momentum(x) - x[0] / np.sqrt(square(x))

    for integrals in ([energy], [energy, angular_momentum], [energy, angular_momentum, axis]):
        motion = flow(kepler().conserving(*integrals), orbits, time=[0.0, 20.0, 40.0], rtol=rtol)
        for each in integrals:
            values = each(np.moveaxis(motion.states, -1, 0))
            assert abs(values - values[0]).max() < 4 * rtol
        assert (motion.status == Status.OK).all()
    jumps = Field(lambda x: (x[1], -np.sign(x[0])), "q p").conserving(
        lambda x: x[1] ** 2 / 2 + abs(x[0])
    )
    x0 = rng.normal(size=(300, 2))
    assert (flow(jumps, x0, time=20.0, rtol=rtol).status == Status.OK).all()
    unproved = Field(lambda x: (x[1], -np.tanh(x[0])), "q p").conserving(
        lambda x: x[1] ** 2 / 2 + np.log(np.cosh(x[0]))
    )
    x0 *= 10.0 ** rng.uniform(-16.0, 1.5, (300, 1))
    assert (flow(unproved, x0, time=20.0, rtol=rtol).status == Status.OK).all()
