"""Right-hand sides of dense quadratic fields, whose coefficients are a table."""

from types import SimpleNamespace

import numpy as np


class DenseRightHandSide:
    """f_i = c_i + sum_j x_j (l_ij + sum_k q_ijk x_k) of D components, with symmetric q.

    It has what steps of the motion read of a `RightHandSide`. The parameters are its table: for
    each component c_i, l_ij for all j, and q_ijk for all j and k.
    """

    is_dense, changes, offsets = True, None, {}
    conditions = watched = watch = aim = None
    hidden = None, False, False
    clocks = of_one_sign = denominators = ()
    fixed = ()

    def __init__(self, D):
        self.D, self.P = D, D * (1 + D + D * D)
        self.table, self.entries = range(self.P), D * D
        self.pattern = [(i, j) for i in range(D) for j in range(D)]
        self.key, self.work = f"dense {D}", D * D * D

    def table_of(self, parameters):
        """Return the table (P, ...) for parameters (P, ...)."""
        return np.array(parameters, np.float64)

    def value(self, x, table):
        """Return f (D, ...) at states (D, ...)."""
        return np.stack([of.value for of in self._components(x, table)])

    def jacobian(self, x, table):
        """Return f' (D, D, ...) at states (D, ...)."""
        return np.stack([np.stack(of.slopes) for of in self._components(x, table)])

    value_and_denominators = value

    def _components(self, x, table):
        """Yield value and slopes of each component, with sums in the order of machine code."""
        D = self.D
        with np.errstate(all="ignore"):
            for i in range(D):
                own = table[i * (1 + D + D * D) :]
                value, slopes = own[0], []
                for j in range(D):
                    total = 0.0
                    for k in range(D):
                        total = total + own[1 + D + j * D + k] * x[k]
                    slopes.append(own[1 + j] + (total + total))
                    value = value + (own[1 + j] + total) * x[j]
                yield SimpleNamespace(value=value, slopes=slopes)


def dense_parameters(indices, values, D):
    """Return the parameters (P, ...) of terms at indices (3, T) with values (..., T)."""
    shape = values.shape[:-1]
    parts = np.zeros((D, 1 + D + D * D, *shape))
    for (i, j, k), v in zip(indices.T.tolist(), np.moveaxis(values, -1, 0), strict=True):
        j, k = min(j, k), max(j, k)
        if j == D:
            parts[i, 0] += v
        elif k == D:
            parts[i, 1 + j] += v
        else:
            parts[i, 1 + D + j * D + k] += 0.5 * v
            parts[i, 1 + D + k * D + j] += 0.5 * v
    return parts.reshape(D * (1 + D + D * D), *shape)
