"""A run of a map: its arguments, its division into parts, and its results."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from .._checks import EXACT, FloatArray, wrong
from .._kernels import codes
from .arguments import BodyOrField
from .layout import flat_parameter
from .memory import require
from .progress import Progress, reporter

if TYPE_CHECKING:
    from .._maps.record import Map

# Work of the first part, in steps of one trajectory of the 3D map: some 10 ms to 300 ms. Python
# handles Ctrl-C between parts.
_PART = 2**27
# The next part is longer if a part took less than the first time (in seconds), and shorter if it
# took more than the second.
_SHORT, _LONG = 0.05, 0.2
# Cost of saving a state, in steps.
_SAVING = 8
# Least numbers of trajectories and of steps of a part, if there are as many, each divided by the
# work of a step: entering a trajectory costs some 30 steps of the 3D map.
_ABREAST, _LENGTH = 2**13, 2**8
# Size of the states that `run_some` copies at a time.
_TOGETHER = 2**20
# Copying an array is faster than filling a new one.
_ONE_NOT_COMPUTED = np.full(1, codes.NOT_COMPUTED, np.int8)
# Placeholder of arrays that are set before use.
_UNSET: Any = None


@lru_cache
def _no_rows(*shape: int) -> FloatArray:
    return np.empty((0, 0, *shape))


@dataclass(slots=True)  # not frozen: that would take longer to create than a short run
class Run:
    """A run over a batch of B trajectories, from state `start` to state `steps`.

    Attributes
    ----------
    omega0
        (B, D), the states at step 0; of a run that may be continued, in memory not shared
        with the caller.
    eps
        The step size, a number or of a shape that broadcasts to the batch.
    orientation
        (B, n, n), the orientations at step 0, or None.
    start, resume
        The number of steps made before, and `Results.resume` of those.
    single
        True for a single step that is not continued.
    parameters
        What `Map.parameters` returns: parameters of the body and eps, (B, ...) or (1, ...).
    time_step
        eps in the unit of time of omega, (B,) or (1,); used with an orientation.
    saved, turns
        (rows, B, D) and (rows, B, n, n), filled by the map: states and orientations from `start`
        on, state 0 included, state `start` > 0 not; no rows if only the last ones are wanted.
    """

    map: Map
    body: BodyOrField
    batch: tuple[int, ...]
    omega0: FloatArray
    eps: float | FloatArray
    steps: int
    save_every: int | None
    method: str = "auto"
    orientation: FloatArray | None = None
    threads: int | None = None
    progress: Progress = None
    start: int = 0
    resume: dict[str, NDArray[Any]] = field(default_factory=dict)
    single: bool = False
    parameters: tuple[FloatArray, ...] = ()
    time_step: FloatArray = _UNSET
    saved: FloatArray = _UNSET
    turns: FloatArray = _UNSET

    @property
    def size(self) -> int:
        """The number of trajectories."""
        return len(self.omega0)

    @property
    def every(self) -> int:
        """The number of steps between saved states, more than `steps` if none are saved."""
        return self.save_every or self.steps + 1

    @property
    def rows(self) -> int:
        """The number of saved states of each trajectory."""
        return 1 if self.save_every is None else self.steps // self.save_every + 1

    @property
    def rows_before(self) -> int:
        """The number of states saved before `start`."""
        return self.start // self.save_every + 1 if self.save_every and self.start else 0

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of the saved states."""
        return (self.rows, *self.batch, self.omega0.shape[1])

    @property
    def saves_last(self) -> bool:
        """True if the last row of `saved` holds the last states."""
        return len(self.saved) > 0 and self.steps % self.every == 0

    def some(self, chosen: NDArray[np.intp], anew: bool = False) -> Run:
        """Return a run of some of the trajectories, with new arrays; with `anew` from step 0."""

        def of(array: FloatArray) -> FloatArray:
            return array if len(array) == 1 else array[chosen]

        def room(array: FloatArray) -> FloatArray:
            rows = len(array) + anew * self.rows_before if len(array) else 0
            return np.empty((rows, chosen.size, *array.shape[2:]))

        return replace(
            self,
            batch=chosen.shape,
            omega0=self.omega0[chosen],
            orientation=None if self.orientation is None else self.orientation[chosen],
            progress=None,
            start=0 if anew else self.start,
            resume={} if anew else {name: array[chosen] for name, array in self.resume.items()},
            parameters=tuple(map(of, self.parameters)),
            time_step=self.time_step if self.orientation is None else of(self.time_step),
            saved=room(self.saved),
            turns=room(self.turns),
        )

    def parts(self, work: float, lanes: int) -> Iterable[Part]:
        """Return the parts to compute one after another: some trajectories and some of their steps.

        `work` is the cost of a step of one trajectory, in steps of the 3D map; a thread takes
        `lanes` trajectories at a time. The batch is divided first, so that the data of a part stay
        in the caches; time is divided only if few trajectories take long.
        """
        size, steps = len(self.omega0), self.steps - self.start
        if len(self.saved):
            work += _SAVING / self.every
        room = _PART / work
        if (not self.progress and size * steps <= room) or not size * steps:
            return (Part(0, size, self.start, self.steps),)
        abreast = max(lanes * numba.config.NUMBA_NUM_THREADS, int(_ABREAST / work))
        return self._parts_of(room, lanes, abreast, max(1, int(_LENGTH / work)))

    def _parts_of(self, room: float, lanes: int, abreast: int, length: int) -> Iterator[Part]:
        """Yield parts of about `room` steps; `room` adapts to the measured time of a part."""
        size, steps = len(self.omega0), self.steps - self.start
        with reporter(self.progress, steps) as report:
            end = 0
            while end < size:
                begin = end
                end += min(alike(size - end, max(abreast, int(room / steps)), lanes), size - end)
                stop = self.start
                while stop < self.steps:
                    start = stop
                    stop = min(stop + max(length, int(room / (end - begin))), self.steps)
                    clock = time.perf_counter()
                    yield Part(begin, end, start, stop)
                    seconds = time.perf_counter() - clock
                    room *= 2.0 if seconds < _SHORT else 0.5 if seconds > _LONG else 1.0
                    report((begin * steps + (end - begin) * (stop - self.start)) // size)


def alike(size: int, most: int, lanes: int) -> int:
    """Return the length of parts of about equal length, at most `most`, in multiples of lanes.

    A short part at the end would leave threads idle.
    """
    parts = -(-size // most)
    return -(-size // (parts * lanes)) * lanes


class Part(NamedTuple):
    """Trajectories `begin` to `end`, from state `start` to state `stop`."""

    begin: int
    end: int
    start: int
    stop: int

    def work(self, lanes: int, step: float) -> int:
        """Return the lane-steps that can run in parallel: none within one block of lanes."""
        count = self.end - self.begin
        return int(count * (self.stop - self.start) * step) if count > lanes else 0


class Results(NamedTuple):
    """Results of a run. A map returns the first four, flat; `execute` all, in the batch shape.

    Attributes
    ----------
    final
        (B, D), state `steps`; NaN if it does not exist.
    status, failed_at
        (B,), a code, and if that is negative, the index of the first state that does not exist.
    resume
        Arrays from which the run can be continued, by name; of `execute` with omega0, and R0 if it
        turns.
    omega, attitude
        Saved states and orientations.
    """

    final: FloatArray
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    resume: dict[str, NDArray[Any]]
    omega: FloatArray = _UNSET
    attitude: FloatArray | None = None


def not_computed(size: int) -> NDArray[np.int8]:
    """Return the initial statuses for a kernel."""
    return _ONE_NOT_COMPUTED.copy() if size == 1 else np.full(size, codes.NOT_COMPUTED, np.int8)


@lru_cache
def _no_failures(size: int) -> NDArray[np.int64]:
    """Return `failed_at` for no failures: -1, read-only, without memory per trajectory."""
    return np.ndarray((size,), np.int64, b"\xff" * 8, 0, (0,))


def worst(status: NDArray[np.int8]) -> int:
    """Return the least status, negative if a trajectory failed; at most 0."""
    return min(status.item(), 0) if status.size == 1 else int(status.min(initial=0))


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """Return the indices of all saved states."""
    return np.array([steps]) if save_every is None else np.arange(0, steps + 1, save_every)


def run_some(
    run: Run,
    chosen: NDArray[np.intp],
    driver: Callable[[Run], Results],
    results: Results,
    anew: bool = False,
    report: Callable[[int], object] | None = None,
) -> None:
    """Compute a subset of the trajectories in groups, and store the results in those of the run.

    Trajectories computed `anew`, from step 0, are not continued. `report` takes a number of steps.
    """
    together = max(_TOGETHER // (run.omega0.shape[1] * (len(run.saved) + 1)), 1)
    for begin in range(0, chosen.size, together):
        some = chosen[begin : begin + together]

        def progress(done: int, total: int, before: int = begin, size: int = some.size) -> None:
            if report:
                report((before * total + size * done) // chosen.size)

        part = run.some(some, anew)
        part.progress = progress if report else None
        found = driver(part)
        progress(run.steps - run.start, run.steps - run.start)
        for whole, rows in ((run.saved, part.saved), (run.turns, part.turns)):
            if len(whole):
                whole[:, some] = rows[len(rows) - len(whole) :]
        results.final[some], results.status[some] = found.final, found.status
        results.failed_at[some] = found.failed_at
        for name, array in {} if anew else found.resume.items():
            if name not in results.resume:
                results.resume[name] = np.zeros((run.size, *array.shape[1:]), array.dtype)
            results.resume[name][some] = array


def execute(
    run: Run,
    out: FloatArray | None = None,
    before: tuple[FloatArray, FloatArray | None] | None = None,
) -> Results:
    """Compute a run; saved states are written to `out` if given.

    States and orientations saved earlier are copied from `before`.
    """
    saved, turns = _room(run, run.rows, out)
    begin = run.rows_before
    if before is not None:
        for kept, array in zip(before, (saved, turns), strict=True):
            if array is not None and kept is not None:
                array[:begin] = kept[:begin]
    return _fill(run, saved, turns, begin)


def go_on(run: Run) -> Results:
    """Compute a run from `start` on; return only states saved after `start`."""
    return _fill(run, *_room(run, run.rows - run.rows_before), 0)


def _room(
    run: Run, rows: int, out: FloatArray | None = None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return arrays for saved states and orientations; MemoryError if they do not fit."""
    size, D = run.omega0.shape
    shape, turned = (rows, *run.batch, D), run.orientation
    saves = out is None and run.save_every is not None
    numbers = (4 + rows * saves) * size * D  # additional arrays of the size of a state
    if turned is not None:
        numbers += rows * turned.size
    require(8 * numbers, "the saved states are {}: raise save_every or divide the batch", shape)
    turns = None if turned is None else np.empty((*shape[:-1], *turned.shape[1:]))
    return np.empty(shape) if saves else out, turns


def _fill(run: Run, saved: FloatArray | None, turns: FloatArray | None, begin: int) -> Results:
    """Compute the steps, and fill the saved states from row `begin` on."""
    if run.steps > EXACT:  # numbers of steps are floats in the closed form
        raise wrong("steps", "at most 2**53", run.steps)
    batch, every, (size, D) = run.batch, run.save_every, run.omega0.shape
    run.parameters = run.map.parameters(run.body, run.eps, batch)
    run.saved, run.turns = _no_rows(D), _no_rows(D + 1, D + 1)
    if saved is not None and every is not None:
        run.saved = saved.reshape((len(saved), size, D))[begin:]
    if turns is not None:
        run.time_step = flat_parameter(run.eps, batch)
        run.turns = turns.reshape((len(turns), size, D + 1, D + 1))[begin:]
    found = run.map.run(run)
    final, status, failed_at, resume = found.final, found.status, found.failed_at, found.resume
    least = worst(status)
    if least == codes.NOT_COMPUTED:
        raise RuntimeError("internal error: a kernel skipped trajectories; please report this")
    if least < 0:
        failed_at[status >= 0] = -1
    else:
        failed_at = _no_failures(size)
    if "status" in resume:
        resume["status"], resume["failed_at"] = status, failed_at
    resume["omega0"] = run.omega0
    if run.orientation is not None:
        resume["R0"] = run.orientation
    if saved is not None and every is not None and len(saved) and run.steps % every == 0:
        final = saved[-1]
    final = final.reshape((*batch, D))
    if saved is None:
        saved = final[np.newaxis]
    elif every is None:
        saved[0] = final
    return Results(final, status.reshape(batch), failed_at.reshape(batch), resume, saved, turns)
