"""Files and folders that appear under their name once they are complete, and not at all before."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFREG: "a file",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


@contextmanager
def replacing(path: str | os.PathLike[str], folder: bool = False) -> Iterator[Path]:
    """A name to write a file or a folder to, which takes the place of `path` at the end.

    It lies in a folder beside `path`, made before any work is done, so that a path that cannot be
    written to is found out at once. If the process is killed, the next writer of the same path
    removes what is left, where folders can be locked. The mode of what is replaced is kept; of a
    link, what it points to is replaced.

    Raises OSError, with what was expected and received as its `strerror`.
    """
    target = _target(path, folder)
    workplace, lock = _workplace(target)
    try:
        new = workplace / "new"
        yield new
        _exchange(new, target)
    finally:
        shutil.rmtree(workplace, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def kind_of(mode: int) -> str:
    """What an entry of a folder is, in words."""
    return _KINDS.get(stat.S_IFMT(mode), "something else")


def _target(path: str | os.PathLike[str], folder: bool) -> Path:
    """What is to be replaced, or made, behind all links."""
    try:
        # A deleted working directory has no path.
        target = Path(os.path.realpath(path))
        if target.is_symlink():
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        try:
            mode = os.stat(target).st_mode
        except FileNotFoundError:
            return target
    except OSError as error:
        raise _explained(error, path) from error
    if folder:
        expected = "the name of a Zarr store"
        fits = stat.S_ISDIR(mode) and _is_store(target)
        received = "another folder" if stat.S_ISDIR(mode) else kind_of(mode)
    else:
        expected = "the name of a file"
        fits, received = stat.S_ISREG(mode), kind_of(mode)
    if not fits:
        message = f"expected {expected} to write, got {received}"
        raise OSError(errno.EEXIST, message, os.fspath(path))
    return target


def _is_store(folder: Path) -> bool:
    """Whether a folder is empty or a Zarr store: no other may be replaced."""
    entries = {entry.name for entry in os.scandir(folder)}
    return not entries or bool(entries & {".zgroup", "zarr.json"})


def _workplace(target: Path) -> tuple[Path, int | None]:
    """A new folder beside the target, and a descriptor that locks it while this process lives."""
    # The name of the target, cut so that this one is not too long either.
    prefix = f".{target.name[:32]}-{zlib.crc32(os.fsencode(target.name)):08x}."
    _remove_stale(target, prefix)
    while True:
        try:
            made = Path(tempfile.mkdtemp(suffix=".part", prefix=prefix, dir=target.parent))
        except OSError as error:
            raise _explained(error, target) from error
        lock = _lock(made, wait=True)
        # Until it was locked, another process may have taken it for stale.
        if made.exists():
            return made, lock
        if lock is not None:
            os.close(lock)


def _remove_stale(target: Path, prefix: str) -> None:
    """Remove what killed processes left behind."""
    with suppress(OSError):
        names = [entry.name for entry in os.scandir(target.parent)]
        for name in names:
            if not (name.startswith(prefix) and name.endswith(".part")):
                continue
            stale = target.parent / name
            lock = _lock(stale, wait=False)
            if lock is None:
                continue
            # Killed between the two renamings of `_exchange`.
            if (stale / "old").exists() and not target.exists():
                os.rename(stale / "old", target)
            shutil.rmtree(stale, ignore_errors=True)
            os.close(lock)


def _lock(folder: Path, wait: bool) -> int | None:
    """A descriptor that holds the lock of a folder, if it can be had."""
    if fcntl is None:
        return None
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # held by its writer, or a file system without locks
        os.close(descriptor)
        return None
    return descriptor


def _exchange(new: Path, target: Path) -> None:
    """Put what was written in the place of what was there."""
    with suppress(FileNotFoundError):
        os.chmod(new, stat.S_IMODE(os.stat(target).st_mode))
    if not (new.is_dir() and target.exists()):
        os.replace(new, target)
        return
    old = new.with_name("old")  # a folder that is not empty cannot be replaced in one move
    os.rename(target, old)
    try:
        os.rename(new, target)
    except OSError:
        os.rename(old, target)
        raise


def _explained(error: OSError, path: str | os.PathLike[str]) -> OSError:
    message = (
        "expected a name in a folder that can be written to, "
        f"got: {error.strerror or type(error).__name__}"
    )
    return OSError(error.errno or errno.EIO, message, os.fspath(path))
