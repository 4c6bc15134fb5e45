"""Records of maps: their class `Discretization`, and the map for a system and a method."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..checks import FloatArray
from ..core.maps.stages import WHOLE, Stages
from ..fields.field import Field
from ..fields.map import Map
from .batch import StepMethod
from .evaluation import Formula
from .formulas import KAHAN, eigenvalues
from .orders import COMPOSITIONS, FIELD, OWN_MAP, field_in
from .problem import Problem

Method = Literal["auto", "gauss", "order2", "order4", "order6", "order8"]
_HOW = ": to iterate a function x -> f(x) pass Map(f, names), for x' = f(x) Field(f, names)"


@dataclass(frozen=True, eq=False)
class Discretization:
    """The record of a map: a discretization of the motion of a class of systems, or a `Map`.

    A class may have several maps: the argument `method` of public functions chooses one of them.
    """

    name: str  # a unique name, which files contain
    title: str  # title in plots and datasets
    body: type[Any]  # the class of the bodies
    methods: Mapping[str, StepMethod]  # methods by the argument `method`; the default is first
    # The functions of `kahan`, and the methods of the class that accept a state, by their names.
    formulas: Mapping[str, Formula]
    stages: Stages = WHOLE  # a step consists of steps of Kahan's map by these fractions of eps
    # How a state gives an angular velocity: "axial" as (Omega1, Omega2), "in_rows" as (Omega_1n,
    # ..., Omega_n-1,n), None if the state is not an angular velocity.
    attitude: Literal["axial", "in_rows"] | None = None
    # eigenvalues(problem, slopes) returns the eigenvalues (..., D) of f', `slopes` (..., D, D), at
    # steady states; the `multipliers` follow from them.
    eigenvalues: Callable[[Problem, FloatArray], NDArray[Any]] = eigenvalues

    def __reduce__(self) -> Any:
        return named, (self.name,)


_METHODS = {"auto": FIELD, "order2": FIELD}
_KAHAN = Discretization("Kahan", "Kahan map of a quadratic field", Field, _METHODS, KAHAN)
_COMPOSED = (
    replace(
        _KAHAN,
        name=f"Kahan, order {order}",
        title=f"Composition of Kahan maps, order {order}",
        methods={f"order{order}": field_in(stages)},
        stages=stages,
    )
    for order, stages in COMPOSITIONS.items()
)
_OWN = Discretization("Map", "Map", Map, {"auto": OWN_MAP}, {})
# All maps, by their names. Modules of `bodies` add the maps of bodies.
MAPS: dict[str, Discretization] = {each.name: each for each in (_KAHAN, *_COMPOSED, _OWN)}


def map_of(body: Any, method: str = "auto") -> Discretization:
    """Return the map of a body or field that has the argument `method`, or raise an error."""
    kind: Any = type(body)
    by_method = methods_of(kind)
    if type(method) is str and method in by_method:
        if isinstance(body, Field):
            _ = body._terms  # raises for a field that is not of degree 2
        return by_method[method]
    if not by_method:
        kinds = [record.body.__name__ for record in MAPS.values()]
        received = checks.kind_of(body) + _HOW
        raise checks.wrong("system", checks.either([*dict.fromkeys(kinds)]), received, TypeError)
    instead = ": Kahan's map, of order 2, is 'auto'; flow(field.conserving(), x0, time=T) has a "
    instead += "tolerance, and keeps the energy"
    return by_method[checks.one_of("method", method, by_method, instead)]


def eps_and_steps(name: str, system: Any, eps: Any, steps: Any) -> tuple[Any, int]:
    """Return eps and steps of a call of `name`; for a `Map` eps is 1, and steps may be first."""
    if isinstance(system, Map) and steps is None and isinstance(eps, (int, np.integer)):
        eps, steps = None, eps
    eps = eps_of(name, system, eps, "x0, steps=N")
    if steps is None:
        call = "map, x0, steps=N" if isinstance(system, Map) else "system, x0, eps, steps"
        raise TypeError(f"{name}: pass the number of steps, {name}({call})")
    return eps, steps


def eps_of(name: str, system: Any, eps: Any, others: str = "x") -> Any:
    """Check and return eps, 1.0 for a `Map`; an error shows its call, ``name(map, others)``."""
    if isinstance(system, Map):
        if eps is not None:
            raise TypeError(f"{name}: a Map has no step size eps: call {name}(map, {others})")
        return 1.0
    if eps is None:
        raise TypeError(f"{name}: pass eps, the step size of Kahan's map of this system")
    return eps


@lru_cache(maxsize=64)  # for speed in small calls
def methods_of(kind: Any) -> dict[str, Discretization]:
    """Return the maps of a class of bodies by the values of the argument `method`."""
    records = [record for record in MAPS.values() if issubclass(kind, record.body)]
    return {method: record for record in records for method in record.methods}


def named(name: str) -> Discretization:
    """Return the map with this name, which files and pickles contain."""
    if name not in MAPS:
        raise ValueError(f"there is no map {name!r}, only {', '.join(map(repr, MAPS))}")
    return MAPS[name]
