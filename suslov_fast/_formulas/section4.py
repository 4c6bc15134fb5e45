"""The constants of Section 4 of the paper."""

import numpy as np

from .._jit import formula, select
from .coordinates import dimensionless, to_xy
from .elementary import logarithm
from .integrals import criticality, level

# T below this: artanh(T) / T is 1, and T may have lost digits.
TINY = 1e-150
# s above this: s**2 + 1 is s**2.
LARGE = 1e8


@formula
def inverse_hyperbolic_sine(s):
    size = abs(s)
    root = select(size > LARGE, size, np.sqrt(1.0 + size * size))
    # log(size + root), as minus the log of the inverse, which is 1 minus an accurate number.
    inverse = 1.0 / (root + size)
    less = select(size > LARGE, size, size + size * size / (root + 1.0))
    value = -logarithm(inverse, less * inverse)
    value = select(size < np.inf, value, size)
    return select(s < 0.0, -value, value)


@formula
def constants(I1, I2, I13, I23, k, eps, omega1, omega2):
    """Constants h, k1, k2 and t; k1 and k2 are NaN unless -1 < t < 1.

    With T = |t| and r = (1 - T) / (1 + T),
    k1 = -(2 / eps) artanh(t) = sqrt(h / (I1 I2)) log(r) / T,
    and sinh(k2) = y / (|x| sqrt(I1 I2 (1 - T**2))).
    """
    t = criticality(I1, I2, I13, I23, k, eps, omega1, omega2)
    x, y = to_xy(I1, I2, I13, I23, k, eps, omega1, omega2)
    X, Y, lost, _ = dimensionless(I1, I2, I13, I23, k, eps, omega1, omega2)
    below = 1.0 + 0.5 * X * X
    h = 0.25 * (x * x + y / I1 * (y / I2)) / below
    T = level(X, Y)
    complement = ((1.0 - Y) - lost) * ((1.0 + Y) + lost) / below  # 1 - T**2
    inverse = 1.0 / (1.0 + T)
    log_r = logarithm(complement * inverse * inverse, 2.0 * (select(T < 1.0, T, 1.0)) * inverse)
    k1 = np.sqrt(h / (I1 * I2)) * (select(T > TINY, log_r / T, -2.0))
    k2 = inverse_hyperbolic_sine(y / (abs(x) * np.sqrt(I1 * I2 * complement)))
    k2 = select(h == 0.0, 0.0, k2)
    below_critical = abs(Y) < 1.0
    return h, select(below_critical, k1, np.nan), select(below_critical, k2, np.nan), t
