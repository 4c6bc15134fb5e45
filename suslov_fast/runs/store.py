"""Zarr stores of runs: what they hold, how they are made, and how runs are told apart.

The attributes of the root are the arguments of the run, and are written first. A store is there
when the metadata of its arrays are consolidated, which is last.
"""

from __future__ import annotations

import errno
import hashlib
import inspect
import math
import os
import shutil
import threading
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import FloatArray, instance, real_array, wrong
from ..engine.memory import require
from ..engine.starts import RandomStarts
from ..maps import map_of
from .trajectories import Trajectories

# Version of the format, and the status of trajectories that are not computed.
FORMAT, PENDING = 6, -128
# What is written when a tile is finished, in this order.
LAST = ("final", "failed_at", "status")
# Numbers read at a time for a digest.
_READ = 2**21
_ONE_AT_A_TIME = threading.Lock()


def resolved(store: Any) -> Any:
    """Return a store that other processes can open: folders as absolute paths."""
    from zarr.abc.store import Store

    instance("store", store, (str, os.PathLike, Store))
    is_folder = isinstance(store, os.PathLike) or (isinstance(store, str) and "://" not in store)
    return os.path.abspath(store) if is_folder else store


def template(
    run: dict[str, Any], batch: tuple[int, ...], functions: Any, dims: Any, coords: Any
) -> Any:
    """Return the dataset of a run, with its arguments as attributes and nothing computed."""
    body, every, turns = run["body"], run["save_every"], run["attitude"]
    rows, D = 1 if every is None else run["steps"] // every + 1, body.dimension
    require(8 * rows, "raise save_every")
    record, whole, pending = map_of(body), (rows, *batch), np.int8(PENDING)
    empty: dict[str, Any] = {
        "states": np.broadcast_to(np.nan, (*whole, D)),
        "final": np.broadcast_to(np.nan, (*batch, D)),
        "status": np.broadcast_to(pending, batch),
        "failed_at": np.broadcast_to(np.int64(pending), batch),
        "attitude": None if turns is None else np.broadcast_to(np.nan, (*whole, D + 1, D + 1)),
    }
    empty |= {name: run[name] for name in ("body", "eps", "method", "steps", "save_every")}
    data = Trajectories(**empty, _map=record).to_xarray(dims, coords).drop_vars("time")
    sources = {}
    for name, function in functions.items():
        if name in (*data.variables, "time"):
            raise wrong("functions", "names that the dataset does not have", repr(name))
        try:
            sources[name] = inspect.getsource(function)
        except (TypeError, OSError) as error:
            received = f"{name}: {function!r}"
            raise wrong("functions", "functions with a source", received, TypeError) from error
        values(name, function, np.full((3, D), 0.5))  # errors come before anything is stored
        data[name] = (("n", *data.status.dims), np.broadcast_to(np.nan, whole))
    for name in {record.variable, "attitude", *LAST, *functions} & {*data}:
        data[name].encoding["fill_value"] = PENDING if data[name].dtype.kind == "i" else np.nan
    if any("/" in str(name) for name in data.variables):
        raise wrong("dims, coords and functions", "names without /", ", ".join(map(str, data)))
    arrays = {**body._arrays, **body._coordinates, "eps": np.asarray(run["eps"])}
    arrays |= {} if turns is None else {"attitude": turns}
    about = {name: _described(name, each) for name, each in arrays.items()}
    about["omega0"] = _described("omega0", run["omega0"], 0)
    labels = {name: data[name].values.tolist() for name in coords or ()}
    for name, each in (("functions", sources), ("coords", labels)):
        digest = hashlib.sha256(repr(sorted(each.items())).encode()).hexdigest()
        about |= {name: f"{', '.join(each)}, sha256 {digest}"} if each else {}
    about |= {} if every is None else {"save_every": every}
    about |= {"steps": run["steps"], "method": run["method"], "body": type(body).__name__}
    return data.assign_attrs(about, dims=", ".join(data.status.dims), format=FORMAT)


