"""Formulas of maps: a `Formula` for each public function of a state, by its name.

A formula takes a checked problem and returns the values. Records list the formulas of their map.
The equations are in `core.suslov.quantities` and `core.fields.quantities`.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.nd import check_known
from ..bodies.rigid import Suslov3D
from ..checks import FloatArray, kind_of
from ..core.compiling.numba import Universal
from ..core.fields import quantities as quantities_field
from ..core.suslov import quantities
from ..engine.derivatives import density, jacobian
from ..engine.problem import Problem
from ..engine.stretches import states_after


class Formula(NamedTuple):
    """The computation of a public function of a state, for one map."""

    # Returns the values (...), or an array for each state; None for functions of their own.
    compute: Any = None
    check: Callable[[Any], None] | None = None  # raises an error for a body without the quantity
    poles: bool = False  # True if infinite values are results; else they become NaN


# A problem in three dimensions, and the function that maps its states back.
Reduced = tuple[Problem, Callable[[FloatArray], FloatArray]]


def values_by_constants(formula: Universal, problem: Problem) -> Any:
    """Return the values of a universal function of the constants of a body, eps and omega."""
    return formula(*problem.body.constants, problem.eps, problem.omega)


def values_by_rows(formula: Universal, problem: Problem) -> Any:
    """Return the values of a universal function that takes constants, eps and rows of states.

    For a single body and step size, the states along the last axis of the batch are one such array.
    """
    body, eps, omega = problem.body, problem.eps, problem.omega
    if omega.ndim > 1 and not body.shape and type(eps) is float:
        return formula(*body.constants, eps, omega)
    values: FloatArray = formula(*body.constants, eps, omega[..., np.newaxis, :])
    return values.squeeze(axis=len(problem.batch))


def values_by_terms(
    formula: Universal, problem: Problem, terms: Any = None, after: FloatArray | None = None
) -> FloatArray:
    """Return the values of a formula of `terms`, by default those of the field of the body.

    The formula takes the terms, and rows of eps, of states, and of the states `after` a step if
    given. For a single field, the states along the last axis of the batch are the rows.
    """
    body, batch = problem.body, problem.batch
    states = [problem.omega] if after is None else [problem.omega, after]
    arrays = [np.broadcast_to(each, (*batch, body.dimension)) for each in states]
    arrays.insert(0, np.broadcast_to(problem.eps, batch))
    in_rows = bool(batch) and not body.shape
    if not in_rows:
        arrays = [np.expand_dims(each, len(batch)) for each in arrays]
    values: FloatArray = formula(*(body._terms if terms is None else terms), *arrays)
    return values if in_rows else values.squeeze(axis=len(batch))


def formulas_named(names: str, **options: Any) -> dict[str, Formula]:
    """Return the formulas with these names in `core.suslov.quantities`, by their names."""
    functions = {name: getattr(quantities, name) for name in names.split()}
    return {n: Formula(partial(values_by_constants, f), **options) for n, f in functions.items()}


# -------------------------------------------------------------------- of Kahan's map of any field
def _check_hamiltonian(body: Any) -> None:
    """Raise TypeError for a field without a Hamiltonian."""
    if not body.field().is_hamiltonian:
        how = "if f = K grad H, make it by Field.from_hamiltonian, "
        how += "or use integrability.report(field), which looks for integrals"
        kind = kind_of(body)
        field = "this field" if kind == "Field" else f"the field of {kind}"
        raise TypeError(f"system: {field} has no Hamiltonian: {how}")


def _energy(problem: Problem) -> FloatArray:
    terms = problem.body.field().energy_terms
    return values_by_terms(quantities_field.cubic_form, problem, terms, problem.omega)


def _modified_energy(problem: Problem) -> FloatArray:
    places, values = problem.body.field().energy_terms
    # H + grad H . (x_next - x) / 3 is the symmetric form H(x, x, x_next): the mean over the three
    # places of x_next.
    terms = np.hstack([places, places[[1, 2, 0]], places[[2, 0, 1]]]), np.tile(values / 3.0, 3)
    return values_by_terms(quantities_field.cubic_form, problem, terms, states_after(problem))


def eigenvalues(problem: Problem, slopes: FloatArray) -> NDArray[Any]:
    """Return the eigenvalues (..., D) of f' (..., D, D) at steady states, for `multipliers`."""
    return np.linalg.eigvals(slopes).astype(complex)


