"""Quantities of states in n dimensions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._bodies.nd import SuslovND
from .._bodies.reduction import first_integral as first_integral_of
from .._bodies.reduction import reduce
from .._checks import FloatArray
from .._engine.run import Run, execute
from .._engine.states import by_slabs, of_state
from .._engine.states_nd import of_state_nd
from .._jit import Kernel
from .._kernels import states as kernels_3d
from .._kernels import states_nd as kernels
from .._maps.registry import map_of

Step = float | FloatArray | None
Batch = tuple[int, ...]


def _by_kernel(quantity: int, axes: int = 0) -> Callable[..., FloatArray]:
    """Return what evaluates a quantity whose results have so many axes of components."""

    def find(
        body: SuslovND, omega: FloatArray, eps: Step, batch: Batch, threads: int | None, name: str
    ) -> FloatArray:
        return of_state_nd(quantity, body, omega, eps, batch, threads, (body.dimension,) * axes)

    return find


def _by_numpy(
    function: Callable[..., FloatArray], axes: int = 0, solved: str | None = None
) -> Callable[..., FloatArray]:
    """Return what evaluates a function of bodies, states and step sizes part by part.

    `solved` is the name of a function that needs a body whose problem is solved.
    """

    def find(
        body: SuslovND, omega: FloatArray, eps: Any, batch: Batch, threads: int | None, name: str
    ) -> FloatArray:
        if solved:
            reduce(body, solved)
        result = (body.dimension,) * axes
        return by_slabs(function, body, omega, eps, batch, result, warn=axes > 0)

    return find


def _three(kernel: Kernel, name: str, body: Any, omega: FloatArray, eps: FloatArray) -> FloatArray:
    """Return a quantity of the body in three dimensions that moves as this one does."""
    reduction = reduce(body, name)
    three, state = reduction.three, reduction.state(omega)
    batch = np.broadcast_shapes(three.shape, state.shape[:-1], np.shape(eps))
    return of_state(kernel, (), three, state, eps, batch, threads=1)


def _first_integral(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    if body.dimension == 2:
        return _three(kernels_3d.first_integral, "first_integral", body, omega, eps)
    body, omega, eps, unit = _normal(body, omega, eps)
    energy = QUANTITIES["energy"](body, omega, None, omega.shape[:-1], 1, "omega")
    return _ldexp(first_integral_of(reduce(body, "first_integral"), omega, eps, energy), unit)


def _criticality(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    if body.dimension > 2:
        body, omega, eps, _ = _normal(body, omega, eps)
    return _three(kernels_3d.criticality, "criticality", body, omega, eps)


def _jacobian(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    """Return A(omega; eps)**-1 A(omega_next; -eps)."""
    following, matrix = _next(body, omega, eps), QUANTITIES["matrix"]
    exists = np.asarray(np.isfinite(following).all(axis=-1))[..., np.newaxis, np.newaxis]
    batch = omega.shape[:-1]
    left = matrix(body, omega, eps, batch, None, "omega")
    right = matrix(body, following, -eps, batch, None, "omega")
    derivative: FloatArray = np.linalg.solve(
        np.where(exists, left, np.eye(body.dimension)), np.where(exists, right, np.nan)
    )
    return derivative


def _discrete_reaction(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    batch, result = omega.shape[:-1], (body.dimension, body.dimension)
    following = _next(body, omega, eps)
    return of_state_nd(
        kernels.REACTION, body, np.ascontiguousarray(omega), None, batch, None, result, following
    )


def _next(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    batch = omega.shape[:-1]
    states = np.ascontiguousarray(omega).reshape(-1, body.dimension)
    return execute(Run(map_of(body), body, batch, states, eps, 1, None, "auto", single=True)).final


def _normal(
    body: SuslovND, omega: FloatArray, eps: FloatArray
) -> tuple[SuslovND, FloatArray, FloatArray, FloatArray]:
    """Return all in units in which it is of the order of 1, and the power of two of F's unit."""
    _, moments = np.frexp(body.J.max(axis=-1, keepdims=True))
    _, products = np.frexp(abs(body.I).max(axis=-1, keepdims=True))
    _, speeds = np.frexp(abs(omega).max(axis=-1, keepdims=True))
    # Positive, as a body's must be, however far apart they are.
    normal = SuslovND(np.maximum(_ldexp(body.J, -moments), 2.0**-900), _ldexp(body.I, -products))
    power = (speeds + products - moments)[..., 0]
    # Steps that long are all alike, and finite.
    step = np.clip(_ldexp(eps, power), -1e300, 1e300)
    return normal, _ldexp(omega, -speeds), step, (2 * speeds - moments)[..., 0]


def _ldexp(values: FloatArray, power: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        result: FloatArray = np.ldexp(values, power)
    return result


QUANTITIES: dict[str, Callable[..., FloatArray]] = {
    "energy": _by_kernel(kernels.ENERGY),
    "first_integral": _by_numpy(_first_integral, solved="first_integral"),
    "modified_energy": _by_kernel(kernels.MODIFIED_ENERGY),
    "criticality": _by_numpy(_criticality, solved="criticality"),
    "vector_field": _by_kernel(kernels.VECTOR_FIELD, 1),
    "reaction": _by_kernel(kernels.REACTION, 2),
    "discrete_reaction": _by_numpy(_discrete_reaction, 2),
    "jacobian": _by_numpy(_jacobian, 2),
    "matrix": _by_kernel(kernels.MATRIX, 2),
}
