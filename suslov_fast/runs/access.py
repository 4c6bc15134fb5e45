"""Requests to a store: the keys that it has, and values of small ones."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")

# The number of simultaneous requests for chunks that are not in a listing.
_AT_A_TIME = 64


def reader(store: Any, read_only: bool = True) -> Any:
    """Return the Zarr store object of a folder or a URL, to read what is there now."""
    from zarr.storage import FsspecStore, LocalStore

    if isinstance(store, Path):
        return LocalStore(store, read_only=read_only)
    if isinstance(store, (str, os.PathLike)):
        store = FsspecStore.from_url(os.fspath(store), read_only=read_only)
    if isinstance(store, FsspecStore):
        store.fs.invalidate_cache()  # of listings, in which other processes' chunks are missing
    return store


def run(requests: Coroutine[Any, Any, T]) -> T:
    """Run requests on the event loop of Zarr, to which the connections of its stores belong.

    Zarr's public functions are synchronous and take arrays; none lists or asks for keys.
    """
    from zarr.core.sync import sync

    found: T = sync(requests)
    return found


async def settle(seconds: float) -> None:
    """Wait until requests that an interrupt has left have ended, and cancel slow ones.

    At the end of a process asyncio prints what it thinks of requests that are under way.
    """
    if others := asyncio.all_tasks() - {asyncio.current_task()}:
        for task in (await asyncio.wait(others, timeout=seconds))[1]:
            task.cancel()


def opened(store: Any) -> Any:
    """Return a Zarr store object after it was opened, which one of a ZIP file is not at first."""
    from zarr.storage import StorePath

    return run(StorePath.open(store, path="")).store


async def put(target: Any, key: str, text: str) -> None:
    from zarr.buffer import default_buffer_prototype

    await target.set(key, default_buffer_prototype().buffer.from_bytes(text.encode()))


async def get(source: Any, key: str) -> str | None:
    from zarr.buffer import default_buffer_prototype

    try:
        value = await source.get(key, default_buffer_prototype())
    except FileNotFoundError:
        return None
    return None if value is None else value.to_bytes().decode("utf-8", "replace")


async def keys_of(source: Any, prefix: str = "") -> set[str]:
    try:
        return {key async for key in source.list_prefix(prefix)}
    except (FileNotFoundError, NotImplementedError):
        return set()


async def existing(source: Any, keys: list[str]) -> set[str]:
    """Return the keys that exist."""
    turn = asyncio.Semaphore(_AT_A_TIME)

    async def ask(key: str) -> bool:
        async with turn:
            try:
                return bool(await source.exists(key))
            except FileNotFoundError:
                return False

    answers = await asyncio.gather(*map(ask, keys))
    return {key for key, there in zip(keys, answers, strict=True) if there}
