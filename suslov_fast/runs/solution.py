"""The closed form of the map (Theorem 1) and of the motion, and the limits of orbits.

An integrable body in n dimensions is reduced to one in three first, see `bodies.reduction`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import AnyBody
from ..checks import FloatArray, Reals, real_number, warn, wrong
from ..core.suslov import closed_form
from ..engine.arguments import by_constants, flat_arrays
from ..engine.problem import Problem
from ..engine.status import IntegrationWarning
from ..engine.threads import call_kernel
from ..keywords import public
from ..maps import problem

# States per call of the kernel: Python handles Ctrl-C between two calls.
SLICE = 2**21
# Costs of preparing an orbit and of computing a state, in steps of the three-dimensional map.
_ORBIT_COST, _STATE_COST = 64, 8
_IN_PYTHON = 1e-5  # seconds of Python for a state, of which it computes 128 at least
# Reasons for missing states, in the order of the kernel's flags.
_REASONS = (
    ("no state, because n must be an integer up to 2**53 for so long an eps", RuntimeWarning),
    ("beyond the range of the closed form, 1e8 for X, Y and K: use iterate", RuntimeWarning),
    ("no state directly after a pole of the map", IntegrationWarning),
)


@public
def exact(
    body: AnyBody, omega0: ArrayLike, /, eps: Reals, n: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return any state of an orbit of the map by its closed form, at the same cost for every n.

    The map is that of a body; t below is its :func:`criticality`.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        Any body in three dimensions; in n dimensions an integrable one.
    omega0, eps
        As in :func:`iterate`: numbers of any type, mpmath's too, are rounded to float64.
    n : array_like(float, shape=() or (N,))
        Numbers of the states, positive or negative. If ``t**2 - (e k)**2 < 1``, with
        ``e = eps / (2 sqrt(I1 I2))`` and the momentum k of a rotor (without one, if ``|t| < 1``),
        n may be any real number, which gives a curve through the orbit.
    threads
        As in :func:`iterate`.

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The states. For longer eps they are NaN, with a `RuntimeWarning`, for ``|n| > 2**53`` and
        for n that is not an integer; and for any eps where the dimensionless X, Y or K exceeds 1e8
        (then use :func:`iterate`). Beyond a pole of the map, where :func:`iterate` stops, the
        formula continues; only the state directly after the pole is NaN, with a
        :class:`IntegrationWarning`.

    Raises
    ------
    NotIntegrableError
        If no closed form is known for this body in n dimensions.

    Notes
    -----
    The formula is Theorem 1 of Dragovic and Gajic, arXiv:0807.2966, with two corrections
    (:func:`closed_form`), extended to t >= 1 and to the gyrostat.

    Examples
    --------
    Where is the body after 25 steps, and after 10**12 steps forwards and backwards?

    >>> from suslov_fast import Suslov3D, exact
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> exact(body, [1.0, 0.5], eps=0.2, n=25).round(6)
    array([ 0.873325, -1.093093])
    >>> exact(body, [1.0, 0.5], eps=0.2, n=[-(10**12), 10**12]).round(6)
    array([[-0.791446,  1.319077],
           [ 0.791446, -1.319077]])
    """
    if isinstance(n, float) and math.isinf(n):
        raise wrong("n", "finite", f"{n!r}: limits returns the limits of an orbit")
    numbers = np.asarray(real_number("n", n))
    if numbers.ndim > 1:
        raise wrong("n", "a number or a 1-D array", f"an array of shape {numbers.shape}")
    start = problem("exact", body, omega0, eps, threads, name="omega0")
    return states_at(start, numbers, is_number=True)


@public
def limits(body: AnyBody, omega0: ArrayLike, /, eps: Reals) -> tuple[FloatArray, FloatArray]:
    """Return the limits of an orbit of the map as n goes to minus and to plus infinity.

    Orbits go from one steady rotation to another (Proposition 2 of Dragovic and Gajic,
    arXiv:0807.2966); without a rotor that is the opposite one.

    Parameters
    ----------
    body, omega0, eps
        As in :func:`exact`, but eps = 0 stands for the continuous motion.

    Returns
    -------
    omega_minus, omega_plus : ndarray(float, shape=(..., D))
        Angular velocities: opposite points of the line I13 Omega1 + I23 Omega2 = 0; for a
        gyrostat, points of the line I13 Omega1 + I23 Omega2 = -k. Orbits continue
        beyond poles, and a fixed point is its own limit. NaN for an orbit of a gyrostat on a closed
        curve, for a state that contains NaN, and for the one state of a body at which the map or
        its inverse is undefined.

    Raises
    ------
    NotIntegrableError
        If no closed form is known for this body in n dimensions.

    Examples
    --------
    Which steady rotation does the body come from, and which does it approach?

    >>> from suslov_fast import Suslov3D, limits
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> before, after = limits(body, [1.0, 0.5], eps=0.2)
    >>> before.round(6), after.round(6)
    (array([-0.791446,  1.319077]), array([ 0.791446, -1.319077]))
    """
    start = problem("limits", body, omega0, eps, name="omega0")
    plane, from_plane = start.map.plane(start)
    minus, plus = closed_form.limits(*plane.body.constants, plane.eps, plane.omega)
    return from_plane(minus), from_plane(plus)


def states_at(problem: Problem, times: FloatArray, is_number: bool) -> FloatArray:
    """Return states of the map or of the flow, and warn of missing ones.

    `times` (N,) or () are numbers of states of the map, or times of the flow.
    """
    plane, from_plane = problem.map.plane(problem)
    batch, threads, flat_times = plane.batch, plane.threads, flat_arrays(times, times.shape, 0)
    starts = flat_arrays(plane.omega, batch)
    orbits = by_constants(plane.body, plane.eps, batch), starts, float(is_number)
    states, reasons = np.empty((times.size, *starts.shape)), np.zeros((3, len(starts)), bool)
    rows = max(SLICE // max(len(starts), 1), 1)
    for row in range(0, times.size, rows):
        slice_times = flat_times[row : row + rows]
        work = len(starts) * (_ORBIT_COST + _STATE_COST * len(slice_times))
        data = *orbits, slice_times, states[row:], reasons
        seconds = _IN_PYTHON * (128 + len(starts) * (2 + len(slice_times)))
        call_kernel(closed_form.states, work, threads, *data, seconds=seconds)
    if np.count_nonzero(reasons):  # faster than `any`, which matters in small calls
        for flags, (reason, category) in zip(reasons, _REASONS, strict=True):
            if flags.any():
                warn(f"{np.count_nonzero(flags)} of {flags.size} orbits: {reason}", category)
    states = states.reshape(*times.shape, *batch, 2)
    if plane is not problem:
        states = np.asarray(from_plane(states))
        states[times == 0.0] = problem.omega  # exactly, because the reduction rounds
    return states
