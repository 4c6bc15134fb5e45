"""The Zarr store of a run: created, lengthened, verified, opened.

Results lie in the root group, under the names and with the attributes of `Trajectories.to_xarray`.
What is needed to go on lies in the group "progress":

    steps_done    the mark of a tile: number of its steps that are stored; -1 before state 0 is
    record        for each trajectory what the next piece starts from, see `compute`

The root group holds a copy of the metadata of all arrays ("consolidated"), which is one object:
readers see the arrays of a run that is being lengthened either all short or all long.
"""

from __future__ import annotations

import errno
import json
import os
import warnings
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from .._core.codes import NOT_COMPUTED
from .._runs import labelled
from .._runs.schema import FORMAT
from .job import Job, parameters_of, require_same
from .plan import Plan, Slices
from .reductions import REDUCTIONS

PROGRESS = "progress"
STEPS_DONE, RECORD = f"{PROGRESS}/steps_done", f"{PROGRESS}/record"
# The arrangement of a store: 1 is that of version 0.2.
_LAYOUT = 2
_CREATING = "creating"
_TIMES = ("t", "time")

# Codecs that only move or compress bytes.
_CODECS = frozenset(
    "bytes vlen-utf8 string vlen-bytes transpose sharding_indexed crc32c blosc gzip zstd lz4 zlib "
    "bz2 lzma shuffle adler32 crc32 fletcher32".split()
)


def resolved(store: Any) -> Any:
    """Return a store that other processes find: a folder, or its URL, as an absolute path."""
    if isinstance(store, str) and store.startswith(("file:", "local:")):
        from fsspec.core import url_to_fs

        store = url_to_fs(store)[1]
    if isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store):
        try:
            return os.path.abspath(os.fspath(store))
        except OSError as error:  # the working directory was deleted
            message = f"expected a name in a folder that can be written to, got: {error.strerror}"
            raise OSError(error.errno, message, os.fspath(store)) from error
    return store


def is_folder(store: Any) -> bool:
    """Return True if a resolved store is a folder of the file system."""
    return isinstance(store, str) and "://" not in store


def exists(store: Any) -> bool:
    """Return True for a store of `ensemble`, False for a name that is free.

    Raises FileExistsError for a file and for another folder, ValueError for another Zarr store.
    """
    group = _group(store)
    if group is None:
        if is_folder(store) and os.path.lexists(store):
            if not os.path.isdir(store):
                raise _occupied(store, "a file")
            if any(not name.endswith(".partial") for name in os.listdir(store)):
                raise _occupied(store, "another folder")
        return False
    if _CREATING in group.attrs:
        return False  # the process that was creating it was killed
    _notes(group, store)
    return True


def _occupied(store: str, received: str) -> OSError:
    return OSError(
        errno.EEXIST, f"expected the name of a Zarr store to write, got {received}", store
    )


def _group(store: Any, mode: Any = "r", consolidated: bool | None = False) -> Any:
    """Open the root group, or return None if there is none."""
    import zarr

    if is_folder(store) and not os.path.isdir(store):
        return None
    try:
        return zarr.open_group(store, mode=mode, zarr_format=3, use_consolidated=consolidated)
    except FileNotFoundError:
        return None


def _notes(group: Any, store: Any) -> dict[str, Any]:
    """Return what a store says of its run; ValueError if it is not of this version."""
    notes = dict(group[PROGRESS].attrs) if PROGRESS in group else {}
    if notes.get("layout") == _LAYOUT:
        return notes
    received = "another"
    if "run" in notes:
        received = f"one that was written by {group.attrs.get('source', 'another version')}"
    raise ValueError(
        "store: expected a new name or a store that ensemble of this version made, "
        f"got {received}: {store}"
    )


