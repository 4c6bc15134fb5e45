"""heyoka: the motion by its Taylor integrator, to machine precision."""

import copy
import functools
from concurrent.futures import ThreadPoolExecutor

import heyoka as hy
import numpy as np
from formulas import Formulas

SIDE_BY_SIDE = 16  # the fastest number of those tried


@functools.cache
def _integrators(threads):
    p, q = hy.make_vars("p", "q")
    system = list(zip((p, q), Formulas().vector_field(p, q), strict=True))
    integrator = hy.taylor_adaptive_batch(system, np.zeros((2, SIDE_BY_SIDE)))
    return [copy.deepcopy(integrator) for _ in range(threads)]


def _integrate(integrator, omega0, time):
    states = np.resize(omega0, (-(-len(omega0) // SIDE_BY_SIDE) * SIDE_BY_SIDE, 2))
    for some in states.reshape(-1, SIDE_BY_SIDE, 2):
        integrator.set_time(0.0)
        integrator.state[:] = some.T
        integrator.propagate_until(time)
        some[:] = integrator.state.T
    return states[: len(omega0)]


def motion(omega0, time, threads):
    """Integrate batches of trajectories, with one integrator per thread.

    heyoka's own ensembles copy the integrator for each batch, which takes longer than integration.
    """
    parts = np.array_split(omega0, threads)
    with ThreadPoolExecutor(threads) as pool:
        times = [time] * threads
        return np.concatenate(list(pool.map(_integrate, _integrators(threads), parts, times)))
