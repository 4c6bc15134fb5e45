"""The base of the results of runs: read-only arrays, equality, copies and files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..engine.status import count_in_words
from ..keywords import nearest, public

T = TypeVar("T", bound=np.generic)

# Attributes that a run lacks, such as those of other packages, and what to use; {x} is omega or x.
INSTEAD_IN_RUNS = {
    **dict.fromkeys(
        ("sel", "isel"),
        "run.to_xarray().sel(...), which finds trajectories by the value of a parameter, or "
        "run.{x}[:, k], the states of trajectory k",
    ),
    "t": "run.time, the times of the saved states; t of the paper is run.criticality()",
    "F": "run.first_integral()",
    **dict.fromkeys(
        ("y", "u", "X", "values", "data", "trajectory", "trajectories", "solution", "sol"),
        "run.{x}, the states with time on the first axis, so that y of solve_ivp is run.{x}.T",
    ),
    **dict.fromkeys(("success", "retcode"), "run.ok, or run.status for each trajectory"),
    **dict.fromkeys(("dt", "h", "step_size"), "run.eps, the step size"),
    "T": "run.{x}.T, or run.time",
    **dict.fromkeys(("last", "end"), "run.final"),
    **dict.fromkeys(("t_events", "y_events"), "crossings, which finds the states on a surface"),
    "shape": "run.{x}.shape",
    "to_numpy": "run.{x}, or np.asarray(run)",
    "parameters": "run.body.parameters",
    "savefig": "run.plot().figure.savefig(path)",
    **dict.fromkeys(
        ("resume", "continue_", "continue_run", "restart", "run_more"),
        "run.extend(steps), which continues the run",
    ),
    "select": "run.{x}[:, k], the states of trajectory k",
    **dict.fromkeys(("summary", "info"), "print(run), or suslov-fast info for a saved run"),
    **dict.fromkeys(
        ("message", "error", "errors", "status_counts", "status_text"),
        "run.status and run.failed_at, with a Status for each trajectory",
    ),
    **dict.fromkeys(
        ("to_netcdf", "to_zarr"),
        "run.to_xarray(), whose Dataset has them",
    ),
}
# Attributes of runs and of SciPy's results, and what crossings have.
INSTEAD_IN_CROSSINGS = {
    **dict.fromkeys(
        "x omega y u sol points y_events values data shape to_numpy".split(),
        "crossings.states, the points, or .before and .after",
    ),
    **dict.fromkeys(
        "index idx indices i orbit orbits which member".split(),
        "crossings.trajectory, the index of the trajectory of each crossing; n is the step",
    ),
    **dict.fromkeys(("t", "times", "t_events"), "crossings.time"),
    **dict.fromkeys(("success", "retcode"), "crossings.ok, or crossings.status"),
    **dict.fromkeys(("dt", "h", "step_size"), "crossings.eps, the step size"),
    "energy": "suslov_fast.energy(crossings.body, crossings.states)",
    "message": "crossings.status and crossings.failed_at, with a Status for each trajectory",
    **dict.fromkeys(
        ("to_netcdf", "to_zarr"),
        "crossings.to_xarray(), whose Dataset has them",
    ),
    "parameters": "crossings.body.parameters, or the coordinates of crossings.to_xarray()",
}

# The same for motions.
INSTEAD_IN_MOTIONS = {
    **{
        name: INSTEAD_IN_RUNS[name]
        for name in (
            "sel isel y u X values data trajectory trajectories solution sol T shape to_numpy "
            "parameters savefig select to_netcdf to_zarr F"
        ).split()
    },
    **dict.fromkeys(("t", "times", "n"), "run.time"),
    **dict.fromkeys(("success", "retcode"), "run.ok, or run.status for each trajectory"),
    **dict.fromkeys(("message", "error", "errors", "failed_at"), "run.status and run.end"),
    **dict.fromkeys(("final", "last"), "run.{x}[-1]"),
    **dict.fromkeys(("nfev", "nsteps", "n_steps"), "run.steps"),
    **dict.fromkeys(("dt", "h", "eps"), "run.steps, the number of steps, whose lengths vary"),
    **dict.fromkeys(("extend", "resume"), "flow again, from run.{x}[-1] and with later times"),
    **dict.fromkeys(("t_events", "y_events"), "crossings, which finds the states on a surface"),
}

# Names of the methods of `quantity`; `dir(run)` hides those that its map does not have.
QUANTITIES: set[str] = set()
_DOCUMENTED = """Return :func:`suslov_fast.{name}` of the states.

