"""The closed form of the map (Theorem 1), of the flow, and of the limits of orbits.

An integrable body in n dimensions is reduced to one in three first, see `bodies.reduction`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import AnyBody, BodyOrField
from ..bodies.nd import NotIntegrableError
from ..checks import FloatArray, real_number, require, short, warn, wrong
from ..core import closed_form
from ..engine.arguments import by_constants, flat_arrays
from ..engine.problem import check
from ..engine.status import SingularStepWarning
from ..engine.stretches import Progress
from ..engine.threads import call_kernel
from ..keywords import public
from ..maps import map_of, problem
from .motion import checked_tolerance, motion

# States per call of the kernel: Python handles Ctrl-C between two calls.
_SLICE = 2**21
# Costs of preparing an orbit and of computing a state, in steps of the three-dimensional map.
_ORBIT_COST, _STATE_COST = 64, 8
_IN_PYTHON = 1e-4  # seconds of Python for a state, of which it computes 128 at least
# Reasons for missing states, in the order of the kernel's flags.
_REASONS = (
    ("no state for t >= 1 if n is not an integer, or |n| > 2**53", RuntimeWarning),
    ("beyond the range of the closed form, 1e8 for X, Y and K: use iterate", RuntimeWarning),
    ("no state directly after a pole of the map", SingularStepWarning),
)


@public
def exact(
    body: AnyBody, omega0: ArrayLike, /, eps: ArrayLike, n: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return any state of an orbit of the map by its closed form, at the same cost for every n.

    The map is that of a body; t below is its :func:`criticality`.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        Any body in three dimensions; in n dimensions an integrable one.
    omega0, eps
        As in :func:`iterate`.
    n : array_like(float, shape=() or (N,))
        Numbers of the states, positive or negative. If ``|t| < 1``, or if the orbit of a
        gyrostat is periodic, n may be any real number, which gives a curve through the orbit.
    threads
        As in :func:`iterate`.

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The states. If ``|t| >= 1``, they are NaN, with a `RuntimeWarning`, for ``|n| > 2**53`` and
        for n that is not an integer; and for any t where the dimensionless X, Y or K exceeds 1e8
        (then use :func:`iterate`). Beyond a pole of the map, where :func:`iterate` stops, the
        formula continues; only the state directly after the pole is NaN, with a
        :class:`SingularStepWarning`.

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
    return _states_at("exact", body, omega0, eps, "n", n, threads)


@public
def flow(
    body: BodyOrField,
    omega0: ArrayLike,
    /,
    time: ArrayLike,
    *,
    rtol: float | None = None,
    threads: int | None = None,
    progress: Progress = None,
) -> FloatArray:
    """Return the solution of the equations of motion at given times, starting at time 0.

    For a field ``x' = f(x)`` it is computed to a tolerance, by extrapolated steps of order 10. Each
    trajectory chooses the lengths of its steps by its own estimate of the error. Stiff fields are
    solved by the same steps. For a body the solution is exact.

    Parameters
    ----------
    body : QuadraticField, LiftedField, Suslov3D, SuslovGyrostat or SuslovND
        A single field or body, or a batch; a body in n dimensions must be integrable.
    omega0 : array_like(float, shape=(..., D))
        Initial states: states x of a field, or angular velocities.
    time : array_like(float, shape=() or (N,))
        Times in any order, positive or negative.
    rtol : float, optional
        Tolerance for fields, from 1e-13 to 1e-2, by default 1e-9. In each component the estimated
        error of a step stays below `rtol` times the largest absolute value of this component on the
        trajectory so far, or below what rounding allows. This value counts as at least 1e-6 of that
        of the largest component. So there is no absolute tolerance: scale components that differ by
        more than a factor of 1e6.
    threads : int, optional
        As in :func:`iterate`; a solution is bit-identical on any number of threads, in any batch.
    progress : bool or callable, optional
        For fields: called as ``progress(done, total)`` with numbers of times, at each time and not
        between two. If it returns False, the states at later times are NaN. To end a long solution
        early, pass times before its last one, such as ``np.linspace(0, 300, 301)``.

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The states. A solution of a field that ends, because it escapes to infinity, or overflows,
        is NaN from there on, with one :class:`PoleWarning` that tells when. So is one that takes
        more than 250,000 steps from one time to the next, with a `RuntimeWarning`; then pass more
        times. NaN for a state that contains NaN.

    Raises
    ------
    NotIntegrableError
        If no solution is known for this body: pass its field, :meth:`QuadraticField.of`.
    TypeError, ValueError
        If an argument is out of range, or `rtol` is given for a body.

    Examples
    --------
    Predators and prey (Lotka-Volterra) for three rates, at two times:

    >>> from suslov_fast import QuadraticField, Suslov3D, exact, flow
    >>> family = QuadraticField.from_function(
    ...     lambda x, a: (x[0] - x[0] * x[1], a * (x[0] * x[1] - x[1])), "u v", a=[0.5, 1, 2]
    ... )
    >>> flow(family, [1.0, 0.5], [5.0, 10.0]).shape
    (2, 3, 2)

    How large is the error of the map of a body at time 5, and does half the step size give a
    quarter of it?

    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> motion = flow(body, [1.0, 0.5], time=5.0)
    >>> motion.round(6)
    array([ 0.873751, -1.093725])
    >>> for eps, n in (0.2, 25), (0.1, 50):
    ...     print(abs(exact(body, [1.0, 0.5], eps, n) - motion).max().round(6))
    0.000632
    0.000158
    """
    map = map_of(body)
    if not map.integrates:
        if map.plane is None:
            raise NotIntegrableError(
                f"flow has no exact solution for a {type(body).__name__}: "
                "use flow(QuadraticField.of(body), ...)"
            )
        for name, value in (("rtol", rtol), ("progress", progress)):
            if value is not None:
                problem("flow", body, omega0, 0.0)  # of a body without a solution, says so
                received = f"a {type(body).__name__}, whose solution is exact"
                how = "pass it for fields alone"
                raise TypeError(f"{name} needs a field, not {received}: {how}")
        return _states_at("flow", body, omega0, 0.0, "time", time, threads)
    times, tolerance = _checked_times("time", time), checked_tolerance(rtol)
    try:
        start = check(map, body, omega0, 0.0, threads, name="x")
    except ValueError:
        if times.shape == (len(body._labels),) != np.shape(omega0)[-1:]:
            how = "pass the state first, flow(field, x0, time)"
            raise wrong("x", "the initial state", f"{short(omega0)}, a time: {how}") from None
        raise
    states = motion(start, times.reshape(-1), tolerance, progress)
    return states.reshape(*times.shape, *states.shape[1:])


@public
def limits(body: AnyBody, omega0: ArrayLike, /, eps: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the limits of an orbit of the map as n goes to minus and to plus infinity.

    Orbits go from one steady rotation to the opposite one.

    Parameters
    ----------
    body : Suslov3D, SuslovGyrostat or SuslovND
        A single body, or a batch; in n dimensions one with a :func:`first_integral`.
    omega0 : array_like(float, shape=(..., D))
        State 0 of each orbit.
    eps : array_like(float, shape=(...))
        Step size in time.

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
    plane, from_plane = start.map.plane.reduce(start)
    minus, plus = closed_form.limits(*plane.body.constants, plane.eps, plane.omega)
    return from_plane(minus), from_plane(plus)


def _checked_times(name: str, value: Any) -> FloatArray:
    """Return a number, or an array of one axis."""
    if name == "n" and np.ndim(value) == 0 and value in (np.inf, -np.inf):
        raise wrong("n", "finite", f"{value}: limits returns the limits of an orbit")
    times = np.asarray(real_number(name, value))
    if times.ndim > 1:
        raise wrong(name, "a number or a 1-D array", f"an array of shape {times.shape}")
    return times


def _states_at(
    function: str, body: Any, omega0: Any, eps: Any, name: str, value: Any, threads: int | None
) -> FloatArray:
    """Return states of the map or the flow, and warn of missing ones.

    `name` is that of the argument `value`: "n" for the map, "time" for the flow.
    """
    times = _checked_times(name, value)
    start = problem(function, body, omega0, eps, threads, name="omega0")
    plane, from_plane = start.map.plane.reduce(start)
    batch, threads, flat_times = plane.batch, plane.threads, flat_arrays(times, times.shape, 0)
    starts = flat_arrays(plane.omega, batch)
    orbits = by_constants(plane.body, plane.eps, batch), starts, float(name == "n")
    require(8 * times.size * starts.size, "compute fewer states at a time")
    states, reasons = np.empty((times.size, *starts.shape)), np.zeros((3, len(starts)), bool)
    rows = max(_SLICE // max(len(starts), 1), 1)
    for row in range(0, times.size, rows):
        slice_times = flat_times[row : row + rows]
        work = len(starts) * (_ORBIT_COST + _STATE_COST * len(slice_times))
        data = *orbits, slice_times, states[row:], reasons
        seconds = _IN_PYTHON * (128 + len(starts) * len(slice_times))
        call_kernel(closed_form.states, work, threads, *data, seconds=seconds)
    if np.count_nonzero(reasons):  # faster than `any`, which matters in small calls
        for flags, (reason, category) in zip(reasons, _REASONS, strict=True):
            if flags.any():
                warn(f"{np.count_nonzero(flags)} of {flags.size} orbits: {reason}", category)
    states = np.asarray(from_plane(states.reshape(*times.shape, *batch, 2)))
    if plane is not start:  # exactly, because the reduction rounds
        states[times == 0.0] = start.omega
    return states
