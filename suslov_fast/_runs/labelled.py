"""Entries of a run as an `xarray.Dataset`, and back."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._engine.status import Status
from .schema import BODIES, PLAIN, RESUME, Entries, parameters_in, parameters_of

if TYPE_CHECKING:
    import xarray

# Beside the axes of the batch.
_AXES = ("n", "component", "space", "body")
# Units are the user's: only what they are units of is known.
_ATTRIBUTES: dict[str, dict[str, Any]] = {
    "omega": {"long_name": "angular velocity", "units": "1/time"},
    "final": {"long_name": "angular velocity after the last step", "units": "1/time"},
    "n": {"long_name": "number of steps", "units": "1"},
    "t": {"long_name": "time", "units": "time"},
    "eps": {"long_name": "step size", "units": "time"},
    "component": {"long_name": "component of the angular velocity"},
    "attitude": {"long_name": "components in space of vectors of the body", "units": "1"},
    "failed_at": {"long_name": "first state that does not exist, or -1", "units": "1"},
    "status": {
        "long_name": "how the trajectory ended",
        "flag_values": np.array([int(status) for status in Status], np.int8),
        "flag_meanings": " ".join(status.name for status in Status),
    },
    "I1": {"long_name": "moment of inertia", "units": "inertia"},
    "I2": {"long_name": "moment of inertia", "units": "inertia"},
    "I13": {"long_name": "product of inertia", "units": "inertia"},
    "I23": {"long_name": "product of inertia", "units": "inertia"},
    "J": {"long_name": "sum I_ii + I_nn", "units": "inertia"},
    "I": {"long_name": "coupling I_in", "units": "inertia"},
}


def import_xarray() -> Any:
    """The module xarray, or an ImportError that says how to get it."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError("expected xarray, got none: pip install 'suslov_fast[xarray]'") from error
    return xarray


def dataset_of(
    entries: Entries,
    dims: str | Sequence[str] | None = None,
    coords: Mapping[Any, Any] | None = None,
) -> xarray.Dataset:
    """The dataset that `Trajectories.to_xarray` returns."""
    xarray = import_xarray()
    kind = str(entries["body"])
    omega = entries["omega"]
    batch = batch_names(dims, entries["status"].ndim, entries)
    variables: dict[str, Any] = {
        "omega": (("n", *batch, "component"), omega),
        "status": (batch, entries["status"]),
        "failed_at": (batch, entries["failed_at"]),
        "eps": _varying(entries["eps"], batch),
    }
    for name in parameters_in(entries):
        own = ("component",) if kind == "SuslovND" else ()
        variables[name] = _varying(entries[name], batch, own)
    if "final" in entries:
        variables["final"] = ((*batch, "component"), entries["final"])
    if "attitude" in entries:
        variables["attitude"] = (("n", *batch, "space", "body"), entries["attitude"])
    resume = {name: array for name, array in entries.items() if name.startswith(RESUME)}
    for name, array in resume.items():
        variables[name] = (tuple(f"{name}_axis{k}" for k in range(array.ndim)), array)
    dataset = xarray.Dataset(
        variables,
        coords={
            "n": entries["n"],
            "t": _times(entries["n"], variables["eps"]),
            "component": _component_names(entries),
        },
        attrs=_global_attributes(entries),
    )
    if resume:
        last = entries.get("final", omega[-1])
        dataset.attrs["resume_after"] = _checksum_of(last)
    for name, variable in dataset.variables.items():
        variable.attrs.update(_ATTRIBUTES.get(name, {}))
        if variable.dtype.kind == "f":
            # Else NaN becomes a "fill value", which readers replace by a NaN of their own.
            variable.encoding["_FillValue"] = None
    return _with_coordinates(dataset, coords)


def batch_names(
    dims: str | Sequence[str] | None, axes: int, taken: Iterable[str] = ()
) -> tuple[str, ...]:
    """A name for each axis of the batch; none of those of variables may be among them."""
    if dims is None:
        return ("trajectory",) if axes == 1 else tuple(f"batch_{k}" for k in range(axes))
    names = (dims,) if isinstance(dims, str) else tuple(dims)
    if not all(isinstance(name, str) for name in names):
        raise TypeError(f"dims: expected names, got {dims!r}")
    clashing = sorted({*_AXES, "t", *taken} & set(names))
    if len(names) != axes or len(set(names)) != axes or clashing:
        but = f", of which {', '.join(clashing)} is taken" if clashing else ""
        raise ValueError(
            f"dims: expected a name of its own for each of the {axes} axes of the batch, "
            f"got {dims!r}{but}"
        )
    return names


def _varying(
    array: NDArray[Any], batch: tuple[str, ...], own: tuple[str, ...] = ()
) -> tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]:
    """An array that broadcasts to the batch, along the axes on which it has more than one entry.

    The number of its axes is an attribute, so that its shape can be found again.
    """
    axes = array.ndim - len(own)
    kept = [k for k in range(axes) if array.shape[k] != 1]
    shape = (*(array.shape[k] for k in kept), *array.shape[axes:])
    names = batch[len(batch) - axes :]
    return (*(names[k] for k in kept), *own), array.reshape(shape), {"batch_axes": axes}


def _times(n: NDArray[np.int64], eps: tuple[Any, NDArray[Any], Any]) -> Any:
    dims, values, _ = eps
    with np.errstate(over="ignore"):
        return ("n", *dims), np.multiply.outer(n, values)


