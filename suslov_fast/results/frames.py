"""Results as an `xarray.Dataset`, with dimensions and coordinates, and as a table of pandas."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import FloatArray, extra
from ..status import Status
from .schema import ARGUMENTS, dims_of, in_datasets, value_of


def to_xarray(run: Any, batch: Sequence[str] | None = None) -> Any:
    """Return a run or a motion as a dataset; `batch` are names for the axes of the batch."""
    from .. import __version__

    xarray, body, count = extra("xarray", "xarray"), run.body, run.status.ndim
    is_of_map = hasattr(type(run), "n")
    has_eps = is_of_map and body._has_eps
    arrays = {"eps": np.asarray(run.eps), **body._arrays} if has_eps else body._arrays
    parameters = {  # parameters with all axes of the batch
        name: np.array(a, ndmin=count + body._axes.get(name, 0)) for name, a in arrays.items()
    }
    batch = tuple(_batch_names(run, parameters) if batch is None else batch)
    flags = {"flag_values": [*map(int, Status)], "flag_meanings": " ".join(Status.__members__)}
    meaning = "state" if body._variable == "x" else "angular velocity"
    special = {"states": {"long_name": meaning}, "status": flags}
    variables: dict[str, Any] = {
        column.short: (
            dims_of(column, batch),
            values,
            special.get(column.name, {"long_name": column.meaning}),
        )
        for column in in_datasets(type(run).__name__)
        if (values := value_of(run, column.name)) is not None
    }
    if is_of_map:
        variables["n"] = "n", run.n, {"long_name": "number of steps"}
        variables |= {} if has_eps else {"time": ("n", run.time, {"long_name": "time"})}
    # Strings of variable length, because Zarr format 3 has none of fixed length.
    variables["component"] = "component", np.array(body._layout.names, object)
    coordinates = [*body._coordinates, *({*batch} & {*parameters})]
    for name, array in parameters.items():
        variable = xarray.Variable((*batch, *("component",) * (array.ndim - count)), array)
        constant = [axis for axis in batch if variable.sizes[axis] == 1 and axis != name]
        variables[name] = variable.squeeze(constant)
        coordinates += [name] if body._axes.get(name) else []
    about = {"title": f"Motion of a {type(body).__name__}"}
    if is_of_map:
        about = {"title": run.map.title, "map": run.map.name}
    attributes = {**about, **_arguments_of(run), "version": __version__}
    data = xarray.Dataset(variables, attrs=attributes).set_coords(coordinates)
    if "time" in data.variables:
        return data
    time = data.variables["n"] * data.variables["eps"]
    time.attrs = {"long_name": "time"}
    return data.assign_coords(time=time)


def _arguments_of(result: Any) -> dict[str, Any]:
    """Return the arguments of a run as attributes of a dataset."""
    arguments = {name: getattr(result, name) for name in ARGUMENTS[type(result).__name__]}
    return {
        # Attributes cannot be truth values in NetCDF, nor tuples in JSON, which Zarr writes.
        name: {bool: int, tuple: list}.get(type(value), lambda same: same)(value)
        for name, value in arguments.items()
        if not isinstance(value, np.ndarray) and value not in (None, ())
    }


def _batch_names(run: Any, parameters: Mapping[str, Any]) -> list[str]:
    """Return names of the batch axes: the first parameter or eps that varies on one axis only."""
    count = run.status.ndim
    names = ["trajectory"] if count == 1 else [f"batch_{k}" for k in range(count)]
    for name in reversed([*varying_numbers(run)]):
        axes = [k for k in range(count) if parameters[name].shape[k] > 1]
        if len(axes) == 1:
            names[axes[0]] = name
    return names


def varying_numbers(result: Any) -> dict[str, Any]:
    """Return the numbers that vary along the batch of a result by name: parameters, then eps."""
    body, arrays = result.body, dict(result.body._arrays)
    names = [name for name in body.parameters if name not in body._axes]
    if "eps" in vars(result):
        arrays["eps"] = np.asarray(result.eps)
        names.append("eps")
    return {name: arrays[name] for name in names if arrays[name].ndim}


def times_of(run: Any) -> FloatArray:
    """Return the time of each state (n, ...) of a run or a motion."""
    time = run.time if run.time.ndim > 1 else run.time.reshape(-1, *(1,) * run.status.ndim)
    return np.broadcast_to(time, run.states.shape[:-1])


def table(result: Any) -> Any:
    """Return a result as a table; see `Result.to_dataframe`."""
    parameters = varying_numbers(result)
    if hasattr(result, "_coordinates"):
        columns = {name: getattr(result, name) for name in result._coordinates}
        columns |= {name: result._at_events(values) for name, values in parameters.items()}
        states = result.states
    else:
        columns, states = _of_runs(result)
    for name, column in zip(result.body._layout.names, states.T, strict=True):
        columns[f"{name}_" if name in columns else name] = column
    return extra("pandas", "xarray").DataFrame(columns)


def _of_runs(run: Any) -> tuple[dict[str, Any], FloatArray]:
    """Return columns for a table of a run or motion, and its states, trajectory by trajectory."""
    N, batch = len(run.states), run.status.shape
    columns: dict[str, Any] = {}
    if batch:
        columns["trajectory"] = np.repeat(np.arange(run.status.size), N)
    if hasattr(type(run), "n"):
        columns["n"] = np.tile(run.n, run.status.size)
    columns["time"] = np.moveaxis(times_of(run), 0, -1).ravel()
    for name, values in varying_numbers(run).items():
        columns[name] = np.repeat(np.broadcast_to(values, batch).ravel(), N)
    states = np.moveaxis(run.states, 0, -2).reshape(-1, len(run.body._layout.names))
    return columns, states
