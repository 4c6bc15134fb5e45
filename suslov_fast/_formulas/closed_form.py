"""State n of the gyrostat and, with k = 0, of the Suslov body, without iteration; and of the flow.

With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, g = I13 / sqrt(I1) + i I23 / sqrt(I2),
e = eps / (2 sqrt(I1 I2)) and l = I13 Omega1 + I23 Omega2 + k, the discrete equations are
z_next / (1 + i e l_next) = z / (1 - i e l). So R = |z| / sqrt(1 + (e l)**2) is conserved and, with
psi = arg(z / (1 - i e l)) - arg(g) and (p, q) = (sin(psi/2), cos(psi/2)), a step is linear:

(p, q) -> (1 + G) (p, q),   G = ((0, T + K), (T - K, 0)),   T = e R |g|,   K = e k.

G**2 = T**2 - K**2. The state is U + i V = z |g| / g, where, with d = p**2 + q**2 - 2 T p q,

X = e l and Y = -e Im(conj(g) z) are the coordinates of a state. Those of state n are quotients of
quadratic forms in (p_n, q_n), and so in (c, s) where (1 + G)**n = c + s G:

X_n = X (c**2 - L**2 s**2) / D,   Y_n = (Y (c**2 + L**2 s**2) - 2 (L**2 + K X) c s) / D,
D = c**2 - 2 Y c s + (L**2 + 2 K X) s**2,   L**2 = T**2 - K**2.

The inverse map changes the sign of Y; X and K may change their signs together, and K >= 0 here. For
the flow, and for states so slow that the map follows it to rounding, terms of higher order in e are
missing: `order` is 0 instead of 1.

There are three kinds of orbits that move:

PASSES    From one steady state to the other, without a pole: L >= T/2 and T < 1. The ratio of the
          coordinates of (p, q) in the eigenbasis is w_n = w r**n, r = (1 - L)/(1 + L).
NEARS     The same for other L, and for T >= 1: c + L s = 1 and c - L s = r**n to a common factor,
          and the forms are those in (r**n, s).
TURNS     K > T: c = cos(n b) and s = sin(n b)/m, m**2 = K**2 - T**2 and b = arctan(m), which is
          known to twice the digits, and so is the phase n b.
"""

import math
from typing import NamedTuple

import numpy as np

from .._jit import formula, select, two_product
from . import twofold, units
from .canonical_map import ZERO_TO_ROUNDING
from .coordinates import (
    canonical_body,
    canonical_state,
    rotor_twofold,
    sum_of_ordered,
    sum_of_products,
    two_sum,
)
from .elementary import (
    LN2_HIGH,
    LN2_LOW,
    TO_INTEGER,
    exponent,
    exponential,
    halvings,
    is_integer,
    larger,
    logarithm,
    logarithm_beyond,
    scaled,
    smaller,
    two_to_the,
    within,
)
from .trigonometric import of_quarter_turns

# The exponential of smaller numbers underflows to 0.
NO_POWER = -1e5
# Longer times and larger numbers of steps are replaced by this: `two_product` does not overflow.
LONGEST = 2.0**990
# Logarithms of the largest X, Y or K: below the first the flow is as good as the map; below the
# second nothing moves; above the third squares leave the range of float64.
SLOW, MOTIONLESS, FAST = -200.0, -930.0, 333.0
# Numbers of steps above this are not known to be even or odd.
EXACT = 2.0**53
# A flow whose unit of time is farther from 1 than this power of two is out of range.
LONGEST_UNIT = 960.0
# Powers of two up to this are part of the coefficients of an orbit; larger ones multiply its
# states, which would leave the range of float64 in between.
PART_OF_COEFFICIENTS = 300.0
# Couplings below this, in units in which k is 1, are none.
UNCOUPLED = 1e-150
# L**2 is at least this part of T**2 for a `Passage`: nearer to L = 0 its coordinates cancel.
PART_OF_PASSAGE = 0.25
# |L| is at least this part of T: nearer to 0 (1 - r**n)/(2 L) is n to rounding.
LEAST_ROOT = 2.0**-100
# States larger than R by this may be at a pole.
NEAR_POLE = 2.0**20
# 2 / pi, as a sum of two numbers.
QUARTER_TURNS = 0.6366197723675814, -3.935735335036497e-17
# In place of r = 0: its square underflows, and one step from next to Y = 1 still has its state.
LEAST_RATIO = -(2.0**-700)

