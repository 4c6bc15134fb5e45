"""The record of a map, which clients read, and lookup of maps by name or by a body."""

from __future__ import annotations

import copyreg
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

from .._checks import instance, one_of
from .._docs import filled

if TYPE_CHECKING:
    from .._checks import FloatArray
    from .._engine.execution import Output, Problem, Resume, Span


class Kept(NamedTuple):
    """An array needed to resume a run, in addition to its states at step 0."""

    name: str
    # Its axes: "flat" (trajectories), "component", "space" (one more), or fixed lengths.
    dims: tuple[str | int, ...]
    dtype: str = "float64"
    attitude: bool = False  # only runs with an orientation have it


# Per-trajectory arrays that kernels write and resume from; files hold them as results.
STATUSES = Kept("status", ("flat",), "int8"), Kept("failed_at", ("flat",), "int64")


@dataclass(frozen=True)
class Map:
    """A map of the package."""

    name: str  # in files
    body: type[Any]  # the class of its bodies
    title: str  # of datasets, for people
    methods: tuple[str, ...]  # values of the argument `method`; the first is the default
    # The flat arrays for kernels, of (body, eps, batch).
    parameters: Callable[[Any, float | FloatArray, tuple[int, ...]], tuple[FloatArray, ...]]
    run: Callable[[Problem, Span, Resume, Output], object]  # fills the output of a run
    kept: tuple[Kept, ...]  # what is needed to resume a run, in addition to `STATUSES`
    # Bodies, each with a state, at a pole of eps = 1 if there is one: calls with them need all
    # kernels of the map.
    samples: tuple[tuple[Any, tuple[float, ...]], ...]
    # The functions of (body, omega, eps) whose drift the summary of a run of a body reports.
    conserved: Callable[[Any], tuple[str, ...]] = lambda body: ()
    carries_attitude: bool = True  # runs can include the orientation
    # The name of a state in `Trajectories`, datasets, files and stores, and what it means.
    variable: str = "omega"
    meaning: str = "angular velocity"
    components: Callable[[Any], tuple[str, ...]] = attrgetter("_labels")  # labels of components

    @property
    def resume(self) -> tuple[Kept, ...]:
        """All arrays needed to resume a run."""
        return *self.kept, *STATUSES

    def symbols(self, body: Any) -> list[str]:
        r"""Return the labels of the components in LaTeX: "Omega1" is `$\Omega_{1}$`."""
        labels = (re.fullmatch(r"(\D+)(.*)", label) for label in self.components(body))
        words = (("\\" * (len(found[1]) > 1) + found[1], found[2]) for found in labels if found)
        return [f"${word}_{{{index}}}$" for word, index in words]


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
    return list(dict.fromkeys(_BODIES.values()))


def map_names() -> list[str]:
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


@filled
def body_from_dict(parameters: Mapping[str, Any]) -> Any:
    """Return the body that its method `to_dict` described, of any class.

    Returns
    -------
    body
        A body or a field.

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
