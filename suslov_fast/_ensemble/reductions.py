"""What is kept along time instead of states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._bodies.reduction import NotIntegrableError
from .._checks import FloatArray
from .._engine.arguments import Body
from .._states.conserved import energy, first_integral, modified_energy

# States (rows, ..., D) and the first ones (..., D) to one number, or vector, a trajectory.
Reduce = Callable[[Body, FloatArray, FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Reduction:
    """One number, or vector, for each trajectory.

    Attributes
    ----------
    combine
        Makes one of that of two stretches of time; twice the same stretch changes nothing.
    """

    meaning: str
    of_components: bool
    reduce: Reduce
    combine: Callable[[FloatArray, FloatArray], FloatArray]


def _drift(observable: Callable[..., FloatArray]) -> Reduce:
    def reduce(body: Body, states: FloatArray, eps: FloatArray, first: FloatArray) -> FloatArray:
        begin = observable(body, first, eps)
        with np.errstate(all="ignore"):
            # Nothing can be said where it vanishes.
            change = abs(observable(body, states, eps) / np.where(begin > 0, begin, np.nan) - 1.0)
        largest: FloatArray = np.fmax.reduce(change, axis=0)
        return largest

    return reduce


def _energy(body: Body, states: FloatArray, eps: FloatArray) -> FloatArray:
    return energy(body, states)


def _smallest(body: Body, states: FloatArray, eps: FloatArray, first: FloatArray) -> FloatArray:
    smallest: FloatArray = np.fmin.reduce(states, axis=0)
    return smallest


def _largest(body: Body, states: FloatArray, eps: FloatArray, first: FloatArray) -> FloatArray:
    largest: FloatArray = np.fmax.reduce(states, axis=0)
    return largest


REDUCTIONS = {
    "first_integral_drift": Reduction(
        "largest relative change of F since the start", False, _drift(first_integral), np.fmax
    ),
    "modified_energy_drift": Reduction(
        "largest relative change of the modified energy since the start",
        False,
        _drift(modified_energy),
        np.fmax,
    ),
    "energy_drift": Reduction(
        "largest relative change of the energy since the start", False, _drift(_energy), np.fmax
    ),
    "omega_min": Reduction("least value of each component", True, _smallest, np.fmin),
    "omega_max": Reduction("largest value of each component", True, _largest, np.fmax),
}


def checked(body: Body, names: Any) -> tuple[str, ...]:
    """The names of reductions, in one order; those that the body does not have are refused."""
    if names is None:
        return ()
    expected = f"names among {', '.join(REDUCTIONS)}"
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise TypeError(f"reductions: expected a list of {expected}, got {names!r}")
    unknown = [name for name in names if name not in REDUCTIONS]
    if unknown or not names:
        raise ValueError(f"reductions: expected {expected}, got {names!r}")
    if "first_integral_drift" in names:
        try:
            first_integral(body, np.zeros(body.dimension), 1.0)
        except NotIntegrableError as error:
            raise NotIntegrableError(f"reductions: {error}") from error
    return tuple(sorted(set(names)))


def reduced(
    names: Sequence[str], body: Body, eps: FloatArray, states: FloatArray, first: FloatArray
) -> dict[str, FloatArray]:
    """Each reduction of some states."""
    return {name: REDUCTIONS[name].reduce(body, states, eps, first) for name in names}
