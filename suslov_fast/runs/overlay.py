"""A view of a store with its original metadata, after others changed them (needs Zarr)."""

from typing import Any

from zarr.storage import WrapperStore


class Overlay(WrapperStore[Any]):  # type: ignore[misc]
    """A store whose key zarr.json, the consolidated metadata, has another text."""

    def __init__(self, store: Any, text: str) -> None:
        super().__init__(store)
        self.text = text

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        if key == "zarr.json":
            return prototype.buffer.from_bytes(self.text.encode())
        return await super().get(key, prototype, byte_range)

    def with_read_only(self, read_only: bool = False) -> "Overlay":
        return Overlay(self._store.with_read_only(read_only), self.text)
