"""A run that is to be stored, checked; it goes to workers as it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._engine.arguments import Body
from .._engine.jump import JUMP
from .._maps.record import Map
from .._maps.registry import map_of
from .plan import Plan, work_of
from .starts import Slices, Source, own_part


@dataclass(frozen=True, eq=False)
class Job:
    """A run and where it is stored; arguments as in `ensemble`, checked.

    Attributes
    ----------
    source
        Of states at step 0; None where these go along by themselves.
    orientation
        The orientations at step 0, which broadcast to the batch, or None.
    """

    body: Body
    eps: FloatArray
    source: Source | None
    orientation: FloatArray | None
    steps: int
    save_every: int | None
    method: str
    reductions: tuple[str, ...]
    dims: tuple[str, ...]
    plan: Plan
    store: Any
    compression: str | None

    @property
    def map(self) -> Map:
        """The map that is iterated."""
        return map_of(self.body)

    @property
    def keeps_states(self) -> bool:
        """Whether states are stored, and not only what is made of them."""
        return not self.reductions

    @property
    def jumps(self) -> bool:
        """Whether the last states come from the first in one go."""
        return (
            isinstance(self.body, Suslov3D)
            and self.method == "auto"
            and self.save_every is None
            and self.orientation is None
            and JUMP <= self.steps <= 2**53
        )

    @property
    def numbers(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """The step numbers of the states that are kept."""
        if self.save_every is None:
            return np.array([self.steps])
        return np.arange(0, self.steps + 1, self.save_every)

    @property
    def chunk_bytes(self) -> int:
        """What the states of one piece take, with their orientations."""
        D = self.body.dimension
        each = D + ((D + 1) ** 2 if self.orientation is not None else 0)
        return 8 * each * self.plan.rows * math.prod(self.plan.tile)

    def work(self, where: Slices) -> float:
        """That of one step of a part of the batch, in steps of the 3D map."""
        return work_of(self.body) * float(np.prod([each.stop - each.start for each in where]))

    def starts(self, where: Slices) -> FloatArray:
        """The states at step 0 of a part of the batch, which broadcast to it."""
        assert self.source is not None
        return self.source.part(own_part(self.source.shape, where))

    def of(self, where: Slices) -> Job:
        """The same for a part of the batch, with its starts left where they are."""
        own = self.body._own_axes
        parameters = []
        for value in self.body._values.values():
            array = np.asarray(value)
            parameters.append(array[own_part(array.shape[: array.ndim - own], where)])
        orientation = self.orientation
        if orientation is not None:
            orientation = orientation[own_part(orientation.shape[:-2], where)]
        return replace(
            self,
            body=type(self.body)(*parameters),
            eps=self.eps[own_part(self.eps.shape, where)],
            orientation=orientation,
        )
