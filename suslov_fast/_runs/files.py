"""Runs in files: a .npz holds each entry of `schema` under its name."""

from __future__ import annotations

import math
import os
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .._checks import wrong
from .._engine.memory import require
from .replacing import replacing
from .schema import HEADER, Entries, check

# Largest size in bytes of a header entry, a number or a name.
_SHORT = 4096

PathLike = str | os.PathLike[str]
Result = TypeVar("Result")


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


def read(path: PathLike, interpret: Callable[[Entries], Result]) -> Result:
    """Return the file as converted by `interpret`; ValueErrors get the name of the file."""
    _check_name(path)
    try:
        # Reading a pipe or a device may never end; the system reports a missing file.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise ValueError("expected a file, got a folder, a pipe or a device")
        try:
            entries = _read_npz(path)
        except MemoryError:
            raise
        except Exception as error:  # readers raise various errors for damaged files
            raise ValueError(
                f"expected a .npz file that Trajectories.save wrote, got: {error}"
            ) from error
        return interpret(entries)
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


def _read_npz(path: PathLike) -> Entries:
    """Return the entries of a .npz, after a check of names, shapes and types."""
    with zipfile.ZipFile(path) as archive:
        shapes = {
            info.filename.removesuffix(".npy"): _shape_of(archive, info)
            for info in archive.infolist()
        }
        header = {
            name: _array_of(archive, name)
            for name, (shape, dtype) in shapes.items()
            if name in HEADER and shape == () and dtype.itemsize < _SHORT
        }
        check(header, shapes)
        nbytes = sum(math.prod(shape) * dtype.itemsize for shape, dtype in shapes.values())
        require(nbytes, "the run in this file is too large for this machine")
        return {name: _array_of(archive, name) for name in shapes}


def _shape_of(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[Any, np.dtype[Any]]:
    """Return the shape and the dtype of an array without decoding it, after a check of its size."""
    form = np.lib.format
    with archive.open(info) as file:
        version = form.read_magic(file)
        readers = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
        shape, _, dtype = readers[version](file)
        if dtype.hasobject:
            raise ValueError(f"{info.filename}: an array of objects")
        if file.tell() + math.prod(shape) * dtype.itemsize != info.file_size:
            raise ValueError(f"{info.filename}: {info.file_size} bytes, shape {shape} of {dtype}")
    return shape, dtype


def _array_of(archive: zipfile.ZipFile, name: str) -> Any:
    with archive.open(f"{name}.npy") as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
        file.read(1)  # reading to the end of the entry verifies its checksum
    return array
