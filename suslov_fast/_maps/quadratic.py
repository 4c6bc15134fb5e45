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
from .record import Kept, Map


def _parameters(
    body: QuadraticField, eps: float | FloatArray, batch: tuple[int, ...]
) -> tuple[Any, ...]:
    """Return the terms of the field, the step size, and the largest quadratic coefficient."""
    indices, values = body.terms
    largest = np.abs(values[0]).max(axis=-1, initial=0.0)
    if body.shape:
        size = math.prod(batch)
        some = np.minimum(np.arange(-(-size // WIDEST) * WIDEST), size - 1)
        full = (np.broadcast_to(each, (*batch, each.shape[-1])) for each in values)
        values = tuple(for_kernel(each.reshape(size, each.shape[-1])[some].T) for each in full)
    return indices, values, (flat_parameter(eps, batch), flat_parameter(largest, batch))


MAP = Map(
    name="quadratic",
    body=QuadraticField,
    title="Kahan map of a quadratic field",
    methods=("auto",),
    parameters=_parameters,
    run=iterate_field,
    kept=(Kept("state", ("flat", "component")),),
    quantities=frozenset(("energy", "modified_energy")),
    # x' = x**2, whose map has a pole at 1 / eps.
    conserved=lambda body: () if body.H is None else ("energy", "modified_energy"),
    samples=((QuadraticField([[[1]]]), (1.0,)),),
    carries_attitude=False,
    variable="x",
    meaning="state",
)
