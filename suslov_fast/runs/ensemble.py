"""Runs larger than memory, `ensemble` and `open_ensemble`: their datasets, and tiles to compute.

`tiles` computes the parts of the batch; `stores` says which ones a store lacks.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..bodies.base import Body
from ..checks import Reals, require, wrong
from ..engine.problem import Problem, check, warn_of_times
from ..engine.random_starts import RandomStarts
from ..engine.starts import RTOL, checked_settings, checked_times, either_map_or_motion
from ..engine.status import PENDING
from ..engine.stretches import Progress, reporter
from ..engine.threads import thread_count
from ..keywords import public
from ..maps import map_of
from .change import Change
from .changes import batch_of, checked_changes, nothing_changed
from .columns import FORMAT, in_stores, shape_of, sizes_of
from .files import stores
from .files.datasets import to_xarray, with_time
from .files.tiles import Steps, Task, Times, count_in, finish
from .iterate import checked_counts
from .motion import Motion
from .trajectories import Trajectories

if TYPE_CHECKING:
    import distributed
    import xarray

# Modules of the extra `large`.
_NEEDED = "zarr", "xarray", "dask"
# Bytes of states in a chunk.
_CHUNK = 2**24


@public
def ensemble(
    system: Any,
    x0: Any,
    /,
    eps: Reals | None = None,
    steps: int | None = None,
    *,
    store: Any,
    save_every: int | None = None,
    method: str = "auto",
    attitude: bool | ArrayLike = False,
    time: Reals | None = None,
    rtol: float = RTOL,
    atol: ArrayLike | None = None,
    max_step: float | None = None,
    stiff: bool | None = None,
    changes: Change | Sequence[Change] = (),
    dims: str | Sequence[str] | None = None,
    chunk: int | Mapping[str, int] | None = None,
    client: distributed.Client | None = None,
    progress: Progress = None,
) -> xarray.Dataset:
    """Compute a batch that is larger than memory, into a Zarr store (extra `large`).

    With `eps` and `steps` the states are those of :func:`iterate`, bit for bit; with `time` those
    of :func:`flow`. The batch is cut into tiles, and each is written when it is computed: if the
    process ends early, the same call computes the missing ones.

    Parameters
    ----------
    system
        As in :func:`iterate` or :func:`flow`.
    x0 : array_like(float, shape=(..., D)) or RandomStarts
        Initial states. Memory maps and Dask arrays are read in parts.
    eps, steps : optional
        As in :func:`iterate`.
    store : str, path-like or Zarr store
        The name of a folder, a URL that fsspec supports, or a Zarr store object.
    save_every : int, optional
        Store states 0, `save_every`, 2 `save_every`, ...; by default only the last states.
    method, attitude
        As in :func:`iterate`.
    time, rtol, atol, max_step, stiff, changes : optional
        As in :func:`flow`, in place of `eps`, `steps` and the arguments of maps. All states of a
        tile are in memory at once. Of changes a store keeps how often each of them acted, `count`.
    dims : optional
        As in :meth:`Trajectories.to_xarray`.
    chunk : int or mapping, optional
        Number of trajectories in a tile, or lengths along `dims`, and along "n" or "time". An
        existing store keeps its own.
    client : distributed.Client, optional
        Its Dask workers compute the tiles and write to the store.
    progress : bool or callable, optional
        As in :func:`iterate`; `done` counts the steps of all trajectories, or their states along a
        motion. A function is called before the first tile, with what the store already has, and
        after each tile.

    Returns
    -------
    xarray.Dataset
        The opened store, as by :func:`open_ensemble`. Trajectories that failed or passed a pole,
        and solutions that end, have a status, and cause no warning.

    Raises
    ------
    TypeError
        If neither `time` nor `eps` and `steps` are given, or arguments of both.
    ValueError
        If the store holds another run, or other data.
    OSError
        If its disk has too little free space.

    Examples
    --------
    For what fraction of 1000 random orbits is the step size too large?

    >>> import tempfile
    >>> from suslov_fast import RandomStarts, Status, Suslov3D, ensemble
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     runs = ensemble(body, RandomStarts(1000, 40.0), 0.2, 100, store=f"{folder}/runs.zarr")
    ...     print(dict(runs.final.sizes), float((runs.status == Status.SUPERCRITICAL).mean()))
    {'trajectory': 1000, 'component': 2} 0.199
    """
    for module in _NEEDED:
        checks.extra(module, "large")  # if one is missing, an error before any work
    if client is not None and not hasattr(client, "nthreads"):
        raise wrong("client", "a distributed.Client", type(client).__name__, TypeError)
    if client is not None and client.status in ("closing", "closed"):
        raise wrong("client", "an open client", "one that is closed")
    checks.instance("system", system, Body)
    of_map = {"save_every": save_every, "method": method, "attitude": attitude}
    tolerances = {"rtol": rtol, "atol": atol, "max_step": max_step, "stiff": stiff}
    of_motion = {**tolerances, "changes": changes}
    is_motion = either_map_or_motion("ensemble", eps, steps, time, **of_map, **of_motion)
    task: Task
    threads = None if client is None else 1
    if not is_motion:
        map = map_of(system, method)
        whole = check(map, system, RandomStarts((), 1.0), eps, threads, attitude=attitude)
        warn_of_times(whole)
        counts: Any = steps, save_every
        task = Steps(method, *checked_counts(*counts))
    else:
        settings = checked_settings(system, **tolerances)
        acting = tuple(change.of(system) for change in checked_changes(changes))
        task = Times(*checked_times(time), settings, acting)
        shape = checks.common_shape({"system": system.shape, "times": batch_of(acting)})
        whole = Problem(None, system, np.empty(0), 0.0, shape, thread_count(threads))
    is_random = isinstance(x0, RandomStarts)
    if not (is_random or isinstance(x0, np.memmap) or hasattr(x0, "dask")):
        x0 = checks.states("x0", x0, system.labels)
    shape = (*x0.shape, system.dimension) if is_random else x0.shape
    if shape[-1:] != (system.dimension,) or np.isnan(shape).any():
        raise wrong("x0", f"have a known shape (..., {system.dimension})", shape)
    batch = checks.common_shape({"x0": shape[:-1], "the other arguments": whole.batch})
    whole, store = whole._replace(omega=x0, batch=batch), stores.resolved(store)
    data = _template(whole, task, dims)
    reports = reporter(progress, math.prod(batch) * task.work)
    group, missing = stores.prepare(store, data, sizes_of_chunks(data, task, chunk))
    status = group["status"]
    tiles = [stores.place_of(tile, status.shape, status.chunks) for tile in missing]
    done = math.prod(batch) - sum(count_in(where) for where in tiles)
    finished = finish(tiles, whole, task, client, store)
    with reports as report, closing(finished):
        goes_on = report is None or report(done * task.work)
        while goes_on and (tile := next(finished, None)) is not None:
            done += count_in(tile)
            goes_on = report is None or report(done * task.work)
    if client is not None and done == math.prod(batch) and stores.tiles_in(store, group)[1]:
        received = f"{store} without tiles that were computed"
        raise wrong("client", "have workers that write to the store", received)
    return with_time(stores.opened(store))


@public
def open_ensemble(store: Any) -> xarray.Dataset:
    """Return the dataset in a store of :func:`ensemble`, finished or not (extra `large`).

    Parameters
    ----------
    store
        As in :func:`ensemble`.

    Returns
    -------
    xarray.Dataset
        Lazy, with the variables of :meth:`Trajectories.to_xarray`; the attributes are the arguments
        of the run. Trajectories that are not computed yet are NaN and have the status -128,
        PENDING.

    Raises
    ------
    FileNotFoundError
        If there is no store.
    ValueError
        If chunks are missing, or something else is there; on reading, if a chunk is damaged.

    Examples
    --------
    How many trajectories of an interrupted run are still to be computed?

    >>> import tempfile
    >>> from suslov_fast import RandomStarts, Suslov3D, ensemble, open_ensemble
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> stop = lambda done, steps: done < 30  # after the first tile, of three trajectories
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = f"{folder}/runs.zarr"
    ...     _ = ensemble(body, RandomStarts(9, 2.0), 0.2, 10, store=store, chunk=3, progress=stop)
    ...     int((open_ensemble(store).status == -128).sum())
    6
    """
    for module in _NEEDED:
        checks.extra(module, "large")
    return with_time(stores.opened(stores.resolved(store)))


def _template(whole: Problem, task: Task, dims: Any) -> xarray.Dataset:
    """Return the empty dataset of a run, with attributes that identify the run."""
    (map, body, x0, eps, batch, *_, turns), is_motion = whole, isinstance(task, Times)
    kind: Any = Motion if is_motion else Trajectories
    rows = task.rows
    require(24 * rows, "save fewer states")
    columns = in_stores(kind.__name__, *["turns"] * (turns is not None))
    sizes = sizes_of(batch, body.dimension, **{task.axis: rows})
    filled: dict[str, Any] = {
        column.name: np.broadcast_to(np.array(column.fill, column.type), shape_of(column, sizes))
        for column in columns
    }
    arguments = {**body.described}
    run: dict[str, Any] = {"body": body, **task.arguments}
    if isinstance(task, Times):
        arguments |= body.of_motion
        arguments["time"], filled["time"] = task.times, task.times.copy()
        if task.changes:
            run["changes"] = nothing_changed(body, task.changes, batch, PENDING)
            arguments["changes"] = json.dumps([_described(each) for each in task.changes])
    else:
        arguments |= {"eps": np.asarray(eps)} | ({} if turns is None else {"attitude": turns})
        run |= {"map": map, "eps": eps}
    data = to_xarray(kind._of(filled | run), dims)
    data = data if is_motion else data.drop_vars("time")
    flags = data.status.attrs
    flags["flag_values"] = [*flags["flag_values"], PENDING]
    flags["flag_meanings"] += " PENDING"
    names = *data.variables, *data.dims
    if refused := [repr(str(name)) for name in names if not _is_storable(name)]:
        expected = "have names without /, and other than '', '.' and 'zarr.json'"
        raise wrong("dims", expected, ", ".join(refused))
    identity = {
        name: value if isinstance(value, str) else stores.described(name, value)
        for name, value in arguments.items()
    }
    identity["x0"] = stores.described("x0", x0, few=0)
    identity |= {"body": type(body).__name__, "dims": ", ".join(data.status.dims)}
    identity["tiled"] = sorted(
        ({*filled, body.variable} | {*data.variables} & {"count"}) - {"states", "time"}
    )
    return data.assign_attrs(identity, format=FORMAT)


def _described(change: Change) -> dict[str, Any]:
    """Return what identifies a change, with its times as they are described."""
    times = change.times
    own = {} if times is None else {"times": stores.described("times", times)}
    return change.to_dict() | own


def _is_storable(name: Any) -> bool:
    """Return whether an array of a store can have a name, because a folder gets it as well."""
    text = str(name)
    is_reserved = text in ("", ".", "..", "zarr.json") or text.startswith("__")
    if is_reserved or any(character in text for character in "/\\\0"):
        return False
    return text.isprintable() and len(text.encode()) <= 200


def sizes_of_chunks(data: Any, task: Task, chunk: Any) -> dict[str, int]:
    """Return the lengths of chunks along each axis of the batch, and of saved states.

    A tile takes whole rows of the last axes. `chunk` is that of :func:`ensemble`.
    """
    lengths = {task.axis: task.rows, **data.status.sizes}
    expected = f"a number of trajectories, or sizes along {', '.join(map(str, lengths))}"
    width = 8 * max(data.sizes["component"], data.sizes.get("space", 0) ** 2)
    default = min(_CHUNK // (width * max(task.rows, 1)), task.most)
    by_axis = chunk if isinstance(chunk, Mapping) else {}
    arrays = len(data.attrs["tiled"])
    fewest = max(task.fewest, 4 * data.status.size * arrays // stores.MOST_CHUNKS)
    left = max(fewest, default) if chunk is None or by_axis else chunk
    if unknown := by_axis.keys() - lengths:
        raise wrong("chunk", expected, ", ".join(repr(name) for name in unknown))
    sizes: dict[str, int] = {}
    for name, length in reversed(lengths.items()):
        if name == task.axis:
            left = max(1, _CHUNK // (width * math.prod(sizes.values())))
        most = checks.integer("chunk", by_axis.get(name, left), 1, expected)
        parts = math.ceil(length / most) or 1  # of equal size, so that no chunk is half empty
        sizes[name] = math.ceil(length / parts) or 1
        left = max(1, left // sizes[name])
    chunks = math.prod(math.ceil(length / sizes[name]) for name, length in lengths.items())
    if chunk is not None and chunks * arrays > stores.MOST_CHUNKS:
        expected = f"so large that a store has at most {stores.MOST_CHUNKS} chunks"
        raise wrong("chunk", expected, f"{chunk}, for {chunks} tiles")
    return sizes
