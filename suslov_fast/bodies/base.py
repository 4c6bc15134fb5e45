"""Base class of all bodies: immutable parameters, families, equality, text and plain data."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..checks import MOMENTS, OTHERS, FloatArray, common_shape, one_of, real_array, within, wrong

# Length of a line of text that represents a body.
_LINE = 100

Kind = TypeVar("Kind", bound="Body")


@dataclass(frozen=True, eq=False, repr=False)
class Body:
    """A body, or a batch of them; the fields of a subclass are its parameters."""

    # The number of axes of all parameters that are not axes of the batch.
    _vector_axes: ClassVar[int] = 0
    # The moments of inertia, and all parameters that are positive.
    _moments: ClassVar[tuple[str, ...]] = ()
    _positive: ClassVar[tuple[str, ...]] = ()
    # Names that `to_dict` has besides those of the parameters.
    _extras: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        arrays = {
            name: real_array(name, value)
            for name in self._names()
            if (value := getattr(self, name)) is not None or name in self._required()
        }
        for name, array in arrays.items():
            within(name, array, MOMENTS if name in self._moments else OTHERS)
            if name in self._positive and not (array > 0).all():
                raise wrong(name, "positive numbers", array.min())
        common_shape({name: self._batch_of(name, array) for name, array in arrays.items()})
        for name, array in arrays.items():
            object.__setattr__(self, name, _frozen(array))

    @classmethod
    def _names(cls) -> list[str]:
        """Return the names of the parameters, optional ones last."""
        return [field.name for field in fields(cls)]

    @classmethod
    def _required(cls) -> list[str]:
        """Return the names of the parameters of the map, which may not be left out."""
        return [field.name for field in fields(cls) if field.default is MISSING]

    @classmethod
    def _axes(cls, name: str) -> int:
        """Return the number of axes of a parameter that are not axes of the batch."""
        return cls._vector_axes

    @property
    def _values(self) -> dict[str, Any]:
        """The parameters that are set, by name: floats and read-only arrays."""
        named = {name: getattr(self, name) for name in self._names()}
        return {name: value for name, value in named.items() if value is not None}

    @property
    def _arrays(self) -> dict[str, FloatArray]:
        """The parameters that are set, as arrays of floats."""
        return {name: np.asarray(value, np.float64) for name, value in self._values.items()}

    @property
    def _coordinates(self) -> dict[str, FloatArray]:
        """Named parameters other than the fields of the class: coordinates of datasets."""
        return {}

    @classmethod
    def _of(cls: type[Kind], values: Mapping[str, Any]) -> Kind:
        """Return a body with parameters of another, or parts of them, which are not checked."""
        self = object.__new__(cls)
        frozen = {name: _frozen(np.asarray(each)) for name, each in values.items()}
        vars(self).update(dict.fromkeys(cls._names()) | frozen)
        return self

    def field(self) -> Any:
        """Return the equations of motion as a `QuadraticField`, exact for a single body."""
        raise wrong("body", "one with a quadratic vector field", type(self).__name__, TypeError)

    @property
    def parameters(self) -> Any:
        """The parameters of the map, in order."""
        return tuple(getattr(self, name) for name in self._required())

    @cached_property
    def batch_of_one(self) -> tuple[Any, ...]:
        """The parameters of a single body with an axis for the batch."""
        return tuple(np.array(each, ndmin=1 + self._vector_axes) for each in self.parameters)

    @property
    def dimension(self) -> int:
        """The number of components of a state."""
        return 2

    @property
    def _labels(self) -> tuple[str, ...]:
        """The labels of the components of a state."""
        return "Omega1", "Omega2"

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """The batch shape of the body, () for a single one."""
        return np.broadcast_shapes(*(self._batch_of(*item) for item in self._values.items()))

    def _batch_of(self, name: str, value: float | FloatArray) -> tuple[int, ...]:
        shape = np.shape(value)
        return shape[: len(shape) - self._axes(name)]

    def __len__(self) -> int:
        if not self.shape:
            raise wrong("body", "a batch", f"a single {type(self).__name__}", TypeError)
        return self.shape[0]

    def __iter__(self: Kind) -> Iterator[Kind]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self: Kind, index: int) -> Kind:
        """Return a member, or a slice, of a batch along its first axis."""
        size = len(self)
        if isinstance(index, slice):
            return self._part(0, index)
        try:
            i = operator.index(index)
        except TypeError:
            raise wrong("index", "an integer or a slice", f"{index!r:.60}", TypeError) from None
        if not -size <= i < size:
            raise wrong("index", f"an integer from {-size} to {size - 1}", i, IndexError)
        return self._part(0, i % size)

    def sel(self: Kind, *, method: str | None = None, **values: float) -> Kind:
        """Return the members of a batch that have given values of named parameters.

        Parameters
        ----------
        method : {None, "nearest"}
            "nearest" takes the nearest value that the batch has; by default only equal values.
        **values : float
            For each name the value. The parameter has to vary along one axis of the batch, which
            the result lacks.

        Returns
        -------
        body
            A single one, or a batch with fewer axes.

        Raises
        ------
        ValueError
            If no parameter of the batch has this name and varies along one axis, or if none of its
            values is the one that is given.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> bodies = Suslov3D(I1=[2, 3, 4], I2=1, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3)
        Suslov3D(I1=3.0, I2=1.0, I13=-0.5, I23=-0.3)
        >>> bodies.sel(I1=3.8, method="nearest").I1
        4.0
        """
        if method is not None:
            one_of("method", method, ["nearest"])
        for name, value in values.items():
            self = self._selected(name, value, method)
        return self

    def _selected(self: Kind, name: str, value: float, method: str | None) -> Kind:
        own = {each: a for each, a in self._arrays.items() if self._axes(each) == 0}
        known = own | self._coordinates
        axes = {each: _axes_of_change(a) for each, a in known.items()}
        if len(axes.get(name, [])) != 1:
            varying = ", ".join(each for each, of in axes.items() if len(of) == 1) or "none"
            what = f"parameters that vary along one axis ({varying})"
            raise wrong("sel", f"names of {what}", name)
        column, wanted = known[name].ravel(), real_array(name, value)
        if wanted.ndim:
            raise wrong(name, "a number", f"{value!r:.60}")
        i = int(np.argmin(abs(column - wanted)))
        if method is None and column[i] != wanted:
            low, high = column.min(), column.max()
            near = f'{wanted}; the nearest is {column[i]}, which method="nearest" takes'
            expected = f"one of its {column.size} values from {low} to {high}"
            raise wrong(name, expected, near)
        return self._part(len(self.shape) + axes[name][0], i)

    def _part(self: Kind, axis: int, index: int | slice) -> Kind:
        """Return the members with an index along one axis of the batch."""
        values, shape = self._arrays.items(), self.shape
        return self._of({n: cut(a, shape, axis, index, self._axes(n)) for n, a in values})

    @property
    def _key(self) -> tuple[Any, ...]:
        """The values that equal bodies share; -0.0 becomes 0.0."""
        values = self._arrays.items()
        return tuple((name, each.shape, (each + 0.0).tobytes()) for name, each in values)

    def __eq__(self, other: object) -> bool:
        return self._key == other._key if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._of, (self._values,)

    def __repr__(self) -> str:
        name, values = type(self).__name__, self._values.items()
        if sum(np.size(value) for _, value in values) <= _LINE // 4:
            text = ", ".join(f"{each}={np.asarray(value).tolist()!r}" for each, value in values)
            if len(text) < _LINE:
                return f"{name}({text})"
        text = ", ".join(
            f"{each}={value if np.ndim(value) == 0 else np.shape(value)}" for each, value in values
        )
        return f"<{name} of shape {self.shape}: {text}>"

    def to_dict(self) -> dict[str, Any]:
        """Return a dictionary of the class and the parameters, without loss, for JSON.

        Returns
        -------
        dict
            Numbers and nested lists by name, and under "body" the name of the class. Exact numbers
            of a field that are no floats are strings "p/q"; its H is the symmetric tensor in
            (x1, ..., xD, 1), and its named parameters are under "parameters".

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D(I1=[4, 3], I2=1, I13=-0.5, I23=-0.3).to_dict()
        {'body': 'Suslov3D', 'I1': [4.0, 3.0], 'I2': 1.0, 'I13': -0.5, 'I23': -0.3}
        """
        return {"body": type(self).__name__, **self._plain}

    @property
    def _plain(self) -> dict[str, Any]:
        return {name: np.asarray(value).tolist() for name, value in self._values.items()}

    @classmethod
    def from_dict(cls: type[Kind], parameters: Mapping[str, Any]) -> Kind:
        """Return the body of this class that :meth:`to_dict` describes.

        Parameters
        ----------
        parameters : mapping
            Numbers and nested lists by name, and under "body" the name of the class.

        Returns
        -------
        body

        Raises
        ------
        ValueError
            If the dictionary is that of another class, or lacks a parameter, or has others.

        Examples
        --------
        >>> from suslov_fast import Suslov3D
        >>> Suslov3D.from_dict({"body": "Suslov3D", "I1": 4, "I2": 1, "I13": -0.5, "I23": -0.3})
        Suslov3D(I1=4.0, I2=1.0, I13=-0.5, I23=-0.3)
        """
        given = dict(mapping(parameters))
        kind, names = given.pop("body", None), [*cls._names(), *cls._extras]
        if kind != cls.__name__:
            raise wrong("body", repr(cls.__name__), repr(kind))
        missing = ", ".join(name for name in cls._required() if name not in given)
        unknown = ", ".join(str(name) for name in given if name not in names)
        if missing or unknown:
            what = f"{missing} missing" if missing else f"{unknown} unknown"
            raise wrong("parameters", f"the names {', '.join(names)}", f"others: {what}")
        return cls._from_plain(given)

    @classmethod
    def _from_plain(cls: type[Kind], given: dict[str, Any]) -> Kind:
        return cls(**given)


def mapping(parameters: Any) -> Mapping[str, Any]:
    """Return the argument of `from_dict`; TypeError if it is no dictionary."""
    if isinstance(parameters, Mapping):
        return parameters
    text = isinstance(parameters, (str, bytes))
    received = "text: pass json.loads(text)" if text else type(parameters).__name__
    raise wrong("parameters", "a dictionary, as to_dict() returns it", received, TypeError)


def cut(array: Any, shape: tuple[int, ...], axis: int, index: Any, own: int) -> Any:
    """Return a part, along one axis of a batch, of a parameter with `own` axes besides."""
    place = axis - len(shape) + array.ndim - own
    if place < 0:
        return array
    if array.shape[place] < shape[axis]:  # it is the same for all members
        index = slice(None) if isinstance(index, slice) else 0
    return array[(slice(None),) * place + (index,)]


def _axes_of_change(array: FloatArray) -> list[int]:
    """Return the axes along which a parameter varies; the only one, though it has one value."""
    axes = [k for k in range(-array.ndim, 0) if array.shape[k] > 1]
    return axes or [-1] * (array.shape == (1,))


def _frozen(array: FloatArray) -> float | FloatArray:
    """Return a read-only copy of a parameter, or its number."""
    # Memory of a bytes object can never be made writeable.
    frozen = np.frombuffer(array.tobytes(), np.float64).reshape(array.shape)
    return frozen if array.ndim else float(array)
