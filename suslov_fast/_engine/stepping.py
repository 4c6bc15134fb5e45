"""Runs iterated step by step, in stretches between which Python handles Ctrl-C.

A stretch takes 10 ms to 100 ms, and longer only where steps need elimination.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numba
import numpy as np

from .._checks import FloatArray
from .._jit import LINE, Kernel
from .._kernels import blocks_nd
from .._kernels.codes import NEEDS_ELIMINATION
from .._kernels.elimination import WIDEST, WIDTH
from .._kernels.lanes import LANES
from .._kernels.map_nd import LANES_ND
from . import threads as _threads
from .layout import alike
from .memory import require
from .problem import NO_TRAJECTORIES, Indices, Output, Problem, Span

_NO_TURN = 1.0, 0.0, 0.0, 0.0
# Largest number of equations of which WIDEST systems fit in the second cache.
_FEW = 12

# Work of a thread in a stretch, in steps of one trajectory of the 3D map.
_STRETCH = 2**26
# Least numbers of trajectories and of steps of a stretch, if there are as many, each divided by the
# work of a step: entering a trajectory costs tens of steps of the 3D map.
_ABREAST, _LENGTH = 2**13, 2**8
# Cost of saving a state, in steps of the 3D map.
_SAVING = 8

# Trajectories begin to end, from state start to state stop; the steps between saved states, and the
# number of those before.
Stretch = tuple[int, int, int, int, int, int]


def iterate_3d(
    problem: Problem, span: Span, output: Output, kernel: Kernel, step: float = 1.0
) -> Indices:
    """Iterate by a kernel of `map_kernel`; `step` is the cost of a step, in those of the 3D map."""
    shape = problem.size if problem.continued else 0, len(kernel.names["map"].State._fields)
    (state,) = _carried(span, output, state=np.empty(shape))
    turning = None
    if problem.orientation is not None:
        (turn,) = _carried(span, output, turn=np.tile(_NO_TURN, (problem.size, 1)))
        turning = problem.parameters[-1], problem.orientation, turn, output.turns
    results = output.final, output.status, output.failed_at, state
    before = problem.parameters, problem.omega0
    for stretch, work in stretches_of(problem, span, step, LANES):
        _threads.call_kernel(
            kernel, work, problem.threads, *before, stretch, output.saved, turning, results
        )
    return NO_TRAJECTORIES


def iterate_nd(
    problem: Problem, span: Span, output: Output, kernel: Kernel, elimination: float = 0.0
) -> Indices:
    """Iterate the n-dimensional map; return the trajectories for which steps in O(n) do not do.

    There are none with elimination, whose cost in a step is `elimination` m**3, in steps of the 3D
    map. Raises MemoryError if there is no room for it where it is needed.
    """
    size, m = problem.omega0.shape
    step, eliminates = max(8.0 * m, elimination * m**3), elimination > 0.0
    tasks, lanes = _tasks_and_lanes(size, problem.threads, eliminates)
    state, exponent = _carried(span, output, state=np.empty((size, m)), exponent=np.empty(size))
    turned, turning = problem.orientation, None
    if turned is not None:  # transposed, and rotated in place
        (columns,) = _carried(span, output, columns=turned.swapaxes(1, 2).copy())
        scratch = np.empty((tasks, m, lanes)), np.empty((tasks, 2 * m + 4, m + 1))
        turning = problem.parameters[-1], columns, output.turns, *scratch
    results = output.final, output.status, output.failed_at, state, exponent
    M = m + m % 2
    # A build for a body that all lanes share pays only for the cheapest steps.
    shared = not eliminates and turning is None and max(map(len, problem.parameters[:2])) <= 1
    of_body = () if shared else (lanes,)
    of_lanes = np.empty((tasks, 2, M, *of_body)), np.empty((tasks, 2, M, lanes))
    advice = "method='rank2', fewer threads, or shorter steps"
    matrices = None
    if eliminates:
        matrices = _on_a_cache_line((tasks, m, m + 1, lanes), advice), *for_one_system(tasks, m)
    before = (*problem.parameters, problem.omega0)
    after = output.saved, turning, results, (*of_lanes, matrices)
    for stretch, work in stretches_of(problem, span, step, LANES_ND):
        _threads.call_kernel(kernel, work, problem.threads, before, stretch, *after)
    if output.turns is not None and len(output.turns) and not span.rows:
        output.turns[-1] = columns.swapaxes(1, 2)
    return output.with_status(NEEDS_ELIMINATION)


def iterate_field(problem: Problem, span: Span, output: Output) -> Indices:
    size, D = problem.omega0.shape
    (state,) = _carried(span, output, state=np.empty((size, D)))
    results = output.final, output.status, output.failed_at, state
    step = D**3 / 3.0 + len(problem.parameters[1])
    lanes = WIDEST if D <= _FEW and size >= WIDEST else WIDTH
    tasks = min(problem.threads or numba.get_num_threads(), max(-(-size // lanes), 1))
    of_lanes = _on_a_cache_line((tasks, 2, D, D + 1, lanes)), _on_a_cache_line((tasks, 2, D, lanes))
    memory = *of_lanes, *for_one_system(tasks, D)
    before, after = (*problem.parameters, problem.omega0), (output.saved, None, results, memory)
    for stretch, work in stretches_of(problem, span, step, lanes):
        _threads.call_kernel(blocks_nd.field, work, problem.threads, before, stretch, *after)
    return NO_TRAJECTORIES


def _carried(span: Span, output: Output, **starts: FloatArray) -> list[FloatArray]:
    """Return arrays that kernels carry from step to step, and the output keeps, by name.

    A resumed run continues with copies of its own, and from its own statuses.
    """
    if span.start:
        output.status[:], output.failed_at[:] = span.resume["status"], span.resume["failed_at"]
        starts = {name: span.resume[name].copy() for name in starts}
    output.resume.update(starts)
    return list(starts.values())


def _tasks_and_lanes(size: int, threads: int | None, eliminates: bool) -> tuple[int, int]:
    """Return the number of tasks, and the number of lanes of a block."""
    blocks = max(-(-size // (WIDTH if eliminates else LANES_ND)), 1)
    tasks = min(threads or numba.get_num_threads(), blocks) if blocks > 1 else 1
    if eliminates:
        return tasks, WIDTH
    # Tasks have equal numbers of blocks, of about equal size.
    blocks = -(-blocks // tasks) * tasks
    lanes = -(-max(size, 1) // (blocks * LINE)) * LINE
    return tasks, lanes


def for_one_system(tasks: int, m: int) -> tuple[FloatArray, FloatArray]:
    """Return memory in which each task solves one system of m equations, see `solve_system`."""
    return np.empty((tasks, 2, m, m + 1)), np.empty((tasks, 2, m))


def _on_a_cache_line(shape: tuple[int, ...], advice: str = "fewer threads") -> FloatArray:
    """Return memory for matrices that begins on a cache line."""
    require(8 * math.prod(shape), f"elimination works in {{}}: use {advice}", shape)
    memory = np.empty(math.prod(shape) + LINE)
    first = -(memory.ctypes.data // 8) % LINE  # vectors across two cache lines take a fifth longer
    return memory[first : first + math.prod(shape)].reshape(shape)


def stretches_of(
    problem: Problem, span: Span, step: float, lanes: int
) -> Iterator[tuple[Stretch, int]]:
    """Yield the stretches to compute one after another, and the work of each for several threads.

    `step` is the cost of a step of one trajectory, in steps of the 3D map. A thread takes `lanes`
    trajectories at a time, in the time of all lanes; such a block is not worth a second thread. The
    batch is divided first, so that the data of a stretch stay in the caches; time is divided only
    if few trajectories take long.
    """
    size, count = len(problem.omega0), span.steps - span.start
    cost = step + (_SAVING / span.every if span.rows else 0.0)
    blocks = -(-size // lanes)
    width, length = blocks * lanes or 1, max(count, 1)
    if width * length * cost > _STRETCH:
        most = problem.threads or numba.config.NUMBA_NUM_THREADS
        of_stretch = min(blocks, most) * _STRETCH / cost
        abreast = max(lanes * most, int(_ABREAST / step), int(of_stretch / length))
        width = alike(width, abreast, lanes)
        length = max(int(_LENGTH / step), int(of_stretch / width), 1)
    for begin in range(0, size, width):
        end = min(begin + width, size)
        for start in range(span.start, max(span.steps, span.start + 1), length):
            stop = min(start + length, span.steps)
            work = (end - begin) * (stop - start) * step if end - begin > lanes else 0
            yield (begin, end, start, stop, span.every, span.rows_before), int(work)
            if problem.progress is not None:
                done = begin * count + (end - begin) * (stop - span.start)
                problem.progress(done // size)
