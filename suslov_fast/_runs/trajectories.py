"""Trajectories, the result of `iterate`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._checks import FloatArray, check_labels, instance, integer
from .._docs import filled
from .._engine.arguments import BodyOrField, States, thread_count
from .._engine.problem import Map, numbers_of_saved, problem_of
from .._engine.progress import Progress
from .._maps import map_of
from .running import OnSingular, compute_run

if TYPE_CHECKING:
    import xarray


def _quantity(
    name: str, shape: str = "(n_saved, ...)", with_eps: bool = True
) -> Callable[[Trajectories], FloatArray]:
    """Return the method that evaluates a public function for the saved states."""

    def method(self: Trajectories) -> FloatArray:
        if self._map is not map_of(self.body):  # functions of bodies are those of their first map
            raise TypeError(f"{name}: expected a map that has it, got a run of {self._map.name}")
        function = getattr(import_module("suslov_fast"), name)
        values: FloatArray = function(self.body, self.states, *(self.eps,) * with_eps)
        return values

    method.__name__, method.__qualname__ = name, f"Trajectories.{name}"
    arguments = "the saved states and eps" if with_eps else "the saved states"
    method.__doc__ = f"Return :func:`suslov_fast.{name}` of {arguments}, shape {shape}."
    return method


@dataclass(frozen=True, eq=False, repr=False)
class Trajectories:
    """A batch of trajectories, as :func:`iterate` returns it.

    Attributes
    ----------
    states : ndarray(float, shape=(n_saved, ..., D))
        The saved states; NaN from the first nonexistent state on. ``run.omega``, or ``run.x`` for
        a field, and ``np.asarray(run)`` are the same array.
    eps : float or ndarray(float, shape=(...))
        The step size, in the unit of time of the states.
    body
        The body or field.
    status : ndarray(int8, shape=(...))
        The :class:`Status` of each trajectory; negative if it failed.
    failed_at : ndarray(int, shape=(...))
        The index of the first state that does not exist, or -1.
    final : ndarray(float, shape=(..., D))
        The state after the last step, even if not saved; if saved, it may share memory with
        `states`.
    method : str
        The requested method.
    steps : int
        The number of steps.
    save_every : int or None
        The states 0, k, 2k, ... were saved, or only the last.
    attitude : ndarray(float, shape=(n_saved, ..., n, n)) or None
        The orientations of the body at the saved states, if requested.

    Notes
    -----
    ``len(run)`` is the number of saved states, ``run[k]`` is ``run.states[k]`` for any index of
    NumPy, and a run iterates over its states. Runs are equal if all of the above is equal, where
    NaN equals NaN; they are not hashable.

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
    status: NDArray[np.int8]
    failed_at: NDArray[np.int64]
    final: FloatArray
    method: str
    steps: int
    save_every: int | None
    attitude: FloatArray | Any = None  # with `Any`, callers need no test of None
    _map: Map = field(kw_only=True)
    # The arrays from which `extend` continues; `dataclasses.replace` makes a run without them.
    _resume: dict[str, NDArray[Any]] = field(init=False, default_factory=dict)

    @classmethod
    def _of(cls, **attributes: Any) -> Trajectories:
        run = cls.__new__(cls)
        vars(run).update(attributes)  # faster than a call of a frozen dataclass
        return run

    @filled
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
            Number of additional steps, 0 or more. Failures before them are not reported again.
        %(threads, on_singular, progress)s

        Returns
        -------
        Trajectories
            A new object, whose arrays also hold the states of this one.

        %(Raises: invalid, errors_of_runs)s

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> half = iterate(body, [1.0, 0.5], eps=0.2, steps=15)
        >>> whole = half.extend(15)
        >>> bool((whole.omega == iterate(body, [1.0, 0.5], eps=0.2, steps=30).omega).all())
        True
        """
        if "omega0" not in self._resume:
            raise ValueError(
                "extend: expected a run of iterate, or one that Trajectories.load read; a dataset "
                "of to_xarray, or a copy with other attributes, does not hold the data needed to "
                "resume"
            )
        batch, omega0, R0 = self.status.shape, self._resume["omega0"], self._resume.get("R0")
        omega0 = omega0.reshape(*batch, omega0.shape[-1])
        if R0 is not None:
            R0 = R0.reshape(*batch, *R0.shape[1:])
        threads = thread_count(threads)
        states = States(self.body, omega0, self.eps, batch, threads, orientation=R0)
        problem = problem_of(self._map, states, self.method)
        options = self.save_every, on_singular, progress
        return compute_run(Trajectories._of, problem, steps, *options, earlier=self)

    @property
    def omega(self) -> FloatArray:
        """The saved states, if they are angular velocities."""
        return self._states_called("omega")

    @property
    def x(self) -> FloatArray:
        """The saved states, if they are those of a field."""
        return self._states_called("x")

    def _states_called(self, name: str) -> FloatArray:
        """Return the saved states by the name that the map gives them."""
        variable = getattr(vars(self).get("_map"), "variable", "states")
        if name == variable:
            return self.states
        if name in ("omega", "x"):
            raise AttributeError(
                f"{name}: expected {variable} or states, the names of the states of a run of "
                f"{type(self.body).__name__}"
            )
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    if not TYPE_CHECKING:  # for which every name would be one of the states
        __getattr__ = _states_called

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
        names = [item.name for item in fields(self) if item.name != "_resume"]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)

    @cached_property
    def n(self) -> NDArray[np.int64]:
        """Step numbers of the saved states, shape (n_saved,)."""
        return numbers_of_saved(self.steps, self.save_every)

    @property
    def time(self) -> FloatArray:
        """Times n eps of the saved states, (n_saved,), or (n_saved, ...) if eps varies."""
        n = self.n if np.ndim(self.eps) == 0 else self.n.reshape(-1, *(1,) * self.status.ndim)
        with np.errstate(over="ignore"):
            times: FloatArray = n * np.asarray(self.eps)
        return times

    @property
    def ok(self) -> bool:
        """True if every trajectory finished."""
        return bool((self.status >= 0).all())

    first_integral = _quantity("first_integral")
    energy = _quantity("energy", with_eps=False)
    modified_energy = _quantity("modified_energy")
    criticality = _quantity("criticality")
    to_xy = _quantity("to_xy", "(n_saved, ..., 2)", with_eps=False)
    reaction = _quantity("reaction", "(n_saved, ...) or (n_saved, ..., n - 1, n - 1)")

    @filled
    def plot(
        self, *, components: tuple[int, int] = (0, 1), lines: bool | None = None, ax: Any = None
    ) -> Any:
        """Draw the saved states of all trajectories in the plane of two components.

        States are dots. If there are several trajectories, colours show the size of the first
        state, and a colour bar its values.

        Parameters
        ----------
        components : tuple of int
            Indices of the components on the horizontal and the vertical axis.
        lines : bool, optional
            Draw lines from each saved state to the next. By default only if every state is saved
            and the median of their lengths is below 1/20 of the extent of all states shown.
        %(ax)s

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        %(invalid)s
        ImportError
            If Matplotlib is not installed (extra `plots`).

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> ax = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=100).plot()
        >>> len(ax.lines)
        2
        """
        from .._show.style import style

        D = self.states.shape[-1]
        if D == 1:
            how = "draw run.states[..., 0] over run.time"
            raise ValueError(f"plot: expected states with at least 2 components, got 1: {how}")
        expected = f"an integer from 0 to {D - 1}"
        first, second = (integer("components", k, 0, expected) for k in components)
        if max(first, second) >= D:
            raise ValueError(f"components: expected {expected}, got {max(first, second)}")
        states = self.states.reshape(len(self), -1, D)
        if lines is None and (np.diff(self.n) > 1).any():
            lines = False
        symbols = self._map.symbols(self.body)
        with style():
            from .._show.figures import axes_for, plot_orbits

            axes = axes_for(ax, (5.0, 5.0))
            plot_orbits(axes, states, (first, second), lines)
            axes.set_xlabel(symbols[first])
            axes.set_ylabel(symbols[second])
            if self._map.variable == "omega":  # the components of a field may have different units
                axes.set_aspect("equal", adjustable="datalim")
        return axes

    @filled
    def to_xarray(
        self, dims: str | Sequence[str] | None = None, coords: Mapping[Any, Any] | None = None
    ) -> xarray.Dataset:
        """Return the run as an `xarray.Dataset`, without the data needed to resume it.

        Parameters are not repeated along axes on which they do not vary, `final` is a variable only
        if the last state is not saved, and no array is copied.

        %(Parameters: dims, coords)s

        Returns
        -------
        xarray.Dataset
            Its dimensions are "n", those of the batch, and "component". Its methods `to_netcdf` and
            `to_zarr` write it without loss; only files of :meth:`save` can be extended.

        %(Raises: invalid, needs_xarray)s

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> orbits = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=25)
        >>> data = orbits.to_xarray(dims="start", coords={"start": ["fast", "slow"]})
        >>> data.omega.sel(start="slow", n=0, component="Omega2").item()
        -0.7
        """
        from .labelled import dataset_of, with_time
        from .schema import entries_of

        return with_time(dataset_of(self.body, entries_of(self), dims, coords))

    @classmethod
    @filled
    def from_xarray(cls, dataset: xarray.Dataset) -> Trajectories:
        """Return the run of a dataset from :meth:`to_xarray`, or of a part of its batch.

        The result cannot be resumed: its :meth:`extend` raises ValueError.

        Parameters
        ----------
        dataset : xarray.Dataset
            The dataset, or a selection of trajectories from it.

        Returns
        -------
        Trajectories

        %(Raises: invalid, needs_xarray)s
        """
        from .labelled import entries_of_dataset
        from .schema import run_of

        run = cls._of(**run_of(entries_of_dataset(dataset)))
        states = dataset[run._map.variable].isel(n=0).transpose(..., "component")
        check_labels("dataset", states, run._map.components(run.body))
        return run

    @filled
    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the run to a file that :meth:`load` reads, without loss.

        The file appears under its name only when it is complete.

        Parameters
        ----------
        %(path)s
        overwrite : bool
            True replaces an existing file, whose mode is kept, or the target of a link.

        Raises
        ------
        OSError
            If the file cannot be written; FileExistsError if it exists and is not to be replaced.
        TypeError, ValueError
            If the name ends otherwise. ``run.to_xarray().to_netcdf(path)`` writes NetCDF, and
            :func:`ensemble` a Zarr store.
        """
        from .files import place_for
        from .schema import entries_of

        instance("overwrite", overwrite, bool)
        with place_for(path, overwrite) as put:
            put(**entries_of(self))

    @classmethod
    @filled
    def load(cls, path: str | os.PathLike[str]) -> Trajectories:
        """Read a run written by :meth:`save`.

        %(Parameters: path)s

        Returns
        -------
        Trajectories

        Raises
        ------
        OSError
            If the file cannot be read.
        MemoryError
            If the run does not fit in memory.
        TypeError, ValueError
            If the name ends otherwise, or the file holds something else or is damaged.
        """
        from .files import read_run

        return cls._of(**read_run(path))

    def __repr__(self) -> str:
        failed, n = np.count_nonzero(self.status < 0), self.n
        steps = f"{n[0]}, {n[1]} ... {n[-1]}" if n.size > 2 else ", ".join(map(str, n))
        return (
            f"Trajectories({self._map.variable}: {self.states.shape}, n: {steps}, "
            f"eps: {_range(self.eps)}, failed: {failed} of {self.status.size})"
        )


def _equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return type(a) is type(b) and bool(a == b)


def _range(eps: float | FloatArray) -> str:
    if np.size(eps) == 0:
        return "none"
    low, high = np.min(eps), np.max(eps)
    return f"{low:g}" if low == high else f"{low:g} ... {high:g}"
