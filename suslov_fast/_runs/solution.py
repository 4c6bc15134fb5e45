"""The closed form: any state of the map and of the flow, and the limits of orbits."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.body_nd import SuslovND, check_solved
from .._checks import FloatArray, real_number, warn, wrong
from .._docs import filled
from .._engine.arguments import AnyBody, States, check
from .._engine.closed_form_runs import states_at
from .._engine.reduced_runs import in_3d, reduced_of
from .._engine.status import SingularStepWarning

# Why states are missing, in the order in which kernels count them.
_REASONS = (
    ("no state there, a pole of the map", SingularStepWarning),
    ("no state between two steps where t >= 1", RuntimeWarning),
    ("beyond the range of float64, or of the closed form: use iterate", RuntimeWarning),
)
_RANGE = 2  # the last of them, of which `flow` and `limits` warn
# Of `flow`, in place of a step size: its times are those of the user.
_UNIT_OF_TIME = 1.0


@filled
def exact(
    body: AnyBody, omega0: ArrayLike, eps: ArrayLike, n: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return state n of the map by the closed form, without iteration.

    Parameters
    ----------
    %(rigid_body, omega0, eps)s
    n : array_like(float, shape=() or (N,))
        Indices of the states, positive or negative. For t < 1 (:func:`criticality`) n may be any
        real number, which gives a curve through the orbit; also for a gyrostat that is periodic.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The states. They are NaN directly after a pole, with a :class:`SingularStepWarning`; and,
        with a `RuntimeWarning`, for non-integer n and for ``|n| > 2**53`` if t >= 1, for
        ``|n| > 2**50`` where a gyrostat is periodic, out of the range of float64, and where t >= 1
        and X, Y, e l or e k is above 2e6 (then use :func:`iterate`).

    Raises
    ------
    %(invalid)s
    MemoryError
        If the states do not fit in memory.
    %(not_solved)s

    Notes
    -----
    The formula is Theorem 1 in Section 4 of the paper, corrected, and extended to t >= 1 and to
    the gyrostat, whose phase is known to rounding for up to 1e15 steps.

    %(poles)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, exact, iterate
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> exact(body, [1.0, 0.5], eps=0.2, n=25).round(6)
    array([ 0.873325, -1.093093])
    >>> iterate(body, [1.0, 0.5], eps=0.2, steps=25).final.round(6)
    array([ 0.873325, -1.093093])
    >>> exact(body, [1.0, 0.5], eps=0.2, n=[-(10**12), 0.5, 10**12]).round(6)
    array([[-0.791446,  1.319077],
           [ 1.007482,  0.435551],
           [ 0.791446, -1.319077]])
    """
    times = _times("n", n)
    given = check(body, AnyBody, {"omega0": omega0, "eps": eps}, threads)
    return _states_at("exact", given, times)


@filled
def flow(
    body: AnyBody, omega0: ArrayLike, time: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Return the continuous motion at given times, by its closed form.

    Parameters
    ----------
    %(rigid_body, omega0)s
    time : array_like(float, shape=() or (N,))
        Times, positive or negative, in the unit of time of omega0.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., D) or (N, ..., D))
        The angular velocities; NaN if omega0 is NaN, and, with a `RuntimeWarning`, if they leave
        the range of float64.

    %(Raises: invalid, not_solved)s

    Notes
    -----
    The solution of equation (2) of the paper.

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
    given = check(body, AnyBody, {"omega0": omega0, "eps": _UNIT_OF_TIME}, threads)
    return _states_at("flow", given, _times("time", time))


@filled
def limits(
    body: AnyBody, omega0: ArrayLike, eps: ArrayLike, *, threads: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the limits of an orbit of the map for n to minus and to plus infinity.

    %(Parameters: rigid_body, omega0, eps, threads)s

    Returns
    -------
    omega_minus, omega_plus : ndarray(float, shape=(..., D))
        Opposite points of the line I13 Omega1 + I23 Omega2 = 0, or for a gyrostat points of the
        line I13 Omega1 + I23 Omega2 = -k. A fixed point is its own limit. NaN where a gyrostat is
        periodic, if omega0 is NaN, and for the one state of a body at which the map, or its
        inverse, is undefined.

    %(Raises: invalid, not_solved)s

    Notes
    -----
    This is Proposition 2 in Section 4 of the paper. For eps > 0 the limits are plus and minus
    2 sqrt(I1 I2 h) (I23, -I13) / D, D = I13**2 I2 + I23**2 I1.

    %(poles)s

    Examples
    --------
    >>> from suslov_fast import Suslov3D, limits
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> omega_minus, omega_plus = limits(body, [1.0, 0.5], eps=0.2)
    >>> omega_minus.round(6), omega_plus.round(6)
    (array([-0.791446,  1.319077]), array([ 0.791446, -1.319077]))
    """
    given = check(body, AnyBody, {"omega0": omega0, "eps": eps}, threads)
    omega_minus, omega_plus = _states_at("limits", given, np.array([-np.inf, np.inf]))
    return omega_minus, omega_plus


def _times(name: str, value: Any) -> FloatArray:
    if getattr(value, "dims", ()) not in ((), ("n",), ("time",)):
        raise wrong(name, "values without labels, or along 'n' or 'time'", f"the axes {value.dims}")
    times = np.asarray(real_number(name, value))
    if times.ndim > 1:
        raise ValueError(f"{name}: expected a number or a 1-D array, got shape {times.shape}")
    return times


def _states_at(name: str, given: States, times: FloatArray) -> FloatArray:
    """Return states of the map or the flow at given times, and warn of those that are missing."""
    body, flow = given.body, name == "flow"
    if isinstance(body, SuslovND):
        check_solved(body, name)
        given = in_3d(given) if body.dimension == 2 else given
    if body.dimension == 2:
        states, missing = states_at(given, times, flow)
    else:
        reduced = reduced_of(given)
        in_three, missing = states_at(reduced.states(given.threads), times, flow)
        states = np.empty((*times.shape, *given.batch, body.dimension))
        rows = times.size, len(reduced.state)
        flat = states.reshape((*rows, body.dimension))
        reduced.expand(in_three.reshape((*rows, 2)), flat, 0, given.threads)
        # At time 0 the state is a copy of the input.
        states[times == 0.0] = given.omega
    if np.count_nonzero(missing):
        first, total = 0 if name == "exact" else _RANGE, states.size // states.shape[-1]
        counts = missing.sum(axis=0)[first:]
        for count, (what, category) in zip(counts, _REASONS[first:], strict=True):
            if count:
                warn(f"{count:.0f} of {total} states: {what}", category)
    return states
