"""Atomic writing of files and folders."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str], folder: bool = False) -> Iterator[Path]:
    """Create a new file or folder next to `path`, which replaces `path` at the end.

    It is created before the computation, so a path that is not writable is detected immediately.
    The file mode is kept; for a link, its target is replaced. A folder must be empty or a Zarr
    store to be replaced, and its replacement is not atomic.

    Raises OSError, with what was expected and received as its `strerror`.
    """
    try:
        target = Path(os.path.realpath(path))  # a deleted working directory has no path
        mode = None
        with suppress(FileNotFoundError):
            mode = os.stat(target).st_mode
            _check_target(target, mode, folder)
        stem = os.fsencode(f".{target.name}")[:100].decode(errors="ignore")
        new = target.with_name(f"{stem}.{secrets.token_hex(4)}.part")
        new.mkdir() if folder else new.touch(exist_ok=False)
    except FileExistsError:
        raise
    except OSError as error:
        message = (
            "expected a name in a folder that can be written to, "
            f"got: {error.strerror or type(error).__name__}"
        )
        raise OSError(error.errno or errno.EIO, message, os.fspath(path)) from error
    old = new.with_suffix(".old")
    try:
        yield new
        if mode is not None:
            os.chmod(new, stat.S_IMODE(mode))
            if folder:  # a folder that is not empty cannot be replaced in one move
                os.rename(target, old)
        try:
            os.replace(new, target)
        except BaseException:  # also for Ctrl-C
            with suppress(FileNotFoundError):
                os.rename(old, target)
            raise
        shutil.rmtree(old, ignore_errors=True)
    finally:
        shutil.rmtree(new, ignore_errors=True)
        with suppress(OSError):
            os.unlink(new)


def _check_target(target: Path, mode: int, folder: bool) -> None:
    """Raise OSError unless the target is a file, an empty folder or a Zarr store."""
    kinds = {stat.S_IFREG: "a file", stat.S_IFDIR: "a folder"}
    received = kinds.get(stat.S_IFMT(mode), "neither a file nor a folder")
    fits = stat.S_ISREG(mode)
    if folder and (fits := stat.S_ISDIR(mode)):
        names = set(os.listdir(target))
        fits, received = not names or bool(names & {".zgroup", "zarr.json"}), "another folder"
    if not fits:
        expected = "a Zarr store" if folder else "a file"
        message = f"expected the name of {expected} to write, got {received}"
        raise OSError(errno.EEXIST, message, os.fspath(target))
