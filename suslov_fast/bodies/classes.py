"""Classes of bodies: unions for type hints, and classes by the name that files contain."""

from collections.abc import Callable, Mapping
from typing import Any, get_args

from ..checks import instance, short, wrong
from ..keywords import public
from .fields.field import Field
from .nd import SuslovND
from .rigid import Suslov3D, SuslovGyrostat

AnyBody = Suslov3D | SuslovND | SuslovGyrostat
BodyIn3D = Suslov3D | SuslovGyrostat  # whose states are (Omega1, Omega2)
BodyOrField = AnyBody | Field
System = BodyOrField | Callable[..., Any]  # with functions of the state in place of fields

_NAMED: dict[Any, type[Any]] = {kind.__name__: kind for kind in get_args(BodyOrField)}


def class_named(name: Any) -> type[Any]:
    """Return the class of bodies with this name."""
    if not isinstance(name, str) or name not in _NAMED:
        raise ValueError(f"body: there is no class {short(name)}, only {', '.join(_NAMED)}")
    return _NAMED[name]


@public
def body_from_dict(parameters: Mapping[str, Any]) -> BodyOrField:
    """Return the body or field that a dictionary from `to_dict` describes.

    Parameters
    ----------
    parameters : mapping
        The dictionary that `to_dict` returned, also if it was saved as JSON and read again.

    Returns
    -------
    Field, Suslov3D, SuslovGyrostat or SuslovND
        The class that the entry ``"body"`` names.

    Raises
    ------
    ValueError
        If there is no such class, or the other entries are not its parameters.

    Examples
    --------
    >>> import json
    >>> from suslov_fast import SuslovND, body_from_dict
    >>> text = json.dumps(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]).to_dict())
    >>> body_from_dict(json.loads(text))
    SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
    """
    instance("parameters", parameters, Mapping)
    if "body" not in parameters:
        raise wrong("parameters", "have an entry 'body', the name of the class", [*parameters])
    return class_named(parameters["body"]).from_dict(parameters)
