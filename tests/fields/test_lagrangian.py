"""Tests of equations from Lagrangians with constraints, against exact values."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ellipk

from suslov_fast import Field, IntegrationWarning, Suslov3D, flow
from suslov_fast.fields.constraints import constraints_of
from suslov_fast.fields.lagrangian import velocity
from suslov_fast.fields.proofs import changes_of

cos, sin = np.cos, np.sin


def cross(a, b):
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def omega(q, v):
    """Angular velocity in the axes of the body, for Euler angles: R = Rz(a) Rx(b) Rz(c)."""
    (_, b, c), (da, db, dc) = q, v
    turned = da * sin(b)
    return np.stack(
        [turned * sin(c) + db * cos(c), turned * cos(c) - db * sin(c), da * cos(b) + dc]
    )


def rotation(q):
    a, b, c = q
    u = [cos(a) * cos(c) - sin(a) * cos(b) * sin(c), -cos(a) * sin(c) - sin(a) * cos(b) * cos(c)]
    v = [sin(a) * cos(c) + cos(a) * cos(b) * sin(c), -sin(a) * sin(c) + cos(a) * cos(b) * cos(c)]
    rows = [*u, sin(a) * sin(b)], [*v, -cos(a) * sin(b)], [sin(b) * sin(c), sin(b) * cos(c), cos(b)]
    return np.array(rows)


def pendulum():
    return Field.from_lagrangian(
        lambda q, v, g: v @ v / 2 - g * q[1], "x y", constraints=lambda q, v: q @ q - 1, g=9.81
    )


def edge(k=1.0):
    return Field.from_lagrangian(
        lambda q, v, k: v @ v / 2 - k * q[0],
        "x y a",
        constraints=lambda q, v: v[0] * sin(q[2]) - v[1] * cos(q[2]),
        k=k,
    )


def test_pendulum_has_its_period_and_length():
    T = 4 * ellipk(sin(1.0) ** 2) / np.sqrt(9.81)
    x0 = [sin(2.0), -cos(2.0), 0, 0]
    motion = flow(pendulum(), x0, time=T * np.linspace(0, 100, 2000))
    assert_allclose(motion.states[-1], x0, atol=1e-5)
    assert_allclose(flow(pendulum(), x0, time=T).states[0], x0, atol=1e-9)
    assert_allclose(motion.residuals(), 0, atol=1e-13)  # also between steps
    assert_allclose(motion.energy(), 9.81 * x0[1], rtol=1e-6)


@pytest.mark.parametrize("a", [1e-3, 1e-6, 1e-9])
def test_small_oscillations_keep_their_digits(a):
    """The height is -1 + x**2 / 2, and rounding errors in its rate must not reach x."""
    x, _, vx, _ = flow(pendulum(), [a, -np.sqrt(1 - a * a), 0, 0], time=20.0).final
    turned = np.sqrt(9.81) * 20.0
    assert abs(x / a - cos(turned)) < 5e-9 + 10 * a * a
    assert abs(vx / a / np.sqrt(9.81) + sin(turned)) < 5e-9 + 10 * a * a


def test_double_pendulum_is_the_field_with_masses():
    def lagrangian(q, v, g):
        kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * cos(q[0] - q[1])
        return kinetic + g * (2 * cos(q[0]) + cos(q[1]))

    def mass(x):
        c = cos(x[0] - x[1])
        return [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 2, c], [0, 0, c, 1]]

    def right(x):
        s = sin(x[0] - x[1])
        return x[2], x[3], -s * x[3] ** 2 - 19.62 * sin(x[0]), s * x[2] ** 2 - 9.81 * sin(x[1])

    field, x = Field.from_lagrangian(lagrangian, "a b", g=9.81), [0.1, 0.2, 0.3, -1]
    assert_allclose(field(x), Field(right, 4, mass=mass)(x), rtol=1e-14)


def test_kowalevski_top_keeps_its_integral():
    def of_angles(q, v):
        O = omega(q, v)
        return (O * np.array([2.0, 2, 1])) @ O / 2 - rotation(q)[2][0]

    def of_body(q, u):
        return (u * np.array([2.0, 2, 1])) @ u / 2 - q[0]

    def integral(O, g):
        return (O[0] ** 2 - O[1] ** 2 - g[0]) ** 2 + (2 * O[0] * O[1] - g[1]) ** 2

    t = np.linspace(0, 20, 50)
    x = flow(Field.from_lagrangian(of_angles, "a b c"), [0.1, 1, 0.3, 0.2, 0.5, -0.4], time=t)
    q, v = x.states[:, :3].T, x.states[:, 3:].T
    values = integral(omega(q, v), rotation(q)[2])
    assert_allclose(values, values[0], rtol=2e-8)
    field = Field.from_lagrangian(
        of_body, "g1 g2 g3", "O1 O2 O3", frame=lambda q, u: cross(q, u), algebra="so3"
    )
    y = flow(field, [*rotation(q[:, 0])[2], *omega(q[:, 0], v[:, 0])], time=t).states.T
    assert_allclose(y[3:], omega(q, v), atol=1e-7)
    kept = field.conserving(lambda x: integral(x[3:], x), lambda x: x[:3] @ x[:3])
    y = flow(kept, y[:, 0], time=t * 50).states.T
    assert_allclose(integral(y[3:], y[:3]), values[0], rtol=1e-13)


def test_chaplygin_sleigh_stops_turning():
    m, J, a, spin, t = 1.0, 0.5, 0.7, 2.0, np.linspace(0, 10, 30)

    def lagrangian(q, v):
        X, Y = v[0] - a * v[2] * sin(q[2]), v[1] + a * v[2] * cos(q[2])
        return m * (X * X + Y * Y) / 2 + J * v[2] ** 2 / 2

    field = Field.from_lagrangian(
        lagrangian, "x y angle", constraints=lambda q, v: v[1] * cos(q[2]) - v[0] * sin(q[2])
    )
    x, k = flow(field, [0, 0, 0.4, 0, 0, spin], time=t).states.T, np.sqrt((J + m * a * a) / m)
    rate = a * spin / k
    assert_allclose(x[3] * cos(x[2]) + x[4] * sin(x[2]), k * spin * np.tanh(rate * t), atol=1e-9)
    assert_allclose(x[5], spin / np.cosh(rate * t), atol=1e-9)
    rates = field._right_hand_sides[0].f.rates
    assert len(rates.operations) < 30  # 97 if the blade's sine and cosine are no unit vector


def test_knife_edge_is_a_cycloid_with_its_reaction():
    t = np.linspace(0, 10, 20)
    x = flow(edge(), [0, 0, 0, 0, 0, 1], time=t).states
    assert_allclose(x[:, 0], -(sin(t) ** 2) / 2, atol=1e-9)
    assert_allclose(x[:, 1], -(t - sin(t) * cos(t)) / 2, atol=1e-9)
    assert_allclose(edge().mechanics.multipliers(x)[:, 0], 2 * sin(t), atol=1e-9)
    assert_allclose(edge().mechanics.reactions(x)[:, 0], 2 * sin(t) * sin(x[:, 2]), atol=1e-9)


def penny(slope=0.0):
    m, R, inertia, J = 2.0, 0.3, 0.09, 0.045

    def lagrangian(q, v, slope):
        turning = inertia * v[2] ** 2 / 2 + J * v[3] ** 2 / 2
        return m * (v[0] ** 2 + v[1] ** 2) / 2 + turning + m * slope * q[0]

    def rolling(q, v):
        return v[0] - R * cos(q[3]) * v[2], v[1] - R * sin(q[3]) * v[2]

    return Field.from_lagrangian(lagrangian, "x y roll heading", constraints=rolling, slope=slope)


def test_penny_rolls_in_circles_and_not_down_a_slope():
    t, roll, w = np.linspace(0, 20, 40), 1.5, 0.8
    x = flow(penny(), [0, 0, 0, 0, 0.3 * roll, 0, roll, w], time=t).states
    assert_allclose(x[:, 0], 0.3 * roll / w * sin(w * t), atol=1e-8)
    force = 2.0 * 0.3 * roll * w * np.stack([-sin(w * t), cos(w * t)], axis=1)
    assert_allclose(penny().mechanics.multipliers(x), force, atol=1e-8)
    x = flow(penny(3.0), [0, 0, 0, 0, 0, 0, 0, w], time=t).states
    k = 2.0 * 3.0 * 0.3 / (0.09 + 2.0 * 0.3**2)
    assert_allclose(x[:, 2], k * (1 - cos(w * t)) / w**2, atol=1e-8)


def disk():
    """A thin rolling disk of radius and mass 1; q is the centre, then Euler angles."""

    def lagrangian(q, v):
        O, rise = omega(q[2:], v[2:]), cos(q[3]) * v[3]
        turning = (O[0] ** 2 + O[1] ** 2) / 8 + O[2] ** 2 / 4
        return (v[0] ** 2 + v[1] ** 2 + rise**2) / 2 + turning - 9.81 * sin(q[3])

    def rolling(q, v):
        w, a, b = rotation(q[2:]) @ omega(q[2:], v[2:]), q[2], q[3]
        down = np.stack([sin(a) * cos(b), -cos(a) * cos(b), -sin(b)])
        u = cross(w, down)
        return v[0] + u[0], v[1] + u[1]

    return Field.from_lagrangian(lagrangian, "x y a b c", constraints=rolling)


def test_rolling_disk_is_stable_above_its_critical_speed():
    field, critical = disk(), np.sqrt(9.81 / 3)
    for speed, is_stable in ((critical * 1.001, True), (critical * 0.999, False)):
        x0 = field.mechanics.projected([0, 0, 0, np.pi / 2, 0, -speed, 0, 0, 0, speed])
        assert (np.linalg.eigvals(field.jacobian(x0)).real.max() < 1e-3) == is_stable
    x0 = field.mechanics.projected([0, 0, 0, 1.2, 0, 0, 0, 0.5, 0.1, 3.0])
    motion = flow(field, x0, time=np.linspace(0, 20, 100))
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)
    assert_allclose(motion.residuals(), 0, atol=1e-13)


def disk_by_hand():
    """The disk typed in angular velocities along its line of nodes, across it, and of its spin."""

    def f(x):
        _, _, a, b, _, w1, w2, w3 = x
        turn = w2 * cos(b) / sin(b)
        return (
            w1 * sin(a) * sin(b) - w3 * cos(a),
            -w3 * sin(a) - w1 * cos(a) * sin(b),
            w2 / sin(b),
            w1,
            w3 - turn,
            (0.25 * turn * w2 - 1.5 * w2 * w3 - 9.81 * cos(b)) / 1.25,
            (0.5 * w3 - 0.25 * turn) * w1 / 0.25,
            2 / 3 * w1 * w2,
        )

    return Field(f, "x y a b c w1 w2 w3")


def test_rolling_disk_is_as_short_as_its_equations():
    field, hand = disk(), disk_by_hand()
    x0 = field.mechanics.projected([0, 0, 0.3, 1.2, 0, 0, 0, 0.5, 0.1, 3.0])
    q, v, b = x0[:5], x0[5:], x0[3]
    start = [*q, v[3], v[2] * sin(b), v[4] + v[2] * cos(b)]
    t = np.linspace(0, 5, 20)
    found, exact = flow(field, x0, time=t).states, flow(hand, start, time=t).states
    assert_allclose(found[:, :5], exact[:, :5], atol=1e-7)
    rates = field._right_hand_sides[0].f.rates
    assert len(rates.operations) < 100  # 583 without cos**2 + sin**2 = 1


def test_formulas_keep_their_digits():
    """A stiff spring near its length, and a bar's small inertia: differences are not expanded."""

    def lagrangian(q, v, k):
        r, a = q
        return (v[0] ** 2 + (r * cos(a) * v[1]) ** 2 + (r * sin(a) * v[1]) ** 2) / 2 - k * (
            r - 1
        ) ** 2 / 2

    field = Field.from_lagrangian(lagrangian, "r a", k=1e8)
    x = [1 + 2.0**-40, 0.7, 0.0, 1e-5]
    assert_allclose(field(x)[2], -1e8 * 2.0**-40 + 1e-10 * (1 + 2.0**-40), rtol=1e-14)
    assert "sin" not in repr(field)


