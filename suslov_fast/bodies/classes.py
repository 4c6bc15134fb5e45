"""Classes of bodies: their unions for types, and the class that a file names."""

from collections.abc import Mapping
from typing import Any

from ..checks import instance
from .base import Body
from .field import QuadraticField
from .nd import SuslovND
from .rigid import Suslov3D, SuslovGyrostat

AnyBody = Suslov3D | SuslovND | SuslovGyrostat
BodyIn3D = Suslov3D | SuslovGyrostat  # whose states are (Omega1, Omega2)
BodyOrField = AnyBody | QuadraticField


def class_named(name: Any) -> type[Any]:
    """Return the class of bodies of a name, as files hold it; those of the package come first."""
    classes: list[Any] = [Suslov3D, SuslovND, SuslovGyrostat, QuadraticField, Body]
    for each in classes:
        classes.extend(each.__subclasses__())
    kinds: dict[Any, type[Any]] = {}
    for each in classes:
        if each is not Body and not each.__name__.startswith("_"):
            kinds.setdefault(each.__name__, each)
    if name not in kinds:
        how = "import the module that defines it"
        raise ValueError(f"body: there is no class {name!r}, only {', '.join(kinds)}: {how}")
    return kinds[name]


def body_from_dict(parameters: Mapping[str, Any]) -> Any:
    """Return the body, of any class, that a dictionary from `to_dict` describes.

    Parameters
    ----------
    parameters : mapping
        What `to_dict` returned.

    Returns
    -------
    Suslov3D, SuslovND, SuslovGyrostat or QuadraticField

    Examples
    --------
    >>> from suslov_fast import SuslovND, body_from_dict
    >>> body_from_dict(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]).to_dict())
    SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
    """
    instance("parameters", parameters, Mapping)
    return class_named(parameters.get("body")).from_dict(parameters)
