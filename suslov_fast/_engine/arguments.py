"""The arguments that nearly every public function takes: a body, states and numbers."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray, aligned, common_shape, instance, real_number, rotations, states

Body = Suslov3D | SuslovND


def check(
    body: Body,
    given: dict[str, ArrayLike],
    numbers: dict[str, ArrayLike] | None = None,
    dimension: int | None = None,
    orientations: dict[str, ArrayLike] | None = None,
    later: bool = False,
    kinds: type[Any] | tuple[type[Any], ...] = (Suslov3D, SuslovND),
) -> tuple[list[Any], tuple[int, ...]]:
    """All arguments as arrays, in the order given, and the batch shape they broadcast to.

    Single numbers become floats. The body is one of `kinds`. States have the dimension of the
    body, unless another is asked for. They may be NaN: no such state. With `later`,
    infinite ones among many are left to who reads them.
    """
    instance("body", body, kinds)
    size = dimension or body.dimension
    arrays: list[Any] = []
    shapes = {"body": body.shape}
    values = aligned({**given, **(numbers or {}), **(orientations or {})})
    for name in given:
        arrays.append(array := states(name, values[name], size, later))
        shapes[name] = array.shape[:-1]
    if numbers:
        for name in numbers:
            arrays.append(number := real_number(name, values[name]))
            shapes[name] = () if isinstance(number, float) else number.shape
    if orientations:
        for name in orientations:
            arrays.append(array := rotations(name, values[name], body.dimension + 1))
            shapes[name] = array.shape[:-2]
    return arrays, common_shape(shapes)


def components(state: FloatArray) -> tuple[FloatArray, ...]:
    """The components of states, as formulas take them."""
    return tuple(state[..., k] for k in range(state.shape[-1]))
