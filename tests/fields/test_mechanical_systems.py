"""Mechanical systems of the literature: exact values, and d'Alembert's principle."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.linalg import expm, null_space

from suslov_fast import Field, flow
from suslov_fast.fields.lagrangian import velocity

cos, sin = np.cos, np.sin


def cross(a, b):
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def about_x(a):
    return np.array([[1.0, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]])


def about_y(a):
    return np.array([[cos(a), 0, sin(a)], [0, 1.0, 0], [-sin(a), 0, cos(a)]])


def about_z(a):
    return np.array([[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1.0]])


def slopes(f, x):
    """Return f' at x, by complex steps."""
    steps = 1e-30j * np.eye(len(x))
    return np.stack([np.ravel(f(x + step)).imag for step in steps], axis=-1) * 1e30


def assert_principle(field, L, x0, constraints=None, forces=None, time=1.0, atol=1e-7):
    """Compare d(L_v)/dt - L_q - Q along a motion with 0, for all velocities that are allowed.

    The derivative in time is a difference of order 8; the others are complex steps. So nothing of
    the package but states of the motion is tested, or, if `time` is None, the rates at x0.
    """
    n, step = len(x0) // 2, 1e-2
    if time is None:
        x = x0 + step * np.outer(np.arange(-4, 5), field(x0))
    else:
        x = flow(field, x0, time=time + step * np.arange(-4, 5), rtol=1e-12).states
    weights = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840 / step
    momenta = [slopes(lambda v, q=y[:n]: L(q, v), y[n:])[0] for y in x]
    q, v = x[4, :n], x[4, n:]
    balance = weights @ momenta - slopes(lambda q: L(q, v), q)[0]
    balance = balance - (forces(q, v) if forces else 0.0)
    if constraints:
        A, of_q = slopes(lambda v: constraints(q, v), v), slopes(lambda q: constraints(q, v), q)
        A = np.where(A.any(axis=1, keepdims=True), A, of_q)  # rows without v are holonomic
        balance = balance @ null_space(A)
    assert_allclose(balance, 0, atol=atol)


def test_heisenberg_system():
    """y'' = 0 and x' sqrt(1 + y**2) is constant, for z' = y x' (Bloch)."""
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2, "x y z", constraints=lambda q, v: v[2] - q[1] * v[0]
    )
    t = np.linspace(0, 20, 30)
    x, y, *_ = flow(field, [0, 0, 0, 1, 0.5, 0], time=t).states.T
    assert_allclose(y, t / 2, rtol=1e-13)
    assert_allclose(x, 2 * np.arcsinh(t / 2), atol=1e-9)


def test_bead_on_a_turning_hoop():
    """In space, on a sphere and a plane that turns, beside a'' = w**2 sin(a) cos(a) - g sin(a)."""
    w, g = 3.0, 5.0
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - g * q[2],
        "x y z",
        constraints=lambda q, v, t: (q @ q - 1, q[0] * sin(w * t) - q[1] * cos(w * t)),
    )
    a, t = 0.4, np.linspace(0, 10, 30)
    x0 = [sin(a), 0, -cos(a), 0, w * sin(a), 0]
    x = flow(field, x0, time=t).states
    angle = flow(lambda x: (x[1], sin(x[0]) * (w * w * cos(x[0]) - g)), [a, 0], time=t).states
    assert_allclose(x[:, 2], -cos(angle[:, 0]), atol=1e-8)


def test_wilberforce_pendulum():
    """A spring that stretches and turns: beats between both, by the exponential of a matrix."""

    def lagrangian(q, v, coupling):
        z, a = q
        return (v[0] ** 2 + 0.1 * v[1] ** 2 - 4 * z**2 - 0.4 * a**2) / 2 - coupling * z * a / 2

    field = Field.from_lagrangian(lagrangian, "z a", coupling=0.05)
    K = np.array([[4, 0.025], [0.25, 4]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-K, np.zeros((2, 2))]])
    x0 = np.array([1.0, 0, 0, 0])
    t = np.array([3.0, 80.0])
    exact = [expm(A * each) @ x0 for each in t]
    assert_allclose(flow(field, x0, time=t).states, exact, atol=3e-8)


