"""Quantities accumulated over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._bodies.reduction import NotIntegrableError
from .._checks import FloatArray, wrong
from .._states.conserved import energy, first_integral, modified_energy


class Reduction(NamedTuple):
    """One number, or one for each component, of each trajectory."""

    meaning: str
    # Of the body, eps, states (rows, ..., D) and the states at step 0 (..., D).
    reduce: Callable[[Any, FloatArray, FloatArray, FloatArray], FloatArray]
    # Of the values of two ranges of steps, to the value of both together.
    combine: Callable[[FloatArray, FloatArray], FloatArray]
    of_components: bool = False


def _drift(meaning: str, observable: Callable[[Any, FloatArray, FloatArray], Any]) -> Reduction:
    def reduce(body: Any, eps: FloatArray, states: FloatArray, first: FloatArray) -> Any:
        begin = observable(body, first, eps)
        with np.errstate(all="ignore"):
            # There is no relative change of 0.
            change = abs(observable(body, states, eps) / np.where(begin > 0, begin, np.nan) - 1.0)
        return np.fmax.reduce(change, axis=0)

    return Reduction(f"largest relative change of {meaning} since the start", reduce, np.fmax)


def _extreme(meaning: str, extreme: Any) -> Reduction:
    def reduce(body: Any, eps: FloatArray, states: FloatArray, first: FloatArray) -> Any:
        return extreme.reduce(states, axis=0)

    return Reduction(f"{meaning} value of each component", reduce, extreme, of_components=True)


REDUCTIONS = {
    "first_integral_drift": _drift("F", first_integral),
    "modified_energy_drift": _drift("the modified energy", modified_energy),
    "energy_drift": _drift("the energy", lambda body, omega, eps: energy(body, omega)),
    "omega_min": _extreme("least", np.fmin),
    "omega_max": _extreme("largest", np.fmax),
}


def checked(body: Any, names: Any) -> tuple[str, ...]:
    """Return names of reductions in alphabetical order; raise an error if the body lacks one."""
    if names is None:
        return ()
    expected = f"names among {', '.join(REDUCTIONS)}"
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise wrong("reductions", f"a list of {expected}", repr(names), TypeError)
    if not names or any(name not in REDUCTIONS for name in names):
        raise wrong("reductions", expected, repr(names))
    for name in names:
        state = np.zeros(body.dimension)
        try:
            REDUCTIONS[name].reduce(body, np.asarray(1.0), state[np.newaxis], state)
        except (NotIntegrableError, TypeError) as error:
            raise type(error)(f"reductions: {name}: {error}") from error
    return tuple(sorted(set(names)))
