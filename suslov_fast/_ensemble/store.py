"""Creation, extension, repair and opening of the Zarr store of a run.

The root group holds the results, with the names and attributes of `Trajectories.to_xarray`. The
group "progress" holds the data for resumption; its attributes describe the run:

    steps_done    for each tile the number of steps of the run for which it was finished, or -1
    record        for each trajectory the data from which the next piece starts, as `Job.record`

An absent chunk reads as not computed: NaN, or the status PENDING. Each chunk has a checksum,
which Zarr verifies when it reads. All metadata are read from their copy in the root group
("consolidated"), which is written last, as one object: while a run is extended, readers see either
all old or all new shapes. The files of the members serve repairs and other programs.
"""

from __future__ import annotations

import errno
import math
import os
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from typing import Any

import numpy as np

from .._checks import wrong
from .._engine.memory import require
from .._kernels.codes import NOT_COMPUTED
from .._maps import map_named
from .._runs import labelled
from .._runs.schema import header_of, schema_of
from .job import Job, require_same
from .reductions import reductions_of

PROGRESS = "progress"
MARKS, RECORDS = f"{PROGRESS}/steps_done", f"{PROGRESS}/record"
# Version of this format.
_LAYOUT = 5
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

# What a name may be to create or to complete a store.
_NEW = "a new name or a store written by ensemble"

# Number of tiles whose marks share a chunk, which is rewritten for each, and of steps in one of n.
_TOGETHER = 4096

Arrays = dict[str, Any]


def resolved(store: Any) -> Any:
    """Return a store that other processes can open: folders and their URLs as absolute paths."""
    if store is None or isinstance(store, (int, float, bytes)):
        raise wrong("store", "the name of a folder, a URL or a Zarr store", repr(store), TypeError)
    labelled.import_xarray("dask.array", "filelock", "zarr", extra="large")
    if isinstance(store, str) and store.startswith(("file:", "local:")):
        from fsspec.core import url_to_fs

        store = url_to_fs(store)[1]
    return os.path.abspath(os.fspath(store)) if _is_folder(store) else store


def _is_folder(store: Any) -> bool:
    return isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store)


@contextmanager
def only_writer(store: Any) -> Iterator[None]:
    """Lock a folder against other writers, under any of its names; other stores are not locked."""
    if not _is_folder(store):
        yield
        return
    from filelock import FileLock, Timeout

    name = f"{os.path.realpath(store)}.lock"
    try:
        locked: Any = FileLock(name).acquire(blocking=False)
    except Timeout:
        message = "expected a store without another writer, got one in use"
        raise BlockingIOError(errno.EAGAIN, message, store) from None
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EROFS) or not os.path.isdir(store):
            raise
        locked = nullcontext()  # a finished store can be opened; nothing else can be written
    with locked:
        try:
            yield
        finally:
            with suppress(OSError):  # Windows removes it later, a read-only folder has none
                os.unlink(name)


def _group(store: Any, path: str = "", copies: bool = False, mode: Any = "r") -> Any:
    """Open a group, with `copies` by the metadata in the root; None if it cannot be read."""
    import zarr

    options = {"mode": mode, "zarr_format": 3, "use_consolidated": copies}
    try:
        if copies:
            root = zarr.open_group(store, **options)
            return root[path] if path else root
        return zarr.open_group(store, path=path, **options)
    except (FileNotFoundError, NotADirectoryError, *_DAMAGE):
        return None


def _notes(store: Any, copies: bool) -> dict[str, Any]:
    """Return the description of the run in the group "progress"; empty if damaged or absent."""
    group = _group(store, PROGRESS, copies)
    attributes = {} if group is None else dict(group.attrs)
    return attributes if attributes.get("layout") == _LAYOUT else {}


def _is_free(store: Any) -> bool:
    """Return True if a store can be created in a place without metadata."""
    if not _is_folder(store) or not os.path.lexists(store):
        return True
    return os.path.isdir(store) and all(name.endswith(".partial") for name in os.listdir(store))


