"""Entries of files, datasets and stores of runs.

A run consists of a header (numbers and strings) and arrays. `schema_of` lists the arrays of runs of
a map, each as an `Entry` with symbolic axes: "n" (saved states), "batch" (all axes of the batch),
"flat" (trajectories, the batch in C order), "component" (components of a state), "space" and "body"
(axes of space and of the body, one more than components). The names of arrays needed to resume a
run begin with `RESUME`; datasets omit them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._checks import one_of, real_array, wrong
from .._engine.execution import numbers_of_saved
from .._maps.record import ENDS, Map
from .._maps.registry import map_named

Entries = dict[str, NDArray[Any]]
Shapes = Mapping[str, tuple[tuple[int, ...], "np.dtype[Any]"]]

# Version of this format.
FORMAT = 4
RESUME = "resume/"
# Entries of one number or one string; the last is absent if only the last state is saved.
_KINDS = int, str, str, str, int, int, str
HEADER = "format", "version", "map", "method", "steps", "save_every", "body"


# Axes of the parameters of a body after those of the batch; the first is also that of states.
COMPONENTS = "component", "component_j", "component_k"


class Entry(NamedTuple):
    """An array of a run."""

    # Symbolic axes, and fixed lengths.
    dims: tuple[str | int, ...]
    dtype: str = "float64"
    meaning: str = ""
    # True for parameters, of any shape that broadcasts to the batch.
    varying: bool = False
    # True if it may be absent.
    optional: bool = False

    def axes(self, batch: tuple[Any, ...], own: Mapping[Any, Any]) -> tuple[Any, ...]:
        """Return the axes, with those of the batch inserted and others replaced by `own`."""
        return tuple(
            each
            for dim in self.dims
            for each in (batch if dim == "batch" else (own.get(dim, dim),))
        )


_ENDS = {
    "n": Entry(("n",), "int64", "number of steps"),
    "eps": Entry(("batch",), meaning="step size", varying=True),
    "status": Entry(("batch",), "int8", "how the trajectory ended"),
    "failed_at": Entry(("batch",), "int64", "first state that does not exist, or -1"),
    "final": Entry(("batch", "component"), meaning="state after the last step", optional=True),
}
_ATTITUDE = Entry(
    ("n", "batch", "space", "body"),
    meaning="components in space of vectors of the body",
    optional=True,
)


def schema_of(map: Map) -> dict[str, Entry]:
    """Return the possible arrays of runs of a map, by name."""
    states = Entry(("n", "batch", "component"), meaning=map.meaning)
    body, entries = map.body, {map.variable: states, **_ENDS}
    for name in body._names():
        optional = name in body._optional()
        dims = ("batch", *COMPONENTS[: body._axes(name)])
        entries[name] = Entry(dims, "float64", body._meanings[name], True, optional)
    entries[RESUME + "omega0"] = Entry(("flat", "component"), optional=True)
    if map.carries_attitude:
        entries["attitude"] = _ATTITUDE
        entries[RESUME + "R0"] = Entry(("flat", "space", "body"), optional=True)
    for kept in map.kept:
        entries[RESUME + kept.name] = Entry(kept.dims, kept.dtype, optional=True)
    return entries


def header_of(body: Any, map: Map, method: str, steps: int, save_every: int | None) -> Entries:
    """Return the header of a run, with the body as text if its arrays round it."""
    from .. import __version__

    values = (FORMAT, __version__, map.name, method, steps, save_every, body._text)
    header = zip(HEADER, values, strict=True)
    return {name: np.asarray(value) for name, value in header if value is not None}


def entries_of(run: Mapping[str, Any]) -> Entries:
    """Return the entries of a run, given as the attributes of `Trajectories`."""
    ends = [kept.name for kept in ENDS]
    arrays = {
        run["_map"].variable: run["states"],
        **{name: run[name] for name in ("eps", *ends, "attitude")},
        "n": numbers_of_saved(run["steps"], run["save_every"]),
        "final": None if _is_saved(run) else run["final"],
        **run["body"]._arrays,
        **{RESUME + name: a for name, a in run["_resume"].items() if name not in ends},
    }
    about = (run[name] for name in ("body", "_map", "method", "steps", "save_every"))
    header = header_of(*about)
    return header | {name: np.asarray(a) for name, a in arrays.items() if a is not None}


def _is_saved(run: Mapping[str, Any]) -> bool:
    """Return True if the last state is the last of the saved ones, bit for bit."""
    last, final = run["states"][-1], run["final"]
    if run["save_every"] and run["steps"] % run["save_every"]:
        return False
    return np.shares_memory(last, final) or last.tobytes() == final.tobytes()


def run_of(entries: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the attributes of `Trajectories`; ValueError if the entries do not form a run."""
    check(entries, {name: (array.shape, array.dtype) for name, array in entries.items()})
    header = read_header(entries)
    map = map_named(header["map"])
    states, eps, n = np.ascontiguousarray(entries[map.variable]), entries["eps"], entries["n"]
    steps, every = header["steps"], header.get("save_every")
    one_of("method", header["method"], map.methods)
    real_array("eps", eps)
    if not np.array_equal(n, numbers_of_saved(steps, every)):
        expected = f"the saved steps of a run of {steps} steps with save_every={every}"
        raise wrong("n", expected, np.array2string(n, threshold=4, edgeitems=2))
    body = body_of(map, entries)
    components = len(map.components(body))
    if states.shape[-1] != components:
        raise wrong(map.variable, f"{components} components", states.shape[-1])
    start = len(RESUME)
    resume = {name[start:]: each for name, each in entries.items() if name.startswith(RESUME)}
    if "state" in resume:
        resume |= {kept.name: entries[kept.name].reshape(-1) for kept in ENDS}
    return {
        **{name: entries[name] for name in ("status", "failed_at")},
        "states": states,
        "eps": float(eps) if eps.ndim == 0 else eps,
        "body": body,
        "final": entries["final"] if "final" in entries else states[-1],
        "method": header["method"],
        "steps": steps,
        "save_every": every,
        "attitude": entries.get("attitude"),
        "_map": map,
        "_resume": resume,
    }


