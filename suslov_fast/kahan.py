"""Kahan's map of a system: its derivative, the matrix A, and the quantities that it conserves.

:func:`suslov_fast.iterate` and :func:`suslov_fast.step` take steps of the map.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .bodies.systems import BodyOrField
from .checks import FloatArray, Reals, first_index, spell
from .fields.terms import Terms, slopes_at, sums_at, with_one
from .keywords import public
from .maps.evaluation import evaluate
from .maps.formulas import eigenvalues_in_order
from .maps.map_records import Method, map_of
from .maps.problem import Problem, check

__all__ = ["invariant_density", "jacobian", "matrix", "modified_energy", "multipliers"]
# `multipliers` takes x as a fixed point if each |f_i(x)| is at most _FIXED times the sum of the
# moduli of its terms, or if a step of Newton's method for f = 0 is at most _FIXED times |x|.
_FIXED = 1e-8


def __dir__() -> list[str]:
    return __all__


def _map_of(system: Any, method: str) -> Any:
    """Return the record of Kahan's map of a system; TypeError for a `Map`."""
    map = map_of(system, method)
    _ = map.body._has_eps or system._field  # this raises an error for a `Map`
    return map


def _value(name: str, system: Any, x: Any, eps: Any, method: str = "auto") -> Any:
    """Return the value of the formula `name` of the map."""
    map = _map_of(system, method)
    return evaluate(map.formulas[name], map, system, x, eps)


@public
def jacobian(
    system: BodyOrField, x: ArrayLike, /, eps: Reals, *, method: Method = "auto"
) -> FloatArray:
    """Return the derivative of a step of the map: d(x_next)_i / dx_j is in row i and column j.

    For Kahan's map it is A(x; eps)**-1 A(x_next; -eps), where A is the :func:`matrix`. For the
    methods of order 4, 6 and 8 it is the product of the derivatives of all sub-steps.

    Parameters
    ----------
    system : Field, Suslov3D or SuslovND
        A single field or body, or a batch.
    x : array_like(float, shape=(..., D))
        States of a field, or angular velocities of a body; NaN gives NaN.
    eps : array_like(float, shape=(...))
        Step size in time; a step of -eps undoes a step of eps.
    method : str
        As in :func:`suslov_fast.iterate`.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        NaN for a state on a pole of the map; one :class:`suslov_fast.IntegrationWarning` counts
        these states.

    Examples
    --------
    >>> from suslov_fast import Field, kahan
    >>> field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> kahan.jacobian(field, [1.0, 0.5], eps=0.2).round(6)
    array([[ 1.093638, -0.221485],
           [ 0.105205,  0.999397]])
    """
    return _value("jacobian", system, x, eps, method)


@public
def matrix(system: BodyOrField, x: ArrayLike, /, eps: Reals) -> FloatArray:
    """Return the matrix A of the linear system that a step of Kahan's map solves.

    A = 1 - (eps / 2) f'(x), and A (x_next - x) = eps f(x), where f is the right-hand side. The
    map has a pole where det A = 0. For a body without a rotor A x_next = x. Dragovic and Gajic,
    arXiv:0807.2966, give A before equation (5), and for n dimensions in equation (16).

    Parameters
    ----------
    system, x, eps
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float, shape=(..., D, D))
        A, dimensionless.

    Examples
    --------
    >>> from suslov_fast import Field, kahan
    >>> field = Field(lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1]), 2)
    >>> kahan.matrix(field, [1.0, 0.5], eps=0.2)
    array([[ 0.95,  0.1 ],
           [-0.05,  1.  ]])
    """
    return _value("matrix", system, x, eps)


