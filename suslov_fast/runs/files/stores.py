"""Zarr stores of runs: how they are created, and which tiles they lack.

A tile is done once its `status` is written, after all else; until then it is PENDING. Every chunk
is written, even one of fill values only, so a chunk that does not exist was lost.
"""

from __future__ import annotations

import asyncio
import errno
import hashlib
import json
import math
import os
import shutil
import warnings
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np

from ... import checks
from ...checks import in_units, short, wrong
from ...core.motion.engine import Settings
from ...engine.random_starts import RandomStarts
from ...engine.status import PENDING
from ..columns import FORMAT, MOTION, RUN, OtherFormat

Tile = tuple[int, ...]  # position of a tile along each axis of the batch
MOST_CHUNKS, _MOST_COMPONENTS = 2**21, 2**20  # of a store, and of a state
_AT_A_TIME = 64  # simultaneous requests
_FILTERS = Lock()  # of warnings: all threads have the same
# Values that unwritten chunks show, by the name of a column; others are NaN.
_FILLS = {column.short: column.fill for column in (*RUN, *MOTION)}
# Attributes that only some runs have, and those that identify no run.
_OF_SOME = "map save_every attitude names H K changes definitions equations"
_OPTIONAL = *_OF_SOME.split(), *Settings._fields
_NOT_COMPARED = "version", "coordinates", "title", "tiled"
_OF_FILES = ".npz", ".nc", ".h5", ".hdf5", ".csv", ".zip"  # suffixes, which no store has


def resolved(store: Any) -> Any:
    """Return a store in a form that other processes can open: folders as absolute paths."""
    if isinstance(store, checks.extra("zarr.abc.store", "large").Store):
        return store
    folder = "the name of a folder, such as 'runs.zarr'"
    if not isinstance(store, (str, os.PathLike)):
        raise wrong("store", folder, short(store), TypeError)
    store = os.path.expanduser(store)
    if Path(store).suffix.lower() in _OF_FILES:
        raise wrong("store", folder, repr(store))
    if store.startswith("file://"):
        return Path(url2pathname(urlsplit(store).path)).absolute()
    return store if "://" in store else Path(store).absolute()


def group_of(store: Any, mode: Any = "r") -> Any:
    """Return the Zarr group of a store of this format; None if there is no store."""
    import zarr

    try:
        group = zarr.open_group(store, mode=mode, zarr_format=3)
    except FileNotFoundError:
        return None
    except (ValueError, LookupError, TypeError) as error:
        if "read-only" in str(error) or "read_only" in str(error):
            raise
        raise _foreign(store, f"damaged metadata: {error}") from error
    number, version = group.attrs.get("format"), group.attrs.get("version")
    if number != FORMAT and version:
        raise ValueError(f"store: {store} is {OtherFormat(number, version)}")
    if number != FORMAT:
        raise _foreign(store, "other data: pass a new name; xarray.open_zarr reads them")
    if _is_complete(group) and (what := _damage(group)):
        raise _foreign(store, f"damaged metadata: {what}")
    return group


def _damage(group: Any) -> str:
    """Return what is wrong with the arrays of a store, if anything, before chunks are sought."""
    arrays = dict(group.arrays())
    if absent := _names_in(group.attrs) - {*arrays}:
        return f"no {', '.join(sorted(absent))}"
    codecs = {type(c).__name__ for a in arrays.values() for c in (*a.filters, *a.compressors)}
    if others := codecs - {"Crc32cCodec"}:
        return f"codecs {', '.join(sorted(others))}"
    if (total := sum(math.prod(array.cdata_shape) for array in arrays.values())) > MOST_CHUNKS:
        return f"{total} chunks, more than {MOST_CHUNKS}"
    if (D := math.prod(arrays["component"].shape)) > _MOST_COMPONENTS:
        return f"{D} components, more than {_MOST_COMPONENTS}"
    return ""


def _names_in(attributes: Any) -> set[str]:
    """Return the names of the arrays of a run with these attributes."""
    tiled, labels = attributes.get("tiled", ["tiled"]), attributes.get("coordinates", "")
    return {
        *tiled,
        *labels.split(),
        "component",
        *(("n", "eps") if "map" in attributes else ("time",)),
    }


