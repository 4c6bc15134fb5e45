"""Arguments common to most public functions: a body, states and numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.body_3d import Suslov3D
from .._bodies.body_gyrostat import SuslovGyrostat
from .._bodies.body_nd import SuslovND
from .._bodies.field import QuadraticField
from .._checks import aligned, common_shape, instance, real_number, rotations, states, wrong

AnyBody = Suslov3D | SuslovND | SuslovGyrostat
BodyOrField = AnyBody | QuadraticField
WithoutRotor = Suslov3D | SuslovND


# Bodies whose states are (Omega1, Omega2).
IN_3D = Suslov3D, SuslovGyrostat


def refuse_rotor(body: object, function: str, instead: str) -> None:
    """Raise TypeError for a body with a rotor, for which a function has no meaning."""
    if isinstance(body, SuslovGyrostat):
        name = type(body).__name__
        raise TypeError(
            f"body: expected one without a rotor, got {name}: instead of {function} use {instead}"
        )


def orientations_of(body: Any, carries_attitude: bool, attitude: Any) -> dict[str, ArrayLike]:
    """Return the argument `attitude` by name if orientations are asked for: the identity for True.

    Raises TypeError where a map carries none.
    """
    is_flag = isinstance(attitude, (bool, np.bool_))
    if is_flag and not attitude:
        return {}
    if not carries_attitude:
        expected = f"False, as states of {type(body).__name__} have no orientation"
        raise wrong("attitude", expected, attitude, TypeError)
    return {"attitude": np.eye(body.dimension + 1) if is_flag else attitude}


def check(
    body: BodyOrField,
    by_name: dict[str, ArrayLike],
    numbers: dict[str, ArrayLike] | None = None,
    components: tuple[str, ...] | None = None,
    orientations: dict[str, ArrayLike] | None = None,
    kinds: type[Any] | tuple[type[Any], ...] = (Suslov3D, SuslovND),
) -> tuple[list[Any], tuple[int, ...]]:
    """Return all arguments as arrays, in order, and the batch shape that they broadcast to.

    The body is one of `kinds`. States, in `by_name`, have the components of the body or those
    given, and may be NaN. Scalars become floats.
    """
    instance("body", body, kinds)
    numbers, orientations = numbers or {}, orientations or {}
    labels = components or body._labels
    values = aligned(by_name | numbers | orientations, labels)
    arrays: list[Any] = []
    shapes = {"body": body.shape}
    for name in by_name:
        arrays.append(state := states(name, values[name], labels))
        shapes[name] = state.shape[:-1]
    for name in numbers:
        arrays.append(number := real_number(name, values[name]))
        shapes[name] = () if isinstance(number, float) else number.shape
    for name in orientations:
        arrays.append(matrix := rotations(name, values[name], body.dimension + 1))
        shapes[name] = matrix.shape[:-2]
    return arrays, common_shape(shapes)
