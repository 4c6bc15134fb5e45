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
    """The extreme over time of a number, or of one for each component, of each trajectory."""

    meaning: str
    # Of the body, eps, states (rows, ..., D) and the states at step 0 (..., D).
    values: Callable[[Any, FloatArray, FloatArray, FloatArray], FloatArray]
    extreme: np.ufunc
    of_components: bool = False

    def reduce(self, *arguments: Any) -> Any:
        return self.extreme.reduce(self.values(*arguments), axis=0)


def _drift(meaning: str, observable: Callable[[Any, FloatArray, FloatArray], Any]) -> Reduction:
    def change(body: Any, eps: FloatArray, states: FloatArray, first: FloatArray) -> Any:
        with np.errstate(all="ignore"):
            return abs(observable(body, states, eps) / observable(body, first, eps) - 1.0)

    return Reduction(f"largest relative change of {meaning} since the start", change, np.fmax)


REDUCTIONS = {
    "first_integral_drift": _drift("F", first_integral),
    "modified_energy_drift": _drift("the modified energy", modified_energy),
    "energy_drift": _drift("the energy", lambda body, omega, eps: energy(body, omega)),
}


def reductions_of(map: Map) -> dict[str, Reduction]:
    """Return the reductions for runs of a map, by name."""
    extremes = {
        f"{map.variable}_{short}": Reduction(
            f"{meaning} value of each component",
            lambda body, eps, states, first: states,
            extreme,
            of_components=True,
        )
        for short, meaning, extreme in (("min", "least", np.fmin), ("max", "largest", np.fmax))
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
