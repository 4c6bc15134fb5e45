"""Crossings of a surface by orbits."""

from __future__ import annotations

import operator
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..bodies.classes import BodyOrField
from ..checks import FloatArray, integer, one_of, wrong
from ..engine.problem import Problem
from ..engine.status import ON_SINGULAR, OnSingular, report_failures
from ..engine.stretches import March, Progress, Progressed, reporter
from ..engine.threads import thread_count
from ..maps import Map
from .search import Search, Surface, check_surface
from .trajectories import equal, in_short

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
        The states n and n + 1, those of :func:`iterate` bit for bit. A return map starts from
        `after`: a point of `states` may lie below the surface by rounding, and return at once.
    fraction : ndarray(float, shape=(K,))
        a / (a - b) in [0, 1], for the values a and b of the surface at n and n + 1.
    count : ndarray(int, shape=(...))
        The number of crossings of each trajectory.
    status, failed_at, final : ndarray, shape=(...), (...) and (..., D)
        Those of a run of transient + steps steps. For a trajectory that ended at its crossing
        number `most`, `final` is the state after this crossing, and `status` and `failed_at` do
        not report later failures and poles. Beyond a pole, ``n + 1 >= failed_at`` where the status
        is PASSED_POLE, crossings are those of the map, and say nothing about the motion.
    body, eps, steps, transient, direction, most, method
        The arguments of :func:`crossings`; `steps` with those of :meth:`extend`.
    map : Map
        The record of the map, an instance of `maps.Map`.

    Notes
    -----
    ``len(points)`` is K. Two objects are equal if all attributes above are equal, where NaN equals
    NaN, whatever their surfaces are; they are not hashable.

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
    method: str
    steps: int
    transient: int
    direction: int
    most: int | None
    # What `extend` continues: the state that the march has reached, the numbers (B, C) that steps
    # carry, the values of the surface there, (B,), if they are known, and the surface.
    # `dataclasses.replace` makes a result without them.
    _n: int = field(init=False, default=0, compare=False)
    _carry: FloatArray | None = field(init=False, default=None, compare=False)
    _last: FloatArray | None = field(init=False, default=None, compare=False)
    _surface: Surface | None = field(init=False, default=None, compare=False)

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
                raise AttributeError(f"no attribute {name!r}: use {_INSTEAD[name]}")
            text = f"crossings have no attribute {name!r}"
            raise AttributeError(text, name=name, obj=self)

    @property
    def ok(self) -> bool:
        """True if no trajectory failed before it ended."""
        return bool((self.status >= 0).all())

    def _at_crossings(self, values: Any, axes: int = 0) -> Any:
        """Return, for each crossing, the value of its trajectory, with its last axes if `axes`."""
        inner = values.shape[values.ndim - axes :]
        each = np.broadcast_to(values, (*self.count.shape, *inner)).reshape(-1, *inner)
        return each[self.trajectory]

    def __len__(self) -> int:
        return len(self.n)

    def __reduce__(self) -> Any:  # NumPy's pickles forget what is read-only
        given = tuple(getattr(self, item.name) for item in fields(self) if item.init)
        return type(self), given, {"_n": self._n, "_carry": self._carry, "_last": self._last}

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Crossings):
            return NotImplemented
        names = [item.name for item in fields(self) if item.compare]
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
        parts |= {name: getattr(self, name) for name in ("map", *_NUMBERS)}
        points = Crossings(**parts, body=body, eps=eps)
        if self._carry is not None:
            last = None if self._last is None else self._last[i : i + 1]
            points._keep(self._n, self._carry[:, i : i + 1], last, None if batch else self._surface)
        return points

    def _keep(self, n: int, carry: Any, last: Any, surface: Any = None) -> None:
        """Keep what `extend` continues."""
        vars(self).update(_n=n, _carry=carry, _last=last, _surface=surface)
        self.__post_init__()

    def extend(
        self,
        steps: int,
        surface: Surface | None = None,
        *,
        threads: int | None = None,
        on_singular: OnSingular = "warn",
        progress: Progress = None,
    ) -> Crossings:
        """Continue the run; the result is bit-identical to one call of :func:`crossings`.

        Trajectories that ended at their crossing number `most` stay ended.

        Parameters
        ----------
        steps : int
            Number of additional steps, 0 or more. A run that ended in its transient finishes this
            first.
        surface : callable, optional
            The surface, which files, pickles and members by `of` do not have; by default that of
            :func:`crossings`.
        threads, on_singular, progress
            As in :func:`crossings`.

        Returns
        -------
        Crossings
            A new object, which also has the crossings of this one. A copy made by
            `dataclasses.replace` lacks what is needed to go on: a ValueError.

        Examples
        --------
        >>> from suslov_fast import QuadraticField, crossings
        >>> oscillator = QuadraticField.from_function(lambda x: (x[1], -x[0]), 2)
        >>> half = crossings(oscillator, [1.0, 0.0], 1 / 8, 100, lambda x: x[..., 0])
        >>> half.extend(100).n
        array([ 37,  88, 138, 188])
        """
        if self._carry is None:
            raise ValueError(
                "extend: this is a part or a copy: extend the result of crossings itself"
            )
        if surface is None and (surface := self._surface) is None:
            text = "surface: files, pickles and of() do not keep it: pass extend(steps, surface)"
            raise ValueError(text)
        total, batch = self.steps + integer("steps", steps, 0), self.count.shape
        one_of("on_singular", on_singular, ON_SINGULAR)
        reports = reporter(progress, self.transient + total - self._n)
        check_surface(surface)
        problem = Problem(self.map, self.body, self.final, self.eps, batch, thread_count(threads))
        reached = Progressed(self._n, self.final, self.status, self.failed_at, self._carry, None)
        march = March(problem, self.method, reached)
        search = Search(march, surface, self.direction, self.most, self)
        return searched(search, total, self.transient, self.method, on_singular, reports)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the crossings to `path`, a name that ends in .npz, without loss.

        The file has all but the surface, and appears under its name when it is complete. An
        existing file is an error unless `overwrite` is True.
        """
        from .storage import save

        save(self, path, overwrite)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Crossings:
        """Read crossings written by :meth:`save`; ValueError if the file is something else."""
        from .storage import load

        return cls._of(load(path, "Crossings"))

    @classmethod
    def _of(cls, found: dict[str, Any]) -> Crossings:
        """Return the crossings that a file has."""
        own = {name: found.pop(name) for name in ("_n", "_carry", "_last")}
        points = cls(**found)
        points._keep(own["_n"], own["_carry"], own["_last"])
        return points

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
        from .datasets import crossings_to_xarray

        return crossings_to_xarray(self)

    def plot(
        self, components: Sequence[int | str] | None = None, color: Any = None, ax: Any = None
    ) -> Any:
        """Draw the crossings in the plane of two components, and return Matplotlib axes.

        `components` are indices or labels, by default of the first two that vary: a section x1 = 0
        is drawn over x2 and x3. `color` is the name of the quantity that colours the points: a
        parameter that varies, "eps", "trajectory", "n" or "time"; or numbers, one for each crossing
        (K,) or for each trajectory (...). By default it is the named parameter of a family. `ax`
        are axes to draw on.
        """
        from . import plot  # which imports Matplotlib

        return plot.plot_crossings(self, components, color, ax)

    def __repr__(self) -> str:
        n = self.n
        steps = f"{n.min()} ... {n.max()}" if n.size > 4 else ", ".join(map(str, n))
        if not n.size:
            steps = {1: "none upwards", -1: "none downwards", 0: "none"}[self.direction]
        return f"Crossings({self.map.variable}: {self.before.shape}, n: {steps}, {in_short(self)})"


def searched(
    search: Search,
    steps: int,
    transient: int,
    method: str,
    on_singular: OnSingular,
    reports: Any,
) -> Crossings:
    """Carry out a search, report failures on the way, and return the crossings."""
    march = search.march
    since = 0 if search.earlier is None else march.n + 1
    with reports as report:
        search.run(transient, transient + steps, report)
    if search.is_stopped:
        steps = max(march.n - transient, 0)
    problem, most = march.problem, search.most
    points = Crossings(
        **search.result(), body=problem.body, eps=problem.eps, map=problem.map, method=method,
        steps=steps, transient=transient, direction=search.direction, most=most,
    )  # fmt: skip
    points._keep(march.n, march.carry, search.last, search.surface)
    report_failures(points, on_singular, since, name="crossings")
    return points


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
_NUMBERS = "method", "steps", "transient", "direction", "most"
