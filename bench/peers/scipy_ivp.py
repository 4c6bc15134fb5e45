"""SciPy: the motion (s1) by `solve_ivp`."""

import numpy as np
from problem import EPS
from scipy.integrate import solve_ivp

from .printed import velocity

TOLERANCES = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def one_by_one(omega0, steps, threads):
    """A call for each trajectory."""
    span = (0.0, steps * EPS)
    ends = [
        solve_ivp(lambda t, w: velocity(*w), span, state, t_eval=span[1:], **TOLERANCES).y[:, 0]
        for state in omega0.tolist()
    ]
    return np.array(ends)


def stacked(omega0, steps, threads):
    """All trajectories as one system, which takes the steps that its worst one needs."""

    def right(t, w):
        return np.concatenate(velocity(*w.reshape(2, -1)))

    span = (0.0, steps * EPS)
    end = solve_ivp(right, span, omega0.T.ravel(), t_eval=span[1:], **TOLERANCES).y[:, 0]
    return end.reshape(2, -1).T
