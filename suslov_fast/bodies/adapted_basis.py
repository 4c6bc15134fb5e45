"""Bases adapted to a constrained axis, to which inertia tensors are rotated."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, wrong
from ..maps.ordered_algebra import eigenvectors, product

# Tolerance of the triangle inequality of moments, relative to the largest one: flat bodies have
# equality, and the parallel axis theorem loses a few digits.
_ROUNDING = 1e-12


def in_adapted_basis(I: ArrayLike, a: ArrayLike) -> tuple[Any, ...]:
    """Return I1, I2, I13, I23, I3 and the rotation; ValueError if no rigid body has the tensor."""
    tensors, rotation = adapted(I, a, 3)
    principal = np.linalg.eigvalsh(checks.real_array("I", I))
    largest = principal[..., -1]
    bad = principal[..., 0] + principal[..., 1] - largest < -_ROUNDING * largest
    _refuse("I", bad, f"is of no rigid body (triangle inequality): {_CONVENTIONS}")
    I1, I2, I3 = np.moveaxis(np.diagonal(tensors, axis1=-2, axis2=-1), -1, 0)
    return I1, I2, tensors[..., 0, 2], tensors[..., 1, 2], I3, rotation


# Part of error messages: CAD programs may print the tensor in other conventions.
_CONVENTIONS = "it is about the fixed point, with minus the integrals of x y dm off the diagonal"


def _refuse(name: str, bad: Any, what: str) -> None:
    """Raise ValueError, which names the first member of a batch where a condition is true."""
    if bad.any():
        member = f": member {checks.spell(checks.first_index(bad))}" if np.ndim(bad) else ""
        raise ValueError(f"{name}{member} {what}")


def adapted(I: ArrayLike, a: ArrayLike, n: int) -> tuple[FloatArray, FloatArray]:
    """Return inertia matrices (..., n, n) in adapted bases, and rotations to these bases.

    In an adapted basis the last axis is a, and the block of the other axes is diagonal.
    """
    matrix, axis = checks.square_matrices("I", I, n), checks.real_array("a", a)
    size = abs(matrix).max(axis=(-2, -1), initial=0.0)
    asymmetry = abs(matrix - matrix.swapaxes(-2, -1)).max(axis=(-2, -1), initial=0.0)
    how = "for printed digits pass (I + I.T) / 2, and I + np.triu(I, 1).T for an upper half"
    _refuse("I", ~(asymmetry <= 1e-12 * size), f"is not symmetric: {how}")
    least = np.linalg.eigvalsh(matrix).min(axis=-1, initial=np.inf)
    _refuse("I", ~(least > 1e-15 * size), f"is not positive definite: {_CONVENTIONS}")
    if axis.shape[-1:] != (n,):
        expected = f"{n} numbers, the components of an axis, or axes (..., {n})"
        raise wrong("a", expected, f"of the shape {axis.shape}")
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    _refuse("a", ~((length > 0) & (length < np.inf))[..., 0], "is not an axis of finite length")
    checks.common_shape({"I": matrix.shape[:-2], "a": axis.shape[:-1]})
    # Rotate the axis to e_n by the smallest angle. If it points down, rotate its opposite in this
    # way, and then make half a turn.
    sign = np.where(axis[..., -1:] < 0.0, -1.0, 1.0)
    up = sign * axis / length
    between = up + np.eye(n)[-1]
    to_last = np.eye(n) - between[..., :, None] * between[..., None, :] / between[..., -1:, None]
    to_last[..., -1, :] = up
    to_last[..., [0, -1], :] *= sign[..., None]
    rotated = product(product(to_last, matrix), to_last.swapaxes(-2, -1))
    vectors = eigenvectors(rotated[..., :-1, :-1])
    order = abs(vectors).argmax(axis=-2).argsort(axis=-1, kind="stable")
    vectors = np.take_along_axis(vectors, order[..., None, :], axis=-1)
    vectors *= np.where(np.diagonal(vectors, axis1=-2, axis2=-1) < 0.0, -1.0, 1.0)[..., None, :]
    turn = np.broadcast_to(np.eye(n), rotated.shape).copy()
    turn[..., :-1, :-1] = vectors.swapaxes(-2, -1)
    turn[..., 0, :] *= np.sign(np.linalg.det(turn))[..., None]
    tensors = product(product(turn, rotated), turn.swapaxes(-2, -1))
    # Products of inertia that should be 0 are as large as the rounding errors of the moments.
    largest = np.diagonal(tensors, axis1=-2, axis2=-1).max(axis=-1)[..., None]
    tensors[..., :-1, -1][abs(tensors[..., :-1, -1]) < 2.0**-50 * largest] = 0.0
    return tensors, product(turn, to_last) + 0.0  # + 0.0 turns -0.0 into 0.0
