"""Runs iterated step by step."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np

from .._checks import FloatArray
from .._jit import LINE, Kernel
from .._kernels import kahan, map_nd
from .._kernels.codes import NEEDS_ELIMINATION
from .._kernels.elimination import WIDEST, WIDTH
from .._kernels.lanes import LANES
from . import threads
from .memory import require
from .run import Results, Run, not_computed, run_some, worst

_NO_TURN = 1.0, 0.0, 0.0, 0.0
# Largest number of equations of which WIDEST systems fit in the second cache.
_FEW = 12


def iterate(run: Run, kernel: Kernel, work: float = 1.0) -> Results:
    """Iterate by a kernel of `map_kernel`; `work` is the cost of a step, in those of the 3D map."""
    resume, turning, numbers = _resume(run), None, kernel.names["map"].STATE
    if not run.start:
        resume["state"] = np.empty((0 if run.single else run.size, numbers))
    if run.orientation is not None:
        if not run.start:
            resume["turn"] = np.tile(_NO_TURN, (run.size, 1))
        turning = run.time_step, run.orientation, resume["turn"], run.turns
    kept = resume["status"], resume["failed_at"], resume["state"]
    before = run.parameters, run.omega0
    final = _make_steps(run, kernel, work, LANES, before, turning, kept)
    return Results(final, resume["status"], resume["failed_at"], resume)


def iterate_nd(run: Run, otherwise: Callable[[Run], Results] | None = None) -> Results:
    """Iterate the n-dimensional map.

    Trajectories for which steps in O(n) are inaccurate are computed by `otherwise`, or iterated
    with elimination.

    Raises
    ------
    MemoryError
        If there is no room for elimination where that is needed.
    """
    if run.method == "gauss":
        return _iterate_nd(run, map_nd.iterate_by_elimination)
    results = _iterate_nd(run, map_nd.iterate)
    if worst(results.status) == NEEDS_ELIMINATION:
        eliminate = partial(_iterate_nd, kernel=map_nd.iterate_with_elimination)
        some = np.flatnonzero(results.status == NEEDS_ELIMINATION)
        run_some(run, some, otherwise or eliminate, results)
    return results


def _iterate_nd(run: Run, kernel: Kernel) -> Results:
    size, m = run.omega0.shape
    work, plain = 8.0 * m, kernel is map_nd.iterate
    if not plain:  # if every step in O(n) needs elimination, the first part takes some 0.3 s
        by_elimination = kernel is map_nd.iterate_by_elimination
        work = m**3 / 3.0 if by_elimination else max(work, m**3 / 48.0)
    tasks, lanes = _tasks_and_lanes(size, run.threads)
    resume, turning = _resume(run), None
    if not run.start:
        resume["state"], resume["exponent"] = np.empty((size, m)), np.empty(size)
    if run.orientation is not None:
        if not run.start:  # transposed, and rotated in place
            resume["columns"] = run.orientation.swapaxes(1, 2).copy()
        room_of_turns = np.empty((tasks, m, lanes)), np.empty((tasks, 2 * m + 4, m + 1))
        turning = run.time_step, resume["columns"], run.turns, *room_of_turns
    kept = tuple(resume[name] for name in ("status", "failed_at", "state", "exponent"))
    M = m + m % 2
    # A build for a body that all lanes share pays only for the cheapest steps.
    shared = plain and turning is None and max(map(len, run.parameters[:2])) <= 1
    of_body = () if shared else (lanes,)
    room = (
        np.empty((tasks, 2, M, *of_body)),
        np.empty((tasks, 2, M, lanes)),
        np.empty((tasks, 0, 1, 1)) if plain else _matrices(tasks, m),
    )
    before = ((*run.parameters, run.omega0),)
    final = _make_steps(run, kernel, work, map_nd.LANES, before, turning, kept, room)
    if turning and len(run.turns) and not len(run.saved):
        run.turns[-1] = resume["columns"].swapaxes(1, 2)
    return Results(final, resume["status"], resume["failed_at"], resume)


def iterate_field(run: Run) -> Results:
    """Iterate Kahan's map of a quadratic field."""
    size, D = run.omega0.shape
    resume = _resume(run)
    if not run.start:
        resume["state"] = np.empty((size, D))
    kept = tuple(resume[name] for name in ("status", "failed_at", "state"))
    indices, values, parameters = run.parameters
    work = D**3 / 3.0 + sum(each.shape[1] for each in indices)
    room = _room_of_field(size, D, indices, run.threads)
    before = indices, values, (*parameters, run.omega0)
    final = _make_steps(run, kahan.iterate_field, work, room[1].shape[3], before, None, kept, room)
    return Results(final, resume["status"], resume["failed_at"], resume)


