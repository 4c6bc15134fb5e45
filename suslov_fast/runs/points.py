"""The base of crossings of maps and of motions: points on a surface, and their trajectories."""

from __future__ import annotations

import operator
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray, short, wrong
from ..keywords import public
from .results import Result


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

    def _at_crossings(self, values: Any, axes: int = 0) -> Any:
        """Return for each crossing the value (...) of its trajectory, an array of `axes` axes."""
        inner = values.shape[values.ndim - axes :]
        by_trajectory = np.broadcast_to(values, (*self.count.shape, *inner)).reshape(-1, *inner)
        return by_trajectory[self.trajectory]

    def __len__(self) -> int:
        return len(self.trajectory)

    def _place(self, index: Any) -> tuple[tuple[int, ...], Any, int, Any]:
        """Return where in the batch a trajectory is, its body, its number, its crossings."""
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
        return place, body, i, np.searchsorted(self.trajectory, [i, i + 1])

    @classmethod
    @public
    def load(cls, path: str | os.PathLike[str]) -> Any:
        """Return the crossings in a file of `save`, along a map or along a motion.

        Parameters
        ----------
        path : str or path-like
            The name of the file.

        Returns
        -------
        Crossings or MotionCrossings
            An object equal to the saved one.

        Raises
        ------
        FileNotFoundError
            If there is no file of this name.
        ValueError
            If the file is damaged, or holds something else.

        Examples
        --------
        >>> from suslov_fast import Crossings
        >>> points = Crossings.load("section.npz")  # doctest: +SKIP
        """
        from .crossings import Crossings
        from .files.storage import load
        from .motion_crossings import MotionCrossings

        attributes = load(path, "Crossings", "MotionCrossings")
        kind: Any = Crossings if "map" in attributes else MotionCrossings
        return kind._of(attributes)