# The formulas of Kahan's map of any field; for a body they use the terms of its field.
KAHAN = {
    "multipliers": Formula(),
    "lyapunov_exponents": Formula(),
    "vector_field": Formula(partial(values_by_terms, quantities_field.vector_field)),
    "matrix": Formula(partial(values_by_terms, quantities_field.matrix)),
    "jacobian": Formula(jacobian),
    "energy": Formula(_energy, _check_hamiltonian),
    "modified_energy": Formula(_modified_energy, _check_hamiltonian),
    "invariant_density": Formula(density, _check_hamiltonian, poles=True),
}


_NOT_OF_ORDERS = "matrix", "modified_energy", "invariant_density"  # these are for single steps
# The formulas of the compositions of order 4, 6 and 8.
OF_ORDER = {name: formula for name, formula in KAHAN.items() if name not in _NOT_OF_ORDERS}


# ------------------------------------------------------------------------------ in three dimensions
def eigenvalues_of_gyrostat(problem: Problem, slopes: FloatArray) -> NDArray[Any]:
    """Return `eigenvalues`; the one along a line of steady states is exactly 0."""
    (I1, I2, _, _, k), x = problem.body.constants, problem.omega
    trace, at_rest = np.trace(slopes, axis1=-2, axis2=-1), (x == 0.0).all(axis=-1)
    root = np.where(at_rest, 2j * k / np.sqrt(I1 * I2), trace)[..., np.newaxis]
    return np.asarray(0.5 * (trace[..., np.newaxis] + root * [1.0, -1.0]))


def eigenvalues_in_3d(problem: Problem, slopes: FloatArray) -> FloatArray:
    """Return `eigenvalues`; without a rotor they are real."""
    return eigenvalues_of_gyrostat(problem, slopes).real


def whole_states(problem: Problem) -> FloatArray:
    """Return the states (..., D + 1) of the whole batch with the constrained component, 0."""
    free = np.broadcast_to(problem.omega, (*problem.batch, problem.body.dimension))
    return np.concatenate([free, abs(0.0 * free[..., :1])], axis=-1)


