"""Zarr stores of runs.

The metadata of a store are made in memory and copied, those of its root last: only then it is
there. The attributes of the root are the arguments of the run. Chunks have checksums; a tile of the
batch is done when its chunk of `status` is there.
"""

from __future__ import annotations

import errno
import hashlib
import inspect
import math
import os
import re
import shutil
import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import real_array, wrong
from ..engine.memory import require
from ..maps import Map
from .trajectories import Trajectories

# Version of this format, and the status of trajectories that are not computed.
FORMAT, PENDING = 6, -128
# Arguments with at most so many numbers are attributes as they are; so many are read at a time.
_FEW, _READ = 1000, 2**21


def resolved(store: Any) -> Any:
    """Return a store that other processes can open: folders as absolute paths."""
    if store is None or isinstance(store, (int, float, bytes)):
        raise wrong("store", "the name of a folder, a URL or a Zarr store", repr(store), TypeError)
    if missing := [each for each in ("dask", "xarray", "zarr") if find_spec(each) is None]:
        install = "pip install '.[large]' in a copy of the repository"
        raise ImportError(f"expected {', '.join(missing)}, got none: {install}")
    is_folder = isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store)
    return os.path.abspath(store) if is_folder else store


def described(name: str, array: Any, most: int = _FEW) -> Any:
    """Return numbers as they are, and many by their shape, range and digest."""
    if math.prod(array.shape) <= most:
        return np.asarray(array).tolist()
    digest, low, high = hashlib.sha256(), np.inf, -np.inf
    step = max(1, _READ // math.prod(array.shape[1:]))
    for k in range(0, len(array), step):
        part = real_array(name, np.asarray(array[k : k + step]), allow_nan=True)
        low, high = np.fmin(low, np.nanmin(part)), np.fmax(high, np.nanmax(part))
        digest.update(np.ascontiguousarray(part).data)
    return f"{_range(array.shape, low, high)}, sha256 {digest.hexdigest()}"


def named(texts: dict[str, str]) -> str | None:
    """Return names, and a digest of what they stand for."""
    digest = hashlib.sha256(repr(sorted(texts.items())).encode()).hexdigest()
    return f"{', '.join(texts)}, sha256 {digest}" if texts else None


def source_of(name: str, function: Any) -> str:
    """Return the source text of a function."""
    try:
        return inspect.getsource(function)
    except (TypeError, OSError) as error:
        expected = "functions whose Python source can be read"
        raise wrong("functions", expected, f"{name}: {function!r}", TypeError) from error


def _range(shape: tuple[int, ...], low: Any, high: Any) -> str:
    size = math.prod(shape)
    form = "" if size in shape else f" of shape {shape}"
    return f"{size} values{form} from {low:g} to {high:g}"


def _words(value: Any) -> str:
    """Return an attribute as users read it, without its digest."""
    array = np.asarray(value)
    if array.ndim and array.size and array.dtype.kind in "iuf":
        return _range(array.shape, array.min(), array.max())
    return str(value).partition(", sha256")[0]


def _differences(asked: dict[str, Any], stored: dict[str, Any]) -> str:
    """Return in words how the arguments of two runs differ."""
    texts = []
    for name in dict.fromkeys([*asked, *stored]):
        if name != "version" and asked.get(name) != stored.get(name):
            ours, theirs = _words(asked.get(name)), _words(stored.get(name))
            texts.append(f"{name}: {ours}, the store has {'others' if ours == theirs else theirs}")
    return "; ".join(texts)


def attributes(store: Any) -> dict[str, Any]:
    """Return the attributes of a store, {} if there is none; ValueError if it is no run's."""
    import zarr

    try:
        found = dict(zarr.open_group(store, mode="r", use_consolidated=False).attrs)
    except FileNotFoundError:
        return {}
    except (ValueError, TypeError, KeyError) as error:
        raise wrong("store", "undamaged metadata", f"{store}: {error}") from error
    if found and found.get("format") != FORMAT:
        version = found.get("version") or found.get("source")
        of = f"a run of suslov_fast {version}: compute it anew" if version else "other data"
        raise wrong("store", f"a store of ensemble in format {FORMAT}", f"{store} with {of}")
    return found


def template(
    map: Map, run: dict[str, Any], batch: tuple[int, ...], functions: Any, dims: Any, coords: Any
) -> Any:
    """Return the dataset of a run, with its arguments as attributes and nothing computed."""
    from dask.array import full

    body, every = run["body"], run["save_every"]
    rows, D = 1 if every is None else run["steps"] // every + 1, body.dimension

    require(8 * rows, "raise save_every")

    def nothing(*shape: int, value: float = np.nan, kind: Any = np.float64) -> Any:
        return full(shape, value, dtype=kind, chunks=-1)

    turns = None if run["attitude"] is False else nothing(rows, *batch, D + 1, D + 1)
    empty = Trajectories(
        states=nothing(rows, *batch, D),
        final=nothing(*batch, D),
        status=nothing(*batch, value=PENDING, kind=np.int8),
        failed_at=nothing(*batch, value=PENDING, kind=np.int64),
        body=body,
        eps=run["eps"],
        attitude=turns,
        method=run["method"],
        steps=run["steps"],
        save_every=every,
        _map=map,
    )
    data = empty.to_xarray(dims, coords).drop_vars("time")
    if taken := functions.keys() & {*data.variables, "time"}:
        raise wrong("functions", "names that the dataset does not have", ", ".join(taken))
    sources = {name: source_of(name, each) for name, each in functions.items()}
    for name, function in functions.items():
        values_of(name, function, np.full((3, D), 0.5))  # an error comes before anything is stored
        data[name] = (("n", *data.status.dims), nothing(rows, *batch))
    for name, variable in data.variables.items():
        if not re.fullmatch(r"(?!__)[^/]*[^/.][^/]*(?<!zarr\.json)", str(name)):
            raise wrong("dims, coords and functions", "names of folders", repr(name))
        if name in data.coords:  # Zarr has strings of variable length
            kind = object if variable.dtype.kind == "U" else variable.dtype
            data[name] = variable.load().astype(kind)
    numbers = {**body._arrays, **body._coordinates, "eps": np.asarray(run["eps"])}
    if run["attitude"] is not False:
        numbers["attitude"] = run["attitude"]
    about: dict[str, Any] = {name: described(name, each) for name, each in numbers.items()}
    starts = run["omega0"]
    about["omega0"] = described("omega0", starts, 0) if hasattr(starts, "ndim") else repr(starts)
    about |= {"steps": run["steps"], "save_every": every, "method": run["method"]}
    about |= {"dims": ", ".join(data.status.dims), "body": type(body).__name__, "format": FORMAT}
    about["coords"] = named({str(name): repr(data[name].values) for name in coords or ()})
    about["functions"] = named(sources)
    return data.assign_attrs({name: each for name, each in about.items() if each is not None})


def prepare(store: Any, template: Any, sizes: dict[str, int]) -> None:
    """Create the store of a run, or check that it holds this run."""
    stored = attributes(store)
    if stored and (text := _differences(template.attrs, stored)):
        received = f"{store} of another run: {text}"
        raise wrong("store", "a new name, or the store of this run", received)
    folder = Path(store) if isinstance(store, str) and "://" not in store else None
    try:
        if folder is not None:
            _check_folder(folder, template)
        if not stored:
            _copy(_made(template, sizes), store)
    except OSError as error:
        text = f"store: expected a place that can be written to, got {error.strerror or error}"
        raise type(error)(error.errno, text, store) from error


def _check_folder(folder: Path, template: Any) -> None:
    """Raise an error if a folder holds other data, or its disk has no space for what is missing."""
    known = {"zarr.json", *map(str, template.variables)}
    if folder.exists() and (others := {each.name for each in folder.iterdir()} - known):
        raise wrong("store", "a new name or a store", f"{folder} with {min(others)} in it")
    there = sum(each.stat().st_size for each in folder.rglob("*") if each.is_file())
    needed, parents = template.nbytes - there, (folder, *folder.parents)
    free = shutil.disk_usage(next(each for each in parents if each.exists())).free
    if needed > free:
        what = f"{free:,} bytes, fewer than the {needed:,} of the run: raise save_every"
        raise OSError(errno.ENOSPC, what, str(folder))


def _made(data: Any, sizes: dict[str, int]) -> dict[str, Any]:
    """Return the contents of the store of a dataset, by their keys."""
    from zarr.codecs import Crc32cCodec
    from zarr.storage import MemoryStore

    contents: dict[str, Any] = {}
    encoding: dict[Any, dict[str, Any]] = {}
    for name, variable in data.variables.items():
        encoding[name] = {"compressors": [Crc32cCodec()]}
        if variable.dtype.kind == "f":
            encoding[name] |= {"fill_value": np.nan, "_FillValue": None}
        if hasattr(variable.data, "dask"):
            lengths = variable.sizes.items()
            encoding[name]["chunks"] = tuple(sizes.get(dim, max(n, 1)) for dim, n in lengths)
    for name in ("status", "failed_at"):
        encoding[name]["fill_value"] = PENDING
    options: dict[str, Any] = {"zarr_format": 3, "consolidated": True, "safe_chunks": False}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # consolidated metadata extend the format
        try:
            data.to_zarr(MemoryStore(contents), compute=False, encoding=encoding, **options)
        except (ValueError, TypeError) as error:
            raise wrong("dims, coords", "names and values that Zarr can store", error) from error
    return contents


def _copy(contents: dict[str, Any], store: Any) -> None:
    """Copy the contents of a store, the metadata of its root last."""
    import zarr
    from zarr.core.sync import sync

    root = zarr.open_group(store, mode="a", zarr_format=3, use_consolidated=False).store_path
    for key in sorted(contents, key="zarr.json".__eq__):
        sync((root / key).set(contents[key]))


def arrays(store: Any) -> dict[str, Any]:
    """Return the arrays of a store, by name, for writing."""
    import zarr

    with zarr.config.set({"array.write_empty_chunks": True}):  # to look for them takes time
        return dict(zarr.open_group(store, mode="r+", use_consolidated=True).arrays())


def is_done(status: Any, where: Any) -> bool:
    """Return True if a tile is computed."""
    try:
        return bool((np.asarray(status[where]) != PENDING).all())
    except ValueError as error:
        raise wrong("store", "undamaged chunks", f"status at {where}: {error}") from error


def values_of(name: str, function: Any, points: Any) -> Any:
    """Return the values of a function of states."""
    values = np.asarray(function(points))
    if values.shape != points.shape[:-1] or values.dtype.kind not in "buif":
        received = f"{name} with {values.dtype} {values.shape} for states {points.shape}"
        raise wrong("functions", "real values (...) for states (..., D)", received)
    return values


def dataset(store: Any) -> Any:
    """Return the dataset of a store, lazy."""
    import xarray

    if not attributes(store):
        raise wrong("store", "a store of ensemble", f"none at {store}", FileNotFoundError)
    try:
        data = xarray.open_zarr(store, consolidated=True, chunks={})
    except ValueError as error:
        raise wrong("store", "undamaged data", f"{store}: {error}") from error
    return data.assign_coords(time=data.n * data.eps)
