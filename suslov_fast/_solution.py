"""The solved problem: any state of the map, any state of the flow, and where orbits tend."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from ._bodies.nd import SuslovND
from ._bodies.reduction import Reduction, reduce
from ._bodies.three import Suslov3D
from ._checks import FloatArray, real_array
from ._core.cpu import closed_form as loops
from ._core.formulas import coordinates, integrals
from ._engine import threads
from ._engine.arguments import Body, check, components
from ._engine.elementwise import evaluate
from ._engine.layout import flat_parameter, flat_vectors, for_kernel
from ._status import SingularStepWarning


def exact(body: Body, omega0: ArrayLike, eps: ArrayLike, n: ArrayLike) -> FloatArray:
    """State n of the map, by the closed form: no iteration, the same time for every n.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., D))
        State 0.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0.
    n : array_like(float, shape=() or (N,))
        Numbers of the states wanted, of either sign and up to 2**53 in size. While t < 1
        (:func:`criticality`) n may be any real number: the curve through the orbit.

    Returns
    -------
    ndarray(float, shape=(..., D) or (..., N, D))
        The states; NaN where there is none: at a pole, with a :class:`SingularStepWarning`, and
        for n that is not an integer where t >= 1, with a `RuntimeWarning`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    NotIntegrableError
        If no closed form is known for the body; all in three dimensions have one.

    Notes
    -----
    The theorem of Section 4, corrected, and extended to t >= 1, where the paper is silent.

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
    (state, step_size), batch = check(body, {"omega0": omega0}, {"eps": eps})
    numbers = _times("n", n)
    if isinstance(body, SuslovND):
        reduction = reduce(body, "exact")
        states = _fill_nd(reduction, state, step_size, batch, numbers, flow=False)
    else:
        states = _fill(body, state, step_size, batch, numbers, flow=False)
    missing = np.isnan(states[..., 0])
    if missing.any():
        between = numbers != np.floor(numbers)
        _warn(missing & between, "no state between two steps where t >= 1", RuntimeWarning)
        _warn(missing & ~between, "no state there, a pole of the map", SingularStepWarning)
    return states


def flow(body: Body, omega0: ArrayLike, t: ArrayLike) -> FloatArray:
    """The continuous motion at time t, by its closed form.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., D))
        The angular velocity at time 0.
    t : array_like(float, shape=() or (N,))
        Times, of either sign and any size, in the unit of time of omega0.

    Returns
    -------
    ndarray(float, shape=(..., D) or (..., N, D))
        The angular velocities.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    NotIntegrableError
        If no closed form is known for the body; all in three dimensions have one.

    Notes
    -----
    The solution of equation (s1).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, energy, flow
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> states = flow(body, [1.0, 0.5], t=[0.0, 5.0, 1e6])
    >>> states.round(6)
    array([[ 1.      ,  0.5     ],
           [ 0.873751, -1.093725],
           [ 0.791864, -1.319774]])
    >>> energy(body, states).round(12)
    array([2.125, 2.125, 2.125])
    """
    (state,), batch = check(body, {"omega0": omega0})
    times = _times("t", t)
    if isinstance(body, SuslovND):
        return _fill_nd(reduce(body, "flow"), state, np.array(1.0), batch, times, flow=True)
    return _fill(body, state, np.array(1.0), batch, times, flow=True)


def limits(body: Body, omega0: ArrayLike, eps: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Where an orbit of the map comes from and where it goes.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., D))
        A state of the orbit.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0.

    Returns
    -------
    omega_minus, omega_plus : ndarray(float, shape=(..., D))
        The limits for n to minus and to plus infinity: opposite points of the line
        I13 Omega1 + I23 Omega2 = 0. A state that does not move is its own limit.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.
    NotIntegrableError
        If no closed form is known for the body; all in three dimensions have one.

    Notes
    -----
    The last proposition of Section 4, with the points on the line: for eps > 0 the limits are
    plus and minus 2 sqrt(I1 I2 h) (I23, -I13) / D, D = I13**2 I2 + I23**2 I1.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, limits
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> omega_minus, omega_plus = limits(body, [1.0, 0.5], eps=0.2)
    >>> omega_minus.round(6), omega_plus.round(6)
    (array([-0.791446,  1.319077]), array([ 0.791446, -1.319077]))
    """
    (state, step_size), batch = check(body, {"omega0": omega0}, {"eps": eps})
    if isinstance(body, SuslovND):
        reduction = reduce(body, "limits")
        ends = limits(reduction.three, reduction.state(state), step_size)
        return reduction.back(ends[0], state), reduction.back(ends[1], state)
    parameters = (*body.normalised, body.normalised_eps(step_size))
    XY = evaluate(coordinates.to_canonical, batch, *parameters, *components(state))[..., :2]
    frame = evaluate(coordinates.from_canonical, batch, *parameters)
    level = np.asarray(evaluate(integrals.level, batch, *components(XY)))
    moves = (XY[..., 0] != 0) & (abs(XY).sum(axis=-1) >= coordinates.MOTIONLESS)
    # (X, Y) tends to (0, T) and (0, -T): only the second column of the frame counts.
    with np.errstate(all="ignore"):  # where nothing moves there is no frame
        far = level[..., np.newaxis] * frame[..., 1::2]
    moves = moves[..., np.newaxis]
    return np.where(moves, far, state), np.where(moves, -far, state)


def _times(name: str, value: ArrayLike) -> FloatArray:
    times = real_array(name, value)
    if times.ndim > 1:
        raise ValueError(f"{name}: expected a number or a 1-D array, got shape {times.shape}")
    return times


def _fill(
    body: Suslov3D,
    state: FloatArray,
    step_size: FloatArray,
    batch: tuple[int, ...],
    times: FloatArray,
    flow: bool,
) -> FloatArray:
    eps = flat_parameter(body.normalised_eps(step_size), batch)
    states = flat_vectors(state, batch)
    flat_times = for_kernel(times.reshape(-1))
    out = np.empty((len(states), flat_times.size, 2))
    threads.run(
        loops.fill,
        out.size // 2 * loops.WORK,
        None,
        flow,
        *body.flat_normalised(batch),
        eps,
        states,
        flat_times,
        out,
    )
    return out.reshape((*batch, *times.shape, 2))


def _fill_nd(
    reduction: Reduction,
    state: FloatArray,
    step_size: FloatArray,
    batch: tuple[int, ...],
    times: FloatArray,
    flow: bool,
) -> FloatArray:
    """The same for an n-dimensional body; at time 0 the given state itself."""
    of_three = _fill(reduction.three, reduction.state(state), step_size, batch, times, flow)
    if times.ndim:
        reduction, state = reduce(reduction.body.along_time(), ""), state[..., np.newaxis, :]
    states = reduction.back(of_three, state)
    return np.where((times == 0)[..., np.newaxis], state, states)


def _warn(missing: FloatArray, what: str, category: type[Warning]) -> None:
    if missing.any():
        count = np.count_nonzero(missing)
        warnings.warn(f"{count} of {missing.size} states: {what}", category, stacklevel=3)
