"""Maps and bodies of the tests' own, as users would write them: see the docstring of `maps.Map`."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import suslov_fast as sf
from suslov_fast import maps
from suslov_fast.core.codes import NONFINITE, OK
from suslov_fast.maps import KAHAN, Body, Formula, Steps, by_field, function, kernel, share


@function
def add_field(indices, values, x, factor, out):
    """Add the field at x (D + 1,), of which the last component is 1, times a factor."""
    for t in range(len(values)):
        i, j, k = indices[0, t], indices[1, t], indices[2, t]
        out[i] += factor * values[t] * x[j] * x[k]


@kernel
def midpoint_steps(part, parts, arguments, omega0, carry, span, saved, final, status, failed_at):
    """x_next = x + eps f(x + (eps / 2) f(x)), one trajectory after the other."""
    indices, values, eps = arguments
    begin, end, start, stop, every, next_row = span
    D = omega0.shape[1]
    x, middle, after = np.ones(D + 1), np.ones(D + 1), np.ones(D + 1)
    first, last = share(end - begin, part, parts)
    for i in range(begin + first, begin + last):
        h, v, row = eps[i % len(eps)], values[i % len(values)], next_row
        for d in range(D):
            x[d] = omega0[i, d] if start == 0 else final[i, d]
        if start == 0 and np.isnan(x.sum()):
            status[i], failed_at[i] = NONFINITE, 0
        for n in range(start, stop + 1):
            if n > start:
                middle[:] = x
                add_field(indices, v, x, 0.5 * h, middle)
                after[:] = x
                add_field(indices, v, middle, h, after)
                x[:] = after
                if status[i] == 0 and not np.isfinite(x.sum()):
                    status[i], failed_at[i] = NONFINITE, n
            if status[i] < 0:
                x[:D] = np.nan
            if every > 0 and n % every == 0 and (n > start or start == 0):
                for d in range(D):
                    saved[row, i, d] = x[d]
                row += 1
        for d in range(D):
            final[i, d] = x[d]


@function
def midpoint_step(x, out, eps, work, indices, values):
    """The same step, of one state, in the same order of operations."""
    D = len(x)
    given, middle, after = work[: D + 1], work[D + 1 : 2 * D + 2], work[2 * D + 2 :]
    given[:D], given[D] = x, 1.0
    middle[:] = given
    add_field(indices, values, given, 0.5 * eps, middle)
    after[:] = given
    add_field(indices, values, middle, eps, after)
    out[:] = after[:D]
    return OK


MIDPOINT = maps.Map(
    name="midpoint",
    title="Explicit midpoint rule",
    body=sf.QuadraticField,
    methods={"midpoint": Steps(midpoint_steps, by_field)},
    formulas={"vector_field": KAHAN["vector_field"], "energy": KAHAN["energy"]},
    random=maps.MAPS["Kahan"].random,
    pole=None,  # every state has a next one
    variable="x",
    meaning="state",
)
BY_STEP = replace(
    MIDPOINT,
    name="by step",
    methods={"by_step": Steps(maps.steps_of(midpoint_step, lambda D: 3 * D + 3), by_field)},
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
