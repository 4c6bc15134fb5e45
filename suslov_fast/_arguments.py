"""The arguments that nearly every public function takes: a body, states and numbers."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ._bodies import Suslov3D
from ._validation import FloatArray, common_shape, instance, real_array, vectors


def check(
    body: Suslov3D,
    states: dict[str, ArrayLike],
    numbers: dict[str, ArrayLike] | None = None,
    dimension: int = 2,
    allow_nan: bool = False,
) -> tuple[list[FloatArray], tuple[int, ...]]:
    """All arguments as arrays, in the order given, and the batch shape they broadcast to.

    Only stored trajectories may hold NaN.
    """
    instance("body", body, Suslov3D)
    checked = {name: vectors(name, value, dimension, allow_nan) for name, value in states.items()}
    shapes = {name: array.shape[:-1] for name, array in checked.items()}
    for name, value in (numbers or {}).items():
        checked[name] = real_array(name, value)
        shapes[name] = checked[name].shape
    return list(checked.values()), common_shape(body=body.shape, **shapes)


def components(state: FloatArray) -> tuple[FloatArray, ...]:
    """The components of states, as formulas take them."""
    return tuple(state[..., k] for k in range(state.shape[-1]))
