"""The Kahan map of a body or gyrostat in three dimensions, with one division a step.

With w = (Omega1, Omega2), let

    z = sqrt(I1) w1 + i sqrt(I2) w2,    g = I13 / sqrt(I1) + i I23 / sqrt(I2),
    e = eps / (2 sqrt(I1 I2)),          ell = I13 w1 + I23 w2 + k = Re(conj(g) z) + k,
    X = e ell,    Y = -e Im(conj(g) z),    K = e k.

Kahan's equations, (4) of the paper, are z_next - z = i e (ell z_next + ell_next z). Their solution,
(5), is with D = 1 - Y - K X + 2 X**2

    z_next = z (D - 2 X**2 + 2 i X) / D,    X_next = X (1 + Y + K X) / D.

Zeros of D are poles. States with ell = 0 are fixed. R**2 = |z|**2 / (1 + X**2) is conserved, and so
is T = e R |g|, the criticality. Two forms of a state are iterated:

plain     (X, Y), for k = 0 and T < 1 (that is |Y| < 1), where there is no pole. Equations (8),
          X_next = X (1 + Y) / (1 - Y + 2 X**2), Y_next = Y - 2 X X_next, have no parameters
general   (X, u, v) with z = sqrt(I1) (u + i v), for all others. X computed from u and v loses
          digits next to a steady state; u and v computed from X and Y lose them for large K
"""

from typing import NamedTuple

import numpy as np

from ..numba.decorators import formula, function
from ..numba.intrinsics import select
from ..numba.status_codes import NONFINITE, OK, SINGULAR

ZERO_TO_ROUNDING = 2.0**-50  # the denominator D counts as 0 below this part of its terms
NEGLIGIBLE = 1e-150  # a decaying X / Y below this becomes 0, because subnormal numbers are slow
LEAST, LARGEST = 2.0**-300, 2.0**300  # squares of numbers between them are in range
RANGE = 1e8  # moduli of X, Y and K up to which their differences keep enough digits


class Frame(NamedTuple):
    """Constants of a body and eps that convert states (w1, w2) to the variables X and Y, and back.

    With u = w1 and v = w2 / `back`, X = a1 u + a2 v + K and Y = a2 u - a1 v. Without a rotor
    u = m1 X + m2 Y and v = m2 X - m1 Y. The coefficients are fields of the tuple.
    """

    e: float  # eps / (2 sqrt(I1 I2))
    K: float
    a1: float
    a2: float
    back: float
    m1: float
    m2: float


@formula
def frame_of(I1, I2, I13, I23, k, eps):
    """Return the `Frame` of a body and eps."""
    root_a = np.sqrt(I1 * I2)
    back = root_a / I2
    e = 0.5 * eps / root_a
    a1 = e * I13
    a2 = e * (I23 * back)
    per_g = 1.0 / (e * (I13 * (I13 / I1) + I23 * (I23 / I2)))  # not finite if e g = 0
    m1 = (I13 / I1) * per_g
    m2 = (I23 / root_a) * per_g
    return Frame(e, e * k, a1, a2, back, m1, m2)


@formula
def XY_in_frame(frame, I13, I23, k, w1, w2):
    """Return X = e (I13 w1 + I23 w2 + k) and Y of a state (w1, w2), by the `Frame` of the body."""
    return frame.e * ((I13 * w1 + I23 * w2) + k), frame.a2 * w1 - frame.a1 * (w2 / frame.back)


@formula
def is_supercritical(frame, X, Y):
    """Return True if |T| >= 1; T**2 = ((X - K)**2 + Y**2) / (1 + X**2), with the K of `frame`."""
    return Y * Y >= 1.0 + frame.K * (2.0 * X - frame.K)


@formula
def loses_digits(frame, X, Y):
    """Return True if X, Y or K of a moving gyrostat is so large that the next step loses digits."""
    is_large = (abs(X) > RANGE) | (abs(Y) > RANGE) | (abs(frame.K) > RANGE)
    return is_large & (frame.K != 0.0) & (X != 0.0)


@formula
def plain_step(X, Y):
    """Return X and Y of the next state, if there is no rotor and |Y| < 1; a tiny X becomes 0."""
    X, Y = decaying_step(X, Y)
    return select(abs(X) < -NEGLIGIBLE * Y, 0.0, X), Y


@formula
def decaying_step(X, Y):
    """Return X and Y of the next state by equations (8) of the paper; X may become subnormal."""
    square = X * (2.0 * X)
    ratio = (1.0 + Y) / ((1.0 - Y) + square)
    return X * ratio, Y - square * ratio


@formula
def leave_plain(frame, X, Y):
    """Return the state (w1, w2) with these X and Y, by the `Frame` of a body without a rotor."""
    return frame.m1 * X + frame.m2 * Y, (frame.m2 * X - frame.m1 * Y) * frame.back


