"""Arguments of most public functions: random starts, checked problems, arguments of kernels."""

import math
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies.field import QuadraticField
from ..bodies.nd import SuslovND
from ..bodies.rigid import Suslov3D, SuslovGyrostat
from ..checks import FloatArray, common_shape, integer, positive, real_number, wrong
from ..core.steps_field import FieldSystem, method_of, system_of
from ..core.steps_nd import FAR_FROM_0, NDSystem

AnyBody = Suslov3D | SuslovND | SuslovGyrostat
BodyIn3D = Suslov3D | SuslovGyrostat  # whose states are (Omega1, Omega2)
BodyOrField = AnyBody | QuadraticField


# Those of the package, and of maps that `maps.register` made known.
Method = Literal["auto", "gauss", "rank2", "order4", "order6", "order8"] | str

# Requests up to this many bytes are not tested, for speed; as many bytes are kept free.
SMALL = 2**26


def require(nbytes: int, what_to_do: str) -> None:
    """Raise MemoryError if `nbytes` are not available: Linux lends more, and kills the process."""
    if nbytes <= SMALL or not os.path.exists("/proc/meminfo"):
        return
    text = Path("/proc/meminfo").read_text("ascii", "replace")
    found = re.search(r"MemAvailable: *(\d+)", text)
    free = 1024 * int(found[1]) if found else math.inf
    if nbytes > free - SMALL:
        raise MemoryError(
            f"the arrays need {nbytes:,} bytes, and {free:,} bytes of memory are available: "
            f"{what_to_do}"
        )


@dataclass(frozen=True)
class RandomStarts:
    """Random initial states for :func:`ensemble` or :func:`iterate`, uniform in a cube around 0.

    State i depends on the seed and on i alone, and is computed when it is needed.

    Parameters
    ----------
    size : int or tuple of int
        Number of states, or the shape of the batch.
    extent : float
        Each component lies in [-extent, extent), in the unit of the states.
    seed : int
        0 or more.

    Examples
    --------
    >>> from suslov_fast import RandomStarts
    >>> starts = RandomStarts(10**9, extent=2.0, seed=1)
    >>> starts.states(2, start=999_999_998).shape
    (2, 2)
    """

    size: int | tuple[int, ...]
    extent: float
    seed: int = 0

    def __post_init__(self) -> None:
        lengths = self.size if isinstance(self.size, (tuple, list)) else [self.size]
        size = tuple(integer("size", length, 0) for length in lengths)
        extent, seed = positive("extent", self.extent), integer("seed", self.seed, 0)
        vars(self).update(size=size[0] if len(size) == 1 else size, extent=extent, seed=seed)

    @property
    def shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return (self.size,) if isinstance(self.size, int) else self.size

    def states(self, count: int, start: int = 0, dimension: int = 2) -> FloatArray:
        """Return the states `start` to `start + count`, shape (count, dimension)."""
        count, start = integer("count", count, 0), integer("start", start, 0)
        dimension = integer("dimension", dimension, 1)
        require(32 * count * dimension, "use fewer initial states, or ensemble")
        # One value of the counter gives four 64-bit words.
        first, skipped = divmod(start * dimension, 4)
        generator = np.random.Philox(key=self.seed, counter=first)
        words = generator.random_raw(skipped + count * dimension)
        unit = (words[skipped:] >> np.uint64(11)) * 2.0**-53
        states: FloatArray = np.asarray((2.0 * unit - 1.0) * self.extent, np.float64)
        return states.reshape(count, dimension)

    def _part(self, where: tuple[slice, ...], dimension: int) -> FloatArray:
        """Return the states (..., D) of a part of the batch, given by a slice for each axis."""
        *outer, inner = [range(part.start, part.stop) for part in where] or [range(1)]
        begins, shape = product(*outer, inner[:1]), self.shape or (1,)
        rows = [
            self.states(len(inner), int(np.ravel_multi_index(begin, shape)), dimension)
            for begin in begins
        ]
        return np.reshape(rows, (*(part.stop - part.start for part in where), dimension))


class Problem(NamedTuple):
    """A checked problem: states of a body and a step size, for a map."""

    map: Any  # the record of the map, see `maps.Map`
    body: Any
    omega: FloatArray  # (..., D)
    eps: float | FloatArray  # 0 if there is no step size
    batch: tuple[int, ...]  # to which all broadcast
    threads: int | None = None
    name: str = "omega"  # of the argument that holds the states
    method: str = "auto"
    orientation: FloatArray | None = None  # (..., n, n)


