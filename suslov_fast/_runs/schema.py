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
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from .._checks import integer, one_of, real_array, wrong
from .._engine.problem import STATUSES, Map, numbers_of_saved
from .._maps import map_named

Entries = dict[str, Any]

# Version of this format.
FORMAT = 5
RESUME = "resume/"
# Entries of one number or one string; the last two may be absent.
HEADER = "format", "version", "map", "method", "steps", "save_every", "body"
# Axes of the parameters of a body after those of the batch; the first is also that of states.
COMPONENTS = "component", "component_j", "component_k"
# That of the coefficients of a Hamiltonian.
TERM = "term"


class Entry(NamedTuple):
    """An array of a run."""

    dims: tuple[str | int, ...]  # symbolic axes, and fixed lengths
    dtype: str = "float64"
    meaning: str = ""
    varying: bool = False  # True for parameters, of any shape that broadcasts to the batch
    optional: bool = False  # True if it may be absent

    def axes(self, batch: tuple[Any, ...], sizes: Mapping[Any, Any]) -> tuple[Any, ...]:
        """Return the axes, with those of the batch inserted and others replaced by `sizes`."""
        axes = (batch if dim == "batch" else (sizes.get(dim, dim),) for dim in self.dims)
        return sum(axes, ())


_OF_ALL_MAPS = {
    "n": Entry(("n",), "int64", "number of steps"),
    "eps": Entry(("batch",), meaning="step size", varying=True),
    "status": Entry(("batch",), "int8", "how the trajectory ended"),
    "failed_at": Entry(("batch",), "int64", "first state that does not exist, or -1"),
    "final": Entry(("batch", "component"), meaning="state after the last step", optional=True),
    RESUME + "omega0": Entry(("flat", "component"), optional=True),
}
_OF_ORIENTATIONS = {
    "attitude": Entry(
        ("n", "batch", "space", "body"),
        meaning="components in space of vectors of the body",
        optional=True,
    ),
    RESUME + "R0": Entry(("flat", "space", "body"), optional=True),
}
_NAMED = Entry(("batch",), meaning="parameter", varying=True, optional=True)


def schema_of(map: Map, named: Iterable[str] = ()) -> dict[str, Entry]:
    """Return the possible arrays of runs of a map whose body has these named parameters."""
    states, body = Entry(("n", "batch", "component"), meaning=map.meaning), map.body
    parameters = {
        name: Entry(
            ("batch", *((TERM,) if name == "H" else COMPONENTS[: body._axes(name)])),
            meaning=body._meanings[name],
            varying=True,
            optional=name not in body._required(),
        )
        for name in body._names()
    }
    resume = {RESUME + kept.name: Entry(kept.dims, kept.dtype, optional=True) for kept in map.kept}
    orientations = _OF_ORIENTATIONS if map.carries_attitude else {}
    parameters |= dict.fromkeys(named, _NAMED)
    return {map.variable: states, **_OF_ALL_MAPS, **parameters, **orientations, **resume}


def schema_in(header: Mapping[str, Any]) -> dict[str, Entry]:
    """Return the possible arrays of the run of a header."""
    named = json.loads(str(header.get("body", "{}"))).get("parameters", {})
    return schema_of(map_named(header["map"]), named)


def header_of(body: Any, map: Map, method: str, steps: int, save_every: int | None) -> Entries:
    """Return the header of a run, with the body as text if its arrays round it."""
    from .. import __version__

    values = FORMAT, __version__, map.name, method, steps, save_every, body._text
    return {name: value for name, value in zip(HEADER, values, strict=True) if value is not None}


def entries_of(run: Any) -> Entries:
    """Return the entries of `Trajectories`."""
    results = "status", "failed_at", "attitude"
    last_is_saved = run.save_every is None or run.steps % run.save_every == 0
    entries = {
        **header_of(run.body, run._map, run.method, run.steps, run.save_every),
        run._map.variable: run.states,
        "n": run.n,
        "eps": np.asarray(run.eps),
        **{name: getattr(run, name) for name in results},
        "final": None if last_is_saved else run.final,
        **run.body._arrays,
        **run.body._coordinates,
        **{RESUME + name: a for name, a in run._resume.items() if name not in results},
    }
    return {name: value for name, value in entries.items() if value is not None}


