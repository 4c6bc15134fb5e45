"""Results as .npz files, without loss: saving and loading."""

import errno
import json
import os
import secrets
import shutil
import zipfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..bodies.systems import body_from_dict, class_named
from ..checks import kind_of, short, wrong
from ..maps import named
from .schema import ARGUMENTS, FORMAT, OF_KIND, Column, OtherFormat, sizes_of, value_of

PathLike = str | os.PathLike[str]


def save(result: Any, path: PathLike, overwrite: bool) -> None:
    """Write a result to a .npz file, which appears under its name when it is complete."""
    from .. import __version__

    others = "to_dataframe().to_csv(path) and to_xarray().to_netcdf(path) write other formats"
    target = Path(
        os.path.realpath(_checked(path, others))
    )  # a link stays, and its target is written
    if not isinstance(overwrite, bool):
        raise wrong("overwrite", "True or False", short(overwrite), TypeError)
    if target.exists() and not overwrite:
        raise _exists(path)
    kind, described = type(result).__name__, result.body.to_dict()
    about = {"format": FORMAT, "version": __version__, "kind": kind}
    map = vars(result).get("map")
    about |= {} if map is None else {"map": map.name}
    arguments = {name: getattr(result, name) for name in ARGUMENTS[kind]}
    is_array = {name: isinstance(value, np.ndarray) for name, value in arguments.items()}
    about |= {name: None if is_array[name] else value for name, value in arguments.items()}
    events = result if kind == "Events" else vars(result).get("events")
    if events is not None:
        about["events"] = [event.to_dict() for event in events.given]
    class_named(described["body"])  # raises an error for a class of the user
    names = *["eps"] * (map is not None), *(column.name for column in OF_KIND[kind])
    arrays = {name: value_of(result, name) for name in names}
    arrays = {
        name: array
        for name, array in arrays.items()
        if name == "eps" or isinstance(array, np.ndarray)
    }
    about["entries"] = [*arrays]  # some are optional, so that a lost one would not be missed
    arrays |= {"about": json.dumps(about), "body": json.dumps(described)}
    try:
        _write(target, arrays, overwrite)
    except FileExistsError as error:  # another process was faster
        raise _exists(path) from error
    except OSError as error:  # name the file of the caller, not the one beside it
        raise OSError(error.errno, error.strerror or str(error), os.fspath(path)) from error


def _exists(path: PathLike) -> FileExistsError:
    """Return the error of a file that exists."""
    message = "the file exists: choose a new name, or pass overwrite=True"
    return FileExistsError(errno.EEXIST, message, os.fspath(path))


def _write(target: Path, arrays: Mapping[str, Any], overwrite: bool) -> None:
    """Write a partial file in the folder of `target`, and rename it at the end."""
    part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        with open(part, "xb") as file:
            if overwrite:  # before writing, so that nobody can read who must not
                with suppress(FileNotFoundError):
                    shutil.copymode(target, part)
            np.savez(file, **arrays)
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


def load(path: PathLike) -> Any:
    """Return the result in a file of `save`; errors name the file.

    Only known entries are read; `zipfile` compares their checksums.
    """
    name = os.fspath(_checked(path, "xarray reads other formats"))
    with open(name, "rb") as file:
        try:
            with zipfile.ZipFile(file) as entries:
                about = json.loads(str(_entry(entries, "about")))
                if (number := about.get("format")) != FORMAT:
                    raise OtherFormat(number, about.get("version"))
                kind = checks.one_of("kind", about["kind"], OF_KIND)
                own = getattr(import_module("suslov_fast"), kind)
                return own._restored(_read(entries, kind, about), about)
        except MemoryError:
            raise
        except OtherFormat as error:
            raise ValueError(f"{name} is {error}") from None
        except Exception as error:  # from NumPy, json or zipfile, which seeks where bytes say
            raise ValueError(f"{name} is not a complete file of run.save: {error}") from error


def _read(entries: zipfile.ZipFile, kind: str, about: Any) -> dict[str, Any]:
    """Return the attributes of a result."""
    values = {name: about[name] for name in ARGUMENTS[kind]}
    # JSON has no tuples.
    attributes: dict[str, Any] = {
        k: tuple(value) if type(value) is list else value for k, value in values.items()
    }
    for column in OF_KIND[kind]:
        if column.name in about["entries"] or not column.when:
            attributes[column.name] = _entry(entries, column.name)
        else:
            attributes.setdefault(column.name, None)
    attributes["body"] = body_from_dict(json.loads(str(_entry(entries, "body"))))
    _check(OF_KIND[kind], attributes)
    if "eps" in about["entries"]:
        eps = _entry(entries, "eps")
        if not np.isfinite(eps).all():
            raise wrong("eps", "finite", short(eps.tolist()))
        attributes |= {"map": named(about["map"]), "eps": eps if eps.ndim else float(eps)}
    return attributes


def _check(columns: Iterable[Column], attributes: Mapping[str, Any]) -> None:
    """Raise an error unless arrays have the types and lengths that belong together."""
    sizes = dict(sizes_of(attributes["status"].shape, attributes["body"].dimension))
    for column in columns:
        array = attributes[column.name]
        if not isinstance(array, np.ndarray):
            continue
        expected: tuple[int, ...] = ()
        for axis in column.axes.split():  # the first column with an axis has its length
            expected += sizes.setdefault(axis, array.shape[len(expected) : len(expected) + 1])
        if array.shape != expected or array.dtype != column.type:
            received = f"{array.dtype} of shape {array.shape}"
            raise wrong(column.name, f"{column.type} of shape {expected}", received)
    if "time" in attributes and not np.isfinite(attributes["time"]).all():
        raise wrong("time", "finite", short(attributes["time"].tolist()))


def _entry(entries: zipfile.ZipFile, name: str) -> Any:
    """Return the array of an entry, C-contiguous and in native byte order."""
    entry = entries.getinfo(f"{name}.npy")
    with entries.open(entry) as file:
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
