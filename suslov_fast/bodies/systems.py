"""Classes of systems: unions for type hints, and classes by the name that files contain."""

from collections.abc import Callable, Mapping
from typing import Any, get_args

from ..checks import short
from ..fields.field import Field
from ..fields.map import Map
from .n_dimensions import SuslovND
from .rigid import Suslov3D

AnyBody = Suslov3D | SuslovND
BodyOrField = AnyBody | Field
MapOrField = BodyOrField | Map  # the systems that `iterate` accepts
System = MapOrField | Callable[..., Any]  # a function of the state may replace a field

_NAMED: dict[Any, type[Any]] = {kind.__name__: kind for kind in get_args(MapOrField)}


def class_named(name: Any) -> type[Any]:
    """Return the class of bodies with this name."""
    if not isinstance(name, str) or name not in _NAMED:
        raise ValueError(f"body: there is no class {short(name)}, only {', '.join(_NAMED)}")
    return _NAMED[name]


def body_from_dict(parameters: Mapping[str, Any]) -> MapOrField:
    """Return the body or field that a dictionary from `to_dict` describes."""
    return class_named(parameters["body"]).from_dict(parameters)