# Fates of orbits: beyond the range of float64; state 0 is NaN; state 0 is where the map is
# undefined, 0 / 0; no pole can be met; |T| >= 1.
OUT_OF_RANGE, UNKNOWN, UNDEFINED, REGULAR, SUPERCRITICAL = -3.0, -2.0, -1.0, 0.0, 1.0
# Kinds of orbits.
RESTS, PASSES, NEARS, TURNS = 0.0, 1.0, 2.0, 3.0


class Start(NamedTuple):
    """Coordinates of a state, dimensionless, and the frame: omega = (f (U, V)) 2**power.

    lost     the rounding error of Y
    factor   the power of two by which X, Y and K were multiplied
    time     the logarithm of the unit of time in steps
    """

    X: float
    Y: float
    lost: float
    K: float
    U: float
    V: float
    coupling: float
    f11: float
    f12: float
    f21: float
    f22: float
    power: float
    factor: float
    order: float
    time: float
    fate: float
    rests: float


class Levels(NamedTuple):
    """R, T, L**2, L as a sum of two numbers (m if L**2 < 0), L - |Y|, and r."""

    R: float
    T: float
    square: float
    root: float
    lost: float
    gap: float
    r: float


class Steps(NamedTuple):
    """Constants of the n-th power of a step.

    log_r   log |r|, as a sum of two numbers
    root    L or m
    square  m**2, or 0 for L
    turns   b in quarter turns, or 0, as a sum of two numbers
    """

    kind: float
    r: float
    log_r: float
    log_lost: float
    root: float
    square: float
    turns: float
    turns_lost: float


class Passage(NamedTuple):
    """omega = rest + (a w - b) / (1 + w (r w - c)), where w_n = v 2**k r**(n - lag)."""

    v: float
    k: float
    lag: float
    c: float
    a1: float
    a2: float
    b1: float
    b2: float
    rest1: float
    rest2: float


class Forms(NamedTuple):
    """omega = (x c**2 + 2 y c s + z s**2) / (d11 c**2 + 2 d12 c s + d22 s**2)."""

    d11: float
    d12: float
    d22: float
    x1: float
    y1: float
    z1: float
    x2: float
    y2: float
    z2: float


@formula
def start(back, flows, given):
    """The `Start` of an orbit of the map, or of the flow for which eps is the unit of time.

    back    -1 for the inverse map and the flow backward in time, else 1
    given   I1, I2, I13, I23, k, eps, omega1 and omega2
    """
    I1, I2, I13, I23, k, eps, omega1, omega2 = given
    E = exponent(eps)
    own = eps * two_to_the(-E)
    p, unit = units.enter(I1, I2, I13, I23, k, 1.0, omega1, omega2)
    body = canonical_body(p.I1, p.I2, p.I13, p.I23)
    _, Y, lost = canonical_state(p.I13, p.I23, *body, own, p.omega1, p.omega2)
    e = own * (math.sqrt(0.5) * body[7])
    l, _ = rotor_twofold(p.I13, p.I23, p.k, p.omega1, p.omega2)
    x = sum_of_products(p.I13, p.omega1, p.I23, p.omega2)
    X, u, K = e * l, e * x, e * p.k

    # The logarithm of the unit of X, Y and K.
    of_step = E + unit.P + unit.W - unit.M
    size = exponent(larger(larger(abs(X), abs(Y)), abs(K)))
    slow = flows | (of_step + size < SLOW)
    factor = two_to_the(select(slow, -size, within(of_step, 1022.0)))
    time = select(slow, of_step + size, 0.0)

    root1, root2 = np.sqrt(p.I1), np.sqrt(p.I2)
    g1, g2 = p.I13 / root1, p.I23 / root2
    g = np.sqrt(g1 * g1 + g2 * g2)
    coupled = g > UNCOUPLED
    inverse = 1.0 / select(coupled, g, 1.0)
    g1, g2 = select(coupled, g1 * inverse, 1.0), select(coupled, g2 * inverse, 0.0)
    # The signs of U + i V, and of X and K.
    whole, half = select(e < 0.0, -1.0, 1.0), select(K < 0.0, -1.0, 1.0)
    coupling = whole * (e * g)
    U = half * select(coupled, u / coupling, whole * (root1 * p.omega1))
    V = back * select(coupled, -Y / coupling, whole * (root2 * p.omega2))
    first, second = whole * half, whole * back

    X, K = X * (half * factor), abs(K) * factor
    Y, lost = Y * (back * factor), lost * (back * factor)
    rests = (X == 0.0) | (eps == 0.0) | (p.omega1 == 0.0) & (p.omega2 == 0.0)
    rests = rests | (~flows) & slow & (time < MOTIONLESS)
    undefined = (~slow) & (X == 0.0) & ((1.0 - Y) - lost == 0.0)
    far = (~rests) & select(slow, abs(time) > LONGEST_UNIT, of_step + size > FAST)
    supercritical = coupled & (~slow) & (Y * Y >= 1.0 + K * (2.0 * X - K))
    fate = select(supercritical, SUPERCRITICAL, REGULAR)
    fate = select(undefined, UNDEFINED, fate)
    total = l + Y + e  # not a number if a parameter is out of range
    fate = select(far | (total != total), OUT_OF_RANGE, fate)
    fate = select(omega1 + omega2 != omega1 + omega2, UNKNOWN, fate)
    return Start(
        X,
        Y,
        lost,
        K,
        U,
        V,
        select(coupled, coupling, 0.0) * factor,
        first * g1 / root1,
        -second * g2 / root1,
        first * g2 / root2,
        second * g1 / root2,
        unit.W,
        factor,
        select(slow, 0.0, 1.0),
        time,
        fate,
        select(rests, 1.0, 0.0),
    )


