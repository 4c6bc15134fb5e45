"""Derivatives of motions by starts and parameters, against power series of 80 digits."""

import functools

import numpy as np
import pytest
from scipy.optimize import least_squares
from series import solution_and_derivatives

import suslov_fast as sf
from suslov_fast import Field, QuadraticField, flow
from suslov_fast.core.lists.variational import variational
from suslov_fast.core.motion import engine, functions


def _of(name):
    """A function of NumPy, and of power series."""
    return lambda a: getattr(a, name)() if hasattr(a, "coeffs") else getattr(np, name)(a)


cos, exp, sin, sqrt = map(_of, ("cos", "exp", "sin", "sqrt"))


def lorenz(x, sigma, rho, beta):
    return sigma * (x[1] - x[0]), x[0] * (rho - x[2]) - x[1], x[0] * x[1] - beta * x[2]


def henon_heiles(x, a):
    return x[2], x[3], -x[0] - 2 * a * x[0] * x[1], -x[1] - a * (x[0] * x[0] - x[1] * x[1])


def predators(x, a, b):
    return x[0] * (a - x[1]), x[1] * (b * x[0] - 1)


def pendulum(x, g, c):
    return x[1], -g * sin(x[0]) - c * x[1]


def brusselator(x, a, b):
    product = x[0] * x[0] * x[1]
    return a - (b + 1) * x[0] + product, b * x[0] - product


def kepler(x, mu):
    r = sqrt(x[0] * x[0] + x[1] * x[1])
    factor = -mu / (r * r * r)
    return x[2], x[3], factor * x[0], factor * x[1]


def duffing(x, delta, force):
    """With a clock."""
    return x[1], x[0] - x[0] * x[0] * x[0] - delta * x[1] + force * cos(x[2]), 1.0


def toggle(x, a, m):
    return a / (1 + exp(m * x[1])) - x[0], a / (1 + x[0] * x[0]) - x[1]


def robertson(x, k1, k3):
    slow, back, fast = k1 * x[0], 1e4 * x[1] * x[2], k3 * x[1] * x[1]
    return back - slow, slow - back - fast, fast


def van_der_pol(x, mu):
    return x[1], mu * (1 - x[0] * x[0]) * x[1] - x[0]


def hires(y, k):
    pair = k * y[5] * y[7]
    return (
        -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
        1.71 * y[0] - 8.75 * y[1],
        -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
        8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
        -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
        -pair + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
        pair - 1.81 * y[6],
        -pair + 1.81 * y[6],
    )


def oregonator(x, s, q):
    return (
        s * (x[1] + x[0] * (1 - q * x[0] - x[1])),
        (x[2] - (1 + x[0]) * x[1]) / s,
        0.161 * (x[0] - x[2]),
    )


# f, start, time, length of a step of the series, parameters.
CASES = {
    "lorenz": (lorenz, [1.0, 1.0, 20.0], 1.5, 0.05, dict(sigma=10.0, rho=28.0, beta=2.5)),
    "henon_heiles": (henon_heiles, [0.1, 0.2, 0.3, -0.1], 8.0, 0.4, dict(a=1.0)),
    "predators": (predators, [1.0, 2.0], 6.0, 0.2, dict(a=1.0, b=0.8)),
    "pendulum": (pendulum, [2.0, 0.0], 5.0, 0.4, dict(g=1.5, c=0.1)),
    "brusselator": (brusselator, [1.0, 2.0], 4.0, 0.1, dict(a=1.0, b=3.0)),
    "kepler": (kepler, [1.0, 0.0, 0.0, 1.2], 4.0, 0.2, dict(mu=1.0)),
    "duffing": (duffing, [0.5, 0.0, 0.0], 5.0, 0.2, dict(delta=0.3, force=0.5)),
    "toggle": (toggle, [0.5, 1.5], 5.0, 0.2, dict(a=4.0, m=1.2)),
}
STIFF = {
    "robertson": (robertson, [1.0, 0.0, 0.0], 0.05, 5e-4, dict(k1=0.04, k3=3e7)),
    "van_der_pol": (van_der_pol, [2.0, -0.6], 0.1, 1e-3, dict(mu=300.0)),
    "hires": (hires, [1, 0, 0, 0, 0, 0, 0, 0.0057], 2.0, 0.05, dict(k=280.0)),
    "oregonator": (oregonator, [1.0, 2.0, 3.0], 0.2, 2e-3, dict(s=77.27, q=8.375e-6)),
}
