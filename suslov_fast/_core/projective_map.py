"""The 3D map in homogeneous coordinates X = p/q, Y = -z/q: several steps for one division."""

from .jit import formula


@formula
def projective_step(p, q, z):
    """Equation (xy1) cleared of denominators."""
    t = q + z
    square = p * p
    return p * (q - z), q * t + square, z * t + square


@formula
def projective_pair(X, Z):
    """Two steps of a tame orbit at the price of one division."""
    p, q, z = projective_step(X, 1.0, Z)
    p, q, z = projective_step(p, q, z)
    r = 1.0 / q
    return p * r, z * r
