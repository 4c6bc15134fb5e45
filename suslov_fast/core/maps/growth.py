"""Growth of tangent vectors along orbits of Kahan's map, and its derivative at states.

A small field has an expression program for a state with columns (`kahan_step.ExtendedStep`), which
the kernel of steps runs. In a lane that needs `pivoting_step`, columns are orthonormalised one step
later. For larger fields NumPy multiplies the columns by DPhi = A(x)**-1 (1 + (eps / 2) f'(x_next)).
"""

import numpy as np

from .kernel import scheme_of
from .stages import WHOLE, Scheme


def of_lists(scheme, values, eps, lengths=True):
    """Return arguments for the kernel of steps, for states with columns; None without a program."""
    tangent = scheme.step.with_columns(lengths)
    if not tangent.usual:
        return None
    return Scheme(tangent, scheme.stages), values, eps


def begun(x, lengths=True):
    """Return initial states (B, D) with orthonormal columns, and sums of logarithms that are 0."""
    B, D = x.shape
    return np.concatenate([x, np.tile(np.eye(D).ravel(), (B, 1)), np.zeros((B, D * lengths))], 1)


def derivative(indices, halves, x):
    """Return (eps / 2) f' (B, D, D) at states x (B, D)."""
    B, D = x.shape
    i, j, k = indices
    found, extended = np.zeros((B, D, D + 1)), np.concatenate([x, np.ones((B, 1))], axis=1)
    np.add.at(found, (slice(None), i, j), halves * extended[:, k])
    np.add.at(found, (slice(None), i, k), halves * extended[:, j])
    return found[..., :D]


class ByNumPy:
    """Steps of states with columns, by NumPy."""

    def __init__(self, scheme, values, eps):
        self.step, self.fractions = scheme.step, scheme.stages.fractions
        self.values, self.eps, self.scheme = values, eps, scheme
        if self.step.of is None:
            self.scheme = scheme_of(self.step.indices, self.step.D, WHOLE)

    def columns_after(self, x, step):
        """Return the states after step(arguments, x), and the derivative DPhi (B, D, D) at x."""
        if (f := self.step.of) is not None:
            slopes = f.jacobian(x.T, f.table_of(self.values.T))
            return step((self.scheme, self.values, self.eps), x), np.moveaxis(slopes, 2, 0)
        unit, product = np.eye(x.shape[1]), np.eye(x.shape[1])
        for fraction in self.fractions:
            eps = fraction * self.eps
            halves = 0.5 * eps[:, np.newaxis] * self.values
            after = step((self.scheme, self.values, eps), x)
            A = unit - derivative(self.step.indices, halves, x)
            is_finite = np.isfinite(A).all(axis=(1, 2)) & np.isfinite(after).all(axis=1)
            A[~is_finite] = unit
            with np.errstate(all="ignore"):
                back = unit + derivative(self.step.indices, halves, after)
            try:
                own = np.linalg.solve(A, back)
            except np.linalg.LinAlgError:
                own = np.linalg.pinv(A) @ back
            product = own @ product
            product[~is_finite], x = np.nan, after
        return x, product
