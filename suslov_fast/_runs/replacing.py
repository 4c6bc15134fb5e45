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
        mode = None
        with suppress(FileNotFoundError):
            mode = os.stat(target).st_mode
            _check_target(target, mode)
        stem = os.fsencode(f".{target.name}")[:100].decode(errors="ignore")
        new = target.with_name(f"{stem}.{secrets.token_hex(4)}.part")
        new.touch(exist_ok=False)
    except FileExistsError:
        raise
    except OSError as error:
        message = (
            "expected a name in a folder that can be written to, "
            f"got: {error.strerror or type(error).__name__}"
        )
        raise OSError(error.errno or errno.EIO, message, os.fspath(path)) from error
    try:
        yield new
        if mode is not None:
            os.chmod(new, stat.S_IMODE(mode))
        os.replace(new, target)
    finally:
        with suppress(OSError):
            os.unlink(new)


def _check_target(target: Path, mode: int) -> None:
    """Raise OSError unless the target is a file."""
    if not stat.S_ISREG(mode):
        received = "a folder" if stat.S_ISDIR(mode) else "neither a file nor a folder"
        message = f"expected the name of a file to write, got {received}"
        raise OSError(errno.EEXIST, message, os.fspath(target))
