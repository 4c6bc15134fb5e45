"""Quantities of a field at B states: its matrix A, 1 / det A, and forms such as the Hamiltonian.

With x_D = 1, component i of a field is a sum of terms v x_j x_k, and a Hamiltonian one of terms
v x_i x_j x_k. The universal functions take indices (3, T), values (T,), step sizes (B,), which some
of them ignore, and states (B, D). 1 / det A is the invariant density of Kahan's map of a
Hamiltonian field.
"""

import numpy as np

from ..expressions.numpy_evaluation import evaluate
from ..numba.arrays import keep, uncounted
from ..numba.decorators import formula, function, kernel, share, universal
from ..numba.gauss import parts_of_determinant, solve
from ..numba.intrinsics import lesser
from .pivoting import fill_system

LANES = 128  # states at once
FIELD = "(c,t),(t),(b),(b,d)->"


@function
def read_states(x, first, y):
    """Fill y (D + 1, LANES) with states from `first` on, and x_D = 1; return how many there are."""
    D, count = x.shape[1], lesser(y.shape[1], len(x) - first)
    for i in range(D):
        for l in range(count):
            y[i, l] = x[first + l, i]
    for l in range(count):
        y[D, l] = 1.0
    return count


@formula
def term(places, t):
    """The i, j and k of a term."""
    return int(places[0, t]), int(places[1, t]), int(places[2, t])


@universal("(c,t),(t),(b),(b,d),(b,d)->(b)")
def cubic_form(places, values, eps, x, z, out):
    """The sum of v x_i x_j z_k, which is H(x) for z = x."""
    D = x.shape[1]
    is_same = x.ctypes.data == z.ctypes.data
    y, h = np.empty((D + 1, LANES)), np.empty((LANES,))
    after = y if is_same else np.empty((D + 1, LANES))
    for first in range(0, len(x), LANES):
        count = read_states(x, first, y)
        if not is_same:
            read_states(z, first, after)
        for l in range(count):
            h[l] = 0.0
        for i in range(D):
            for l in range(count):
                h[l] += 0.0 * y[i, l]  # NaN where the state is
        for t in range(len(values)):
            (i, j, k), v = term(places, t), values[t]
            for l in range(count):
                h[l] += v * y[i, l] * y[j, l] * after[k, l]
        for l in range(count):
            out[first + l] = h[l]


@universal(FIELD + "(b,d,d)")
def matrix(places, values, eps, x, out):
    """1 - (eps / 2) f'."""
    D = x.shape[1]
    for n in range(len(x)):
        for i in range(D):
            for j in range(D):
                out[n, i, j] = (1.0 if i == j else 0.0) + 0.0 * x[n, i]
        for t in range(len(values)):
            (i, j, k), half = term(places, t), 0.5 * eps[n] * values[t]
            if j < D:
                out[n, i, j] -= half * (x[n, k] if k < D else 1.0)
            if k < D:
                out[n, i, k] -= half * x[n, j]


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
    """Return 1 / det A at states x (B, D), infinite where det A is 0 to rounding.

    The determinant is the product of the pivots of a step. At states where these lose digits it
    comes from elimination with pivoting.
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
