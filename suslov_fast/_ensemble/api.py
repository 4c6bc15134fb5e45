"""Runs in a store: made, finished, made longer, opened."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .._engine.arguments import Body
from .._engine.progress import Progress, check_progress, reporter
from .._runs.iterate import Method
from .control import only_writer, stopping
from .starts import RandomStarts

if TYPE_CHECKING:
    import dask.array
    import distributed
    import xarray

    from .job import Job

Compression = Literal["lz4", "zstd"]


def ensemble(
    body: Body,
    omega0: ArrayLike | str | os.PathLike[str] | RandomStarts | dask.array.Array,
    eps: ArrayLike,
    steps: int,
    *,
    store: Any,
    save_every: int | None = None,
    method: Method = "auto",
    attitude: bool | ArrayLike = False,
    reductions: Sequence[str] | None = None,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
    chunk: int | Mapping[str, int] | None = None,
    compression: Compression | None = None,
    scheduler: distributed.Client | str | None = None,
    verify: bool = False,
    progress: Progress = None,
) -> xarray.Dataset:
    """Iterate a batch of any size, and store it in a Zarr store as it is computed.

    The run is cut into tiles of the batch, and these along time, each of which is computed as
    :func:`iterate` does, bit for bit, and marked once it is stored. Wherever a process ends, the
    same call again computes what is missing. More steps than those of a finished store make it
    longer, without computing the old ones again.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., D)), str or path-like, RandomStarts, dask.array.Array
        Initial angular velocities, as in :func:`iterate`; also the name of a .npy file, which is
        read in parts, :class:`RandomStarts`, or a Dask array. All but random ones are read once
        more than needed, to know them again.
    eps : array_like(float, shape=(...))
        Step size, as in :func:`iterate`.
    steps : int
        Number of steps, 0 or more; those of the store or more.
    store : str, path-like or Zarr store
        The name of a folder, a URL that fsspec knows, or a store as Zarr takes it.
    save_every : int or None
        Keep the states 0, k, 2k, ... up to `steps`; None keeps only the last. With `reductions`,
        look at these states, or at all.
    reductions : sequence of str, optional
        Store no states but the last, and instead, for each trajectory, what these names stand for:
        "first_integral_drift", "modified_energy_drift", "energy_drift" (the largest relative change
        since the start), "omega_min", "omega_max" (the extrema of each component).
    method : str
        As in :func:`iterate`.
    attitude : bool or array_like(float, shape=(..., n, n))
        As in :func:`iterate`.
    dims : str or sequence of str, optional
        Names for the axes of the batch; by default "trajectory", or "batch_0", "batch_1", ...
    coords : mapping, optional
        Coordinates along them, as `xarray.Dataset.assign_coords` takes them.
    chunk : int or mapping, optional
        How many trajectories a tile has, or its sizes along `dims` and "n", the states that are
        kept. By default a chunk of states takes 16 MiB at most, or what 64 trajectories take, and
        each thread holds four of them at most. Results do not depend on it.
    compression : {"lz4", "zstd"}, optional
        Compress chunks, with shuffled bytes; by default they are stored as they are.
    scheduler : distributed.Client or str, optional
        Have tiles computed by Dask workers, on one thread each; or the address of a scheduler. The
        store must be one that they all reach. By default this process computes, on all threads.
    verify : bool
        Read what is stored already, and compute again what is damaged. After another start of the
        machine that wrote it, this is done once without being asked for.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, total)``, both in
        steps of one trajectory.

    Returns
    -------
    xarray.Dataset
        Of the store, lazy: see :func:`open_ensemble`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above, or the store holds another run; nothing is
        computed or written then.
    BlockingIOError
        If another process writes to the store.
    OSError
        If it cannot be written to.
    ImportError
        If Dask, xarray or Zarr are not installed: ``pip install 'suslov_fast[large]'``.
    KeyboardInterrupt
        After SIGINT or SIGTERM, once the chunks in hand are stored.

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
    _require_large()
    check_progress(progress)
    from .job import job_of
    from .store import open_dataset, resolved

    job = job_of(
        body,
        omega0,
        eps,
        steps,
        store=resolved(store),
        save_every=save_every,
        method=method,
        attitude=attitude,
        reductions=reductions,
        dims=dims,
        chunk=chunk,
        compression=compression,
    )
    _finish(job, coords, scheduler, verify, progress)
    return open_dataset(job.store)


