"""Maps and bodies of the tests' own, as users would write them: see the docstring of `maps.Map`."""

from dataclasses import dataclass
from typing import Any

import numpy as np

import suslov_fast as sf
from suslov_fast import maps
from suslov_fast.core.codes import OK
from suslov_fast.maps import KAHAN, Body, Formula, Steps, by_field, function


@function
def add_field(indices, values, x, factor, out):
    """Add the field at x (D + 1,), of which the last component is 1, times a factor."""
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        out[i] += factor * values[t] * x[j] * x[k]


@function
def midpoint_step(x, out, eps, work, indices, values):
    """x_next = x + eps f(x + (eps / 2) f(x))."""
    D = len(x)
    given, middle, after = work[: D + 1], work[D + 1 : 2 * D + 2], work[2 * D + 2 :]
    given[D] = 1.0
    for d in range(D):
        given[d] = x[d]
    for d in range(D + 1):  # loops, because Numba compiles slices on the left for seconds
        middle[d] = after[d] = given[d]
    add_field(indices, values, given, 0.5 * eps, middle)
    add_field(indices, values, middle, eps, after)
    for d in range(D):
        out[d] = after[d]
    return OK


MIDPOINT = maps.Map(
    name="midpoint",
    title="Explicit midpoint rule",
    body=sf.QuadraticField,
    methods={"midpoint": Steps(maps.steps_of(midpoint_step, lambda D: 3 * D + 3), by_field)},
    formulas={"vector_field": KAHAN["vector_field"], "energy": KAHAN["energy"]},
    random=maps.MAPS["Kahan"].random,
    pole=None,  # every state has a next one
    variable="x",
    meaning="state",
)


@dataclass(frozen=True, eq=False, repr=False)
class Sleigh(Body):
    """A Chaplygin sleigh, whose state is its speed and its angular velocity: it turns no body."""

    mass: Any
    J: Any
    b: Any

    def field(self):
        mass, J, b = np.broadcast_arrays(self.mass, self.J, self.b)
        q = np.zeros((*self.shape, 2, 2, 2))
        q[..., 0, 1, 1], q[..., 1, 0, 1] = b, -mass * b / (J + mass * b * b)
        return sf.QuadraticField(q)


def _energy(problem):
    body, (v, w) = problem.body, np.moveaxis(problem.omega, -1, 0)
    return 0.5 * (body.mass * v * v + (body.J + body.mass * body.b**2) * w * w) + 0.0 * problem.eps


SLEIGH = maps.Map(
    name="sleigh",
    title="Sleigh",
    body=Sleigh,
    methods={"auto": maps.FIELD},
    formulas={**KAHAN, "energy": Formula(_energy)},
    random=(lambda rng, shape: Sleigh(*rng.uniform(1, 2, (3, *shape))),),
    # A = [[1, -eps b w], [eps c w / 2, 1 + eps c v / 2]] is singular for eps = 1, w = 0, v = -4.
    pole=(Sleigh(1.0, 1.0, 1.0), (-4.0, 0.0)),
)
