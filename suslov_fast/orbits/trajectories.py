"""`Trajectories`, the result of `iterate`: states, statuses, and methods that go on from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import kahan
from ..bodies.systems import MapOrField
from ..checks import FloatArray, wrong
from ..core.cached import cached_property
from ..core.maps.stages import WHOLE
from ..keywords import public
from ..maps.map_records import Discretization
from ..results.result import States, read_only


@dataclass(frozen=True, eq=False, repr=False)
class Trajectories(States):
    """Orbits of a batch, with the status of each: the result of :func:`iterate`.

    Attributes
    ----------
    states : ndarray(float, shape=(n_saved, ..., D))
        The saved states; NaN from the first state that does not exist. ``np.asarray(run)`` is the
        same array, and ``run["x1"]`` is a component of it.
    n, time : ndarray
        Step numbers (n_saved,) and times of the saved states.
    body, eps, method, steps, save_every
        The arguments of :func:`iterate`; eps is 1 for a :class:`Map`.
    status : ndarray(int8, shape=(...))
        The :class:`Status` of each trajectory; negative if it failed.
    failed_at : ndarray(int, shape=(...))
        If a trajectory failed, the number of the first state that does not exist; if its status is
        PASSED_POLE, the number of the first state beyond the pole; else -1.
    first_pole : ndarray(int, shape=(...))
        The number of the first state beyond a pole, also if the trajectory failed later; -1 if no
        pole was found.
    valid : ndarray(bool, shape=(n_saved, ...))
        True for the saved states before the first failure or pole.
    final : ndarray(float, shape=(..., D))
        The state after the last step, saved or not.
    attitude : ndarray(float, shape=(n_saved, ..., n, n)) or None
        Rotation matrices from body to space at the saved states, if requested.

    Notes
    -----
    ``run.states[k]`` are the states that were saved as number k, and ``run.member(k)`` is the run
    of trajectory k alone. Two runs are equal if all attributes are equal; NaN equals NaN. Arrays
    are read-only: to change states, take a copy, ``run.states.copy()``.

    Examples
    --------
    By how much do the energy and the modified energy of an orbit vary?

    >>> import numpy as np
    >>> from suslov_fast import Field, iterate
    >>> well = Field.from_hamiltonian(lambda x: x[1] ** 2 / 2 - x[0] + x[0] ** 3, "q p")
    >>> orbit = iterate(well, [0.9, 0.0], eps=0.1, steps=1000)
    >>> orbit
    Trajectories(states: (1001, 2), n: 0, 1 ... 1000, eps: 0.1, failed: 0 of 1)
    >>> f"{np.ptp(orbit.energy()):.0e}", bool(np.ptp(orbit.modified_energy()) < 1e-14)
    ('2e-03', True)
    """

    states: FloatArray
    eps: float | FloatArray
    body: MapOrField
    map: Discretization
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    first_pole: NDArray[np.int64]
    final: FloatArray
    method: str
    steps: int
    save_every: int | None
    attitude: FloatArray | Any = None  # `Any`, so that type checkers ask for no test of None
    _t0: FloatArray | Any = 0.0  # the time (...) at x0

    @cached_property
    def n(self) -> NDArray[np.int64]:
        """Step numbers of the saved states, shape (n_saved,): 0, save_every, 2 save_every, ..."""
        if self.save_every is None:
            return read_only(np.array([self.steps]))
        return read_only(self.save_every * np.arange(self.steps // self.save_every + 1))

    @property
    def time(self) -> FloatArray:
        """Times n eps of the saved states: (n_saved,), or (n_saved, ...) if eps is an array."""
        n = self.n if np.ndim(self.eps) == 0 else self.n.reshape(-1, *(1,) * self.status.ndim)
        return read_only(n * np.asarray(self.eps))

    @property
    def _last(self) -> tuple[Any, Any]:
        """The states and the times (...) from which another run or motion goes on."""
        if not self.body._has_eps or self.body._layout.time_variable:
            return self.final, None
        return self.final, self._t0 + self.steps * np.asarray(self.eps)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """True for saved states before the first failure or pole, shape (n_saved, ...).

        All states of a trajectory with the status SUPERCRITICAL are valid.
        """
        n = self.n.reshape(-1, *(1,) * self.status.ndim)
        # A failure never comes before a pole that was passed.
        end = np.where(self.first_pole < 0, self.failed_at, self.first_pole)
        return read_only((end < 0) | (n < end))

    @public
    def modified_energy(self) -> FloatArray:
        """Return the modified energy (n, ...), as :func:`kahan.modified_energy` does."""
        if self.map.stages is not WHOLE:
            how = "use energy, which varies along orbits of higher order"
            raise wrong("method", "'auto'", f"{self.method!r}: {how}", TypeError)
        body: Any = self.body  # for a `Map` the call raises
        return kahan.modified_energy(body, self.states, self.eps)

    def __repr__(self) -> str:
        n = self.n
        steps = f"{n[0]}, {n[1]} ... {n[-1]}" if n.size > 2 else ", ".join(map(str, n))
        parts = [f"states: {self.states.shape}", f"n: {steps}"]
        if self.body._has_eps:
            low, high = np.min(self.eps, initial=np.inf), np.max(self.eps, initial=-np.inf)
            parts.append(f"eps: {low:g} ... {high:g}" if low < high else f"eps: {low:g}")
        parts.append(f"failed: {np.count_nonzero(self.status < 0)} of {self.status.size}")
        if passed := np.count_nonzero(self.first_pole >= 0):
            parts.append(f"passed a pole: {passed}")
        return f"Trajectories({', '.join(parts)})"
