"""Scaling by powers of two of what NumPy computes from moments and products of inertia.

Kernels scale their own arguments: see `_formulas.units`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .body_nd import SuslovND


class InUnits(NamedTuple):
    """A body by J and I (..., m), as in n dimensions, and the momentum (..., 1) of a rotor.

    The units 2**moments of J and 2**products of the others are exponents (..., 1).
    """

    J: FloatArray
    I: FloatArray
    rotor: FloatArray
    moments: NDArray[np.intc]
    products: NDArray[np.intc]


def J_I_rotor(body: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return J and I (..., m), as in n dimensions, and the momentum (..., 1) of a rotor."""
    if isinstance(body, SuslovND):
        return *body.parameters, np.zeros(1)
    I1, I2, I13, I23, *k = body.parameters
    J = np.stack(np.broadcast_arrays(I1, I2), axis=-1)
    I = np.stack(np.broadcast_arrays(I23, np.negative(I13)), axis=-1)
    return J, I, np.asarray(k[0] if k else 0.0)[..., np.newaxis]


def in_units(body: Any) -> InUnits:
    """Return a body in units in which J and I are of the order of 1."""
    J, I, rotor = J_I_rotor(body)
    ends = (np.frexp(each(axis=-1, keepdims=True))[1] for each in (J.max, J.min))
    moments = sum(ends) // 2
    products = np.frexp(np.maximum(abs(I).max(axis=-1, keepdims=True), abs(rotor)))[1]
    J, I, rotor = np.ldexp(J, -moments), np.ldexp(I, -products), np.ldexp(rotor, -products)
    return InUnits(J, I, rotor, moments, products)
