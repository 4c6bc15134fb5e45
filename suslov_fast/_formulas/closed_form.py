"""The closed form of the map and of the flow of the gyrostat; k = 0 is the Suslov body.

Let z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, g = I13 / sqrt(I1) + i I23 / sqrt(I2),
e = eps / (2 sqrt(I1 I2)) and l = I13 Omega1 + I23 Omega2 + k. With X = e l, Y = -e Im(conj(g) z),
K = e k, U + i V = z |g| / g, R = |z| / sqrt(1 + X**2) and T = e R |g| state n is

    square = (X**2 - K * X * (2 + K * X) + Y**2) / (1 + X**2)
    L = sqrt(abs(square))
    if square > 0:
        r = ((1 - L) / (1 + L)) ** n
        c, s = (1 + r) / 2, (1 - r) / (2 * L)
    elif square < 0:
        c, s = cos(n * arctan(L)), sin(n * arctan(L)) / L
    else:
        c, s = 1, n
    d = c**2 - 2 * Y * c * s + (2 * K * X + square) * s**2
    U_n = (U * c**2 - 2 * K * V * c * s - (K**2 * U + T * R * (X + K)) * s**2) / d
    V_n = (V * c**2 + 2 * (T * R + K * U) * c * s + square * V * s**2) / d

because a step is linear in the half-angle plane: (p, q) -> (1 + e G) (p, q) with (e G)**2 = square,
up to a common factor; docs/theory/gyrostat.md derives it. What these lines lack is the subject of
the rest:

units   Parameters and states in any unit; orbits so slow that X, Y and K underflow; the flow.
        `discrete` is the factor of terms of higher order in e: 1 for the map, and 0 for the flow
        and for slow orbits.
digits  Orbits that pass from one steady state to another, and begin next to the first or have gone
        far: here (c, s) is (w_n, 1), and w_n = w_0 r**n is the ratio of the coordinates of
        (p_n, q_n) in the eigenbasis of G. The logarithm of r is a sum of two numbers.
rows    A geometric sequence takes one product for each state, and the state one division.

These are the orbits that pass. The others, which turn, come close to |k| = A or have T >= 1, are
those of `other_orbits`. K >= 0 and T >= 0 here: X and K may change their signs together, the
inverse map changes that of Y, and for e < 0 -g stands in place of g.
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
)
from .elementary import exponent, exponential, larger, scaled, smaller, two_to_the, within

# The exponential of smaller numbers underflows to 0.
NO_POWER = -1e5
# Exponents of the largest of X, Y and K: below the first the flow is as good as the map, below the
# second nothing moves; above the third squares leave the range of float64, and above the fourth the
# closed form of orbits with T >= 1 may lose digits.
SLOW, MOTIONLESS_POWER, FASTEST, FAST = -200.0, -930.0, 100.0, 20.0
# A flow is out of range if `time_power` of its `Start` is larger in size.
LONGEST_UNIT = 960.0
# `Forms` contain the unit of states, 2**power, up to this |power|: more would take them out of the
# range of float64. The rest, 2**power_left, multiplies states last.
PART_OF_COEFFICIENTS = 300.0
# For orbits that pass w_n is below 2**LARGEST_RATIO / LEAST_RATIO, also at real n below 1.
LARGEST_RATIO, LEAST_RATIO = 200.0, 2.0**-200
# |L| is at least this part of T: nearer to 0 (1 - r**n)/(2 L) is n to rounding.
LEAST_ROOT = 2.0**-100
# Values of |g| below this, in units in which k is of the order of 1, are taken for 0.
UNCOUPLED = 1e-150
# Larger numbers of steps and longer times are replaced by this: `two_product` does not overflow.
LARGEST_TIME = 2.0**990
# Numbers of steps above this are not known to be even or odd.
LARGEST_COUNT = 2.0**53
# Squares of smaller w and s are negligible; if subnormal, they would be slow.
NO_SQUARE = 1e-100

# Fates of orbits: beyond the range, state 0 is NaN, at state 0 the map is 0 / 0, no pole can be
# met, and T >= 1.
BEYOND_RANGE, UNKNOWN, UNDEFINED, REGULAR, JUMPING = -3.0, -2.0, -1.0, 0.0, 1.0

# A `units.ScaledBody`, its e as a sum of two numbers, and 1 / sqrt(I1) and 1 / sqrt(I2).
OrbitBody = namedtuple("OrbitBody", (*units.ScaledBody._fields, "e", "e_lost", "of_1", "of_2"))
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
# that of -L**2, and r has no meaning.
Levels = namedtuple("Levels", "R T square root root_lost gap r")
# Constants of (c, s) after n steps.
#
# kind       RESTS or PASSES, or one of `other_orbits`
# log_r      log |r|, as the sum of this and `log_lost`; if `discrete` is 0, where r is 1,
#            -2 L 2**time_power
# v          w_n = v 2**power r**(n - lag)
# root       L, or the root of -L**2 of an orbit that turns
# square     L**2 where the product of two (c, s) contains it, else 0
# turns      of an orbit that turns: the angle of a step in quarter turns, with `turns_lost`
Steps = namedtuple("Steps", "kind r log_r log_lost v power lag root square turns turns_lost")
RESTS, PASSES = 0.0, 1.0
# omega = (x c**2 + y c s + z s**2) / (d11 c**2 + d12 c s + d22 s**2).
Forms = namedtuple("Forms", "d11 d12 d22 x1 y1 z1 x2 y2 z2")


@formula
def body(given):
    """The `OrbitBody` of a `units.ScaledState` in the units of the user.

    The exponent of eps is kept apart: for a slow orbit X, Y and K would underflow.
    """
    own = units.of_body(given.I1, given.I2, given.I13, given.I23, given.k, given.eps)
    e = twofold.root(twofold.quotient((0.5, 0.0), two_product(2.0 * own.I1, own.I2)))
    e, e_lost = twofold.product(e, (own.eps, 0.0))
    return OrbitBody(
        own.I1, own.I2, own.I13, own.I23, own.k, own.eps, own.M, own.P, own.Q, own.E,
        e, e_lost, 1.0 / np.sqrt(own.I1), 1.0 / np.sqrt(own.I2),
    )  # fmt: skip


@formula
def start(back, flows, body, omega1, omega2):
    """The `Start` of an orbit of the map, or of the flow for which eps is the unit of time.

    back    -1 for the inverse map and the flow backward in time, else 1
    """
    p, unit = units.of_state(body, omega1, omega2)
    e, of_1, of_2 = (body.e, body.e_lost), body.of_1, body.of_2
    _, Y, Y_lost, _ = dimensionless(p.I1, p.I2, p.I13, p.I23, p.k, body.eps, p.omega1, p.omega2)
    X, X_lost = twofold.product(e, rotor_twofold(p.I13, p.I23, p.k, p.omega1, p.omega2))
    K, K_lost = twofold.product(e, (p.k, 0.0))

    # The unit of time: exponents of the unit of X, Y and K so far, and of the largest of them.
    of_step = body.E + unit.P + unit.W - unit.M
    size = exponent(larger(larger(abs(X), abs(Y)), abs(K)))
    slow = flows | (of_step + size < SLOW)
    factor = two_to_the(select(slow, -size, within(of_step, 1022.0)))
    time_power = select(slow, of_step + size, 0.0)

    # The frame: the direction of g, or any if g = 0, and U + i V.
    g1, g2 = p.I13 * of_1, p.I23 * of_2
    g = np.sqrt(g1 * g1 + g2 * g2)
    coupled, sign_of_eps = g > UNCOUPLED, select(body.eps < 0.0, -1.0, 1.0)
    coupling = select(coupled, sign_of_eps * (e[0] * g), 0.0)
    inverse = 1.0 / select(coupled, coupling, 1.0)
    g1 = select(coupled, g1 * (e[0] * inverse), sign_of_eps)
    g2 = select(coupled, g2 * (e[0] * inverse), 0.0)
    without_rotor = e[0] * sum_of_products(p.I13, p.omega1, p.I23, p.omega2)
    U = select(coupled, without_rotor * inverse, sign_of_eps * (p.I1 * of_1 * p.omega1))
    V = select(coupled, -Y * inverse, sign_of_eps * (p.I2 * of_2 * p.omega2))

    # The reflections: K >= 0, and time runs forward.
    mirror = select(K < 0.0, -1.0, 1.0)
    of_X, of_Y = mirror * factor, back * factor
    X, X_lost, K, K_lost = X * of_X, X_lost * of_X, K * of_X, K_lost * of_X
    Y, Y_lost = Y * of_Y, Y_lost * of_Y

    rests = (X == 0.0) | (body.eps == 0.0) | (omega1 == 0.0) & (omega2 == 0.0)
    rests = rests | (~flows) & slow & (time_power < MOTIONLESS_POWER)
    fate = fate_of_map(X, Y, Y_lost, K)
    fate = select(slow | (fate == JUMPING) & ~coupled, REGULAR, fate)
    fastest = select(fate == JUMPING, FAST, FASTEST)
    far = (~rests) & select(slow, abs(time_power) > LONGEST_UNIT, of_step + size > fastest)
    total = X + Y + e[0]  # not a number if a parameter is out of range
    fate = select(far | (total != total), BEYOND_RANGE, fate)
    fate = select(omega1 + omega2 != omega1 + omega2, UNKNOWN, fate)
    return Start(
        select(rests, 0.0, X), X_lost, Y, Y_lost, K, K_lost, mirror * U, back * V,
        coupling=coupling * factor,
        f11=mirror * g1 * of_1, f12=-back * g2 * of_1,
        f21=mirror * g2 * of_2, f22=back * g1 * of_2,
        power=unit.W,
        discrete=select(slow, 0.0, 1.0),
        time_power=time_power,
        fate=fate,
    )  # fmt: skip


@formula
def fate_of_map(X, Y, Y_lost, K):
    """REGULAR, JUMPING for T >= 1, to rounding with a rotor, or UNDEFINED."""
    slack = select(K == 0.0, 0.0, ZERO_TO_ROUNDING * (1.0 + abs(K) * (2.0 * abs(X) + abs(K))))
    supercritical = Y * Y + slack >= 1.0 + K * (2.0 * X - K)
    c, Z = shifted(Y, Y_lost)
    undefined = (X == 0.0) & (c == 1.0) & (Z == 0.0)
    return select(undefined, UNDEFINED, select(supercritical, JUMPING, REGULAR))


@formula
def is_missing(start):
    """Test that an orbit has no states."""
    return (start.fate != REGULAR) & (start.fate != JUMPING)


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
def larger_sum(start, levels):
    """The larger in size of S - L Y and S + L Y, S = L**2 + K X, and True if that is the first.

    Its terms do not cancel, and the smaller is X**2 T**2 (1 - L**2) divided by it.
    """
    S, LY = levels.root * levels.root + start.K * start.X, levels.root * abs(start.Y)
    return S + select(S < 0.0, -1.0, 1.0) * LY, (start.Y < 0.0) == (S >= 0.0)


@formula
def steps(start, levels):
    """The `Steps` of an orbit that rests or passes; those of a map take `with_logarithm`, too."""
    X, T, L, r, discrete = start.X, levels.T, levels.root, levels.r, start.discrete
    rests = (X == 0.0) | is_missing(start)
    unit, ends = -2.0 * two_to_the(start.time_power), r == 0.0
    # w_0 = X T (1 + L) / (S - L Y), or w_1 = (S + L Y) / (X T (1 + L)).
    total, from_0 = larger_sum(start, levels)
    power = exponent(X)
    other = X * two_to_the(-power) * T * (1.0 + discrete * L)
    v = select(from_0, other, total) / select(from_0, total, other)
    v_power = exponent(v)
    return Steps(
        kind=select(rests, RESTS, PASSES),
        r=select(rests, 1.0, r),
        log_r=select(rests, 0.0, select(ends, NO_POWER, L * unit)),
        log_lost=select(rests | ends, 0.0, levels.root_lost * unit),
        v=select(rests, 0.0, v * two_to_the(-v_power)),
        power=select(rests, 0.0, select(from_0, power, -power) + v_power),
        lag=select(rests | from_0, 0.0, discrete),
        root=L,
        square=0.0,
        turns=0.0,
        turns_lost=0.0,
    )


@formula
def with_logarithm(start, levels, log_r, log_lost):
    """`log_r` and `log_lost` of an orbit, from those of `steps`: of the map the logarithm of r."""
    high, low = twofold.logarithm_of_ratio(levels.root, levels.root_lost, levels.r)
    of_map = (start.discrete > 0.0) & (log_r < 0.0) & (levels.r != 0.0)
    return select(of_map, high, log_r), select(of_map, low, log_lost)


@formula
def matrix_to_omega(start, size):
    """The matrix from (U, -V) to `size` omega, without the factor 2**power_left(power)."""
    unit = size * two_to_the(within(start.power, PART_OF_COEFFICIENTS))
    return start.f11 * unit, -start.f12 * unit, start.f21 * unit, -start.f22 * unit


@formula
def power_left(power):
    """The part of an exponent that is not in the coefficients, and multiplies states last."""
    return power - within(power, PART_OF_COEFFICIENTS)


@formula
def forms(start, levels, given):
    """The `Forms` of an orbit that passes, or rests at a given state; NaN if it has no states."""
    K, T, L, r = start.K, levels.T, levels.root, levels.r
    inverse, of_one = 1.0 / T, 1.0 / (1.0 + start.discrete * L)
    f11, f12, f21, f22 = matrix_to_omega(start, levels.R * inverse)
    y = 2.0 * T * of_one
    missing = is_missing(start)
    rests = (start.X == 0.0) | missing
    rest1, rest2 = select(missing, np.nan, given.omega1), select(missing, np.nan, given.omega2)
    return Forms(
        d11=select(rests, 0.0, r),
        d12=select(rests, 0.0, -2.0 * K * inverse * of_one),
        d22=1.0,
        x1=select(rests, 0.0, r * (f12 * L - f11 * K)),
        y1=select(rests, 0.0, f11 * y),
        z1=select(rests, rest1, -f12 * L - f11 * K),
        x2=select(rests, 0.0, r * (f22 * L - f21 * K)),
        y2=select(rests, 0.0, f21 * y),
        z2=select(rests, rest2, -f22 * L - f21 * K),
    )


@formula
def is_other(start, levels, steps):
    """Test that an orbit is one of `other_orbits`."""
    moves = (steps.kind == PASSES) & (
        cancels(levels)
        | (abs(start.power) > PART_OF_COEFFICIENTS)
        | (steps.power >= LARGEST_RATIO)
        | (levels.r < LEAST_RATIO)
    )
    return moves | ((start.fate != REGULAR) & (start.fate != UNKNOWN))


@formula
def power_of_ratio(n, steps):
    """p and an integer `power` for which |r|**n = (1 + p) 2**power."""
    x, lost = two_product(n, steps.log_r)
    lost = lost + n * steps.log_lost
    endless = x < NO_POWER
    return exponential(select(endless, NO_POWER, x), select(endless, 0.0, lost))


@formula
def pair(n, steps):
    """(c, s) after n steps."""
    p, power = power_of_ratio(smaller(n, LARGEST_TIME) - steps.lag, steps)
    return scaled(steps.v + steps.v * p, power + steps.power), 1.0


@formula
def growth(n, steps):
    """The pair that takes (c, s) n steps further by `combined`."""
    p, power = power_of_ratio(n, steps)
    return scaled(1.0 + p, power), 0.0


@formula
def squarable(v):
    """v, or 0 if its square is negligible."""
    return select(abs(v) > NO_SQUARE, v, 0.0)


@formula
def omega_of(c, s, forms):
    """omega, without the factor 2**power_left."""
    cc, ss = c * squarable(c), s * squarable(s)
    cs = c * s
    inverse = 1.0 / ((forms.d11 * cc + forms.d12 * cs) + forms.d22 * ss)
    return (
        ((forms.x1 * cc + forms.y1 * cs) + forms.z1 * ss) * inverse,
        ((forms.x2 * cc + forms.y2 * cs) + forms.z2 * ss) * inverse,
    )
