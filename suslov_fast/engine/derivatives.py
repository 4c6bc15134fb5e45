"""Derivatives of Kahan's map at states, and the growth of tangent vectors along orbits.

These are the calls of `core.fields.tangent`.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, common_shape
from ..core.fields import tangent
from ..core.fields.density import densities
from ..core.fields.driver import WIDTH
from .arguments import ALL, by_zeros, flat_arrays, in_stages
from .problem import Problem
from .stretches import Report
from .threads import available, call_kernel

# Operations of one call of a kernel, some tenths of a second; Python handles Ctrl-C in between.
STRETCH = 2**28
_IN_PYTHON = 1e-5  # seconds of Python for a number of a step


def groups_of_alike(problem: Problem, batch: tuple[int, ...]) -> Iterator[tuple[Any, Any]]:
    """Yield groups of a batch, as indices, and the scheme, values and step sizes of each."""
    make = in_stages(problem.map.stages)
    arguments = make(problem.body, problem.eps, batch)
    yield from by_zeros(arguments)


def _at_states(
    compute: Callable[..., None], problem: Problem, own: tuple[int, ...], shape: tuple[int, ...]
) -> FloatArray:
    """Return the values (..., *shape) that compute(scheme, values, eps, states, out) writes.

    Parameters have the last axes of the batch, `own`; along those before them are more states of
    the same fields. Each call is for states (rows, fields, D).
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
    in_lines = rows > 1 and fields > 1  # of states of one field
    arguments, _alive = tangent.arguments_of(scheme, values, eps, rows * fields, in_lines)
    if in_lines:  # lanes without a row repeat the last one
        x = np.concatenate([x, x[-1:].repeat(-rows % arguments.W, axis=0)])
        x = x.reshape(-1, arguments.W, fields, D).swapaxes(1, 2)
    states = x.reshape(-1, D)
    found = np.empty((len(states), D, D))
    seconds = _IN_PYTHON * (len(states) + 8) * D * D * len(arguments.fractions)
    tangent.jacobians.briefly(seconds, able := tangent.able(arguments), states, found)
    if arguments.unable[0] and not able.solves:
        tangent.jacobians.briefly(seconds * D, tangent.able(arguments), states, found)
    if in_lines:
        found = found.reshape(-1, fields, arguments.W, D, D).swapaxes(1, 2)
    out[:] = found.reshape(-1, fields, D, D)[:rows]


