"""`suslov-fast run`: iterate a batch and print a summary."""

from __future__ import annotations

import argparse
import math
import shutil
import time
from contextlib import ExitStack, nullcontext
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Any

import numba
import numpy as np

import suslov_fast as sf

from .._engine.memory import require
from .._ensemble.workers import client_of
from .._jit import compile_timer
from .._runs.files import place_for
from .._runs.schema import entries_of
from .flags import STORE, CommandError, UsageError, flag
from .problem import orientation_of, problem_of, starts_of
from .summary import Facts, facts_of, facts_of_store, text_of
from .terminal import about, progress_bar, require_new, require_space

# Duration in seconds, without compilation, above which one-time work such as starting threads is
# negligible; shorter runs are timed a second time.
_LONG = 0.5


def run(options: argparse.Namespace) -> str:
    """Carry out the command, and return the summary."""
    in_store = options.output is not None and options.output.suffix.lower() == ".zarr"
    for name in () if in_store else STORE.split():
        if getattr(options, name):
            given = options.output or "none"
            raise UsageError(f"argument {flag(name)}: expected -o FILE.zarr with it, got {given}")
    body, eps, rotation = problem_of(options)
    if options.threads is not None:
        with about(f"argument --threads: got {options.threads}"):
            numba.set_num_threads(options.threads)
    starts = starts_of(options, body)
    facts = (_in_store if in_store else _in_memory)(options, body, eps, starts)
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


def _count(starts: Any) -> int:
    return math.prod(starts.shape if isinstance(starts, sf.RandomStarts) else starts.shape[:-1])


def _nbytes(options: argparse.Namespace, body: Any, count: int) -> int:
    """Return the number of bytes of the saved states."""
    rows = 1 if options.save_every is None else options.steps // options.save_every + 1
    D: int = body.dimension
    turning = options.attitude or options.orientation is not None
    return 8 * (D + turning * (D + 1) ** 2) * count * rows


def _in_memory(options: argparse.Namespace, body: Any, eps: float, starts: Any) -> Facts:
    """Iterate and write a batch."""
    path, count = options.output, _count(starts)
    if path is not None:
        require_new(path, options.force)
    nbytes = _nbytes(options, body, count)
    less = "lower --trajectories" if options.save_every is None else "raise --save-every"
    more = f"{less}, or write -o FILE.zarr, which is computed in parts"
    require(nbytes + 64 * count * body.dimension, more)
    if isinstance(starts, sf.RandomStarts):
        starts = starts.states(count, 0, body.dimension)
    settings = {**_settings(sf.iterate, options), "on_singular": "ignore"}
    # A file that cannot be written is detected before the run.
    with about(path), nullcontext() if path is None else place_for(path) as put:
        if path is not None:
            require_space(path, nbytes)
        with about("run"), progress_bar("iterating") as progress:
            for _ in range(2):
                with compile_timer() as compiling:
                    begin = time.perf_counter()
                    orbits = sf.iterate(body, starts, eps, **settings, progress=progress)
                    seconds = time.perf_counter() - begin - compiling()
                if seconds > _LONG:
                    break
        if put is not None:
            put(entries_of(orbits))
    # The closed form takes no steps: steps that iteration would take are comparable.
    stepped = "state" in orbits._resume
    rate = "steps_per_second" if stepped else "equivalent_steps_per_second"
    facts = facts_of(orbits, starts)
    return {**facts, "seconds": seconds, rate: count * options.steps / seconds}


def _in_store(options: argparse.Namespace, body: Any, eps: float, starts: Any) -> Facts:
    """Create, complete or extend a store."""
    path, sweeps = options.output, options.sweep
    settings = {**_settings(sf.ensemble, options), "store": path}
    settings["reductions"] = options.reduce
    settings["dims"] = (*(name for name, *_ in sweeps), "trajectory")
    body, eps_of_all = _swept(body, eps, sweeps)
    if not path.exists() and (options.save_every or not options.reduce):
        count = _count(starts) * math.prod(count for *_, count in sweeps)
        require_space(path, _nbytes(options, body, count))
    begin = time.perf_counter()
    with ExitStack() as stack:
        with about("argument --scheduler"):
            settings["scheduler"] = stack.enter_context(client_of(options.scheduler))
        progress = stack.enter_context(progress_bar("iterating"))
        stack.enter_context(about(path))
        compute = partial(sf.ensemble, body, starts, eps_of_all, **settings, progress=progress)
        try:
            compute()
        except (ValueError, TypeError) as error:
            if path.name not in str(error):  # the arguments are invalid
                raise UsageError(f"run: {error}") from error
            if not options.force or not (path / "zarr.json").exists():
                raise CommandError(f"{error}; --force replaces it") from error
            shutil.rmtree(path)  # the store of another run
            compute()
    seconds = time.perf_counter() - begin
    # Part of a store may be older: the rate of the whole is unknown.
    return {**facts_of_store(path), "seconds": seconds}


def _swept(body: Any, eps: Any, sweeps: list[tuple[str, float, float, int]]) -> tuple[Any, Any]:
    """Return the body and the step sizes with an axis for each sweep, before that of the states."""
    names = [name for name in body._names() if not body._axes(name)]
    for k, (name, low, high, count) in enumerate(sweeps):
        values = np.linspace(low, high, count).reshape(-1, *(1,) * (len(sweeps) - k))
        with about("argument --sweep"):
            if name == "eps":
                eps = values
            elif name in names:
                body = replace(body, **{name: values})
            else:
                raise ValueError(f"expected one of {', '.join(['eps', *names])}, got {name}")
    return body, eps
