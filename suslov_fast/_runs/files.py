"""Runs in files: a .npz holds each entry of `schema` under its name."""

from __future__ import annotations

import math
import os
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from .._checks import wrong
from .._engine.memory import require
from .replacing import replacing
from .schema import Entries, run_of

PathLike = str | os.PathLike[str]


@contextmanager
def place_for(path: PathLike) -> Iterator[Callable[[Entries], None]]:
    """Yield a function that writes a run to `path`, atomically.

    Obstacles to writing are detected before the computation.
    """
    _check_name(path)
    with replacing(path) as new:

        def write(entries: Entries) -> None:
            with open(new, "wb") as file:
                np.savez(file, **entries)  # type: ignore[arg-type]

        yield write


def read(path: PathLike) -> dict[str, Any]:
    """Return the attributes of the run in a file; ValueErrors get the name of the file."""
    _check_name(path)
    try:
        # Reading a pipe or a device may never end; the system reports a missing file.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise ValueError("expected a file, got a folder, a pipe or a device")
        return run_of(_entries(path))
    except (ValueError, TypeError) as error:
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
    try:
        with zipfile.ZipFile(path) as archive:
            nbytes = sum(_size_of(archive, info) for info in archive.infolist())
        require(nbytes, "the run in this file is too large for this machine")
        with np.load(path, allow_pickle=False) as arrays:
            return dict(arrays)
    except MemoryError:
        raise
    except Exception as error:  # readers raise various errors for damaged files
        raise ValueError(
            f"expected a .npz file that Trajectories.save wrote, got: {error}"
        ) from error


def _size_of(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> int:
    """Return the size of an array in memory; ValueError if that of its entry differs.

    Otherwise the entry might not be read to its end, where its checksum is compared.
    """
    form = np.lib.format
    with archive.open(info) as file:
        readers = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
        shape, _, dtype = readers[form.read_magic(file)](file)
        size = math.prod(shape) * dtype.itemsize
        if file.tell() + size != info.file_size:
            raise ValueError(f"{info.filename}: {info.file_size} bytes, shape {shape} of {dtype}")
    return size
