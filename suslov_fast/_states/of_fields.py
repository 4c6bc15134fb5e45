"""Quantities of states of quadratic fields."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .._bodies.field import QuadraticField
from .._checks import FloatArray
from .._engine.evaluation import SLAB, by_slabs
from .._engine.layout import flat_arrays
from .._engine.stepping import equations_of_field
from .._maps.registry import map_of
from .of_nd import jacobian_by

Quantity = Callable[[QuadraticField, FloatArray, FloatArray], FloatArray]


def _equations(
    body: QuadraticField, x: FloatArray, eps: Any, threads: int | None, solves: bool = False
) -> FloatArray:
    """Return A and minus half the step size times f, or A**-1 f, as (..., D, D + 1)."""
    batch = x.shape[:-1]
    flat = map_of(body).parameters(body, eps, batch)
    found = equations_of_field(flat, flat_arrays(x, batch), threads, solves)
    return found.reshape((*batch, *found.shape[1:]))


def _of_states(
    function: Callable[..., FloatArray], axes: int = 0, warn: bool = False
) -> Callable[..., FloatArray]:
    """Return the evaluation of `function(body, x, eps, threads)`, in parts."""

    def find(
        body: QuadraticField, x: FloatArray, eps: Any, batch: Any, threads: int | None, name: str
    ) -> FloatArray:
        D = body.dimension
        of_part = partial(function, threads=threads)
        most = max(SLAB // (D * D), 1)
        step = 2.0 if eps is None else eps
        return by_slabs(of_part, body, x, step, batch, (D,) * axes, warn, most)

    return find


def _vector_field(body: QuadraticField, x: FloatArray, eps: Any, threads: int | None) -> FloatArray:
    return 0.0 - _equations(body, x, 2.0, threads)[..., -1]


def _matrix(body: QuadraticField, x: FloatArray, eps: Any, threads: int | None) -> FloatArray:
    return _equations(body, x, eps, threads)[..., :-1]


def _jacobian(body: QuadraticField, x: FloatArray, eps: Any, threads: int | None) -> FloatArray:
    def matrix(body: Any, x: FloatArray, eps: Any, *_: Any) -> FloatArray:
        return _matrix(body, x, eps, threads)

    return jacobian_by(matrix, body, x, eps)


def _energy(body: QuadraticField, x: FloatArray, eps: Any, threads: int | None) -> FloatArray:
    with np.errstate(all="ignore"):
        products: FloatArray = x * _vector_field(body.quotients, x, None, threads)
        total: FloatArray = products.sum(axis=-1) + float(body._energy.terms.get((), 0))
    return total


def _modified_energy(
    body: QuadraticField, x: FloatArray, eps: Any, threads: int | None
) -> FloatArray:
    """Return H(x) + (eps/3) grad H(x).A(x)**-1 f(x)."""
    half = _equations(body, x, eps, threads, solves=True)[..., -1]
    with np.errstate(all="ignore"):
        work = (_vector_field(body.gradient, x, None, threads) * half).sum(axis=-1)
        modified: FloatArray = _energy(body, x, eps, threads) - work * (2.0 / 3.0)
    return modified


def _invariant_density(
    body: QuadraticField, x: FloatArray, eps: Any, threads: int | None
) -> FloatArray:
    """Return 1 / det A(x)."""
    assert body._energy
    with np.errstate(all="ignore"):
        density: FloatArray = 1.0 / np.linalg.det(_matrix(body, x, eps, threads))
    return density


QUANTITIES = {
    "energy": _of_states(_energy),
    "modified_energy": _of_states(_modified_energy),
    "invariant_density": _of_states(_invariant_density),
    "vector_field": _of_states(_vector_field, 1),
    "jacobian": _of_states(_jacobian, 2, warn=True),
    "matrix": _of_states(_matrix, 2),
}
