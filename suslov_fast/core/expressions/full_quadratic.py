"""Right-hand sides of full quadratic fields, with a table of all coefficients."""

from math import inf

import numpy as np

from .right_hand_side import RightHandSide


class DenseRightHandSide(RightHandSide):
    """The right-hand side f_i = c_i + sum_j x_j (l_ij + sum_k q_ijk x_k), with symmetric q.

    Its parameters, like its table, are for each i: c_i, l_ij for all j, and q_ijk for all j and k.
    """

    is_dense, is_written, products, longest = True, True, (), inf
    clocks = steady = of_one_sign = denominators = fixed = ()

    def __init__(self, D):
        self.D, self.P = D, D * (1 + D + D * D)
        self.table = range(self.P)
        self.pattern = [(i, j) for i in range(D) for j in range(D)]
        self.key, self.cost = f"dense {D}", D * D * D

    def table_of(self, parameters):
        """Return the table (P, ...) of all coefficients: a copy of the parameters (P, ...)."""
        return np.array(parameters, np.float64)

    @np.errstate(all="ignore")
    def value(self, x, table):
        """Return f (D, ...) at states x (D, ...), with coefficients `table` (P, ...)."""
        x, constant, linear, totals = self._parts(x, table)
        terms = np.concatenate([constant[:, np.newaxis], (linear + totals) * x], axis=1)
        return np.add.accumulate(terms, axis=1)[:, -1]

    @np.errstate(all="ignore")
    def jacobian(self, x, table):
        """Return f' (D, D, ...) at states x (D, ...), with coefficients `table` (P, ...)."""
        _, _, linear, totals = self._parts(x, table)
        return linear + (totals + totals)

    def _parts(self, x, table):
        """Return arrays x_i, c_i, l_ij and sum_k q_ijk x_k, added as machine code adds them."""
        D, axes = self.D, max(np.ndim(x), np.ndim(table)) - 1
        x, coefficients = (
            np.reshape(a, (D, rows, *[1] * (axes + 1 - np.ndim(a)), *np.shape(a)[1:]))
            for a, rows in ((x, 1), (table, 1 + D + D * D))
        )
        constant, linear, quadratic = np.split(coefficients, [1, 1 + D], axis=1)
        products = quadratic.reshape(D, D, D, *quadratic.shape[2:]) * x[:, 0]
        shape = D, *np.broadcast_shapes(constant.shape[2:], x.shape[2:])
        constant = np.broadcast_to(constant[:, 0], shape)
        return x[:, 0], constant, linear, np.add.accumulate(products, axis=2)[:, :, -1]


def dense_parameters(indices, values, D):
    """Return the parameters (P, ...) of a `DenseRightHandSide` with the terms v x_j x_k in f_i.

    `indices` (3, n) has i, j, k of n terms, where x_D = 1; `values` (..., n) has the factors v.
    """
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
