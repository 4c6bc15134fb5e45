"""Table of all quantities of states: the evaluation for each class of bodies."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any

from numpy.typing import ArrayLike

from .._bodies.base import Body
from .._bodies.body_3d import Suslov3D, SuslovGyrostat
from .._bodies.body_nd import SuslovND
from .._bodies.field import QuadraticField
from .._checks import FloatArray
from .._docs import F, filled
from .._engine.arguments import States, check
from .._engine.evaluation import of_state
from .._kernels import quantities_3d as kernels
from . import of_fields, of_nd
from .of_fixed_points import of_rigid_body

Evaluation = Callable[[States], FloatArray]

# Of both bodies in three dimensions.
_WITH_ROTOR: dict[str, Evaluation] = {
    "energy": partial(of_state, kernels.energy, ()),
    "first_integral": partial(of_state, kernels.first_integral, ()),
    "modified_energy": partial(of_state, kernels.modified_energy, ()),
    "criticality": partial(of_state, kernels.criticality, ()),
    "rotation_number": partial(of_state, kernels.rotation_number, ()),
    "invariant_density": partial(of_state, kernels.invariant_density, ()),
    "vector_field": partial(of_state, kernels.vector_field, (2,)),
    "reaction": partial(of_state, kernels.reaction, ()),
    "discrete_reaction": partial(of_state, kernels.discrete_reaction, ()),
    "jacobian": partial(of_state, kernels.jacobian, (2, 2)),
    "matrix": partial(of_state, kernels.matrix, (2, 2)),
    "multipliers": of_rigid_body,
}
TABLE: dict[type[Any], dict[str, Evaluation]] = {
    Suslov3D: {
        **_WITH_ROTOR,
        "to_xy": partial(of_state, kernels.to_xy, (2,)),
        "from_xy": partial(of_state, kernels.from_xy, (2,)),
        "closed_form": partial(of_state, kernels.constants, (4,)),
    },
    SuslovND: of_nd.QUANTITIES,
    SuslovGyrostat: _WITH_ROTOR,
    QuadraticField: of_fields.QUANTITIES,
}


@cache
def kinds_with(quantity: str) -> tuple[type[Any], ...]:
    """Return the classes of bodies that have a quantity."""
    return tuple(kind for kind, quantities in TABLE.items() if quantity in quantities)


def described(function: F, quantity: str = "") -> F:
    """Fill in a docstring; the bodies are those that have the quantity, by default of its name."""
    *others, last = (kind.__name__ for kind in kinds_with(quantity or function.__name__))
    kinds = f"{', '.join(others)} or {last}" if others else last
    return filled(function, body=f"body : {kinds}\n    A single one, or a batch.")


def with_table(body: Any) -> Any:
    """Return the body, or its field, if it has one, for a class that is not in the table."""
    is_other = isinstance(body, Body) and not isinstance(body, tuple(TABLE))
    return body.field() if is_other and type(body).field is not Body.field else body


def evaluation_of(quantity: str, body: Any) -> Evaluation:
    """Return the evaluation of a quantity that a body has."""
    return next(TABLE[kind][quantity] for kind in kinds_with(quantity) if isinstance(body, kind))


def evaluate(
    quantity: str, body: Any, arguments: dict[str, ArrayLike], threads: int | None
) -> FloatArray:
    """Check the arguments of a public function, as `check`, and evaluate a quantity."""
    components = ("x", "y") if "xy" in arguments else getattr(body, "_labels", None)
    body = with_table(body)
    states = check(body, kinds_with(quantity), arguments, threads, components, later=True)
    return evaluation_of(quantity, body)(states)