def test_veselova_body():
    """A body that does not turn about a direction g in space: moment across g is kept."""
    inertia = np.array([1.0, 1.7, 2.4])
    field = Field.from_lagrangian(
        lambda q, u: (u * inertia) @ u / 2,
        "g1 g2 g3",
        "O1 O2 O3",
        frame=lambda q, u: cross(q, u),
        algebra="so3",
        constraints=lambda q, u: q @ u,
    )
    g, O = np.array([0.6, 0, 0.8]), np.array([0.8, 0.3, -0.6])
    x = flow(field, [*g, *O], time=np.linspace(0, 50, 20)).states
    M = inertia * x[:, 3:]
    kept = (M * M).sum(axis=1) - (M * x[:, :3]).sum(axis=1) ** 2
    assert_allclose(kept, kept[0], rtol=1e-8)
    assert_allclose(field.energy(x), field.energy(x[0]), rtol=1e-8)
    assert_allclose((x[:, :3] * x[:, 3:]).sum(axis=1), 0, atol=1e-14)


def test_routh_sphere_keeps_two_moments():
    """A ball with its centre of mass off its centre rolls; Jellett's and Routh's integrals."""
    m, R, a, g = 1.3, 0.5, 0.1, 9.81
    inertia = np.array([0.2, 0.2, 0.12])

    def to_contact(q):
        return -R * q - np.array([0, 0, a])

    def lagrangian(q, u):
        O, V = u[:3], u[3:]
        return m * (V @ V) / 2 + (O * inertia) @ O / 2 + m * g * (to_contact(q) @ q)

    field = Field.from_lagrangian(
        lagrangian,
        "g1 g2 g3",
        "O1 O2 O3 V1 V2 V3",
        frame=lambda q, u: cross(q, u[:3]),
        algebra="se3",
        constraints=lambda q, u: u[3:] + cross(u[:3], to_contact(q)),
    )
    q, O = np.array([0.48, 0.6, 0.64]), np.array([0.5, -1.0, 6.0])
    r = to_contact(q)
    x = flow(field, [*q, *O, *-np.cross(O, r)], time=np.linspace(0, 10, 20)).states
    r, O = to_contact(x[:, :3]), x[:, 3:6]
    jellett = (inertia * O * r).sum(axis=1)
    routh = O[:, 2] * np.sqrt(inertia[0] * inertia[2] + m * (inertia * r * r).sum(axis=1))
    assert_allclose(jellett, jellett[0], rtol=1e-8)
    assert_allclose(routh, routh[0], rtol=1e-8)
    assert np.ptp(O[:, 2]) > 0.1
    assert_allclose(field.energy(x), field.energy(x[0]), rtol=1e-8)


def test_roller_racer():
    """Two bodies with wheels, joined by a pivot (Krishnaprasad, Tsakiris)."""
    m, J, J2, a, b = 1.0, 0.3, 0.2, 0.7, 0.4

    def second(q):
        x, y, th, ps = q
        return np.stack([x + a * cos(th) + b * cos(th + ps), y + a * sin(th) + b * sin(th + ps)])

    def rate(q, v):
        """The velocity of the second body's wheels."""
        turn, both = v[2], v[2] + v[3]
        u = v[0] - a * sin(q[2]) * turn - b * sin(q[2] + q[3]) * both
        return u, v[1] + a * cos(q[2]) * turn + b * cos(q[2] + q[3]) * both

    def lagrangian(q, v):
        u = rate(q, v)
        parts = m * (v[0] ** 2 + v[1] ** 2) + J * v[2] ** 2
        return (parts + 0.5 * (u[0] ** 2 + u[1] ** 2) + J2 * (v[2] + v[3]) ** 2) / 2

    def wheels(q, v):
        u, c = rate(q, v), q[2] + q[3]
        return np.stack([v[0] * sin(q[2]) - v[1] * cos(q[2]), u[0] * sin(c) - u[1] * cos(c)])

    field = Field.from_lagrangian(lagrangian, "x y th ps", constraints=wheels)
    x0 = field.mechanics.projected([0, 0, 0.3, 0.5, 1.0, 0.2, 0.3, 0.4])
    motion = flow(field, x0, time=np.linspace(0, 5, 10))
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)
    assert_principle(field, lagrangian, x0, wheels)


