"""Quantities of a field at B states: f, its matrix A, and cubic forms such as the Hamiltonian.

With x_D = 1, component i of a field is a sum of terms v x_j x_k, and a Hamiltonian one of terms
v x_i x_j x_k. The universal functions take indices (3, T), values (T,), step sizes (B,), which some
of them ignore, and states (B, D). `tangent` has the quantities that need elimination.
"""

import numpy as np

from ..numba.decorators import formula, function, universal
from ..numba.intrinsics import lesser

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
