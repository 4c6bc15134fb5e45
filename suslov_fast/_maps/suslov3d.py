"""The discrete Suslov problem in three dimensions, equation (4) of the paper."""

from __future__ import annotations

from .._bodies.body_3d import Suslov3D
from .._engine.layout import for_loops
from .._engine.methods import run_3d
from .registry import Kept, Map

MAP = Map(
    name="suslov3d",
    body=Suslov3D,
    title="Discrete Suslov problem",
    methods=("auto", "canonical", "ds2"),
    parameters=for_loops,
    run=run_3d,
    kept=(Kept("state", ("flat", 2)), Kept("turn", ("flat", 4), attitude=True)),
    samples=((Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0)),),
    conserved=lambda body: ("first_integral",),
)
