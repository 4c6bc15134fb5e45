"""Quantities of states of quadratic fields."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .._bodies.field import QuadraticField
from .._checks import FloatArray, wrong
from .._engine.arguments import States
from .._engine.evaluation import SLAB, by_slabs
from .._kernels.one_system import ROUNDS
from .of_fixed_points import in_order, of_rates, refuse_moving
from .step_derivatives import jacobian_by, next_states


def _of_states(
    function: Callable[..., FloatArray], axes: int, states: States, warn: bool = False
) -> FloatArray:
    """Return `function(body, x, eps)` with `axes` axes, in parts; NaN of states that are NaN."""
    most = max(SLAB // states.body.dimension**2, 1)
    with np.errstate(all="ignore"):
        found = by_slabs(function, axes, states, warn, most)
        unknown = np.isnan(states.omega).any(axis=-1)
    if not unknown.any():
        return found
    return np.where(np.reshape(unknown, (*unknown.shape, *(1,) * axes)), np.nan, found)[()]


def _terms(body: QuadraticField, x: FloatArray) -> tuple[Any, ...]:
    """Return i, j and k of the terms v x_j x_k of f_i, and v x_j, v x_k and v x_j x_k."""
    (i, j, k), v = body.terms
    x = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)
    return i, j, k, v * x[..., j], v * x[..., k], v * x[..., k] * x[..., j]


def _sums(terms: FloatArray, places: Any, size: int) -> FloatArray:
    """Return numbers (..., size), each the sum of the terms (..., T) at its place."""
    shape = *terms.shape[:-1], size
    first = size * np.arange(math.prod(shape[:-1]))[:, np.newaxis]
    found = np.bincount((first + places).ravel(), terms.ravel(), math.prod(shape))
    return np.reshape(found, shape)


def _vector_field(body: QuadraticField, x: FloatArray, eps: Any) -> FloatArray:
    i, *_, values = _terms(body, x)
    return _sums(values, i, body.dimension)


def _slopes(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    """Return (eps/2) f'(x)."""
    D = body.dimension
    i, j, k, along_k, along_j, _ = _terms(body, x)
    slopes = np.concatenate([along_j, along_k], axis=-1)
    slopes = _sums(slopes, np.concatenate([i * (D + 1) + j, i * (D + 1) + k]), D * (D + 1))
    half = 0.5 * np.asarray(eps)[..., np.newaxis, np.newaxis]
    return np.asarray(half * slopes.reshape(*slopes.shape[:-1], D, D + 1)[..., :D])


def _matrix(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    return np.eye(body.dimension) - _slopes(body, x, eps)


def _energy(body: QuadraticField, x: FloatArray, eps: Any) -> FloatArray:
    total = np.zeros(x.shape[:-1])
    try:
        for powers, c in sorted(body.hamiltonian.terms.items()):
            total += math.prod((x[..., i] for i in powers), start=np.asarray(c, np.float64))
    except OverflowError:
        expected = "a Hamiltonian with coefficients in the range of float64"
        raise wrong("body", expected, body) from None
    return total


def _modified_energy(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    """Return H(x) + (eps/3) grad H(x).A(x)**-1 f(x)."""
    gradient, following = _vector_field(body.gradient, x, None), next_states(body, x, eps)
    work: FloatArray = (gradient * (following - x)).sum(axis=-1)
    return _energy(body, x, None) + work / 3.0


def _invariant_density(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    """Return 1 / det A(x)."""
    assert body.hamiltonian
    return np.asarray(1.0 / np.linalg.det(_balanced(_matrix(body, x, eps))))


def _balanced(matrix: FloatArray) -> FloatArray:
    """Return matrices (..., D, D) in other units of the unknowns, as `one_system.balance`.

    In the units of the components LAPACK's choice of pivots may cost all digits of a determinant.
    """
    for _ in range(ROUNDS):
        size = abs(matrix) * (1.0 - np.eye(matrix.shape[-1]))
        of_row, of_column = size.max(axis=-1), size.max(axis=-2)
        # Changes of two units at a time, which are not to overshoot, are halved.
        power = np.trunc(0.25 * np.subtract(np.frexp(of_row)[1], np.frexp(of_column)[1]))
        power = np.where((of_row > 0.0) & (of_column > 0.0), power, 0.0).astype(np.intc)
        if not power.any():
            break
        matrix = np.ldexp(matrix, power[..., np.newaxis, :] - power[..., np.newaxis])
    return matrix


def _multipliers(states: States) -> Any:
    body, x = states.body, states.omega
    with np.errstate(all="ignore"):
        i, *_, terms = _terms(body, x)
        field, sizes = (_sums(each, i, body.dimension) for each in (terms, abs(terms)))
        refuse_moving(states, field, sizes)
        slopes = _slopes(body, x, np.asarray(states.eps))
        finite = np.asarray(np.isfinite(slopes).all(axis=(-2, -1), keepdims=True))
        found = of_rates(np.linalg.eigvals(np.where(finite, slopes, 0.0)).astype(complex))
        return in_order(states, np.where(finite[..., 0], found, np.nan))


_SLOPES = partial(_of_states, _slopes, 2)
QUANTITIES: dict[str, Callable[[States], FloatArray]] = {
    "energy": partial(_of_states, _energy, 0),
    "modified_energy": partial(_of_states, _modified_energy, 0),
    "invariant_density": partial(_of_states, _invariant_density, 0),
    "vector_field": partial(_of_states, _vector_field, 1),
    "jacobian": partial(_of_states, partial(jacobian_by, _SLOPES), 2, warn=True),
    "matrix": partial(_of_states, _matrix, 2),
    "slopes": _SLOPES,
    "multipliers": _multipliers,
}
