"""One writer of a store at a time; signals; progress."""

from __future__ import annotations

import errno
import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from .._engine.progress import Progress, _tqdm

# Called with trajectory-steps made and bytes written since the last call.
Report = Callable[[int, int], object]

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
    if folder:
        from filelock import FileLock, Timeout

        lock = FileLock(f"{os.path.realpath(store)}.lock")
        try:
            lock.acquire(blocking=False)
        except Timeout as error:
            raise _blocked(store) from error
        try:
            yield
        finally:
            lock.release()
        return
    name = store if isinstance(store, str) else f"{type(store).__name__} {id(store)}"
    with _guard:
        if name in _in_use:
            raise _blocked(name)
        _in_use.add(name)
    try:
        yield
    finally:
        _in_use.discard(name)


def _blocked(store: str) -> BlockingIOError:
    return BlockingIOError(
        errno.EAGAIN, "expected a store without another writer, got one that is written to", store
    )


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
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, stop.ask) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def meter(progress: Progress, total: int, done: int) -> Iterator[Report]:
    """Return the function that reports progress, in trajectory-steps."""
    if progress is True:
        with _tqdm()(total=total, initial=done, unit="step", unit_scale=True) as bar:
            written = 0

            def advance(steps: int, nbytes: int) -> None:
                nonlocal written
                written += nbytes
                bar.set_postfix_str(f"{written / 1e9:.3g} GB written", refresh=False)
                bar.update(steps)

            yield advance
    elif callable(progress):
        progress(done, total)

        def call(steps: int, nbytes: int) -> None:
            nonlocal done
            done += steps
            progress(done, total)

        yield call
    else:
        yield lambda steps, nbytes: None
