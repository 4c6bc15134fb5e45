"""Elementary functions as plain arithmetic: calls to the C library keep loops scalar.

They are accurate to a few ulps on the ranges that the closed form needs. Integers that are combined
with floats are stored as floats.
"""

import math

import numpy as np

from .._jit import formula, select, two_product

LOG2_E = 1.4426950408889634
# log 2 as two numbers; the first has few bits, and its products with integers are exact.
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
# Adding this rounds to an integer, which the last bits of the sum hold.
TO_INTEGER = 1.5 * 2.0**52
BITS_OF_TO_INTEGER = 0x4338000000000000
BITS_OF_ROOT_HALF = 0x3FE6A09E667F3BCD
# Phases of this many quarter turns or more are not known.
LONGEST_PHASE = 2.0**52


@formula
def bits_of(number):
    """Return the bits of a float as an integer, without a call to the C library."""
    return np.float64(number).view(np.int64)


@formula
def number_of_bits(bits):
    """Return the float that has these bits."""
    return np.int64(bits).view(np.float64)


@formula
def larger(a, b):
    """Return the larger number; b if one is NaN."""
    return select(a > b, a, b)


@formula
def smaller(a, b):
    """Return the smaller number; b if one is NaN."""
    return select(a < b, a, b)


@formula
def is_integer(v):
    """Test that a number v >= 0 is an integer; `floor` would be a call."""
    return (v >= 2.0**52) | ((v + 2.0**52) - 2.0**52 == v)


@formula
def two_to_the(k):
    """2**k for an integer k from -1022 to 1023."""
    return number_of_bits(bits_of(k + (TO_INTEGER + 1023.0)) << 52)


@formula
def within(v, bound):
    """v limited to the range from -bound to bound."""
    return larger(smaller(v, bound), -bound)


@formula
def scaled(v, k):
    """v 2**k for an integer k of any size, rounded at most once."""
    k = within(k, 2044.0)
    half = (0.5 * k + TO_INTEGER) - TO_INTEGER
    return v * two_to_the(half) * two_to_the(k - half)


@formula
def exponent(v):
    """Exponent k with 2**k <= |v| < 2**(k + 1), limited to -1022 ... 1022."""
    k = number_of_bits((bits_of(abs(v)) >> 52) + BITS_OF_TO_INTEGER) - TO_INTEGER
    return within(k - 1023.0, 1022.0)


@formula
def exponential(x, lost):
    """p and k, an integer, for which exp(x + lost) = (1 + p) 2**k, |x| <= 1e6."""
    k = (x * LOG2_E + TO_INTEGER) - TO_INTEGER
    z = ((x - k * LN2_HIGH) - k * LN2_LOW) + lost
    # (exp(z) - 1 - z) / z**2 by Taylor's series, |z| <= log(2)/2, summed pairwise, which
    # shortens the chain of dependent operations.
    z2 = z * z
    z4 = z2 * z2
    low = (1.0 / 2.0 + z * (1.0 / 6.0)) + z2 * (1.0 / 24.0 + z * (1.0 / 120.0))
    middle = (1.0 / 720.0 + z * (1.0 / 5040.0)) + z2 * (1.0 / 40320.0 + z * (1.0 / 362880.0))
    high = (1.0 / 3628800.0 + z * (1.0 / 39916800.0)) + z2 * (
        1.0 / 479001600.0 + z * (1.0 / 6227020800.0)
    )
    return (low + z4 * (middle + z4 * high)) * z2 + z, k


@formula
def halvings(value):
    """The integer k for which value / 2**k lies between sqrt(1/2) and sqrt(2), value > 0."""
    k = (bits_of(value) - BITS_OF_ROOT_HALF) >> 52
    return number_of_bits(k + BITS_OF_TO_INTEGER) - TO_INTEGER


