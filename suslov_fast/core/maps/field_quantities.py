"""Quantities of a field at states: its matrix A, 1 / det A, and forms such as the Hamiltonian.

With x_D = 1, component i of a field is a sum of terms v x_j x_k, and a Hamiltonian is a sum of
terms v x_i x_j x_k. Functions take indices (3, T), values (..., T), step sizes (...) and states
(..., D). 1 / det A is the invariant density of Kahan's map of a Hamiltonian field.
"""

import numpy as np

from ..expressions.numpy_evaluation import evaluate
from ..numba.arrays import keep, uncounted
from ..numba.decorators import kernel, share
from ..numba.gauss import parts_of_determinant, solve
from .pivoting import fill_system


def _with_one(x):
    """Return states with x_D = 1, as components (D + 1, ...)."""
    y = np.ones((x.shape[-1] + 1, *x.shape[:-1]))
    y[:-1] = np.moveaxis(x, -1, 0)
    return y


@np.errstate(all="ignore")
def cubic_form(indices, values, x, z):
    """Return the sums (...) of v x_i x_j z_k, which are H(x) for z = x."""
    total, y, z = (0.0 * x).sum(axis=-1), _with_one(x), _with_one(z)  # NaN where the state is
    for (i, j, k), v in zip(indices.T.tolist(), np.moveaxis(values, -1, 0), strict=True):
        total = total + v * y[i] * y[j] * z[k]
    return total


@np.errstate(all="ignore")
def matrix(indices, values, eps, x):
    """Return A = 1 - (eps / 2) f' (..., D, D); a row is NaN if its component of x is NaN."""
    D, halves = x.shape[-1], (0.5 * eps)[..., np.newaxis] * values
    batch, y = np.broadcast_shapes(halves.shape[:-1], x.shape[:-1]), _with_one(x)
    A = np.empty((D, D, *batch))
    A[:] = np.expand_dims(np.eye(D), (*range(2, A.ndim),)) + 0.0 * np.expand_dims(y[:D], 1)
    for (i, j, k), half in zip(indices.T.tolist(), np.moveaxis(halves, -1, 0), strict=True):
        if j < D:
            A[i, j] -= half * y[k]
        if k < D:
            A[i, k] -= half * y[j]
    return np.ascontiguousarray(np.moveaxis(A, (0, 1), (-2, -1)))


@kernel
def determinants(part, parts, indices, halves, x, out):
    """Fill out (B,) with det A at states x (B, D), by `solve`; 0 where it is 0 to rounding."""
    indices, halves, x, D = uncounted(indices), uncounted(halves), uncounted(x), x.shape[1]
    counted = np.empty((D, D)), np.empty((2, D))
    system, units = uncounted(counted)
    for k in range(*share(len(x), part, parts)):
        fill_system(indices, halves[k % len(halves)], 1.0, x[k], system)
        solve(system, units)
        out[k] = np.ldexp(*parts_of_determinant(system, units))
    keep(counted)


def densities(scheme, values, eps, x):
    """Return 1 / det A at states x (B, D), infinite if det A is 0 to rounding.

    The determinant is the product of the pivots of a step. If these lose digits, it comes from
    elimination with pivoting.
    """
    step, halves = scheme.step, 0.5 * eps[:, np.newaxis] * values
    found = dict(enumerate(np.ascontiguousarray(x.T)))
    with np.errstate(all="ignore"):
        found.update(zip(step.table, step.table_of(halves.T), strict=True))
        evaluate(step.usual, found)
        evaluate(step.rare, found)
        density, inaccurate = np.ones(len(x)), np.ones(len(x), bool)
        if step.usual:
            for k in sorted(step.factors.inverse):
                density = density * found[step.factors.inverse[k]]
            inaccurate = ~np.broadcast_to(found[step.accurate], len(x))
        solved = np.empty(np.count_nonzero(inaccurate))
        own = halves[inaccurate] if len(halves) > 1 else halves
        seconds = 1e-5 * len(solved) * (10 + step.D**3)
        determinants.briefly(seconds, step.indices, own, x[inaccurate], solved)
        density[inaccurate] = 1.0 / solved
        return density + 0.0 * x.sum(axis=1)
