"""The discrete Suslov problem in three dimensions, equation (ds2)."""

from __future__ import annotations

from .._bodies.three import Suslov3D
from .._checks import FloatArray
from .._engine.iterate_3d import run
from .record import Kept, Map


def _parameters(
    body: Suslov3D, eps: float | FloatArray, batch: tuple[int, ...]
) -> list[FloatArray]:
    return body.for_loops(eps, batch)


MAP = Map(
    name="suslov3d",
    body=Suslov3D,
    components=lambda body: ("Omega1", "Omega2"),
    methods=("auto", "canonical", "ds2"),
    parameters=_parameters,
    run=run,
    resume=(Kept("state", (2, "B")), Kept("turn", (4, "B"), attitude=True)),
    quantities=frozenset(
        ("first_integral", "energy", "modified_energy", "criticality", "to_xy", "reaction")
    ),
)
