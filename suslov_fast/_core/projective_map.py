"""The 3D map in homogeneous coordinates X = p/q, Y = s/q: several steps for one division."""

from .jit import formula


@formula
def projective_step(p, q, s):
    """Equation (xy1) cleared of denominators."""
    t = q - s
    square = p * p
    return p * (q + s), q * t + square, s * t - square


@formula
def projective_pair(X, Y):
    """Two steps of a tame orbit at the price of one division."""
    p, q, s = projective_step(X, 1.0, Y)
    p, q, s = projective_step(p, q, s)
    r = 1.0 / q
    return p * r, s * r
