"""What a run is and what came of it, as lines for people and as JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._engine.arguments import Body
from .._engine.status import Status
from .._runs.trajectories import Trajectories
from .._states.conserved import energy, first_integral, modified_energy

# States whose observables stay in the cache while they are compared.
_PORTION = 2**17

Facts = dict[str, Any]


def facts_of(trajectories: Trajectories) -> Facts:
    """What a run is: numbers, strings and lists."""
    return {
        "body": described(trajectories.body),
        "eps": brief(trajectories.eps),
        "trajectories": trajectories.status.size,
        "steps": trajectories.steps,
        "save_every": trajectories.save_every,
        "saved_states": len(trajectories.n),
        "attitude": trajectories.attitude is not None,
        "method": trajectories.method,
    }


def outcome_of(trajectories: Trajectories, start: FloatArray | None) -> Facts:
    """How far a run kept what it should keep since `start`, and how its trajectories ended."""
    drift = {}
    if start is not None:
        drift = {
            name: _drift(trajectories, start, observable)
            for name, observable in conserved(trajectories.body)
        }
    numbers = {status.name: int((trajectories.status == status).sum()) for status in Status}
    return {
        "drift": drift,
        "status": {name: number for name, number in numbers.items() if number},
    }


def as_json(facts: Facts) -> str:
    """One object for programs."""
    return json.dumps(facts, allow_nan=False)


def as_text(facts: Facts) -> str:
    """A line for each fact."""
    lines = []
    for name, spell in _SPELLED.items():
        if facts.get(name) is not None:
            lines.extend(spell(facts[name]))
    return "\n".join(f"{name:<16}{value}" for name, value in lines)


def described(body: Body) -> Facts:
    """The parameters of a body."""
    parameters = {name: brief(value, body._own_axes) for name, value in body._values.items()}
    return {"type": type(body).__name__, **parameters}


def brief(value: Any, axes: int = 0) -> Any:
    """A number or a vector, or of a batch of them the range."""
    array = np.asarray(value)
    if array.ndim <= axes:
        return array.tolist()
    bounds = {"min": float(array.min()), "max": float(array.max())} if array.size else {}
    return {"shape": list(array.shape), **bounds}


def conserved(body: Body) -> list[tuple[str, Callable[..., FloatArray]]]:
    """What to watch: F where it is conserved by every body, else the two energies."""
    if isinstance(body, Suslov3D):
        return [("F", first_integral)]
    return [("E", lambda body, states, eps: energy(body, states)), ("E_mod", modified_energy)]


def _drift(
    trajectories: Trajectories, start: FloatArray, observable: Callable[..., FloatArray]
) -> Facts:
    """The largest relative change from the start to any of the saved states and the last.

    States whose observable leaves the range of float64 are counted apart.
    """
    body, eps = trajectories.body, trajectories.eps
    largest, beyond = 0.0, 0
    for states, begin in _portions(trajectories, start):
        at_begin = observable(body, begin, eps)
        # Nothing can be said where it vanishes.
        reference = np.where(at_begin > 0, at_begin, np.nan)
        with np.errstate(all="ignore"):
            change = abs(observable(body, states, eps) / reference - 1.0)
        known = np.isfinite(change)
        if not known.all():
            exists = np.isfinite(states).all(axis=-1) & (at_begin > 0)
            beyond += int((exists & ~known).sum())
        largest = max(largest, float(change.max(initial=0.0, where=known)))
    return {"largest": largest, "beyond_float64": beyond}


def _portions(
    trajectories: Trajectories, start: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Parts (time, batch, D) of the states, and the states that they began with.

    Temporary arrays of their size are affordable.
    """
    states = [trajectories.omega]
    if trajectories.n[-1] != trajectories.steps:
        states.append(trajectories.final[np.newaxis])
    alike = not trajectories.body.shape and np.ndim(trajectories.eps) == 0
    if alike:  # the batch may be cut too
        states = [array.reshape(len(array), -1, array.shape[-1]) for array in states]
        start = start.reshape(-1, start.shape[-1])
    wide = _PORTION
    long = max(1, _PORTION // max(1, min(trajectories.status.size, _PORTION)))
    for array in states:
        for k in range(0, len(array), long):
            if not alike:
                yield array[k : k + long], start
                continue
            for b in range(0, len(start), wide):
                yield array[k : k + long, b : b + wide], start[b : b + wide]


def _spell_body(body: Facts) -> str:
    parameters = {name: value for name, value in body.items() if name != "type"}
    if body["type"] == "SuslovND" and isinstance(body["J"], list):
        with np.printoptions(precision=6, threshold=8, edgeitems=3, linewidth=1000):
            J, I = (np.array(parameters[name]) for name in ("J", "I"))
            return f"n = {len(J) + 1}, J = {J}, I = {I}"
    return ", ".join(f"{name} = {_spell(value)}" for name, value in parameters.items())


def _spell(value: Any) -> str:
    if isinstance(value, dict):
        shape = tuple(value["shape"])
        return f"{value['min']:g} ... {value['max']:g} {shape}" if "min" in value else f"{shape}"
    return f"{value}" if isinstance(value, list) else f"{value:g}"


def _spell_drift(drift: Facts) -> Iterator[tuple[str, str]]:
    for name, change in drift.items():
        text = f"{change['largest']:.2g}, largest relative"
        if change["beyond_float64"]:
            text += f"; beyond float64: {change['beyond_float64']:,}"
        yield f"drift of {name}", text


def _row(name: str, spell: Callable[[Any], str]) -> Callable[[Any], list[tuple[str, str]]]:
    return lambda value: [(name, spell(value))]


_SPELLED: dict[str, Callable[[Any], Any]] = {
    "body": _row("body", _spell_body),
    "rotation": _row(
        "rotation", lambda _: "states are in the adapted basis; --json has the matrix"
    ),
    "eps": _row("step size", lambda eps: f"eps = {_spell(eps)}"),
    "trajectories": _row("trajectories", "{:,}".format),
    "steps": _row("steps", "{:,}".format),
    "saved_states": _row("saved states", "{:,}".format),
    "method": _row("method", str),
    "threads": _row("threads", str),
    "seconds": _row("wall time", "{:.4g} s, after compilation".format),
    "speed": _row("speed", str),
    "drift": _spell_drift,
    "status": lambda numbers: [
        ("status", f"{number:,} {name}: {Status[name].message}") for name, number in numbers.items()
    ],
    "written": _row("written", str),
}
