"""Multipliers of fixed points: those of bodies, and what all have in common."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._bodies.body_3d import SuslovGyrostat
from .._bodies.rigid import in_units
from .._checks import FloatArray, real_array, spell
from .._engine.arguments import States

# A state is fixed if no component of the field is above this part of its terms.
_FIXED = 1e-8


def of_rigid_body(states: States) -> Any:
    """Return the multipliers of a body in three or n dimensions."""
    body, m = states.body, states.body.dimension
    J, I, k, moments, products = in_units(body)
    unit = np.frexp(abs(states.omega).max(axis=-1, keepdims=True, initial=0.0))[1]
    x, k = np.ldexp(states.omega, -unit), np.ldexp(k, -unit)
    others = 1.0 - np.eye(m)  # for sums over the other components, whose terms do not cancel
    p, square, turn = (I * x) @ others, (x * x) @ others, np.zeros(m)
    if m == 2:
        turn = k * x[..., ::-1] * [-1.0, 1.0]
    terms = abs(x) * (abs(I * x) @ others) + abs(I) * square + abs(turn)
    refuse_moving(states, x * p - I * square + turn, terms)
    along = (I * I).sum(axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        if m == 2:
            rates = (p / J).sum(axis=-1, keepdims=True)  # the trace of f'; that along is 0
        else:
            c = (I * x).sum(axis=-1, keepdims=True) / along
            rates = np.where(along > 0.0, c, 0.0) * _spectrum(J, I)
        factor, power = np.frexp(np.asarray(states.eps)[..., np.newaxis])
        half = 0.5 * factor
        power = power + products + unit - moments
        found = np.ones((*states.batch, m), complex if isinstance(body, SuslovGyrostat) else float)
        found[..., 1:] = of_rates(np.ldexp(half * rates, power))
        if k.any():  # at rest, where the line of steady states is not, f' turns
            speed = half * k / (np.sqrt(J[..., :1]) * np.sqrt(J[..., 1:]))
            pair = of_rates(1j * np.ldexp(speed, power) * np.array([1.0, -1.0]))
            found = np.where((x == 0.0).all(axis=-1, keepdims=True) & (k != 0.0), pair, found)
    return in_order(states, found)


def refuse_moving(states: States, field: FloatArray, terms: FloatArray) -> None:
    """Raise ValueError for a state at which the vector field is not 0 to rounding."""
    real_array(states.name, states.omega, allow_nan=True)
    unknown = np.isnan(states.omega).any(axis=-1, keepdims=True)
    moves = (~(abs(field) <= _FIXED * terms) & ~unknown).any(axis=-1)
    moves = np.broadcast_to(moves, states.batch)
    if moves.any():
        first = np.unravel_index(int(np.argmax(moves)), moves.shape)
        where = f", first: {spell(tuple(map(int, first)))}" if first else ""
        count = np.count_nonzero(moves)
        raise ValueError(
            f"{states.name}: expected fixed points of the map, got {count} other states{where}: "
            "use jacobian for the derivative at these"
        )


def of_rates(Y: NDArray[Any]) -> NDArray[Any]:
    """Return (1 + Y) / (1 - Y) for Y = eps mu / 2, inf if Y = 1."""
    large = (1.0 / Y + 1.0) / (1.0 / Y - 1.0)
    return np.where(Y == 1.0, np.inf, np.where(abs(Y) < 1.0, (1.0 + Y) / (1.0 - Y), large))


def in_order(states: States, found: NDArray[Any]) -> NDArray[Any]:
    """Return multipliers in the order of their moduli, NaN for states that are NaN."""
    found = np.broadcast_to(found, (*states.batch, states.body.dimension))
    order = np.lexsort((-found.imag, -abs(found)), axis=-1)
    unknown = np.isnan(states.omega).any(axis=-1, keepdims=True)
    return np.where(unknown, np.nan, np.take_along_axis(found, order, axis=-1))


def _spectrum(J: FloatArray, I: FloatArray) -> FloatArray:
    """Return the spectrum of J**-1 (|I|**2 Id - I I^T) without the 0 of I.

    The sum of I_i**2 / (pole_i - s), with pole_i = |I|**2 / J_i, is 0 for one s between two poles.
    By bisection the error of each s is relative to itself, not to the largest one.
    """
    square = I * I
    poles = square.sum(axis=-1, keepdims=True) / J
    bounds = np.sort(poles, axis=-1)
    low, high = bounds[..., :-1], bounds[..., 1:]
    square, poles = square[..., np.newaxis, :], poles[..., np.newaxis, :]
    for _ in range(80):
        middle = np.where(high > 4.0 * low, np.sqrt(low) * np.sqrt(high), 0.5 * (low + high))
        above = (square / (poles - middle[..., np.newaxis])).sum(axis=-1) < 0.0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return high
