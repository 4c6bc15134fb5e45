"""The motion by integrators: heyoka, to machine precision, and SciPy."""

import functools

import numpy as np
from formulas import Formulas
from problem import EPS_FIELD, lorenz_system
from work import TIME_OF_MOTIONS

SIDE_BY_SIDE = 16  # the fastest number of those tried


@functools.cache
def _integrator(right, D):
    """Return heyoka's integrator of a field, a function of D expressions."""
    import heyoka as hy

    variables = hy.make_vars(*(f"x{i}" for i in range(D)))
    system = list(zip(variables, right(*variables), strict=True))
    return hy.taylor_adaptive_batch(system, np.zeros((D, SIDE_BY_SIDE)))


def by_batches(integrator, starts, time):
    """Return last states by an integrator of heyoka, for batches one after the other."""
    size, D = starts.shape
    states = np.resize(starts, (-(-size // SIDE_BY_SIDE) * SIDE_BY_SIDE, D))
    for some in states.reshape(-1, SIDE_BY_SIDE, D):
        integrator.set_time(0.0)
        integrator.state[:] = some.T
        integrator.propagate_until(time)
        some[:] = integrator.state.T
    return states[:size]


def _by_scipy(right, starts, time, tolerance=1e-12, times=None):
    """Return last states, or states at `times`, of all trajectories as one system.

    All of them take the steps of the trajectory that needs the shortest.
    """
    from scipy.integrate import solve_ivp

    D = starts.shape[1]
    of_all = lambda t, x: np.concatenate(right(*x.reshape(D, -1)))  # noqa: E731
    settings = {"method": "DOP853", "rtol": tolerance, "atol": tolerance / 10}
    found = solve_ivp(of_all, (0, time), starts.T.ravel(), t_eval=times, **settings).y.T
    states = found.reshape(len(found), D, -1).transpose(0, 2, 1)
    return states[-1] if times is None else states


def _suslov(w1, w2):
    return Formulas().vector_field(w1, w2)


def _lorenz(*x):
    return lorenz_system(x)


def _henon_heiles(x, y, u, v):
    return u, v, -x - 2 * x * y, y * y - x * x - y


def by_heyoka(omega0, time):
    return by_batches(_integrator(_suslov, 2), omega0, time)


def by_scipy(omega0, time):
    return _by_scipy(_suslov, omega0, time)


def lorenz(field, x, steps):
    """The motion of the Lorenz system over the time of some steps of Kahan's map, by heyoka."""
    return by_batches(_integrator(_lorenz, 3), x, EPS_FIELD * steps)


def lorenz_by_scipy(field, x, steps):
    return _by_scipy(_lorenz, x, EPS_FIELD * steps)


def henon_heiles_by_scipy(tolerance, times=None):
    return lambda x: _by_scipy(_henon_heiles, x, TIME_OF_MOTIONS, tolerance, times)
