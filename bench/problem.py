"""The problem that every benchmark solves: random starts of the paper's first picture."""

import numpy as np

from suslov_fast import Suslov3D, SuslovND

BODY = Suslov3D(4, 1, -0.5, -0.3)
EPS = 0.2


def starts(batch):
    """Angular velocities in the square |Omega1|, |Omega2| <= 2."""
    return np.random.default_rng(0).uniform(-2, 2, (batch, 2))


def problem_nd(components, batch):
    """A body in components + 1 dimensions, and states of the order of 1."""
    rng = np.random.default_rng(components)
    scale = 1.0 / np.sqrt(components)
    body = SuslovND(rng.uniform(1, 4, components), rng.normal(size=components) * scale)
    return body, rng.normal(size=(batch, components)) * scale