@formula
def turn(X, Y, K):
    """Return numbers `along`, `across` and `ratio`, and 1.0 if the state is a pole, else 0.0.

    The next state is z_next = along z + across i z, with X_next = ratio X; NaN if there is none.
    """
    KX = K * X
    square = X * (2.0 * X)
    linear = (1.0 - Y) - KX
    D = linear + square
    least = ZERO_TO_ROUNDING * ((1.0 + abs(Y)) + square)
    inverse = 1.0 / select(abs(D) > least, D, np.nan)
    part = square * inverse  # if X = 0, 1 - part is 1, where linear (1 / D) may be 1 - ulp / 2
    along = select(abs(part) < 0.5, 1.0 - part, linear * inverse)
    return along, (2.0 * X) * inverse, ((1.0 + Y) + KX) * inverse, select(abs(D) < least, 1.0, 0.0)


@formula
def general_step(frame, X, u, v):
    """Return the next X, u and v of any orbit, and 1.0 if the state is a pole, else 0.0."""
    Y = frame.a2 * u - frame.a1 * v
    along, across, ratio, pole = turn(X, Y, frame.K)
    X = X * ratio
    X = select(abs(X) < -NEGLIGIBLE * Y, 0.0, X)
    return X, along * u - across * v, along * v + across * u, pole


@formula
def length(u, v):
    """Return sqrt(u**2 + v**2), also if the squares are out of range."""
    size = abs(u) + abs(v)
    small = size < LEAST
    large = size > LARGEST
    unit = select(small, LEAST * LEAST, select(large, LARGEST * LARGEST, 1.0))
    inverse = select(small, LARGEST * LARGEST, select(large, LEAST * LEAST, 1.0))
    u, v = u * inverse, v * inverse
    return np.sqrt(u * u + v * v) * unit


@formula
def project_on_level(frame, R, X, u, v):
    """Return X, u and v on the level of the conserved R: (u, v) has the length R sqrt(1 + X**2).

    X is first computed again from u and v if this gives more digits.
    """
    Y = frame.a2 * u - frame.a1 * v
    direct = (frame.a1 * u + frame.a2 * v) + frame.K
    X = select(8.0 * abs(direct) > abs(Y) + abs(frame.K), direct, X)
    factor = R * np.sqrt(1.0 + X * X) / length(u, v)
    factor = select((X != 0.0) & (abs(factor - 1.0) < 1e-6), factor, 1.0)  # a steady state stays
    return X, u * factor, v * factor


@formula
def is_plain(frame, X, Y):
    """Return True if a state takes `plain_step`: no rotor, |Y| < 1, not fixed, X and Y normal."""
    moves = (X != 0.0) & (abs(X) < LARGEST) & (abs(Y) < 1.0) & (abs(X) + abs(Y) > LEAST)
    return moves & (frame.K == 0.0) & (abs(frame.m1) + abs(frame.m2) < np.inf)


@formula
def is_fixed(X, Y):
    """Return True for a fixed state (ell = 0), which a step keeps bitwise, unless it is a pole."""
    return (X == 0.0) & (abs(1.0 - Y) > ZERO_TO_ROUNDING * (1.0 + abs(Y)))


@formula
def one_step(I1, I2, I13, I23, k, eps, w1, w2):
    """Return the next state (w1, w2), bitwise as `steps` computes it; NaN if there is none."""
    frame = frame_of(I1, I2, I13, I23, k, eps)
    X, Y = XY_in_frame(frame, I13, I23, k, w1, w2)
    if is_plain(frame, X, Y):
        next1, next2 = leave_plain(frame, *plain_step(X, Y))
    elif is_fixed(X, Y):
        return w1, w2
    else:
        X = select(loses_digits(frame, X, Y), np.nan, X)
        _, next1, v, _ = general_step(frame, X, w1, w2 / frame.back)
        next2 = v * frame.back
    exists = abs(next1) + abs(next2) < np.inf
    return select(exists, next1, np.nan), select(exists, next2, np.nan)


class BodySystem(NamedTuple):
    """A body and a step size, for compiled loops of users; k = 0 without a rotor."""

    I1: float
    I2: float
    I13: float
    I23: float
    k: float
    eps: float
    dimension: int = 2


@function
def no_memory(system):
    """Return an empty array: steps in three dimensions need no memory."""
    return np.empty(0)


@function
def step_of_one(system, x, out, memory):
    """Write the state after x of a `BodySystem` to `out`; return its status."""
    s = system
    w1, w2 = one_step(s.I1, s.I2, s.I13, s.I23, s.k, s.eps, x[0], x[1])
    status = OK
    if np.isnan(w1):
        status = SINGULAR if abs(x[0]) + abs(x[1]) < np.inf else NONFINITE
    out[0], out[1] = w1, w2
    return status


# Functions that `compiled` calls for a `BodySystem`.
BodySystem.memory, BodySystem.one_step = no_memory, step_of_one