def _fill_densities(scheme: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
    out[0] = densities(scheme, values, eps, x[0])


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
    return _at_states(_fill_densities, problem, problem.batch, ())


class Growth(NamedTuple):
    """Sums over the steps of an orbit, from which Lyapunov exponents follow, and its end."""

    sums: FloatArray  # (B, D), of the logarithms of the growth of D orthogonal tangent vectors
    of_det: FloatArray  # (B,), of log(abs(det DPhi))
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # (B,)
    by_signs: NDArray[np.bool_]  # (B,), true where a change of sign told the pole
    steps: int  # of the sums: fewer than asked for if `report` ended the run, or 0


class _Part(NamedTuple):
    """Some trajectories with the same operations of a step, and their sums so far."""

    where: Any  # their indices
    arguments: Any  # of `tangent.growth`, and what these need to stay alive
    x: FloatArray
    carry: FloatArray
    sums: tuple[NDArray[Any], ...]  # the arrays of `Growth`
    cost: int  # operations of a step


def growth(problem: Problem, steps: int, transient: int, report: Report | None = None) -> Growth:
    """Return the sums of Kahan's map over `steps` steps after a transient.

    Tangent vectors go through the transient, too. With `report` all trajectories stand at the same
    step whenever it is called with this number; if it returns False, the sums end there.
    """
    start = flat_arrays(problem.omega, problem.batch)
    whole, done = _no_sums(*start.shape), steps
    ends = transient, transient + steps
    parts = _parts(problem, start)
    for together in [[*parts]] if report is not None else ([part] for part in parts):
        done = _grow(together, ends, problem.threads, report)
        for part in together:
            for array, of_part in zip(whole, part.sums, strict=True):
                array[part.where] = of_part
    sums, of_det, status, failed_at, by_signs = whole
    sums[(status < 0) | (done == 0)] = np.nan
    return Growth(sums, of_det, _of_poles(problem, status), failed_at, by_signs, done)


def _of_poles(problem: Problem, status: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return statuses without positive ones of maps in three dimensions, which tell of no pole."""
    if any(steps.notes_poles for steps in problem.map.methods.values()):
        return status
    return np.minimum(status, 0)


def _no_sums(B: int, D: int) -> Any:
    """Return the arrays of `Growth` for trajectories that have taken no step."""
    status, by_signs = np.zeros(B, np.int8), np.zeros(B, bool)
    return np.zeros((B, D)), np.zeros(B), status, np.full(B, -1), by_signs


def _parts(problem: Problem, start: FloatArray) -> Iterator[_Part]:
    """Divide a batch into parts.

    A call takes few trajectories through about 64 steps, not many through few, because it reads and
    writes D**2 numbers for each trajectory.
    """
    for where, (scheme, *parameters) in groups_of_alike(problem, problem.batch):
        states, cost = start[where], tangent.operations_of(scheme)
        block = 64 * (problem.threads or available())
        width = max(block, STRETCH // (64 * cost) // block * block)
        width = max(min(len(states), width, STRETCH // cost), 1)
        for begin in range(0, len(states), width):
            part = slice(begin, begin + width)
            x = states[part]
            # A single row of a parameter is for all of the batch.
            values, eps = (rows[part] if len(rows) > 1 else rows for rows in parameters)
            arguments = tangent.arguments_of(scheme, values, eps, len(x))
            carry, sums = tangent.carry_of(arguments[0], *x.shape), _no_sums(*x.shape)
            yield _Part(part if where is ALL else where[part], arguments, x, carry, sums, cost)


def _grow_part(part: _Part, span: tuple[int, int, int], work: int, threads: int | None) -> None:
    """Add the logarithms of some steps; take them anew where a lane is found to need `solve`."""
    arguments, carried = tangent.able(part.arguments[0]), (part.carry, *part.sums)
    before = [] if arguments.solves else [array.copy() for array in carried]
    arrays = part.x, part.carry, span, *part.sums
    (start, stop, _), (size, D) = span, part.x.shape
    seconds = _IN_PYTHON * (size + 8) * (stop - start + D * D)
    call_kernel(tangent.growth, work, threads, arguments, *arrays, seconds=seconds)
    if arguments.unable[0] and not arguments.solves:
        for array, kept in zip(carried, before, strict=True):
            array[:] = kept
        arguments = tangent.able(arguments)
        call_kernel(tangent.growth, work, threads, arguments, *arrays, seconds=seconds * D)


def _grow(
    parts: list[_Part], ends: tuple[int, int], threads: int | None, report: Report | None
) -> int:
    """Add the steps from the first end to the second to the sums of some parts.

    Return the number of steps, which is smaller if `report` ended the run.
    """

    def take(start: int, stop: int, last: int) -> None:
        for part in parts:
            # An operation is 1/20 of a step of the 3D map.
            work = part.cost * len(part.x) * (stop - start) // 20
            _grow_part(part, (start, stop, last), work, threads)

    length = max(STRETCH // max(sum(part.cost * len(part.x) for part in parts), 1), 1)
    n, (transient, end) = 0, ends
    for last in ends:
        for part in parts:  # sums over the transient do not count
            part.sums[0][:], part.sums[1][:] = 0.0, 0.0
        while n < last:
            until = min(n + length, last)
            take(n, until, last)
            n = until
            if report is not None and not report(n):
                if transient < n < end:  # one more step, after which all logarithms are taken
                    take(n, n + 1, n + 1)
                    n += 1
                return max(n - transient, 0)
    return n - transient
