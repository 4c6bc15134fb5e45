"""`suslov-fast run`: iterate a batch and print a summary."""

from __future__ import annotations

import argparse
import math
import shutil
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import numba
import numpy as np

import suslov_fast as sf

from .._engine.memory import require
from .._jit import compile_timer
from .._runs.files import place_for
from .._runs.schema import entries_of
from .flags import SAVED, STORE, CommandError, UsageError, flag
from .problem import body_and_step_of, orientation_of, starts_of
from .summary import Facts, facts_of, facts_of_store, text_of
from .terminal import about, progress_bar, require_new

# Duration in seconds, without compilation, above which one-time work such as starting threads is
# negligible.
_LONG_RUN = 0.5


def summary_of_run(options: argparse.Namespace) -> str:
    in_store = options.output is not None and options.output.suffix.lower() == ".zarr"
    required = {} if in_store else dict.fromkeys(STORE.split(), "-o FILE.zarr")
    if options.output is None:
        required |= dict.fromkeys(SAVED.split(), "-o FILE")
    for name, output in required.items():
        if getattr(options, name):
            given = options.output or "none"
            raise UsageError(f"argument {flag(name)}: expected {output} with it, got {given}")
    body, eps, rotation = body_and_step_of(options)
    if options.threads is not None:
        most = numba.config.NUMBA_NUM_THREADS
        if options.threads > most:
            expected = f"expected at most {most}, that of the processors or NUMBA_NUM_THREADS"
            raise UsageError(f"argument --threads: {expected}, got {options.threads}")
        numba.set_num_threads(options.threads)
    starts = starts_of(options, body)
    facts = (_store_run if in_store else _hold_run)(options, body, eps, starts)
    facts |= {
        "rotation": None if rotation is None else rotation.tolist(),
        "threads": numba.get_num_threads(),
        "written": None if options.output is None else str(options.output),
        "version": sf.__version__,
    }
    return text_of(facts, options.json)


def _settings(function: Any, options: argparse.Namespace) -> Facts:
    """Return the arguments of `iterate` or `ensemble` that are options, by name."""
    wanted = signature(function).parameters.keys() - {"body", "omega0", "eps", "threads"}
    settings = {name: value for name, value in vars(options).items() if name in wanted}
    orientation = orientation_of(options)
    return settings if orientation is None else {**settings, "attitude": orientation}


def _require_space(path: Path, shape: tuple[int, ...], options: argparse.Namespace) -> None:
    """Raise CommandError before the run if its states do not fit on the disk."""
    rows = options.steps // options.save_every + 1 if options.save_every else 1
    turned = options.attitude or options.orientation is not None
    numbers = shape[-1] + turned * (shape[-1] + 1) ** 2
    needed = 8 * rows * math.prod(shape[:-1]) * numbers
    free = shutil.disk_usage(path.absolute().parent).free
    if needed > free:
        expected = f"expected a disk with space for the run, of which {free:,} bytes are free"
        raise CommandError(f"{path}: {expected}, got {needed:,} bytes; raise --save-every")


def _hold_run(options: argparse.Namespace, body: Any, eps: float, starts: Any) -> Facts:
    path = options.output
    if path is not None:
        require_new(path, options.force)
    # A file that cannot be written is detected before the run.
    with about(path), nullcontext() if path is None else place_for(path) as put:
        try:
            with about("run"), progress_bar("iterating") as progress:
                if isinstance(starts, sf.RandomStarts):
                    starts = starts.states(starts.shape[0], dimension=body.dimension)
                if path is not None:
                    _require_space(path, np.shape(starts), options)
                settings = {**_settings(sf.iterate, options), "on_singular": "ignore"}
                iterate = partial(sf.iterate, body, starts, eps, **settings, progress=progress)
                orbits, seconds = _timed(iterate)
        except MemoryError as error:
            text = str(error).partition(";")[0]
            how = "-o FILE.zarr writes a run of any size, a larger --save-every less"
            raise CommandError(f"run: {text}; {how}") from error
        if put is not None:
            put(**entries_of(orbits))
    # The closed form takes no steps: steps that iteration would take are comparable.
    stepped = "state" in orbits._resume
    rate = "steps_per_second" if stepped else "equivalent_steps_per_second"
    steps = orbits.status.size * options.steps
    return {**facts_of(orbits, starts), "seconds": seconds, rate: steps / seconds}


def _timed(iterate: Callable[[], sf.Trajectories]) -> tuple[sf.Trajectories, float]:
    """Return a run and its duration, without compilation; short runs are made twice."""
    for _ in range(2):
        with compile_timer() as compiling:
            begin = time.perf_counter()
            orbits = iterate()
            seconds = time.perf_counter() - begin - compiling()
        if seconds > _LONG_RUN:
            break
    return orbits, seconds


def _store_run(options: argparse.Namespace, body: Any, eps: float, starts: Any) -> Facts:
    """Create, complete or extend a store."""
    path, sweeps = options.output, options.sweep
    settings = {**_settings(sf.ensemble, options), "store": path, "reductions": options.reduce}
    settings["dims"] = (*(name for name, *_ in sweeps), "trajectory")
    body, eps_of_all = _swept(body, eps, sweeps)
    begin = time.perf_counter()
    with progress_bar("iterating") as progress, about(path):
        compute = partial(sf.ensemble, body, starts, eps_of_all, **settings, progress=progress)
        try:
            compute()
        except (ValueError, TypeError) as error:
            if path.name not in str(error):  # the arguments are invalid
                raise UsageError(f"run: {error}") from error
            if not (path / "zarr.json").exists():
                raise
            if not options.force:
                raise CommandError(f"{error}; --force replaces it") from error
            shutil.rmtree(path)  # the store of another run
            compute()
    seconds = time.perf_counter() - begin
    # Part of a store may be older: the rate of the whole is unknown.
    return {**facts_of_store(path), "seconds": seconds}


def _swept(body: Any, eps: Any, sweeps: list[tuple[str, float, float, int]]) -> tuple[Any, Any]:
    """Return the body and the step sizes with an axis for each sweep, before that of the states."""
    names = [name for name in body._names() if not body._axes(name)] + [*body._coordinates]
    for k, (name, low, high, count) in enumerate(sweeps):
        require(16 * count, "fewer values of --sweep need less")
        values = np.linspace(low, high, count).reshape(-1, *(1,) * (len(sweeps) - k))
        with about("argument --sweep"):
            if name == "eps":
                eps = values
            elif name in names:
                body = body._swept(name, values)
            else:
                raise ValueError(f"expected one of {', '.join(['eps', *names])}, got {name}")
    return body, eps
