"""Check that a Zarr store can be decoded safely: numbers, strings and standard codecs only."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

# Zarr's standard compressors and checksums, filters that only reorder numbers, and strings.
_STANDARD = frozenset(
    "blosc bz2 gzip lz4 lzma zlib zstd adler32 crc32 crc32c fletcher32 shuffle delta vlen-utf8 "
    "bytes transpose sharding_indexed".split()
)


def refuse_codecs(store: Any) -> None:
    """Raise ValueError if an array of a store holds objects, or uses a nonstandard codec.

    `store` is an argument of `zarr.open_group`. Nothing is decoded.
    """
    import zarr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that are not part of the format
        # Metadata are stored centrally and with each array; readers may use either.
        for consolidated in (None, False):
            group = zarr.open_group(store, mode="r", use_consolidated=consolidated)
            for name, member in group.members(max_depth=None):
                if isinstance(member, zarr.Array):
                    _check(name, member.metadata.to_dict())


def _check(name: str, metadata: dict[str, Any]) -> None:
    codecs = [metadata.get(key) for key in ("filters", "compressor", "codecs")]
    used = {codec.removeprefix("numcodecs.") for codec in _names(codecs)}
    kind = metadata.get("dtype", metadata.get("data_type"))
    of_objects = "O" in str(kind) and "vlen-utf8" not in used
    if of_objects or not used <= _STANDARD:
        what = "objects" if of_objects else f"codecs {', '.join(sorted(used - _STANDARD))}"
        raise ValueError(f"{name}: expected numbers and Zarr's standard compressors, got {what}")


def _names(codec: Any) -> Iterator[str]:
    """Yield the names of codecs, including those nested in the configuration of others."""
    codec = codec.get_config() if hasattr(codec, "get_config") else codec
    if isinstance(codec, (list, tuple)):
        for each in codec:
            yield from _names(each)
    elif isinstance(codec, dict):
        yield str(codec.get("id", codec.get("name")))
        inner = codec.get("configuration") or {}
        yield from _names([inner.get("codecs"), inner.get("index_codecs")])
    elif codec is not None:
        yield str(codec)