@pytest.mark.parametrize("L", [lambda q, v: (v[0] + v[1]) ** 2, lambda q, v: v[0] ** 2 - q[1]])
def test_singular_masses(L):
    with pytest.raises(ValueError, match=r"^L must be .* L_vv"):
        Field.from_lagrangian(L, "x y")


def test_drag_on_a_constraint():
    """An overdamped pendulum: the implicit integrator, and steps that stay on the circle."""
    drag = {"forces": lambda q, v, c: -c * v, "c": 1000.0}
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1], "x y", constraints=lambda q, v: q @ q - 1, **drag
    )
    motion = flow(field, [1, 0, 0, 0], time=[1e3, 5e3, 1e5])
    exact = 1 / np.cosh(motion.time / 1000)  # of 1000 a' = -sin(a), up to 1 / 1000**2
    assert_allclose(motion.states[:, 0], exact, rtol=1e-4, atol=1e-12)
    assert_allclose(motion.residuals(), 0, atol=1e-15)
    assert motion.steps < 1000


def test_chaplygin_ball_keeps_its_moment_in_space():
    inertia = np.array([1.0, 1.6, 2.1])

    def lagrangian(q, v):
        O = omega(q[2:], v[2:])
        return (v[0] ** 2 + v[1] ** 2) / 2 + (O * inertia) @ O / 2

    def rolling(q, v):
        w = rotation(q[2:]) @ omega(q[2:], v[2:])
        return v[0] - w[1], v[1] + w[0]

    field = Field.from_lagrangian(lagrangian, "x y a b c", constraints=rolling)
    x0 = field.mechanics.projected([0, 0, 0.2, 1, 0.3, 0, 0, 0.5, 0.6, -0.7])
    states = flow(field, x0, time=np.linspace(0, 30, 20)).states

    def moment(x):
        R, O = rotation(x[2:5]), omega(x[2:5], x[7:])
        w = R @ O
        return R @ (inertia * O) + [w[0], w[1], 0]

    assert_allclose([moment(x) for x in states], [moment(x0)] * 20, atol=1e-8)


