"""The map of the Suslov gyrostat."""

import numpy as np

from .._formulas import gyrostat as formulas
from .._formulas.elementary import larger, two_to_the
from .._jit import formula, select
from . import codes
from .iterate import LARGEST, map_kernel
from .lanes import entry

# Rows of a block: constants b1, b2, K and c of the map, a bound of the state, the unit of omega.
_BOUND, _UNIT = 4, 5


@formula
def enter(parameters, omega, b, c, s, l):
    I1, I2, I13, I23, k, eps = parameters
    I1, I2, I13, I23, k, eps, M, P, Q, E = formulas.normal_gyrostat(
        entry(I1, b), entry(I2, b), entry(I13, b), entry(I23, b), entry(k, b), entry(eps, b)
    )
    b1, b2, K, shift, L, Z, omega1, omega2, _, _, W = formulas.enter(
        I1, I2, I13, I23, k, eps, M, P, Q, E, omega[b, 0], omega[b, 1]
    )
    unit = two_to_the(W)
    c[0, l], c[1, l], c[2, l], c[3, l] = b1, b2, K, shift
    c[_BOUND, l], c[_UNIT, l] = LARGEST / larger(unit, 1.0), unit
    missing = np.isnan(omega[b, 0] + omega[b, 1])
    s[0, l], s[1, l] = select(missing, np.nan, L), Z
    s[2, l], s[3, l] = omega1, omega2
    return codes.NONFINITE if missing else codes.OK, 1


@formula
def advance(c, s, l):
    L, Z, omega1, omega2 = formulas.step(
        c[0, l], c[1, l], c[2, l], c[3, l], s[0, l], s[1, l], s[2, l], s[3, l]
    )
    exists = larger(abs(omega1), abs(omega2)) < c[_BOUND, l]
    s[0, l], s[1, l] = select(exists, L, np.nan), Z
    s[2, l], s[3, l] = select(exists, omega1, np.nan), select(exists, omega2, np.nan)


@formula
def show(c, s, l, out, i):
    out[i], out[i + 1] = s[2, l] * c[_UNIT, l], s[3, l] * c[_UNIT, l]


@formula
def cause(c, s, l):
    d = formulas.denominator(c[0, l], c[1, l], c[2, l], c[3, l], s[0, l], s[1, l])
    return codes.SINGULAR if np.isnan(d) and np.isfinite(s[0, l] * s[0, l]) else codes.NONFINITE


gyrostat = map_kernel("gyrostat", 2, 4, enter, advance, show, cause)
