"""The Zarr store of a run: created, lengthened, verified, opened.

Results lie in the root group, under the names and with the attributes of `Trajectories.to_xarray`.
What is needed to go on lies in the group "progress":

    steps_done    the mark of a tile: number of its steps that are stored; -1 before state 0 is
    record        for each trajectory what the next piece starts from, the bytes of `Job.record`

A chunk that is absent reads as not computed: NaN, or the status PENDING. The root group holds a
copy of the metadata of all arrays ("consolidated"), which is one object, so that readers see the
arrays of a run that is being lengthened either all short or all long.
"""

from __future__ import annotations

import errno
import json
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from .._engine.run import numbers_of_saved
from .._kernels.codes import NOT_COMPUTED
from .._runs import labelled
from .._runs.codecs import refuse_codecs
from .._runs.schema import header_of
from .job import Index, Job, require_same
from .reductions import REDUCTIONS

PROGRESS = "progress"
MARKS, RECORDS = f"{PROGRESS}/steps_done", f"{PROGRESS}/record"
# Number of this arrangement; stores of version 0.2 have none.
_LAYOUT = 3
_CREATING = "creating"

# Integers that stand for what is not computed in the dataset; floats are NaN.
_PENDING = {"status": NOT_COMPUTED, "failed_at": NOT_COMPUTED}

Arrays = dict[str, Any]


def resolved(store: Any) -> Any:
    """Return a store that other processes find: a folder, or its URL, as an absolute path."""
    if isinstance(store, str) and store.startswith(("file:", "local:")):
        from fsspec.core import url_to_fs

        store = url_to_fs(store)[1]
    return os.path.abspath(os.fspath(store)) if _is_folder(store) else store


def _is_folder(store: Any) -> bool:
    return isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store)


@contextmanager
def only_writer(store: Any) -> Iterator[None]:
    """Keep other writers out of a folder, whatever the name it goes by.

    Raises BlockingIOError if there is another writer, and OSError if the lock file is a symbolic
    link. Nothing is locked for stores that are no folders.
    """
    if not _is_folder(store):
        yield
        return
    from filelock import FileLock, Timeout

    lock = FileLock(f"{os.path.realpath(store)}.lock")
    try:
        lock.acquire(blocking=False)
    except Timeout:
        message = "expected a store without another writer, got one in use"
        raise BlockingIOError(errno.EAGAIN, message, store) from None
    try:
        yield
    finally:
        lock.release()


def _root(store: Any, mode: Any = "r", consolidated: bool | None = False) -> Any:
    """Open the root group; None if there is none."""
    import zarr

    try:
        return zarr.open_group(store, mode=mode, zarr_format=3, use_consolidated=consolidated)
    except (FileNotFoundError, NotADirectoryError):
        return None


def _group(store: Any, mode: Any = "r", consolidated: bool | None = False) -> Any:
    """Open the root group of a store whose creation was finished, else None."""
    group = _root(store, mode, consolidated)
    return None if group is None or _CREATING in group.attrs else group


def _notes(group: Any, store: Any) -> dict[str, Any]:
    """Return what a store says of its run; ValueError if it is not of this version."""
    notes = dict(group[PROGRESS].attrs) if PROGRESS in group else {}
    if notes.get("layout") != _LAYOUT:
        source = group.attrs.get("source", "") if "run" in notes else ""
        raise ValueError(
            "store: expected a new name or a store that ensemble of this version made, "
            f"got another{f', of {source}' if source else ''}: {store}"
        )
    return notes


def _stranger(store: Any) -> str | None:
    """Return a name for what lies where there is no Zarr group, if it is no begun store."""
    if not _is_folder(store) or not os.path.lexists(store):
        return None
    if not os.path.isdir(store):
        return "a file"
    # A process that was killed may have left these.
    names = [name for name in os.listdir(store) if not name.endswith(".partial")]
    return "another folder" if names and "zarr.json" not in names else None


def recognised(job: Job, identity: dict[str, Any]) -> Job | None:
    """Return the job with the chunks of its store; None if the name is free.

    Raises ValueError if the store holds another run, or none, and FileExistsError for what is no
    Zarr store.
    """
    group, store = _group(job.store), job.store
    if group is None:
        if stranger := _stranger(store):
            message = f"expected the name of a Zarr store to write, got {stranger}"
            raise OSError(errno.EEXIST, message, store)
        return None
    notes = _notes(group, store)
    require_same(identity, json.loads(notes["run"]), store)
    stored = int(group.attrs["steps"])
    if stored > job.steps:
        raise ValueError(
            f"steps: expected at least the {stored} of the run in {store}, got {job.steps}"
        )
    return replace(job, tile=tuple(notes["tile"]), rows=int(notes["rows"]))


