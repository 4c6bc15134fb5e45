"""Steps of all maps, also of higher order: kernels with their arguments and costs."""

from functools import partial
from typing import Any

from ..core.maps import kernel
from ..core.maps.stages import Stages
from ..core.suslov import map_nd as steps_nd, steps as steps_3d
from ..core.suslov.map_3d import BodySystem
from . import kernel_arguments as of
from .batch import StepMethod


def _cost_of_field(D: int, arguments: Any) -> float:
    """Return the time of a step without pivoting, relative to a step of the map in 3D."""
    step, stages = arguments[0]
    return len(stages.fractions) * (0.1 * step.length if step.usual else float(D**3))


# The map of bodies in three dimensions.
STEPS_3D = StepMethod(
    kernel=steps_3d.steps,
    arguments=of.by_constants,
    system=lambda body, eps: BodySystem(*(*body._constants, eps)),
    carried=steps_3d.CARRIED,
    cost=lambda D, arguments: 2.0 if arguments[4].any() else 1.0,  # a rotor doubles the cost
)
# Kahan's map of a field, or of the field of a body.
FIELD = StepMethod(
    kernel.field_steps, of.by_scheme, of.field_system, 1, _cost_of_field, 32, of.by_zeros, True
)
# A map of the user, x -> f(x).
OWN_MAP = FIELD._replace(arguments=of.by_map, system=of.map_system, divide=None, notes_poles=False)
STEPS_ND = StepMethod(  # bodies in n dimensions, in O(n) operations; few steps need elimination
    kernel=steps_nd.nd_steps,
    arguments=of.by_constants,
    system=of.nd_system,
    carried=1,
    cost=lambda D, arguments: 16.0 * D + D**3 / 30.0,
    lanes=32,
    notes_poles=True,
)
GAUSS = STEPS_ND._replace(  # the map of bodies in n dimensions, by elimination
    kernel=steps_nd.gauss_steps,
    cost=lambda D, arguments: D**3 / 3.0,
    system=lambda body, eps: steps_nd.GaussSystem(*of.nd_system(body, eps)),
)


# ---------------------------------------------------------------------- steps of order 4, 6 and 8
# Kahan's map is symmetric: its inverse is the map with -eps. So steps with fractions of eps have an
# even order together if the fractions read the same from both ends and their sum is 1. The
# fractions of order 4 are from M. Suzuki, Phys. Lett. A 146 (1990), with three equal fractions on
# each side; for orders 6 and 8 from M. Sofroniou and G. Spaletta, Optim. Methods Softw. 20 (2005).
# A list ends with the middle fraction.
_SUZUKI = 1 / (6 - 6 ** (1 / 3))
_TO_THE_MIDDLE = {
    4: [_SUZUKI, _SUZUKI, _SUZUKI, 1 - 6 * _SUZUKI],
    6: [
        0.13861930854051695246,
        0.13346562851074760407,
        0.13070531011449225191,
        0.12961893756907034773,
        -0.35000324893920896517,
        0.11805530653002387170,
        0.39907751534871587460,
    ],
    8: [
        0.10647728984550031824,
        0.10837408645835726397,
        0.35337821052654342420,
        -0.23341414023165082199,
        -0.24445266791528841270,
        0.11317848435755633315,
        0.11892905625000350063,
        0.12603912321825988140,
        0.12581718736176041804,
        0.11699135019217642181,
        -0.38263596012643665351,
    ],
}
COMPOSITIONS = {n: Stages((*first, *first[-2::-1])) for n, first in _TO_THE_MIDDLE.items()}


def field_in(stages: Stages) -> StepMethod:
    """Return the `StepMethod` of fields for steps with these stages."""
    return FIELD._replace(
        arguments=partial(of.by_scheme, stages=stages),
        system=partial(of.field_system, stages=stages),
        goes_back=min(stages.fractions) < 0.0,
    )
