"""The n-th state of the 3D map, and the state of the flow at time t, without iterating.

Section 4 of the paper, in forms that cancel nowhere: next to the line X = 0, next to t = 1 and on
it. All is in the dimensionless coordinates (X, Y) of `coordinates`.
"""

import numpy as np

from .canonical_map import ZERO_TO_ROUNDING
from .integrals import level
from .jit import formula


@formula
def rate(X, Y, lost):
    """The constants of an orbit of the map: T, 1 - T**2, r = (1 - T)/(1 + T) and log |r|."""
    T = level(X, Y)
    complement = ((1.0 - Y) - lost) * ((1.0 + Y) + lost) / (1.0 + 0.5 * X * X)
    r = complement / ((1.0 + T) * (1.0 + T))
    # Where |r| is not small log |r| is, and r does not hold its digits.
    distance = 2.0 * min(T, 1.0) / (1.0 + T)
    if distance < 0.75:
        log_r = np.log1p(-distance)
    else:
        log_r = np.log(abs(r)) if r != 0.0 else -1e300  # so that r**0 = 1 on the critical line
    return T, complement, r, log_r


@formula
def power_of_ratio(r, log_r, n):
    """r**n; n is an integer where r is negative."""
    power = np.exp(n * log_r)
    return -power if r < 0.0 and n % 2.0 == 1.0 else power


@formula
def point(T, u, v, k, m):
    """X = m T u v / (u**2 + k v**2) and Y = T (k v**2 - u**2) / (u**2 + k v**2)."""
    size = max(abs(u), abs(v))
    u, v = u / size, v / size
    first, second = u * u, k * v * v
    total = first + second
    if not abs(total) > ZERO_TO_ROUNDING * (first + abs(second)):
        return np.nan, np.nan  # the orbit is at infinity
    return m * T * u * v / total, T * (second - first) / total


@formula
def follow(X, Y, T, complement, c, r, factor, factor_before):
    """The point where factor = r**n, factor_before = r**(n - 1) and c = 1 / (1 + T)**2."""
    if Y < 0.0:
        return point(T, T - Y, factor * X, 0.5 * complement, 2.0)
    return point(T, X, factor_before * (T + Y), 2.0 * c * r, 4.0 * c)


@formula
def map_point(X, Y, T, complement, r, log_r, n):
    """State n, not 0, of the orbit of the map through (X, Y); NaN where there is none."""
    if abs(Y) >= 1.0 and n != np.floor(n):
        return np.nan, np.nan  # beyond t = 1 nothing lies between two states
    # The inverse map is the map with Y reversed.
    backwards = n < 0.0
    if backwards:
        Y, n = -Y, -n
    if X == 0.0 and Y != 1.0:
        X_n, Y_n = X, Y
    else:
        X_n, Y_n = follow(
            X,
            Y,
            T,
            complement,
            1.0 / ((1.0 + T) * (1.0 + T)),
            r,
            power_of_ratio(r, log_r, n),
            power_of_ratio(r, log_r, n - 1.0),
        )
    return X_n, -Y_n if backwards else Y_n


@formula
def flow_point(X, Y, time):
    """The flow X' = 2 X Y, Y' = -X**2 of equation (s1), where (X, Y) are taken with eps = 1."""
    if X == 0.0:
        return X, Y
    backwards = time < 0.0
    if backwards:
        Y, time = -Y, -time
    K = np.hypot(np.sqrt(0.5) * X, Y)
    decay = np.exp(-2.0 * K * time)
    X_t, Y_t = follow(X, Y, K, 1.0, 1.0, 1.0, decay, decay)
    return X_t, -Y_t if backwards else Y_t
