"""Four mechanical systems, typed as Lagrangians with constraints.

A rattleback turns back by itself. A blade on an inclined plane does not slide down. A rolling disk
draws the path of its contact. A chain of 30 rods falls, in Cartesian coordinates.
"""

import matplotlib.pyplot as plt
import numpy as np

from suslov_fast import Field, flow

cos, sin = np.cos, np.sin
figure, axes = plt.subplots(2, 2, figsize=(6, 6), layout="constrained")


def cross(a, b):
    return np.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


# The rattleback of Kane and Levinson (1982). g is the vertical in axes of the body.
inertia = np.array([[2e-4, -2e-5, 0], [-2e-5, 1.6e-3, 0], [0, 0, 1.7e-3]])
squares = np.array([0.2, 0.03, 0.02]) ** 2


def contact(g):
    """The point of contact from the centre of mass, which is 0.01 below the ellipsoid's centre."""
    return np.array([0, 0, 0.01]) - squares * g / np.sqrt((squares * g) @ g)


def of_rattleback(g, u):
    turn, v = u[:3], u[3:]
    return v @ v / 2 + turn @ (inertia @ turn) / 2 + 9.81 * contact(g) @ g


rattleback = Field.from_lagrangian(
    of_rattleback,
    "g1 g2 g3",
    "O1 O2 O3 V1 V2 V3",
    frame=lambda g, u: cross(g, u[:3]),
    algebra="se3",
    constraints=lambda g, u: u[3:] + cross(u[:3], contact(g)),
)
g = np.array([0.01, 0.02, 1.0]) / np.sqrt(1.0005)
turn = np.array([0, 0, -5.0])
motion = flow(rattleback, [*g, *turn, *-cross(turn, contact(g))], time=np.linspace(0, 12, 800))
axes[0, 0].plot(motion.time, motion["O3"], color="steelblue")
axes[0, 0].axhline(0, color="grey", linewidth=0.5)
axes[0, 0].set(title="rattleback", xlabel="time", ylabel="spin")

# A blade, such as a skate, on an inclined plane; x points down.
blade = Field.from_lagrangian(
    lambda q, v: v @ v / 2 + q[0],
    "x y angle",
    constraints=lambda q, v: v[0] * sin(q[2]) - v[1] * cos(q[2]),
)
for k, spin in enumerate((1.0, 1.5, 2.5)):
    path = flow(blade, [0, 0, 0, 0, 0, spin], time=np.linspace(0, 12, 500))
    axes[0, 1].plot(path["y"], path["x"], color=f"C{k}", label=f"{spin:g}")
axes[0, 1].invert_yaxis()
axes[0, 1].set(title="a blade on an inclined plane", xlabel="$y$", ylabel="$x$, downhill")
axes[0, 1].legend(title="spin at the start", loc="lower right", fontsize="small")


# A thin disk of radius 1 in Euler angles: heading a, tilt b, spin c.
def turning(q, v):
    (_, b, c), (da, db, dc) = q[2:], v[2:]
    u = da * sin(b)
    return u * sin(c) + db * cos(c), u * cos(c) - db * sin(c), da * cos(b) + dc


def of_disk(q, v):
    w = turning(q, v)
    rise = cos(q[3]) * v[3]
    spin = (w[0] ** 2 + w[1] ** 2) / 8 + w[2] ** 2 / 4
    return (v[0] ** 2 + v[1] ** 2 + rise**2) / 2 + spin - 9.81 * sin(q[3])


def rolling(q, v):
    _, _, a, b, _ = q
    spin = v[2] * cos(b) + v[4]
    rise = v[3] * sin(b)
    return v[0] + spin * cos(a) - rise * sin(a), v[1] + spin * sin(a) + rise * cos(a)


disk = Field.from_lagrangian(of_disk, "x y a b c", constraints=rolling)
start = disk.mechanics.projected([0, 0, 0, 1.2, 0, 0, 0, 1.0, 0, 3.5])
motion = flow(disk, start, time=np.linspace(0, 5.6, 3000))
a, b = motion["a"], motion["b"]
axes[1, 0].plot(motion["x"], motion["y"], color="silver", linewidth=1, label="centre")
axes[1, 0].plot(
    motion["x"] + sin(a) * cos(b), motion["y"] - cos(a) * cos(b), color="crimson", label="contact"
)
axes[1, 0].set(title="a rolling disk, from above", xlabel="$x$", ylabel="$y$")
axes[1, 0].set_aspect("equal")
axes[1, 0].legend(loc="upper right", fontsize="small")

# A chain of 30 masses on rods, in Cartesian coordinates; it starts as a straight line.
n = 30


def lengths(q, v):
    p = np.reshape(q, (n, 2))
    rods = np.concatenate([p[:1], p[1:] - p[:-1]])
    return (rods * rods).sum(axis=1) - 1 / n**2


chain = Field.from_lagrangian(
    lambda q, v: v @ v / 2 - sum(q[1::2]),
    [f"{name}{k}" for k in range(n) for name in "xy"],
    constraints=lengths,
)
start = np.zeros(4 * n)
start[: 2 * n : 2] = np.arange(1, n + 1) / n
start[1 : 2 * n : 2] = start[: 2 * n : 2] * 0.2
start[: 2 * n] /= np.sqrt(1.04)
motion = flow(chain, start, time=np.linspace(0, 1.6, 9), stiff=False)
for k, state in enumerate(motion.states):
    p = np.concatenate([[[0, 0]], state[: 2 * n].reshape(n, 2)])
    axes[1, 1].plot(*p.T, color=plt.cm.viridis(k / 8), linewidth=1.2)
axes[1, 1].set(title="a falling chain of 30 rods", xlabel="$x$", ylabel="$y$")
axes[1, 1].set_aspect("equal")
