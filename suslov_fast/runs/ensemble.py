"""Runs larger than memory: tiles of the batch, each written to its part of a Zarr store.

A store exists once its metadata are consolidated, a tile once its `status` is written.
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
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import islice, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, wrong
from ..engine.arguments import Problem, RandomStarts, check, require
from ..engine.stretches import March, Progress, reporter
from ..maps import map_of
from .iterate import checked_counts
from .trajectories import Trajectories

if TYPE_CHECKING:
    import distributed
    import xarray

# Version of the format, and the status of trajectories that are not computed.
FORMAT, PENDING = 8, -128
# Bytes of the states in a chunk; steps of all trajectories of a tile, some seconds of work; the
# least number of trajectories that keep a processor busy; tiles queued per thread of a worker.
_CHUNK, _WORK, _FEWEST, _WAITING = 2**23, 2**31, 2**12, 4
_ONE_AT_A_TIME = threading.Lock()

Where = tuple[slice, ...]  # a tile: a part of each axis of the batch
Functions = Mapping[str, Callable[[FloatArray], ArrayLike]]
Options = tuple[str, int, int | None, Functions]  # method, steps, save_every, functions


def ensemble(
    body: Any,
    omega0: Any,
    /,
    eps: ArrayLike,
    steps: int,
    *,
    store: Any,
    save_every: int | None = None,
    method: str = "auto",
    attitude: bool | ArrayLike = False,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
    chunk: int | Mapping[str, int] | None = None,
    functions: Functions | None = None,
    client: distributed.Client | None = None,
    progress: Progress = None,
) -> xarray.Dataset:
    """Iterate a batch of any size into a Zarr store.

    States are those of :func:`iterate`, bit for bit. Each tile of the batch is written when it is
    computed; if the process ends early, the same call computes the others.

    Parameters
    ----------
    body, eps, steps, save_every, method, attitude, progress
        As in :func:`iterate`; progress counts the steps of all trajectories.
    omega0 : array_like(float, shape=(..., D)) or RandomStarts
        Initial states; memory maps and Dask arrays are read in parts, twice.
    store : str, path-like or Zarr store
        The name of a folder, a URL that fsspec supports, or a Zarr store object.
    dims, coords : optional
        As in :meth:`Trajectories.to_xarray`.
    chunk : int or mapping, optional
        Number of trajectories in a tile, or sizes along `dims` and "n"; a store keeps its own.
    functions : mapping of str to callable, optional
        Functions of the saved states (..., D), whose real values (...) are stored under these
        names. Names and source texts identify the run; values of variables that a source uses do
        not. With `client` they must be picklable.
    client : distributed.Client, optional
        Computes the tiles on its workers, which have access to the store.

    Returns
    -------
    xarray.Dataset
        That of :func:`open_ensemble`.

    Raises
    ------
    ValueError, OSError
        If the store holds another run, or other data; if its disk has no space for it.

    Examples
    --------
    >>> import tempfile
    >>> from suslov_fast import RandomStarts, Suslov3D, ensemble
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     runs = ensemble(body, RandomStarts(9, 2.0), 0.2, 100, store=f"{folder}/runs.zarr")
    ...     print(dict(runs.final.sizes), int((runs.status < 0).sum()))
    {'trajectory': 9, 'component': 2} 0
    """
    zarr = checks.extra("zarr", "large")
    if client is not None and not hasattr(client, "nthreads"):
        raise wrong("client", "a distributed.Client", type(client).__name__, TypeError)
    map = map_of(body, method)
    threads = None if client is None else 1
    whole = check(map, body, RandomStarts((), 1.0), eps, threads, attitude=attitude)
    is_random = isinstance(omega0, RandomStarts)
    if not (is_random or isinstance(omega0, np.memmap) or hasattr(omega0, "dask")):
        omega0 = checks.states("omega0", omega0, body._labels)
    shape = (*omega0.shape, body.dimension) if is_random else omega0.shape
    if shape[-1:] != (body.dimension,) or np.isnan(shape).any():
        raise wrong("omega0", f"known shape (..., {body.dimension})", shape)
    batch = checks.common_shape({"omega0": shape[:-1], "the other arguments": whole.batch})
    functions = functions or {}
    checks.instance("functions", functions, Mapping)
    steps, save_every = checked_counts(steps, save_every)
    options = method, steps, save_every, functions
    whole, store = whole._replace(omega=omega0, batch=batch), _resolved(store)
    data, done = _template(whole, options, dims, coords), 0
    sizes, reports = _sizes(data, chunk), reporter(progress, math.prod(batch) * steps)
    _prepare(store, data, sizes)
    with zarr.config.set({"array.write_empty_chunks": True}):  # to look for them takes time
        arrays = dict(zarr.open_group(store, mode="r+").arrays())
    status = arrays["status"]
    axes = zip(status.shape, status.chunks, strict=True)
    tiles = product(*([slice(k, min(k + m, n)) for k in range(0, n, m)] for n, m in axes))
    compute: Any = _compute
    abreast = 1
    if client is not None:
        compute = partial(client.submit, _compute, pure=False)
        abreast = _WAITING * max(1, sum(client.nthreads().values()))
    with reports as report:
        while group := [(where, np.asarray(status[where])) for where in islice(tiles, abreast)]:
            missing = [where for where, found in group if (found == PENDING).any()]
            jobs = [compute(_tile(whole, where), options, where, arrays) for where in missing]
            for job in jobs if client else ():
                job.result()  # `gather` would log the tiles that an error cancels
            done += sum(found.size for _, found in group)
            if report is not None:
                report(done * steps)
    return open_ensemble(store)


def open_ensemble(store: Any) -> xarray.Dataset:
    """Open a store of :func:`ensemble`, finished or not.

    Parameters
    ----------
    store : str, path-like or Zarr store
        As in :func:`ensemble`; FileNotFoundError if there is none.

    Returns
    -------
    xarray.Dataset
        Lazy, with the names of :meth:`Trajectories.to_xarray` and the functions; the attributes
        are the arguments of the run. What is not computed yet is NaN, and its `status` -128.
        Reading a damaged chunk is an error.

    Examples
    --------
    >>> import tempfile
    >>> from suslov_fast import RandomStarts, Suslov3D, ensemble, open_ensemble
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = ensemble(body, RandomStarts(9, 2.0), 0.2, 10, store=f"{folder}/runs.zarr", chunk=4)
    ...     open_ensemble(f"{folder}/runs.zarr").attrs["eps"]
    0.2
    """
    xarray, store = checks.extra("xarray", "large"), _resolved(store)
    if not _opened(store)[1]:
        raise wrong("store", "a store of ensemble", f"none at {store}", FileNotFoundError)
    data = xarray.open_zarr(store, consolidated=True, chunks={})
    return data.assign_coords(time=data.n * data.eps)


def _resolved(store: Any) -> Any:
    """Return a store that other processes can open: folders as absolute paths."""
    Store = checks.extra("zarr.abc.store", "large").Store
    checks.instance("store", store, (str, os.PathLike, Store))
    elsewhere = isinstance(store, Store) or "://" in os.fspath(store)
    return store if elsewhere else Path(store).absolute()


def _template(whole: Problem, options: Options, dims: Any, coords: Any) -> Any:
    """Return the empty dataset of a run, with attributes that identify the run."""
    (map, body, omega0, eps, batch, *_, turns), (method, steps, every, functions) = whole, options
    rows, D = 1 if every is None else steps // every + 1, body.dimension
    require(24 * rows, "raise save_every")
    fills: dict[str, Any] = {
        "states": np.broadcast_to(np.nan, (rows, *batch, D)),
        "final": np.broadcast_to(np.nan, (*batch, D)),
        "failed_at": np.broadcast_to(np.int64(PENDING), batch),
        "status": np.broadcast_to(np.int8(PENDING), batch),
    }
    arrays = {**body._arrays, "eps": np.asarray(eps)}
    if turns is not None:
        fills["attitude"] = np.broadcast_to(np.nan, (rows, *batch, D + 1, D + 1))
        arrays["attitude"] = turns
    about = {
        "body": body,
        "map": map,
        "eps": eps,
        "method": method,
        "steps": steps,
        "save_every": every,
    }
    data = Trajectories._of(fills | about).to_xarray(dims, coords).drop_vars("time")
    sources = {}
    for name, function in functions.items():
        if name in (*data.variables, "time"):
            raise wrong("functions", "names that the dataset does not have", repr(name))
        try:
            sources[name] = inspect.getsource(function)
        except (TypeError, OSError) as error:
            received = f"{name}: {function!r}"
            raise wrong("functions", "functions with a source", received, TypeError) from error
        _values(name, function, np.full((3, D), 0.5))  # errors come before anything is stored
        data[name] = (("n", *data.status.dims), np.broadcast_to(np.nan, (rows, *batch)))
    if any("/" in str(name) for name in data.variables):
        raise wrong("dims, coords and functions", "names without /", ", ".join(map(str, data)))
    for name in {map.variable, *fills, *functions} & {*data}:
        data[name].encoding["fill_value"] = PENDING if data[name].dtype.kind == "i" else np.nan
    identity = {name: _described(name, each) for name, each in arrays.items()}
    identity["omega0"] = _described("omega0", omega0, few=0)
    labels = {name: data[name].values.tolist() for name in coords or ()}
    for name, texts in (("functions", sources), ("coords", labels)):
        digest = hashlib.sha256(repr(sorted(texts.items())).encode()).hexdigest()
        identity |= {name: f"{', '.join(texts)}, sha256 {digest}"} if texts else {}
    identity |= {"body": type(body).__name__, "dims": ", ".join(data.status.dims)}
    return data.assign_attrs(identity, format=FORMAT)


def _described(name: str, array: Any, few: int = 1000) -> Any:
    """Return few numbers as they are, and of many their count, range and digest."""
    if isinstance(array, RandomStarts):
        return repr(array)
    if array.size <= few:
        return array.tolist()
    digest, low, high = hashlib.sha256(str(array.shape).encode()), np.inf, -np.inf
    step = max(1, 2**21 // max(1, math.prod(array.shape[1:])))  # 16 MiB
    for k in range(0, len(array), step):
        part = checks.real_array(name, np.asarray(array[k : k + step]), allow_nan=True)
        low = np.fmin.reduce(part, axis=None, initial=low)
        high = np.fmax.reduce(part, axis=None, initial=high)
        digest.update(np.ascontiguousarray(part).data)
    return f"{array.size} values from {low:g} to {high:g}, sha256 {digest.hexdigest()}"


def _in_words(value: Any) -> str:
    """Return an attribute without the digest, and an array by number and range."""
    text = str(_described("store", np.array(value), 0) if isinstance(value, list) else value)
    return text.partition(", sha256")[0]


def _values(name: str, function: Any, points: FloatArray) -> Any:
    values = np.asarray(function(points))
    if values.shape != points.shape[:-1] or values.dtype.kind not in "buif":
        received = f"{name} with {values.dtype} {values.shape} for states {points.shape}"
        raise wrong("functions", "real values (...) for states (..., D)", received)
    return values


def _sizes(data: Any, chunk: Any) -> dict[str, int]:
    """Return the lengths of chunks: tiles along the last axes, and saved states."""
    lengths = {"n": data.sizes["n"], **data.status.sizes}
    expected = f"a number of trajectories, or sizes along {', '.join(map(str, lengths))}"
    width = 8 * max(data.sizes["component"], data.sizes.get("space", 0) ** 2)
    few = min(_CHUNK // (width * lengths["n"]), _WORK // (data.attrs["steps"] + 1))
    given = chunk if isinstance(chunk, Mapping) else {}
    left = max(_FEWEST, few) if chunk is None or given else chunk
    if unknown := given.keys() - lengths:
        raise wrong("chunk", expected, ", ".join(map(str, unknown)))
    sizes: dict[str, int] = {}
    for name, length in reversed(lengths.items()):
        if name == "n":
            left = max(1, _CHUNK // (width * math.prod(sizes.values())))
        most = checks.integer("chunk", given.get(name, left), 1, expected)
        parts = math.ceil(length / most) or 1  # of equal size, since all take as much space
        sizes[name] = math.ceil(length / parts) or 1
        left = max(1, left // sizes[name])
    return sizes


def _opened(store: Any) -> tuple[dict[str, Any], bool]:
    """Return the attributes of a store, {} if there is none, and whether all of it was made."""
    import zarr

    try:
        root = zarr.open_group(store, mode="r")
    except FileNotFoundError:
        return {}, False
    if root.attrs.get("format") != FORMAT:
        version = root.attrs.get("version") or root.attrs.get("source")
        of = f"a run of suslov_fast {version}: compute it anew" if version else "other data"
        raise wrong("store", f"a store of ensemble in format {FORMAT}", f"{store} with {of}")
    return dict(root.attrs), root.metadata.consolidated_metadata is not None


def _prepare(store: Any, data: Any, sizes: dict[str, int]) -> None:
    """Create the store of a run, or check that it holds this run."""
    (stored, is_made), texts = _opened(store), []
    for name in {**data.attrs, **stored} if stored else ():
        if name not in ("version", "coordinates") and data.attrs.get(name) != stored.get(name):
            ours, theirs = (_in_words(each.get(name)) for each in (data.attrs, stored))
            texts.append(f"{name}: {ours}, the store has {'others' if ours == theirs else theirs}")
    if texts:
        received = f"{store} of another run: {'; '.join(texts)}"
        raise wrong("store", "a new name, or the store of this run", received)
    if not stored and isinstance(store, Path):
        there = {path.name for path in store.glob("*") if path.suffix != ".partial"}
        if others := there - {"zarr.json", *map(str, data.variables)}:  # which another process made
            raise wrong("store", "a new name or a store", f"{store} with {min(others)} in it")
        free = shutil.disk_usage(next(each for each in store.parents if each.exists())).free
        if data.nbytes > free:
            received = f"{free:,} bytes, fewer than the {data.nbytes:,} of the run"
            message = f"expected space for the run, got {received}: raise save_every"
            raise OSError(errno.ENOSPC, message, str(store))
    if not is_made:
        _create(store, data, sizes)


def _create(store: Any, data: Any, sizes: dict[str, int]) -> None:
    """Make the arrays of a store, which an interrupted call or another process may have begun."""
    import zarr

    labels = " ".join(str(name) for name in data.coords if name not in data.dims)
    about = {**data.attrs, "coordinates": labels}  # as xarray reads it
    with suppress(zarr.errors.ContainsGroupError):
        zarr.create_group(store, zarr_format=3, attributes=about)
    root = zarr.open_group(store, mode="r+", use_consolidated=False)
    for name, variable in data.variables.items():
        fill = variable.encoding.get("fill_value")
        lengths = data.sizes if fill is None else {**data.sizes, **sizes}
        with suppress(zarr.errors.ContainsArrayError):
            root.create_array(
                name,
                shape=variable.shape,
                dtype=str if variable.dtype.kind in "OU" else variable.dtype,
                chunks=tuple(max(1, lengths[dim]) for dim in variable.dims),
                fill_value=fill,
                compressors=zarr.codecs.Crc32cCodec(),
                dimension_names=variable.dims,
                attributes=variable.attrs,
            )
        if fill is None:
            root[name][...] = variable.values
    with _ONE_AT_A_TIME, warnings.catch_warnings():  # filters of warnings are those of all threads
        warnings.simplefilter("ignore", UserWarning)  # on this format and on unfinished files
        zarr.consolidate_metadata(store)


def _compute(tile: Problem, options: Options, where: Where, arrays: Any) -> None:
    """Compute and write a tile, in pieces that fill a chunk, its `status` last."""
    (method, steps, every, functions), map, row = options, tile.map, 0
    march, rows = March(tile, method), arrays[map.variable].chunks[0]
    for saved, turns in march.pieces(steps, every or 0, rows):
        found = {map.variable: saved} if turns is None else {map.variable: saved, "attitude": turns}
        found |= {name: _values(name, f, saved) for name, f in functions.items()}
        for name, values in found.items():
            arrays[name][(slice(row, row + len(saved)), *where)] = values
        row += len(saved)
    for name in ("final", "failed_at", "status"):
        arrays[name][where] = getattr(march, name)


def _tile(whole: Problem, where: Where) -> Problem:
    """Return a part of the batch, whose initial states are read."""
    _, body, omega0, eps, *_, turns = whole
    for axis, part in enumerate(_along(body.shape, where)):
        body = body._part(axis, part)
    if isinstance(omega0, RandomStarts):
        omega0 = omega0._part(_along(omega0.shape, where), body.dimension)
    else:
        omega0 = np.asarray(omega0[_along(omega0.shape[:-1], where)])
        omega0 = checks.states("omega0", omega0, body._labels)
    if turns is not None:
        turns = turns[_along(turns.shape[:-2], where)]
    batch, eps = tuple(part.stop - part.start for part in where), np.asarray(eps)
    eps = eps[_along(eps.shape, where)]
    return whole._replace(body=body, omega=omega0, eps=eps, batch=batch, orientation=turns)


def _along(shape: tuple[int, ...], where: Where) -> Where:
    """Return the slices, for a part of the batch, of an array that broadcasts to the batch."""
    last = where[len(where) - len(shape) :]
    return tuple(slice(0, 1) if n == 1 else each for n, each in zip(shape, last, strict=True))
