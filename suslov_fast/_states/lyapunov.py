"""Lyapunov exponents."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.nd import SuslovND
from .._bodies.three import Suslov3D
from .._bodies.units import scaled_eps, units_of
from .._checks import FloatArray, first_index, integer, spell
from .._docs import filled
from .._engine import threads as _threads
from .._engine.arguments import WithoutRotor, check
from .._engine.layout import flat_vectors, for_kernel
from .._engine.states import TASKS
from .._engine.status import SingularStepWarning
from .._jit import Kernel
from .._kernels import exponents as kernels
from .._kernels.lanes import LANES

# Number of operations between checks for Ctrl-C: some 0.1 s.
_SLICE = 2**28
# Cost of a step in three dimensions, in steps of the map.
_STEP = 20


@filled
def lyapunov_exponents(
    body: WithoutRotor, omega0: ArrayLike, eps: ArrayLike, steps: int, *, threads: int | None = None
) -> FloatArray:
    """Lyapunov exponents of orbits over a number of steps.

    Parameters
    ----------
    %(body)s
    omega0 : array_like(float, shape=(..., D))
        Initial angular velocities. The result is NaN for states that are NaN.
    %(eps)s
        A negative one gives the inverse map.
    steps : int
        Number of steps, 1 or more.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        Exponents per step, the largest first; divide by eps for rates per unit of time. -inf if
        a step is not invertible; NaN, with one :class:`SingularStepWarning`, if an orbit fails
        before its last step.

    Raises
    ------
    %(invalid)s

    Notes
    -----
    The derivatives of the map along the orbit are multiplied, and the product is decomposed as Q R
    after each step, beginning with Q = Id. The exponents are the mean logarithms of the diagonal of
    R; their sum is the mean of ``log |det DPhi|``. As `steps` grows, they tend to the logarithms of
    the :func:`multipliers` of the steady state that the orbit approaches, with an error of order
    1 / steps: one is 0, the others are negative.

    Of an orbit that leaves the line of steady states, a displacement along the orbit grows and
    shrinks again. If it outgrows the displacement across by 1e16, single exponents lose all digits;
    their sum does not.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, limits, lyapunov_exponents, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> lyapunov_exponents(body, [1.0, 0.5], eps=0.2, steps=100_000).round(4)
    array([ 0.    , -0.0805])
    """
    (state, step_size), batch = check(body, {"omega0": omega0}, {"eps": eps})
    steps = integer("steps", steps, 1)
    threads = _threads.thread_count(threads)
    arguments = flat_vectors(state, batch).copy(), step_size, batch, steps, threads
    if isinstance(body, Suslov3D):
        products, exponents = _growth(body, *arguments)
    else:
        products, exponents = _growth_nd(body, *arguments)
    logarithms = np.empty(products.shape)
    _threads.run(kernels.take_logarithms, 0, threads, products, exponents, float(steps), logarithms)
    if isinstance(body, Suslov3D):
        logarithms[:, 1] -= logarithms[:, 0]  # of the area, less that of the length
    result = -np.sort(-logarithms, axis=-1).reshape((*batch, body.dimension))
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
    eps: float | FloatArray,
    batch: tuple[int, ...],
    steps: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the growth of a length and of an area, as products and exponents (B, 2)."""
    size = len(omega)
    parameters = tuple(
        for_kernel(np.broadcast_to(each, batch).reshape(size)) for each in (*body.parameters, eps)
    )
    carried = np.empty((kernels.ROWS, size))
    _threads.run(kernels.enter, size * _STEP, threads, parameters, omega, carried)
    _iterate(kernels.iterate, steps, _STEP, size, LANES, threads, carried)
    products = carried[[kernels.LENGTH, kernels.AREA]].T
    exponents = carried[[kernels.OF_LENGTH, kernels.OF_AREA]].T
    return np.ascontiguousarray(products), np.ascontiguousarray(exponents)


def _growth_nd(
    body: SuslovND,
    omega: FloatArray,
    eps: float | FloatArray,
    batch: tuple[int, ...],
    steps: int,
    threads: int | None,
) -> tuple[FloatArray, FloatArray]:
    """Return the growth of the vectors of a frame, as products and exponents (B, m)."""
    size, m = omega.shape
    J, I = (flat_vectors(each, batch) for each in units_of(body).parameters)
    _, power = np.frexp(np.nan_to_num(abs(omega).max(axis=-1)))
    omega = np.ldexp(omega, -power[:, np.newaxis])
    with np.errstate(all="ignore"):
        step = np.ldexp(np.broadcast_to(scaled_eps(body, eps), batch).reshape(size), power)
        h = 0.5 * step[:, np.newaxis] / J
    frames = np.empty((size, m, m))
    frames[:] = np.eye(m)
    products, exponents = np.ones((size, m)), np.zeros((size, m))
    scratch = np.empty((min(size, TASKS), kernels.scratch_size(m)))
    grown = h, I, omega, frames, products, exponents, scratch
    _iterate(kernels.iterate_nd, steps, 3 * m**3 + _STEP * m, size, 1, threads, *grown)
    return products, exponents


def _iterate(
    kernel: Kernel, steps: int, cost: int, size: int, lanes: int, threads: int | None, *arrays: Any
) -> None:
    """Make the steps of all orbits in slices; `cost` is that of one step of one orbit."""
    length = max(_SLICE // (cost * max(size, lanes)), 1)
    for start in range(0, steps, length):
        count = min(length, steps - start)
        work = count * size * cost if size > lanes else 0
        _threads.run(kernel, work, threads, count, *arrays)
