"""A view of a store for reading (needs Zarr)."""

from typing import Any

from zarr.storage import WrapperStore

from .chunks import is_damaged


class Overlay(WrapperStore[Any]):  # type: ignore[misc]
    """A store whose damaged chunks are errors that name them, because those of Zarr do not.

    With a `text`, that is the text of zarr.json, the consolidated metadata.
    """

    def __init__(self, store: Any, name: str, text: str | None) -> None:
        super().__init__(store)
        self.name, self.text = name, text

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        if key == "zarr.json" and self.text is not None:
            return prototype.buffer.from_bytes(self.text.encode())
        value = await super().get(key, prototype, byte_range)
        is_chunk = value is not None and byte_range is None and not key.endswith("zarr.json")
        if is_chunk and is_damaged(value.as_numpy_array()):
            how = "delete it, and ensemble, called again, computes its tile anew"
            raise ValueError(f"store: the chunk {key} of {self.name} is damaged: {how}")
        return value

    def with_read_only(self, read_only: bool = False) -> "Overlay":
        return Overlay(self._store.with_read_only(read_only), self.name, self.text)
