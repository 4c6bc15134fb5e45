"""Check that a Zarr store can be decoded safely: numbers, strings and standard codecs only."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

# Zarr's standard compressors and checksums, codecs that only reorder numbers, and strings.
_STANDARD = frozenset("blosc bytes crc32c gzip sharding_indexed transpose vlen-utf8 zstd".split())


def refuse_codecs(store: Any) -> None:
    """Raise ValueError if an array of a store uses a nonstandard codec; nothing is decoded."""
    import zarr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of files that are not part of the format
        # Metadata are stored centrally and with each array; readers may use either.
        for consolidated in (None, False):
            options: dict[str, Any] = {"zarr_format": 3, "use_consolidated": consolidated}
            group = zarr.open_group(store, mode="r", **options)
            for name, member in group.members(max_depth=None):
                if isinstance(member, zarr.Array):
                    check(name, member.metadata.to_dict()["codecs"])


def check(name: str, codecs: Any) -> None:
    """Raise ValueError if the array `name` needs a nonstandard codec."""
    unknown = sorted(set(_names(codecs)) - _STANDARD)
    if unknown:
        received = f"codecs {', '.join(unknown)}"
        raise ValueError(f"{name}: expected Zarr's standard codecs, got {received}")


def _names(codecs: Any) -> Iterator[str]:
    """Yield the names of codecs, including those nested in the configuration of others."""
    for codec in codecs:
        yield codec["name"]
        inner = codec.get("configuration") or {}
        for key in ("codecs", "index_codecs"):
            yield from _names(inner.get(key, ()))
