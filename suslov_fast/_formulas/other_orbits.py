"""The closed form of orbits that turn, come close to |k| = A, or have T >= 1, beside those that
rest or pass; for these it has the bits of `closed_form`, which explains the symbols.

Each kind has its own (c, s), in which the quadratic forms do not cancel:

PASSES  (w_n, 1), as in `closed_form`; a large w is stored as (f, 2**-k). Where r < 0 the sign of w
        alternates, and only integers n have states.
NEAR    The same near L = 0, where w cancels: (c_n - L s_n, s_n) = (r**n, (1 - r**n)/(2 L)) for
        (1 + e G)**n = c_n + s_n e G, up to a common factor.
TURNS   K > T. (c_n, s_n) = (cos(n b), sin(n b)/m), m**2 = K**2 - T**2 and b = arctan(m). Both b and
        the phase n b have twice the digits of a float.
"""

import math

import numpy as np

from .._jit import formula, select
from . import twofold
from .closed_form import (
    JUMPING,
    LARGEST_COUNT,
    LARGEST_RATIO,
    LARGEST_TIME,
    LEAST_ROOT,
    PASSES,
    RESTS,
    Forms,
    Levels,
    Steps,
    cancels,
    larger_sum,
    matrix_to_omega,
    power_of_ratio,
)
from .coordinates import ZERO_TO_ROUNDING, shifted
from .elementary import is_integer, larger, scaled, sine_and_cosine, smaller, two_to_the
from .equations import denominator, over_denominator

NEAR, TURNS = 2.0, 3.0
# States larger than R by this factor may be at a pole.
NEAR_POLE = 2.0**20
# 2 / pi, as a sum of two numbers.
TWO_OVER_PI = 0.6366197723675814, -3.935735335036497e-17


@formula
def accurate_levels(start, levels):
    """`levels` with L, or the root of -L**2, to twice the digits."""
    X, Y = (start.X, start.X_lost), (start.Y, start.Y_lost)
    K, discrete = (start.K, start.K_lost), (start.discrete, 0.0)
    # L**2 = (X**2 - K X (2 + K X) + Y**2) / (1 + X**2)
    KX, XX = twofold.product(K, X), twofold.square(X)
    above = twofold.difference(XX, (2.0 * KX[0], 2.0 * KX[1]))
    above = twofold.difference(above, twofold.product(discrete, twofold.square(KX)))
    below = twofold.plus((1.0, 0.0), twofold.product(discrete, XX))
    square, lost = twofold.quotient(twofold.plus(above, twofold.square(Y)), below)
    least = (LEAST_ROOT * levels.T) * (LEAST_ROOT * levels.T)
    known = abs(square) > least
    square, lost = select(known, square, least), select(known, lost, 0.0)
    root, root_lost = twofold.root((abs(square), select(square < 0.0, -lost, lost)))
    # L**2 - Y**2 = (X**2 (1 - Y**2) - K X (2 + K X)) / (1 + X**2), and r.
    XY = twofold.product(X, (start.discrete * start.Y, start.discrete * start.Y_lost))
    gap = twofold.difference(above, twofold.square(XY))[0] / below[0] / (root + abs(start.Y))
    L, L_lost = start.discrete * root, start.discrete * root_lost
    r = ((1.0 - L) - L_lost) / (1.0 + L)
    return Levels(levels.R, levels.T, square, root, root_lost, gap, r)


@formula
def steps(start, levels, given):
    """The `Steps` of an orbit, from those `given` as one that rests or passes."""
    square, moves = levels.square, given.kind == PASSES
    turns = moves & (square < 0.0)
    near = moves & (square > 0.0) & cancels(levels) & (start.discrete * square < 1.0)
    passes = ~(turns | near)
    return Steps(
        kind=select(turns, TURNS, select(near, NEAR, given.kind)),
        r=select(turns, 1.0, given.r),
        log_r=select(turns, 0.0, given.log_r),
        log_lost=select(turns, 0.0, given.log_lost),
        v=select(passes, given.v, 1.0),
        power=select(passes, given.power, 0.0),
        lag=select(passes, given.lag, 0.0),
        root=given.root,
        square=select(turns, square, 0.0),
        turns=0.0,
        turns_lost=0.0,
    )


