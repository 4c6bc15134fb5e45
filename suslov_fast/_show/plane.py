"""Curves in the plane (Omega1, Omega2): the steady states, and levels of F and of the energy."""

from __future__ import annotations

import numpy as np

from .._bodies.body_3d import Suslov3D
from .._bodies.body_gyrostat import SuslovGyrostat
from .._checks import FloatArray, instance
from .._states.conserved import energy
from .._states.paper_coordinates import from_xy


def half_angle(body: Suslov3D | SuslovGyrostat) -> tuple[complex, float]:
    """Complex g = I13 / sqrt(I1) + i I23 / sqrt(I2), and k, of a single body that can move.

    With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, l = k + Re(conj(g) z), e = eps / (2 sqrt(I1 I2)),
    the levels of F are abs(z) / sqrt(1 + e**2 l**2) = R, and psi = arg(z / (1 - i e l)) - arg(g) is
    the phase on a level.
    """
    instance("body", body, (Suslov3D, SuslovGyrostat))
    k = getattr(body, "k", 0.0)
    if body.shape or not (body.I13 or body.I23 or k):
        raise ValueError(f"body: expected a single one with I13 or I23 other than 0, got {body}")
    return complex(body.I13 / np.sqrt(body.I1), body.I23 / np.sqrt(body.I2)), float(k)


def on_level(body: Suslov3D | SuslovGyrostat, eps: float, R: float, psi: FloatArray) -> FloatArray:
    """States (N, 2) on the level R of the first integral, at phases psi (N,)."""
    g, k = half_angle(body)
    e, turn = 0.5 * eps / np.sqrt(body.I1 * body.I2), g / abs(g) if g else 1.0
    A = R * abs(g)
    z = R * turn * ((1 - 1j * e * k) * np.exp(1j * psi) - 1j * e * A) / (1 - e * A * np.sin(psi))
    return np.stack([z.real / np.sqrt(body.I1), z.imag / np.sqrt(body.I2)], axis=-1)


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
