"""Facts of a run, as the command prints them: for people or as JSON."""

import json
from pathlib import Path
from typing import Any

import suslov_fast as sf

_OF_STORES = "tiled", "shared", "columns"  # attributes with the names of arrays


def facts_in(path: Path) -> dict[str, Any]:
    if path.suffix == ".zarr":
        data = sf.open_ensemble(path)
        about = {name: _value(each) for name, each in data.attrs.items() if name not in _OF_STORES}
        try:
            status = data.status.to_numpy()  # read once
        except ValueError as error:
            advice = "delete it, and the same run computes its tile anew"
            raise ValueError(f"a chunk of status is damaged ({error}): {advice}") from error
        return {**about, **_counts(status)}
    found = result_in(path)
    if isinstance(found, sf.Crossings):
        return _facts_of_crossings(found)
    return facts_of(found, found.states[0] if found.n[0] == 0 else None)


def result_in(path: Path) -> Any:
    """Return the run, or the crossings, in a file."""
    from .runs.storage import load

    found = load(path)
    return getattr(sf, found.pop("kind"))._of(found)


def _value(attribute: Any) -> Any:
    """Return an attribute of a store; numbers in lists of lists are stored as JSON."""
    is_text_of_lists = isinstance(attribute, str) and attribute.startswith("[[")
    return json.loads(attribute) if is_text_of_lists else attribute


def facts_of(found: Any, start: Any) -> dict[str, Any]:
    """Return the summary of a run; without its first state, the drift is empty."""
    return {
        **_of_both(found),
        "saved_states": len(found),
        "method": found.method,
        "drift": {} if start is None else _drift(found, start),
    }


def _facts_of_crossings(found: Any) -> dict[str, Any]:
    names = "transient", "direction", "most", "method"
    given = {name: getattr(found, name) for name in names if getattr(found, name) is not None}
    return {**_of_both(found), "crossings": len(found), **given}


def _of_both(found: Any) -> dict[str, Any]:
    """Return what a run and crossings have in common."""
    return {
        "body": repr(found.body) if found.body.shape else found.body.to_dict(),
        "eps": found.eps if isinstance(found.eps, float) else f"{found.eps.size} values",
        **_counts(found.status),
        "steps": found.steps,
        "map": found.map.name,
    }


def _counts(status: Any) -> dict[str, Any]:
    """Return the number of trajectories, in all and of each status, or not computed yet."""
    codes = {each.name: int(each) for each in sf.Status} | {"PENDING": -128}
    counts = {name: int((status == code).sum()) for name, code in codes.items()}
    return {"trajectories": status.size, "status": {k: n for k, n in counts.items() if n}}


def _drift(found: Any, start: Any) -> dict[str, float]:
    """Return the largest finite relative change of the conserved quantity, by its name."""
    import numpy as np

    name = found.map.conserves(found.body)
    if name is None:
        return {}
    with np.errstate(all="ignore"):
        last, first = (found._value(name, x) for x in (found.final, start))
        change = np.asarray(abs(last / first - 1))
    finite = change[np.isfinite(change)]
    return {name: float(finite.max())} if finite.size else {}


_FEW = 6  # numbers that are printed one by one
# Measured numbers, of which people read few digits; all others have all of theirs.
_MEASURED = "drift", "seconds", "steps_per_second"


def lines_of(facts: dict[str, Any], as_json: bool) -> str:
    """Return a line for each fact, or one JSON object for programs."""
    if as_json:
        return json.dumps(facts)
    rows = []
    for name, value in _for_people(facts).items():
        text = _spelled(value, ".4g" if name in _MEASURED else "")
        rows.append((name.replace("_", " "), text))
    for name, count in facts["status"].items():
        meaning = sf.Status[name].message if name in sf.Status.__members__ else "not computed yet"
        rows.append(("status", f"{count:,} {name}: {meaning}"))
    return "\n".join(f"{name:<17}{text}" for name, text in rows if text)


def _for_people(facts: dict[str, Any]) -> dict[str, Any]:
    """Return the facts with a field as its formula, and no method where there is only one."""
    from .maps import MAPS

    shown, record = dict(facts), MAPS[facts["map"]]
    for name in ("map", "status"):
        del shown[name]
    ways = [name for other in MAPS.values() if other.body is record.body for name in other.methods]
    if len(ways) == 1:
        del shown["method"]
    if record.variable == "x":
        body = facts["body"]
        tables = [name for name in _TABLES if name in facts]
        if not isinstance(body, dict) and "quadratic" in facts:  # of a store
            body = {"body": body} | {k: facts[k] for k in (*_TABLES[:3], "names") if k in facts}
            # It has the size and the range of a large table, and not its numbers.
            if any(isinstance(body[name], str) for name in _TABLES[:3]):
                body = body["body"]
        if isinstance(body, dict):
            values = body.get("parameters", {}).items()
            named = [f"{name} = {_spelled(value)}" for name, value in values]
            shown["body"] = ", ".join([repr(sf.body_from_dict(body)), *named])
        for name in tables:
            del shown[name]
    return shown


# Attributes of the stores of fields.
_TABLES = "quadratic", "linear", "constant", "H", "K"


def _spelled(value: Any, form: str = "") -> str:
    """Return a number, or the parameters of a body, as people read them."""
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
            flat = [each for row in flat for each in row]
        if len(flat) > _FEW:
            return f"{len(flat):,} values from {min(flat):g} to {max(flat):g}"
    return str(value).partition(", sha256")[0]
