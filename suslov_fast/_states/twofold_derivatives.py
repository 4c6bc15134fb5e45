"""Derivatives of steps with twice the digits, where elimination loses too many."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._bodies.body_nd import SuslovND, in_units
from .._checks import FloatArray
from .._engine import threads as _threads
from .._engine.arguments import States
from .._engine.evaluation import TASKS
from .._kernels.elimination import ACCURATE
from .._kernels.tangent_map import differentiate_twofold

# Cost of an entry of a derivative per equation, in steps of the 3D map.
_COST = 200


def are_doubtful(states: States, ratios: FloatArray) -> NDArray[np.bool_]:
    """Return where elimination with these ratios of pivots lost digits, flat."""
    body = states.body
    doubtful: NDArray[np.bool_] = ratios <= ACCURATE
    # `min` and `max` of all numbers, which are fast, come first.
    if isinstance(body, SuslovND) and body.J.min() < ACCURATE**2 * body.J.max():
        uneven = body.J.min(axis=-1) < ACCURATE**2 * body.J.max(axis=-1)
        doubtful |= np.broadcast_to(uneven, states.batch).ravel()
    return doubtful


def improve(states: States, chosen: NDArray[np.intp], found: tuple[FloatArray, FloatArray]) -> None:
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
    for array, values in zip(found, better, strict=True):
        array[chosen] = values


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
