"""Calls of the closed form of the map (Theorem 1) and of the motion, at many times at once."""

from __future__ import annotations

import numpy as np

from ..calls import flat_arrays
from ..checks import FloatArray, warn
from ..core.suslov import closed_form
from ..maps.kernel_arguments import by_constants
from ..maps.kernel_calls import call_kernel
from ..maps.problem import Problem
from ..status import IntegrationWarning

# States per call of the kernel: Python handles Ctrl-C between two calls.
SLICE = 2**21
# Costs of preparing an orbit and of computing a state, in steps of the three-dimensional map.
_ORBIT_COST, _STATE_COST = 64, 8
_IN_PYTHON = 1e-5  # seconds for a state in Python, without Numba; a call costs 128 states more
# Reasons for missing states, in the order of the kernel's flags.
_REASONS = (
    ("no state, because n must be an integer up to 2**53 for so long an eps", RuntimeWarning),
    ("beyond the range of the closed form, 1e8 for X, Y and K: use iterate", RuntimeWarning),
    ("no state directly after a pole of the map", IntegrationWarning),
)


def states_at(problem: Problem, times: FloatArray, is_number: bool) -> FloatArray:
    """Return states of the motion at `times`, or of the map after `times` steps if `is_number`."""
    plane, from_plane = problem.body._in_plane(problem)
    batch = plane.batch
    flat_times, starts = flat_arrays(times, times.shape, 0), flat_arrays(plane.x, batch)
    orbits = by_constants(plane.body, plane.eps, batch), starts, float(is_number)
    states = np.empty((times.size, *starts.shape))
    reasons = np.zeros((3, len(starts)), bool)
    rows = max(SLICE // max(len(starts), 1), 1)
    for row in range(0, times.size, rows):
        slice_times = flat_times[row : row + rows]
        work = len(starts) * (_ORBIT_COST + _STATE_COST * len(slice_times))
        data = *orbits, slice_times, states[row:], reasons
        seconds = _IN_PYTHON * (128 + len(starts) * (2 + len(slice_times)))
        call_kernel(closed_form.states, work, plane.threads, *data, seconds=seconds)
    if np.count_nonzero(reasons):  # faster than `any`, which matters in small calls
        for flags, (reason, category) in zip(reasons, _REASONS, strict=True):
            if flags.any():
                warn(f"{np.count_nonzero(flags)} of {flags.size} orbits: {reason}", category)
    states = states.reshape(*times.shape, *batch, 2)
    if plane is not problem:
        states = np.asarray(from_plane(states))
        states[times == 0.0] = problem.x  # the given states: `from_plane` rounds
    return states
