"""What else one would use for fields of many variables: SciPy's sparse solver, and Numba.

They take the terms of a field. Steps of Runge and Kutta's method are explicit, and are none of the
map.
"""

import functools

import numba
import numpy as np
import scipy.sparse
from problem import EPS_FIELD as EPS
from scipy.sparse.linalg import spsolve


def _terms(field):
    places, values = field.terms
    return np.asarray(places), np.asarray(values, float)


def by_sparse(field, x, steps):
    """Steps of Kahan's map of orbits one after the other, by `scipy.sparse.linalg.spsolve`."""
    ((i, j, k), values), D = _terms(field), field.dimension
    rows, x = np.concatenate([np.arange(D), i, i]), x.copy()
    columns = np.concatenate([np.arange(D), j, k])
    keep = columns < D
    for state in x:
        for _ in range(steps):
            y = np.append(state, 1.0)
            entries = np.concatenate([np.ones(D), *(-EPS / 2 * values * y[a] for a in (k, j))])
            places = entries[keep], (rows[keep], columns[keep])
            A = scipy.sparse.csc_matrix(places, shape=(D, D))
            f = np.bincount(i, values * y[j] * y[k], D)
            state += EPS * spsolve(A, f)
    return x


@functools.cache
def _compiled():
    @numba.njit(error_model="numpy")
    def rates(places, values, x, out):
        out[:] = 0.0
        for t in range(len(values)):
            out[places[0, t]] += values[t] * x[places[1, t]] * x[places[2, t]]

    @numba.njit(error_model="numpy")
    def runge_kutta(places, values, x, eps, steps):
        D = x.shape[1]
        k, y, total = np.zeros(D + 1), np.ones(D + 1), np.zeros(D)
        for state in x:
            for _ in range(steps):
                total[:] = 0.0
                y[:D] = state
                for part, weight in ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)):
                    rates(places, values, y, k)
                    for i in range(D):
                        total[i] += weight * k[i]
                        y[i] = state[i] + part * eps * k[i]
                for i in range(D):
                    state[i] += eps / 6 * total[i]

    return runge_kutta


def by_runge_kutta(field, x, steps):
    """Steps of Runge and Kutta's method of order 4, orbits one after the other."""
    x = x.copy()
    _compiled()(*_terms(field), x, EPS, steps)
    return x
