"""Action of the derivative of the map on small displacements, and the growth of products."""

from .._jit import formula, select
from .elementary import LN2_HIGH, LN2_LOW, larger, logarithm

# Products are rescaled by this, often enough to prevent overflow.
UNIT = 2.0**300
LOG2_OF_UNIT = 300.0
# X**2 is in range below this.
FAR = 2.0**500


@formula
def complement(X, Y, lost):
    """1 - t**2 of an orbit, accurate near t = 1."""
    # In the unit of |X| if that is above 1: its square is in range.
    unit = 1.0 / larger(abs(X), 1.0)
    X1 = X * unit
    product = (((1.0 - Y) - lost) * unit) * (((1.0 + Y) + lost) * unit)
    return product / (unit * unit + 0.5 * (X1 * X1))


@formula
def canonical_derivative(X, Z, c, G):
    """Entries (XX, XY, YX, YY) of the derivative of the canonical map, its determinant, and the
    next X.

    The determinant follows from the invariant density 1 / (X (2 + X**2)); it has no cancellation,
    and the entries only where they vanish. Near Y = -1, which orbits with t near 1 reach,
    1 + Y follows from G = 1 - t**2 = 2 (1 - Y**2) / (2 + X**2).
    """
    above, below = (1.0 + c) - Z, (1.0 - c) + Z  # 1 + Y and 1 - Y
    near = (abs(above) < 0.5) & (abs(X) < FAR)
    above = select(near, G * ((1.0 + 0.5 * (X * X)) / below), above)
    r = 1.0 / (below + X * X)
    X_r, above_r, below_r = X * r, above * r, below * r
    X_next = X * above_r
    return (
        above_r * (below_r - X * X_r),
        X_r * ((2.0 + X * X) * r),
        -2.0 * X_r * (above * below_r),
        below_r * below_r - 2.0 * (c - Z) * (X_r * X_r),
        above_r * ((2.0 + X_next * X_next) / (2.0 + X * X)),
        X_next,
    )


@formula
def times_matrix(h_i, I_i, omega_i, v_i, p, I_v, omega_v):
    """Component i of A(omega) v, for the matrix A of equation (16).

    h_i = eps / (2 J_i), p = I.omega, I_v = I.v and omega_v = omega.v.
    """
    return (1.0 - h_i * p) * v_i + h_i * (2.0 * I_i * omega_v - omega_i * I_v)


@formula
def multiplied(product, exponent, factor):
    """Product multiplied by |factor| UNIT**exponent, its first number kept in range."""
    product = product * abs(factor)
    large, small = product > UNIT, product < 1.0 / UNIT
    scaled = product * (select(large, 1.0 / UNIT, select(small, UNIT, 1.0)))
    return scaled, exponent + (select(large, 1.0, select(small, -1.0, 0.0)))


@formula
def mean_logarithm(product, exponent, power, steps):
    """log(2**power product UNIT**exponent) / steps, for 1/2 <= product <= 1."""
    twos = power + LOG2_OF_UNIT * exponent
    return (twos * LN2_HIGH + (logarithm(product, 1.0 - product) + twos * LN2_LOW)) / steps