@formula
def levels(o):
    """The `Levels` of an orbit."""
    X, Y, K, order = o.X, o.Y, o.K, o.order
    below = 1.0 / np.sqrt(1.0 + order * X * X)
    R = np.sqrt(o.U * o.U + o.V * o.V) * below
    T = o.coupling * R
    X1, Y1, K1 = X * below, Y * below, K * below
    square = Y1 * Y1 + X1 * (X1 - 2.0 * K1) - order * (K * X1) * (K * X1)
    least = LEAST_ROOT * T
    square = select(abs(square) > least * least, square, least * least)
    root = np.sqrt(abs(square))
    plus, minus = (1.0 + order * Y) + order * o.lost, (1.0 - order * Y) - order * o.lost
    gap = X1 * (X1 * (plus * minus) - K1 * (2.0 + order * K * X)) / (root + abs(Y))
    # A gap that is small beside |Y| and 1 - |Y| extends the digits of |Y|.
    more = gap + select(Y > 0.0, o.lost, -o.lost)
    near = smaller(abs(Y), select(order > 0.0, abs(1.0 - abs(Y)), abs(Y)))
    extends = (2.0 * abs(gap) <= near) & (square > 0.0)
    root, lost = sum_of_ordered(select(extends, abs(Y), root), select(extends, more, 0.0))
    share = below / (1.0 + order * root)
    r = ((minus + order * K * X) * share) * ((plus + order * K * X) * share)
    r = select(r == 0.0, LEAST_RATIO, r)
    return Levels(R, T, square, root, lost, gap, r)


@formula
def logarithm_of_ratio(T, T_lost, r):
    """Return log |r|, as a sum of two numbers, for r = (1 - T) / (1 + T)."""
    k = halvings(abs(r))
    d, d_lost = two_sum(1.0, -T)
    # Near t = 1 only r has the digits of 1 - T, unless T has them.
    near = (T_lost == 0.0) & (abs(d) < 0.5)
    d, d_lost = select(near, r * (1.0 + T), d), select(near, 0.0, d_lost)
    s, s_lost = two_sum(1.0, T)
    # r = 2**k m, and log m = 2 artanh(q), q = (m - 1)/(m + 1).
    scale = two_to_the(-k)
    scale = select(r < 0.0, -scale, scale)
    d, d_lost = scale * d, scale * d_lost
    # T_lost comes last, as it may be larger than 1. For large T, where scale = -1, it cancels in
    # the first sum.
    above, lost = two_sum(d, -s)
    above, above_lost = two_sum(above, (lost + (d_lost - s_lost)) - (scale + 1.0) * T_lost)
    below, lost = two_sum(d, s)
    below, below_lost = two_sum(below, (lost + (d_lost + s_lost)) - (scale - 1.0) * T_lost)
    q = above / below
    back, back_lost = two_product(q, below)
    q_lost = (((above - back) - back_lost) + (above_lost - q * below_lost)) / below
    total, lost = sum_of_ordered(k * LN2_HIGH, 2.0 * q)
    lost = lost + ((2.0 * q_lost + logarithm_beyond(q)) + k * LN2_LOW)
    high = total + lost
    return high, lost - (high - total)