@public
def modified_energy(system: BodyOrField, x: ArrayLike, /, eps: Reals) -> FloatArray:
    """Return the modified energy, which the map conserves; for small eps it is near the energy.

    For a field with a Hamiltonian H the modified energy is H + (eps / 3) grad H . A**-1 f, with the
    right-hand side f and the :func:`matrix` A. The map conserves it exactly.

    For a body with the energy E it is E**2 / (E + eps**2 S / 8), where S is the sum of J_i f_i**2;
    in three dimensions J = (I1, I2). The map conserves it exactly if the body has a known
    ``first_integral`` F: in three dimensions the modified energy is 2 I1 I2 F. For other bodies the
    modified energy varies, by an amount of order eps**4.

    Methods of higher order do not conserve it, because they combine steps of several sizes.

    Parameters
    ----------
    system, x, eps
        As in :func:`jacobian`; a field must be made by ``Field.from_hamiltonian``.

    Returns
    -------
    ndarray(float, shape=(...))
        In units of the energy. NaN for a state of a field on a pole of the map; one
        :class:`suslov_fast.IntegrationWarning` counts these states.

    Notes
    -----
    For fields: Celledoni, McLachlan, Owren and Quispel, arXiv:1209.1164.

    Examples
    --------
    >>> from suslov_fast import Field, iterate, kahan
    >>> well = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, 2)
    >>> orbit = iterate(well, [0.5, 0.0], eps=0.1, steps=100_000).states
    >>> H = kahan.modified_energy(well, orbit, eps=0.1)
    >>> bool(abs(H - H[0]).max() < 1e-12)
    True
    """
    return _value("modified_energy", system, x, eps)


@public
def invariant_density(system: BodyOrField, x: ArrayLike, /, eps: Reals) -> FloatArray:
    """Return the density rho of an invariant measure: rho(x_next) det(jacobian at x) = rho(x).

    For a field with a Hamiltonian rho = 1 / det A, with the :func:`matrix` A. For a body in three
    dimensions rho = 1 / (l (4 I1 I2 + eps**2 l**2)), where l = I13 Omega1 + I23 Omega2 + k.

    In n dimensions rho = 1 if I = 0. Otherwise rho is known if :meth:`suslov_fast.SuslovND.reduced`
    returns a body with two components, or with three components and only one entry of I other than
    0. For three components (w1, w2, w3) and I = (I1, 0, 0) rho = 1 / (w2 w3 (1 - (eps I1)**2 (J1
    w1**2 - (J3 - J2) (w2**2 - w3**2)) / (4 J1 J2 J3))). If the reduction replaces a vector of k
    dimensions by its length r, rho has the further factor r**(1 - k); for odd k > 1 the identity
    above then holds up to a sign.

    Methods of higher order do not have these measures.

    Parameters
    ----------
    system, x, eps
        As in :func:`jacobian`. With eps = 0 the continuous motion conserves the measure.

    Returns
    -------
    ndarray(float, shape=(...))
        For a field dimensionless, and infinite at poles. For a body in three dimensions in units
        of 1 / (omega * inertia**3), with the sign of l, and infinite where l = 0. For the formula
        with w2 and w3 in units of 1 / omega**2.

    Raises
    ------
    NotIntegrableError
        If no invariant measure is known for the body.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, kahan
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(kahan.invariant_density(body, [1.0, 0.5], eps=0.2).round(9))
    -0.096052391
    """
    return _value("invariant_density", system, x, eps)


