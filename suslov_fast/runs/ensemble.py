"""Runs larger than memory: tiles of the batch, each written to its part of a Zarr store."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import islice, product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..checks import FloatArray, common_shape, instance, integer, states, wrong
from ..engine.progress import Progress, check_progress, reporter
from ..engine.starts import RandomStarts
from ..maps import map_of
from . import store as stores
from .iterate import _begin, _counts, pieces

if TYPE_CHECKING:
    import distributed
    import xarray

# Bytes of the states in a chunk; steps of all trajectories of a tile, some seconds of work; the
# least number of trajectories that keep a processor busy; tiles queued per thread of a worker.
_CHUNK, _WORK, _FEWEST, _WAITING = 2**24, 2**31, 2**12, 2

Where = tuple[slice, ...]
Run = dict[str, Any]  # the arguments of a run, or of a tile of it


def ensemble(
    body: Any,
    omega0: Any,
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
    functions: Mapping[str, Callable[[FloatArray], ArrayLike]] | None = None,
    client: distributed.Client | None = None,
    progress: Progress = None,
) -> xarray.Dataset:
    """Iterate a batch of any size into a Zarr store.

    States are those of :func:`iterate`, bit for bit. The batch is cut into tiles, each of which is
    written when it is computed: if the process ends early, the same call computes the others.

    Parameters
    ----------
    body, eps, steps, save_every, method, attitude, progress
        As in :func:`iterate`.
    omega0 : array_like(float, shape=(..., D)) or RandomStarts
        Initial states. Memory maps and Dask arrays are read in parts, twice: the first time for
        the digest that identifies them.
    store : str, path-like or Zarr store
        The name of a folder, a URL that fsspec supports, or a Zarr store object.
    dims : str or sequence of str, optional
        Names of the axes of the batch. A parameter, or "eps", that varies along the axis of its
        name alone becomes the coordinate of that axis, so that ``.sel(eps=0.2)`` works.
    coords : mapping, optional
        More coordinates, as `xarray.Dataset` takes them.
    chunk : int or mapping, optional
        Number of trajectories in a tile, or sizes along `dims` and "n", the saved states; by
        default chunks of 16 MiB or less. Results do not depend on it; a store keeps its own.
    functions : mapping of str to callable, optional
        Functions of states (..., D) with real values (...), which are stored beside the saved
        states under these names. Names and source texts are part of what identifies the run; the
        values of variables that a source uses are not. With `client` they must be picklable.
    client : distributed.Client, optional
        Computes the tiles on its workers, which have access to the store.

    Returns
    -------
    xarray.Dataset
        That of :func:`open_ensemble`.

    Raises
    ------
    ValueError
        If the store holds other data, or another run: the message says what differs.
    OSError
        If the store cannot be written to, or exceeds the free space of its disk.

    Examples
    --------
    >>> import tempfile
    >>> from suslov_fast import RandomStarts, Suslov3D, ensemble
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     runs = ensemble(
    ...         body, RandomStarts(1000, 2.0), 0.2, 100, store=f"{folder}/runs.zarr", save_every=50
    ...     )
    ...     print(dict(runs.omega.sizes), int((runs.status < 0).sum()))
    {'n': 3, 'trajectory': 1000, 'component': 2} 0
    """
    check_progress(progress)
    if client is not None and not hasattr(client, "nthreads"):
        raise wrong("client", "a distributed.Client", type(client).__name__, TypeError)
    map_of(body)
    given = _begin(body, np.zeros(body.dimension), eps, method, attitude, None)[1]
    is_random = isinstance(omega0, RandomStarts)
    if not (is_random or isinstance(omega0, np.memmap) or hasattr(omega0, "dask")):
        omega0 = states("omega0", omega0, body._labels)
    shape = omega0.shape if is_random else omega0.shape[:-1]
    if not is_random and (omega0.shape[-1:] != (body.dimension,) or np.isnan(shape).any()):
        raise wrong("omega0", f"known shape (..., {body.dimension})", omega0.shape)
    batch = common_shape({"omega0": shape, "the other arguments": given.batch})
    steps, save_every = _counts(steps, save_every)
    run = {"body": body, "omega0": omega0, "eps": given.eps, "steps": steps, "method": method}
    run |= {"save_every": save_every, "attitude": given.orientation}
    functions = functions or {}
    instance("functions", functions, Mapping)
    place, data = stores.resolved(store), stores.template(run, batch, functions, dims, coords)
    stores.prepare(place, data, _sizes(data, chunk))
    _compute_missing(run, functions, place, client, progress)
    return open_ensemble(place)


def open_ensemble(store: Any) -> xarray.Dataset:
    """Open a store of :func:`ensemble`, finished or not.

    Parameters
    ----------
    store : str, path-like or Zarr store
        As in :func:`ensemble`.

    Returns
    -------
    xarray.Dataset
        Lazy, with the names of :meth:`Trajectories.to_xarray` and the functions. Its attributes
        are the arguments of the run. Where nothing is computed yet `status` is -128 and states are
        NaN. Reading a damaged chunk is an error.

    Raises
    ------
    FileNotFoundError, ValueError
        If there is nothing of that name, or something else.

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
    import xarray

    place = stores.resolved(store)
    if not stores.attributes(place)[1]:
        raise wrong("store", "a store of ensemble", f"none at {place}", FileNotFoundError)
    data = xarray.open_zarr(place, consolidated=True, chunks={})
    return data.assign_coords(time=data.n * data.eps)


