"""`suslov-fast run`: iterate a batch and print what came of it."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import fields
from pathlib import Path
from typing import Any

import numba
import numpy as np

from .. import __version__
from .._bodies.nd import SuslovND
from .._bodies.paper import PICTURES
from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._conserved import energy, first_integral, modified_energy
from .._engine.arguments import Body
from .._engine.threads import CROSSOVER
from .._map import JUMP, iterate, jumps
from .._status import Status
from .._trajectories import Trajectories
from .errors import UserError
from .files import output_file, read_body, read_states, written_whole
from .values import integer, number, numbers, positive

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
    body = parser.add_argument_group(
        "body (a picture of the paper, or all parameters and a step size)"
    )
    body.add_argument("--picture", metavar="1..4", help="body and step size of a picture (1)")
    body.add_argument("--I1", type=positive, help="moment of inertia")
    body.add_argument("--I2", type=positive, help="moment of inertia")
    body.add_argument("--I13", type=number, help="product of inertia")
    body.add_argument("--I23", type=number, help="product of inertia")
    body.add_argument(
        "--inertia", type=Path, metavar="FILE", help="n x n inertia matrix, .npy or .csv"
    )
    body.add_argument("--J", type=numbers, metavar="J1,J2,...", help="in n dimensions: I_ii + I_nn")
    body.add_argument("--I", type=numbers, metavar="I1,I2,...", help="in n dimensions: I_in")
    body.add_argument("--eps", type=number, help="step size (that of the picture)")
    batch = parser.add_argument_group("batch")
    batch.add_argument(
        "--trajectories", type=integer(1), metavar="N", help=f"random starts ({_TRAJECTORIES})"
    )
    batch.add_argument("--seed", type=integer(0), help="of the random starts (0)")
    batch.add_argument(
        "--initial", type=Path, metavar="FILE", help="starts from a .npy or .csv, a row for each"
    )
    batch.add_argument("--steps", type=integer(0), default=1000, metavar="N", help="(1000)")
    batch.add_argument("--method", default="auto", help="as that of iterate (auto)")
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
    omega0 = _starts(options, body)
    threads = options.threads or numba.get_num_threads()
    settings = {"save_every": options.save_every, "method": options.method, "threads": threads}
    try:
        iterate(body, omega0[:0], eps, 0, **settings)
    except ValueError as error:
        raise UserError(f"argument --{error}") from error
    # Compiled is what a run of as many threads calls; the time of that is not counted.
    first_steps = min(options.steps, JUMP + 2 * CROSSOVER // len(omega0))
    with written_whole(options.output) if options.output else nullcontext() as file:
        try:
            iterate(body, omega0, eps, first_steps, on_singular="ignore", **settings)
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


def _problem(options: argparse.Namespace) -> tuple[Body, float]:
    """The body and the step size, from the one group of options that is given."""
    groups = {"picture": ("picture",), "3D": _PARAMETERS, "matrix": ("inertia",), "nD": ("J", "I")}
    given = {
        group: [f"--{name}" for name in names if getattr(options, name) is not None]
        for group, names in groups.items()
    }
    chosen = [group for group, names in given.items() if names]
    if len(chosen) > 1:
        both = " and ".join(given[group][0] for group in chosen)
        raise UserError(f"expected one body, got {both}")
    if chosen in ([], ["picture"]):
        choice = options.picture or "1"
        if choice not in map(str, PICTURES):
            raise UserError(f"argument --picture: expected 1, 2, 3 or 4, got {choice!r}")
        picture = PICTURES[int(choice)]
        return picture.body, picture.eps if options.eps is None else options.eps
    needed = (*groups[chosen[0]], "eps")
    missing = [f"--{name}" for name in needed if getattr(options, name) is None]
    if missing:
        wanted = " ".join(f"--{name}" for name in needed)
        raise UserError(f"expected all of {wanted} or none, got no {' '.join(missing)}")
    if options.inertia is not None:
        return read_body(options.inertia), options.eps
    parameters = [getattr(options, name) for name in groups[chosen[0]]]
    try:
        return (Suslov3D if chosen == ["3D"] else SuslovND)(*parameters), options.eps
    except ValueError as error:
        raise UserError(f"arguments of the body: {error}") from error


def _starts(options: argparse.Namespace, body: Body) -> FloatArray:
    if options.initial is None:
        count = options.trajectories or _TRAJECTORIES
        _check_memory(count, body, options)
        generator = np.random.default_rng(options.seed or 0)
        return generator.uniform(-_EXTENT, _EXTENT, (count, body.dimension))
    for name in ("trajectories", "seed"):
        if getattr(options, name) is not None:
            raise UserError(f"expected either --initial or --{name}, got both")
    states = read_states(options.initial, body.dimension)
    _check_memory(len(states), body, options)
    return states


def _check_memory(count: int, body: Body, options: argparse.Namespace) -> None:
    """Refuse a batch that no memory holds, rather than be killed in the middle."""
    saved = 1 if options.save_every is None else options.steps // options.save_every + 1
    needed = 8 * body.dimension * count * (saved + 8)
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
    np.savez(
        file,
        omega=trajectories.omega,
        n=trajectories.n,
        t=trajectories.t,
        omega0=omega0,
        final=trajectories.final,
        status=trajectories.status,
        failed_at=trajectories.failed_at,
        **{
            field.name: getattr(trajectories.body, field.name)
            for field in fields(trajectories.body)
        },
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
    count = len(omega0)
    speed = f"{count * options.steps / seconds:.3g} steps/s"
    if jumps(trajectories.body, options.method, options.save_every, options.steps):
        speed += ", by the closed form; --method canonical iterates"
    rows = [
        ("body", _description(trajectories.body)),
        ("step size", f"eps = {trajectories.eps:g}"),
        ("trajectories", f"{count:,}"),
        ("steps", f"{options.steps:,}"),
        ("threads", f"{threads}"),
        ("wall time", f"{seconds:.4g} s, after compilation"),
        ("speed", speed),
    ]
    for name, quantity in _quantities(trajectories):
        rows.append((f"drift of {name}", _drift(trajectories, omega0, quantity)))
    for status in Status:
        number_of = np.count_nonzero(trajectories.status == status)
        if number_of:
            rows.append(("status", f"{number_of:,} {status.name}: {status.message}"))
    if options.output:
        rows.append(("written", str(options.output)))
    for name, value in rows:
        print(f"{name:<16}{value}")


def _description(body: Body) -> str:
    if isinstance(body, Suslov3D):
        return ", ".join(f"{field.name} = {getattr(body, field.name):g}" for field in fields(body))
    with np.printoptions(precision=6, threshold=8, edgeitems=3, linewidth=1000):
        return f"n = {body.dimension + 1}, J = {body.J}, I = {body.I}"


def _quantities(trajectories: Trajectories) -> list[tuple[str, Callable[..., FloatArray]]]:
    """What to watch: F where it is conserved by every body, else the two energies."""
    body, eps = trajectories.body, trajectories.eps
    if isinstance(body, Suslov3D):
        return [("F", lambda states: first_integral(body, states, eps))]
    return [
        ("E", lambda states: energy(body, states)),
        ("E_mod", lambda states: modified_energy(body, states, eps)),
    ]


def _drift(
    trajectories: Trajectories, omega0: FloatArray, quantity: Callable[..., FloatArray]
) -> str:
    """The largest relative change over the last and the saved states."""
    start = quantity(omega0)[:, np.newaxis]
    largest, unknown = 0.0, 0
    states = [trajectories.final[:, np.newaxis], trajectories.omega]
    for saved in (some for array in states for some in _portions(array)):
        exists = np.isfinite(saved).all(axis=-1) & (start > 0)
        with np.errstate(all="ignore"):
            drift = abs(quantity(saved) / start - 1.0)[exists]
        largest = max(largest, float(drift[np.isfinite(drift)].max(initial=0.0)))
        unknown += int(np.count_nonzero(~np.isfinite(drift)))
    text = f"{largest:.2g}, largest relative"
    return f"{text}; {unknown:,} states beyond float64" if unknown else text


def _portions(states: FloatArray) -> Iterator[FloatArray]:
    """Parts of the saved states, along time, for which temporary arrays are affordable."""
    length = max(1, 2**20 // states[:, :1].size)
    for first in range(0, states.shape[1], length):
        yield states[:, first : first + length]
