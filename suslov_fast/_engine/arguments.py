"""Arguments common to most public functions: a body, states and numbers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .. import _checks
from .._bodies.body_3d import Suslov3D, SuslovGyrostat
from .._bodies.body_nd import SuslovND
from .._bodies.field import QuadraticField
from .._checks import FloatArray, aligned, common_shape, instance, real_number, rotations, wrong
from .random_starts import RandomStarts

AnyBody = Suslov3D | SuslovND | SuslovGyrostat
BodyIn3D = Suslov3D | SuslovGyrostat  # whose states are (Omega1, Omega2)
BodyOrField = AnyBody | QuadraticField


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


def check(
    body: Any,
    kinds: Any,
    arguments: dict[str, ArrayLike],
    threads: int | None = None,
    components: tuple[str, ...] | None = None,
    later: bool = False,
) -> States:
    """Check the arguments of a public function.

    The body is one of `kinds`, if any are given. Arguments are states, which have the components of
    the body or those given, and may be NaN, by any name; `eps`; and the rotation `attitude`.
    Scalars become floats; `later` is that of `_checks.states`.
    """
    if kinds:
        instance("body", body, kinds)
    labels = components or body._labels
    omega: Any = None
    eps: Any = 0.0
    orientation, of_states = None, ""
    shapes = {"body": body.shape}
    for name, value in aligned(arguments, labels).items():
        if name == "eps":
            eps = real_number(name, value)
            shapes[name] = () if type(eps) is float else eps.shape
        elif name == "attitude":
            orientation = rotations(name, value, body.dimension + 1)
            shapes[name] = orientation.shape[:-2]
        else:
            if isinstance(value, RandomStarts):
                shape, D = value.shape, len(labels)
                value = value.states(math.prod(shape), dimension=D).reshape(*shape, D)
            omega, of_states = _checks.states(name, value, labels, later), name
            shapes[name] = omega.shape[:-1]
    batch, threads = common_shape(shapes), thread_count(threads)
    return States(body, omega, eps, batch, threads, of_states, orientation)
