"""`ensemble`: batches that are larger than memory, in a Zarr store, by chunks of trajectories."""

from __future__ import annotations

import glob
import hashlib
import json
import math
import os
import pickle
import shutil
import uuid
import warnings
from collections.abc import Generator, Iterator, Mapping
from contextlib import closing
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from . import checks
from .calls import Progress, reporter
from .checks import Reals, common_shape, extra, start_of, warn, wrong
from .fields.base import Body
from .keywords import public, refuse_unknown
from .motions.events import checked_events
from .motions.flow import flow
from .motions.motion_arguments import either_map_or_motion, system_of
from .orbits.iterate import iterate
from .results.frames import to_xarray
from .status import IntegrationWarning, Status

if TYPE_CHECKING:
    import distributed
    import xarray

_AXIS = "trajectory"  # the last axis of the batch, which is divided into chunks
_INNER = {"system": 0, "x0": 1, "eps": 0, "t0": 0, "attitude": 2}  # numbers of axes after the batch
_BYTES = 2**23  # the size of the states of a chunk, by default
_HOW = "choose another name, or delete it"
_PENDING = -128  # the status of trajectories that are not computed yet


@public
def ensemble(
    system: Any,
    x0: Any,
    /,
    store: Any,
    *,
    time: Reals | None = None,
    eps: Reals | None = None,
    steps: int | None = None,
    chunks: int | None = None,
    client: distributed.Client | None = None,
    progress: Progress = None,
    **options: Any,
) -> xarray.Dataset:
    """Compute a batch that is larger than memory, into a Zarr store (extra `large`).

    The trajectories on the last axis of the batch are divided into chunks. :func:`flow` or
    :func:`iterate` computes a chunk, and the chunk is written to the store. If the process ends
    early, the same call computes the missing chunks. States have the same bits as in one call of
    these functions for the whole batch.

    Parameters
    ----------
    system : Field, Map, a body or callable
        A single system, or a batch. With `time`, a function of the state, as in :func:`flow`.
    x0 : array_like(float, shape=(..., N, D)) or callable
        Initial states; or a function x0(k) that returns the initial states (..., n, D) of chunk k,
        with the same n for all chunks. A call that continues a store compares only ``x0(0)``.
    store : str, path-like or Zarr store
        The name of a folder, a URL that fsspec supports, or a store of Zarr.
    time, eps, steps : optional
        The times of :func:`flow`, or the step size and the number of steps of :func:`iterate`.
    chunks : int, optional
        The largest number of chunks. By default the states of a chunk take at most 8 MB. If x0 is a
        function, `chunks` is required, and x0 is called for k = 0, 1, ..., chunks - 1.
    client : distributed.Client, optional
        A Dask client, for workers that compute chunks and write them to the store. By default this
        process computes the chunks, one after the other.
    progress : bool or callable, optional
        As in :func:`iterate`; it counts trajectories in place of steps.
    **options
        Other arguments of :func:`flow` or :func:`iterate`. Derivatives are not stored.

    Returns
    -------
    xarray.Dataset
        ``xarray.open_zarr(store)``, with the variables that `to_xarray` of a run returns. The last
        axis of the batch is the dimension "trajectory". Trajectories that are not computed yet have
        the status -128.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, or the store contains something else. Nothing is computed then.

    Warns
    -----
    IntegrationWarning
        Once, with the number of trajectories that failed and their statuses.

    See Also
    --------
    flow, iterate : Compute a batch in memory.

    Examples
    --------
    Of 400 random initial states of a double well, how many end in the right one?

    >>> import tempfile
    >>> import numpy as np
    >>> from suslov_fast import Field, ensemble
    >>> well = Field(lambda x: (x[1], x[0] - x[0] ** 3 - 0.2 * x[1]), "q p")
    >>> starts = lambda k: np.random.default_rng([7, k]).uniform(-2, 2, (100, 2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     data = ensemble(well, starts, f"{folder}/well.zarr", time=[50, 100], chunks=4)
    ...     q = data.states.sel(time=100, component="q")
    ...     print(dict(data.states.sizes), int((q > 0).sum()))
    {'time': 2, 'trajectory': 400, 'component': 2} 207
    """
    xarray, _, zarr = (extra(name, "large") for name in ("xarray", "dask.array", "zarr"))
    if time is None:
        checks.instance("system", system, Body)
    checks.instance("store", store, (str, os.PathLike, zarr.abc.store.Store))
    if isinstance(store, (str, os.PathLike)) and "://" not in os.fspath(store):
        store = os.path.abspath(os.path.expanduser(store))  # the same folder for workers
    function: Any = iterate if time is None else flow
    refuse_unknown("ensemble", options, ensemble, function)
    x0, t0 = start_of(x0, options.get("t0"))
    options |= {} if t0 is None else {"t0": checks.real_number("t0", t0)}
    if callable(x0) and chunks is None:
        raise wrong("chunks", "given beside a function x0: how often it is called")
    count = 1 if chunks is None else checks.integer("chunks", chunks, 1)
    first = x0(0) if callable(x0) else x0
    system = system_of(system, first)
    of_function = _checked(system, eps, steps, time, options)
    states = system._layout.states("x0", first)
    given = {"system": system, "x0": states, **options, **of_function}
    batch = _batch_of(given, count if callable(x0) else 0)
    N = batch[-1]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntegrationWarning)  # one warning for all chunks follows
        # A run without trajectories raises the errors of arguments.
        none = _part(given | ({"x0": states[..., :0, :]} if callable(x0) else {}), slice(0, 0), N)
        empty = function(none.pop("system"), none.pop("x0"), **none)
        if chunks is None:
            count = 1 + 8 * len(empty.states) * math.prod(batch) * system.dimension // _BYTES
        length = math.ceil(N / count)
        names = [*empty.to_xarray().status.dims[:-1], _AXIS]
        whole, encoding = _whole(to_xarray(empty, names), given, N, length)
        whole.attrs["ensemble"] = json.dumps(_digests(given) | {"chunks": length})
        status = _prepared(store, whole, encoding)
        given |= {"x0": x0 if callable(x0) else states} | ({"threads": 1} if client else {})
        columns = [name for name, how in encoding.items() if "fill_value" in how]
        parts = [slice(first, min(first + length, N)) for first in range(0, N, length)]
        missing = [k for k, part in enumerate(parts) if (status[..., part] == _PENDING).any()]
        calls = (
            (function, _part(given, parts[k], N), k, parts[k], names, columns, store)
            for k in missing
        )
        done = N - sum(parts[k].stop - parts[k].start for k in missing)
        with reporter(progress, N) as report, closing(_computed(client, calls)) as finished:
            goes_on = report is None or report(done)
            while goes_on and (part := next(finished, None)):
                done += part.stop - part.start
                goes_on = report is None or report(done)
    data = xarray.open_zarr(store)
    _check_end(data, goes_on, store)
    return data


