"""Kahan's map of any quadratic vector field."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .._bodies.field import QuadraticField
from .._checks import FloatArray
from .._engine.layout import flat_parameter, for_kernel
from .._engine.stepping import iterate_field
from .._kernels.elimination import WIDEST
from .registry import Kept, Map


def _parameters(
    body: QuadraticField, eps: float | FloatArray, batch: tuple[int, ...]
) -> tuple[Any, ...]:
    """Return the terms of the field, the step size, and the largest quadratic coefficient."""
    indices, values = body.terms
    quadratic = values[..., indices[2] < body.dimension]
    largest = np.abs(quadratic).max(axis=-1, initial=0.0)
    if body.shape:
        size, T = math.prod(batch), len(indices[0])
        some = np.minimum(np.arange(-(-size // WIDEST) * WIDEST), size - 1)
        values = for_kernel(np.broadcast_to(values, (*batch, T)).reshape(size, T)[some].T)
    return indices, values, flat_parameter(eps, batch), flat_parameter(largest, batch)


MAP = Map(
    name="quadratic",
    body=QuadraticField,
    title="Kahan map of a quadratic field",
    methods=("auto",),
    parameters=_parameters,
    run=iterate_field,
    kept=(Kept("state", ("flat", "component")),),
    # x' = x**2, whose map has a pole at 1 / eps.
    conserved=lambda body: () if body.H is None else ("energy", "modified_energy"),
    samples=((QuadraticField([[[1]]]), (1.0,)),),
    carries_attitude=False,
    variable="x",
    meaning="state",
)
