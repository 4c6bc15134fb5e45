"""The 3D map in the dimensionless coordinates (X, Y): one map for every body and step size.

A state is stored as (X, Z) with Z = c - Y. The constant c of an orbit is 0 where Y is small, and 1
where 1 - Y is small, so that neither is a difference of rounded numbers.
"""

import numpy as np

from .._jit import formula, select
from .elementary import smaller

# A denominator this much smaller than its own terms is zero to rounding: the state is on a pole.
# Rounding of the body, the state and the terms may amount to four units 2**-53.
ZERO_TO_ROUNDING = 2.0**-50

# Above this |X|, in the first state of an orbit or near a pole, the new Y is not a small change of
# the old one.
LARGE = 2.0

# Subnormal arithmetic is at least four times slower: X**2 is subnormal if |X| is below the first
# number, and X itself soon if it is below the second.
SMALLEST_SQUARED, NEGLIGIBLE = 2.0**-510, 2.0**-960

# Bound of |X| + |Z| of such orbits: by H = (X**2 + 2 Y**2)/(2 + X**2),
# which is conserved, its X**2 is below 6 and its |Y| below 1.
LARGEST_BOUNDED = 5.0


@formula
def nan_at_zero(difference, size):
    """Difference of terms of a given size, or NaN if it is zero to rounding."""
    return difference + 0.0 / (abs(difference) > ZERO_TO_ROUNDING * size)


@formula
def shifted(Y, lost):
    """Shift c, and Z = c - (Y + lost)."""
    c = select(Y > 0.5, 1.0, 0.0)
    return c, (c - Y) - lost


@formula
def stays_bounded(X, Z, c, bound):
    """Test that c = 0, -1 < Y <= 1/2 and X is not large: the orbit reaches no pole and no bound."""
    return (c == 0.0) & (Z < 1.0) & (abs(X) < LARGE) & (bound > LARGEST_BOUNDED)


@formula
def has_subnormal_square(X):
    """Test that X**2 is subnormal, which is negligible relative to a state that moves."""
    return abs(X) < SMALLEST_SQUARED


@formula
def without_negligible(X, Z, c):
    """X, or 0 if X is near the smallest normal number and converges to a fixed point."""
    return select((abs(X) < NEGLIGIBLE) & (c < Z), 0.0, X)


@formula
def canonical_step(X, Z, c):
    """Next state: equation (8) in the coordinates (X, Y), solved.

    X' = X (1 + Y) / (1 - Y + X**2),  Y' = Y - X X'.
    """
    X_next = X * ((1.0 + c) - Z) / (((1.0 - c) + Z) + X * X)
    return X_next, Z + X * X_next


@formula
def careful_step(X, Z):
    """`canonical_step` for c = 0 without subnormal squares, which are slow."""
    X0 = select(has_subnormal_square(X), 0.0, X)
    X_next = X * (1.0 - Z) / ((1.0 + Z) + X0 * X)
    return X_next, Z + X0 * X_next


@formula
def denominator(X, Z, c):
    """Return 1 - Y + X**2, and True if it is finite and differs from 0 beyond rounding.

    The threshold decreases towards X = 0, where steady states (0, Y) approach the point (0, 1).
    For |Y| < 1 nothing is taken for 0.
    """
    square = select(has_subnormal_square(X), 0.0, X) * X
    d = ((1.0 - c) + Z) + square
    return d, abs(d) > ZERO_TO_ROUNDING * smaller(1.0 + square, 2.0**20 * square)


@formula
def guarded_step(X, Z, c, bound):
    """`canonical_step` for any state: NaN if the next state does not exist or exceeds a bound."""
    d, regular = denominator(X, Z, c)
    X0 = select(has_subnormal_square(X), 0.0, X)
    X_next = X * ((1.0 + c) - Z) / d
    Z_next = Z + X0 * X_next
    # c - (Y (1 - Y) - X**2) / (1 - Y + X**2), which then cancels nowhere.
    quotient = ((1.0 + c) * (X0 * X) + Z * ((1.0 - c) + Z)) / d
    Z_next = select(abs(X) > LARGE, quotient, Z_next)
    exists = regular & (abs(X_next) + abs(Z_next) < bound)
    return select(exists, X_next, np.nan), select(exists, Z_next, np.nan)