def body_of(map: Map, entries: Mapping[str, NDArray[Any]]) -> Any:
    """Return the body of a run."""
    if "body" in entries:
        return map.body.from_dict(json.loads(str(entries["body"])))
    return map.body(**{name: entries[name] for name in map.body._names() if name in entries})


def read_header(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the header as numbers and strings; ValueError if it is of another version."""
    if "format" not in values:
        raise ValueError(
            "expected a run from Trajectories.save or to_xarray, got one without a format"
        )
    written = str(values["format"])
    if written != str(FORMAT):
        version = values.get("version", "unknown")
        old = ": runs of older versions cannot be read; recompute them" if written < "4" else ""
        raise ValueError(
            f"expected a run in format {FORMAT}, got format {written}, of suslov_fast "
            f"{version}{old}"
        )
    missing = [name for name in HEADER[:-2] if name not in values]
    if missing:
        raise ValueError(f"expected a run, got one without {', '.join(missing)}")
    header: dict[str, Any] = {}
    for name, kind in zip(HEADER, _KINDS, strict=True):
        if name in values:
            value = np.asarray(values[name])
            if value.ndim or value.dtype.kind != ("U" if kind is str else "i"):
                raise wrong(name, f"one {kind.__name__}", f"{value.dtype} {value.shape}")
            header[name] = kind(value)
    steps, every = header["steps"], header.get("save_every", 1)
    if steps < 0 or every < 1:
        raise wrong("steps, save_every", "at least 0 and 1", f"{steps} and {every}")
    return header


def check(values: Mapping[str, Any], shapes: Shapes) -> None:
    """Raise ValueError if the header and the shapes of the arrays are inconsistent."""
    header = read_header(values)
    map = map_named(header["map"])
    schema = schema_of(map)
    arrays = {name: each for name, each in shapes.items() if name not in HEADER}
    missing = [name for name, each in schema.items() if not (each.optional or name in arrays)]
    unknown = [name for name in arrays if name not in schema]
    if missing or unknown:
        raise ValueError(
            f"expected a run of the map {header['map']}, got one "
            + (f"without {', '.join(missing)}" if missing else f"with {', '.join(unknown)}")
        )
    if RESUME + "omega0" in arrays and ("attitude" in arrays) != (RESUME + "R0" in arrays):
        raise ValueError(f"attitude, {RESUME}R0: expected both or none, got one of them")
    every = header.get("save_every")
    states, batch = arrays[map.variable][0], arrays["status"][0]
    components = states[-1] if states else 0
    sizes = {
        "n": 1 if every is None else header["steps"] // every + 1,
        **dict.fromkeys(COMPONENTS, components),
        "space": components + 1,
        "body": components + 1,
        "flat": math.prod(batch),
    }
    for name, (shape, dtype) in arrays.items():
        entry = schema[name]
        whole, expected = entry.axes(batch, sizes), "shape"
        fits = shape == whole
        if entry.varying:
            own, expected = len(entry.dims) - 1, "a shape that broadcasts to"
            fits = own <= len(shape) <= len(whole) and all(
                a == b or (k >= own and a == 1)
                for k, (a, b) in enumerate(zip(shape[::-1], whole[::-1], strict=False))
            )
        if not fits or dtype != np.dtype(entry.dtype):
            raise wrong(name, f"{expected} {whole} and dtype {entry.dtype}", f"{shape} and {dtype}")
