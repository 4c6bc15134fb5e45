"""The closed form over a batch and many times, in slices between which Python handles Ctrl-C."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..core import closed_form
from .memory import require
from .threads import call_kernel

# States of a slice: 30 ms, or 130 ms of orbits that turn.
_SLICE = 2**21
# Costs of entering an orbit, and of a state, in steps of the three-dimensional map.
_ENTERING, _STATE = 64, 8


def states_at(
    parameters: tuple[FloatArray, ...],
    omega: FloatArray,
    discrete: bool,
    times: FloatArray,
    threads: int | None,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return states (N, B, 2) at times (N,), and why orbits lack some, the flags (3, B) of kernels.

    The orbits are those of states omega (B, 2), of the map, or else of the flow.
    """
    shape = times.size, *omega.shape
    require(8 * math.prod(shape), "compute fewer states at a time")
    out, reasons = np.empty(shape), np.zeros((3, len(omega)), bool)
    if shape[0] * shape[1] <= _SLICE:
        _fill(threads, parameters, omega, float(discrete), times, out, reasons)
        return out, reasons
    for rows, orbits in _slices(*shape[:2]):
        part = tuple(each if len(each) == 1 else each[orbits] for each in parameters)
        found = np.zeros(reasons[:, orbits].shape, bool)
        states = out[rows, orbits]
        _fill(threads, part, omega[orbits], float(discrete), times[rows], states, found)
        reasons[:, orbits] |= found
    return out, reasons


def _fill(threads: int | None, *arguments: Any) -> None:
    _, omega, _, times, *_ = arguments
    work = len(omega) * (_ENTERING + _STATE * len(times))
    call_kernel(closed_form.states, work, threads, *arguments)


def _slices(times: int, orbits: int) -> Iterator[tuple[slice, slice]]:
    """Yield the times and orbits of each call of the kernel, whose results are contiguous."""
    rows = max(_SLICE // max(orbits, 1), 1)
    width = orbits if rows > 1 else min(_SLICE, orbits)
    for row in range(0, times, rows):
        for first in range(0, orbits, width or 1):
            yield slice(row, row + rows), slice(first, first + width)
