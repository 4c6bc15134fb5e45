"""Arguments of kernels: one row for all trajectories, or a row for each."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls import ALL, flat_parameter
from ..checks import FloatArray, wrong
from ..core.maps.kernel import scheme_of
from ..core.maps.stages import WHOLE, Scheme, Stages
from ..core.maps.step_system import FieldSystem, map_system_of, system_of
from ..core.maps.tolerances import LONGEST_MAP
from ..core.suslov.map_nd import FAR_FROM_0, NDSystem
from ..fields import terms

Arguments = tuple[NDArray[Any], ...]


def by_constants(body: Any, eps: float | FloatArray, batch: tuple[int, ...]) -> Arguments:
    """Return the kernel arguments of bodies: their constants, and eps last."""
    if not body.shape:
        return *body._batch_of_one, flat_parameter(eps, batch)
    axes = max(body._axes.get(name, 0) for name in body._arrays)  # the most axes of any constant
    constants = [flat_parameter(value, batch, axes) for value in body._constants]
    return *constants, flat_parameter(eps, batch)


def by_scheme(body: Any, eps: Any, batch: tuple[int, ...], stages: Stages = WHOLE) -> Any:
    """Return the kernel arguments of fields: a `Scheme`, values of terms, and eps."""
    indices, values = body._terms
    # For a single field the one row is made without `flat_parameter`, for speed in small calls.
    rows = flat_parameter(values, batch, 1) if body.shape else values[np.newaxis]
    return scheme_of(indices, body._layout.D, stages), rows, flat_parameter(eps, batch)


def by_zeros(arguments: Any) -> Iterator[tuple[Any, Any]]:
    """Group trajectories by which coefficients are 0; yield the indices and arguments of a group.

    The operations of a step, and so its rounding errors, depend on which terms are 0. Without
    groups, the bits of a trajectory would depend on the fields of other trajectories.
    """
    (step, stages), values, eps = arguments
    if len(values) == 1 or (nonzero := values != 0.0).all():
        yield ALL, arguments
        return
    for pattern, where in terms.by_zeros(nonzero):
        scheme = scheme_of(np.ascontiguousarray(step.indices[:, pattern]), step.D, stages)
        of_group = np.ascontiguousarray(values[where][:, pattern])
        yield where, (scheme, of_group, eps[where] if len(eps) > 1 else eps)


def by_map(body: Any, eps: Any, batch: tuple[int, ...]) -> Any:
    """Return the kernel arguments of a `Map`: a `Scheme`, its parameters, and 2 in place of eps."""
    rows = body._rows if body.shape else body._rows[np.newaxis]
    return Scheme(body._operations, WHOLE), flat_parameter(rows, batch, 1), np.array([2.0])


def map_system(body: Any, _: float) -> FieldSystem:
    """Return the code and the parameters of a single map, for `compiled`."""
    if not body._operations.usual:
        raise wrong("system", f"a map of at most {LONGEST_MAP:,} operations", body._called)
    return map_system_of(body._operations, body._rows)


def nd_system(body: Any, eps: float) -> NDSystem:
    """Return the constants of a single body in n dimensions, for `compiled`."""
    # If eps I.x / 2 < `near`, no divisor J_i - eps I.x / 2 is near 0, and a step looks for none.
    near = (1.0 - FAR_FROM_0) * float(np.min(body.J))
    return NDSystem(np.array(body.J), np.array(body.I), eps, near, body.dimension)


def field_system(body: Any, eps: float, stages: Stages = WHOLE) -> FieldSystem:
    """Return the constants of a single field, for `compiled`."""
    indices, values = body._terms
    halves = np.outer(stages.fractions, 0.5 * eps * values)
    return system_of(indices, halves, body._layout.D)
