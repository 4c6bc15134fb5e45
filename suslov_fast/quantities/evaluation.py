"""Evaluation of functions of a state: checked arguments, universal functions, missing values.

To add a quantity, write its formula in `core.quantities`, as a universal function of the same
arguments as the others, and call `evaluate` with its name.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..bodies.nd import SuslovND, check_known
from ..checks import FloatArray, first_index, real_array, spell, warn, wrong
from ..core import quantities as formulas
from ..core import quantities_field as fields
from ..core.numba import Universal
from ..engine.arguments import BodyIn3D, States, check
from ..engine.status import SingularStepWarning

# Quantities of fields that have a Hamiltonian.
_HAMILTONIAN = "energy", "modified_energy", "invariant_density"


def evaluate(
    name: str,
    body: Any,
    kinds: Any,
    omega: Any,
    eps: Any = 0.0,
    *,
    otherwise: Callable[[States], FloatArray] | None = None,
    poles: bool = False,
) -> FloatArray:
    """Check the arguments of the public function `name`, and return its value.

    The formula has this name in `core.quantities`, with "_nd" in n dimensions. A body without one
    takes `otherwise`, or else the formula of this name in `core.quantities_field`, of the terms of
    its equations. With `poles`, infinite values are values, else missing ones.
    """
    states, formula = check(body, kinds, omega, eps, later=True), None
    if isinstance(body, BodyIn3D):
        formula = getattr(formulas, name)
    elif isinstance(body, SuslovND):
        check_known(body, name)
        formula = getattr(formulas, f"{name}_nd", None)
    elif name in _HAMILTONIAN and body.field().H is None:
        expected = "a field with a Hamiltonian, made by QuadraticField.from_hamiltonian"
        raise wrong("body", expected, "one without", TypeError)
    if formula is not None:
        found = formula(*body.parameters, states.eps, states.omega)
    elif otherwise is not None:
        found = otherwise(states)
    else:
        found = by_terms(getattr(fields, name), states, body.terms)
    return reported(states, found, poles)


def by_terms(formula: Universal, states: States, terms: Any, *after: FloatArray) -> FloatArray:
    """Return a quantity by a formula of terms, of the states and of the states `after` them.

    Formulas take the states of a single field along the last axis of the batch in one call.
    """
    body, omega, eps, batch, *_ = states
    arrays = [np.broadcast_to(each, (*batch, body.dimension)) for each in (omega, *after)]
    arrays.insert(0, np.broadcast_to(eps, batch))
    in_rows = bool(batch) and not body.shape
    if not in_rows:
        arrays = [np.expand_dims(each, len(batch)) for each in arrays]
    found: FloatArray = formula(*terms, *arrays)
    return found if in_rows else found.squeeze(axis=len(batch))


def reported(states: States, found: FloatArray, poles: bool = False) -> FloatArray:
    """Return a quantity, NaN where the state is NaN; a warning counts the other missing values.

    Formulas are not finite at states that are not, so that most results need no other test.
    """
    with np.errstate(all="ignore"):
        if math.isfinite(found.sum()):
            return found
    unknown = np.isnan(real_array(states.name, states.omega, allow_nan=True)).any(axis=-1)
    unknown = np.broadcast_to(unknown, states.batch)
    axes = tuple(range(len(states.batch), found.ndim))
    lost = np.isnan(found) if poles else ~np.isfinite(found)
    lost = lost.any(axis=axes) & ~unknown
    if lost.any():
        message = f"{np.count_nonzero(lost)} of {lost.size} states: singular step or out of range"
        warn(f"{message}, first: {spell(first_index(lost))}", SingularStepWarning)
    return np.where(np.expand_dims(unknown | lost, axes), np.nan, found)[()]
