"""Steps of large sparse fields by SuperLU, and of maps with long programs by NumPy.

With A(x) = 1 - (eps/2) f'(x) a step is x_next = x + eps A(x)**-1 f(x). SuperLU calls BLAS, whose
last digits depend on the processor. So solutions are refined with residuals of twice as many
digits, and rounded: then orbits have the same bits on all processors.
"""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..numba.decorators import function, kernel
from ..numba.status_codes import NONFINITE, PASSED_POLE, SINGULAR
from .tolerances import LEAST_REFINEMENT, LEAST_WITH_SIGN, MOST_REFINEMENTS, TIME_OF_ENTRY_IN_PYTHON

SPLITTER = 2.0**27 + 1.0  # divides numbers in two halves, whose products are exact


def take(arguments, states, span, output, abandoned):
    """Take the steps of a `Span` from `states`; `kernel._iterate_part` has the other arguments."""
    scheme, values, eps = arguments
    _, _, start, stop, every, row = span
    saved, final, [poles], status, failed_at = output
    halves = 0.5 * eps[:, np.newaxis] * values
    x, alive = states.copy(), status >= 0
    x[~alive] = np.nan
    signs = [*scheme.step.of_one_sign]
    if scheme.step.of is None:
        step = _Sparse(scheme.step.indices, x.shape[1], halves)
    else:
        step = _StepByNumPy(scheme.step.of, halves)
    if every and start == 0:
        saved[row] = x
        row += 1
    for n in range(start + 1, stop + 1):
        if abandoned:
            break
        before = x[:, signs]
        for fraction in scheme.stages.fractions:
            [which] = np.nonzero(alive)
            x[which], sign = step(fraction, x[which], which)
            fails = ~np.isfinite(x[which]).all(axis=1)
            ends = which[fails]
            status[ends] = np.where(sign[fails] == 0, SINGULAR, NONFINITE)
            failed_at[ends] = n
            x[ends], alive[ends] = np.nan, False
            passed = which[(sign < 0) & ~fails & (poles[which] == 0.0)]
            poles[passed], status[passed], failed_at[passed] = n, PASSED_POLE, n
        after = x[:, signs]
        size = LEAST_WITH_SIGN
        changed = ((before < 0.0) & (after > size) | (before > 0.0) & (after < -size)).any(axis=1)
        changed &= alive & (poles == 0.0)
        poles[changed], status[changed], failed_at[changed] = -n, PASSED_POLE, n
        if every and n % every == 0:
            saved[row] = x
            row += 1
    final[:] = x


class _StepByNumPy:
    """Steps x -> f(x) of a map by NumPy, called as `_Sparse` is; the signs it returns are 1."""

    def __init__(self, f, parameters):
        self.f, self.table = f, f.table_of(parameters.T)

    def __call__(self, _, x, which):
        table = self.table if self.table.shape[1] == 1 else self.table[:, which]
        return np.ascontiguousarray(self.f.value(x.T, table).T), np.ones(len(x))


class _Sparse:
    """A step of sparse fields with terms v x_j x_k of f_i; `halves` (1 or B, T) are eps v / 2.

    Called with the fraction of eps that a stage takes, states (n, D) and the numbers `which` of
    their trajectories, it returns the next states, and the signs (n,) of det A, 0 if A is singular.
    """

    def __init__(self, indices, D, halves):
        i, j, k = self.indices = indices
        self.D, self.halves = D, halves
        self.of_j, self.of_k = np.flatnonzero(j < D), np.flatnonzero(k < D)
        diagonal = np.arange(D)
        self.rows = np.concatenate([i[j < D], i[k < D], diagonal])
        self.columns = np.concatenate([j[j < D], k[k < D], diagonal])

    def __call__(self, fraction, x, which):
        after, sign = np.empty_like(x), np.empty(len(x))
        for n, m in enumerate(which):
            after[n], sign[n] = self._of_one(fraction * self.halves[m % len(self.halves)], x[n])
        return after, sign

    def _of_one(self, half, x):
        i, j, k = self.indices
        D, y = self.D, np.append(x, 1.0)
        of_j, of_k = half[self.of_j] * y[k[self.of_j]], half[self.of_k] * y[j[self.of_k]]
        entries = np.concatenate([-of_j, -of_k, np.ones(D)])
        if not np.isfinite(entries).all():
            return np.full(D, np.nan), 1
        A = sparse.csc_matrix((entries, (self.rows, self.columns)), (D, D))
        try:
            factors = splu(A, permc_spec="MMD_AT_PLUS_A")
        except RuntimeError:
            return np.full(D, np.nan), 0
        sign = _parity(factors.perm_r) * _parity(factors.perm_c)
        sign *= np.prod(np.sign(factors.U.diagonal()))
        return x + 2.0 * _refined(factors, A, np.bincount(i, half * y[j] * y[k], D)), sign


def _refined(factors, A, right):
    """Return A**-1 right, rounded from a sum of two numbers for each component."""
    arrays = A.indptr, A.indices, A.data
    high, low = factors.solve(right), np.zeros(len(right))
    for _ in range(MOST_REFINEMENTS):
        residual = np.array([right, low * 0.0])
        seconds = TIME_OF_ENTRY_IN_PYTHON * len(A.data)
        subtract_product.interpreted_or_serial(seconds, *arrays, high, low, residual)
        change = factors.solve(residual[0] + residual[1])
        if not np.isfinite(change).all():
            break
        low = low + change
        total = high + low
        high, low = total, low - (total - high)
        if (abs(change) <= LEAST_REFINEMENT * abs(high)).all():
            break
    return high


@function
def error_of_product(a, b):
    """Return a b - fl(a b), by Dekker's method."""
    c, d = SPLITTER * a, SPLITTER * b
    a_high, b_high = c - (c - a), d - (d - b)
    a_low, b_low = a - a_high, b - b_high
    return a_low * b_low - (((a * b - a_high * b_high) - a_low * b_high) - a_high * b_low)


@kernel
def subtract_product(part, parts, offsets, rows, entries, high, low, residual):
    """Subtract A (high + low) from `residual` (2, D), sums of two numbers.

    Column j of A has `entries` in `rows` from offsets[j] to offsets[j + 1].
    """
    for j in range(len(high)):
        for n in range(offsets[j], offsets[j + 1]):
            i, a = rows[n], entries[n]
            before, product = residual[0, i], a * high[j]
            total = before - product
            of_sum = total - before  # Knuth's sum of two numbers and its error
            error = (before - (total - of_sum)) - (product + of_sum)
            residual[0, i] = total
            residual[1, i] += error - error_of_product(a, high[j]) - a * low[j]


def _parity(order):
    """Return 1 if the permutation `order` is even, -1 if it is odd, from its number of cycles."""
    D = len(order)
    cycles = connected_components(sparse.csr_matrix((np.ones(D), (np.arange(D), order)), (D, D)))[0]
    return 1 - 2 * ((D - cycles) % 2)
