"""Zarr stores of runs: how they are made, and what they lack.

A store exists once its metadata are consolidated, a tile once its `status` is written. Every chunk
is written, even one that has only fill values: so a chunk that is not there was lost. There are no
shards, which several tiles would share: each writer replaces a shard as a whole, and loses what
others wrote to it at the same time.
"""

from __future__ import annotations

import asyncio
import errno
import hashlib
import json
import math
import os
import shutil
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from itertools import product
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..checks import first_index, wrong
from ..engine.random_starts import RandomStarts
from ..engine.status import Status
from . import access
from .metadata import COPY, Contents, Stored, Tile, contents, digest_of, overlaid

# The status of trajectories that are not computed.
PENDING = -128
# Settings of Zarr apply to all threads.
_ALONE = Lock()


class Lost(NamedTuple):
    """The parts that a store lacks."""

    chunks: dict[str, int]  # the number of chunks that were lost, by the name of their array
    tiles: set[Tile]  # tiles with such a chunk
    pending: set[Tile]  # not computed yet

    def __str__(self) -> str:
        each = (f"{n} chunk{'s' * (n > 1)} of {name}" for name, n in self.chunks.items())
        return ", ".join(each)


def resolved(store: Any) -> Any:
    """Return a store that other processes can open: folders as absolute paths."""
    Store = checks.extra("zarr.abc.store", "large").Store
    checks.instance("store", store, (str, os.PathLike, Store))
    if isinstance(store, Store):
        return access.opened(store)
    return store if "://" in os.fspath(store) else Path(store).absolute()


def lost(store: Any, found: Contents) -> Lost:
    """Return what is missing in a store; opening, summaries and the end of a run all ask here."""
    is_folder = isinstance(store, Path)
    there = _whole(store, found.arrays) if is_folder else _listed(store, found.arrays)
    tiles = [name for name in found.tiled if name != "status"]
    status = found.arrays["status"]
    whole = {tile for tile, _ in status.keys("status")}
    done = {tile for tile, key in status.keys("status") if key in there}
    absent: dict[str, tuple[str, Tile | None]] = {}  # key: name of the array, tile
    for name, each in found.arrays.items():
        axes = [each.dims.index(dim) for dim in status.dims] if name in tiles else None
        for index, key in each.keys(name) if name != "status" else ():
            tile = None if axes is None else tuple(index[axis] for axis in axes)
            if key not in there and (tile is None or tile in done):
                absent[key] = name, tile
    if not is_folder:  # which may list new keys late
        for key in access.run(access.existing(access.reader(store), list(absent))):
            del absent[key]
    chunks: dict[str, int] = {}
    for name, _ in absent.values():
        chunks[name] = chunks.get(name, 0) + 1
    return Lost(chunks, {tile for _, tile in absent.values() if tile is not None}, whole - done)


def _whole(folder: Path, arrays: Mapping[str, Stored]) -> set[str]:
    """Return the keys of the chunks in a folder whose files have their size."""
    return {
        key
        for name, each in arrays.items()
        for _, key in each.keys(name)
        if _is_whole(f"{folder}/{key}", each.nbytes)
    }


def _is_whole(path: str, nbytes: int | None) -> bool:
    try:
        about = os.stat(path)
    except FileNotFoundError:
        return False
    except NotADirectoryError:
        place = next(each for each in Path(path).parents if each.is_file())
        raise wrong("store", "have a folder of chunks", f"the file {place}: remove it") from None
    if stat.S_ISDIR(about.st_mode):
        raise wrong("store", "have a file for each chunk", f"the folder {path}: remove it")
    return nbytes is None or about.st_size == nbytes


def _listed(store: Any, arrays: Mapping[str, Stored]) -> set[str]:
    """Return the keys that a store lists; of one that cannot list, such as HTTP, those it has."""
    source = access.reader(store)
    there = access.run(access.keys_of(source))
    if "zarr.json" in there:
        return there
    return access.run(
        access.existing(
            source, [key for name, each in arrays.items() for _, key in each.keys(name)]
        )
    )


def has_tile(store: Any, tile: Tile) -> bool:
    """Return True if this process finds the status of a tile in a store."""
    return bool(
        access.run(
            access.existing(access.reader(store), ["/".join(["status", "c", *map(str, tile)])])
        )
    )


