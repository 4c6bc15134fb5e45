"""Derivatives of Kahan's map at states, and the growth of tangent vectors along orbits.

A small field has an expression program for a step of a state and its tangent vectors
(`kahan_step.ExtendedStep`), which the kernel of steps runs. For larger fields NumPy multiplies the
vectors by the derivative of a step, A(x; eps)**-1 A(x_next; -eps). Callers silence NumPy's
warnings.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls import ALL, Report, flat_arrays
from ..checks import FloatArray
from ..core.maps.kernel import field_steps, scheme_of
from ..core.maps.stages import Scheme
from ..core.numba.span import Output, Span
from ..fields.terms import Terms, slopes_at
from .kernel_arguments import by_scheme, by_zeros
from .problem import Problem
from .tolerances import WORK_OF_CALL


def matrix(terms: Any, eps: Any, x: FloatArray) -> FloatArray:
    """Return A = 1 - (eps / 2) f' (..., D, D) at states (..., D) of fields with these terms."""
    half = 0.5 * np.asarray(eps)[..., np.newaxis, np.newaxis]
    return np.asarray(np.eye(x.shape[-1]) - half * slopes_at(Terms(*terms), x))


def _derivative(terms: Any, eps: FloatArray, x: FloatArray, after: FloatArray) -> FloatArray:
    """Return the derivatives A(x; eps)**-1 A(after; -eps) (B, D, D) of a step; NaN if undefined."""
    A, back = matrix(terms, eps, x), matrix(terms, -eps, after)
    exists = (np.isfinite(A) & np.isfinite(back)).all(axis=(1, 2))
    A[~exists] = np.eye(x.shape[1])
    found = np.asarray(np.linalg.solve(A, back), np.float64)
    found += np.linalg.solve(A, back - A @ found)  # iterative refinement, for small entries
    found[~exists] = np.nan
    return found


def _with_derivative(kernel_arguments: Any, x: FloatArray, carry_and_statuses: Any, n: int) -> Any:
    """Take step n from x (B, D); return the next states, and the derivatives (B, D, D) there."""
    (step, stages), values, eps = kernel_arguments
    if (f := step.of) is not None:  # a map of the user
        slopes = f.jacobian(x.T, f.table_of(values.T))
        return _take(kernel_arguments, x, carry_and_statuses, n, n + 1), np.moveaxis(slopes, 2, 0)
    scheme, product = scheme_of(step.indices, step.D), np.eye(step.D)
    for fraction in stages.fractions:
        after = _take((scheme, values, fraction * eps), x, carry_and_statuses, n, n + 1)
        product = _derivative((step.indices, values), fraction * eps, x, after) @ product
        x = after
    return x, product


def _take(arguments: Any, x: FloatArray, notes: Any, start: int, stop: int) -> FloatArray:
    """Return states number `stop` from x, number `start`; `notes` get carry, status, failed_at."""
    carry, status, failed_at = notes
    output = Output(np.empty((0, *x.shape)), x.copy(), carry, status, failed_at)
    field_steps.serial(arguments, x, Span(0, len(x), start, stop, 0, 0), output)
    return output.final


def _no_notes(B: int) -> Any:
    """Return carry, status and failed_at of trajectories that begin."""
    return np.zeros((1, B)), np.zeros(B, np.int8), np.full(B, -1)


def groups_of_alike(problem: Problem) -> Iterator[tuple[Any, Any]]:
    """Yield groups of trajectories with the same operations: indices, and kernel arguments."""
    method = problem.map.methods[problem.method]
    of_problem = problem.body, problem.eps, problem.batch
    if method.kernel is field_steps and method.divide is None:
        yield ALL, method.arguments(*of_problem)
    else:  # a field, or the field of a body
        yield from by_zeros(by_scheme(*of_problem, problem.map.stages))


def jacobian(problem: Problem) -> FloatArray:
    """Return the derivatives (..., D, D) of a step."""
    x = flat_arrays(problem.x, problem.batch)
    B, D = x.shape
    out = np.empty((B, D, D))
    for where, arguments in groups_of_alike(problem) if B else ():
        states = x[where]
        out[where] = _with_derivative(arguments, states, _no_notes(len(states)), 0)[1]
    return out.reshape(*problem.batch, D, D)


