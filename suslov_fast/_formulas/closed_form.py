"""The closed form of the map and of the flow of the gyrostat; k = 0 is the Suslov body.

With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, g = I13 / sqrt(I1) + i I23 / sqrt(I2),
e = eps / (2 sqrt(I1 I2)) and l = I13 Omega1 + I23 Omega2 + k, the discrete equations are
z_next / (1 + i e l_next) = z / (1 - i e l). So R = |z| / sqrt(1 + (e l)**2) is conserved and, with
psi = arg(z / (1 - i e l)) - arg(g) and (p, q) = (sin(psi/2), cos(psi/2)), a step is linear up to a
common factor:

(p, q) -> (1 + G) (p, q),   G = ((0, T + K), (T - K, 0)),   T = e R |g|,   K = e k.

For e < 0, -g stands in place of g, so that T >= 0. G**2 = T**2 - K**2 = L**2. The state is
U + i V = z |g| / g, and X = e l and Y = -e Im(conj(g) z) are its dimensionless coordinates. The
components of state n are quotients of quadratic forms in coordinates (c, s) of the plane of (p, q).
docs/theory/gyrostat.md derives them under "The forms that are computed"; its delta, chi and A are
e, g and R |g|. Each kind of orbit that moves has its own:

PASSES       From one steady state to the other. (c, s) = (w_n, 1): w_n = w_0 r**n is the ratio of
             the coordinates of (p_n, q_n) in the eigenbasis of G, and r = (1 - L)/(1 + L).
PASSES_NEAR  The same near L = 0 or a pole, where w cancels. (1 + G)**n = c_n + s_n G, and
             (c, s) = (c_n - L s_n, s_n) = (r**n, (1 - r**n)/(2 L)), up to a common factor.
TURNS        K > T. (c, s) = (c_n, s_n) = (cos(n b), sin(n b)/m), m**2 = K**2 - T**2 and
             b = arctan(m). Both b and the phase n b have twice the digits of a float.

The inverse map changes the sign of Y; X and K may change their signs together, and K >= 0 here.
Terms of higher order in e have the factor `discrete`: 1 for the map, and 0 for the flow and for
states so slow that the map equals the flow to rounding.

This module computes the constants of an orbit, and `closed_form_states` its states.
"""

from collections import namedtuple

import numpy as np

from .._jit import formula, select, two_product
from . import twofold, units
from .coordinates import (
    ZERO_TO_ROUNDING,
    dimensionless,
    rotor_twofold,
    shifted,
    sum_of_ordered,
    sum_of_products,
    two_sum,
)
from .elementary import (
    LN2_HIGH,
    LN2_LOW,
    exponent,
    halvings,
    larger,
    logarithm_beyond,
    smaller,
    two_to_the,
    within,
)

# The exponential of smaller numbers underflows to 0.
NO_POWER = -1e5
# Exponents of the largest of X, Y and K: below the first the flow is as good as the map; below the
# second nothing moves; above the third squares leave the range of float64.
SLOW, MOTIONLESS, FAST = -200.0, -930.0, 333.0
# A flow is out of range if `time_power` of its `Start` is larger in size.
LONGEST_UNIT = 960.0
# `Forms` contain the unit of states, 2**power, up to this |power|: more would take them out of the
# range of float64. The rest, 2**power_left, multiplies states last.
PART_OF_COEFFICIENTS = 300.0
# Where L and |Y| / L are both above this, an orbit stays next to a pole, where the coordinates of
# PASSES cancel.
LARGE_ROOT = 8.0
# |L| is at least this part of T: nearer to 0 (1 - r**n)/(2 L) is n to rounding.
LEAST_ROOT = 2.0**-100
# States larger than R by this factor may be at a pole.
NEAR_POLE = 2.0**20
# Values of |g| below this, in units in which k is of the order of 1, are taken for 0.
UNCOUPLED = 1e-150
# 2 / pi, as a sum of two numbers.
TWO_OVER_PI = 0.6366197723675814, -3.935735335036497e-17

