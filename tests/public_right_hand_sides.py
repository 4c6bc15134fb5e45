"""Right-hand sides as people type them for SciPy: name, variables, parameters, f, and a state."""

import numpy as np


def hodgkin_huxley(x, current):
    """With rates that are 0/0 at v = -40 and -55."""
    v, m, h, n = x
    a_m, b_m = 0.1 * (v + 40) / (1 - np.exp(-(v + 40) / 10)), 4 * np.exp(-(v + 65) / 18)
    a_h, b_h = 0.07 * np.exp(-(v + 65) / 20), 1 / (1 + np.exp(-(v + 35) / 10))
    a_n, b_n = 0.01 * (v + 55) / (1 - np.exp(-(v + 55) / 10)), 0.125 * np.exp(-(v + 65) / 80)
    ionic = 120 * m**3 * h * (v - 50) + 36 * n**4 * (v + 77) + 0.3 * (v + 54.4)
    return (
        current - ionic,
        a_m * (1 - m) - b_m * m,
        a_h * (1 - h) - b_h * h,
        a_n * (1 - n) - b_n * n,
    )


def thermostat(x, on, off):
    T, heater = x
    wanted = np.where(on > T, 1.0, np.where(off < T, 0.0, heater))
    return 5 * heater - 0.2 * (T - 10), 50 * (wanted - heater)


def kuramoto(theta, K):
    omega = np.linspace(-1, 1, 30)
    return omega + K / 30 * np.sin(theta[None, :] - theta[:, None]).sum(axis=1)


def pleiades(w):
    x, y, vx, vy = w.reshape(4, 7)
    dx, dy = x[None, :] - x[:, None], y[None, :] - y[:, None]
    cubes = (dx**2 + dy**2 + np.eye(7)) ** 1.5  # no body attracts itself
    mass = np.arange(1.0, 8.0)
    return np.concatenate([vx, vy, (mass * dx / cubes).sum(1), (mass * dy / cubes).sum(1)])


def brusselator(x, alpha):
    n = 4
    u, v = x[: n * n].reshape(n, n), x[n * n :].reshape(n, n)

    def laplacian(a):
        around = (np.roll(a, s, axis) for s in (1, -1) for axis in (0, 1))
        return sum(around) - 4 * a

    du = 1 + u**2 * v - 4.4 * u + alpha * laplacian(u)
    dv = 3.4 * u - u**2 * v + alpha * laplacian(v)
    return np.concatenate([du.ravel(), dv.ravel()])


def diode(x, Is):
    v, t = x
    source = 5 * np.heaviside(np.sin(2 * np.pi * t), 0.5)
    return (source - v) / 1e3 - Is * np.expm1(np.clip(v / 0.026, -50, 40)), 1


def diffusion(u, d):
    """With reflecting ends."""
    padded = np.concatenate([u[:1], u, u[-1:]])
    return d * np.diff(padded, 2) + np.where(np.abs(u) > 1, 0, u * (1 - u) * (u - 0.2))


def predator_prey(x, r, K, a, h):
    N, P = x
    response = a * N / (1 + a * h * N)
    dx = np.zeros_like(x)
    dx[0] = r * N * (1 - N / K) - response * P
    dx[1] += 0.5 * response * P - 0.2 * P
    return dx


_rng = np.random.default_rng(1)
PUBLIC = {
    "Hodgkin-Huxley": (hodgkin_huxley, "v m h n", {"current": 10.0}, [-60.0, 0.1, 0.6, 0.3]),
    "thermostat": (thermostat, "T heater", {"on": 18.0, "off": 22.0}, [19.0, 0.3]),
    "Kuramoto": (kuramoto, 30, {"K": 2.0}, _rng.uniform(0, 6, 30)),
    "Pleiades": (pleiades, 28, {}, _rng.normal(size=28) * 3),
    "Brusselator": (brusselator, 32, {"alpha": 0.2}, _rng.uniform(1, 3, 32)),
    "diode": (diode, "v t", {"Is": 1e-12}, [0.4, 0.2]),
    "diffusion": (diffusion, 6, {"d": 0.7}, [0.1, 0.3, 1.5, 0.2, -0.4, 0.9]),
    "predator-prey": (
        predator_prey, "N P", {"r": 1.0, "K": 10.0, "a": 0.9, "h": 0.2}, [4.0, 1.5]
    ),
}  # fmt: skip
