"""Runs larger than memory: tiles of the batch, each written to its part of a Zarr store."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import islice, product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..checks import FloatArray, common_shape, instance, integer, states, wrong
from ..engine.progress import Progress, check_progress, reporter
from ..engine.starts import RandomStarts
from ..maps import Map, map_of
from . import store as stores
from .iterate import _begin, _counts, pieces

if TYPE_CHECKING:
    import distributed
    import xarray

# Bytes of the states in a chunk; steps of all trajectories of a tile, some seconds of work; and the
# number of trajectories below which the processor would be idle.
_CHUNK, _WORK, _FEWEST = 2**24, 2**31, 2**12
_LITTLE = 2**24
# Tiles queued per thread of a worker: no thread is idle, and few initial states are in memory.
_WAITING = 2

Where = tuple[slice, ...]
Run = dict[str, Any]  # the arguments of a run, or of a tile of it


def ensemble(
    body: Any,
    omega0: ArrayLike | RandomStarts | Any,
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
    body, eps, steps, save_every, method, attitude
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
        More coordinates, as :class:`xarray.Dataset` takes them.
    chunk : int or mapping, optional
        Number of trajectories in a tile, or sizes along `dims` and "n", the saved states; by
        default chunks of 16 MiB or less. Results do not depend on it; a store keeps its own.
    functions : mapping of str to callable, optional
        Functions of states (..., D) with real values (...), which are stored beside the saved
        states under these names. Names and source texts are part of what identifies the run; the
        values of variables that a source uses are not. With `client` they must be picklable.
    client : distributed.Client, optional
        Computes the tiles on its workers, which have access to the store.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, total)``, both in
        steps of one trajectory.

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
    place, record = stores.resolved(store), map_of(body)
    check_progress(progress)
    if client is not None:
        from distributed import Client

        instance("client", client, Client)
    D, is_random = body.dimension, isinstance(omega0, RandomStarts)
    if not (is_random or isinstance(omega0, np.memmap) or hasattr(omega0, "dask")):
        omega0 = states("omega0", omega0, body._labels)
    if not is_random and (omega0.shape[-1:] != (D,) or np.isnan(omega0.shape).any()):
        raise wrong("omega0", f"known shape (..., {D})", omega0.shape)
    shape = omega0.shape if is_random else omega0.shape[:-1]
    given = _begin(body, np.zeros(D), eps, method, attitude, None)[1]
    batch = common_shape({"omega0": shape, "the other arguments": given.batch})
    steps, save_every = _counts(steps, save_every)
    turns = False if given.orientation is None else given.orientation
    run = {"body": body, "omega0": omega0, "eps": given.eps, "steps": steps}
    run |= {"save_every": save_every, "method": method, "attitude": turns}
    functions = dict(functions or {})
    template = stores.template(record, run, batch, functions, dims, coords)
    stores.prepare(place, template, _sizes(template, record.variable, chunk))
    _compute_missing(record, run, functions, stores.arrays(place), client, progress)
    return stores.dataset(place)


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
    FileNotFoundError
        If there is nothing of that name.
    ValueError
        If it is no store of :func:`ensemble`, one of an earlier version, or damaged.

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
    return stores.dataset(stores.resolved(store))


def _sizes(template: Any, variable: str, chunk: Any) -> dict[str, int]:
    """Return the lengths of chunks: tiles along the last axes, and saved states."""
    lengths = {"n": template.sizes["n"], **template.status.sizes}
    expected = f"a number of trajectories, or sizes along {', '.join(map(str, lengths))}"
    whole = template.attitude if "attitude" in template else template[variable]
    width = whole.nbytes // max(1, math.prod(lengths.values()))
    work = _WORK // (template.attrs["steps"] + 1)
    given = dict(chunk) if isinstance(chunk, Mapping) else {}
    if unknown := given.keys() - lengths:
        raise wrong("chunk", expected, ", ".join(map(str, unknown)))
    left = max(min(_CHUNK // (width * lengths["n"] or 1), work), _FEWEST)
    if chunk is not None and not given:
        left = integer("chunk", chunk, 1, expected)
    sizes: dict[str, int] = {}
    for name in reversed(lengths):
        if name == "n":
            left = max(1, _CHUNK // (width * math.prod(sizes.values()) or 1))
        sizes[name] = _alike(lengths[name], integer("chunk", given.get(name, left), 1, expected))
        left = max(1, left // sizes[name])
    return sizes


def _alike(length: int, most: int) -> int:
    """Return the length of parts of about equal length, since a short chunk takes as much space."""
    return -(-length // -(-length // most)) if length else 1


def _compute_missing(
    record: Map, run: Run, functions: Any, arrays: Any, client: Any, progress: Progress
) -> None:
    """Compute the tiles whose `status` is not in the store, here or on the workers of a client."""
    status, steps, rows = arrays["status"], run["steps"], arrays[record.variable].chunks[0]
    axes = zip(status.shape, status.chunks, strict=True)
    sides = [[slice(k, min(k + m, n)) for k in range(0, n, m)] for n, m in axes]
    tiles = math.prod(len(each) for each in sides)
    # With less work than this a tile is computed before a second thread has started.
    threads = 1 if math.prod(status.chunks) * steps < _LITTLE else None
    missing = (each for each in product(*sides) if not stores.is_done(status, each))
    with reporter(progress, tiles * steps) as show:
        if client is None:
            with ThreadPoolExecutor(1, "suslov_fast writer") as writer:
                writing = writer.submit(int)  # nothing yet
                for done, where in enumerate(missing, start=1):
                    work = record.variable, _tile(run, where), where, functions, rows, threads
                    for each in _computed(*work):
                        writing.result()
                        writing = writer.submit(_write, arrays, *each)
                    show(done * steps)
                writing.result()
            return
        from distributed import as_completed

        def submit(where: Where) -> Any:
            tile = _tile(run, where)
            work = record.variable, tile, where, functions, rows
            return client.submit(_compute, arrays, *work, pure=False)

        abreast = _WAITING * max(1, sum(client.nthreads().values()))
        futures = as_completed(map(submit, islice(missing, abreast)))
        try:
            for done, future in enumerate(futures, start=1):
                future.result()
                show(done * steps)
                futures.update(map(submit, islice(missing, 1)))
        except BaseException:
            client.cancel(list(futures.futures))
            raise


def _computed(
    variable: str, tile: Run, where: Where, functions: Any, rows: int, threads: int | None = None
) -> Iterator[tuple[str, Any, Any]]:
    """Yield parts of arrays, by name, of a tile, in pieces that fill a chunk, its `status` last."""
    row = 0
    for piece in pieces(**tile, rows=rows, threads=threads):
        part = slice(row, row + len(piece.n)), *where
        yield variable, part, piece.states
        if piece.attitude is not None:
            yield "attitude", part, piece.attitude
        for name, function in functions.items():
            yield name, part, stores.values_of(name, function, piece.states)
        row += len(piece.n)
    for name in ("final", "failed_at", "status"):
        yield name, where, getattr(piece, name)


def _write(arrays: Any, name: str, where: Where, values: Any) -> None:
    arrays[name][where] = values


def _compute(arrays: Any, *work: Any) -> None:
    """Compute and write a tile, on a worker with one thread."""
    for each in _computed(*work, 1):
        _write(arrays, *each)


def _tile(run: Run, where: Where) -> Run:
    """Return the run of a part of the batch, whose initial states are read."""
    body, omega0, eps, turns = (run[name] for name in ("body", "omega0", "eps", "attitude"))
    if isinstance(omega0, RandomStarts):
        omega0 = omega0._part(_along(omega0.shape, where), body.dimension)
    else:
        omega0 = np.asarray(_cut(omega0, where, 1))
    if body.shape:
        arrays = body._arrays.items()
        body = body._of({name: _cut(each, where, body._axes(name)) for name, each in arrays})
    eps = _cut(np.asarray(eps), where)
    turns = turns if turns is False else _cut(turns, where, 2)
    return {**run, "body": body, "omega0": omega0, "eps": eps, "attitude": turns}


def _cut(array: Any, where: Where, own: int = 0) -> Any:
    """Return the part of a parameter, whose last axes are its own."""
    return array[_along(array.shape[: array.ndim - own], where)]


def _along(shape: tuple[int, ...], where: Where) -> Where:
    """Return the slices, for a part of the batch, of an array that broadcasts to the batch."""
    last = where[len(where) - len(shape) :]
    return tuple(slice(0, 1) if n == 1 else each for n, each in zip(shape, last, strict=True))
