"""Derivatives of Kahan's map at states, and the growth of tangent vectors along orbits.

They call `core.maps.growth`.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, common_shape
from ..core.maps import growth as tangents
from ..core.maps.driver import WIDTH
from ..core.maps.field_quantities import densities
from ..core.maps.kernel import field_steps
from ..core.numba.status import PASSED_POLE
from .batch import Report
from .kernel_arguments import ALL, by_zeros, flat_arrays, in_stages
from .problem import Problem

# Operations of one call of a kernel, some tenths of a second; Python handles Ctrl-C in between.
CHUNK_WORK = 2**28


def groups_of_alike(problem: Problem, batch: tuple[int, ...]) -> Iterator[tuple[Any, Any]]:
    """Yield groups of a batch, as indices, and the scheme, values and step sizes of each."""
    own = problem.map.methods[problem.method]
    is_field = own.divide is not None or own.kernel is not field_steps
    make = in_stages(problem.map.stages) if is_field else own.arguments
    arguments = make(problem.body, problem.eps, batch)
    yield from by_zeros(arguments) if is_field else [(ALL, arguments)]


def _at_states(
    compute: Callable[..., None], problem: Problem, own: tuple[int, ...], shape: tuple[int, ...]
) -> FloatArray:
    """Return the values (..., *shape) that compute(scheme, values, eps, states, out) writes.

    `own`, the last axes of the batch, are the axes of parameters; the axes before them are more
    states of the same fields. A call gets states (rows, fields, D).
    """
    D, batch = problem.body.dimension, problem.batch
    rows, fields = math.prod(batch[: len(batch) - len(own)]), math.prod(own)
    x = flat_arrays(problem.omega, batch).reshape(rows, fields, D)
    out = np.empty((rows, fields, *shape))
    for where, of_group in groups_of_alike(problem, own) if out.size else ():
        values = out[:, where]  # a view if where is ALL, else a copy
        compute(*of_group, x[:, where], values)
        if where is not ALL:
            out[:, where] = values
    return out.reshape((*batch, *shape))


def _fill_jacobians(scheme: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
    rows, fields, D = x.shape
    states = x.reshape(-1, D)
    if rows > 1 and fields > 1:
        values, eps = (np.tile(a, (rows, 1)[: a.ndim]) if len(a) > 1 else a for a in (values, eps))
    arguments = tangents.of_lists(scheme, values, eps, lengths=False)
    if arguments is None:
        found = tangents.ByNumPy(scheme, values, eps).columns_after(states, _one_step)[1]
    else:
        end = _one_step(arguments, tangents.begun(states, lengths=False))
        found = end[:, D:].reshape(-1, D, D).swapaxes(1, 2)
    out[:] = found.reshape(rows, fields, D, D)


def _one_step(arguments: Any, x: FloatArray) -> FloatArray:
    """Return the states after a step."""
    notes = np.zeros((1, len(x))), np.zeros(len(x), np.int8), np.full(len(x), -1)
    return _take(arguments, x, notes, 0, 1)


def _take(arguments: Any, x: FloatArray, notes: Any, start: int, stop: int) -> FloatArray:
    """Return states after steps; `notes` are carry, status and failed_at of the kernel."""
    carry, status, failed_at = notes
    final, saved = x.copy(), np.empty((0, *x.shape))
    span = 0, len(x), start, stop, 0, 0
    field_steps.serial(arguments, x, carry, span, saved, final, status, failed_at)
    return final


def jacobian(problem: Problem) -> FloatArray:
    """Return the derivatives (..., D, D) of a step."""
    D, batch, eps = problem.body.dimension, problem.batch, problem.eps
    of_eps = () if type(eps) is float else np.shape(eps)
    own = common_shape({"body": problem.body.shape, "eps": of_eps})
    if own:
        axes = len(batch) - len(own)
        few = math.prod(batch[:axes]) < WIDTH  # states of a field, which do not fill a line
        own = batch if few else batch[axes:]
    return _at_states(_fill_jacobians, problem, own, (D, D))


def density(problem: Problem) -> FloatArray:
    """Return 1 / det A (...), the invariant density of a Hamiltonian field."""

    def fill(scheme: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
        out[0] = densities(scheme, values, eps, x[0])

    return _at_states(fill, problem, problem.batch, ())


class TangentGrowth(NamedTuple):
    """Sums over the steps of an orbit, from which Lyapunov exponents follow, and its end."""

    sums: FloatArray  # (B, D), of the logarithms of the growth of D orthogonal tangent vectors
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # (B,)
    by_signs: NDArray[np.bool_]  # (B,), true where a change of sign told the pole
    steps: int  # of the sums: fewer than asked for if `report` ended the run, or 0


class _Part:
    """Trajectories with the same step operations, and their columns and sums."""

    def __init__(self, where: Any, scheme: Any, values: Any, eps: Any, x: FloatArray) -> None:
        B, self.D = x.shape
        self.where, self.n = where, 0
        self.arguments = tangents.of_lists(scheme, values, eps)
        self.by_numpy = tangents.ByNumPy(scheme, values, eps)
        self.notes = np.zeros((1, B)), np.zeros(B, np.int8), np.full(B, -1)
        self.x = tangents.begun(x)

    def begin(self) -> None:
        """Set the sums to 0."""
        self.x[:, -self.D :] = 0.0

    def take(self, stop: int) -> None:
        """Take the steps up to state `stop`."""
        if self.arguments is not None:
            self.x = _take(self.arguments, self.x, self.notes, self.n, stop)
        else:
            for n in range(self.n, stop):
                self._step(n)
        self.n = stop

    def _step(self, n: int) -> None:
        D = self.D
        own = self.x[:, :D], self.x[:, D:-D].reshape(-1, D, D), self.x[:, -D:]
        x, columns, sums = own

        def step(arguments: Any, states: FloatArray) -> FloatArray:
            return _take(arguments, states, self.notes, n, n + 1)

        after, product = self.by_numpy.columns_after(x, step)
        V = product @ columns.swapaxes(1, 2)
        V[~np.isfinite(V).all(axis=(1, 2))] = np.eye(D)
        Q, R = np.linalg.qr(V)
        with np.errstate(divide="ignore"):
            sums += np.log(abs(np.diagonal(R, axis1=1, axis2=2)))
        x[:], columns[:] = after, Q.swapaxes(1, 2)

    def sums(self) -> FloatArray:
        """Return the sums (B, D), with the lengths of columns that are not orthonormal yet."""
        V = self.x[:, self.D : -self.D].reshape(-1, self.D, self.D).swapaxes(1, 2)
        R = np.linalg.qr(np.where(np.isfinite(V).all(axis=(1, 2), keepdims=True), V, 0.0))[1]
        rest = abs(np.diagonal(R, axis1=1, axis2=2))
        return self.x[:, -self.D :] + np.log(np.where(rest > 0.0, rest, 1.0))


def growth(
    problem: Problem, steps: int, transient: int, report: Report | None = None
) -> TangentGrowth:
    """Return the sums of Kahan's map over `steps` steps after a transient.

    Tangent vectors follow the transient, too. When `report` is called with a number of steps, all
    trajectories have taken these steps; if it returns False, the sums end there.
    """
    start = flat_arrays(problem.omega, problem.batch)
    B, D = start.shape
    parts = [
        _Part(where, scheme, values, eps, start[where])
        for where, (scheme, values, eps) in groups_of_alike(problem, problem.batch)
    ]
    sums, status, failed_at = np.zeros((B, D)), np.zeros(B, np.int8), np.full(B, -1)
    by_signs, done = np.zeros(B, bool), 0
    length, n = max(CHUNK_WORK // max(400 * B * D, 1), 1), 0
    for last in (transient, transient + steps):
        for part in parts:
            part.begin()
        goes_on = True
        while n < last and goes_on:
            n = min(n + length, last)
            for part in parts:
                part.take(n)
            goes_on = report is None or report(n)
        done = n - transient if last > transient else 0
        if not goes_on:
            break
    for part in parts:
        sums[part.where] = part.sums()
        carry, status[part.where], failed_at[part.where] = part.notes
        by_signs[part.where] = carry[0] < 0.0
        is_pole = (carry[0] != 0.0) & (part.notes[1] == 0)
        status[part.where] = np.where(is_pole, PASSED_POLE, part.notes[1])
        failed_at[part.where] = np.where(is_pole, abs(carry[0]), part.notes[2])
    done = max(done, 0)
    sums[(status < 0) | (done == 0)] = np.nan
    return TangentGrowth(sums, _of_poles(problem, status), failed_at, by_signs, done)


def _of_poles(problem: Problem, status: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return statuses; in three dimensions positive ones become 0, because they mean no pole."""
    if any(steps.notes_poles for steps in problem.map.methods.values()):
        return status
    return np.minimum(status, 0)
