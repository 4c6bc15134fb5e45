"""Lyapunov exponents."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..checks import FloatArray, integer
from ..core import tangent
from ..engine import threads as _threads
from ..engine.arguments import BodyOrField, States, check, flat_arrays, flat_parameter
from ..maps import states_after
from .evaluation import reported, terms_of

# Work of a stretch, between which Ctrl-C is heard, in operations.
_STRETCH = 2**26


def lyapunov_exponents(
    body: BodyOrField,
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
    body : Suslov3D, SuslovND, SuslovGyrostat or QuadraticField
        A single one, or a batch.
    omega0 : array_like(float, shape=(..., D))
        States 0.
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega0.
    steps : int
        Number of steps of the mean, 1 or more.
    transient : int
        Number of steps before the mean begins.
    threads : int, optional
        Number of threads, by default Numba's. Results do not depend on it.

    Returns
    -------
    ndarray(float, shape=(..., D))
        Exponents per step, dimensionless, the largest first; divide by eps for rates. -inf if a
        step is not invertible; NaN, with one :class:`SingularStepWarning`, if an orbit fails.

    Notes
    -----
    The derivatives of the map along the orbit are multiplied, and the product is decomposed as Q R
    after each step. The exponents are the mean logarithms of the diagonal of R; their sum is the
    mean of ``log |det DPhi|``, with an error below 1e-10 of the mean of its modulus. Where a
    displacement along the orbit outgrows that across by 1e16, single exponents lose all digits.

    Examples
    --------
    >>> import numpy as np
    >>> from suslov_fast import Suslov3D, lyapunov_exponents
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> lyapunov_exponents(body, [1.0, 0.5], eps=0.2, steps=100_000).round(4)
    array([ 0.    , -0.0805])
    """
    states = check(body, BodyOrField, {"omega0": omega0, "eps": eps}, threads)
    steps, transient = integer("steps", steps, 1), integer("transient", transient, 0)
    start = states_after(states, transient) if transient else states.omega
    with np.errstate(all="ignore"):
        sums, of_det = _growth(states, flat_arrays(start, states.batch), steps)
        lost = (sums[:, :-1] == -np.inf).any(axis=1)
        # The last follows from the others and the determinant, unless these are 0.
        sums[:, -1] = np.where(lost, sums[:, -1], of_det - sums[:, :-1].sum(axis=1))
    sums[np.isnan(sums).any(axis=1)] = np.nan
    found = -np.sort(-sums / steps, axis=1).reshape((*states.batch, body.dimension))
    return reported(states, found, axes=1, poles=True)


def _growth(states: States, start: FloatArray, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return the sums (B, D) of logarithms of lengths, and those (B,) of |det DPhi|."""
    (places, values), (B, D), batch = terms_of(states.body), start.shape, states.batch
    parameters = places, flat_parameter(values, batch, 1), flat_parameter(states.eps, batch)
    sums, of_det, carry = np.zeros((B, D)), np.zeros(B), np.empty((B, D + D * D))
    arrays = sums, of_det, np.zeros(B, np.int8), np.full(B, -1)
    cost = 4 * D**3 + len(places[0])
    width = max(min(B, _STRETCH // cost), 1)
    length = max(_STRETCH // (cost * width), 1)
    for begin in range(0, B, width):
        for first in range(0, steps, length):
            span = begin, min(begin + width, B), first, min(first + length, steps)
            work, arguments = cost * width * length, (parameters, start, carry, span, *arrays)
            _threads.call_kernel(tangent.growth, work, states.threads, *arguments)
    return sums, of_det
