"""`suslov-fast run`: iterate a batch and print what came of it."""

from __future__ import annotations

import argparse
import math
import shutil
import time
from contextlib import nullcontext
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import event

import suslov_fast as sf

from .._checks import FloatArray
from .._engine.memory import require
from .._runs.files import place_for
from .._runs.schema import entries_of
from .options import STORE, CommandError, UsageError, flag
from .problem import orientation_of, problem_of, read_starts, starts_of
from .summary import Facts, as_json, as_text, facts_of, facts_of_store
from .work import about, announce, progress_bar, require_new

# Seconds, without compilation, of a run that what is done once, such as to start threads, does not
# delay much; shorter ones are timed when that is done.
_LONG = 0.5


def run(options: argparse.Namespace) -> str:
    """Carry out the command, and return the summary."""
    body, eps, rotation = problem_of(options)
    starts = starts_of(options, body)
    in_store = options.output is not None and options.output.suffix.lower() == ".zarr"
    for name in () if in_store else STORE.split():
        if getattr(options, name):
            raise UsageError(f"argument {flag(name)}: expected -o FILE.zarr with it, got none")
    if options.threads is not None:
        with about("argument --threads", UsageError):
            numba.set_num_threads(options.threads)
    facts = (_in_store if in_store else _in_memory)(options, body, eps, starts)
    facts |= {
        "rotation": None if rotation is None else rotation.tolist(),
        "threads": numba.get_num_threads(),
        "written": None if options.output is None else str(options.output),
        "version": sf.__version__,
    }
    return as_json(facts) if options.json else as_text(facts)


def _settings(function: Any, options: argparse.Namespace, body: Any) -> Facts:
    """Return the arguments of `iterate` or `ensemble` that are options, by name."""
    wanted = signature(function).parameters.keys() - {"body", "omega0", "eps", "threads"}
    settings = {name: value for name, value in vars(options).items() if name in wanted}
    orientation = orientation_of(options, body.dimension + 1)
    return settings if orientation is None else {**settings, "attitude": orientation}


def _nbytes(options: argparse.Namespace, body: Any, count: int) -> int:
    """Return the number of bytes of the saved states."""
    rows = 1 if options.save_every is None else options.steps // options.save_every + 1
    D: int = body.dimension
    turning = options.attitude or options.orientation is not None
    return 8 * (D + turning * (D + 1) ** 2) * count * rows


def _in_memory(options: argparse.Namespace, body: Any, eps: float, starts: Any) -> Facts:
    """Iterate and write a batch."""
    path = options.output
    if path is not None:
        require_new(path, options.force)
    if isinstance(starts, Path):
        starts = read_starts(starts, body.dimension)
    count = math.prod(starts.shape) if isinstance(starts, sf.RandomStarts) else len(starts)
    nbytes = _nbytes(options, body, count)
    require(nbytes + 64 * count * body.dimension, "raise --save-every or lower --trajectories")
    if isinstance(starts, sf.RandomStarts):
        starts = starts.states(count, 0, body.dimension)
    settings = {**_settings(sf.iterate, options, body), "on_singular": "ignore"}
    # A file that cannot be written is found before the run.
    with about(path), nullcontext() if path is None else place_for(path) as put:
        if path is not None:
            announce(path, nbytes)
        with about("run", UsageError), progress_bar("iterating") as report:
            for _ in range(2):
                with event.install_listener("numba:compiler_lock", event.TimingListener()) as lock:
                    begin = time.perf_counter()
                    orbits = sf.iterate(body, starts, eps, **settings, progress=report)
                    seconds = time.perf_counter() - begin - (lock.duration if lock.done else 0.0)
                if seconds > _LONG:
                    break
        if put is not None:
            put(entries_of(vars(orbits)))
    takes_steps = orbits.method != "auto" or len(orbits._map.methods) == 1
    done = count * options.steps if takes_steps else orbits.omega[..., 0].size
    rate = "steps_per_second" if takes_steps else "states_per_second"
    return {**facts_of(orbits, starts), "seconds": seconds, rate: done / seconds}


def _in_store(options: argparse.Namespace, body: Any, eps: float, starts: Any) -> Facts:
    """Make, finish or lengthen a store."""
    path = options.output
    if isinstance(starts, Path):
        if starts.suffix.lower() != ".npy":
            starts = read_starts(starts, body.dimension)
        else:  # read in parts
            with about(starts):
                starts = np.load(starts, mmap_mode="r", allow_pickle=False)
    settings = {**_settings(sf.ensemble, options, body), "store": path}
    body, eps_of_all, settings["dims"], settings["coords"] = _swept(body, eps, options.sweep or [])
    if not path.exists() and (options.save_every or not options.reductions):
        shape = starts.shape if isinstance(starts, sf.RandomStarts) else starts.shape[:-1]
        announce(path, _nbytes(options, body, math.prod(shape) * math.prod(_lengths(options))))
    begin = time.perf_counter()
    with about(path), progress_bar("iterating") as report:
        _ensemble(path, options.force, body, starts, eps_of_all, **settings, progress=report)
    seconds = time.perf_counter() - begin
    # A store may have been begun before: there is no rate of the whole.
    return {**facts_of_store(path), "seconds": seconds}


def _lengths(options: argparse.Namespace) -> list[int]:
    return [count for *_, count in options.sweep or []]


def _ensemble(path: Path, force: bool, *arguments: Any, **settings: Any) -> None:
    """Call `ensemble`; replace the store of another run if that was asked for."""
    try:
        sf.ensemble(*arguments, **settings)
    except (ValueError, TypeError) as error:
        if path.name not in str(error):  # the arguments are wrong
            raise UsageError(f"run: {error}") from error
        if not force or not (path / "zarr.json").exists():
            raise CommandError(f"{error}; --force replaces it") from error
        shutil.rmtree(path)
        sf.ensemble(*arguments, **settings)


def _swept(
    body: Any, eps: Any, sweeps: list[tuple[str, float, float, int]]
) -> tuple[Any, Any, tuple[str, ...], dict[str, FloatArray]]:
    """Return the body and the step sizes with an axis for each sweep, before that of the starts.

    An axis has the name of what varies along it, and its values as coordinate.
    """
    coords = {}
    for k, (name, low, high, count) in enumerate(sweeps):
        values = np.linspace(low, high, count)
        column = values.reshape(-1, *(1,) * (len(sweeps) - k))
        with about("argument --sweep", UsageError):
            if name == "eps":
                eps = column
            elif not body._own_axes and name in body._names():
                body = replace(body, **{name: column})
            else:
                body, coords[name] = _with_entry(body, name, column), values
    return body, eps, (*(name for name, *_ in sweeps), "trajectory"), coords


def _with_entry(body: Any, name: str, values: FloatArray) -> Any:
    """Return a body one entry of whose vectors, J2 for one, has other values."""
    entries = {
        f"{field}{k + 1}": (field, k)
        for field in body._names() * bool(body._own_axes)
        for k in range(body.dimension)
    }
    if name not in entries:
        expected = ", ".join(entries or body._names())
        raise ValueError(f"expected one of eps, {expected}, got {name}")
    field, k = entries[name]
    old = getattr(body, field)
    batch = np.broadcast_shapes(values.shape, old.shape[:-1])
    new = np.array(np.broadcast_to(old, (*batch, old.shape[-1])))
    new[..., k] = values
    return replace(body, **{field: new})