def _described(name: str, array: Any, few: int = 1000) -> Any:
    """Return a few numbers as they are, and many, read in parts, by number, range and digest."""
    if isinstance(array, RandomStarts):
        return repr(array)
    if array.size <= few:
        return array.tolist()
    digest, low, high = hashlib.sha256(str(array.shape).encode()), np.inf, -np.inf
    step = max(1, _READ // max(1, math.prod(array.shape[1:])))
    for k in range(0, len(array), step):
        part = real_array(name, np.asarray(array[k : k + step]), allow_nan=True)
        low = np.fmin.reduce(part, axis=None, initial=low)
        high = np.fmax.reduce(part, axis=None, initial=high)
        digest.update(np.ascontiguousarray(part).data)
    return f"{array.size} values from {low:g} to {high:g}, sha256 {digest.hexdigest()}"


def _differences(asked: dict[str, Any], stored: dict[str, Any]) -> str:
    """Return in words, without digests, how the arguments of two runs differ."""
    found = []
    for name in dict.fromkeys([*asked, *stored]):
        if name in ("version", "coordinates") or asked.get(name) == stored.get(name):
            continue
        values = (each.get(name) for each in (asked, stored))
        texts = (
            _described(name, np.array(v), 0) if isinstance(v, list) else str(v) for v in values
        )
        ours, theirs = (text.partition(", sha256")[0] for text in texts)
        found.append(f"{name}: {ours}, the store has {'others' if ours == theirs else theirs}")
    return "; ".join(found)


def attributes(store: Any) -> tuple[dict[str, Any], bool]:
    """Return the attributes of a store, {} if there is none, and whether all of it was created.

    ValueError if it is no store of a run.
    """
    import zarr

    try:
        root = zarr.open_group(store, mode="r")
    except FileNotFoundError:
        return {}, False
    found = dict(root.attrs)
    if found and found.get("format") != FORMAT:
        version = found.get("version") or found.get("source")
        of = f"a run of suslov_fast {version}: compute it anew" if version else "other data"
        raise wrong("store", f"a store of ensemble in format {FORMAT}", f"{store} with {of}")
    return found, root.metadata.consolidated_metadata is not None


def prepare(store: Any, data: Any, sizes: dict[str, int]) -> None:
    """Create the store of a run, or check that it holds this run."""
    stored, created = attributes(store)
    if stored and (text := _differences(data.attrs, stored)):
        received = f"{store} of another run: {text}"
        raise wrong("store", "a new name, or the store of this run", received)
    if isinstance(store, str) and "://" not in store:
        _require_space(Path(store), data)
    if not created:
        _create(store, data, sizes)


def _require_space(folder: Path, data: Any) -> None:
    """Raise an error if a folder holds other data, or its disk has no space for what it lacks."""
    there = [*folder.rglob("*")]
    known = {"zarr.json", *map(str, data.variables)}
    if others := {path.relative_to(folder).parts[0] for path in there} - known:
        raise wrong("store", "a new name or a store", f"{folder} with {min(others)} in it")
    needed = data.nbytes - sum(path.stat().st_size for path in there if path.is_file())
    free = shutil.disk_usage(next(each for each in folder.parents if each.exists())).free
    if needed > free:
        what = f"{free:,} bytes, fewer than the {needed:,} of the run: raise save_every"
        raise OSError(errno.ENOSPC, what, str(folder))


def _create(store: Any, data: Any, sizes: dict[str, int]) -> None:
    """Write all but what is to be computed; the metadata of all arrays together come last.

    What an interrupted call has written is written again, with the same bytes.
    """
    import zarr

    labels = " ".join(str(name) for name in data.coords if name not in data.dims)
    about = {**data.attrs, "coordinates": labels}  # as xarray reads it
    with suppress(zarr.errors.ContainsGroupError):  # of an earlier call, or another process
        zarr.create_group(store, zarr_format=3, attributes=about)
    root = zarr.open_group(store, mode="r+", use_consolidated=False)
    for name, variable in data.variables.items():
        lengths = {dim: max(1, n) for dim, n in variable.sizes.items()}
        fill = variable.encoding.get("fill_value")
        with suppress(zarr.errors.ContainsArrayError):
            root.create_array(
                name,
                shape=variable.shape,
                dtype=str if variable.dtype.kind in "OU" else variable.dtype,
                chunks=tuple(
                    (lengths if fill is None else lengths | sizes)[dim] for dim in lengths
                ),
                fill_value=fill,
                compressors=zarr.codecs.Crc32cCodec(),
                dimension_names=variable.dims,
                attributes=variable.attrs,
            )
        if fill is None:
            root[name][...] = variable.values
    with _ONE_AT_A_TIME, warnings.catch_warnings():  # filters of warnings are those of all threads
        warnings.simplefilter("ignore", UserWarning)  # consolidated metadata extend the format
        zarr.consolidate_metadata(store)


def values(name: str, function: Any, points: FloatArray) -> Any:
    """Return the values of a function of states."""
    values = np.asarray(function(points))
    if values.shape != points.shape[:-1] or values.dtype.kind not in "buif":
        received = f"{name} with {values.dtype} {values.shape} for states {points.shape}"
        raise wrong("functions", "real values (...) for states (..., D)", received)
    return values