class TangentGrowth(NamedTuple):
    """Statuses of orbits, and sums over their steps, from which Lyapunov exponents follow."""

    sums: FloatArray  # (B, D) for B orbits: sums of log(growth) of D orthogonal tangent vectors
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # (B,)
    by_sign: NDArray[np.bool_]  # (B,), True if a pole was seen by a component that changed its sign
    steps: int  # number of steps in the sums: fewer than asked for if `report` ended the run


class _Part:
    """Trajectories with the same operations, their tangent vectors, and logarithms of growth."""

    def __init__(self, where: Any, scheme: Any, values: Any, eps: Any, x: FloatArray) -> None:
        B, self.D = x.shape
        self.where, self.n = where, 0
        extended = scheme.step.extended
        self.by_numpy = not extended.usual  # the step is too long for a program
        of_step = scheme if self.by_numpy else Scheme(extended, scheme.stages)
        self.arguments, self.notes = (of_step, values, eps), _no_notes(B)
        # The state, D orthonormal tangent vectors, and sums of the logarithms of their growth.
        columns = np.tile(np.eye(self.D).ravel(), (B, 1))
        self.x = np.concatenate([x, columns, np.zeros((B, self.D))], axis=1)

    def take(self, stop: int) -> None:
        """Take the steps up to state `stop`."""
        if self.by_numpy:
            for n in range(self.n, stop):
                self._step(n)
        else:
            self.x = _take(self.arguments, self.x, self.notes, self.n, stop)
        self.n = stop

    def _step(self, n: int) -> None:
        D = self.D
        x, columns, sums = self.x[:, :D], self.x[:, D:-D].reshape(-1, D, D), self.x[:, -D:]
        after, product = _with_derivative(self.arguments, x, self.notes, n)
        # Last digits of BLAS and LAPACK do not reach the orbit, so growth differs by them alone;
        # without gaps in memory they are the same in any batch.
        V = np.ascontiguousarray(product) @ np.ascontiguousarray(columns.swapaxes(1, 2))
        V[~np.isfinite(V).all(axis=(1, 2))] = np.eye(D)
        Q, R = np.linalg.qr(V)
        sums += np.log(abs(np.diagonal(R, axis1=1, axis2=2)))
        x[:], columns[:] = after, Q.swapaxes(1, 2)


def growth(
    problem: Problem, steps: int, transient: int, report: Report | None = None
) -> TangentGrowth:
    """Return the growth of tangent vectors over `steps` steps after a transient.

    The vectors follow the transient, too, and turn to the directions in which they grow most.
    The sums end earlier if `report`, which is called with a number of steps, returns False.
    """
    start = flat_arrays(problem.x, problem.batch)
    B, D = start.shape
    parts = [
        _Part(where, scheme, values, eps, start[where])
        for where, (scheme, values, eps) in groups_of_alike(problem)
    ]
    sums, status, failed_at = np.zeros((B, D)), np.zeros(B, np.int8), np.full(B, -1)
    by_sign = np.zeros(B, bool)
    length, n = max(WORK_OF_CALL // max(400 * B * D, 1), 1), 0
    for last in (transient, transient + steps):
        for part in parts:
            part.x[:, -D:] = 0.0
        goes_on = True
        while n < last and goes_on:
            n = min(n + length, last)
            for part in parts:
                part.take(n)
            goes_on = report is None or report(n)
        if not goes_on:
            break
    for part in parts:
        sums[part.where] = part.x[:, -D:]
        carry, status[part.where], failed_at[part.where] = part.notes
        by_sign[part.where] = carry[0] < 0.0
    if not any(method.notes_poles for method in problem.map.methods.values()):
        status = np.minimum(status, 0)  # PASSED_POLE becomes 0: runs of this map do not report it
    done = max(n - transient, 0)
    sums[(status < 0) | (done == 0)] = np.nan
    return TangentGrowth(sums, status, failed_at, by_sign, done)
