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
_RESULTS = ("final", "status", "failed_at", "attitude")


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
        if name not in ("version", "coordinates") and asked.get(name) != stored.get(name):
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
    record: Map, run: dict[str, Any], batch: tuple[int, ...], functions: Any, dims: Any, coords: Any
) -> Any:
    """Return the dataset of a run, with its arguments as attributes and nothing computed."""
    body, every, turns = run["body"], run["save_every"], run["attitude"]
    rows, D = 1 if every is None else run["steps"] // every + 1, body.dimension
    require(8 * rows, "raise save_every")
    whole, pending = (rows, *batch), np.int8(PENDING)
    run = run | {
        "states": np.broadcast_to(np.nan, (*whole, D)),
        "final": np.broadcast_to(np.nan, (*batch, D)),
        "status": np.broadcast_to(pending, batch),
        "failed_at": np.broadcast_to(np.int64(pending), batch),
        "attitude": None if turns is False else np.broadcast_to(np.nan, (*whole, D + 1, D + 1)),
    }
    starts = run.pop("omega0")
    data = Trajectories(**run, _map=record).to_xarray(dims, coords).drop_vars("time")
    if taken := functions.keys() & {*data.variables, "time"}:
        raise wrong("functions", "names that the dataset does not have", ", ".join(taken))
    sources = {name: source_of(name, each) for name, each in functions.items()}
    for name, function in functions.items():
        values_of(name, function, np.full((3, D), 0.5))  # an error comes before anything is stored
        data[name] = (("n", *data.status.dims), np.broadcast_to(np.nan, whole))
    if bad := [
        each
        for each in [str(name) for name in data.variables]
        if each in ("", ".", "..") or "/" in each
    ]:
        raise wrong("dims, coords and functions", "names of folders", repr(bad[0]))
    for name in {record.variable, *_RESULTS, *functions} & {*data}:
        data[name].encoding["fill_value"] = PENDING if data[name].dtype.kind == "i" else np.nan
    numbers = {**body._arrays, **body._coordinates, "eps": np.asarray(run["eps"])}
    numbers |= {} if turns is False else {"attitude": turns}
    about: dict[str, Any] = {name: described(name, each) for name, each in numbers.items()}
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
    import zarr

    contents: dict[str, Any] = {}
    labels = " ".join(str(name) for name in data.coords if name not in data.dims)
    about = {**data.attrs, "coordinates": labels}  # as xarray reads it
    root = zarr.create_group(zarr.storage.MemoryStore(contents), attributes=about)
    for name, variable in data.variables.items():
        computed = "fill_value" in variable.encoding
        lengths = {dim: max(1, n) for dim, n in variable.sizes.items()}
        array = root.create_array(
            name,
            shape=variable.shape,
            dtype=str if variable.dtype.kind in "OU" else variable.dtype,
            chunks=tuple((lengths | sizes if computed else lengths)[dim] for dim in lengths),
            fill_value=variable.encoding.get("fill_value"),
            compressors=zarr.codecs.Crc32cCodec(),
            dimension_names=variable.dims,
            attributes=variable.attrs,
        )
        if not computed:
            array[...] = variable.values
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # consolidated metadata extend the format
        zarr.consolidate_metadata(root.store)
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
