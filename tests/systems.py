"""Equations that tests of several rooms take."""

from fractions import Fraction

import mpmath
import numpy as np

from suslov_fast import Event, Field, compiled, iterate, kahan


def lorenz(x, rho=28, sigma=10, beta=8 / 3):
    return sigma * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - beta * x[2]


def pendulum(x, k=1):
    return x[1], -k * np.sin(x[0])


def van_der_pol(x, mu=1):
    return x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]


def rubbing(x, k):
    """A block on a spring and on a belt with the speed 0.3."""
    return x[1], -x[0] - k * np.sign(x[1] - 0.3)


def henon_heiles(x):
    """A Hamiltonian, of two coordinates and their momenta."""
    return (x[2] ** 2 + x[3] ** 2 + x[0] ** 2 + x[1] ** 2) / 2 + x[0] ** 2 * x[1] - x[1] ** 3 / 3


def rates_of_henon_heiles(s, a=1.0):
    x, y, p, q = s
    return p, q, -x - 2 * a * x * y, -y - a * (x * x - y * y)


def robertson(s, k1=0.04, k3=3e7):
    x, y, z = s
    a, b, c = k1 * x, 1e4 * y * z, k3 * y * y
    return b - a, a - b - c, c


def oregonator(y, s=77.27, q=8.375e-6):
    return (
        s * (y[1] + y[0] * (1 - q * y[0] - y[1])),
        (y[2] - (1 + y[0]) * y[1]) / s,
        0.161 * (y[0] - y[2]),
    )


def kepler(s):
    r = np.sqrt(s[0] ** 2 + s[1] ** 2)
    return s[2], s[3], -s[0] / r**3, -s[1] / r**3


def chain(x):
    """Volterra's, closed."""
    return [x[i] * (x[(i + 1) % len(x)] - x[i - 1]) for i in range(len(x))]


def lorenz_96(x):
    return [x[i - 1] * (x[(i + 1) % len(x)] - x[i - 2]) - x[i] + 8 for i in range(len(x))]


def euler(x):
    return 2 * x[1] * x[2], -3 * x[2] * x[0], x[0] * x[1]


def epidemic(x):
    """Susceptible, infected and recovered, whose sum is conserved."""
    new, healed, again = 3 * x[0] * x[1], x[1], x[2] / 4
    return again - new, new - healed, healed - again


def three_bodies(s, mu):
    """The restricted three-body problem in space: positions, then velocities."""
    x, y, z, u, v, w = s
    a, b = x + mu, x + mu - 1
    r1, r2 = (a * a + y * y + z * z) ** 1.5, (b * b + y * y + z * z) ** 1.5
    return (
        u,
        v,
        w,
        2 * v + x - (1 - mu) * a / r1 - mu * b / r2,
        -2 * u + y - (1 - mu) * y / r1 - mu * y / r2,
        -(1 - mu) * z / r1 - mu * z / r2,
    )


def on_a_table(A, e):
    """Return a ball with g = 1, and the event that it hits a table at the height A sin(t)."""
    ball = Field(lambda s, A: (s[1], -1.0, 1.0), "h v t", A=A)
    return ball, Event(
        lambda s, A: s[0] - A * np.sin(s[2]),
        direction=-1,
        to=lambda s, A: (s[0], -e * s[1] + (1 + e) * A * np.cos(s[2]), s[2]),
    )


def tables(field):
    """Return q, l and c of a field of degree 2: x_i' = q_ijk x_j x_k + l_ij x_j + c_i."""
    (i, j, k), values = field.terms
    D = field.dimension
    whole = np.zeros((*field.shape, D, D + 1, D + 1))
    whole[..., i, j, k] = values
    whole = (whole + whole.swapaxes(-2, -1)) / 2
    return whole[..., :D, :D], 2 * whole[..., :D, D], whole[..., D, D]


def exactly(terms, x):
    """Return f(x) of exact terms: i, j, k and v of each term v x_j x_k of f_i, x_D = 1."""
    y, found = [*x, Fraction(1)], [Fraction(0)] * len(x)
    for i, j, k, v in zip(*terms[0].tolist(), terms[1].tolist(), strict=True):
        found[i] += Fraction(v) * y[j] * y[k]
    return found


def field(f, names="x t", **parameters):
    return Field(f, names, **parameters)


LORENZ = Field(lorenz, 3)
HENON_HEILES = Field.from_hamiltonian(henon_heiles, 4)
# Two populations. By DOP853 those that start from (0.05, 0.05) stay between 5e-4 and 48.
PREY = Field(lambda x: (x[0] * x[1] - 5 * x[0], -x[0] * x[1] + 4 * x[1]), "x y")
FRICTION = Field(lambda s, mu: (s[1], -s[0] - mu * np.sign(s[1])), "x v", mu=0.15)
# A ball that falls on a spring.
SPRING = Field(lambda s: (s[1], -9.81 - np.where(s[0] < 0, 1000 * s[0], 0.0)), "h v")
# A function, its field, a state and a time in which the motion changes much.
FLOWS = {
    "Lorenz": (lorenz, LORENZ, (1.0, 1.0, 20.0), 1),
    "Henon-Heiles": (rates_of_henon_heiles, HENON_HEILES, (0.1, 0.2, 0.3, -0.1), 8),
    "chain": (chain, Field(chain, 5), (1, 0.5, 1.5, 0.8, 1.2), 4),
    "Euler's top": (euler, Field(euler, 3), (1.0, 0.5, -0.7), 4),
    "epidemic": (epidemic, Field(epidemic, 3), (0.9, 0.1, 0.1), 8),
}


def exponents_by_qr(system, x, *eps, steps, **options):
    """Return exponents per unit of time, or per step, by NumPy's QR of the derivative of each."""
    Q, logs = np.eye(len(x)), []
    for state in iterate(system, x, *eps, steps=steps - 1, **options).states:
        slope = kahan.jacobian(system, state, *eps, **options) if eps else system.jacobian(state)
        Q, R = np.linalg.qr(slope @ Q)
        logs.append(np.log(abs(np.diag(R))))
    return np.sort(np.mean(logs, axis=0))[::-1] / abs(*(eps or [1.0]))


def compiled_step(system, x, *eps, **options):
    """Return the status of a step that compiled code takes, and the next state."""
    constants, out = compiled.system(system, *eps, **options), np.zeros(len(x))
    return compiled.step_system(constants, np.array(x), out, compiled.work(constants)), out


def by_taylor(f, x, time, digits=25, **parameters):
    """Return the state at a time of x' = f(x) by mpmath's Taylor series."""
    with mpmath.workdps(digits):
        start = [*map(mpmath.mpf, x)]
        return mpmath.odefun(lambda _, y: [*f(y, **parameters)], 0, start)(time)
