"""Evaluation of functions of a state: check, compute the formula of the map, warn."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..checks import FloatArray, first_index, spell, warn
from ..status import IntegrationWarning
from .problem import Problem, check, part_of
from .tolerances import NUMBERS_OF_PART


class Formula(NamedTuple):
    """A function of a state, for the map of a class of systems."""

    compute: Any  # takes a checked problem, returns the values (...), or an array for each state
    check: Callable[[Any], None] | None = None  # raises an error for a system without the function
    poles: bool = False  # True if infinite values are results; else they become NaN


def evaluate(formula: Formula, map: Any, body: Any, x: Any, eps: Any = 0.0) -> Any:
    """Check the arguments of a public function of a state; return its value by a `Formula`."""
    if formula.check:
        formula.check(body)
    body = body._autonomous
    problem = check(map, body, x, eps)
    with np.errstate(all="ignore"):
        values = in_parts(formula.compute, problem)
    return mask_and_warn(problem, values[()], formula.poles)  # a number for a single state


def in_parts(compute: Callable[[Problem], FloatArray], problem: Problem) -> FloatArray:
    """Return compute(problem); large batches in parts, between which Python handles Ctrl-C."""
    batch, D = problem.batch, problem.body._layout.D
    work, length = math.prod(batch) * D**2, max(batch, default=1)
    if work <= NUMBERS_OF_PART or length == 1:
        return compute(problem)
    # Divide the longest axis; calls for parts that are still too large divide their longest axis.
    axis = batch.index(length)
    width = max(length * NUMBERS_OF_PART // work, 1)
    where = [slice(0, n) for n in batch]
    for begin in range(0, length, width):
        where[axis] = slice(begin, min(begin + width, length))
        of_part = in_parts(compute, part_of(problem, tuple(where)))
        if begin == 0:
            values = np.empty((*batch, *of_part.shape[len(batch) :]), of_part.dtype)
        values[tuple(where)] = of_part
    return values


def mask_and_warn(problem: Problem, values: FloatArray, poles: bool = False) -> FloatArray:
    """Return the values, NaN where the state has a NaN; warn once where other values are missing.

    A value is missing if it is NaN or, unless `poles` is True, infinite.
    """
    with np.errstate(all="ignore"):
        total = values.sum()
    if math.isfinite(total):  # no value is missing: a state with NaN has no finite value
        return values
    unknown = np.isnan(problem.x).any(axis=-1)
    unknown = np.broadcast_to(unknown, problem.batch)
    axes = tuple(range(len(problem.batch), values.ndim))
    lost = np.isnan(values) if poles else ~np.isfinite(values)
    lost = lost.any(axis=axes) & ~unknown
    if lost.any():
        message = f"{np.count_nonzero(lost)} of {lost.size} states: singular step or out of range"
        warn(f"{message}, first: {spell(first_index(lost))}", IntegrationWarning)
    return np.where(np.expand_dims(unknown | lost, axes), np.nan, values)[()]
