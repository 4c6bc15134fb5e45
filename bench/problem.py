"""The problem that every benchmark solves: random starts of the paper's first picture."""

import numpy as np

from suslov_fast import Suslov3D

BODY = Suslov3D(4, 1, -0.5, -0.3)
EPS = 0.2


def starts(batch):
    """Angular velocities in the square |Omega1|, |Omega2| <= 2."""
    return np.random.default_rng(0).uniform(-2, 2, (batch, 2))
