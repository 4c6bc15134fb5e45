"""Curves in the plane (Omega1, Omega2), and ellipsoids of inertia, for drawings of bodies."""

from __future__ import annotations

import numpy as np

from ..bodies.rigid import Suslov3D, SuslovGyrostat
from ..checks import FloatArray, instance, wrong

BodyIn3D = Suslov3D | SuslovGyrostat
# Relative distance from t = 1 of levels drawn in place of nearer ones.
_NEAR_1 = 1e-6


def check_moving(body: BodyIn3D) -> None:
    """Check that a body is a single one that does not rest in all states."""
    instance("body", body, BodyIn3D)
    if body.shape or not (body.I13 or body.I23 or getattr(body, "k", 0.0)):
        raise wrong("body", "a single one with I13 or I23 other than 0", body)


def half_angle(body: BodyIn3D) -> tuple[complex, float]:
    """Complex g = I13 / sqrt(I1) + i I23 / sqrt(I2), and k, of a single body.

    With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, l = k + Re(conj(g) z), e = eps / (2 sqrt(I1 I2)),
    the levels of F are abs(z) / sqrt(1 + e**2 l**2) = R, and psi = arg(z / (1 - i e l)) - arg(g) is
    the phase on a level.
    """
    g = complex(body.I13 / np.sqrt(body.I1), body.I23 / np.sqrt(body.I2))
    return g, float(getattr(body, "k", 0.0))


def half_step(body: BodyIn3D, eps: float) -> float:
    """The number e = eps / (2 sqrt(I1 I2))."""
    return float(0.5 * eps / np.sqrt(body.I1 * body.I2))


def on_level(body: BodyIn3D, eps: float, R: float, psi: float | FloatArray) -> FloatArray:
    """States (..., 2) on the level R of the first integral, at phases psi (...)."""
    g, k = half_angle(body)
    e, A, turn = half_step(body, eps), R * abs(g), g / abs(g) if g else 1.0
    z = R * turn * ((1 - 1j * e * k) * np.exp(1j * psi) - 1j * e * A) / (1 - e * A * np.sin(psi))
    return np.stack([z.real / np.sqrt(body.I1), z.imag / np.sqrt(body.I2)], axis=-1)


def level(body: BodyIn3D, eps: float, R: float, reach: float = 3.0) -> list[FloatArray]:
    """Branches, as states (N, 2), of the level R, a conic; with a step size of 0, of the energy.

    Unbounded branches are cut off at sinh(reach) times their width.
    """
    t = abs(half_step(body, eps)) * R * abs(half_angle(body)[0])
    if abs(t - 1.0) < _NEAR_1:  # two lines, which have no phases: draw the hyperbola next to them
        R, t = R * (1.0 + _NEAR_1) / t, 1.0 + _NEAR_1
    # With u = tan(phase / 2 - pi / 4) the curve is a quotient of quadratic polynomials, of which
    # the denominator is proportional to u**2 - v**2 or, where t < 1, u**2 + v**2.
    v = float(np.sqrt(abs((1.0 - t) / (1.0 + t))))
    if t < 1.0:
        branches = [v * np.tan(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 300))]
    else:
        s = np.tanh(np.linspace(-0.5 * reach, 0.5 * reach, 300))
        branches = [v * s, v / s]
    middle = np.copysign(0.5 * np.pi, eps)
    return [on_level(body, eps, R, middle + 2.0 * np.arctan(u)) for u in branches]


def meeting_phase(A: float, k: float) -> float:
    """The phase, up to its sign, where abs(l) is least on a level with A = R abs(g)."""
    return float(np.arccos(np.clip(-k / A, -1.0, 1.0))) if A else 0.0


def steady_line(body: BodyIn3D) -> tuple[FloatArray, FloatArray]:
    """The steady state of least energy, and the direction of the half that repels for eps > 0."""
    g, k = half_angle(body)
    middle = -k / abs(g) ** 2 * np.array([body.I13 / body.I1, body.I23 / body.I2]) + 0.0
    return middle, np.array([body.I23, -body.I13]) / np.hypot(body.I13, body.I23)


def ellipsoid(body: BodyIn3D) -> tuple[FloatArray, FloatArray, float, bool]:
    """Return semi-axes, the largest being 1, directions as columns, I3, and if it is admissible.

    A body without I3 has the middle of the interval or, if that is empty, one of an ellipsoid.
    """
    I1, I2, I13, I23 = map(float, (body.I1, body.I2, body.I13, body.I23))
    low, high = Suslov3D(I1, I2, I13, I23).admissible_I3()
    if body.I3 is not None:
        I3 = float(body.I3)
    elif np.isfinite(low):
        I3 = float(0.5 * (low + high))
    else:
        I3 = max(I1, I2, 2.0 * (I13**2 / I1 + I23**2 / I2))
    moments, axes = np.linalg.eigh(np.array([[I1, 0, I13], [0, I2, I23], [I13, I23, I3]]))
    if not moments[0] > 0:
        expected = "one with a positive definite inertia tensor"
        raise wrong("I3", expected, f"{I3} and the principal moment {moments[0]:.3g}")
    return np.sqrt(moments[0] / moments), axes, I3, bool(low < I3 < high)
