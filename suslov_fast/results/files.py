"""Results as .npz files, without loss: saving and loading."""

import errno
import json
import os
import secrets
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..bodies.systems import body_from_dict, class_named
from ..checks import kind_of, short, wrong
from ..maps.map_records import named
from .schema import ARGUMENTS, FORMAT, OF_KIND, value_of

PathLike = str | os.PathLike[str]


def save(result: Any, path: PathLike, overwrite: bool) -> None:
    """Write a result to a .npz file, which appears under its name when it is complete."""
    from .. import __version__

    others = "to_dataframe().to_csv(path) and to_xarray().to_netcdf(path) write other formats"
    # A symbolic link stays, and the file that it leads to is written.
    target = Path(os.path.realpath(_checked(path, others)))
    if not isinstance(overwrite, bool):
        raise wrong("overwrite", "True or False", short(overwrite), TypeError)
    if target.exists() and not overwrite:
        message = "the file exists: choose a new name, or pass overwrite=True"
        raise FileExistsError(errno.EEXIST, message, os.fspath(path))
    kind, described = type(result).__name__, result.body.to_dict()
    about = {"format": FORMAT, "version": __version__, "kind": kind}
    map = vars(result).get("map")
    about |= {} if map is None else {"map": map.name}
    about |= {name: getattr(result, name) for name in ARGUMENTS[kind]}
    events = result if kind == "Events" else getattr(result, "events", None)
    if events is not None:
        about["events"] = [event.to_dict() for event in events.given]
    class_named(described["body"])  # raises an error for a class of the user
    names = *["eps"] * (map is not None), *(column.name for column in OF_KIND[kind])
    values = {name: value_of(result, name) for name in names}
    arrays = {k: a for k, a in values.items() if k == "eps" or isinstance(a, np.ndarray)}
    about["entries"] = [*arrays]  # so that `load` misses no column: some are optional
    arrays |= {"about": json.dumps(about), "body": json.dumps(described)}
    part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        with open(part, "xb") as file:
            np.savez(file, **arrays)
        os.replace(part, target)
    except OSError as error:  # the error names the file of the caller, not the temporary file
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error
    finally:
        part.unlink(missing_ok=True)


def load(path: PathLike) -> Any:
    """Return the result in a file of `save`; errors name the file."""
    name = os.fspath(_checked(path, "xarray.open_zarr(path).states reads a store"))
    with open(name, "rb") as file:
        try:
            with np.load(file) as entries:  # reads known entries only, and tests their checksums
                about = json.loads(str(entries["about"]))
                if (number := about.get("format")) != FORMAT:
                    version = about.get("version")
                    raise ValueError(f"format {number}, not {FORMAT}, of suslov_fast {version}")
                kind = checks.one_of("kind", about["kind"], OF_KIND)
                class_ = getattr(import_module("suslov_fast"), kind)
                return class_._restored(_read(entries, kind, about), about)
        except MemoryError:
            raise
        except Exception as error:  # NumPy, json and zipfile raise many kinds of errors
            raise ValueError(f"{name} is no complete file of this run.save: {error}") from error


def _read(entries: Any, kind: str, about: Any) -> dict[str, Any]:
    """Return the attributes of a result from the entries of its file."""
    values = {name: about[name] for name in ARGUMENTS[kind]}
    # JSON has no tuples.
    attributes: dict[str, Any] = {
        k: tuple(value) if type(value) is list else value for k, value in values.items()
    }
    for column in OF_KIND[kind]:
        if column.name in about["entries"] or not column.when:
            attributes[column.name] = entries[column.name]
        else:
            attributes.setdefault(column.name, None)
    attributes["body"] = body_from_dict(json.loads(str(entries["body"])))
    if "eps" in about["entries"]:
        eps = entries["eps"]
        attributes |= {"map": named(about["map"]), "eps": eps if eps.ndim else float(eps)}
    return attributes


def _checked(path: PathLike, others: str) -> Path:
    """Return the path of a .npz file, checked; `others` is advice on other formats."""
    if not isinstance(path, (str, os.PathLike)):
        raise wrong("path", "a string or a path", kind_of(path), TypeError)
    if Path(path).suffix.lower() != ".npz":
        how = "" if Path(path).suffix or Path(path).is_dir() else f": pass '{path}.npz'"
        raise wrong("path", f"a name that ends in .npz ({others})", f"'{os.fspath(path)}'{how}")
    return Path(path).expanduser()