def test_suslov_problem_is_the_body_of_the_package():
    inertia = np.array([[4, 0, -0.5], [0, 2, -0.3], [-0.5, -0.3, 3]])
    field = Field.from_lagrangian(
        lambda q, u: u @ (inertia @ u) / 2,
        "g1 g2 g3",
        "O1 O2 O3",
        frame=lambda q, u: cross(q, u),
        algebra="so3",
        constraints=lambda q, u: u[2],
    )
    body, t = Suslov3D(4, 2, -0.5, -0.3), np.linspace(0, 5, 6)
    x, exact = flow(field, [0, 0, 1, 1, 0.5, 0], time=t), flow(body, [1, 0.5], time=t)
    assert_allclose(x.states[:, 3:5], exact.states, atol=1e-12)
    assert_allclose(
        field.mechanics.multipliers(x.states)[:, 0], body.reaction(exact.states), atol=1e-11
    )
    alone = field.subsystem("O1 O2", O3=0.0)
    assert_allclose(alone([1, 0.5]), field([0, 0, 1, 1, 0.5, 0])[3:5], atol=1e-15)
    angles = Field.from_lagrangian(
        lambda q, v: omega(q, v) @ (inertia @ omega(q, v)) / 2,
        "a b c",
        constraints=lambda q, v: omega(q, v)[2],
    )
    b, c = 1.2, 0.3
    turn = (sin(c) + 0.5 * cos(c)) / sin(b)
    x = flow(angles, [0, b, c, turn, cos(c) - 0.5 * sin(c), -cos(b) * turn], time=t).states
    assert_allclose(omega(x[:, :3].T, x[:, 3:].T)[:2].T, exact.states, atol=1e-8)
    assert_allclose(angles.mechanics.multipliers(x)[:, 0], body.reaction(exact.states), atol=1e-7)