def create(job: Job, identity: dict[str, Any], dataset: Any) -> None:
    """Create a store, which counts as one once the last step is done."""
    import zarr

    begun = _root(job.store) is not None  # by a process that was killed
    zarr.create_group(job.store, overwrite=begun, zarr_format=3, attributes={_CREATING: True})
    _write(job, dataset.assign_attrs({_CREATING: True}))
    notes = {
        "variables": sorted(map(str, dataset.variables)),
        "known": ["eps", "component", *job.parameters],
        "layout": _LAYOUT,
        "run": json.dumps(identity),
        "tile": list(job.tile),
        "rows": job.rows,
    }
    root = _root(job.store, "r+")
    root.create_group(PROGRESS, attributes=notes)
    _make_room(job, root)
    del root.attrs[_CREATING]
    _consolidate(job.store)


def lengthen(job: Job, dataset: Any, verify: bool) -> None:
    """Make room for the states of a longer run, which a process may have begun before.

    With `verify` the known variables of the dataset are written again, and arrays that are lost are
    created.
    """
    group = _group(job.store, "r+")
    consolidated = _group(job.store, consolidated=None).metadata.consolidated_metadata
    if int(group.attrs["steps"]) == job.steps and consolidated is not None and not verify:
        return
    rows = len(job.numbers)
    for name in ("omega", "attitude", "n"):
        array = _array(group, name)
        if array is not None and array.shape[0] != rows:
            array.resize((rows, *array.shape[1:]))
    attributes = dict(group.attrs)
    if verify:
        lazy = [name for name, each in dataset.variables.items() if each.chunks is not None]
        whole = [name for name in lazy if _fits(group, name, dataset[name].shape)]
        _write(job, dataset.drop_vars(whole))
        group = _group(job.store, "r+")
        _make_room(job, group)
    elif job.keeps_states:
        group["n"][:] = job.numbers
    # Coordinates of the user that are not given now stay.
    group.attrs.put({**group.attrs, **attributes, "steps": job.steps})
    _consolidate(job.store)


def _array(group: Any, name: str) -> Any:
    """Return an array; None if its metadata are lost or damaged."""
    try:
        return group[name]
    except (KeyError, ValueError, TypeError, AttributeError):
        return None


def _fits(group: Any, name: str, shape: tuple[int, ...]) -> bool:
    return getattr(_array(group, name), "shape", None) == shape


def _write(job: Job, dataset: Any) -> None:
    """Write the known variables of a dataset, and create arrays for the others, which are lazy.

    Each chunk has a checksum, which Zarr verifies when it reads.
    """
    from zarr.codecs import BloscCodec, Crc32cCodec

    group = _group(job.store, "r+")
    lengths = {"n": job.rows, **dict(zip(job.dims, job.tile, strict=True))}
    encoding: dict[Any, Any] = {}
    for name, variable in dataset.variables.items():
        if group is not None:
            if _fits(group, name, variable.shape):
                continue
            del group[name]
        codecs: list[Any] = [Crc32cCodec()]
        if job.compression is not None and variable.dtype.kind in "iuf":
            codecs.insert(0, BloscCodec(cname=job.compression, clevel=1, shuffle="shuffle"))
        sizes = lengths if variable.chunks is not None else {}
        encoding[name] = {
            "compressors": tuple(codecs),
            "chunks": tuple(max(1, sizes.get(dim, n)) for dim, n in variable.sizes.items()),
        }
        if variable.dtype.kind == "f":
            encoding[name] |= {"fill_value": np.nan, "_FillValue": None}
        elif name in _PENDING:
            encoding[name]["fill_value"] = _PENDING[name]
    dataset.to_zarr(
        job.store,
        mode="a",
        compute=False,
        consolidated=False,
        encoding=encoding,
        safe_chunks=False,
        write_empty_chunks=True,
        zarr_format=3,
    )


def _lazy(shape: tuple[int, ...], dtype: str = "f8") -> Any:
    from dask.array import zeros

    return zeros(shape, dtype=dtype, chunks=shape)


def dataset_of(job: Job, coords: Mapping[Any, Any] | None) -> Any:
    """Return the dataset of a run, with lazy zeros for what is to be computed."""
    batch, D = job.batch, job.body.dimension
    entries: dict[str, Any] = {
        **header_of(job.map, job.method, job.steps, job.save_every),
        "n": np.zeros(1, np.int64),
        "eps": job.eps,
        **job.parameters,
        "omega": _lazy((1, *batch, D)),
        "final": _lazy((*batch, D)),
        "status": _lazy(batch, "i1"),
        "failed_at": _lazy(batch, "i8"),
    }
    if job.orientation is not None:
        entries["attitude"] = _lazy((1, *batch, D + 1, D + 1))
    dataset = labelled.dataset_of(entries, job.dims, coords)
    # One row stands for all so far: times of all would be as many as states.
    rows = {name: dataset[name].variable for name in ("omega", "attitude") if name in dataset}
    number = dataset["n"].attrs
    dataset = dataset.drop_vars([*rows, "n", "time"])
    if job.keeps_states:
        dataset = dataset.assign_coords(n=("n", job.numbers, number))
        for name, row in rows.items():
            dataset[name] = (row.dims, _lazy((len(job.numbers), *row.shape[1:])), row.attrs)
    for name in job.reductions:
        meaning, *_, of_components = REDUCTIONS[name]
        own, tail = (("component",), (D,)) if of_components else ((), ())
        dataset[name] = ((*job.dims, *own), _lazy((*batch, *tail)), {"long_name": meaning})
    status = dataset["status"].attrs
    status["flag_values"] = np.append(status["flag_values"], np.int8(NOT_COMPUTED))
    status["flag_meanings"] += " PENDING"
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "U":  # Zarr 3 has strings of any length only
            dataset[name] = variable.astype(object)
    return dataset


