"""The scheme before Omega3 is set to 0."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ._bodies.three import Suslov3D
from ._checks import FloatArray
from ._core.formulas.full_map import full_step
from ._engine.arguments import check, components
from ._engine.elementwise import evaluate, without_poles


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
    (state, step_size, third), batch = check(
        body, {"omega": omega}, {"eps": eps, "I3": I3}, dimension=3
    )
    if not (third > 0).all():
        raise ValueError(f"I3: expected a positive moment of inertia, got {third.min()}")
    return without_poles(
        evaluate(full_step, batch, *body.parameters, step_size, third, *components(state))
    )
