"""Facts about a run, in memory or in a store, as lines for people and as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from inspect import signature
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import suslov_fast as sf

from .._checks import FloatArray
from .._maps.record import Map
from .._maps.registry import map_named
from .._runs.labelled import unvarying

Facts = dict[str, Any]
Report = Callable[[int, int], object]

# States of which temporary arrays stay in the cache.
_SLAB = 2**17
# Quantities whose drift is printed: F if it is known for the body, otherwise the energies. A store
# may hold their drifts instead of states.
_CONSERVED = {"F": "first_integral", "E": "energy", "E_mod": "modified_energy"}


def facts_of(orbits: sf.Trajectories) -> Facts:
    """Return what a run in memory is."""
    return {
        "body": described(orbits.body),
        "eps": brief(orbits.eps),
        "trajectories": orbits.status.size,
        "steps": orbits.steps,
        "save_every": orbits.save_every,
        "saved_states": len(orbits.omega),
        "attitude": orbits.attitude is not None,
        "method": orbits.method,
    }


def outcome_of(orbits: sf.Trajectories, start: FloatArray | None, report: Report) -> Facts:
    """Return the drifts of a run in memory since `start`, and the statuses of its trajectories."""
    outcome = _Outcome(orbits._map)
    outcome.count(orbits.status)
    if start is not None:
        rows = [*_slabs(orbits.omega)]
        if orbits.n[-1] != orbits.steps:
            rows.append(orbits.final[np.newaxis])
        outcome.compare(orbits.body, orbits.eps, start, rows, report)
    return outcome.facts()


def facts_of_store(path: Path, report: Report) -> Facts:
    """Return what a store of `ensemble` holds, how much of it is there, and what came of it."""
    dataset = sf.open_ensemble(path)
    attributes = dataset.attrs
    record = map_named(attributes["map"])
    body, eps = _parameters(dataset, record)
    outcome = _Outcome(record)
    for name, quantity in _CONSERVED.items():
        reduced = dataset.get(f"{quantity}_drift")
        if reduced is not None and np.isfinite(largest := float(reduced.max())):
            outcome.drift[name] = {"largest": largest, "beyond_float64": 0}
    from_start = "omega" in dataset and int(dataset["n"][0]) == 0
    tiles = list(_tiles(dataset))
    for k, tile in enumerate(tiles):
        outcome.count(tile["status"].values)
        if from_start:
            omega = tile["omega"]
            edges = np.cumsum([0, *omega.chunks[0]])
            rows = (omega[a:b].values for a, b in pairwise(edges))
            outcome.compare(*_parameters(tile, record), omega[0].values, rows, lambda *_: None)
        report(k + 1, len(tiles))
    return {
        "body": described(body),
        "eps": brief(eps),
        "trajectories": int(dataset["status"].size),
        "steps": int(attributes["steps"]),
        "save_every": int(attributes["save_every"]) if "save_every" in attributes else None,
        "saved_states": int(dataset.sizes.get("n", 0)),
        "attitude": "attitude" in dataset,
        "method": attributes["method"],
        "tiles_done": attributes["tiles_done"],
        **outcome.facts(),
    }


class _Outcome:
    """Statuses, and the largest relative changes of conserved quantities, of parts of a run."""

    def __init__(self, record: Map) -> None:
        self._record = record
        self._status = dict.fromkeys(sf.Status, 0)
        self.drift: dict[str, Facts] = {}

    def count(self, status: Any) -> None:
        """Add the statuses of a part."""
        for each in self._status:
            self._status[each] += int((status == each).sum())

    def compare(
        self, body: Any, eps: Any, start: FloatArray, rows: Iterable[FloatArray], report: Report
    ) -> None:
        """Add the changes from the start of a part to all rows (time, ..., D) of its states.

        States whose quantity leaves the range of float64 are counted apart.
        """
        quantities = _quantities(self._record, body, eps)
        references = {}
        for name, quantity in quantities.items():
            at_start = quantity(start)
            # There is no relative change from 0.
            references[name] = np.where(at_start > 0, at_start, np.nan)
            self.drift.setdefault(name, {"largest": 0.0, "beyond_float64": 0})
        total = len(rows) if isinstance(rows, list) else 0
        for k, states in enumerate(rows):
            exists = np.isfinite(states).all(axis=-1)
            for name, quantity in quantities.items():
                with np.errstate(all="ignore"):
                    change = abs(quantity(states) / references[name] - 1.0)
                known = np.isfinite(change)
                beyond = exists & ~known & ~np.isnan(references[name])
                drift = self.drift[name]
                drift["beyond_float64"] += int(beyond.sum())
                drift["largest"] = max(
                    drift["largest"], float(change.max(initial=0.0, where=known))
                )
            report(k + 1, total)

    def facts(self) -> Facts:
        """Return what was found."""
        return {
            "drift": self.drift,
            "status": {each.name: count for each, count in self._status.items() if count},
        }


def _quantities(record: Map, body: Any, eps: Any) -> dict[str, Callable[[Any], FloatArray]]:
    """Return the quantities to compare, as functions of states."""

    def of_states(name: str) -> Callable[[Any], FloatArray]:
        function = getattr(sf, name)
        settings = {"eps": eps} if "eps" in signature(function).parameters else {}
        return lambda states: function(body, states, **settings)

    found = {
        name: of_states(quantity)
        for name, quantity in _CONSERVED.items()
        if quantity in record.quantities
    }
    if "F" in found:
        try:
            found["F"](np.zeros(body.dimension))
            return {"F": found["F"]}
        except sf.NotIntegrableError:
            del found["F"]
    return found


def _slabs(omega: FloatArray) -> Iterator[FloatArray]:
    """Cut states along time."""
    rows = max(1, _SLAB // max(1, omega[:1].size))
    return (omega[k : k + rows] for k in range(0, len(omega), rows))


def _tiles(dataset: Any) -> Iterator[Any]:
    """Cut a dataset along its batch, as it is stored."""
    dims = dataset["status"].dims
    chunks = dict(zip(dims, dataset["status"].chunks or (), strict=True))
    edges = [np.cumsum([0, *chunks[dim]]).tolist() for dim in dims]
    for index in np.ndindex(*(len(each) - 1 for each in edges)):
        where = zip(dims, edges, index, strict=True)
        yield dataset.isel({dim: slice(each[k], each[k + 1]) for dim, each, k in where})


def _parameters(dataset: Any, record: Map) -> tuple[Any, Any]:
    """Return the body and the step sizes of a dataset."""
    batch = tuple(dataset["status"].dims)
    values = {
        name: unvarying(dataset, name, batch)
        for name in ("eps", *record.body._names())
        if name in dataset
    }
    return record.body(**{k: v for k, v in values.items() if k != "eps"}), values["eps"]


def described(body: Any) -> Facts:
    """Return the parameters of a body."""
    values = {name: brief(value, body._own_axes) for name, value in body._values.items()}
    return {"type": type(body).__name__, **values}


def brief(value: Any, axes: int = 0) -> Any:
    """Return a number or a vector, or the range of a batch of them."""
    array = np.asarray(value)
    if array.ndim <= axes:
        return array.tolist()
    bounds = {"min": float(array.min()), "max": float(array.max())} if array.size else {}
    return {"shape": list(array.shape), **bounds}


def as_json(facts: Facts) -> str:
    """Return one object for programs."""
    return json.dumps(facts, allow_nan=False)


def as_text(facts: Facts) -> str:
    """Return a line for each fact."""
    lines = []
    for name, lines_of in _LINES.items():
        if facts.get(name) is not None:
            lines.extend(lines_of(facts[name]))
    return "\n".join(f"{name:<16}{value}" for name, value in lines)


def _row(name: str, spell: Callable[[Any], str]) -> Callable[[Any], list[tuple[str, str]]]:
    return lambda value: [(name, spell(value))]


def _body_line(body: Facts) -> str:
    values = ", ".join(f"{name} = {_spell(body[name])}" for name in body if name != "type")
    vectors = [value for value in body.values() if isinstance(value, list)]
    return f"n = {len(vectors[0]) + 1}, {values}" if vectors else values


def _spell(value: Any) -> str:
    if isinstance(value, dict):
        shape = tuple(value["shape"])
        return f"{value['min']:g} ... {value['max']:g} {shape}" if "min" in value else f"{shape}"
    if isinstance(value, list):
        with np.printoptions(precision=6, threshold=8, edgeitems=3, linewidth=1000):
            return str(np.array(value))
    return f"{value:g}"


def _drift_lines(drift: Facts) -> Iterator[tuple[str, str]]:
    for name, change in drift.items():
        text = f"{change['largest']:.2g}, largest relative"
        if change["beyond_float64"]:
            text += f"; beyond float64: {change['beyond_float64']:,}"
        yield f"drift of {name}", text


_LINES: dict[str, Callable[[Any], Any]] = {
    "body": _row("body", _body_line),
    "rotation": _row("rotation", lambda _: "to the adapted basis of states; --json has it"),
    "eps": _row("step size", lambda eps: f"eps = {_spell(eps)}"),
    "trajectories": _row("trajectories", "{:,}".format),
    "steps": _row("steps", "{:,}".format),
    "saved_states": _row("saved states", "{:,}".format),
    "method": _row("method", str),
    "threads": _row("threads", str),
    "seconds": _row("wall time", str),
    "speed": _row("speed", str),
    "drift": _drift_lines,
    "status": lambda counts: [
        ("status", f"{count:,} {name}: {sf.Status[name].message}") for name, count in counts.items()
    ],
    "tiles_done": _row("tiles done", str),
    "written": _row("written", str),
}
