"""Results as .npz files, without loss: saving, loading, and checks of what is read."""

import errno
import io
import json
import math
import os
import secrets
import shutil
import time
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np

from ... import checks
from ...bodies.classes import body_from_dict, class_named
from ...checks import (
    common_shape,
    in_units,
    integer,
    kind_of,
    require,
    short,
    wrong,
)
from ...maps import map_of, named
from ..columns import (
    ARGUMENTS,
    FORMAT,
    OF_KIND,
    Column,
    OtherFormat,
    arrays_of,
    check_arrays,
    present,
    sizes_of,
)

PathLike = str | os.PathLike[str]

# Numbers and texts of results: their arguments, and of crossings the number of states so far.
_NUMBERS = ARGUMENTS | {"Crossings": (*ARGUMENTS["Crossings"], "_n")}
_ROOM = "make room, or raise save_every"
_TEXTS = "about", "body"
_OF_MAPS = "Trajectories", "Crossings"
# Largest sizes in bytes: of the header of an entry, of the text `about`, and of the text `body`,
# which may be larger if its compressed size is at least 1/64: JSON is never compressed so much.
_MOST_HEADER, _MOST_ABOUT, _MOST_BODY, _RATIO = 2**14, 2**20, 2**24, 64


def save(result: Any, path: PathLike, overwrite: bool) -> None:
    """Write a result to a .npz file, which appears under its name when it is complete."""
    from ... import __version__

    others = "to_xarray().to_netcdf(path) and ensemble(store=...) write other formats"
    target = Path(
        os.path.realpath(_checked(path, others))
    )  # a link stays, and its target is written
    if not isinstance(overwrite, bool):
        raise wrong("overwrite", "True or False", short(overwrite), TypeError)
    if target.exists() and not overwrite:
        raise _exists(path)
    kind, described = type(result).__name__, result.body.to_dict()
    if kind in _OF_MAPS and result._carry is None:
        raise ValueError(
            "save: this is a part or a copy of a result: save the result of the run itself"
        )
    about = {"format": FORMAT, "version": __version__, "kind": kind}
    about |= {"map": result.map.name} if kind in _OF_MAPS else {}
    about |= {name: getattr(result, name) for name in _NUMBERS[kind]}
    if class_named(described["body"]) is not type(result.body):
        raise wrong("body", "a class whose name no other one has", described["body"], TypeError)
    names = *["eps"] * (kind in _OF_MAPS), *(column.name for column in OF_KIND[kind])
    arrays = {name: getattr(result, name, None) for name in names}
    arrays = {name: array for name, array in arrays.items() if array is not None}
    arrays |= {"about": json.dumps(about), "body": json.dumps(described)}
    try:
        _write(target, arrays, overwrite)
    except FileExistsError as error:  # another process was faster
        raise _exists(path) from error
    except OSError as error:  # name the file of the caller, not the one beside it
        why = _why_not(error, target, sum(np.asarray(a).nbytes for a in arrays.values()))
        raise OSError(error.errno, why, os.fspath(path)) from error


def _why_not(error: OSError, target: Path, nbytes: int) -> str:
    """Return why a file of a size was not written, and what to do."""
    if error.errno == errno.EDQUOT:
        return f"the disk quota is used up, the file takes {in_units(nbytes)}: {_ROOM}"
    if error.errno == errno.ENOSPC:
        sizes = in_units(shutil.disk_usage(target.parent).free), in_units(nbytes)
        return f"{sizes[0]} are free, the file takes {sizes[1]}: {_ROOM}"
    if os.name == "nt" and isinstance(error, PermissionError) and target.exists():
        return "a program reads the file: close what has it open"  # Windows replaces no such file
    return error.strerror or str(error)


def _exists(path: PathLike) -> FileExistsError:
    """Return the error of a file that exists."""
    message = "the file exists: choose a new name, or pass overwrite=True"
    return FileExistsError(errno.EEXIST, message, os.fspath(path))


def _write(target: Path, arrays: Mapping[str, Any], overwrite: bool) -> None:
    """Write a partial file beside `target`, and rename it at the end."""
    part, file = _partial(target)
    try:
        with file:  # locked until it is closed
            if overwrite:  # before writing, so that nobody can read who must not
                with suppress(FileNotFoundError):
                    shutil.copymode(target, part)
            np.savez(file, **arrays)
            if os.name == "nt":  # Windows renames no open file
                file.close()
            if overwrite:
                os.replace(part, target)
            else:
                _rename(part, target)
    finally:
        part.unlink(missing_ok=True)


