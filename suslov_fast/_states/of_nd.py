"""Quantities of states in n dimensions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .._bodies.body_3d import Suslov3D
from .._bodies.body_nd import SuslovND, check_solved
from .._checks import FloatArray
from .._engine import reduced_runs
from .._engine import threads as _threads
from .._engine.evaluation import TASKS, by_slabs, of_state, of_state_nd
from .._engine.execution import execute, problem_of, span_of
from .._jit import Kernel
from .._kernels import quantities_3d as kernels_3d
from .._kernels import quantities_nd as kernels
from .._kernels.elimination import WIDTH
from .._kernels.tangent_map import differentiate
from .._maps.registry import map_of

Step = float | FloatArray | None
Batch = tuple[int, ...]


def _by_kernel(kernel: Kernel, axes: int = 0) -> Callable[..., FloatArray]:
    """Return the evaluation by a kernel of a quantity with `axes` axes."""

    def evaluate(
        body: SuslovND, omega: FloatArray, eps: Step, batch: Batch, threads: int | None, name: str
    ) -> FloatArray:
        return of_state_nd(kernel, body, omega, eps, batch, threads, (body.dimension,) * axes)

    return evaluate


def _by_numpy(
    function: Callable[..., FloatArray], axes: int = 0, solved: str | None = None
) -> Callable[..., FloatArray]:
    """Return the evaluation, in parts, of a NumPy function of bodies, states and step sizes.

    `solved` is the name of a public function that needs a solved body.
    """

    def evaluate(
        body: SuslovND, omega: FloatArray, eps: Any, batch: Batch, threads: int | None, name: str
    ) -> FloatArray:
        if solved:
            check_solved(body, solved)
        result = (body.dimension,) * axes
        return by_slabs(function, body, omega, eps, batch, result, warn=axes > 0)

    return evaluate


def _of_three(kernel: Kernel, body: Suslov3D, state: FloatArray, eps: FloatArray) -> FloatArray:
    return of_state(kernel, (), body, state, eps, state.shape[:-1], threads=1)


def _of_n_3(kernel: Kernel, body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    return _of_three(kernel, Suslov3D(*reduced_runs.of_n_3(body.J, body.I)), omega, eps)


def _first_integral(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    """Return F = 2 E / (4 a b + eps**2 x**2)."""
    if body.dimension == 2:
        return _of_n_3(kernels_3d.first_integral, body, omega, eps)
    batch = omega.shape[:-1]
    _, power = np.frexp(abs(omega).max(axis=-1, keepdims=True))
    energy = QUANTITIES["energy"](body, np.ldexp(omega, -power), None, batch, 1, "omega")
    reduced = reduced_runs.of_batch(body, omega, eps, batch, 1)
    b, a, _, I23, step = reduced.three.T
    with np.errstate(all="ignore"):
        below = 4.0 * a * b + (step * (I23 * reduced.state[:, 1])) ** 2
        unit = reduced.unit.astype(np.intc).reshape(batch)
        energy = np.ldexp(energy, -unit)
        value: FloatArray = np.ldexp(2.0 * energy / below.reshape(batch), 2 * power[..., 0] - unit)
    return value


def _criticality(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    if body.dimension == 2:
        return _of_n_3(kernels_3d.criticality, body, omega, eps)
    reduced = reduced_runs.of_batch(body, omega, eps, omega.shape[:-1], 1)
    t = _of_three(kernels_3d.criticality, reduced.body, reduced.state, reduced.three[:, 4])
    return t.reshape(omega.shape[:-1])


def jacobian_by(
    slopes: Callable[..., FloatArray], body: Any, omega: FloatArray, eps: FloatArray
) -> FloatArray:
    """Return (1 - S(omega))**-1 (1 + S(omega_next)), where S = (eps/2) f'."""
    before, after = (
        slopes(body, each, eps, omega.shape[:-1], None, "omega")
        for each in (omega, next_states(body, omega, eps))
    )
    return derivatives_of(before, after, None)[0].reshape(before.shape)


def derivatives_of(
    slopes: FloatArray, following: FloatArray, threads: int | None
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives (count, D, D) of steps and logarithms (count,) of their determinants."""
    D = slopes.shape[-1]
    before, after = slopes.reshape(-1, D, D), following.reshape(-1, D, D)
    derivatives, logarithms = np.empty(before.shape), np.empty(len(before))
    scratch = tuple(np.empty((TASKS, *shape, WIDTH)) for shape in ((D, 2 * D), (D, D), (2, D)))
    arguments = before, after, derivatives, logarithms, scratch
    _threads.run(differentiate, 2 * before.size * D, threads, *arguments)
    return derivatives, logarithms


def _discrete_reaction(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    batch, result = omega.shape[:-1], (body.dimension, body.dimension)
    following = next_states(body, omega, eps)
    return of_state_nd(
        kernels.reaction, body, np.ascontiguousarray(omega), None, batch, None, result, following
    )


def next_states(body: Any, omega: FloatArray, eps: FloatArray) -> FloatArray:
    problem = problem_of(map_of(body), body, omega.shape[:-1], omega, eps, continued=False)
    return execute(problem, span_of(0, 1, None)).final


QUANTITIES: dict[str, Callable[..., FloatArray]] = {
    "energy": _by_kernel(kernels.energy),
    "first_integral": _by_numpy(_first_integral, solved="first_integral"),
    "modified_energy": _by_kernel(kernels.modified_energy),
    "criticality": _by_numpy(_criticality, solved="criticality"),
    "vector_field": _by_kernel(kernels.vector_field, 1),
    "reaction": _by_kernel(kernels.reaction, 2),
    "discrete_reaction": _by_numpy(_discrete_reaction, 2),
    "jacobian": _by_numpy(partial(jacobian_by, _by_kernel(kernels.slopes, 2)), 2),
    "matrix": _by_kernel(kernels.matrix, 2),
    "slopes": _by_kernel(kernels.slopes, 2),
}
