"""Facts about a run, in memory or in a store, as lines for people and as JSON for programs."""

from __future__ import annotations

import argparse
import json
import textwrap
from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import suslov_fast as sf

from .._checks import FloatArray
from .._ensemble.reductions import REDUCTIONS
from .._ensemble.store import open_dataset, resolved
from .._maps import map_named
from .._runs.labelled import parameters_in
from .._runs.schema import body_of
from .flags import CommandError
from .terminal import about, progress_bar

Facts = dict[str, Any]

# Size of the states compared at a time, that of a chunk of a store.
_COMPARED = 2**21
# Short names of quantities whose relative changes are printed.
_SHORT = {"first_integral": "F", "energy": "E", "modified_energy": "E_mod"}


def print_summaries(options: argparse.Namespace) -> None:
    """Print summaries of saved runs; the files that cannot be read are one error after them."""
    texts, errors = [], []
    for path in options.file:
        facts: Facts = {"file": str(path)} if len(options.file) > 1 else {}
        try:
            with about(path):
                in_store = path.suffix.lower() == ".zarr"
                facts |= facts_of_store(path) if in_store else facts_of(sf.Trajectories.load(path))
            texts.append(text_of(facts, options.json))
        except CommandError as error:
            errors.append(str(error))
    if texts:
        print(("\n" if options.json else "\n\n").join(texts), flush=True)
    if errors:
        raise CommandError("; ".join(errors))


def facts_of(orbits: sf.Trajectories, start: FloatArray | None = None) -> Facts:
    """Return the summary of a run in memory, with changes since its first state or `start`."""
    return {**_header(orbits), **_outcome([orbits], start)}


def facts_of_store(path: Path) -> Facts:
    """Return the summary of a store of `ensemble`, finished or not, read tile by tile."""
    dataset = open_dataset(resolved(path), with_dask=False)
    facts = {**_header(_run_in(dataset)), "tiles_done": dataset.attrs["tiles_done"]}
    facts |= _outcome(_run_in(tile) for tile in _tiles(dataset))
    for name, short in _SHORT.items():
        if f"{name}_drift" in dataset:
            facts["drift"][short] = _largest(dataset[f"{name}_drift"].values)
    return facts


def _run_in(dataset: Any) -> sf.Trajectories:
    """Return the run in a dataset, whose states, if it has any, are read when needed."""
    batch, map = tuple(dataset["status"].dims), map_named(dataset.attrs["map"])
    values = parameters_in(dataset, dataset.attrs, batch)
    body, states = body_of(dataset.attrs, values), dataset.get(map.variable, np.empty(0))
    found = {name: dataset.get(name) for name in ("status", "failed_at", "final", "attitude")}
    found |= {name: dataset.attrs.get(name) for name in ("method", "steps", "save_every")}
    return sf.Trajectories(states=states, eps=values["eps"], body=body, **found, _map=map)


def _tiles(dataset: Any) -> Iterator[Any]:
    """Divide a dataset along its batch into the tiles that are stored together."""
    status = dataset["status"]
    sizes = dict(zip(status.dims, status.encoding["chunks"], strict=True))
    tiles = list(product(*(range(0, status.sizes[dim], size) for dim, size in sizes.items())))
    with progress_bar("checking") as progress:
        for done, index in enumerate(tiles):
            progress(done, len(tiles))
            where = zip(sizes.items(), index, strict=True)
            yield dataset.isel({dim: slice(k, k + size) for (dim, size), k in where})


def _header(run: sf.Trajectories) -> Facts:
    return {
        "body": {"body": type(run.body).__name__, **_parameters(run.body)},
        "parameters": {name: _brief(each) for name, each in run.body._coordinates.items()},
        "eps": _brief(run.eps),
        "trajectories": run.status.size,
        "steps": run.steps,
        "save_every": run.save_every and int(run.save_every),
        "saved_states": len(run.states),
        "attitude": run.attitude is not None,
        "method": run.method,
    }


def _parameters(body: Any) -> Facts:
    """Return numbers and vectors by name; of a body that has others its text."""
    if any(body._axes(name) > 1 for name in body._names()):
        return {"text": textwrap.shorten(repr(body), 200)}
    return {name: _brief(value, body._axes(name)) for name, value in body._values.items()}


