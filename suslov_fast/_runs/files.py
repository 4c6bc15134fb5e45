"""Runs in files: .npz by NumPy alone, .nc and .zarr by xarray.

A .npz holds each entry of `schema` under its name. The other formats hold the dataset of
`Trajectories.to_xarray`, and in the group "resume" the data needed to resume the run.
"""

from __future__ import annotations

import errno
import math
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .._checks import wrong
from . import labelled
from .codecs import refuse_codecs
from .replacing import replacing
from .schema import HEADER, RESUME, Entries, check, read_header

# The library needed by xarray for each format; .npz needs NumPy only.
_LIBRARIES = {".npz": "", ".nc": "netCDF4", ".zarr": "zarr"}
# Largest size in bytes of a header entry, a number or a name.
_SHORT = 4096

PathLike = str | os.PathLike[str]
Result = TypeVar("Result")


@contextmanager
def place_for(path: PathLike) -> Iterator[Callable[[Entries], None]]:
    """Yield a function that writes a run to `path`, atomically.

    Obstacles to writing are detected before the computation.
    """
    suffix = _suffix_of(path)
    with replacing(path, folder=suffix == ".zarr") as new:
        yield lambda entries: _write(new, entries, suffix)


def read(path: PathLike, interpret: Callable[[Entries], Result]) -> Result:
    """Return the file as converted by `interpret`; ValueErrors get the name of the file."""
    suffix = _suffix_of(path)
    os.stat(path)  # the system reports a missing file
    try:
        try:
            entries = _read_npz(path) if suffix == ".npz" else _read_dataset(path, suffix)
        except MemoryError:
            raise
        except Exception as error:  # readers raise various errors for damaged files
            raise ValueError(
                f"expected a {suffix} file that Trajectories.save wrote, got: {error}"
            ) from error
        return interpret(entries)
    except (ValueError, TypeError) as error:
        raise ValueError(f"{os.fspath(path)}: {error}") from error


def _suffix_of(path: PathLike) -> str:
    """Return the suffix of a file name, after a check that its library is installed."""
    name = os.fspath(path) if isinstance(path, os.PathLike) else path
    if not isinstance(name, str):
        raise wrong("path", "a string or a path", type(path).__name__, TypeError)
    suffix = Path(name).suffix.lower()
    if suffix not in _LIBRARIES or name.endswith(("/", os.sep)):
        raise wrong("path", f"a name that ends in {', '.join(_LIBRARIES)}", repr(name))
    if library := _LIBRARIES[suffix]:
        labelled.import_xarray(library)
    return suffix


def _write(new: Path, entries: Entries, suffix: str) -> None:
    if suffix == ".npz":
        with open(new, "wb") as file:
            np.savez(file, **entries)  # type: ignore[arg-type]
        return
    dataset = labelled.with_time(labelled.dataset_of(entries))
    dataset.attrs["crc32"] = _checksum(entries)  # these formats need not have one
    resume = labelled.import_xarray().Dataset()
    for name, array in entries.items():
        if name.startswith(RESUME):
            name = name.removeprefix(RESUME)
            resume[name] = ([f"{name}_{k}" for k in range(array.ndim)], array)
            resume[name].encoding["_FillValue"] = None
    if suffix == ".zarr":
        # Zarr format 2, which all readers support and which has consolidated metadata.
        options = {"mode": "a", "zarr_format": 2, "consolidated": True}
        dataset = dataset.assign_coords(component=dataset["component"].astype(str))
        dataset.to_zarr(new, **options)
        resume.to_zarr(new, group="resume", **options)
        return
    try:
        dataset.to_netcdf(new, engine="netcdf4")
        resume.to_netcdf(new, mode="a", group="resume", engine="netcdf4")
    except RuntimeError as error:  # the error of netCDF4 for a full disk
        raise OSError(errno.EIO, f"could not be written: {error}", os.fspath(new)) from error


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


def _read_dataset(path: PathLike, suffix: str) -> Entries:
    xarray, name = labelled.import_xarray(), os.path.abspath(path)
    options = {
        "engine": "zarr" if suffix == ".zarr" else "netcdf4",
        "mask_and_scale": False,
        "decode_times": False,
    }
    if suffix == ".zarr":
        refuse_codecs(name)
    with xarray.open_dataset(name, **options) as opened:
        read_header(opened.attrs)
        dataset = opened.load()
    with xarray.open_dataset(name, group="resume", **options) as opened:
        resume = {RESUME + str(name): each.values for name, each in opened.data_vars.items()}
    entries = labelled.entries_of_dataset(dataset) | resume
    if int(dataset.attrs.get("crc32", -1)) != _checksum(entries):
        raise ValueError("its checksum differs: the file was damaged or edited")
    return entries


def _checksum(entries: Entries) -> int:
    total = 0
    for name, array in sorted(entries.items()):
        plain = array.dtype.kind not in "iuf"
        data = str(array).encode() if plain else np.ascontiguousarray(array).data
        total = zlib.crc32(data, zlib.crc32(f"{name}{array.shape}".encode(), total))
    return total
