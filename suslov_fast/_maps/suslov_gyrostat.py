"""The Suslov gyrostat: a body with a rotor of constant momentum along the forbidden axis."""

from __future__ import annotations

from .._bodies.gyrostat import SuslovGyrostat
from .._checks import FloatArray
from .._engine.iterate import iterate
from .._engine.layout import flat_parameter
from .._engine.problem import Outcome, Problem
from .._kernels.gyrostat import gyrostat
from .record import Kept, Map


def _parameters(
    body: SuslovGyrostat, eps: float | FloatArray, batch: tuple[int, ...]
) -> list[FloatArray]:
    # In their own units: the kernel takes out those of each trajectory.
    return [flat_parameter(each, batch) for each in (*body.parameters, eps)]


def _run(problem: Problem) -> Outcome:
    return iterate(problem, gyrostat, numbers=4, work=2.0)


MAP = Map(
    name="suslov_gyrostat",
    body=SuslovGyrostat,
    components=lambda body: ("Omega1", "Omega2"),
    methods=("auto",),
    parameters=_parameters,
    run=_run,
    kept=(
        Kept("state", ("flat", 4)),
        Kept("turn", ("flat", 4), attitude=True),
    ),
    quantities=frozenset(("first_integral", "energy")),
)
