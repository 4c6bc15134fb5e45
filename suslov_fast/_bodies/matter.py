"""Inertia tensors of physically realizable bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, warn

# Rounding tolerance of the triangle inequality, which is an equality for flat bodies; a change of
# the basis of the tensor is included.
_ROUNDING = 1e-14


def _fits(moments: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Return where principal moments (..., 3), in order, obey the triangle inequalities."""
    largest = moments[..., 2]
    fits: NDArray[np.bool_] = moments[..., 0] + moments[..., 1] - largest >= -_ROUNDING * largest
    return fits


def warn_of_I3(body: Any) -> None:
    """Warn, once for a batch, of an I3 that no body has."""
    if body.I3 is None:
        return
    I1, I2, I13, I23, I3 = body.I1, body.I2, body.I13, body.I23, body.I3
    entries = np.broadcast_arrays(I1, 0.0, I13, 0.0, I2, I23, I13, I23, I3)
    tensors = np.stack(entries, axis=-1).reshape(-1, 3, 3)
    fits = _fits(np.linalg.eigvalsh(tensors / abs(tensors).max(axis=(1, 2), keepdims=True)))
    if not fits.all():
        least = entries[-1].reshape(-1)[~fits][0]
        warn(
            f"I3: expected one that a body with these parameters can have (see admissible_I3), "
            f"got {least}"
        )


def check_triangles(name: str, tensor: FloatArray) -> None:
    """Check the triangle inequalities of the principal moments of tensors (..., 3, 3)."""
    moments = np.linalg.eigvalsh(tensor)
    fits = _fits(moments)
    if not fits.all():
        wrong = np.broadcast_to(moments, (*fits.shape, 3))[~fits][0]
        raise ValueError(
            f"{name}: expected an inertia tensor that a body can have, no principal moment larger "
            f"than the sum of the others, got the principal moments {wrong.tolist()}"
        )


def shortest_rotation_to_last(axis: FloatArray) -> FloatArray:
    """Return the rotations of smallest angle that take unit axes (..., n) to e_n."""
    n = axis.shape[-1]
    # An axis that points down is first rotated by pi in the plane of e_1 and e_n.
    half_turn = np.eye(n)
    half_turn[0, 0] = half_turn[-1, -1] = -1.0
    down = axis[..., -1, np.newaxis, np.newaxis] < 0.0
    first = np.where(down, half_turn, np.eye(n))
    up = first @ axis[..., np.newaxis]
    s = up + np.eye(n)[:, -1:]
    rotation: FloatArray = np.eye(n) - s @ s.swapaxes(-2, -1) / s[..., -1:, :]
    rotation[..., -1, :] += 2.0 * up[..., 0]
    return rotation @ first
