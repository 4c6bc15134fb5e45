"""Results as an `xarray.Dataset`, with dimensions and coordinates, and as a table of pandas."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import FloatArray, extra, short, wrong
from ..status import Status
from .schema import ARGUMENTS, MOTION, RUN, dims_of, in_datasets, value_of

# Names that an axis of the batch may not have.
TAKEN = (
    *("n", "time", "component", "space", "body"),
    *(column.name for column in (*RUN, *MOTION) if column.is_public),
    *ARGUMENTS["Trajectories"],
)


def to_xarray(run: Any, dims: str | Sequence[str] | None = None) -> Any:
    """Return a run or a motion as a dataset; see `States.to_xarray`."""
    from .. import __version__

    xarray, body, count = extra("xarray", "xarray"), run.body, run.status.ndim
    is_of_map = hasattr(type(run), "n")
    has_eps = is_of_map and body._has_eps
    arrays = {"eps": np.asarray(run.eps), **body._arrays} if has_eps else body._arrays
    parameters = {  # with all axes of the batch
        name: np.array(a, ndmin=count + body._axes.get(name, 0)) for name, a in arrays.items()
    }
    batch = _batch_names(run, dims, parameters)
    flags = {"flag_values": [*map(int, Status)], "flag_meanings": " ".join(Status.__members__)}
    special = {"states": {"long_name": run._meaning}, "status": flags}
    variables: dict[str, Any] = {
        column.short: (
            dims_of(column, batch),
            values,
            special.get(column.name, {"long_name": column.meaning}),
        )
        for column in in_datasets(type(run).__name__, "turns", "events")
        if (values := value_of(run, column.name)) is not None
    }
    if is_of_map:
        variables["n"] = "n", run.n, {"long_name": "number of steps"}
        variables |= {} if has_eps else {"time": ("n", run.time, {"long_name": "time"})}
    # Strings of variable length, because Zarr format 3 has none of fixed length.
    variables["component"] = "component", np.array(body._labels, object)
    coordinates = [*body._coordinates, *({*batch} & {*parameters})]
    for name, array in parameters.items():
        variable = xarray.Variable((*batch, *("component",) * (array.ndim - count)), array)
        constant = [axis for axis in batch if variable.sizes[axis] == 1 and axis != name]
        variables[name] = variable.squeeze(constant)
        coordinates += [name] if body._axes.get(name) else []
    attributes = {**run._titles, **_arguments_of(run), "version": __version__}
    return with_time(xarray.Dataset(variables, attrs=attributes).set_coords(coordinates))


def _arguments_of(result: Any) -> dict[str, Any]:
    """Return the attributes of a dataset for the arguments of a run."""
    arguments = {name: getattr(result, name) for name in ARGUMENTS.get(type(result).__name__, ())}
    return {
        # NetCDF has no truth values, and JSON no tuples.
        name: {bool: int, tuple: list}.get(type(value), lambda same: same)(value)
        for name, value in arguments.items()
        if not isinstance(value, np.ndarray) and value not in (None, ())
    }


def with_time(data: Any) -> Any:
    """Return a dataset with the coordinate `time`, which runs of a map lack: n eps."""
    if "time" in data.variables:
        return data
    time = data.variables["n"] * data.variables["eps"]
    time.attrs = {"long_name": "time"}
    return data.assign_coords(time=time)


def _batch_names(run: Any, dims: Any, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a name for each axis of the batch: the only parameter that varies along it."""
    count = run.status.ndim
    axis_of = {}  # parameters that vary along one axis only
    for name, array in parameters.items():
        axes = [k for k in range(count) if array.shape[k] > 1]
        if len(axes) == 1:
            axis_of[name] = axes[0]
    if dims is None:
        names = ["trajectory"] if count == 1 else [f"batch_{k}" for k in range(count)]
        for name in reversed([name for name in run.body._coordinates if name in axis_of]):
            names[axis_of[name]] = name
        return tuple(names)
    if not isinstance(dims, str | Iterable):
        raise wrong("dims", "a name, or one for each axis of the batch", short(dims), TypeError)
    names = [dims] if isinstance(dims, str) else list(dims)
    if len(names) != count or len({*names}) != count or not all(isinstance(n, str) for n in names):
        if count == 0:
            raise wrong("dims", "left out for one trajectory, which has no batch axis", repr(dims))
        raise wrong("dims", f"{count} different names, one for each axis of the batch", repr(dims))
    if clashing := sorted({*TAKEN} & {*names}):
        raise wrong("dims", "names that are not taken", ", ".join(map(repr, clashing)))
    for axis, name in enumerate(names):
        if name in parameters and run.status.shape[axis] > 1 and axis_of.get(name) != axis:
            text = f"the parameter {name} varies along another axis: choose another name"
            raise ValueError(f"dims {dims!r}: {text}")
    return tuple(names)


