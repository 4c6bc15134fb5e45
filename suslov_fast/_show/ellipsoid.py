"""Ellipsoids of inertia for drawings of bodies."""

from __future__ import annotations

import numpy as np

from .._bodies.body_3d import Suslov3D
from .._bodies.body_gyrostat import SuslovGyrostat
from .._bodies.matter import ellipsoid_of_inertia
from .._checks import FloatArray

_PARAMETERS = ("I1", "I2", "I13", "I23")


def ellipsoid(body: Suslov3D | SuslovGyrostat) -> tuple[FloatArray, FloatArray, float, bool]:
    """Return the ellipsoid of inertia of a single body; ValueError if there is none.

    These are the semi-axes, the largest being 1, their directions as columns, the corresponding I3,
    and True if it is admissible. I3 is that of the body, by default the middle of the interval of
    admissible values, or, if that is empty, a value with a positive definite inertia tensor.
    """
    I1, I2, I13, I23 = (float(getattr(body, each)) for each in _PARAMETERS)
    parameters = I1, I2, I13, I23
    low, high = Suslov3D(*parameters).admissible_I3()
    given = getattr(body, "I3", None)
    if given is not None:
        I3 = float(given)
    elif np.isfinite(low):
        I3 = float(0.5 * (low + high))
    else:
        I3 = max(I1, I2, 2.0 * (I13**2 / I1 + I23**2 / I2))
    return *ellipsoid_of_inertia(parameters, I3), I3, bool(low < I3 < high)


def sphere(turns: int = 64) -> FloatArray:
    """Return the points (3, turns / 2 + 1, turns + 1) of a grid on the unit sphere."""
    pole = 1e-3  # patches with two equal corners have no normal for shading
    v = np.linspace(np.pi - pole, pole, turns // 2 + 1)  # normals point outwards
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, turns + 1), v)
    return np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
