"""A run that is to be stored: its checked arguments, its parts, its identity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._bodies.base import Body
from .._checks import FloatArray, common_shape, integer, one_of, real_array, rotations
from .._engine.run import numbers_of_saved
from .._maps.record import Map
from .._maps.registry import map_of
from .._runs.labelled import batch_names
from .plan import Plan, Slices, plan_of, step_work
from .reductions import checked
from .starts import Source, described, own_part, source_of


@dataclass(frozen=True, eq=False)
class Job:
    """A run and its store; arguments as in `ensemble`, checked. Workers receive it as it is.

    Attributes
    ----------
    source
        Initial states of the batch; None where a worker receives those of its tile apart.
    orientation
        Orientations at step 0, which broadcast to the batch, or None.
    """

    body: Any
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
        """True if states are stored, and not only reductions of them."""
        return self.save_every is not None or not self.reductions

    @property
    def every(self) -> int | None:
        """Stride of the states that are computed; where none is stored reductions look at all."""
        return self.save_every if self.keeps_states else 1

    @property
    def numbers(self) -> NDArray[np.int64]:
        """Step numbers of the stored states."""
        return numbers_of_saved(self.steps, self.save_every)

    def starts(self, where: Slices) -> FloatArray:
        """Return the initial states of a part of the batch, which broadcast to it."""
        assert self.source is not None
        return self.source.part(own_part(self.source.shape, where))

    def part(self, where: Slices) -> Job:
        """Return the job of a part of the batch, with the source of the whole."""
        own = self.body._own_axes
        parameters = {
            name: value[own_part(value.shape[: value.ndim - own], where)]
            for name, value in parameters_of(self.body).items()
        }
        turned = self.orientation
        if turned is not None:
            turned = turned[own_part(turned.shape[:-2], where)]
        eps = self.eps[own_part(self.eps.shape, where)]
        return replace(self, body=type(self.body)(**parameters), eps=eps, orientation=turned)

    def identity(self) -> dict[str, Any]:
        """Return plain values that are equal where the results are, whatever the steps."""
        from .. import __version__

        assert self.source is not None
        parameters = {name: described(value) for name, value in parameters_of(self.body).items()}
        return {
            "body": {"map": self.map.name, **parameters},
            "eps": described(self.eps),
            "omega0": self.source.identity(),
            "batch": list(self.plan.batch),
            "dims": list(self.dims),
            "method": self.method,
            "save_every": self.save_every,
            "attitude": None if self.orientation is None else described(self.orientation),
            "reductions": list(self.reductions),
            "version": __version__,
        }


def parameters_of(body: Body) -> dict[str, FloatArray]:
    """Return the parameters of a body that are set, as arrays."""
    return {name: np.asarray(value) for name, value in body._values.items()}


def job_of(
    body: Any,
    omega0: Any,
    eps: Any,
    steps: Any,
    *,
    store: Any,
    save_every: Any,
    method: Any,
    attitude: Any,
    reductions: Any,
    dims: Any,
    chunk: Any,
    compression: Any,
) -> Job:
    """Check the arguments of `ensemble`; `store` is resolved already."""
    methods = map_of(body).methods
    source = source_of(omega0, body.dimension)
    eps = real_array("eps", eps).copy()
    side = body.dimension + 1
    if isinstance(attitude, (bool, np.bool_)):
        orientation = np.eye(side) if attitude else None
    else:
        orientation = rotations("attitude", attitude, side).copy()
    turned = {} if orientation is None else {"attitude": orientation.shape[:-2]}
    batch = common_shape({"body": body.shape, "omega0": source.shape, "eps": eps.shape, **turned})
    steps = integer("steps", steps, 0, "an integer of at least 0")
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    one_of("method", method, methods)
    names = checked(body, reductions)
    if compression is not None:
        one_of("compression", compression, ("lz4", "zstd"))
    dims = batch_names(dims, len(batch))
    state_bytes = 8 * (body.dimension + (0 if orientation is None else side * side))
    every = 1 if names and save_every is None else save_every
    rows = 1 if every is None else steps // every + 1
    plan = plan_of(batch, dims, chunk, state_bytes, rows, steps * step_work(body.dimension))
    return Job(
        body,
        eps,
        source,
        orientation,
        steps,
        save_every,
        method,
        names,
        dims,
        plan,
        store,
        compression,
    )


def require_same(asked: dict[str, Any], stored: dict[str, Any], store: object) -> None:
    """Raise a ValueError that says what differs if the store holds another run."""
    differing = [
        f"{name} {_short(stored.get(name))} instead of {_short(asked[name])}"
        for name in asked
        if stored.get(name) != asked[name]
    ]
    if differing:
        raise ValueError(
            f"store: expected a new one or one that holds this run, got {store} of another run, "
            f"with {'; '.join(differing)}"
        )


def _short(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_short(each)}" for name, each in value.items())
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
