"""Runs as an `xarray.Dataset`, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._checks import wrong
from .._engine.status import Status
from .._maps import map_named
from .schema import COMPONENTS, HEADER, RESUME, TERM, Entries, Entry, read_header, schema_in

if TYPE_CHECKING:
    import xarray

# Names not available for axes of the batch.
TAKEN = ("n", "time", *COMPONENTS, TERM, "space", "body", "flat")


def import_xarray(*others: str, extra: str = "xarray") -> Any:
    """Return the module xarray; ImportError with the command if it or others are not installed."""
    for name in ("xarray", *others):
        try:
            import_module(name)
        except ImportError as error:
            install = f"pip install '.[{extra}]' in a copy of the repository"
            raise ImportError(f"expected {name}, got none: {install}") from error
    return import_module("xarray")


def dataset_of(
    body: Any,
    entries: Entries,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
) -> xarray.Dataset:
    """Return the dataset of the entries of a run, without the data needed to resume it."""
    xarray = import_xarray()
    header = {name: entries[name] for name in HEADER if name in entries}
    map, schema = map_named(header["map"]), schema_in(header)
    batch = _names_of(dims, entries, schema, body)
    variables = {
        name: _variable(name, entries[name], entry, batch)
        for name, entry in schema.items()
        if name in entries and not name.startswith(RESUME)
    }
    # Strings of variable length: Zarr format 3 has none of fixed length.
    labels = np.array(map.components(body), dtype=object)
    dataset = xarray.Dataset(
        variables,
        coords={"component": ("component", labels, {"long_name": f"component of {map.meaning}"})},
        attrs={"title": map.title, **header},
    )
    dataset = dataset.set_coords([*body._coordinates])
    for variable in dataset.variables.values():
        if variable.dtype.kind == "f":
            # Otherwise NaN becomes a fill value, which readers replace by another NaN.
            variable.encoding["_FillValue"] = None
    return dataset if coords is None else _with_coordinates(dataset, coords)


def with_time(dataset: xarray.Dataset) -> xarray.Dataset:
    """Return a dataset with the times n eps as a coordinate."""
    with np.errstate(over="ignore"):
        time = dataset["n"] * dataset["eps"]
    return dataset.assign_coords(time=time.assign_attrs(long_name="time"))


def _variable(name: str, array: NDArray[Any], entry: Entry, batch: tuple[str, ...]) -> Any:
    """Return an array with its axes and attributes."""
    attributes: dict[str, Any] = {"long_name": entry.meaning}
    if name in ("n", "failed_at", "attitude"):
        attributes["units"] = "1"
    if name == "status":
        attributes["flag_values"] = np.array([int(status) for status in Status], np.int8)
        attributes["flag_meanings"] = " ".join(status.name for status in Status)
    if not entry.varying:
        return entry.axes(batch, {}), array, attributes
    # Along the axes of length above 1, or with its name. The number of axes is an attribute, from
    # which the shape can be restored.
    components = entry.dims[1:]
    axes = attributes["batch_axes"] = array.ndim - len(components)
    names = (*batch[len(batch) - axes :], *components)
    along = [k for k, dim in enumerate(names) if k >= axes or array.shape[k] != 1 or dim == name]
    shape = tuple(array.shape[k] for k in along)
    return tuple(names[k] for k in along), array.reshape(shape), attributes


def batch_names(
    dims: str | Sequence[str] | None,
    batch: tuple[int, ...],
    taken: Iterable[str] = (),
    coordinates: Mapping[str, Any] | None = None,
) -> tuple[str, ...]:
    """Return a name for each axis of the batch, not among those in use.

    By default an axis has the name of the first of these coordinates that varies along it alone.
    """
    axes = len(batch)
    if dims is None:
        names = ["trajectory"] if axes == 1 else [f"batch_{k}" for k in range(axes)]
        for name, array in reversed([*(coordinates or {}).items()]):
            varying = [k - array.ndim for k, length in enumerate(array.shape) if length > 1]
            if len(varying) == 1:
                names[varying[0]] = name
        return tuple(names)
    names = [dims] if isinstance(dims, str) else list(dims)
    if not all(isinstance(name, str) for name in names):
        raise wrong("dims", "names", repr(dims), TypeError)
    clashing = sorted({*TAKEN, *HEADER, *taken} & set(names))
    if len(names) != axes or len(set(names)) != axes or clashing:
        but = f", of which {', '.join(clashing)} is taken" if clashing else ""
        expected = f"a distinct name for each of the {axes} axes of the batch"
        raise wrong("dims", expected, f"{dims!r}{but}")
    return tuple(names)


def _names_of(
    dims: str | Sequence[str] | None, entries: Entries, schema: dict[str, Entry], body: Any
) -> tuple[str, ...]:
    """Return names for the axes of a batch; a parameter may name its only varying axis."""
    batch = entries["status"].shape
    parameters = {name for name, entry in schema.items() if entry.varying and name in entries}
    names = batch_names(dims, batch, set(entries) - parameters, body._coordinates)
    for axis, name in enumerate(names):
        if name in parameters:
            shape = entries[name].shape
            alone = tuple(length if k == axis else 1 for k, length in enumerate(batch))
            if (1,) * (len(batch) - len(shape)) + shape != alone:
                expected = f"{name} for an axis along which it varies, and along no other"
                received = f"{name} of shape {shape} in a batch of shape {batch}"
                raise wrong("dims", expected, received)
    return names


def _with_coordinates(dataset: xarray.Dataset, coords: Mapping[Any, Any]) -> xarray.Dataset:
    if not isinstance(coords, Mapping):
        raise wrong("coords", "a mapping of names to values", type(coords).__name__, TypeError)
    if taken := [str(name) for name in coords if name in {*dataset.variables, *TAKEN}]:
        raise wrong("coords", "names not in use", ", ".join(taken))
    try:
        labelled = dataset.assign_coords(coords)
    except ValueError as error:
        raise ValueError(f"coords: {error}") from error
    if added := [str(name) for name in labelled.sizes if name not in dataset.sizes]:
        along = ", ".join(map(str, dataset.sizes))
        raise wrong("coords", f"values along {along}", f"new dimensions {', '.join(added)}")
    return labelled


def entries_of_dataset(dataset: xarray.Dataset) -> Entries:
    if not isinstance(dataset, import_xarray().Dataset):
        raise wrong("dataset", "an xarray.Dataset", type(dataset).__name__, TypeError)
    header = read_header(dataset.attrs)
    batch = tuple(map(str, dataset["status"].dims)) if "status" in dataset else ()
    entries: Entries = {**header, **parameters_in(dataset, header, batch)}
    for name, entry in schema_in(header).items():
        if name in dataset.variables and not entry.varying:
            variable, order = dataset[name], entry.axes(batch, {})
            if {*variable.dims} != {*order}:
                received = f"it along {', '.join(map(str, variable.dims)) or 'nothing'}"
                raise wrong("dataset", f"{name} along {', '.join(order)}", received)
            entries[name] = variable.transpose(*order).values
    return entries


def parameters_in(
    dataset: xarray.Dataset, header: Mapping[str, Any], batch: tuple[str, ...]
) -> Entries:
    """Return eps and the parameters of a body in their shapes before axes were dropped."""
    entries = {}
    for name, entry in schema_in(header).items():
        if not entry.varying or name not in dataset.variables:
            continue
        variable = dataset[name]
        components = tuple(dim for dim in entry.dims[1:] if dim in variable.dims)
        along = [dim for dim in variable.dims if dim not in components]
        if strangers := [str(dim) for dim in along if dim not in batch]:
            raise wrong("dataset", f"{name} along the batch", ", ".join(strangers))
        # A selected part of a batch may lack axes.
        fewest = len(batch) - min((batch.index(str(dim)) for dim in along), default=len(batch))
        axes = min(max(int(variable.attrs.get("batch_axes", 0)), fewest), len(batch))
        names = batch[len(batch) - axes :]
        absent = [dim for dim in names if dim not in along]
        entries[name] = variable.expand_dims(absent).transpose(*names, *components).values
    return entries