def _rename(part: Path, target: Path) -> None:
    """Give a file a new name; FileExistsError in all but one of several processes at once."""
    try:
        os.link(part, target)
    except FileExistsError:
        raise
    except (AttributeError, OSError):  # without hard links, an empty file reserves the name
        open(target, "xb").close()
        os.replace(part, target)


def _partial(target: Path) -> tuple[Path, Any]:
    """Return a new file beside `target`, locked; delete those that killed processes left there.

    The files of living processes are locked. Windows has no such locks, but deletes no open file;
    processes close theirs just before they rename it, so those younger than a minute stay there.
    """
    for left in target.parent.glob(f".{escape(target.name)}.*.part"):
        with suppress(OSError):
            if os.name != "nt":
                with open(left, "rb+") as old:
                    _lock(old)
                    left.unlink()
            elif time.time() - left.stat().st_mtime > 60.0:
                left.unlink()
    while True:
        part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
        file = open(part, "xb")  # noqa: SIM115  (closed by the caller)
        with suppress(BlockingIOError):
            _lock(file)
            if part.exists():  # another process may have deleted it before the lock
                return part, file
        file.close()


def _lock(file: Any) -> None:
    """Lock a file until it is closed; BlockingIOError if another process has the lock."""
    with suppress(ImportError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def load(path: PathLike, *kinds: str) -> dict[str, Any]:
    """Return the attributes of the result in a file of `save`.

    `kinds` are names of classes to accept; without them any is, and the attributes have its `kind`.
    Only known entries are read, and arrays only if their types and shapes are right. Errors name
    the file.
    """
    name = os.fspath(_checked(path, "open_ensemble reads a store"))
    writers = " or ".join(f"{kind}.save" for kind in kinds or OF_KIND)
    try:
        with open(name, "rb") as file, zipfile.ZipFile(file) as entries:
            about, texts = _about(entries)
            kind = checks.one_of("kind", about["kind"], OF_KIND)
            if not kinds or kind in kinds:
                found = _read(entries, kind, about, texts["body"])
                return found | ({} if kinds else {"kind": kind})
    except (OSError, MemoryError):
        raise
    except OtherFormat as error:
        raise ValueError(f"{name} is {error}") from None
    except Exception as error:  # from NumPy, zipfile or json
        text = f"it has no entry {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{name} is not a complete file of {writers}: {text}") from error
    raise ValueError(f"{name} is a file of {kind}.save: load it by {kind}.load")


