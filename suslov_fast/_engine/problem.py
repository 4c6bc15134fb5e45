"""Problems, spans of steps, and the outputs that drivers fill; the class of the records of maps."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray
from .._kernels import codes
from .arguments import States
from .layout import flat_arrays, for_loops

Indices = NDArray[np.intp]
Resume = Mapping[str, NDArray[Any]]
# The trajectories that a driver leaves if it computes all.
NO_TRAJECTORIES: Indices = np.empty(0, np.intp)


class Problem(NamedTuple):
    """A batch of B trajectories of a map, and how to compute them."""

    map: Map
    body: Any
    batch: tuple[int, ...]  # its shape
    omega0: FloatArray  # (B, D), the states at step 0
    eps: float | FloatArray  # of a shape that broadcasts to the batch
    parameters: tuple[Any, ...]  # of `Map.parameters`: arrays (B, ...) or (1, ...)
    method: str
    orientation: FloatArray | None  # (B, n, n), at step 0
    threads: int | None
    continued: bool  # False for a single step that no other follows
    # Takes the number of steps done so far. The closed form does not call it, nor do drivers of
    # trajectories that another one left.
    progress: Callable[[int], object] | None = None

    @property
    def size(self) -> int:
        return len(self.omega0)

    def take(self, chosen: Indices) -> Problem:
        def of(array: FloatArray) -> FloatArray:
            return array if len(array) == 1 else array[chosen]

        return self._replace(
            batch=chosen.shape,
            omega0=self.omega0[chosen],
            parameters=tuple(map(of, self.parameters)),
            orientation=None if self.orientation is None else self.orientation[chosen],
            progress=None,
        )


def problem_of(map: Map, states: States, method: str = "auto", continued: bool = True) -> Problem:
    """Return the problem of states at step 0; if it may be continued, with copies of all."""
    body, omega0, eps, batch, threads, _, orientation = states
    omega0, parameters = flat_arrays(omega0, batch), map.parameters(body, eps, batch)
    if orientation is not None:
        orientation = flat_arrays(orientation, batch, 2).copy()
    if continued:
        omega0, eps = omega0.copy(), eps if type(eps) is float else np.array(eps)
    return Problem(
        map, body, batch, omega0, eps, parameters, method, orientation, threads, continued
    )


class Span:
    """Steps after state `start`, up to state `steps`; states 0, k, 2k, ... are saved, or none.

    every         number of steps between saved states, more than all steps if none are saved
    rows_before   number of states saved before this span
    rows          number of states saved in it, with state 0 if it starts there
    saves_last    True if the last state is one of these
    resume        `Output.resume` of the span up to state `start`, if that is not 0
    """

    def __init__(
        self, steps: int, save_every: int | None, start: int = 0, resume: Resume | None = None
    ) -> None:
        self.steps, self.save_every = steps, save_every
        self.start, self.resume = start, resume or {}
        self.every = save_every or steps + 1
        self.rows_before = start // self.every + 1 if start and save_every else 0
        self.rows = steps // self.every + 1 - self.rows_before if save_every else 0
        self.saves_last = self.rows > 0 and steps % self.every == 0


def numbers_of_saved(steps: int, save_every: int | None) -> NDArray[np.int64]:
    """Return the indices of all saved states, or that of the last if none are saved."""
    if save_every is None:
        return np.array([steps])
    return save_every * np.arange(steps // save_every + 1)


class Output(NamedTuple):
    """The results of a span, flat for drivers, and in the shape of the batch for users."""

    saved: FloatArray  # (rows, B, D)
    turns: FloatArray | None  # (rows, B, n, n); without saved states a row for the last orientation
    final: FloatArray  # (B, D), the last state; NaN if it does not exist
    status: NDArray[np.int8]  # (B,)
    failed_at: NDArray[np.int64]  # the first state that does not exist, or -1
    resume: dict[str, NDArray[Any]]  # arrays from which the run can be continued

    @classmethod
    def empty(
        cls,
        problem: Problem,
        span: Span,
        states: FloatArray | None = None,
        turns: FloatArray | None = None,
    ) -> Output:
        """Return an output that is not filled; without saved states, `states` is the last."""
        size, turned = problem.size, problem.orientation
        if states is None:  # memory of its own
            rows = span.rows or 1
            states = np.empty((rows, *problem.omega0.shape))
            turns = None if turned is None else np.empty((rows, *turned.shape))
        is_last = span.save_every is None or span.saves_last
        final = states[-1] if is_last else np.empty(problem.omega0.shape)
        status, failed_at = np.empty(size, np.int8), np.empty(size, np.int64)
        status.fill(codes.NOT_COMPUTED)
        failed_at.fill(-1)
        return cls(states[: span.rows], turns, final, status, failed_at, {})

    @property
    def worst(self) -> int:
        """The least status, negative if a trajectory failed; at most 0."""
        status = self.status
        return min(status.item(), 0) if status.size == 1 else int(status.min(initial=0))

    def with_status(self, code: int) -> Indices:
        """Return the trajectories with this status, the least of all that occur."""
        return np.flatnonzero(self.status == code) if self.worst == code else NO_TRAJECTORIES

    def put(self, chosen: Indices, part: Output) -> None:
        """Take over the results of some trajectories; of a part from step 0 on, the last rows."""
        for whole, rows in ((self.saved, part.saved), (self.turns, part.turns)):
            if whole is not None and rows is not None and len(whole):
                whole[:, chosen] = rows[len(rows) - len(whole) :]
        self.final[chosen] = part.final
        self.status[chosen], self.failed_at[chosen] = part.status, part.failed_at
        for name, array in part.resume.items():
            if name not in self.resume:
                size = len(self.status)
                self.resume[name] = np.zeros((size, *array.shape[1:]), array.dtype)
            self.resume[name][chosen] = array


# Fills the output of a span; returns the indices of the trajectories that it cannot compute.
Fill = Callable[[Problem, Span, Output], Indices]


class Driver(NamedTuple):
    """An algorithm that computes trajectories of a problem, and leaves others to the next."""

    fill: Fill
    from_0: bool = False  # begins at step 0, whatever the span
    keeps: bool = True  # the arrays of `Map.kept`, from which the span can be continued


class Kept(NamedTuple):
    """An array needed to resume a run, in addition to its states at step 0."""

    name: str
    # Its axes: "flat" (trajectories), "component", "space" (one more), or fixed lengths.
    dims: tuple[str | int, ...]
    dtype: str = "float64"
    attitude: bool = False  # only runs with an orientation have it


# Per-trajectory arrays that kernels write and resume from; files hold them as results.
STATUSES = Kept("status", ("flat",), "int8"), Kept("failed_at", ("flat",), "int64")


@dataclass(frozen=True)
class Map:
    """A map of the package."""

    name: str  # in files
    body: type[Any]  # the class of its bodies
    title: str  # of datasets, for people
    # What computes a span: each driver takes the trajectories that those before it left.
    drivers: Callable[[Problem, Span], Sequence[Driver]]
    kept: tuple[Kept, ...]  # what is needed to resume a run, in addition to `STATUSES`
    # Bodies, each with a state, at a pole of eps = 1 if there is one: calls with them need all
    # kernels of the map.
    samples: tuple[tuple[Any, tuple[float, ...]], ...]
    methods: tuple[str, ...] = ("auto",)  # values of the argument `method`, the default first
    # The flat arrays for kernels, of (body, eps, batch).
    parameters: Callable[[Any, float | FloatArray, tuple[int, ...]], tuple[Any, ...]] = for_loops
    # The functions of (body, omega, eps) whose drift the summary of a run of a body reports.
    conserved: Callable[[Any], tuple[str, ...]] = lambda body: ()
    # The name of a state in `Trajectories`, datasets, files and stores, and what it means.
    variable: str = "omega"
    meaning: str = "angular velocity"
    components: Callable[[Any], tuple[str, ...]] = attrgetter("_labels")  # labels of components

    @property
    def carries_attitude(self) -> bool:
        """True if runs can include the orientation."""
        return any(array.attitude for array in self.kept)

    @property
    def resume(self) -> tuple[Kept, ...]:
        """All arrays needed to resume a run."""
        return *self.kept, *STATUSES

    def symbols(self, body: Any) -> list[str]:
        r"""Return the labels of the components in LaTeX: "Omega1" is `$\Omega_{1}$`."""
        labels = (re.fullmatch(r"(\D+)(.*)", label) for label in self.components(body))
        words = (("\\" * (len(found[1]) > 1) + found[1], found[2]) for found in labels if found)
        return [f"${word}_{{{index}}}$" for word, index in words]
