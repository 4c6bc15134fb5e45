"""The n-th state of the 3D map, and the state of the flow at time t, without iterating.

Section 4 of the paper, in forms that cancel nowhere: next to the line X = 0, next to t = 1 and on
it. All is in the dimensionless coordinates (X, Y) of `coordinates`.

An orbit of the map has T = t, its `level`, and r = (1 - T)/(1 + T). With R = r**(2 n),

X_n = 2 T X r**n / D,   Y_n = T ((Y + T) R + Y - T) / D,   D = T (1 + R) - Y (1 - R),

which cancels nowhere while Y < 0, and only at a pole where Y >= 2 and |X| >= 1. Elsewhere the same
is taken from u = X, v = (T + Y) r**(n-1), k = 2 r / (1 + T)**2 and m = 4 / (1 + T)**2:

X_n = m T u v / (u**2 + k v**2),   Y_n = T (k v**2 - u**2) / (u**2 + k v**2).

Orbits of the flow obey this too, with K = sqrt(X**2 / 2 + Y**2) for T, exp(-2 K t) for r**n and for
r**(n-1), and 1 for all that T and r make up.
"""

import numpy as np

from ..jit import formula
from .canonical_map import ZERO_TO_ROUNDING
from .elementary import is_integer, logarithm, times_exponential
from .integrals import level


@formula
def orbit_of_map(X, Y, lost):
    """The constants of an orbit of the map: T, 1 / (1 + T)**2, r and log |r|."""
    T = level(X, Y)
    complement = ((1.0 - Y) - lost) * ((1.0 + Y) + lost) / (1.0 + 0.5 * X * X)
    inverse = 1.0 / (1.0 + T)
    c = inverse * inverse
    r = c * complement
    log_r = logarithm(abs(r), 2.0 * min(T, 1.0) * inverse)
    # On the critical line, where r = 0, r**0 is 1 all the same.
    return T, c, r, log_r if r != 0.0 else -1e300


@formula
def orbit_of_flow(X, Y):
    """What stands for them where the flow X' = 2 X Y, Y' = -X**2 of equation (s1) is followed."""
    size = abs(X) + abs(Y) + 1e-300
    X, Y = X / size, Y / size
    K = size * np.sqrt(0.5 * X * X + Y * Y)
    return K, 1.0, 1.0, -2.0 * K


@formula
def square(w):
    """w**2 beside a square of 1, where what is subnormal is slow and does not count."""
    w = w if abs(w) > 1e-100 else 0.0
    return w * w


@formula
def orbit_point(X, Y, T, c, r, log_r, lag, n):
    """The point n steps from (X, Y), or at time n of the flow; NaN where there is none.

    lag is 1 for the map, and 0 for the flow, where r**n and r**(n - 1) are the same.
    """
    # The inverse map is the map with Y reversed.
    sign = -1.0 if n < 0.0 else 1.0
    Y_0 = sign * Y
    direct = (Y_0 < 0.0) | ((Y_0 >= 2.0) & (abs(X) >= 1.0))
    power = abs(n) - (0.0 if direct else lag)
    odd = (not is_integer(0.5 * power)) & (r < 0.0)
    # An orbit from next to X = 0 lives where r**n is as small as X.
    u, v = X, T + Y_0
    lift = 2.0**500 if (abs(u) < 1e-150) & (abs(v) < 1e150) else 1.0
    v = 1.0 if direct else lift * v
    v, less_one = times_exponential(-v if odd else v, power * log_r)

    u = lift * u
    scale = 1.0 / max(abs(u), abs(v))
    u, w = u * scale, v * scale
    first, second = square(u), 2.0 * c * r * square(w)

    R = square(v)
    rest = -less_one * (2.0 + less_one)  # 1 - R
    D = T * (1.0 + R) - Y_0 * rest if direct else first + second
    size = T * (1.0 + R) + abs(Y_0) * rest if direct else first + abs(second)
    inverse = T / D
    X_n = (2.0 * X * v if direct else 4.0 * c * u * w) * inverse
    Y_n = (Y_0 * (1.0 + R) - T * rest if direct else second - first) * inverse
    # Otherwise the orbit is at infinity, or, beyond t = 1, between two states.
    exists = (abs(D) > ZERO_TO_ROUNDING * size) & ((r > 0.0) | is_integer(abs(n)))
    X_n, Y_n = X_n if exists else np.nan, Y_n if exists else np.nan
    still = (X == 0.0) & (Y_0 != 1.0)
    return X if still else X_n, Y if still else sign * Y_n
