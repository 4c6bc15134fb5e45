"""The Suslov gyrostat: a body with a rotor of constant momentum along the constrained axis."""

from __future__ import annotations

from functools import partial

from .._bodies.body_3d import SuslovGyrostat
from .._engine.layout import for_loops
from .._engine.methods import gyrostat_steps, run_3d
from .registry import Kept, Map

MAP = Map(
    name="suslov_gyrostat",
    body=SuslovGyrostat,
    title="Discrete Suslov gyrostat",
    methods=("auto", "canonical"),
    parameters=for_loops,
    run=partial(run_3d, by_steps=gyrostat_steps),
    kept=(Kept("state", ("flat", 4)), Kept("turn", ("flat", 4), attitude=True)),
    samples=((SuslovGyrostat(1, 1, 1, 0, 0.5), (1.0, -3.875)),),
    conserved=lambda body: ("first_integral",),
)
