"""One writer of a store at a time."""

from __future__ import annotations

import errno
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from .layout import is_folder

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

# Stores of this process that are being written to, of any kind.
_taken: set[str] = set()
_door = threading.Lock()


@contextmanager
def only_writer(store: Any) -> Iterator[None]:
    """Keep other writers out.

    Beside a folder lies a file that is locked, which ends with this process however it ends. For
    other stores only this process is known; two that write the same run there write the same bytes.

    Raises BlockingIOError if there is another writer.
    """
    name = store if isinstance(store, str) else f"{type(store).__name__} {id(store)}"
    with _door:
        if name in _taken:
            raise _in_use(name, f"a thread of this process, {os.getpid()}")
        _taken.add(name)
    try:
        if is_folder(store) and fcntl is not None:
            with _locked_file(store):
                yield
        else:
            yield
    finally:
        with _door:
            _taken.discard(name)


@contextmanager
def _locked_file(store: str) -> Iterator[None]:
    path = f"{store}.lock"
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.read(file, 200).decode(errors="replace") or "another process"
            os.close(file)
            raise _in_use(store, holder) from error
        if _is_same(file, path):
            break
        os.close(file)  # it was removed by who held it
    try:
        os.ftruncate(file, 0)
        os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        os.unlink(path)
        os.close(file)


def _is_same(file: int, path: str) -> bool:
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False


def _in_use(store: str, holder: str) -> BlockingIOError:
    return BlockingIOError(
        errno.EAGAIN,
        f"expected a store that nobody else writes to, got one in use by {holder}",
        store,
    )