def varying(body: Any) -> dict[str, Any]:
    """Return the parameters that vary along the batch of a body; of a field, the named ones."""
    arrays, axes, names = body._arrays, body._axes, body.parameters
    return {name: arrays[name] for name in names if arrays[name].ndim > axes.get(name, 0)}


def varying_numbers(result: Any) -> dict[str, Any]:
    """Return the numbers that vary along the batch of a result by name: parameters, then eps."""
    found = {k: array for k, array in varying(result.body).items() if k not in result.body._axes}
    eps = np.asarray(vars(result).get("eps"))
    return found | ({"eps": eps} if eps.ndim else {})


def events_to_xarray(events: Any) -> Any:
    """Return events as a dataset; see `Events.to_xarray`."""
    from .. import __version__

    body, variables = events.body, {}
    for name in ("before", "states"):
        about = {"long_name": f"{events._meaning} {'there' if name == 'states' else name}"}
        variables[name] = ("event", "component"), getattr(events, name), about
    coords: dict[str, Any] = {"component": np.array(body._labels, object)}
    coords |= {name: ("event", getattr(events, name)) for name in events._coordinates}
    for name, values in varying(body).items():
        axes = body._axes.get(name, 0)
        coords[name] = ("event", *("component",) * axes), events._at_events(values, axes)
    attributes = {**events._titles, "version": __version__}
    return extra("xarray", "xarray").Dataset(variables, coords, attributes)


def table(result: Any) -> Any:
    """Return a result as a table; see `Result.to_dataframe`."""
    parameters = varying_numbers(result)
    if hasattr(result, "_coordinates"):
        columns = {name: getattr(result, name) for name in result._coordinates}
        columns |= {name: result._at_events(values) for name, values in parameters.items()}
        states = result.states
    else:
        columns, states = _of_runs(result)
    for name, column in zip(result.body._labels, states.T, strict=True):
        columns[f"{name}_" if name in columns else name] = column
    return extra("pandas", "xarray").DataFrame(columns)


def _of_runs(run: Any) -> tuple[dict[str, Any], FloatArray]:
    """Return the columns of a run or a motion, and its states, trajectory by trajectory."""
    N, batch = len(run.states), run.status.shape
    columns: dict[str, Any] = {}
    if batch:
        columns["trajectory"] = np.repeat(np.arange(run.status.size), N)
    if hasattr(type(run), "n"):
        columns["n"] = np.tile(run.n, run.status.size)
    time = run.time.reshape((N, *(1,) * (1 + len(batch) - run.time.ndim), *run.time.shape[1:]))
    columns["time"] = np.moveaxis(np.broadcast_to(time, (N, *batch)), 0, -1).ravel()
    for name, values in varying_numbers(run).items():
        columns[name] = np.repeat(np.broadcast_to(values, batch).ravel(), N)
    states = np.moveaxis(run.states, 0, -2).reshape(-1, len(run.body._labels))
    return columns, states
