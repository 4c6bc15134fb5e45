"""The closed form: any state of the map and of the flow, and the limits of orbits.

Bodies in n dimensions that have one are reduced to three, see `maps.formulas`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import AnyBody
from ..checks import FloatArray, real_number, require, warn, wrong
from ..core import closed_form
from ..engine.arguments import by_constants, flat_arrays
from ..engine.status import SingularStepWarning
from ..engine.threads import call_kernel
from ..maps import problem

# States in a call of the kernel, between which Python handles Ctrl-C; and costs of entering an
# orbit, and of a state, in steps of the three-dimensional map.
_SLICE, _ENTERING, _STATE = 2**21, 64, 8
# Why orbits lack states, in the order of the flags of the closed form.
_REASONS = (
    ("non-integer n, or |n| > 2**53, where t >= 1", RuntimeWarning),
    ("beyond the range of the closed form, 1e8 for X, Y and K", RuntimeWarning),
    ("no state directly after a pole of the map", SingularStepWarning),
)


def exact(
    body: AnyBody, omega0: ArrayLike, /, eps: ArrayLike, n: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return state n of the map by the closed form, without iteration.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        In n dimensions it must be integrable, else :class:`NotIntegrableError`.
    omega0, eps, threads
        As in :func:`iterate`.
    n : array_like(float, shape=() or (N,))
        Indices of the states, positive or negative. For t < 1 (:func:`criticality`) n may be any
        real number, which gives a curve through the orbit; also for a gyrostat that is periodic.

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The states. They are NaN directly after a pole, with a :class:`SingularStepWarning`; and,
        with a `RuntimeWarning`, for non-integer n and for ``|n| > 2**53`` if t >= 1, and where
        the dimensionless X, Y or K is above 1e8 (then use :func:`iterate`).

    Notes
    -----
    The formula is Theorem 1 in Section 4 of the paper, corrected, and extended to t >= 1 and to
    the gyrostat.

    At a pole there is no next state: :func:`iterate` and :func:`step` stop there, with NaN and the
    status SINGULAR. The closed form goes on beyond the pole, as the birational map does:
    :func:`exact` and :func:`limits` have the states after it, and only the state directly after
    the pole is NaN.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, exact, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> exact(body, [1.0, 0.5], eps=0.2, n=25).round(6)
    array([ 0.873325, -1.093093])
    >>> exact(body, [1.0, 0.5], eps=0.2, n=[-(10**12), 0.5, 10**12]).round(6)
    array([[-0.791446,  1.319077],
           [ 1.007482,  0.435551],
           [ 0.791446, -1.319077]])
    """
    return _states_at("exact", body, omega0, eps, "n", n, threads)


def flow(
    body: AnyBody, omega0: ArrayLike, /, time: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return the continuous motion at given times, the solution of equation (2) of the paper.

    Parameters
    ----------
    body, omega0, threads
        As in :func:`exact`.
    time : array_like(float, shape=() or (N,))
        Times, positive or negative, in the unit of time of omega0.

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The angular velocities.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, energy, flow
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> states = flow(body, [1.0, 0.5], time=[0.0, 5.0, 1e6])
    >>> states.round(6)
    array([[ 1.      ,  0.5     ],
           [ 0.873751, -1.093725],
           [ 0.791864, -1.319774]])
    >>> energy(body, states).round(12)
    array([2.125, 2.125, 2.125])
    """
    return _states_at("flow", body, omega0, 0.0, "time", time, threads)


def limits(body: AnyBody, omega0: ArrayLike, /, eps: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the limits of an orbit of the map for n to minus and to plus infinity.

    They are those of Proposition 2 in Section 4 of the paper.

    Parameters
    ----------
    body, omega0, eps
        As in :func:`exact`.

    Returns
    -------
    omega_minus, omega_plus : ndarray(float, shape=(..., D))
        Opposite points of the line I13 Omega1 + I23 Omega2 = 0, or for a gyrostat points of the
        line I13 Omega1 + I23 Omega2 = -k. Orbits are continued beyond poles. A fixed point is its
        own limit. NaN where the orbit of a gyrostat lies on a closed curve, if omega0 is NaN, and
        for the one state of a body at which the map, or its inverse, is undefined.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, limits
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> omega_minus, omega_plus = limits(body, [1.0, 0.5], eps=0.2)
    >>> omega_minus.round(6), omega_plus.round(6)
    (array([-0.791446,  1.319077]), array([ 0.791446, -1.319077]))
    """
    given = problem("limits", body, omega0, eps, name="omega0")
    plane, leave = given.map.plane.reduce(given)
    minus, plus = closed_form.limits(*plane.body.constants, plane.eps, plane.omega)
    return leave(minus), leave(plus)


def _states_at(
    function: str, body: Any, omega0: Any, eps: Any, name: str, value: Any, threads: int | None
) -> FloatArray:
    """Return states of the map or the flow at given times, and warn of those that are missing."""
    times = np.asarray(real_number(name, value))
    if times.ndim > 1:
        raise wrong(name, "a number or a 1-D array", f"an array of shape {times.shape}")
    start = problem(function, body, omega0, eps, threads, name="omega0")
    plane, leave = start.map.plane.reduce(start)
    batch, threads, all_times = plane.batch, plane.threads, times.reshape(-1)
    flat = flat_arrays(plane.omega, batch)
    given = by_constants(plane.body, plane.eps, batch), flat, float(name == "n")
    require(8 * times.size * flat.size, "compute fewer states at a time")
    states, reasons = np.empty((times.size, *flat.shape)), np.zeros((3, len(flat)), bool)
    rows = max(_SLICE // max(len(flat), 1), 1)
    for row in range(0, times.size, rows):
        some = all_times[row : row + rows]
        work = len(flat) * (_ENTERING + _STATE * len(some))
        call_kernel(closed_form.states, work, threads, *given, some, states[row:], reasons)
    if reasons.any():
        for flags, (what, category) in zip(reasons, _REASONS, strict=True):
            if flags.any():
                warn(f"{np.count_nonzero(flags)} of {flags.size} orbits: {what}", category)
    states = np.asarray(leave(states.reshape(*times.shape, *batch, 2)))
    if plane is not start:
        states[times == 0.0] = start.omega
    return states
