"""Formulas of Kahan's map of any field."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, kind_of
from ..fields.terms import with_one
from .batch import states_after
from .derivatives import jacobian, matrix
from .evaluation import Formula
from .problem import Problem


def _check_hamiltonian(body: Any) -> None:
    """Raise TypeError for a field without a Hamiltonian."""
    if not body._field._is_hamiltonian:
        how = "if f = K grad H, make it by Field.from_hamiltonian, "
        how += "or use integrability.report(field), which looks for integrals"
        kind = kind_of(body)
        field = "this field" if kind == "Field" else f"the field of {kind}"
        raise TypeError(f"system: {field} has no Hamiltonian: {how}")


def _modified_energy(problem: Problem) -> FloatArray:
    """Return H + grad H . (x_next - x) / 3, which Kahan's map conserves, for a cubic H.

    It is the mean of three values: the first, second or third factor of each term v x_i x_j x_k of
    H is taken at x_next, the others at x.
    """
    (i, j, k), values = problem.body._field._energy_terms
    x, after = with_one(problem.x), with_one(states_after(problem))
    y = x[..., i], x[..., j], x[..., k]
    z = after[..., i], after[..., j], after[..., k]
    means = (y[0] * y[1] * z[2] + y[0] * z[1] * y[2] + z[0] * y[1] * y[2]) / 3.0
    return np.asarray((values * means).sum(axis=-1))


def _matrix(problem: Problem) -> FloatArray:
    return matrix(problem.body._terms, problem.eps, problem.x)


def _density(problem: Problem) -> FloatArray:
    """Return 1 / det A(x) (...), the density of the measure that the map conserves."""
    return np.asarray(1.0 / np.linalg.det(_matrix(problem)))


def eigenvalues(problem: Problem, slopes: FloatArray) -> NDArray[Any]:
    """Return the eigenvalues (..., D) of `slopes`, f' at steady states, for `multipliers`."""
    return np.linalg.eigvals(slopes).astype(complex)


def eigenvalues_in_order(values: NDArray[Any], sizes: FloatArray) -> NDArray[Any]:
    """Return eigenvalues (..., k) by decreasing `sizes` (..., k), which are moduli or real parts.

    Sizes that agree to 9 digits count as equal, so that last digits do not choose the order; then
    larger |Im| comes first, then larger Re, and in conjugate pairs Im > 0.
    """
    largest = np.fmax.reduce(abs(values), axis=-1, keepdims=True, initial=0.0)
    scale = np.where((largest > 0.0) & (largest < np.inf), largest, 1.0)
    keys = (np.round(each / scale, 9) for each in (values.real, abs(values.imag), sizes))
    order = np.lexsort((-values.imag, *(-key for key in keys)), axis=-1)
    return np.take_along_axis(values, order, axis=-1)


# Formulas of the functions in the module `kahan`, for any field; bodies have their own.
KAHAN = {
    "matrix": Formula(_matrix),
    "jacobian": Formula(jacobian),
    "modified_energy": Formula(_modified_energy, _check_hamiltonian),
    "invariant_density": Formula(_density, _check_hamiltonian, poles=True),
}
