"""Atomic writing of files."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Create a new file next to `path`, which replaces `path` at the end.

    It is created before the computation, so a path that is not writable is detected immediately.
    The file mode is kept; for a link, its target is replaced.

    Raises OSError, with what was expected and received as its `strerror`.
    """
    try:
        target = Path(os.path.realpath(path))  # a deleted working directory has no path
        mode = target.stat().st_mode if target.exists() else None
        if mode is not None and not stat.S_ISREG(mode):
            kind = "a folder" if stat.S_ISDIR(mode) else "neither a file nor a folder"
            raise FileExistsError(errno.EEXIST, kind)
        new = target.with_name(f".{secrets.token_hex(8)}.part")
        new.touch(exist_ok=False)
    except OSError as error:
        received = error.strerror or type(error).__name__
        message = f"expected a name in a folder that can be written to, got {received}"
        raise OSError(error.errno or errno.EIO, message, os.fspath(path)) from error
    try:
        yield new
        if mode is not None:
            os.chmod(new, stat.S_IMODE(mode))
        os.replace(new, target)
    finally:
        with suppress(OSError):
            new.unlink()
