"""The 3D map in the dimensionless coordinates (X, Y): one map for every body and step size.

A state is held as (X, Z) with Z = c - Y. c is 0 where Y is small, and 1 where 1 - Y is, so that
neither is a difference of rounded numbers; it stays the same along an orbit.
"""

import numpy as np

from .._jit import formula, select
from .elementary import smaller

# A denominator this much smaller than its own terms is zero to rounding: the state is on a pole.
# Four units 2**-53 is what rounding of the body, the state and the terms may come to.
ZERO_TO_ROUNDING = 2.0**-50

# Where |X| is above this, which it is in the first state of an orbit or next to a pole, the new Y
# is not a small change of the old one.
LARGE = 2.0

# Arithmetic with subnormal numbers is four times slower or more: X**2 where |X| is below the first,
# and soon X itself where it is below the second.
SMALLEST_SQUARED, NEGLIGIBLE = 2.0**-510, 2.0**-960

# No such orbit gets to a larger |X| + |Z|: by H = (X**2 + 2 Y**2)/(2 + X**2),
# which is conserved, its X**2 is below 6 and its |Y| below 1.
LARGEST_BOUNDED = 5.0


@formula
def nan_at_zero(difference, size):
    """A difference of terms of a given size, or NaN if it is zero to rounding."""
    return difference + 0.0 / (abs(difference) > ZERO_TO_ROUNDING * size)


@formula
def shifted(Y, lost):
    """The shift c, and Z = c - (Y + lost)."""
    c = select(Y > 0.5, 1.0, 0.0)
    return c, (c - Y) - lost


@formula
def stays_bounded(X, Z, c, bound):
    """Test that an orbit has c = 0, -1 < Y <= 1/2 and no large X: it meets no pole and no bound."""
    return (c == 0.0) & (Z < 1.0) & (abs(X) < LARGE) & (bound > LARGEST_BOUNDED)


@formula
def has_subnormal_square(X):
    """Test that X**2 is subnormal; beside a state that moves at all it is 0 to rounding."""
    return abs(X) < SMALLEST_SQUARED


@formula
def without_negligible(X, Z, c):
    """X, or 0 where it is next to the smallest normal number on its way to a fixed point."""
    return select((abs(X) < NEGLIGIBLE) & (c < Z), 0.0, X)


@formula
def canonical_step(X, Z, c):
    """Equation (xy1) solved for the next state.

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

    Near X = 0, where the steady states (0, Y) reach up to the point (0, 1), less and less is taken
    for 0. While |Y| < 1 nothing is.
    """
    square = select(has_subnormal_square(X), 0.0, X) * X
    d = ((1.0 - c) + Z) + square
    return d, abs(d) > ZERO_TO_ROUNDING * smaller(1.0 + square, 2.0**20 * square)


@formula
def guarded_step(X, Z, c, bound):
    """`canonical_step` for any state: NaN where there is no next one or it is beyond a bound."""
    d, regular = denominator(X, Z, c)
    X0 = select(has_subnormal_square(X), 0.0, X)
    X_next = X * ((1.0 + c) - Z) / d
    Z_next = Z + X0 * X_next
    # c - (Y (1 - Y) - X**2) / (1 - Y + X**2), which then cancels nowhere.
    quotient = ((1.0 + c) * (X0 * X) + Z * ((1.0 - c) + Z)) / d
    Z_next = select(abs(X) > LARGE, quotient, Z_next)
    exists = regular & (abs(X_next) + abs(Z_next) < bound)
    return select(exists, X_next, np.nan), select(exists, Z_next, np.nan)