def _described(store: Any, expected: str) -> dict[str, Any]:
    """Return the description of the run in a store; empty if there is none, or one just begun.

    A ValueError says what was `expected` if something else is there.
    """
    root, progress = _group(store), _group(store, PROGRESS)
    about, stored = ({} if each is None else dict(each.attrs) for each in (root, progress))
    if about == _UNFINISHED or (root is progress is None and _is_free(store)):
        return {}
    if notes := _notes(store, copies=True) or _notes(store, copies=False):
        return notes
    received = f"other data in {store}"
    if "run" in stored:
        of = about.get("source", f"suslov_fast {about.get('version', 'unknown')}")
        received = f"format {stored.get('layout', 1)} of {of}: compute {store} anew"
    raise wrong("store", f"{expected}, in format {_LAYOUT}", received)


def _checked_root(store: Any) -> Any:
    """Return the root group of a store; ValueError if it or one of the parameters is damaged."""
    root, notes = _group(store, copies=True), _notes(store, copies=True)
    if not notes or dict(root.attrs) != {**notes["attributes"], "steps": notes["steps"]}:
        raise ValueError("zarr.json is damaged or missing")
    needed = {"eps", "n", "component", *map_named(notes["attributes"]["map"]).body._names()}
    for name in notes["known"]:
        values = root[name][...]  # raises an error if its checksum differs
        if name in needed and ((values == root[name].fill_value) | (values != values)).any():
            raise ValueError(f"a chunk of {name} is missing")
    return root


def stored_dims(store: Any) -> Any:
    """Return the names of the axes of the batch in a store; None if there is none."""
    return _described(store, _NEW).get("run", {}).get("dims")


def prepare(job: Job, identity: dict[str, Any], dataset: Any, verify: bool) -> Job:
    """Create, extend or repair the store of a run; return the job with the chunks of the store.

    Raises ValueError if the store holds another run, is damaged, or is no store of a run. The next
    call completes the work of a process killed here.
    """
    import zarr

    store = job.store
    notes = _described(store, _NEW)
    if not notes:
        notes = {"layout": _LAYOUT, "run": identity, "known": [], "tile": list(job.tile)}
        notes |= {"rows": job.rows, "compression": job.compression}
        require_space(job, dataset)
        require(64 * math.prod(job.grid), "divide the batch, or raise chunk")
        made = _made_in_memory(job, dataset, notes)  # may raise an error, before a file is written
        options = {"zarr_format": 3, "use_consolidated": False, "attributes": _UNFINISHED}
        group = zarr.open_group(store, mode="a", **options)
        for name in list(group):
            del group[name]
        _write_metadata(job, made)
        return job
    require_same(identity, notes["run"], store)
    if "body" in notes["attributes"]:  # with the names of parameters that it has
        dataset.attrs["body"] = notes["attributes"]["body"]
    if notes["steps"] > job.steps:
        raise wrong("steps", f"at least the {notes['steps']} of the run in {store}", job.steps)
    tile, rows, compression = tuple(notes["tile"]), notes["rows"], notes["compression"]
    job = replace(job, tile=tile, rows=rows, compression=compression)
    if not verify:
        with advice(store):
            _checked_root(store)
        require_space(job, dataset)
    if verify or notes["steps"] < job.steps:
        dataset = _with_stored_coordinates(job, dataset, notes)
        _write_metadata(job, _made_in_memory(job, dataset, notes))
    return job


def _with_stored_coordinates(job: Job, dataset: Any, notes: dict[str, Any]) -> Any:
    """Return the dataset with the coordinates in the store that this call does not repeat."""
    root = _group(job.store, copies=True)
    for name in sorted(set(notes["known"]) - set(dataset.variables)):
        try:
            values, metadata = root[name][...], root[name].metadata
        except _DAMAGE as error:
            raise wrong("coords", f"{name}, which {job.store} has lost", "none") from error
        variable = metadata.dimension_names or (), values, metadata.attributes
        dataset = dataset.assign_coords({name: variable})
    return dataset