def test_skateboard():
    """The board leans by g, and its trucks steer by tan(d) = tan(e) sin(g) (Hubbard)."""
    m, I, Iz, h, w, steer = 1.5, 0.2, 0.4, 0.6, 0.45, 0.7

    def lagrangian(q, v):
        _, _, th, lean = q
        side = h * sin(lean)
        u = v[0] + h * cos(lean) * v[3] * sin(th) + side * cos(th) * v[2]
        s = v[1] - h * cos(lean) * v[3] * cos(th) + side * sin(th) * v[2]
        up = -h * sin(lean) * v[3]
        turning = I * v[3] ** 2 + Iz * v[2] ** 2
        return m * (u**2 + s**2 + up**2) / 2 + turning / 2 - m * 9.81 * h * cos(lean) - 8 * lean**2

    def trucks(q, v):
        _, _, th, lean = q
        along, across = v[0] * cos(th) + v[1] * sin(th), v[1] * cos(th) - v[0] * sin(th)
        return np.stack([across, w * v[2] - along * steer * sin(lean)])

    field = Field.from_lagrangian(lagrangian, "x y th lean", constraints=trucks)
    x0 = field.mechanics.projected([0, 0, 0.2, 0.1, 3.0, 0, 0, 0.2])
    motion = flow(field, x0, time=np.linspace(0, 5, 10))
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)
    assert_principle(field, lagrangian, x0, trucks)


def test_elastic_chain_buckles_at_its_exact_load():
    """20 rods with springs at their joints, clamped below: P = 2 k (1 - cos(pi / 41))."""
    n, k = 20, 3.0

    def rods(q):
        p = np.reshape(q, (n, 2))
        return np.concatenate([p[:1], p[1:] - p[:-1]])

    def lagrangian(q, v, P):
        d = rods(q)
        # a spring k (1 - cos) at each joint; the first joint is clamped upright
        bends = sum(1 - d[i] @ d[i + 1] for i in range(n - 1)) + 1 - d[0][1]
        return v @ v / 2 - k * bends - P * q[-1]

    field = Field.from_lagrangian(
        lagrangian,
        [f"{a}{i}" for i in range(n) for a in "xy"],
        constraints=lambda q, v: (rods(q) ** 2).sum(axis=1) - 1,
        P=1.0,
    )
    x0 = np.zeros(4 * n)
    x0[1 : 2 * n : 2] = np.arange(1, n + 1)
    exact = 2 * k * (1 - cos(np.pi / (2 * n + 1)))
    for part, is_stable in ((0.99, True), (1.01, False)):
        matrix = field.with_parameters(P=part * exact).jacobian(x0)
        squares = np.linalg.eigvals(matrix[2 * n :: 2, : 2 * n : 2]).real  # sideways: x'' of x
        assert (squares.max() < 0) == is_stable


def test_five_bar_linkage():
    """A closed chain: two cranks and a coupler of two bars, under gravity."""
    masses = np.array([1.0, 1.0, 2.0, 2.0, 0.5, 0.5])

    def lagrangian(q, v):
        return (masses * v) @ v / 2 - 9.81 * (masses[1::2] @ q[1::2])

    def bars(q, v):
        B, C, D = q[:2], q[2:4], q[4:]
        E = np.array([1.5, 0.0])
        pairs = (B, 1.0), (C - B, 1.44), (C - D, 1.21), (D - E, 0.81)
        return np.stack([p @ p - length for p, length in pairs])

    field = Field.from_lagrangian(lagrangian, "bx by cx cy dx dy", constraints=bars)
    x0 = field.mechanics.projected([-0.2, 1, 0.7, 1.7, 1.4, 0.9, 0, 0, 0.3, 0, 0, 0.1])
    motion = flow(field, x0, time=np.linspace(0, 0.5, 10))
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)
    assert_allclose(motion.residuals(), 0, atol=1e-13)
    assert_principle(field, lagrangian, x0, bars, time=0.3, atol=1e-5)


def test_two_wheeled_robot():
    """Torques on wheels beside the axle: linear speed and turn grow linearly in time."""
    m, I, J, R, b, left, right = 3.0, 0.4, 0.01, 0.1, 0.2, 0.03, 0.05

    def rolling(q, v):
        th = q[2]
        along = v[0] * cos(th) + v[1] * sin(th)
        side = v[1] * cos(th) - v[0] * sin(th)
        return side, along - b * v[2] - R * v[3], along + b * v[2] - R * v[4]

    field = Field.from_lagrangian(
        lambda q, v: (m * (v[0] ** 2 + v[1] ** 2) + I * v[2] ** 2 + J * (v[3:] @ v[3:])) / 2,
        "x y th l r",
        constraints=rolling,
        forces=lambda q, v: (0, 0, 0, left, right),
    )
    t = np.linspace(0, 10, 20)
    x = flow(field, np.zeros(10), time=t).states
    speed = x[:, 5] * cos(x[:, 2]) + x[:, 6] * sin(x[:, 2])
    assert_allclose(speed, (left + right) / R / (m + 2 * J / R**2) * t, atol=1e-9)
    turn = b * (right - left) / R / (I + 2 * J * b * b / R**2)
    assert_allclose(x[:, 2], turn * t**2 / 2, atol=1e-9)


