"""Evaluation of functions of a state: checked arguments, a formula of the map, missing values."""

import math
from typing import Any

import numpy as np

from ..checks import FloatArray, first_index, real_array, spell, warn
from ..engine.arguments import Problem, check
from ..engine.status import SingularStepWarning
from ..maps import Map, map_of


def evaluate(
    name: str, body: Any, omega: Any, eps: Any = 0.0, *, map: Map | None = None
) -> FloatArray:
    """Check the arguments of the public function `name`, and return its value.

    The formula has this name in the record of the map, by default that of the body; a map without
    one is refused.
    """
    map = map or map_of(body)
    formula = map.formula(name, body)
    problem = check(map, body, omega, eps, later=True)
    return reported(problem, formula.compute(problem), formula.poles)


def reported(problem: Problem, values: FloatArray, poles: bool = False) -> FloatArray:
    """Return values, NaN where the state is NaN; a warning counts the other missing values.

    With `poles`, infinite values are values, else missing ones. Formulas are not finite at states
    that are not, so that most results need no other test.
    """
    with np.errstate(all="ignore"):
        if math.isfinite(values.sum()):
            return values
    unknown = np.isnan(real_array(problem.name, problem.omega, allow_nan=True)).any(axis=-1)
    unknown = np.broadcast_to(unknown, problem.batch)
    axes = tuple(range(len(problem.batch), values.ndim))
    lost = np.isnan(values) if poles else ~np.isfinite(values)
    lost = lost.any(axis=axes) & ~unknown
    if lost.any():
        message = f"{np.count_nonzero(lost)} of {lost.size} states: singular step or out of range"
        warn(f"{message}, first: {spell(first_index(lost))}", SingularStepWarning)
    return np.where(np.expand_dims(unknown | lost, axes), np.nan, values)[()]
