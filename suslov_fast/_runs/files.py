"""Runs in files: .npz by NumPy alone, .nc and .zarr by xarray."""

from __future__ import annotations

import errno
import os
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from . import labelled
from .replacing import replacing
from .schema import Entries

SUFFIXES = (".npz", ".nc", ".zarr")

PathLike = str | os.PathLike[str]
Result = TypeVar("Result")


def suffix_of(path: PathLike) -> str:
    """One of `SUFFIXES`; raises ValueError for any other."""
    name = os.fspath(path)
    if not isinstance(name, str):
        raise TypeError(f"path: expected a string or a path, got {type(path).__name__}")
    suffix = Path(name).suffix.lower()
    if suffix not in SUFFIXES or name.endswith(("/", os.sep)):
        raise ValueError(f"path: expected a name that ends in {', '.join(SUFFIXES)}, got {name!r}")
    return suffix


@contextmanager
def place_for(path: PathLike) -> Iterator[Callable[[Entries], None]]:
    """A function that writes a run, which is then found under `path`, whole or not at all.

    What would keep it from being written there is found out before any work is done.
    """
    suffix = suffix_of(path)
    engine_of(suffix)
    with replacing(path, folder=suffix == ".zarr") as new:
        yield lambda entries: _WRITERS[suffix](new, entries)


def read(path: PathLike, interpret: Callable[[Entries], Result]) -> Result:
    """What `interpret` makes of the entries in a file; its ValueErrors get the name of the file."""
    suffix = suffix_of(path)
    engine_of(suffix)
    os.stat(path)  # that there is no such file is for the system to say
    try:
        return interpret(_READERS[suffix](path))
    except ValueError as error:
        raise ValueError(f"{os.fspath(path)}: {error}") from error


def engine_of(suffix: str) -> str | None:
    """The part of xarray that reads and writes a kind of file; ImportError if it is missing."""
    if suffix == ".npz":
        return None
    labelled.import_xarray()
    libraries = {".zarr": ("zarr",), ".nc": ("netCDF4", "h5netcdf")}[suffix]
    for library in libraries:
        if _is_installed(library):
            return library.lower()
    raise ImportError(
        f"{suffix}: expected {' or '.join(libraries)}, got none: pip install 'suslov_fast[xarray]'"
    )


def _is_installed(library: str) -> bool:
    try:
        return find_spec(library) is not None
    except ValueError:  # its import was blocked
        return False


def _write_npz(new: Path, entries: Entries) -> None:
    with open(new, "wb") as file:
        np.savez(file, **entries)  # type: ignore[arg-type]


def _write_nc(new: Path, entries: Entries) -> None:
    try:
        _checked_dataset(entries).to_netcdf(new, engine=engine_of(".nc"))
    except RuntimeError as error:  # netCDF4's word for a full disk
        raise OSError(errno.EIO, f"could not be written: {error}", os.fspath(new)) from error


def _write_zarr(new: Path, entries: Entries) -> None:
    # The second format, which all readers know, and whose metadata lie in one place.
    _checked_dataset(entries).to_zarr(new, mode="w-", zarr_format=2, consolidated=True)


def _checked_dataset(entries: Entries) -> Any:
    """A dataset with a checksum, which these formats need not have."""
    dataset = labelled.dataset_of(entries)
    dataset.attrs["crc32"] = labelled.checksum(entries)
    return dataset


def _read_npz(path: PathLike) -> Entries:
    if not zipfile.is_zipfile(path):
        raise ValueError("expected a .npz file that Trajectories.save wrote, got something else")
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            return dict(archive)
    except MemoryError:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
        if damaged is None:
            raise
        raise ValueError(f"expected a whole .npz file, got one with {damaged} damaged") from None
    except Exception as error:  # readers raise whatever a damaged file makes them
        raise ValueError(f"expected a whole .npz file, got one that is damaged: {error}") from error


def _read_dataset(path: PathLike) -> Entries:
    suffix = suffix_of(path)
    xarray = labelled.import_xarray()
    try:
        with xarray.open_dataset(
            os.path.abspath(path),
            engine=engine_of(suffix),
            mask_and_scale=False,
            decode_times=False,
        ) as opened:
            dataset = opened.load()
    except MemoryError:
        raise
    except Exception as error:  # as above
        raise ValueError(
            f"expected a {suffix} file that Trajectories.save wrote, got: {error}"
        ) from error
    entries = labelled.entries_of_dataset(dataset)
    if "crc32" in dataset.attrs and int(dataset.attrs["crc32"]) != labelled.checksum(entries):
        raise ValueError(
            "expected what Trajectories.save wrote, got something damaged or edited since: "
            "its checksum is another"
        )
    return entries


_WRITERS = {".npz": _write_npz, ".nc": _write_nc, ".zarr": _write_zarr}
_READERS = {".npz": _read_npz, ".nc": _read_dataset, ".zarr": _read_dataset}
