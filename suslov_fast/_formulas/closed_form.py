"""State n of the gyrostat and, with k = 0, of the Suslov body, without iteration; and of the flow.

With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, g = I13 / sqrt(I1) + i I23 / sqrt(I2),
e = eps / (2 sqrt(I1 I2)) and l = I13 Omega1 + I23 Omega2 + k, the discrete equations are
z_next / (1 + i e l_next) = z / (1 - i e l). So R = |z| / sqrt(1 + (e l)**2) is conserved and, with
psi = arg(z / (1 - i e l)) - arg(g) and (p, q) = (sin(psi/2), cos(psi/2)), a step is linear:

(p, q) -> (1 + G) (p, q),   G = ((0, T + K), (T - K, 0)),   T = e R |g|,   K = e k.

G**2 = T**2 - K**2 = L**2. The state is U + i V = z |g| / g, and X = e l and Y = -e Im(conj(g) z)
are its dimensionless coordinates. Those of state n are quotients of quadratic forms in (p_n, q_n),
and so in other coordinates (c, s). There are three kinds of orbits that move:

PASSES    From one steady state to the other. (c, s) = (w_n, 1), where w_n = w_0 r**n with
          r = (1 - L)/(1 + L) is the ratio of the coordinates of (p, q) in the eigenbasis.
NEARS     The same next to L = 0, where these coordinates cancel. (1 + G)**n = c_n + s_n G, and
          (c, s) = (c_n - L s_n, s_n) = (r**n, (1 - r**n)/(2 L)), to a common factor.
TURNS     K > T. (c, s) = (c_n, s_n) = (cos(n b), sin(n b)/m), m**2 = K**2 - T**2 and
          b = arctan(m), which is known to twice the digits, and so is the phase n b.

The inverse map changes the sign of Y; X and K may change their signs together, and K >= 0 here. For
the flow, and for states so slow that the map follows it to rounding, terms of higher order in e are
missing: `order` is 0 instead of 1.
"""

import math
from typing import NamedTuple

import numpy as np

