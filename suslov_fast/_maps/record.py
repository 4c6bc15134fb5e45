"""The record of a map, from which runs, files, datasets and the command read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from .._checks import FloatArray
    from .._engine.run import Results, Run


class Kept(NamedTuple):
    """An array that a run needs to go on, beside its states at step 0.

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


# What kernels write of each trajectory, and go on from; files hold it as parts of the result.
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
        Values of `method`; the first is the default.
    parameters
        (body, eps, batch) to the flat arrays that kernels take, units taken out.
    run
        Make the steps of a run.
    kept
        Arrays that a run needs to go on, beside `ENDS`.
    quantities
        The methods of `Trajectories` that apply to its runs.
    carries_attitude
        True if the orientation can be carried along.
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
        """All arrays that a run needs to go on."""
        return *self.kept, *ENDS
