"""The problem that every benchmark solves, and its solution in more digits than float64 has.

The body is that of the paper's first picture, the states are random. References are computed in
long doubles (64 bits of mantissa on x86), from formulas that share nothing with the package.
"""

import functools

import numpy as np

from suslov_fast import Suslov3D, SuslovND

BODY = Suslov3D(4, 1, -0.5, -0.3)
EPS = 0.2
# So many trajectories are compared with the reference, after so many steps.
CHECKED, STEPS = 64, 1000
CHECKED_ND, STEPS_ND = 8, 5


def starts(batch):
    """Angular velocities in the square |Omega1|, |Omega2| <= 2; larger batches begin the same."""
    return np.random.default_rng(0).uniform(-2, 2, (batch, 2))


def problem_nd(components, batch):
    """A body in components + 1 dimensions, and states of the order of 1."""
    rng = np.random.default_rng(components)
    scale = 1.0 / np.sqrt(components)
    body = SuslovND(rng.uniform(1, 4, components), rng.normal(size=components) * scale)
    return body, rng.normal(size=(batch, components)) * scale


def isotropic(components, batch):
    """A body in components + 1 dimensions that has a closed form, and states of the order of 1."""
    body, omega0 = problem_nd(components, batch)
    return SuslovND(np.full(components, 2.0), body.I), omega0


def relative_error(computed, reference):
    """The largest |computed - reference| / |reference|, of vectors on the last axis."""
    difference = np.sqrt(((computed - reference) ** 2).sum(-1))
    return float((difference / np.sqrt((reference**2).sum(-1))).max())


def _precise():
    """I1, I2, I13, I23, eps and a = I1 I2, D = I13^2 I2 + I23^2 I1 as long doubles."""
    I1, I2, I13, I23, eps = map(np.longdouble, (*BODY.parameters, EPS))
    return I1, I2, I13, I23, eps, I1 * I2, I13**2 * I2 + I23**2 * I1


def _from_xy(x, y):
    I1, I2, I13, I23, _, _, D = _precise()
    return np.stack([(I13 * I2 * x + I23 * y) / D, (I23 * I1 * x - I13 * y) / D], axis=-1)


def _xy(omega0):
    I1, I2, I13, I23, _, _, _ = _precise()
    w1, w2 = omega0.T.astype(np.longdouble)
    return I13 * w1 + I23 * w2, I23 * I1 * w1 - I13 * I2 * w2


@functools.cache
def orbit(batch, steps):
    """All states 0 ... steps of the first trajectories, (steps + 1, batch, 2), by iteration."""
    _, _, _, _, eps, a, _ = _precise()
    x, y = _xy(starts(batch))
    X, Y = [eps * x / np.sqrt(2 * a)], [eps * y / (2 * a)]
    for _ in range(steps):
        X.append(X[-1] * (1 + Y[-1]) / (1 - Y[-1] + X[-1] ** 2))
        Y.append(Y[-1] - X[-2] * X[-1])
    return _from_xy(np.stack(X) * np.sqrt(2 * a) / eps, np.stack(Y) * 2 * a / eps)


@functools.cache
def motion(batch, t):
    """The continuous motion (s1) of the first trajectories at time t: x' = xy/a, y' = -x^2."""
    *_, a, _ = _precise()
    x, y = _xy(starts(batch))
    R = np.sqrt(a * x * x + y * y)
    angle = R * np.longdouble(t) / a - np.arctanh(y / R)
    return _from_xy(np.sign(x) * R / np.sqrt(a) / np.cosh(angle), -R * np.tanh(angle))


@functools.cache
def orbit_nd(components):
    """State STEPS_ND of CHECKED_ND trajectories in n dimensions, by elimination; eps is EPS / 2."""
    body, omega = problem_nd(components, CHECKED_ND)
    J, I, eps = (np.asarray(each, np.longdouble) for each in (body.J, body.I, EPS / 2))
    omega = omega.astype(np.longdouble)
    for _ in range(STEPS_ND):
        A = matrix_nd(J, I, eps, omega)
        for k in range(components):  # without pivoting: the steps are short
            factor = A[:, :, k] / A[:, k, k, None]
            factor[:, k] = 0
            omega = omega - factor * omega[:, k, None]
            A = A - factor[:, :, None] * A[:, k, None, :]
        omega = omega / np.einsum("bii->bi", A)
    return omega


def matrix_nd(J, I, eps, omega):
    """A(Omega) of equation (dsn), one matrix for each state."""
    p = (omega * I).sum(-1)[:, None, None]
    h = (eps / (2 * J))[:, None]
    rank2 = 2 * I[:, None] * omega[:, None, :] - I * omega[:, :, None]
    return h * rank2 + np.eye(len(J)) * (1 - h * p)
