"""Metadata of the Zarr stores of runs: the arrays and attributes that a store should have."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple

from ...checks import wrong
from ..columns import FORMAT, OtherFormat
from . import access

# Codecs of our stores; metadata with others are refused, because codecs can run commands.
_CODECS = {"bytes", "vlen-utf8", "crc32c"}
# Bytes of a number, and of the checksum that follows the numbers in the file of a chunk.
_BYTES, _CHECKSUM = {"float64": 8, "int64": 8, "int8": 1}, 4
# Chunks of a store, each of which opening it looks for, and components of a state.
MOST_CHUNKS, _MOST_COMPONENTS = 2**21, 2**20
# What to do with data of others.
_OTHERS = "other data: pass a new name; xarray.open_zarr reads them"

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
    """The metadata of a store; `arrays` is empty until all arrays of the run are created."""

    attributes: dict[str, Any]
    arrays: dict[str, Stored]

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
    source = access.reader(store)
    text = access.run(access.text(source, "zarr.json"))
    if text is None:
        return None
    document = _document(store, text)
    attributes = dict(document["attributes"])
    if (number := attributes.get("format")) != FORMAT:
        version = attributes.get("version") or attributes.get("source")
        if version:
            raise ValueError(f"store: {store} is {OtherFormat(number, version)}")
        raise _foreign(store, _OTHERS)
    try:
        metadata = (document.get("consolidated_metadata") or {"metadata": {}})["metadata"]
        contents = Contents(attributes, {})
        ours = {*contents.shared, *contents.tiled}  # others may add arrays of their own
        arrays = {name: stored_in(name, each) for name, each in metadata.items() if name in ours}
        contents = Contents(attributes, arrays)
        if metadata:
            _check_arrays(contents)
        return contents
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise _foreign(store, f"damaged metadata: {error}") from error


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
    """Check that a store has all arrays of its run, and chunks that can be looked for."""
    if (total := sum(math.prod(array.counts) for array in contents.arrays.values())) > MOST_CHUNKS:
        raise wrong("store", f"at most {MOST_CHUNKS} chunks", total)
    if absent := {*contents.shared, *contents.tiled} - {*contents.arrays}:
        raise ValueError(f"the array {min(absent)} is missing")
    if (D := math.prod(contents.arrays["component"].shape)) > _MOST_COMPONENTS:
        raise wrong("component", f"at most {_MOST_COMPONENTS} names", D)