def _foreign(store: Any, data: str) -> Any:
    """Return the error of a store that holds other data."""
    return wrong("store", f"a store of ensemble in format {FORMAT}", f"{store} with {data}")


def _is_complete(group: Any) -> bool:
    """Return whether all arrays were created: then their metadata were consolidated."""
    return group is not None and group.metadata.consolidated_metadata is not None


def opened(store: Any) -> Any:
    """Return the lazy dataset of a store, or raise an error if chunks are missing."""
    import dask.array
    import xarray

    if not _is_complete(group := group_of(store)):
        raise FileNotFoundError(f"store: there is no store of ensemble at {store}")
    done, _ = tiles_in(store, group)  # first, because another process may finish a tile meanwhile
    _refuse(store, lost_tiles(store, group, done))
    data = xarray.open_zarr(store, chunks=None, consolidated=True, zarr_format=3)
    lazy = {
        name: data.variables[name].copy(
            data=dask.array.from_array(Stored(store, array), chunks="auto", name=False)
        )
        for name, array in group.arrays()
        if array.shape and name in group.attrs["tiled"]
    }
    return data.assign(lazy)


class Stored:
    """An array of a store, whose error on reading says what to delete."""

    def __init__(self, store: Any, array: Any) -> None:
        self._store, self._array = store, array
        self.shape, self.dtype, self.ndim = array.shape, array.dtype.newbyteorder("="), array.ndim
        self.chunks = array.chunks  # to which Dask aligns its own

    def __getitem__(self, index: Any) -> Any:
        try:
            values = np.asarray(self._array[index])
        except ValueError as error:  # of a checksum, or of a length
            raise _damaged(self._store, self._array.path, error) from error
        return values.astype(self.dtype, copy=False).view(self.dtype)  # in the order of the machine


def _damaged(store: Any, name: str, error: Exception) -> ValueError:
    what = "status/c" if name == "status" else f"the chunk, in {name}/c, and status/c"
    how = f"delete {what}, and call ensemble again, which computes the tiles anew"
    return ValueError(f"store: a chunk of {name} in {store} is damaged ({error}): {how}")


def tiles_in(store: Any, group: Any) -> tuple[list[Tile], list[Tile]]:
    """Return the tiles of a store that are done, and those that are not."""
    status = group["status"]
    try:
        values = np.asarray(status[...])
    except ValueError as error:
        raise _damaged(store, "status", error) from error
    done: list[Tile] = []
    pending: list[Tile] = []
    for tile in product(*map(range, status.cdata_shape)):
        is_done = (values[place_of(tile, values.shape, status.chunks)] != PENDING).all()
        (done if is_done else pending).append(tile)
    return done, pending


def _refuse(store: Any, lost: dict[str, Tile | None]) -> None:
    """Raise an error if chunks are lost, which says what to delete."""
    if not lost:
        return
    (key, tile), *_ = lost.items()
    how = "ensemble, called again, writes parameters and labels anew"
    if tile is not None:
        is_one = len({*lost.values()}) == 1
        what = "/".join(["status/c", *map(str, tile)]) if is_one else "status/c"
        how = f"delete {what} there, and ensemble, called again, computes its tiles anew"
    more = f" and {len(lost) - 1} more" * (len(lost) > 1)
    received = f"{store} without the chunk {key}{more}: {how}"
    raise wrong("store", "have whole chunks of all its tiles", received)


def place_of(tile: Tile, shape: tuple[int, ...], chunks: tuple[int, ...]) -> tuple[slice, ...]:
    """Return the slices of the batch that a tile covers."""
    axes = zip(tile, shape, chunks, strict=True)
    return tuple(slice(k * m, min(k * m + m, n)) for k, n, m in axes)