def test_snakeboard_by_constraints_and_by_its_shape():
    """The theta' of a snakeboard that starts at rest follows from its balance of momentum."""
    m, J, Jr, Jw, r = 1.0, 0.3, 0.1, 0.05, 0.5

    def lagrangian(q, v):
        turning = J * v[2] ** 2 + Jr * (v[2] + v[3]) ** 2
        wheels = Jw * ((v[2] + v[4]) ** 2 + (v[2] - v[4]) ** 2)
        return (m * (v[0] ** 2 + v[1] ** 2) + turning + wheels) / 2

    def rolling(q, v):
        _, _, a, _, b = q
        side = r * cos(b) * v[2]
        return (
            -sin(a + b) * v[0] + cos(a + b) * v[1] - side,
            -sin(a - b) * v[0] + cos(a - b) * v[1] + side,
        )

    field = Field.from_lagrangian(
        lagrangian,
        "x y theta psi phi",
        constraints=rolling,
        forces=lambda q, v, t: (0, 0, 0, 0.1 * cos(t), 0.08 * sin(t)),
    )
    t = np.linspace(0, 20, 30)
    x = flow(field, [0, 0, 0, 0, 0.4, 0, 0, 0, 0, -0.8], time=t).states
    # Forces on psi and phi give Jr (theta' + psi') = 0.1 sin(t) and 2 Jw phi' = -0.08 cos(t).
    assert_allclose(0.1 * (x[:, 7] + x[:, 8]), 0.1 * sin(t), atol=1e-9)
    assert_allclose(0.1 * x[:, 9], -0.08 * cos(t), atol=1e-9)
    assert_allclose(field.mechanics.residuals(x), 0, atol=1e-13)


