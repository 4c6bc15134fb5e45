"""Results as .npz files, without loss."""

import errno
import io
import json
import math
import os
import secrets
import shutil
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import MOMENTS, common_shape, integer, real_array, within, wrong
from ..engine.arguments import require
from ..engine.status import Status
from ..maps import body_from_dict, class_named, map_of, named

PathLike = str | os.PathLike[str]

FORMAT = 10
_ARRAYS = "states", "eps", "status", "failed_at", "final", "attitude", "_carry", "_turned"
_TEXTS, _OLD = ("about", "body"), ("format", "version")  # the latter in files of 0.5
_NUMBERS = "method", "steps", "save_every"
# Bytes of the header of an entry; of the text `about`; of any text that is compressed, which
# JSON never is to 1/64.
_HEADER, _ABOUT, _TEXT, _RATIO = 2**14, 2**20, 2**24, 64


def save(run: Any, path: PathLike, overwrite: bool) -> None:
    """Write a run to a .npz file, which appears under its name when it is complete."""
    from .. import __version__

    target = Path(os.path.realpath(_checked(path)))  # of a link the file that it names
    if target.exists() and not overwrite:
        raise _exists(path)
    about = {"format": FORMAT, "version": __version__}
    about |= {"map": run.map.name, **{name: getattr(run, name) for name in _NUMBERS}}
    described = run.body.to_dict()
    if class_named(described["body"]) is not type(run.body):
        raise wrong("body", "a class whose name no other one has", described["body"], TypeError)
    arrays = {name: getattr(run, name) for name in _ARRAYS if getattr(run, name) is not None}
    arrays |= {"about": json.dumps(about), "body": json.dumps(described)}
    try:
        _write(target, arrays, overwrite)
    except FileExistsError as error:  # another call was faster
        raise _exists(path) from error
    except OSError as error:  # it names the new file, which the caller does not know
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error


def _exists(path: PathLike) -> FileExistsError:
    message = "expected the name of a new file, or overwrite=True, got one that exists"
    return FileExistsError(errno.EEXIST, message, os.fspath(path))


def _write(target: Path, arrays: Mapping[str, Any], overwrite: bool) -> None:
    """Write a file beside `target`, and give it this name at the end."""
    new, file = _part(target)
    try:
        with file:  # which has a lock until it is closed
            if overwrite:  # before it has content that others may not read
                with suppress(FileNotFoundError):
                    shutil.copymode(target, new)
            np.savez(file, **arrays)
            file.flush()
            if os.name == "nt":  # which moves no file that is open
                file.close()
            if overwrite:
                os.replace(new, target)
            else:
                _name(new, target)
    finally:
        new.unlink(missing_ok=True)


