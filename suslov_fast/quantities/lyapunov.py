"""Lyapunov exponents of the map."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..bodies.classes import BodyOrField
from ..checks import FloatArray, integer
from ..engine.problem import warn_of_times
from ..engine.status import report_poles
from ..engine.stretches import Progress, reporter
from ..keywords import public
from ..maps import Method, problem
from .evaluation import mask_and_warn


@public
def lyapunov_exponents(
    body: BodyOrField,
    omega0: ArrayLike,
    /,
    eps: ArrayLike,
    steps: int,
    transient: int = 0,
    *,
    method: Method = "auto",
    threads: int | None = None,
    progress: Progress = None,
) -> FloatArray:
    """Lyapunov exponents of orbits over a finite number of steps; chaos shows as positive ones.

    They are per step; divide by eps for exponents per unit of time.
    The derivatives of the map along the orbit are multiplied, and decomposed as Q R before columns
    lose digits (Benettin's method). The exponents are the mean logarithms of the diagonals of R.
    Their sum equals the mean of ``log |det DPhi|`` (relative error 1e-10). The exponents of an
    orbit are bit-identical whatever else is in the batch.

    Parameters
    ----------
    body, omega0, eps
        As in :func:`iterate`.
    steps : int
        Number of steps averaged over, after the transient; 1 or more.
    transient : int
        Number of steps before averaging begins. They also align the tangent vectors; without them
        the mean has an error of order 1 / steps.
    method, threads
        As in :func:`iterate`.
    progress : bool or callable, optional
        True shows a bar (needs tqdm). A function is called as ``progress(done, transient +
        steps)``; if it returns False, the exponents are means over the steps done, or NaN if the
        transient was not over.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Exponents per step, the largest first. ``-inf`` if a step is not invertible; NaN, with one
        :class:`SingularStepWarning`, if an orbit fails. If an orbit passed a pole (one
        :class:`PoleWarning`), they are those of the map, not of the motion.

    Raises
    ------
    TypeError, ValueError
        As :func:`iterate`.

    Examples
    --------
    The Lorenz system, whose largest exponent is about 0.906 per unit time:

    >>> from suslov_fast import QuadraticField, lyapunov_exponents
    >>> lorenz = QuadraticField.from_function(
    ...     lambda x: (10 * (x[1] - x[0]), x[0] * (28 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]),
    ...     "x y z",
    ... )
    >>> eps = 1 / 128
    >>> exponents = lyapunov_exponents(lorenz, [1, 1, 20], eps, 50_000, transient=2000) / eps
    >>> exponents.round(1)
    array([  0.9,   0. , -14.6])
    """
    checked = problem("lyapunov_exponents", body, omega0, eps, threads, method, name="omega0")
    steps, transient = integer("steps", steps, 1), integer("transient", transient, 0)
    warn_of_times(checked)
    with reporter(progress, transient + steps) as report, np.errstate(all="ignore"):
        growth = checked.map.find_growth(checked, steps, transient, report)
        sums, of_det = growth.sums, growth.of_det
        others = sums[:, :-1].sum(axis=1)
        # The last one follows from the determinant and the others, if all steps are invertible.
        sums[:, -1] = np.where(others == -np.inf, sums[:, -1], of_det - others)
    sums[np.isnan(sums).any(axis=1)] = np.nan
    exponents = -np.sort(-sums / max(growth.steps, 1), axis=1).reshape(
        (*checked.batch, body.dimension)
    )
    notes = growth.status, growth.failed_at, growth.by_signs
    status, failed_at, by_signs = (each.reshape(checked.batch) for each in notes)
    methods = checked.map.methods
    steps_taken = methods.get(checked.method, next(iter(methods.values())))
    report_poles(checked, steps_taken, status, failed_at, told_by_signs=by_signs)
    if growth.steps == 0:  # `progress` ended the run in its transient
        return exponents
    return mask_and_warn(checked, exponents, poles=True)
