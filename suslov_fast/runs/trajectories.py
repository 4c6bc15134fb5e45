"""The result of an iteration."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.classes import BodyOrField
from ..checks import FloatArray, checked_out, integer, one_of
from ..engine.problem import Problem
from ..engine.status import ON_SINGULAR, OnSingular, count_in_words, report_failures
from ..engine.stretches import March, Progress, Progressed, reporter
from ..engine.threads import thread_count
from ..maps import Map

if TYPE_CHECKING:
    import xarray


# How a run has what results of other packages have under these names; x is that of the states.
_INSTEAD = {
    **dict.fromkeys(
        ("sel", "isel"),
        "run.to_xarray().sel(...), which finds trajectories by the value of a parameter, or "
        "run.{x}[:, k], the states of trajectory k",
    ),
    "t": "run.time, the times of the saved states; t of the paper is run.criticality()",
    **dict.fromkeys(
        ("y", "u", "X", "values", "data", "trajectory", "trajectories", "solution", "sol"),
        "run.{x}, the states with time on the first axis, so that y of solve_ivp is run.{x}.T",
    ),
    **dict.fromkeys(("success", "retcode"), "run.ok, or run.status for each trajectory"),
    "message": "run.status and run.failed_at, with a Status for each trajectory",
    "shape": "run.{x}.shape",
    "to_numpy": "run.{x}, or np.asarray(run)",
    **dict.fromkeys(
        ("to_dataframe", "to_pandas", "to_csv", "to_netcdf", "to_zarr"),
        "run.to_xarray(), whose Dataset has to_dataframe and to_netcdf",
    ),
}


def _quantity(name: str) -> Callable[[Trajectories], FloatArray]:
    """Return the method that evaluates a public function for the saved states."""

    def method(self: Trajectories) -> FloatArray:
        return self._value(name, self.states)

    method.__name__, method.__qualname__ = name, f"Trajectories.{name}"
    method.__doc__ = f"Return :func:`suslov_fast.{name}` of the saved states, shape (n_saved, ...)."
    _QUANTITIES.add(name)
    return method


# Names of these methods; a run has those of its map.
_QUANTITIES: set[str] = set()


def _states(name: str, what: str) -> Any:
    """Return the property of the saved states under the name that only some maps have."""

    def states(self: Trajectories) -> FloatArray:
        if name != self.map.variable:
            raise AttributeError  # `__getattr__` has the words
        return self.states

    return property(states, doc=f"The saved states, if they are {what}.")


@dataclass(frozen=True, eq=False, repr=False)
class Trajectories:
    """A batch of trajectories, as :func:`iterate` returns it.

    Attributes
    ----------
    states : ndarray(float, shape=(n_saved, ..., D))
        The saved states; NaN from the first nonexistent state on. ``run.omega``, or ``run.x`` for
        a field, and ``np.asarray(run)`` are the same array.
    body, eps, method, steps, save_every
        The arguments of :func:`iterate`; `steps` with those of :meth:`extend`.
    map : Map
        The record of the map, which says what the run has.
    status : ndarray(int8, shape=(...))
        The :class:`Status` of each trajectory; negative if it failed.
    failed_at : ndarray(int, shape=(...))
        The number of the first state that does not exist, if a trajectory failed; of the first
        state beyond a pole, if its status is PASSED_POLE; else -1.
    final : ndarray(float, shape=(..., D))
        The state after the last step, even if not saved.
    attitude : ndarray(float, shape=(n_saved, ..., n, n)) or None
        The orientations of the body at the saved states, if requested.

    Notes
    -----
    ``len(run)`` is the number of saved states, ``run[k]`` is ``run.states[k]`` for any index of
    NumPy, and a run iterates over its states. Runs are equal if all of the above is equal, where
    NaN equals NaN; they are not hashable. All arrays are read-only; a copy, as
    ``run.states.copy()``, is not. An array that was passed as `out` stays writeable.

    Examples
    --------
    >>> from suslov_fast import Suslov3D, iterate
    >>> orbit = iterate(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.2, steps=25)
    >>> orbit
    Trajectories(omega: (26, 2), n: 0, 1 ... 25, eps: 0.2, failed: 0 of 1)
    >>> orbit.energy().shape
    (26,)
    """

    states: FloatArray
    eps: float | FloatArray
    body: BodyOrField
    map: Map
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    final: FloatArray
    method: str
    steps: int
    save_every: int | None
    attitude: FloatArray | Any = None  # with `Any`, callers need no test of None
    # What `extend` continues, beside the last state: numbers (B, C) and orientations (B, n, n).
    # `dataclasses.replace` makes a run without them.
    _carry: FloatArray | None = field(init=False, default=None, compare=False)
    _turned: FloatArray | None = field(init=False, default=None, compare=False)

    def __post_init__(self) -> None:  # arrays that a caller may go on to use
        arrays = {name: each for name, each in vars(self).items() if isinstance(each, np.ndarray)}
        vars(self).update({name: _read_only(each.view()) for name, each in arrays.items()})

    def __setstate__(self, attributes: dict[str, Any]) -> None:  # of copies, which own their arrays
        for value in attributes.values():
            if type(value) is np.ndarray:
                value.setflags(write=False)
        object.__setattr__(self, "__dict__", attributes)

    @classmethod
    def _of(cls, attributes: dict[str, Any]) -> Trajectories:
        """Return a run with these attributes, whose arrays belong to it."""
        run = cls.__new__(cls)
        run.__setstate__(attributes)  # faster than a call of the class
        return run

    def extend(
        self,
        steps: int,
        *,
        threads: int | None = None,
        on_singular: OnSingular = "warn",
        progress: Progress = None,
    ) -> Trajectories:
        """Continue the run; the result is bit-identical to an uninterrupted run.

        Parameters
        ----------
        steps : int
            Number of additional steps, 0 or more. Failures and poles before them are not reported
            again.
        threads, on_singular, progress
            As in :func:`iterate`.

        Returns
        -------
        Trajectories
            A new object, whose arrays also hold the states of this one. A copy made by
            `dataclasses.replace` lacks what is needed to go on: a ValueError.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> half = iterate(body, [1.0, 0.5], eps=0.2, steps=15)
        >>> half.extend(15) == iterate(body, [1.0, 0.5], eps=0.2, steps=30)
        True
        """
        if self._carry is None:
            raise ValueError(
                "extend: this is a part or a copy of a run: extend the result of iterate itself"
            )
        total, batch = self.steps + integer("steps", steps, 0), self.status.shape
        problem = Problem(self.map, self.body, self.final, self.eps, batch, thread_count(threads))
        reached = Progressed(
            self.steps, self.final, self.status, self.failed_at, self._carry, self._turned
        )
        march = March(problem, self.method, reached)
        about = self.method, total, self.save_every
        return run_to_end(march, *about, on_singular, progress, earlier=self)

    def _value(self, name: str, states: FloatArray) -> FloatArray:
        """Return a function of states of the map of this run."""
        from ..quantities.evaluation import evaluate

        return evaluate(name, self.body, states, self.eps, map=self.map)

    omega = _states("omega", "angular velocities")
    x = _states("x", "those of a field")

    if not TYPE_CHECKING:  # checkers know the attributes

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError that says how the run has what users of others look for."""
            received = f"a run has no attribute {name!r}"
            if "states" in vars(self):
                x = self.map.variable
                if name in ("omega", "x"):
                    raise AttributeError(
                        f"no attribute {name!r}: the states of this run are run.{x}"
                    )
                instead = _INSTEAD.get(name, "").format(x=x)
                if name in self.body._labels:
                    instead = f"run.{x}[..., {self.body._labels.index(name)}]"
                elif name in import_module("suslov_fast").__all__:
                    instead = f"suslov_fast.{name}(run.body, run.{x}, ...)"
                if instead:
                    raise AttributeError(f"no attribute {name!r}: use {instead}")
            raise AttributeError(received, name=name, obj=self)

    def __dir__(self) -> list[str]:
        other = "x" if self.map.variable == "omega" else "omega"
        hidden = {other, *_QUANTITIES} - {*self.map.functions(self.body)}
        return [name for name in super().__dir__() if name not in hidden]

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: Any) -> Any:
        return self.states[index]

    def __iter__(self) -> Iterator[FloatArray]:
        return iter(self.states)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is None:  # which NumPy 1.26 does not take
            return np.asarray(self.states, dtype)
        return np.array(self.states, dtype, copy=copy)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Trajectories):
            return NotImplemented
        names = [item.name for item in fields(self) if item.compare]
        return all(equal(getattr(self, name), getattr(other, name)) for name in names)

    @cached_property
    def n(self) -> NDArray[np.int64]:
        """Step numbers of the saved states, shape (n_saved,)."""
        if self.save_every is None:
            return _read_only(np.array([self.steps]))
        return _read_only(self.save_every * np.arange(self.steps // self.save_every + 1))

    @property
    def time(self) -> FloatArray:
        """Times n eps of the saved states, (n_saved,), or (n_saved, ...) if eps varies."""
        n = self.n if np.ndim(self.eps) == 0 else self.n.reshape(-1, *(1,) * self.status.ndim)
        times: FloatArray = _read_only(n * np.asarray(self.eps))
        return times

    @property
    def ok(self) -> bool:
        """True if every trajectory finished, also beyond a pole."""
        return bool((self.status >= 0).all())

    first_integral = _quantity("first_integral")
    energy = _quantity("energy")
    modified_energy = _quantity("modified_energy")
    criticality = _quantity("criticality")
    to_xy = _quantity("to_xy")
    reaction = _quantity("reaction")

    def plot(
        self,
        *,
        components: Sequence[int | str] = (0, 1),
        lines: bool | None = None,
        color: Any = None,
        ax: Any = None,
    ) -> Any:
        """Draw the saved states in the plane of two components, and return Matplotlib axes.

        `components` are their indices or labels, as ``("x1", "x3")``. `lines` joins consecutive
        states, by default where all are saved and are close. `color` is the name of what gives the
        colours, a parameter that varies or "eps"; or numbers (...), one for each orbit. By default
        it is the named parameter of a family, else the level of the conserved quantity. `ax` are
        axes to draw on. Of many states some are drawn: whole orbits or pieces of them, if joined.
        """
        from . import plot  # which imports Matplotlib

        return plot.plot_run(self, components, lines, color, ax)

    def to_xarray(
        self, dims: str | Sequence[str] | None = None, coords: Mapping[Any, Any] | None = None
    ) -> xarray.Dataset:
        """Return the run as an `xarray.Dataset`, without what `extend` needs.

        Parameters
        ----------
        dims : str or sequence of str, optional
            Names for the axes of the batch; by default that of a parameter of the body that varies
            along this axis alone, else "trajectory", or "batch_0", "batch_1", ... The name of such
            a parameter, or "eps", makes it the coordinate: ``data.sel(eps=0.2)``.
        coords : mapping, optional
            Coordinates along them, as `xarray.Dataset.assign_coords` takes them.

        Returns
        -------
        xarray.Dataset
            Its dimensions are "n", those of the batch, and "component", so that without `attitude`
            ``to_dataframe()`` has a row for each component of each state. Coefficients of fields
            are coordinates, a column for each monomial that occurs: linear_2 for x2, quadratic_1_3
            for x1 x3.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> orbits = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=25)
        >>> data = orbits.to_xarray(dims="start", coords={"start": ["fast", "slow"]})
        >>> data.omega.sel(start="slow", n=0, component="Omega2").item()
        -0.7
        """
        from .datasets import to_xarray

        return to_xarray(self, dims, coords)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the run to `path`, a name that ends in .npz, without loss.

        The file appears under its name when it is complete. An existing file is an error unless
        `overwrite` is True.
        """
        from .storage import save

        save(self, path, overwrite)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Trajectories:
        """Read a run written by :meth:`save`; ValueError if the file is something else."""
        from .storage import load

        return cls._of(load(path, "Trajectories"))

    def __repr__(self) -> str:
        n = self.n
        steps = f"{n[0]}, {n[1]} ... {n[-1]}" if n.size > 2 else ", ".join(map(str, n))
        states = f"{self.map.variable}: {self.states.shape}"
        return f"Trajectories({states}, n: {steps}, {in_short(self)})"


def run_to_end(
    march: March,
    method: str,
    steps: int,
    save_every: int | None,
    on_singular: OnSingular,
    progress: Progress,
    out: FloatArray | None = None,
    earlier: Trajectories | None = None,
) -> Trajectories:
    """Continue a march to state `steps`; return its run, after the states of an `earlier` one."""
    one_of("on_singular", on_singular, ON_SINGULAR)
    start, every = march.n, save_every or 0
    reports = reporter(progress, steps - start)
    if out is not None:  # which may overlap state 0
        rows = steps // every + 1 if every else 1
        out = checked_out(out, (rows, *march.final.shape))
        march.omega0 = march.omega0.copy()
    with reports as report:
        saved, turns = march.to(steps, every, out, report)
    steps = march.n  # fewer, if `progress` ended the run
    if out is not None:
        saved = saved.view()  # that of the run becomes read-only, `out` stays as it is
    if every and earlier is not None and start > 0:
        saved = np.concatenate([earlier.states, saved])
        turns = None if turns is None else np.concatenate([earlier.attitude, turns])
    found = {
        "states": saved,
        "eps": march.problem.eps,
        "body": march.problem.body,
        "map": march.problem.map,
        "status": march.status,
        "failed_at": march.failed_at,
        "final": march.final,
        "method": method,
        "steps": steps,
        "save_every": save_every,
        "attitude": turns,
        "_carry": march.carry,
        "_turned": march.turned,
    }
    run = Trajectories._of(found)
    report_failures(run, on_singular, start + 1 if earlier else 0)
    return run


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array


def in_short(found: Any) -> str:
    """Return the step sizes and the number of failures of a run or of crossings."""
    low, high = np.min(found.eps, initial=np.inf), np.max(found.eps, initial=-np.inf)
    eps = f"{low:g} ... {high:g}" if low < high else f"{low:g}"
    return f"eps: {eps}, {count_in_words(found.status)}"


def equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return type(a) is type(b) and bool(a == b)
