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

from .. import checks
from ..bodies.classes import body_from_dict, class_named
from ..checks import MOMENTS, common_shape, integer, real_array, require, within, wrong
from ..engine.status import Status
from ..maps import map_of, named

PathLike = str | os.PathLike[str]

FORMAT = 10
# What files of each kind of result have: arrays, some of which may lack, and numbers.
_OF_ALL = "eps", "status", "failed_at", "final", "_carry"
_ARRAYS = {
    "Trajectories": (*_OF_ALL, "states", "attitude", "_turned"),
    "Crossings": (*_OF_ALL, "n", "before", "after", "fraction", "count", "_last"),
}
_NUMBERS = {
    "Trajectories": ("method", "steps", "save_every"),
    "Crossings": ("method", "steps", "transient", "direction", "most", "_n"),
}
_TEXTS, _OLD = ("about", "body"), ("format", "version")  # the latter in files of 0.5
# Bytes of the header of an entry; of the text `about`; of any text that is compressed, which
# JSON never is to 1/64.
_HEADER, _ABOUT, _TEXT, _RATIO = 2**14, 2**20, 2**24, 64


def save(result: Any, path: PathLike, overwrite: bool) -> None:
    """Write a result to a .npz file, which appears under its name when it is complete."""
    from .. import __version__

    target = Path(os.path.realpath(_checked(path)))  # of a link the file that it names
    if target.exists() and not overwrite:
        raise _exists(path)
    kind, described = type(result).__name__, result.body.to_dict()
    if result._carry is None:
        raise ValueError(
            "save: this is a part or a copy of a result: save the result of the run itself"
        )
    about = {"format": FORMAT, "version": __version__, "kind": kind, "map": result.map.name}
    about |= {name: getattr(result, name) for name in _NUMBERS[kind]}
    if class_named(described["body"]) is not type(result.body):
        raise wrong("body", "a class whose name no other one has", described["body"], TypeError)
    arrays = {name: getattr(result, name) for name in _ARRAYS[kind]}
    arrays = {name: each for name, each in arrays.items() if each is not None}
    arrays |= {"about": json.dumps(about), "body": json.dumps(described)}
    try:
        _write(target, arrays, overwrite)
    except FileExistsError as error:  # another call was faster
        raise _exists(path) from error
    except OSError as error:  # it names the new file, which the caller does not know
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error


def _exists(path: PathLike) -> FileExistsError:
    message = "the file exists: choose a new name, or pass overwrite=True"
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
    except (AttributeError, OSError):  # there are no links: an empty file takes the name
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


def load(path: PathLike, *kinds: str) -> dict[str, Any]:
    """Return the attributes of the result in a file of `save`, with its kind, if this is not given.

    Only entries that such a result has are read, and arrays only if their types and shapes are
    right. Errors name the file.
    """
    name = os.fspath(_checked(path))
    writers = " or ".join(f"{kind}.save" for kind in kinds or _ARRAYS)
    try:
        with open(name, "rb") as file, zipfile.ZipFile(file) as entries:
            about, texts = _about(entries)
            kind = checks.one_of("kind", about["kind"], _ARRAYS)
            if not kinds or kind in kinds:
                return _read(entries, kind, about, texts["body"]) | (
                    {} if kinds else {"kind": kind}
                )
    except (OSError, MemoryError):
        raise
    except Exception as error:  # from NumPy, zipfile or json
        raise ValueError(f"{name} is no whole file of {writers}: {error}") from error
    raise ValueError(f"{name} is a file of {kind}.save: load it by {kind}.load")


def _about(entries: zipfile.ZipFile) -> tuple[dict[str, Any], dict[str, str]]:
    """Return what a file says of itself, and its texts."""
    names = [name for name in (*_TEXTS, *_OLD) if _kind(entries, name) is not None]
    texts = {name: _text(entries, name) for name in names}
    about = json.loads(texts.get("about", "{}"))
    version = about.get("version", texts.get("version"))
    if about.get("format", texts.get("format", FORMAT)) != FORMAT:
        how = f"one of suslov_fast {version}: compute it again"
        raise wrong("format", f"{FORMAT}, that of this version", how)
    return about, texts


def _read(entries: zipfile.ZipFile, kind: str, about: Any, described: str) -> dict[str, Any]:
    kinds = {name: _kind(entries, name) for name in _ARRAYS[kind]}
    given = {name: each for name, each in kinds.items() if each is not None}
    numbers = {name: about[name] for name in _NUMBERS[kind]}
    body, map = body_from_dict(json.loads(described)), named(about["map"])
    if map_of(body, numbers["method"]) is not map:
        raise wrong("map", f"one of {type(body).__name__} and its method", repr(map.name))
    # All other shapes follow from that of `status`.
    batch, size = given["status"][1], math.prod(given["status"][1])
    arrays = _arrays_of_a_file if kind == "Trajectories" else _arrays_of_crossings
    expected = arrays(numbers, given, batch, body.dimension)
    expected["_carry"] = "float64", (map.methods[numbers["method"]].carried, size)
    if "eps" in given:  # it broadcasts to the batch
        expected["eps"] = "float64", given["eps"][1]
        shapes = {"body": body.shape, "eps": given["eps"][1], "status": batch}
        if common_shape(shapes) != batch:
            raise wrong("status", f"have the shape {common_shape(shapes)}", batch)
    check_arrays(given, expected)
    found: dict[str, Any] = dict.fromkeys(_ARRAYS[kind])
    found |= {name: _entry(entries, name) for name in expected} | numbers
    eps = within("eps", real_array("eps", found["eps"]), MOMENTS)
    _check_failures(found, numbers["steps"] if kind == "Trajectories" else numbers["_n"])
    if kind == "Trajectories":
        _check_states(found)
    else:
        found["trajectory"] = _check_crossings(found)
    return found | {"body": body, "map": map, "eps": float(eps) if eps.ndim == 0 else eps}


