"""States of an orbit that rests or passes: w after n steps, and omega from (c, s) = (w, 1).

`closed_form` explains the symbols, and computes the constants of orbits.
"""

from .._jit import formula, select, two_product
from .closed_form import NO_POWER
from .elementary import exponential, scaled, smaller

# Larger numbers of steps and longer times are replaced by this: `two_product` does not overflow.
LARGEST_TIME = 2.0**990
# Numbers of steps above this are not known to be even or odd.
LARGEST_COUNT = 2.0**53
# Squares of smaller w and s are negligible; if subnormal, they would be slow.
NO_SQUARE = 1e-100


@formula
def power_of_ratio(n, steps):
    """p and an integer `power` for which |r|**n = (1 + p) 2**power."""
    x, lost = two_product(n, steps.log_r)
    lost = lost + n * steps.log_lost
    endless = x < NO_POWER
    return exponential(select(endless, NO_POWER, x), select(endless, 0.0, lost))


@formula
def pair(n, steps):
    """(c, s) after n steps."""
    p, power = power_of_ratio(smaller(n, LARGEST_TIME) - steps.lag, steps)
    return scaled(steps.v + steps.v * p, power + steps.power), 1.0


@formula
def growth(n, steps):
    """The pair that takes (c, s) n steps further by `combined`."""
    p, power = power_of_ratio(n, steps)
    return scaled(1.0 + p, power), 0.0


@formula
def combined(c, s, next_c, next_s, square):
    """(c, s) after the steps of two pairs."""
    return c * next_c, 1.0


@formula
def squarable(v):
    """v, or 0 if its square is negligible."""
    return select(abs(v) > NO_SQUARE, v, 0.0)


@formula
def omega_of(c, s, forms):
    """omega, without the factor 2**power_left."""
    cc, ss = c * squarable(c), s * squarable(s)
    cs = c * s
    inverse = 1.0 / ((forms.d11 * cc + forms.d12 * cs) + forms.d22 * ss)
    return (
        ((forms.x1 * cc + forms.y1 * cs) + forms.z1 * ss) * inverse,
        ((forms.x2 * cc + forms.y2 * cs) + forms.z2 * ss) * inverse,
    )
