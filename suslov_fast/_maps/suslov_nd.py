"""The discrete Suslov problem in n dimensions, equation (15) of the paper."""

from __future__ import annotations

from .._bodies.body_nd import SuslovND, are_solved
from .._engine.layout import for_loops
from .._engine.methods import run_nd
from .registry import Kept, Map


def _conserved(body: SuslovND) -> tuple[str, ...]:
    return ("first_integral",) if are_solved(body).all() else ("energy", "modified_energy")


MAP = Map(
    name="suslov_nd",
    body=SuslovND,
    title="Discrete Suslov problem in n dimensions",
    methods=("auto", "gauss", "rank2"),
    parameters=for_loops,
    run=run_nd,
    kept=(
        Kept("state", ("flat", "component")),
        Kept("exponent", ("flat",)),
        Kept("columns", ("flat", "space", "space"), attitude=True),
    ),
    samples=(
        (SuslovND([1.0, 1.5, 2.0], [0.4, -0.7, 0.5]), (1.0, -3.0, 0.5)),
        (SuslovND([1.0, 1.0, 1.0], [0.4, -0.7, 0.5]), (1.0, -3.0, 0.5)),
    ),
    conserved=_conserved,
)
