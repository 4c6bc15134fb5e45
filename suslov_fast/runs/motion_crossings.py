"""`MotionCrossings`, the crossings along motions: points, times, and which surface was crossed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray
from .points import Points, span


@dataclass(frozen=True, eq=False, repr=False)
class MotionCrossings(Points):
    """Points where motions of a batch cross surfaces: the result of ``crossings(..., time=T)``.

    There are K crossings, ordered by trajectory, then along the motion.

    Attributes
    ----------
    time, states : ndarray(float, shape=(K,) and (K, D))
        Times and states of the crossings, with the digits of the tolerance. States lie on the
        surface to rounding, on the side to which the motion goes: a motion that starts there does
        not cross again at once.
    surface : ndarray(int, shape=(K,))
        Which of the surfaces is crossed; 0 if there is one.
    trajectory, count
        As in :class:`Crossings`.
    status, end, steps
        As in :class:`Motion`.
    final : ndarray(float, shape=(..., D))
        The states at the last time, or at the crossing number `most`; NaN where a solution has
        ended.
    body, last, transient, direction, most, rtol, atol, max_step, stiff
        The arguments of :func:`crossings`; `last` is the last time.

    Notes
    -----
    ``len(points)`` is K, and ``points.ok`` is True if no solution ended early. Two objects are
    equal if all attributes are equal; NaN equals NaN. Arrays are read-only: change a copy.

    Examples
    --------
    When does an oscillator pass 0 upwards? At 3 pi / 2, then every 2 pi:

    >>> import numpy as np
    >>> from suslov_fast import QuadraticField, crossings
    >>> oscillator = QuadraticField.from_function(lambda x: (x[1], -x[0]), "q p")
    >>> points = crossings(oscillator, [1.0, 0.0], surface=lambda x: x[..., 0], time=20.0)
    >>> points
    MotionCrossings(x: (3, 2), time: 4.71239 to 17.2788, rtol: 1e-09, ended: 0 of 1)
    >>> bool(abs(points.time - np.pi * np.array([1.5, 3.5, 5.5])).max() < 1e-8)
    True
    """

    coordinates = "trajectory", "surface", "time"

    trajectory: NDArray[np.int64]
    surface: NDArray[np.int64]
    time: FloatArray
    states: FloatArray
    count: NDArray[np.int64]
    status: NDArray[np.int8]
    end: FloatArray
    final: FloatArray
    steps: NDArray[np.int64]
    body: BodyOrField
    last: float
    transient: float
    direction: int
    most: int | None
    rtol: float
    atol: float | tuple[float, ...] | None
    max_step: float | None
    stiff: bool | None

    def __repr__(self) -> str:
        ended = f"{np.count_nonzero(self.status < 0)} of {self.status.size}"
        states = f"{self._variable}: {self.states.shape}"
        about = f"time: {span(self.time)}, rtol: {self.rtol:g}, ended: {ended}"
        return f"MotionCrossings({states}, {about})"
