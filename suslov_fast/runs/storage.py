"""Runs as .npz files, without loss, and as an `xarray.Dataset`."""

import errno
import json
import os
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import extra, instance, wrong
from ..engine.status import Status
from ..maps import body_from_dict, class_named, map_of, named

PathLike = str | os.PathLike[str]

FORMAT = 9
_ARRAYS = "states", "eps", "status", "failed_at", "final", "attitude", "_carry", "_turned"
_NUMBERS = "method", "steps", "save_every"
# Axes of a parameter of a body after those of the batch; the first is also that of states.
_COMPONENTS = "component", "component_j", "component_k"
# Names of a dataset that no axis of a batch and no coordinate may have.
TAKEN = ("n", "time", *_COMPONENTS, "space", "body", *_ARRAYS[2:6], *_NUMBERS)


def save(run: Any, path: PathLike, overwrite: bool) -> None:
    """Write a run to a .npz file, which appears under its name when it is complete."""
    from .. import __version__

    target = _checked(path)
    if target.exists() and not overwrite:
        message = "expected the name of a new file, or overwrite=True, got one that exists"
        raise FileExistsError(errno.EEXIST, message, os.fspath(path))
    about = {"format": FORMAT, "version": __version__}
    about |= {"map": run.map.name, **{name: getattr(run, name) for name in _NUMBERS}}
    described = run.body.to_dict()
    if class_named(described["body"]) is not type(run.body):
        raise wrong("body", "a class whose name no other one has", described["body"], TypeError)
    arrays = {name: getattr(run, name) for name in _ARRAYS if getattr(run, name) is not None}
    arrays |= {"about": json.dumps(about), "body": json.dumps(described)}
    new = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        with open(new, "xb") as file:
            np.savez(file, **arrays)
        os.replace(new, target)
    except OSError as error:  # it names the new file, which the caller does not know
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error
    finally:
        new.unlink(missing_ok=True)


def load(path: PathLike) -> dict[str, Any]:
    """Return the attributes of the run in a file of `save`; errors name the file."""
    name = os.fspath(_checked(path))
    try:
        with open(name, "rb") as file, np.lib.npyio.NpzFile(file) as entries:
            found = {each: entries[each] for each in entries.files}
        about = json.loads(str(found.get("about", "{}")))
        written = {each: str(found.get(each, "")) for each in ("format", "version")} | about
        if written["format"] not in ("", FORMAT):
            how = f"one of suslov_fast {written['version']}: compute the run again"
            raise wrong("format", f"{FORMAT}, that of this version", how)
        run: dict[str, Any] = {each: found.get(each) for each in _ARRAYS}
        run |= {each: about[each] for each in _NUMBERS}
        body, eps = body_from_dict(json.loads(str(found["body"]))), found["eps"]
        map = named(about["map"])
        if map_of(body, about["method"]) is not map:
            raise wrong("map", f"one of {type(body).__name__} and its method", repr(map.name))
        rows = run["steps"] // run["save_every"] + 1 if run["save_every"] else 1
        shape = rows, *run["status"].shape, body.dimension
        if run["states"].shape != shape:
            raise wrong("states", f"shape {shape}", run["states"].shape)
        return run | {"body": body, "map": map, "eps": float(eps) if eps.ndim == 0 else eps}
    except (OSError, MemoryError):
        raise
    except Exception as error:  # from NumPy, zipfile or json
        expected = "a file that Trajectories.save wrote"
        raise wrong(name, expected, f"another, or a damaged one: {error}") from error


def _checked(path: PathLike) -> Path:
    if not isinstance(path, (str, os.PathLike)):
        raise wrong("path", "a string or a path", type(path).__name__, TypeError)
    if Path(path).suffix.lower() != ".npz":
        how = "to_xarray().to_netcdf(path) and ensemble(store=...) write other formats"
        raise wrong("path", f"a name that ends in .npz ({how})", repr(os.fspath(path)))
    return Path(path)


def to_xarray(
    run: Any, dims: str | Sequence[str] | None = None, coords: Mapping[Any, Any] | None = None
) -> Any:
    """Return a run as a dataset; see `Trajectories.to_xarray`."""
    from .. import __version__

    xarray = extra("xarray", "xarray")
    map, body, count = run.map, run.body, run.status.ndim
    arrays = {"eps": np.asarray(run.eps), **body._arrays}
    parameters = {  # each with all axes of the batch first
        name: np.array(each, ndmin=count + body._axes.get(name, 0))
        for name, each in arrays.items()
        if name not in ("H", "K")
    }
    batch = _batch_names(run, dims, parameters)
    flags = {"flag_values": [int(s) for s in Status], "flag_meanings": " ".join(Status.__members__)}
    variables: dict[str, Any] = {
        map.variable: (("n", *batch, "component"), run.states, {"long_name": map.meaning}),
        "final": ((*batch, "component"), run.final, {"long_name": "state after the last step"}),
        "status": (batch, run.status, flags),
        "failed_at": (batch, run.failed_at, {"long_name": "first missing state, or -1"}),
        "n": ("n", run.n, {"long_name": "number of steps"}),
        # Strings of variable length: Zarr format 3 has none of fixed length.
        "component": ("component", np.array(body._labels, object)),
    }
    if run.attitude is not None:
        variables["attitude"] = ("n", *batch, "space", "body"), run.attitude
    for name, array in parameters.items():
        each = xarray.Variable((*batch, *_COMPONENTS[: array.ndim - count]), array)
        common = [axis for axis in batch if each.sizes[axis] == 1 and axis != name]
        variables[name] = each.squeeze(common)
    attributes = {"title": map.title, "map": map.name, "version": __version__}
    attributes |= {name: getattr(run, name) for name in _NUMBERS if getattr(run, name) is not None}
    dataset = xarray.Dataset(variables, attrs=attributes)
    dataset = dataset.set_coords([*body._coordinates, *({*batch} & {*parameters})])
    if coords is not None:
        instance("coords", coords, Mapping)
    if taken := [str(name) for name in coords or () if name in {*dataset.variables, *TAKEN}]:
        raise wrong("coords", "names not in use", ", ".join(taken))
    time = (dataset["n"] * dataset["eps"]).assign_attrs(long_name="time")
    return dataset.assign_coords({"time": time, **(coords or {})})


def _batch_names(run: Any, dims: Any, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a name for each axis of the batch; a parameter may name the one it varies along."""
    count = run.status.ndim
    alone = {}  # the axes along which parameters vary alone
    for name, array in parameters.items():
        along = [k for k in range(count) if array.shape[k] > 1]
        if len(along) == 1:
            alone[name] = along[0]
    if dims is None:
        names = ["trajectory"] if count == 1 else [f"batch_{k}" for k in range(count)]
        for name in reversed([name for name in run.body._coordinates if name in alone]):
            names[alone[name]] = name
        return tuple(names)
    names = [dims] if isinstance(dims, str) else list(dims)
    if len(names) != count or len({*names}) != count or not all(isinstance(n, str) for n in names):
        raise wrong("dims", f"a name for each of the {count} axes of the batch", repr(dims))
    if clashing := sorted({*TAKEN, run.map.variable} & {*names}):
        raise wrong("dims", "names that are not taken", ", ".join(clashing))
    for axis, name in enumerate(names):
        if name in parameters and run.status.shape[axis] > 1 and alone.get(name) != axis:
            raise wrong("dims", f"{name} for the axis along which it varies alone", repr(dims))
    return tuple(names)
