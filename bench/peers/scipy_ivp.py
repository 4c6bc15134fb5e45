"""SciPy: the motion (s1) by `solve_ivp`."""

import numpy as np
from formulas import velocity
from scipy.integrate import solve_ivp

TOLERANCES = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def one_by_one(omega0, time, threads):
    """A call for each trajectory."""

    def last(state):
        return solve_ivp(lambda t, w: velocity(*w), (0.0, time), state, **TOLERANCES).y[:, -1]

    return np.array([last(state) for state in omega0.tolist()])


def stacked(omega0, time, threads):
    """All trajectories as one system, which takes the steps that its worst one needs."""

    def right(t, w):
        return np.concatenate(velocity(*w.reshape(2, -1)))

    end = solve_ivp(right, (0.0, time), omega0.T.ravel(), **TOLERANCES).y[:, -1]
    return end.reshape(2, -1).T