def run_of(entries: Entries) -> dict[str, Any]:
    """Return the attributes of a run; ValueError if the entries form none."""
    header = read_header(entries)
    map, steps, every = map_named(header["map"]), header["steps"], header.get("save_every")
    integer("steps", steps, 0)
    if every is not None:
        integer("save_every", every, 1)
    method = one_of("method", header["method"], map.methods)
    schema = schema_in(header)
    arrays = {name: np.asarray(entries[name]) for name in schema if name in entries}
    body = _checked_body(schema, header, arrays)
    if not np.array_equal(arrays["n"], numbers_of_saved(steps, every)):
        expected = f"the saved steps of a run of {steps} steps with save_every={every}"
        raise wrong("n", expected, np.array2string(arrays["n"], threshold=4, edgeitems=2))
    states, eps = np.ascontiguousarray(arrays[map.variable]), real_array("eps", arrays["eps"])
    statuses = {kept.name: arrays[kept.name] for kept in STATUSES}
    names = (name for name in arrays if name.startswith(RESUME))
    resume = {name.removeprefix(RESUME): arrays[name] for name in names}
    if "state" in resume:
        resume |= {name: array.reshape(-1) for name, array in statuses.items()}
    return {
        **statuses,
        "states": states,
        "eps": float(eps) if eps.ndim == 0 else eps,
        "body": body,
        "final": arrays.get("final", states[-1]),
        "method": method,
        "steps": steps,
        "save_every": every,
        "attitude": arrays.get("attitude"),
        "_map": map,
        "_resume": resume,
    }


def body_of(header: Mapping[str, Any], arrays: Mapping[str, Any]) -> Any:
    """Return the body of a run from its header and its arrays."""
    kind = map_named(header["map"]).body
    values = {name: arrays[name] for name in kind._names() if name in arrays}
    if "body" not in header:
        return kind(**values)
    given = json.loads(header["body"])
    for name, value in given.get("parameters", {}).items():
        if value is None and name not in arrays:
            raise wrong(name, "values of this parameter, as to_xarray() has them", "none")
        if value is None:
            given["parameters"][name] = arrays[name]
    return kind.from_dict(values | given)


def read_header(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the header as numbers and strings; ValueError if it is of another version."""
    if "format" not in values:
        raise ValueError("expected a run of this package, got other arrays")
    written = str(values["format"])
    if written != str(FORMAT):
        of = f", of suslov_fast {values['version']}" if "version" in values else ""
        is_old = written < str(FORMAT)
        old = ": runs of older versions cannot be read; recompute them" if is_old else ""
        raise wrong("format", f"{FORMAT}, that of this version", f"{written}{of}{old}")
    return {name: np.asarray(values[name]).tolist() for name in HEADER if name in values}


def _checked_body(schema: dict[str, Entry], header: Mapping[str, Any], arrays: Entries) -> Any:
    """Return the body; ValueError if arrays are absent, or of other shapes or types."""
    map, steps, every = map_named(header["map"]), header["steps"], header.get("save_every")
    absent = [name for name, entry in schema.items() if not (entry.optional or name in arrays)]
    if absent:
        raise ValueError(
            f"expected a run of the map {map.name}, got one without {', '.join(absent)}"
        )
    body, batch = body_of(header, arrays), arrays["status"].shape
    D = len(map.components(body))
    sizes = {
        "n": 1 if every is None else steps // every + 1,
        **dict.fromkeys(COMPONENTS, D),
        TERM: math.comb(D + 3, 3),
        "space": D + 1,
        "body": D + 1,
        "flat": math.prod(batch),
    }
    for name, array in arrays.items():
        entry, shape = schema[name], array.shape
        whole = entry.axes(batch, sizes)
        lengths = zip(shape[::-1], whole[::-1], strict=False)
        fits = len(shape) <= len(whole) and all(length in (1, most) for length, most in lengths)
        if shape != whole and not (entry.varying and fits):
            relation = "a shape that broadcasts to" if entry.varying else "shape"
            raise wrong(name, f"{relation} {whole}", shape)
        if array.dtype != entry.dtype:
            raise wrong(name, f"dtype {entry.dtype}", array.dtype)
    return body
