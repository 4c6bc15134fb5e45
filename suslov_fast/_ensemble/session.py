"""One call: a store made or recognised, and what it lacks computed."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from .._engine.progress import Progress
from . import chunks, cluster, layout, local, settling
from .chunks import Settled
from .identity import identity_of, require_same
from .job import Job
from .layout import RESUME, STEPS_DONE, Arrays, unpacked
from .lock import only_writer
from .meter import meter
from .pieces import resume_size
from .plan import Plan
from .signals import Stop, stopping

Index = tuple[int, ...]


def finish(
    job: Job,
    coords: Mapping[Any, Any] | None,
    scheduler: Any,
    verify: bool,
    progress: Progress,
) -> None:
    """See to it that the store holds the whole run."""
    identity = identity_of(job)
    with (
        nullcontext() if scheduler is None else cluster.client_of(scheduler) as client,
        only_writer(job.store),
    ):
        # What this call writes may be in memory only until the machine is started again.
        since = settling.boot() if layout.is_folder(job.store) and client is None else None
        if layout.exists(job.store):
            arrays = Arrays(job.store)
            job = _recognised(job, identity, arrays)
            if int(arrays.attrs["steps"]) < job.steps or _is_short(job, arrays):
                layout.lengthen(job, arrays)
                arrays = Arrays(job.store)
            lost = arrays.unsettled not in (None, settling.boot())
            if verify or lost:
                _forget_damaged(job, arrays)
            if lost:
                arrays.note_unsettled(None)
        else:
            layout.create(job, identity, resume_size(job), coords, since)
            arrays = Arrays(job.store)
        missing = _missing(job, arrays)
        if not missing:
            return
        if layout.is_folder(job.store):
            chunks.sweep(job.store)
        if since is not None and arrays.unsettled != since:
            arrays.note_unsettled(since)
        settled: Settled = "all" if since is None else "replacing"
        with stopping() as stop:
            _compute(job, arrays, missing, client, settled, progress, stop)
            if client is not None and layout.is_folder(job.store):
                chunks.sweep(job.store)  # what workers left that were killed meanwhile
            if stop.asked and (left := len(_missing(job, arrays))):
                raise KeyboardInterrupt(_how_to_go_on(job, left))


def _recognised(job: Job, identity: dict[str, Any], arrays: Arrays) -> Job:
    """The run with the chunks of the store, which must hold the same one."""
    notes = arrays.notes
    require_same(identity, json.loads(notes["run"]), job.store)
    stored = int(arrays.attrs["steps"])
    if stored > job.steps:
        raise ValueError(
            f"steps: expected at least the {stored} of the run in {job.store}, got {job.steps}"
        )
    return replace(job, plan=Plan(job.plan.batch, tuple(notes["tile"]), int(notes["rows"])))


def _is_short(job: Job, arrays: Arrays) -> bool:
    """Whether a process ended while it made room for a longer run."""
    if not job.keeps_states:
        return False
    rows = len(job.numbers)
    names = [name for name in ("omega", "attitude", "n", "time") if name in arrays]
    return any(arrays[name].shape[0] != rows for name in names) or (
        not np.array_equal(arrays["n"][...], job.numbers)
    )


def _missing(job: Job, arrays: Arrays) -> list[Index]:
    """The tiles that are not finished, in the order of the batch."""
    done = np.asarray(arrays[STEPS_DONE][...])
    return [tuple(int(k) for k in index) for index in np.argwhere(done != job.steps)]


def _forget_damaged(job: Job, arrays: Arrays) -> None:
    """Take back the marks of tiles that are not as they were written, and damaged marks."""
    marks = arrays[STEPS_DONE]
    for index in np.ndindex(marks.shape):
        place = tuple(slice(k, k + 1) for k in index)
        if chunks.is_missing(marks, place):
            continue
        damage = chunks.damaged(marks, place)
        if damage is None and (done := int(marks[index])) >= 0:
            damage = _damage(job, arrays, place, job.plan.where(index), done)
        if damage is not None:
            chunks.put(marks, place, np.full((1,) * len(place), -1), "all")


def _damage(
    job: Job, arrays: Arrays, place: tuple[slice, ...], where: tuple[slice, ...], steps: int
) -> str | None:
    """What is wrong with a tile of so many steps, if anything is."""
    if RESUME in arrays:
        array = arrays[RESUME]
        place = (*place, slice(0, array.shape[-1]))
        damage = chunks.damaged(array, place)
        if damage is not None:
            return damage
        # The mark comes later; the tile is gone on with from here.
        steps = max(steps, unpacked(array[place].reshape(-1))[0])
    rows = 0
    if job.save_every is not None:
        rows = steps // job.save_every + 1
    elif steps == job.steps:
        rows = 1
    parts: dict[str, tuple[slice, ...]] = {}
    if job.keeps_states:
        parts |= {name: (slice(0, rows), *where) for name in ("omega", "attitude")}
    parts |= dict.fromkeys(job.reductions, where)
    if steps == job.steps:
        parts |= dict.fromkeys(("final", "status", "failed_at"), where)
    for name, part in parts.items():
        if name not in arrays:
            continue
        array = arrays[name]
        rest = tuple(slice(0, length) for length in array.shape[len(part) :])
        damage = chunks.damaged(array, (*part, *rest))
        if damage is not None:
            return damage
    return None


def _compute(
    job: Job,
    arrays: Arrays,
    missing: list[Index],
    client: Any,
    settled: Settled,
    progress: Progress,
    stop: Stop,
) -> None:
    total = math.prod(job.plan.batch) * job.steps
    made = _steps_made(job, arrays) if progress else 0
    with meter(progress, total, made) as report:
        if client is None:
            local.run(job, arrays, missing, settled, report, stop)
        else:
            cluster.run(job, client, iter(missing), report, stop)


def _steps_made(job: Job, arrays: Arrays) -> int:
    """All steps that are stored, over the batch."""
    done = np.asarray(arrays[STEPS_DONE][...])

    def size(index: Index) -> int:
        return math.prod(each.stop - each.start for each in job.plan.where(index))

    return sum(size(index) * max(int(done[index]), 0) for index in _indices(done))


def _indices(done: np.ndarray[Any, Any]) -> Iterator[Index]:
    yield from np.ndindex(done.shape)


def _how_to_go_on(job: Job, left: int) -> str:
    tiles = math.prod(job.plan.grid)
    return (
        f"stopped with {tiles - left} of {tiles} tiles in {job.store} finished; "
        "the same call again goes on from there"
    )
