"""Zarr stores of runs: how they are created, and which tiles and chunks they lack.

A store is complete once its metadata are consolidated, a tile once its `status` is written. Every
chunk is written, even one of fill values only, so a chunk that does not exist was lost. There are
no shards, because a writer replaces a whole shard, and so would lose what other tiles write to it
at the same time.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit
from urllib.request import url2pathname

import numpy as np

from ... import checks
from ...checks import in_units, short, wrong
from ...engine.random_starts import RandomStarts
from ..columns import MOTION, RUN
from . import access
from .metadata import Contents, Stored, Tile, read_contents, stored_in

# Values that unwritten chunks show, by the name of a column; others are NaN, or Zarr's default.
_FILLS = {column.name: column.fill for column in (*RUN, *MOTION)}
# Attributes that only some runs have.
_OPTIONAL = "map save_every attitude names H K atol max_step stiff".split()
# Attributes that identify no run, or follow from others.
_NOT_COMPARED = "version", "coordinates", "title", "tiled", "shared"
# Suffixes of files, which no store has: of runs, of datasets, and of archives.
_OF_FILES = ".npz", ".nc", ".h5", ".hdf5", ".csv", ".zip"
# What to do with a folder of others.
_NEW = "pass a new name"


# The indices and keys of the chunks of each array.
Expected = Mapping[str, list[tuple[tuple[int, ...], str]]]


class Lost(NamedTuple):
    """Lost chunks of a store, and tiles to compute."""

    chunks: dict[str, int]  # number of lost chunks, by the name of their array
    tiles: set[Tile]  # computed tiles with a lost chunk
    pending: set[Tile]  # tiles that are not computed yet

    def __str__(self) -> str:
        counts = self.chunks.items()
        return ", ".join(f"{count} chunk{'s' * (count > 1)} of {name}" for name, count in counts)


def resolved(store: Any) -> Any:
    """Return a store in a form that other processes can open: folders as absolute paths."""
    Store = checks.extra("zarr.abc.store", "large").Store
    if isinstance(store, Store):
        return access.opened(store)
    folder = "the name of a folder, such as 'runs.zarr'"
    if not isinstance(store, (str, os.PathLike)):
        raise wrong("store", folder, short(store), TypeError)
    store = os.path.expanduser(store)
    if Path(store).suffix.lower() in _OF_FILES:
        raise wrong("store", folder, repr(store))
    if store.startswith("file://"):  # fsspec makes no folders
        return Path(url2pathname(urlsplit(store).path)).absolute()
    return store if "://" in store else Path(store).absolute()


def lost(store: Any, contents: Contents) -> Lost:
    """Return the chunks and tiles that a store lacks."""
    is_folder, arrays = isinstance(store, Path), contents.arrays
    expected = {name: list(array.keys(name)) for name, array in arrays.items()}
    keys = _whole(store, arrays, expected) if is_folder else _listed(store, expected)
    dims = arrays["status"].dims
    done = {tile for tile, key in expected["status"] if key in keys}
    absent: dict[str, tuple[str, Tile | None]] = {}  # by key: the array, and the tile if any
    for name in [name for name in expected if name != "status"]:
        axes = [arrays[name].dims.index(dim) for dim in dims] if name in contents.tiled else None
        for index, key in expected[name]:
            tile = None if axes is None else tuple(index[axis] for axis in axes)
            if key not in keys and (tile is None or tile in done):
                absent[key] = name, tile
    if not is_folder:  # ask for each, because listings of remote stores may lack new keys
        for key in access.run(access.existing(access.reader(store), list(absent))):
            del absent[key]
    chunks: dict[str, int] = {}
    for name, _ in absent.values():
        chunks[name] = chunks.get(name, 0) + 1
    damaged = {tile for _, tile in absent.values() if tile is not None}
    return Lost(chunks, damaged, {tile for tile, _ in expected["status"]} - done)


def _whole(folder: Path, arrays: Mapping[str, Stored], expected: Expected) -> set[str]:
    """Return the keys of the chunks in a folder whose files have the right size.

    Those of `status` come first, because it is written last: a tile that is finished meanwhile is
    then pending, not damaged.
    """
    return {
        key
        for name in sorted(expected, key=lambda name: name != "status")
        for _, key in expected[name]
        if _is_whole(f"{folder}/{key}", arrays[name].nbytes)
    }


def _is_whole(path: str, nbytes: int | None) -> bool:
    """Return whether a file has the right size."""
    try:
        size = os.stat(path).st_size
    except (FileNotFoundError, NotADirectoryError):  # Windows raises the first below files, too
        return False
    return nbytes is None or size == nbytes


def _listed(store: Any, expected: Expected) -> set[str]:
    """Return the keys of a store; if it cannot list them, such as one by HTTP, ask for each."""
    source = access.reader(store)
    keys = access.run(access.keys_of(source))
    if "zarr.json" in keys:
        return keys
    return access.run(
        access.existing(source, [key for pairs in expected.values() for _, key in pairs])
    )


def has_tile(store: Any, tile: Tile) -> bool:
    """Return whether this process finds the status of a tile in a store."""
    key = "/".join(["status", "c", *map(str, tile)])
    return bool(access.run(access.existing(access.reader(store), [key])))


def prepare(store: Any, data: Any, sizes: dict[str, int]) -> tuple[list[Tile], Contents]:
    """Create the store of a run, or check that it holds this run.

    Return the tiles to compute, and the metadata.
    """
    if not getattr(store, "supports_deletes", True):  # in a ZIP file no entry can be rewritten
        received = f"{type(store).__name__}: write into a folder, and open_ensemble reads a copy"
        raise wrong("store", "a store that is written in parts, in any order", received)
    contents = read_contents(store)
    if contents is None:
        _check_new(store, data)
    else:
        _require_same(store, data, contents.attributes)
    if contents is not None and contents.arrays:
        _restore_shared(store, data, contents)
    else:
        create(store, data, sizes)
        contents = read_contents(store)
        assert contents is not None
    lacks = lost(store, contents)
    return sorted(lacks.tiles | lacks.pending), contents


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
    """Check that a store is new, and that its folder has no other files and space for the run."""
    if (
        access.run(access.keys_of(access.reader(store), "status/c/"))
        and read_contents(store) is None
    ):
        received = f"{store} with tiles, but without zarr.json: {_NEW}"
        raise wrong("store", "a new name or a store", received)
    if not isinstance(store, Path):
        return
    if os.path.lexists(store) and not store.is_dir():
        message = "the name of a file, or of a link without a target: pass a new name"
        raise FileExistsError(errno.EEXIST, message, str(store))
    names = {path.name for path in store.glob("*") if path.suffix != ".partial"}
    ours = {"zarr.json", *map(str, data.variables)}  # another process may have begun this run
    if others := names - ours:
        raise wrong("store", "a new name or a store", f"{store} with {min(others)} in it: {_NEW}")
    free = shutil.disk_usage(next(parent for parent in store.parents if parent.exists())).free
    if data.nbytes > free:
        sizes = in_units(free), in_units(data.nbytes)
        how = "choose another disk, or save fewer states"
        message = f"{sizes[0]} are free, the run takes {sizes[1]}: {how}"
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


def create(store: Any, data: Any, sizes: dict[str, int]) -> None:
    """Create the arrays of a store, except those that an earlier call or another process made."""
    target, made = access.reader(store, read_only=False), _made(data, sizes)
    group = access.run(access.put_new(target, "zarr.json", made["zarr.json"]))
    # Another process may have begun another run meanwhile.
    _require_same(store, data, json.loads(group)["attributes"])
    # The array of states is made first: its chunks tell the tiles, which all arrays share.
    batch = data["status"].dims
    states = next(name for name in data if data[name].dims[1:] == (*batch, "component"))
    key = f"{states}/zarr.json"
    if (found := access.run(access.put_new(target, key, made[key]))) != made[key]:
        array = stored_in(states, json.loads(found))
        made = _made(data, dict(zip(array.dims, array.chunks, strict=True)))
    there = access.run(access.existing(target, list(made)))
    access.run(access.put(target, {key: [made[key]] for key in made if key not in there}))
    access.run(_consolidate(target, sorted(key for key in made if key.endswith("/zarr.json"))))


def _made(data: Any, sizes: dict[str, int]) -> dict[str, bytes]:
    """Return the keys and values of a new store: all metadata, and the chunks of shared arrays.

    Zarr makes them in memory, because it takes many requests one after the other.
    """
    import zarr

    made: dict[str, Any] = {}
    labels = " ".join(str(name) for name in data.coords if name not in data.dims)
    attributes = {**data.attrs, "coordinates": labels}  # by which xarray knows coordinates
    memory, shared = zarr.storage.MemoryStore(made), json.loads(data.attrs["shared"])
    root = zarr.create_group(memory, zarr_format=3, attributes=attributes)
    for name, variable in data.variables.items():
        lengths = data.sizes if name in shared else {**data.sizes, **sizes}
        kind = variable.dtype.kind
        array = root.create_array(
            name,
            shape=variable.shape,
            dtype=str if kind in "OU" else variable.dtype,
            chunks=tuple(max(1, lengths[dim]) for dim in variable.dims),
            fill_value=_FILLS.get(str(name), math.nan if kind == "f" else None),
            compressors=zarr.codecs.Crc32cCodec(),
            dimension_names=variable.dims,
            attributes=variable.attrs,
            config={"write_empty_chunks": True},
        )
        if name in shared:
            array[...] = variable.values
    return {key: value.to_bytes() for key, value in made.items()}


async def _consolidate(target: Any, keys: list[str]) -> None:
    """Write consolidated metadata, as Zarr does, with which a store is complete."""
    texts = await access.texts(target, ["zarr.json", *keys])
    group, *documents = (json.loads(text or "") for text in texts)
    arrays = {key.partition("/")[0]: each for key, each in zip(keys, documents, strict=True)}
    metadata = {"kind": "inline", "must_understand": False, "metadata": arrays}
    text = json.dumps(group | {"consolidated_metadata": metadata}, indent=2)
    await access.put(target, {"zarr.json": [text.encode()]})


def _restore_shared(store: Any, data: Any, contents: Contents) -> None:
    """Write the arrays that all tiles share anew where they are not those of the run."""
    made = _made(data, {})
    keys = [key for name in contents.shared for _, key in contents.arrays[name].keys(name)]
    target = access.reader(store, read_only=False)
    access.run(access.put_where_different(target, {key: made[key] for key in keys}))