@public
def multipliers(
    system: BodyOrField, x: ArrayLike, /, eps: Reals, *, method: Method = "auto"
) -> FloatArray:
    """Return the multipliers of fixed points: the eigenvalues of the derivative of the map.

    A fixed point is stable if all moduli are below 1. For each eigenvalue mu of f' Kahan's map has
    the multiplier (1 + eps mu / 2) / (1 - eps mu / 2). A method of order 4, 6 or 8 has the product
    of these numbers over its sub-steps. At the steady state omega = c I of a body in n dimensions
    mu = c s, where s is an eigenvalue of ``J**-1 (|I|**2 Id - I I^T)``.

    Parameters
    ----------
    system
        As in :func:`jacobian`.
    x : array_like(float, shape=(..., D))
        Fixed points of the map: equilibria of a field, or steady states of a body.
    eps, method
        As in :func:`jacobian`.

    Returns
    -------
    ndarray(float or complex, shape=(..., D))
        Sorted by decreasing modulus; of a conjugate pair the number with Im > 0 is first. Complex
        for fields and for bodies with a rotor. Real for other bodies, with the multiplier 1 along
        their line of steady states. Infinite at a pole.

    Raises
    ------
    ValueError
        If x is not a fixed point: a component of f(x) exceeds 1e-8 of the sum of the moduli of its
        terms, and a step of Newton's method moves x by more than 1e-8 of ``max abs(x)``. For other
        states use :func:`jacobian`.

    Examples
    --------
    The equilibrium of a damped oscillator is stable:

    >>> from suslov_fast import Field, kahan
    >>> field = Field(lambda x: (x[1], -x[0] - 0.1 * x[1]), "x v")
    >>> abs(kahan.multipliers(field, [0.0, 0.0], eps=0.2)).round(6)
    array([0.990148, 0.990148])
    """
    checked = check(_map_of(system, method), system, x, eps, method=method, name="x")
    with np.errstate(all="ignore"):
        slopes = _slopes_at_fixed_points(checked)
        known = np.asarray(np.isfinite(slopes).all(axis=(-2, -1)))[..., np.newaxis]
        slopes = np.where(known[..., np.newaxis], slopes, 0.0)
        Y = np.asarray(checked.eps)[..., np.newaxis] * checked.map.eigenvalues(checked, slopes)
        values = checked.map.stages.multiply(0.5 * Y)
        values = np.where(np.broadcast_to(known, (*checked.batch, 1)), values, np.nan)
        return eigenvalues_in_order(values, abs(values))


def _slopes_at_fixed_points(checked: Problem) -> FloatArray:
    """Return f' (..., D, D) at fixed points; raise ValueError if f is not 0 to rounding there."""
    x, terms = checked.x, Terms(*checked.body._terms)
    (i, j, k), values = terms
    y = with_one(x)
    products = values * y[..., j] * y[..., k]
    # f, and the sum of the moduli of its terms.
    f, sizes = (sums_at(i, each, x.shape[-1]) for each in (products, abs(products)))
    derivative = slopes_at(terms, x)
    moves = ~((abs(f) <= _FIXED * sizes) & (sizes < np.inf)) & ~np.isnan(x)
    if moves.any():
        moves &= ~_has_short_step(f, sizes, derivative, x)[..., np.newaxis]
    if moves.any():
        moves = np.broadcast_to(moves.any(axis=-1), checked.batch)
        text = f"{checked.name} is not a fixed point"
        if checked.batch:
            where = spell(first_index(moves))
            text = f"{checked.name}: states that are not fixed points, first: {where}"
        raise ValueError(
            f"{text}: use kahan.jacobian for the derivative there; "
            "for a periodic orbit see periodic_orbit"
        )
    return derivative


def _has_short_step(f: Any, sizes: Any, slopes: Any, x: Any) -> Any:
    """Return True for states at which the step d of Newton's method, f' d = f, is short."""
    known = np.isfinite(slopes).all(axis=(-2, -1)) & np.isfinite(f).all(axis=-1)
    is_known = known[..., np.newaxis, np.newaxis]
    slopes, f = np.where(is_known, slopes, 0.0), np.where(is_known, f[..., np.newaxis], 0.0)
    d = np.linalg.pinv(slopes, rcond=1e-13) @ f
    residual, x = abs(slopes @ d - f)[..., 0], np.broadcast_to(x, sizes.shape)
    is_small = abs(d[..., 0]).max(axis=-1) <= _FIXED * abs(x).max(axis=-1)
    return known & is_small & (residual <= _FIXED * sizes).all(axis=-1)
