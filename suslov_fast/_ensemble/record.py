"""What the next piece of a tile starts from, as words of 64 bits for each trajectory.

They are the number of steps, `failed_at`, the arrays that the map needs to go on, and the
reductions so far. A tile has one chunk of them, so that they are replaced together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .job import Job
from .reductions import REDUCTIONS

Values = dict[str, NDArray[Any]]


def _layout(job: Job) -> Iterator[tuple[str, slice, tuple[int, ...], str]]:
    """Name, place, shape and type of the arrays; those that the run does not need have no place."""
    at, D = 2, job.body.dimension
    lengths = {"component": D, "space": D + 1}
    for kept in job.map.resume:
        shape = tuple(lengths[dim] if isinstance(dim, str) else dim for dim in kept.dims[1:])
        turning = kept.name == "turn" or "space" in kept.dims
        size = 0 if turning and job.orientation is None else math.prod(shape)
        yield kept.name, slice(at, at := at + size), shape, kept.dtype
    for name in job.reductions:
        shape = (D,) if REDUCTIONS[name].of_components else ()
        yield f"reduced {name}", slice(at, at := at + math.prod(shape)), shape, "float64"


def words(job: Job) -> int:
    """Return the number of words of a trajectory."""
    return max((int(place.stop) for _, place, _, _ in _layout(job)), default=2)


def packed(
    job: Job, steps: int, failed_at: NDArray[np.int64], resume: Values, reduced: Values
) -> NDArray[np.int64]:
    """Return the records of a tile, shape (..., words)."""
    values = {**resume, **{f"reduced {name}": array for name, array in reduced.items()}}
    records = np.zeros((failed_at.size, words(job)), np.int64)
    records[:, 0], records[:, 1] = steps, failed_at.reshape(-1)
    for name, place, _, dtype in _layout(job):
        if name in values and place.start < place.stop:
            array = np.ascontiguousarray(values[name]).reshape(failed_at.size, -1)
            records[:, place] = array.view(np.int64) if dtype == "float64" else array
    return records.reshape(*failed_at.shape, -1)


def unpacked(job: Job, records: Any) -> tuple[int, NDArray[np.int64], Values, Values]:
    """Return steps, `failed_at`, the arrays to go on from, and the reductions of a tile."""
    batch, flat = records.shape[:-1], np.asarray(records).reshape(-1, records.shape[-1])
    resume, reduced = {}, {}
    for name, place, shape, dtype in _layout(job):
        values = np.ascontiguousarray(flat[:, place])
        values = values.view(np.float64) if dtype == "float64" else values.astype(dtype)
        if name.startswith("reduced "):
            reduced[name.removeprefix("reduced ")] = values.reshape(*batch, *shape)
        else:
            resume[name] = values.reshape(len(flat) if values.size else 0, *shape)
    return int(flat[0, 0]), records[..., 1], resume, reduced
