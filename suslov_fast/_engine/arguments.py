"""Arguments common to most public functions: a body, states and numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.body_3d import Suslov3D, SuslovGyrostat
from .._bodies.body_nd import SuslovND
from .._bodies.field import QuadraticField
from .._checks import FloatArray, aligned, common_shape, instance, real_number, rotations, wrong
from .._checks import states as checked_states
from .threads import thread_count

AnyBody = Suslov3D | SuslovND | SuslovGyrostat
BodyIn3D = Suslov3D | SuslovGyrostat  # whose states are (Omega1, Omega2)
BodyOrField = AnyBody | QuadraticField
WithoutRotor = Suslov3D | SuslovND

# Names of arguments that are numbers.
_NUMBERS = "eps", "c"


class States(NamedTuple):
    """States of a body, checked."""

    body: Any
    omega: FloatArray  # (..., D)
    eps: float | FloatArray  # 0 if there is no step size
    batch: tuple[int, ...]  # to which all broadcast
    threads: int | None = None
    name: str = "omega"  # of the argument that holds the states


def refuse_rotor(body: object, function: str, instead: str) -> None:
    """Raise TypeError for a body with a rotor, for which a function has no meaning."""
    if isinstance(body, SuslovGyrostat):
        name = type(body).__name__
        raise TypeError(
            f"body: expected one without a rotor, got {name}: instead of {function} use {instead}"
        )


def orientations_of(body: Any, carries_attitude: bool, attitude: Any) -> dict[str, ArrayLike]:
    """Return the argument `attitude` by name, the identity for True, or nothing for False."""
    is_flag = isinstance(attitude, (bool, np.bool_))
    if is_flag and not attitude:
        return {}
    if not carries_attitude:
        expected = f"False, as states of {type(body).__name__} have no orientation"
        raise wrong("attitude", expected, attitude, TypeError)
    return {"attitude": np.eye(body.dimension + 1) if is_flag else attitude}


def check(
    body: BodyOrField,
    kinds: Any,
    arguments: dict[str, ArrayLike],
    components: tuple[str, ...] | None = None,
    later: bool = False,
) -> tuple[list[Any], tuple[int, ...]]:
    """Return all arguments as arrays, in order, and the batch shape that they broadcast to.

    The body is one of `kinds`, if any are given. States have the components of the body or those
    given, and may be NaN; `later` is that of `states`. `attitude` is a rotation, and the arguments
    called `_NUMBERS` are numbers; scalars become floats.
    """
    if kinds:
        instance("body", body, kinds)
    labels = components or body._labels
    arrays: list[Any] = []
    shapes = {"body": body.shape}
    for name, value in aligned(arguments, labels).items():
        if name in _NUMBERS:
            array: Any = real_number(name, value)
            shapes[name] = () if type(array) is float else array.shape
        elif name == "attitude":
            array = rotations(name, value, body.dimension + 1)
            shapes[name] = array.shape[:-2]
        else:
            array = checked_states(name, value, labels, later)
            shapes[name] = array.shape[:-1]
        arrays.append(array)
    return arrays, common_shape(shapes)


def states_of(
    body: BodyOrField,
    kinds: Any,
    arguments: dict[str, ArrayLike],
    threads: int | None,
    components: tuple[str, ...] | None = None,
    later: bool = False,
) -> States:
    """Check the arguments of a public function, the states first, and `threads`; as `check`."""
    arrays, batch = check(body, kinds, arguments, components, later)
    omega, eps = arrays if len(arrays) > 1 else (*arrays, 0.0)
    return States(body, omega, eps, batch, thread_count(threads), next(iter(arguments)))
