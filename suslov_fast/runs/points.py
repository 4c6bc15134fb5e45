"""The base of crossings and of changes: points on orbits, and their trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray
from ..keywords import public
from .results import Result

if TYPE_CHECKING:
    import xarray


class Points(Result):
    """Points in the order of trajectories; subclasses are dataclasses with these attributes."""

    trajectory: NDArray[np.int64]
    states: Any
    time: Any
    count: NDArray[np.int64]
    body: BodyOrField

    called = "a result of crossings"
    coordinates: Any  # attributes of crossings that label them
    what: ClassVar[str] = "crossings"

    def _at_crossings(self, values: Any, axes: int = 0) -> Any:
        """Return for each crossing the value (...) of its trajectory, an array of `axes` axes."""
        inner = values.shape[values.ndim - axes :]
        by_trajectory = np.broadcast_to(values, (*self._batch, *inner)).reshape(-1, *inner)
        return by_trajectory[self.trajectory]

    @property
    def _batch(self) -> tuple[int, ...]:
        """The shape of the batch."""
        return self.count.shape

    @property
    def _heading(self) -> str:
        """The name of the points in plots."""
        return str(self._titles["title"])

    def __len__(self) -> int:
        return len(self.trajectory)

    @public
    def to_xarray(self) -> xarray.Dataset:
        """Return a labelled dataset, as :meth:`Trajectories.to_xarray` does.

        Dimensions: "crossing" and "component". The points are "omega", or "x" for a field; along a
        map there are also `before`, `after` and `fraction`. Coordinates along "crossing":
        `trajectory`, `time`, `n` and `eps` or `surface`, and parameters of the body that vary:
        ``data.where(data.rho > 24.74, drop=True)``.
        """
        from .files.datasets import crossings_to_xarray

        return crossings_to_xarray(self)

    @public
    def plot(
        self,
        *names: int | str,
        color: Any = None,
        title: str | bool | None = None,
        ax: Any = None,
        label: str | None = None,
    ) -> Any:
        """Draw the points, as :meth:`Trajectories.plot` does states: ``points.plot("y", "py")``.

        By default the components are the first two that vary; of a canonical Hamiltonian field a
        coordinate and its momentum. `color` may also be "trajectory" or "time", along maps "n",
        along motions "surface", or a number for each point (K,). Of more than 1,000,000 points it
        draws as many, chosen at random.
        """
        from . import drawing  # which imports Matplotlib

        return drawing.plot_crossings(self, names, color, title, ax, label)


def span(times: FloatArray) -> str:
    """Return the range of times, as text."""
    return f"{times.min():g} to {times.max():g}" if times.size else "none"
