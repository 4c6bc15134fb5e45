"""The way of a function of a state from its arguments to a universal function and its result.

To add one, write its formula in `core.quantities`, as a universal function of the arguments that
all have, and call `evaluate` with it. A field has functions of `States` in place of formulas, most
of them `by_terms`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..bodies.field import QuadraticField
from ..bodies.nd import SuslovND
from ..bodies.rigid import Suslov3D, SuslovGyrostat
from ..checks import FloatArray, first_index, real_array, spell, warn
from ..core.universal import Universal
from ..engine.arguments import States, check
from ..engine.status import SingularStepWarning

OfState = Universal | Callable[[States], FloatArray]


def evaluate(
    body: Any,
    arguments: dict[str, Any],
    in_3d: OfState,
    in_nd: OfState | None = None,
    of_field: OfState | None = None,
    *,
    axes: int = 0,
    poles: bool = False,
) -> FloatArray:
    """Check the arguments of a public function, and return the quantity, which has `axes` axes.

    A body may be of n dimensions if there is `in_nd`, or a field if there is `of_field`. With
    `poles`, infinite values have a meaning.
    """
    kinds: tuple[Any, ...] = (Suslov3D, SuslovGyrostat)
    kinds += (SuslovND,) * bool(in_nd) + (QuadraticField,) * bool(of_field)
    states, quantity = check(body, kinds, arguments, later=True), in_3d
    if isinstance(body, SuslovND):
        quantity = in_nd or in_3d
    elif isinstance(body, QuadraticField):
        quantity = of_field or in_3d
    if isinstance(quantity, Universal):
        found = quantity(*body.parameters, states.eps, states.omega)
    else:
        found = quantity(states)
    return reported(states, found, axes, poles)


def terms_of(body: Any) -> tuple[Any, FloatArray]:
    """Return the terms v x_j x_k, j <= k, of the equations i: places (3, T) and values (..., T)."""
    if not isinstance(body, SuslovND):
        terms: tuple[Any, FloatArray] = body.field().terms
        return terms
    i, j = np.nonzero(~np.eye(body.dimension, dtype=bool))  # faster than its exact field
    J, I = np.broadcast_arrays(body.J, body.I)
    places = np.array([[*i, *i], [*np.minimum(i, j), *j], [*np.maximum(i, j), *j]], np.int64)
    values = np.concatenate([I[..., j] / J[..., i], -I[..., i] / J[..., i]], axis=-1)
    return places, values


def by_terms(
    formula: Universal, states: States, *after: FloatArray, terms: Any = None
) -> FloatArray:
    """Return a quantity by a formula of terms, by default of the equations, and of more states.

    Formulas take the states of a single field in rows, which are the last axis of the batch.
    """
    body, omega, eps, batch, *_ = states
    arrays = [np.broadcast_to(each, (*batch, body.dimension)) for each in (omega, *after)]
    arrays.insert(0, np.broadcast_to(eps, batch))
    one_by_one = bool(body.shape) or not batch
    if one_by_one:
        arrays = [np.expand_dims(each, len(batch)) for each in arrays]
    found: FloatArray = formula(*(terms or terms_of(body)), *arrays)
    return found.reshape(batch + found.shape[len(batch) + 1 :]) if one_by_one else found


def reported(states: States, found: FloatArray, axes: int, poles: bool = False) -> FloatArray:
    """Return a quantity, NaN where the state is NaN; a warning counts the other missing values.

    Formulas are not finite at states that are not, so that most results need no other test.
    """
    with np.errstate(all="ignore"):
        if math.isfinite(found.sum()):
            return found
    unknown = np.isnan(real_array(states.name, states.omega, allow_nan=True)).any(axis=-1)
    unknown = np.broadcast_to(unknown, states.batch)
    lost = np.isnan(found) if poles else ~np.isfinite(found)
    lost = lost.any(axis=tuple(range(-axes, 0))) & ~unknown
    if lost.any():
        where = spell(first_index(lost))
        message = f"{np.count_nonzero(lost)} of {lost.size} states: singular step or out of range"
        warn(f"{message}, first: {where}", SingularStepWarning)
    missing = np.reshape(unknown | lost, (*states.batch, *(1,) * axes))
    return np.where(missing, np.nan, found)[()]
