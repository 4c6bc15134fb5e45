"""Records of maps: the class `Map`, all of its records, and the map for a body and a method."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

from numpy.typing import NDArray

from .. import checks
from ..bodies.fields.field import Field
from ..checks import FloatArray
from ..core.fields.stages import WHOLE, Stages
from ..engine.problem import Problem, check
from ..engine.stretches import Steps
from .formulas import Formula, Reduced, eigenvalues

Method = Literal["auto", "gauss", "order2", "order4", "order6", "order8"]


Eigenvalues = Callable[[Problem, FloatArray], NDArray[Any]]  # returns eigenvalues of f'

_HOW = ": pass a body, or a field such as Field(f, names)"
# What to use in place of a function that a map has not.
_INSTEAD = {
    "exact": "iterate or flow, because it has no closed form",
    "flow": "iterate, because it has no closed form",
    "limits": "iterate, because it has no closed form",
    "first_integral": "suslov_fast.integrability.report, which looks for integrals",
    "criticality": "run.status and run.first_pole, which tell of steps that are too long",
    "plot_phase": "iterate(...).plot() or flow(...).plot()",
}

# Quantities that are conserved, exactly or nearly: of a map the first one that it has.
_CONSERVED = "first_integral", "modified_energy", "energy"


@dataclass(frozen=True, eq=False)
class Map:
    """A map: one discretization of the equations of motion of a class of bodies or fields.

    Runs, files, stores, plots and functions of a state get everything that depends on the map from
    this record; a function that the record does not support raises an error. Several records may be
    for the same class: the argument `method` of runs and functions chooses one of them.

    Attributes
    ----------
    name : str
        The unique name, which files contain.
    title : str
        The name in plots and datasets.
    body : type
        The class of the bodies.
    methods : mapping of str to Steps
        Ways to compute the steps, by the values of the argument `method`, the default first.
    formulas : mapping of str to Formula
        How to compute the public functions that the map supports, by their names (see
        `maps/formulas.py`).
    stages : Stages
        Stages of a composition: a step consists of Kahan steps by these fractions of eps. WHOLE for
        Kahan's map itself.
    attitude : {"axial", "in_rows"} or None
        How states rotate a body: they are Omega1 and Omega2, or (Omega_1n, ..., Omega_n-1,n). None
        if they do not.
    plane : callable or None
        The reduction of a problem of `exact`, `flow` and `limits` to a solved one in three
        dimensions: returns that problem, and the function that maps its states back.
    eigenvalues : callable
        ``eigenvalues(problem, slopes)`` returns those of f', the `slopes` (..., D, D), at steady
        states, as an array (..., D), from which the `multipliers` follow.
    """

    name: str
    title: str
    body: type[Any]
    methods: Mapping[str, Steps]
    formulas: Mapping[str, Formula]
    stages: Stages = WHOLE
    attitude: Literal["axial", "in_rows"] | None = None
    plane: Callable[[Problem], Reduced] | None = None
    eigenvalues: Eigenvalues = eigenvalues

    def functions(self, body: Any) -> list[str]:
        """Return the names of the public functions that the map supports for a body."""
        found = []
        for name in self.formulas:
            with suppress(TypeError, ValueError):
                self.require(name, body)
                found.append(name)
        return found

    def require(self, name: str, body: Any) -> None:
        """Raise an error unless the map supports a public function for this body."""
        if name not in self.formulas:
            if self is not map_of(body):
                received = f"{', '.join(map(repr, self.methods))}: {self.title} has no {name}"
                if name == "modified_energy" and "energy" in self.functions(body):
                    received += ": use energy, which varies along orbits"
                raise checks.wrong("method", "'auto'", received, TypeError)
            having = dict.fromkeys(m.body for m in MAPS.values() if name in m.formulas)
            received, names = checks.kind_of(body), [kind.__name__ for kind in having]
            if isinstance(body, tuple(having)):
                received += f", whose map ({self.title}) has no {name}"
            else:
                received += f": use {how}" if (how := _INSTEAD.get(name)) else ""
            raise checks.wrong(
                "system", checks.either(names or ["another one"]), received, TypeError
            )
        if check := self.formulas[name].check:
            check(body)

    def conserves(self, body: Any) -> str | None:
        """Return the name of a conserved, or nearly conserved, quantity; None without one."""
        known = self.functions(body)
        return next((name for name in _CONSERVED if name in known), None)

    def __reduce__(self) -> Any:
        return named, (self.name,)


# ------------------------------------------------------------------------------------------ records
MAPS: dict[str, Map] = {}  # by name


# ------------------------------------------------------------------------------------------- lookup
def map_of(body: Any, method: str = "auto") -> Map:
    """Return the map of a method for a body."""
    by_method = methods_of(type(body))
    if type(method) is str and method in by_method:
        if isinstance(body, Field):
            _ = body._terms  # raises for a field that is not of degree 2
        return by_method[method]
    if not by_method:
        kinds = [record.body.__name__ for record in MAPS.values()]
        received = checks.kind_of(body) + _HOW
        raise checks.wrong("system", checks.either([*dict.fromkeys(kinds)]), received, TypeError)
    if f"order{method}" in by_method:
        checks.one_of("method", method, by_method, f": pass 'order{method}'")
    instead = ": Kahan's map, of order 2, is 'auto'; flow(system, x0, time=T) has a tolerance"
    if str(method).startswith("order") and method != "order2":
        of_fields = ", ".join(repr(name) for name in methods_of(Field) if name != "auto")
        instead = f": body.field() has the methods {of_fields}"
        instead *= "order8" not in by_method
    return by_method[checks.one_of("method", method, by_method, instead)]


def methods_of(kind: Any) -> dict[str, Map]:
    """Return the maps of a class of bodies by the names of their methods."""
    return _methods_of(kind)


@lru_cache(maxsize=64)  # for speed in small calls
def _methods_of(kind: Any) -> dict[str, Map]:
    records = [record for record in MAPS.values() if issubclass(kind, record.body)]
    return {method: record for record in records for method in record.methods}


def named(name: str) -> Map:
    """Return the map with this name, which files and pickles contain."""
    if name not in MAPS:
        raise ValueError(f"there is no map {name!r}, only {', '.join(map(repr, MAPS))}")
    return MAPS[name]


def problem(
    function: str,
    body: Any,
    omega: Any,
    eps: Any = 0.0,
    threads: int | None = None,
    method: str = "auto",
    **options: Any,
) -> Problem:
    """Return the checked problem of a public function, if the map supports the function.

    Options are those of `engine.problem.check`.
    """
    map = map_of(body, method)
    map.require(function, body)
    return check(map, body, omega, eps, threads, method=method, **options)
