"""The base of crossings of maps and of motions: points on a surface, and their trajectories."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray, short, wrong
from ..keywords import public
from .columns import OF_KIND
from .results import Result

if TYPE_CHECKING:
    import xarray


class Points(Result):
    """Points in the order of trajectories; subclasses are dataclasses with these attributes."""

    trajectory: NDArray[np.int64]
    states: Any
    time: Any
    count: NDArray[np.int64]
    status: NDArray[np.int8]
    final: FloatArray
    body: BodyOrField

    called = "a result of crossings"
    kinds = "Crossings", "MotionCrossings"
    coordinates: ClassVar[tuple[str, ...]]  # attributes of crossings that label them

    def _at_crossings(self, values: Any, axes: int = 0) -> Any:
        """Return for each crossing the value (...) of its trajectory, an array of `axes` axes."""
        inner = values.shape[values.ndim - axes :]
        by_trajectory = np.broadcast_to(values, (*self.count.shape, *inner)).reshape(-1, *inner)
        return by_trajectory[self.trajectory]

    def __len__(self) -> int:
        return len(self.trajectory)

    def _parts_of(self, place: tuple[int, ...], i: int) -> dict[str, Any]:
        """Return further attributes of one trajectory, at a place of the batch, with its number."""
        return {}

    @public
    def of(self, index: Any) -> Self:
        """Return the crossings of one trajectory, with its body.

        Parameters
        ----------
        index : int or sequence of int
            The index of the trajectory in the batch, with a number for each axis.

        Returns
        -------
        Crossings or MotionCrossings
            A result whose batch has the shape (). Its `extend` needs the surface as an argument.

        Raises
        ------
        IndexError, TypeError
            If `index` does not select one trajectory.

        Examples
        --------
        >>> from suslov_fast import QuadraticField, crossings
        >>> oscillator = QuadraticField.from_function(lambda x: (x[1], -x[0]), 2)
        >>> starts = [[1.0, 0.0], [0.0, -1.0]]
        >>> points = crossings(oscillator, starts, 1 / 8, 100, lambda x: x[..., 0])
        >>> points.of(1).n
        array([25, 75])
        """
        batch = self.count.shape
        try:
            numbers = tuple(index) if np.ndim(index) else (index,)
            pairs = zip(numbers, batch, strict=True)
            place = tuple(range(size)[operator.index(k)] for k, size in pairs)
        except (IndexError, TypeError, ValueError) as error:
            expected = f"an index of one trajectory of a batch of shape {batch}"
            kind = TypeError if isinstance(error, TypeError) else IndexError
            raise wrong("index", expected, short(index), kind) from None
        body: Any = self.body
        if body.shape:
            body_place = zip(place[len(batch) - len(body.shape) :], body.shape, strict=True)
            body = body[tuple(k if size > 1 else 0 for k, size in body_place)]
        i = int(np.ravel_multi_index(place, batch)) if place else 0
        begin, end = np.searchsorted(self.trajectory, [i, i + 1])
        parts = self.__getstate__() | {"body": body, **self._parts_of(place, i)}
        for column in OF_KIND[type(self).__name__]:
            if column.axes.startswith("crossing"):
                parts[column.name] = getattr(self, column.name)[begin:end]
            elif column.axes.startswith("batch"):
                parts[column.name] = np.array(getattr(self, column.name)[place])
        return self._of(parts | {"trajectory": np.zeros(end - begin, np.int64)})

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

        Raises
        ------
        ImportError
            If xarray is not installed.

        Examples
        --------
        >>> data = points.to_xarray()  # doctest: +SKIP
        >>> chaotic = data.where(data.rho > 24.74, drop=True)  # doctest: +SKIP
        """
        from .files.datasets import crossings_to_xarray

        return crossings_to_xarray(self)

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
            Matplotlib. By default the parameter of a family, else the level of the conserved
            quantity, if it differs by more than 2 %.
        title : str or bool, optional
            True: the system and the number of crossings. By default none, unless crossings are
            left out.
        ax : matplotlib.axes.Axes, optional
            Axes to draw on; by default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        TypeError, ValueError
            If there is no such component or colour, or `ax` has the wrong kind.

        Examples
        --------
        >>> points.plot(color="trajectory").figure.savefig("section.png")  # doctest: +SKIP
        """
        from . import plot  # which imports Matplotlib

        chosen = names[0] if len(names) == 1 else names or components
        return plot.plot_crossings(self, chosen, color, title, ax)
