"""The body with a rotor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .._checks import FloatArray
from .base import Body
from .body_3d import Suslov3D, set_in_3d


@dataclass(frozen=True, eq=False, repr=False)
class SuslovGyrostat(Body):
    """Suslov gyrostat, or a batch: a rigid body with a rotor along the constrained axis.

    In the adapted basis the constraint is Omega3 = 0, and the angular momentum is that of
    :class:`Suslov3D` with the constant k along e3.

    Parameters
    ----------
    I1, I2 : array_like(float, shape=(...))
        Moments of inertia, positive, in any unit that I13 and I23 share.
    I13, I23 : array_like(float, shape=(...))
        Products of inertia.
    k : array_like(float, shape=(...))
        Momentum of the rotor, of either sign, in units of inertia times angular velocity.
    I3 : array_like(float, shape=(...)), optional
        The third moment of inertia, positive, as in :class:`Suslov3D`.

    Raises
    ------
    TypeError, ValueError
        If a parameter is not a finite real number, a moment is not positive, they are more than
        2**1800 apart, or the shapes do not broadcast.

    Notes
    -----
    With l = I13 Omega1 + I23 Omega2 + k the equations are I1 Omega1' = -l Omega2 and
    I2 Omega2' = l Omega1. States with l = 0 are steady. An orbit of energy E goes from one to
    another where k**2 <= 2 E (I13**2 / I1 + I23**2 / I2), and is periodic elsewhere. If
    I13 = I23 = 0, Omega still rotates.

    Examples
    --------
    >>> from suslov_fast import SuslovGyrostat
    >>> SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)
    SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=0.9)
    >>> SuslovGyrostat(I1=2.3, I2=1.4, I13=0.5, I23=-0.7, k=[0.0, 0.9, 1.8]).shape
    (3,)
    """

    I1: float | FloatArray
    I2: float | FloatArray
    I13: float | FloatArray
    I23: float | FloatArray
    k: float | FloatArray
    I3: float | FloatArray | None = None

    _moments: ClassVar[tuple[str, ...]] = ("I1", "I2")
    _couplings: ClassVar[tuple[str, ...]] = ("I13", "I23", "k")
    _meanings: ClassVar[dict[str, str]] = {**Suslov3D._meanings, "k": "momentum of the rotor"}

    def __post_init__(self) -> None:
        set_in_3d(self)