Where = tuple[slice, ...]  # a part of each axis of a batch


def part_of(problem: Problem, where: Where) -> Problem:
    """Return the problem of a part of the batch, without copies; it keeps `RandomStarts`."""
    _, body, omega, eps, *_, turns = problem
    for axis, part in enumerate(along(body.shape, where)):
        body = body._part(axis, part)
    if not isinstance(omega, RandomStarts):
        omega = omega[along(omega.shape[:-1], where)]
    if type(eps) is not float:
        eps = np.asarray(eps)
        eps = eps[along(eps.shape, where)]
    if turns is not None:
        turns = turns[along(turns.shape[:-2], where)]
    batch = tuple(part.stop - part.start for part in where)
    return problem._replace(body=body, omega=omega, eps=eps, batch=batch, orientation=turns)


def along(shape: tuple[int, ...], where: Where) -> Where:
    """Return the slices, for a part of the batch, of an array that broadcasts to the batch."""
    last = where[len(where) - len(shape) :]
    return tuple(slice(0, 1) if n == 1 else each for n, each in zip(shape, last, strict=True))


def check(
    map: Any,
    body: Any,
    omega: Any,
    eps: Any = 0.0,
    threads: int | None = None,
    *,
    name: str = "omega",
    components: tuple[str, ...] | None = None,
    attitude: Any = False,
    later: bool = False,
    method: str = "auto",
) -> Problem:
    """Check the arguments of a public function that takes states of a body, for a map of it.

    Messages call the states `name`, or x if the map does; they may be NaN, and have `components`,
    by default those of the body. `attitude` is a bool or rotations, `later` as for
    `checks.states`.
    """
    labels, turns = components or body._labels, None
    if components is None and len(labels) != body.dimension:
        expected = f"have {body.dimension} entries, the dimension of {type(body).__name__}"
        raise wrong("_labels", expected, checks.short(labels))
    if map.variable == "x":
        name = "x"
    if isinstance(omega, RandomStarts):
        states = omega.states(math.prod(omega.shape), 0, len(labels))
        omega = states.reshape(*omega.shape, len(labels))
    omega = checks.states(name, omega, labels, later)
    eps = checks.within("eps", real_number("eps", eps), checks.MOMENTS)
    shapes = {"body": body.shape, name: omega.shape[:-1]}
    shapes["eps"] = () if type(eps) is float else eps.shape
    if attitude is not False:
        if "attitude" not in map.formulas:
            expected = "left out, because states of this map have no orientation"
            raise wrong("attitude", expected, error=TypeError)
        n = body.dimension + 1
        if map.formulas["attitude"].compute is True and n != 3:
            raise wrong("attitude", "IN_ROWS, because states have not two components", "AXIAL")
        turns = np.eye(n) if attitude is True else checks.rotations("attitude", attitude, n)
        shapes["attitude"] = turns.shape[:-2]
    batch, threads = common_shape(shapes), thread_count(threads)
    return Problem(map, body, omega, eps, batch, threads, name, method, turns)


def thread_count(threads: int | None) -> int | None:
    if threads is None:
        return None
    import numba  # which the command does without until it computes

    limit = int(numba.config.NUMBA_NUM_THREADS)
    expected = f"None or an integer from 1 to {limit} (NUMBA_NUM_THREADS)"
    return integer("threads", threads, 1, expected, limit)


def flat_arrays(array: FloatArray, batch: tuple[int, ...], axes: int = 1) -> FloatArray:
    """Return arrays (..., D), or with `axes` axes each, as (B, D): one for each trajectory."""
    split = array.ndim - axes
    inner = array.shape[split:]
    if array.shape[:split] != batch:
        array = np.broadcast_to(array, (*batch, *inner))
    flat = array.reshape((math.prod(batch), *inner) if batch else (1, *inner))
    # The only type that kernels are compiled for.
    return flat if flat.flags.carray else np.require(flat, np.float64, ["C", "A", "W"])


def flat_parameter(value: float | FloatArray, batch: tuple[int, ...], axes: int = 0) -> FloatArray:
    """Return a parameter with `axes` axes as (1, ...) if common to the whole batch, or (B, ...)."""
    if type(value) is float:
        return np.array([value])
    array = np.asarray(value)
    inner = array.shape[array.ndim - axes :]
    if array.size == math.prod(inner):
        array, batch = array.reshape((1, *inner)), (1,)
    return flat_arrays(array, batch, axes)


