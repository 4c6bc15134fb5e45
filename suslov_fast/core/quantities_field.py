"""Quantities of states of a field, as universal functions of states in rows.

They take the terms v x_j x_k of the components i, with x_D = 1, as indices (3, T) and values (T,),
step sizes (B,), used or not, and states (B, D). Terms of a Hamiltonian are v x_i x_j x_k. States
of a block are lanes. `tangent` has what is computed by elimination.
"""

import numpy as np

from .numba import formula, function, inlined, lesser, universal

LANES = 128
FIELD = "(c,t),(t),(b),(b,d)->"


@function
def read_states(x, first, y):
    """Fill rows y with states from `first` on, and x_D = 1; return their number."""
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


@universal(FIELD + "(b,d)")
def vector_field(places, values, eps, x, out):
    D = x.shape[1]
    y, f = np.empty((D + 1, LANES)), np.empty((D, LANES))
    for first in range(0, len(x), LANES):
        count = read_states(x, first, y)
        for i in range(D):
            for l in range(count):
                f[i, l] = 0.0 * y[i, l]  # NaN where the state is
        for t in range(len(values)):
            (i, j, k), v = term(places, t), values[t]
            for l in range(count):
                f[i, l] += v * y[j, l] * y[k, l]
        for i in range(D):
            for l in range(count):
                out[first + l, i] = f[i, l]


@universal(FIELD + "(b)")
def energy(places, values, eps, x, out):
    """H(x)."""
    add_terms(places, values, x, None, out)


@universal("(c,t),(t),(b),(b,d),(b,d)->(b)")
def cubic_form(places, values, eps, x, z, out):
    """The sum of v x_i x_j z_k."""
    add_terms(places, values, x, z, out)


@inlined
def add_terms(places, values, x, z, out):
    """Fill the sum of v x_i x_j z_k, where z is x if it is None."""
    D = x.shape[1]
    y, h = np.empty((D + 1, LANES)), np.empty((LANES,))
    after = y if z is None else np.empty((D + 1, LANES))
    for first in range(0, len(x), LANES):
        count = read_states(x, first, y)
        if z is not None:
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
