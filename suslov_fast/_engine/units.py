"""Bodies as kernels take them: flat parameters, units taken out."""

from __future__ import annotations

import numpy as np

from .._bodies.base import Body
from .._bodies.units import scaled_eps, units_of
from .._checks import FloatArray
from .layout import flat_parameter, flat_rows, for_kernel


def for_loops(body: Body, eps: float | FloatArray, batch: tuple[int, ...]) -> list[FloatArray]:
    """Return the parameters of the map and eps, units taken out, as `Problem.parameters`."""
    own: list[FloatArray] | None = None if body.shape else vars(body).get("_flat")
    if own is None:
        flat = flat_rows if body._own_axes else flat_parameter
        own = [flat(each, batch) for each in units_of(body).parameters]
        if not body.shape:  # the same for all batches
            vars(body)["_flat"] = own
    return [*own, flat_parameter(scaled_eps(body, eps), batch)]


def flat_of_one(body: Body) -> list[FloatArray]:
    """Return the parameters of a single body, in its own units, as 1-D arrays."""
    own: list[FloatArray] | None = vars(body).get("_own")
    if own is None:
        own = vars(body)["_own"] = [
            for_kernel(np.asarray(each, np.float64)).reshape(-1) for each in body.parameters
        ]
    return own