def _write_metadata(job: Job, made: Any) -> None:
    """Write all metadata, and all values that are not computed; chunks of results remain.

    All was made in memory, since Zarr removes the chunks of an array that it creates.
    """
    import zarr

    groups = (_group(job.store, path, mode="r+") for path in ("", PROGRESS))
    group = next(each for each in groups if each is not None)
    place = zarr.storage.StorePath(group.store, group.path.removesuffix(PROGRESS))
    nodes = list(made.members(max_depth=None))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # an extension of Zarr's format
        nodes.append(("", zarr.consolidate_metadata(made.store, zarr_format=3)))
    known = made[PROGRESS].attrs["known"]
    for name, node in nodes:
        if isinstance(node, zarr.Group):
            zarr.Group(zarr.AsyncGroup(node.metadata, place / name)).update_attributes({})
        else:
            array = zarr.Array(zarr.AsyncArray(node.metadata, place / name))
            array.update_attributes({})
            if name in known:
                array[...] = node[...]


def _made_in_memory(job: Job, dataset: Any, notes: dict[str, Any]) -> Any:
    """Return a group in memory, with all metadata and the values that are not computed."""
    import zarr
    from zarr.codecs import BloscCodec, Crc32cCodec

    checksum: list[Any] = [Crc32cCodec()]
    packed = list(checksum)
    if job.compression:
        packed.insert(0, BloscCodec(cname=job.compression, clevel=1, shuffle="shuffle"))
    lengths = {"n": job.rows, **dict(zip(job.dims, job.tile, strict=True))}
    computed = [*job.states, *job.results]
    encoding: dict[Any, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        options = encoding[name] = {"compressors": packed if name in computed else checksum}
        if variable.dtype.kind == "f":  # an absent chunk is recognised by its NaN
            options |= {"fill_value": np.nan, "_FillValue": None}
        elif name in computed:
            options["fill_value"] = NOT_COMPUTED
        if name in computed:
            sizes = variable.sizes.items()
            options["chunks"] = tuple(lengths.get(dim, length) for dim, length in sizes)
        elif name == "n":  # the same chunks for any number of steps
            options |= {"chunks": (_TOGETHER,), "fill_value": -1}
    store = zarr.storage.MemoryStore()
    try:
        dataset.to_zarr(store, compute=False, consolidated=False, encoding=encoding, zarr_format=3)
    except _DAMAGE as error:
        raise wrong("coords", "values that Zarr can store", error) from error
    group = zarr.open_group(store, mode="r+", use_consolidated=False)
    attributes = {name: value for name, value in group.attrs.items() if name != "steps"}
    known = sorted(set(map(str, dataset.variables)) - set(computed))
    notes = {**notes, "attributes": attributes, "known": known, "steps": job.steps}
    group.create_group(PROGRESS, attributes=notes)
    size, tiles = job.record.itemsize, math.prod(job.grid)
    for name, shape, chunks, dtype, fill in (
        (MARKS, (tiles,), (_TOGETHER,), "int64", -1),
        (RECORDS, (*job.batch, size), (*job.tile, size), "uint8", 255),
    ):
        group.create_array(
            name, shape=shape, chunks=chunks, dtype=dtype, fill_value=fill, compressors=checksum
        )
    return group


def check_names(argument: str, job: Job, names: Iterable[Any]) -> None:
    """Raise ValueError for names of axes or coordinates that cannot be those of arrays."""
    taken = {PROGRESS, *reductions_of(job.map), *job.monitors, "", ".", "..", "zarr.json"}
    for name in names:
        fits = isinstance(name, str) and name.isprintable() and len(name.encode()) < 256
        if not fits or name in taken or "/" in name or name.startswith("__"):
            expected = "names without '/', and not those of files, groups and reductions in a store"
            raise wrong(argument, expected, repr(name))


def require_space(job: Job, dataset: Any) -> None:
    """Raise OSError if the disk of a folder has no space for the arrays that it lacks."""
    if not _is_folder(job.store):
        return
    folder = os.path.realpath(job.store)
    while not os.path.exists(folder):
        folder = os.path.dirname(folder)
    free = shutil.disk_usage(folder).free
    sizes = {name: dataset[name].nbytes for name in (*job.states, *job.results)}
    sizes[RECORDS] = job.record.itemsize * math.prod(job.batch)
    needed = sum(sizes.values())
    if needed <= free:
        return
    # What is there needs no space; the chunks of an array are about alike.
    for name, size in sizes.items():
        chunks = math.prod(job.grid) * (-(-job.saved // job.rows) if name in job.states else 1)
        found = sum(len(files) for *_, files in os.walk(os.path.join(job.store, name, "c")))
        needed -= size * min(found, chunks) // chunks
    if needed > free:
        raise OSError(
            errno.ENOSPC,
            f"expected a disk with space for the run, of which {free:,} bytes are free, got "
            f"{needed:,} bytes to store; raise save_every or divide the batch",
            os.fspath(job.store),
        )


def lazy_dataset(job: Job, coords: Mapping[Any, Any] | None) -> Any:
    """Return the dataset of a run, with placeholders without memory for results."""
    from dask.array import zeros

    batch, D = job.batch, job.body.dimension
    entries = header_of(job.body, job.map, job.method, job.steps, job.save_every)
    entries |= {"eps": job.eps, **job.body._arrays, **job.body._coordinates}
    if job.keeps_states:
        entries["n"] = job.numbers
    sizes = {"n": len(job.numbers), "component": D, "space": D + 1, "body": D + 1}
    for name, entry in schema_of(job.map).items():
        if name in (*job.states, *job.results):
            entries[name] = zeros(entry.axes(batch, sizes), dtype=entry.dtype, chunks=-1)
    dataset = labelled.dataset_of(job.body, entries, job.dims, coords)
    check_names("coords", job, dataset.coords)
    dataset = dataset.assign_coords({name: each.load() for name, each in dataset.coords.items()})
    for name in job.monitors:
        nothing = zeros((len(job.numbers), *batch), chunks=-1)
        dataset[name] = (("n", *job.dims), nothing, {"long_name": name})
    for name in job.reductions:
        meaning, *_, of_components = reductions_of(job.map)[name]
        own = {"component": D} if of_components else {}
        nothing = zeros((*batch, *own.values()), chunks=-1)
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
    group = _group(job.store, copies=True, mode="r+")
    return {name: group[name] for name in (MARKS, RECORDS, *job.states, *job.results)}


def withdraw(job: Job, arrays: Arrays, tile: int, all_data: bool) -> None:
    """Remove the data of a tile that are written with its last step, or all its data."""
    where = job.where(tile)
    parts = dict.fromkeys(job.results, where)
    if all_data:
        parts[RECORDS] = where
    if all_data or job.save_every is None:
        parts |= {name: (slice(None), *where) for name in job.states}
    for name, part in parts.items():
        # A chunk that holds only the fill value is removed.
        arrays[name][part] = arrays[name].fill_value


def open_dataset(store: Any, with_dask: bool = True) -> Any:
    """Return the dataset of a store, lazy."""
    import xarray

    expected = "a store written by ensemble"
    if not _described(store, expected):
        raise wrong("store", expected, f"none at {store}", FileNotFoundError)
    with advice(store), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that are no part of the format
        done = np.asarray(_checked_root(store)[MARKS][...])
        # The copies agree with each other while the arrays are extended.
        options: dict[str, Any] = {"consolidated": True, "zarr_format": 3}
        dataset = xarray.open_zarr(store, chunks={} if with_dask else None, **options)
    finished = np.count_nonzero(done == dataset.attrs["steps"])
    dataset.attrs["tiles_done"] = f"{finished} of {done.size}"
    return labelled.with_time(dataset) if "n" in dataset.dims else dataset


@contextmanager
def advice(store: Any) -> Iterator[None]:
    """Add to an error about damaged data how to repair them."""
    try:
        yield
    except _DAMAGE as error:
        received = f"{store}: {error}; ensemble with verify=True repairs it"
        raise wrong("store", "an undamaged store", received) from error
