"""Problems: the checked arguments of functions of maps, and parts of large batches."""

from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..calls import thread_count
from ..checks import FloatArray, common_shape, real_number, wrong


class Problem(NamedTuple):
    """The checked arguments of a function of a map: a body or field, states, and step sizes."""

    map: Any  # the record of the map, see `map_records`
    body: Any
    x: FloatArray  # states (..., D)
    eps: float | FloatArray  # 0 if there is no step size
    batch: tuple[int, ...]  # the shape to which body, x, eps and orientation broadcast
    threads: int | None = None
    name: str = "x"  # name of the states, in messages
    method: str = "auto"
    orientation: FloatArray | None = None  # rotations (..., n, n) at state 0


Where = tuple[slice, ...]  # a part of each axis of a batch


def part_of(problem: Problem, where: Where) -> Problem:
    """Return the problem of a part of a batch without orientations, as views."""
    body, x, eps = problem.body, problem.x, np.asarray(problem.eps)
    for axis, part in enumerate(along(body.shape, where)):
        body = body._part(axis, part)
    x, eps = x[along(x.shape[:-1], where)], eps[along(eps.shape, where)]
    batch = tuple(part.stop - part.start for part in where)
    return problem._replace(body=body, x=x, eps=eps, batch=batch)


def along(shape: tuple[int, ...], where: Where) -> Where:
    """Return the slices of the part `where` of a batch in an array of a shape that broadcasts."""
    last = where[len(where) - len(shape) :]
    return tuple(slice(0, 1) if n == 1 else part for n, part in zip(shape, last, strict=True))


def check(
    map: Any,
    body: Any,
    x: Any,
    eps: Any = 0.0,
    threads: int | None = None,
    *,
    name: str = "",
    components: tuple[str, ...] | None = None,
    attitude: Any = False,
    method: str | None = None,
    t0: Any = None,
) -> Problem:
    """Return a `Problem` of the checked arguments of a public function.

    States `x` may be NaN; errors call them `name`, by default as the body does. Their `components`
    have by default the names that the body gives. `attitude` is False, or rotations, or True for
    the identity; `t0` is the hidden time of f.
    """
    name, turns = name or body._variable, None
    if components:
        x = checks.states(name, x, components)
    elif t0 is not None and not body._has_eps:
        raise wrong("t0", "left out: a Map takes no time", error=TypeError)
    else:
        x = body._layout.enter(name, x, t0)
    eps = checks.within("eps", real_number("eps", eps), checks.MOMENTS)
    of_eps = () if type(eps) is float else eps.shape
    shapes = {"system": body.shape, name: x.shape[:-1], "eps": of_eps}
    if attitude is not False:
        if map.attitude is None:
            expected = "left out, because states of this map have no orientation"
            raise wrong("attitude", expected, error=TypeError)
        n = body.dimension + 1
        turns = np.eye(n) if attitude is True else checks.rotations("attitude", attitude, n)
        shapes["attitude"] = turns.shape[:-2]
    batch, threads = common_shape(shapes), thread_count(threads)
    method = method or next(iter(map.methods))
    return Problem(map, body, x, eps, batch, threads, name, method, turns)
