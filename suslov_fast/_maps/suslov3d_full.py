"""The three-component scheme, equation (3) of the paper, of a body whose I3 is set."""

from __future__ import annotations

from functools import partial

from .._bodies.body_3d import Suslov3D
from .._checks import FloatArray
from .._engine.layout import flat_body, flat_parameter
from .._engine.stepping import iterate
from .._kernels.blocks import full
from .registry import Kept, Map


def _parameters(
    body: Suslov3D, eps: float | FloatArray, batch: tuple[int, ...]
) -> tuple[FloatArray, ...]:
    assert body.I3 is not None
    others = (flat_parameter(each, batch) for each in (eps, body.I3))
    return *flat_body(body, batch), *others


MAP = Map(
    name="suslov3d_full",
    body=Suslov3D,
    title="Suslov problem in three components",
    methods=("auto",),
    parameters=_parameters,
    run=partial(iterate, kernel=full, step=2.0),
    kept=(Kept("state", ("flat", 3)),),
    samples=((Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0, 0.5)),),
    carries_attitude=False,
    components=lambda body: ("Omega1", "Omega2", "Omega3"),
)
