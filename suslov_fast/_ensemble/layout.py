"""The arrays of a store: made by xarray, filled chunk by chunk.

Results lie in the root group, under the names and with the attributes of `Trajectories.to_xarray`.
What is needed to go on lies in the group "progress":

    steps_done    the mark of a tile: how many of its steps are stored; -1 before state 0 is
    resume        what the steps left to go on from, with their number, as bytes of a .npz; absent
                  where the starts are enough

Data are written whole first, then what goes on from them, then the mark. Each of these is one
object, which a store replaces as a whole, so that wherever a process is killed all that a mark
speaks for is there, and what is written again is the same.
"""

from __future__ import annotations

import errno
import io
import json
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._core.codes import NOT_COMPUTED
from .._runs import labelled
from .._runs.replacing import kind_of, replacing
from .._runs.schema import header_of
from .job import Job
from .reductions import REDUCTIONS
from .settling import settle, settle_all

PROGRESS = "progress"
STEPS_DONE, RESUME = f"{PROGRESS}/steps_done", f"{PROGRESS}/resume"
_PENDING = "PENDING"
# Among the notes: the start of the machine since which there is what may be in memory only.
_UNSETTLED = "unsettled_since"


def resolved(store: Any) -> Any:
    """A store that other processes find: a folder as its absolute path."""
    if isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store):
        try:
            return os.path.abspath(os.fspath(store))
        except OSError as error:  # a working directory that was deleted has no path
            message = f"expected a name in a folder that can be written to, got: {error.strerror}"
            raise OSError(error.errno, message, os.fspath(store)) from error
    return store


def is_folder(store: Any) -> bool:
    """Whether a resolved store is a folder of this file system."""
    return isinstance(store, str) and "://" not in store


def exists(store: Any) -> bool:
    """Whether something is there that is, or was to become, a store."""
    import zarr

    if is_folder(store):
        if not os.path.lexists(store):
            return False
        if not os.path.isdir(store):
            raise _not_a_store(store, kind_of(os.lstat(store).st_mode))
    try:
        group = zarr.open_group(store, mode="r", use_consolidated=False)
    except FileNotFoundError:
        if is_folder(store):
            raise _not_a_store(store, "another folder") from None
        return False
    if PROGRESS in group and "run" in group[PROGRESS].attrs:
        return True
    if is_folder(store) or "unfinished" not in group.attrs:
        raise ValueError(
            f"store: expected a new name or a store that ensemble made, got another: {store}"
        )
    return False  # the process that was making it is gone


def _not_a_store(store: str, received: str) -> OSError:
    message = f"expected the name of a Zarr store to write, got {received}"
    return OSError(errno.EEXIST, message, store)


def create(
    job: Job,
    identity: dict[str, Any],
    resume_size: int,
    coords: Mapping[Any, Any] | None,
    since: str | None,
) -> None:
    """Make the arrays, empty. A folder appears as a whole.

    `since` is the start of the machine that is noted, if any; see `settling`.
    """
    import zarr
    from zarr.core.sync import sync

    dataset = _skeleton(job, coords)
    notes: dict[str, Any] = {
        "run": json.dumps(identity),
        "tile": list(job.plan.tile),
        "rows": job.plan.rows,
    }
    if since is not None:
        notes[_UNSETTLED] = since
    if not is_folder(job.store):
        sync(_fill(job, dataset, job.store, notes, resume_size, {"unfinished": True}))
        del zarr.open_group(job.store, mode="r+", use_consolidated=False).attrs["unfinished"]
        _consolidate(job.store)
        return
    # Zarr takes a thread for each file of a folder, and none for what is in memory.
    files: dict[str, Any] = {}
    memory = zarr.storage.MemoryStore(files)
    sync(_fill(job, dataset, memory, notes, resume_size, {}))
    _consolidate(memory)
    with replacing(job.store, folder=True) as new:
        for name, content in files.items():
            path = new / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content.to_bytes())
        settle_all(new)
    settle(Path(job.store).parent)


