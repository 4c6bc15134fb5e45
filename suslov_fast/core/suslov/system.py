"""Steps of one state in three dimensions, for compiled loops of users (`compiled.step_system`)."""

from typing import NamedTuple

import numpy as np

from ..numba.decorators import function
from ..numba.status import NONFINITE, OK, SINGULAR
from .map import one_step


class BodySystem(NamedTuple):
    """A body in three dimensions and a step size; without a rotor k = 0."""

    I1: float
    I2: float
    I13: float
    I23: float
    k: float
    eps: float
    dimension: int = 2


@function
def no_memory(system):
    """An array, because all systems have memory; steps in three dimensions need none."""
    return np.empty(0)


@function
def step_of_one(system, x, out, memory):
    """Write the state that follows x to `out`; return its status."""
    s = system
    w1, w2 = one_step(s.I1, s.I2, s.I13, s.I23, s.k, s.eps, x[0], x[1])
    status = OK
    if np.isnan(w1):
        status = SINGULAR if abs(x[0]) + abs(x[1]) < np.inf else NONFINITE
    out[0], out[1] = w1, w2
    return status


# What `compiled` calls for a system of this kind.
BodySystem.memory, BodySystem.one_step = no_memory, step_of_one
