"""Runs and crossings as an `xarray.Dataset`: dimensions, coordinates, coefficients of fields."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import extra, instance, wrong
from ..engine.status import Status
from .columns import CROSSINGS, RUN, dims_of

# Attributes of the datasets of runs and of crossings.
_OF_RUNS = "method", "steps", "save_every"
_OF_CROSSINGS = "method", "steps", "transient", "direction", "most"
# Axes of a parameter of a body after those of the batch; the first is also that of states.
_COMPONENTS = "component", "component_j", "component_k"
_VARIABLES = [column for column in RUN if column.is_public]
# Names that neither an axis of the batch nor a coordinate of the user may have.
TAKEN = ("n", "time", *_COMPONENTS, "space", "body", *(c.name for c in _VARIABLES), *_OF_RUNS)


def to_xarray(
    run: Any,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
    with_tables: bool = False,
) -> Any:
    """Return a run as a dataset; see `Trajectories.to_xarray`.

    With `with_tables`, the coefficients of a field stay tables, because a store should have few
    arrays; `as_columns` divides them when it is opened.
    """
    from .. import __version__

    xarray = extra("xarray", "xarray")
    map, body, count = run.map, run.body, run.status.ndim
    arrays = {"eps": np.asarray(run.eps), **body._arrays}
    parameters = {  # with all axes of the batch
        name: np.array(array, ndmin=count + body._axes.get(name, 0))
        for name, array in arrays.items()
    }
    batch = _batch_names(run, dims, parameters)
    flags = {"flag_values": [int(s) for s in Status], "flag_meanings": " ".join(Status.__members__)}
    special = {"states": {"long_name": map.meaning}, "status": flags}
    variables: dict[str, Any] = {
        (map.variable if column.name == "states" else column.name): (
            dims_of(column, batch),
            values,
            special.get(column.name, {"long_name": column.meaning}),
        )
        for column in _VARIABLES
        if (values := getattr(run, column.name, None)) is not None
    }
    variables["n"] = "n", run.n, {"long_name": "number of steps"}
    # Strings of variable length, because Zarr format 3 has none of fixed length.
    variables["component"] = "component", np.array(body._labels, object)
    coordinates = [*body._coordinates, *({*batch} & {*parameters})]
    for name, array in parameters.items():
        variable = xarray.Variable((*batch, *_COMPONENTS[: array.ndim - count]), array)
        constant = [axis for axis in batch if variable.sizes[axis] == 1 and axis != name]
        variables[name] = variable.squeeze(constant)
        coordinates += [name] if body._axes.get(name) else []
    attributes = {"title": map.title, "map": map.name, "version": __version__}
    attributes |= {name: getattr(run, name) for name in _OF_RUNS if getattr(run, name) is not None}
    dataset = xarray.Dataset(variables, attrs=attributes).set_coords(coordinates)
    if coords is not None:
        instance("coords", coords, Mapping)
    if taken := [str(name) for name in coords or () if name in {*dataset.variables, *TAKEN}]:
        raise wrong("coords", "names that are not taken", ", ".join(repr(name) for name in taken))
    dataset = with_time(dataset.assign_coords(coords or {}))
    return dataset if with_tables else as_columns(dataset, columns_of(dataset))


def with_time(data: Any) -> Any:
    """Return a dataset with the coordinate `time`, n eps."""
    time = (data["n"] * data["eps"]).assign_attrs(long_name="time")
    return data.assign_coords(time=time)


def _indices(table: Any) -> Iterator[tuple[str, list[tuple[int, ...]]]]:
    """Yield the name of each column, such as quadratic_1_3, and the entries that it adds.

    A quadratic table is symmetric: its entries (0, 2) and (2, 0) both belong to x1 x3.
    """
    for index in np.ndindex(*(table.sizes[dim] for dim in table.dims if dim in _COMPONENTS[1:])):
        if [*index] == sorted(index):
            name = "_".join([str(table.name), *(str(k + 1) for k in index)])
            yield name, [index] if index == index[::-1] else [index, index[::-1]]


def _column(table: Any, entries: list[tuple[int, ...]]) -> Any:
    """Return the coefficients of a monomial: the sum of these entries of a table."""
    axes = [dim for dim in table.dims if dim in _COMPONENTS[1:]]
    parts = [table.variable.isel(dict(zip(axes, entry, strict=True))) for entry in entries]
    return parts[0] if len(parts) == 1 else parts[0] + parts[1]


def _tables(data: Any) -> list[Any]:
    """Return the names of the tables of coefficients of a field."""
    return [name for name in data.variables if _COMPONENTS[1] in data[name].dims]


def columns_of(data: Any) -> list[str]:
    """Return the names of the columns of tables of coefficients that are not 0."""
    return [
        name
        for table in _tables(data)
        for name, entries in _indices(data[table])
        if _column(data[table], entries).values.any()
    ]


def as_columns(data: Any, columns: Sequence[str]) -> Any:
    """Return a dataset with a coordinate for each monomial, in place of tables of coefficients.

    Otherwise a table of pandas would have a row for each pair of components. The coordinate
    linear_2 has the coefficients of x2, quadratic_1_3 those of x1 x3.
    """
    labels, coordinates = data["component"].values.tolist(), {}
    for table in _tables(data):
        for name, entries in _indices(data[table]):
            if name in columns:
                monomial = "*".join(labels[k] for k in entries[0])
                coordinates[name] = _column(data[table], entries)
                coordinates[name].attrs = {"long_name": f"coefficient of {monomial}"}
    return data.drop_vars(_tables(data)).assign_coords(coordinates)


def _batch_names(run: Any, dims: Any, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a name for each axis of the batch: that of a parameter that varies along it alone."""
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
    names = [dims] if isinstance(dims, str) else list(dims)
    if len(names) != count or len({*names}) != count or not all(isinstance(n, str) for n in names):
        raise wrong("dims", f"{count} different names, one for each axis of the batch", repr(dims))
    if clashing := sorted({*TAKEN, run.map.variable} & {*names}):
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


def crossings_to_xarray(points: Any) -> Any:
    """Return crossings as a dataset; see `Crossings.to_xarray`."""
    from .. import __version__

    dataset, map, body = extra("xarray", "xarray").Dataset, points.map, points.body
    variables: dict[str, Any] = {
        column.name: (
            dims_of(column, ()),
            getattr(points, column.name),
            {"long_name": column.meaning} if column.meaning else {},
        )
        for column in CROSSINGS
        if column.axes.startswith("crossing")
    }
    there = {"long_name": f"{map.meaning} there"}
    variables[map.variable] = ("crossing", "component"), points.states, there
    del variables["n"]  # a coordinate
    coords: dict[str, Any] = {"component": np.array(body._labels, object)}
    coords |= {name: ("crossing", getattr(points, name)) for name in ("trajectory", "n", "time")}
    coords["eps"] = "crossing", points._at_crossings(np.asarray(points.eps))
    for name, values in varying(body).items():
        if (axes := body._axes.get(name, 0)) < 2:  # a number, or a vector such as J
            dims = ("crossing", "component")[: axes + 1]
            coords[name] = dims, points._at_crossings(values, axes)
    attributes = {"title": map.title, "map": map.name, "version": __version__}
    arguments = {name: getattr(points, name) for name in _OF_CROSSINGS}
    attributes |= {name: value for name, value in arguments.items() if value is not None}
    return dataset(variables, coords, attributes)
