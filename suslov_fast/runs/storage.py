"""Runs as .npz files, without loss, and as an `xarray.Dataset`."""

import errno
import json
import os
import secrets
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import MOMENTS, common_shape, extra, instance, integer, real_array, within, wrong
from ..engine.arguments import require
from ..engine.status import Status
from ..maps import body_from_dict, class_named, map_of, named

PathLike = str | os.PathLike[str]

FORMAT = 9
_ARRAYS = "states", "eps", "status", "failed_at", "final", "attitude", "_carry", "_turned"
_TEXTS, _OLD = ("about", "body"), ("format", "version")  # the latter in files of 0.5
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
    try:
        new, file = _part(target)
        try:
            with file:
                np.savez(file, **arrays)
            os.replace(new, target)
        finally:
            new.unlink(missing_ok=True)
    except OSError as error:  # it names the new file, which the caller does not know
        raise OSError(error.errno, error.strerror, os.fspath(path)) from error


def _part(target: Path) -> tuple[Path, Any]:
    """Return a new file beside `target`; delete those that killed processes left there.

    A process holds a lock on its own. Windows deletes no file that is open.
    """
    for left in target.parent.glob(f".{escape(target.name)}.*.part"):
        with suppress(OSError), open(left, "rb+") as old:
            _lock(old)
            left.unlink()
    while True:
        new = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
        file = open(new, "xb")  # noqa: SIM115  (closed by the caller)
        with suppress(BlockingIOError):
            _lock(file)
            if new.exists():  # else another call deleted it, before the lock
                return new, file
        file.close()


def _lock(file: Any) -> None:
    """Lock a file until it is closed; BlockingIOError if another one has the lock."""
    with suppress(ImportError):
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def load(path: PathLike) -> dict[str, Any]:
    """Return the attributes of the run in a file of `save`; errors name the file.

    Only entries that a run has are read, and arrays only if their types and shapes are right.
    """
    name = os.fspath(_checked(path))
    try:
        with open(name, "rb") as file, zipfile.ZipFile(file) as entries:
            return _read(entries)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # from NumPy, zipfile or json
        expected = "a file that Trajectories.save wrote"
        raise wrong(name, expected, f"another, or a damaged one: {error}") from error


def _read(entries: zipfile.ZipFile) -> dict[str, Any]:
    kinds = {name: _kind(entries, name) for name in (*_ARRAYS, *_TEXTS, *_OLD)}
    given = {name: kind for name, kind in kinds.items() if kind is not None}
    texts = {name: str(_entry(entries, name)) for name in (*_TEXTS, *_OLD) if name in given}
    about = json.loads(texts.get("about", "{}"))
    version = about.get("version", texts.get("version"))
    if about.get("format", texts.get("format", FORMAT)) != FORMAT:
        how = f"one of suslov_fast {version}: compute the run again"
        raise wrong("format", f"{FORMAT}, that of this version", how)
    method, steps, every = (about[name] for name in _NUMBERS)
    integer("steps", steps, 0)
    rows = 1 if every is None else steps // integer("save_every", every, 1) + 1
    body, map = body_from_dict(json.loads(texts["body"])), named(about["map"])
    if map_of(body, method) is not map:
        raise wrong("map", f"one of {type(body).__name__} and its method", repr(map.name))
    # All other shapes follow from that of `status`.
    batch, D = given["status"][1], body.dimension
    size, turns = int(np.prod(batch)), "attitude" in given or "_turned" in given
    expected = arrays_of_a_run("states", batch, rows, D, turns)
    expected["_carry"] = "float64", (map.methods[method].carried, size)
    if turns:
        expected["_turned"] = "float64", (size, D + 1, D + 1)
    if "eps" in given:  # it broadcasts to the batch
        expected["eps"] = "float64", given["eps"][1]
        shapes = {"body": body.shape, "eps": given["eps"][1], "status": batch}
        if common_shape(shapes) != batch:
            raise wrong("status", f"shape {common_shape(shapes)}", batch)
    check_arrays({name: given[name] for name in given if name in _ARRAYS}, expected)
    run: dict[str, Any] = dict.fromkeys(_ARRAYS)
    run |= {name: _entry(entries, name) for name in expected}
    eps = within("eps", real_array("eps", run["eps"]), MOMENTS)
    if not np.isin(run["status"], [*Status]).all():
        raise wrong("status", "values of Status", "others")
    run |= {"body": body, "map": map, "eps": float(eps) if eps.ndim == 0 else eps}
    return run | {"method": method, "steps": steps, "save_every": every}


def _kind(entries: zipfile.ZipFile, name: str) -> tuple[str, tuple[int, ...]] | None:
    """Return type and shape of an entry, without its numbers; None if there is none."""
    if f"{name}.npy" not in entries.namelist():
        return None
    with entries.open(f"{name}.npy") as file:
        read = np.lib.format.read_array_header_1_0
        if np.lib.format.read_magic(file) != (1, 0):
            read = np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
    return dtype.newbyteorder("=").name, shape


def _entry(entries: zipfile.ZipFile, name: str) -> Any:
    """Return the array of an entry, in native and contiguous memory."""
    require(entries.getinfo(f"{name}.npy").file_size, "this file needs as many")
    with entries.open(f"{name}.npy") as file:
        array = np.lib.format.read_array(file)
    return np.asarray(array, array.dtype.newbyteorder("="), order="C")


def arrays_of_a_run(
    states: str, batch: tuple[int, ...], rows: int, D: int, turns: bool
) -> dict[str, tuple[str, tuple[int, ...]]]:
    """Return the types and shapes of the arrays of a run, whose states have the name `states`."""
    found: dict[str, tuple[str, tuple[int, ...]]] = {
        states: ("float64", (rows, *batch, D)),
        "final": ("float64", (*batch, D)),
        "status": ("int8", batch),
        "failed_at": ("int64", batch),
    }
    if turns:
        found["attitude"] = "float64", (rows, *batch, D + 1, D + 1)
    return found


def check_arrays(given: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    """Check types and shapes of the arrays of a file or a store, by name."""
    for name, (kind, shape) in expected.items():
        if name not in given:
            raise wrong(name, f"{kind} of shape {shape}", "none")
        if given[name] != (kind, shape):
            raise wrong(name, f"{kind} of shape {shape}", "{} of shape {}".format(*given[name]))


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
        name: np.array(each, ndmin=count + body._axes.get(name, 0)) for name, each in arrays.items()
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