@formula
def steps(o, e):
    """The `Steps` of an orbit that does not turn, and the kind of any."""
    passes = (e.square >= PART_OF_PASSAGE * e.T * e.T) & (o.fate == REGULAR)
    kind = select(passes, PASSES, select(e.square > 0.0, NEARS, TURNS))
    kind = select((o.rests != 0.0) | (o.fate < 0.0), RESTS, kind)
    high, low = logarithm_of_ratio(e.root, e.lost, e.r)
    unit = -2.0 * two_to_the(o.time)
    slow, moves = o.order == 0.0, (kind == PASSES) | (kind == NEARS)
    return Steps(
        kind,
        select(moves, e.r, 1.0),
        select(moves, select(slow, e.root * unit, high), 0.0),
        select(moves, select(slow, e.lost * unit, low), 0.0),
        e.root,
        0.0,
        0.0,
        0.0,
    )


@formula
def turning(o, e, s, given):
    """The `Steps` of an orbit that does not pass: b is computed with twice the digits."""
    I1, I2, I13, I23, k, eps, omega1, omega2 = given
    own = eps * two_to_the(-exponent(eps))
    p, _ = units.enter(I1, I2, I13, I23, k, 1.0, omega1, omega2)
    e2 = twofold.quotient(two_product(0.5 * own, 0.5 * own), two_product(p.I1, p.I2))
    l = rotor_twofold(p.I13, p.I23, p.k, p.omega1, p.omega2)
    l, k = (l[0] * o.factor, l[1] * o.factor), (p.k * o.factor, 0.0)
    # m**2 = (X (2 K - X) - Y**2 + (K X)**2) / (1 + X**2), for X = e l and K = e k.
    X2, K2 = twofold.product(e2, twofold.square(l)), twofold.product(e2, twofold.square(k))
    XK = twofold.product(e2, twofold.product(l, twofold.difference((2.0 * k[0], 0.0), l)))
    X2 = X2[0] * o.order, X2[1] * o.order
    size = twofold.plus((1.0, 0.0), X2)
    m2 = twofold.quotient(twofold.difference(XK, twofold.square((o.Y, o.lost))), size)
    m2 = twofold.plus(m2, twofold.product(K2, twofold.quotient(X2, size)))
    least = LEAST_ROOT * e.T
    tiny = ~(m2[0] > least * least)
    turns = s.kind == TURNS
    m2 = select(tiny, least * least, m2[0]), select(tiny, 0.0, m2[1])
    m = twofold.root((select(turns, m2[0], 1.0), select(turns, m2[1], 0.0)))
    # The angle of the flow is m, and of the map the arctangent.
    large = m[0] > 1.0
    one, over = twofold.quotient((1.0, 0.0), m)
    angle, lost = twofold.arctangent((select(large, one, m[0]), select(large, over, m[1])))
    slow, unit = o.order == 0.0, two_to_the(o.time)
    angle, lost = select(slow, m[0] * unit, angle), select(slow, m[1] * unit, lost)
    angle, lost = twofold.product((angle, lost), QUARTER_TURNS)
    above, rest = twofold.difference((1.0, 0.0), (angle, lost))
    large = large & ~slow
    return Steps(
        s.kind,
        s.r,
        s.log_r,
        s.log_lost,
        select(turns, m[0], s.root),
        select(turns, m2[0], 0.0),
        select(turns, select(large, above, angle), 0.0),
        select(turns, select(large, rest, lost), 0.0),
    )