@pytest.mark.parametrize("inertia", [[0.4, 0.4, 0.4], [0.3, 0.4, 0.5]])
def test_ball_on_a_turntable(inertia):
    """A ball of equal moments moves in circles, at 2/7 of the table's speed."""
    W, inertia = 3.0, np.array(inertia)

    def turning(q, v):
        """The angular velocity in space, for R = Rz(a) Ry(b) Rx(c)."""
        a, b, _ = q[2:]
        da, db, dc = v[2:]
        across = dc * cos(b)
        return np.stack(
            [across * cos(a) - db * sin(a), across * sin(a) + db * cos(a), da - dc * sin(b)]
        )

    def lagrangian(q, v):
        a, b, c = q[2:]
        O = (about_z(a) @ about_y(b) @ about_x(c)).T @ turning(q, v)
        return (v[0] ** 2 + v[1] ** 2) / 2 + (O * inertia) @ O / 2

    def rolling(q, v):
        w = turning(q, v)
        return np.stack([v[0] - w[1] + W * q[1], v[1] + w[0] - W * q[0]])

    field = Field.from_lagrangian(lagrangian, "x y a b c", constraints=rolling)
    x0 = field.mechanics.projected([0.5, 0, 0.1, 0.2, 0.3, 0, 1, 0.3, 0.1, 0.2])
    assert_principle(field, lagrangian, x0, rolling)
    if inertia[0] == inertia[2]:
        T = 2 * np.pi / (2 / 7 * W)
        x = flow(field, x0, time=[T / 2, T]).states
        assert_allclose(x[1, :2], x0[:2], atol=1e-8)
        assert abs(x[0, :2] - x0[:2]).max() > 0.1


BENCHMARK = {
    "rear": (0.3, 2.0, (0.0603, 0.12)),
    "front": (0.35, 3.0, (0.1405, 0.28)),
    "body": (85.0, (0.3, -0.9), (9.2, 11.0, 2.8, 2.4)),
    "fork": (4.0, (0.9, -0.7), (0.05892, 0.06, 0.00708, -0.00756)),
}
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
C = np.array([[0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0, 76.59734589573222], [0, 2.65431523794604]])