def _make_room(job: Job, group: Any) -> None:
    """Create the arrays of what is needed to go on, if they are not there."""
    from zarr.codecs import Crc32cCodec

    size, axes = job.record.itemsize, len(job.batch)
    for name, shape, chunks, dtype, fill_value in (
        (MARKS, job.grid, (1,) * axes, "int64", -1),
        (RECORDS, (*job.batch, size), (*job.tile, size), "uint8", 255),
    ):
        if not _fits(group, name, shape):
            group.create_array(
                name,
                shape=shape,
                chunks=chunks,
                dtype=dtype,
                fill_value=fill_value,
                compressors=[Crc32cCodec()],
                overwrite=True,
            )


def _consolidate(store: Any) -> None:
    import zarr

    with warnings.catch_warnings():
        # An extension of the format, which readers that do not know it ignore.
        warnings.simplefilter("ignore", UserWarning)
        zarr.consolidate_metadata(store, zarr_format=3)


def open_arrays(store: Any) -> Arrays:
    """Return the arrays of a store by name, to be written to."""
    group = _group(store, "r+")
    members = {**dict(group.arrays()), MARKS: group[MARKS], RECORDS: group[RECORDS]}
    # Chunks of NaN are written like others: looking for them takes longer.
    return {name: each.with_config({"write_empty_chunks": True}) for name, each in members.items()}


def withdraw(job: Job, arrays: Arrays, index: Index, whole: bool = False) -> None:
    """Remove the last states of a tile, or with `whole` all that it has, its mark first."""
    where = job.where(index)
    parts = dict.fromkeys(("final", "status", "failed_at", *job.reductions), where)
    if whole:
        arrays[MARKS][index] = -1
        parts[RECORDS] = where
    if whole or job.save_every is None:
        parts |= dict.fromkeys({"omega", "attitude"} & set(arrays), (slice(None), *where))
    for name, part in parts.items():
        # A chunk of nothing but the fill value is removed.
        array = arrays[name].with_config({"write_empty_chunks": False})
        array[part] = array.fill_value


def open_dataset(store: Any) -> Any:
    """Return the dataset of a store, lazy."""
    import xarray

    group = _group(store)
    if group is None:
        if _stranger(store):
            raise ValueError(f"store: expected one that ensemble made, got another: {store}")
        raise FileNotFoundError(f"store: expected one that ensemble made, got nothing at {store}")
    notes = _notes(group, store)
    with advice(store):
        refuse_code(store)
        missing = [name for name in notes["variables"] if name not in group]
        if missing:
            raise ValueError(f"{', '.join(missing)} missing")
        options: dict[str, Any] = {"zarr_format": 3, "chunks": {}, "drop_variables": ["n"]}
        try:
            dataset = xarray.open_zarr(store, consolidated=False, **options)
        except ValueError:  # some arrays are longer already, in a run that is being lengthened
            group = _group(store, consolidated=None)
            if group.metadata.consolidated_metadata is None:
                raise
            dataset = xarray.open_zarr(store, consolidated=True, **options)
        done = np.asarray(group[MARKS][...])
        for name in notes["known"]:
            values = dataset[name].load().values
            if (values == "" if values.dtype.kind in "OT" else values != values).any():
                raise ValueError(f"a chunk of {name} is missing")
    steps, every = int(dataset.attrs["steps"]), dataset.attrs.get("save_every")
    dataset.attrs["tiles_done"] = f"{int((done == steps).sum())} of {done.size}"
    if "n" in dataset.dims:
        numbers = numbers_of_saved(steps, every)
        dataset = dataset.isel(n=slice(0, len(numbers)))
        dataset = dataset.assign_coords(n=("n", numbers, dict(group["n"].attrs)))
        with np.errstate(over="ignore"):
            times = (dataset["n"] * dataset["eps"]).assign_attrs(long_name="time")
        dataset = dataset.assign_coords(time=times)
    return dataset


def refuse_code(store: Any) -> None:
    """Raise a ValueError if decoding an array of a store could run code."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that are no part of Zarr 3
        refuse_codecs(store)


@contextmanager
def advice(store: Any) -> Iterator[None]:
    """Say how damage that an error is about is mended."""
    try:
        yield
    except (ValueError, RuntimeError, KeyError) as error:
        raise ValueError(
            f"store: expected an undamaged one, got {store}: {error}; "
            "ensemble with verify=True mends it"
        ) from error