def test_spherical_pendulum_keeps_energy_and_moment():
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[2], "x y z", constraints=lambda q, v: q @ q - 1
    )
    x0 = field.mechanics.projected([0.6, 0, -0.8, 0.1, 0.5, 0])
    kept = field.conserving(lambda x: x[3:] @ x[3:] / 2 + x[2], lambda x: x[0] * x[4] - x[1] * x[3])
    motion = flow(kept, x0, time=np.linspace(0, 1000, 500))
    x = motion.states.T
    assert_allclose(x[0] * x[4] - x[1] * x[3], x0[0] * x0[4], rtol=1e-14)
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-14)
    assert_allclose(motion.residuals(), 0, atol=1e-14)


def chain(n):
    """A chain of n masses in Cartesian coordinates, with rods of length 1."""

    def lengths(q, v):
        p = np.reshape(q, (n, 2))
        d = np.concatenate([p[:1], p[1:] - p[:-1]])
        return (d * d).sum(axis=1) - 1

    names = [f"{a}{i}" for i in range(n) for a in "xy"]
    return Field.from_lagrangian(lambda q, v: v @ v / 2 - sum(q[1::2]), names, constraints=lengths)


def chain_at_rest(n):
    x0 = np.zeros(4 * n)
    x0[1 : 2 * n : 2] = -np.arange(1, n + 1)
    return x0


@pytest.mark.parametrize("n", [3, 10])
def test_chain_has_the_frequencies_of_laguerre(n):
    field, x0 = chain(n), chain_at_rest(n)
    assert_allclose(field.mechanics.residuals(x0), 0, atol=1e-15)
    squares = np.linalg.eigvals(field.jacobian(x0)).imag ** 2
    exact = np.repeat(np.polynomial.laguerre.lagroots([0] * n + [1]), 2)
    assert_allclose(np.sort(squares)[-2 * n :], np.sort(exact), rtol=1e-9)
    x0[2 * n : 4 * n : 2] = 0.1 * np.arange(1, n + 1)
    motion = flow(field, x0, time=np.linspace(0, 20, 50))
    assert_allclose(motion.residuals(), 0, atol=1e-12)
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)