@formula
def logarithm_beyond(s):
    """log((1 + s) / (1 - s)) - 2 s, |s| < 0.172."""
    q = s * s
    q2 = q * q
    q4 = q2 * q2
    low = (1.0 / 3.0 + q * (1.0 / 5.0)) + q2 * (1.0 / 7.0 + q * (1.0 / 9.0))
    middle = (1.0 / 11.0 + q * (1.0 / 13.0)) + q2 * (1.0 / 15.0 + q * (1.0 / 17.0))
    high = (1.0 / 19.0 + q * (1.0 / 21.0)) + q2 * (1.0 / 23.0)
    return 2.0 * (s * (q * (low + q4 * (middle + q4 * high))))


@formula
def logarithm(value, distance):
    """log(value) for value > 0, where distance = 1 - value is more precise near 1."""
    k = halvings(value)
    m = value * two_to_the(-k)
    near = k == 0.0
    s = select(near, distance, m - 1.0) / select(near, distance - 2.0, m + 1.0)
    return k * LN2_HIGH + ((2.0 * s + logarithm_beyond(s)) + k * LN2_LOW)


@formula
def of_quarter_turns(q, lost):
    """sin(pi (q + lost) / 2) and cos(pi (q + lost) / 2) for a small `lost`, up to a common sign.

    Both have all digits, next to multiples of a quarter turn too.
    """
    whole = (q + TO_INTEGER) - TO_INTEGER
    z = (0.5 * math.pi) * ((q - whole) + lost)  # q - whole has no error; |z| <= pi/4
    s = z * z
    # Taylor's series, the smallest terms first.
    sine = 1.0 - s * (1.0 / 156.0) * (1.0 - s * (1.0 / 210.0))
    sine = 1.0 - s * (1.0 / 42.0) * (1.0 - s * (1.0 / 72.0) * (1.0 - s * (1.0 / 110.0) * sine))
    sine = z - z * (s * (1.0 / 6.0) * (1.0 - s * (1.0 / 20.0) * sine))
    cosine = 1.0 - s * (1.0 / 132.0) * (1.0 - s * (1.0 / 182.0) * (1.0 - s * (1.0 / 240.0)))
    cosine = 1.0 - s * (1.0 / 30.0) * (1.0 - s * (1.0 / 56.0) * (1.0 - s * (1.0 / 90.0) * cosine))
    cosine = 1.0 - 0.5 * s * (1.0 - s * (1.0 / 12.0) * cosine)
    odd = 0.5 * whole != (0.5 * whole + TO_INTEGER) - TO_INTEGER
    return select(odd, cosine, sine), select(odd, -sine, cosine)


@formula
def sine_and_cosine(n, turns, turns_lost):
    """Sine and cosine of n times some quarter turns, up to a common sign; NaN if n is too large."""
    high, low = two_product(n, turns)
    half = select(abs(high) < LONGEST_PHASE, 0.5 * high, np.nan)
    whole = (half + TO_INTEGER) - TO_INTEGER
    return of_quarter_turns(2.0 * (half - whole), low + n * turns_lost)


@formula
def half_tangent(t):
    """Tangent of half the angle whose tangent is t."""
    return t / (1.0 + np.sqrt(1.0 + t * t))


@formula
def arctangent(y, x):
    """Angle from 0 to pi/2 of the point (x, y), for x, y >= 0, not both 0."""
    z = half_tangent(half_tangent(smaller(x, y) / larger(x, y)))
    # Four times Taylor's series of the arctangent, |z| < 0.2, in pairs and pairs of them.
    q = -z * z
    q2 = q * q
    q4 = q2 * q2
    low = (1.0 / 3.0 + q * (1.0 / 5.0)) + q2 * (1.0 / 7.0 + q * (1.0 / 9.0))
    middle = (1.0 / 11.0 + q * (1.0 / 13.0)) + q2 * (1.0 / 15.0 + q * (1.0 / 17.0))
    high = (1.0 / 19.0 + q * (1.0 / 21.0)) + q2 * (1.0 / 23.0 + q * (1.0 / 25.0))
    angle = 4.0 * (z + z * (q * (low + q4 * (middle + q4 * high))))
    return select(y > x, 0.5 * math.pi - angle, angle)
