"""Units of Kahan's map of a quadratic field, x_next = x + eps A(x)**-1 f(x).

With x = X 2**k, quadratic coefficients are multiplied by 2**k, and constant ones by 2**-k.
"""

from .._jit import formula, select
from .elementary import exponent, within

# |eps q| lies between the inverse of 2 to this power and that power, where q is the largest
# quadratic coefficient: products of eps, q and states are in range if eps q x is.
FAR = 500.0


@formula
def unit_of_length(eps, q):
    """Return k, 0 unless |eps q| is out of range with it."""
    size = exponent(eps) + exponent(q)
    return select((eps != 0.0) & (q != 0.0), within(size, FAR) - size, 0.0)
