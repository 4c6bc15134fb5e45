"""The base of the results of runs: read-only arrays, equality, copies and files."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray
from ..engine.status import count_in_words
from ..keywords import public

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
    "local_error": "iterate(..., method='extrapolated'), whose steps estimate their errors",
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

# Names of the methods of `quantity`; `dir(run)` hides those that its map does not have.
QUANTITIES: set[str] = set()
_DOCUMENTED = """Return :func:`suslov_fast.{name}` of the saved states.

Returns
-------
ndarray(float)
    The values, in the units of the function; time is the first axis, (n_saved, ...).

Raises
------
TypeError, ValueError
    If the map of the run does not have this quantity.

Examples
--------
>>> run.{name}()  # doctest: +SKIP
"""


def quantity(name: str) -> Callable[[Any], FloatArray]:
    """Return a method of `Trajectories` that evaluates a public function for the saved states."""

    def method(self: Any) -> FloatArray:
        values: FloatArray = self._value(name, self.states)
        return values

    method.__name__, method.__qualname__ = name, f"Trajectories.{name}"
    method.__doc__ = _DOCUMENTED.format(name=name)
    QUANTITIES.add(name)
    return public(method)


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The base of `Trajectories` and `Crossings`, frozen dataclasses whose arrays are read-only."""

    _instead: ClassVar[str] = ": pass its body, run.body"

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
        from .storage import save

        save(self, path, overwrite)

    @classmethod
    @public
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the result in a file of `save`, which `extend` can continue.

        Parameters
        ----------
        path : str or path-like
            The name of the file.

        Returns
        -------
        Trajectories or Crossings
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
        from .storage import load

        return cls._of(load(path, cls.__name__))


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