@pytest.mark.parametrize("upright", [0.0, np.pi / 2])
def test_points_without_inertia_keep_their_energy(upright):
    """M is singular where both points are upright: only the constraint keeps the rod's foot."""

    def points(q):
        a = q[2] + upright
        up = np.stack([0 * a, sin(a), cos(a)])
        foot = np.stack([q[0], q[1], 0 * a])
        return foot + 1.0 * up, foot + 2.0 * up

    def lagrangian(q, v):
        rates = [velocity(lambda q, k=k: points(q)[k], q, v) for k in range(2)]
        return sum(r @ r for r in rates) / 2 - sum(p[2] for p in points(q))

    field = Field.from_lagrangian(lagrangian, "x y a", constraints=lambda q, v: v[1] - q[0] * v[0])
    x0 = field.mechanics.projected([0.1, 0, 0.3 - upright, 1, 0, 0.4])
    motion = flow(field, x0, time=5.0)
    assert_allclose(motion.energy()[-1], field.energy(x0), rtol=1e-8)


def test_states_off_constraints():
    with pytest.raises(ValueError, match="off by 1"):
        flow(edge(), [0, 0, 0, 0, 1, 1], time=1.0)
    with pytest.raises(ValueError, match="off by 2 at 1"):
        flow(pendulum(), [[1, 0, 0, 1.0], [1, 0, 1, 0]], time=1.0)


def test_constraints_that_depend_on_one_another():
    with pytest.raises(ValueError, match="must be independent"):
        Field.from_lagrangian(
            lambda q, v: v @ v / 2, "x y", constraints=lambda q, v: (q @ q - 1, q @ v)
        )
    circles = Field.from_lagrangian(
        lambda q, v: v @ v / 2,
        "x y",
        constraints=lambda q, v: (q @ q - 1, (q[0] - 2) ** 2 + q[1] ** 2 - 1),
    )
    with pytest.raises(ValueError, match="singular one"):
        flow(circles, [1, 0, 0, 0], time=1.0)  # they touch there
    cross_roads = Field.from_lagrangian(
        lambda q, v: v @ v / 2, "x y", constraints=lambda q, v: q[0] * q[1]
    )
    with pytest.raises(ValueError, match="singular one at 1"):
        flow(cross_roads, [[1, 0, 0, 0], [0, 0, 0, 0]], time=1.0)


def bars():
    """A parallelogram of bars, which may also fold into a crossed one where it is flat."""
    return Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1] / 10,
        "x y z w",
        constraints=lambda q, v: (
            q[:2] @ q[:2] - 1,
            (q[2] - 2) ** 2 + q[3] ** 2 - 1,
            (q[0] - q[2]) ** 2 + (q[1] - q[3]) ** 2 - 4,
        ),
    )


@pytest.mark.parametrize("rtol", [1e-2, 1e-4, 1e-6, 1e-9, 1e-12])
def test_solutions_end_where_constraints_become_dependent(rtol):
    lines = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - 0.1 * q[1], "x y", constraints=lambda q, v: q[0] * q[1]
    )
    with pytest.warns(IntegrationWarning, match="dependent"):
        motion = flow(lines, [1, 0, -1, 0], time=[0.5, 2.0], rtol=rtol)
    assert_allclose(motion.end, 1.0, atol=10 * rtol)
    assert_allclose(motion.states, [[0.5, 0, -1, 0], [np.nan] * 4], atol=1e-12)
    with pytest.warns(IntegrationWarning, match="dependent"):
        motion = flow(bars(), [0, 1, 2, 1, 1, 0, 1, 0], time=10.0, rtol=rtol)
    angle = flow(lambda x: (x[1], -np.cos(x[0]) / 20), [np.pi / 2, -1], time=motion.end)
    assert_allclose(angle.states[0, 0], 0, atol=max(30 * rtol, 1e-5))


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9, 1e-12])
def test_constraints_turn_at_any_tolerance(rtol):
    """A body that moves fast on a small circle, and chains at rest, do not end."""
    x0 = [1e3, 0, 0, 1e3]
    track = Field.from_lagrangian(
        lambda q, v: v @ v / 2,
        "x y",
        constraints=lambda q, v: (q[0] - 1e3 + 1) ** 2 + q[1] ** 2 - 1,
    )
    motion = flow(track, x0, time=[1.0, 10.0], rtol=rtol)
    assert motion.ok
    assert_allclose(motion.residuals(), 0, atol=1e-7)
    rest = flow(chain(8), chain_at_rest(8), time=10.0, rtol=rtol)
    assert_allclose(rest.states[0], chain_at_rest(8), atol=1e-12)


