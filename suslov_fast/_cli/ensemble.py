"""The parts of `run` and `info` that deal with Zarr stores larger than memory."""

from __future__ import annotations

import argparse
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from .._bodies.nd import SuslovND
from .._checks import FloatArray
from .._engine.arguments import Body
from .._engine.status import Status
from .._ensemble.api import ensemble, open_ensemble
from .._ensemble.starts import RandomStarts
from .._maps.registry import map_named
from .._runs import labelled
from .errors import UserError
from .files import read_states
from .problem import EXTENT, TRAJECTORIES
from .summary import Facts, as_json, as_text, brief, conserved, described
from .values import integer, number

_NUMBER = r"[^:=]+"
# A store may have been begun before: the rate of the rest is not that of the whole.
_SPEED = ("seconds", "steps_per_second")


def add_to(parser: argparse.ArgumentParser) -> None:
    """Add the options of runs larger than memory."""
    group = parser.add_argument_group(
        "with -o FILE.zarr (computed and written in parts; run again, it goes on)"
    )
    group.add_argument(
        "--chunk", type=integer(1), metavar="N", help="trajectories computed at a time (a few MB)"
    )
    group.add_argument("--scheduler", metavar="ADDRESS", help="of Dask, whose workers compute")
    group.add_argument(
        "--sweep",
        type=_sweep,
        action="append",
        metavar="NAME=LOW:HIGH:COUNT",
        help="an axis of step sizes (eps) or of a parameter (I13, J2); may be given more than once",
    )
    group.add_argument("--compression", choices=("lz4", "zstd"), help="of what is written (none)")
    group.add_argument(
        "--reduce",
        action="append",
        metavar="NAME",
        help="write no states but the last, and this: first_integral_drift, omega_max, ...",
    )
    group.add_argument(
        "--verify", action="store_true", help="read what is there, compute anew what is damaged"
    )


def is_store(path: Path | None) -> bool:
    """Whether a name is that of a store."""
    return path is not None and path.suffix == ".zarr"


def require_none(options: argparse.Namespace) -> None:
    """Refuse options of stores where nothing, or another kind of file, is written."""
    for name in ("chunk", "scheduler", "sweep", "compression", "reduce", "verify"):
        if getattr(options, name):
            raise UserError(f"argument --{name}: expected -o FILE.zarr with it, got none")


def run(options: argparse.Namespace, body: Body, eps: float, bar: bool) -> str:
    """Make or finish a store, and return what it holds."""
    body, sizes, dims, coords = _swept(body, eps, options.sweep or [])
    begin = time.perf_counter()
    try:
        ensemble(
            body,
            _starts(options, body.dimension),
            sizes,
            options.steps,
            store=options.output,
            save_every=options.save_every,
            method=options.method,
            attitude=bool(getattr(options, "attitude", False)),
            reductions=options.reduce,
            dims=dims,
            coords=coords,
            chunk=options.chunk,
            compression=options.compression,
            scheduler=options.scheduler,
            verify=options.verify,
            progress=bar or None,
        )
    except (ValueError, TypeError, ImportError) as error:
        raise UserError(str(error)) from error
    seconds = time.perf_counter() - begin
    facts = _facts(options.output)
    made = {
        "seconds": seconds,
        "steps_per_second": facts["trajectories"] * facts["steps"] / seconds,
        "written": str(options.output),
        "version": __version__,
    }
    return _spelled({**facts, **made}, options.json)


def info(path: Path, json: bool) -> str:
    """What a store holds, how much of it is there, and what came of it."""
    return _spelled(_facts(path), json)


def _facts(path: Path) -> Facts:
    try:
        dataset = open_ensemble(path)
    except (ValueError, OSError) as error:
        raise UserError(str(error)) from error
    body, eps = _parameters(dataset)
    return {
        "body": described(body),
        "eps": brief(eps),
        "trajectories": int(dataset["status"].size),
        "steps": int(dataset.attrs["steps"]),
        "save_every": int(dataset.attrs["save_every"]) if "save_every" in dataset.attrs else None,
        "saved_states": int(dataset.sizes.get("n", 0)),
        "attitude": "attitude" in dataset,
        "method": dataset.attrs["method"],
        "tiles_done": dataset.attrs["tiles_done"],
        "drift": _drift(dataset),
        "status": _statuses(dataset),
    }


def _spelled(facts: Facts, json: bool) -> str:
    if json:
        return as_json(facts)
    shown = {name: value for name, value in facts.items() if name not in _SPEED}
    return f"{as_text(shown)}\n{'tiles done':<16}{facts['tiles_done']}"


def is_ensemble(path: Path) -> bool:
    """Whether a store is one of `ensemble`, and not a single run that was saved."""
    return (path / "progress" / "zarr.json").exists()


def _sweep(text: str) -> tuple[str, FloatArray]:
    """Read an axis of values."""
    match = re.fullmatch(rf"(\w+)=({_NUMBER}):({_NUMBER}):({_NUMBER})", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"expected NAME=LOW:HIGH:COUNT, got {text!r}")
    name, low, high, count = match.groups()
    return name, np.linspace(number(low), number(high), integer(1)(count))


