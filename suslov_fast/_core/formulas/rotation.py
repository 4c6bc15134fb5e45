"""Rotations as unit quaternions (w, x, y, z)."""

import numpy as np

from ..jit import formula


@formula
def turned(w, x, y, z, angle1, angle2, angle3):
    """A rotation followed by cay(S) in the body, where S is the matrix of the vector `angle`.

    cay(S) = (Id - S/2)**-1 (Id + S/2) is the quaternion (1, angle/2) over its length.
    """
    b1, b2, b3 = 0.5 * angle1, 0.5 * angle2, 0.5 * angle3
    w, x, y, z = (
        w - x * b1 - y * b2 - z * b3,
        x + w * b1 + y * b3 - z * b2,
        y + w * b2 + z * b1 - x * b3,
        z + w * b3 + x * b2 - y * b1,
    )
    length = np.sqrt(w * w + x * x + y * y + z * z)
    return w / length, x / length, y / length, z / length


@formula
def matrix(w, x, y, z):
    """The rotation matrix of a unit quaternion, row by row."""
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
