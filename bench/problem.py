"""The problem that every benchmark solves, and its solution in long doubles.

Long doubles have 64 bits of mantissa on x86. The body is that of the paper's first picture, the
states are random.
"""

import functools

import formulas
import numpy as np
from formulas import EPS, Formulas

from suslov_fast import QuadraticField, Suslov3D, SuslovND

BODY = Suslov3D(*formulas.BODY)
PRECISE = Formulas(np.longdouble)
# Number of trajectories that are compared with the reference, and number of their steps.
CHECKED, STEPS = 64, 1000
CHECKED_ND, STEPS_ND = 8, 5


# Quadratic fields by their dimension: the Lorenz system, and a Volterra chain.
EPS_FIELD = 1 / 64
FIELDS = {
    3: lambda x: (10 * (x[1] - x[0]), 28 * x[0] - x[1] - x[0] * x[2], x[0] * x[1] - 8 / 3 * x[2]),
    12: lambda x: [x[i] * (x[(i + 1) % 12] - x[i - 1]) for i in range(12)],
}


def field_and_states(components, batch):
    """A quadratic field, and states of the order of 1."""
    states = np.random.default_rng(3).uniform(0.5, 1, (batch, components))
    return QuadraticField.from_function(FIELDS[components], components), states


def starts(batch):
    """Random states with |Omega1|, |Omega2| <= 2; larger batches extend smaller ones."""
    return np.random.default_rng(0).uniform(-2, 2, (batch, 2))


def random_states(count):
    """Random states away from singularities of the quantities."""
    return np.random.default_rng(2).uniform(0.5, 2, (count, 2))


def problem_nd(components, batch, integrable=False):
    """A body in components + 1 dimensions, and states of the order of 1."""
    rng = np.random.default_rng(components)
    scale = 1.0 / np.sqrt(components)
    J, I = rng.uniform(1, 4, components), rng.normal(size=components) * scale
    body = SuslovND(np.full(components, 2.0) if integrable else J, I)
    return body, rng.normal(size=(batch, components)) * scale


def aligned(shape, offset=0):
    """Return a touched C-contiguous array of zeros, at a multiple of 64 bytes plus some doubles."""
    size = int(np.prod(shape))
    room = np.empty(size + 16)
    room.fill(0.0)
    start = -room.ctypes.data % 64 // 8 + offset
    return room[start : start + size].reshape(shape)


def relative_error(computed, reference):
    """The largest |computed - reference| / |reference|, of vectors on the last axis."""
    difference = np.sqrt(((computed - reference) ** 2).sum(-1))
    return float((difference / np.sqrt((reference**2).sum(-1))).max())


@functools.cache
def orbit(batch, steps):
    """States 0 to `steps` of the first trajectories, (steps + 1, batch, 2), by iteration."""
    states = [PRECISE.enter(*starts(batch).T.astype(np.longdouble))]
    for _ in range(steps):
        states.append(formulas.advance(*states[-1]))
    return np.stack([np.stack(PRECISE.leave(*each), axis=-1) for each in states])


@functools.cache
def motion(batch, time):
    """Continuous motion of the first trajectories: x' = xy/a, y' = -x^2."""
    a = PRECISE.a
    x, y = PRECISE.to_xy(*starts(batch).T.astype(np.longdouble))
    R = np.sqrt(a * x * x + y * y)
    angle = R * np.longdouble(time) / a - np.arctanh(y / R)
    x, y = np.sign(x) * R / np.sqrt(a) / np.cosh(angle), -R * np.tanh(angle)
    return np.stack(PRECISE.from_xy(x, y), axis=-1)


@functools.cache
def orbit_nd(components):
    """State STEPS_ND of CHECKED_ND trajectories in n dimensions, by elimination; eps is EPS / 2."""
    body, omega = problem_nd(components, CHECKED_ND)
    J, I, eps = (np.asarray(each, np.longdouble) for each in (body.J, body.I, EPS / 2))
    omega = omega.astype(np.longdouble)
    for _ in range(STEPS_ND):
        A = formulas.matrix_nd(J, I, eps, omega)
        for k in range(components):  # without pivoting: the steps are short
            factor = A[:, :, k] / A[:, k, k, None]
            factor[:, k] = 0
            omega = omega - factor * omega[:, k, None]
            A = A - factor[:, :, None] * A[:, k, None, :]
        omega = omega / np.einsum("bii->bi", A)
    return omega