def _finish(
    job: Job, coords: Mapping[Any, Any] | None, scheduler: Any, verify: bool, progress: Progress
) -> None:
    """Create or recognise the store, and compute what it lacks."""
    from . import compute, store, workers

    identity, dataset = job.identity(), store.dataset_of(job, coords)
    with (
        nullcontext() if scheduler is None else workers.client_of(scheduler) as client,
        only_writer(job.store, store.is_folder(job.store)),
    ):
        if (known := store.recognised(job, identity)) is None:
            store.create(job, identity, dataset)
        else:
            job = known
            with store.advice(job.store):
                store.lengthen(job, dataset, verify)
            store.refuse_code(job.store)
        arrays = store.Arrays(job.store)
        tiles = list(np.ndindex(job.plan.grid))
        for index in tiles if verify else ():
            if not compute.is_whole(job.part(job.plan.where(index)), index, arrays):
                store.withdraw(job, arrays, index, whole=True)
        with store.advice(job.store):
            done = np.asarray(arrays[store.STEPS_DONE][...])
        missing = [index for index in tiles if done[index] != job.steps]
        for index in missing:
            if done[index] >= 0:  # of a shorter run
                store.withdraw(job, arrays, index)
        if not missing:
            return
        made = sum(math.prod(job.plan.shape(each)) * max(int(done[each]), 0) for each in tiles)
        with stopping() as stop, reporter(progress, math.prod(job.plan.batch) * job.steps) as show:

            def report(steps: int) -> None:
                nonlocal made
                made += steps
                show(made)

            report(0)
            if client is None:
                compute.run(job, arrays, missing, report, stop)
            else:
                workers.run(job, client, missing, report, stop)
        left = int((arrays[store.STEPS_DONE][...] != job.steps).sum())
        if left:
            raise KeyboardInterrupt(
                f"stopped with {len(tiles) - left} of {len(tiles)} tiles in {job.store} finished; "
                "the same call goes on from there"
            )


def open_ensemble(store: Any) -> xarray.Dataset:
    """A store of :func:`ensemble`, finished or not.

    Parameters
    ----------
    store : str, path-like or Zarr store
        As in :func:`ensemble`.

    Returns
    -------
    xarray.Dataset
        With the names of :meth:`Trajectories.to_xarray`, lazy. Its attribute "tiles_done" says how
        much of it is there, as "3 of 8"; of what is not, states are NaN and the status is -128.

    Raises
    ------
    FileNotFoundError
        If there is nothing of that name.
    ValueError
        If it is no such store.
    ImportError
        If Dask, xarray or Zarr are not installed: ``pip install 'suslov_fast[large]'``.

    Examples
    --------
    >>> import tempfile
    >>> from suslov_fast import RandomStarts, Suslov3D, ensemble, open_ensemble
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = ensemble(body, RandomStarts(9, 2.0), 0.2, 10, store=f"{folder}/runs.zarr", chunk=4)
    ...     open_ensemble(f"{folder}/runs.zarr").attrs["tiles_done"]
    '3 of 3'
    """
    _require_large()
    from .store import open_dataset, resolved

    return open_dataset(resolved(store))


def _require_large() -> None:
    try:
        import dask.array  # noqa: F401
        import filelock  # noqa: F401
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "ensemble needs dask, xarray and zarr: pip install 'suslov_fast[large]'"
        ) from error