def lost_tiles(store: Any, group: Any, done: list[Tile]) -> dict[str, Tile | None]:
    """Return the keys of chunks that are not there, each with its tile if it has one."""
    expected: dict[str, Tile | None] = {}
    batch = group["status"].metadata.dimension_names or ()
    for name, array in group.arrays():
        counts, dims = array.cdata_shape, array.metadata.dimension_names or ()
        tiles: list[Tile | None] = [*done] if name in group.attrs["tiled"] else [None]
        for tile in tiles:
            at = {} if tile is None else dict(zip(batch, tile, strict=True))
            axes = ([at[d]] if d in at else range(n) for d, n in zip(dims, counts, strict=True))
            for index in product(*axes):
                expected[f"{name}/{array.metadata.encode_chunk_key(index)}"] = tile
    if isinstance(store, Path):
        missing = [key for key in expected if not os.path.exists(f"{store}/{key}")]
    else:
        missing = _absent(store, [*expected])
    return {key: expected[key] for key in missing}


def _absent(store: Any, keys: list[str]) -> list[str]:
    """Return the keys that a store does not have.

    It is asked in a thread, because a notebook has a loop of events of its own.
    """
    from zarr.storage import FsspecStore

    async def ask() -> list[str]:
        source = FsspecStore.from_url(store, read_only=True) if isinstance(store, str) else store
        if isinstance(source, FsspecStore):
            source.fs.invalidate_cache()  # cached listings lack chunks of other processes
        try:
            found = {key async for key in source.list_prefix("")}
        except Exception:  # of any class, because each kind of server has its own
            found = set()
        turn = asyncio.Semaphore(_AT_A_TIME)

        async def has(key: str) -> bool:
            async with turn:
                return bool(await source.exists(key))

        left = [key for key in keys if key not in found]
        there = await asyncio.gather(*map(has, left))
        return [key for key, is_there in zip(left, there, strict=True) if not is_there]

    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, ask()).result()


def prepare(store: Any, data: Any, sizes: dict[str, int]) -> tuple[Any, list[Tile]]:
    """Return the group of a run, created or found, and its tiles to compute.

    Raise an error if the store holds another run.
    """
    if not getattr(store, "supports_deletes", True):  # in a ZIP file no entry can be rewritten
        received = f"{type(store).__name__}: write into a folder, and open_ensemble reads a copy"
        raise wrong("store", "a store that is written in parts, in any order", received)
    group = group_of(store)
    if group is None:
        _check_new(store, data)
    else:
        _require_same(store, data, dict(group.attrs))
    if not _is_complete(group):
        is_new = group is None and isinstance(store, Path)
        (create_store if is_new else _fill)(store, data, sizes)
        group = group_of(store)
        _require_same(store, data, dict(group.attrs))  # another process may have begun another run
    done, pending = tiles_in(store, group)
    lost = lost_tiles(store, group, done)
    _write_shared(store, group, data, {key.partition("/")[0] for key in lost})
    _refuse(store, {key: tile for key, tile in lost.items() if tile is not None})
    return group, pending


def create_store(store: Path, data: Any, sizes: dict[str, int]) -> None:
    """Create the arrays of a run elsewhere, so that a folder appears as a whole."""
    target = Path(os.path.realpath(store))
    target.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(".partial", f"{target.name}.", target.parent) as folder:
        made = Path(folder) / "made"
        _fill(made, data, sizes)
        with suppress(OSError):
            target.rmdir()  # if it is empty
        try:
            made.rename(target)
        except OSError:
            if not (target / "zarr.json").exists():  # else another process made it
                raise


def _fill(target: Any, data: Any, sizes: dict[str, int]) -> None:
    """Create the arrays that are not there; those of states first, whose chunks tell the tiles."""
    import zarr
    from zarr.errors import ContainsArrayError

    labels = " ".join(str(name) for name in data.coords if name not in data.dims)
    attributes = {**data.attrs, "coordinates": labels}  # by which xarray knows coordinates
    group = zarr.open_group(target, mode="a", zarr_format=3, attributes=attributes)
    _require_same(target, data, dict(group.attrs))
    batch = data["status"].dims
    first = next(name for name in data if data[name].dims[1:] == (*batch, "component"))
    for name in (first, *(each for each in data.variables if each != first)):
        variable, is_tiled = data.variables[name], name in data.attrs["tiled"]
        lengths = {**data.sizes, **sizes} if is_tiled else data.sizes
        kind = variable.dtype.kind
        with suppress(ContainsArrayError):
            group.create_array(
                name,
                shape=variable.shape,
                dtype=str if kind in "OU" else variable.dtype,
                chunks=tuple(max(1, lengths[dim]) for dim in variable.dims),
                fill_value=_FILLS.get(str(name), math.nan if kind == "f" else None),
                compressors=zarr.codecs.Crc32cCodec(),
                dimension_names=variable.dims,
                attributes=variable.attrs,
            )
        if name == first:
            sizes = dict(zip(variable.dims, group[name].chunks, strict=True))
    _write_shared(target, group, data, {*map(str, data.variables)})
    with _FILTERS, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that consolidated metadata are not part of the format
        zarr.consolidate_metadata(target, zarr_format=3)