Returns
-------
ndarray(float)
    The values, in the units of the function; time is the first axis, (n, ...).

Raises
------
TypeError, ValueError
    If the system does not have this quantity.

Examples
--------
>>> run.{name}()  # doctest: +SKIP
"""


def quantity(name: str) -> Callable[[Any], FloatArray]:
    """Return a method that evaluates a public function for the states of a result."""

    def method(self: Any) -> FloatArray:
        values: FloatArray = self._value(name, self.states)
        return values

    method.__name__, method.__qualname__ = name, f"States.{name}"
    method.__doc__ = _DOCUMENTED.format(name=name)
    QUANTITIES.add(name)
    return public(method)


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The base of the results of runs, frozen dataclasses whose arrays are read-only.

    `_variable`, `_conserved` and `_value` are those of results of a map.
    """

    _instead: ClassVar[str] = ": pass its body, run.body"

    @property
    def _variable(self: Any) -> str:
        """The name of the states, "omega" or "x"."""
        name: str = self.map.variable
        return name

    @property
    def _conserved(self: Any) -> str | None:
        """The name of a conserved, or nearly conserved, quantity."""
        name: str | None = self.map.conserves(self.body)
        return name

    def _value(self: Any, name: str, states: FloatArray) -> FloatArray:
        """Return the values of a public function of the system for states."""
        from ..quantities.evaluation import evaluate

        return evaluate(name, self.body, states, self.eps, map=self.map)

    @staticmethod
    def _remade(name: str, value: object) -> str:
        return "change a copy of an array, such as run.final.copy()"

    def __post_init__(self) -> None:
        """Make arrays read-only: views of them, because a caller may go on writing to their own."""
        arrays = {k: value for k, value in vars(self).items() if isinstance(value, np.ndarray)}
        vars(self).update({k: read_only(array.view()) for k, array in arrays.items()})

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, without cached properties."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def __setstate__(self, attributes: dict[str, Any]) -> None:
        """Set the attributes of a new or unpickled result, whose arrays are in no other hands."""
        for value in attributes.values():
            if type(value) is np.ndarray:
                # `write`, by position twice as fast
                value.setflags(False)  # type: ignore[call-arg]
        object.__setattr__(self, "__dict__", attributes)

    @classmethod
    def _of(cls, attributes: dict[str, Any]) -> Self:
        """Return a result with these attributes, whose arrays are in no other hands."""
        result = cls.__new__(cls)
        result.__setstate__(attributes)  # faster than a call of the class
        return result

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        names = [item.name for item in fields(self) if item.compare]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)

    @public
    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the result to a file, without loss; `load` of its class reads it.

        Parameters
        ----------
        path : str or path-like
            A name that ends in .npz. The file appears under it only when it is complete.
        overwrite : bool
            Whether to replace an existing file.

        Raises
        ------
        FileExistsError
            If the file exists and `overwrite` is False.

        Examples
        --------
        >>> import tempfile
        >>> from suslov_fast import Suslov3D, Trajectories, iterate
        >>> run = iterate(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.2, steps=25)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     run.save(f"{folder}/run.npz")
        ...     Trajectories.load(f"{folder}/run.npz") == run
        True
        """
        from .files.storage import save

        save(self, path, overwrite)

    @classmethod
    @public
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the result in a file of `save`; `extend` can continue those of maps.

        Parameters
        ----------
        path : str or path-like
            The name of the file.

        Returns
        -------
        Trajectories, Crossings or Motion
            An instance of the class whose method this is, equal to the saved one.

        Raises
        ------
        FileNotFoundError
            If there is no file of this name.
        ValueError
            If the file is damaged, or holds something else.

        Examples
        --------
        >>> from suslov_fast import Trajectories
        >>> later = Trajectories.load("run.npz").extend(1000)  # doctest: +SKIP
        """
        from .files.storage import load

        return cls._of(load(path, cls.__name__))


