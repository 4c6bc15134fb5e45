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
from numpy.typing import NDArray

from .._checks import one_of, real_array, wrong
from .._engine.problem import STATUSES, Map, Problem, Span, numbers_of_saved
from .._maps import map_named
from .running import resumed

Entries = dict[str, NDArray[Any]]

# Version of this format.
FORMAT = 5
RESUME = "resume/"
# So begin the names of arrays of named parameters.
NAMED = "parameter/"
# Entries of one number or one string.
_NUMBERS, _TEXTS = ("format", "steps", "save_every"), ("version", "map", "method", "body")
HEADER = (*_NUMBERS, *_TEXTS)
_OPTIONAL = "save_every", "body"
# Axes of the parameters of a body after those of the batch; the first is also that of states.
COMPONENTS = "component", "component_j", "component_k"


class Entry(NamedTuple):
    """An array of a run."""

    dims: tuple[str | int, ...]  # symbolic axes, and fixed lengths
    dtype: str = "float64"
    meaning: str = ""
    varying: bool = False  # True for parameters, of any shape that broadcasts to the batch
    optional: bool = False  # True if it may be absent

    def axes(self, batch: tuple[Any, ...], sizes: Mapping[Any, Any]) -> tuple[Any, ...]:
        """Return the axes, with those of the batch inserted and others replaced by `sizes`."""
        return tuple(
            each
            for dim in self.dims
            for each in (batch if dim == "batch" else (sizes.get(dim, dim),))
        )


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


def schema_of(map: Map) -> dict[str, Entry]:
    """Return the possible arrays of runs of a map, by name."""
    states, body = Entry(("n", "batch", "component"), meaning=map.meaning), map.body
    parameters = {
        name: Entry(
            ("batch", *COMPONENTS[: body._axes(name)]),
            meaning=body._meanings[name],
            varying=True,
            optional=name not in body._required(),
        )
        for name in body._names()
    }
    resume = {RESUME + each.name: Entry(each.dims, each.dtype, optional=True) for each in map.kept}
    orientations = _OF_ORIENTATIONS if map.carries_attitude else {}
    return {map.variable: states, **_OF_ALL_MAPS, **parameters, **orientations, **resume}


def parameters_of(body: Any) -> Entries:
    """Return the parameters of a body, and the named ones that are coordinates of datasets."""
    return {**body._arrays, **{NAMED + name: each for name, each in body._coordinates.items()}}


def names_in(header: Mapping[str, Any]) -> list[str]:
    """Return the named parameters of the body in a header."""
    return list(json.loads(header.get("body", "{}")).get("parameters", {}))


def with_names(schema: dict[str, Entry], names: Iterable[str]) -> dict[str, Entry]:
    """Return a schema with entries of named parameters."""
    entry = Entry(("batch",), meaning="parameter", varying=True, optional=True)
    return {**schema, **dict.fromkeys(names, entry)}


def header_of(body: Any, map: Map, method: str, steps: int, save_every: int | None) -> Entries:
    """Return the header of a run, with the body as text if its arrays round it."""
    from .. import __version__

    numbers, texts = (FORMAT, steps, save_every), (__version__, map.name, method, body._text)
    header = zip(HEADER, (*numbers, *texts), strict=True)
    return {name: np.asarray(value) for name, value in header if value is not None}


def entries_of(run: Any) -> Entries:
    """Return the entries of `Trajectories`."""
    results = "eps", *(each.name for each in STATUSES), "attitude"
    last_is_saved = run.save_every is None or run.steps % run.save_every == 0
    arrays = {
        run._map.variable: run.states,
        "n": run.n,
        **{name: getattr(run, name) for name in results},
        "final": None if last_is_saved else run.final,
        **parameters_of(run.body),
        **{RESUME + name: a for name, a in run._resume.items() if name not in results},
    }
    header = header_of(run.body, run._map, run.method, run.steps, run.save_every)
    return header | {name: np.asarray(a) for name, a in arrays.items() if a is not None}