def _name(new: Path, target: Path) -> None:
    """Give a file a name that no file has: of several calls at once all but one fail."""
    try:
        os.link(new, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links: an empty file takes the name
        open(target, "xb").close()
        os.replace(new, target)


def _part(target: Path) -> tuple[Path, Any]:
    """Return a new file beside `target`; delete those that killed processes left there.

    A process holds a lock on its own. Windows deletes no file that is open.
    """
    for left in target.parent.glob(f".{escape(target.name)}.*.part"):
        with suppress(OSError), open(left, "rb+") as old:
            _lock(old)
            left.unlink()
    while True:
        new = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
        file = open(new, "xb")  # noqa: SIM115  (closed by the caller)
        with suppress(BlockingIOError):
            _lock(file)
            if new.exists():  # else another call deleted it, before the lock
                return new, file
        file.close()


def _lock(file: Any) -> None:
    """Lock a file until it is closed; BlockingIOError if another one has the lock."""
    with suppress(ImportError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def load(path: PathLike) -> dict[str, Any]:
    """Return the attributes of the run in a file of `save`; errors name the file.

    Only entries that a run has are read, and arrays only if their types and shapes are right.
    """
    name = os.fspath(_checked(path))
    try:
        with open(name, "rb") as file, zipfile.ZipFile(file) as entries:
            return _read(entries)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # from NumPy, zipfile or json
        expected = "a file that Trajectories.save wrote"
        raise wrong(name, expected, f"another, or a damaged one: {error}") from error


def _read(entries: zipfile.ZipFile) -> dict[str, Any]:
    kinds = {name: _kind(entries, name) for name in (*_ARRAYS, *_TEXTS, *_OLD)}
    given = {name: kind for name, kind in kinds.items() if kind is not None}
    texts = {name: _text(entries, name) for name in (*_TEXTS, *_OLD) if name in given}
    about = json.loads(texts.get("about", "{}"))
    version = about.get("version", texts.get("version"))
    if about.get("format", texts.get("format", FORMAT)) != FORMAT:
        how = f"one of suslov_fast {version}: compute the run again"
        raise wrong("format", f"{FORMAT}, that of this version", how)
    method, steps, every = (about[name] for name in _NUMBERS)
    integer("steps", steps, 0)
    rows = 1 if every is None else steps // integer("save_every", every, 1) + 1
    body, map = body_from_dict(json.loads(texts["body"])), named(about["map"])
    if map_of(body, method) is not map:
        raise wrong("map", f"one of {type(body).__name__} and its method", repr(map.name))
    # All other shapes follow from that of `status`.
    batch, D = given["status"][1], body.dimension
    size, turns = math.prod(batch), "attitude" in given or "_turned" in given
    expected = arrays_of_a_run("states", batch, rows, D, turns)
    expected["_carry"] = "float64", (map.methods[method].carried, size)
    if turns:
        expected["_turned"] = "float64", (size, D + 1, D + 1)
    if "eps" in given:  # it broadcasts to the batch
        expected["eps"] = "float64", given["eps"][1]
        shapes = {"body": body.shape, "eps": given["eps"][1], "status": batch}
        if common_shape(shapes) != batch:
            raise wrong("status", f"shape {common_shape(shapes)}", batch)
    check_arrays({name: given[name] for name in given if name in _ARRAYS}, expected)
    run: dict[str, Any] = dict.fromkeys(_ARRAYS)
    run |= {name: _entry(entries, name) for name in expected}
    eps = within("eps", real_array("eps", run["eps"]), MOMENTS)
    n = np.arange(rows) * every if every else np.array([steps])
    _check_failures(run, steps)
    _check_states(run, n, steps)
    run |= {"body": body, "map": map, "eps": float(eps) if eps.ndim == 0 else eps}
    return run | {"method": method, "steps": steps, "save_every": every}


def _check_failures(run: Mapping[str, Any], steps: int) -> None:
    """Check that statuses, `failed_at` and last states agree."""
    status, failed_at, failed = run["status"], run["failed_at"], run["status"] < 0
    if not np.isin(status, [*Status]).all():
        raise wrong("status", "values of Status", "others")
    if ((failed_at < -1) | (failed_at > steps) | ((failed_at >= 0) != failed)).any():
        expected = f"a step from 0 to {steps} where a trajectory failed, else -1"
        raise wrong("failed_at", expected, "others")
    if (np.isnan(run["final"]).any(axis=-1) != failed).any():
        raise wrong("final", "NaN where a trajectory failed, else numbers", "others")


def _check_states(run: Mapping[str, Any], n: Any, steps: int) -> None:
    """Check that saved states, at the steps n, agree with failures and last states."""
    states, final, failed_at = run["states"], run["final"], run["failed_at"]
    if n[-1] == steps and not np.array_equal(states[-1], final, equal_nan=True):
        raise wrong("final", f"the saved state {steps}", "another")
    n = n.reshape(-1, *(1,) * failed_at.ndim)
    gone = (run["status"] < 0) & (failed_at <= n)
    if (np.isnan(states[..., 0]) != gone).any():
        raise wrong("states", "NaN from the state failed_at on, and numbers before it", "others")


def _kind(entries: zipfile.ZipFile, name: str) -> tuple[str, tuple[int, ...]] | None:
    """Return type and shape of an entry, without its numbers; None if there is none.

    Its size is that of its header and its numbers, or it is an error.
    """
    try:
        about = entries.getinfo(f"{name}.npy")
    except KeyError:
        return None
    with entries.open(about) as file:
        head = io.BytesIO(file.read(_HEADER))
    read = np.lib.format.read_array_header_1_0
    if np.lib.format.read_magic(head) != (1, 0):
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(head)
    size = head.tell() + dtype.itemsize * math.prod(shape)
    if about.file_size != size:
        raise wrong(name, f"{size:,} bytes, as its header says", f"{about.file_size:,}")
    return dtype.newbyteorder("=").name, shape


def _text(entries: zipfile.ZipFile, name: str) -> str:
    """Return a text, unless it is larger than those of runs are."""
    about = entries.getinfo(f"{name}.npy")
    most = max(_TEXT, _RATIO * about.compress_size) if name == "body" else _ABOUT
    if about.file_size > most:
        raise wrong(name, f"a text of at most {most:,} bytes", f"{about.file_size:,} bytes")
    return str(_entry(entries, name))


def _entry(entries: zipfile.ZipFile, name: str) -> Any:
    """Return the array of an entry, in native and contiguous memory."""
    require(entries.getinfo(f"{name}.npy").file_size, "this file needs as many")
    with entries.open(f"{name}.npy") as file:
        array = np.lib.format.read_array(file)
    return np.asarray(array, array.dtype.newbyteorder("="), order="C")


def arrays_of_a_run(
    states: str, batch: tuple[int, ...], rows: int, D: int, turns: bool
) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Return the types and shapes of the arrays of a run, whose states have the name `states`."""
    found: dict[str, tuple[str, tuple[int, ...]]] = {
        states: ("float64", (rows, *batch, D)),
        "final": ("float64", (*batch, D)),
        "status": ("int8", batch),
        "failed_at": ("int64", batch),
    }
    if turns:
        found["attitude"] = "float64", (rows, *batch, D + 1, D + 1)
    return found


def check_arrays(given: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Check types and shapes of the arrays of a file or a store, by name."""
    for name, (kind, shape) in expected.items():
        if name not in given:
            raise wrong(name, f"{kind} of shape {shape}", "none")
        if given[name] != (kind, shape):
            raise wrong(name, f"{kind} of shape {shape}", "{} of shape {}".format(*given[name]))


def _checked(path: PathLike) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise wrong("path", "a string or a path", type(path).__name__, TypeError)
    if Path(path).suffix.lower() != ".npz":
        how = "to_xarray().to_netcdf(path) and ensemble(store=...) write other formats"
        raise wrong("path", f"a name that ends in .npz ({how})", repr(os.fspath(path)))
    return Path(path)
