"""Quantities accumulated over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .._bodies.body_nd import NotIntegrableError
from .._checks import FloatArray, wrong
from .._maps import Map, map_of
from .._states.conserved import energy, first_integral, modified_energy


class Reduction(NamedTuple):
    """One number, or one for each component, of each trajectory."""

    meaning: str
    # Of the body, eps, states (rows, ..., D) and the states at step 0 (..., D).
    reduce: Callable[[Any, FloatArray, FloatArray, FloatArray], FloatArray]
    combine: Callable[[FloatArray, FloatArray], FloatArray]  # of the values of two ranges of steps
    of_components: bool = False


def _drift(meaning: str, observable: Callable[[Any, FloatArray, FloatArray], Any]) -> Reduction:
    def reduce(body: Any, eps: FloatArray, states: FloatArray, first: FloatArray) -> Any:
        with np.errstate(all="ignore"):
            change = abs(observable(body, states, eps) / observable(body, first, eps) - 1.0)
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
}


def reductions_of(map: Map) -> dict[str, Reduction]:
    """Return the reductions for runs of a map, by name."""
    name = map.variable
    extremes = {
        f"{name}_min": _extreme("least", np.fmin),
        f"{name}_max": _extreme("largest", np.fmax),
    }
    return {**REDUCTIONS, **extremes}


def checked(body: Any, names: Any) -> tuple[str, ...]:
    """Return names of reductions in alphabetical order; raise an error if the body lacks one."""
    if names is None:
        return ()
    known = reductions_of(map_of(body))
    expected = f"names among {', '.join(known)}"
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise wrong("reductions", f"a list of {expected}", repr(names), TypeError)
    if not names or any(name not in known for name in names):
        raise wrong("reductions", expected, repr(names))
    for name in names:
        state = np.zeros(body.dimension)
        try:
            known[name].reduce(body, np.asarray(1.0), state[np.newaxis], state)
        except (NotIntegrableError, TypeError) as error:
            raise type(error)(f"reductions: {name}: {error}") from error
    return tuple(sorted(set(names)))
