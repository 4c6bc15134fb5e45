"""States at many times, and times of crossings, by SciPy and heyoka.

Each function makes a function of starts, as those of the file of the same name beside this folder.
"""

import numpy as np
from inside import SURFACE, SYSTEM, TIME, TIMES, WANTED, by_trajectory
from scipy.integrate import solve_ivp

from peers.integrators import SIDE_BY_SIDE, henon_heiles_by_scipy
from peers.motions import compiled_f, heyoka_system


def by_scipy(wanted, tolerance):
    """States by one system of all orbits; crossings by events, orbits one after the other."""
    if wanted == WANTED[0]:
        return henon_heiles_by_scipy(tolerance, TIMES)
    f = compiled_f(SYSTEM)
    options = {"method": "DOP853", "rtol": tolerance, "atol": 1e-3 * tolerance}
    event = lambda t, s: s[SURFACE]  # noqa: E731

    def run(x):
        found = [solve_ivp(f, (0, TIME), s, events=event, **options).t_events[0] for s in x]
        trajectory = np.repeat(np.arange(len(x)), [len(each) for each in found])
        return by_trajectory(np.concatenate(found), trajectory, len(x))

    return run


def by_heyoka(wanted, tolerance):
    """Batches of 16; events that are recorded by a function of Python."""
    import heyoka

    system = heyoka_system(SYSTEM)
    D, found, options = len(system), [], {"tol": tolerance}
    if wanted == WANTED[1]:
        record = lambda integrator, t, direction, k: found.append((k, t))  # noqa: E731
        options["nt_events"] = [heyoka.nt_event_batch(system[SURFACE][0], callback=record)]
    several = heyoka.taylor_adaptive_batch(system, np.zeros((D, SIDE_BY_SIDE)), **options)
    times = np.repeat(TIMES[:, np.newaxis], SIDE_BY_SIDE, axis=1)

    def run(x):
        states = np.resize(x, (-(-len(x) // SIDE_BY_SIDE) * SIDE_BY_SIDE, D))
        results = []
        for first, some in enumerate(states.reshape(-1, SIDE_BY_SIDE, D)):
            several.set_time(0.0)
            several.state[:] = some.T
            if wanted == WANTED[0]:
                results.append(several.propagate_grid(times)[-1].transpose(0, 2, 1))
                continue
            found.clear()
            several.propagate_until(TIME)
            results += [(first * SIDE_BY_SIDE + k, t) for k, t in found]
        if wanted == WANTED[0]:
            return np.concatenate(results, axis=1)[:, : len(x)]
        trajectory, time = np.array(sorted(results)).T
        inside = trajectory < len(x)
        return by_trajectory(time[inside], trajectory[inside].astype(int), len(x))

    return run
