"""`suslov-fast run`: iterate a batch and print what came of it."""

from __future__ import annotations

import argparse
import os
import stat
import sys
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np

from .. import __version__
from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._engine.arguments import Body
from .._runs.iterate import iterate
from . import ensemble
from .errors import UserError
from .files import place, result_file
from .phases import Phases
from .problem import TRAJECTORIES, add_batch_to, add_body_to, problem_of, starts_of
from .summary import Facts, as_json, as_text, facts_of, outcome_of
from .values import integer

# A call of so many seconds runs as the whole run does: on all threads.
_WARM = 0.05


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "run",
        help="iterate a batch of trajectories and print a summary",
        description=(
            "Iterate a batch of trajectories of the discrete Suslov problem. With no options: "
            f"{TRAJECTORIES:,} random starts of the paper's first picture, 1000 steps."
        ),
    )
    parser.set_defaults(command=run)
    add_body_to(parser)
    batch = add_batch_to(parser)
    batch.add_argument("--steps", type=integer(0), default=1000, metavar="N", help="(1000)")
    batch.add_argument("--method", default="auto", help="as that of iterate (auto)")
    batch.add_argument("--threads", type=integer(1), metavar="N", help="(all)")
    output = parser.add_argument_group("output")
    output.add_argument(
        "--save-every", type=integer(1), metavar="K", help="keep every K-th state (the last only)"
    )
    output.add_argument(
        "--attitude", action="store_true", help="carry the orientation of the body along"
    )
    output.add_argument(
        "-o",
        dest="output",
        type=result_file,
        metavar="FILE",
        help="write all that Trajectories.load needs, to a .npz, .nc or .zarr",
    )
    ensemble.add_to(parser)
    output.add_argument(
        "--json", action="store_true", help="print the summary as one JSON object, for programs"
    )


def run(options: argparse.Namespace) -> str:
    """Carry out the command, and return the summary."""
    body, eps, rotation = problem_of(options)
    settings = _settings(options)
    if ensemble.is_store(options.output):
        return ensemble.run(options, body, eps, _bar())
    ensemble.require_none(options)
    omega0 = starts_of(options, body)
    phases = Phases(options.output)
    linked = _has_hard_links(options.output)
    try:
        with phases, place(options.output) as put:
            phases.enter("compiling")
            _warm_up(body, omega0, eps, options.steps, settings)
            phases.enter("iterating")
            begin = time.perf_counter()
            trajectories = iterate(body, omega0, eps, options.steps, progress=_bar(), **settings)
            seconds = time.perf_counter() - begin
            if options.output:
                phases.enter("writing")
                put(trajectories)
        with phases:
            phases.enter("checking")
            outcome = outcome_of(trajectories, omega0)
    except MemoryError as error:
        raise UserError(f"expected a batch that fits in memory, got: {error}") from error
    facts = {
        **facts_of(trajectories),
        "rotation": None if rotation is None or _is_identity(rotation) else rotation.tolist(),
        "threads": settings["threads"],
        "seconds": seconds,
        "steps_per_second": len(omega0) * options.steps / seconds,
        **outcome,
        "written": None if options.output is None else str(options.output),
        "version": __version__,
    }
    if options.json:
        return as_json(facts)
    return as_text(_for_people(facts, trajectories.body, options, linked))


def _settings(options: argparse.Namespace) -> Facts:
    """Arguments of `iterate`, by name."""
    limit = numba.config.NUMBA_NUM_THREADS
    if options.threads is not None and options.threads > limit:
        raise UserError(
            f"argument --threads: expected at most {limit} on this machine, got {options.threads}"
        )
    return {
        "save_every": options.save_every,
        "method": options.method,
        "threads": options.threads or numba.get_num_threads(),
        "on_singular": "ignore",
        **({"attitude": True} if options.attitude else {}),
    }


def _warm_up(body: Body, omega0: FloatArray, eps: float, steps: int, settings: Facts) -> None:
    """Have compiled what the run calls, by ever larger parts of it.

    They grow until one takes long enough for what calls of the size of the run do. One that is
    long may have been compiling, and is repeated.
    """
    sizes = [(1, 0), (64, 1), (4096, 8), (65_536, 64), (65_536, 512), (65_536, 4096)]
    for count, most in sizes:
        for _ in range(2):
            begin = time.perf_counter()
            try:
                iterate(body, omega0[:count], eps, min(most, steps), **settings)
            except ValueError as error:
                raise UserError(str(error)) from error
            seconds = time.perf_counter() - begin
            if seconds < _WARM:
                break
        else:
            return
        if count >= len(omega0) and most >= steps:
            return


def _is_identity(rotation: FloatArray) -> bool:
    return bool((rotation == np.eye(len(rotation))).all())


def _has_hard_links(path: Path | None) -> bool:
    """Whether there is a file of that name that has others too."""
    if path is None:
        return False
    try:
        status = os.stat(path)
    except OSError:
        return False
    return stat.S_ISREG(status.st_mode) and status.st_nlink > 1


def _for_people(facts: Facts, body: Body, options: argparse.Namespace, linked: bool) -> Facts:
    """The facts, with what explains them."""
    speed = f"{facts['steps_per_second']:.3g} steps/s"
    last_only = options.method == "auto" and options.save_every is None
    if isinstance(body, Suslov3D) and last_only:
        speed += ", by the closed form where it is faster; --method canonical iterates"
    written = facts["written"]
    if linked:
        written += ", under this name alone: its hard links keep what they had"
    shown = {name: value for name, value in facts.items() if name not in ("method", "saved_states")}
    return {**shown, "speed": speed, "written": written}


def _bar() -> bool:
    """Whether to show a bar: on a terminal, if tqdm is there."""
    if not sys.stderr.isatty():
        return False
    try:
        import tqdm  # noqa: F401
    except ImportError:
        return False
    return True
