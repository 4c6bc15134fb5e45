"""Elementary functions as plain arithmetic, to some ulps: calls to the C library keep loops scalar.

Each reduces its argument without loss, and sums Taylor's series in pairs, pairs of them and so on,
which shortens the chain of dependent operations.
"""

import numpy as np

from .numba import formula, select

LOG2_E = 1.4426950408889634
# log 2 as two numbers; the first has few bits, and its products with integers are exact.
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
TO_INTEGER = 1.5 * 2.0**52  # adding it rounds to an integer, which the last bits of the sum hold
BITS_OF_TO_INTEGER = 0x4338000000000000
BITS_OF_ROOT_HALF = 0x3FE6A09E667F3BCD
VANISHES = -350.0  # exp(t) below this is 0; its square would be subnormal


@formula
def bits_of(v):
    return np.float64(v).view(np.int64)


@formula
def of_bits(bits):
    return np.int64(bits).view(np.float64)


@formula
def two_to_the(k):
    """2**k for an integer k, a float, from -1022 to 1023."""
    return of_bits(bits_of(k + (TO_INTEGER + 1023.0)) << 52)


@formula
def is_integer(v):
    """True if v >= 0 is an integer."""
    return (v >= 2.0**52) | ((v + 2.0**52) - 2.0**52 == v)


@formula
def exponential(t):
    """exp(t) and exp(t) - 1 for t <= 0."""
    t = select(t > VANISHES, t, select(t != t, t, VANISHES))
    k = (t * LOG2_E + TO_INTEGER) - TO_INTEGER
    z = (t - k * LN2_HIGH) - k * LN2_LOW
    z2 = z * z
    z4 = z2 * z2
    low = (1.0 / 2.0 + z * (1.0 / 6.0)) + z2 * (1.0 / 24.0 + z * (1.0 / 120.0))
    middle = (1.0 / 720.0 + z * (1.0 / 5040.0)) + z2 * (1.0 / 40320.0 + z * (1.0 / 362880.0))
    high = (1.0 / 3628800.0 + z * (1.0 / 39916800.0)) + z2 * (
        1.0 / 479001600.0 + z * (1.0 / 6227020800.0)
    )
    less, power = (low + z4 * (middle + z4 * high)) * z2 + z, two_to_the(k)
    power = select(t > VANISHES, power, select(t != t, t, 0.0))
    return power * (1.0 + less), power * less + (power - 1.0)


@formula
def odd_series(q):
    """1/3 + q/5 + ... + q**11/25."""
    q2 = q * q
    q4 = q2 * q2
    low = (1.0 / 3.0 + q * (1.0 / 5.0)) + q2 * (1.0 / 7.0 + q * (1.0 / 9.0))
    middle = (1.0 / 11.0 + q * (1.0 / 13.0)) + q2 * (1.0 / 15.0 + q * (1.0 / 17.0))
    high = (1.0 / 19.0 + q * (1.0 / 21.0)) + q2 * (1.0 / 23.0 + q * (1.0 / 25.0))
    return low + q4 * (middle + q4 * high)


@formula
def logarithm(v, distance):
    """log(v) for v > 0, where distance = 1 - v has more digits near 1."""
    exponent = of_bits(((bits_of(v) - BITS_OF_ROOT_HALF) >> 52) + BITS_OF_TO_INTEGER) - TO_INTEGER
    m, near = v * two_to_the(-exponent), exponent == 0.0
    s = select(near, distance, m - 1.0) / select(near, distance - 2.0, m + 1.0)
    of_m = 2.0 * s + 2.0 * (s * (s * s * odd_series(s * s)))
    return exponent * LN2_HIGH + (of_m + exponent * LN2_LOW)


@formula
def half_tangent(t):
    """The tangent of half the angle whose tangent is t."""
    return t / (1.0 + np.sqrt(1.0 + t * t))


@formula
def quarter_turns(t):
    """The angle whose tangent is t, |t| <= 1, in quarter turns."""
    z = half_tangent(half_tangent(t))
    return (8.0 / np.pi) * (z - z * (z * z * odd_series(-z * z)))


@formula
def cosine_and_sine(q):
    """Cosine and sine of q quarter turns, up to a common sign."""
    whole = np.floor(q + 0.5)
    z = (0.5 * np.pi) * (q - whole)
    s = z * z
    sine = 1.0 - s * (1.0 / 156.0) * (1.0 - s * (1.0 / 210.0))
    sine = 1.0 - s * (1.0 / 42.0) * (1.0 - s * (1.0 / 72.0) * (1.0 - s * (1.0 / 110.0) * sine))
    sine = z - z * (s * (1.0 / 6.0) * (1.0 - s * (1.0 / 20.0) * sine))
    cosine = 1.0 - s * (1.0 / 132.0) * (1.0 - s * (1.0 / 182.0) * (1.0 - s * (1.0 / 240.0)))
    cosine = 1.0 - s * (1.0 / 30.0) * (1.0 - s * (1.0 / 56.0) * (1.0 - s * (1.0 / 90.0) * cosine))
    cosine = 1.0 - 0.5 * s * (1.0 - s * (1.0 / 12.0) * cosine)
    odd = 0.5 * whole != np.floor(0.5 * whole)
    return select(odd, -sine, cosine), select(odd, cosine, sine)