# Fates of orbits.
OUT_OF_RANGE = -3.0  # of float64
UNKNOWN = -2.0  # state 0 is NaN
UNDEFINED = -1.0  # at state 0 the map is 0 / 0
REGULAR = 0.0  # no pole can be met
SUPERCRITICAL = 1.0  # T >= 1
# Kinds of orbits.
RESTS, PASSES, PASSES_NEAR, TURNS = 0.0, 1.0, 2.0, 3.0

# A `units.Body`, its e as a sum of two numbers, and 1 / sqrt(I1) and 1 / sqrt(I2).
Body = namedtuple("Body", (*units.Body._fields, "e", "e_lost", "of_1", "of_2"))
# Coordinates of state 0, and a matrix f: omega = (f (U, V)) 2**power. X, Y and K are dimensionless,
# and sums of two numbers (`_lost` is the smaller); X is 0 for a state at rest.
#
# coupling   |e g|, in the unit of X; 0 if g = 0
# discrete   1, or 0 for the flow and slow orbits
# time_power exponent of the unit of X, Y and K, 0 unless `discrete` is 0
Start = namedtuple(
    "Start",
    "X X_lost Y Y_lost K K_lost U V coupling f11 f12 f21 f22 power discrete time_power fate",
)
# R, T, L**2 (`square`), L (`root` + `root_lost`), L - |Y| (`gap`) and r. Where L**2 < 0, `root` is
# m, and r has no meaning.
Levels = namedtuple("Levels", "R T square root root_lost gap r")
# Constants of (c, s) after n steps.
#
# log_r      log |r|, as the sum of this and `log_lost`; if `discrete` is 0, where r is 1,
#            -2 L 2**time_power
# v          of PASSES: w_n = v 2**power r**(n - lag)
# root       L, or m of TURNS
# m_square   m**2 of TURNS, else 0
# turns      b of TURNS in quarter turns, else 0, as the sum of this and `turns_lost`
Steps = namedtuple("Steps", "kind r log_r log_lost v power lag root m_square turns turns_lost")
# omega = (x c**2 + y c s + z s**2) / (d11 c**2 + d12 c s + d22 s**2).
Forms = namedtuple("Forms", "d11 d12 d22 x1 y1 z1 x2 y2 z2")


@formula
def body(given):
    """The `Body` of a `units.Problem` in the units of the user.

    The exponent of eps is kept apart: for a slow orbit X, Y and K would underflow.
    """
    own = units.of_body(given.I1, given.I2, given.I13, given.I23, given.k, given.eps)
    e = twofold.root(twofold.quotient((0.5, 0.0), two_product(2.0 * own.I1, own.I2)))
    e, e_lost = twofold.product(e, (own.eps, 0.0))
    return Body(
        own.I1, own.I2, own.I13, own.I23, own.k, own.eps, own.M, own.P, own.Q, own.E,
        e, e_lost, 1.0 / np.sqrt(own.I1), 1.0 / np.sqrt(own.I2),
    )  # fmt: skip