class Arrays:
    """The arrays of a store by name, to be written to."""

    def __init__(self, store: Any) -> None:
        self.store = store
        self.group = _group(store, "r+")
        self._opened: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._opened:
            # Chunks of NaN are written like others: looking for them takes longer.
            array = self.group[name].with_config({"write_empty_chunks": True})
            self._opened[name] = array
        return self._opened[name]

    def __contains__(self, name: str) -> bool:
        return name in self._opened or name in self.group

    @property
    def steps(self) -> int:
        """Number of steps of the run."""
        return int(self.group.attrs["steps"])

    def clear(self, name: str, where: Slices) -> None:
        """Remove values, so that they read as not computed."""
        array = self.group[name].with_config({"write_empty_chunks": False})
        array[where] = array.fill_value

    def marks(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Return the marks of all tiles."""
        return np.asarray(self[STEPS_DONE][...])


def place_of(index: tuple[int, ...]) -> Slices:
    """Return the place of a tile in the grid of tiles."""
    return tuple(slice(k, k + 1) for k in index)


class _Result(NamedTuple):
    """An array to be filled with results."""

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    attributes: dict[str, Any]
    plain: bool = False  # never compressed

    @property
    def fill(self) -> Any:
        if self.name == STEPS_DONE or self.name == RECORD:
            return -1
        return np.nan if self.dtype == "f8" else NOT_COMPUTED


def _described(job: Job, coords: Mapping[Any, Any] | None) -> tuple[Any, list[_Result]]:
    """Return the dataset of all that is known before the run, and the arrays of the rest."""
    from .. import __version__

    batch, D = job.plan.batch, job.body.dimension
    kind = type(job.body).__name__

    def empty(lead: tuple[int, ...], tail: tuple[int, ...], dtype: str = "f8") -> Any:
        return np.broadcast_to(np.zeros((), dtype), (*lead, *batch, *tail))

    # One row stands for all: only names, dimensions and attributes are taken from it.
    entries: dict[str, Any] = {
        "format": np.array(FORMAT),
        "version": np.array(__version__),
        "body": np.array(kind),
        "method": np.array(job.method),
        "steps": np.array(job.steps),
        "omega": empty((1,), (D,)),
        "n": np.zeros(1, np.int64),
        "eps": job.eps,
        "status": empty((), (), "i1"),
        "failed_at": empty((), (), "i8"),
        "final": empty((), (D,)),
        **parameters_of(job.body),
    }
    if job.save_every is not None:
        entries["save_every"] = np.array(job.save_every)
    if job.orientation is not None:
        entries["attitude"] = empty((1,), (D + 1, D + 1))
    dataset = labelled.dataset_of(entries, job.dims, coords)
    dataset = dataset.drop_vars([name for name in _TIMES if name in dataset.variables])
    for name in job.reductions:
        own = ("component",) if REDUCTIONS[name].of_components else ()
        attributes = {"long_name": REDUCTIONS[name].meaning}
        dataset[name] = ((*job.dims, *own), empty((), (D,) if own else ()), attributes)
    status = dataset["status"].attrs
    status["flag_values"] = np.append(status["flag_values"], np.int8(NOT_COMPUTED))
    status["flag_meanings"] += " PENDING"

    results = ["omega", "attitude", "final", "status", "failed_at", *job.reductions]
    results = [name for name in results if name in dataset.variables]
    arrays = [_result(job, name, dataset[name]) for name in results]
    n = dataset["n"].attrs
    dataset = dataset.drop_vars([*results, "n"])
    if job.keeps_states:
        dataset = dataset.assign_coords(n=("n", job.numbers, n))
    else:
        arrays = [each for each in arrays if "n" not in each.dims]
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "U":  # Zarr 3 has strings of any length only
            dataset[name] = variable.astype(object)
    return dataset, [*arrays, *_progress(job)]


def _result(job: Job, name: str, variable: Any) -> _Result:
    sizes = {"n": len(job.numbers)}
    parts = {"n": job.plan.rows, **dict(zip(job.dims, job.plan.tile, strict=True))}
    shape = tuple(sizes.get(dim, variable.sizes[dim]) for dim in variable.dims)
    chunks = tuple(
        parts.get(dim, max(length, 1)) for dim, length in zip(variable.dims, shape, strict=True)
    )
    attributes = {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in variable.attrs.items()
    }
    return _Result(name, variable.dims, shape, chunks, variable.dtype.str[1:], attributes)


def _progress(job: Job) -> Iterator[_Result]:
    from .compute import record_size

    size, grid = record_size(job), job.plan.grid
    axes = tuple(f"tile_{k}" for k in range(len(grid)))
    yield _Result(STEPS_DONE, axes, grid, (1,) * len(grid), "i8", {}, plain=True)
    yield _Result(
        RECORD,
        (*job.dims, "word"),
        (*job.plan.batch, size),
        (*job.plan.tile, size),
        "i8",
        {},
        plain=True,
    )


def _make(job: Job, group: Any, result: _Result, overwrite: bool = False) -> None:
    """Create an array; each of its chunks has a checksum, which Zarr verifies when it reads."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    codecs: list[Any] = [Crc32cCodec()]
    if job.compression is not None and not result.plain:
        typesize = int(result.dtype[1:])
        blosc = BloscCodec(cname=job.compression, clevel=1, shuffle="shuffle", typesize=typesize)
        codecs.insert(0, blosc)
    group.create_array(
        result.name,
        shape=result.shape,
        chunks=result.chunks,
        dtype=result.dtype,
        fill_value=result.fill,
        compressors=codecs,
        dimension_names=result.dims,
        attributes=result.attributes,
        overwrite=overwrite,
    )


def _write_known(dataset: Any, store: Any, existing: Any) -> None:
    """Write the variables of a dataset, each chunk with a checksum."""
    from zarr.codecs import Crc32cCodec

    encoding: dict[Any, Any] = {}
    for name in set(dataset.variables) - set(existing):
        variable = dataset[name]
        encoding[name] = {"compressors": (Crc32cCodec(),)}
        if variable.dtype.kind == "f":
            encoding[name] |= {"fill_value": np.nan, "_FillValue": None}
        if variable.ndim:
            encoding[name]["chunks"] = tuple(max(1, length) for length in variable.shape)
    dataset.to_zarr(store, mode="a", consolidated=False, encoding=encoding, write_empty_chunks=True)


def create(job: Job, identity: dict[str, Any], coords: Mapping[Any, Any] | None) -> None:
    """Create the arrays of a store; it is one once the last step is done."""
    import zarr

    dataset, results = _described(job, coords)
    begun = _group(job.store) is not None
    group = zarr.create_group(
        job.store, overwrite=begun, zarr_format=3, attributes={_CREATING: True}
    )
    _write_known(dataset.assign_attrs({_CREATING: True}), job.store, ())
    notes: dict[str, Any] = {
        "layout": _LAYOUT,
        "run": json.dumps(identity),
        "tile": list(job.plan.tile),
        "rows": job.plan.rows,
        "variables": [*dataset.variables, *(each.name for each in results)],
    }
    group.create_group(PROGRESS, attributes=notes)
    for result in results:
        _make(job, group, result)
    del _group(job.store, "r+").attrs[_CREATING]
    _consolidate(job.store)


def _consolidate(store: Any) -> None:
    import zarr

    with warnings.catch_warnings():
        # An extension of the format, which readers that do not know it ignore.
        warnings.simplefilter("ignore", UserWarning)
        zarr.consolidate_metadata(store, zarr_format=3)


def recognised(job: Job, identity: dict[str, Any]) -> Job:
    """Return the job with the chunks of its store, which must hold the same run."""
    from dataclasses import replace

    group = _group(job.store)
    notes = _notes(group, job.store)
    require_same(identity, json.loads(notes["run"]), job.store)
    stored = int(group.attrs["steps"])
    if stored > job.steps:
        raise ValueError(
            f"steps: expected at least the {stored} of the run in {job.store}, got {job.steps}"
        )
    return replace(job, plan=Plan(job.plan.batch, tuple(notes["tile"]), int(notes["rows"])))


def lengthen(job: Job, arrays: Arrays) -> None:
    """Make room for the states of a longer run; a process that was killed here is no obstacle."""
    group = arrays.group
    consolidated = _group(job.store, consolidated=None).metadata.consolidated_metadata
    if arrays.steps == job.steps and consolidated is not None:
        return
    if job.keeps_states:
        rows = len(job.numbers)
        for name in ("omega", "attitude", "n"):
            if name in group and group[name].shape[0] != rows:
                group[name].resize((rows, *group[name].shape[1:]))
        group["n"][:] = job.numbers
    group.attrs["steps"] = job.steps
    _consolidate(job.store)


def withdraw(job: Job, arrays: Arrays, index: tuple[int, ...], whole: bool = False) -> None:
    """Remove the last states of a tile, or the whole of it, with its mark."""
    where, every_row = job.plan.where(index), slice(0, len(job.numbers))
    names = ["final", "status", "failed_at", *job.reductions]
    if whole:
        arrays[STEPS_DONE][place_of(index)] = np.full((1,) * len(index), -1)
        names.append(RECORD)
    if job.keeps_states and (whole or job.save_every is None):
        for name in ("omega", "attitude"):
            if name in arrays:
                arrays.clear(name, (every_row, *where))
    for name in names:
        arrays.clear(name, where)


def mend(job: Job, coords: Mapping[Any, Any] | None) -> None:
    """Write again all that is known without computing, and create arrays that are not there.

    `lengthen` has to follow.
    """
    dataset, results = _described(job, coords)
    group = _group(job.store, "r+")
    attributes = dict(group.attrs)
    existing = []
    for name, variable in dataset.variables.items():
        if _state_of(group, str(name), variable.dims, variable.shape) == "fits":
            existing.append(name)
        elif str(name) in group:
            del group[str(name)]
    if "n" in existing:  # `lengthen` writes it
        dataset = dataset.drop_vars("n")
    _write_known(dataset, job.store, existing)
    group = _group(job.store, "r+")
    group.attrs.put(attributes)
    for result in results:
        state = _state_of(group, result.name, result.dims, result.shape)
        if state != "fits":
            _make(job, group, result, overwrite=state == "damaged")


def _state_of(group: Any, name: str, dims: Any, shape: tuple[int, ...]) -> str:
    """Return "fits", "absent" or "damaged" for the metadata of an array."""
    axes = slice(1 if dims and dims[0] == "n" else 0, None)
    try:
        array = group[name]
        return "fits" if array.shape[axes] == shape[axes] else "damaged"
    except KeyError:
        return "absent"
    except (ValueError, TypeError, AttributeError):
        return "damaged"


def open_dataset(store: Any) -> Any:
    """Return the dataset of a store, lazy."""
    import xarray

    group = _group(store, consolidated=None)
    if group is None or _CREATING in group.attrs:
        if group is None and is_folder(store) and os.path.lexists(store):
            raise ValueError(f"store: expected one that ensemble made, got another: {store}")
        raise FileNotFoundError(f"store: expected one that ensemble made, got nothing at {store}")
    _require_harmless(group)
    notes = _notes(group, store)
    with advice(store):
        for name in notes["variables"]:
            array = group[name] if name in group else None
            if array is None or (_is_known(array) and array.nchunks_initialized < array.nchunks):
                raise ValueError(f"{name} is missing")
        consolidated = group.metadata.consolidated_metadata is not None
        dataset = xarray.open_zarr(
            store, consolidated=consolidated, zarr_format=3, chunks={}, drop_variables=["n"]
        )
        done = np.asarray(group[STEPS_DONE][...])
        steps, every = int(dataset.attrs["steps"]), dataset.attrs.get("save_every")
        dataset.attrs["tiles_done"] = f"{int((done == steps).sum())} of {done.size}"
        if "n" in dataset.dims:
            numbers = np.array([steps]) if every is None else np.arange(0, steps + 1, every)
            numbers = numbers[: dataset.sizes["n"]]
            dataset = dataset.assign_coords(n=("n", numbers, dict(group["n"].attrs)))
            eps = dataset["eps"] if dataset["eps"].ndim else dataset["eps"].load()
            with np.errstate(over="ignore"):
                times = (dataset["n"] * eps).assign_attrs(long_name="time")
            dataset = dataset.assign_coords(time=times)
    return dataset


def _is_known(array: Any) -> bool:
    """Return True for an array that was written as a whole when the store was created."""
    return array.basename not in (
        *("omega", "attitude", "final", "status", "failed_at", "steps_done", "record"),
        *REDUCTIONS,
    )


class advice:
    """Say how damage that an error is about is mended."""

    def __init__(self, store: Any) -> None:
        self.store = store

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, (ValueError, RuntimeError, KeyError)):
            raise ValueError(
                f"store: expected an undamaged one, got {self.store}: {error}; "
                "ensemble with verify=True mends it"
            ) from error


def _require_harmless(group: Any) -> None:
    """Refuse arrays whose decoding could run code, before anything is decoded."""
    for name, array in group.members(max_depth=None):
        if not hasattr(array, "dtype"):
            continue
        unknown = sorted(set(_codecs_of(array.metadata.to_dict().get("codecs", ()))) - _CODECS)
        if unknown or array.metadata.zarr_format != 3:
            raise ValueError(
                f"store: expected arrays of Zarr 3 with its standard codecs, got {name} with "
                f"{', '.join(unknown) or 'format 2'}"
            )


def _codecs_of(codecs: Any) -> Iterator[str]:
    for codec in codecs:
        yield str(codec["name"]).removeprefix("numcodecs.")
        settings = codec.get("configuration") or {}
        for inner in ("codecs", "index_codecs"):
            yield from _codecs_of(settings.get(inner, ()))
