"""Runs of the 3D map: by the closed form, or step by step."""

from __future__ import annotations

from .._kernels import maps_3d
from .iterate import iterate
from .jump import jump, jumps
from .problem import Outcome, Problem


def run(problem: Problem) -> Outcome:
    """Find the last states, and how each trajectory ends; fill saved states."""
    return jump(problem, _iterate) if jumps(problem) else _iterate(problem)


def _iterate(problem: Problem) -> Outcome:
    return iterate(problem, maps_3d.printed if problem.method == "ds2" else maps_3d.canonical)
