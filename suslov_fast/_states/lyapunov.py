"""Lyapunov exponents."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._bodies.base import Body
from .._checks import FloatArray, integer
from .._engine import threads as _threads
from .._engine.arguments import States, check
from .._engine.evaluation import TASKS, warn_of_missing
from .._engine.execution import execute
from .._engine.problem import Problem, Span, problem_of
from .._jit import LINE
from .._kernels.tangent_map import orthonormalise
from .._maps import map_of
from .step_derivatives import derivatives_of
from .table import described, evaluation_of, kinds_with, with_table

# Number of entries of the derivatives that are held at a time.
_SLAB = 2**18
# Cost of a product of two numbers, in steps of the map.
_COST = 2
# t is computed exactly if 1 - t**2 is below this.
_NEXT_TO_1 = 0.1


@partial(described, quantity="jacobian")
def lyapunov_exponents(
    body: Body,
    omega0: ArrayLike,
    eps: ArrayLike,
    steps: int,
    transient: int = 0,
    *,
    threads: int | None = None,
) -> FloatArray:
    """Lyapunov exponents of orbits over a number of steps.

    Parameters
    ----------
    %(body, omega0, eps)s
    steps : int
        Number of steps of the mean, 1 or more.
    transient : int
        Number of steps before the mean begins: the exponents are those of the orbit that starts at
        the state after them.
    %(threads)s

    Returns
    -------
    ndarray(float, shape=(..., D))
        Exponents per step, the largest first; divide by eps for rates. -inf if a step is not
        invertible; NaN, with one :class:`SingularStepWarning`, if an orbit fails or all digits of a
        determinant cancel.

    %(Raises: invalid)s

    Notes
    -----
    The derivatives of the map along the orbit are multiplied, and the product is decomposed as Q R
    after each step, beginning with Q = Id. The exponents are the mean logarithms of the diagonal of
    R; their sum is the mean of ``log |det DPhi|``, with an error below 1e-12 of the mean of its
    magnitude. Where an orbit tends to a steady state, they tend to the logarithms of its
    :func:`multipliers`, with an error of order 1 / steps. Where a displacement along the orbit
    outgrows that across by 1e16, single exponents lose all digits; their sum does not.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, limits, lyapunov_exponents, multipliers
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> lyapunov_exponents(body, [1.0, 0.5], eps=0.2, steps=100_000).round(4)
    array([ 0.    , -0.0805])
    """
    components, body = getattr(body, "_labels", None), with_table(body)
    arguments = {"omega0": omega0, "eps": eps}
    states = check(body, kinds_with("jacobian"), arguments, threads, components)
    steps, problem = integer("steps", steps, 1), problem_of(map_of(body), states)
    transient = integer("transient", transient, 0)
    if 0 in states.batch:
        return np.empty((*states.batch, body.dimension))
    if transient:
        later = execute(problem, Span(transient, None)).final
        problem = problem_of(map_of(body), states._replace(omega=later))
    with np.errstate(all="ignore"):
        lengths, of_det = _growth(problem, steps, body.dimension - 1)
        lost = (lengths[..., :-1] == -np.inf).any(axis=-1, keepdims=True)
        # The last follows from the others and the determinant, unless these are 0.
        lengths[..., -1] = of_det - lengths[..., :-1].sum(axis=-1)
        if lost.any():
            lengths = np.where(lost, _growth(problem, steps, body.dimension)[0], lengths)
    lengths[np.isnan(lengths).any(axis=-1)] = np.nan
    result: FloatArray = -np.sort(-lengths / steps, axis=-1)
    failed = np.isnan(result).any(axis=-1) & ~np.isnan(states.omega).any(axis=-1)
    if failed.any():
        what = "trajectories: singular or non-finite step"
        warn_of_missing(int(failed.sum()), int(np.argmax(failed)), failed.shape, what)
    return result


def _growth(problem: Problem, steps: int, columns: int) -> tuple[FloatArray, FloatArray]:
    """Return the sums of logarithms of the first diagonal entries of R, and of |det DPhi|."""
    body, eps, threads, (size, D) = problem.body, problem.eps, problem.threads, problem.omega0.shape
    scratch, of_det, invariant = np.empty((TASKS, 2 * D + 3, D, LINE)), np.zeros(size), None
    log_det = _by_slopes if isinstance(body, kinds_with("slopes")) else _canonical
    carried = np.zeros((size, D + 2, D))
    carried[:, :D], carried[:, D] = np.eye(D), 1.0
    for omega in _slabs(problem, steps):
        states = States(body, omega, eps, omega.shape[:-1], threads)
        derivatives, logarithms, invariant = log_det(states, invariant)
        arrays = derivatives.reshape(-1, size, D, D), logarithms.reshape(-1, size), carried, of_det
        work = _COST * derivatives.size * columns
        _threads.call_kernel(orthonormalise, work, threads, columns, *arrays, scratch)
    lengths = np.log(carried[:, D]) + carried[:, D + 1] * np.log(2.0)
    return lengths.reshape(*problem.batch, D), of_det.reshape(problem.batch)


def _slabs(problem: Problem, steps: int) -> Iterator[FloatArray]:
    """Yield all states (..., D) of a run in parts; the first state of a part is the last before."""
    size = max(problem.omega0.size * problem.omega0.shape[1], 1)
    length = max(_SLAB // size, 1)
    found = execute(problem, Span(min(length, steps), 1))
    yield found.saved
    for start in range(length, steps, length):
        last = found.saved[-1:]
        found = execute(problem, Span(min(start + length, steps), 1, start, found.resume))
        yield np.concatenate([last, found.saved])


def _canonical(states: States, G: FloatArray | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return DPhi and log |det DPhi| of the steps between states in three dimensions, and 1 - t**2.

    With X = e l, Y and K = e k of `_formulas.closed_form`, the invariant density gives
    det DPhi = (1 + Y + K X) / (1 - Y + 2 X**2 - K X) (1 + X_next**2) / (1 + X**2). Next to t = 1
    the first numerator nearly vanishes, and follows from 1 - t**2, which is constant on an orbit:
    (1 + K X + Y) (1 + K X - Y) / (1 + X**2). Where K is large, u = X - K has digits that X lost.
    """
    body, omega, eps, *_ = states
    I1, I2, I13, I23, *rest = body.parameters
    k, root = rest[0] if rest else 0.0, np.sqrt(I1) * np.sqrt(I2)
    omega1, omega2 = 0.5 * omega[..., 0] * eps, 0.5 * omega[..., 1] * eps
    K = 0.5 * (k / root) * eps
    u = I13 / root * omega1 + I23 / root * omega2
    X = u + K
    Y, KX, square = I23 / I2 * omega1 - I13 / I1 * omega2, K * X, X * X
    if G is None:
        G = np.array(((1.0 + KX + Y) * (1.0 + KX - Y) / (1.0 + square))[0])
        near = abs(G) < _NEXT_TO_1
        numbers = np.broadcast_arrays(I1, I2, I13, I23, k, eps, omega[0, ..., 0], omega[0, ..., 1])
        G[near] = [_exact(*state) for state in zip(*(each[near] for each in numbers), strict=True)]
    above, below, product = 1.0 + KX + Y, 1.0 + KX - Y, G * (1.0 + square)
    first = abs(above) < abs(below)  # the smaller one follows from the other
    above, below = np.where(first, product / below, above), np.where(first, below, product / above)
    wide = 2.0 * (X * u)
    # The factors above / ahead and ratio, and what they have more than 1.
    ahead, before = (below + wide)[:-1], 1.0 + square[:-1]
    more = (2.0 * Y - wide)[:-1] / ahead
    change = (u[1:] - u[:-1]) * (X[1:] + X[:-1]) / before
    ratio, less_1 = (1.0 + square[1:]) / before, more + change + more * change
    factor = above[:-1] / ahead * ratio  # log1p is accurate where it is near 1
    logarithms = np.where(abs(less_1) < 0.5, np.log1p(less_1), np.log(abs(factor)))
    # A state without a next one has no derivative either.
    before = np.where(np.isnan(omega[1:]), np.nan, omega[:-1])
    jacobian = evaluation_of("jacobian", body)
    return jacobian(states._replace(omega=before, batch=before.shape[:-1])), logarithms, G


def _by_slopes(states: States, _: Any) -> tuple[FloatArray, FloatArray, None]:
    found, before = evaluation_of("slopes", states.body)(states), states.omega[:-1]
    states = states._replace(omega=before, batch=before.shape[:-1])
    return *derivatives_of(states, found[:-1], found[1:]), None


def _exact(*numbers: float) -> float:
    """Return 1 - t**2 of a state, rounded once."""
    I1, I2, I13, I23, k, eps, omega1, omega2 = map(Fraction, numbers)
    l, y = I13 * omega1 + I23 * omega2 + k, I23 * I1 * omega1 - I13 * I2 * omega2
    a, h = I1 * I2, eps * eps / 4
    return float(((a + h * k * l) ** 2 - h * y * y) / (a * (a + h * l * l)))
