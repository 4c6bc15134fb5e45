"""Curves in the plane (Omega1, Omega2): the steady states, and levels of F and of the energy."""

from __future__ import annotations

import numpy as np

from .._bodies.three import Suslov3D
from .._checks import FloatArray, instance
from .._states.conserved import energy
from .._states.coordinates import from_xy


def repelling_direction(body: Suslov3D) -> FloatArray:
    """Direction of the repelling half of the line of steady states, for eps > 0."""
    instance("body", body, Suslov3D)
    if body.shape or (body.I13 == 0 and body.I23 == 0):
        raise ValueError(f"body: expected a single one with I13 or I23 other than 0, got {body}")
    direction: FloatArray = np.array([body.I23, -body.I13]) / np.hypot(body.I13, body.I23)
    return direction


def level_curves(body: Suslov3D, eps: float, t: float, reach: float = 3.0) -> list[FloatArray]:
    """Branches, as states (N, 2), of the curve of criticality t."""
    a = body.I1 * body.I2
    units = np.array([np.sqrt(2.0 * a), 2.0 * a]) / eps
    return [from_xy(body, np.stack(branch, axis=-1) * units) for branch in conic(t, reach)]


def conic(t: float, reach: float = 3.0) -> list[tuple[FloatArray, FloatArray]]:
    """Branches of X**2 (1 - t**2) / 2 + Y**2 = t**2.

    Unbounded branches are cut off at sinh(reach) times their width.
    """
    if t == 1.0:
        x = np.sinh(reach) * np.array([-1.0, 1.0])
        return [(x, np.full(2, y)) for y in (-1.0, 1.0)]
    width = t * np.sqrt(2.0 / abs(1.0 - t * t))
    if t < 1.0:
        angle = np.linspace(0.0, 2.0 * np.pi, 300)
        return [(width * np.cos(angle), t * np.sin(angle))]
    s = np.linspace(-reach, reach, 300)
    return [(width * np.sinh(s), sign * t * np.cosh(s)) for sign in (-1.0, 1.0)]


def energy_level(body: Suslov3D, omega: FloatArray) -> FloatArray:
    """States (N, 2) with the energy of a state."""
    angle = np.linspace(0.0, 2.0 * np.pi, 300)
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    lengths = np.sqrt(energy(body, omega) / energy(body, directions))
    ellipse: FloatArray = lengths[:, np.newaxis] * directions
    return ellipse
