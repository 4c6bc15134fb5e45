"""Summaries of runs, crossings and stores, as the command prints them in JSON."""

import json
from pathlib import Path
from typing import Any

import suslov_fast as sf


def facts_in(path: Path) -> dict[str, Any]:
    """Return the summary of a file or a store."""
    if path.suffix == ".zarr":
        data = sf.open_ensemble(path)
        attributes = data.attrs.items()
        facts = {name: _value(text) for name, text in attributes if name != "tiled"}
        first_pole = data.first_pole.to_numpy() if "first_pole" in data else None
        return {**facts, **_counts(data.status.to_numpy(), first_pole)}
    from ..runs.files.storage import load

    result = load(path)
    is_run = isinstance(result, sf.Trajectories)
    return facts_of(result, result.states[0] if is_run and result.n[0] == 0 else None)


def _value(attribute: Any) -> Any:
    """Return an attribute of a store; lists of lists are stored as JSON."""
    is_text_of_lists = isinstance(attribute, str) and attribute.startswith("[[")
    return json.loads(attribute) if is_text_of_lists else attribute


def facts_of(result: Any, start: Any = None) -> dict[str, Any]:
    """Return the summary of a result; `start` is state 0 of a run of a map, if it is known."""
    from ..runs.columns import ARGUMENTS

    body = {"body": _body_of(result)}
    if vars(result).get("map") is not None:
        eps = result.eps if isinstance(result.eps, float) else f"{result.eps.size} values"
        counts = _counts(result.status, result.first_pole)
        common = {**body, "eps": eps, **counts, "steps": result.steps, "map": result.map.name}
    else:
        last = result.time[-1] if isinstance(result, sf.Motion) else result.last
        counts = {**_counts(result.status), "steps": int(result.steps.sum())}
        common = {**body, **counts, "time": float(last)}
    if isinstance(result, sf.Crossings):
        names = [name for name in ARGUMENTS["Crossings"] if name not in ("last", "steps")]
        given = {k: value for k in names if (value := getattr(result, k)) is not None}
        return {**common, "crossings": len(result), **given}
    saved = {**common, "saved_states": len(result)}
    if isinstance(result, sf.Motion):
        saved |= {"rtol": result.rtol} | ({} if result.atol is None else {"atol": result.atol})
        start, last = result.states[[0, -1]]
    else:
        saved["method"], last = result.method, result.final
    drift = {} if start is None else _largest_change(result, result._conserved, start, last)
    return {**saved, "drift": drift}


def _body_of(result: Any) -> Any:
    """Return the body of a result: a dictionary, or for a family a text."""
    return repr(result.body) if result.body.shape else result.body.to_dict()


def _counts(status: Any, first_pole: Any = None) -> dict[str, Any]:
    """Return the number of trajectories, with each status, and failed after a pole, if any."""
    from ..engine.status import PENDING  # here, because it imports Numba

    codes = {code.name: int(code) for code in sf.Status} | {"PENDING": PENDING}
    counts = {name: int((status == code).sum()) for name, code in codes.items()}
    facts = {"trajectories": status.size, "status": {k: n for k, n in counts.items() if n}}
    hidden = 0 if first_pole is None else int(((status < 0) & (first_pole >= 0)).sum())
    return {**facts, "failed_after_a_pole": hidden} if hidden else facts


def _largest_change(result: Any, name: str | None, first: Any, last: Any) -> dict[str, float]:
    """Return the largest finite relative change of the conserved quantity, under its name."""
    import numpy as np

    if name is None:
        return {}
    with np.errstate(all="ignore"):
        change = np.asarray(abs(result._value(name, last) / result._value(name, first) - 1))
    finite = change[np.isfinite(change)]
    return {name: float(finite.max())} if finite.size else {}
