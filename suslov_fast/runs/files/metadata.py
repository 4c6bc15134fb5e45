"""Metadata of the Zarr stores of runs: the arrays and attributes that a store should have.

A store holds a copy of them, because others, such as xarray, may rewrite the metadata of Zarr.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple

from ... import checks
from ...checks import wrong
from ...maps import named
from ..columns import FORMAT, OtherFormat, arrays_of, check_arrays, of_runs, sizes_of
from . import access

# Key of the copy: inside an array, because Zarr warns of unknown keys in groups.
COPY = "status/run.json"
# Codecs of our stores; metadata with others are refused, because codecs can run commands.
_CODECS = {"bytes", "vlen-utf8", "crc32c"}
# Bytes of a number, and of the checksum that follows the numbers in the file of a chunk.
_BYTES, _CHECKSUM = {"float64": 8, "int64": 8, "int8": 1}, 4
# Chunks of a store, each of which opening it looks for, and components of a state.
MOST_CHUNKS, _MOST_COMPONENTS = 2**21, 2**20
# What to do with data of others.
_ELSEWHERE = "pass a new name; xarray.open_zarr reads them"
_OTHERS = f"other data: {_ELSEWHERE}"

Tile = tuple[int, ...]  # position of a tile along each axis of the batch


class Stored(NamedTuple):
    """The metadata of an array."""

    shape: tuple[int, ...]
    dtype: str
    chunks: tuple[int, ...]
    dims: tuple[str, ...]

    @property
    def counts(self) -> tuple[int, ...]:
        """The numbers of chunks along each axis."""
        return tuple(math.ceil(n / m) for n, m in zip(self.shape, self.chunks, strict=True))

    @property
    def nbytes(self) -> int | None:
        """Size of the file of a chunk; None for texts, whose size varies."""
        width = _BYTES.get(self.dtype)
        return None if width is None else width * math.prod(self.chunks) + _CHECKSUM

    def key(self, name: str, position: Mapping[str, int]) -> str:
        """Return the key of the chunk at a position along each axis, 0 where it has none."""
        return "/".join([name, "c", *(str(position.get(dim, 0)) for dim in self.dims)])

    def keys(self, name: str) -> Iterator[tuple[tuple[int, ...], str]]:
        """Yield the index and the key of each chunk."""
        for index in product(*map(range, self.counts)):
            yield index, "/".join([name, "c", *map(str, index)])


class Contents(NamedTuple):
    """The metadata of a store; `arrays` is empty until all arrays of the run are created.

    The last three are for stores into which others have written: the copy of the metadata, the
    attributes that they added, and whether the metadata are still consolidated.
    """

    attributes: dict[str, Any]
    arrays: dict[str, Stored]
    copy: str | None = None
    added: Mapping[str, Any] = {}
    is_consolidated: bool = True

    @property
    def tiled(self) -> list[str]:
        """Names of the arrays that are written tile by tile."""
        return [*json.loads(self.attributes["tiled"])]

    @property
    def shared(self) -> list[str]:
        """Names of the arrays that are written at once: parameters, step sizes, labels."""
        return [*json.loads(self.attributes["shared"])]


def read_contents(store: Any) -> Contents | None:
    """Return the metadata of a store, or None if there is no store; ValueError for other data.

    They are checked before Zarr reads them: only format 3 and our own codecs are accepted.
    """
    from ... import __version__

    source = access.reader(store)
    text = access.run(access.text(source, "zarr.json"))
    document: Any = {"attributes": {}} if text is None else _document(store, text)
    copy, rewritten = None, {}
    is_ours = "sha256" in (document.get("consolidated_metadata") or {})
    if not is_ours:
        copy = access.run(access.text(source, COPY))
    if copy is not None:  # others rewrote the metadata; without a copy, they are not complete yet
        rewritten, document = document, _document(store, copy)
    elif text is None:
        if access.run(access.existing(source, [".zgroup", ".zarray"])):
            raise _foreign(store, f"data of Zarr format 2: {_ELSEWHERE}")
        return None
    attributes = dict(document["attributes"])
    if (number := attributes.get("format")) != FORMAT:
        version = attributes.get("version") or attributes.get("source")
        if number is None and version == __version__:
            raise _foreign(store, "a dataset of to_xarray(): open it by xarray.open_zarr")
        if version:
            raise ValueError(f"store: {store} is {OtherFormat(number, version)}")
        raise _foreign(store, _OTHERS)
    try:
        consolidated = document.get("consolidated_metadata") or {"metadata": {}}
        metadata = consolidated["metadata"]
        digest = digest_of(document["attributes"], metadata)
        # Zarr drops the digest when it rewrites the metadata, for a new array, say.
        if consolidated.get("sha256", digest) != digest:
            raise wrong("sha256", "the digest of what was written", "another")
        contents = Contents(attributes, {k: stored_in(k, array) for k, array in metadata.items()})
        if metadata:
            _check_arrays(contents)
        return contents if copy is None else _with_additions(contents, copy, rewritten)
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        kind = "damaged metadata" if is_ours or copy else "a copy by others, for xarray.open_zarr"
        raise _foreign(store, f"{kind}: {error}") from error


def _document(store: Any, text: str) -> dict[str, Any]:
    """Return the metadata of a group from their JSON text."""
    try:
        document: dict[str, Any] = json.loads(text)
        _ = dict(document["attributes"])
        if document["zarr_format"] != 3 or document["node_type"] != "group":
            raise KeyError("zarr_format")
    except (KeyError, TypeError):
        raise _foreign(store, _OTHERS) from None
    except (ValueError, RecursionError) as error:
        raise _foreign(store, f"damaged metadata: {error}") from error
    return document


def _with_additions(contents: Contents, copy: str, rewritten: dict[str, Any]) -> Contents:
    """Add what others wrote into a store; they may only have lengthened arrays of the run."""
    consolidated = rewritten.get("consolidated_metadata") or {}
    metadata = consolidated.get("metadata", {})
    for name in contents.arrays.keys() & metadata.keys():
        now = stored_in(name, metadata[name])
        if now._replace(shape=contents.arrays[name].shape) != contents.arrays[name]:
            raise wrong(name, "the array that ensemble made", "another")
    attributes = rewritten["attributes"].items()
    added = {name: value for name, value in attributes if name not in contents.attributes}
    return Contents(*contents[:2], copy, added, bool(consolidated))


def digest_of(attributes: Any, arrays: Any) -> str:
    """Return the digest of metadata, because Zarr has no checksum of them."""
    return hashlib.sha256(json.dumps([attributes, arrays], sort_keys=True).encode()).hexdigest()


def _foreign(store: Any, data: str) -> Any:
    """Return the error of a store that holds other data."""
    return wrong("store", f"a store of ensemble in format {FORMAT}", f"{store} with {data}")


def stored_in(name: str, metadata: dict[str, Any]) -> Stored:
    """Return the metadata of an array, or raise an error if Zarr must not open it."""
    if (metadata["zarr_format"], metadata.get("node_type")) != (3, "array"):
        raise wrong(name, "an array of Zarr format 3", metadata["zarr_format"])
    codecs = {codec["name"] for codec in metadata["codecs"]}
    separator = metadata["chunk_key_encoding"].get("configuration", {}).get("separator", "/")
    grid = metadata["chunk_grid"]["configuration"]["chunk_shape"]
    if not codecs <= _CODECS or separator != "/" or metadata.get("storage_transformers"):
        raise wrong(name, "an array as ensemble makes it", ", ".join(sorted(codecs)))
    shape, dims = tuple(metadata["shape"]), tuple(metadata.get("dimension_names") or ())
    if len(dims) != len(shape) or len(grid) != len(shape) or min((*grid, 1)) < 1:
        raise wrong(name, "have chunks and a name for each axis", f"{shape}, {grid}, {dims}")
    return Stored(shape, str(metadata["data_type"]), tuple(grid), dims)


def _check_arrays(contents: Contents) -> None:
    """Check that a store has all arrays of its run, with their types, shapes and chunks."""
    attributes, arrays, *_ = contents
    if (total := sum(math.prod(array.counts) for array in arrays.values())) > MOST_CHUNKS:
        raise wrong("store", f"at most {MOST_CHUNKS} chunks", total)
    map = named(attributes["map"])
    checks.one_of("method", attributes["method"], map.methods)
    every = attributes.get("save_every")
    rows = 1 if every is None else attributes["steps"] // every + 1
    status, (D,) = arrays["status"], arrays["component"].shape
    if D > _MOST_COMPONENTS:
        raise wrong("component", f"at most {_MOST_COMPONENTS} names", D)
    columns = of_runs("attitude" in attributes)
    of_run = arrays_of(columns, sizes_of(status.shape, D, n=rows))
    functions = dict.fromkeys(contents.tiled, ("float64", (rows, *status.shape)))
    expected = functions | {map.variable: of_run.pop("states")} | of_run
    expected |= {"n": ("int64", (rows,)), "component": ("string", (D,))}
    check_arrays({name: (array.dtype, array.shape) for name, array in arrays.items()}, expected)
    if absent := {*contents.shared, "eps"} - {*arrays}:
        raise ValueError(f"the array {min(absent)} is missing")
    sizes = dict(zip(status.dims, status.shape, strict=True))
    chunks = dict(zip(status.dims, status.chunks, strict=True))
    for name, array in arrays.items():
        if name in contents.tiled and not {*status.dims} <= {*array.dims}:
            raise wrong(name, f"have the axes {', '.join(status.dims)}", ", ".join(array.dims))
        for dim, length, chunk in zip(array.dims, array.shape, array.chunks, strict=True):
            if length != sizes.setdefault(dim, length):
                raise wrong(name, f"have the length {sizes[dim]} along {dim}", length)
            if name in contents.tiled and chunk != chunks.setdefault(dim, chunk):
                raise wrong(name, f"have chunks of {chunks[dim]} along {dim}", chunk)


def overlaid(store: Any, contents: Contents, read_only: bool = True) -> Any:
    """Return a store for Zarr: with the copy of the metadata, if others changed them.

    To be read, it also names damaged chunks.
    """
    if contents.copy is None and not read_only:
        return store
    from .overlay import Overlay

    return Overlay(access.reader(store, read_only), str(store), contents.copy)
