"""Sine, cosine and arctangent as plain arithmetic, bit-identical on all machines.

They are accurate to a few ulps.
"""

import math

import numpy as np

from .._jit import formula, select
from .elementary import TO_INTEGER, larger, smaller


@formula
def of_quarter_turns(q):
    """sin(pi q / 2) and cos(pi q / 2) for 0 <= q < 2**51, up to a common sign."""
    whole = (q + TO_INTEGER) - TO_INTEGER
    z = (0.5 * math.pi) * (q - whole)  # of a difference without error; |z| <= pi/4
    s = z * z
    # Taylor's series, the smallest terms first.
    sine = 1.0 - s / 156.0 * (1.0 - s / 210.0)
    sine = 1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0 * sine))
    sine = z - z * (s / 6.0 * (1.0 - s / 20.0 * sine))
    cosine = 1.0 - s / 132.0 * (1.0 - s / 182.0 * (1.0 - s / 240.0))
    cosine = 1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0 * cosine))
    cosine = 1.0 - s / 2.0 * (1.0 - s / 12.0 * cosine)
    odd = 0.5 * whole != (0.5 * whole + TO_INTEGER) - TO_INTEGER
    return select(odd, cosine, sine), select(odd, -sine, cosine)


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
