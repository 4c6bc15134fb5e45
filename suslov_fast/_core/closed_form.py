"""The n-th state of the 3D map, and the state of the flow at time t, without iterating.

Section 4 of the paper, in forms that cancel nowhere: next to the line X = 0, next to t = 1 and on
it. All is in the dimensionless coordinates (X, Y) of `coordinates`.

An orbit of the map has T = t, its `level`, and r = (1 - T)/(1 + T). With complement = 1 - T**2,

X_n = 2 T u v / (u**2 + k v**2),   Y_n = T (k v**2 - u**2) / (u**2 + k v**2),

where u = T - Y, v = X r**n, k = complement / 2, or, the same without cancellation for Y > 0,
u = X, v = (T + Y) r**(n-1), k = 2 r / (1 + T)**2, and X_n is twice as large and over (1 + T)**2.
Orbits of the flow obey this too, with K = sqrt(X**2 / 2 + Y**2) for T, exp(-2 K t) for r**n and for
r**(n-1), and 1 for all that T and r make up.
"""

import numpy as np

from .canonical_map import ZERO_TO_ROUNDING
from .elementary import is_integer, logarithm, times_exponential
from .integrals import level
from .jit import formula


@formula
def orbit_of_map(X, Y, lost):
    """The constants of an orbit of the map: T, 1 - T**2, 1 / (1 + T)**2, r and log |r|."""
    T = level(X, Y)
    complement = ((1.0 - Y) - lost) * ((1.0 + Y) + lost) / (1.0 + 0.5 * X * X)
    inverse = 1.0 / (1.0 + T)
    c = inverse * inverse
    r = c * complement
    log_r = logarithm(abs(r), 2.0 * min(T, 1.0) * inverse)
    # On the critical line, where r = 0, r**0 is 1 all the same.
    return T, complement, c, r, log_r if r != 0.0 else -1e300


@formula
def orbit_of_flow(X, Y):
    """What stands for them where the flow X' = 2 X Y, Y' = -X**2 of equation (s1) is followed."""
    size = abs(X) + abs(Y) + 1e-300
    X, Y = X / size, Y / size
    K = size * np.sqrt(0.5 * X * X + Y * Y)
    return K, 1.0, 1.0, 1.0, -2.0 * K


@formula
def square(w):
    """w**2 beside a square of 1, where what is subnormal is slow and does not count."""
    w = w if abs(w) > 1e-100 else 0.0
    return w * w


@formula
def ahead(X, Y, T, complement, c, r, lag):
    """The numbers u, v (where r**n is 1), k and m / T ahead of (X, Y), and the lag of r**n.

    lag is 1 for the map, and 0 for the flow, where r**n and r**(n - 1) are the same.
    """
    below = Y < 0.0
    u, v = T - Y if below else X, X if below else T + Y
    # An orbit from next to X = 0 lives where r**n is as small as X.
    lift = 2.0**500 if (abs(u) < 1e-150) & (abs(v) < 1e150) else 1.0
    k = 0.5 * complement if below else 2.0 * c * r
    return lift * u, lift * v, k, 2.0 if below else 4.0 * c, 0.0 if below else lag


@formula
def follow(T, u, v, k, m, exponent):
    """The point (X_n, Y_n), where r**n is exp(exponent); NaN where it is at infinity."""
    v = times_exponential(v, exponent)
    scale = 1.0 / max(abs(u), abs(v))
    u, v = u * scale, v * scale
    first, second = square(u), k * square(v)
    total = first + second
    inverse = T / total
    exists = abs(total) > ZERO_TO_ROUNDING * (first + abs(second))
    X, Y = m * u * v * inverse, (second - first) * inverse
    return X if exists else np.nan, Y if exists else np.nan


@formula
def orbit_point(X, Y, T, complement, c, r, log_r, lag, n):
    """The point n steps from (X, Y), or at time n of the flow; NaN where there is none."""
    # The inverse map is the map with Y reversed.
    sign = -1.0 if n < 0.0 else 1.0
    u, v, k, m, lag = ahead(X, sign * Y, T, complement, c, r, lag)
    power = abs(n) - lag
    odd = not is_integer(0.5 * power)
    v = -v if odd & (r < 0.0) else v
    X_n, Y_n = follow(T, u, v, k, m, power * log_r)
    # Beyond t = 1 there is nothing between two states.
    exists = (r > 0.0) | is_integer(abs(n))
    X_n, Y_n = X_n if exists else np.nan, Y_n if exists else np.nan
    still = (X == 0.0) & (sign * Y != 1.0)
    return X if still else X_n, Y if still else sign * Y_n
