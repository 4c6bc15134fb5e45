"""One writer of a store at a time; a request to stop."""

from __future__ import annotations

import errno
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# Stores other than folders that this process writes to.
_in_use: set[str] = set()
_guard = threading.Lock()


@contextmanager
def only_writer(store: Any, folder: bool) -> Iterator[None]:
    """Keep other writers out of a store.

    For a folder, the file beside its real path with the suffix .lock is locked, so that another
    name of the folder is the same store. Other stores are known within this process only.

    Raises BlockingIOError if there is another writer, and OSError if the lock file is a symbolic
    link.
    """
    name = store if isinstance(store, str) else f"{type(store).__name__} {id(store)}"
    in_use = BlockingIOError(
        errno.EAGAIN, "expected a store without another writer, got one in use", name
    )
    if folder:
        from filelock import FileLock, Timeout

        lock = FileLock(f"{os.path.realpath(store)}.lock")
        try:
            lock.acquire(blocking=False)
        except Timeout:
            raise in_use from None
        try:
            yield
        finally:
            lock.release()
        return
    with _guard:
        if name in _in_use:
            raise in_use
        _in_use.add(name)
    try:
        yield
    finally:
        _in_use.discard(name)


class Stop:
    """A request to stop."""

    asked = False

    def ask(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal; raise KeyboardInterrupt at the second."""
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True


@contextmanager
def stopping() -> Iterator[Stop]:
    """Turn SIGINT and SIGTERM into a request to stop; only the main thread receives them."""
    stop, before = Stop(), {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            before[number] = signal.signal(number, stop.ask)
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