@pytest.mark.parametrize("far", [0.0, 1e5, 1e9])
def test_far_coordinates_do_not_end_solutions(far):
    """An error of z is allowed that is longer than the ellipse; constraints do not read z."""
    track = Field.from_lagrangian(
        lambda q, v: v @ v / 2, "x y z", constraints=lambda q, v: q[0] ** 2 + 9 * q[1] ** 2 - 1
    )
    assert flow(track, [1, 0, far, 0, 1.0, 0.1], time=10.0, rtol=1e-3).ok


def test_starts_near_constraints_are_moved_there():
    x = flow(pendulum(), [1 + 1e-8, 0, 0, 1.0], time=[1.0, 2.0], rtol=1e-12)
    assert_allclose(x.residuals(), 0, atol=1e-13)


@pytest.mark.parametrize("length", [1.0, [1.0, 2.0, 3.0]])
def test_machine_code_tests_the_starts_of_batches(length):
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2, "x y", constraints=lambda q, v, R: q @ q - R * R, R=length
    )
    x = np.array(length)[..., np.newaxis] * np.array([[cos(1.0), sin(1.0), 0, 0]] * 21)[:, None]
    x = x[:, 0] if np.ndim(length) == 0 else x
    x[4] *= 1.01
    constraints = constraints_of(field)
    first = constraints.tested(x, field._inputs)
    for _ in range(60):
        found = constraints.tested(x, field._inputs)
    assert callable(constraints._test.calls["start", False])
    np.testing.assert_array_equal(found, first)
    assert (found[0] == (np.arange(21) != 4).reshape(-1, *[1] * (x.ndim - 2))).all()


def test_bead_on_a_rotating_wire():
    """r" = r w**2 along a wire that turns at the rate w: r = cosh(w t)."""
    wire = Field.from_lagrangian(
        lambda q, v: v @ v / 2,
        "x y",
        constraints=lambda q, v, t: q[0] * sin(2 * t) - q[1] * cos(2 * t),
    )
    motion = flow(wire, [1, 0, 0, 2], time=[0.5, 1.0], t0=0.0)
    x = motion.states
    assert_allclose(np.hypot(x[:, 0], x[:, 1]), np.cosh([1.0, 2.0]), rtol=1e-9)
    assert wire.dimension == 4
    r, w = np.cosh([1.0, 2.0]), 2.0
    rate = w * np.sinh([1.0, 2.0])
    assert_allclose(motion.energy(), (rate**2 + (r * w) ** 2) / 2, rtol=1e-9)
    assert_allclose(motion.residuals(), 0, atol=1e-13)
    side = np.stack([-sin(2 * motion.time), cos(2 * motion.time)], axis=1)
    force = 2 * w * rate  # of Coriolis
    assert_allclose((motion.reactions() * side).sum(axis=1), force, rtol=1e-9)
    later = flow(wire, motion, time=0.25)
    assert_allclose(np.hypot(*later.final[:2]), np.cosh(2.5), rtol=1e-9)
    assert_allclose(later.energy(), ((2 * np.sinh(2.5)) ** 2 + (2 * np.cosh(2.5)) ** 2) / 2)
    assert Field.from_dict(wire.to_dict()) == wire
    turned = [cos(2.0), sin(2.0), -2 * sin(2.0), 2 * cos(2.0)]
    late = flow(wire, turned, time=1.0, t0=1.0).final
    assert_allclose(np.hypot(*late[:2]), np.cosh(2.0), rtol=1e-9)
    assert_allclose(wire.mechanics.residuals(turned, t=1.0), 0, atol=1e-15)
    with pytest.raises(ValueError, match="off by"):
        flow(wire, turned, time=1.0)


def test_a_time_that_nothing_reads_is_no_component():
    free = Field.from_lagrangian(lambda q, v, t: v @ v / 2 - q[0] ** 2, "x")
    assert free == Field.from_lagrangian(lambda q, v: v @ v / 2 - q[0] ** 2, "x")


