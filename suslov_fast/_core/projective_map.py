"""The 3D map in homogeneous coordinates X = p/q, Y = s/q: several steps for one division."""

from .jit import formula

# While |Y| < 1 no pole is near, so no step needs a test; below this X no square overflows.
LARGE = 2.0**200


@formula
def tame(X, Y):
    """Whether `projective_pair` may carry this trajectory: it never meets a pole."""
    return abs(Y) < 1.0 and abs(X) < LARGE


@formula
def projective_step(p, q, s):
    """Equation (xy1) cleared of denominators."""
    t = q - s
    square = p * p
    return p * (q + s), q * t + square, s * t - square


@formula
def projective_pair(X, Y):
    """Two steps of the map at the price of one division."""
    p, q, s = projective_step(X, 1.0, Y)
    p, q, s = projective_step(p, q, s)
    r = 1.0 / q
    return p * r, s * r