def _sizes(data: Any, chunk: Any) -> dict[str, int]:
    """Return the lengths of chunks: tiles along the last axes, and saved states."""
    lengths = {"n": data.sizes["n"], **data.status.sizes}
    expected = f"a number of trajectories, or sizes along {', '.join(map(str, lengths))}"
    largest = max(each.nbytes for name, each in data.items() if "fill_value" in each.encoding)
    width = max(1, largest // max(1, math.prod(lengths.values())))
    given = dict(chunk) if isinstance(chunk, Mapping) else {}
    if unknown := given.keys() - lengths:
        raise wrong("chunk", expected, ", ".join(map(str, unknown)))
    few = min(_CHUNK // (width * lengths["n"]), _WORK // (data.attrs["steps"] + 1))
    left = max(_FEWEST, few) if chunk is None or given else chunk
    sizes: dict[str, int] = {}
    for name in reversed(lengths):
        if name == "n":
            left = max(1, _CHUNK // (width * math.prod(sizes.values())))
        most = integer("chunk", given.get(name, left), 1, expected)
        parts = max(1, -(-lengths[name] // most))  # of equal size, since all take as much space
        sizes[name] = max(1, -(-lengths[name] // parts))
        left = max(1, left // sizes[name])
    return sizes


def _compute_missing(run: Run, functions: Any, store: Any, client: Any, progress: Progress) -> None:
    """Compute the tiles whose `status` is not in the store, here or on the workers of a client."""
    import zarr

    with zarr.config.set({"array.write_empty_chunks": True}):  # to look for them takes time
        arrays = dict(zarr.open_group(store, mode="r+", use_consolidated=False).arrays())
    status, steps = arrays["status"], run["steps"]
    axes = zip(status.shape, status.chunks, strict=True)
    sides = [[slice(k, min(k + m, n)) for k in range(0, n, m)] for n, m in axes]
    missing = (
        each for each in product(*sides) if (np.asarray(status[each]) == stores.PENDING).any()
    )
    with reporter(progress, math.prod(map(len, sides)) * steps) as show:
        if client is None:
            for done, where in enumerate(missing, start=1):
                _compute(_tile(run, where), where, functions, arrays, None)
                show(done * steps)
            return
        from distributed import as_completed

        def submit(where: Where) -> Any:
            return client.submit(_compute, _tile(run, where), where, functions, arrays, pure=False)

        abreast = _WAITING * max(1, sum(client.nthreads().values()))
        futures = as_completed(map(submit, islice(missing, abreast)))
        for done, future in enumerate(futures, start=1):
            future.result()
            show(done * steps)
            futures.update(map(submit, islice(missing, 1)))


def _compute(tile: Run, where: Where, functions: Any, arrays: Any, threads: int | None = 1) -> None:
    """Compute and write a tile, in pieces that fill a chunk, its `status` last."""
    variable, row = map_of(tile["body"]).variable, 0
    for piece in pieces(**tile, rows=arrays[variable].chunks[0], threads=threads):
        saved, turns, march = piece
        found = {variable: saved} if turns is None else {variable: saved, "attitude": turns}
        found |= {name: stores.values(name, f, saved) for name, f in functions.items()}
        for name, values in found.items():
            arrays[name][(slice(row, row + len(saved)), *where)] = values
        row += len(saved)
    for name in stores.LAST:
        arrays[name][where] = getattr(march, name)


def _tile(run: Run, where: Where) -> Run:
    """Return the run of a part of the batch, whose initial states are read."""
    body, omega0, turns = run["body"], run["omega0"], run["attitude"]
    if isinstance(omega0, RandomStarts):
        omega0 = omega0._part(_along(omega0.shape, where), body.dimension)
    else:
        omega0 = np.asarray(_cut(omega0, where, 1))
    if body.shape:
        arrays = body._arrays.items()
        body = body._of({name: _cut(each, where, body._axes(name)) for name, each in arrays})
    turns = False if turns is None else _cut(turns, where, 2)
    eps = _cut(np.asarray(run["eps"]), where)
    return {**run, "body": body, "omega0": omega0, "eps": eps, "attitude": turns}


def _cut(array: Any, where: Where, own: int = 0) -> Any:
    """Return the part of an array, whose last axes are its own."""
    return array[_along(array.shape[: array.ndim - own], where)]


def _along(shape: tuple[int, ...], where: Where) -> Where:
    """Return the slices, for a part of the batch, of an array that broadcasts to the batch."""
    last = where[len(where) - len(shape) :]
    return tuple(slice(0, 1) if n == 1 else each for n, each in zip(shape, last, strict=True))
