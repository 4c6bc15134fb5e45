"""Rotations: unit quaternions (w, x, y, z) in three dimensions, rows of matrices in n.

A turn between two states is cay(S) = (Id - S/2)**-1 (Id + S/2), where S is eps times the matrix of
their mean angular velocity. It is stored as (unit, b), with the vector b of S/2, and 1 as `unit`;
if 1 is negligible relative to b, `unit` is 0, and b has any length.
"""

import numpy as np

from .._jit import formula, select

# Below this the square of b is in range; above it 1 + b**2 rounds to b**2, a half-turn.
HALF_TURN = 2.0**500


@formula
def mean(omega, following):
    """Mean of two components, without overflow."""
    return 0.5 * omega + 0.5 * following


@formula
def is_large(total):
    """Test that a turn is a half-turn to rounding, from the sum of all |b_i|; True for NaN."""
    return not total < HALF_TURN


@formula
def unit_of_large(largest):
    """Power of two that brings components up to `largest`, of large turns, into range."""
    return select(largest > 2.0**300, 2.0**-600, select(largest < 2.0**-300, 2.0**600, 1.0))


@formula
def turn_between(eps, omega1, omega2, next1, next2):
    """(unit, b1, b2) of the turn between two states; b3 = 0, as Omega3 is."""
    half = 0.5 * eps
    mean1, mean2 = mean(omega1, next1), mean(omega2, next2)
    b1, b2 = half * mean1, half * mean2
    large = is_large(abs(b1) + abs(b2))
    factor = np.copysign(unit_of_large(max(abs(mean1), abs(mean2))), eps)
    return (
        select(large, 0.0, 1.0),
        select(large, factor * mean1, b1),
        select(large, factor * mean2, b2),
    )


@formula
def turned(w, x, y, z, unit, b1, b2):
    """A rotation followed, in the body, by the turn of the quaternion (unit, b1, b2, 0)."""
    w, x, y, z = (
        w * unit - x * b1 - y * b2,
        x * unit + w * b1 - z * b2,
        y * unit + w * b2 + z * b1,
        z * unit + x * b2 - y * b1,
    )
    inverse = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
    return w * inverse, x * inverse, y * inverse, z * inverse


@formula
def rotation_matrix(w, x, y, z):
    """Rotation matrix of a unit quaternion, row by row."""
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@formula
def row_times_matrix(r1, r2, r3, w, x, y, z):
    """Product of a row and the matrix of a unit quaternion."""
    m11, m12, m13, m21, m22, m23, m31, m32, m33 = rotation_matrix(w, x, y, z)
    return (
        r1 * m11 + r2 * m21 + r3 * m31,
        r1 * m12 + r2 * m22 + r3 * m32,
        r1 * m13 + r2 * m23 + r3 * m33,
    )


# In n dimensions S/2 = b e_n^T - e_n b^T, and cay(S) = Id + 2 (S/2 + (S/2)**2) / (1 + |b|**2): each
# row of R is multiplied separately.


@formula
def turned_last(last, image, scale, unit, square):
    """Last number of a row; image = row.b over the others, scale = 2 / (unit**2 + |b|**2)."""
    return last + scale * (unit * image - square * last)


@formula
def turned_component(component, last, image, unit, scaled_b_i):
    """Another number of a row; scaled_b_i = scale b_i."""
    return component - (unit * last + image) * scaled_b_i
