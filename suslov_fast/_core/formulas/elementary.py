"""Elementary functions as plain arithmetic: a call of the C library keeps loops scalar.

To a few ulps where the closed form needs them. They serve numbers, not arrays.
"""

import numpy as np

from ..jit import formula

LOG2_E = 1.4426950408889634
# log 2 as two numbers, the first of so few bits that its products with integers are exact.
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
# Adding this rounds to an integer and leaves it in the last bits of the sum.
TO_INTEGER = 1.5 * 2.0**52
BITS_OF_TO_INTEGER = 0x4338000000000000
BITS_OF_ROOT_HALF = 0x3FE6A09E667F3BCD


@formula
def is_integer(v):
    """Whether a number v >= 0 is one; `floor` would be a call."""
    return (v >= 2.0**52) | ((v + 2.0**52) - 2.0**52 == v)


@formula
def times_exponential(v, x):
    """v exp(x) and exp(x) - 1 for x <= 0.

    The first also where exp(x) itself is out of range; 0 below exp(-1400).
    """
    shifted = x * LOG2_E + TO_INTEGER
    k = shifted - TO_INTEGER
    z = (x - k * LN2_HIGH) - k * LN2_LOW
    # (exp(z) - 1 - z) / z**2 by Taylor's series, |z| <= log(2)/2, summed in pairs and pairs of
    # them: one after the other, terms would wait for each other.
    z2 = z * z
    z4 = z2 * z2
    low = (1.0 / 2.0 + z * (1.0 / 6.0)) + z2 * (1.0 / 24.0 + z * (1.0 / 120.0))
    middle = (1.0 / 720.0 + z * (1.0 / 5040.0)) + z2 * (1.0 / 40320.0 + z * (1.0 / 362880.0))
    high = (1.0 / 3628800.0 + z * (1.0 / 39916800.0)) + z2 * (1.0 / 479001600.0)
    p = low + z4 * (middle + z4 * high)
    p = p * z2 + z
    exponent = np.float64(shifted).view(np.int64) - BITS_OF_TO_INTEGER
    half = exponent >> 1
    power1 = np.int64((half + 1023) << 52).view(np.float64)
    power2 = np.int64((exponent - half + 1023) << 52).view(np.float64)
    less_one = p if k == 0.0 else (1.0 + p) * power1 * power2 - 1.0
    far = x < -1400.0
    return 0.0 * v if far else (v + v * p) * power1 * power2, -1.0 if far else less_one


@formula
def logarithm(value, distance):
    """log(value) for 0 < value <= 1, where distance = 1 - value has digits that value lacks."""
    # value = 2**k m, with m between sqrt(1/2) and sqrt(2).
    k = (np.float64(value).view(np.int64) - BITS_OF_ROOT_HALF) >> 52
    m = np.int64(np.float64(value).view(np.int64) - (k << 52)).view(np.float64)
    above, below = (-distance, 2.0 - distance) if k == 0 else (m - 1.0, m + 1.0)
    # log(m) = 2 artanh(s), |s| < 0.172.
    s = above / below
    q = s * s
    q2 = q * q
    q4 = q2 * q2
    low = (1.0 / 3.0 + q * (1.0 / 5.0)) + q2 * (1.0 / 7.0 + q * (1.0 / 9.0))
    middle = (1.0 / 11.0 + q * (1.0 / 13.0)) + q2 * (1.0 / 15.0 + q * (1.0 / 17.0))
    high = (1.0 / 19.0 + q * (1.0 / 21.0)) + q2 * (1.0 / 23.0)
    p = low + q4 * (middle + q4 * high)
    k = np.int64(k + BITS_OF_TO_INTEGER).view(np.float64) - TO_INTEGER
    return k * LN2_HIGH + (2.0 * (s + s * (q * p)) + k * LN2_LOW)
