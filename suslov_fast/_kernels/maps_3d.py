"""The map in three dimensions: in canonical coordinates, and by equation (5) as printed."""

from typing import NamedTuple

import numpy as np

from .._formulas import canonical_map, coordinates, printed_map
from .._formulas.elementary import exponent, larger, scaled, two_to_the
from .._jit import formula, select
from . import codes
from .iterate import LARGEST, map_kernel
from .lanes import body_at


class Canonical(NamedTuple):
    """Constants of a trajectory: omega = (m (X, Z) + rest) scale, |X| + |Z| < bound, Z = c - Y."""

    m11: float
    m12: float
    m21: float
    m22: float
    rest1: float
    rest2: float
    scale: float
    bound: float
    c: float


@formula
def canonical_at(c, l):
    return Canonical(
        c[0, l], c[1, l], c[2, l], c[3, l], c[4, l], c[5, l], c[6, l], c[7, l], c[8, l]
    )


@formula
def own_unit(eps, omega1, omega2):
    """Return eps and a state in a unit 2**k in which the state is of the order of 1, and 2**k."""
    k = exponent(larger(abs(omega1), abs(omega2)))
    inverse = two_to_the(-k)
    return scaled(eps, k), omega1 * inverse, omega2 * inverse, two_to_the(k)


@formula
def enter_canonical(parameters, omega, b, c, s, l):
    I1, I2, I13, I23, eps = body_at(parameters, b)
    omega1, omega2 = omega[b, 0], omega[b, 1]
    step, state1, state2, unit = own_unit(eps, omega1, omega2)
    X, Y, lost = coordinates.to_canonical(I1, I2, I13, I23, step, state1, state2)
    m11, m12, m21, m22 = coordinates.from_canonical(I1, I2, I13, I23, step)
    # The identity map (I13 = I23 = 0, or eps = 0) has no such matrix: the state does not change.
    rests = coordinates.at_rest(I13, I23, step, X, Y)
    m11, m12 = select(rests, 0.0, m11), select(rests, 0.0, m12)
    m21, m22 = select(rests, 0.0, m21), select(rests, 0.0, m22)
    X, Y, lost = select(rests, 0.0, X), select(rests, 0.0, Y), select(rests, 0.0, lost)
    shift, Z = canonical_map.shifted(Y, lost)
    largest = larger(larger(abs(m11), abs(m12)), larger(abs(m21), abs(m22)))
    # omega is finite if |X| + |Z| is below this.
    bound = (LARGEST / larger(unit, 1.0)) / largest
    c[0, l], c[1, l], c[2, l], c[3, l] = m11, -m12, m21, -m22
    c[4, l] = select(rests, omega1, 0.0) + m12 * shift
    c[5, l] = select(rests, omega2, 0.0) + m22 * shift
    c[6, l], c[7, l], c[8, l] = select(rests, 1.0, unit), bound, shift
    missing = omega1 + omega2 != omega1 + omega2
    s[0, l], s[1, l] = select(missing, np.nan, X), Z
    code = codes.SUPERCRITICAL if abs(Y) >= 1.0 else codes.OK
    bounded = canonical_map.stays_bounded(X, Z, shift, bound)
    return codes.NONFINITE if missing else code, 0 if bounded else 1


@formula
def advance_canonical(c, s, l):
    s[0, l], s[1, l] = canonical_map.canonical_step(s[0, l], s[1, l], 0.0)


@formula
def careful_canonical(c, s, l):
    s[0, l], s[1, l] = canonical_map.careful_step(s[0, l], s[1, l])


@formula
def guarded_canonical(c, s, l):
    o = canonical_at(c, l)
    s[0, l], s[1, l] = canonical_map.guarded_step(s[0, l], s[1, l], o.c, o.bound)


@formula
def show_canonical(c, s, l, out, i):
    o = canonical_at(c, l)
    out[i], out[i + 1] = coordinates.angular_velocity(
        o.m11, o.m12, o.m21, o.m22, o.rest1, o.rest2, o.scale, s[0, l], s[1, l]
    )


@formula
def cause_canonical(c, s, l):
    d, regular = canonical_map.denominator(s[0, l], s[1, l], canonical_at(c, l).c)
    return codes.SINGULAR if np.isfinite(d) and not regular else codes.NONFINITE


@formula
def settle_canonical(c, s, l, rounds):
    X = s[0, l]
    if rounds:
        s[0, l] = canonical_map.without_negligible(X, s[1, l], canonical_at(c, l).c)
    return 1 if canonical_map.has_subnormal_square(X) else 0


canonical = map_kernel(
    "canonical",
    2,
    2,
    enter_canonical,
    advance_canonical,
    show_canonical,
    cause_canonical,
    careful_canonical,
    guarded_canonical,
    settle_canonical,
)


class Printed(NamedTuple):
    """Constants of a trajectory: the coefficients, a bound of the state, and the unit of omega."""

    k1: float
    k2: float
    k3: float
    k4: float
    bound: float
    unit: float


@formula
def printed_at(c, l):
    return Printed(c[0, l], c[1, l], c[2, l], c[3, l], c[4, l], c[5, l])


@formula
def enter_printed(parameters, omega, b, c, s, l):
    I1, I2, I13, I23, eps = body_at(parameters, b)
    omega1, omega2 = omega[b, 0], omega[b, 1]
    step, state1, state2, unit = own_unit(eps, omega1, omega2)
    _, Y, _ = coordinates.to_canonical(I1, I2, I13, I23, step, state1, state2)
    rests = (eps == 0.0) | (I13 == 0.0) & (I23 == 0.0)
    c[0, l], c[1, l], c[2, l], c[3, l] = printed_map.printed_coefficients(I1, I2, I13, I23, step)
    c[4, l] = select(rests, np.inf, LARGEST / larger(unit, 1.0))
    c[5, l] = select(rests, 1.0, unit)
    missing = omega1 + omega2 != omega1 + omega2
    s[0, l] = select(missing, np.nan, select(rests, omega1, state1))
    s[1, l] = select(rests, omega2, state2)
    code = codes.SUPERCRITICAL if abs(Y) >= 1.0 and not rests else codes.OK
    return codes.NONFINITE if missing else code, 1


@formula
def advance_printed(c, s, l):
    o = printed_at(c, l)
    s[0, l], s[1, l] = printed_map.printed_step(o.k1, o.k2, o.k3, o.k4, s[0, l], s[1, l], o.bound)


@formula
def show_printed(c, s, l, out, i):
    unit = printed_at(c, l).unit
    out[i], out[i + 1] = s[0, l] * unit, s[1, l] * unit


@formula
def cause_printed(c, s, l):
    o = printed_at(c, l)
    d, regular = printed_map.printed_denominator(o.k1, o.k2, o.k3, o.k4, s[0, l], s[1, l])
    return codes.SINGULAR if np.isfinite(d) and not regular else codes.NONFINITE


printed = map_kernel("printed", 2, 2, enter_printed, advance_printed, show_printed, cause_printed)