def bicycle():
    """The bicycle of Whipple, with the numbers of Meijaard, Papadopoulos, Ruina and Schwab (2007).

    z points down. q = x, y of the point below the rear wheel, heading, lean, pitch, steer, and the
    turns of the wheels. Pitch keeps the front wheel on the ground.
    """
    w, trail, tilt, g = 1.02, 0.08, np.pi / 10, 9.81
    rear, front = BENCHMARK["rear"], BENCHMARK["front"]
    # In the frame of the rear body, from the centre of the rear wheel; the steer axis meets the
    # ground a trail ahead of the front contact.
    centre = np.array([0, 0, -rear[0]])
    on_axis = np.array([w + trail, 0, 0]) - centre
    hub = np.array([w, 0, -front[0]]) - centre
    axis = about_y(tilt)  # the frame of the fork: its z is the steer axis

    def poses(q):
        x, y, yaw, lean, pitch, steer = q[:6]
        leaned = about_z(yaw) @ about_x(lean)
        body = leaned @ about_y(pitch)
        fork = body @ axis @ about_z(steer) @ axis.T
        start = np.stack([x, y, 0 * x]) + leaned @ centre
        return start, body, fork

    def at(q, which, point):
        start, body, fork = poses(q)
        if which == "body":
            return start + body @ point
        return start + body @ on_axis + fork @ (point - on_axis)

    def rates(pose, q, v):
        """Return the angular velocity in the axes of a frame R: R^T R' is antisymmetric."""
        S = pose(q).T @ velocity(pose, q, v)
        return np.stack([S[2, 1], S[0, 2], S[1, 0]])

    def lagrangian(q, v):
        total = 0.0
        for name in "body", "fork":
            mass, (x, z), (A, B, D, E) = BENCHMARK[name]
            point = np.array([x, 0, z]) - centre
            u = velocity(lambda q, n=name, p=point: at(q, n, p), q, v)
            O = rates(lambda q, n=name: poses(q)[1 + (n == "fork")], q, v)
            turning = A * O[0] ** 2 + B * O[1] ** 2 + D * O[2] ** 2 + 2 * E * O[0] * O[2]
            total = total + (mass * (u @ u) + turning) / 2 + mass * g * at(q, name, point)[2]
        for k, (_, mass, (across, along)), name, point in (
            (0, rear, "body", 0 * hub),
            (1, front, "fork", hub),
        ):
            u = velocity(lambda q, n=name, p=point: at(q, n, p), q, v)
            O = rates(lambda q, k=k: poses(q)[1 + k], q, v)
            turning = across * (O[0] ** 2 + O[2] ** 2) + along * (O[1] + v[6 + k]) ** 2
            total = total + (mass * (u @ u) + turning) / 2 + mass * g * at(q, name, point)[2]
        return total

    def wheel(q, v, k):
        """Return the contact point's velocity, and the height of the wheel's lowest point."""
        name, (r, *_), point = (("body", rear, 0 * hub), ("fork", front, hub))[k]
        R = poses(q)[1 + k]
        across = R @ np.array([0, 1.0, 0])
        down = np.array([0, 0, 1.0]) - across[2] * across
        down = r * down / np.sqrt(1 - across[2] ** 2)
        O = R @ rates(lambda q: poses(q)[1 + k], q, v) + across * v[6 + k]
        hub_rate = velocity(lambda q: at(q, name, point), q, v)
        return hub_rate + cross(O, down), at(q, name, point)[2] + down[2]

    def rolling(q, v):
        first, second = wheel(q, v, 0), wheel(q, v, 1)
        return second[1], *first[0][:2], *second[0][:2]

    return Field.from_lagrangian(
        lagrangian, "x y yaw lean pitch steer rear front", constraints=rolling
    )


def linear_equations(field, speed):
    """Return rows lean'' and steer'' by lean, steer and their rates, along the constraints."""
    x0 = np.zeros(16)
    x0[[8, 14, 15]] = speed, -speed / 0.3, -speed / 0.35
    assert_allclose(field.mechanics.residuals(x0), 0, atol=1e-13)
    along = np.zeros((16, 4))
    along[[3, 5, 11, 13], range(4)] = 1.0
    # yaw' that keeps the front wheel from skidding: wheelbase 1.02, trail 0.08, tilt pi / 10
    along[10, [1, 3]] = np.cos(np.pi / 10) / 1.02 * np.array([speed, 0.08])
    after, before = (field.mechanics.residuals(x0 + h * along.T) for h in (1e-5, -1e-5))
    assert_allclose(after - before, 0, atol=1e-13)
    return field.jacobian(x0)[[11, 13]] @ along


@pytest.mark.slow
def test_bicycle_has_the_published_linear_equations():
    field = bicycle()
    for speed in (0.0, 5.0):
        exact = -np.linalg.solve(M, np.hstack([9.81 * K0 + speed**2 * K2, speed * C]))
        assert_allclose(linear_equations(field, speed), exact, rtol=1e-8, atol=1e-8)
    for speed, is_stable in ((4.29, False), (4.30, True), (6.02, True), (6.03, False)):
        rows = np.vstack([np.eye(4)[2:], linear_equations(field, speed)])
        assert (np.linalg.eigvals(rows).real.max() < 0) == is_stable
    near = [0, 0, 0, 0.1, 0, 0.05, 0, 0, 5.0, 0, 0, 0, 0, 0.1, -5 / 0.3, -5 / 0.35]
    x0 = field.mechanics.projected(near)
    motion = flow(field, x0, time=[1.0, 2.0])
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)
    assert_allclose(motion.residuals(), 0, atol=1e-12)


# ------------------------------------------------------------------------------ two-mass skate
WHEELBASE, TRAIL, TILT = 1.0, 0.02, np.pi / 36
MASSES = (10.0, (1.2, -0.4)), (1.0, (1.02, -0.2))  # of the body, of the fork: mass, (x, z)


