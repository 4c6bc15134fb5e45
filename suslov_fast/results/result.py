"""The base of results: read-only arrays, equality, names, files, plots and datasets."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import fields
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..checks import FloatArray, integer, short, wrong
from ..fields.map import Map
from ..fields.state_functions import function_values
from ..keywords import lacking, public
from .schema import OF_KIND

if TYPE_CHECKING:
    import pandas
    import xarray

T = TypeVar("T", bound=np.generic)


class Result:
    """The base of the results of runs: frozen dataclasses with read-only arrays.

    Subclasses have the attributes `states` and `body`. Results of a map also have `map` and `eps`.
    """

    states: FloatArray
    body: Any
    status: Any
    _called: ClassVar[str] = "a run"  # name of the result in messages
    _by_number: ClassVar[str] = "run.states[k], or run.member(k) for one trajectory"
    _in_parts: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Replace arrays by read-only views, because a caller may go on to write to the arrays."""
        arrays = {k: value for k, value in vars(self).items() if isinstance(value, np.ndarray)}
        vars(self).update({k: read_only(array.view()) for k, array in arrays.items()})

    def __getstate__(self: Any) -> dict[str, Any]:
        """Return the fields, without cached properties."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def __setstate__(self, attributes: dict[str, Any]) -> None:
        """Set the attributes of an unpickled result."""
        vars(self).update(vars(self._of(attributes)))

    @classmethod
    def _of(cls, attributes: dict[str, Any]) -> Self:
        """Return a result with these attributes, and make its arrays read-only."""
        for value in attributes.values():
            if type(value) is np.ndarray:
                read_only(value)
        return cls._with(attributes)

    @classmethod
    def _with(cls, attributes: dict[str, Any]) -> Self:
        """Return a result with these attributes, in which all arrays are read-only."""
        result = object.__new__(cls)  # faster than a call of the class
        object.__setattr__(result, "__dict__", attributes)
        return result

    @classmethod
    def _restored(cls, attributes: dict[str, Any], about: dict[str, Any]) -> Self:
        """Return the result in a file, from its attributes and the description in the file."""
        return cls._of(attributes)

    def __eq__(self: Any, other: object) -> bool:
        if not isinstance(other, type(self)):
            return NotImplemented
        names = [item.name for item in fields(self) if item.compare]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the components of a state."""
        names: tuple[str, ...] = self.body._layout.names
        return names

    if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name

        def __getattr__(self, name: str) -> Any:
            """Raise an AttributeError that names the attribute to use instead, if there is one."""
            if "body" not in vars(self):
                raise AttributeError(name)
            here = ""
            labels = {label.lower(): label for label in self.body._layout.names}
            plain = name.lower().replace("_", "")
            if plain in labels:
                here = f"run[{labels[plain]!r}], or run.states for all"
            elif name in ("omega", "x"):
                here = "run.states"
            elif hasattr(type(self.body), name):
                here = f"run.body.{name}(run.states)"
            if name in self.body.parameters:
                here = f"run.body.parameters[{name!r}]"
            raise lacking(self, name, here)

    def __getitem__(self, name: str) -> FloatArray:
        """Return a component of the states by its name."""
        labels = self.body._layout.names
        if not isinstance(name, str):
            named = f"[{short(name)}] must be the name of one component, such as [{labels[0]!r}]"
            raise TypeError(f"{named}: use {self._by_number}")
        if name not in labels:
            known = f"run.{name}" if name in dir(self) else ", ".join(labels)
            if name in getattr(self, "derivatives", ()):
                known = f"run.derivatives[{name!r}]"
            raise KeyError(f"run[{name!r}] is no component: use {known}")
        return self.states[..., labels.index(name)]

    def __iter__(self) -> NoReturn:
        kind = type(self).__name__
        how = f"use .time and .states of the {kind}{self._in_parts}"
        raise TypeError(f"{self._called} is no sequence: {how}")

    def __len__(self) -> NoReturn:
        kind = type(self).__name__
        raise TypeError(f"{self._called} has no len: use len(run.time), or .states.shape of {kind}")

    def __bool__(self) -> bool:
        return True

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        if copy is None:  # NumPy 1.26 does not accept None
            return np.asarray(self.states, dtype)
        return np.array(self.states, dtype, copy=copy)

    @property
    def ok(self) -> NDArray[np.bool_]:
        """True where a trajectory did not fail, shape (...). Passing a pole is not a failure."""
        return read_only(np.asarray(self.status >= 0))

    def _members(self, index: tuple[int, ...]) -> dict[str, Any]:
        """Return the attributes of the result of one trajectory, from its index in the batch."""
        attributes = self.__getstate__()
        for column in OF_KIND[type(self).__name__]:
            before, is_of_batch, _ = column.axes.partition("batch")
            array = attributes.get(column.name)
            first: list[Any] = [slice(None)] * len(before.split())
            if is_of_batch and isinstance(array, np.ndarray):
                attributes[column.name] = np.array(array[(*first, *index)])
        body, eps = self.body, attributes.get("eps")
        attributes["body"] = body[place_in(body.shape, index)] if body.shape else body
        if isinstance(eps, np.ndarray):
            attributes["eps"] = float(eps[place_in(eps.shape, index)])
        return attributes

    @public
    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table with a row for each state or event, trajectory by trajectory.

        Returns
        -------
        pandas.DataFrame
            Its columns are "trajectory", the index in ``status.ravel()``, if there are several
            trajectories; "n", the number of the step, for a map; "which", the number of the event,
            for events; "time"; parameters that vary; and the components of the state.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> run = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=25)
        >>> run.to_dataframe().to_csv("states.csv", index=False)  # doctest: +SKIP
        """
        from .frames import table

        return table(self)

    @public
    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the result to a file, without loss; :func:`suslov_fast.load` reads it.

        Parameters
        ----------
        path : str or path-like
            A name that ends in .npz. The file gets this name when it is complete.
        overwrite : bool
            True replaces an existing file.

        Raises
        ------
        FileExistsError
            If the file exists and `overwrite` is False.

        Examples
        --------
        >>> import tempfile
        >>> from suslov_fast import Suslov3D, iterate, load
        >>> run = iterate(Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3), [1.0, 0.5], eps=0.2, steps=25)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     run.save(f"{folder}/run.npz")
        ...     load(f"{folder}/run.npz") == run
        True
        """
        from .files import save

        save(self, path, overwrite)