def prepare(
    store: Any, data: Any, sizes: dict[str, int]
) -> tuple[list[Tile], dict[str, Any], Stored]:
    """Create the store of a run, or check that it holds this run.

    Returns the tiles to compute, the arrays to be written to, and the metadata of `status`.
    """
    if not getattr(store, "supports_deletes", True):  # a ZIP file, whose entries are written once
        received = f"{type(store).__name__}: write into a folder, and open_ensemble reads a copy"
        raise wrong("store", "a store that is written in parts, in any order", received)
    found = contents(store)
    ours, theirs = data.attrs, {} if found is None else found.attributes
    texts = []
    for name in {**ours, **theirs} if theirs else ():
        if name not in ("version", "coordinates") and ours.get(name) != theirs.get(name):
            here, there = (_in_words(each.get(name)) for each in (ours, theirs))
            texts.append(f"{name}: {here}, the store has {'others' if here == there else there}")
    if texts:
        what = f"{store} holds another run: {'; '.join(texts)}"
        raise ValueError(f"store: {what}; pass a new name, or the arguments of that run")
    if found is None:
        _check_new(store, data)
    if found is None or not found.arrays:
        create(store, data, sizes)
        found = contents(store)
        assert found is not None
    if not found.is_consolidated:
        create(store, data, sizes, found.copy)
    lacks, arrays = lost(store, found), opened(store, found)
    for name in found.shared:
        values = data.variables[name].values
        if name in lacks.chunks or not _holds(arrays[name], values):
            arrays[name][...] = values
    return sorted(lacks.tiles | lacks.pending), arrays, found.arrays["status"]


def passed_poles(arrays: Any, status: Stored) -> tuple[int, tuple[tuple[int, ...], int] | None]:
    """Return how many trajectories passed a pole; the index of the first, and `failed_at` there."""
    count, first = 0, None
    axes = [range(0, n, m) for n, m in zip(status.shape, status.chunks, strict=True)]
    for begin in product(*axes):  # a tile at a time
        where = tuple(slice(k, k + m) for k, m in zip(begin, status.chunks, strict=True))
        passed = np.asarray(arrays["status"][where]) == Status.PASSED_POLE
        if passed.any():
            count += int(np.count_nonzero(passed))
            index = first_index(passed)
            step = int(np.asarray(arrays["failed_at"][where])[index])
            place = tuple(k + own for k, own in zip(begin, index, strict=True)), step
            first = place if first is None else min(first, place)
    return count, first


def _holds(array: Any, values: Any) -> bool:
    """Return False if an array has other values, or is damaged."""
    try:
        stored = np.asarray(array[...], values.dtype)
    except ValueError:  # of a checksum
        return False
    return np.array_equal(stored, values, equal_nan=values.dtype.kind == "f")


def _check_new(store: Any, data: Any) -> None:
    """Check that a new store has no tiles; in a folder that this is its own, and has space."""
    if access.run(access.keys_of(access.reader(store), "status/c/")) and contents(store) is None:
        raise wrong("store", "a new name or a store", f"{store} with tiles, but without zarr.json")
    if not isinstance(store, Path):
        return
    there = {path.name for path in store.glob("*") if path.suffix != ".partial"}
    if others := there - {
        "zarr.json",
        COPY,
        *map(str, data.variables),
    }:  # which another process made
        raise wrong("store", "a new name or a store", f"{store} with {min(others)} in it")
    free = shutil.disk_usage(next(each for each in store.parents if each.exists())).free
    if data.nbytes > free:
        message = f"{free:,} bytes are free, the run takes {data.nbytes:,}: raise save_every"
        raise OSError(errno.ENOSPC, message, str(store))