def _digests(given: Mapping[str, Any]) -> dict[str, str]:
    """Return digests of all arguments that decide about the states, and of each parameter."""
    run = {k: _digest(value) for k, value in given.items() if k not in ("threads", "system")}
    system = given["system"].to_dict()
    parameters = system.pop("parameters", {})
    if "names" not in system:  # a body, with its parameters as entries
        parameters, system = system, {"body": system.pop("body")}
    run |= {f"parameter {name}": _digest(value) for name, value in parameters.items()}
    return run | {"system": _digest(system)}


def _check_end(data: Any, goes_on: bool, store: Any) -> None:
    """Raise an error if chunks are missing; warn once of all failures and passed poles."""
    status = data.status.values
    if goes_on and (status == _PENDING).any():
        raise wrong("client", "have workers that write to the store", f"{store} lacks chunks")
    texts, failed = [], status[(status < 0) & (status > _PENDING)]
    if failed.size:
        kinds = ", ".join(f"{(failed == k).sum()} {Status(k).name}" for k in np.unique(failed))
        texts.append(f"{failed.size} of {status.size} trajectories failed: {kinds}")
    if unkept := (status == Status.NOT_KEPT).sum():
        texts.append(f"{unkept} of {status.size} trajectories do not keep field.conserving(...)")
    if "first_pole" in data and (passed := (data.first_pole.values >= 0).sum()):
        texts.append(f"{passed} of {status.size} trajectories passed a pole before their end")
    if texts:
        warn(f"ensemble: {'; '.join(texts)}", IntegrationWarning)