def _arrays_of_a_file(
    numbers: dict[str, Any], given: dict[str, Any], batch: tuple[int, ...], D: int
) -> dict[str, Any]:
    """Return the types and shapes of the arrays of a run in a file, after checks of its numbers."""
    steps, every = integer("steps", numbers["steps"], 0), numbers["save_every"]
    rows = 1 if every is None else steps // integer("save_every", every, 1) + 1
    turns = "attitude" in given or "_turned" in given
    found: dict[str, Any] = arrays_of_a_run("states", batch, rows, D, turns)
    return found | ({"_turned": ("float64", (math.prod(batch), D + 1, D + 1))} if turns else {})


def _arrays_of_crossings(
    numbers: dict[str, Any], given: dict[str, Any], batch: tuple[int, ...], D: int
) -> dict[str, Any]:
    """Return the types and shapes of the arrays of crossings, after checks of their numbers."""
    end = sum(integer(name, numbers[name], 0) for name in ("steps", "transient"))
    integer("direction", numbers["direction"], -1, "1, -1 or 0", 1)
    integer("_n", numbers["_n"], 0, f"an integer from 0 to {end}", end)
    if numbers["most"] is not None:
        integer("most", numbers["most"], 1)
    (K,) = given["n"][1]
    found: dict[str, Any] = arrays_of_a_run("states", batch, 0, D, False)
    del found["states"]
    found |= {"before": ("float64", (K, D)), "after": ("float64", (K, D))}
    found |= {"n": ("int64", (K,)), "fraction": ("float64", (K,)), "count": ("int64", batch)}
    return found | ({"_last": ("float64", (math.prod(batch),))} if "_last" in given else {})


def _check_failures(found: Mapping[str, Any], steps: int) -> None:
    """Check that statuses, `failed_at` and last states agree."""
    status, failed_at, failed = found["status"], found["failed_at"], found["status"] < 0
    if not np.isin(status, [*Status]).all():
        raise wrong("status", "have values of Status", "others")
    passed = status == Status.PASSED_POLE
    told, early = (failed_at >= 0) != (failed | passed), passed & (failed_at < 1)
    if ((failed_at < -1) | (failed_at > steps) | told | early).any():
        expected = f"a step up to {steps} where a trajectory failed or passed a pole, else -1"
        raise wrong("failed_at", expected, "others")
    if (np.isnan(found["final"]).any(axis=-1) != failed).any():
        raise wrong("final", "NaN where a trajectory failed, else numbers", "others")


def _check_states(run: Mapping[str, Any]) -> None:
    """Check that saved states agree with failures and last states."""
    states, final, failed_at = run["states"], run["final"], run["failed_at"]
    every, steps = run["save_every"], run["steps"]
    n = np.arange(len(states)) * every if every else np.array([steps])
    if n[-1] == steps and not np.array_equal(states[-1], final, equal_nan=True):
        raise wrong("final", f"the saved state {steps}", "another")
    gone = (run["status"] < 0) & (failed_at <= n.reshape(-1, *(1,) * failed_at.ndim))
    if (np.isnan(states[..., 0]) != gone).any():
        raise wrong("states", "NaN from the state failed_at on, and numbers before it", "others")


def _check_crossings(points: Mapping[str, Any]) -> Any:
    """Return the trajectory of each crossing, after checks that all arrays agree."""
    count, most, n = points["count"].ravel(), points["most"], points["n"]
    begin, end = points["transient"], min(points["_n"], points["transient"] + points["steps"])
    if (count < 0).any() or count.sum() != len(n) or (most and (count > most).any()):
        raise wrong("count", "the numbers of crossings of trajectories", "others")
    trajectory = np.repeat(np.arange(len(count)), count)
    if ((n < begin) | (n >= end)).any() or (np.diff(n)[np.diff(trajectory) == 0] <= 0).any():
        raise wrong("n", f"ascending steps from {begin} to {end - 1} of each trajectory", "others")
    fraction, after = points["fraction"], points["after"]
    if not ((fraction >= 0) & (fraction <= 1)).all():
        raise wrong("fraction", "numbers from 0 to 1", "others")
    if not np.isfinite([points["before"], after]).all():
        raise wrong("before and after", "finite states", "others")
    ended = np.flatnonzero(count == (most or -1))
    final = points["final"].reshape(len(count), -1)[ended]
    if not np.array_equal(final, after[np.cumsum(count)[ended] - 1]):
        raise wrong(
            "final", "have the state after the last crossing of trajectories that ended", "others"
        )
    return trajectory


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
            raise ValueError(f"{name} is missing: {kind} of shape {shape}")
        if given[name] != (kind, shape):
            raise wrong(name, f"{kind} of shape {shape}", "{} of shape {}".format(*given[name]))


def _checked(path: PathLike) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise wrong("path", "a string or a path", type(path).__name__, TypeError)
    if Path(path).suffix.lower() != ".npz":
        how = "to_xarray().to_netcdf(path) and ensemble(store=...) write other formats"
        raise wrong("path", f"a name that ends in .npz ({how})", repr(os.fspath(path)))
    return Path(path)
