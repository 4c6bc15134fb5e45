"""The continuous problem beside the discrete one."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from .._checks import FloatArray
from .table import find


def vector_field(body: Any, omega: ArrayLike, threads: int | None = None) -> FloatArray:
    """Derivative of omega by time.

    Parameters
    ----------
    body : Suslov3D, SuslovND or SuslovGyrostat
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(..., D))
        In the unit of omega squared.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Notes
    -----
    Equations (s1) and (nsus1).

    Examples
    --------
    >>> from suslov_fast import Suslov3D, vector_field
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> vector_field(body, [1.0, 0.5]).round(6)
    array([ 0.08125, -0.65   ])
    """
    return find("vector_field", body, omega, None, threads)


def reaction(
    body: Any, omega: ArrayLike, eps: ArrayLike | None = None, threads: int | None = None
) -> FloatArray:
    """Lagrange multiplier of the constraint: the torque that keeps Omega3 at 0.

    Parameters
    ----------
    body : Suslov3D or SuslovND
        The body, or a batch of them.
    omega : array_like(float, shape=(..., D))
        Angular velocities; NaN for states that do not exist, and so is the result.
    eps : array_like(float, shape=(...)), optional
        Step size, in the unit of time of omega. With it the multiplier is that of the discrete
        equations between each state and its own next one, without it that of the continuous ones.
    threads : int, optional
        Number of threads; by default Numba's.

    Returns
    -------
    ndarray(float, shape=(...) or (..., n - 1, n - 1))
        In the unit of inertia times that of omega squared; in n dimensions the antisymmetric
        lambda_ij of (nsus). NaN, with one :class:`SingularStepWarning`, where eps is given and a
        state has no next one.

    Raises
    ------
    TypeError, ValueError
        If an argument is of another type or shape, or infinite.

    Notes
    -----
    The third equation of (s1); made discrete as the others are in (ds1), it reads
    (x_next - x) / eps = lambda + (I1 - I2) (Omega1 Omega2_next + Omega1_next Omega2) / 2.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, reaction
    >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
    >>> float(reaction(body, [1.0, 0.5]).round(6))
    -1.345625
    >>> float(reaction(body, [1.0, 0.5], eps=0.01).round(6))
    -1.336328
    """
    return find("reaction" if eps is None else "discrete_reaction", body, omega, eps, threads)