def wedge(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b^T - b a^T."""
    product = a[..., :, np.newaxis] * b[..., np.newaxis, :]
    return np.asarray(product - product.swapaxes(-2, -1)) + 0.0  # no -0.0


def _matrix_in_3d(problem: Problem) -> FloatArray:
    in_rows = whole_states(problem)[..., [1, 0, 2]] * [1.0, -1.0, 1.0]
    return wedge(in_rows, np.eye(3)[-1])


def _momentum_in_3d(problem: Problem) -> FloatArray:
    I1, I2, I13, I23, k = problem.body.constants
    w1, w2, _ = np.moveaxis(whole_states(problem), -1, 0)
    return np.stack([I1 * w1, I2 * w2, I13 * w1 + I23 * w2 + k], axis=-1)


def _step_full(problem: Problem) -> Any:
    body = problem.body
    return quantities.step_full(*body.constants[:4], body.I3, problem.eps, problem.omega)


def as_it_is(problem: Problem) -> Reduced:
    """Return a problem in three dimensions, which needs no reduction."""
    return problem, lambda states: states


GYROSTAT = {
    **KAHAN,
    **formulas_named("first_integral energy modified_energy rotation_number reaction"),
    **formulas_named("vector_field matrix jacobian"),
    "criticality": Formula(partial(values_by_rows, quantities.criticality)),
    "step": Formula(partial(values_by_rows, quantities.step)),
    **formulas_named("invariant_density", poles=True),
    **dict.fromkeys("exact flow limits plot_phase".split(), Formula()),
    "to_matrix": Formula(_matrix_in_3d),
    "to_vector": Formula(whole_states),
    "momentum": Formula(_momentum_in_3d),
}
IN_3D = {
    **GYROSTAT,
    **formulas_named("to_xy from_xy closed_form"),
    "step_full": Formula(_step_full),
    "scattering_angle": Formula(),
}


# ---------------------------------------------------------------------------------- in n dimensions
def _reaction_nd(problem: Problem) -> FloatArray:
    body, omega = problem.body, problem.omega
    after = states_after(problem) if np.any(problem.eps) else omega
    return quantities.reaction_between(body.J, body.I, omega, after)


def eigenvalues_nd(problem: Problem, slopes: FloatArray) -> FloatArray:
    """Return `eigenvalues`: those of f' = (I.x) J**-1 P.

    P projects onto the vectors orthogonal to I. The eigenvalues are I.x times the squares of the
    singular values of P J**-1/2, computed in this way because small singular values keep their
    digits beside large ones.
    """
    body, x = problem.body, problem.omega
    length = np.linalg.norm(body.I, axis=-1, keepdims=True)
    unit = body.I / np.where(length > 0.0, length, 1.0)
    P = np.eye(body.dimension) - unit[..., :, np.newaxis] * unit[..., np.newaxis, :]
    roots = np.linalg.svd(P / np.sqrt(body.J)[..., np.newaxis, :], compute_uv=False)
    roots[..., -1] = 0.0
    return np.asarray((body.I * x).sum(axis=-1, keepdims=True) * roots * roots)


def _matrix_nd(problem: Problem) -> FloatArray:
    return wedge(whole_states(problem), np.eye(problem.body.dimension + 1)[-1])


def _momentum_nd(problem: Problem) -> FloatArray:
    body, vector = problem.body, whole_states(problem)
    last = np.eye(body.dimension + 1)[-1]
    J, I = (np.concatenate([part, 0.0 * part[..., :1]], axis=-1) for part in (body.J, body.I))
    return wedge(vector, I) + wedge(J * vector, last)


def in_plane(problem: Problem) -> Reduced:
    """Return an equivalent problem in three dimensions, and the function that maps states back.

    A body of two coordinates with J = a, b and I = (c, d) is that of I1 = a, I2 = b, I13 = -d,
    I23 = c.
    """
    parts, omega = problem.body.reduction, problem.omega
    J, I = parts.parameters(2)
    plane = {"I1": J[..., 0], "I2": J[..., 1], "I13": -I[..., 1], "I23": I[..., 0]}
    steady = parts.steady[..., np.newaxis]

    def map_back(states: FloatArray) -> FloatArray:
        return np.where(steady, omega, parts.back(states, omega))

    reduced = Suslov3D._of(plane)
    return problem._replace(body=reduced, omega=parts.states(omega, 2)), map_back


def _criticality_nd(problem: Problem) -> FloatArray:
    """Return t of the reduced body."""
    return IN_3D["criticality"].compute(in_plane(problem)[0])


def _first_integral_nd(problem: Problem) -> FloatArray:
    """Return the modified energy over 2 a b, with the J of the two coordinates."""
    values: FloatArray = IN_ND["modified_energy"].compute(problem)
    J, _ = problem.body.reduction.parameters(2)
    return np.asarray(values / (2.0 * J.prod(axis=-1)))


def _density_nd(problem: Problem) -> FloatArray:
    """Return the density of the reduced body over the powers of r, 1 where every state is steady.

    States with the same r are a sphere, whose area is the power of r that each part in E0 adds.
    """
    body, omega, eps = problem.body, problem.omega, problem.eps
    parts, values = body.reduction, np.ones(problem.batch)
    for size in (2, 3):
        has_size = ~parts.steady & (parts.count == size)
        if has_size.any():
            x = parts.states(omega, size)
            J, I = parts.parameters(size)
            with np.errstate(all="ignore"):
                area = (x ** parts.further(size)).prod(axis=-1)
                density = quantities.invariant_density_nd(J, I, eps, x) / area
            values = np.where(has_size, density, values)
    return np.asarray(values + 0.0 * omega.sum(axis=-1))


def _nd(name: str, compute: Any = None, **options: Any) -> dict[str, Formula]:
    """Return, by its name, the formula of a function that is not known for all bodies."""
    if formula := getattr(quantities, f"{name}_nd", None):
        compute = compute or partial(values_by_constants, formula)
    return {name: Formula(compute, partial(check_known, function=name), **options)}


IN_ND = {
    **KAHAN,
    **_nd("first_integral", _first_integral_nd),
    **_nd("energy"),
    **_nd("modified_energy"),
    **_nd("criticality", _criticality_nd),
    **_nd("vector_field"),
    **_nd("invariant_density", _density_nd, poles=True),
    **_nd("reaction", _reaction_nd),
    **_nd("exact"),
    **_nd("flow"),
    **_nd("limits"),
    "to_matrix": Formula(_matrix_nd),
    "momentum": Formula(_momentum_nd),
}
