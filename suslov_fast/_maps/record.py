"""The record of a map, used by runs, files, datasets and the command line."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from .._checks import FloatArray
    from .._engine.execution import Output, Problem, Resume, Span


class Kept(NamedTuple):
    """An array needed to resume a run, in addition to its states at step 0.

    Attributes
    ----------
    dims
        Its axes: "flat" (trajectories), "component", "space" (one more), or fixed lengths.
    attitude
        True if only runs with an orientation have it.
    """

    name: str
    dims: tuple[str | int, ...]
    dtype: str = "float64"
    attitude: bool = False


# Per-trajectory arrays that kernels write and resume from; files hold them as results.
STATUSES = Kept("status", ("flat",), "int8"), Kept("failed_at", ("flat",), "int64")


@dataclass(frozen=True)
class Map:
    """A map of the package.

    Attributes
    ----------
    name
        The name in files, "suslov3d".
    body
        The class of its bodies.
    title
        What it is, for people: title of datasets.
    methods
        Values of the argument `method`; the first is the default.
    parameters
        Function of (body, eps, batch) that returns the flat, scaled arrays for kernels.
    run
        Function that fills the output of a run.
    kept
        Arrays needed to resume a run, in addition to `STATUSES`.
    quantities
        The methods of `Trajectories` that apply to its runs.
    samples
        Bodies, each with a state, at a pole of eps = 1 if there is one: calls with them need all
        kernels of the map.
    conserved
        The functions of (body, omega, eps) whose drift the summary of a run of a body reports.
    carries_attitude
        True if runs can include the orientation.
    variable, meaning
        The name of a state in `Trajectories`, datasets, files and stores, and what it means.
    components
        The labels of the components of a state.
    """

    name: str
    body: type[Any]
    title: str
    methods: tuple[str, ...]
    parameters: Callable[[Any, float | FloatArray, tuple[int, ...]], tuple[FloatArray, ...]]
    run: Callable[[Problem, Span, Resume, Output], object]
    kept: tuple[Kept, ...]
    quantities: frozenset[str]
    samples: tuple[tuple[Any, tuple[float, ...]], ...]
    conserved: Callable[[Any], tuple[str, ...]] = lambda body: ()
    carries_attitude: bool = True
    variable: str = "omega"
    meaning: str = "angular velocity"
    components: Callable[[Any], tuple[str, ...]] = attrgetter("_labels")

    @property
    def resume(self) -> tuple[Kept, ...]:
        """All arrays needed to resume a run."""
        return *self.kept, *STATUSES

    def symbols(self, body: Any) -> list[str]:
        r"""Return the labels of the components in LaTeX: "Omega1" is `$\Omega_{1}$`."""
        labels = (re.fullmatch(r"(\D+)(.*)", label) for label in self.components(body))
        words = (("\\" * (len(found[1]) > 1) + found[1], found[2]) for found in labels if found)
        return [f"${word}_{{{index}}}$" for word, index in words]