def skate():
    """A bicycle of two points with mass, on blades in the places of wheels; z points down.

    Its matrix of masses is singular: nothing but the constraints determines its rotations.
    """
    axis, blade = about_y(TILT), np.array([WHEELBASE, 0, 0])
    on_axis = np.array([WHEELBASE + TRAIL, 0, 0])

    def body(q):
        return about_z(q[2]) @ about_x(q[3]) @ about_y(q[4])

    def fork(q):
        return body(q) @ axis @ about_z(q[5]) @ axis.T

    def on_fork(q, point):
        return np.stack([q[0], q[1], 0 * q[0]]) + body(q) @ on_axis + fork(q) @ (point - on_axis)

    def lagrangian(q, v):
        (m, (x, z)), (of_fork, (X, Z)) = MASSES
        at = np.array([x, 0, z]), np.array([X, 0, Z])
        first = lambda q: np.stack([q[0], q[1], 0 * q[0]]) + body(q) @ at[0]  # noqa: E731
        second = lambda q: on_fork(q, at[1])  # noqa: E731
        u, w = velocity(first, q, v), velocity(second, q, v)
        heights = m * first(q)[2] + of_fork * second(q)[2]
        return (m * (u @ u) + of_fork * (w @ w)) / 2 + 9.81 * heights

    def blades(q, v):
        across = fork(q) @ np.array([0, 1.0, 0])
        u = velocity(lambda q: on_fork(q, blade), q, v)
        skids = v[0] * sin(q[2]) - v[1] * cos(q[2])
        return on_fork(q, blade)[2], skids, across[0] * u[0] + across[1] * u[1]

    return Field.from_lagrangian(lagrangian, "x y yaw lean pitch steer", constraints=blades)


def linear_equations_of_points():
    """Return M, C, K0, K2 of Meijaard et al. (2007), without wheels and moments of inertia."""
    (m, (x, z)), (of_fork, (X, Z)) = MASSES
    s, c = sin(TILT), cos(TILT)
    u = (X - WHEELBASE - TRAIL) * c - Z * s  # from the steer axis
    mu = TRAIL / WHEELBASE * c
    xx, zz = m * z * z + of_fork * Z * Z, m * x * x + of_fork * X * X
    xz = -m * x * z - of_fork * X * Z
    along, of_lean, of_yaw = of_fork * u * u, -of_fork * u * Z, of_fork * u * X
    S = of_fork * u + mu * (m * x + of_fork * X)
    heights = m * z + of_fork * Z
    M = [[xx, of_lean + mu * xz], [of_lean + mu * xz, along + 2 * mu * of_yaw + mu**2 * zz]]
    yaw = c / WHEELBASE
    C = [[0, xz * yaw - mu * heights], [0, of_yaw * yaw + mu * (S + zz * yaw)]]
    K0 = [[heights, -S], [-S, -S * s]]
    K2 = [[0, -heights * yaw], [0, S * yaw]]
    return map(np.array, (M, C, K0, K2))


def test_two_mass_skate_has_the_published_linear_equations():
    field, (M, C, K0, K2) = skate(), linear_equations_of_points()
    for speed in (0.0, 3.0, 6.0):
        x0, along = np.zeros(12), np.zeros((12, 4))
        x0[6] = speed
        along[[3, 5, 9, 11], range(4)] = 1.0
        along[8, [1, 3]] = cos(TILT) / WHEELBASE * np.array([speed, TRAIL])
        exact = -np.linalg.solve(M, np.hstack([9.81 * K0 + speed**2 * K2, speed * C]))
        assert_allclose(field.jacobian(x0)[[9, 11]] @ along, exact, rtol=1e-8, atol=1e-8)
    x0 = field.mechanics.projected([0, 0, 0, 0.05, 0, 0.02, 6.0, 0, 0, 0, 0, 0])
    motion = flow(field, x0, time=[1.0, 10.0])  # above its critical speed of 4.2 m/s
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-7)
    assert abs(motion["lean"][1]) < 1e-2 * abs(motion["lean"][0])