def test_fields_without_mechanics():
    with pytest.raises(TypeError, match="no mechanics"):
        Field(lambda x: -x, "x").mechanics  # noqa: B018
    free = Field.from_lagrangian(lambda q, v: v @ v / 2, "x")
    assert free.mechanics.momenta([1.0, 2.0]).tolist() == [2.0]
    with pytest.raises(TypeError, match="no residuals"):
        free.mechanics.projected([1.0, 2.0])


def test_projected_states():
    found = pendulum().mechanics.projected([[1e3, 1e3, 0, 0], [0.3, -0.4, 1.0, 2.0]])
    assert_allclose(found[0], [0.5**0.5, 0.5**0.5, 0, 0], rtol=1e-14)
    assert_allclose(found[1], [0.6, -0.8, 1.6, 1.2], rtol=1e-14)
    for bad in ([0, 0, 0, 0], [[1.0, 0, 0, 0], [0, 0, 0, 0]]):
        with pytest.raises(ValueError, match="near the constraints"):
            pendulum().mechanics.projected(bad)


def test_moving_supports_are_no_velocities():
    """The rank of constraints of q and t is that of their slopes by q alone."""
    rod = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1],
        "x y",
        constraints=lambda q, v, t, a: (q[0] - a * sin(3 * t)) ** 2 + q[1] ** 2 - 1,
        a=[0.0, 0.1],
    )
    start = rod.mechanics.projected([0, -1.0, 0, 0])
    x = flow(rod, start, time=2.0, rtol=1e-11).states[0]
    # a'' = -sin(a) - X'' cos(a) for the angle a, and X = 0.1 sin(3 t)
    angle = flow(
        lambda t, x: (x[1], -sin(x[0]) + 0.9 * sin(3 * t) * cos(x[0])), [0, -0.3], time=2.0
    ).states[0]
    assert_allclose(x[0], [0, -1, 0, 0], atol=1e-14)
    assert_allclose(x[1, :2], [0.1 * sin(6.0) + sin(angle[0]), -cos(angle[0])], atol=1e-8)


def test_constraints_that_leave_nothing_free():
    """The motion is given, as a function of time; multipliers are the forces that it takes."""
    given = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[0],
        "x y",
        constraints=lambda q, v, t: (q[0] - t**2, q[1] - sin(t)),
    )
    motion = flow(given, [0, 0, 0, 1], time=2.0)
    assert_allclose(motion.states, [[4, sin(2.0), 4, cos(2.0)]], atol=1e-9)
    assert_allclose(motion.reactions(), [[3, -sin(2.0)]], atol=1e-9)
    with pytest.raises(ValueError, match="dependent on one another"):
        Field.from_lagrangian(
            lambda q, v: v @ v / 2, "x y", constraints=lambda q, v: (v[0], v[1], q[0] * v[1])
        )


def test_files_and_families():
    field, x = edge(2.0), [0, 0, 1, 0, 0, 1]
    again = Field.from_dict(field.to_dict())
    assert again == field
    assert_allclose(again.mechanics.reactions(x), field.mechanics.reactions(x), rtol=0)
    ends = flow(edge([1, 2.0]), [0, 0, 0, 0, 0, 1], time=np.pi).states[-1, :, 1]
    assert_allclose(ends, [-np.pi / 2, -np.pi], atol=1e-9)
    by_k = flow(field, [0, 0, 0, 0, 0, 1], time=np.pi, derivatives="k").derivatives["k"]
    assert_allclose(np.ravel(by_k)[1], -np.pi / 2, atol=1e-8)


def test_energies_are_proved_by_the_power_of_reactions():
    """dE/dt = lambda . phi as formulas; a drag leaves c v . v, so the energy is tested."""
    assert changes_of(pendulum().conserving()) is None
    damped = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[1],
        "x y",
        constraints=lambda q, v: q @ q - 1,
        forces=lambda q, v, c: -c * v,
        c=0.0,
    )
    kept = damped.conserving()
    assert changes_of(kept) is not None
    with pytest.raises(ValueError, match="changes along the motion"):
        kept.with_parameters(c=1e-6)
    with pytest.raises(ValueError, match="changes along the motion"):
        damped.with_parameters(c=1e-3).conserving()