class States(Result):
    """The base of `Trajectories` and `Motion`, which have states with time on the first axis."""

    time: Any
    _t0: Any  # the time (...) at the start

    @public
    def energy(self) -> FloatArray:
        """Return the energy (n, ...) of the states, as :meth:`Suslov3D.energy` does."""
        return self._of_body("energy")(self.states, **self._times)

    @public
    def reactions(self) -> FloatArray:
        """Return the forces of reaction (n, ..., m), as ``field.mechanics.reactions`` does."""
        return self._of_body("mechanics").reactions(self.states, **self._times)

    @public
    def residuals(self) -> FloatArray:
        """Return by how much states violate constraints, as ``field.mechanics.residuals`` does."""
        return self._of_body("mechanics").residuals(self.states, **self._times)

    @public
    def first_integral(self) -> FloatArray:
        """Return the first integral (n, ...), as :meth:`Suslov3D.first_integral` does."""
        return self._of_body("first_integral")(self.states, vars(self).get("eps", 0.0))

    @public
    def values(self, f: Any, /) -> FloatArray:
        """Return the values of a function of the state along the run.

        Parameters
        ----------
        f : callable or str, or sequence of str
            A function of the state and of parameters of the system by name, as in :class:`Event`;
            or formulas of their names. It may take the time, unless the run is one of a map.

        Returns
        -------
        ndarray(float, shape=(n, ...) or (n, ..., m))
            One number for each saved state, or m of them if f returns m; NaN where there is no
            state.

        Examples
        --------
        >>> import numpy as np
        >>> from suslov_fast import Field, flow
        >>> family = Field(lambda x, k: (x[1], -k * x[0]), "x v", k=[1.0, 4.0])
        >>> motion = flow(family, [1.0, 0.0], time=np.linspace(0, 10, 101))
        >>> energy = motion.values(lambda s, k: s[1] ** 2 / 2 + k * s[0] ** 2 / 2)
        >>> energy.shape, bool(np.ptp(energy, axis=0).max() < 1e-8)
        ((101, 2), True)
        >>> motion.values("k*x").shape
        (101, 2)
        """
        if isinstance(self.body, Map):
            return read_only(
                function_values(self.body, f, self.body._layout.enter("x", self.states))
            )
        system = self.body._field._timed
        at = None if system._layout.clock is None else self._t
        return read_only(function_values(system, f, system._layout.enter("x", self.states, at)))

    @property
    def _t(self) -> FloatArray:
        """The time t of each state, (n, ...)."""
        axes = self.states.ndim - 1 - self.time.ndim
        found: FloatArray = self._t0 + self.time.reshape(*self.time.shape, *(1,) * axes)
        return found

    @property
    def _times(self) -> dict[str, Any]:
        """The time of each state as an argument of functions of the body, if it reads the time."""
        return {} if self.body._layout.clock is None else {"t": self._t}

    def _of_body(self, name: str) -> Any:
        """Return an attribute of the body, if it has one."""
        if not hasattr(type(self.body), name):
            raise lacking(self.body, name)
        return getattr(self.body, name)

    @public
    def plot(
        self,
        *names: int | str | Sequence[int | str],
        lines: bool | None = None,
        color: Any = None,
        ax: Any = None,
        label: str | None = None,
        **style: Any,
    ) -> Any:
        """Draw the states over two components, over time, or in space (extra `plots`).

        For a chain of many variables ``ax.imshow(run.states, aspect="auto")`` draws a picture over
        space and time. A single motion at one or two times is drawn at 201 times.

        Parameters
        ----------
        *names : int, str or list of these
            The components to draw: two or three indices or names, also "time"; by default the first
            two components. Three components are drawn in space. ``run.plot("x1")`` draws one
            component over time, ``run.plot("time", ["x1", "x3"])`` draws two, and
            ``run.plot("time")`` draws all.
        lines : bool, optional
            True joins consecutive states by lines, False draws dots. By default states are joined
            if they are at most 100,000 and lie close together.
        color : str or array_like(float, shape=(...)), optional
            A parameter that varies or "eps" by name; a number for each trajectory, as
            ``run.energy()[0]``; or a colour of Matplotlib. By default colours show the parameter of
            a family. Without a family trajectories have different colours, and up to 8 are in a
            legend. If several components are drawn over time, each has a colour. Line styles, or
            the label of the colour bar, show a second parameter that varies.
        ax : matplotlib.axes.Axes, optional
            Axes to draw on, 3-D axes for three components; by default axes of a new figure.
        label : str, optional
            The name of the run in ``ax.legend()``.
        **style
            Properties of Matplotlib's `Line2D`, such as ``linewidth=2``.

        Returns
        -------
        matplotlib.axes.Axes

        Examples
        --------
        >>> from suslov_fast import Field, iterate
        >>> predators = lambda x: (x[0] - x[0] * x[1], x[0] * x[1] - x[1])
        >>> field = Field(predators, "prey predator")
        >>> run = iterate(field, [[1.0, 0.5], [1.0, 0.3]], eps=1 / 64, steps=1000)
        >>> run.plot().figure.savefig("orbits.png")  # doctest: +SKIP
        >>> run.plot("time").figure.savefig("over_time.png")  # doctest: +SKIP
        """
        from . import figures  # this imports Matplotlib

        chosen = self.body._layout.drawn(names or (0, 1))
        return figures.plot_run(self._to_draw(), chosen, lines, color, ax, label, style)

    def _to_draw(self) -> Self:
        return self

    @public
    def member(self, k: int | tuple[int, ...], /) -> Self:
        """Return the run of one trajectory.

        Parameters
        ----------
        k : int or tuple of int
            The number of the trajectory, or one number for each axis of the batch.

        Returns
        -------
        Trajectories or Motion
            A run with the batch shape (), equal to the run of this trajectory alone.

        Raises
        ------
        TypeError, ValueError
            If k does not have one integer for each axis, or an integer is out of range.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> run = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=25)
        >>> run.member(1) == iterate(body, [0.2, -0.7], eps=0.2, steps=25)
        True
        """
        index, batch = k if isinstance(k, tuple) else (k,), self.status.shape
        if not batch:
            raise TypeError("member: the run is that of one trajectory already")
        if len(index) != len(batch):
            expected = f"an integer for each axis of the batch {batch}"
            raise wrong("k", expected, short(k), TypeError)
        places = (
            integer("k", number, -n, f"from {-n} to {n - 1}", n - 1) % n
            for number, n in zip(index, batch, strict=True)
        )
        return self._of(self._members(tuple(places)))

    @public
    def to_xarray(self) -> xarray.Dataset:
        """Return the run as a labelled `xarray.Dataset` (extra `xarray`).

        Returns
        -------
        xarray.Dataset
            Its dimensions are "n" for a run of a map or "time" for a motion, the axes of the batch,
            and "component". If parameters or eps vary along a single axis, the axis has the name
            and the values of the first of them, as in ``data.sel(eps=0.2)``. Other axes are
            "trajectory" or, if the batch has several axes, "batch_0", "batch_1", ... The states are
            one variable, so that a file has them once: ``data.states.sel(component="x")``, or
            ``data.states.to_dataset("component")`` with a variable for each component.

        Examples
        --------
        >>> from suslov_fast import Suslov3D, iterate
        >>> body = Suslov3D(I1=4, I2=1, I13=-0.5, I23=-0.3)
        >>> orbits = iterate(body, [[1.0, 0.5], [0.2, -0.7]], eps=0.2, steps=25)
        >>> data = orbits.to_xarray().assign_coords(trajectory=["fast", "slow"])
        >>> data.states.sel(trajectory="slow", n=0, component="Omega2").item()
        -0.7
        """
        from .frames import to_xarray

        return to_xarray(self)


