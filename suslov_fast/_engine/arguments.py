"""The arguments that nearly every public function takes: a body, states and numbers."""

from __future__ import annotations

from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray, common_shape, instance, real_array, rotations, vectors

Body = Suslov3D | SuslovND


def check(
    body: Body,
    states: dict[str, ArrayLike],
    numbers: dict[str, ArrayLike] | None = None,
    dimension: int | None = None,
    orientations: dict[str, ArrayLike] | None = None,
    later: bool = False,
) -> tuple[list[FloatArray], tuple[int, ...]]:
    """All arguments as arrays, in the order given, and the batch shape they broadcast to.

    States have the dimension of the body, unless another is asked for, which only
    three-dimensional bodies have. They may be NaN: no such state. With `later`, infinite ones among
    many are left to who reads them.
    """
    instance("body", body, Suslov3D if dimension else (Suslov3D, SuslovND))
    size = dimension or body.dimension
    checked = {name: vectors(name, value, size, True, later) for name, value in states.items()}
    shapes = {name: array.shape[:-1] for name, array in checked.items()}
    for name, value in (numbers or {}).items():
        checked[name] = real_array(name, value)
        shapes[name] = checked[name].shape
    for name, value in (orientations or {}).items():
        checked[name] = rotations(name, value, body.dimension + 1)
        shapes[name] = checked[name].shape[:-2]
    return list(checked.values()), common_shape(body=body.shape, **shapes)


def components(state: FloatArray) -> tuple[FloatArray, ...]:
    """The components of states, as formulas take them."""
    return tuple(state[..., k] for k in range(state.shape[-1]))