def run_of(entries: Entries) -> tuple[Entries, dict[str, Any]]:
    """Return what resumes a run, and its attributes; ValueError if the entries form none."""
    header = read_header(entries)
    map = map_named(header["map"])
    steps, every = header["steps"], header.get("save_every")
    _check_arrays(entries, map, 1 if every is None else steps // every + 1)
    states, eps, n = np.ascontiguousarray(entries[map.variable]), entries["eps"], entries["n"]
    method, batch = one_of("method", header["method"], map.methods), entries["status"].shape
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
        resume |= {each.name: entries[each.name].reshape(-1) for each in STATUSES}
    step_size = float(eps) if eps.ndim == 0 else eps
    if "omega0" in resume:
        problem = resumed(map, body, step_size, batch, method, resume)
        _check_resume(map, resume, problem, Span(steps, every))
    return resume, {
        **{name: entries[name] for name in ("status", "failed_at")},
        "states": states,
        "eps": step_size,
        "body": body,
        "final": entries.get("final", states[-1]),
        "method": method,
        "steps": steps,
        "save_every": every,
        "attitude": entries.get("attitude"),
        "_map": map,
    }


def _check_resume(map: Map, resume: Entries, problem: Problem, span: Span) -> None:
    """Raise ValueError if arrays are absent from which a run continues."""
    kept = [each.name for each in map.kept if not each.attitude or "R0" in resume]
    absent = [RESUME + name for name in kept if name not in resume]
    # Either all are there, or none if the first driver, which computes all it can, needs none.
    needs = map.drivers(problem, span)[0].keeps
    if absent and (needs or len(absent) < len(kept)):
        expected = f"a run of the map {map.name} with what resumes it"
        raise ValueError(f"expected {expected}, got one without {', '.join(absent)}")


def body_of(map: Map, entries: Mapping[str, Any]) -> Any:
    values = {name: entries[name] for name in map.body._names() if name in entries}
    if "body" not in entries:
        return map.body(**values)
    given = json.loads(str(entries["body"]))
    for name, value in given.get("parameters", {}).items():
        if value is None:
            given["parameters"][name] = entries[NAMED + name]
    return map.body.from_dict(values | given)


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
    header = {name: np.asarray(values[name]).tolist() for name in HEADER if name in values}
    for name in HEADER:
        value, kind = header.get(name), int if name in _NUMBERS else str
        if type(value) is not kind and (name in header or name not in _OPTIONAL):
            raise wrong(name, f"one {kind.__name__}", f"{value!r:.99}")
    steps, every = header["steps"], header.get("save_every", 1)
    if steps < 0 or every < 1:
        raise wrong("steps, save_every", "at least 0 and 1", f"{steps} and {every}")
    return header


def _check_arrays(entries: Entries, map: Map, rows: int) -> None:
    """Raise ValueError if arrays are absent, unknown or of other shapes; `rows` are saved."""
    arrays = {name: each for name, each in entries.items() if name not in HEADER}
    schema = with_names(schema_of(map), (name for name in arrays if name.startswith(NAMED)))
    absent = [name for name, each in schema.items() if not (each.optional or name in arrays)]
    unknown = [name for name in arrays if name not in schema]
    if absent or unknown:
        raise ValueError(
            f"expected a run of the map {map.name}, got one "
            + (f"without {', '.join(absent)}" if absent else f"with {', '.join(unknown)}")
        )
    if RESUME + "omega0" in arrays and ("attitude" in arrays) != (RESUME + "R0" in arrays):
        raise ValueError(f"attitude, {RESUME}R0: expected both or none, got one of them")
    batch = arrays["status"].shape
    components = (arrays[map.variable].shape or (0,))[-1]
    sizes = {
        "n": rows,
        **dict.fromkeys(COMPONENTS, components),
        "space": components + 1,
        "body": components + 1,
        "flat": math.prod(batch),
    }
    for name, array in arrays.items():
        entry = schema[name]
        whole, shape = entry.axes(batch, sizes), array.shape
        lengths = zip(shape[::-1], whole[::-1], strict=False)
        fits = len(shape) <= len(whole) and all(length in (1, most) for length, most in lengths)
        if shape != whole and not (entry.varying and fits):
            relation = "a shape that broadcasts to" if entry.varying else "shape"
            raise wrong(name, f"{relation} {whole}", shape)
        if array.dtype != entry.dtype:
            raise wrong(name, f"dtype {entry.dtype}", array.dtype)
