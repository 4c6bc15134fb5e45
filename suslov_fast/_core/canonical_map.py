"""The 3D map in the dimensionless coordinates (X, Y): one map for every body and step size."""

import numpy as np

from .jit import formula

# A denominator this much smaller than its own terms is zero to rounding: the state is on a pole.
# The terms carry a relative error of up to four units 2**-53.
ZERO_TO_ROUNDING = 2.0**-50


@formula
def denominator(X, Y):
    """1 - Y + X**2, and whether it differs from 0 beyond rounding and is finite."""
    square = X * X
    d = (1.0 - Y) + square
    return d, abs(d) > ZERO_TO_ROUNDING * square


@formula
def canonical_step(X, Y):
    """Equation (xy1) solved for the next state; NaN where there is none.

    X' = X (1 + Y) / (1 - Y + X**2),  Y' = Y - X X'.
    """
    d, regular = denominator(X, Y)
    X_next = X * (1.0 + Y) / d
    X_next = X_next if regular else np.nan
    return X_next, Y - X * X_next
