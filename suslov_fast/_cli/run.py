"""`suslov-fast run`: iterate a batch and print what came of it."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numba
import numpy as np

from .. import __version__
from .._bodies import Suslov3D
from .._conserved import first_integral, first_integral_of
from .._map import iterate
from .._paper import PICTURES
from .._status import Status
from .._trajectories import Trajectories
from .._validation import FloatArray
from .errors import UserError
from .files import output_file, read_states, written_whole
from .values import integer, number, positive

_TRAJECTORIES = 65_536
_PARAMETERS = ("I1", "I2", "I13", "I23")
# Random starts fill the square |Omega1|, |Omega2| <= _EXTENT.
_EXTENT = 2.0


def add_to(commands: Any) -> None:
    """Add the command to a parser."""
    parser = commands.add_parser(
        "run",
        help="iterate a batch of trajectories and print a summary",
        description=(
            "Iterate a batch of trajectories of the discrete Suslov problem. With no options: "
            f"{_TRAJECTORIES:,} random starts of the paper's first picture, 1000 steps."
        ),
    )
    parser.set_defaults(command=run)
    body = parser.add_argument_group("body (a picture of the paper, or all four parameters)")
    body.add_argument("--picture", metavar="1..4", help="body and step size of a picture (1)")
    body.add_argument("--I1", type=positive, help="moment of inertia")
    body.add_argument("--I2", type=positive, help="moment of inertia")
    body.add_argument("--I13", type=number, help="product of inertia")
    body.add_argument("--I23", type=number, help="product of inertia")
    body.add_argument("--eps", type=number, help="step size (that of the picture)")
    batch = parser.add_argument_group("batch")
    batch.add_argument(
        "--trajectories", type=integer(1), metavar="N", help=f"random starts ({_TRAJECTORIES})"
    )
    batch.add_argument("--seed", type=integer(0), help="of the random starts (0)")
    batch.add_argument(
        "--initial", type=Path, metavar="FILE", help="starts from a .npy or .csv of two columns"
    )
    batch.add_argument("--steps", type=integer(0), default=1000, metavar="N", help="(1000)")
    batch.add_argument(
        "--method", choices=("auto", "canonical", "ds2"), default="auto", help="(auto)"
    )
    batch.add_argument("--threads", type=integer(1), metavar="N", help="(all)")
    output = parser.add_argument_group("output")
    output.add_argument(
        "--save-every", type=integer(1), metavar="K", help="keep every K-th state (the last only)"
    )
    output.add_argument(
        "-o",
        dest="output",
        type=output_file,
        metavar="FILE.npz",
        help="write states, step numbers, parameters and status",
    )


def run(options: argparse.Namespace) -> None:
    """Carry out the command."""
    body, eps = _problem(options)
    if options.threads is not None and options.threads > numba.config.NUMBA_NUM_THREADS:
        raise UserError(
            f"argument --threads: expected at most {numba.config.NUMBA_NUM_THREADS} on this "
            f"machine, got {options.threads}"
        )
    omega0 = _starts(options)
    threads = options.threads or numba.get_num_threads()
    settings = {"save_every": options.save_every, "method": options.method, "threads": threads}
    with written_whole(options.output) if options.output else nullcontext() as file:
        try:
            # What has to be compiled is compiled by a short run, which is not timed.
            iterate(body, omega0, eps, min(options.steps, 4), on_singular="ignore", **settings)
            begin = time.perf_counter()
            trajectories = iterate(
                body,
                omega0,
                eps,
                options.steps,
                on_singular="ignore",
                progress=_bar(),
                **settings,
            )
            seconds = time.perf_counter() - begin
        except MemoryError as error:
            raise UserError(f"expected a batch that fits in memory, got: {error}") from error
        if file is not None:
            _save(file, trajectories, omega0, options)
    _print_summary(trajectories, omega0, options, threads, seconds)


def _problem(options: argparse.Namespace) -> tuple[Suslov3D, float]:
    given = [name for name in _PARAMETERS if getattr(options, name) is not None]
    if not given:
        choice = "1" if options.picture is None else options.picture
        if choice not in map(str, PICTURES):
            raise UserError(f"argument --picture: expected 1, 2, 3 or 4, got {choice!r}")
        picture = PICTURES[int(choice)]
        return picture.body, picture.eps if options.eps is None else options.eps
    if options.picture is not None:
        raise UserError(f"expected either --picture or the body's parameters, got --{given[0]} too")
    missing = [f"--{name}" for name in (*_PARAMETERS, "eps") if getattr(options, name) is None]
    if missing:
        raise UserError(
            "expected all of --I1 --I2 --I13 --I23 --eps or none, got no " + " ".join(missing)
        )
    return Suslov3D(*(getattr(options, name) for name in _PARAMETERS)), options.eps


def _starts(options: argparse.Namespace) -> FloatArray:
    if options.initial is None:
        count = options.trajectories or _TRAJECTORIES
        _check_memory(count, options)
        return np.random.default_rng(options.seed or 0).uniform(-_EXTENT, _EXTENT, (count, 2))
    for name in ("trajectories", "seed"):
        if getattr(options, name) is not None:
            raise UserError(f"expected either --initial or --{name}, got both")
    states = read_states(options.initial)
    _check_memory(len(states), options)
    return states


def _check_memory(count: int, options: argparse.Namespace) -> None:
    """Refuse a batch that no memory holds, rather than be killed in the middle."""
    saved = 1 if options.save_every is None else options.steps // options.save_every + 1
    needed = 16 * count * (saved + 8)
    if hasattr(os, "sysconf"):
        available = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if needed > available:
            raise UserError(
                f"expected a batch that fits in {available / 2**30:.1f} GiB of memory, "
                f"got one of {needed / 2**30:.1f} GiB; raise --save-every or lower --trajectories"
            )


def _bar() -> bool:
    """Whether to show a bar: on a terminal, if tqdm is there."""
    if not sys.stderr.isatty():
        return False
    try:
        import tqdm  # noqa: F401
    except ImportError:
        return False
    return True


def _save(file: Any, trajectories: Trajectories, omega0: FloatArray, options: Any) -> None:
    I1, I2, I13, I23 = trajectories.body.parameters
    np.savez(
        file,
        omega=trajectories.omega,
        n=trajectories.n,
        t=trajectories.t,
        omega0=omega0,
        final=trajectories.final,
        status=trajectories.status,
        failed_at=trajectories.failed_at,
        I1=I1,
        I2=I2,
        I13=I13,
        I23=I23,
        eps=trajectories.eps,
        steps=options.steps,
        **({} if options.save_every is None else {"save_every": options.save_every}),
        method=options.method,
        version=__version__,
    )


def _print_summary(
    trajectories: Trajectories,
    omega0: FloatArray,
    options: argparse.Namespace,
    threads: int,
    seconds: float,
) -> None:
    I1, I2, I13, I23 = trajectories.body.parameters
    count = len(omega0)
    rate = count * options.steps / seconds
    rows = [
        ("body", f"I1 = {I1:g}, I2 = {I2:g}, I13 = {I13:g}, I23 = {I23:g}"),
        ("step size", f"eps = {trajectories.eps:g}"),
        ("trajectories", f"{count:,}"),
        ("steps", f"{options.steps:,}"),
        ("threads", f"{threads}"),
        ("wall time", f"{seconds:.4g} s, after compilation"),
        ("speed", f"{rate:.3g} steps/s"),
        ("drift of F", _drift(trajectories, omega0)),
    ]
    for status in Status:
        number_of = np.count_nonzero(trajectories.status == status)
        if number_of:
            rows.append(("status", f"{number_of:,} {status.name}: {status.message}"))
    if options.output:
        rows.append(("written", str(options.output)))
    for name, value in rows:
        print(f"{name:<14}{value}")


def _drift(trajectories: Trajectories, omega0: FloatArray) -> str:
    """The largest relative drift of F over the last and the saved states."""
    body, eps = trajectories.body, trajectories.eps
    start = first_integral(body, omega0, eps)
    largest, unknown = 0.0, 0
    states = [trajectories.final[:, np.newaxis], trajectories.omega]
    for saved in (some for array in states for some in _portions(array)):
        F = first_integral_of(body, saved, np.asarray(eps), saved.shape[:-1])
        exists = np.isfinite(saved).all(axis=-1) & (start > 0)[:, np.newaxis]
        with np.errstate(all="ignore"):
            drift = abs(F / start[:, np.newaxis] - 1.0)[exists]
        largest = max(largest, float(drift[np.isfinite(drift)].max(initial=0.0)))
        unknown += int(np.count_nonzero(~np.isfinite(drift)))
    text = f"{largest:.2g}, largest relative"
    return f"{text}; {unknown:,} states with F beyond float64" if unknown else text


def _portions(states: FloatArray) -> Iterator[FloatArray]:
    """Parts of the saved states, along time, for which temporary arrays are affordable."""
    length = max(1, 2**20 // len(states))
    for first in range(0, states.shape[1], length):
        yield states[:, first : first + length]
