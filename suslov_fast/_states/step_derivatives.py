"""Derivatives of steps in n dimensions and of fields."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._bodies.body_nd import SuslovND, is_solved
from .._checks import FloatArray
from .._engine import threads as _threads
from .._engine.arguments import States
from .._engine.evaluation import TASKS, of_state
from .._engine.execution import ONE_STEP, execute
from .._engine.problem import Indices, problem_of
from .._engine.reduced_runs import Reduced, reduction
from .._kernels import quantities_3d as kernels_3d
from .._kernels.elimination import ACCURATE, WIDTH
from .._kernels.tangent_map import differentiate
from .._maps import map_of

# Derivatives of solved bodies are those in three dimensions where |1 - Y| is below this.
_NEAR = 2.0**-10


def jacobian_by(
    slopes: Callable[..., FloatArray], body: Any, omega: FloatArray, eps: FloatArray
) -> FloatArray:
    """Return (1 - S(omega))**-1 (1 + S(omega_next)), where S = (eps/2) f'."""
    states = States(body, omega, eps, omega.shape[:-1])
    before = slopes(states)
    after = slopes(states._replace(omega=next_states(body, omega, eps)))
    return derivatives_of(states, before, after)[0].reshape(before.shape)


def next_states(body: Any, omega: FloatArray, eps: FloatArray) -> FloatArray:
    states = States(body, omega, eps, omega.shape[:-1])
    return execute(problem_of(map_of(body), states, continued=False), ONE_STEP).final


def derivatives_of(
    states: States, slopes: FloatArray, following: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives (count, D, D) of steps and logarithms (count,) of their determinants."""
    D = slopes.shape[-1]
    before, after = slopes.reshape(-1, D, D), following.reshape(-1, D, D)
    derivatives, logarithms, ratios = np.empty(before.shape), *np.empty((2, len(before)))
    scratch = (
        *(np.empty((TASKS, *shape, WIDTH)) for shape in ((D, 2 * D), (D, D), (2, D))),
        *(np.empty((TASKS, 2, *shape)) for shape in ((D, 2 * D), (D, D), (D,))),
    )
    arguments = before, after, derivatives, logarithms, ratios, scratch
    _threads.call_kernel(differentiate, 2 * before.size * D, states.threads, *arguments)
    if isinstance(states.body, SuslovND) and D > 2:
        doubtful = np.flatnonzero(~(ratios > ACCURATE))
        if doubtful.size:
            _reduce(states, doubtful, derivatives, logarithms)
    return derivatives, logarithms


def _reduce(
    states: States, chosen: Indices, derivatives: FloatArray, logarithms: FloatArray
) -> None:
    """Replace chosen derivatives of solved bodies with n > 3 next to Y = 1, where A is nearly
    singular, but the derivative is not large.
    """
    problem = problem_of(map_of(states.body), states, continued=False).take(chosen)
    solved = is_solved(*problem.parameters[:2])
    if not solved.any():
        return
    reduced = reduction(problem.parameters, problem.omega0, states.threads)
    with np.errstate(all="ignore"):
        _, a, _, I23, step = reduced.three.T
        near = abs(1.0 - 0.5 * step * I23 * reduced.state[:, 0] / a) < _NEAR
        near &= reduced.fits & solved
        if near.any():
            better, logs = _derivatives_of_solved(
                Reduced(*(each[near] for each in reduced)), states.threads
            )
            exists, chosen = np.isfinite(logs), chosen[near]
            derivatives[chosen[exists]], logarithms[chosen[exists]] = better[exists], logs[exists]


def _derivatives_of_solved(reduced: Reduced, threads: int | None) -> tuple[FloatArray, FloatArray]:
    """Return derivatives and logarithms of solved bodies; not finite on the line and at poles.

    In the plane of I and omega the derivative is that of the 3D map, which conserves the density
    1 / (x (4 a b + eps**2 x**2)); a displacement orthogonal to it is multiplied by x_next / x.
    """
    (b, a, _, I23, step), three = reduced.three.T, reduced.states(threads)
    m = reduced.along.shape[-1]
    x = np.stack([three.omega, next_states(three.body, three.omega, step)])[..., 1]
    ratio = x[1] / x[0]
    above, below = 1.0 + (0.5 * step * I23 * x[::-1]) ** 2 / (a * b)
    logs = (m - 1) * np.log(abs(ratio)) + np.log(above / below)
    # The kernel warns of states without a derivative, but not of NaN.
    known = np.where(np.isfinite(logs)[:, np.newaxis], three.omega, np.nan)
    ratio = ratio[:, np.newaxis, np.newaxis]
    of_plane = of_state(kernels_3d.jacobian, (2, 2), three._replace(omega=known))
    of_plane -= ratio * np.eye(2)
    plane = np.stack([reduced.along, reduced.across])
    plane /= abs(plane).max(axis=-1, keepdims=True)
    plane /= np.sqrt(sum(np.moveaxis(plane * plane, -1, 0)))[..., np.newaxis]
    derivatives = ratio * np.eye(m)
    for i, j in np.ndindex(2, 2):
        product = plane[i, :, :, np.newaxis] * plane[j, :, np.newaxis]
        derivatives += of_plane[:, i, j, np.newaxis, np.newaxis] * product
    return derivatives, logs
