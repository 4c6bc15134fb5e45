"""Maps and bodies of the tests' own, as users would write them: see the docstring of `maps.Map`."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

import suslov_fast as sf
from suslov_fast import maps
from suslov_fast.core.compiling.codes import OK
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
)


@function
def slope(x, factor, scale, b, A, out):
    """Set out to factor scale (b.x) A x."""
    D, product = len(x), 0.0
    for j in range(D):
        product += b[j] * x[j]
    for i in range(D):
        total = 0.0
        for j in range(D):
            total += A[i, j] * x[j]
        out[i] = factor * scale * product * total


@function
def mixed_step(x, out, eps, work, scale, b, A):
    """x_next = x + eps f(x + (eps / 2) f(x)) with f(x) = scale (b.x) A x."""
    D = len(x)
    middle, change = work[:D], work[D:]
    slope(x, 0.5 * eps, scale, b, A, change)
    for i in range(D):
        middle[i] = x[i] + change[i]
    slope(middle, eps, scale, b, A, change)
    for i in range(D):
        out[i] = x[i] + change[i]
    return OK


@dataclass(frozen=True, eq=False, repr=False)
class Mixed(Body):
    """x' = scale (b.x) A x: a body with a number, a vector and a matrix."""

    scale: Any
    b: Any
    A: Any

    axes: ClassVar = {"b": 1, "A": 2}
    dimension = 3
    labels = "x", "y", "z"

    def field(self):
        scale, b, A = (np.asarray(each) for each in (self.scale, self.b, self.A))
        return sf.QuadraticField(
            scale[..., None, None, None] * A[..., :, :, None] * b[..., None, None, :]
        )


def _mixed(rng, shape):
    """Return a body whose number is that of each member, and whose matrix all of them share."""
    A = rng.uniform(-1, 1, (3, 3))
    return Mixed(rng.uniform(0.5, 1, shape), rng.uniform(-1, 1, (*shape, 3)), A)


MIXED = maps.Map(
    name="mixed",
    title="Number, vector and matrix",
    body=Mixed,
    methods={"auto": Steps(maps.steps_of(mixed_step, lambda D: 2 * D), maps.by_constants)},
    formulas={"vector_field": KAHAN["vector_field"]},
    variable="x",
    meaning="state",
)

RANDOM = {
    "mixed": (
        _mixed,
        lambda rng, shape: Mixed(
            0.7, rng.uniform(-1, 1, (*shape, 3)), rng.normal(size=(*shape, 3, 3))
        ),
    ),
}
