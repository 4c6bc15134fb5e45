"""Curves in the plane (Omega1, Omega2), and ellipsoids of inertia, for drawings of bodies."""

from typing import Any, NamedTuple

import numpy as np

from ..bodies.rigid import Suslov3D, SuslovGyrostat
from ..checks import FloatArray, instance, wrong

BodyIn3D = Suslov3D | SuslovGyrostat
# Relative distance from t = 1 of levels drawn in place of nearer ones.
_NEAR_1 = 1e-6


class Plane(NamedTuple):
    """The plane of a single body and a step size.

    With z = sqrt(I1) Omega1 + i sqrt(I2) Omega2, l = k + Re(conj(g) z), e = eps / (2 sqrt(I1 I2)),
    the levels of F are abs(z) / sqrt(1 + e**2 l**2) = R, and psi = arg(z / (1 - i e l)) - arg(g) is
    the phase on a level.
    """

    I1: float
    I2: float
    I13: float
    I23: float
    k: float
    eps: float

    @property
    def g(self) -> complex:
        """The complex number I13 / sqrt(I1) + i I23 / sqrt(I2)."""
        return complex(self.I13 / np.sqrt(self.I1), self.I23 / np.sqrt(self.I2))

    @property
    def e(self) -> float:
        """The number eps / (2 sqrt(I1 I2))."""
        return float(0.5 * self.eps / np.sqrt(self.I1 * self.I2))

    def radius(self, omega: Any) -> float:
        """The modulus of z."""
        return float(np.hypot(np.sqrt(self.I1) * omega[0], np.sqrt(self.I2) * omega[1]))

    def on_level(self, R: float, psi: float | FloatArray) -> FloatArray:
        """States (..., 2) on the level R of the first integral, at phases psi (...)."""
        g, e = self.g, self.e
        A, turn = R * abs(g), g / abs(g) if g else 1.0
        turned = (1 - 1j * e * self.k) * np.exp(1j * psi) - 1j * e * A
        z = R * turn * turned / (1 - e * A * np.sin(psi))
        return np.stack([z.real / np.sqrt(self.I1), z.imag / np.sqrt(self.I2)], axis=-1)

    def level(self, R: float, reach: float = 3.0) -> list[FloatArray]:
        """Branches, as states (N, 2), of the level R, a conic; for eps = 0, of the energy.

        Unbounded branches are cut off at sinh(reach) times their width.
        """
        t = abs(self.e * R * self.g)
        if abs(t - 1.0) < _NEAR_1:  # two lines, which have no phases: the hyperbola next to them
            R, t = R * (1.0 + _NEAR_1) / t, 1.0 + _NEAR_1
        # With u = tan(phase / 2 - pi / 4) the curve is a quotient of quadratic polynomials, of
        # which the denominator is proportional to u**2 - v**2 or, where t < 1, u**2 + v**2.
        v = float(np.sqrt(abs((1.0 - t) / (1.0 + t))))
        if t < 1.0:
            branches = [v * np.tan(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 300))]
        else:
            s = np.tanh(np.linspace(-0.5 * reach, 0.5 * reach, 300))
            branches = [v * s, v / s]
        middle = np.copysign(0.5 * np.pi, self.eps)
        return [self.on_level(R, middle + 2.0 * np.arctan(u)) for u in branches]

    def meeting_phase(self, R: float) -> float:
        """The phase, up to its sign, where abs(l) is least on a level."""
        A = R * abs(self.g)
        return float(np.arccos(np.clip(-self.k / A, -1.0, 1.0))) if A else 0.0

    def steady_line(self) -> tuple[FloatArray, FloatArray]:
        """The steady state of least energy, and the direction of the half that repels."""
        least = -self.k / abs(self.g) ** 2 * np.array([self.I13 / self.I1, self.I23 / self.I2])
        direction = np.copysign(1.0, self.eps) * np.array([self.I23, -self.I13])
        return least + 0.0, direction / np.hypot(self.I13, self.I23)


def plane_of(body: BodyIn3D, eps: float) -> Plane:
    """The plane of a body, which must be a single one that does not rest in all states."""
    instance("body", body, BodyIn3D)
    if body.shape or not any(body.parameters[2:]):
        raise wrong("body", "a single one with I13 or I23 other than 0", body)
    return Plane(*(*body.parameters, eps))


def ellipsoid(body: BodyIn3D) -> tuple[FloatArray, FloatArray, float, bool]:
    """Semi-axes, the largest being 1, directions as columns, I3, and whether it is admissible.

    A body without I3 has the middle of the interval or, if that is empty, one of an ellipsoid.
    """
    I1, I2, I13, I23, _ = body.parameters
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