def _brief(value: Any, own_axes: int = 0) -> Any:
    """Return a number or a vector, or the range of a batch of them."""
    array = np.asarray(value)
    if array.ndim <= own_axes or not array.size:
        return array.tolist()
    return {"min": float(array.min()), "max": float(array.max()), "shape": list(array.shape)}


def _outcome(parts: Iterable[sf.Trajectories], start: FloatArray | None = None) -> Facts:
    """Return statuses and largest relative changes, since state 0 or, if not saved, `start`."""
    counts = dict.fromkeys(sf.Status, 0)
    drift: dict[str, float] = {}
    for part in parts:
        for status in counts:
            counts[status] += int((part.status == status).sum())
        for name, changes in _changes(part, start):
            drift[name] = max(drift.get(name, 0.0), _largest(changes))
    return {"drift": drift, "status": {each.name: n for each, n in counts.items() if n}}


def _largest(changes: FloatArray) -> float:
    """Return the largest change but those after a failure, or out of the range of float64."""
    return float(changes.max(initial=0.0, where=np.isfinite(changes)))


def _changes(run: sf.Trajectories, start: FloatArray | None) -> Iterator[tuple[str, FloatArray]]:
    """Yield the changes of conserved quantities, each with its name."""
    if start is None and run.n[0] == 0 and len(run):
        start = np.asarray(run.states[0])
    if start is None:
        return
    rows = max(1, _COMPARED // max(1, run.states[:1].size))
    parts = [run.states[k : k + rows] for k in range(0, len(run.states), rows)]
    if run.n[-1] != run.steps and run.final is not None:  # the last state is not saved
        parts.append(np.asarray(run.final)[np.newaxis])
    for name, part in product(run._map.conserved(run.body), parts):
        reduction = REDUCTIONS[f"{name}_drift"]
        yield _SHORT[name], reduction.reduce(run.body, np.asarray(run.eps), np.asarray(part), start)


# ------------------------------------------------------------------ text


def text_of(facts: Facts, as_json: bool) -> str:
    """Return a line for each fact, or one JSON object for programs."""
    if as_json:
        return json.dumps(facts, allow_nan=False)
    return "\n".join(f"{name:<16}{value}" for name, value in _lines(facts))


def _lines(facts: Facts) -> Iterator[tuple[str, object]]:
    if "file" in facts:
        yield "file", facts["file"]
    body = facts["body"]
    values = (f"{name} = {_spell(each)}" for name, each in body.items() if name != "body")
    yield "body", body.get("text") or ", ".join(values)
    if facts["parameters"]:
        named = (f"{name} = {_spell(each)}" for name, each in facts["parameters"].items())
        yield "parameters", ", ".join(named)
    if facts.get("rotation"):
        yield "rotation", "to the adapted basis of states; --json has it"
    yield "step size", f"eps = {_spell(facts['eps'])}"
    yield "trajectories", f"{facts['trajectories']:,}"
    yield "steps", f"{facts['steps']:,}"
    if "seconds" in facts:
        yield "threads", facts["threads"]
        yield "wall time", f"{facts['seconds']:.4g} s"
    else:
        yield "saved states", f"{facts['saved_states']:,}"
        yield "method", facts["method"]
    equivalent = "equivalent steps/s, by the closed form where it is faster"
    for key, unit in (("equivalent_steps", equivalent), ("steps", "steps/s")):
        if (rate := facts.get(f"{key}_per_second")) is not None:
            yield "speed", f"{rate:.3g} {unit}"
    for name, change in facts["drift"].items():
        yield f"drift of {name}", f"{change:.2g}, largest relative"
    for name, count in facts["status"].items():
        yield "status", f"{count:,} {name}: {sf.Status[name].message}"
    for name in ("tiles_done", "written"):
        if facts.get(name):
            yield name.replace("_", " "), facts[name]


def _spell(value: Any) -> str:
    if isinstance(value, dict):
        return f"{value['min']:g} ... {value['max']:g} {tuple(value['shape'])}"
    if isinstance(value, list):
        return np.array2string(np.array(value), precision=6, threshold=8, max_line_width=1000)
    return f"{value:g}"
