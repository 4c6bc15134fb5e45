"""Arguments common to most public functions: a body, states and numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import _checks
from .._bodies.body_3d import Suslov3D, SuslovGyrostat
from .._bodies.body_nd import SuslovND
from .._bodies.field import QuadraticField
from .._checks import FloatArray, aligned, common_shape, instance, real_number, rotations, wrong

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
    orientation: FloatArray | None = None  # (..., n, n)


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
            array = _checks.states(name, value, labels, later)
            shapes[name] = array.shape[:-1]
        arrays.append(array)
    return arrays, common_shape(shapes)


def thread_count(threads: int | None) -> int | None:
    """Check the `threads` argument of a public function."""
    if threads is None:
        return None
    import numba  # which the command does without until it computes

    limit = int(numba.config.NUMBA_NUM_THREADS)
    expected = f"None or an integer from 1 to {limit} (NUMBA_NUM_THREADS)"
    count = _checks.integer("threads", threads, 1, expected)
    if count > limit:
        raise ValueError(f"threads: expected {expected}, got {count}")
    return count


def states_of(
    body: BodyOrField,
    kinds: Any,
    arguments: dict[str, ArrayLike],
    threads: int | None,
    components: tuple[str, ...] | None = None,
    later: bool = False,
) -> States:
    """Check `threads`, and by `check` states and, if given, step sizes and orientations."""
    arrays, batch = check(body, kinds, arguments, components, later)
    absent: list[Any] = [None, 0.0, None]
    omega, eps, orientation = arrays + absent[len(arrays) :]
    name = next(iter(arguments))
    return States(body, omega, eps, batch, thread_count(threads), name, orientation)
