"""Check that an array can be decoded safely: numbers, strings and standard codecs only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

# Zarr's standard compressors and checksums, codecs that only reorder numbers, and strings.
_STANDARD = frozenset("blosc bytes crc32c gzip sharding_indexed transpose vlen-utf8 zstd".split())


def checked(name: str, node: Any) -> Any:
    """Return an array, not yet decoded, or a group; ValueError if it uses a nonstandard codec."""
    unknown = sorted(set(_names(node.metadata.to_dict().get("codecs", ()))) - _STANDARD)
    if unknown:
        received = f"codecs {', '.join(unknown)}"
        raise ValueError(f"{name}: expected Zarr's standard codecs, got {received}")
    return node


def _names(codecs: Any) -> Iterator[str]:
    """Yield the names of codecs, including those nested in the configuration of others."""
    for codec in codecs:
        yield codec["name"]
        inner = codec.get("configuration") or {}
        for key in ("codecs", "index_codecs"):
            yield from _names(inner.get(key, ()))
