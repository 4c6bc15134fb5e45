"""Solved bodies: those in n dimensions whose motion reduces to that of a body in three."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, first_index, spell
from .body_nd import SuslovND

# Rounding error of J and I, which from_mass_tensor rotates.
_ROUNDING = 1e-14


# What to use for bodies that are not solved.
_INSTEAD = {
    "exact": "iterate",
    "limits": "iterate",
    "flow": "vector_field with scipy.integrate.solve_ivp",
    "first_integral": "modified_energy",
    "criticality": "iterate, and compare with half the step size",
}


class NotIntegrableError(ValueError):
    """No closed form or first integral is known for this body."""


def is_solved(J: FloatArray, I: FloatArray, rounding: float = 0.0) -> NDArray[np.bool_]:
    """Return a mask of the bodies with J I = b I, and J = a orthogonal to I, up to `rounding`.

    All J are equal, or at most one component of I is not 0; for n = 3 every body is solved.
    """
    J, size = np.broadcast_arrays(J, abs(I))
    largest = size.max(axis=-1, keepdims=True)
    coupled = size > rounding * largest
    left_out = coupled & (coupled.sum(axis=-1, keepdims=True) == 1)
    low = np.where(left_out, np.inf, J).min(axis=-1)
    high = np.where(left_out, 0.0, J).max(axis=-1)
    solved: NDArray[np.bool_] = high * (1.0 - rounding) <= low
    solved |= (largest[..., 0] == 0.0) | (J.shape[-1] == 2)
    return solved


def are_solved(body: SuslovND) -> NDArray[np.bool_]:
    """Return a mask of the bodies of a batch that are solved, to rounding."""
    return is_solved(body.J, body.I, _ROUNDING)


def check_solved(body: SuslovND, function: str) -> None:
    """Raise an error that names the function unless all bodies are solved."""
    solved = are_solved(body)
    if not solved.all():
        which = spell(first_index(~np.atleast_1d(solved)))
        raise NotIntegrableError(
            f"{function}: expected a body with all J equal, or with I along one axis and all other "
            f"J equal; body {which} is not, and no closed form is known for it: "
            f"use {_INSTEAD[function]}"
        )
