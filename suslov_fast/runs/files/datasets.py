"""Results as an `xarray.Dataset`: dimensions, coordinates, coefficients of fields."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ...checks import extra, instance, short, wrong
from ...engine.status import Status
from ..columns import ARGUMENTS, MOTION, OF_KIND, RUN, dims_of, in_stores

# The terms of a field in a store, and their axes: the names are no identifiers, as those of
# parameters are.
_INDICES, _VALUES, _OF_TERMS = "terms-indices", "terms-values", ("terms-places", "terms-numbers")
# Names that neither an axis of the batch nor a coordinate of the user may have.
TAKEN = (
    *("n", "time", "component", "space", "body"),
    *_OF_TERMS,
    *(column.name for column in (*RUN, *MOTION) if column.is_public),
    *ARGUMENTS["Trajectories"],
)


def to_xarray(
    run: Any,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
    with_terms: bool = False,
) -> Any:
    """Return a run or a motion as a dataset; see `States.to_xarray`.

    With `with_terms`, the coefficients of a field stay one list, because a store should have few
    arrays; `as_columns` divides it when it is opened.
    """
    special = {"states": {"long_name": run._meaning}, "status": flags()}

    def variables(batch: tuple[str, ...]) -> dict[str, Any]:
        found: dict[str, Any] = {
            (run._variable if column.name == "states" else column.name): (
                dims_of(column, batch),
                values,
                special.get(column.name, {"long_name": column.meaning}),
            )
            for column in in_stores(type(run).__name__, turns=True)
            if (values := getattr(run, column.name, None)) is not None
        }
        if hasattr(type(run), "n"):
            found["n"] = "n", run.n, {"long_name": "number of steps"}
        return found

    of_steps = {"eps": np.asarray(run.eps)} if hasattr(type(run), "n") else {}
    attributes = {**run._titles, **_arguments_of(run)}
    dataset = with_time(_labelled(run, variables, of_steps, attributes, dims, coords))
    return dataset if with_terms else as_columns(dataset)


def flags() -> dict[str, Any]:
    """Return the attributes of statuses."""
    return {"flag_values": [int(s) for s in Status], "flag_meanings": " ".join(Status.__members__)}


def _labelled(
    run: Any,
    variables_along: Callable[[tuple[str, ...]], dict[str, Any]],
    of_steps: dict[str, Any],
    attributes: dict[str, Any],
    dims: str | Sequence[str] | None,
    coords: Mapping[Any, Any] | None,
) -> Any:
    """Return variables along the axes of the batch, with parameters and coordinates."""
    from ... import __version__

    xarray, body, count = extra("xarray", "xarray"), run.body, run.status.ndim
    axes, arrays = {**body.axes, _VALUES: 1}, {**of_steps, **body.arrays}
    if body.lists_terms:
        indices, arrays[_VALUES] = body.terms
    parameters = {  # with all axes of the batch
        name: np.array(array, ndmin=count + axes.get(name, 0)) for name, array in arrays.items()
    }
    batch = _batch_names(run, dims, parameters)
    variables = variables_along(batch)
    # Strings of variable length, because Zarr format 3 has none of fixed length.
    variables["component"] = "component", np.array(body.labels, object)
    coordinates = [*body.coordinates, *({*batch} & {*parameters})]
    for name, array in parameters.items():
        inner = _inner(name, array.ndim - count) if name != _VALUES else _OF_TERMS[1:]
        variable = xarray.Variable((*batch, *inner), array)
        constant = [axis for axis in batch if variable.sizes[axis] == 1 and axis != name]
        variables[name] = variable.squeeze(constant)
        coordinates += [name] if axes.get(name) else []
    if body.lists_terms:
        variables[_INDICES] = _OF_TERMS, indices
    attributes = {**attributes, "version": __version__}
    dataset = xarray.Dataset(variables, attrs=attributes).set_coords(coordinates)
    if coords is not None:
        instance("coords", coords, Mapping)
    if taken := [str(name) for name in coords or () if name in {*dataset.variables, *TAKEN}]:
        raise wrong("coords", "names that are not taken", ", ".join(repr(name) for name in taken))
    for name, values in (coords or {}).items():
        for dim, length in xarray.Dataset(coords={name: values}).sizes.items():
            if length != (expected := dataset.sizes.get(dim, length)):
                raise wrong("coords", f"have {expected} values along {dim}", f"{length}, {name}")
    return dataset.assign_coords(coords or {})


def _inner(name: str, axes: int) -> tuple[str, ...]:
    """Return the dimensions of a parameter: none, those of a vector, or those of a matrix."""
    return ("component", *(f"{name}_{k}" for k in range(1, axes)))[:axes]


def _arguments_of(result: Any) -> dict[str, Any]:
    """Return the attributes of a dataset for the arguments of a run or of crossings."""
    arguments = {name: getattr(result, name) for name in ARGUMENTS[type(result).__name__]}
    return {
        # NetCDF has no truth values, and JSON no tuples.
        name: {bool: int, tuple: list}.get(type(value), lambda same: same)(value)
        for name, value in arguments.items()
        if value not in (None, ())
    }


def with_time(data: Any) -> Any:
    """Return a dataset with the coordinate `time`, which runs of a map lack: n eps."""
    if "time" in data.variables:
        return data
    time = data.variables["n"] * data.variables["eps"]
    time.attrs = {"long_name": "time"}
    return data.assign_coords(time=time)


def columns_of(data: Any) -> dict[str, tuple[str, Any]]:
    """Return, for each monomial of a field, the name of its column, its text and its terms.

    linear_2 stands for x2, quadratic_1_3 for x1 x3, and constant for 1.
    """
    if _INDICES not in data:
        return {}
    labels = data["component"].values.tolist()
    columns: dict[str, tuple[str, Any]] = {"constant": ("1", [])}
    for t, (_, *factors) in enumerate(data[_INDICES].values.T.tolist()):
        places = [k for k in factors if k < len(labels)]
        kind = ("constant", "linear", "quadratic")[len(places)]
        name = "_".join([kind, *(str(k + 1) for k in places)])
        columns.setdefault(name, ("*".join(labels[k] for k in places), []))[1].append(t)
    return columns


def as_columns(data: Any) -> Any:
    """Return a dataset with a coordinate for each monomial, in place of the terms of a field.

    Otherwise a table of pandas would have a row for each term.
    """
    coordinates, columns = {}, columns_of(data)
    if not columns:
        return data
    Variable, D = extra("xarray", "xarray").Variable, data.sizes["component"]
    values, rows = data[_VALUES], data[_INDICES].values[0]
    # Dask's for a family in a store; those of a single field are few.
    dims, array = (
        (*values.dims[:-1], "component"),
        values.data if values.ndim > 1 else values.values,
    )
    array = np.concatenate([array, np.zeros((*array.shape[:-1], 1))], axis=-1)
    for name, (monomial, terms) in columns.items():
        term_of = np.full(D, array.shape[-1] - 1)  # the 0 at the end
        term_of[rows[terms]] = terms
        meaning = {"long_name": f"coefficient of {monomial}"}
        coordinates[name] = Variable(dims, array[..., term_of], meaning)
    return data.drop_vars([_INDICES, _VALUES]).assign_coords(coordinates)


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
        for name in reversed([name for name in run.body.coordinates if name in axis_of]):
            names[axis_of[name]] = name
        return tuple(names)
    if not isinstance(dims, str | Iterable):
        raise wrong("dims", "a name, or one for each axis of the batch", short(dims), TypeError)
    names = [dims] if isinstance(dims, str) else list(dims)
    if len(names) != count or len({*names}) != count or not all(isinstance(n, str) for n in names):
        if count == 0:
            raise wrong("dims", "left out for one trajectory, which has no batch axis", repr(dims))
        raise wrong("dims", f"{count} different names, one for each axis of the batch", repr(dims))
    if clashing := sorted({*TAKEN, run._variable} & {*names}):
        raise wrong("dims", "names that are not taken", ", ".join(map(repr, clashing)))
    for axis, name in enumerate(names):
        if name in parameters and run.status.shape[axis] > 1 and axis_of.get(name) != axis:
            text = f"the parameter {name} varies along another axis: choose another name"
            raise ValueError(f"dims {dims!r}: {text}")
    return tuple(names)


def varying(body: Any) -> dict[str, Any]:
    """Return the parameters that vary along the batch of a body; of a field, the named ones."""
    arrays, axes, names = body.arrays, body.axes, body.parameters
    return {name: arrays[name] for name in names if arrays[name].ndim > axes.get(name, 0)}


def crossings_to_xarray(points: Any) -> Any:
    """Return crossings as a dataset; see `Points.to_xarray`."""
    from ... import __version__

    body, of_steps = points.body, {}
    variables: dict[str, Any] = {}
    for column in OF_KIND[type(points).__name__]:
        if column.axes.startswith("crossing") and column.name not in points.coordinates:
            name = points._variable if column.name == "states" else column.name
            meaning = {"long_name": column.meaning} if column.meaning else {}
            variables[name] = dims_of(column, ()), getattr(points, column.name), meaning
    coords: dict[str, Any] = {"component": np.array(body.labels, object)}
    coords |= {name: ("crossing", getattr(points, name)) for name in points.coordinates}
    attributes = {"title": f"Crossings by motions of a {type(body).__name__}"}
    if type(points).__name__ == "Crossings":
        map = points.map
        there = {"long_name": f"{map.meaning} there"}
        variables[map.variable] = ("crossing", "component"), points.states, there
        of_steps = {"eps": np.asarray(points.eps)}
        attributes = {"title": map.title, "map": map.name}
    for name, values in (of_steps | varying(body)).items():
        axes = body.axes.get(name, 0)
        coords[name] = ("crossing", *_inner(name, axes)), points._at_crossings(values, axes)
    attributes |= {"version": __version__, **_arguments_of(points)}
    return extra("xarray", "xarray").Dataset(variables, coords, attributes)