def _checked(system: Any, eps: Any, steps: Any, time: Any, options: Any) -> dict[str, Any]:
    """Return checked arguments of `flow` or `iterate`, in addition to the options of the user."""
    if system._has_eps:
        either_map_or_motion("ensemble", eps, steps, time)
    if time is not None:
        events = tuple(each.of(system) for each in checked_events(options.get("events", ())))
        return {"time": checks.real_number("time", time), "events": events}
    of_eps = {} if eps is None else {"eps": checks.real_number("eps", eps)}
    return {"steps": steps, "on_singular": "ignore", **of_eps}


def _batch_of(given: dict[str, Any], chunks: int) -> tuple[int, ...]:
    """Return the batch shape of the arguments; a function x0 is called for `chunks` numbers."""
    shapes: dict[str, Any] = {
        name: np.shape(given.get(name, 0.0))[: -k or None] for name, k in _INNER.items()
    }
    if chunks:
        shapes["x0"] = *shapes["x0"][:-1], chunks * sum(shapes["x0"][-1:])
    batch = common_shape(shapes)
    if not batch or not math.prod(batch) or (chunks and shapes["x0"][-1] != batch[-1]):
        states = f"states (..., N, {given['system'].dimension})"
        raise wrong("x0", states, f"of shape {given['x0'].shape}")
    return batch


def _part(given: dict[str, Any], where: slice, N: int) -> dict[str, Any]:
    """Return the arguments for the trajectories `where` of N."""
    part = dict(given)
    for name in {*_INNER} & {*given}:
        axis = len(np.shape(given[name])) - 1 - _INNER[name]
        if axis >= 0 and np.shape(given[name])[axis] == N:
            part[name] = given[name][(slice(None),) * axis + (where,)]
    return part


def _digest(value: Any) -> str:
    """Return a short text that identifies a value."""
    if isinstance(value, np.ndarray):
        content = str(value.shape).encode() + value.tobytes()
    else:
        plain = value.item() if isinstance(value, np.generic) else value
        content = json.dumps(plain, default=lambda each: each.to_dict()).encode()
    return hashlib.sha256(content).hexdigest()[:16]


def _whole(data: Any, given: dict[str, Any], N: int, length: int) -> Any:
    """Return the dataset of all N trajectories, lazy if chunks write it, and its encoding."""
    import dask.array
    from zarr.codecs import BloscCodec

    # This codec makes states smaller than Zarr's default codec does, in a third of the time.
    codec = BloscCodec(cname="lz4", clevel=1, shuffle="bitshuffle")
    parameters = given["system"]._arrays | {k: a for k, a in given.items() if k == "eps"}
    encoding: dict[str, Any] = {}
    variables = {}
    for name, each in data.variables.items():
        if _AXIS not in each.dims:
            variables[name] = each
        elif name != "time":  # times follow from n and eps, and are not stored
            sizes = each.sizes | {_AXIS: N}
            pieces = tuple((sizes | {_AXIS: length}).values())
            encoding[name] = {"chunks": pieces, "compressors": (codec,)}
            values: Any
            if name in parameters:
                values = np.reshape(parameters[name], tuple(sizes.values()))
            else:
                fill = np.nan if each.dtype.kind == "f" else _PENDING if name == "status" else -1
                encoding[name]["fill_value"] = fill
                values = dask.array.full([*sizes.values()], fill, dtype=each.dtype, chunks=pieces)
            variables[name] = each.dims, values, each.attrs
    coords = {name: variables.pop(name) for name in data.coords if name in variables}
    return type(data)(variables, coords, data.attrs), encoding


