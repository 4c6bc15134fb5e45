"""Summaries of runs, crossings and stores, as the command prints them: as lines, or as JSON."""

import json
from pathlib import Path
from typing import Any

import suslov_fast as sf

# Attributes of stores of fields: the number of variables and their terms, and those of H.
_TERMS = "dimension", "indices", "values"
_LISTS = *_TERMS, "indices of H", "H", "K"


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
    if hasattr(result, "map"):
        eps = result.eps if isinstance(result.eps, float) else f"{result.eps.size} values"
        counts = _counts(result.status, result.first_pole)
        common = {**body, "eps": eps, **counts, "steps": result.steps, "map": result.map.name}
    else:
        last = result.time[-1] if isinstance(result, sf.Motion) else result.last
        counts = {**_counts(result.status), "steps": int(result.steps.sum())}
        common = {**body, **counts, "time": float(last)}
    if isinstance(result, (sf.Crossings, sf.MotionCrossings)):
        names = ARGUMENTS[type(result).__name__]
        arguments = {name: getattr(result, name) for name in names if name != "last"}
        given = {name: value for name, value in arguments.items() if value is not None}
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


# Most numbers of a list that are printed.
_FEW = 6
# Measured numbers, which are printed with four digits; others are printed with all of theirs.
_MEASURED = "drift", "seconds", "steps_per_second"


def lines_of(facts: dict[str, Any], as_json: bool) -> str:
    """Return a summary as a text: a line for each fact, or one JSON object."""
    if as_json:
        return json.dumps(facts)
    rows = []
    for name, value in _for_people(facts).items():
        text = _spelled(value, ".4g" if name in _MEASURED else "")
        rows.append((name.replace("_", " "), text))
    for name, count in facts["status"].items():
        meaning = sf.Status[name].message if name in sf.Status.__members__ else "not computed yet"
        rows.append(("status", f"{count:,} {name}: {meaning}"))
    width = max(17, *(len(name) + 1 for name, _ in rows))
    return "\n".join(f"{name:<{width}}{text}" for name, text in rows if text)


def _for_people(facts: dict[str, Any]) -> dict[str, Any]:
    """Return the facts to print: fields as formulas, and the method only if there are others."""
    from ..maps import MAPS

    shown, record = dict(facts), MAPS.get(facts.get("map", ""))  # none of a motion
    for name in {"map", "status"} & shown.keys():
        del shown[name]
    if shown.get("saved_states") == 1 and record:
        shown["saved_states"] = "1, the last; --save-every K saves more"
    same_body = [other for other in MAPS.values() if record and other.body is record.body]
    if sum(len(other.methods) for other in same_body) == 1:
        del shown["method"]
    if record is None or record.variable == "x":
        body = facts["body"]
        lists = [n for n in _LISTS if n in facts]
        if not isinstance(body, dict) and "dimension" in facts:  # the attributes of a store
            body = {"body": body} | {k: facts[k] for k in (*_TERMS, "names") if k in facts}
            # For a long list a store has a text, size and range, in place of numbers.
            if any(isinstance(body[name], str) for name in _TERMS):
                body = body["body"]
        if isinstance(body, dict):
            values = body.get("parameters", {}).items()
            named = [f"{name} = {_spelled(value)}" for name, value in values]
            shown["body"] = ", ".join([repr(sf.body_from_dict(body)), *named])
        for name in lists:
            del shown[name]
    return shown


def _spelled(value: Any, form: str = "") -> str:
    """Return the text of a number, a list of numbers, or the parameters of a body."""
    if isinstance(value, dict):
        names = [name for name in value if name != "body"]
        return ", ".join(f"{name} = {_spelled(value[name], form)}" for name in names)
    if isinstance(value, float):
        return f"{value:{form}}" if form else repr(value).removesuffix(".0")
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, list):
        flat = value
        while flat and isinstance(flat[0], list):
            flat = [item for row in flat for item in row]
        if len(flat) > _FEW:
            return f"{len(flat):,} values from {min(flat):g} to {max(flat):g}"
    return str(value).partition(", sha256")[0]
