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
    arrays, shapes = [], {"body": body.shape}
    for name, value in states.items():
        arrays.append(vectors(name, value, size, True, later))
        shapes[name] = arrays[-1].shape[:-1]
    for name, value in (numbers or {}).items():
        arrays.append(real_array(name, value))
        shapes[name] = arrays[-1].shape
    for name, value in (orientations or {}).items():
        arrays.append(rotations(name, value, body.dimension + 1))
        shapes[name] = arrays[-1].shape[:-2]
    return arrays, common_shape(**shapes)


def components(state: FloatArray) -> tuple[FloatArray, ...]:
    """The components of states, as formulas take them."""
    return tuple(state[..., k] for k in range(state.shape[-1]))
