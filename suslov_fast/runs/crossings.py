"""Crossings of a surface by orbits."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..checks import FloatArray, wrong
from ..engine.arguments import BodyOrField
from ..maps import Map
from .trajectories import equal

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Crossings:
    """The crossings of a surface by a batch of orbits, as :func:`crossings` returns them.

    There are K crossings, ordered by trajectory, then by n. Arrays are read-only.

    Attributes
    ----------
    trajectory : ndarray(int, shape=(K,))
        The index of the trajectory, in the batch flattened in C order.
    n : ndarray(int, shape=(K,))
        The orbit crosses between its states n and n + 1, counted from the initial state.
    before, after : ndarray(float, shape=(K, D))
        The states n and n + 1, those of :func:`iterate` bit for bit.
    fraction : ndarray(float, shape=(K,))
        a / (a - b) in [0, 1], for the values a and b of the surface at n and n + 1.
    count : ndarray(int, shape=(...))
        The number of crossings of each trajectory.
    status, failed_at, final : ndarray, shape=(...), (...) and (..., D)
        Those of a run of transient + steps steps. For a trajectory that ended at its crossing
        number `most`, `final` is the state after this crossing, and `status` and `failed_at` do
        not report later failures.
    body, eps
        The arguments of :func:`crossings`.
    map : Map
        The record of the map, an instance of `maps.Map`.

    Notes
    -----
    ``len(points)`` is K. Two objects are equal if all attributes above are equal, where NaN equals
    NaN; they are not hashable.

    Examples
    --------
    >>> from suslov_fast import QuadraticField, crossings
    >>> oscillator = QuadraticField.from_function(lambda x: (x[1], -x[0]), 2)
    >>> points = crossings(oscillator, [1.0, 0.0], 1 / 8, 200, lambda x: x[..., 0])
    >>> points
    Crossings(x: (4, 2), n: 37, 88, 138, 188, eps: 0.125, failed: 0 of 1)
    >>> points.time.round(2)
    array([ 4.72, 11.01, 17.3 , 23.59])
    """

    trajectory: NDArray[np.int64]
    n: NDArray[np.int64]
    before: FloatArray
    after: FloatArray
    fraction: FloatArray
    count: NDArray[np.int64]
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    final: FloatArray
    body: BodyOrField
    eps: float | FloatArray
    map: Map

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @cached_property
    def states(self) -> FloatArray:
        """The points ``before + fraction * (after - before)``, shape (K, D).

        There the linear interpolation of the surface's values between states n and n + 1 is 0.
        """
        share = self.fraction[:, np.newaxis]
        points: FloatArray = self.before + share * (self.after - self.before)
        points.flags.writeable = False
        return points

    @cached_property
    def time(self) -> FloatArray:
        """Times (n + fraction) eps of the crossings, shape (K,), negative for negative eps."""
        times: FloatArray = (self.n + self.fraction) * self._at_crossings(np.asarray(self.eps))
        times.flags.writeable = False
        return times

    if not TYPE_CHECKING:  # checkers know the attributes

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError that says where else a name is to be found."""
            if name in _INSTEAD:
                raise AttributeError(f"{name}: expected {_INSTEAD[name]}, got no such attribute")
            text = f"crossings have no attribute {name!r}"
            raise AttributeError(text, name=name, obj=self)

    @property
    def ok(self) -> bool:
        """True if no trajectory failed before it ended."""
        return bool((self.status >= 0).all())

    def _at_crossings(self, values: Any) -> Any:
        """Return, for each crossing, the value of its trajectory; values broadcast to the batch."""
        if values.size == 1:
            return np.full(len(self), values.item())
        return np.broadcast_to(values, self.count.shape).ravel()[self.trajectory]

    def __len__(self) -> int:
        return len(self.n)

    def __reduce__(self) -> Any:  # NumPy's pickles forget what is read-only
        return type(self), tuple(getattr(self, item.name) for item in fields(self))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Crossings):
            return NotImplemented
        names = [item.name for item in fields(self)]
        return all(equal(getattr(self, name), getattr(other, name)) for name in names)

    def of(self, index: Any) -> Crossings:
        """Return the crossings of one trajectory, with its own body and step size.

        Parameters
        ----------
        index : int or sequence of int
            An index of one element of `count`: a number, or one for each axis of the batch.

        Returns
        -------
        Crossings
            Its batch has shape ().
        """
        batch = self.count.shape
        try:
            given = tuple(index) if np.ndim(index) else (index,)
            pairs = zip(given, batch, strict=True)
            place = tuple(range(size)[operator.index(k)] for k, size in pairs)
        except (IndexError, TypeError, ValueError) as error:
            expected = f"an index of one trajectory of a batch of shape {batch}"
            kind = TypeError if isinstance(error, TypeError) else IndexError
            raise wrong("index", expected, checks.short(index), kind) from None
        body = self.body
        if body.shape:
            own = zip(place[len(batch) - len(body.shape) :], body.shape, strict=True)
            body = body[tuple(k if size > 1 else 0 for k, size in own)]
        i = int(np.ravel_multi_index(place, batch)) if place else 0
        begin, end = np.searchsorted(self.trajectory, [i, i + 1])
        parts = {name: getattr(self, name)[begin:end] for name in _OF_EACH}
        parts |= {name: np.array(getattr(self, name)[place]) for name in _OF_BATCH}
        eps = float(np.broadcast_to(self.eps, batch)[place])
        parts["trajectory"] = np.zeros(end - begin, np.int64)
        return Crossings(**parts, body=body, eps=eps, map=self.map)

    def to_xarray(self) -> xarray.Dataset:
        """Return the crossings as an `xarray.Dataset` of dimensions "crossing" and "component".

        The coordinates `trajectory`, `n`, `time` and `eps`, and each parameter of the body that
        varies, have the dimension "crossing": ``data.where(data.rho > 24, drop=True)`` selects
        crossings by a parameter.

        Returns
        -------
        xarray.Dataset
            Variables `before`, `after` and `fraction`, and the points under the name that the map
            has for states, "omega" or "x".
        """
        from .. import __version__

        dataset, map, body = checks.extra("xarray", "xarray").Dataset, self.map, self.body
        lines = {"before": "state n", "after": "state n + 1", map.variable: f"{map.meaning} there"}
        points = {"before": self.before, "after": self.after, map.variable: self.states}
        variables: dict[str, Any] = {
            name: (("crossing", "component"), points[name], {"long_name": text})
            for name, text in lines.items()
        }
        variables["fraction"] = "crossing", self.fraction
        coords: dict[str, Any] = {"component": np.array(body._labels, object)}
        coords |= {name: ("crossing", getattr(self, name)) for name in ("trajectory", "n", "time")}
        coords["eps"] = "crossing", self._at_crossings(np.asarray(self.eps))
        for name, values in varying(body).items():
            if name not in body._axes:
                coords[name] = "crossing", self._at_crossings(values)
            elif body._axes[name] == 1:  # J and I in n dimensions
                columns = np.moveaxis(values, -1, 0)
                each = np.stack([self._at_crossings(column) for column in columns], axis=-1)
                coords[name] = ("crossing", "component"), each
        return dataset(variables, coords, {"title": map.title, "version": __version__})

    def plot(
        self, components: Sequence[int | str] = (0, 1), color: Any = None, ax: Any = None
    ) -> Any:
        """Draw the crossings in the plane of two components, and return Matplotlib axes.

        `components` are indices or labels. `color` is the name of the quantity that colours them:
        a parameter that varies, "eps", "trajectory", "n" or "time"; or numbers, one for each
        crossing. By default it is the named parameter of a family. `ax` are axes to draw on.
        """
        plots = import_module("suslov_fast.plots.orbits")
        return plots.plot_crossings(self, components, color, ax)

    def __repr__(self) -> str:
        failed, n = np.count_nonzero(self.status < 0), self.n
        steps = f"{n.min()} ... {n.max()}" if n.size > 4 else ", ".join(map(str, n)) or "none"
        low, high = np.min(self.eps, initial=np.inf), np.max(self.eps, initial=-np.inf)
        eps = f"{low:g} ... {high:g}" if low < high else f"{low:g}"
        return (
            f"Crossings({self.map.variable}: {self.before.shape}, n: {steps}, eps: {eps}, "
            f"failed: {failed} of {self.status.size})"
        )


def varying(body: Any) -> dict[str, Any]:
    """Return the parameters of a body, for fields the named ones, that vary along its batch."""
    arrays, axes, names = body._arrays, body._axes, body.parameters
    return {name: arrays[name] for name in names if arrays[name].ndim > axes.get(name, 0)}


# Names that users of runs or of SciPy may try, and what to use instead.
_INSTEAD = {
    **dict.fromkeys(
        ("x", "omega", "y", "u", "points", "y_events"),
        "crossings.states, the points, or .before and .after",
    ),
    **dict.fromkeys(("t", "times", "t_events"), "crossings.time"),
}
_OF_EACH = "trajectory", "n", "before", "after", "fraction"
_OF_BATCH = "count", "status", "failed_at", "final"