def _write_shared(store: Any, group: Any, data: Any, lost: set[str]) -> None:
    """Write the arrays that all tiles share where they are lost, or are not those of the run."""
    for name, variable in data.variables.items():
        if name in data.attrs["tiled"]:
            continue
        if name in lost or not _has_values(group[name], variable.values):
            array = group_of(store, "r+")[name] if group.read_only else group[name]
            array.with_config({"write_empty_chunks": True})[...] = variable.values


def _has_values(array: Any, values: Any) -> bool:
    try:
        return np.array_equal(array[...], values, equal_nan=values.dtype.kind == "f")
    except ValueError:  # of a checksum
        return False


def _require_same(store: Any, data: Any, theirs: dict[str, Any]) -> None:
    """Raise an error that names what differs if the attributes in a store are of another run."""
    ours, differences = data.attrs, []
    for name in {**ours, **dict.fromkeys(_OPTIONAL)} if theirs else ():  # others may add some
        if name not in _NOT_COMPARED and ours.get(name) != theirs.get(name):
            here, there = _in_words(ours.get(name)), _in_words(theirs.get(name))
            differences.append(
                f"{name}: {here}, the store has {'others' if here == there else there}"
            )
    if differences:
        what = f"{store} holds another run: {'; '.join(differences)}"
        raise ValueError(f"store: {what}; pass a new name, or the arguments of that run")


def _check_new(store: Any, data: Any) -> None:
    """Check that the folder of a new store has no other files, and space for the run."""
    if not isinstance(store, Path):
        return
    if os.path.lexists(store) and not store.is_dir():
        message = "the name of a file, or of a link without a target: pass a new name"
        raise FileExistsError(errno.EEXIST, message, str(store))
    if others := {path.name for path in store.glob("*") if path.suffix != ".partial"}:
        received = f"{store} with {min(others)} in it: pass a new name"
        raise wrong("store", "a new name or a store", received)
    free = shutil.disk_usage(next(parent for parent in store.parents if parent.exists())).free
    if data.nbytes > free:
        how = "choose another disk, or save fewer states"
        message = f"{in_units(free)} are free, the run takes {in_units(data.nbytes)}: {how}"
        raise OSError(errno.ENOSPC, message, str(store))


def described(name: str, array: Any, few: int = 1000) -> Any:
    """Return an attribute for an array: the numbers, if at most `few`, else range and digest."""
    if isinstance(array, RandomStarts):
        return repr(array)
    if array.size <= few:  # lists of lists as JSON, because NetCDF has no such attributes
        return array.tolist() if array.ndim < 2 else json.dumps(array.tolist())
    digest, low, high = hashlib.sha256(str(array.shape).encode()), np.inf, -np.inf
    rows = max(1, 2**21 // max(1, math.prod(array.shape[1:])))  # 16 MiB at a time
    for k in range(0, len(array), rows):
        part = checks.real_array(name, np.asarray(array[k : k + rows]), allow_nan=True)
        low = np.fmin.reduce(part, axis=None, initial=low)
        high = np.fmax.reduce(part, axis=None, initial=high)
        digest.update(np.ascontiguousarray(part).data)
    return f"{array.size} values from {low:g} to {high:g}, sha256 {digest.hexdigest()}"


def _in_words(value: Any) -> str:
    """Return an attribute as text: an array by its count and range, without the digest."""
    if isinstance(value, str) and value.startswith("[["):
        value = json.loads(value)
    text = str(described("store", np.array(value), 0) if isinstance(value, list) else value)
    return text.partition(", sha256")[0]
