"""SciPy: the motion by `solve_ivp`."""

import numpy as np
from formulas import Formulas
from scipy.integrate import solve_ivp


def motion(omega0, time, threads):
    """Integrate all trajectories as one system, with the steps of the most demanding one."""

    def right(t, w):
        return np.concatenate(Formulas().vector_field(*w.reshape(2, -1)))

    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    end = solve_ivp(right, (0.0, time), omega0.T.ravel(), **settings).y[:, -1]
    return end.reshape(2, -1).T