def _component_names(entries: Entries) -> NDArray[Any]:
    last = "n" if str(entries["map"]) == "suslov_nd" else ""
    dimension = entries["omega"].shape[-1]
    # Strings of any length: those of fixed length are no part of Zarr's third format.
    return np.array([f"Omega{i + 1}{last}" for i in range(dimension)], dtype=object)


def _global_attributes(entries: Entries) -> dict[str, Any]:
    return {
        "Conventions": "CF-1.11",
        "title": "Trajectories of the discrete Suslov problem",
        "source": f"suslov_fast {entries['version']}",
        **{name: entries[name].item() for name in PLAIN if name in entries},
    }


def _with_coordinates(dataset: xarray.Dataset, coords: Mapping[Any, Any] | None) -> xarray.Dataset:
    if coords is None:
        return dataset
    if not isinstance(coords, Mapping):
        raise TypeError(
            f"coords: expected a mapping of names to values, got {type(coords).__name__}"
        )
    taken = [name for name in coords if name in dataset.variables or name in _AXES]
    if taken:
        raise ValueError(f"coords: expected names of their own, got {', '.join(map(str, taken))}")
    before = dict(dataset.sizes)
    try:
        labelled = dataset.assign_coords(coords)
    except ValueError as error:
        raise ValueError(f"coords: {error}") from error
    added = [str(name) for name in labelled.sizes if name not in before]
    if added:
        raise ValueError(
            f"coords: expected values along {', '.join(map(str, before))}, "
            f"got new dimensions {', '.join(added)}"
        )
    return labelled


def entries_of_dataset(dataset: xarray.Dataset) -> Entries:
    """The entries of a run that a dataset holds."""
    xarray = import_xarray()
    if not isinstance(dataset, xarray.Dataset):
        raise TypeError(f"dataset: expected an xarray.Dataset, got {type(dataset).__name__}")
    entries = {name: np.asarray(dataset.attrs[name]) for name in PLAIN if name in dataset.attrs}
    needed = {"omega", "n", "eps", "status", "failed_at"} - set(dataset.variables)
    if needed or str(entries.get("body")) not in BODIES:
        lacking = ", ".join(sorted(needed)) or "the attribute 'body'"
        raise ValueError(
            f"dataset: expected one that Trajectories.to_xarray made, got one without {lacking}"
        )
    batch = tuple(map(str, dataset["status"].dims))
    orders = {
        "omega": ("n", *batch, "component"),
        "n": ("n",),
        "status": batch,
        "failed_at": batch,
        "final": (*batch, "component"),
        "attitude": ("n", *batch, "space", "body"),
    }
    for name, order in orders.items():
        if name in dataset.variables:
            entries[name] = _in_order(dataset, name, order)
    for name in ("eps", *parameters_of(str(entries["body"])), "I3"):
        if name in dataset.variables:
            entries[name] = unvarying(dataset, name, batch)
    entries.update(_resume_entries(dataset, entries))
    return entries


def _in_order(dataset: xarray.Dataset, name: str, order: tuple[str, ...]) -> NDArray[Any]:
    variable = dataset[name]
    if set(variable.dims) != set(order):
        raise ValueError(
            f"dataset: expected {name} along {', '.join(order) or 'nothing'}, "
            f"got it along {', '.join(map(str, variable.dims)) or 'nothing'}"
        )
    values: NDArray[Any] = variable.transpose(*order).values
    return values


def unvarying(dataset: xarray.Dataset, name: str, batch: tuple[str, ...]) -> NDArray[Any]:
    """The inverse of `_varying`."""
    variable = dataset[name]
    own = tuple(dim for dim in variable.dims if dim == "component")
    along = [dim for dim in variable.dims if dim not in own]
    strangers = [str(dim) for dim in along if dim not in batch]
    if strangers:
        raise ValueError(f"dataset: expected {name} along the batch, got {', '.join(strangers)}")
    # A part of a batch may have lost axes.
    fewest = len(batch) - min((batch.index(str(dim)) for dim in along), default=len(batch))
    axes = min(max(int(variable.attrs.get("batch_axes", 0)), fewest), len(batch))
    names = batch[len(batch) - axes :]
    order = [dim for dim in names if dim in along]
    shape = [dataset.sizes[dim] if dim in along else 1 for dim in names]
    values: NDArray[Any] = variable.transpose(*order, *own).values
    return values.reshape((*shape, *(dataset.sizes[dim] for dim in own)))


def _resume_entries(dataset: xarray.Dataset, entries: Entries) -> Entries:
    resume = {
        str(name): np.asarray(dataset[name].values)
        for name in dataset.data_vars
        if str(name).startswith(RESUME)
    }
    last = entries.get("final", entries["omega"][-1:])
    if resume and int(dataset.attrs.get("resume_after", -1)) != _checksum_of(last):
        raise ValueError(
            "dataset: expected the last states that its resume variables belong to, got others, "
            f"as of a part of the batch; drop {', '.join(resume)} to use them, without going on"
        )
    return resume


def checksum(entries: Entries) -> int:
    """A number that changes when a bit of the entries does."""
    total = 0
    for name, array in sorted(entries.items()):
        plain = array.dtype.kind not in "iuf"
        data = str(array).encode() if plain else np.ascontiguousarray(array).data
        total = zlib.crc32(data, zlib.crc32(f"{name}{array.shape}".encode(), total))
    return total


def _checksum_of(array: NDArray[Any]) -> int:
    return zlib.crc32(np.ascontiguousarray(array).data)