@public
def load(path: str | os.PathLike[str]) -> Any:
    """Return the result that `save` has written to a file.

    Parameters
    ----------
    path : str or path-like
        The name of the file.

    Returns
    -------
    Trajectories, Events or Motion
        A result of the same class, equal to the saved one.

    Raises
    ------
    FileNotFoundError
        If there is no file of this name.
    ValueError
        If the file is damaged, or contains something else.

    Examples
    --------
    >>> import tempfile
    >>> from suslov_fast import Field, flow, load
    >>> motion = flow(Field(lambda x: (-x[0],), 1), [1.0], time=[0.0, 1.0])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     motion.save(f"{folder}/motion.npz")
    ...     load(f"{folder}/motion.npz") == motion
    True
    """
    from .files import load

    return load(path)


def place_in(shape: tuple[int, ...], index: tuple[int, ...]) -> tuple[int, ...]:
    """Return the index of a trajectory in an array of a shape that broadcasts with the batch."""
    last = index[len(index) - len(shape) :]
    return tuple(0 if n == 1 else k for k, n in zip(last, shape, strict=True))


@lru_cache(128)
def zeros_of(batch: tuple[int, ...], kind: Any = np.int8) -> NDArray[Any]:
    """Return zeros of the shape `batch`, read-only, so that results can share them."""
    return read_only(np.zeros(batch, kind))


def times_of(t0: Any, batch: tuple[int, ...]) -> FloatArray:
    """Return the times (...) at the starts of a batch, by default 0."""
    if t0 is None:
        return zeros_of(batch, np.float64)
    return read_only(np.array(np.broadcast_to(t0, batch), np.float64))


def read_only(array: NDArray[T]) -> NDArray[T]:
    """Make an array read-only, and return it."""
    array.setflags(False)  # type: ignore[call-arg]  # faster than by keyword
    return array


def _equal(a: Any, b: Any) -> bool:
    """Return True if two attributes are equal; NaN equals NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=True)
    return type(a) is type(b) and bool(a == b)
