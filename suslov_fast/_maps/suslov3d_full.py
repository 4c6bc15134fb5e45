"""The three-component scheme, equation (ds), of a body whose I3 is set."""

from __future__ import annotations

from .._bodies.three import Suslov3D
from .._engine.iterate_full import parameters, run
from .record import Kept, Map

MAP = Map(
    name="suslov3d_full",
    body=Suslov3D,
    components=lambda body: ("Omega1", "Omega2", "Omega3"),
    methods=("auto",),
    parameters=parameters,
    run=run,
    resume=(
        Kept("state", (3, "B")),
        Kept("status", ("B",), "int8"),
        Kept("failed_at", ("B",), "int64"),
    ),
    quantities=frozenset(),
    carries_attitude=False,
)
