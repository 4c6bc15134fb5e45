"""Lookup of a map by its name or by a body."""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from typing import Any

from .._checks import instance, one_of
from .record import Map

# The class of the bodies of each map; maps are imported on first use. The first map of a class is
# that of `iterate`.
_BODIES = {
    "suslov3d": "Suslov3D",
    "suslov_nd": "SuslovND",
    "suslov3d_full": "Suslov3D",
    "suslov_gyrostat": "SuslovGyrostat",
    "quadratic": "QuadraticField",
}


def body_names() -> list[str]:
    """Return the names of the classes of bodies that have a map."""
    return list(dict.fromkeys(_BODIES.values()))


def map_names() -> list[str]:
    """Return the names of all maps."""
    return list(_BODIES)


@cache
def map_named(name: str) -> Map:
    """Return the map of a name; ValueError if there is none."""
    if name not in _BODIES:
        raise ValueError(f"map: expected {' or '.join(_BODIES)}, got {name!r}")
    record: Map = import_module(f".{name}", __package__).MAP
    return record


# A record is pickled by its name, since it may hold functions that cannot be pickled.
copyreg.pickle(Map, lambda record: (map_named, (record.name,)))


@cache
def _map_of_class(kind: type[Any]) -> Map:
    for base in kind.__mro__:
        for name, body in _BODIES.items():
            if body == base.__name__ and (record := map_named(name)).body is base:
                return record
    raise TypeError(f"body: expected {' or '.join(body_names())}, got {kind.__name__}")


def body_from_dict(parameters: Mapping[str, Any]) -> Any:
    """Return the body that its method `to_dict` described, of any class.

    Parameters
    ----------
    parameters : mapping
        Numbers and nested lists by name, and, as "body", the name of the class.

    Returns
    -------
    body
        A body or a field.

    Raises
    ------
    TypeError, ValueError
        If it does not describe a body.

    Examples
    --------
    >>> from suslov_fast import SuslovND, body_from_dict
    >>> body_from_dict(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]).to_dict())
    SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
    """
    instance("parameters", parameters, Mapping)
    kind = one_of("body", parameters.get("body"), body_names())
    record = map_named(next(name for name, body in _BODIES.items() if body == kind))
    return record.body.from_dict(parameters)


def map_of(body: Any) -> Map:
    """Return the map of a body, or of an object of a subclass: that of `iterate`."""
    return _map_of_class(body.__class__)