@formula
def start(back, flows, body, omega1, omega2):
    """The `Start` of an orbit of the map, or of the flow for which eps is the unit of time.

    back    -1 for the inverse map and the flow backward in time, else 1
    """
    # X, Y, K and u, the part of X without the rotor.
    p, unit = units.of_state(body, omega1, omega2)
    e, eps, of_1, of_2 = (body.e, body.e_lost), body.eps, body.of_1, body.of_2
    _, Y, Y_lost, _ = dimensionless(p.I1, p.I2, p.I13, p.I23, p.k, eps, p.omega1, p.omega2)
    l = rotor_twofold(p.I13, p.I23, p.k, p.omega1, p.omega2)
    X, X_lost = twofold.product(e, l)
    K, K_lost = twofold.product(e, (p.k, 0.0))
    u = e[0] * sum_of_products(p.I13, p.omega1, p.I23, p.omega2)

    # Exponents: of the unit of X, Y and K so far, and of the largest of them.
    of_step = body.E + unit.P + unit.W - unit.M
    size = exponent(larger(larger(abs(X), abs(Y)), abs(K)))
    slow = flows | (of_step + size < SLOW)
    factor = two_to_the(select(slow, -size, within(of_step, 1022.0)))
    time_power = select(slow, of_step + size, 0.0)

    # The frame, and U and V: they take the signs, so that K >= 0 and T >= 0.
    sign_of_eps, sign_of_K = select(eps < 0.0, -1.0, 1.0), select(K < 0.0, -1.0, 1.0)
    g1, g2 = p.I13 * of_1, p.I23 * of_2
    g = np.sqrt(g1 * g1 + g2 * g2)
    coupled, coupling = g > UNCOUPLED, sign_of_eps * (e[0] * g)
    inverse = 1.0 / select(coupled, coupling, 1.0)
    # The direction of g, or any if g = 0.
    g1 = select(coupled, g1 * (e[0] * inverse), sign_of_eps)
    g2 = select(coupled, g2 * (e[0] * inverse), 0.0)
    U = sign_of_K * select(coupled, u * inverse, sign_of_eps * (p.I1 * of_1 * p.omega1))
    V = back * select(coupled, -Y * inverse, sign_of_eps * (p.I2 * of_2 * p.omega2))
    of_X, of_Y = sign_of_K * factor, back * factor
    X, X_lost, K, K_lost = X * of_X, X_lost * of_X, K * of_X, K_lost * of_X
    Y, Y_lost = Y * of_Y, Y_lost * of_Y

    # The fate.
    c, Z = shifted(Y, Y_lost)
    undefined = (~slow) & (X == 0.0) & (c == 1.0) & (Z == 0.0)
    rests = (X == 0.0) | (eps == 0.0) | (omega1 == 0.0) & (omega2 == 0.0)
    rests = rests | (~flows) & slow & (time_power < MOTIONLESS)
    far = (~rests) & select(slow, abs(time_power) > LONGEST_UNIT, of_step + size > FAST)
    # T**2 >= 1, to rounding with a rotor: at T = 1 poles can be met.
    slack = select(K == 0.0, 0.0, ZERO_TO_ROUNDING * (1.0 + abs(K) * (2.0 * abs(X) + abs(K))))
    supercritical = coupled & (~slow) & (Y * Y + slack >= 1.0 + K * (2.0 * X - K))
    fate = select(supercritical, SUPERCRITICAL, REGULAR)
    fate = select(undefined, UNDEFINED, fate)
    total = X + Y + e[0]  # not a number if a parameter is out of range
    fate = select(far | (total != total), OUT_OF_RANGE, fate)
    fate = select(omega1 + omega2 != omega1 + omega2, UNKNOWN, fate)
    return Start(
        X=select(rests, 0.0, X),
        X_lost=X_lost,
        Y=Y,
        Y_lost=Y_lost,
        K=K,
        K_lost=K_lost,
        U=U,
        V=V,
        coupling=select(coupled, coupling, 0.0) * factor,
        f11=sign_of_K * g1 * of_1,
        f12=-back * g2 * of_1,
        f21=sign_of_K * g2 * of_2,
        f22=back * g1 * of_2,
        power=unit.W,
        discrete=select(slow, 0.0, 1.0),
        time_power=time_power,
        fate=fate,
    )