@formula
def passage(o, e, kind, given):
    """The `Passage` of an orbit; one that rests, or has no states, is the constant `rest`."""
    moves = kind == PASSES
    T, root = e.T, e.root
    one = 1.0 + o.order * root
    X = select(moves, o.X, 1.0)
    k = exponent(X)
    X = X * two_to_the(-k) * T * one
    falls = o.Y < 0.0
    rest = root * (root + abs(o.Y)) + o.K * o.X
    v = select(falls, X, rest) / select(falls, rest, X)
    v_k = exponent(v)
    f11, f12, f21, f22 = frame(o, e.R / T)
    half_c = o.K / (T * one)
    of_X, of_Y = 2.0 * root * root / (T * one), 2.0 * root
    ends = o.fate < 0.0
    return Passage(
        select(moves, v * two_to_the(-v_k), 0.0),
        select(moves, select(falls, k, -k) + v_k, 0.0),
        select(moves & (~falls), o.order, 0.0),
        select(moves, 2.0 * half_c, 0.0),
        select(moves, f11 * of_X + f12 * (half_c * of_Y), 0.0),
        select(moves, f21 * of_X + f22 * (half_c * of_Y), 0.0),
        select(moves, f12 * of_Y, 0.0),
        select(moves, f22 * of_Y, 0.0),
        select(ends, np.nan, select(moves, f12 * root - f11 * o.K, given.omega1)),
        select(ends, np.nan, select(moves, f22 * root - f21 * o.K, given.omega2)),
    )


@formula
def frame(o, size):
    """The matrix from (U, -V) times `size` to omega in a unit of which `rest_of` is left."""
    unit = size * two_to_the(within(o.power, PART_OF_COEFFICIENTS))
    return o.f11 * unit, -o.f12 * unit, o.f21 * unit, -o.f22 * unit


@formula
def rest_of(power):
    """The part of a power of two that multiplies states."""
    return power - within(power, PART_OF_COEFFICIENTS)


@formula
def forms(o, e, s, odd):
    """The `Forms` of an orbit that does not pass.

    Where r < 0, those of odd n are others, for |r|**n in place of r**n.
    """
    X, Y, K, U, V, T, root = o.X, o.Y, o.K, o.U, o.V, e.T, s.root
    turns, falls = s.kind == TURNS, Y < 0.0
    # Of NEARS: L - Y, and L (L - Y) + K X, from its product with L (L + |Y|) + K X for Y >= 0.
    XT = X * T * (1.0 + o.order * root)
    rest = root * (root + abs(Y)) + K * X
    gap = select(falls, root + abs(Y), e.gap)
    m = select(falls, rest, e.r * (XT / rest) * XT)
    # Odd n: an orbit from (-X, Y) / (1 + 2 K X / L**2).
    more, sign = select(odd, 2.0 * (K * X / root), 0.0), select(odd, -1.0, 1.0)
    gap, g = gap + more, 1.0 + more / root
    TR = T * e.R
    f11, f12, f21, f22 = frame(o, select(turns, 1.0, e.R / select(turns, 1.0, T)))
    x_u, x_v = select(turns, U, sign * X - K * g), select(turns, -V, Y)
    y_u = select(turns, -K * V, sign * root * X - K * gap)
    y_v = select(turns, -(TR + K * U), -m)
    z_u = select(turns, -(K * K * U + TR * (X + K)), -2.0 * m * K)
    z_v = select(turns, V * s.square, -2.0 * m * root)
    return Forms(
        select(turns, 1.0, g),
        select(turns, -Y, gap),
        select(turns, 2.0 * K * X - s.square, 2.0 * m),
        f11 * x_u + f12 * x_v,
        f11 * y_u + f12 * y_v,
        f11 * z_u + f12 * z_v,
        f21 * x_u + f22 * x_v,
        f21 * y_u + f22 * y_v,
        f21 * z_u + f22 * z_v,
    )


@formula
def power_of_ratio(n, o):
    """p, k and a sign s for which r**n = s (1 + p) 2**k, k an integer.

    s is NaN if no such number exists: between two states of L >= 1.
    """
    x, lost = two_product(n, o.log_r)
    lost = lost + n * o.log_lost
    endless = x < NO_POWER
    p, k = exponential(select(endless, NO_POWER, x), select(endless, 0.0, lost))
    even = is_integer(0.5 * abs(n)) | (o.r >= 0.0)
    exists = is_integer(abs(n)) | (o.r > 0.0)
    return p, k, select(exists, select(even, 1.0, -1.0), np.nan)


@formula
def growth(n, s, o):
    """f and k for which w_n = f 2**k."""
    p, k, _ = power_of_ratio(smaller(n, LONGEST) - o.lag, s)
    return o.v + o.v * p, o.k + k


