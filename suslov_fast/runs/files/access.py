"""Requests to a Zarr store: which keys it has, and their values, read and written."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Coroutine, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

# Simultaneous requests, for keys that a listing does not have and of writing.
_AT_A_TIME = 64


def reader(store: Any, read_only: bool = True) -> Any:
    """Return the Zarr store object of a folder or a URL, without cached listings."""
    from zarr.storage import FsspecStore, LocalStore

    if isinstance(store, Path):
        return LocalStore(store, read_only=read_only)
    if isinstance(store, (str, os.PathLike)):
        store = FsspecStore.from_url(os.fspath(store), read_only=read_only)
    if isinstance(store, FsspecStore):
        store.fs.invalidate_cache()  # because cached listings lack chunks of other processes
    return store


def run(requests: Coroutine[Any, Any, T]) -> T:
    """Run requests on the event loop of Zarr, to which the connections of its stores belong.

    The private `sync` is needed because no public function of Zarr lists keys or asks for one.
    """
    from zarr.core.sync import sync

    answer: T = sync(requests)
    return answer


def opened(store: Any) -> Any:
    """Return a Zarr store object after it was opened, because one of a ZIP file starts closed."""
    from zarr.storage import StorePath

    return run(StorePath.open(store, path="")).store


async def put(target: Any, values: Mapping[str, Sequence[Any]]) -> None:
    """Write values, each in parts that are bytes or arrays of bytes, several keys at a time."""
    from zarr.buffer import default_buffer_prototype

    buffer, turn = default_buffer_prototype().buffer, asyncio.Semaphore(_AT_A_TIME)

    async def put_one(key: str, parts: Sequence[Any]) -> None:
        async with turn:
            await target.set(key, buffer.from_bytes(b"".join(parts)))

    await asyncio.gather(*(put_one(key, parts) for key, parts in values.items()))


async def put_new(target: Any, key: str, value: bytes) -> bytes:
    """Write bytes under a key that has none; return those that it has then.

    Of several processes at once one succeeds, if the file system has hard links.
    """
    from zarr.buffer import default_buffer_prototype

    if await get(target, key) is None:
        try:
            made = default_buffer_prototype().buffer.from_bytes(value)
            await target.set_if_not_exists(key, made)
        except OSError:
            await put(target, {key: [value]})
    return await get(target, key) or b""


async def put_where_different(target: Any, values: Mapping[str, bytes]) -> None:
    """Write bytes under those keys that have others, or none."""
    found = await asyncio.gather(*(get(target, key) for key in values))
    pairs = zip(values.items(), found, strict=True)
    await put(target, {key: [value] for (key, value), there in pairs if value != there})


async def get(source: Any, key: str) -> bytes | None:
    """Return the bytes under a key, or None."""
    from zarr.buffer import default_buffer_prototype

    try:
        value = await source.get(key, default_buffer_prototype())
    except FileNotFoundError:
        return None
    return None if value is None else bytes(value.to_bytes())


async def texts(source: Any, keys: list[str]) -> list[str | None]:
    """Return the text under each key, or None."""
    return await asyncio.gather(*(text(source, key) for key in keys))


async def text(source: Any, key: str) -> str | None:
    """Return the text under a key, or None."""
    value = await get(source, key)
    return None if value is None else value.decode("utf-8", "replace")


async def keys_of(source: Any, prefix: str = "") -> set[str]:
    """Return the keys with a prefix; none if the store cannot list keys."""
    try:
        return {key async for key in source.list_prefix(prefix)}
    except Exception:  # of any class, because each kind of server has its own
        return set()


async def existing(source: Any, keys: list[str]) -> set[str]:
    """Return those of the keys that exist, by one request for each."""
    turn = asyncio.Semaphore(_AT_A_TIME)

    async def ask(key: str) -> bool:
        async with turn:
            try:
                return bool(await source.exists(key))
            except FileNotFoundError:
                return False

    answers = await asyncio.gather(*map(ask, keys))
    return {key for key, exists in zip(keys, answers, strict=True) if exists}