@formula
def levels(start):
    """The `Levels` of an orbit."""
    X, Y, Y_lost, K, discrete = start.X, start.Y, start.Y_lost, start.K, start.discrete
    below = 1.0 / np.sqrt(1.0 + discrete * X * X)
    R = np.sqrt(start.U * start.U + start.V * start.V) * below
    T = start.coupling * R
    X1, Y1, K1 = X * below, Y * below, K * below
    square = Y1 * Y1 + X1 * (X1 - 2.0 * K1) - discrete * (K * X1) * (K * X1)
    least = LEAST_ROOT * T
    square = select(abs(square) > least * least, square, least * least)
    root = np.sqrt(abs(square))
    # L - |Y| = (L**2 - Y**2) / (L + |Y|): L and |Y| do not cancel.
    plus, minus = (1.0 + discrete * Y) + discrete * Y_lost, (1.0 - discrete * Y) - discrete * Y_lost
    gap = X1 * (X1 * (plus * minus) - K1 * (2.0 + discrete * K * X)) / (root + abs(Y))
    # If it is small beside |Y| and |1 - |Y||, L = |Y| + gap has more digits than the root.
    near = smaller(abs(Y), select(discrete > 0.0, abs(1.0 - abs(Y)), abs(Y)))
    extends = (2.0 * abs(gap) <= near) & (square > 0.0)
    more = gap + select(Y > 0.0, Y_lost, -Y_lost)
    root, root_lost = sum_of_ordered(select(extends, abs(Y), root), select(extends, more, 0.0))
    # r = (1 - L**2) / (1 + L)**2, and 1 - L**2 = ((1 + K X)**2 - Y**2) / (1 + X**2).
    share = below * (1.0 / (1.0 + discrete * root))
    r = ((minus + discrete * K * X) * share) * ((plus + discrete * K * X) * share)
    return Levels(R, T, square, root, root_lost, gap, r)


@formula
def cancels(levels):
    """Test that L**2 = T**2 - K**2 loses digits: next to |k| = A, and where an orbit turns."""
    return levels.square < 0.25 * levels.T * levels.T


@formula
def accurate_levels(start, levels):
    """`levels` with L, or m, to twice the digits."""
    # L**2 = (X**2 - K X (2 + K X) + Y**2) / (1 + X**2), where X and Y are divided by a power of two
    # if X is large, and 1 by its square: (K X)**2 may leave the range of float64.
    one = two_to_the(-exponent(larger(abs(start.X), 1.0)))
    X, Y = (one * start.X, one * start.X_lost), (one * start.Y, one * start.Y_lost)
    K, discrete = (start.K, start.K_lost), (start.discrete, 0.0)
    KX, XX = twofold.product(K, X), twofold.square(X)
    above = twofold.difference(XX, (2.0 * one * KX[0], 2.0 * one * KX[1]))
    above = twofold.difference(above, twofold.product(discrete, twofold.square(KX)))
    below = twofold.plus((one * one, 0.0), twofold.product(discrete, XX))
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
def logarithm_of_ratio(L, L_lost, r):
    """log |r| as a sum of two numbers, r = (1 - L) / (1 + L)."""
    power = halvings(abs(r))
    d, d_lost = two_sum(1.0, -L)
    # Near L = 1 only r has the digits of 1 - L, unless L_lost has them.
    near = (L_lost == 0.0) & (abs(d) < 0.5)
    d, d_lost = select(near, r * (1.0 + L), d), select(near, 0.0, d_lost)
    s, s_lost = two_sum(1.0, L)
    # r = 2**power f, and log f = 2 artanh(q), q = (f - 1)/(f + 1).
    scale = two_to_the(-power)
    scale = select(r < 0.0, -scale, scale)
    d, d_lost = scale * d, scale * d_lost
    # L_lost is added last, since it may exceed 1. For large L, where scale = -1, it cancels in the
    # first sum, like L.
    above, lost = two_sum(d, -s)
    above, above_lost = two_sum(above, (lost + (d_lost - s_lost)) - (scale + 1.0) * L_lost)
    below, lost = two_sum(d, s)
    below, below_lost = two_sum(below, (lost + (d_lost + s_lost)) - (scale - 1.0) * L_lost)
    q, q_lost = twofold.quotient((above, above_lost), (below, below_lost))
    total, lost = sum_of_ordered(power * LN2_HIGH, 2.0 * q)
    lost = lost + ((2.0 * q_lost + logarithm_beyond(q)) + power * LN2_LOW)
    high = total + lost
    return high, lost - (high - total)


