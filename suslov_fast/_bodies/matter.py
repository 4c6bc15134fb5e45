"""Inertia tensors of physically realizable bodies."""

from __future__ import annotations

from collections.abc import Callable
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


def admissible_I3(
    I1: FloatArray, I2: FloatArray, I13: FloatArray, I23: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the open interval of I3 for which tr(T)/2 - T is positive definite; NaN where none is.

    With d = |I1 - I2|, m = min(I1, I2) and s = I3 - d the condition is s > 0 and

    f(s) = m - s / 2 - 2 A**2 / s - 2 B**2 / (s + 2 d) > 0,

    where A is the product of inertia that belongs to the larger of I1 and I2. f is concave: it has
    no root or two, one on each side of its maximum.
    """
    I1, I2, I13, I23 = np.broadcast_arrays(I1, I2, I13, I23)
    _, exponent = np.frexp(np.maximum(np.maximum(I1, I2), np.maximum(abs(I13), abs(I23))))
    I1, I2, I13, I23 = (np.ldexp(each, -exponent) for each in (I1, I2, I13, I23))
    d, m = abs(I1 - I2), np.minimum(I1, I2)
    A, B = np.where(I1 > I2, I13, I23), np.where(I1 > I2, I23, I13)
    # For d = 0 the two terms have the same pole, and are combined.
    A, B = np.where(d == 0, np.hypot(A, B), abs(A)), np.where(d == 0, 0.0, abs(B))

    def f(s: FloatArray) -> FloatArray:
        return m - 0.5 * s - _over(2.0 * A * A, s) - _over(2.0 * B * B, s + 2.0 * d)

    def slope(s: FloatArray) -> FloatArray:
        first, second = _over(A, s), _over(B, s + 2.0 * d)
        return 2.0 * (first * first + second * second) - 0.5

    zero, most = np.zeros_like(m), 2.0 * m
    with np.errstate(all="ignore"):
        top, _ = _bisected(lambda s: slope(s) > 0, zero, most)
        exists = f(top) > 0
        low, _ = _bisected(lambda s: f(s) < 0, zero, top)
        _, high = _bisected(lambda s: f(s) > 0, top, most)
        ends = [np.where(exists, np.ldexp(d + s, exponent), np.nan)[()] for s in (low, high)]
    return ends[0], ends[1]


def _over(v: FloatArray, w: FloatArray) -> FloatArray:
    """Return v / w, or 0 where v is 0."""
    return np.where(v == 0, 0.0, v / w)


def _bisected(
    holds: Callable[[FloatArray], NDArray[np.bool_]], low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the last number from low on for which a condition holds, and its successor."""
    start, stop = low.view(np.int64), high.view(np.int64)  # ordered as the numbers, which are >= 0
    for _ in range(64):
        middle = start + (stop - start) // 2
        inside = holds(middle.view(np.float64))
        start, stop = np.where(inside, middle, start), np.where(inside, stop, middle)
    return start.view(np.float64), stop.view(np.float64)
