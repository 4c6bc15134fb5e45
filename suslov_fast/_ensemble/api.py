"""Creation, completion, extension and opening of stored runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .._checks import aligned, common_shape, integer, one_of
from .._docs import filled
from .._engine.arguments import BodyOrField, check, orientations_of
from .._engine.memory import require
from .._engine.progress import Progress, check_progress
from .._engine.random_starts import RandomStarts
from .._maps import map_of
from .._runs.iterate import Method
from .._runs.labelled import batch_names
from .compute import client_of, compute_tiles
from .job import Job, cut
from .reductions import checked_reductions
from .starts import source_of
from .store import (
    check_names,
    lazy_dataset,
    only_writer,
    open_dataset,
    prepare,
    resolved,
    stored_dims,
)

if TYPE_CHECKING:
    import dask.array
    import distributed
    import xarray

Compression = Literal["lz4", "zstd"]


@filled
def ensemble(
    body: BodyOrField,
    omega0: ArrayLike | str | os.PathLike[str] | RandomStarts | dask.array.Array,
    eps: ArrayLike,
    steps: int,
    *,
    store: Any,
    save_every: int | None = None,
    method: Method = "auto",
    attitude: bool | ArrayLike = False,
    reductions: Sequence[str] | Mapping[str, Callable[[Any], Any]] | None = None,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
    chunk: int | Mapping[str, int] | None = None,
    compression: Compression | None = None,
    scheduler: distributed.Client | str | None = None,
    verify: bool = False,
    progress: Progress = None,
) -> xarray.Dataset:
    """Iterate a batch of any size into a Zarr store.

    The results are bit-identical to those of :func:`iterate`. They are stored in pieces: if the
    process ends early, repeat the call to compute the rest. A call with more steps extends a
    finished store without recomputing it.

    Parameters
    ----------
    %(body)s
    omega0 : array_like(float, shape=(..., D)), str or path-like, RandomStarts, dask.array.Array
        Initial states, as in :func:`iterate`; also the name of a .npy file or a Dask array, both
        read in parts, or :class:`RandomStarts`. All but random ones are read twice, the first time
        for a digest that identifies them.
    %(eps)s
    steps : int
        Number of steps, at least 0 and at least those of the store.
    store : str, path-like or Zarr store
        The name of a folder, a URL that fsspec supports, or a Zarr store object.
    %(save_every)s
    method : str
        As in :func:`iterate`.
    attitude : bool or array_like(float, shape=(..., n, n))
        As in :func:`iterate`.
    reductions : sequence of str or mapping, optional
        Quantities of each trajectory over the saved states, or, with ``save_every=None``, over all
        states, of which only the last is stored: "first_integral_drift", "modified_energy_drift",
        "energy_drift" (the largest relative change since the start), "omega_min", "omega_max" (the
        extrema of each component, named by the variable of the states). Or functions of states
        (..., D) with real values (...), by name, whose values at the saved states are stored as
        variables with these names. Their source, and the values that they carry, are part of the
        identity of the store.
    %(dims, coords)s
    chunk : int or mapping, optional
        Number of trajectories computed together, or sizes along `dims` and "n", the saved states.
        By default the states of a chunk take 16 MiB, or the size of 64 trajectories if that is
        more. Results do not depend on it.
    compression : {"lz4", "zstd"}, optional
        Compress chunks, with shuffled bytes; by default they are not compressed.
    scheduler : distributed.Client or str, optional
        A Dask client, or the address of a scheduler, whose workers compute the run and have access
        to the store. By default this process computes on all threads.
    verify : bool
        Read all stored data, and write anew what is damaged or missing, metadata included.
    progress : bool or callable, optional
        True shows a bar (needs tqdm); a callable is called as ``progress(done, total)``, both in
        steps of one trajectory.

    Returns
    -------
    xarray.Dataset
        The dataset of the store, lazy: see :func:`open_ensemble`.

    Raises
    ------
    TypeError, ValueError
        If an argument is invalid, or the store holds another run, one of an earlier version, or,
        without `verify`, damaged metadata; then nothing is computed or written.
    BlockingIOError, OSError
        If another process writes to the store, or it cannot be written to.
    %(needs_large)s
    KeyboardInterrupt
        After SIGINT or SIGTERM, when the current pieces are stored.

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
    store = resolved(store)
    check_progress(progress)
    record = map_of(body)
    one_of("method", method, record.methods)
    arguments = {"omega0": omega0, "eps": eps, "attitude": attitude}
    omega0, eps, attitude = aligned(arguments, body._labels).values()
    orientations = orientations_of(body, record.carries_attitude, attitude)
    given = check(body, (), {"eps": eps} | orientations)
    step_size, orientation = np.array(given.eps), given.orientation
    if orientation is not None:
        orientation = orientation.copy()
    source = source_of(omega0, body._labels)
    batch = common_shape({"omega0": source.shape, "the other arguments": given.batch})
    steps = integer("steps", steps, 0)
    if save_every is not None:
        save_every = integer("save_every", save_every, 1, "None or an integer of at least 1")
    if compression is not None:
        one_of("compression", compression, ("lz4", "zstd"))
    names, monitors = checked_reductions(body, reductions)
    dims = stored_dims(store) if dims is None else dims
    dims = batch_names(dims, batch, monitors, body._coordinates)
    run = body, step_size, source, orientation, batch, steps, save_every, method, names, monitors
    job = cut(Job(*run, dims, store, compression), chunk)
    check_names("dims", job, job.dims)
    check_names("reductions", replace(job, monitors={}), monitors)
    require(8 * job.saved, "raise save_every")
    identity, dataset = job.identity(), lazy_dataset(job, coords)
    with client_of(scheduler) as client, only_writer(job.store):
        job = prepare(job, identity, dataset, verify)
        compute_tiles(job, client, verify, progress)
    return open_dataset(job.store)


@filled
def open_ensemble(store: Any) -> xarray.Dataset:
    """Open a store of :func:`ensemble`, finished or not.

    Parameters
    ----------
    store : str, path-like or Zarr store
        As in :func:`ensemble`.

    Returns
    -------
    xarray.Dataset
        With the names of :meth:`Trajectories.to_xarray`, lazy. Its attribute "tiles_done" is the
        number of finished tiles, as "3 of 8"; in the others states that are not computed are NaN,
        and `status` and `failed_at` are -128.

    Raises
    ------
    FileNotFoundError
        If there is nothing of that name.
    ValueError
        If it is no store of :func:`ensemble`, one of an earlier version, or one with damaged
        metadata or parameters; and if decoding its arrays could run code.
    %(needs_large)s

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
    return open_dataset(resolved(store))
