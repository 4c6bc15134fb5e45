"""The 3D map in the dimensionless coordinates (X, Y): one map for every body and step size."""

import numpy as np

from .jit import formula

# A denominator this much smaller than its own terms is zero to rounding: the state is on a pole.
# Four units 2**-53 is what rounding of the body, the state and the terms may come to.
ZERO_TO_ROUNDING = 2.0**-50


@formula
def denominator(X, Y):
    """1 - Y + X**2, and whether it differs from 0 beyond rounding and is finite.

    Near X = 0, where 1 - Y is exact and the steady states (0, Y) reach up to the point (0, 1), less
    and less is taken for 0. While |Y| < 1 nothing is.
    """
    square = X * X
    d = (1.0 - Y) + square
    return d, abs(d) > ZERO_TO_ROUNDING * min(1.0 + square, 2.0**20 * square)


@formula
def canonical_step(X, Y):
    """Equation (xy1) solved for the next state.

    X' = X (1 + Y) / (1 - Y + X**2),  Y' = Y - X X'.
    """
    X_next = X * (1.0 + Y) / ((1.0 - Y) + X * X)
    return X_next, Y - X * X_next


@formula
def guarded_step(X, Y):
    """`canonical_step`, and NaN where there is no next state."""
    _, regular = denominator(X, Y)
    X_next, Y_next = canonical_step(X, Y)
    return X_next if regular else np.nan, Y_next if regular else np.nan


# |X| below this keeps every product in range.
LARGE = 2.0**200


@formula
def tame(X, Y):
    """Whether the orbit never meets a pole and stays in range, so that no step needs a guard."""
    return abs(Y) < 1.0 and abs(X) < LARGE