class States(Result):
    """The base of `Trajectories` and `Motion`, which have states with time on the first axis.

    Subclasses have the attributes `states`, `body` and `status`, and for plots `_is_whole`, whether
    states follow one another, and `_heading`: what they are, how far orbits go, and the number of
    states of one.
    """

    states: FloatArray
    body: Any
    status: NDArray[np.int8]
    _is_whole: Any
    _heading: Any
    _functions: Any  # the names of the quantities that the system has
    _table: ClassVar[dict[str, str]] = {}  # attributes that it lacks, and what to use

    @property
    def omega(self) -> FloatArray:
        """The states of a body, its angular velocities, shape (n, ..., D)."""
        return self._states_called("omega")

    @property
    def x(self) -> FloatArray:
        """The states of a field, shape (n, ..., D)."""
        return self._states_called("x")

    def _states_called(self, name: str) -> FloatArray:
        if name != self._variable:
            raise AttributeError  # `__getattr__` words the message
        return self.states

    if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError that names the attribute to use instead, if there is one."""
            if "states" in vars(self):
                x = self._variable
                if name in ("omega", "x"):
                    raise AttributeError(
                        f"no attribute {name!r}: the states of this run are run.{x}"
                    )
                instead = self._table.get(name, "").format(x=x)
                labels = [*self.body._labels]
                alike = [k for k, label in enumerate(labels) if label.lower() == name.lower()]
                if name in labels or (alike and not instead):
                    instead = f"run.{x}[..., {labels.index(name) if name in labels else alike[0]}]"
                elif name in import_module("suslov_fast").__all__:
                    instead = f"suslov_fast.{name}(run.body, run.{x}, ...)"
                elif name in self.body.parameters:
                    instead = f"run.body.parameters[{name!r}]"
                here = "" if name.startswith("_") else import_module("suslov_fast")._here(name)
                if instead := instead or here or nearest(name, dir(self)):
                    raise AttributeError(f"no attribute {name!r}: use {instead}")
            raise AttributeError(f"a run has no attribute {name!r}", name=name, obj=self)

    def __dir__(self) -> list[str]:
        other = "x" if self._variable == "omega" else "omega"
        hidden = {other, *QUANTITIES} - {*self._functions}
        return [name for name in super().__dir__() if name not in hidden]

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, index: Any) -> FloatArray:
        if isinstance(index, str):
            labels = self.body._labels
            part = f"{self._variable}[..., {labels.index(index) if index in labels else 'k'}]"
            is_attribute = index in dir(self) and index not in labels
            raise TypeError(f"run[{index!r}]: use run.{index if is_attribute else part}")
        states: FloatArray = self.states[index]
        return states

    def __iter__(self) -> Iterator[FloatArray]:
        return iter(self.states)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is None:  # NumPy 1.26 does not accept None
            return np.asarray(self.states, dtype)
        return np.array(self.states, dtype, copy=copy)

    @property
    def ok(self) -> bool:
        """True if no trajectory failed; a passed pole is not a failure."""
        return bool((self.status >= 0).all())

    first_integral = quantity("first_integral")
    energy = quantity("energy")
    reaction = quantity("reaction")


def read_only(array: NDArray[T]) -> NDArray[T]:
    """Return an array after it was made read-only."""
    array.setflags(write=False)
    return array


def in_short(result: Any) -> str:
    """Return the step sizes and the number of failures of a result, as text."""
    low, high = np.min(result.eps, initial=np.inf), np.max(result.eps, initial=-np.inf)
    eps = f"{low:g} ... {high:g}" if low < high else f"{low:g}"
    return f"eps: {eps}, {count_in_words(result.status, result.first_pole)}"


def _equal(a: Any, b: Any) -> bool:
    """Return whether two attributes are equal, where NaN equals NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return type(a) is type(b) and bool(a == b)
