"""Creation, extension, repair and opening of the Zarr store of a run.

The root group holds the results, with the names and attributes of `Trajectories.to_xarray`. The
group "progress" holds the data for resumption; its attributes identify the run:

    steps_done    for each tile the number of steps of the run for which it was finished, or -1
    record        for each trajectory the data from which the next piece starts, as `Job.record`

An absent chunk reads as not computed: NaN, or the status PENDING. Each chunk has a checksum,
which Zarr verifies when it reads. The root group holds a copy of all metadata ("consolidated"),
in one object: readers see either all old or all new shapes while a run is extended.
"""

from __future__ import annotations

import errno
import json
import math
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from .._checks import wrong
from .._engine.run import numbers_of_saved
from .._kernels.codes import NOT_COMPUTED
from .._maps.registry import map_named
from .._runs import labelled
from .._runs.codecs import refuse_codecs
from .._runs.schema import header_of, schema_of
from .job import Job, require_same
from .reductions import REDUCTIONS

PROGRESS = "progress"
MARKS, RECORDS = f"{PROGRESS}/steps_done", f"{PROGRESS}/record"
# Version of this format; stores of suslov_fast 0.2 have none.
_LAYOUT = 3

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


def _group(store: Any, mode: Any = "r") -> Any:
    """Open the root group; None if there is none, or an empty one left by a killed process."""
    import zarr

    try:
        group = zarr.open_group(store, mode=mode, zarr_format=3, use_consolidated=False)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return group if PROGRESS in group or group.attrs or list(group) else None


def _notes(group: Any, store: Any) -> dict[str, Any]:
    """Return the description of the run in a store; ValueError if it is of another version."""
    notes = dict(group[PROGRESS].attrs) if PROGRESS in group else {}
    if notes.get("layout") != _LAYOUT:
        source = group.attrs.get("source", "") if "run" in notes else ""
        received = f"another{f', of {source}' if source else ''}: {store}"
        raise wrong("store", "a new name or a store written by ensemble of this version", received)
    return notes


def _stranger(store: Any) -> str | None:
    """Return a description of a path that is not a Zarr group."""
    if not _is_folder(store) or not os.path.lexists(store):
        return None
    if not os.path.isdir(store):
        return "a file"
    names = [name for name in os.listdir(store) if not name.endswith(".partial")]
    return "another folder" if names and "zarr.json" not in names else None


def prepare(job: Job, identity: dict[str, Any], dataset: Any, verify: bool) -> Job:
    """Create, extend or repair the store of a run; return the job with the chunks of the store.

    Raises ValueError if the store holds another run, or none, and FileExistsError if the path is
    not a Zarr store. The next call completes the work of a process killed here.
    """
    import zarr

    group, store = _group(job.store), job.store
    if group is None:
        if stranger := _stranger(store):
            message = f"expected the name of a Zarr store to write, got {stranger}"
            raise OSError(errno.EEXIST, message, store)
        group = zarr.open_group(store, mode="a", zarr_format=3, use_consolidated=False)
        notes: dict[str, Any] = {
            "layout": _LAYOUT,
            "run": json.dumps(identity),
            "tile": list(job.tile),
            "rows": job.rows,
            "variables": sorted(map(str, dataset.variables)),
        }
        group.create_group(PROGRESS, attributes=notes)
    notes = _notes(group, store)
    require_same(identity, json.loads(notes["run"]), store)
    stored = int(group.attrs.get("steps", -1))
    if stored > job.steps:
        raise wrong("steps", f"at least the {stored} of the run in {store}", job.steps)
    job = replace(job, tile=tuple(notes["tile"]), rows=int(notes["rows"]))
    with advice(store):
        whole = zarr.open_group(store, mode="r").metadata.consolidated_metadata is not None
        if stored != job.steps or verify or not whole:
            _write(job, dataset, verify or stored < 0)
        refuse_codecs(store)
    return job


