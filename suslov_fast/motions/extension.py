"""Motions with more components than a state: columns of derivatives, modes, tangent vectors.

The further components follow those of the state. They have starts and absolute tolerances of their
own, and share the error estimate of a step. Results are divided into states and the others.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..checks import FloatArray
from ..core.flow.batch_solver import Settings, SolverRequest
from ..fields.right_hand_sides import OfMembers
from .integration import SolverResult, to_tolerance


class Extension(NamedTuple):
    """A motion from states x (B, D) with E further components.

    groups   right-hand sides of all D + E components, by members of a field of the shape `shape`
    starts   (B, D + E), the states x, then the starts of the others
    D        how many components a state has
    atol     absolute tolerances of the others, if those of states are given: numbers (E,)
    """

    groups: list[OfMembers]
    shape: tuple[int, ...]
    starts: FloatArray
    D: int
    atol: tuple[float, ...]

    def run(self, batch: tuple[int, ...], request: SolverRequest) -> tuple[SolverResult, Any]:
        """Return the motion with states alone, and the other components (n, B, E)."""
        request = request._replace(settings=with_atol(request.settings, self.atol))
        result = to_tolerance(self.groups, self.shape, self.starts, batch, request)
        states, others = divided(result.states, self.D)
        return result._replace(states=states), others


def extended(x: FloatArray, *others: FloatArray) -> FloatArray:
    """Return states (B, D), followed by all components of others, arrays (B, ...)."""
    return np.concatenate([x, *(a.reshape(len(x), math.prod(a.shape[1:])) for a in others)], axis=1)


def divided(states: FloatArray, D: int) -> tuple[FloatArray, FloatArray]:
    """Return states (..., D), contiguous, and the other components (..., E)."""
    return np.ascontiguousarray(states[..., :D]), states[..., D:]


def with_atol(settings: Settings, others: tuple[float, ...]) -> Settings:
    """Return settings with absolute tolerances of further components, if atol is one for each."""
    if not isinstance(settings.atol, tuple):
        return settings
    return settings._replace(atol=settings.atol + others)


def atol_of_columns(settings: Settings, C: int) -> tuple[float, ...]:
    """Return absolute tolerances of C columns of derivatives: those of the components."""
    return settings.atol * C if isinstance(settings.atol, tuple) else ()