from .._jit import formula, select, two_product
from . import twofold, units
from .canonical_map import ZERO_TO_ROUNDING
from .coordinates import (
    dimensionless,
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
# A ratio w above 2**this is stored as the pair (f, 2**-k).
LARGE = 200.0
# An orbit with larger L, which begins at larger |Y| / L, is next to a pole for long.
LARGE_ROOT = 8.0
# w and s whose squares are negligible, and subnormal, which is slow.
NO_SQUARE = 1e-100
# |L| is at least this part of T: nearer to 0 (1 - r**n)/(2 L) is n to rounding.
LEAST_ROOT = 2.0**-100
# States larger than R by this may be at a pole.
NEAR_POLE = 2.0**20
# Couplings below this, in units in which k is 1, are none.
UNCOUPLED = 1e-150
# 2 / pi, as a sum of two numbers.
QUARTER_TURNS = 0.6366197723675814, -3.935735335036497e-17

# Fates of orbits: beyond the range of float64; state 0 is NaN; state 0 is where the map is
# undefined, 0 / 0; no pole can be met; |T| >= 1.
OUT_OF_RANGE, UNKNOWN, UNDEFINED, REGULAR, SUPERCRITICAL = -3.0, -2.0, -1.0, 0.0, 1.0
# Kinds of orbits.
RESTS, PASSES, NEARS, TURNS = 0.0, 1.0, 2.0, 3.0


class Start(NamedTuple):
    """Coordinates of a state, dimensionless, and the frame: omega = (f (U, V)) 2**power.

    X, Y and K are sums of two numbers, and X is 0 for a state at rest.

    time     the logarithm of the unit of time in steps
    """

    X: float
    X_lost: float
    Y: float
    Y_lost: float
    K: float
    K_lost: float
    U: float
    V: float
    coupling: float
    f11: float
    f12: float
    f21: float
    f22: float
    power: float
    order: float
    time: float
    fate: float


class Levels(NamedTuple):
    """R, T, L**2, L as a sum of two numbers, L - |Y|, and r."""

    R: float
    T: float
    square: float
    root: float
    root_lost: float
    gap: float
    r: float


class Steps(NamedTuple):
    """Constants of (c, s) after n steps.

    log_r   log |r|, as a sum of two numbers
    v       of PASSES: w_n = v 2**k r**(n - lag)
    root    L or m
    square  m**2, or 0 for L
    turns   b in quarter turns, or 0, as a sum of two numbers
    """

    kind: float
    r: float
    log_r: float
    log_lost: float
    v: float
    k: float
    lag: float
    root: float
    square: float
    turns: float
    turns_lost: float


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
    E = exponent(given.eps)
    own = given.eps * two_to_the(-E)
    I1, I2, I13, I23, k, _, omega1, omega2 = given
    p, unit = units.enter(I1, I2, I13, I23, k, 1.0, omega1, omega2)
    _, Y, Y_lost, _ = dimensionless(p.I1, p.I2, p.I13, p.I23, p.k, own, p.omega1, p.omega2)
    e = twofold.root(twofold.quotient((0.25, 0.0), two_product(p.I1, p.I2)))
    e = twofold.product(e, (own, 0.0))
    l = rotor_twofold(p.I13, p.I23, p.k, p.omega1, p.omega2)
    X, X_lost = twofold.product(e, l)
    K, K_lost = twofold.product(e, (p.k, 0.0))
    u = e[0] * sum_of_products(p.I13, p.omega1, p.I23, p.omega2)

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
    whole, half = select(own < 0.0, -1.0, 1.0), select(K < 0.0, -1.0, 1.0)
    coupling = whole * (e[0] * g)
    U = half * select(coupled, u / coupling, whole * (root1 * p.omega1))
    V = back * select(coupled, -Y / coupling, whole * (root2 * p.omega2))
    first, second = whole * half, whole * back
    of_X, of_Y = half * factor, back * factor
    X, X_lost, K, K_lost = X * of_X, X_lost * of_X, K * of_X, K_lost * of_X
    Y, Y_lost = Y * of_Y, Y_lost * of_Y

    undefined = (~slow) & (X == 0.0) & ((1.0 - Y) - Y_lost == 0.0)
    rests = (X == 0.0) | (own == 0.0) | (omega1 == 0.0) & (omega2 == 0.0)
    rests = rests | (~flows) & slow & (time < MOTIONLESS)
    far = (~rests) & select(slow, abs(time) > LONGEST_UNIT, of_step + size > FAST)
    supercritical = coupled & (~slow) & (Y * Y >= 1.0 + K * (2.0 * X - K))
    fate = select(supercritical, SUPERCRITICAL, REGULAR)
    fate = select(undefined, UNDEFINED, fate)
    total = X + Y + e[0]  # not a number if a parameter is out of range
    fate = select(far | (total != total), OUT_OF_RANGE, fate)
    fate = select(omega1 + omega2 != omega1 + omega2, UNKNOWN, fate)
    return Start(
        select(rests, 0.0, X),
        X_lost,
        Y,
        Y_lost,
        K,
        K_lost,
        U,
        V,
        select(coupled, coupling, 0.0) * factor,
        first * g1 / root1,
        -second * g2 / root1,
        first * g2 / root2,
        second * g1 / root2,
        unit.W,
        select(slow, 0.0, 1.0),
        time,
        fate,
    )


@formula
def levels(o):
    """The `Levels` of an orbit."""
    X, Y, K, order, lost = o.X, o.Y, o.K, o.order, o.Y_lost
    below = 1.0 / np.sqrt(1.0 + order * X * X)
    R = np.sqrt(o.U * o.U + o.V * o.V) * below
    T = o.coupling * R
    X1, Y1, K1 = X * below, Y * below, K * below
    square = Y1 * Y1 + X1 * (X1 - 2.0 * K1) - order * (K * X1) * (K * X1)
    least = LEAST_ROOT * T
    square = select(abs(square) > least * least, square, least * least)
    root = np.sqrt(abs(square))
    plus, minus = (1.0 + order * Y) + order * lost, (1.0 - order * Y) - order * lost
    gap = X1 * (X1 * (plus * minus) - K1 * (2.0 + order * K * X)) / (root + abs(Y))
    # A gap that is small beside |Y| and 1 - |Y| extends the digits of |Y|.
    more = gap + select(Y > 0.0, lost, -lost)
    near = smaller(abs(Y), select(order > 0.0, abs(1.0 - abs(Y)), abs(Y)))
    extends = (2.0 * abs(gap) <= near) & (square > 0.0)
    root, lost = sum_of_ordered(select(extends, abs(Y), root), select(extends, more, 0.0))
    share = below / (1.0 + order * root)
    r = ((minus + order * K * X) * share) * ((plus + order * K * X) * share)
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
def larger_sum(o, e):
    """The larger of S - L Y and S + L Y, S = L**2 + K X, and True if it is the first.

    Their product is X**2 T**2 (1 - L**2).
    """
    S = e.root * e.root + o.K * o.X
    return S + select(S < 0.0, -1.0, 1.0) * (e.root * abs(o.Y)), (o.Y < 0.0) == (S >= 0.0)


@formula
def steps(o, e):
    """The `Steps` of an orbit that does not turn, and the kind of any."""
    X, T, L, r = o.X, e.T, e.root, e.r
    # Next to L = 0 the coordinates of PASSES cancel, unless r < 0, and next to poles if L is large.
    passes = (e.square >= 0.25 * T * T) | (o.order * e.square >= 1.0)
    passes = passes & ((o.order * L < LARGE_ROOT) | (abs(o.Y) < LARGE_ROOT * L))
    kind = select(passes, PASSES, select(e.square > 0.0, NEARS, TURNS))
    kind = select((X == 0.0) | (o.fate < 0.0), RESTS, kind)
    high, low = logarithm_of_ratio(L, e.root_lost, r)
    slow, unit = o.order == 0.0, -2.0 * two_to_the(o.time)
    high, low = select(slow, L * unit, high), select(slow, e.root_lost * unit, low)
    decays = (kind == PASSES) | (kind == NEARS)
    ends = decays & (r == 0.0)

    # w_0 = X T (1 + L) / (S - L Y), or w_1 = (S + L Y) / (X T (1 + L)).
    passes = kind == PASSES
    total, from_0 = larger_sum(o, e)
    X = select(passes, X, 1.0)
    k = exponent(X)
    X = X * two_to_the(-k) * T * (1.0 + o.order * L)
    v = select(from_0, X, total) / select(from_0, total, X)
    v_k = exponent(v)
    return Steps(
        kind,
        select(decays, r, 1.0),
        select(ends, NO_POWER, select(decays, high, 0.0)),
        select(decays & ~ends, low, 0.0),
        select(passes, v * two_to_the(-v_k), select(decays, 1.0, 0.0)),
        select(passes, select(from_0, k, -k) + v_k, 0.0),
        select(passes & ~from_0, o.order, 0.0),
        L,
        0.0,
        0.0,
        0.0,
    )


@formula
def turning(o, e, s):
    """The `Steps` of an orbit that may turn: b is computed with twice the digits."""
    # m**2 = (X (2 K - X) - Y**2 + (K X)**2) / (1 + X**2)
    X, Y, K, order = (o.X, o.X_lost), (o.Y, o.Y_lost), (o.K, o.K_lost), (o.order, 0.0)
    KX = twofold.product(K, X)
    beyond = twofold.difference(twofold.plus(KX, KX), twofold.square(X))
    beyond = twofold.difference(beyond, twofold.square(Y))
    beyond = twofold.plus(beyond, twofold.product(order, twofold.square(KX)))
    below = twofold.plus((1.0, 0.0), twofold.product(order, twofold.square(X)))
    square = twofold.quotient(beyond, below)
    least, turns = (LEAST_ROOT * e.T) * (LEAST_ROOT * e.T), s.kind == TURNS
    known = turns & (square[0] > least)
    square = select(known, square[0], select(turns, least, 1.0)), select(known, square[1], 0.0)
    m = twofold.root(square)
    # The angle of the flow is m, and of the map the arctangent.
    slow, unit, large = o.order == 0.0, two_to_the(o.time), m[0] > 1.0
    one, over = twofold.quotient((1.0, 0.0), m)
    angle, lost = twofold.arctangent((select(large, one, m[0]), select(large, over, m[1])))
    angle, lost = select(slow, m[0] * unit, angle), select(slow, m[1] * unit, lost)
    angle, lost = twofold.product((angle, lost), QUARTER_TURNS)
    above, rest = twofold.difference((1.0, 0.0), (angle, lost))
    large = large & ~slow
    return Steps(
        s.kind,
        s.r,
        s.log_r,
        s.log_lost,
        s.v,
        s.k,
        s.lag,
        select(turns, m[0], s.root),
        select(turns, square[0], 0.0),
        select(turns, select(large, above, angle), 0.0),
        select(turns, select(large, rest, lost), 0.0),
    )


@formula
def has_two_forms(s):
    """Test that odd n have other `Forms`."""
    return (s.kind == NEARS) & (s.r < 0.0)


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
def forms(o, e, s, given):
    """The `Forms` of an orbit that passes; one that rests, or has no states, is constant."""
    moves, one = s.kind == PASSES, 1.0 + o.order * e.root
    f11, f12, f21, f22 = frame(o, e.R / e.T)
    y, K, L, r = e.T / one, o.K, e.root, e.r
    return Forms(
        select(moves, r, 0.0),
        select(moves, -K / (e.T * one), 0.0),
        select(o.fate < 0.0, np.nan, 1.0),
        select(moves, r * (f12 * L - f11 * K), 0.0),
        select(moves, f11 * y, 0.0),
        select(moves, -f12 * L - f11 * K, given.omega1),
        select(moves, r * (f22 * L - f21 * K), 0.0),
        select(moves, f21 * y, 0.0),
        select(moves, -f22 * L - f21 * K, given.omega2),
    )


@formula
def other_forms(o, e, s, passing, odd):
    """The `Forms` of an orbit of the other kinds, else those given.

    Where r < 0, those of odd n are others, for |r|**n in place of r**n.
    """
    X, Y, K, U, V, T, L = o.X, o.Y, o.K, o.U, o.V, e.T, s.root
    turns, passes = s.kind == TURNS, s.kind <= PASSES
    # Of NEARS: L - Y, and S - L Y.
    total, is_first = larger_sum(o, e)
    gap = select(Y < 0.0, L + abs(Y), e.gap)
    XT = X * T * (1.0 + o.order * L)
    m = select(is_first, total, e.r * (XT / total) * XT)
    # Odd n: an orbit from (-X, Y) / (1 + 2 K X / L**2).
    more, sign = select(odd, 2.0 * (K * X / L), 0.0), select(odd, -1.0, 1.0)
    gap, one = gap + more, 1.0 + more / L
    TR = T * e.R
    f11, f12, f21, f22 = frame(o, select(turns, 1.0, e.R / select(turns, 1.0, T)))
    x_u, x_v = select(turns, U, sign * X - K * one), select(turns, -V, Y)
    y_u, y_v = select(turns, -K * V, sign * L * X - K * gap), select(turns, -(TR + K * U), -m)
    z_u = select(turns, -(K * K * U + TR * (X + K)), -2.0 * m * K)
    z_v = select(turns, V * s.square, -2.0 * m * L)
    return Forms(
        select(passes, passing.d11, select(turns, 1.0, one)),
        select(passes, passing.d12, select(turns, -Y, gap)),
        select(passes, passing.d22, select(turns, 2.0 * K * X - s.square, 2.0 * m)),
        select(passes, passing.x1, f11 * x_u + f12 * x_v),
        select(passes, passing.y1, f11 * y_u + f12 * y_v),
        select(passes, passing.z1, f11 * z_u + f12 * z_v),
        select(passes, passing.x2, f21 * x_u + f22 * x_v),
        select(passes, passing.y2, f21 * y_u + f22 * y_v),
        select(passes, passing.z2, f21 * z_u + f22 * z_v),
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
def pair(n, o, others):
    """(c, s) after n steps; NaN where there is no such state.

    others   False if the orbit is known to pass or rest
    """
    c, s = multiples(smaller(n, LONGEST) - o.lag, o.v, o.k, o, others)
    # The lag hides a fraction below rounding.
    unknown = (o.r < 0.0) & (n < np.inf) & (~is_integer(n) | (n > EXACT))
    return select(unknown, np.nan, c), s


@formula
def growth(n, o, others):
    """By what n steps multiply (c, s), see `product`."""
    c, s = multiples(n, 1.0, 0.0, o, others)
    return c, select(o.kind > PASSES, s, 0.0)


@formula
def multiples(n, v, k, o, others):
    """`pair` of an orbit that begins at the ratio v 2**k."""
    p, k_n, sign = power_of_ratio(n, o)
    f, k = sign * (v + v * p), k + k_n
    large = k >= LARGE
    c, s = select(large, f, scaled(f, smaller(k, LARGE))), select(large, scaled(1.0, -k), 1.0)
    if others:
        # Near 1 the distance from 1 is more precise.
        rest = select(k == 0.0, -p, 1.0 - abs(c)) * (0.5 / o.root)
        sine, cosine = sine_and_cosine(n, o.turns, o.turns_lost)
        turns = o.kind == TURNS
        c = select(turns, cosine, select(o.kind == NEARS, abs(c), c))
        s = select(turns, sine / o.root, select(o.kind == NEARS, rest, s))
    return c, s


@formula
def product(c, s, next_c, next_s, square):
    """(c, s) after the steps of both pairs."""
    return c * next_c - square * (s * next_s), s * select(square > 0.0, next_c, 1.0) + c * next_s


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
    """omega for a pair (c, s)."""
    cc = c * select(abs(c) > NO_SQUARE, c, 0.0)
    ss = s * select(abs(s) > NO_SQUARE, s, 0.0)
    cs = 2.0 * c * s
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
def exact_size(o, e, s):
    """A size of states from which on they are computed one by one: they may be at a pole."""
    f11, f12, f21, f22 = frame(o, e.R)
    size = larger(larger(abs(f11), abs(f12)), larger(abs(f21), abs(f22)))
    may_meet = (s.kind != RESTS) & (o.fate == SUPERCRITICAL)
    size = select(may_meet, NEAR_POLE * size * (1.0 + e.T + o.K), np.inf)
    return select((o.fate < 0.0) | has_two_forms(s), 0.0, size)


@formula
def step_to_pole(forms, o, second):
    """The real n, but for the sign of r**n, at the first or second zero of the denominator."""
    d11, d12, d22 = forms.d11, forms.d12, forms.d22
    total = -(d12 + select(d12 < 0.0, -1.0, 1.0) * np.sqrt(d12 * d12 - d11 * d22))
    ratio = d22 / total if second else total / d11  # of c and s
    if o.kind == NEARS:
        return -np.log1p(2.0 * o.root / ratio) / o.log_r
    return o.lag + (np.log(abs(ratio / o.v)) - o.k * math.log(2.0)) / o.log_r
