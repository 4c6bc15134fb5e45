"""Runs larger than memory: tiles of the batch, each written to its part of a Zarr store.

What a store holds, and what it lacks, is answered by `stores`.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import closing
from itertools import islice
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..checks import FloatArray, require, wrong
from ..engine.problem import Problem, Where, along, check, part_of
from ..engine.random_starts import RandomStarts
from ..engine.status import warn_of_poles
from ..engine.stretches import March, Progress, reporter
from ..maps import map_of
from . import metadata, stores
from .datasets import as_columns, columns_of, to_xarray, with_time
from .iterate import checked_counts
from .trajectories import Trajectories

if TYPE_CHECKING:
    import distributed
    import xarray

# Bytes of the states in a chunk; steps of all trajectories of a tile, some seconds of work; the
# least number of trajectories that keep a processor busy; tiles queued per thread of a worker.
_CHUNK, _WORK, _FEWEST, _WAITING = 2**24, 2**31, 2**12, 4
# What writing a state costs, in steps of the three-dimensional map. Where steps cost less, one
# thread takes them: others would spin while the store is written.
_WRITING = 8.0

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
    computed; if the process ends early, the same call computes the others. Failures have a status,
    and no warning; one :class:`PoleWarning` tells of poles that trajectories of the store passed,
    unless the call only opens it.

    Parameters
    ----------
    body, eps, steps, save_every, method, attitude, progress
        As in :func:`iterate`; progress counts the steps of all trajectories, and is called after
        each tile. If it returns False, the store is left as it is; the same call goes on.
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
    for module in ("zarr", "xarray", "dask"):  # before anything is computed
        checks.extra(module, "large")
    if client is not None and not hasattr(client, "nthreads"):
        raise wrong("client", "a distributed.Client", type(client).__name__, TypeError)
    if client is not None and client.status in ("closing", "closed"):
        raise wrong("client", "an open client", "one that is closed")
    map = map_of(body, method)
    threads = None if client is None else 1
    whole = check(map, body, RandomStarts((), 1.0), eps, threads, attitude=attitude)
    is_random = isinstance(omega0, RandomStarts)
    if not (is_random or isinstance(omega0, np.memmap) or hasattr(omega0, "dask")):
        omega0 = checks.states("omega0", omega0, body._labels)
    shape = (*omega0.shape, body.dimension) if is_random else omega0.shape
    if shape[-1:] != (body.dimension,) or np.isnan(shape).any():
        raise wrong("omega0", f"have a known shape (..., {body.dimension})", shape)
    batch = checks.common_shape({"omega0": shape[:-1], "the other arguments": whole.batch})
    functions = functions or {}
    checks.instance("functions", functions, Mapping)
    steps, save_every = checked_counts(steps, save_every)
    options = method, steps, save_every, functions
    whole, store = whole._replace(omega=omega0, batch=batch), stores.resolved(store)
    data = _template(whole, options, dims, coords)
    reports = reporter(progress, math.prod(batch) * steps)
    missing, arrays, status = stores.prepare(store, data, _sizes(data, chunk))
    tiles = {tile: _where(tile, status.shape, status.chunks) for tile in missing}
    done = math.prod(batch) - sum(_count(where) for where in tiles.values())
    computing = _finished(tiles, whole, options, arrays, client, store)
    with reports as report, closing(computing):
        goes_on = report is None or report(done * steps)
        while goes_on and (where := next(computing, None)) is not None:
            done += _count(where)
            goes_on = report is None or report(done * steps)
    data = _dataset(store, is_finished=done == math.prod(batch), is_known=not tiles)
    if tiles and map.methods[method].notes_poles:
        count, first = stores.passed_poles(arrays, status)
        if first is not None:
            warn_of_poles(body, count, math.prod(batch), *first)
    return data


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
        are the arguments of the run. What is not computed yet is NaN, and its `status` -128,
        PENDING. Reading a damaged chunk is an error.

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
    for module in ("zarr", "xarray", "dask"):
        checks.extra(module, "large")
    return _dataset(stores.resolved(store))


def _dataset(store: Any, is_finished: bool = False, is_known: bool = False) -> xarray.Dataset:
    """Open a store that lacks nothing, and no tile if `is_finished`; `is_known` spares the look."""
    import xarray

    found = metadata.contents(store)
    if found is None or not found.arrays:
        raise FileNotFoundError(f"store: there is no store of ensemble at {store}")
    lost = stores.Lost({}, set(), set()) if is_known else stores.lost(store, found)
    if lost.chunks:
        received = f"{store} without {lost}: ensemble, called again, computes them anew"
        raise wrong("store", "have whole chunks of all its tiles", received)
    if is_finished and lost.pending:
        received = f"{store} without {len(lost.pending)} of the tiles that were computed"
        raise wrong("client", "have workers that write to the store", received)
    if found.foreign:
        names = ", ".join(found.foreign)
        how = "keep derived variables in a store of their own"
        checks.warn(f"store: {store} also has {names}, which ensemble did not write: {how}")
    source = metadata.overlaid(store, found)
    data = xarray.open_zarr(source, consolidated=True, zarr_format=3, chunks=None)
    data = data.assign_attrs(found.added)
    for name, array in found.arrays.items():
        if array.shape and name not in data.indexes:
            data[name] = data[name].chunk(_parts(array), token=uuid4().hex)
    return with_time(as_columns(data, json.loads(found.attributes["columns"])))


def _parts(array: metadata.Stored) -> dict[Any, int]:
    """Return the lengths of Dask's chunks, each of which reads as many of the store as fill one.

    So an array of small chunks takes few tasks, and each makes several requests at a time.
    """
    parts: dict[Any, int] = {}
    left = _CHUNK // (array.nbytes or _CHUNK)
    for dim, length, chunk in reversed([*zip(array.dims, array.shape, array.chunks, strict=True)]):
        count = max(1, min(left, math.ceil(length / chunk)))
        parts[dim] = count * chunk
        left //= count
    return parts


def _template(whole: Problem, options: Options, dims: Any, coords: Any) -> Any:
    """Return the empty dataset of a run, with attributes that identify the run."""
    (map, body, omega0, eps, batch, *_, turns), (method, steps, every, functions) = whole, options
    rows, D = 1 if every is None else steps // every + 1, body.dimension
    require(24 * rows, "raise save_every")
    fills: dict[str, Any] = {
        "states": np.broadcast_to(np.nan, (rows, *batch, D)),
        "final": np.broadcast_to(np.nan, (*batch, D)),
        "failed_at": np.broadcast_to(np.int64(stores.PENDING), batch),
        "status": np.broadcast_to(np.int8(stores.PENDING), batch),
    }
    arrays = {**body._described, "eps": np.asarray(eps)}
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
    data = to_xarray(Trajectories._of(fills | about), dims, coords, True).drop_vars("time")
    flags = data.status.attrs
    flags["flag_values"] = [*flags["flag_values"], stores.PENDING]
    flags["flag_meanings"] += " PENDING"
    sources = {}
    for name, function in functions.items():
        checks.instance("functions, a name", name, str)
        if name in (*data.variables, "time"):
            raise wrong("functions", "names that the dataset does not have", repr(name))
        try:
            sources[name] = inspect.getsource(function)
        except (TypeError, OSError) as error:
            received = f"{name}: {function!r}"
            raise wrong("functions", "functions with a source", received, TypeError) from error
        _values(name, function, np.full((3, D), 0.5))  # errors come before anything is stored
        data[name] = (("n", *data.status.dims), np.broadcast_to(np.nan, (rows, *batch)))
    names = *data.variables, *data.dims
    if refused := [repr(str(name)) for name in names if not _is_storable(name)]:
        expected = "have names without /, and other than '', '.' and 'zarr.json'"
        raise wrong("dims, coords and functions", expected, ", ".join(refused))
    identity = {
        name: each if isinstance(each, str) else stores.described(name, each)
        for name, each in arrays.items()
    }
    identity["omega0"] = stores.described("omega0", omega0, few=0)
    labels = {name: data[name].values.tolist() for name in coords or ()}
    for name, texts in (("functions", sources), ("coords", labels)):
        digest = hashlib.sha256(repr(sorted(texts.items())).encode()).hexdigest()
        identity |= {name: f"{', '.join(texts)}, sha256 {digest}"} if texts else {}
    identity |= {"body": type(body).__name__, "dims": ", ".join(data.status.dims)}
    tiled = sorted({map.variable, *fills, *functions} & {*data.variables})
    shared = sorted({*data.variables} - {*tiled})
    lists = {"tiled": tiled, "shared": shared, "columns": columns_of(data)}
    identity |= {name: json.dumps(each) for name, each in lists.items()}
    return data.assign_attrs(identity, format=metadata.FORMAT)


def _is_storable(name: Any) -> bool:
    """Return whether an array of a store can have a name, which is that of a folder, too."""
    text = str(name)
    is_reserved = text in ("", ".", "..", "zarr.json") or text.startswith("__")
    if is_reserved or any(each in text for each in "/\\\0"):
        return False
    return text.isprintable() and len(text.encode()) <= 200


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


def _finished(
    tiles: dict[metadata.Tile, Where],
    whole: Problem,
    options: Options,
    arrays: Any,
    client: Any,
    store: Any,
) -> Generator[Where, None, None]:
    """Compute tiles, and yield each when it is finished."""
    if client is None:
        for where in tiles.values():
            _compute(_tile(whole, where), options, where, arrays)
            yield where
        return
    from dask import config
    from distributed import as_completed

    # What a tile needs is at most some chunks, which a graph may hold.
    sizes = {"distributed.admin.large-graph-warning-threshold": 16 * _CHUNK}
    waiting = iter(tiles.items())
    under_way: dict[Any, tuple[metadata.Tile, Where]] = {}
    finished, known = as_completed(loop=client.loop), set()  # workers that write to the store

    def submit() -> None:
        """Keep all workers busy, of which there may be more by now."""
        most = _WAITING * max(1, sum(client.nthreads().values()))
        for tile, where in islice(waiting, max(0, most - len(under_way))):
            given = _tile(whole, where), options, where, arrays
            with config.set(sizes):
                job = client.submit(_compute_on_worker, *given, pure=False)
            under_way[job] = tile, where
            finished.add(job)

    try:
        submit()
        for job in finished:
            tile, where = under_way.pop(job)
            worker = job.result()
            if worker not in known and not stores.has_tile(store, tile):
                received = f"{worker}, whose tile is not at {store}"
                raise wrong("client", "have workers that write to the store", received)
            known.add(worker)
            yield where
            submit()
    finally:
        client.cancel([*under_way])


def _compute_on_worker(*arguments: Any) -> str:
    """Compute a tile, and return the address of the worker."""
    from distributed import get_worker

    _compute(*arguments)
    return str(get_worker().address)


def _compute(tile: Problem, options: Options, where: Where, arrays: Any) -> None:
    """Compute and write a tile, in pieces that fill a chunk, its `status` last."""
    (method, steps, every, functions), map, row = options, tile.map, 0
    if isinstance(tile.omega, RandomStarts):  # computed where they are needed
        part = tile.omega._part(along(tile.omega.shape, where), tile.body.dimension)
        tile = tile._replace(omega=part)
    march, rows = March(tile, method), arrays[map.variable].chunks[0]
    cost = march.steps.cost(tile.body.dimension, march.arguments)
    if every and every * cost < _WRITING:
        march.problem = tile._replace(threads=1)
    for saved, turns in march.pieces(steps, every or 0, rows):
        found = {map.variable: saved} if turns is None else {map.variable: saved, "attitude": turns}
        found |= {name: _values(name, f, saved) for name, f in functions.items()}
        for name, values in found.items():
            arrays[name][(slice(row, row + len(saved)), *where)] = values
        row += len(saved)
    for name in ("final", "failed_at", "status"):
        arrays[name][where] = getattr(march, name)


def _tile(whole: Problem, where: Where) -> Problem:
    """Return a part of the batch, whose initial states in an array are read and checked."""
    tile = part_of(whole, where)
    if isinstance(tile.omega, RandomStarts):
        return tile
    return tile._replace(omega=checks.states("omega0", np.asarray(tile.omega), tile.body._labels))


def _where(tile: metadata.Tile, shape: tuple[int, ...], chunks: tuple[int, ...]) -> Where:
    """Return the part of the batch that a tile is."""
    axes = zip(tile, shape, chunks, strict=True)
    return tuple(slice(k * m, min(k * m + m, n)) for k, n, m in axes)


def _count(where: Where) -> int:
    return math.prod(part.stop - part.start for part in where)