Arguments = tuple[NDArray[Any], ...]


def by_constants(body: Any, eps: float | FloatArray, batch: tuple[int, ...]) -> Arguments:
    """Return the arguments of a kernel that takes the constants of a body, and eps last.

    Each has one row if it is common to the whole batch, else one for each trajectory.
    """
    if not body.shape:
        return *body.batch_of_one, flat_parameter(eps, batch)
    axes = max(body._axes.values(), default=0)
    own = (flat_parameter(value, batch, axes) for value in body.constants)
    return *own, flat_parameter(eps, batch)


def by_field(body: Any, eps: float | FloatArray, batch: tuple[int, ...]) -> Arguments:
    """Return the arguments of kernels that take the field of a body: its terms, and eps."""
    indices, values = body.terms
    return indices, flat_parameter(values, batch, 1), flat_parameter(eps, batch)


ALL = slice(None)


def alike(
    indices: NDArray[Any], values: FloatArray, eps: FloatArray
) -> Iterator[tuple[Any, NDArray[Any], FloatArray, FloatArray]]:
    """Divide trajectories by the zeros of their fields; yield where they are, and arguments.

    The operations of a step, and so its rounding errors, depend on which terms are zero: without
    this, the bits of a trajectory would depend on the fields of others.
    """
    nonzero = values != 0.0
    if len(values) == 1 or nonzero.all():
        yield ALL, indices, values, eps
        return
    patterns, which = np.unique(nonzero, axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        [where] = np.nonzero(which.ravel() == k)
        own = [np.ascontiguousarray(each[:, pattern]) for each in (indices, values[where])]
        yield where, own[0], own[1], eps[where] if len(eps) > 1 else eps


WHOLE = (1.0,)  # the fractions of eps of a step of Kahan's map


def by_method(body: Any, eps: float | FloatArray, batch: tuple[int, ...]) -> Any:
    """Return the arguments of the kernel of fields: the operations of a step, values and eps."""
    return with_method(body.dimension, WHOLE, *by_field(body, eps, batch))


def in_stages(fractions: tuple[float, ...]) -> Callable[..., Any]:
    """Return `by_method` for steps of several fractions of eps, one after the other."""

    def by_method(body: Any, eps: float | FloatArray, batch: tuple[int, ...]) -> Any:
        return with_method(body.dimension, fractions, *by_field(body, eps, batch))

    return by_method


def with_method(
    D: int, fractions: Any, indices: NDArray[Any], values: FloatArray, eps: FloatArray
) -> Any:
    return method_of(indices, D, fractions), values, eps


def by_zeros(D: int, arguments: Any) -> Iterator[tuple[Any, Any]]:
    """Divide the arguments of `by_method`, see `alike`."""
    (step, fractions), values, eps = arguments
    for where, *own in alike(step.indices, values, eps):
        yield where, arguments if where is ALL else with_method(D, fractions, *own)


def nd_system(body: Any, eps: float) -> NDSystem:
    """Return the constants of a single body in n dimensions, for `compiled`."""
    near = (1.0 - FAR_FROM_0) * float(np.min(body.J))
    return NDSystem(np.array(body.J), np.array(body.I), eps, near, body.dimension)


def field_system(body: Any, eps: float, fractions: Any = WHOLE) -> FieldSystem:
    """Return the constants of a single body with a field, for `compiled`."""
    indices, values = body.terms
    halves = np.outer(fractions, 0.5 * eps * values)
    system: FieldSystem = system_of(indices, halves, body.dimension)
    return system


def checked_out(out: Any, shape: tuple[int, ...]) -> FloatArray:
    if not isinstance(out, np.ndarray) or np.ma.isMA(out) or out.dtype != np.float64:
        received = f"{checks.kind_of(out)} of dtype {getattr(out, 'dtype', None)}"
        raise wrong("out", "a NumPy array of dtype float64", received, TypeError)
    if out.shape != shape or not out.flags.carray:
        expected = f"a C-contiguous, writeable, aligned array of shape {shape}"
        received = f"shape {out.shape}, strides {out.strides}"
        if not out.flags.writeable:
            received += ", read-only, as the states of runs are: pass an array of your own"
        raise wrong("out", expected, received)
    return out
