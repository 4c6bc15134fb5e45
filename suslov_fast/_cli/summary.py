"""Facts about a run, in memory or in a store, as lines for people and as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import suslov_fast as sf

from .._checks import FloatArray
from .._ensemble.store import open_dataset, resolved
from .._maps.registry import map_named
from .._runs.labelled import unvarying
from .work import progress_bar

Facts = dict[str, Any]

# Numbers of the states that are compared at a time; a chunk of a store has as many.
_SLAB = 2**21


def facts_of(orbits: sf.Trajectories, start: FloatArray | None = None) -> Facts:
    """Return what a run in memory is and what came of it, since its first state or `start`."""
    outcome = _Outcome()
    outcome.add(orbits, start)
    return {**_header(orbits), **outcome.facts()}


def facts_of_store(path: Path) -> Facts:
    """Return the same of a store of `ensemble`, finished or not, which is read tile by tile."""
    dataset = open_dataset(resolved(path), chunks=None)
    outcome, tiles = _Outcome(), list(_tiles(dataset))
    with progress_bar("checking") as report:
        for k, tile in enumerate(tiles):
            outcome.add(_view(tile))
            report(k + 1, len(tiles))
    done = dataset.attrs["tiles_done"]
    return {**_header(_view(dataset)), "tiles_done": done, **outcome.facts()}


def _view(dataset: Any) -> Any:
    """Return a dataset as what looks like `Trajectories`; its states are read when needed."""
    batch, map = tuple(dataset["status"].dims), map_named(dataset.attrs["map"])
    values = {
        name: unvarying(dataset, name, batch)
        for name in ("eps", *map.body._names())
        if name in dataset
    }
    return SimpleNamespace(
        eps=values.pop("eps"),
        body=map.body(**values),
        status=dataset["status"],
        omega=dataset.get("omega", ()),
        final=dataset.get("final"),
        n=dataset["n"].values if "n" in dataset.dims else np.array([-1]),
        attitude=dataset.get("attitude"),
        drifts={name: dataset.get(f"{quantity}_drift") for name, quantity in _CONSERVED.items()},
        steps=int(dataset.attrs["steps"]),
        save_every=dataset.attrs.get("save_every"),
        method=dataset.attrs["method"],
        _map=map,
    )


def _tiles(dataset: Any) -> Iterator[Any]:
    """Cut a dataset along its batch, as it is stored."""
    status = dataset["status"]
    sizes = dict(zip(status.dims, status.encoding["chunks"], strict=True))
    for index in product(*(range(0, status.sizes[dim], size) for dim, size in sizes.items())):
        where = zip(sizes.items(), index, strict=True)
        yield dataset.isel({dim: slice(k, k + size) for (dim, size), k in where})


def _header(run: Any) -> Facts:
    body = {name: _brief(value, run.body._own_axes) for name, value in run.body._values.items()}
    return {
        "body": {"type": type(run.body).__name__, **body},
        "eps": _brief(run.eps),
        "trajectories": run.status.size,
        "steps": run.steps,
        "save_every": None if run.save_every is None else int(run.save_every),
        "saved_states": len(run.omega),
        "attitude": run.attitude is not None,
        "method": run.method,
    }


def _brief(value: Any, own_axes: int = 0) -> Any:
    """Return a number or a vector, or the range of a batch of them."""
    array = np.asarray(value)
    if array.ndim <= own_axes or not array.size:
        return array.tolist()
    return {"min": float(array.min()), "max": float(array.max()), "shape": list(array.shape)}


# ------------------------------------------------------------------ what came of it


# F if it is known for the body, otherwise the energies. A store may hold their drifts instead of
# states.
_CONSERVED = {"F": "first_integral", "E": "energy", "E_mod": "modified_energy"}


class _Outcome:
    """Statuses, and the largest relative changes of conserved quantities, of parts of a run."""

    def __init__(self) -> None:
        self._status = dict.fromkeys(sf.Status, 0)
        self._drift: dict[str, float] = {}

    def add(self, run: Any, start: FloatArray | None = None) -> None:
        """Look at a part, of which `start` is state 0 if it is not saved."""
        for status in self._status:
            self._status[status] += int((run.status == status).sum())
        for name, reduced in getattr(run, "drifts", {}).items():
            if reduced is not None:
                self._note(name, reduced.values)
        if start is None and run.n[0] == 0:
            start = np.asarray(run.omega[0])
        if start is not None:
            for name, quantity in _quantities(run).items():
                first = quantity(start)
                first = np.where(first > 0, first, np.nan)  # no relative change from 0
                for states in _slabs(run):
                    with np.errstate(all="ignore"):
                        self._note(name, abs(quantity(states) / first - 1.0))

    def _note(self, name: str, changes: FloatArray) -> None:
        # Where a trajectory has ended, or the quantity leaves float64, there is none.
        largest = float(changes.max(initial=0.0, where=np.isfinite(changes)))
        self._drift[name] = max(self._drift.get(name, 0.0), largest)

    def facts(self) -> Facts:
        """Return what was found."""
        counts = {status.name: count for status, count in self._status.items() if count}
        return {"drift": self._drift, "status": counts}


def _quantities(run: Any) -> dict[str, Callable[[FloatArray], FloatArray]]:
    """Return the quantities to compare, as functions of states."""
    body, eps = run.body, run.eps
    functions: dict[str, Callable[[FloatArray], FloatArray]] = {
        "F": lambda omega: sf.first_integral(body, omega, eps),
        "E": lambda omega: sf.energy(body, omega),
        "E_mod": lambda omega: sf.modified_energy(body, omega, eps),
    }
    known = {name: functions[name] for name, q in _CONSERVED.items() if q in run._map.quantities}
    if "F" in known:
        first_integral = known.pop("F")
        try:
            first_integral(np.zeros(body.dimension))
            return {"F": first_integral}
        except sf.NotIntegrableError:
            pass
    return known


def _slabs(run: Any) -> Iterator[FloatArray]:
    """Cut states along time, and add the last one where it is not saved."""
    rows = max(1, _SLAB // max(1, run.omega[:1].size))
    for k in range(0, len(run.omega), rows):
        yield np.asarray(run.omega[k : k + rows])
    if run.n[-1] != run.steps and run.final is not None:
        yield np.asarray(run.final)[np.newaxis]


# ------------------------------------------------------------------ text


def as_json(facts: Facts) -> str:
    """Return one object for programs."""
    return json.dumps(facts, allow_nan=False)


def as_text(facts: Facts) -> str:
    """Return a line for each fact."""
    values = [f"{name} = {_spell(each)}" for name, each in facts["body"].items() if name != "type"]
    lines = [
        ("body", ", ".join(values)),
        ("step size", f"eps = {_spell(facts['eps'])}"),
        ("trajectories", f"{facts['trajectories']:,}"),
        ("steps", f"{facts['steps']:,}"),
    ]
    if facts.get("rotation"):
        lines.insert(1, ("rotation", "to the adapted basis of states; --json has it"))
    if "seconds" in facts:
        lines.append(("threads", str(facts["threads"])))
        lines.append(("wall time", f"{facts['seconds']:.4g} s"))
    else:
        lines.append(("saved states", f"{facts['saved_states']:,}"))
        lines.append(("method", facts["method"]))
    if "states_per_second" in facts:
        rate = f"{facts['states_per_second']:.3g} states/s"
        lines.append(("speed", f"{rate}, by the closed form where it is faster"))
    elif "steps_per_second" in facts:
        lines.append(("speed", f"{facts['steps_per_second']:.3g} steps/s"))
    for name, change in facts["drift"].items():
        lines.append((f"drift of {name}", f"{change:.2g}, largest relative"))
    for name, count in facts["status"].items():
        lines.append(("status", f"{count:,} {name}: {sf.Status[name].message}"))
    for name in ("tiles_done", "written"):
        if facts.get(name):
            lines.append((name.replace("_", " "), facts[name]))
    return "\n".join(f"{name:<16}{value}" for name, value in lines)


def _spell(value: Any) -> str:
    if isinstance(value, dict):
        return f"{value['min']:g} ... {value['max']:g} {tuple(value['shape'])}"
    if isinstance(value, list):
        return np.array2string(np.array(value), precision=6, threshold=8, max_line_width=1000)
    return f"{value:g}"
