"""The formulas of the n-dimensional problem, over arrays with components on the last axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._bodies.nd import SuslovND
from ._checks import FloatArray


def _dot(v: FloatArray, w: FloatArray) -> FloatArray:
    product: FloatArray = (v * w).sum(axis=-1, keepdims=True)
    return product


def slope(body: SuslovND, omega: FloatArray, following: FloatArray) -> FloatArray:
    """The right side of (dsn) over J and eps; where following = omega, that of (nsus1)."""
    p, p_next = _dot(body.I, omega), _dot(body.I, following)
    with np.errstate(all="ignore"):
        result: FloatArray = (
            0.5 * (p * following + p_next * omega) - body.I * _dot(omega, following)
        ) / body.J
    return result


def energy(body: SuslovND, omega: FloatArray) -> FloatArray:
    """Half the sum of J_i Omega_i**2."""
    with np.errstate(all="ignore"):
        total: FloatArray = 0.5 * (body.J * omega * omega).sum(axis=-1)
    return np.broadcast_to(total, np.broadcast_shapes(body.shape, total.shape))[()]


def modified_energy(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    """E**2 / (E + eps**2 f.Jf / 8), or 0 at rest."""
    E, f = energy(body, omega), slope(body, omega, omega)
    with np.errstate(all="ignore"):
        excess = 0.125 * eps * eps * (body.J * f * f).sum(axis=-1)
        result: FloatArray = np.where(E > 0, E / (1.0 + excess / E), 0.0 * (E + excess))
    return result[()]


def matrix(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    """A(omega) below (dsn)."""
    h = 0.5 * eps[..., np.newaxis, np.newaxis]
    I, J = body.I[..., np.newaxis], body.J[..., np.newaxis]
    column, row = omega[..., np.newaxis], omega[..., np.newaxis, :]
    I_row = body.I[..., np.newaxis, :]
    p = _dot(body.I, omega)[..., np.newaxis]
    with np.errstate(all="ignore"):
        result: FloatArray = (
            np.eye(body.dimension) * (1.0 - h * p / J) + h * (2.0 * I * row - I_row * column) / J
        )
    return result


def jacobian(
    body: SuslovND, omega: FloatArray, following: FloatArray, eps: FloatArray
) -> FloatArray:
    """A(omega; eps)**-1 A(omega_next; -eps); NaN where there is no next state."""
    exists = np.asarray(np.isfinite(following).all(axis=-1))[..., np.newaxis, np.newaxis]
    left = np.where(exists, matrix(body, omega, eps), np.eye(body.dimension))
    right = np.where(exists, matrix(body, following, -eps), np.nan)
    return np.linalg.solve(left, right)


def multipliers(body: SuslovND, c: FloatArray, eps: FloatArray) -> FloatArray:
    """(1 + eps c s / 2) / (1 - eps c s / 2) for the eigenvalues s of J**-1 (|I|**2 - I I^T)."""
    root = 1.0 / np.sqrt(body.J)
    I = body.I * root
    square = _dot(body.I, body.I)[..., np.newaxis]
    symmetric = square * np.eye(body.dimension) * (root**2)[..., np.newaxis] - (
        I[..., np.newaxis] * I[..., np.newaxis, :]
    )
    spectrum = np.linalg.eigvalsh(symmetric)
    with np.errstate(all="ignore"):
        Y = 0.5 * (eps * c)[..., np.newaxis] * spectrum
        result: FloatArray = (1.0 + Y) / (1.0 - Y)
    return result


def reaction(body: SuslovND, omega: FloatArray, following: FloatArray) -> FloatArray:
    """The lambda_ij of (nsus), made discrete as (dsn) is; where following = omega, (nsus)'s."""
    derivative = slope(body, omega, following)

    def outer(v: Any, w: Any) -> Any:
        return v[..., :, np.newaxis] * w[..., np.newaxis, :]

    with np.errstate(all="ignore"):
        product = 0.5 * (outer(omega, following) + outer(following, omega))
        difference = body.J[..., np.newaxis, :] - body.J[..., :, np.newaxis]
        result: FloatArray = (
            outer(derivative, body.I) - outer(body.I, derivative) - difference * product
        )
    return result