def _swept(
    body: Body, eps: float, sweeps: list[tuple[str, FloatArray]]
) -> tuple[Body, Any, tuple[str, ...], dict[str, FloatArray]]:
    """The body and the step sizes with an axis for each sweep, before that of trajectories."""
    sizes: Any = eps
    for k, (name, values) in enumerate(sweeps):
        column = values.reshape(-1, *(1,) * (len(sweeps) - k))
        if name == "eps":
            sizes = column
        else:
            body = _with_parameter(body, name, column)
    dims = tuple(f"sweep_{name}" for name, _ in sweeps)
    coords = dict(zip(dims, (values for _, values in sweeps), strict=True))
    return body, sizes, (*dims, "trajectory"), coords


def _with_parameter(body: Body, name: str, values: FloatArray) -> Body:
    try:
        if not isinstance(body, SuslovND):
            if name in body._names():
                return replace(body, **{name: values})
            raise UserError(f"argument --sweep: expected eps, I1, I2, I13 or I23, got {name}")
        match = re.fullmatch(r"([JI])([1-9]\d*)", name)
        if match is None or int(match[2]) > body.dimension:
            last = body.dimension
            raise UserError(f"argument --sweep: expected eps, J1 ... J{last} or I1 ..., got {name}")
        old = getattr(body, match[1])
        shape = np.broadcast_shapes(values.shape, old.shape[:-1])
        new = np.broadcast_to(old, (*shape, old.shape[-1])).copy()
        new[..., int(match[2]) - 1] = values
        return replace(body, **{match[1]: new})
    except ValueError as error:
        raise UserError(f"argument --sweep: {error}") from error


def _starts(options: argparse.Namespace, dimension: int) -> Any:
    """Random starts, or a file of them that is read in parts."""
    if options.initial is None:
        return RandomStarts(options.trajectories or TRAJECTORIES, EXTENT, options.seed or 0)
    for name in ("trajectories", "seed"):
        if getattr(options, name) is not None:
            raise UserError(f"expected either --initial or --{name}, got both")
    if options.initial.suffix.lower() == ".npy":
        return options.initial
    return read_states(options.initial, dimension)


def _parameters(dataset: Any) -> tuple[Body, FloatArray]:
    """The body and the step sizes of a part of a dataset."""
    batch = tuple(dataset["status"].dims)
    body = map_named(dataset.attrs["map"]).body
    values = {
        name: labelled.unvarying(dataset, name, batch)
        for name in ("eps", *body._names())
        if name in dataset.variables
    }
    eps = values.pop("eps")
    return body(**values), eps


def _parts(dataset: Any) -> Iterator[Any]:
    """The tiles of a dataset, each along the whole time."""
    dims = dataset["status"].dims
    chunks = dict(zip(dims, dataset["status"].chunks or (), strict=True))
    edges = [np.cumsum([0, *chunks.get(dim, (1,))]) for dim in dims]
    for index in np.ndindex(*(len(each) - 1 for each in edges)):
        yield dataset.isel(
            {
                dim: slice(int(each[k]), int(each[k + 1]))
                for dim, each, k in zip(dims, edges, index, strict=True)
            }
        )


def _statuses(dataset: Any) -> dict[str, int]:
    counts = dict.fromkeys((status.name for status in Status), 0)
    for part in _parts(dataset):
        status = part["status"].values
        for each in Status:
            counts[each.name] += int((status == each).sum())
    return {name: count for name, count in counts.items() if count}


def _drift(dataset: Any) -> Facts:
    """The largest relative change since state 0, of what is kept or was reduced."""
    reduced = {"F": "first_integral_drift", "E": "energy_drift", "E_mod": "modified_energy_drift"}
    found: Facts = {
        name: {"largest": float(dataset[of].max().compute()), "beyond_float64": 0}
        for name, of in reduced.items()
        if of in dataset
    }
    if "omega" not in dataset or int(dataset["n"][0]) != 0:
        return {name: each for name, each in found.items() if np.isfinite(each["largest"])}
    body, _ = _parameters(dataset)
    for name, observable in conserved(body):
        largest, beyond = 0.0, 0
        for part in _parts(dataset):
            here, eps = _parameters(part)
            begin = observable(here, part["omega"][0].values, eps)
            with np.errstate(all="ignore"):
                reference = np.where(begin > 0, begin, np.nan)
            for rows in _along_time(part["omega"]):
                with np.errstate(all="ignore"):
                    change = abs(observable(here, rows, eps) / reference - 1.0)
                known = np.isfinite(change)
                exists = np.isfinite(rows).all(axis=-1) & (begin > 0)
                beyond += int((exists & ~known).sum())
                largest = max(largest, float(change.max(initial=0.0, where=known)))
        found[name] = {"largest": largest, "beyond_float64": beyond}
    return found


def _along_time(omega: Any) -> Iterator[FloatArray]:
    start = 0
    for length in omega.chunks[0]:
        yield omega[start : start + length].values
        start += length