def _prepared(store: Any, whole: Any, encoding: Any) -> Any:
    """Return the statuses in the store of this run; make the store if there is none."""
    stored = _opened(store)
    if stored is None:
        _make(store, whole, encoding)
        stored = _opened(store)
    asked, known = (json.loads(data.attrs.get("ensemble", "{}")) for data in (whole, stored))
    if others := [name for name in {**asked, **known} if known.get(name) != asked.get(name)]:
        received = f"{store}, of a run with another {', '.join(others)}: {_HOW}"
        raise wrong("store", "new, or of the same run", received)
    return stored.status.values


def _opened(store: Any) -> Any:
    """Return the dataset in the store of an ensemble; None if there is no store."""
    import xarray

    try:
        return xarray.open_zarr(store, chunks=None, consolidated=True)
    except FileNotFoundError:
        return None
    except (ValueError, OSError) as error:
        raise wrong("store", "new, or of an ensemble", f"{store}: {_HOW}") from error


def _make(store: Any, whole: Any, encoding: Any) -> None:
    """Make the store. A folder gets its name when it is complete, so no incomplete one is found."""
    import zarr

    is_folder = isinstance(store, str) and "://" not in store
    new = f"{store}.{uuid.uuid4().hex}.new" if is_folder else store
    try:
        options: Any = {"mode": "w-", "compute": False, "consolidated": False, "zarr_format": 3}
        whole.to_zarr(new, encoding=encoding, **options)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # format 3 does not define consolidated metadata yet
            zarr.consolidate_metadata(new)  # the last step: a store without metadata is refused
        if is_folder:
            os.rename(new, store)
    except OSError:
        if _opened(store) is None:  # else another process has made the store
            raise
    finally:
        for folder in glob.glob(f"{glob.escape(store)}.*.new") if is_folder else ():
            shutil.rmtree(folder, ignore_errors=True)


def _computed(client: Any, calls: Iterator[Any]) -> Generator[slice, None, None]:
    """Compute chunks, here or on the workers of a client; yield the place of each chunk."""
    if client is None:
        yield from (_write(*call) for call in calls)
        return
    import cloudpickle
    from distributed import as_completed

    def submitted(count: int) -> list[Any]:
        # The task itself unpickles its call, and raises if a user's function cannot be imported. If
        # the worker unpickled the call, the worker would end, and the wait would not.
        texts = (cloudpickle.dumps(call) for call in islice(calls, count))
        return [client.submit(_write_pickled, text, pure=False) for text in texts]

    # A few calls wait at the scheduler, so that no worker waits; few, because calls contain states.
    futures = as_completed(submitted(4 + 2 * sum(client.nthreads().values())))
    for future in futures:
        yield future.result()
        futures.update(submitted(1))


def _write_pickled(text: bytes) -> slice:
    """Compute and write a chunk, for the pickled arguments of `_write`."""
    return _write(*pickle.loads(text))


def _write(
    function: Any, given: Any, k: int, where: slice, names: Any, columns: Any, store: Any
) -> slice:
    """Compute chunk k, and write it to the store, the status last; return its place."""
    system, x0 = given.pop("system"), given.pop("x0")
    states = system._layout.states(f"x0({k})", x0(k)) if callable(x0) else x0
    data = to_xarray(function(system, states, **given), names)
    if data.sizes[_AXIS] != where.stop - where.start:
        raise wrong(f"x0({k})", "as many states as x0(0)", f"of shape {states.shape}")
    data = data.drop_vars({*data.variables} - {*columns})
    for part in (data.drop_vars("status"), data[["status"]]):
        part.to_zarr(store, region={_AXIS: where}, consolidated=False, write_empty_chunks=True)
    return where
