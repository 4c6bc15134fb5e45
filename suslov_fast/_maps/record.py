"""The record of a map, from which runs, files, datasets and the command read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .._checks import FloatArray
    from .._engine.problem import Outcome, Problem


@dataclass(frozen=True)
class Kept:
    """An array that a run needs to go on, beside its states at step 0.

    Attributes
    ----------
    dims
        Its axes: "flat" (trajectories), "component", "space" (one more), or fixed lengths.
    """

    name: str
    dims: tuple[str | int, ...]
    dtype: str = "float64"


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
        What `method` may be; the first is the default.
    parameters
        (body, eps, batch) to the flat arrays that kernels take, units taken out.
    run
        Fill a checked, flat problem.
    resume
        What a run needs to go on.
    quantities
        The methods of `Trajectories` that apply to its runs.
    carries_attitude
        True if the orientation can be carried along.
    """

    name: str
    body: type[Any]
    components: Callable[[Any], tuple[str, ...]]
    methods: tuple[str, ...]
    parameters: Callable[[Any, float | FloatArray, tuple[int, ...]], list[FloatArray]]
    run: Callable[[Problem], Outcome]
    resume: tuple[Kept, ...]
    quantities: frozenset[str]
    carries_attitude: bool = True