def _skeleton(job: Job, coords: Mapping[Any, Any] | None) -> Any:
    """The dataset, with arrays of no memory in place of results."""
    batch, D = job.plan.batch, job.body.dimension
    n = job.numbers

    def empty(lead: tuple[int, ...], tail: tuple[int, ...], dtype: str = "f8") -> Any:
        return np.broadcast_to(np.zeros((), dtype), (*lead, *batch, *tail))

    entries: dict[str, Any] = {
        **header_of(job.map, job.method, job.steps, job.save_every),
        "omega": empty(n.shape, (D,)),
        "n": n,
        "eps": job.eps,
        "status": empty((), (), "i1"),
        "failed_at": empty((), (), "i8"),
        "final": empty((), (D,)),
        **{name: np.asarray(value) for name, value in job.body._values.items()},
    }
    if job.orientation is not None and job.keeps_states:
        entries["attitude"] = empty(n.shape, (D + 1, D + 1))
    dataset = labelled.dataset_of(entries, job.dims, coords)
    if dataset["time"].ndim > 1 or not job.keeps_states:
        dataset = dataset.drop_vars("time")  # made when the store is opened
    if not job.keeps_states:
        dataset = dataset.drop_vars(["omega", "n"])
    for name, variable in dataset.coords.items():
        if variable.dtype.kind == "U":
            # Strings of fixed length are no part of Zarr's third format.
            dataset[name] = variable.astype(object)
    for name in job.reductions:
        own = ("component",) if REDUCTIONS[name].of_components else ()
        tail = (D,) if own else ()
        attributes = {"long_name": REDUCTIONS[name].meaning}
        dataset[name] = ((*job.dims, *own), empty((), tail), attributes)
    status = dataset["status"].attrs
    status["flag_values"] = np.append(status["flag_values"], np.int8(NOT_COMPUTED))
    status["flag_meanings"] += f" {_PENDING}"
    return dataset


async def _fill(
    job: Job,
    dataset: Any,
    store: Any,
    notes: dict[str, Any],
    resume_size: int,
    besides: dict[str, Any],
) -> None:
    """The dataset as `Dataset.to_zarr` would write it, and what is noted beside it.

    It would make all arrays one after the other, and a task of each chunk of results.
    """
    import asyncio

    from xarray.conventions import encode_cf_variable, encode_dataset_coordinates
    from zarr.api.asynchronous import create_group
    from zarr.codecs import Crc32cCodec

    variables, attributes = encode_dataset_coordinates(dataset)
    group = await create_group(
        store=store, overwrite=True, zarr_format=3, attributes=_plain(attributes) | besides
    )

    async def make(name: str) -> None:
        encoding = _encoding(job, dataset[name])
        if _is_result(name):
            values = variables[name]
        else:
            if dataset[name].dtype.kind == "f":
                variables[name].encoding["_FillValue"] = None  # NaN stays what it is
            values = encode_cf_variable(variables[name], name=name)
        array = await group.create_array(
            name,
            shape=values.shape,
            dtype=str if values.dtype == object else values.dtype,
            dimension_names=values.dims,
            attributes=_plain(values.attrs),
            **encoding,
        )
        if not _is_result(name):
            await array.setitem(..., values.values)

    async def note() -> None:
        progress = await group.create_group(PROGRESS, attributes=notes)
        grid = job.plan.grid
        ones = tuple(1 for _ in grid)
        each = {"compressors": [Crc32cCodec()]}
        await progress.create_array(
            "steps_done", shape=grid, chunks=ones, dtype="i8", fill_value=-1, **each
        )
        if resume_size:
            chunk = (*ones, resume_size)
            await progress.create_array(
                "resume", shape=(*grid, resume_size), chunks=chunk, dtype="u1", fill_value=0, **each
            )

    await asyncio.gather(note(), *map(make, variables))


def _is_result(name: str) -> bool:
    return name in ("omega", "attitude", "final", "status", "failed_at", *REDUCTIONS)


