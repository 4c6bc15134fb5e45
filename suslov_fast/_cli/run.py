"""`suslov-fast run`: iterate a batch and print what came of it."""

from __future__ import annotations

import argparse
import math
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from inspect import signature
from pathlib import Path
from typing import Any

import numba
import numpy as np

import suslov_fast as sf

from .._checks import FloatArray
from .._engine.memory import require
from .._maps.registry import map_of
from .._runs.files import place_for
from .._runs.schema import entries_of
from .options import STORE, CommandError, flag, usage_error
from .problem import Problem, orientation_of, problem_of, read_states, starts_of
from .summary import Facts, as_json, as_text, facts_of, facts_of_store, outcome_of
from .work import Work, announce, checking, reading, require_new, writing

# Trajectories and steps of ever larger parts of a run, which have compiled what it calls; a part
# of so many seconds runs as the whole does.
_PARTS, _LONG = [(1, 0), (64, 1), (4096, 8), (65_536, 64), (65_536, 512), (65_536, 4096)], 0.05


def run(options: argparse.Namespace) -> str:
    """Carry out the command, and return the summary."""
    problem = problem_of(options)
    starts = starts_of(options, problem.body)
    in_store = options.output is not None and options.output.suffix.lower() == ".zarr"
    for name in () if in_store else STORE.split():
        if getattr(options, name):
            raise usage_error(f"argument {flag(name)}: expected -o FILE.zarr with it, got none")
    with _threads(options.threads):
        facts = (_in_store if in_store else _in_memory)(options, problem, starts)
        rotation = problem.rotation
        facts |= {
            "rotation": None if rotation is None else rotation.tolist(),
            "threads": numba.get_num_threads(),
            "written": None if options.output is None else str(options.output),
            "version": sf.__version__,
        }
    if options.json:
        return as_json(facts)
    return as_text({**facts, **_for_people(facts, problem.body, in_store)})


def _for_people(facts: Facts, body: Any, in_store: bool) -> Facts:
    """Return the facts that are worded differently for people."""
    speed = None
    if "states_per_second" in facts:
        speed = (
            f"{facts['states_per_second']:.3g} states/s, by the closed form where it is faster; "
            f"--method {map_of(body).methods[1]} takes every step"
        )
    elif "steps_per_second" in facts:
        speed = f"{facts['steps_per_second']:.3g} steps/s"
    seconds = f"{facts['seconds']:.4g} s" + ("" if in_store else ", after compilation")
    return {"method": None, "saved_states": None, "speed": speed, "seconds": seconds}


@contextmanager
def _threads(count: int | None) -> Iterator[None]:
    before, limit = numba.get_num_threads(), numba.config.NUMBA_NUM_THREADS
    if count is not None and count > limit:
        raise usage_error(
            f"argument --threads: expected at most {limit} on this machine, got {count}"
        )
    numba.set_num_threads(count or before)
    try:
        yield
    finally:
        numba.set_num_threads(before)


def _settings(function: Any, options: argparse.Namespace, body: Any) -> Facts:
    """Return the arguments of `iterate` or `ensemble` that are options, by name."""
    wanted = signature(function).parameters.keys() - {"body", "omega0", "eps", "threads"}
    settings = {name: value for name, value in vars(options).items() if name in wanted}
    orientation = orientation_of(options, body.dimension + 1)
    return settings if orientation is None else {**settings, "attitude": orientation}


def _size(options: argparse.Namespace, body: Any, count: int) -> int:
    """Return the number of bytes of the saved states."""
    rows = 1 if options.save_every is None else options.steps // options.save_every + 1
    D: int = body.dimension
    turning = options.attitude or options.orientation is not None
    return 8 * (D + turning * (D + 1) ** 2) * count * rows


# ------------------------------------------------------------------ in memory


def _in_memory(options: argparse.Namespace, problem: Problem, starts: Any) -> Facts:
    """Iterate, write and check a batch."""
    body, eps, _ = problem
    path = options.output
    if path is not None:
        require_new(path, options.force)
    omega0 = _states(options, body, starts)
    settings = {**_settings(sf.iterate, options, body), "on_singular": "ignore"}
    with Work(path) as work, nullcontext() if path is None else _saving(path) as put:
        work.phase("compiling")
        with checking():
            _compile(body, omega0, eps, settings)
        if path is not None:
            announce(path, _size(options, body, len(omega0)))
        report = work.phase("iterating")
        begin = time.perf_counter()
        orbits = sf.iterate(body, omega0, eps, **settings, progress=report)
        seconds = time.perf_counter() - begin
        work.phase("writing")
        if put is not None:
            put(orbits)
            work.written = True
        outcome = outcome_of(orbits, omega0, work.phase("checking"))
    facts = {**facts_of(orbits), **outcome, "seconds": seconds}
    if orbits.method == "auto" and len(orbits._map.methods) > 1:  # steps may not be taken
        return {**facts, "states_per_second": orbits.omega[..., 0].size / seconds}
    return {**facts, "steps_per_second": len(omega0) * options.steps / seconds}


