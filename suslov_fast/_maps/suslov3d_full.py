"""The three-component scheme, equation (3) of the paper, of a body whose I3 is set."""

from __future__ import annotations

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._engine.iterate import iterate
from .._engine.layout import flat_parameter
from .._engine.problem import Outcome, Problem
from .._kernels.full import full
from .record import Kept, Map


def _parameters(
    body: Suslov3D, eps: float | FloatArray, batch: tuple[int, ...]
) -> list[FloatArray]:
    assert body.I3 is not None
    return [flat_parameter(each, batch) for each in (*body.parameters, eps, body.I3)]


def _run(problem: Problem) -> Outcome:
    return iterate(problem, full, numbers=3, work=2.0)


MAP = Map(
    name="suslov3d_full",
    body=Suslov3D,
    components=lambda body: ("Omega1", "Omega2", "Omega3"),
    methods=("auto",),
    parameters=_parameters,
    run=_run,
    kept=(Kept("state", ("flat", 3)),),
    quantities=frozenset(),
    carries_attitude=False,
)
