"""States of an orbit of the closed form: (c, s) after n steps, and omega from (c, s).

`closed_form` explains the symbols, and computes the constants of orbits.
"""

import math

import numpy as np

from .._jit import formula, select, two_product
from .closed_form import NO_POWER, PASSES, PASSES_NEAR, TURNS, frame
from .coordinates import ZERO_TO_ROUNDING, shifted
from .elementary import (
    TO_INTEGER,
    exponential,
    is_integer,
    larger,
    of_quarter_turns,
    scaled,
    smaller,
)
from .equations import denominator

# Larger numbers of steps and longer times are replaced by this: `two_product` does not overflow.
LONGEST = 2.0**990
# Phases of this many quarter turns or more are not known.
LONGEST_PHASE = 2.0**52
# Numbers of steps above this are not known to be even or odd.
EXACT = 2.0**53
# A ratio w = f 2**k above 2**this is stored as (c, s) = (f, 2**-k).
LARGE = 200.0
# Squares of smaller w and s are negligible; if subnormal, they would be slow.
NO_SQUARE = 1e-100


@formula
def power_of_ratio(n, steps):
    """p, an integer `power` and a sign, for which r**n = sign (1 + p) 2**power.

    The sign is NaN if no such number exists: between two states of L >= 1.
    """
    x, lost = two_product(n, steps.log_r)
    lost = lost + n * steps.log_lost
    endless = x < NO_POWER
    p, power = exponential(select(endless, NO_POWER, x), select(endless, 0.0, lost))
    sign = select(is_integer(0.5 * abs(n)) | (steps.r >= 0.0), 1.0, -1.0)
    exists = is_integer(abs(n)) | (steps.r > 0.0)
    return p, power, select(exists, sign, np.nan)


@formula
def pair(n, steps, any_kind):
    """(c, s) after n steps; NaN where there is no such state.

    any_kind   False if the orbit is known to pass or rest
    """
    c, s = multiples(smaller(n, LONGEST) - steps.lag, steps.v, steps.power, steps, any_kind)
    # Where r < 0, only integers: n - lag may round a fraction away.
    unknown = (steps.r < 0.0) & (n < np.inf) & (~is_integer(n) | (n > EXACT))
    return select(unknown, np.nan, c), s


@formula
def growth(n, steps, any_kind):
    """The pair that takes (c, s) n steps further by `combined`."""
    c, s = multiples(n, 1.0, 0.0, steps, any_kind)
    return c, select(steps.kind > PASSES, s, 0.0)


@formula
def multiples(n, v, power, steps, any_kind):
    """`pair` of an orbit that begins at the ratio v 2**power."""
    p, more, sign = power_of_ratio(n, steps)
    f, power = sign * (v + v * p), power + more
    large = power >= LARGE
    c = select(large, f, scaled(f, smaller(power, LARGE)))
    s = select(large, scaled(1.0, -power), 1.0)
    if any_kind:
        # Near 1 the distance from 1 is more precise.
        rest = select(power == 0.0, -p, 1.0 - abs(c)) * (0.5 / steps.root)
        sine, cosine = sine_and_cosine(n, steps.turns, steps.turns_lost)
        is_turning, near = steps.kind == TURNS, steps.kind == PASSES_NEAR
        c = select(is_turning, cosine, select(near, abs(c), c))
        s = select(is_turning, sine / steps.root, select(near, rest, s))
    return c, s


@formula
def combined(c, s, next_c, next_s, m_square):
    """(c, s) after the steps of two pairs: (c c', s) for PASSES, (c c', s + c s') for PASSES_NEAR,
    and for TURNS that of the sum of the angles.
    """
    of_s = select(m_square > 0.0, next_c, 1.0)
    return c * next_c - m_square * (s * next_s), s * of_s + c * next_s


@formula
def sine_and_cosine(n, turns, turns_lost):
    """Sine and cosine of n times some quarter turns, up to a common sign; NaN if n is too large."""
    high, low = two_product(n, turns)
    half = select(abs(high) < LONGEST_PHASE, 0.5 * high, np.nan)
    whole = (half + TO_INTEGER) - TO_INTEGER
    return of_quarter_turns(2.0 * (half - whole), low + n * turns_lost)


@formula
def squarable(v):
    """v, or 0 if its square is negligible."""
    return select(abs(v) > NO_SQUARE, v, 0.0)


@formula
def omega_of(c, c_or_0, s, forms):
    """omega, without the factor 2**power_left(power); `c_or_0` is c, or 0 if c**2 is negligible."""
    ss = s * squarable(s)
    inverse = 1.0 / ((forms.d11 * c_or_0 + forms.d12 * s) * c + forms.d22 * ss)
    return (
        ((forms.x1 * c_or_0 + forms.y1 * s) * c + forms.z1 * ss) * inverse,
        ((forms.x2 * c_or_0 + forms.y2 * s) * c + forms.z2 * ss) * inverse,
    )


@formula
def state_1(start):
    """State 1 by one step of the map, in the same units; NaN at a pole.

    U + i V is multiplied by (1 + i X_next) / (1 - i X), of which the imaginary part is 2 X / D.
    """
    X, U, V = start.X, start.U, start.V
    inverse = 1.0 / denominator(X, *shifted(start.Y, start.Y_lost), start.K)
    X_next = X * ((1.0 + start.Y) + start.K * X) * inverse
    along, across = (1.0 - X * X_next) / (1.0 + X * X), 2.0 * X * inverse
    f11, f12, f21, f22 = frame(start, 1.0)
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
    if steps.kind == PASSES_NEAR:
        return -np.log1p(2.0 * steps.root / ratio) / steps.log_r
    log_w = np.log(abs(ratio / steps.v)) - steps.power * math.log(2.0)
    return steps.lag + log_w / steps.log_r
