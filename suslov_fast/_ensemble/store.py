"""Creation, extension, repair and opening of the Zarr store of a run.

The root group holds the results, with the names and attributes of `Trajectories.to_xarray`. The
group "progress" holds the data for resumption; its attributes describe the run, with a digest:

    steps_done    for each tile the number of steps of the run for which it was finished, or -1
    record        for each trajectory the data from which the next piece starts, as `Job.record`

An absent chunk reads as not computed: NaN, or the status PENDING. Each chunk has a checksum,
which Zarr verifies when it reads. The root group holds a copy of all metadata ("consolidated"),
in one object: readers see either all old or all new shapes while a run is extended, and each
file of metadata is compared with its copy.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from .._checks import wrong
from .._engine.execution import numbers_of_saved
from .._kernels.codes import NOT_COMPUTED
from .._maps.registry import map_named
from .._runs import labelled
from .._runs.schema import header_of, schema_of
from .codecs import refuse_codecs
from .job import Job, require_same
from .reductions import reductions_of

PROGRESS = "progress"
MARKS, RECORDS = f"{PROGRESS}/steps_done", f"{PROGRESS}/record"
# Version of this format.
_LAYOUT = 4
# Attributes of the root until all metadata are written for the first time.
_UNFINISHED = {"unfinished": True}
# What Zarr raises if metadata are damaged. Errors of access to a store are others.
_DAMAGE = (
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
    ArithmeticError,
    RuntimeError,
)

# Number of tiles whose marks share a chunk, which is rewritten for each, and of steps in one of n.
_TOGETHER = 4096

Arrays = dict[str, Any]


def resolved(store: Any) -> Any:
    """Return a store that other processes can open: folders and their URLs as absolute paths.

    Raises ImportError if a library that stores need is not installed.
    """
    labelled.import_xarray("dask.array", "filelock", "zarr", extra="large")
    if isinstance(store, str) and store.startswith(("file:", "local:")):
        from fsspec.core import url_to_fs

        store = url_to_fs(store)[1]
    return os.path.abspath(os.fspath(store)) if _is_folder(store) else store


def _is_folder(store: Any) -> bool:
    return isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store)


@contextmanager
def only_writer(store: Any) -> Iterator[None]:
    """Lock a folder against other writers, under any of its names.

    Raises BlockingIOError if there is another writer, and OSError if the lock file is a symbolic
    link. Stores that are not folders are not locked.
    """
    if not _is_folder(store):
        yield
        return
    from filelock import FileLock, Timeout

    try:
        locked = FileLock(f"{os.path.realpath(store)}.lock").acquire(blocking=False)
    except Timeout:
        message = "expected a store without another writer, got one in use"
        raise BlockingIOError(errno.EAGAIN, message, store) from None
    with locked:
        yield


class Found(NamedTuple):
    """Contents of a store."""

    # The description of the run.
    notes: dict[str, Any]
    # Number of steps that readers see, and for each tile the number for which it was finished.
    steps: int = -1
    done: Any = None
    # What is damaged, if anything is.
    damage: Exception | None = None


def _group(store: Any, path: str = "", copies: bool = False, mode: Any = "r") -> Any:
    """Open a group, with `copies` by the metadata in the root; None if it cannot be read."""
    import zarr

    options = {"mode": mode, "zarr_format": 3, "use_consolidated": copies}
    try:
        group = zarr.open_group(store, path=path, **options)
    except (FileNotFoundError, NotADirectoryError, *_DAMAGE):
        return None
    return group if group.metadata.zarr_format == 3 else None  # not that of a damaged one


def _member(group: Any, name: str) -> Any:
    """Return an array or a group; None if it cannot be read."""
    try:
        return None if group is None else group[name]
    except _DAMAGE:
        return None


def _digest(notes: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(notes, sort_keys=True).encode()).hexdigest()


def _notes(group: Any) -> dict[str, Any]:
    """Return the description of the run in a group; empty if it is damaged or absent."""
    notes = {} if group is None else dict(group.attrs)
    return notes if notes.pop("digest", None) == _digest(notes) else {}


def look(store: Any, run: str | None = None) -> Found | None:
    """Return what a store holds, and what is damaged; None if there is no store.

    If the two descriptions in a store differ, that of `run` counts. Raises ValueError if the store
    is of another program or version.
    """
    # The copies first: while a run is extended, the originals are newer.
    copies, root, own = _group(store, copies=True), _group(store), _group(store, PROGRESS)
    attributes = next((dict(each.attrs) for each in (copies, root) if each is not None), {})
    if attributes == _UNFINISHED or (own is None and not attributes and _is_free(store, root)):
        return None
    new, old = _notes(own), _notes(_member(copies, PROGRESS))
    notes = new if new and run in (None, new["run"]) else old or new
    if not notes:
        stored = {} if own is None else dict(own.attrs)
        received = f"another: {store}"
        if "run" in stored:
            of = attributes.get("source", f"suslov_fast {attributes.get('version', 'unknown')}")
            received = f"format {stored.get('layout', 1)} of {of}: compute {store} anew"
        raise wrong("store", f"a new name or a store in format {_LAYOUT}", received)
    try:
        _compare(store, root, copies, new, old)
        refuse_codecs(store)
        needed = ("eps", "component", *map_named(attributes["map"]).body._names())
        for name in new["known"]:
            values = np.asarray(root[name][...])  # raises an error if its checksum differs
            lost = values == "" if values.dtype.kind in "OT" else values != values
            if name in needed and lost.any():
                raise ValueError(f"a chunk of {name} is missing")
        done = np.asarray(root[MARKS][...])
        shown = attributes["steps"]
        if done.max(initial=-1) > shown < old["steps"] and _group(store).attrs["steps"] == shown:
            raise ValueError("zarr.json is damaged")
    except _DAMAGE as damage:
        return Found(notes, damage=damage)
    return Found(notes, shown, done)


def _is_free(store: Any, root: Any) -> bool:
    """Return True if a store can be created in a place without metadata."""
    if root is not None or not _is_folder(store) or not os.path.lexists(store):
        return root is None or not list(root)
    return os.path.isdir(store) and all(name.endswith(".partial") for name in os.listdir(store))


def _compare(store: Any, root: Any, copies: Any, new: dict[str, Any], old: dict[str, Any]) -> None:
    """Raise an error that names metadata that are lost or differ from their copy.

    While a run is extended, it has more steps than its copy, and axes of time may be longer.
    """
    if not new:
        raise ValueError(f"{PROGRESS}/zarr.json is damaged or missing")
    about = new["attributes"]
    if (
        root is None
        or not old
        or old != {**new, "steps": old["steps"]}
        or about != {name: copies.attrs[name] for name in about}
        or not 0 <= copies.attrs["steps"] <= old["steps"] <= new["steps"]
    ):
        raise ValueError("zarr.json is damaged or missing")
    for name in (*new["known"], *new["computed"], MARKS, RECORDS):
        node, member = copies[name].metadata.to_dict(), _member(root, name)
        found = {} if member is None else member.metadata.to_dict()
        if found and (node.get("dimension_names") or ("",))[0] == "n":
            rows, *others = found["shape"]
            latest = _notes(_group(store, PROGRESS))["steps"]
            if node["shape"][0] <= rows <= len(numbers_of_saved(latest, about.get("save_every"))):
                found["shape"] = (node["shape"][0], *others)
        if found != node:
            raise ValueError(f"{name}/zarr.json is damaged or missing")


def prepare(job: Job, identity: dict[str, Any], dataset: Any, verify: bool) -> Job:
    """Create, extend or repair the store of a run; return the job with the chunks of the store.

    Raises ValueError if the store holds another run, or is damaged, and FileExistsError if the
    path is not a Zarr store. The next call completes the work of a process killed here.
    """
    import zarr

    store, run = job.store, json.dumps(identity)
    if _group(store) is None and _group(store, PROGRESS) is None and not _is_free(store, None):
        received = "another folder" if os.path.isdir(store) else "a file"
        message = f"expected the name of a Zarr store to write, got {received}"
        raise OSError(errno.EEXIST, message, store)
    found = look(store, run)
    if found is None:
        group = zarr.open_group(store, mode="a", zarr_format=3, use_consolidated=False)
        group.attrs.put(_UNFINISHED)
        for name in list(group):
            del group[name]
        about = {name: value for name, value in dataset.attrs.items() if name != "steps"}
        notes: dict[str, Any] = {"layout": _LAYOUT, "run": run, "attributes": about, "known": []}
        notes |= {"tile": job.tile, "rows": job.rows, "compression": job.compression}
        _write(job, dataset, notes, True)
        return job
    notes = found.notes
    require_same(identity, json.loads(notes["run"]), store)
    if notes["steps"] > job.steps:
        raise wrong("steps", f"at least the {notes['steps']} of the run in {store}", job.steps)
    tile, rows, compression = tuple(notes["tile"]), notes["rows"], notes["compression"]
    job = replace(job, tile=tile, rows=rows, compression=compression)
    if not verify:
        with advice(store):
            if found.damage:
                raise found.damage
            records = _group(store)[RECORDS]
            for each in np.flatnonzero(found.done != job.steps).tolist():
                records[job.where(each)]  # raises an error if its checksum differs
    if verify or found.steps != job.steps:
        _write(job, dataset, notes, verify)
    return job


def _write(job: Job, dataset: Any, notes: dict[str, Any], all_values: bool) -> None:
    """Write the metadata of all arrays, and the known values; existing chunks remain."""
    import zarr
    from zarr.codecs import BloscCodec, Crc32cCodec

    groups = (_group(job.store, path, mode="r+") for path in ("", PROGRESS))
    group = next(each for each in groups if each is not None)
    place = zarr.storage.StorePath(group.store, group.path.removesuffix(PROGRESS))
    # Metadata are made in memory, since Zarr removes the chunks of an array that it creates.
    memory = zarr.create_group(zarr.storage.MemoryStore(), zarr_format=3)

    def put_group(path: str, attributes: dict[str, Any]) -> None:
        made = zarr.AsyncGroup(memory.metadata, place / path)
        zarr.Group(made).update_attributes(attributes)
        memory.attrs.put({})

    def put(name: str, shape: Any, chunks: Any, **options: Any) -> None:
        made = memory.create_array(name, shape=shape, chunks=chunks, **options)
        zarr.Array(zarr.AsyncArray(made.metadata, place / name)).update_attributes({})

    if _group(job.store) is None:
        put_group("", notes["attributes"])
    group = zarr.open_group(job.store, mode="r+", use_consolidated=False)
    computed: list[Any] = [*job.states, *job.ends, *("n",) * job.keeps_states]
    known = dataset.drop_vars(computed).drop_attrs(deep=False)
    for name in notes["known"]:
        if name not in known.variables and _member(group, name) is None:
            raise wrong("coords", f"{name}, which {job.store} has lost", "none")
    names = sorted({*notes["known"], *map(str, known.variables)})
    notes = {**notes, "known": names, "computed": computed, "steps": job.steps}
    put_group(PROGRESS, {**notes, "digest": _digest(notes)})
    codecs: list[Any] = [Crc32cCodec()]
    size, tiles = job.record.itemsize, math.prod(job.grid)
    put(MARKS, (tiles,), (_TOGETHER,), dtype="int64", fill_value=-1, compressors=codecs)
    chunks = (*job.tile, size)
    put(RECORDS, (*job.batch, size), chunks, dtype="uint8", fill_value=255, compressors=codecs)
    packed = list(codecs)
    if job.compression:
        packed.insert(0, BloscCodec(cname=job.compression, clevel=1, shuffle="shuffle"))
    lengths = {"n": job.rows, **dict(zip(job.dims, job.tile, strict=True))}
    for name in computed:
        variable = dataset[name].variable
        chunks = tuple(lengths.get(dim, length) for dim, length in variable.sizes.items())
        put(
            name,
            variable.shape,
            # A chunk of n does not depend on the number of steps: it serves old and new metadata.
            (_TOGETHER,) if name == "n" else chunks,
            dtype=variable.dtype,
            fill_value=np.nan if variable.dtype.kind == "f" else NOT_COMPUTED,
            compressors=packed,
            dimension_names=variable.dims,
            attributes={key: np.asarray(each).tolist() for key, each in variable.attrs.items()},
        )
    if job.keeps_states:
        group["n"][...] = job.numbers
    if all_values:
        encoding: dict[Any, Any] = {}
        for name, variable in known.variables.items():
            del group[name]
            encoding[name] = {"compressors": codecs}
            if variable.dtype.kind == "f":  # an absent chunk is recognised by its NaN
                encoding[name] |= {"fill_value": np.nan, "_FillValue": None}
        known.attrs = dict(group.attrs)
        known.to_zarr(job.store, mode="a", consolidated=False, encoding=encoding, zarr_format=3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an extension of Zarr's format
        zarr.consolidate_metadata(job.store, zarr_format=3)
    # Last of all the number of steps, in one object with the copies.
    group = zarr.open_group(job.store, mode="r+", use_consolidated=True)
    others = {name: each for name, each in group.attrs.items() if name not in _UNFINISHED}
    group.attrs.put({**others, **notes["attributes"], "steps": job.steps})


def dataset_of(job: Job, coords: Mapping[Any, Any] | None) -> Any:
    """Return the dataset of a run, with placeholders without memory for results."""
    batch, D = job.batch, job.body.dimension
    entries = header_of(job.body, job.map, job.method, job.steps, job.save_every)
    entries |= {"eps": job.eps, **job.parameters}
    if job.keeps_states:
        entries["n"] = job.numbers
    sizes = {"n": len(job.numbers), "component": D, "space": D + 1, "body": D + 1}
    for name, entry in schema_of(job.map).items():
        if name in (*job.states, *job.ends):
            shape = entry.axes(batch, sizes)
            entries[name] = np.broadcast_to(np.zeros((), entry.dtype), shape)
    dataset = labelled.dataset_of(entries, job.dims, coords)
    for name in job.reductions:
        meaning, *_, of_components = reductions_of(job.map)[name]
        own = {"component": D} if of_components else {}
        nothing = np.broadcast_to(0.0, (*batch, *own.values()))
        dataset[name] = ((*job.dims, *own), nothing, {"long_name": meaning})
    status = dataset["status"].attrs
    status["flag_values"] = np.append(status["flag_values"], np.int8(NOT_COMPUTED))
    status["flag_meanings"] += " PENDING"
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "U":  # Zarr 3 has only strings of variable length
            dataset[name] = variable.astype(object)
    return dataset


def open_arrays(job: Job) -> Arrays:
    """Return the arrays written during a run, by name."""
    group = _group(job.store, mode="r+")
    # Chunks of NaN are written like others: testing for them takes longer.
    return {
        name: group[name].with_config({"write_empty_chunks": True})
        for name in (MARKS, RECORDS, *job.states, *job.ends)
    }


def withdraw(job: Job, arrays: Arrays, tile: int, record: bool = False) -> None:
    """Remove the data of a tile written with its last step, or all its data if `record`."""
    where = job.where(tile)
    parts = dict.fromkeys((*job.ends, *((RECORDS,) * record)), where)
    if record or job.save_every is None:
        parts |= {name: (slice(None), *where) for name in job.states}
    for name, part in parts.items():
        # A chunk that holds only the fill value is removed.
        array = arrays[name].with_config({"write_empty_chunks": False})
        array[part] = array.fill_value


def open_dataset(store: Any, chunks: Any = "auto") -> Any:
    """Return the dataset of a store, lazy."""
    import xarray

    found = look(store)
    if found is None:
        received = f"none at {store}"
        raise wrong("store", "a store written by ensemble", received, FileNotFoundError)
    with advice(store), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that are no part of the format
        if found.damage:
            raise found.damage
        # The copies agree with each other while the arrays are extended.
        options: dict[str, Any] = {"zarr_format": 3, "chunks": chunks, "drop_variables": ["n"]}
        dataset = xarray.open_zarr(store, consolidated=True, **options)
        done, steps = found.done, found.steps
        dataset.attrs["steps"] = steps
        dataset.attrs["tiles_done"] = f"{int((done == steps).sum())} of {done.size}"
        if "n" in dataset.dims:
            numbers = numbers_of_saved(steps, dataset.attrs.get("save_every"))
            dataset = dataset.isel(n=slice(0, len(numbers)))
            dataset = dataset.assign_coords(n=("n", numbers, dict(_group(store)["n"].attrs)))
            dataset = labelled.with_time(dataset)
    return dataset


@contextmanager
def advice(store: Any) -> Iterator[None]:
    """Add to an error about damaged data how to repair them."""
    try:
        yield
    except _DAMAGE as error:
        received = f"{store}: {error}; ensemble with verify=True repairs it"
        raise wrong("store", "an undamaged store", received) from error