def _plain(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    """As JSON holds them."""
    return {
        name: value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
        for name, value in attributes.items()
    }


def _consolidate(store: Any) -> None:
    """Put what readers need to know of all arrays into one place, which changes as a whole."""
    import zarr

    with warnings.catch_warnings():
        # It is an extension of the format, which all readers that do not know it ignore.
        warnings.simplefilter("ignore", UserWarning)
        zarr.consolidate_metadata(store)


def _encoding(job: Job, variable: Any) -> dict[str, Any]:
    """Chunks along the tiles, each with a checksum, after which Zarr asks when it is read."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    if variable.dtype.kind not in "iuf":
        return {}
    sizes = dict(zip(job.dims, job.plan.tile, strict=True))
    chunks = tuple(
        max(1, min(sizes.get(name, length), length))
        for name, length in zip(variable.dims, variable.shape, strict=True)
    )
    results = variable.name in ("omega", "attitude")
    if results:
        chunks = (job.plan.rows, *chunks[1:])
    codecs: list[Any] = [Crc32cCodec()]
    if job.compression is not None:
        codecs.insert(
            0,
            BloscCodec(
                cname=job.compression,
                clevel=1,
                shuffle="shuffle",
                typesize=variable.dtype.itemsize,
            ),
        )
    encoding: dict[str, Any] = {"chunks": chunks, "compressors": tuple(codecs)}
    if variable.dtype.kind == "f":
        encoding["fill_value"] = float("nan")
    if variable.name == "status":
        encoding["fill_value"] = NOT_COMPUTED
    if variable.name == "failed_at":
        encoding["fill_value"] = -1
    return encoding


class Arrays:
    """The arrays of a store by name, each looked up once, chunks of NaN written like all others."""

    def __init__(self, store: Any) -> None:
        import zarr

        self._group = zarr.open_group(store, mode="r+", use_consolidated=False)
        self._opened: dict[str, Any] = {}
        self._known: dict[str, bool] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._opened:
            array = self._group[name]
            self._opened[name] = array.with_config({"write_empty_chunks": True})
        return self._opened[name]

    def __contains__(self, name: str) -> bool:
        if name not in self._known:
            self._known[name] = name in self._group
        return self._known[name]

    @property
    def attrs(self) -> Any:
        """The attributes of the dataset."""
        return self._group.attrs

    @property
    def notes(self) -> Any:
        """What is known of the run beside the dataset."""
        return self._group[PROGRESS].attrs

    @property
    def unsettled(self) -> str | None:
        """The start of the machine since which there is what may be in memory only, if noted."""
        since: str | None = self.notes.get(_UNSETTLED)
        return since

    def note_unsettled(self, since: str | None) -> None:
        """Note it, or that there is nothing of the kind, on the disk."""
        notes = self.notes
        if since is None:
            del notes[_UNSETTLED]
        else:
            notes[_UNSETTLED] = since
        if (root := path_of(self[STEPS_DONE])) is not None:
            settle(root.parent / "zarr.json")
            settle(root.parent)


def lengthen(job: Job, group: Arrays) -> None:
    """Make room for the states of a run that is longer than the stored one."""
    if job.keeps_states:
        _make_rows(job, group)
    group.attrs["steps"] = job.steps
    _consolidate(job.store)
    if is_folder(job.store):
        root = Path(job.store)
        for name in ("n", "time"):
            if name in group and job.keeps_states:
                settle_all(root / name)
        for folder in (root, *(root / name for name in ("omega", "attitude") if name in group)):
            settle(folder / "zarr.json")
            settle(folder)


def _make_rows(job: Job, group: Arrays) -> None:
    numbers = job.numbers
    for name in ("omega", "attitude"):
        if name in group:
            group[name].resize((len(numbers), *group[name].shape[1:]))
    values: dict[str, Any] = {"n": numbers}
    if "time" in group:
        values["time"] = numbers * float(job.eps)
    for name, array in values.items():
        group[name].resize(array.shape)
        group[name][:] = array


def packed(steps: int, resume: Mapping[str, Any]) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """What a segment left to go on from, as bytes."""
    file = io.BytesIO()
    np.savez(file, steps=np.array(steps), **resume)
    return np.frombuffer(file.getvalue(), np.uint8)


def unpacked(data: np.ndarray[Any, np.dtype[np.uint8]]) -> tuple[int, dict[str, Any]]:
    """The number of steps, and what they left."""
    size = int(data[:8].view(np.int64)[0])
    with np.load(io.BytesIO(data[8 : 8 + size].tobytes()), allow_pickle=False) as archive:
        entries = dict(archive)
    return int(entries.pop("steps")), entries


def path_of(array: Any) -> Path | None:
    """The folder of an array, if it is in one."""
    root = getattr(array.store, "root", None)
    return Path(root) / array.path if isinstance(root, Path) else None
