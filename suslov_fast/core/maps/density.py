"""The invariant density of Kahan's map of a Hamiltonian field, 1 / det A(x).

A(x) = 1 - (eps/2) f'(x). The determinant is the product of the pivots of a planned step; at states
where that loses digits it is found by elimination with pivoting.
"""

import numpy as np

from ..expressions.numpy_evaluation import evaluate
from ..numba.arrays import keep, uncounted
from ..numba.decorators import kernel, share
from ..numba.gauss import parts_of_determinant, solve
from .pivoting import fill_system


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
    """Return 1 / det A at states x (B, D), infinite where det A is 0 to rounding."""
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
