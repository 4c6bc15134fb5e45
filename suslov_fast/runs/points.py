"""The base of crossings and of changes: points on orbits, and their trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray
from ..keywords import public
from .results import Result

if TYPE_CHECKING:
    import pandas
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
        return f"Motion of a {type(self.body).__name__}"

    def __len__(self) -> int:
        return len(self.trajectory)

    @public
    def to_xarray(self) -> xarray.Dataset:
        """Return the crossings as a labelled `xarray.Dataset` (extra `xarray`).

        Returns
        -------
        xarray.Dataset
            Dimensions: "crossing" and "component". The points are "omega", or "x" for a field;
            along a map there are also `before`, `after` and `fraction`. Coordinates along
            "crossing": `trajectory`, `time`, `n` and `eps` or `surface`, and each parameter of the
            body that varies.

        Examples
        --------
        >>> data = points.to_xarray()  # doctest: +SKIP
        >>> chaotic = data.where(data.rho > 24.74, drop=True)  # doctest: +SKIP
        """
        from .files.datasets import crossings_to_xarray

        return crossings_to_xarray(self)

    @public
    def to_dataframe(self) -> pandas.DataFrame:
        """Return a table with a row for each point; needs pandas.

        Returns
        -------
        pandas.DataFrame
            Columns: the coordinates of :meth:`to_xarray`, parameters that vary, and the components
            of the state.

        Examples
        --------
        >>> points.to_dataframe().to_csv("points.csv")  # doctest: +SKIP
        """
        from .files.frames import of_points

        return of_points(self)

    @public
    def plot(
        self,
        *names: int | str | Sequence[int | str],
        components: Sequence[int | str] | None = None,
        color: Any = None,
        title: str | bool | None = None,
        ax: Any = None,
    ) -> Any:
        """Draw the crossings over two components, over time, or in space (extra `plots`).

        Of more than 1,000,000 crossings it draws as many, chosen at random.

        Parameters
        ----------
        *names : int or str
            The components to draw, as in ``points.plot("y", "py")``; one tuple, or `components`, is
            the same.
        components : sequence of int or str, optional
            Two or three indices or labels, such as ``("x2", "x3")``, or "time". By default the
            first two that vary; of a canonical Hamiltonian field a coordinate and its momentum.
        color : str or array_like(float, shape=(K,) or (...)), optional
            A parameter that varies, "trajectory" or "time", along maps also "eps" or "n", and along
            motions "surface"; a number for each crossing, or each trajectory; or a colour of
            Matplotlib. By default the parameter of a family, or else
            a colour for each trajectory.
        title : str or bool, optional
            True: the system and the number of crossings. By default none, unless crossings are
            left out.
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> points.plot(color="trajectory").figure.savefig("section.png")  # doctest: +SKIP
        """
        from . import drawing  # which imports Matplotlib

        chosen = names[0] if len(names) == 1 else names or components
        return drawing.plot_crossings(self, chosen, color, title, ax)


def span(times: FloatArray) -> str:
    """Return the range of times, as text."""
    return f"{times.min():g} to {times.max():g}" if times.size else "none"