def test_rattleback_turns_back():
    """The body of Kane and Levinson (1982), beside Newton's and Euler's equations in SciPy."""
    inertia = np.array([[2e-4, -2e-5, 0], [-2e-5, 1.6e-3, 0], [0, 0, 1.7e-3]])
    squares = np.array([0.2, 0.03, 0.02]) ** 2

    def contact(g):
        return np.array([0, 0, 0.01]) - squares * g / np.sqrt((squares * g) @ g)

    def lagrangian(g, u):
        O, V = u[:3], u[3:]
        return V @ V / 2 + O @ (inertia @ O) / 2 + 9.81 * contact(g) @ g

    field = Field.from_lagrangian(
        lagrangian,
        "g1 g2 g3",
        "O1 O2 O3 V1 V2 V3",
        frame=lambda g, u: cross(g, u[:3]),
        algebra="se3",
        constraints=lambda g, u: u[3:] + cross(u[:3], contact(g)),
    )

    def newton(t, x):
        g, O = x[:3], x[3:]
        rate, r = cross(g, O), contact(g)
        r_rate = slopes(contact, g) @ rate
        R = np.array([cross(r, e) for e in np.eye(3)]).T  # R b = r x b
        # force = V' + O x V + 9.81 g with V = -O x r; torque r x force = I O' + O x I O
        known = 9.81 * g - cross(O, r_rate) - cross(O, cross(O, r))
        right = cross(r, known) - cross(O, inertia @ O)
        return [*rate, *np.linalg.solve(inertia - R @ R, right)]

    g, O = np.array([0.01, 0.02, 1.0]) / np.sqrt(1.0005), np.array([0, 0, -5.0])
    x0 = [*g, *O, *-np.cross(O, contact(g))]
    motion = flow(field, x0, time=[1.0, 6.0], rtol=1e-11)
    exact = solve_ivp(newton, (0, 1), x0[:6], "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert_allclose(motion.states[0, :6], exact, atol=1e-7)
    assert motion.states[1, 5] > 5.0  # it turns the other way
    assert_allclose(motion.energy(), field.energy(x0), rtol=1e-8)


# ------------------------------------------------------------------------------ other bodies
def test_body_by_quaternions_is_euler_s():
    """|q| = 1 is a constraint, and the angular velocity is 2 q* q'."""
    moments, start = np.array([1.0, 2.0, 3.0]), np.array([0.3, 0.1, 1.2])

    def omega(q, v):
        a, b, c, d = q
        rows = np.array([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]])
        return 2 * (rows @ v)

    field = Field.from_lagrangian(
        lambda q, v: (moments * omega(q, v)) @ omega(q, v) / 2,
        "a b c d",
        constraints=lambda q, v: q @ q - 1,
    )
    euler = Field(lambda w: (-w[1] * w[2], w[2] * w[0], -w[0] * w[1] / 3), 3)
    t = np.array([1.0, 10.0])
    motion, exact = flow(field, [1, 0, 0, 0, 0, *start / 2], time=t), flow(euler, start, time=t)
    for state, expected in zip(motion.states, exact.states, strict=True):
        assert_allclose(omega(state[:4], state[4:]), expected, atol=1e-9)
    assert_allclose(motion.residuals(), 0, atol=1e-14)


