"""The scheme before Omega3 is set to 0."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from ._bodies import Suslov3D
from ._core.full_map import full_step
from ._elementwise import evaluate
from ._layout import first_index, spell
from ._status import SingularStepWarning
from ._validation import FloatArray, common_shape, instance, real_array, vectors


def step_full(body: Suslov3D, omega: ArrayLike, eps: ArrayLike, I3: ArrayLike) -> FloatArray:
    """One step of the three-component scheme, equation (ds).

    The constraint asks for Omega3 = 0; the scheme itself only changes the sign of Omega3.

    Parameters
    ----------
    body : Suslov3D
        The body, or a batch of them.
    omega : array_like(float, shape=(..., 3))
        Angular velocities (Omega1, Omega2, Omega3).
    eps : array_like(float, shape=(...))
        Step size, in the unit of time of omega.
    I3 : array_like(float, shape=(...))
        The third moment of inertia, positive.

    Returns
    -------
    ndarray(float, shape=(..., 3))
        The next states; NaN, with one :class:`SingularStepWarning`, where there is none.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what is said above.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, step_full
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> step_full(body, [1.0, 0.5, 0.1], eps=0.2, I3=3).round(6)
    array([ 0.988568,  0.315951, -0.1     ])
    """
    instance("body", body, Suslov3D)
    state = vectors("omega", omega, 3)
    step_size = real_array("eps", eps)
    third = real_array("I3", I3)
    if not (third > 0).all():
        raise ValueError(f"I3: expected a positive moment of inertia, got {third.min()}")
    batch = common_shape(
        body=body.shape, omega=state.shape[:-1], eps=step_size.shape, I3=third.shape
    )
    following = evaluate(
        full_step,
        batch,
        *body.parameters,
        step_size,
        third,
        state[..., 0],
        state[..., 1],
        state[..., 2],
    )
    failed = np.asarray(~np.isfinite(following).all(axis=-1))
    if failed.any():
        following[failed] = np.nan
        message = (
            f"{np.count_nonzero(failed)} of {failed.size} states: singular step, "
            f"first: {spell(first_index(failed))}"
        )
        warnings.warn(message, SingularStepWarning, stacklevel=2)
    return following
