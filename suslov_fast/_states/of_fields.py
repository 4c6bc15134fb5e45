"""Quantities of states of quadratic fields."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .._bodies.field import QuadraticField
from .._checks import FloatArray
from .._engine.arguments import States
from .._engine.evaluation import SLAB, by_slabs
from .decimals import modified_energy_and_density
from .step_derivatives import jacobian_by, next_states

# Results that may be this part of their terms, or less, are computed in decimals.
LOST = 2.0**-26
# Numbers below this part of others are small beside them.
UNEVEN = 2.0**-10


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
    sums = np.bincount((first + places).ravel(), terms.ravel(), math.prod(shape))
    return np.reshape(sums, shape)


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
    return np.asarray(half * slopes.reshape(*x.shape, D + 1)[..., :D])


def _matrix(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    return np.eye(body.dimension) - _slopes(body, x, eps)


def _energy(body: QuadraticField, x: FloatArray, eps: Any, of_term: Any = np.asarray) -> FloatArray:
    total = np.zeros(x.shape[:-1])
    for powers, c in sorted(body.hamiltonian.terms.items()):
        total += of_term(math.prod((x[..., i] for i in powers), start=float(c)))
    return total


def _modified_energy(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    """Return H(x) + (eps/3) grad H(x).A(x)**-1 f(x)."""
    gradient, following = _vector_field(body.gradient, x, None), next_states(body, x, eps)
    work = gradient * (following - x)
    energy: FloatArray = _energy(body, x, None) + work.sum(axis=-1) / 3.0
    # The first bound is the same for all states, and fast.
    largest, *others = (abs(each).max(initial=0.0) for each in (gradient, x, following))
    doubtful = np.asarray(~(LOST * largest * max(others) <= abs(energy)))
    if not doubtful.any():
        return energy
    # The error of a next state is relative to its largest component.
    some = np.maximum(abs(x[doubtful]), abs(following[doubtful])).max(axis=-1)
    some *= abs(gradient[doubtful]).max(axis=-1)
    terms = _energy(body, x[doubtful], None, abs)
    sizes = [abs(float(c)) for c in body.hamiltonian.terms.values()]
    # Otherwise the result depends as strongly on the last digits of x.
    uneven = (terms < UNEVEN * some) & (min(sizes, default=0.0) < UNEVEN * max(sizes, default=0.0))
    uneven |= terms < abs(work[doubtful]).sum(axis=-1)
    doubtful[doubtful] = uneven & (abs(np.asarray(energy)[doubtful]) < LOST * some)
    return _repaired(0, energy, doubtful, body, x, eps)


def _invariant_density(body: QuadraticField, x: FloatArray, eps: FloatArray) -> FloatArray:
    """Return 1 / det A(x)."""
    assert body.hamiltonian
    matrix = _matrix(body, x, eps)
    density: FloatArray = 1.0 / np.linalg.det(matrix)
    D, largest = body.dimension, max(matrix.max(initial=0.0), -matrix.min(initial=0.0))
    if LOST * (D * largest) ** D * abs(density).max(initial=0.0) <= 1.0:
        return density
    density = np.asarray(density)
    doubtful = np.asarray(abs(matrix).sum(axis=-1).prod(axis=-1) * abs(density) * LOST > 1.0)
    doubtful &= abs(matrix).max(axis=(-2, -1)) * UNEVEN > 1.0  # else a pole is near
    if doubtful.any():  # where small changes of entries, here of any sign and size, matter
        some = matrix[doubtful]
        some *= 1.0 + LOST**1.5 * np.cos(np.arange(D * D)).reshape(D, D)
        doubtful[doubtful] = abs(np.linalg.det(some) * density[doubtful] - 1.0) > LOST
    return _repaired(1, density, doubtful, body, x, eps)


def _repaired(
    quantity: int, found: FloatArray, doubtful: Any, body: Any, x: FloatArray, eps: FloatArray
) -> FloatArray:
    """Return a quantity whose doubtful values are replaced."""
    found = np.asarray(found)
    for index in map(tuple, np.argwhere(doubtful)):
        found[index] = modified_energy_and_density(body, x[index], eps[index])[quantity]
    return found


_SLOPES = partial(_of_states, _slopes, 2)
QUANTITIES: dict[str, Callable[[States], FloatArray]] = {
    "energy": partial(_of_states, _energy, 0),
    "modified_energy": partial(_of_states, _modified_energy, 0),
    "invariant_density": partial(_of_states, _invariant_density, 0),
    "vector_field": partial(_of_states, _vector_field, 1),
    "jacobian": partial(_of_states, partial(jacobian_by, _SLOPES), 2, warn=True),
    "matrix": partial(_of_states, _matrix, 2),
    "slopes": _SLOPES,
}
