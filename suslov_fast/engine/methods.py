"""Steps of the kernels of the package, with what each costs."""

from typing import Any

from ..core import steps_3d, steps_field, steps_nd
from .arguments import by_constants, by_plan, by_zeros, field_system, nd_system
from .stretches import Steps


def _cost_of_field(D: int, arguments: Any) -> float:
    """Return the time of a step by `elimination.solve`, which may be that of all lanes."""
    operations, _ = arguments[1]
    return D**3 + 2.5 * len(operations)


def _cost_in_nd(D: int, arguments: Any) -> float:
    """Return a time between those of usual steps and of steps by elimination, for Ctrl-C."""
    return 16.0 * D + D**3 / 30.0


STEPS_3D = Steps(steps_3d.steps, by_constants, steps_3d.CARRIED, system=field_system)
STEPS_WITH_ROTOR = STEPS_3D._replace(cost=lambda D, arguments: 2.0)
# Kahan's map of the field of any body.
FIELD = Steps(steps_field.field_steps, by_plan, 0, _cost_of_field, 32, field_system, by_zeros)
STEPS_ND = Steps(steps_nd.nd_steps, by_constants, 0, _cost_in_nd, 32, nd_system)
GAUSS = Steps(steps_nd.gauss_steps, by_constants, 0, lambda D, arguments: D**3 / 3.0, 32)
