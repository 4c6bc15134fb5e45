"""One table of problems, with the reference for each: every map, in its regimes.

A row is a body, a state 0, a step size, a number of steps and a tolerance, relative to the largest
state of the orbit. `next_state` of a problem is the slow step of `naive`, in 60 digits.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import naive

import suslov_fast as sf


class Problem(NamedTuple):
    name: str
    body: Callable  # makes it: rows are made when tests are collected
    next_state: Callable  # of (eps, state)
    omega: tuple
    eps: float
    steps: int
    tolerance: float
    solved: bool  # has `exact` and `limits`

    def orbit(self):
        """States 0 to `steps`, in 60 digits."""
        return naive.iterated(partial(self.next_state, self.eps), self.omega, self.steps)


def body(name, parameters, omega, eps, steps, tolerance=1e-14):
    """A row for a body (I1, I2, I13, I23), or a gyrostat with k."""
    kind = sf.Suslov3D if len(parameters) == 4 else sf.SuslovGyrostat
    *inertia, k = parameters if len(parameters) == 5 else (*parameters, 0)

    def next_state(eps, state):
        return naive.step(*inertia, eps, state, k)

    make = partial(kind, *parameters)
    return Problem(name, make, next_state, omega, eps, steps, tolerance, solved=True)


PICTURE, ROTOR, UNIT = (4, 1, -0.5, -0.3), (2.3, 1.4, 0.5, -0.7), (1, 1, 1, 0)
PROBLEMS = [
    body("picture 1", PICTURE, (1.0, 0.5), 0.2, 60),
    body("picture 1, backwards", PICTURE, (1.0, 0.5), -0.2, 60),
    body("picture 2", (4, 3, -0.4, -0.2), (1.5, 0.25), 0.2, 60),
    body("picture 3", (4, 2, 0, -0.2), (1.5, 0.25), 0.02, 60),
    body("picture 4, T > 1", (3, 3, -0.2, -0.2), (-40.0, -250.0), 1.0, 12, 1e-13),
    body("long step, x < 0", PICTURE, (-1.0, -0.5), 4.0, 30),
    body("small step", PICTURE, (1.0, 0.5), 1e-9, 40),
    body("next to the line", (2.0, 1.0, 0.0, 0.5), (1.5, 1e-9), 1.0, 60),
    body("next to the line on its other side", (2.0, 1.0, 0.0, 0.5), (-1.5, 1e-9), 1.0, 40),
    body("at rest", UNIT, (0.0, 1.5), 0.5, 20, 0.0),
    body("next to the critical line", UNIT, (1e-3, -0.999999), 2.0, 60),
    body("T = 1", UNIT, (0.25, -1.0), 2.0, 2),
    body("T = 1, collapse", UNIT, (0.25, 1.0), 2.0, 3),
    body("large X", UNIT, (1e3, 0.5), 2.0, 8, 1e-13),
    body("large X and Y", UNIT, (300.0, -2000.0), 1.0, 8, 1e-13),
    body("next to a pole", UNIT, (1.0, -3.001), 1.0, 6, 1e-12),
    body("moments far apart", (1e-8, 1e8, 0.3, 0.2), (1.0, 1.0), 1e-4, 30, 1e-13),
    body("no products of inertia", (3, 2, 0, 0), (1.0, -2.0), 0.3, 10, 0.0),
    body("no step", PICTURE, (1.0, 0.5), 0.0, 10, 0.0),
    body("rotor, passes", (*ROTOR, 0.05), (1.1, -0.4), 0.35, 60),
    body("rotor, k next to A", (*ROTOR, 0.9), (1.1, -0.4), 0.35, 60),
    body("rotor, turns", (*ROTOR, -3.0), (1.1, -0.4), -0.35, 60, 3e-14),
    body("rotor, tiny", (*ROTOR, 1e-9), (1.1, -0.4), 0.35, 60),
    body("rotor, T > 1", (*ROTOR, 0.3), (11.0, -4.0), 3.0, 12, 1e-12),
    body("rotor, turns fast", (*ROTOR, 300.0), (1.1, -0.4), 2.0, 60, 1e-13),
    body("rotor alone, turns", (2.0, 3.0, 0.0, 0.0, 1.5), (1.0, 1.0), 0.3, 60, 3e-14),
    body("rotor, at rest", (1, 1, 1, 0, 0.5), (-0.5, 0.75), 0.5, 20, 0.0),
]
