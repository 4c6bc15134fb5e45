"""Runs of the three-component scheme, in which Omega3 need not vanish."""

from __future__ import annotations

import math

import numpy as np

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._core import codes
from .._core.cpu import full_map
from .._core.cpu.blocks import LANES
from .._core.formulas.full_map import full_coefficients
from . import threads
from .layout import flat_parameter
from .problem import Outcome, Problem

# Work of a step, in steps of the 3D map.
_STEP = 2


def parameters(body: Suslov3D, eps: float | FloatArray, batch: tuple[int, ...]) -> list[FloatArray]:
    """The coefficients of the scheme, (8, B)."""
    assert body.I3 is not None
    given = [flat_parameter(each, batch) for each in (*body.parameters, eps, body.I3)]
    with np.errstate(all="ignore"):
        coefficients = full_coefficients(*given)
    size = (math.prod(batch),)
    return [np.stack([np.broadcast_to(each, size) for each in coefficients])]


def run(problem: Problem) -> Outcome:
    """The last states, and how each trajectory ended; saved states are filled on the way.

    The parameters of the problem are those above.
    """
    start = problem.omega
    known = ~np.isnan(start[:, 0])
    if problem.start:
        state = problem.resume["state"].copy()
        status = problem.resume["status"].astype(np.int8)
        failed_at = problem.resume["failed_at"].astype(np.int64)
    else:
        state = np.ascontiguousarray(start.T)
        status = np.where(known, codes.OK, codes.NONFINITE).astype(np.int8)
        failed_at = np.where(known, -1, 0)
        if len(problem.saved):
            problem.saved[0] = start
    for part in problem.parts(_STEP, LANES):
        threads.run(
            full_map.iterate,
            part.work(LANES, _STEP),
            problem.threads,
            *problem.parameters,
            *part,
            problem.every,
            problem.first_row,
            state,
            problem.saved,
            status,
            failed_at,
        )
    final = np.ascontiguousarray(state.T)
    return Outcome(
        final, status, failed_at, {"state": state, "status": status, "failed_at": failed_at}
    )
