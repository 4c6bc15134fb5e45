"""heyoka: the map as a compiled function, and the motion (s1) by its Taylor integrator."""

import copy
import functools
from concurrent.futures import ThreadPoolExecutor

import heyoka as hy
import numpy as np
from problem import BODY, EPS

from . import printed

I1, I2, I13, I23 = map(float, BODY.parameters)
A, D = I1 * I2, I13**2 * I2 + I23**2 * I1
SX, SY = EPS / (2 * A) ** 0.5, EPS / (2 * A)
FUSED, SIDE_BY_SIDE = 4, 16  # the fastest of those tried


def _advance(X, Y):
    X_next = X * (1.0 + Y) / (1.0 - Y + X * X)
    return X_next, Y - X * X_next


@functools.cache
def _compiled(step, fused):
    p, q = hy.make_vars("p", "q")
    state = (p, q)
    for _ in range(fused):
        state = step(*state)
    return hy.cfunc(list(state), [p, q])


def _iterate(step, state, steps, threads):
    """`steps` steps of (2, batch): calls of several steps, then single ones."""
    hy.set_nthreads(threads)
    states, following = np.ascontiguousarray(state), np.empty(state.shape)
    for fused, calls in ((FUSED, steps // FUSED), (1, steps % FUSED)):
        function = _compiled(step, fused)
        for _ in range(calls):
            function(states, outputs=following)
            states, following = following, states
    return states


def as_printed(omega0, steps, threads):
    """(ds2) as printed."""
    return _iterate(printed.step, omega0.T.copy(), steps, threads).T


def parameter_free(omega0, steps, threads):
    """The parameter-free form."""
    p, q = omega0.T
    state = np.stack([SX * (I13 * p + I23 * q), SY * (I23 * I1 * p - I13 * I2 * q)])
    X, Y = _iterate(_advance, state, steps, threads)
    x, y = X / SX, Y / SY
    return np.stack([I13 * I2 * x + I23 * y, I23 * I1 * x - I13 * y], axis=-1) / D


@functools.cache
def _integrators(threads):
    p, q = hy.make_vars("p", "q")
    system = list(zip((p, q), printed.velocity(p, q), strict=True))
    integrator = hy.taylor_adaptive_batch(system, np.zeros((2, SIDE_BY_SIDE)))
    return [copy.deepcopy(integrator) for _ in range(threads)]


def _integrate(integrator, omega0, t):
    states = np.resize(omega0, (-(-len(omega0) // SIDE_BY_SIDE) * SIDE_BY_SIDE, 2))
    for some in states.reshape(-1, SIDE_BY_SIDE, 2):
        integrator.set_time(0.0)
        integrator.state[:] = some.T
        integrator.propagate_until(t)
        some[:] = integrator.state.T
    return states[: len(omega0)]


def motion(omega0, steps, threads):
    """Batches of trajectories, an integrator for each thread; to machine precision.

    Its own ensembles copy the integrator for each batch, which takes longer than to integrate.
    """
    parts = np.array_split(omega0, threads)
    with ThreadPoolExecutor(threads) as pool:
        times = [steps * EPS] * threads
        return np.concatenate(list(pool.map(_integrate, _integrators(threads), parts, times)))
