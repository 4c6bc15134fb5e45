"""Lyapunov exponents."""

from __future__ import annotations

import math
import warnings

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._checks import FloatArray, integer
from .._engine import threads as _threads
from .._engine.arguments import Body, check
from .._engine.layout import first_index, spell
from .._engine.states import TASKS
from .._engine.status import SingularStepWarning
from .._kernels import exponents as kernels

# Python looks for Ctrl-C between slices of so many operations: some 0.1 s.
_SLICE = 2**28
# The cost of a step in three dimensions, in steps of the map.
_STEP = 20


def lyapunov_exponents(
    body: Body, omega0: ArrayLike, eps: ArrayLike, steps: int, threads: int | None = None
) -> FloatArray:
    """Lyapunov exponents of orbits over a number of steps.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega0 : array_like(float, shape=(..., D))
        Initial angular velocities; NaN where there is none.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0; a negative one gives the inverse map.
    steps : int
        Number of steps, 1 or more.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Per step, the largest first; divide by eps for a rate in time. -inf where a step is not
        invertible. NaN where omega0 is, and, with one :class:`SingularStepWarning`, where an orbit
        comes to an end before its last step.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Notes
    -----
    Mean logarithms of the diagonal of R, where Q R is the product of the derivatives DPhi along the
    orbit, taken apart anew at each step from Q = Id on. Their sum is the mean of
    ``log |det DPhi|``.
    As `steps` grows they tend, like 1 / steps, to the logarithms of the :func:`multipliers` of the
    steady state that the orbit reaches: one is 0, the others are negative.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, limits, lyapunov_exponents, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> lyapunov_exponents(body, [1.0, 0.5], eps=0.2, steps=100_000).round(4)
    array([ 0.    , -0.0805])
    """
    (state, step_size), batch = check(body, {"omega0": omega0}, {"eps": eps})
    steps = integer("steps", steps, 1, "an integer of at least 1")
    threads = _threads.thread_count(threads)
    size, m = math.prod(batch), body.dimension
    omega = np.broadcast_to(state, (*batch, m)).reshape(size, m).copy()
    flat_eps = np.broadcast_to(step_size, batch).reshape(size)
    growth = _growth if isinstance(body, Suslov3D) else _growth_nd
    products, exponents = growth(body, omega, flat_eps, batch, steps, threads)
    logarithms = np.empty((size, m))
    _threads.run(kernels.take_logarithms, 0, threads, products, exponents, float(steps), logarithms)
    if isinstance(body, Suslov3D):
        logarithms[:, 1] -= logarithms[:, 0]  # of the area, less that of the length
    result = -np.sort(-logarithms, axis=-1).reshape((*batch, m))
    failed = np.isnan(result).any(axis=-1) & ~np.isnan(state).any(axis=-1)
    if failed.any():
        warnings.warn(
            f"{np.count_nonzero(failed)} of {failed.size} trajectories: singular or non-finite "
            f"step, first: {spell(first_index(np.asarray(failed)))}",
            SingularStepWarning,
            stacklevel=2,
        )
    return result


def _growth(
    body: Suslov3D,
    omega: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    steps: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the growth of a length and of an area, as products and exponents (B, 2)."""
    size = len(omega)
    own = (np.broadcast_to(each, batch).reshape(size) for each in body.parameters)
    parameters = tuple(np.require(each, requirements=["C", "W"]) for each in (*own, eps))
    carried = np.empty((kernels.ROWS, size))
    _threads.run(kernels.enter, size * _STEP, threads, parameters, omega, carried)
    length = max(_SLICE // (_STEP * max(size, kernels.LANES)), 1)
    for start in range(0, steps, length):
        count = min(length, steps - start)
        work = count * size * _STEP if size > kernels.LANES else 0
        _threads.run(kernels.iterate, work, threads, count, carried)
    products = carried[[kernels.LENGTH, kernels.AREA]].T
    exponents = carried[[kernels.OF_LENGTH, kernels.OF_AREA]].T
    return np.ascontiguousarray(products), np.ascontiguousarray(exponents)


def _growth_nd(
    body: SuslovND,
    omega: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    steps: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the growth of the vectors of an orthonormal frame, as products and exponents (B, m)."""
    size, m = omega.shape
    J, I = (np.broadcast_to(each, (*batch, m)).reshape(size, m) for each in body.parameters)
    # In units in which all three are of the order of 1: (dsn) knows eps I omega / J alone.
    _, of_J = np.frexp(J.max(axis=-1))
    _, of_I = np.frexp(abs(I).max(axis=-1))
    _, of_omega = np.frexp(np.nan_to_num(abs(omega).max(axis=-1)))
    J, I = np.ldexp(J, -of_J[:, np.newaxis]), np.ldexp(I, -of_I[:, np.newaxis])
    omega = np.ldexp(omega, -of_omega[:, np.newaxis])
    with np.errstate(all="ignore"):
        h = np.ldexp(0.5 * eps, of_I + of_omega - of_J)[:, np.newaxis] / J
    frames = np.empty((size, m, m))
    frames[:] = np.eye(m)
    products, exponents = np.ones((size, m)), np.zeros((size, m))
    scratch = np.empty((min(size, TASKS), kernels.scratch_size(m)))
    cost = 3 * m**3 + _STEP * m
    length = max(_SLICE // (cost * max(size, 1)), 1)
    for start in range(0, steps, length):
        count = min(length, steps - start)
        work = count * size * cost if size > 1 else 0
        grown = omega, frames, products, exponents
        _threads.run(kernels.iterate_nd, work, threads, count, h, I, *grown, scratch)
    return products, exponents