def _write(job: Job, dataset: Any, all_values: bool) -> None:
    """Resize arrays to the shapes of the dataset, and write the known values."""
    import zarr
    from zarr.codecs import BloscCodec, Crc32cCodec

    group = zarr.open_group(job.store, mode="r+", use_consolidated=False)
    attributes, codecs = dict(group.attrs), [Crc32cCodec()]
    packed: list[Any] = list(codecs)
    if job.compression:
        packed.insert(0, BloscCodec(cname=job.compression, clevel=1, shuffle="shuffle"))

    def fit(name: str, shape: Any, chunks: Any, **options: Any) -> None:
        array = _array(group, name)
        if array is None or array.chunks != chunks:
            options = {"compressors": codecs, "overwrite": True, **options}
            group.create_array(name, shape=shape, chunks=chunks, **options)
        elif array.shape != shape:
            array.resize(shape)

    size, tiles = job.record.itemsize, math.prod(job.grid)
    fit(MARKS, (tiles,), (_TOGETHER,), dtype="int64", fill_value=-1)
    fit(RECORDS, (*job.batch, size), (*job.tile, size), dtype="uint8", fill_value=255)
    lengths = {"n": job.rows, **dict(zip(job.dims, job.tile, strict=True))}
    computed: list[Any] = [*job.states, *job.ends]
    for name in computed:
        variable = dataset[name].variable
        fit(
            name,
            variable.shape,
            tuple(lengths.get(dim, length) for dim, length in variable.sizes.items()),
            dtype=variable.dtype,
            fill_value=np.nan if variable.dtype.kind == "f" else NOT_COMPUTED,
            compressors=packed,
            dimension_names=variable.dims,
            attributes={key: np.asarray(each).tolist() for key, each in variable.attrs.items()},
        )
    if job.keeps_states:
        about = {"dimension_names": ("n",), "attributes": dict(dataset["n"].attrs)}
        # A chunk does not depend on the number of steps: it serves old and new metadata.
        fit("n", job.numbers.shape, (_TOGETHER,), dtype="int64", fill_value=0, **about)
        group["n"][...] = job.numbers
    if all_values:
        known = dataset.drop_vars([*computed, "n"], errors="ignore").drop_attrs(deep=False)
        encoding: dict[Any, Any] = {}
        for name, variable in known.variables.items():
            del group[name]
            encoding[name] = {"compressors": codecs}
            if variable.dtype.kind == "f":  # an absent chunk is recognised by its NaN
                encoding[name] |= {"fill_value": np.nan, "_FillValue": None}
        known.to_zarr(job.store, mode="a", consolidated=False, encoding=encoding, zarr_format=3)
        group = zarr.open_group(job.store, mode="r+", use_consolidated=False)
    # Coordinates of the user that are not passed now remain.
    group.attrs.put({**dataset.attrs, **group.attrs, **attributes, "steps": job.steps})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an extension of Zarr's format
        zarr.consolidate_metadata(job.store, zarr_format=3)


def _array(group: Any, name: str) -> Any:
    """Return an array; None if its metadata are missing or damaged."""
    try:
        return group[name]
    except (KeyError, ValueError, TypeError, AttributeError):
        return None


def dataset_of(job: Job, coords: Mapping[Any, Any] | None) -> Any:
    """Return the dataset of a run, with placeholders without memory for results."""
    batch, D = job.batch, job.body.dimension
    entries = header_of(job.map, job.method, job.steps, job.save_every)
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
        meaning, *_, of_components = REDUCTIONS[name]
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
    group = _group(job.store, "r+")
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

    group = _group(store)
    if group is None and _stranger(store):
        raise wrong("store", "a store written by ensemble", f"another one: {store}")
    notes = {} if group is None else _notes(group, store)
    if group is None or "steps" not in group.attrs:
        received = f"none at {store}"
        raise wrong("store", "a store written by ensemble", received, FileNotFoundError)
    with advice(store), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that are no part of the format
        refuse_codecs(store)
        if lost := [name for name in notes["variables"] if name not in group]:
            raise ValueError(f"{', '.join(lost)} missing")
        options: dict[str, Any] = {"zarr_format": 3, "chunks": chunks, "drop_variables": ["n"]}
        try:
            dataset = xarray.open_zarr(store, consolidated=False, **options)
        except ValueError:  # some arrays are already longer while a run is extended
            dataset = xarray.open_zarr(store, consolidated=True, **options)
        for name in ("eps", "component", *map_named(dataset.attrs["map"]).body._names()):
            values = dataset[name].load().values if name in dataset else np.empty(0)
            if (values == "" if values.dtype.kind in "OT" else values != values).any():
                raise ValueError(f"a chunk of {name} is missing")
        done, steps = np.asarray(group[MARKS][...]), int(dataset.attrs["steps"])
        dataset.attrs["tiles_done"] = f"{int((done == steps).sum())} of {done.size}"
        if "n" in dataset.dims:
            numbers = numbers_of_saved(steps, dataset.attrs.get("save_every"))
            dataset = dataset.isel(n=slice(0, len(numbers)))
            dataset = dataset.assign_coords(n=("n", numbers, dict(group["n"].attrs)))
            dataset = labelled.with_time(dataset)
    return dataset


@contextmanager
def advice(store: Any) -> Iterator[None]:
    """Add to an error about damaged data how to repair them."""
    try:
        yield
    except (ValueError, RuntimeError, KeyError) as error:
        received = f"{store}: {error}; ensemble with verify=True repairs it"
        raise wrong("store", "an undamaged store", received) from error