@formula
def negligible_square(w):
    """w**2, or 0 if it is subnormal and negligible relative to 1."""
    w = select(abs(w) > 1e-100, w, 0.0)
    return w * w


@formula
def passing(f, k, r, o):
    """omega of an orbit that passes, for w = f 2**k of any size."""
    # Scale w and 1 by a power of two that brings the larger one to the order of 1.
    factor = select(abs(k) <= 1000.0, two_to_the(-smaller(abs(k), 1000.0)), 0.0)
    large = k > 0.0
    one = select(large, factor, 1.0)
    w = select(large, f, f * factor)
    inverse = one / (negligible_square(one) - o.c * (one * w) + r * negligible_square(w))
    return (
        o.rest1 + (o.a1 * w - o.b1 * one) * inverse,
        o.rest2 + (o.a2 * w - o.b2 * one) * inverse,
    )


@formula
def multiples(n, o):
    """c and s of `Forms` after n steps; NaN where there is no such state."""
    unknown = (n > EXACT) & (n < np.inf) & (o.r < 0.0)
    n = smaller(n, LONGEST)
    p, k, sign = power_of_ratio(n, o)
    sign = select(unknown, np.nan, sign)
    ratio = scaled(1.0 + p, k)
    # Near 1 the distance from 1 is more precise.
    rest = select(k == 0.0, -p, 1.0 - ratio) * (0.5 / o.root)
    sine, cosine = sine_and_cosine(n, o.turns, o.turns_lost)
    turns = o.turns != 0.0
    return (
        select(turns, cosine, ratio * abs(sign)),
        select(turns, sine / o.root, rest),
    )


@formula
def sine_and_cosine(n, turns, turns_lost):
    """Sine and cosine of n times some quarter turns, up to a common sign; NaN if n is too large."""
    high, low = two_product(n, turns)
    half = 0.5 * high
    whole = (half + TO_INTEGER) - TO_INTEGER
    low = low + n * turns_lost
    half = select(abs(half) < 2.0**51, (half - whole) + 0.5 * low, np.nan)
    sine, cosine = of_quarter_turns(2.0 * abs(half))
    return select(half < 0.0, -sine, sine), cosine


@formula
def quotient(c, s, o):
    """omega for c and s of `multiples`."""
    cc, cs, ss = c * c, 2.0 * c * s, s * s
    inverse = 1.0 / ((o.d11 * cc + o.d22 * ss) + o.d12 * cs)
    return (
        ((o.x1 * cc + o.z1 * ss) + o.y1 * cs) * inverse,
        ((o.x2 * cc + o.z2 * ss) + o.y2 * cs) * inverse,
    )


@formula
def is_pole(c, s, o):
    """Test that the denominator of `quotient` is 0 to rounding."""
    first, second, third = o.d11 * c * c, 2.0 * o.d12 * c * s, o.d22 * s * s
    size = (abs(first) + abs(third)) + abs(second)
    return ~(abs((first + third) + second) > ZERO_TO_ROUNDING * size)


@formula
def far_from_poles(o, e):
    """A number that components of omega exceed at a pole, and seldom elsewhere."""
    f11, f12, f21, f22 = frame(o, e.R)
    size = larger(larger(abs(f11), abs(f12)), larger(abs(f21), abs(f22)))
    return NEAR_POLE * size * (1.0 + e.T + o.K)


@formula
def is_odd(n, r):
    """Test that r**n is negative."""
    return (r < 0.0) & (~is_integer(0.5 * abs(n)))


@formula
def indices_of_poles(d11, d12, d22, root, log_r):
    """The real n, the parity of n apart, for which d11 c**2 + 2 d12 c s + d22 s**2 = 0, or NaN."""
    sum_of_roots = -(d12 + select(d12 < 0.0, -1.0, 1.0) * np.sqrt(d12 * d12 - d11 * d22))
    return (
        index_of_ratio(2.0 * root * sum_of_roots / d22, log_r),
        index_of_ratio(2.0 * root * d11 / sum_of_roots, log_r),
    )


@formula
def index_of_ratio(x, log_r):
    """The n for which |r|**n = 1 / (1 + x); NaN if n < 0."""
    y = select(x >= 0.0, x, 0.0)
    return select(x >= 0.0, logarithm(1.0 / (1.0 + y), y / (1.0 + y)) / log_r, np.nan)
