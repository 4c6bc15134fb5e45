"""The bytes of a chunk of a store: numbers as Zarr writes them, and their checksum (crc32c).

Chunks are written by this module, because the codecs of Zarr copy them several times. Zarr reads
them.
"""

import math
from typing import Any

import google_crc32c
import numpy as np

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
