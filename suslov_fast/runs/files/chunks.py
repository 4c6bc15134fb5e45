"""The bytes of a chunk of a store: numbers as Zarr writes them, and their checksum (crc32c).

Chunks are written by this module, because the codecs of Zarr copy them several times. They are read
by Zarr, whose errors do not name a damaged chunk.
"""

import math
from typing import Any

import google_crc32c
import numpy as np
from zarr.storage import WrapperStore

from ...engine.status import PENDING


def encoded(values: Any, shape: tuple[int, ...], dtype: str) -> tuple[Any, bytes]:
    """Return a chunk of this shape and type: the bytes of its numbers, and their checksum.

    At the end of an axis the values fill a part of it.
    """
    if values.shape != shape:
        fill = math.nan if dtype == "float64" else PENDING
        whole = np.full(shape, fill, dtype)
        whole[tuple(map(slice, values.shape))] = values
        values = whole
    numbers = np.ascontiguousarray(values, dtype).reshape(-1).view(np.uint8)
    checksum = google_crc32c.value(numbers).to_bytes(4, "little")
    return numbers, checksum


class NamingStore(WrapperStore[Any]):  # type: ignore[misc]
    """A store, for reading, whose damaged chunks are errors that name them."""

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        value = await super().get(key, prototype, byte_range)
        if value is None or byte_range is not None or key.endswith("zarr.json"):
            return value
        chunk = value.as_numpy_array()
        checksum = google_crc32c.value(chunk[:-4]).to_bytes(4, "little")
        if chunk[-4:].tobytes() != checksum:
            how = "delete it, and ensemble, called again, computes its tile anew"
            raise ValueError(f"store: the chunk {key} of {self._store} is damaged: {how}")
        return value

    def with_read_only(self, read_only: bool = False) -> "NamingStore":
        return NamingStore(self._store.with_read_only(read_only))
