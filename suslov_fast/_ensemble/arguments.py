"""What a user asks for, checked."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray, common_shape, instance, integer, one_of, real_array, rotations
from .._engine.arguments import Body
from .._maps.registry import map_of
from .._runs import labelled
from .job import Job
from .layout import resolved
from .plan import plan_of
from .reductions import checked
from .starts import source_of


class Asked(NamedTuple):
    """The run; see `ensemble`."""

    body: Body
    omega0: Any
    eps: Any
    steps: Any
    save_every: Any
    method: Any
    attitude: Any


class Wanted(NamedTuple):
    """How it is stored; see `ensemble`."""

    store: Any
    reductions: Any
    dims: Any
    chunk: Any
    compression: Any


def job_of(asked: Asked, wanted: Wanted) -> Job:
    """A run that is to be stored, from arguments; they are refused before any work is done."""
    body = asked.body
    instance("body", body, (Suslov3D, SuslovND))
    source = source_of(asked.omega0, body.dimension)
    eps = real_array("eps", asked.eps).copy()
    orientation = _orientation(body, asked.attitude)
    turned = {} if orientation is None else {"attitude": orientation.shape[:-2]}
    batch = common_shape({"body": body.shape, "omega0": source.shape, "eps": eps.shape, **turned})
    steps = integer("steps", asked.steps, 0, "an integer of at least 0")
    save_every = asked.save_every
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    method = one_of("method", asked.method, map_of(body).methods)
    reductions = checked(body, wanted.reductions)
    if reductions and save_every is None:
        save_every = 1
    if wanted.compression is not None:
        one_of("compression", wanted.compression, ("lz4", "zstd"))
    dims = labelled.batch_names(wanted.dims, len(batch))
    plan = plan_of(body, batch, steps, save_every, orientation is not None, dims, wanted.chunk)
    return Job(
        body=body,
        eps=eps,
        source=source,
        orientation=orientation,
        steps=steps,
        save_every=save_every,
        method=method,
        reductions=reductions,
        dims=dims,
        plan=plan,
        store=resolved(wanted.store),
        compression=wanted.compression,
    )


def _orientation(body: Body, attitude: Any) -> FloatArray | None:
    if isinstance(attitude, (bool, np.bool_)):
        return np.eye(body.dimension + 1) if attitude else None
    return rotations("attitude", attitude, body.dimension + 1).copy()
