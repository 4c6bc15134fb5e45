"""Derivatives of Kahan's map at states, and the growth of tangent vectors along orbits.

These are the calls of `core.tangent`, and `growth_by_jacobian` for other maps.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core import tangent
from ..core.density import densities
from .arguments import ALL, by_zeros, flat_arrays, in_stages
from .problem import Problem
from .stretches import March, Report
from .threads import available, call_kernel

# Operations of one call of a kernel, about 0.1 s; Python handles Ctrl-C between calls.
_STRETCH = 2**26


def groups_of_alike(problem: Problem) -> Iterator[tuple[Any, Any]]:
    """Yield groups of trajectories, as indices, and the scheme, values and step sizes of each."""
    make = in_stages(problem.map.stages)
    arguments = make(problem.body, problem.eps, problem.batch)
    yield from by_zeros(problem.body.dimension, arguments)


def _of_part(part: slice, *parameters: FloatArray) -> list[FloatArray]:
    """Return the rows of parameters for a part of the batch; a single row is for all of it."""
    return [rows[part] if len(rows) > 1 else rows for rows in parameters]


def _at_states(
    compute: Callable[..., None], problem: Problem, shape: tuple[int, ...]
) -> FloatArray:
    """Return the values (..., *shape) that compute(scheme, values, eps, states, out) writes.

    Each call is for a part of the batch, so that Python handles Ctrl-C in between.
    """
    x, D = flat_arrays(problem.omega, problem.batch), problem.body.dimension
    cost, out = 4 * len(problem.map.stages.fractions) * D**3, np.empty((len(x), *shape))
    width = max(_STRETCH // cost, 1)
    for where, (scheme, *parameters) in groups_of_alike(problem):
        states, values = x[where], out[where]  # views if where is ALL, else copies
        for begin in range(0, len(states), width):
            part = slice(begin, begin + width)
            compute(scheme, *_of_part(part, *parameters), states[part], values[part])
        if where is not ALL:
            out[where] = values
    return out.reshape((*problem.batch, *shape))


def _fill_jacobians(scheme: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
    arguments, _kept_alive = tangent.arguments_of(scheme, values, eps, len(x))
    tangent.jacobians.serial(arguments, x, out)


def _fill_densities(scheme: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
    out[:] = densities(scheme, values, eps, x)


def jacobian(problem: Problem) -> FloatArray:
    """Return the derivatives (..., D, D) of a step."""
    D = problem.body.dimension
    return _at_states(_fill_jacobians, problem, (D, D))


def density(problem: Problem) -> FloatArray:
    """Return 1 / det A (...), the invariant density of a Hamiltonian field."""
    return _at_states(_fill_densities, problem, ())


class Growth(NamedTuple):
    """Sums over the steps of an orbit, from which Lyapunov exponents follow, and its end."""

    sums: FloatArray  # (B, D), of the logarithms of the growth of D orthogonal tangent vectors
    of_det: FloatArray  # (B,), of log(abs(det DPhi))
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # (B,)


def growth(problem: Problem, steps: int, transient: int, report: Report | None = None) -> Growth:
    """Return the sums of Kahan's map over `steps` steps after a transient.

    Tangent vectors go through the transient, too. `report` is called with the number of steps done,
    the mean over all trajectories.
    """
    start, done = flat_arrays(problem.omega, problem.batch), 0

    def count(steps_of_all: int) -> None:
        nonlocal done
        done += steps_of_all
        if report is not None:
            report(done // len(start))

    whole: Any = _no_growth(len(start), start.shape[1])
    for where, (scheme, *parameters) in groups_of_alike(problem):
        states, cost = start[where], tangent.operations_of(scheme)
        of_group: Any = _no_growth(*states.shape)
        # A call takes few trajectories through about 64 steps, not many through few, because it
        # reads and writes D**2 numbers for each trajectory.
        block = 64 * (problem.threads or available())
        width = max(block, _STRETCH // (64 * cost) // block * block)
        width = max(min(len(states), width, _STRETCH // cost), 1)
        for begin in range(0, len(states), width):
            part = slice(begin, begin + width)
            x = states[part]
            values, eps = _of_part(part, *parameters)
            arguments, _kept_alive = tangent.arguments_of(scheme, values, eps, len(x))
            of_part = Growth(*(array[part] for array in of_group))
            ends = transient, transient + steps
            _grow(arguments, x, of_part, ends, cost, problem.threads, count)
        for k, array in enumerate(of_group):
            whole[k][where] = array
    if not any(steps.notes_poles for steps in problem.map.methods.values()):
        whole.status[whole.status > 0] = 0  # maps in three dimensions have no such status
    growth: Growth = whole
    return growth


def _no_growth(B: int, D: int) -> Growth:
    """Return sums of 0 for trajectories that have not failed."""
    return Growth(np.zeros((B, D)), np.zeros(B), np.zeros(B, np.int8), np.full(B, -1))


def _grow(
    arguments: Any,
    x: FloatArray,
    growth: Growth,
    ends: tuple[int, int],
    cost: int,
    threads: int | None,
    count: Callable[[int], None],
) -> None:
    """Write the sums of trajectories over the steps from the first end to the second to `growth`.

    After each call of the kernel, `count` takes the number of its steps, of all trajectories.
    """
    (B, D), n = x.shape, 0
    carry, length = np.empty((B, 2 * D + D * D + 3)), max(_STRETCH // (cost * max(B, 1)), 1)
    for last in ends:
        growth.sums[:], growth.of_det[:] = 0.0, 0.0  # those over the transient do not count
        while n < last:
            span = n, min(n + length, last), last
            work = cost * B * (span[1] - n) // 20  # an operation is 1/20 of a step of the 3D map
            call_kernel(tangent.growth, work, threads, arguments, x, carry, span, *growth)
            count(B * (span[1] - n))
            n = span[1]
    growth.sums[growth.status < 0] = np.nan


def growth_by_jacobian(
    problem: Problem, steps: int, transient: int, report: Report | None = None
) -> Growth:
    """Return the sums of `growth` for any map, from products of its "jacobian"."""
    compute = problem.map.formulas["jacobian"].compute
    start = np.broadcast_to(problem.omega, (*problem.batch, problem.body.dimension)).copy()
    march = March(problem._replace(omega=start))
    march.to(transient + steps)
    status, failed_at = march.status.reshape(-1), march.failed_at.reshape(-1)
    start[march.status < 0] = np.nan  # where an orbit fails, the formula may overflow or raise
    march = March(problem._replace(omega=start))
    B, D = march.omega0.shape
    sums, of_det, Q = np.zeros((B, D)), np.zeros(B), np.eye(D)
    rows = max(_STRETCH // max(B * D**3, 1) // 16, 1)  # 16: NumPy is slower than a kernel
    n = 0
    for states, _ in march.pieces(transient + steps - 1, 1, rows):
        piece = problem._replace(omega=states, batch=(len(states), *problem.batch))
        for slopes in compute(piece).reshape(len(states), B, D, D):
            of_det += np.linalg.slogdet(slopes)[1]
            Q, R = np.linalg.qr(slopes @ Q)
            sums += np.log(abs(np.diagonal(R, axis1=1, axis2=2)))
            n += 1
            if n == transient:
                sums, of_det = np.zeros((B, D)), np.zeros(B)
        if report is not None:
            report(n)
    return Growth(sums, of_det, status, failed_at)