def test_suslov_body_with_rotors():
    """Momenta k that are fixed in the body are terms of L of degree 1."""
    inertia, k = (
        np.array([[4, 0, -0.5], [0, 2, -0.25], [-0.5, -0.25, 3]]),
        np.array([0.3, 0.7, 0.2]),
    )
    field = Field.from_lagrangian(
        lambda g, u: u @ (inertia @ u) / 2 + k @ u,
        "g1 g2 g3",
        "O1 O2 O3",
        frame=lambda g, u: np.cross(g, u),
        algebra="so3",
        constraints=lambda g, u: u[2],
    )

    def newton(t, x):
        turn = np.cross(inertia @ x[3:] + k, x[3:])
        inverse = np.linalg.inv(inertia)
        turn[2] -= (inverse @ turn)[2] / inverse[2, 2]
        return np.concatenate([np.cross(x[:3], x[3:]), inverse @ turn])

    x0 = [0, 0, 1, 1.0, 0.5, 0]
    exact = solve_ivp(newton, (0, 5.0), x0, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    assert_allclose(flow(field, x0, time=5.0).final, exact, atol=1e-9)


def test_ball_in_a_turning_cylinder():
    """It does not fall: its height oscillates at sqrt(2 / 7) times the rate of its centre."""
    a, radius, turn, g = 0.2, 0.8, 0.7, 9.81  # the ball's radius, of the centre's path
    turns = np.zeros((5, 5, 5))
    for i, j, k in ((2, 3, 4), (3, 4, 2), (4, 2, 3)):
        turns[i, j, k], turns[j, i, k] = -1.0, 1.0  # axes are fixed in space

    def lagrangian(q, u):
        moving = radius**2 * u[0] ** 2 + u[1] ** 2 + 0.4 * a * a * (u[2:] @ u[2:])
        return moving / 2 - g * q[1]

    def rolling(q, u):
        along = -sin(q[0]) * u[2] + cos(q[0]) * u[3]
        return radius * u[0] + a * u[4] - (radius + a) * turn, u[1] - a * along

    field = Field.from_lagrangian(
        lagrangian,
        "angle z",
        "rate vz wx wy wz",
        frame=lambda q, u: u[:2],
        algebra=turns,
        constraints=rolling,
    )
    rate, vz, out = 0.9, 0.3, 0.5
    x0 = [0, 0, rate, vz, out, vz / a, ((radius + a) * turn - radius * rate) / a]
    t = np.linspace(0, 12, 13)
    motion = flow(field, x0, time=t)
    w = np.sqrt(2 / 7) * rate
    middle = -(2 / 7 * a * rate * out + 5 / 7 * g) / w**2
    assert_allclose(motion["angle"], rate * t, atol=1e-9)
    exact = middle * (1 - cos(w * t)) + vz / w * sin(w * t)
    assert_allclose(motion["z"], exact, atol=1e-7)


def test_constraint_of_appell():
    """z' = a |(x', y')| is not linear: by Chetaev's rule the speed on the plane grows linearly."""
    field = Field.from_lagrangian(
        lambda q, v: v @ v / 2 - q[2],
        "x y z",
        constraints=lambda q, v: v[2] - 1.5 * np.sqrt(v[0] ** 2 + v[1] ** 2),
    )
    t = np.array([0.5, 1.0])
    motion = flow(field, [0, 0, 0, 0.6, 0.8, 1.5], time=t)
    speed = 1 - 1.5 / 3.25 * t
    assert_allclose(motion["vx"], 0.6 * speed, atol=1e-12)
    assert_allclose(motion["z"], 1.5 * (t - 0.75 / 3.25 * t * t), atol=1e-12)
    assert_allclose(motion.energy(), 1.625, rtol=1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_random_systems(seed):
    """Constraints are eliminated in many ways; d'Alembert's principle holds for all of them."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 6))
    a, R = n - 1, rng.normal(size=(4, n))

    def lagrangian(q, v):
        turning = sum((R[0, i] * v[i] + cos(q[a]) * v[a]) ** 2 for i in range(n))
        turning = turning + sum((v[i] + R[1, i] * sin(q[i]) * v[a]) ** 2 for i in range(a))
        return turning / 2 - sum(R[2, i] * cos(q[i]) for i in range(n)) + 0.3 * q[0] * v[1]

    rows = (
        lambda q, v: v[0] * sin(q[a]) - v[1] * cos(q[a]) + R[3, 0] * v[a],
        lambda q, v: v[0] - R[3, 1] * v[a] * cos(q[a]),
        lambda q, v: q[0] ** 2 + q[1] ** 2 + sin(q[a]) - 1.5,
        lambda q, v: v[0] * cos(q[a]) * cos(q[0]) + v[a] * sin(q[a]) * cos(q[0]) + v[1] * sin(q[0]),
        lambda q, v: 2 * v[1] * cos(q[0]) + 2 * v[a] * sin(q[0]) - 0.3 * q[1],
    )
    chosen = [rows[k] for k in rng.permutation(5)[: rng.integers(1, n - 1)]]

    def constraints(q, v):
        return [row(q, v) for row in chosen]

    def forces(q, v):
        return [-0.1 * v[i] + 0.05 * q[i] * v[i - 1] for i in range(n)]

    names = " ".join(f"q{i}" for i in range(n))
    field = Field.from_lagrangian(lagrangian, names, constraints=constraints, forces=forces)
    x0 = field.mechanics.projected(0.5 * rng.normal(size=2 * n))
    assert_principle(field, lagrangian, x0, constraints, forces, time=None)
    change = field.mechanics.residuals(x0 + 1e-4 * np.outer([1, -1], field(x0)))
    assert_allclose(change[0], change[1], atol=1e-9)  # rates keep the constraints