@formula
def larger_sum(start, levels):
    """The larger in size of S - L Y and S + L Y, S = L**2 + K X, and True if that is the first.

    Its terms do not cancel, and the smaller is X**2 T**2 (1 - L**2) divided by it.
    """
    S, LY = levels.root * levels.root + start.K * start.X, levels.root * abs(start.Y)
    return S + select(S < 0.0, -1.0, 1.0) * LY, (start.Y < 0.0) == (S >= 0.0)


@formula
def steps(start, levels):
    """The `Steps` of an orbit, of which `logarithm_of_ratio` and `turning` replace some."""
    X, T, L, r, discrete = start.X, levels.T, levels.root, levels.r, start.discrete
    # w cancels next to L = 0, except for r < 0, and next to poles for large L; the coordinates of
    # PASSES_NEAR do not.
    apart = (levels.square >= 0.25 * T * T) | (discrete * levels.square >= 1.0)
    apart = apart & ((discrete * L < LARGE_ROOT) | (abs(start.Y) < LARGE_ROOT * L))
    kind = select(apart, PASSES, select(levels.square > 0.0, PASSES_NEAR, TURNS))
    kind = select((X == 0.0) | (start.fate < 0.0), RESTS, kind)
    passes, decays = kind == PASSES, (kind == PASSES) | (kind == PASSES_NEAR)
    unit, ends = -2.0 * two_to_the(start.time_power), decays & (r == 0.0)

    # w_0 = X T (1 + L) / (S - L Y), or w_1 = (S + L Y) / (X T (1 + L)).
    total, from_0 = larger_sum(start, levels)
    factor = select(passes, X, 1.0)
    power = exponent(factor)
    other = factor * two_to_the(-power) * T * (1.0 + discrete * L)
    v = select(from_0, other, total) / select(from_0, total, other)
    v_power = exponent(v)
    return Steps(
        kind=kind,
        r=select(decays, r, 1.0),
        log_r=select(ends, NO_POWER, select(decays, L * unit, 0.0)),
        log_lost=select(decays & ~ends, levels.root_lost * unit, 0.0),
        v=select(passes, v * two_to_the(-v_power), select(decays, 1.0, 0.0)),
        power=select(passes, select(from_0, power, -power) + v_power, 0.0),
        lag=select(passes & ~from_0, discrete, 0.0),
        root=L,
        m_square=0.0,
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
def has_two_forms(steps):
    """Test that odd n have other `Forms`."""
    return (steps.kind == PASSES_NEAR) & (steps.r < 0.0)


@formula
def frame(start, size):
    """The matrix from (U, -V) to `size` omega, without the factor 2**power_left(power)."""
    unit = size * two_to_the(within(start.power, PART_OF_COEFFICIENTS))
    return start.f11 * unit, -start.f12 * unit, start.f21 * unit, -start.f22 * unit


@formula
def power_left(power):
    """The part of an exponent that is not in the coefficients, and multiplies states last."""
    return power - within(power, PART_OF_COEFFICIENTS)


@formula
def resting_forms(start, given):
    """The `Forms` of an orbit that rests, or has no states: (c, s) is (0, 1)."""
    d22 = select(start.fate < 0.0, np.nan, 1.0)
    return Forms(0.0, 0.0, d22, 0.0, 0.0, given.omega1, 0.0, 0.0, given.omega2)


@formula
def passing_forms(start, levels):
    """The `Forms` of PASSES."""
    K, T, L, r = start.K, levels.T, levels.root, levels.r
    inverse, of_one = 1.0 / T, 1.0 / (1.0 + start.discrete * L)
    f11, f12, f21, f22 = frame(start, levels.R * inverse)
    y = 2.0 * T * of_one
    return Forms(
        d11=r, d12=-2.0 * K * inverse * of_one, d22=1.0,
        x1=r * (f12 * L - f11 * K), y1=f11 * y, z1=-f12 * L - f11 * K,
        x2=r * (f22 * L - f21 * K), y2=f21 * y, z2=-f22 * L - f21 * K,
    )  # fmt: skip


@formula
def turning_forms(start, levels, steps):
    """The `Forms` of TURNS."""
    X, Y, K, U, V, R = start.X, start.Y, start.K, start.U, start.V, levels.R
    f11, f12, f21, f22 = frame(start, 1.0)
    # T R + K U cancels next to a steady state, unless it is formed from terms that are small there:
    # R**2 - U**2 = V**2 - (R X)**2, and K - T = m**2 / (K + T).
    TR, RX = levels.T * R, start.discrete * R * X
    first = K * ((V - RX) * (V + RX) / (R + abs(U)))
    second = R * (steps.m_square / (K + levels.T))
    small = (U < 0.0) & (abs(first) + second < 0.01 * TR)
    total = select(small, first - second, TR + K * U)
    y_u, y_v = -2.0 * K * V, -2.0 * total
    z_u, z_v = -(K * total + TR * X), V * steps.m_square
    return Forms(
        d11=1.0, d12=-2.0 * Y, d22=2.0 * K * X - steps.m_square,
        x1=f11 * U - f12 * V, y1=f11 * y_u + f12 * y_v, z1=f11 * z_u + f12 * z_v,
        x2=f21 * U - f22 * V, y2=f21 * y_u + f22 * y_v, z2=f21 * z_u + f22 * z_v,
    )  # fmt: skip


@formula
def near_forms(start, levels, sign):
    """The `Forms` of PASSES_NEAR, for even n (the sign is 1.0) or odd n (-1.0).

    Where r < 0, (c, s) is that of |r|**n; odd n, for which r**n has the other sign, start from
    (-X, Y) / (1 + 2 K X / L**2).
    """
    X, Y, K, T, L = start.X, start.Y, start.K, levels.T, levels.root
    gap = select(Y < 0.0, L + abs(Y), levels.gap)  # L - Y
    XT = X * T * (1.0 + start.discrete * L)
    total, is_first = larger_sum(start, levels)
    minus = 2.0 * select(is_first, total, levels.r * (XT / total) * XT)  # 2 (S - L Y)
    more = select(sign < 0.0, 2.0 * (K * X / L), 0.0)
    gap, one = gap + more, 1.0 + more / L
    f11, f12, f21, f22 = frame(start, levels.R / T)
    x_u, y_u = sign * X - K * one, 2.0 * (sign * L * X - K * gap)
    z_u, z_v = -minus * K, -minus * L
    return Forms(
        d11=one, d12=2.0 * gap, d22=minus,
        x1=f11 * x_u + f12 * Y, y1=f11 * y_u - f12 * minus, z1=f11 * z_u + f12 * z_v,
        x2=f21 * x_u + f22 * Y, y2=f21 * y_u - f22 * minus, z2=f21 * z_u + f22 * z_v,
    )  # fmt: skip


@formula
def usual_after(start, steps):
    """0, or 1 where `Forms` lose digits of state 1, (c, s) = (1, 1): large Y and K X cancel."""
    cancels = 4.0 * (1.0 + abs(start.Y - start.K * start.X)) < abs(start.Y)
    return select(cancels & (steps.kind != RESTS), start.discrete, 0.0)


@formula
def recompute_from(start, levels, steps):
    """The size from which on states are computed again one by one: from there on they may be at a
    pole. 0 for orbits with two forms or without states.
    """
    f11, f12, f21, f22 = frame(start, levels.R)
    size = larger(larger(abs(f11), abs(f12)), larger(abs(f21), abs(f22)))
    may_meet = (steps.kind != RESTS) & (start.fate == SUPERCRITICAL)
    size = select(may_meet, NEAR_POLE * size * (1.0 + levels.T + start.K), np.inf)
    return select((start.fate < 0.0) | has_two_forms(steps), 0.0, size)