@formula
def turning_tangent(levels):
    """tan(b / 8) for b = arctan(m), or if m > 1 for b = arctan(1 / m), to twice the digits."""
    m, m_lost = levels.root, levels.root_lost
    inverse, lost = twofold.quotient((1.0, 0.0), (m, m_lost))
    return twofold.eighth_tangent((select(m > 1.0, inverse, m), select(m > 1.0, lost, m_lost)))


@formula
def turning(start, levels, tangent):
    """b of an orbit that turns in quarter turns, as a sum of two numbers."""
    # The angle of the flow is m, and of the map the arctangent.
    m, slow = (levels.root, levels.root_lost), start.discrete == 0.0
    unit = two_to_the(start.time_power)
    angle, lost = twofold.angle_of_eighth(tangent)
    angle, lost = select(slow, m[0] * unit, angle), select(slow, m[1] * unit, lost)
    angle, lost = twofold.product((angle, lost), TWO_OVER_PI)
    above, rest = twofold.difference((1.0, 0.0), (angle, lost))
    large = (m[0] > 1.0) & ~slow
    return select(large, above, angle), select(large, rest, lost)


@formula
def turning_forms(start, levels):
    """The `Forms` of TURNS."""
    X, Y, K, U, V, R = start.X, start.Y, start.K, start.U, start.V, levels.R
    f11, f12, f21, f22 = matrix_to_omega(start, 1.0)
    # T R + K U cancels next to a steady state, unless it is formed from terms that are small there:
    # R**2 - U**2 = V**2 - (R X)**2, and K - T = -L**2 / (K + T).
    TR, RX = levels.T * R, start.discrete * R * X
    first = K * ((V - RX) * (V + RX) / (R + abs(U)))
    second = R * (-levels.square / (K + levels.T))
    small = (U < 0.0) & (abs(first) + second < 0.01 * TR)
    total = select(small, first - second, TR + K * U)
    y_u, y_v = -2.0 * K * V, -2.0 * total
    z_u, z_v = -(K * total + TR * X), -V * levels.square
    return Forms(
        d11=1.0, d12=-2.0 * Y, d22=2.0 * K * X + levels.square,
        x1=f11 * U - f12 * V, y1=f11 * y_u + f12 * y_v, z1=f11 * z_u + f12 * z_v,
        x2=f21 * U - f22 * V, y2=f21 * y_u + f22 * y_v, z2=f21 * z_u + f22 * z_v,
    )  # fmt: skip


@formula
def near_forms(start, levels):
    """The `Forms` of NEAR."""
    X, Y, K, T, L = start.X, start.Y, start.K, levels.T, levels.root
    gap = select(Y < 0.0, L + abs(Y), levels.gap)  # L - Y
    XT = X * T * (1.0 + start.discrete * L)
    total, is_first = larger_sum(start, levels)
    minus = 2.0 * select(is_first, total, levels.r * (XT / total) * XT)  # 2 (S - L Y)
    f11, f12, f21, f22 = matrix_to_omega(start, levels.R / T)
    x_u, y_u = X - K, 2.0 * (L * X - K * gap)
    z_u, z_v = -minus * K, -minus * L
    return Forms(
        d11=1.0, d12=2.0 * gap, d22=minus,
        x1=f11 * x_u + f12 * Y, y1=f11 * y_u - f12 * minus, z1=f11 * z_u + f12 * z_v,
        x2=f21 * x_u + f22 * Y, y2=f21 * y_u - f22 * minus, z2=f21 * z_u + f22 * z_v,
    )  # fmt: skip


@formula
def recompute_from(start, levels, steps):
    """The size from which on states are computed again one by one: they may be at a pole."""
    f11, f12, f21, f22 = matrix_to_omega(start, levels.R)
    size = larger(larger(abs(f11), abs(f12)), larger(abs(f21), abs(f22)))
    may_meet = (steps.kind != RESTS) & (start.fate == JUMPING)
    return select(may_meet, NEAR_POLE * size * (1.0 + levels.T + start.K), np.inf)


