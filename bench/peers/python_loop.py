"""Python alone: one number at a time."""

import numpy as np

from .printed import step


def final(omega0, steps, threads):
    """(ds2) as printed."""
    result = []
    for p, q in omega0.tolist():
        for _ in range(steps):
            p, q = step(p, q)
        result.append((p, q))
    return np.array(result)
