"""A record of each map of the package; lookup of maps by body and of bodies by name."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from . import checks
from .bodies.field import QuadraticField
from .bodies.nd import SuslovND, are_solved
from .bodies.rigid import Suslov3D, SuslovGyrostat
from .checks import FloatArray
from .core import steps_3d, steps_field, steps_nd
from .engine.arguments import States
from .engine.stretches import March, Steps


@dataclass(frozen=True)
class Map:
    """A map of the package."""

    body: type[Any]  # the class of its bodies
    title: str  # of datasets, for people
    methods: Mapping[str, Steps]  # by the values of the argument `method`, the default first
    functions: Callable[[Any], tuple[str, ...]]  # of the states of a run: names of its methods
    sample: tuple[Any, tuple[float, ...]]  # a body, and a state at a pole of eps = 1
    variable: str = "omega"  # the name of a state
    meaning: str = "angular velocity"

    def conserved(self, body: Any) -> str | None:
        """Return the name of a conserved, or nearly conserved, quantity; None without one."""
        known = self.functions(body)
        return next((name for name in ("first_integral", "modified_energy") if name in known), None)

    def symbols(self, body: Any) -> list[str]:
        r"""Return the labels of the components in LaTeX: "Omega1" is `$\Omega_{1}$`."""
        labels = (re.sub(r"(\D+)(.*)", r"$\1_{\2}$", label) for label in body._labels)
        return [label.replace("Omega", r"\Omega") for label in labels]


def _in_nd(body: SuslovND) -> tuple[str, ...]:
    solved = ("first_integral", "criticality") if are_solved(body).all() else ()
    return *solved, "energy", "modified_energy", "reaction"


_IN_3D = "first_integral", "energy", "modified_energy", "criticality", "reaction"
# Costs lie between those of usual steps and of steps by elimination with pivots, for Ctrl-C.
_IN_ND = Steps(steps_nd.steps, 0, lambda D, T: 16.0 * D + D**3 / 30.0, 32)

MAPS = (
    Map(  # equation (4) of the paper
        body=Suslov3D,
        title="Discrete Suslov problem",
        sample=(Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0)),
        methods={"auto": Steps(steps_3d.steps, steps_3d.CARRIED)},
        functions=lambda body: (*_IN_3D, "to_xy"),
    ),
    Map(  # equation (15)
        body=SuslovND,
        title="Discrete Suslov problem in n dimensions",
        sample=(SuslovND([1.0, 1.0, 2.0], [0.5, -0.75, 0.5]), (1.0, -1.0, 1.5)),
        methods={
            "auto": _IN_ND,
            "gauss": Steps(steps_nd.gauss_steps, 0, lambda D, T: D**3 / 3.0, 32),
            "rank2": _IN_ND,
        },
        functions=_in_nd,
    ),
    Map(
        body=SuslovGyrostat,
        title="Discrete Suslov gyrostat",
        sample=(SuslovGyrostat(1, 1, 1, 0, 0.5), (1.0, -3.875)),
        methods={"auto": Steps(steps_3d.steps, steps_3d.CARRIED, lambda D, T: 2.0)},
        functions=lambda body: _IN_3D,
    ),
    Map(
        body=QuadraticField,
        title="Kahan map of a quadratic field",
        sample=(QuadraticField([[[1]]]), (1.0,)),  # x' = x**2
        methods={"auto": Steps(steps_field.steps, 0, lambda D, T: 3.0 * (D**3 + T), 32)},
        functions=lambda body: () if body.H is None else ("energy", "modified_energy"),
        variable="x",
        meaning="state",
    ),
)
_KINDS: dict[str, Any] = {record.body.__name__: record.body for record in MAPS}


def map_of(body: Any) -> Map:
    """Return the map of a body, or of an object of a subclass."""
    for record in MAPS:
        if isinstance(body, record.body):
            return record
    raise checks.wrong("body", " or ".join(_KINDS), checks.kind_of(body), TypeError)


def body_from_dict(parameters: Mapping[str, Any]) -> Any:
    """Return the body that its method `to_dict` described, of any class.

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
    checks.instance("parameters", parameters, Mapping)
    return _KINDS[checks.one_of("body", parameters.get("body"), _KINDS)].from_dict(parameters)


def states_after(states: States, steps: int = 1) -> FloatArray:
    """Return the states (..., D) after a number of steps, NaN where there are none."""
    march = March(map_of(states.body).methods["auto"], states)
    march.to(steps)
    return march.final
