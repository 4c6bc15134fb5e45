"""The discrete Suslov problem in n dimensions, equation (15) of the paper."""

from __future__ import annotations

from .._bodies.nd import SuslovND
from .._engine.jump import run_nd
from .._engine.layout import for_loops
from .record import Kept, Map

MAP = Map(
    name="suslov_nd",
    body=SuslovND,
    components=lambda body: tuple(f"Omega{i + 1}n" for i in range(body.dimension)),
    methods=("auto", "gauss", "rank2"),
    parameters=for_loops,
    run=run_nd,
    kept=(
        Kept("state", ("flat", "component")),
        Kept("exponent", ("flat",)),
        Kept("columns", ("flat", "space", "space"), attitude=True),
    ),
    quantities=frozenset(
        ("first_integral", "energy", "modified_energy", "criticality", "reaction")
    ),
)