@formula
def multiples(n, v, power, steps):
    """(c, s) of an orbit that begins at the ratio v 2**power, after n steps."""
    p, more = power_of_ratio(n, steps)
    even, exists = is_integer(0.5 * abs(n)) | (steps.r >= 0.0), is_integer(abs(n)) | (steps.r > 0.0)
    sign = select(exists, select(even, 1.0, -1.0), np.nan)
    f, power = sign * (v + v * p), power + more
    large = power >= LARGEST_RATIO
    c = select(large, f, scaled(f, smaller(power, LARGEST_RATIO)))
    s = select(large, scaled(1.0, -power), 1.0)
    # Near 1 the distance of r**n from 1 is more precise.
    s = select(steps.kind == NEAR, select(power == 0.0, -p, 1.0 - c) * (0.5 / steps.root), s)
    sine, cosine = sine_and_cosine(n, steps.turns, steps.turns_lost)
    turns = steps.kind == TURNS
    return select(turns, cosine, c), select(turns, sine / steps.root, s)


@formula
def pair(n, steps):
    """(c, s) after n steps; NaN where there is no such state."""
    c, s = multiples(smaller(n, LARGEST_TIME) - steps.lag, steps.v, steps.power, steps)
    # Where r < 0, only integers: n - lag may round a fraction away.
    unknown = (steps.r < 0.0) & (n < np.inf) & (~is_integer(n) | (n > LARGEST_COUNT))
    return select(unknown, np.nan, c), s


@formula
def growth(n, steps):
    """The pair that takes (c, s) n steps further by `combined`."""
    c, s = multiples(n, 1.0, 0.0, steps)
    return c, select((steps.kind == PASSES) | (steps.kind == RESTS), 0.0, s)


@formula
def combined(c, s, next_c, next_s, square):
    """(c, s) after the steps of two pairs: (c c', s) for PASSES, (c c', s + c s') for NEAR, and the
    product of c + s e G and c' + s' e G, with (e G)**2 = square, for TURNS.
    """
    of_s = select(square != 0.0, next_c, 1.0)
    return c * next_c + square * (s * next_s), s * of_s + c * next_s


@formula
def loses_state_1(start):
    """Test that `Forms` lose digits of state 1, (c, s) = (1, 1): large Y and K X cancel."""
    return start.discrete * abs(start.Y) > 4.0 * (1.0 + abs(start.Y - start.K * start.X))


@formula
def state_1(start):
    """State 1 by one step of the map, in the units of `matrix_to_omega`; NaN at a pole.

    U + i V is multiplied by (1 + i X_next) / (1 - i X), of which the imaginary part is 2 X / D.
    """
    X, U, V, K = start.X, start.U, start.V, start.K
    inverse = over_denominator(1.0, *denominator(X, *shifted(start.Y, start.Y_lost), K))
    X_next = X * ((1.0 + start.Y) + K * X) * inverse
    along, across = (1.0 - X * X_next) / (1.0 + X * X), 2.0 * X * inverse
    f11, f12, f21, f22 = matrix_to_omega(start, 1.0)
    U, V = along * U - across * V, along * V + across * U
    return f11 * U - f12 * V, f21 * U - f22 * V


@formula
def is_pole(c, s, forms):
    """Test that the denominator of `omega_of` is 0 to rounding, or NaN."""
    first, second, third = forms.d11 * c * c, forms.d12 * c * s, forms.d22 * s * s
    size = (abs(first) + abs(third)) + abs(second)
    return ~(abs((first + third) + second) > ZERO_TO_ROUNDING * size)


@formula
def step_to_pole(forms, steps, second):
    """The real number of steps to the first or second zero of the denominator, for |r|**n.

    np.log suffices: the caller tries the steps beside it.
    """
    d11, half, d22 = forms.d11, 0.5 * forms.d12, forms.d22
    root = np.sqrt(larger(half * half - d11 * d22, 0.0))  # both zeros meet at T = 1
    total = -(half + select(half < 0.0, -root, root))
    ratio = d22 / total if second else total / d11  # of c and s
    if steps.kind == NEAR:
        return -np.log1p(2.0 * steps.root / ratio) / steps.log_r
    log_w = np.log(abs(ratio / steps.v)) - steps.power * math.log(2.0)
    return steps.lag + log_w / steps.log_r
