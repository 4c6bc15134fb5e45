"""The maps of the package: a record of each, which clients read, and lookup by name or body."""

from __future__ import annotations

import copyreg
import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ._bodies.base import Body, mapping
from ._bodies.body_3d import Suslov3D, SuslovGyrostat
from ._bodies.body_nd import SuslovND, are_solved
from ._bodies.field import QuadraticField
from ._checks import FloatArray, one_of
from ._docs import filled
from ._engine.layout import flat_parameter, for_kernel, for_loops
from ._engine.methods import drivers_3d, drivers_nd, gyrostat_steps
from ._engine.problem import Driver, Kept, Map
from ._engine.stepping import iterate_3d, iterate_field
from ._kernels.blocks import full
from ._kernels.elimination import WIDEST


def _with_I3(body: Suslov3D, eps: float | FloatArray, batch: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the parameters of a body whose I3 is set, eps and I3."""
    assert body.I3 is not None
    return *for_loops(body, eps, batch), flat_parameter(body.I3, batch)


def of_field(body: Body, eps: float | FloatArray, batch: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the terms of a body's field, the step size, and the largest quadratic coefficient."""
    indices, values = body.field().terms
    quadratic = values[..., indices[2] < body.dimension]
    largest = np.abs(quadratic).max(axis=-1, initial=0.0)
    if body.shape:
        size, T = math.prod(batch), len(indices[0])
        rows = np.minimum(np.arange(-(-size // WIDEST) * WIDEST), size - 1)
        values = for_kernel(np.broadcast_to(values, (*batch, T)).reshape(size, T)[rows].T)
    return indices, values, flat_parameter(eps, batch), flat_parameter(largest, batch)


def _conserved_in_nd(body: SuslovND) -> tuple[str, ...]:
    return ("first_integral",) if are_solved(body).all() else ("energy", "modified_energy")


_RECORDS = (
    Map(  # equation (4) of the paper
        name="suslov3d",
        body=Suslov3D,
        title="Discrete Suslov problem",
        methods=("auto", "canonical", "ds2"),
        drivers=drivers_3d,
        kept=(Kept("state", ("flat", 2)), Kept("turn", ("flat", 4), attitude=True)),
        samples=((Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0)),),
        conserved=lambda body: ("first_integral",),
    ),
    Map(  # equation (15)
        name="suslov_nd",
        body=SuslovND,
        title="Discrete Suslov problem in n dimensions",
        methods=("auto", "gauss", "rank2"),
        drivers=drivers_nd,
        kept=(
            Kept("state", ("flat", "component")),
            Kept("exponent", ("flat",)),
            Kept("columns", ("flat", "space", "space"), attitude=True),
        ),
        samples=(
            # Steps in O(n) do not suffice: J_i = eps p / 2 for two i.
            (SuslovND([1.0, 1.0, 2.0], [0.5, -0.75, 0.5]), (1.0, -1.0, 1.5)),
            (SuslovND([1.0, 1.0, 1.0], [0.5, -0.75, 0.5]), (1.0, -1.0, 1.5)),
        ),
        conserved=_conserved_in_nd,
    ),
    Map(  # equation (3)
        name="suslov3d_full",
        body=Suslov3D,
        title="Suslov problem in three components",
        parameters=_with_I3,
        drivers=lambda problem, span: (Driver(partial(iterate_3d, kernel=full, step=2.0)),),
        kept=(Kept("state", ("flat", 3)),),
        samples=((Suslov3D(1, 1, 0.25, 0, 1.5), (4.0, -12.0, 0.5)),),
        components=lambda body: ("Omega1", "Omega2", "Omega3"),
    ),
    Map(
        name="suslov_gyrostat",
        body=SuslovGyrostat,
        title="Discrete Suslov gyrostat",
        methods=("auto", "canonical"),
        drivers=partial(drivers_3d, by_steps=gyrostat_steps),
        kept=(Kept("state", ("flat", 4)), Kept("turn", ("flat", 4), attitude=True)),
        samples=((SuslovGyrostat(1, 1, 1, 0, 0.5), (1.0, -3.875)),),
        conserved=lambda body: ("first_integral",),
    ),
    Map(
        name="quadratic",
        body=QuadraticField,
        title="Kahan map of a quadratic field",
        parameters=of_field,
        drivers=lambda problem, span: (Driver(iterate_field),),
        kept=(Kept("state", ("flat", "component")),),
        # x' = x**2, whose map has a pole at 1 / eps.
        samples=((QuadraticField([[[1]]]), (1.0,)),),
        conserved=lambda body: () if body.H is None else ("energy", "modified_energy"),
        variable="x",
        meaning="state",
    ),
)
# The first map of a class of bodies is that of `iterate`.
MAPS = {record.name: record for record in _RECORDS}


def map_named(name: str) -> Map:
    """Return the map of a name; ValueError if there is none."""
    if name not in MAPS:
        raise ValueError(f"map: expected {' or '.join(MAPS)}, got {name!r}")
    return MAPS[name]


# A record is pickled by its name, since it may hold functions that cannot be pickled.
copyreg.pickle(Map, lambda record: (map_named, (record.name,)))


def map_of(body: Any) -> Map:
    """Return the map of a body, or of an object of a subclass: that of `iterate`."""
    for record in MAPS.values():
        if isinstance(body, record.body):
            return record
    received = f"the class {body.__name__}" if isinstance(body, type) else type(body).__name__
    raise TypeError(f"body: expected {' or '.join(_classes())}, got {received}")


def _classes() -> dict[str, Any]:
    return {record.body.__name__: record.body for record in MAPS.values()}


@filled
def body_from_dict(parameters: Mapping[str, Any]) -> Any:
    """Return the body that its method `to_dict` described, of any class.

    %(Parameters: parameters)s

    Returns
    -------
    body
        A body or a field.

    %(Raises: invalid)s

    Examples
    --------
    >>> from suslov_fast import SuslovND, body_from_dict
    >>> body_from_dict(SuslovND(J=[1.3, 2.1], I=[0.4, -0.7]).to_dict())
    SuslovND(J=[1.3, 2.1], I=[0.4, -0.7])
    """
    kinds = _classes()
    return kinds[one_of("body", mapping(parameters).get("body"), [*kinds])].from_dict(parameters)