@contextmanager
def _saving(path: Path) -> Iterator[Callable[[sf.Trajectories], None]]:
    """Find out at once if a file cannot be written, and yield a function that saves a run."""
    with writing(path), ExitStack() as stack:
        put = stack.enter_context(place_for(path))

        def save(orbits: sf.Trajectories) -> None:
            put(entries_of(vars(orbits)))
            stack.close()  # now the file has its name

        yield save


def _states(options: argparse.Namespace, body: Any, starts: Any) -> FloatArray:
    """Return the starts as an array, if memory holds the whole run."""
    random = isinstance(starts, sf.RandomStarts)
    if isinstance(starts, Path):
        starts = read_states(starts, body.dimension)
    count = math.prod(starts.shape) if random else len(starts)
    needed = _size(options, body, count) + 64 * count * body.dimension
    require(needed, "raise --save-every or lower --trajectories")
    states: FloatArray = starts.states(count, 0, body.dimension) if random else starts
    return states


def _compile(body: Any, omega0: FloatArray, eps: float, settings: Facts) -> None:
    """Call ever larger parts of a run, which compiles what it calls."""
    for count, most in _PARTS:
        part = {**settings, "steps": min(most, settings["steps"])}
        for _ in range(2):  # the first one may compile
            begin = time.perf_counter()
            sf.iterate(body, omega0[:count], eps, **part)
            seconds = time.perf_counter() - begin
            if seconds < _LONG:
                break
        else:
            return
        if count >= len(omega0) and most >= settings["steps"]:
            return


# ------------------------------------------------------------------ in a store


def _in_store(options: argparse.Namespace, problem: Problem, starts: Any) -> Facts:
    """Make, finish or lengthen a store."""
    path = options.output
    body, eps, dims, coords = _swept(problem.body, problem.eps, options.sweep or [])
    if isinstance(starts, Path) and starts.suffix.lower() != ".npy":
        starts = read_states(starts, body.dimension)
    settings = _settings(sf.ensemble, options, body)
    settings |= {"store": path, "dims": dims, "coords": coords}
    if isinstance(starts, Path):
        with reading(starts):
            count = len(np.load(starts, mmap_mode="r", allow_pickle=False))
    else:
        count = math.prod(starts.shape[: None if isinstance(starts, sf.RandomStarts) else -1])
    count *= math.prod(len(values) for values in coords.values())
    if not options.reductions and not path.exists():
        announce(path, _size(options, body, count))
    with Work(path) as work, writing(path):
        settings["progress"] = work.phase("iterating")
        begin = time.perf_counter()
        _ensemble(path, options.force, body, starts, eps, **settings)
        seconds = time.perf_counter() - begin
        work.written = True
        facts = facts_of_store(path, work.phase("checking"))
    # A store may have been begun before: there is no rate of the whole.
    return {**facts, "seconds": seconds}


def _ensemble(path: Path, force: bool, *arguments: Any, **settings: Any) -> None:
    """Call `ensemble`; replace the store of another run if that was asked for."""
    try:
        with checking():
            sf.ensemble(*arguments, **settings)
    except CommandError as error:
        if not str(error).startswith("store:"):  # the arguments are wrong
            raise
        if not force or not any((path / name).exists() for name in ("zarr.json", ".zgroup")):
            raise CommandError(f"{error}; --force replaces it") from error
        shutil.rmtree(path)
        sf.ensemble(*arguments, **settings)


def _swept(
    body: Any, eps: Any, sweeps: list[tuple[str, float, float, int]]
) -> tuple[Any, Any, tuple[str, ...], dict[str, FloatArray]]:
    """Return the body and the step sizes with an axis for each sweep, before that of the starts."""
    coords = {}
    for k, (name, low, high, count) in enumerate(sweeps):
        values = coords[f"sweep_{name}"] = np.linspace(low, high, count)
        column = values.reshape(-1, *(1,) * (len(sweeps) - k))
        if name == "eps":
            eps = column
        else:
            with checking("argument --sweep"):
                body = _with_parameter(body, name, column)
    return body, eps, (*coords, "trajectory"), coords


def _with_parameter(body: Any, name: str, values: FloatArray) -> Any:
    known: dict[str, tuple[str, int | None]] = {}
    for field in body._names():
        for k in range(body.dimension) if body._own_axes else (None,):
            known[field if k is None else f"{field}{k + 1}"] = field, k
    if name not in known:
        raise ValueError(f"expected one of eps, {', '.join(known)}, got {name}")
    field, k = known[name]
    if k is None:
        return replace(body, **{field: values})
    old = getattr(body, field)
    new = np.array(
        np.broadcast_to(old, (*np.broadcast_shapes(values.shape, old.shape[:-1]), old.shape[-1]))
    )
    new[..., k] = values
    return replace(body, **{field: new})
