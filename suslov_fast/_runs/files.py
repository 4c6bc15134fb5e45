"""Runs in files: .npz by NumPy alone, .nc and .zarr by xarray.

A .npz holds each entry of `schema` under its name. The other two hold the dataset of
`Trajectories.to_xarray`, and in a group of its own, "resume", what the run needs to go on.
"""

from __future__ import annotations

import errno
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from . import labelled
from .codecs import refuse_codecs
from .replacing import replacing
from .schema import HEADER, RESUME, Entries, check, read_header

SUFFIXES = (".npz", ".nc", ".zarr")
# Bytes of an entry of the header: more is no number and no name.
_SHORT = 4096
_LIBRARIES = {".npz": (), ".nc": ("netCDF4", "h5netcdf"), ".zarr": ("zarr",)}

PathLike = str | os.PathLike[str]
Result = TypeVar("Result")


def suffix_of(path: PathLike) -> str:
    """Return one of `SUFFIXES`; ValueError for any other."""
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
        yield lambda entries: (_write_npz if suffix == ".npz" else _write)(new, entries, suffix)


def read(path: PathLike, interpret: Callable[[Entries], Result]) -> Result:
    """Return what `interpret` makes of a file; ValueErrors get the name of the file."""
    suffix = suffix_of(path)
    engine_of(suffix)
    os.stat(path)  # that there is no such file is for the system to say
    try:
        return interpret(_read_npz(path) if suffix == ".npz" else _read(path, suffix))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{os.fspath(path)}: {error}") from error


def engine_of(suffix: str) -> str | None:
    """Return the part of xarray that reads and writes a kind of file; ImportError without it."""
    libraries = _LIBRARIES[suffix]
    if not libraries:
        return None
    labelled.import_xarray()
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


def _write_npz(new: Path, entries: Entries, suffix: str) -> None:
    with open(new, "wb") as file:
        np.savez(file, **entries)  # type: ignore[arg-type]


def _write(new: Path, entries: Entries, suffix: str) -> None:
    dataset = labelled.dataset_of(entries)
    # A checksum, which these formats need not have.
    dataset.attrs["crc32"] = _checksum(entries)
    resume = labelled.import_xarray().Dataset(
        {
            name.removeprefix(RESUME): ([f"{name[len(RESUME) :]}_{k}" for k in range(a.ndim)], a)
            for name, a in entries.items()
            if name.startswith(RESUME)
        }
    )
    for variable in resume.variables.values():
        variable.encoding["_FillValue"] = None
    if suffix == ".zarr":
        # The second format, which all readers know, and whose metadata lie in one place.
        dataset = dataset.assign_coords(component=dataset["component"].astype(str))
        dataset.to_zarr(new, mode="a", zarr_format=2, consolidated=True)
        resume.to_zarr(new, group="resume", mode="a", zarr_format=2, consolidated=True)
        return
    try:
        dataset.to_netcdf(new, engine=engine_of(suffix))
        resume.to_netcdf(new, mode="a", group="resume", engine=engine_of(suffix))
    except RuntimeError as error:  # netCDF4's word for a full disk
        raise OSError(errno.EIO, f"could not be written: {error}", os.fspath(new)) from error


def _read_npz(path: PathLike) -> Entries:
    if not zipfile.is_zipfile(path):
        raise ValueError("expected a .npz file that Trajectories.save wrote, got something else")
    try:
        with zipfile.ZipFile(path) as archive:
            shapes = {}
            for info in archive.infolist():
                name = info.filename.removesuffix(".npy")
                if name in shapes or name == info.filename:
                    raise ValueError(f"an unexpected entry {info.filename}")
                shapes[name] = _shape_of(archive, info)
            header = {}
            for name, (shape, dtype) in shapes.items():
                if name in HEADER and shape == () and dtype.itemsize < _SHORT:
                    header[name] = _array_of(archive, name)
            read_header(header)
            check(header, shapes)
            return {name: _array_of(archive, name) for name in shapes}
    except MemoryError:
        raise
    except Exception as error:  # readers raise whatever a damaged file makes them
        raise ValueError(f"expected a whole .npz file of a run, got: {error}") from error


def _shape_of(
    archive: zipfile.ZipFile, info: zipfile.ZipInfo
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """The shape and the dtype of an array that is not decoded, and takes what they say."""
    form = np.lib.format
    with archive.open(info) as file:
        version = form.read_magic(file)
        readers = {(1, 0): form.read_array_header_1_0, (2, 0): form.read_array_header_2_0}
        if version not in readers:
            raise ValueError(f"{info.filename}: version {version} of the .npy format")
        shape, _, dtype = readers[version](file)
        if dtype.hasobject:
            raise ValueError(f"{info.filename}: an array of objects")
        size = int(np.prod(shape, dtype=object)) * dtype.itemsize
        if file.tell() + size != info.file_size:
            raise ValueError(f"{info.filename}: {info.file_size} bytes, shape {shape} of {dtype}")
    return shape, dtype


def _array_of(archive: zipfile.ZipFile, name: str) -> Any:
    with archive.open(f"{name}.npy") as file:
        array = np.lib.format.read_array(file, allow_pickle=False)
        file.read(1)  # the end of the entry, where its checksum is looked at
    return array


def _read(path: PathLike, suffix: str) -> Entries:
    xarray = labelled.import_xarray()
    options = {"engine": engine_of(suffix), "mask_and_scale": False, "decode_times": False}
    name = os.path.abspath(path)
    try:
        if suffix == ".zarr":
            refuse_codecs(name)
        with xarray.open_dataset(name, **options) as opened:
            read_header(opened.attrs)
            dataset = opened.load()
        with xarray.open_dataset(name, group="resume", **options) as opened:
            resume = {RESUME + str(name): each.values for name, each in opened.data_vars.items()}
    except MemoryError:
        raise
    except Exception as error:  # readers raise whatever a damaged file makes them
        raise ValueError(
            f"expected a {suffix} file that Trajectories.save wrote, got: {error}"
        ) from error
    entries = labelled.entries_of_dataset(dataset) | resume
    if int(dataset.attrs.get("crc32", -1)) != _checksum(entries):
        raise ValueError(
            "expected what Trajectories.save wrote, got something damaged or edited since: "
            "its checksum is another"
        )
    return entries


def _checksum(entries: Entries) -> int:
    """A number that changes when a bit of the entries does."""
    total = 0
    for name, array in sorted(entries.items()):
        plain = array.dtype.kind not in "iuf"
        data = str(array).encode() if plain else np.ascontiguousarray(array).data
        total = zlib.crc32(data, zlib.crc32(f"{name}{array.shape}".encode(), total))
    return total