def _about(entries: zipfile.ZipFile) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the description of a file (format, kind, map, numbers), and all its texts."""
    texts = {name: _text(entries, name) for name in _TEXTS if _header(entries, name) is not None}
    about = json.loads(texts.get("about", "{}"))
    if (number := about.get("format", FORMAT)) != FORMAT:
        raise OtherFormat(number, about.get("version"))
    return about, texts


def _read(entries: zipfile.ZipFile, kind: str, about: Any, body_text: str) -> dict[str, Any]:
    """Return the attributes of a result; all shapes follow from that of `status` and few others."""
    table, is_of_map = OF_KIND[kind], kind in _OF_MAPS
    names = [*["eps"] * is_of_map, *(column.name for column in table)]
    all_headers = {name: _header(entries, name) for name in names}
    headers = {name: header for name, header in all_headers.items() if header is not None}
    attributes: dict[str, Any] = dict.fromkeys(names)
    attributes |= {name: about[name] for name in _NUMBERS[kind]}
    body, batch = body_from_dict(json.loads(body_text)), headers["status"][1]
    shapes, lengths = {"body": body.shape, "status": batch}, {}
    if is_of_map:
        map, method = named(about["map"]), about["method"]
        if map_of(body, method) is not map:
            raise wrong("map", f"one of {type(body).__name__} and its method", repr(map.name))
        attributes["map"], lengths["carried"] = map, map.methods[method].carried
        shapes["eps"] = headers["eps"][1]
    if kind == "Trajectories":
        lengths["n"] = _rows_of_run(about["steps"], about["save_every"])
    for column in table:  # the first that has an axis tells its length
        if column.name in headers:
            lengths = _lengths_of(column, headers[column.name][1], len(batch)) | lengths
    if common_shape(shapes) != batch:
        raise wrong("status", f"have the shape {common_shape(shapes)}", batch)
    conditions = {column.when for column in table if column.name in headers}
    sizes = {**{axis: (n,) for axis, n in lengths.items()}, **sizes_of(batch, body.dimension)}
    expected = arrays_of(present(table, conditions), sizes)
    if is_of_map:
        expected["eps"] = "float64", headers["eps"][1]  # of any shape that broadcasts to the batch
    check_arrays(headers, expected)
    attributes |= {name: _entry(entries, name) for name in expected} | {"body": body}
    if is_of_map and attributes["eps"].ndim == 0:
        attributes["eps"] = float(attributes["eps"])
    if "count" in attributes:  # of crossings
        count = attributes["count"].ravel()
        if count.sum() != lengths["crossing"]:
            raise wrong("count", f"have the sum {lengths['crossing']}", count.sum())
        attributes["trajectory"] = np.repeat(np.arange(len(count)), count)
    # JSON has no tuples.
    return {name: tuple(a) if type(a) is list else a for name, a in attributes.items()}


def _lengths_of(column: Column, shape: tuple[int, ...], axes: int) -> dict[str, int]:
    """Return the lengths of the axes of an array, but for those of the batch, `axes`."""
    before, _, after = column.axes.partition("batch")
    names = before.split(), after.split()
    if len(shape) != len(names[0]) + len(names[1]) + axes * ("batch" in column.axes):
        return {}  # `check_arrays` says what is wrong
    ends = zip(names[0], shape, strict=False), zip(names[1][::-1], shape[::-1], strict=False)
    return dict(ends[0]) | dict(ends[1])


def _rows_of_run(steps: Any, every: Any) -> int:
    """Return the number of saved states, after checks of the numbers of a run."""
    steps = integer("steps", steps, 0)
    return 1 if every is None else steps // integer("save_every", every, 1) + 1


def _header(entries: zipfile.ZipFile, name: str) -> tuple[str, tuple[int, ...]] | None:
    """Return the type and the shape in the header of an entry; None if there is no entry.

    ValueError if the size of the entry is not that of its header and its numbers.
    """
    try:
        entry = entries.getinfo(f"{name}.npy")
    except KeyError:
        return None
    with entries.open(entry) as file:
        head = io.BytesIO(file.read(_MOST_HEADER))
    read = np.lib.format.read_array_header_1_0
    if np.lib.format.read_magic(head) != (1, 0):
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(head)
    size = head.tell() + dtype.itemsize * math.prod(shape)
    if entry.file_size != size:
        raise wrong(name, f"{size:,} bytes, as its header says", f"{entry.file_size:,}")
    return dtype.newbyteorder("=").name, shape


def _text(entries: zipfile.ZipFile, name: str) -> str:
    """Return a text; ValueError if it is larger than a run makes it."""
    entry = entries.getinfo(f"{name}.npy")
    most = max(_MOST_BODY, _RATIO * entry.compress_size) if name == "body" else _MOST_ABOUT
    if entry.file_size > most:
        raise wrong(name, f"a text of at most {most:,} bytes", f"{entry.file_size:,} bytes")
    return str(_entry(entries, name))


def _entry(entries: zipfile.ZipFile, name: str) -> Any:
    """Return the array of an entry, C-contiguous and in native byte order."""
    entry = entries.getinfo(f"{name}.npy")
    if entry.file_size > max(_MOST_BODY, _RATIO * entry.compress_size):  # `save` compresses nothing
        received = f"{entry.file_size:,} bytes from {entry.compress_size:,}"
        raise wrong(name, f"an array compressed at most {_RATIO} times", received)
    require(entry.file_size, "this file needs as many")
    with entries.open(f"{name}.npy") as file:
        array = np.lib.format.read_array(file)
    return np.asarray(array, array.dtype.newbyteorder("="), order="C")


def _checked(path: PathLike, others: str) -> Path:
    """Return the path of a .npz file, checked; `others` is advice on other formats."""
    if not isinstance(path, (str, os.PathLike)):
        raise wrong("path", "a string or a path", kind_of(path), TypeError)
    if Path(path).suffix.lower() != ".npz":
        how = "" if Path(path).suffix or Path(path).is_dir() else f": pass '{path}.npz'"
        raise wrong("path", f"a name that ends in .npz ({others})", f"'{os.fspath(path)}'{how}")
    return Path(path).expanduser()