def described(name: str, array: Any, few: int = 1000) -> Any:
    """Return an array of at most `few` numbers as it is, else its count, range and digest."""
    if isinstance(array, RandomStarts):
        return repr(array)
    if array.size <= few:  # numbers in lists of lists as JSON: NetCDF has no such attributes
        return array.tolist() if array.ndim < 2 else json.dumps(array.tolist())
    digest, low, high = hashlib.sha256(str(array.shape).encode()), np.inf, -np.inf
    step = max(1, 2**21 // max(1, math.prod(array.shape[1:])))  # 16 MiB
    for k in range(0, len(array), step):
        part = checks.real_array(name, np.asarray(array[k : k + step]), allow_nan=True)
        low = np.fmin.reduce(part, axis=None, initial=low)
        high = np.fmax.reduce(part, axis=None, initial=high)
        digest.update(np.ascontiguousarray(part).data)
    return f"{array.size} values from {low:g} to {high:g}, sha256 {digest.hexdigest()}"


def _in_words(value: Any) -> str:
    """Return an attribute as text, without the digest; of arrays the count and range."""
    if isinstance(value, str) and value.startswith("[["):
        value = json.loads(value)
    text = str(described("store", np.array(value), 0) if isinstance(value, list) else value)
    return text.partition(", sha256")[0]


def create(store: Any, data: Any, sizes: dict[str, int], copy: str | None = None) -> None:
    """Create the arrays of a store; an interrupted call or another process may have made some.

    The metadata become those of the `copy`, if there is one.
    """
    import zarr

    labels = " ".join(str(name) for name in data.coords if name not in data.dims)
    about = {**data.attrs, "coordinates": labels}  # as xarray reads it
    with suppress(zarr.errors.ContainsGroupError):
        zarr.create_group(store, zarr_format=3, attributes=about)
    root = zarr.open_group(store, mode="r+", zarr_format=3, use_consolidated=False)
    tiled, shared = (json.loads(data.attrs[name]) for name in ("tiled", "shared"))
    sizes = dict(sizes)
    for name in tiled:
        if (begun := root.get(name)) is not None:  # with the sizes of the call that made it
            sizes |= zip(data[name].dims, begun.chunks, strict=True)
    for name, variable in data.variables.items():
        lengths = {**data.sizes, **sizes} if name in tiled else data.sizes
        kind = variable.dtype.kind
        with suppress(zarr.errors.ContainsArrayError):
            root.create_array(
                name,
                shape=variable.shape,
                dtype=str if kind in "OU" else variable.dtype,
                chunks=tuple(max(1, lengths[dim]) for dim in variable.dims),
                fill_value=_fill(kind, name in tiled),
                compressors=zarr.codecs.Crc32cCodec(),
                dimension_names=variable.dims,
                attributes=variable.attrs,
            )
    if copy is not None:
        access.run(access.put(root.store, "zarr.json", copy))
        return
    write(_writable(root, shared), data, shared)
    access.run(_consolidate(root.store, about, sorted(map(str, data.variables))))


async def _consolidate(target: Any, attributes: Any, names: list[str]) -> None:
    """Write the metadata of all arrays, as Zarr consolidates them, their digest, and a copy."""
    keys = ["zarr.json", *(f"{name}/zarr.json" for name in names)]
    texts = await asyncio.gather(*(access.get(target, key) for key in keys))
    group, *each = (json.loads(text or "") for text in texts)
    group, arrays = group | {"attributes": attributes}, dict(zip(names, each, strict=True))
    digest = digest_of(attributes, arrays)
    about = {"kind": "inline", "must_understand": False, "sha256": digest, "metadata": arrays}
    text = json.dumps(group | {"consolidated_metadata": about}, indent=2)
    for key in (COPY, "zarr.json"):
        await access.put(target, key, text)


def _fill(kind: str, is_tiled: bool) -> Any:
    """Return the value of chunks that are not written yet, None for that of Zarr."""
    if kind == "f":
        return math.nan
    return PENDING if is_tiled else None


def opened(store: Any, found: Contents) -> dict[str, Any]:
    """Return the arrays of a store, to be written to."""
    import zarr

    root = zarr.open_group(overlaid(store, found, False), mode="r+", zarr_format=3)
    return _writable(root, found.arrays)


def _writable(root: Any, names: Iterable[str]) -> dict[str, Any]:
    """Return arrays of a group that write every chunk, even one that has only fill values."""
    import zarr

    with _ALONE, zarr.config.set({"array.write_empty_chunks": True}):
        return {name: root[name] for name in names}


def write(arrays: Any, data: Any, names: Any) -> None:
    """Write the arrays that all tiles share: parameters, step sizes, labels."""
    for name in names:
        arrays[name][...] = data.variables[name].values
