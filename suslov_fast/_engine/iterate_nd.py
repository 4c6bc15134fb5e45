"""Runs of the n-dimensional map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TypeAlias

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._core.codes import NEEDS_ELIMINATION, NOT_COMPUTED
from .._core.cpu import map_nd
from .._core.cpu.elimination import matrix_shape
from .._core.cpu.vector import VECTOR
from . import threads
from .problem import Outcome, Part, Problem, check_computed, never, not_computed, worst

_ALL = np.empty(0, np.int64)
# Numbers, and rows of a matrix, between what tasks work in: the processor fetches ahead, also what
# another thread writes, which slows both (measured with 0 to 4,096 numbers and 0 to 300 rows).
_AHEAD = 4096, 40
# To work in: for all, for elimination, and for orientations, as `map_nd.iterate` takes it.
_Room: TypeAlias = tuple[tuple[FloatArray, ...], FloatArray | None, tuple[FloatArray, ...] | None]


def run(problem: Problem) -> Outcome:
    """Iterate a checked problem.

    Raises
    ------
    MemoryError
        If there is no room to work in.
    """
    run = _Run(problem)
    for part in problem.parts(run.work, map_nd.block_size(problem.omega.shape[1])):
        run.compute(part)
    return run.outcome()


class _Run:
    """The arrays of a run."""

    def __init__(self, problem: Problem) -> None:
        size, m = problem.omega.shape
        gauss = problem.method == "gauss"
        # The O(n) step may have to eliminate each time: then the first part takes some 0.3 s.
        self.work = m**3 / 3.0 if gauss else max(8.0 * m, m**3 / 48.0)
        self.problem = problem
        # Trajectories of the blocks that threads share out.
        self.shared = min(map_nd.block_size(m), map_nd.SHARED)
        self.method = map_nd.GAUSS if gauss else map_nd.RANK2
        self.bodies = (*problem.parameters, problem.time_step)  # as `map_nd.Bodies`
        self.saved = (problem.saved, problem.turns)  # as `map_nd.Saved`
        self.kept = _kept(problem)
        # Few trajectories need elimination, which takes long to compile and much room: without
        # orientations, which are turned in place, they are computed anew.
        self.rooms = self._room(size, gauss or problem.orientation is not None)

    def _room(self, size: int, eliminates: bool) -> _Room:
        """Room for so many trajectories, as much as threads can use at once."""
        m, blocks = self.problem.omega.shape[1], -(-size // self.shared)
        tasks = min(self.problem.threads or numba.get_num_threads(), blocks) if blocks > 1 else 1
        groups = -(-min(map_nd.block_size(m), max(size, 1)) // VECTOR)
        numbers, rows = _AHEAD if tasks > 1 else (0, 0)
        shapes: list[tuple[int, ...]] = [
            (tasks, (groups * m + VECTOR) * map_nd.CELL + numbers),
            (tasks, groups * map_nd.GROUP + numbers),
            (tasks, groups * VECTOR * m + VECTOR + numbers),
        ]
        if eliminates:
            height, *row = matrix_shape(m)
            shapes.append((tasks, height + rows, *row))
        if self.problem.orientation is not None:
            shapes += [(tasks, groups * VECTOR, m), (tasks, 2 * m + 4, m + 1)]
        cells, sums, tile, *others = _arrays(*shapes)
        return (
            (cells, sums, tile),
            others[0] if eliminates else None,
            None if self.problem.orientation is None else tuple(others[1:]),
        )

    def compute(self, part: Part) -> None:
        status = self.kept.status[part.begin : part.end]
        if part.start:  # else they are new
            status[self.kept.failed_at[part.begin : part.end] < 0] = NOT_COMPUTED
        self._call(part, _ALL, self.rooms)
        if worst(status) == NEEDS_ELIMINATION:
            left = np.flatnonzero(status == NEEDS_ELIMINATION)
            status[left] = NOT_COMPUTED
            rooms = self._room(left.size, True)
            self._call(part._replace(begin=0, end=left.size), left + part.begin, rooms)
        check_computed(status)

    def _call(self, part: Part, chosen: NDArray[np.intp], rooms: _Room) -> None:
        every, first_row = self.problem.every, self.problem.first_row
        threads.run(
            map_nd.iterate,
            part.work(self.shared, self.work),
            self.problem.threads,
            self.method,
            self.bodies,
            self.problem.omega,
            (chosen, *part, every, first_row),
            self.saved,
            tuple(self.kept),
            *rooms,
        )

    def outcome(self) -> Outcome:
        kept = self.kept
        resume = {name: getattr(kept, name) for name in _names(self.problem)}
        if len(self.problem.turns) and not len(self.problem.saved):
            self.problem.turns[-1] = kept.columns.swapaxes(1, 2)
        return Outcome(kept.final, kept.status, kept.failed_at, resume)


def _names(problem: Problem) -> list[str]:
    """What a run is gone on with from."""
    turning = ["columns"] if problem.orientation is not None else []
    return ["state", "exponent", "status", "failed_at", *turning]


def _kept(problem: Problem) -> map_nd.Kept:
    """What a run writes, with what it goes on from, which stays as it is."""
    size, m = problem.omega.shape
    # In one piece: of several, glibc gives memory back at the end of each call, and to get it anew
    # takes as long as some steps.
    state, *last = np.empty((1 if problem.saves_last else 2, size, m))
    kept = map_nd.Kept(
        final=last[0] if last else problem.saved[-1],
        status=not_computed(size),
        failed_at=never(size).copy(),
        state=state,
        exponent=np.empty(size),
        columns=(
            np.empty((0, m + 1, m + 1))
            if problem.orientation is None
            else np.ascontiguousarray(problem.orientation.swapaxes(1, 2))
        ),
    )
    if not problem.start:
        return kept
    return kept._replace(**{name: problem.resume[name].copy() for name in _names(problem)})


def _arrays(*shapes: tuple[int, ...]) -> Iterator[FloatArray]:
    """Arrays of zeros on cache lines: a vector across two lines costs a quarter and more."""
    sizes = [-(-math.prod(shape) // VECTOR) * VECTOR for shape in shapes]
    try:
        buffer = np.zeros(sum(sizes) + VECTOR)
    except (MemoryError, ValueError) as error:  # NumPy has both for sizes out of all proportion
        raise MemoryError(
            f"expected {8 * sum(sizes):.3g} bytes to work in, which there are not; most of it is "
            "room for elimination: use method='rank2', fewer threads, or shorter steps"
        ) from error
    begin = -(buffer.ctypes.data // buffer.itemsize) % VECTOR
    for shape, size in zip(shapes, sizes, strict=True):
        yield np.ndarray(shape, np.float64, buffer, buffer.itemsize * begin)
        begin += size
