"""How a part of an array gets into a store, and how damage to it is found."""

from __future__ import annotations

import math
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .layout import path_of
from .starts import Slices

_CHECKSUM = 4  # bytes of it, after those of a chunk


def put(array: Any, where: Slices, values: NDArray[Any]) -> None:
    """Write a part of an array; each of its chunks appears whole or not at all.

    One whole chunk in a folder, without compression, is written straight from memory: Zarr would
    copy it four times.
    """
    path = path_of(array)
    if path is None or not _is_plain_chunk(array, where, values):
        array[where] = values
        return
    index = tuple(each.start // length for each, length in zip(where, array.chunks, strict=True))
    name = array.metadata.chunk_key_encoding.encode_chunk_key(index)
    _write(path / name, np.ascontiguousarray(values).reshape(-1).view(np.uint8))


def _is_plain_chunk(array: Any, where: Slices, values: NDArray[Any]) -> bool:
    codecs = [type(codec).__name__ for codec in array.metadata.codecs]
    return (
        codecs == ["BytesCodec", "Crc32cCodec"]
        and sys.byteorder == "little"
        and array.dtype == values.dtype
        and values.shape == array.chunks
        and all(each.start % length == 0 for each, length in zip(where, array.chunks, strict=True))
    )


def _write(path: Path, data: NDArray[np.uint8]) -> None:
    import google_crc32c

    checksum = google_crc32c.value(data).to_bytes(_CHECKSUM, "little")
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}.partial")
    try:
        with open(beside, "xb", buffering=0) as file:
            for part in (data.data, memoryview(checksum)):
                written = 0
                while written < len(part):
                    written += file.write(part[written:])
            if os.fstat(file.fileno()).st_size != len(data) + _CHECKSUM:
                raise OSError(f"{beside}: expected {len(data) + _CHECKSUM} bytes, got others")
        os.replace(beside, path)
    except BaseException:
        with suppress(OSError):
            beside.unlink()
        raise


def sweep(folder: str) -> None:
    """Remove what killed writers left beside the chunks."""
    for path in Path(folder).rglob(".*.partial"):
        path.unlink(missing_ok=True)
    for path in Path(folder).rglob("*.partial"):
        path.unlink(missing_ok=True)


def damaged(array: Any, where: Slices) -> str | None:
    """What is wrong with the chunks of a part of an array, if anything is.

    Each is read; one that is missing, which Zarr takes for one without values, is found too.
    """
    for part in _chunks(array, where):
        index = tuple(each.start // size for each, size in zip(part, array.chunks, strict=True))
        key = array.metadata.chunk_key_encoding.encode_chunk_key(index)
        if not _is_there(array, key):
            return f"{array.path}/{key} is missing"
        try:
            array[part]
        except (ValueError, RuntimeError, OSError) as error:
            return f"{array.path}/{key}: {error}"
    return None


def _is_there(array: Any, key: str) -> bool:
    from zarr.core.sync import sync

    return bool(sync((array.store_path / key).store.exists((array.store_path / key).path)))


def _chunks(array: Any, where: Slices) -> Iterator[Slices]:
    first = [each.start // size for each, size in zip(where, array.chunks, strict=True)]
    last = [-(-each.stop // size) for each, size in zip(where, array.chunks, strict=True)]
    counts = [b - a for a, b in zip(first, last, strict=True)]
    if math.prod(counts) == 0:
        return
    for index in np.ndindex(*counts):
        yield tuple(
            slice((a + k) * size, min((a + k + 1) * size, length))
            for a, k, size, length in zip(first, index, array.chunks, array.shape, strict=True)
        )
