"""Quantities of states in n dimensions."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from .._bodies.body_nd import SuslovND, check_measure, check_solved
from .._checks import FloatArray
from .._engine.arguments import States
from .._engine.evaluation import by_slabs, of_state, of_state_nd
from .._engine.reduced_runs import in_3d, reduced_of
from .._jit import Kernel
from .._kernels import quantities_3d as kernels_3d
from .._kernels import quantities_nd as kernels
from .of_fixed_points import of_rigid_body
from .step_derivatives import jacobian_by, next_states


def _of_solved(
    name: str, kernel: Kernel, function: Callable[..., FloatArray], states: States
) -> FloatArray:
    """Return a quantity of solved bodies, by the kernel for three dimensions if n = 3."""
    check_solved(states.body, name)
    if states.body.dimension == 2:
        return of_state(kernel, (), in_3d(states))
    return by_slabs(function, 0, states)


def _first_integral(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    """Return F = 2 E / (4 a b + eps**2 x**2)."""
    batch = omega.shape[:-1]
    _, power = np.frexp(abs(omega).max(axis=-1, keepdims=True))
    scaled = States(body, np.ldexp(omega, -power), 0.0, batch, threads=1)
    energy = of_state_nd(kernels.energy, 0, scaled)
    reduced = reduced_of(States(body, omega, eps, batch, threads=1))
    b, a, _, I23, step = reduced.three.T
    with np.errstate(all="ignore"):
        below = 4.0 * a * b + (step * (I23 * reduced.state[:, 1])) ** 2
        unit = reduced.unit.astype(np.intc).reshape(batch)
        energy = np.ldexp(energy, -unit)
        value: FloatArray = np.ldexp(2.0 * energy / below.reshape(batch), 2 * power[..., 0] - unit)
    return value


def _criticality(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    batch = omega.shape[:-1]
    three = reduced_of(States(body, omega, eps, batch, threads=1)).states(threads=1)
    return of_state(kernels_3d.criticality, (), three).reshape(batch)


def _invariant_density(states: States) -> FloatArray:
    check_measure(states.body, "invariant_density")
    if states.body.dimension == 2:
        return of_state(kernels_3d.invariant_density, (), in_3d(states))
    return of_state_nd(kernels.invariant_density, 0, states)


def _discrete_reaction(body: SuslovND, omega: FloatArray, eps: FloatArray) -> FloatArray:
    states = States(body, np.ascontiguousarray(omega), eps, omega.shape[:-1])
    return of_state_nd(kernels.reaction, 2, states, following=next_states(body, omega, eps))


_SLOPES = partial(of_state_nd, kernels.slopes, 2)
QUANTITIES: dict[str, Callable[[States], FloatArray]] = {
    "energy": partial(of_state_nd, kernels.energy, 0),
    "first_integral": partial(
        _of_solved, "first_integral", kernels_3d.first_integral, _first_integral
    ),
    "modified_energy": partial(of_state_nd, kernels.modified_energy, 0),
    "criticality": partial(_of_solved, "criticality", kernels_3d.criticality, _criticality),
    "invariant_density": _invariant_density,
    "vector_field": partial(of_state_nd, kernels.vector_field, 1),
    "reaction": partial(of_state_nd, kernels.reaction, 2),
    "discrete_reaction": partial(by_slabs, _discrete_reaction, 2, warn=True),
    "jacobian": partial(by_slabs, partial(jacobian_by, _SLOPES), 2, warn=True),
    "matrix": partial(of_state_nd, kernels.matrix, 2),
    "slopes": _SLOPES,
    "multipliers": of_rigid_body,
}
