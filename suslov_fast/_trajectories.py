"""What an iteration returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._bodies import Suslov3D
from ._validation import FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Trajectories:
    """A batch of trajectories, as :func:`iterate` returns it.

    Attributes
    ----------
    omega : ndarray(float, shape=(..., n_saved, D))
        The saved states; NaN from the first state on that does not exist.
    n : ndarray(int, shape=(n_saved,))
        Their step numbers.
    eps : float or ndarray(float, shape=(...))
        The step size, in the unit of time that omega is measured in.
    body : Suslov3D
        The body.
    status : ndarray(int8, shape=(...))
        How each trajectory ended: a :class:`Status`; negative if it failed.
    final : ndarray(float, shape=(..., D))
        The state after the last step, whether saved or not.
    failed_at : ndarray(int, shape=(...))
        The number of the first state that does not exist, or -1.
    """

    omega: FloatArray
    n: NDArray[np.int64]
    eps: Any
    body: Suslov3D
    status: NDArray[np.int8]
    final: FloatArray
    failed_at: NDArray[np.int64]

    @property
    def t(self) -> FloatArray:
        """The times n eps of the saved states: (n_saved,), or (..., n_saved) if eps varies."""
        times: FloatArray = np.multiply.outer(self.eps, self.n)
        return times

    @property
    def ok(self) -> bool:
        """Whether every trajectory finished."""
        return bool((self.status >= 0).all())

    def __repr__(self) -> str:
        failed = np.count_nonzero(self.status < 0)
        return (
            f"Trajectories(omega: {self.omega.shape}, n: {_first_and_last(self.n)}, "
            f"eps: {_range(self.eps)}, failed: {failed} of {self.status.size})"
        )


def _first_and_last(n: NDArray[np.int64]) -> str:
    return f"{n[0]}" if n.size == 1 else f"{n[0]}, {n[1]} ... {n[-1]}"


def _range(eps: Any) -> str:
    if np.size(eps) == 0:
        return "none"
    low, high = np.min(eps), np.max(eps)
    return f"{low:g}" if low == high else f"{low:g} ... {high:g}"
