"""Runs in files, written atomically: a .npz holds each entry of `schema` under its name."""

from __future__ import annotations

import errno
import os
import secrets
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import wrong
from .._engine.memory import require
from .schema import Entries, run_of

PathLike = str | os.PathLike[str]


@contextmanager
def place_for(path: PathLike, overwrite: bool = True) -> Iterator[Callable[..., None]]:
    """Yield a function that writes the entries of a run, its keywords, to `path`, atomically."""
    _check_name(path)
    if not overwrite and os.path.isfile(path):
        message = "expected the name of a new file, or overwrite=True, got one that exists"
        raise FileExistsError(errno.EEXIST, message, os.fspath(path))

    def put(**entries: Any) -> None:
        for name, value in entries.items():  # of any name: `numpy.savez` has arguments, too
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asanyarray(value), allow_pickle=False)

    with replacing(path) as new, zipfile.ZipFile(new, "w") as archive:
        yield put


def read_run(path: PathLike) -> dict[str, Any]:
    """Return what `run_of` finds in a file; errors get the name of the file."""
    _check_name(path)
    try:
        # Reading a pipe or a device may never end; the system reports a missing file.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise ValueError("expected a file, got a folder, a pipe or a device")
        return run_of(_entries(path))
    except KeyError as error:
        message = f"expected the arrays of a run, got none named {error}"
        raise ValueError(f"{os.fspath(path)}: {message}") from error
    except (ValueError, TypeError, AttributeError, LookupError, ArithmeticError) as error:
        raise ValueError(f"{os.fspath(path)}: {error}") from error


def _check_name(path: PathLike) -> None:
    name = os.fspath(path) if isinstance(path, os.PathLike) else path
    if not isinstance(name, str):
        raise wrong("path", "a string or a path", type(path).__name__, TypeError)
    if Path(name).suffix.lower() != ".npz" or name.endswith(("/", os.sep)):
        expected = (
            "a name that ends in .npz (to_xarray().to_netcdf(path) and ensemble(store=...) write "
            "other formats)"
        )
        raise wrong("path", expected, repr(name))


def _entries(path: PathLike) -> Entries:
    """Return the arrays of a .npz, after a check of their sizes."""
    entries: Entries = {}
    try:
        with zipfile.ZipFile(path) as archive:
            nbytes = sum(member.file_size for member in archive.infolist())
            require(nbytes, "the run in this file is too large for this machine")
            for name in archive.namelist():
                with archive.open(name) as file:
                    array = np.lib.format.read_array(file, allow_pickle=False)
                    if file.read(1):  # otherwise this reads the end, where the checksum is compared
                        raise ValueError(f"{name}: more data than shape {array.shape} needs")
                entries[name.removesuffix(".npy")] = array
    except MemoryError:
        raise
    except Exception as error:  # readers raise various errors for damaged files
        expected = "expected a .npz file that Trajectories.save wrote"
        raise ValueError(f"{expected}, got another file, or a damaged one") from error
    return entries


@contextmanager
def replacing(path: PathLike) -> Iterator[Path]:
    """Create a new file next to `path`, which replaces `path` at the end.

    It is created before the computation, so a path that is not writable is detected immediately.
    The file mode is kept; for a link, its target is replaced.
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
