"""The record of a map, used by runs, files, datasets and the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from .._checks import FloatArray
    from .._engine.run import Results, Run


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
ENDS = Kept("status", ("flat",), "int8"), Kept("failed_at", ("flat",), "int64")


@dataclass(frozen=True)
class Map:
    """A map of the package.

    Attributes
    ----------
    name
        The name in files, "suslov3d".
    body
        The class of its bodies.
    components
        The labels of the components of a state.
    methods
        Values of the argument `method`; the first is the default.
    parameters
        Function of (body, eps, batch) that returns the flat, scaled arrays for kernels.
    run
        Function that computes a run.
    kept
        Arrays needed to resume a run, in addition to `ENDS`.
    quantities
        The methods of `Trajectories` that apply to its runs.
    carries_attitude
        True if runs can include the orientation.
    """

    name: str
    body: type[Any]
    components: Callable[[Any], tuple[str, ...]]
    methods: tuple[str, ...]
    parameters: Callable[[Any, float | FloatArray, tuple[int, ...]], tuple[FloatArray, ...]]
    run: Callable[[Run], Results]
    kept: tuple[Kept, ...]
    quantities: frozenset[str]
    carries_attitude: bool = True

    @property
    def resume(self) -> tuple[Kept, ...]:
        """All arrays needed to resume a run."""
        return *self.kept, *ENDS