def equations_of_field(
    flat: Any, states: FloatArray, threads_wanted: int | None, solves: bool
) -> FloatArray:
    """Return A and minus half the step size times f, or A**-1 f, (B, D, D + 1).

    `flat` is what `Map.parameters` returns.
    """
    indices, values, parameters = flat
    size, D = states.shape
    kept = states, np.empty(size, np.int8), np.empty(size, np.int64), states
    out = np.empty((size, D, D + 1))
    room = _room_of_field(size, D, indices, threads_wanted)
    work = size * (D * D + sum(each.shape[1] for each in indices) + solves * D**3 // 3)
    arguments = indices, values, (*parameters, states), kept, solves, out, room
    threads.run(kahan.equations, work, threads_wanted, *arguments)
    return out


def _room_of_field(
    size: int, D: int, indices: Any, threads_wanted: int | None
) -> tuple[FloatArray, ...]:
    """Return memory for blocks of trajectories, whose equations fit in the second cache."""
    lanes = WIDEST if D <= _FEW and size >= WIDEST else WIDTH
    tasks = min(threads_wanted or numba.get_num_threads(), max(-(-size // lanes), 1))
    return (
        _aligned((tasks, 2, D, D + 1, lanes)),
        _aligned((tasks, 2, D, lanes)),
        _aligned((tasks, indices[1].shape[1], lanes)),
    )


def _resume(run: Run) -> dict[str, Any]:
    """Return status and failed_at for kernels to fill, or copies of the data of a resumed run."""
    if run.start:
        return {name: array.copy() for name, array in run.resume.items()}
    return {"status": not_computed(run.size), "failed_at": np.empty(run.size, np.int64)}


def _make_steps(
    run: Run,
    kernel: Kernel,
    work: float,
    lanes: int,
    before: tuple[Any, ...],
    turning: tuple[FloatArray, ...] | None,
    kept: tuple[Any, ...],
    *room: tuple[FloatArray, ...],
) -> FloatArray:
    """Call the kernel for each part; return the last states."""
    final = run.saved[-1] if run.saves_last else np.empty(run.omega0.shape)
    for part in run.parts(work, lanes):
        threads.run(
            kernel,
            part.work(lanes, work),
            run.threads,
            *before,
            (*part, run.every, run.rows_before),
            run.saved,
            turning,
            (final, *kept),
            *room,
        )
    return final


def _tasks_and_lanes(size: int, threads: int | None) -> tuple[int, int]:
    """Return the number of tasks, and the number of lanes of a block."""
    blocks = max(-(-size // map_nd.LANES), 1)
    tasks = min(threads or numba.get_num_threads(), blocks) if blocks > 1 else 1
    # Tasks have equal numbers of blocks, of about equal size.
    blocks = -(-blocks // tasks) * tasks
    lanes = -(-max(size, 1) // (blocks * LINE)) * LINE
    return tasks, lanes


def _matrices(tasks: int, m: int) -> FloatArray:
    """Return memory for elimination."""
    return _aligned((tasks, m + 4, m + 1, WIDTH), "method='rank2', fewer threads, or shorter steps")


def _aligned(shape: tuple[int, ...], advice: str = "fewer threads") -> FloatArray:
    """Return memory for matrices that begins on a cache line."""
    require(8 * math.prod(shape), f"elimination works in {{}}: use {advice}", shape)
    memory = np.empty(math.prod(shape) + LINE)
    first = -(memory.ctypes.data // 8) % LINE  # vectors across two cache lines take a fifth longer
    return memory[first : first + math.prod(shape)].reshape(shape)
