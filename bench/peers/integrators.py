"""The motion by integrators: heyoka, to machine precision, and SciPy."""

import functools

import numpy as np
from formulas import Formulas

SIDE_BY_SIDE = 16  # the fastest number of those tried


@functools.cache
def _integrator():
    import heyoka as hy

    p, q = hy.make_vars("p", "q")
    system = list(zip((p, q), Formulas().vector_field(p, q), strict=True))
    return hy.taylor_adaptive_batch(system, np.zeros((2, SIDE_BY_SIDE)))


def by_heyoka(omega0, time):
    """Integrate batches of trajectories, one after the other."""
    integrator = _integrator()
    states = np.resize(omega0, (-(-len(omega0) // SIDE_BY_SIDE) * SIDE_BY_SIDE, 2))
    for some in states.reshape(-1, SIDE_BY_SIDE, 2):
        integrator.set_time(0.0)
        integrator.state[:] = some.T
        integrator.propagate_until(time)
        some[:] = integrator.state.T
    return states[: len(omega0)]


def by_scipy(omega0, time):
    """Integrate all trajectories as one system, with the steps of the most demanding one."""
    from scipy.integrate import solve_ivp

    right = lambda t, w: np.concatenate(Formulas().vector_field(*w.reshape(2, -1)))  # noqa: E731
    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    return solve_ivp(right, (0, time), omega0.T.ravel(), **settings).y[:, -1].reshape(2, -1).T
