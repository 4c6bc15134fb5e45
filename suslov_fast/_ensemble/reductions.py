"""Quantities that are accumulated along time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._bodies.reduction import NotIntegrableError
from .._checks import FloatArray
from .._engine.arguments import Body
from .._states.conserved import energy, first_integral, modified_energy


class Reduction(NamedTuple):
    """One number, or one for each component, of each trajectory.

    Attributes
    ----------
    reduce
        Of the body, eps, states (rows, ..., D) and the states at step 0 (..., D).
    combine
        Of the values of two stretches of time, that of both.
    """

    meaning: str
    reduce: Callable[[Body, FloatArray, FloatArray, FloatArray], FloatArray]
    combine: Callable[[FloatArray, FloatArray], FloatArray]
    of_components: bool = False


def _drift(observable: Callable[[Body, FloatArray, FloatArray], FloatArray]) -> Any:
    def reduce(body: Body, eps: FloatArray, states: FloatArray, first: FloatArray) -> FloatArray:
        begin = observable(body, first, eps)
        with np.errstate(all="ignore"):
            # There is no relative change of 0.
            change = abs(observable(body, states, eps) / np.where(begin > 0, begin, np.nan) - 1.0)
        largest: FloatArray = np.fmax.reduce(change, axis=0)
        return largest

    return reduce


_CHANGE = "largest relative change of {} since the start"
REDUCTIONS = {
    "first_integral_drift": Reduction(_CHANGE.format("F"), _drift(first_integral), np.fmax),
    "modified_energy_drift": Reduction(
        _CHANGE.format("the modified energy"), _drift(modified_energy), np.fmax
    ),
    "energy_drift": Reduction(
        _CHANGE.format("the energy"), _drift(lambda body, omega, eps: energy(body, omega)), np.fmax
    ),
    "omega_min": Reduction(
        "least value of each component",
        lambda body, eps, states, first: np.fmin.reduce(states, axis=0),
        np.fmin,
        of_components=True,
    ),
    "omega_max": Reduction(
        "largest value of each component",
        lambda body, eps, states, first: np.fmax.reduce(states, axis=0),
        np.fmax,
        of_components=True,
    ),
}


def checked(body: Body, names: Any) -> tuple[str, ...]:
    """Return names of reductions in alphabetical order; refuse those that the body has not."""
    if names is None:
        return ()
    expected = f"names among {', '.join(REDUCTIONS)}"
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise TypeError(f"reductions: expected a list of {expected}, got {names!r}")
    if not names or any(name not in REDUCTIONS for name in names):
        raise ValueError(f"reductions: expected {expected}, got {names!r}")
    if "first_integral_drift" in names:
        try:
            first_integral(body, np.zeros(body.dimension), 1.0)
        except NotIntegrableError as error:
            raise NotIntegrableError(f"reductions: {error}") from error
    return tuple(sorted(set(names)))
