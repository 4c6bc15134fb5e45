"""Derivatives of Kahan's map at states, and along orbits: the calls of `core.tangent`."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core import tangent
from .arguments import ALL, by_zeros, flat_arrays, in_stages
from .problem import Problem
from .stretches import March, Report
from .threads import call_kernel

# Operations of a call of a kernel; Ctrl-C is handled between calls.
_STRETCH = 2**26


def with_fields(problem: Problem) -> Iterator[tuple[Any, Any]]:
    """Yield some trajectories, and the method, values and step sizes of theirs."""
    make = in_stages(problem.map.fractions)
    given = make(problem.body, problem.eps, problem.batch)
    yield from by_zeros(problem.body.dimension, given)


def _some(part: slice, *parameters: FloatArray) -> list[FloatArray]:
    """Return rows of parameters, which have one for each trajectory, or one for all."""
    return [each[part] if len(each) > 1 else each for each in parameters]


def _at_states(
    compute: Callable[..., None], problem: Problem, shape: tuple[int, ...]
) -> FloatArray:
    """Return what compute(method, values, eps, states, out) writes, of this shape for each state.

    The batch is divided, so that Ctrl-C is handled.
    """
    x, D = flat_arrays(problem.omega, problem.batch), problem.body.dimension
    cost, out = 4 * len(problem.map.fractions) * D**3, np.empty((len(x), *shape))
    width = max(_STRETCH // cost, 1)
    for where, (method, *parameters) in with_fields(problem):
        some, found = x[where], out[where]  # views of all, or copies
        for begin in range(0, len(some), width):
            part = slice(begin, begin + width)
            compute(method, *_some(part, *parameters), some[part], found[part])
        if where is not ALL:
            out[where] = found
    return out.reshape((*problem.batch, *shape))


def _fill_jacobians(method: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
    given = tangent.arguments_of(method, values, eps, len(x))
    tangent.jacobians.serial(given, x, out)


def _fill_densities(method: Any, values: Any, eps: Any, x: FloatArray, out: FloatArray) -> None:
    out[:] = tangent.densities(method, values, eps, x)


def jacobian(problem: Problem) -> FloatArray:
    D = problem.body.dimension
    return _at_states(_fill_jacobians, problem, (D, D))


def density(problem: Problem) -> FloatArray:
    return _at_states(_fill_densities, problem, ())


class Growth(NamedTuple):
    """Sums of logarithms along orbits: of D lengths, and of abs(det DPhi); and how they ended."""

    sums: FloatArray  # (B, D)
    of_det: FloatArray  # (B,)
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # (B,)


def growth(problem: Problem, steps: int, transient: int, report: Report | None = None) -> Growth:
    """Return the sums over steps after a transient, through which columns go, too.

    `report` takes the number of steps done, the mean over all trajectories.
    """
    start, done = flat_arrays(problem.omega, problem.batch), 0

    def told(taken: int) -> None:
        nonlocal done
        done += taken
        if report is not None:
            report(done // len(start))

    whole: Any = _no_growth(len(start), start.shape[1])
    for where, (method, *parameters) in with_fields(problem):
        some, cost = start[where], tangent.operations_of(method)
        found: Any = _no_growth(*some.shape)
        # Few trajectories for some 64 steps, rather than many for few: D**2 numbers are carried.
        block = 64 * (problem.threads or numba.get_num_threads())
        width = max(block, _STRETCH // (64 * cost) // block * block)
        width = max(min(len(some), width, _STRETCH // cost), 1)
        for begin in range(0, len(some), width):
            part = slice(begin, begin + width)
            own = some[part]
            values, eps = _some(part, *parameters)
            given = tangent.arguments_of(method, values, eps, len(own))
            of_part = Growth(*(each[part] for each in found))
            ends = transient, transient + steps
            _grow(given, own, of_part, ends, cost, problem.threads, told)
        for k, of_some in enumerate(found):
            whole[k][where] = of_some
    if not any(
        steps.notes_poles for steps in problem.map.methods.values()
    ):  # as in three dimensions
        whole.status[whole.status > 0] = 0
    growth: Growth = whole
    return growth


def _no_growth(B: int, D: int) -> Growth:
    return Growth(np.zeros((B, D)), np.zeros(B), np.zeros(B, np.int8), np.full(B, -1))


def _grow(
    given: Any,
    x: FloatArray,
    found: Growth,
    ends: tuple[int, int],
    cost: int,
    threads: int | None,
    told: Callable[[int], None],
) -> None:
    """Find the sums of `growth` for some trajectories, from the first end to the second.

    `told` takes the number of steps of a call, those of all of these trajectories.
    """
    (B, D), n = x.shape, 0
    carry, length = np.empty((B, 2 * D + D * D + 3)), max(_STRETCH // (cost * max(B, 1)), 1)
    for last in ends:
        found.sums[:], found.of_det[:] = 0.0, 0.0
        while n < last:
            span = n, min(n + length, last), last
            # Threads are worth it for a twentieth of the operations that a kernel of Numba takes.
            work = cost * B * (span[1] - n) // 20
            call_kernel(tangent.growth, work, threads, given, x, carry, span, *found)
            told(B * (span[1] - n))
            n = span[1]
    found.sums[found.status < 0] = np.nan


def growth_by_jacobian(
    problem: Problem, steps: int, transient: int, report: Report | None = None
) -> Growth:
    """Return the sums of `growth` for any map, from its formula of the Jacobian."""
    compute = problem.map.formulas["jacobian"].compute
    start = np.broadcast_to(problem.omega, (*problem.batch, problem.body.dimension)).copy()
    march = March(problem._replace(omega=start))
    march.to(transient + steps)
    status, failed_at = march.status.reshape(-1), march.failed_at.reshape(-1)
    start[march.status < 0] = np.nan  # at their last states a formula may overflow, or raise
    march = March(problem._replace(omega=start))
    B, D = march.omega0.shape
    sums, of_det, Q = np.zeros((B, D)), np.zeros(B), np.eye(D)
    rows = max(_STRETCH // max(B * D**3, 1) // 16, 1)  # NumPy takes longer than a kernel
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
