"""Results as an `xarray.Dataset`."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..checks import extra, instance, wrong
from ..engine.status import Status

_NUMBERS = "method", "steps", "save_every"
_OF_CROSSINGS = "method", "steps", "transient", "direction", "most"
# Axes of a parameter of a body after those of the batch; the first is also that of states.
_COMPONENTS = "component", "component_j", "component_k"
_OF_RUNS = "status", "failed_at", "final", "attitude"
# Names of a dataset that no axis of a batch and no coordinate may have.
TAKEN = ("n", "time", *_COMPONENTS, "space", "body", *_OF_RUNS, *_NUMBERS)


def to_xarray(
    run: Any,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
    with_tables: bool = False,
) -> Any:
    """Return a run as a dataset; see `Trajectories.to_xarray`.

    Stores have few arrays, `with_tables`, which `as_columns` divides when they are opened.
    """
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
        "failed_at": (
            batch,
            run.failed_at,
            {"long_name": "first state missing or beyond a pole, or -1"},
        ),
        "n": ("n", run.n, {"long_name": "number of steps"}),
        # Strings of variable length: Zarr format 3 has none of fixed length.
        "component": ("component", np.array(body._labels, object)),
    }
    if run.attitude is not None:
        variables["attitude"] = ("n", *batch, "space", "body"), run.attitude
    coordinates = [*body._coordinates, *({*batch} & {*parameters})]
    for name, array in parameters.items():
        each = xarray.Variable((*batch, *_COMPONENTS[: array.ndim - count]), array)
        common = [axis for axis in batch if each.sizes[axis] == 1 and axis != name]
        variables[name] = each.squeeze(common)
        coordinates += [name] if body._axes.get(name) else []
    attributes = {"title": map.title, "map": map.name, "version": __version__}
    attributes |= {name: getattr(run, name) for name in _NUMBERS if getattr(run, name) is not None}
    dataset = xarray.Dataset(variables, attrs=attributes).set_coords(coordinates)
    if coords is not None:
        instance("coords", coords, Mapping)
    if taken := [str(name) for name in coords or () if name in {*dataset.variables, *TAKEN}]:
        raise wrong("coords", "names not in use", ", ".join(taken))
    dataset = with_time(dataset.assign_coords(coords or {}))
    return dataset if with_tables else as_columns(dataset, columns_of(dataset))


def with_time(data: Any) -> Any:
    """Return a dataset with the times of saved states."""
    time = (data["n"] * data["eps"]).assign_attrs(long_name="time")
    return data.assign_coords(time=time)


def _indices(table: Any) -> Iterator[tuple[str, list[tuple[int, ...]]]]:
    """Yield the name of each column of a table, as quadratic_1_3, and the places that it adds."""
    for index in np.ndindex(*(table.sizes[dim] for dim in table.dims if dim in _COMPONENTS[1:])):
        if [*index] == sorted(index):
            name = "_".join([str(table.name), *(str(k + 1) for k in index)])
            yield name, [index] if index == index[::-1] else [index, index[::-1]]


def _column(table: Any, places: list[tuple[int, ...]]) -> Any:
    axes = [dim for dim in table.dims if dim in _COMPONENTS[1:]]
    parts = [table.variable.isel(dict(zip(axes, place, strict=True))) for place in places]
    return parts[0] if len(parts) == 1 else parts[0] + parts[1]


def _tables(data: Any) -> list[Any]:
    return [each for each in data.variables if _COMPONENTS[1] in data[each].dims]


def columns_of(data: Any) -> list[str]:
    """Return the names of the columns of tables of coefficients that have other numbers than 0."""
    return [
        name
        for table in _tables(data)
        for name, places in _indices(data[table])
        if _column(data[table], places).values.any()
    ]


def as_columns(data: Any, columns: Sequence[str]) -> Any:
    """Return a dataset with columns as coordinates, in place of tables of coefficients.

    So a table of pandas has a row for each component. The coordinate linear_2 has the coefficients
    of x2, quadratic_1_3 those of x1 x3.
    """
    labels, found = data["component"].values.tolist(), {}
    for table in _tables(data):
        for name, places in _indices(data[table]):
            if name in columns:
                what = "*".join(labels[k] for k in places[0])
                found[name] = _column(data[table], places)
                found[name].attrs = {"long_name": f"coefficient of {what}"}
    return data.drop_vars(_tables(data)).assign_coords(found)


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
            text = f"{name} is the parameter that varies along another axis: choose another name"
            raise ValueError(f"dims {dims!r}: {text}")
    return tuple(names)


def varying(body: Any) -> dict[str, Any]:
    """Return the parameters of a body, for fields the named ones, that vary along its batch."""
    arrays, axes, names = body._arrays, body._axes, body.parameters
    return {name: arrays[name] for name in names if arrays[name].ndim > axes.get(name, 0)}


def crossings_to_xarray(points: Any) -> Any:
    """Return crossings as a dataset; see `Crossings.to_xarray`."""
    from .. import __version__

    dataset, map, body = extra("xarray", "xarray").Dataset, points.map, points.body
    lines = {"before": "state n", "after": "state n + 1", map.variable: f"{map.meaning} there"}
    states = {"before": points.before, "after": points.after, map.variable: points.states}
    variables: dict[str, Any] = {
        name: (("crossing", "component"), states[name], {"long_name": text})
        for name, text in lines.items()
    }
    variables["fraction"] = "crossing", points.fraction
    coords: dict[str, Any] = {"component": np.array(body._labels, object)}
    coords |= {name: ("crossing", getattr(points, name)) for name in ("trajectory", "n", "time")}
    coords["eps"] = "crossing", points._at_crossings(np.asarray(points.eps))
    for name, values in varying(body).items():
        if (axes := body._axes.get(name, 0)) < 2:  # one for J and I in n dimensions
            dims = ("crossing", "component")[: axes + 1]
            coords[name] = dims, points._at_crossings(values, axes)
    attributes = {"title": map.title, "map": map.name, "version": __version__}
    numbers = {name: getattr(points, name) for name in _OF_CROSSINGS}
    attributes |= {name: each for name, each in numbers.items() if each is not None}
    return dataset(variables, coords, attributes)
