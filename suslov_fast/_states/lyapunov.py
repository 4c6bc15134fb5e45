"""How fast orbits that begin next to each other part."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._bodies.units import scaled_eps, units_of
from .._checks import FloatArray, integer
from .._core.cpu import lyapunov as loops
from .._core.cpu.blocks import LANES, TASKS
from .._engine import threads as _threads
from .._engine.arguments import Body, check
from .._engine.layout import first_index, spell
from .._engine.status import SingularStepWarning

# Python looks for Ctrl-C between slices of so many operations: some 0.1 s.
_SLICE = 2**28
# What a step costs in three dimensions, in steps of the map.
_STEP = 20


def lyapunov_exponents(
    body: Body, omega0: ArrayLike, eps: ArrayLike, steps: int, threads: int | None = None
) -> FloatArray:
    """The Lyapunov exponents of orbits over so many steps.

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
        Number of threads; by default what Numba is set to.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Per step, the largest first; divide by eps for a rate in time. -inf where a step is not
        invertible. NaN where omega0 is, and, with one :class:`SingularStepWarning`, where an orbit
        comes to an end before its last step.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

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
    arguments = omega.copy(), step_size, batch, steps, threads
    if isinstance(body, Suslov3D):
        products, exponents = _growth(body, *arguments)
    else:
        products, exponents = _growth_nd(body, *arguments)
    logarithms = np.empty((size, m))
    _threads.run(loops.take_logarithms, 0, threads, products, exponents, float(steps), logarithms)
    if isinstance(body, Suslov3D):
        logarithms[:, 1] -= logarithms[:, 0]  # of the area, less that of the length
    result = -np.sort(-logarithms, axis=-1).reshape((*batch, m))
    _warn_of_failures(np.isnan(result).any(axis=-1) & ~np.isnan(state).any(axis=-1))
    return result


def _warn_of_failures(missing: Any) -> None:
    failed = np.asarray(missing)
    if failed.any():
        warnings.warn(
            f"{np.count_nonzero(failed)} of {failed.size} trajectories: singular or non-finite "
            f"step, first: {spell(first_index(failed))}",
            SingularStepWarning,
            stacklevel=3,
        )


def _growth(
    body: Suslov3D,
    omega: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    steps: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """By what a length and an area have grown, as products and exponents (B, 2)."""
    size = len(omega)
    parameters = [
        np.broadcast_to(each, batch).reshape(size).copy()
        for each in (*units_of(body).parameters, scaled_eps(body, eps))
    ]
    carried = np.empty((loops.ROWS, size))
    _threads.run(loops.enter, size * _STEP, threads, *parameters, omega, carried)
    n_blocks = (size + LANES - 1) // LANES
    length = max(_SLICE // (_STEP * max(n_blocks * LANES, 1)), 1)
    for start in range(0, steps, length):
        count = min(length, steps - start)
        work = count * size * _STEP if n_blocks > 1 else 0
        _threads.run(loops.iterate, work, threads, count, carried)
    rows: Any = loops.LENGTH, loops.AREA
    products, exponents = (
        np.ascontiguousarray(carried[[row + k for row in rows]].T) for k in (0, 1)
    )
    return products, exponents


def _growth_nd(
    body: SuslovND,
    omega: FloatArray,
    eps: FloatArray,
    batch: tuple[int, ...],
    steps: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """By what the vectors of an orthonormal frame have grown, as products and exponents (B, m)."""
    size, m = omega.shape
    J, I = (np.broadcast_to(each, (*batch, m)).reshape(size, m) for each in body.parameters)
    # In units in which all three are of the order of 1: (dsn) knows eps I omega / J alone.
    _, of_J = np.frexp(J.max(axis=-1))
    _, of_I = np.frexp(abs(I).max(axis=-1))
    _, of_omega = np.frexp(np.nan_to_num(abs(omega).max(axis=-1)))
    J, I = np.ldexp(J, -of_J[:, np.newaxis]), np.ldexp(I, -of_I[:, np.newaxis])
    omega = np.ldexp(omega, -of_omega[:, np.newaxis])
    with np.errstate(all="ignore"):
        flat = np.broadcast_to(eps, batch).reshape(size)
        h = np.ldexp(0.5 * flat, of_I + of_omega - of_J)[:, np.newaxis] / J
    frames = np.empty((size, m, m))
    frames[:] = np.eye(m)
    products, exponents = np.ones((size, m)), np.zeros((size, m))
    scratch = np.empty((min(size, TASKS), loops.scratch_size(m)))
    cost = 3 * m**3 + _STEP * m
    length = max(_SLICE // (cost * max(size, 1)), 1)
    for start in range(0, steps, length):
        count = min(length, steps - start)
        _threads.run(
            loops.iterate_nd,
            count * size * cost if size > 1 else 0,
            threads,
            count,
            h,
            np.ascontiguousarray(I),
            omega,
            frames,
            products,
            exponents,
            scratch,
        )
    return products, exponents
