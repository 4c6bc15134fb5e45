"""Derivatives of steps in n dimensions and of fields, with twice the digits where many are lost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._bodies.body_nd import SuslovND, in_units
from .._checks import FloatArray
from .._engine import threads as _threads
from .._engine.arguments import States
from .._engine.evaluation import TASKS
from .._engine.execution import ONE_STEP, execute, problem_of
from .._kernels.elimination import ACCURATE, WIDTH
from .._kernels.tangent_map import differentiate, differentiate_twofold
from .._maps import map_of

# Cost of an entry of a derivative per equation, in steps of the 3D map.
_COST = 200


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
    scratch = tuple(np.empty((TASKS, *shape, WIDTH)) for shape in ((D, 2 * D), (D, D), (2, D)))
    arguments = before, after, derivatives, logarithms, ratios, scratch
    _threads.run(differentiate, 2 * before.size * D, states.threads, *arguments)
    doubtful = np.flatnonzero(_are_doubtful(states, ratios))
    if doubtful.size:
        _improve(states, doubtful, derivatives, logarithms)
    return derivatives, logarithms


def _are_doubtful(states: States, ratios: FloatArray) -> NDArray[np.bool_]:
    """Return where elimination with these ratios of pivots lost digits, flat."""
    body = states.body
    doubtful: NDArray[np.bool_] = ratios <= ACCURATE
    # `min` and `max` of all numbers, which are fast, come first.
    if isinstance(body, SuslovND) and body.J.min() < ACCURATE**2 * body.J.max():
        uneven = body.J.min(axis=-1) < ACCURATE**2 * body.J.max(axis=-1)
        doubtful |= np.broadcast_to(uneven, states.batch).ravel()
    return doubtful


def _improve(
    states: States, chosen: NDArray[np.intp], derivatives: FloatArray, logarithms: FloatArray
) -> None:
    """Replace chosen derivatives (count, D, D), and logarithms (count,) of their |det|."""
    body, omega, eps, batch, threads, *_ = states
    fill = _terms_nd if isinstance(body, SuslovND) else _terms_of_field
    terms, half, *vectors = fill(body, omega, np.asarray(eps))
    D = body.dimension
    some = [np.broadcast_to(half, batch).ravel()[chosen]]
    for each in vectors:
        whole = np.broadcast_to(each, (*batch, each.shape[-1]))
        some.append(whole.reshape(-1, each.shape[-1])[chosen])
    better = np.empty((len(chosen), D, D)), np.empty(len(chosen))
    scratch = np.empty((TASKS, D, 2 * D + 1, 3)), np.empty((TASKS, 3, D))
    work = _COST * len(chosen) * D**3
    _threads.run(differentiate_twofold, work, threads, terms, *some, *better, scratch)
    derivatives[chosen], logarithms[chosen] = better


def _terms_nd(body: SuslovND, omega: FloatArray, eps: FloatArray) -> tuple[Any, ...]:
    """Return the terms of J f, half the step size, J, units of omega, coefficients, and states."""
    J, I, _, moments, products = in_units(body)
    i, k = np.nonzero(~np.eye(body.dimension, dtype=bool))
    terms = np.stack([np.concatenate(each) for each in ((i, i), (i, k), (k, k))])
    power = np.frexp(abs(omega).max(axis=-1))[1]
    half = np.ldexp(0.5 * eps, (products - moments)[..., 0] + power)
    unit = np.ldexp(1.0, -(np.frexp(J)[1] // 2))
    state = np.ldexp(omega, -power[..., np.newaxis])
    return terms, half, J, unit, np.concatenate([I[..., k], -I[..., i]], axis=-1), state


def _terms_of_field(body: Any, omega: FloatArray, eps: FloatArray) -> tuple[Any, ...]:
    terms, values = body.terms
    one = np.ones(body.dimension)
    return terms, 0.5 * eps, one, one, values, omega
